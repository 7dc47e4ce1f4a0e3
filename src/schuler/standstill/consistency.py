"""Checks of candidate rests: specific force keeps its direction, the mean rate agrees with the other rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import earth
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.recording.series import ImuSeries
from schuler.units import DEG

#: Prior 1-sigma of an unknown gyro bias. [rad/s]
_ANY_BIAS = 10.0
#: Standard deviation of a normal distribution over the median of its absolute values.
NORMAL = 1.4826
#: Fewest rests from which their common scatter is estimated.
_FEWEST = 5


@dataclass(frozen=True)
class Contrasts:
    """Thirds of intervals compared, relative to white noise of the samples.

    Attributes
    ----------
    drift : ndarray, shape (k, 3)
        Last third less first; of unit variance if the noise is white and nothing drifts.
    sigma : ndarray, shape (k, 3)
        Standard deviation of that difference for white noise. [x]
    colour : float
        Robust standard deviation of second differences, first less twice second plus third, which are independent of
        ``drift`` and unchanged by it; not below 1, its value for white noise.
    """

    drift: FloatArray
    sigma: FloatArray
    colour: float


def contrasts(x: FloatArray, index: IntArray, sigma: FloatArray) -> Contrasts:
    """Contrasts of a triad.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Time along axis 0.
    index : ndarray of int, shape (k, 2)
        Intervals: first sample and one past the last, nine or more samples each.
    sigma : ndarray, shape (3,)
        Standard deviation of a sample at rest. [x]

    Returns
    -------
    Contrasts
        Second differences of ninths are used too, since those of thirds are few in logs of one or two rests.
    """
    drift: list[FloatArray] = []
    scale: list[FloatArray] = []
    second: dict[int, list[FloatArray]] = {3: [], 9: []}
    for a, b in index:
        for parts, out in second.items():
            m = (b - a) // parts
            means = x[a : a + parts * m].reshape(parts, m, 3).mean(axis=1)
            triples = means.reshape(-1, 3, 3)
            out.append((triples[:, 0] - 2.0 * triples[:, 1] + triples[:, 2]) / (sigma * np.sqrt(6.0 / m)))
            if parts == 3:
                scale.append(sigma * np.sqrt(2.0 / m))
                drift.append((means[2] - means[0]) / scale[-1])
    # nine values or more, or the median says little
    colours = [_robust_sigma(np.concatenate(z)) for parts, z in second.items() if parts * len(z) >= 9]
    return Contrasts(np.array(drift).reshape(-1, 3), np.array(scale).reshape(-1, 3), max([1.0, *colours]))


def constant_direction(
    rates: ImuSeries, index: IntArray, sigma_f: FloatArray, *, max_creep: float, limit: float
) -> tuple[BoolArray, list[str]]:
    """Test whether specific force keeps its direction.

    Parameters
    ----------
    rates : ImuSeries
    index : ndarray of int, shape (k, 2)
        Intervals.
    sigma_f : ndarray, shape (3,)
        Standard deviation of a sample at rest. [m/s^2]
    max_creep : float
        Largest rate of tilting accepted where the other intervals tilt as much. [rad/s]
    limit : float
        Standard deviations.

    Returns
    -------
    keep : ndarray of bool, shape (k,)
    reasons : list of str
        A sentence on each that is refused.
    """
    contrast = contrasts(rates.accel, index, sigma_f)
    f = np.array([rates.accel[a:b].mean(axis=0) for a, b in index])
    g = np.linalg.norm(f, axis=1)
    along = f / g[:, None]
    change = contrast.drift * contrast.sigma
    change -= np.sum(change * along, axis=1, keepdims=True) * along
    z = np.linalg.norm(change / contrast.sigma, axis=1)
    # between the middles of the first and the last third
    span = 2.0 / 3.0 * (index[:, 1] - index[:, 0]) * rates.interval
    tilt = np.linalg.norm(change, axis=1) / (g * span)
    # squared, because supports do not give way by a normal distribution: in logs where most do, some do much more
    common = _robust_sigma(contrast.drift) ** 2 if len(index) >= _FEWEST else 1.0
    accepted = max_creep * g * span / contrast.sigma.max(axis=1)
    allowed = np.maximum(limit * contrast.colour, np.minimum(limit * common, accepted))
    keep = z <= allowed
    reasons = [
        f"refused {time_span(rates, *index[k])}: tilts at {tilt[k] / DEG:.2g} deg/s "
        f"(up to {tilt[k] * allowed[k] / z[k] / DEG:.2g} passes)"
        for k in np.flatnonzero(~keep)
    ]
    return np.asarray(keep), reasons


def consistent_rates(
    rates: ImuSeries,
    index: IntArray,
    sigma_w: FloatArray,
    *,
    bias: FloatArray | None,
    g_sensitivity: float,
    max_rate: float,
    limit: float,
) -> tuple[BoolArray, FloatArray, list[str]]:
    """Test whether the mean rate follows from those of the other intervals by ``b + G f``.

    Parameters
    ----------
    rates : ImuSeries
    index : ndarray of int, shape (k, 2)
        Intervals.
    sigma_w : ndarray, shape (3,)
        Standard deviation of a sample at rest. [rad/s]
    bias : ndarray, shape (3,), optional
        Where it is given it is not estimated. [rad/s]
    g_sensitivity : float
        Prior 1-sigma of the elements of G. [(rad/s)/(m/s^2)]
    max_rate : float
        Largest difference ever accepted. [rad/s]
    limit : float
        Standard deviations.

    Returns
    -------
    keep : ndarray of bool, shape (k,)
    bias : ndarray, shape (3,)
        Given or estimated. [rad/s]
    reasons : list of str
        A sentence on each that is refused.

    Notes
    -----
    The variance of a mean is that of the noise, of Earth rate in an unknown direction, and of a bias that wanders from
    rest to rest, as much as makes the median residual what it should be; its limit is wider, by Student's distribution.
    """
    n = index[:, 1] - index[:, 0]
    omega, f = (np.array([x[a:b].mean(axis=0) for a, b in index]) for x in (rates.gyro, rates.accel))
    if len(index) == 1 and bias is None:
        note = "one rest only: turning uniformly about the vertical would look like a gyro bias"
        return np.ones(1, dtype=bool), omega[0], [note]
    colour = contrasts(rates.gyro, index, sigma_w).colour
    white = (colour * sigma_w) ** 2 / n[:, None] + earth.WGS84.omega_ie**2 / 3.0
    # for parameters of prior 1-sigma one: bias, and a row of G
    A = np.column_stack((np.full(len(f), _ANY_BIAS if bias is None else 0.0), g_sensitivity * f))
    y = omega - (np.zeros(3) if bias is None else bias)
    keep = _first_guess(y, A, white, limit)
    readmitted = np.zeros(len(y), dtype=bool)
    while True:
        b, residual, allowed = _residuals_and_limits(y, A, white, keep, limit)
        allowed = np.minimum(allowed, max_rate)
        ratio = np.max(np.abs(residual) / allowed, axis=1)
        worst = float(ratio[keep].max(initial=0.0))
        if worst > 1.0 and (keep.sum() > 1 or bias is not None):
            keep &= ratio < 0.999 * worst  # of two that contradict each other both are refused
        elif keep.any() and np.any(again := ~keep & ~readmitted & (ratio <= 1.0)):
            best = int(np.flatnonzero(again)[np.argmin(ratio[again])])
            keep[best] = readmitted[best] = True  # once: it may be refused again
        else:
            break
    reasons = []
    for k in np.flatnonzero(~keep):
        upright = abs(residual[k] @ f[k]) / np.linalg.norm(f[k])
        j = int(np.argmax(np.abs(residual[k]) / allowed[k]))
        reasons.append(
            f"refused {time_span(rates, *index[k])}: turns at {np.linalg.norm(residual[k]) / DEG:.2g} deg/s relative "
            f"to the other rests, {upright / DEG:.2g} of it about the vertical (up to {allowed[k, j] / DEG:.2g} about "
            f"{'xyz'[j]} passes)"
        )
    return keep, _ANY_BIAS * b[0] if bias is None else bias, reasons


def _first_guess(y: FloatArray, A: FloatArray, variance: FloatArray, limit: float) -> BoolArray:
    """Rests near a fit of least absolute deviations, which a third of outliers does not bias."""
    if len(y) < _FEWEST:
        return np.ones(len(y), dtype=bool)
    weight = 1.0 / variance
    for _ in range(20):
        b, _, _ = _leave_one_out_residuals(y, A, weight, variance)
        z = np.abs(y - A @ b) / np.sqrt(variance)
        weight = 1.0 / (variance * np.maximum(z, 1.0))
    near: BoolArray = np.all(z <= limit * np.maximum(NORMAL * np.median(z, axis=0), 1.0), axis=1)
    return near


def _residuals_and_limits(
    y: FloatArray, A: FloatArray, white: FloatArray, keep: BoolArray, limit: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters from the rests kept, leave-one-out residuals of all, and their limits.

    The variance of the bias from rest to rest makes the median residual equal to its expectation, axis by axis.
    """
    from scipy.stats import norm, t

    wander = np.zeros(3)
    for _ in range(20 if keep.sum() >= _FEWEST else 1):
        variance = white + wander
        b, residual, sigma = _leave_one_out_residuals(y, A, np.where(keep[:, None], 1.0 / variance, 0.0), variance)
        if keep.sum() >= _FEWEST:
            z = (residual / sigma)[keep]
            common = np.maximum(_robust_sigma(z), NORMAL * np.median(np.abs(z), axis=0))
            wander = np.maximum(wander + (common**2 - 1.0) * np.median(variance, axis=0), 0.0)
    # a scatter estimated from few rests has the tails of Student's distribution
    wide = t.isf(norm.sf(limit), max(int(keep.sum()) - A.shape[1], 1)) ** 2 - limit**2
    return b, residual, np.sqrt(limit**2 * sigma**2 + wide * wander)


def _leave_one_out_residuals(
    y: FloatArray, A: FloatArray, weight: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ridge regression of each column of y, its leave-one-out residuals and their sigma.

    With p = a' N^-1 a and weight w of a row in the normal matrix N, the prediction without it has the residual
    ``e / (1 - w p)`` and the variance ``p / (1 - w p)`` in addition to that of the row itself.
    """
    b, residual, sigma = np.empty((A.shape[1], y.shape[1])), np.empty_like(y), np.empty_like(y)
    for j in range(y.shape[1]):
        N = np.eye(A.shape[1]) + A.T @ (weight[:, j, None] * A)
        b[:, j] = np.linalg.solve(N, A.T @ (weight[:, j] * y[:, j]))
        p = np.einsum("ij,ij->i", A, np.linalg.solve(N, A.T).T)
        remainder = np.maximum(1.0 - weight[:, j] * p, 1e-12)
        residual[:, j] = (y[:, j] - A @ b[:, j]) / remainder
        sigma[:, j] = np.sqrt(variance[:, j] + p / remainder)
    return b, residual, sigma


def time_span(rates: ImuSeries, a: int, b: int) -> str:
    """Times of samples a to b - 1, as text."""
    return f"{rates.t[a]:.2f}..{rates.t[b - 1]:.2f} s"


def _robust_sigma(z: FloatArray) -> float:
    """Standard deviation of normal deviates of zero mean, from the median of their absolute values."""
    return NORMAL * float(np.median(np.abs(z)))
