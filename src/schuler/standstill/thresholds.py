"""Thresholds for the test statistics of standing still: from noise, from the log itself, and from the time since."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.detectors import KINDS, Kind, window_samples
from schuler.timebase import check_times


def threshold(kind: Kind, window: int, false_alarm: float = 1e-3) -> float:
    """Value that a window at rest exceeds with probability ``false_alarm``, for white Gaussian noise.

    Parameters
    ----------
    kind : str
        As in :func:`schuler.standstill.detectors.statistic`.
    window : int
        Samples in a window, see :func:`schuler.standstill.detectors.window_samples`.
    false_alarm : float
        Probability that one window at rest is taken for motion. Overlapping windows fail together: a log of n
        samples has about ``n / window`` independent ones.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If an argument is out of range.

    Notes
    -----
    With W samples, W times the statistic is chi-square distributed with 3 W (energy), 3 W - 3 (variance), W
    (magnitude), 6 W - 2 (glrt) degrees of freedom; the moving deviation is the largest of six with W - 1. For
    ``printed`` that is an upper bound where the rate is zero, because the norm of noise alone varies less than noise.
    ``glrt`` and ``acceleration magnitude`` assume a calibrated accelerometer and all but the variances a known gyro
    bias: an error c in either adds ``c^2 / sigma^2``. Where that is not small, as in most raw logs, use
    :func:`threshold_from_rest`. Noise correlated over several samples has fewer degrees of freedom than counted here.

    References
    ----------
    Skog et al. (2010), eqs. (10)-(18), for the statistics; the degrees of freedom follow from them.
    """
    from scipy.special import chdtri

    W = int(window)
    if W < 2:
        raise InputError(f"window: expected at least 2 samples, got {window}")
    p = _probability(false_alarm, "false_alarm")
    if kind in ("moving deviation", "printed"):
        axes = 6 if kind == "moving deviation" else 2
        return float(chdtri(W - 1, -np.expm1(np.log1p(-p) / axes)) / W)
    return float(chdtri(_freedom(kind, W), p) / W)


def threshold_from_rest(
    values: ArrayLike, kind: Kind, window: int, false_alarm: float = 1e-3, share: float = 0.1
) -> float:
    """Threshold from the quietest part of the log itself, for sensors whose noise or biases are not known.

    Parameters
    ----------
    values : array_like, shape (n,)
        Values of :func:`schuler.standstill.detectors.statistic`.
    kind, window, false_alarm
        As in :func:`threshold`.
    share : float
        Share of the log that certainly rests.

    Returns
    -------
    float
        Median of the smallest ``share`` of the values, times the ratio between the chi-square quantiles of
        ``1 - false_alarm`` and ``1/2``.

    Raises
    ------
    InputError
        If an argument is out of range.

    Notes
    -----
    If more than ``share`` of the log rests, the median lies low: with everything at rest and ``share`` = 0.1 it is the
    5 % quantile, and the false-alarm rate is higher than ``false_alarm``, more so for short windows. A constant error
    (bias in the magnitude tests) raises the threshold in proportion, which is on the safe side for noise.
    """
    v = np.sort(as_floats(values, "values", (None,)))
    if len(v) == 0:
        raise InputError("values: expected at least one, got none")
    quiet = v[: max(1, round(_probability(share, "share") * len(v)))]
    return float(np.median(quiet) * threshold(kind, window, false_alarm) / threshold(kind, window, 0.5))


def noise_at_rest(imu: ImuSeries, window_s: float = 1.0, share: float = 0.1) -> tuple[FloatArray, FloatArray]:
    """Standard deviation of every axis at rest, from the quietest windows of a log that also moves.

    Parameters
    ----------
    imu : ImuSeries
    window_s : float
        Length of the windows, which do not overlap here. [s]
    share : float
        At least this share of the windows is at rest.

    Returns
    -------
    sigma_f, sigma_w : ndarray, shape (3,)
        Noise of a sample of specific force [m/s^2] and angular rate [rad/s], not below that of rounding. One where a
        log has no gyroscopes (all their rates are zero), so that they say nothing about rest.

    Raises
    ------
    InputError
        If the log has fewer than 10 windows, or an axis never changes.

    Notes
    -----
    The median of the lowest ``share`` of the window variances is a low quantile of the variances at rest; which one
    depends on the share of the log at rest, which is counted with the resulting variance, until both agree.
    """
    W = window_samples(imu, window_s)
    rates = imu.rates()
    if len(imu) // W < 10:
        raise InputError(
            f"the log has {len(imu) // W} windows of {window_s} s; expected at least 10 to tell rest from motion"
        )
    sigma = [
        _quiet_deviation(x, W, _probability(share, "share"), f"{name}_{axis}")
        for name, triad in (("accel", rates.accel), ("gyro", rates.gyro))
        if name == "accel" or triad.any()
        for axis, x in zip("xyz", triad.T, strict=True)
    ]
    return np.array(sigma[:3]), np.array(sigma[3:]) if len(sigma) == 6 else np.ones(3)


def _quiet_deviation(x: FloatArray, W: int, share: float, name: str) -> float:
    from scipy.special import gammaincinv

    variance = np.sort(x[: len(x) // W * W].reshape(-1, W).var(axis=1, ddof=1))
    low = float(np.median(variance[: max(1, round(share * len(variance)))]))
    step = np.diff(np.sort(x))
    step = step[step > 0.0]
    if not len(step):
        raise InputError(f"{name}: expected noise, but the axis always reads {x[0]:.6g}; is it connected?")
    # smallest step between readings: tiny for unrounded numbers, then no restriction
    rounding = float(step.min()) ** 2 / 12.0
    rest, at_rest = max(low, rounding), share
    high = 2.0 * gammaincinv(0.5 * (W - 1), 0.99) / (W - 1)  # quantiles of chi-square variables over their mean
    for _ in range(20):
        rest = max(low / (2.0 * gammaincinv(0.5 * (W - 1), min(0.5, 0.5 * share / at_rest)) / (W - 1)), rounding)
        limit = rest * high
        at_rest = max(share, np.count_nonzero(variance <= limit) / len(variance) / 0.99)
    return float(np.sqrt(rest))


def _freedom(kind: str, W: int) -> int:
    """Degrees of freedom of W times the statistic."""
    freedom = {
        "glrt": 6 * W - 2,
        "acceleration variance": 3 * W - 3,
        "acceleration magnitude": W,
        "angular rate energy": 3 * W,
    }
    if kind not in freedom:
        raise InputError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    return freedom[kind]


def elapsed_time_threshold(
    t: ArrayLike, statistic: ArrayLike, *, growth: float, delay_s: float = 0.0, floor: float = 0.0
) -> tuple[FloatArray, BoolArray]:
    """Threshold that rises with the time since the last rest, and the samples at rest by it.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    statistic : array_like, shape (n,)
        Dimensionless.
    growth : float
        Rise of the threshold. [1/s]
    delay_s : float
        Time after a rest during which it does not rise yet. [s]
    floor : float
        Smallest threshold.

    Returns
    -------
    threshold : ndarray, shape (n,)
        ``max(floor, growth (t - t_rest - delay))``, t_rest the last sample at rest before.
    rest : ndarray of bool, shape (n,)

    Raises
    ------
    InputError
        If a setting is out of range.

    Notes
    -----
    Decide for rest if the likelihood ratio exceeds ``eta = cost(false alarm) / cost(missed rest)``. With
    ``T = -(2/W) log(ratio)`` that is ``T < -(2/W) log(eta)``. A missed rest costs more the longer the errors have been
    growing: with ``eta = alpha exp(-theta dt)`` the threshold is linear in the time dt since the last rest,
    ``(2/W) (theta dt - log(alpha))``. ``growth`` is ``2 theta / W``, ``delay_s`` is ``log(alpha) / theta``. It is
    causal. Every stance gives only its quietest samples, since each one lowers the threshold again.

    References
    ----------
    Wahlstrom, Skog, Gustafsson, Markham, Trigoni (2019), Zero-velocity detection - a Bayesian approach to adaptive
    thresholding: exponential cost of a missed detection. Departure: no prior from the velocity of the filter, so that
    detection does not depend on navigation.
    """
    t = check_times(t, "t")
    value = as_floats(statistic, "statistic", (len(t),))
    if not (np.isfinite(growth) and growth > 0.0):
        raise InputError(f"growth: expected a positive rise per second, got {growth}")
    if not (delay_s >= 0.0 and floor >= 0.0):
        raise InputError(f"expected delay_s and floor of at least 0, got {delay_s} and {floor}")
    threshold, rest = np.empty(len(t)), np.zeros(len(t), dtype=bool)
    last = t[0] if len(t) else 0.0
    for k, (now, v) in enumerate(zip(t.tolist(), value.tolist(), strict=True)):
        limit = max(floor, growth * (now - last - delay_s))
        threshold[k] = limit
        if v < limit:
            rest[k] = True
            last = now
    return threshold, rest


def below_with_hysteresis(value: FloatArray, limit: FloatArray, leave: float) -> BoolArray:
    """Rest begins below the limit and lasts until ``leave`` times the limit is reached."""
    enter, out = value < limit, value >= leave * limit
    # the last sample that decided, of those before and at each one
    decided = np.maximum.accumulate(np.where(enter | out, np.arange(len(value)), -1))
    rest: BoolArray = np.where(decided >= 0, enter[np.maximum(decided, 0)], False)
    return rest


def _probability(value: float, name: str) -> float:
    if not 0.0 < value < 1.0:
        raise InputError(f"{name}: expected a number between 0 and 1, got {value}")
    return float(value)
