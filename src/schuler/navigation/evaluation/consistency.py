"""Is a filter as good as it says? Normalised errors against their chi-square bands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.navigation.evaluation.errors import attitude_difference
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


def state_errors(
    result: NavigationResult, reference: Trajectory, parameters: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error vectors at the records, with the covariance that was claimed for them.

    Parameters
    ----------
    result : NavigationResult
    reference : Trajectory
        Truth of the IMU with velocity and attitude, covering the records.
    parameters : array_like, shape (m,) or (k, m), optional
        True parameters, constant or at each record; left out, only the nine navigation errors are looked at.

    Returns
    -------
    t : ndarray, shape (j,)
        Times of the records inside the reference. [s]
    dx : ndarray, shape (j, n)
        Estimate minus truth, Earth-fixed axes, order of the layout.
    P : ndarray, shape (j, n, n)

    Raises
    ------
    InputError
        If the reference lacks velocity or attitude, or has no time in common with the records.
    """
    if reference.v_eb_e is None or reference.q_eb is None:
        raise InputError("state errors need a reference with velocity and attitude")
    inside = (result.t >= reference.t[0] - 1e-9) & (result.t <= reference.t[-1] + 1e-9)
    if not inside.any():
        raise InputError(
            f"no record of the solution ({result.t[0]:.3f}..{result.t[-1]:.3f} s) lies within the reference "
            f"({reference.t[0]:.3f}..{reference.t[-1]:.3f} s)"
        )
    t = result.t[inside]
    truth = reference.at(np.clip(t, reference.t[0], reference.t[-1])).full()
    s = result.states
    columns = [
        attitude_difference(s.q_eb[inside], truth.q_eb),
        s.v_eb_e[inside] - truth.v_eb_e,
        s.r_eb_e[inside] - truth.r_eb_e,
    ]
    P = result.covariance_e[inside]
    if parameters is None:
        return t, np.concatenate(columns, axis=1), P[:, :9, :9]
    p = as_floats(parameters, "parameters")
    m = result.layout.size - 9
    if p.shape not in ((m,), (len(result.t), m)):
        raise InputError(f"parameters: expected shape ({m},) or ({len(result.t)}, {m}), got {p.shape}")
    truth_p = np.broadcast_to(p, result.parameters.shape)[inside]
    return t, np.concatenate([*columns, result.parameters[inside] - truth_p], axis=1), P


def nees(result: NavigationResult, reference: Trajectory, parameters: ArrayLike | None = None) -> FloatArray:
    """Normalised estimation error squared at the records, per degree of freedom: 1 on average for an honest filter.

    Parameters
    ----------
    result, reference, parameters
        See :func:`state_errors`.

    Returns
    -------
    ndarray, shape (j,)

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), section 5.4.2.
    """
    _, dx, P = state_errors(result, reference, parameters)
    scale = np.sqrt(np.einsum("kii->ki", P))  # solve in units of sigma: positions and biases differ by 1e9
    correlation = P / (scale[:, :, None] * scale[:, None, :])
    z = dx / scale
    squared = np.einsum("ki,ki->k", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0])
    per_degree: FloatArray = squared / dx.shape[1]
    return per_degree


def chi_square_band(degrees: int, runs: int = 1, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided band of a mean chi-square per degree of freedom.

    Parameters
    ----------
    degrees : int
        Degrees of freedom of one value.
    runs : int
        Independent values averaged.
    probability : float

    Returns
    -------
    low, high : float
        The mean of ``runs`` values of chi-square / degrees lies between them with the given probability.
    """
    from scipy.special import gammaincinv

    k = degrees * runs
    tail = 0.5 * (1.0 - probability)
    return float(2.0 * gammaincinv(0.5 * k, tail) / k), float(2.0 * gammaincinv(0.5 * k, 1.0 - tail) / k)
