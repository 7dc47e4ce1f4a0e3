"""Rests of a hand-rotated log in any unit: candidates for several thresholds, their means and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.calibration.freepose.weights import median
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries

#: Multiples of the variance at rest that are tried, those of Tedaldi's program; the one is kept whose poses determine
#: the accelerometers best.
MARGINS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)
#: Share of the log that is believed to be at rest when the noise is taken from the log itself.
SHARE = 0.1
# The median of a chi-square with 9 degrees of freedom over its mean: part means of one pose are ten.
_MEDIAN_9 = 0.927


@dataclass(frozen=True, eq=False)
class Rests:
    """Poses of a log in the units of the log.

    Attributes
    ----------
    index : ndarray of int, shape (n, 2)
        First sample and one past the last.
    accel, gyro : ndarray, shape (n, 3)
        Means. [units of the log]
    duration : ndarray, shape (n,)
        [s]
    density_a, density_g : ndarray, shape (3,)
        Noise N of both triads at rest: the mean over T seconds has standard deviation N / sqrt(T). [unit/sqrt(Hz)]
    margin : float
        Threshold as a multiple of the variance at rest; NaN if intervals were given.
    tried : tuple of (float, int, float)
        What the published search tried: multiple, rests, cost of their accelerometers [m^2/s^4]; see
        :func:`schuler.calibration.freepose.rest_search.tedaldi_rests`. Empty for the others.
    """

    index: IntArray
    accel: FloatArray
    gyro: FloatArray
    duration: FloatArray
    density_a: FloatArray
    density_g: FloatArray
    margin: float
    tried: tuple[tuple[float, int, float], ...] = ()

    def __len__(self) -> int:
        return len(self.index)

    def of(self, keep: BoolArray) -> Rests:
        """Some of them, noise unchanged."""
        return Rests(
            self.index[keep], self.accel[keep], self.gyro[keep], self.duration[keep], self.density_a,
            self.density_g, self.margin, self.tried,
        )  # fmt: skip


def restlessness(rates: ImuSeries, interval: float, window_s: float, initial_rest_s: float | None) -> FloatArray:
    """Variance over a moving window relative to that at rest, the larger of the two triads'. Shape (n,). [-]

    The variance at rest comes from the first ``initial_rest_s`` seconds, or from the quietest tenth of the log; it is
    never taken below what rounding to the log's resolution, or a millionth of its amplitude, makes.
    """
    from schuler.calibration.freepose import _kernels as kernels

    n = len(rates)
    W = max(10, round(window_s / interval)) if n > 1 else 10
    check_length(n, W, window_s)
    kernels.prepare_freepose()
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
    kernels.combine(parts[0], parts[1], W, out)
    return out


def check_length(n: int, W: int, window_s: float) -> None:
    """Raise InputError for a log of n samples that is shorter than ten windows of W samples."""
    if n < 10 * W:
        raise InputError(
            f"imu: expected ten windows of {window_s:g} s or more, got {n} samples; a "
            "calibration needs nine poses and takes minutes"
        )


def least_variance(x: FloatArray, W: int) -> FloatArray:
    """What rounding to the log's resolution makes, or a millionth of its amplitude. Shape (3,). [unit of the log^2]"""
    step = np.abs(np.diff(x[: 20 * W], axis=0))
    lsb = np.array([float(s[s > 0.0].min()) if (s > 0.0).any() else 0.0 for s in step.T])
    span = float(np.abs(x - x[0]).max())
    return np.asarray(np.maximum(lsb**2 / 12.0, (1e-6 * span) ** 2))


def gaps_of(t: FloatArray, interval: float) -> IntArray:
    """Samples after which the log pauses for more than three intervals."""
    return np.flatnonzero(np.diff(t) > 3.0 * interval).astype(np.int64)


def rest_intervals(
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


def rests_of(rates: ImuSeries, interval: float, index: IntArray, margin: float) -> Rests:
    """Means over intervals, and noise pooled over them.

    Noise is the sensor's and not the pose's, so it is one number an axis for all poses: the median over poses of the
    scatter of ten part means or of the samples, whichever is larger; a pose that was disturbed does not count for much.
    """
    from schuler.calibration.freepose import _kernels as kernels

    k = len(index)
    means, density = [], []
    for x in (rates.accel, rates.gyro):
        mean, variance, coloured = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
        kernels.moments(x, index, mean, variance, coloured)
        means.append(mean)
        N = np.zeros(3)
        if k:
            N = np.sqrt(np.maximum(median(variance), median(coloured) / _MEDIAN_9) * interval)
        # rounding of the means themselves, so that data without noise have a weight
        density.append(np.maximum(N, 1e-14 * max(float(np.abs(mean).max(initial=0.0)), 1e-300)))
    duration = np.asarray((index[:, 1] - index[:, 0]) * interval, dtype=np.float64)
    return Rests(index, means[0], means[1], duration, density[0], density[1], margin)
