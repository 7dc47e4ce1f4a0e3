"""How far the filtered solution lies from the smoothed one, and how far it may: a test that needs no truth.

For an honest filter the difference between the filtered and the smoothed state has the covariance ``P_f - P_s``: what
the later measurements added. A difference beyond that says that the model is wrong, wherever no reference is at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.errors import attitude_difference
from schuler.navigation.result import NavigationResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Separation:
    """Filtered minus smoothed at the records.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    difference : ndarray, shape (k, 9)
        Attitude, velocity, position about or along north, east, down. [rad], [m/s], [m]
    covariance : ndarray, shape (k, 9, 9)
        What an honest filter expects of it, ``P_f - P_s``.
    outages : tuple of (start, stop)
        [s]
    """

    t: FloatArray
    difference: FloatArray
    covariance: FloatArray
    outages: tuple[tuple[float, float], ...] = ()

    @property
    def sigma(self) -> FloatArray:
        """Expected 1-sigma of the difference. Shape (k, 9)."""
        sigma: FloatArray = np.sqrt(np.maximum(np.einsum("kii->ki", self.covariance), 0.0))
        return sigma

    def normalised(self) -> FloatArray:
        """Squared position difference over its covariance, per degree of freedom; 1 for an honest filter. Shape (j,).

        Only records where the smoother added something: elsewhere both solutions are one and the ratio says nothing.
        """
        d, P = self.difference[:, 6:], self.covariance[:, 6:, 6:]
        low = np.linalg.eigvalsh(P)[:, 0] if len(P) else np.empty(0)
        keep = low > 1e-3 * np.einsum("kii->k", P) / 3.0
        squared: FloatArray = (
            np.einsum("ki,ki->k", d[keep], np.linalg.solve(P[keep], d[keep][:, :, None])[:, :, 0]) / 3.0
        )
        return squared

    def plot(self) -> Figure:
        """See :func:`schuler.navigation.evaluation.figures.plot_separation`."""
        from schuler.navigation.evaluation.figures import plot_separation

        return plot_separation(self)


def separation(filtered: NavigationResult, smoothed: NavigationResult | None = None) -> Separation:
    """Compare a solution with its smoothed twin.

    Parameters
    ----------
    filtered : NavigationResult
    smoothed : NavigationResult, optional
        Default: smoothed here.

    Raises
    ------
    InputError
        If the two are not of one run.

    References
    ----------
    Rauch, Tung, Striebel (1965), AIAA Journal 3(8), for the covariance of the smoothed state.
    """
    smoothed = filtered.smooth() if smoothed is None else smoothed
    if filtered.smoothed or not smoothed.smoothed or not np.array_equal(filtered.t, smoothed.t):
        raise InputError("expected the filtered and the smoothed solution of one run, in this order")
    f, s = filtered.states, smoothed.states
    C = frames.C_en(s.llh)
    parts = (attitude_difference(f.q_eb, s.q_eb), f.v_eb_e - s.v_eb_e, f.r_eb_e - s.r_eb_e)
    difference = np.concatenate([np.einsum("nji,nj->ni", C, p) for p in parts], axis=1)
    P = filtered.covariance[:, :9, :9] - smoothed.covariance[:, :9, :9]
    return Separation(filtered.t, difference, P, filtered.outages)
