"""Intervals of a log at rest, for calibration, noise identification and zero-velocity updates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.series import ImuSeries
from schuler.standstill.detectors import (
    MAX_RATE,
    Kind,
    mean_rate,
    moving_deviation,
    per_axis_sigma,
    positive_number,
    statistic,
    window_samples,
)
from schuler.standstill.intervals import runs_between_pauses
from schuler.standstill.thresholds import noise_at_rest, threshold, threshold_from_rest
from schuler.units import G0

#: A mean rate at rest beyond this is not believed to be a gyro bias, about 6 deg/s. [rad/s]
LARGEST_BIAS = 0.1


@dataclass(frozen=True, repr=False)
class StaticIntervals(Displayed):
    """Intervals of a log in which the unit stands still.

    Attributes
    ----------
    start, stop : ndarray, shape (k,)
        First and last time of each, in the time of the log. [s]
    index : ndarray of int, shape (k, 2)
        First sample and the one after the last: ``imu.gyro[a:b] for a, b in index``.
    mask : ndarray of bool, shape (n,)
        Samples that belong to an interval.
    statistic : ndarray, shape (n,)
        Values of :func:`schuler.standstill.detectors.statistic`.
    threshold : float
        The statistic is below it at rest.
    method : str
    window_s : float
        [s]
    sigma_f, sigma_w : ndarray, shape (3,)
        Noise at rest that the statistic is relative to. [m/s^2], [rad/s]
    gyro_bias : ndarray, shape (3,)
        Bias taken for the mean-rate test. [rad/s]
    notes : tuple of str
        What was estimated or assumed.
    """

    start: FloatArray
    stop: FloatArray
    index: IntArray
    mask: BoolArray
    statistic: FloatArray
    threshold: float
    method: str
    window_s: float
    sigma_f: FloatArray
    sigma_w: FloatArray
    gyro_bias: FloatArray
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.start)

    @property
    def duration(self) -> FloatArray:
        """Length of each interval. Shape (k,). [s]"""
        return np.asarray(self.stop - self.start)

    def means(self, imu: ImuSeries) -> tuple[FloatArray, FloatArray]:
        """Mean angular rate [rad/s] and specific force [m/s^2] of each interval, shape (k, 3) each.

        Raises
        ------
        InputError
            If ``imu`` is not as long as the log the intervals come from.
        """
        if len(imu) != len(self.mask):
            raise InputError(
                f"imu: expected the log of {len(self.mask)} samples the intervals come from, got {len(imu)}"
            )
        rates = imu.rates()
        gyro = [rates.gyro[a:b].mean(axis=0) for a, b in self.index]
        accel = [rates.accel[a:b].mean(axis=0) for a, b in self.index]
        return np.array(gyro).reshape(-1, 3), np.array(accel).reshape(-1, 3)

    def summary(self) -> str:
        """A few lines for people."""
        if not len(self):
            head = "no interval at rest"
        else:
            d = self.duration
            head = (
                f"{len(self)} intervals at rest, {d.sum():.1f} s in all ({100.0 * self.mask.mean():.0f} % of the log); "
                f"shortest {d.min():.1f} s, median {np.median(d):.1f} s, longest {d.max():.1f} s"
            )
        how = f"{self.method}, window {self.window_s:g} s, threshold {self.threshold:.3g}"
        return "\n".join((head, how, *self.notes))


def static_intervals(
    imu: ImuSeries,
    *,
    min_s: float = 1.0,
    window_s: float = 1.0,
    method: Kind = "moving deviation",
    thresholds: float | tuple[float, float] | None = None,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    gyro_bias: ArrayLike | None = None,
    max_rate: float = MAX_RATE,
    gravity: float = G0,
    false_alarm: float = 1e-3,
    margin: float = 3.0,
    share: float = 0.1,
) -> StaticIntervals:
    """Find the intervals at rest.

    Parameters
    ----------
    imu : ImuSeries
    min_s : float
        Shorter intervals are left out. [s]
    window_s : float
        Window of the statistic; a motion is seen if it lasts about as long. [s]
    method : str
        See :func:`schuler.standstill.detectors.statistic`.
    thresholds : float or (float, float), optional
        A number is compared with the statistic. Two are the standard deviations of specific force [m/s^2] and rate
        [rad/s] allowed at rest, for the two deviation methods. None: ``margin`` times the threshold that noise alone
        exceeds with probability ``false_alarm``.
    noise : (array_like, array_like), optional
        Standard deviations of a sample at rest, specific force [m/s^2] and rate [rad/s], that the statistic is
        relative to. None: from the quietest windows, see :func:`schuler.standstill.thresholds.noise_at_rest`.
    gyro_bias : array_like, shape (3,), optional
        [rad/s] None: the median over the quietest and slowest windows, if below :data:`LARGEST_BIAS`, else zero.
    max_rate : float
        A larger mean rate over the window is motion, whatever the statistic. [rad/s]
    gravity : float
        Local gravity for the methods that need it. [m/s^2]
    false_alarm : float
        Probability that a window at rest is taken for motion, before ``margin``.
    margin : float
        Factor on the threshold for what is not white noise at rest (a table, an idling engine, a steady hand). 1 if
        the noise is white; users calibrating by hand try 1 to 10 and keep what fits best.
    share : float
        At least this share of the log rests; noise and bias are taken from there.

    Returns
    -------
    StaticIntervals

    Raises
    ------
    InputError
        If an argument is out of range, or the log is shorter than 10 windows where the noise must be estimated.

    Notes
    -----
    A sample is at rest if its window is. Neighbouring intervals are joined if the break is hardly longer than a window
    (one bad sample makes a break of one window) and specific force and rate are the same before and after it. They end
    at gaps of the log longer than half a window. Half a window is cut from both ends of each, except at the ends of
    the log, because the beginning of a motion is weak in a window that holds little of it.

    Without ``gyro_bias`` a slow uniform rotation about the vertical that lasts all the time cannot be distinguished
    from a bias; faster than :data:`LARGEST_BIAS` it is motion.

    References
    ----------
    Yaman (2017), section 4.8, with a mean-rate test in addition; Tedaldi, Pretto, Menegatti (2014) for the
    threshold in multiples of the noise at rest.
    """
    if not (np.isfinite(min_s) and min_s > 0.0):
        raise InputError(f"min_s: expected a positive time, got {min_s} s")
    if not margin >= 1.0:
        raise InputError(f"margin: expected 1 or more, got {margin}")
    W = window_samples(imu, window_s)
    imu = imu.rates()  # once: of a day at 200 Hz they have 830 MB
    notes: list[str] = []
    sigma_f, sigma_w = _noise_scale(imu, window_s, method, thresholds, noise, share, notes)
    bias = quiet_bias(imu, W, share, notes) if gyro_bias is None else as_vector3(gyro_bias, "gyro_bias")
    if method == "moving deviation":
        value, rate = moving_deviation(imu, W, sigma_f, sigma_w, bias, positive_number(max_rate, "max_rate"))
    else:
        value = statistic(
            imu, method, window_s, sigma_f=sigma_f, sigma_w=sigma_w, gravity=gravity, gyro_bias=bias, max_rate=max_rate
        )
        rate = mean_rate(imu, window_s, bias)
    if isinstance(thresholds, tuple):
        limit = 1.0
    elif thresholds is not None:
        limit = positive_number(thresholds, "thresholds")
    elif method in ("glrt", "acceleration magnitude", "angular rate energy"):
        # a bias of the accelerometer adds a constant; noise alone would then never reach the theoretical threshold
        limit = margin * max(
            threshold(method, W, false_alarm), threshold_from_rest(value, method, W, false_alarm, share)
        )
    else:
        limit = margin * threshold(method, W, false_alarm)
    still = (value < limit) & (rate < max_rate)
    runs = _joined(runs_between_pauses(still, imu.t, 0.5 * window_s), imu, W, sigma_f, sigma_w, max_rate)
    index = _trimmed(runs, imu, W, min_s)
    return StaticIntervals(
        imu.t[index[:, 0]], imu.t[index[:, 1] - 1], index, interval_mask(index, len(imu)), value, limit, method,
        window_s, sigma_f, sigma_w, bias, tuple(notes),
    )  # fmt: skip


def interval_mask(index: IntArray, n: int) -> BoolArray:
    """Samples of a log of n samples that lie in the intervals of ``index``, shape (k, 2). Shape (n,)."""
    mask = np.zeros(n, dtype=bool)
    for a, b in index:
        mask[a:b] = True
    return mask


def _noise_scale(
    imu: ImuSeries,
    window_s: float,
    method: Kind,
    thresholds: float | tuple[float, float] | None,
    noise: tuple[ArrayLike, ArrayLike] | None,
    share: float,
    notes: list[str],
) -> tuple[FloatArray, FloatArray]:
    """Deviations that the statistic is relative to: limits given, noise given, or noise of the quietest windows."""
    if isinstance(thresholds, tuple):
        if method not in ("moving deviation", "printed"):
            raise InputError(
                f"thresholds: two limits are for 'moving deviation' and 'printed'; give one for {method!r}"
            )
        if len(thresholds) != 2:
            raise InputError(f"thresholds: expected one number or (m/s^2, rad/s), got {thresholds!r}")
        return per_axis_sigma(thresholds[0], "thresholds"), per_axis_sigma(thresholds[1], "thresholds")
    if noise is not None:
        return per_axis_sigma(noise[0], "noise"), per_axis_sigma(noise[1], "noise")
    sigma_f, sigma_w = noise_at_rest(imu, window_s, share)
    notes.append(f"noise at rest estimated: specific force {_listed(sigma_f)} m/s^2, rate {_listed(sigma_w)} rad/s")
    return sigma_f, sigma_w


def quiet_bias(imu: ImuSeries, W: int, share: float, notes: list[str]) -> FloatArray:
    """Median rate of the slower half of the quietest windows, or zero if that is too fast for a bias.

    Parameters
    ----------
    imu : ImuSeries
    W : int
        Samples in a window.
    share : float
        At least this share of the log rests.
    notes : list of str
        Gets a sentence on what was taken.
    """
    rates = imu.rates()
    n = len(imu) // W * W
    gyro, accel = (x[:n].reshape(-1, W, 3) for x in (rates.gyro, rates.accel))
    # relative to typical variances, so that both triads count
    restless = sum(v / max(float(np.median(v)), 1e-300) for v in (x.var(axis=1).sum(axis=1) for x in (gyro, accel)))
    quiet = np.argsort(restless)[: max(1, round(share * len(gyro)))]
    mean = gyro.mean(axis=1)[quiet]
    # turning steadily about the vertical is as quiet as rest: the slower half is at rest if half of it is
    slow = np.argsort(np.linalg.norm(mean, axis=1))[: (len(mean) + 1) // 2]
    bias = np.median(mean[slow], axis=0)
    if np.linalg.norm(bias) > LARGEST_BIAS:
        notes.append(
            f"the quietest windows turn at {np.linalg.norm(bias):.3f} rad/s, too fast for a gyro bias: taken as "
            "motion; give gyro_bias if it is one"
        )
        return np.zeros(3)
    notes.append(f"gyro bias estimated: {_listed(bias)} rad/s")
    return np.asarray(bias)


def _joined(
    runs: IntArray, imu: ImuSeries, W: int, sigma_f: FloatArray, sigma_w: FloatArray, max_rate: float
) -> IntArray:
    """Runs with breaks closed that one bad sample made: short, and the same pose before and after."""
    if len(runs) == 0:
        return runs
    rates, out = imu.rates(), [runs[0]]
    for a, b in runs[1:]:
        before = slice(max(int(out[-1][0]), int(out[-1][1]) - W), int(out[-1][1]))
        after = slice(int(a), min(int(b), int(a) + W))
        short = a - out[-1][1] <= 1.2 * W and imu.t[a] - imu.t[out[-1][1] - 1] <= 1.3 * W * imu.interval
        # six sigma of a difference of means, and what a table gives way
        m = min(before.stop - before.start, after.stop - after.start)
        df = np.abs(rates.accel[before].mean(axis=0) - rates.accel[after].mean(axis=0))
        dw = np.abs(rates.gyro[before].mean(axis=0) - rates.gyro[after].mean(axis=0))
        same = np.all(df <= 6.0 * sigma_f * np.sqrt(2.0 / m) + 1e-3 * G0) and np.all(
            dw <= 6.0 * sigma_w * np.sqrt(2.0 / m) + 0.1 * max_rate
        )
        if short and same:
            out[-1] = np.array((out[-1][0], b))
        else:
            out.append(np.array((a, b)))
    return np.array(out)


def _trimmed(runs: IntArray, imu: ImuSeries, W: int, min_s: float) -> IntArray:
    """Runs less half a window at both ends, those shorter than ``min_s`` left out. Shape (k, 2)."""
    half, n = W // 2, len(imu)
    kept = []
    for a, b in runs:
        first = a if a == 0 else a + half
        last = b if b == n else b - half
        if last - first >= 2 and imu.t[last - 1] - imu.t[first] + imu.interval >= min_s:
            kept.append((first, last))
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def _listed(x: FloatArray) -> str:
    return ", ".join(f"{v:.2g}" for v in x)
