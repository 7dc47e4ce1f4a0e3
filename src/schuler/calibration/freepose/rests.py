"""Rests of a hand-rotated log in any unit: candidates for several thresholds, their means and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray, as_floats
from schuler.calibration.freepose.accel import accel_start, magnitude_residuals, response
from schuler.calibration.freepose.weights import median, pseudo_inverse
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.variance_ratio import accel_variance_ratio, intervals_below, log_gaps, variance_ratio

#: Multiples of the variance at rest that are tried, those of Tedaldi's program; the one is kept whose poses determine
#: the accelerometers best.
MARGINS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)
#: Multiples k of the variance magnitude at rest that are tried, those of imu_tk. The paper begins at 1, which half the
#: windows at rest exceed: rests fall apart or get lost, and the remaining ones cost less. With 1 among them, it won
#: a quarter of 400 simulated logs, mostly with 12 to 19 of their 20 poses, once with too few to be solved.
MULTIPLES = tuple(float(k) for k in range(2, 11))
#: Fewest rests for a cost: nine parameters fit a smaller number too well.
ENOUGH = 12
#: Length from which on readings that do not change at all were held, and the share of a log from which on they are its
#: own: a log without noise repeats in every rest. [s]
HELD_S, MOST_HELD = 0.2, 0.1
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
        Trials of the published search: multiple, rests, cost of their accelerometers [m^2/s^4]; see
        :func:`schuler.calibration.freepose.rests.tedaldi_rests`. Empty for the others.
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

    def select(self, keep: BoolArray) -> Rests:
        """A subset of the poses, noise unchanged."""
        return Rests(
            self.index[keep], self.accel[keep], self.gyro[keep], self.duration[keep], self.density_a,
            self.density_g, self.margin, self.tried,
        )  # fmt: skip


def without_held(imu: ImuSeries) -> tuple[ImuSeries, tuple[str, ...]]:
    """Log without readings that were held, which look like the best of rests, and a sentence on them.

    Parameters
    ----------
    imu : ImuSeries
        In any unit.

    Returns
    -------
    ImuSeries
        With a gap after the first of every :data:`HELD_S` or more in which no axis changes; the same log where there
        are none, or where they are :data:`MOST_HELD` of it or more.
    tuple of str
        Empty where nothing was left out.
    """
    readings = np.concatenate((imu.gyro, imu.accel), axis=1)
    same = np.zeros(len(imu) + 1, dtype=bool)
    same[1:-1] = np.all(
        np.abs(np.diff(readings, axis=0)) <= 1e-9 * np.ptp(readings, axis=0), axis=1
    )  # but for rounding
    change = np.diff(same.astype(np.int8))
    first, last = np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1
    long = (last - first) * imu.interval >= HELD_S
    first, last = first[long], last[long]
    count = int((last - first).sum())
    if not 0 < count < MOST_HELD * len(imu):
        return imu, ()
    keep = np.ones(len(imu), dtype=bool)
    for a, b in zip(first, last, strict=True):
        keep[a:b] = False
    temperature, magnetometer = (None if x is None else x[keep] for x in (imu.temperature, imu.magnetometer))
    places = ", ".join(f"{imu.t[a - 1]:.1f}..{imu.t[b - 1]:.1f} s" for a, b in zip(first[:3], last[:3], strict=True))
    sentence = (
        f"No reading changes in {places}{' and later' if len(first) > 3 else ''}: {count} samples were held, not "
        "measured, and left out like a gap."
    )
    return replace(imu, t=imu.t[keep], gyro=imu.gyro[keep], accel=imu.accel[keep], temperature=temperature,
                   magnetometer=magnetometer), (sentence,)  # fmt: skip


def pose_means(rates: ImuSeries, interval: float, index: IntArray, margin: float) -> Rests:
    """Means over intervals, and noise pooled over them.

    Noise is the sensor's and not the pose's, so it is one number an axis for all poses: the median over poses of the
    scatter of ten part means or of the samples, whichever is larger, so that a disturbed pose has little influence.
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
        density.append(np.maximum(N, 1e-14 * max(float(np.abs(mean).max(initial=0.0)), 1e-16)))
    duration = np.asarray((index[:, 1] - index[:, 0]) * interval, dtype=np.float64)
    return Rests(index, means[0], means[1], duration, density[0], density[1], margin)


def candidate_rests(
    rates: ImuSeries,
    interval: float,
    intervals: Sequence[tuple[float, float]] | None,
    initial_rest_s: float | None,
    window_s: float,
    min_s: float,
) -> list[Rests]:
    """Different sets of rests, one for each threshold, or those that were given."""
    if intervals is not None:
        spans = as_floats(intervals, "intervals", (None, 2))
        index = np.stack(
            (np.searchsorted(rates.t, spans[:, 0] - 1e-9), np.searchsorted(rates.t, spans[:, 1] + 1e-9)), axis=1
        ).astype(np.int64)
        if (np.diff(index, axis=1) < 20).any() or (index[1:, 0] < index[:-1, 1]).any():
            raise InputError("intervals: expected rests one after another with 20 samples or more in each")
        return [pose_means(rates, interval, np.ascontiguousarray(index), float("nan"))]
    statistic = variance_ratio(rates, interval, window_s, initial_rest_s)
    gaps = log_gaps(rates.t, interval)
    out: list[Rests] = []
    for margin in MARGINS:
        index = intervals_below(rates.t, interval, gaps, statistic, margin, min_s)
        if not out or not np.array_equal(index, out[-1].index):
            out.append(pose_means(rates, interval, index, margin))
    return out


def tedaldi_rests(
    rates: ImuSeries,
    interval: float,
    gravity: float,
    initial_rest_s: float,
    *,
    factor: float | None = None,
    window_s: float = 1.0,
    min_s: float = 1.0,
) -> Rests:
    """Rests by the threshold, of nine, whose accelerometer calibration leaves the least cost.

    Parameters
    ----------
    rates : ImuSeries
        Rates in any unit.
    interval : float
        Sampling interval. [s]
    gravity : float
        Local gravity. [m/s^2]
    initial_rest_s : float
        The log begins with so many seconds at rest. [s]
    factor : float, optional
        Factor of the accelerometers [m/s^2 per unit of the log]. None: estimated.
    window_s : float
        Of :func:`accel_variance_ratio`. [s]
    min_s : float
        Shortest rest; only this time from its start is used. [s]

    Returns
    -------
    Rests
        ``index``: complete rests, where turns begin and end; means, durations and noise are those of the samples used.
        ``margin``: k; ``tried``: all trials, with infinite cost where nothing could be fitted.

    Raises
    ------
    InputError
        As :func:`accel_variance_ratio`.

    Notes
    -----
    A sample is at rest if its variance magnitude is below k times that of the initial rest, k = 2 ... 10. For each k
    nine parameters are fitted to all used samples alike, and the cost is half the sum of squares of what their
    calibrated magnitudes miss gravity by. The cost grows with the number of rests and is zero with nine. So only k
    with twelve rests or more compete, and if there is none, k = 10 is taken, where rests do not fall apart (our
    choice). Rests end at gaps of the log.

    Gyroscopes are not used: slow turns about the vertical count as rests.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), static detector and eq. (10). The multiple is one of the variance magnitude, not
    of its square or of a standard deviation: so the nine counts and costs that imu_tk prints for its own log come out.
    """
    ratio, _ = accel_variance_ratio(rates, interval, initial_rest_s, window_s)
    gaps = log_gaps(rates.t, interval)
    count = max(20, round(min_s / interval))
    spans: list[IntArray] = []
    tried: list[tuple[float, int, float]] = []
    for k in MULTIPLES:
        index = intervals_below(rates.t, interval, gaps, ratio, k, 0.0)
        index = np.ascontiguousarray(index[np.diff(index, axis=1)[:, 0] >= count])
        spans.append(index)
        tried.append((k, len(index), _cost(rates.accel, index, count, gravity, factor)))
    enough = [i for i, (_, n, cost) in enumerate(tried) if n >= ENOUGH and np.isfinite(cost)]
    best = min(enough, key=lambda i: tried[i][2]) if enough else len(tried) - 1
    used = np.stack((spans[best][:, 0], spans[best][:, 0] + count), axis=1)
    rests = pose_means(rates, interval, np.ascontiguousarray(used), MULTIPLES[best])
    return replace(rests, index=spans[best], tried=tuple(tried))


def _cost(accel: FloatArray, index: IntArray, count: int, gravity: float, factor: float | None) -> float:
    """Half the sum of squared residuals of the first ``count`` samples of each rest; infinite if nothing fits."""
    if len(index) < 9:
        return float("inf")
    y = np.stack([accel[a : a + count] for a in index[:, 0]])
    scale, p = accel_start(y.mean(axis=1), gravity, factor)
    if p is None:
        return float("inf")
    y = scale * y.reshape(-1, 3)
    for _ in range(40):
        r, J, _ = magnitude_residuals(p, y, gravity)
        # einsum, not matrix products: a threaded library spends more on its threads at this size
        dp = -pseudo_inverse(np.einsum("ni,nj->ij", J, J)) @ np.einsum("ni,n->i", J, r)
        if not np.isfinite(p + dp).all() or abs(np.linalg.det(response(p + dp))) < 1e-9:
            break
        p = p + dp
        if float(np.abs(dp).max()) < 1e-9:
            return 0.5 * float((magnitude_residuals(p, y, gravity)[0] ** 2).sum())
    return float("inf")
