"""Gyroscope bias of a hand-rotated log from its rests, and what makes it change between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.calibration.freepose.rests import Rests
from schuler.calibration.result.rest_causes import RestCause, rest_causes
from schuler.calibration.result.rest_scatter import RestScatter, rest_scatter
from schuler.recording.series import ImuSeries

#: Fewest poses in which g-sensitivity is looked for.
FEWEST_FOR_FORCE = 12


@dataclass(frozen=True, eq=False)
class TurnBias:
    """A held bias less that in every turn, where the bias scatters between rests.

    Attributes
    ----------
    covariance : ndarray, shape (3, n, n)
        Of axis and turns. [(rad/s)^2]
    cross : ndarray, shape (n, 3)
        Covariance with the error of the held bias. [(rad/s)^2]
    """

    covariance: FloatArray
    cross: FloatArray

    def scaled(self, factor: float) -> TurnBias:
        """The same in another unit of the log."""
        return TurnBias(factor**2 * self.covariance, factor**2 * self.cross)

    def in_residuals(self, by_bias: FloatArray) -> FloatArray:
        """Covariance of two residuals a turn with derivatives ``by_bias`` (2 n, 3). Shape (2 n, 2 n). [rad^2]"""
        n = len(self.cross)
        by = by_bias.reshape(n, 2, 3)
        V = np.einsum("kai,ikl,lci->kalc", by, self.covariance, by, optimize=True)
        return np.asarray(V.reshape(2 * n, 2 * n))


@dataclass(frozen=True, eq=False)
class RestBias:
    """Bias at rest, in units of the log.

    Attributes
    ----------
    value, sigma : ndarray, shape (3,)
    seconds : float
        Time it was taken over. [s]
    by_force : bool
        Whether the g-sensitivity is estimated with it.
    scatter : RestScatter
        Rates at rest, fitted with a constant, and with specific force if ``by_force``.
    causes : tuple of RestCause
        What the rates at rest follow, the likeliest first.
    white : ndarray, shape (n, 3)
        1 sigma of the mean rates at rest by white noise.
    """

    value: FloatArray
    sigma: FloatArray
    seconds: float
    by_force: bool
    scatter: RestScatter
    causes: tuple[RestCause, ...]
    white: FloatArray


def bias_at_rest(
    rates: ImuSeries, rests: Rests, f: FloatArray, initial_rest_s: float | None, g_sensitivity: bool | None
) -> RestBias:
    """Bias of the gyroscopes from the rates at rest, with the scatter between rests in its sigma.

    Parameters
    ----------
    rates : ImuSeries
    rests : Rests
    f : ndarray, shape (n, 3)
        Calibrated specific force in them. [m/s^2]
    initial_rest_s : float or None
        The bias is the mean of the first seconds; it differs from that of the log by the scatter. None: of all rests.
    g_sensitivity : bool or None
        None: if the log proves it.

    Returns
    -------
    RestBias
    """
    t, white = _times_and_noise(rates, rests)
    scatter = rest_scatter(t, rests.gyro, white)
    T = rates.temperature
    warm = None if T is None else np.array([T[a:b].mean() for a, b in rests.index])
    causes = tuple(rest_causes(t, rests.gyro, white, scatter, f=f, temperature=warm))
    by_force = bool(g_sensitivity)
    if g_sensitivity is None and len(rests) >= FEWEST_FOR_FORCE:
        by_force = any(cause.name == "g-sensitivity" and cause.decisive for cause in causes)
    constant = scatter
    if by_force and len(rests) > 4:
        scatter = rest_scatter(t, rests.gyro, white, np.column_stack((np.ones(len(t)), f)))
    if initial_rest_s is None:
        sigma = np.sqrt(constant.covariance[:, 0, 0])
        return RestBias(constant.values[0], sigma, float(rests.duration.sum()), by_force, scatter, causes, white)
    n = int(np.searchsorted(rates.t, rates.t[0] + initial_rest_s))
    sigma = np.hypot(rests.density_g / np.sqrt(n * rates.interval), constant.sigma)
    return RestBias(rates.gyro[:n].mean(axis=0), sigma, n * rates.interval, by_force, scatter, causes, white)


def bias_difference(rates: ImuSeries, rests: Rests, first: BoolArray) -> FloatArray:
    """Variance of the difference between the biases of some rests and of the others. Shape (3,), units of the log^2.

    ``first`` (n,) says which. One scatter for all rests, with two constants: where the two are mixed in time, what
    drifts slowly is common to them and no part of it.
    """
    t, white = _times_and_noise(rates, rests)
    P = rest_scatter(t, rests.gyro, white, np.column_stack((first, ~first)).astype(np.float64)).covariance
    return np.asarray(P[:, 0, 0] + P[:, 1, 1] - 2.0 * P[:, 0, 1])


def bias_in_turns(scatter: RestScatter, white: FloatArray, pair: IntArray) -> TurnBias:
    """Bias of all rests less that in every turn, which is tied to those in the rests before and after it.

    What drifts slowly is common to a turn and its rests: it makes the bias of the log uncertain, but not the turn.
    Between two rests the bias is taken for a Brownian bridge: its mean is that of both ends, with a twelfth of the
    variance of their difference.

    Parameters
    ----------
    scatter : RestScatter
        Of rates at rest, fitted with a constant.
    white : ndarray, shape (m, 3)
        1 sigma of these rates by white noise. [x]
    pair : ndarray of int, shape (n, 2)
        Rests before and after each turn.

    Returns
    -------
    TurnBias
        Of errors of the bias that weights by ``scatter.rests`` give. [x^2]
    """
    n = len(pair)
    A = np.zeros((n, len(white)))
    np.add.at(A, (np.repeat(np.arange(n), 2), pair.ravel()), 0.5)
    covariance, cross = np.empty((3, n, n)), np.empty((n, 3))
    for i, V in enumerate(scatter.rests):
        S = V - np.diag(white[:, i] ** 2)
        w = np.linalg.solve(V, np.ones(len(V)))
        w /= w.sum()
        common, own = float(w @ V @ w), A @ S @ w
        a, b = pair.T
        bridge = (S[a, a] + S[b, b] - 2.0 * S[a, b]) / 12.0
        covariance[i] = A @ S @ A.T - own[:, None] - own + common + np.diag(bridge)
        cross[:, i] = common - own
    return TurnBias(covariance, cross)


def _times_and_noise(rates: ImuSeries, rests: Rests) -> tuple[FloatArray, FloatArray]:
    """Middles of the rests (n,) [s] and 1 sigma of their mean rates by white noise (n, 3), in units of the log."""
    t = 0.5 * (rates.t[rests.index[:, 0]] + rates.t[rests.index[:, 1] - 1])
    return np.asarray(t), np.asarray(rests.density_g / np.sqrt(rests.duration)[:, None])
