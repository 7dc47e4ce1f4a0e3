"""Variance over a moving window relative to that at rest, for logs in any unit, and the intervals below a multiple.

The statistic of the free-pose calibration, where neither noise nor units of the log are given; that of
:mod:`schuler.standstill.detectors` is for SI logs of stated noise.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries

#: Share of the log that is taken for rest when the noise is estimated from the log itself.
SHARE = 0.1


def variance_ratio(rates: ImuSeries, interval: float, window_s: float, initial_rest_s: float | None) -> FloatArray:
    """Variance over a moving window relative to that at rest, the larger of the two triads'. Shape (n,). [-]

    The variance at rest comes from the first ``initial_rest_s`` seconds, or from the quietest tenth of the log; it is
    never taken below what rounding to the log's resolution, or a millionth of its amplitude, makes.
    """
    from schuler.standstill import _kernels as kernels

    n = len(rates)
    W = max(10, round(window_s / interval)) if n > 1 else 10
    _check_length(n, W, window_s)
    kernels.prepare_variances()
    blocks = n // W
    variances = []
    for x in (rates.accel, rates.gyro):
        v = np.empty((blocks, 3))
        kernels.block_variances(x, W, v)
        variances.append(v)
    if initial_rest_s is not None:
        first = max(1, int(np.searchsorted(rates.t, rates.t[0] + initial_rest_s)) // W)
        quiet = np.arange(min(first, blocks))
    else:
        total = sum(v.sum(axis=1) / max(float(np.median(v.sum(axis=1))), 1e-300) for v in variances)
        quiet = np.argsort(total, kind="stable")[: max(3, round(SHARE * blocks))]
    parts = []
    for x, v in zip((rates.accel, rates.gyro), variances, strict=True):
        sigma2 = np.maximum(v[quiet].mean(axis=0), least_variance(x, W))
        part = np.zeros((n, 3))
        kernels.moving_variance(x, W, np.maximum(sigma2, 1e-300), part)
        parts.append(part)
    out = np.empty(n)
    kernels.larger_triad(parts[0], parts[1], W, out)
    return out


def _check_length(n: int, W: int, window_s: float) -> None:
    """Raise InputError for a log of n samples that is shorter than ten windows of W samples."""
    if n < 10 * W:
        raise InputError(
            f"imu: expected ten windows of {window_s:g} s or more, got {n} samples; a "
            "calibration needs nine poses and takes minutes"
        )


def least_variance(x: FloatArray, W: int) -> FloatArray:
    """Variance by rounding to the resolution, or of a millionth of the amplitude. Shape (3,). [unit of the log^2]"""
    step = np.abs(np.diff(x[: 20 * W], axis=0))
    lsb = np.array([float(s[s > 0.0].min()) if (s > 0.0).any() else 0.0 for s in step.T])
    span = float(np.abs(x - x[0]).max())
    return np.asarray(np.maximum(lsb**2 / 12.0, (1e-6 * span) ** 2))


def log_gaps(t: FloatArray, interval: float) -> IntArray:
    """Samples after which the log pauses for more than three intervals."""
    return np.flatnonzero(np.diff(t) > 3.0 * interval).astype(np.int64)


def intervals_below(
    t: FloatArray, interval: float, gaps: IntArray, statistic: FloatArray, margin: float, min_s: float
) -> IntArray:
    """Runs of the log where the statistic is below ``margin``, cut at gaps, of ``min_s`` or more. Shape (k, 2)."""
    still = np.concatenate(([False], statistic < margin, [False]))
    gap = gaps + 1
    edge = np.diff(still.astype(np.int8))
    first, last = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    gap = gap[still[gap] & still[gap + 1]]
    if len(gap):
        first, last = np.sort(np.concatenate((first, gap))), np.sort(np.concatenate((last, gap)))
    long = (last - first >= 20) & (t[last - 1] - t[first] + interval >= min_s)
    return np.ascontiguousarray(np.stack((first[long], last[long]), axis=1), dtype=np.int64)


def accel_variance_ratio(
    rates: ImuSeries, interval: float, initial_rest_s: float, window_s: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Magnitude of the variances of specific force over a window around each sample, relative to that at rest.

    Parameters
    ----------
    rates : ImuSeries
        Rates in any unit.
    interval : float
        Sampling interval. [s]
    initial_rest_s : float
        The log begins with so many seconds at rest. [s]
    window_s : float
        The window: the odd number of samples next to it, 101 at 100 Hz. [s]

    Returns
    -------
    ratio : ndarray, shape (n,)
        ``|(var f_x, var f_y, var f_z)|`` over that of the initial rest; infinite at both ends of the log, where no
        window has its centre. [-]
    at_rest : ndarray, shape (3,)
        Variances of the initial rest. [unit of the log^2]

    Raises
    ------
    InputError
        If the log is shorter than ten windows or the initial rest than one.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), section on the static detector. Variances are over ``count - 1``. The variance
    at rest is never taken below what rounding makes, so that a log without noise has rests.
    """
    from schuler.standstill import _kernels as kernels

    n = len(rates)
    half = max(5, round(0.5 * window_s / interval)) if n > 1 else 5
    W = 2 * half + 1
    _check_length(n, W, window_s)
    first = int(np.searchsorted(rates.t, rates.t[0] + initial_rest_s))
    if first < W:
        raise InputError(
            f"initial_rest_s: expected a window of {window_s:g} s or more, got {initial_rest_s:g} s ({first} samples)"
        )
    kernels.prepare_variances()
    at_rest = np.maximum(rates.accel[:first].var(axis=0, ddof=1), least_variance(rates.accel, W))
    size = max(float(np.linalg.norm(at_rest)), 1e-300)
    parts = np.full((n, 3), np.inf)
    # the kernel divides sums of squares by 3 W sigma2; this makes it variances over count - 1
    kernels.moving_variance(rates.accel, W, np.full(3, (W - 1.0) / (3.0 * W) * size), parts)
    ratio = np.full(n, np.inf)
    ratio[half : n - half] = np.sqrt((parts[half : n - half] ** 2).sum(axis=1))
    return ratio, np.asarray(at_rest)
