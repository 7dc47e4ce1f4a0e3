"""Consistency of a filter: normalised errors against chi-square bands, and filtered against smoothed solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames, rotation
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.measurements import REJECTED
from schuler.plotting.notebook import Abridged
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.gnss.ranges import Ranges
    from schuler.navigation.result import Innovations, NavigationResult


def attitude_difference(q_hat_eb: FloatArray, q_eb: FloatArray) -> FloatArray:
    """Rotation vector ``dpsi`` with ``C_hat = exp([dpsi x]) C``, Earth-fixed axes. Shapes (n, 4) to (n, 3). [rad]"""
    return rotation.rotvec_from_quat(rotation.quat_multiply(q_hat_eb, rotation.quat_conjugate(q_eb)))


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
        True parameters, constant or at each record; without them only the nine navigation errors are returned.

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
    """Normalised estimation error squared at the records, per degree of freedom: 1 on average for a consistent filter.

    Parameters
    ----------
    result, reference, parameters
        See :func:`state_errors`.

    Returns
    -------
    ndarray, shape (j,)
        NaN at records whose variances are not positive.

    Raises
    ------
    InputError
        If a covariance is singular.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), section 5.4.2.
    """
    _, dx, P = state_errors(result, reference, parameters)
    variance = np.einsum("kii->ki", P)
    usual = (variance > 0.0).all(axis=1)
    scale = np.sqrt(variance[usual])  # solve in units of sigma: positions and biases differ by 1e9
    correlation = P[usual] / (scale[:, :, None] * scale[:, None, :])
    z = dx[usual] / scale
    squared = np.full(len(dx), np.nan)
    try:
        squared[usual] = np.einsum("ki,ki->k", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        raise InputError(
            "nees: expected covariances that can be inverted, got a singular one: two states of the run are the same, "
            "or its covariance broke down (see its verdict)"
        ) from None
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


#: Fixes and measurements closer than this are the same. [s]
SAME_TIME = 1e-5
#: Share of rejections that does not count against a filter.
_RARE = 0.02


def mean_nis(inn: Innovations) -> tuple[float, bool]:
    """Mean normalised square per component, and whether it is as predicted.

    Predicted means between 0.64 and 1.56 (sizes wrong by a quarter), or inside the 99.9 % band of so many values. The
    rejected are left out as long as they are few (2 %): single faults are for the gate. If they are many, it is the
    filter that is wrong.
    """
    inn = inn.where(judged(inn))
    if not len(inn):
        return float("nan"), True
    mean = inn.mean_nis()
    low, high = chi_square_band(1, int(inn.freedom.sum()), 0.999)
    return mean, bool(min(low, 0.64) <= mean <= max(high, 1.5625))


def judged(inn: Innovations) -> BoolArray:
    """Innovations that count for consistency: those tested, less rare rejections of a kind. Shape (n,)."""
    tested = np.isfinite(inn.nis)
    keep = tested.copy()
    for kind in np.unique(inn.kind[tested]):
        rejected = tested & (inn.kind == kind) & (inn.status == REJECTED)
        if rejected.sum() <= _RARE * np.sum(tested & (inn.kind == kind)):
            keep &= ~rejected
    return keep


def matched_satellites(t: FloatArray, ranges: Ranges, value: FloatArray) -> IntArray:
    """Satellite of each innovation, 0 if unknown.

    The filter takes the ranges of an epoch in their order: the place among the innovations of one time identifies the
    satellite.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the innovations. [s]
    ranges : Ranges
        Ranges of the run.
    value : ndarray, shape (k,)
        Pseudoranges or range rates; those not finite were not offered.

    Returns
    -------
    ndarray of int, shape (n,)
        0 in epochs that have another number of ranges than of innovations: then these are other ranges.
    """
    satellite = np.zeros(len(t), dtype=np.int64)
    rows = np.flatnonzero(ranges.used & np.isfinite(value))
    if not len(rows) or not len(t):
        return satellite
    epochs, first, many = np.unique(ranges.t[rows], return_index=True, return_counts=True)
    times, begin, count = np.unique(t, return_index=True, return_counts=True)
    k, distance = nearest(times, epochs)
    same = (distance < SAME_TIME) & (many[k] == count)
    place = np.arange(len(t)) - np.repeat(begin, count)
    finite = np.repeat(same, count)
    at = (np.repeat(first[k], count) + place)[finite]
    satellite[finite] = ranges.sat[rows[at]]
    return satellite


def nearest(t: FloatArray, among: FloatArray) -> tuple[IntArray, FloatArray]:
    """Index of the nearest of increasing times, and how far it is. Shapes (n,), (n,). [s]"""
    k = np.clip(np.searchsorted(among, t), 1, max(len(among) - 1, 1))
    left = np.clip(k - 1, 0, len(among) - 1)
    right = np.clip(k, 0, len(among) - 1)
    k = np.where(np.abs(among[left] - t) <= np.abs(among[right] - t), left, right)
    return k.astype(np.int64), np.abs(among[k] - t)


@dataclass(frozen=True, repr=False)
class Separation(Abridged):
    """Filtered minus smoothed at the records.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    difference : ndarray, shape (k, 9)
        Attitude, velocity, position about or along north, east, down. [rad], [m/s], [m]
    covariance : ndarray, shape (k, 9, 9)
        Covariance of the difference for a consistent filter, ``P_f - P_s``.
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

        Only records where the smoother added something: elsewhere both solutions agree and the ratio is undefined.
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
    """Filtered minus smoothed solution of one run, with the covariance that this difference should have.

    The difference has the covariance ``P_f - P_s``, what the later measurements added; a difference beyond that says
    that the model is wrong, where no reference is at hand.

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
    # of the sensors' axes: what is not known of the body's is in both alike
    P_f, P_s = (r._in_ned(r.filter_covariance_e())[:, :9, :9] for r in (filtered, smoothed))
    return Separation(filtered.t, difference, P_f - P_s, filtered.outages)
