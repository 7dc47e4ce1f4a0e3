"""Gait of a foot: the period of its strides, and a threshold for its stances that follows them.

A foot on the ground is never quite at rest: the sole gives and rolls, the more the faster the gait. A threshold that
finds every stance of a run takes slow swings of a walk for rest, one made for a slow walk finds no stance of a run. But
every stride has a stance, and strides repeat: their period shows in the log itself.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.detectors import moving_moments
from schuler.timebase import check_times

_PERIODS_S = (0.5, 2.2)  # strides of one foot: a sprint, a very slow walk
_LEAST_CORRELATION = 0.2  # of the rate with itself a stride later; what does not repeat is no gait
_MOST_OF_MEAN = 0.1  # a stance is stiller than this share of the mean, however still the rest of the stride


def stride_period(imu: ImuSeries) -> float | None:
    """Time from one stride of a foot to the next, where its motion repeats. [s]

    Parameters
    ----------
    imu : ImuSeries

    Returns
    -------
    float, optional
        None where nothing repeats between 0.5 and 2.2 s: standing, shuffling, something other than a gait.

    Notes
    -----
    The first peak of the autocorrelation of the angular rate's magnitude that reaches three quarters of the highest
    one, over the parts of the log that move. Rates above their 98th percentile are cut: heel strikes are not periodic.
    """
    from scipy.signal import find_peaks

    step = imu.interval
    rate = np.linalg.norm(imu.rates().gyro, axis=1)
    n = len(rate)
    if n * step < 2.0 * _PERIODS_S[1] or not rate.any():
        return None
    mean_square = moving_moments(rate**2, max(1, round(1.5 / step)))[0]
    moving = mean_square > 0.1 * np.median(mean_square[mean_square >= np.median(mean_square)])
    x = np.minimum(rate, np.quantile(rate, 0.98))
    x = np.where(moving, x - x[moving].mean(), 0.0)
    lags = round(1.2 * _PERIODS_S[1] / step)
    correlation, pairs = (np.fft.irfft(np.abs(np.fft.rfft(y, 2 * n)) ** 2)[:lags] for y in (x, moving.astype(float)))
    if not correlation[0] > 0.0:
        return None
    correlation = correlation / correlation[0] * (pairs[0] / np.maximum(pairs, 0.1 * pairs[0]))
    peaks = find_peaks(correlation)[0]
    peaks = peaks[(peaks * step >= _PERIODS_S[0]) & (peaks * step <= _PERIODS_S[1])]
    peaks = peaks[correlation[peaks] > _LEAST_CORRELATION]
    if not len(peaks):
        return None
    return float(peaks[correlation[peaks] > 0.75 * correlation[peaks].max()][0] * step)


def gait_threshold(
    t: ArrayLike,
    statistic: ArrayLike,
    *,
    ratio: float = 0.01,
    cycle_s: float = 1.5,
    floor: float = 0.0,
    ceiling: float = np.inf,
    stillest: float = 0.0,
) -> FloatArray:
    """Threshold as a share of the mean statistic over a stride, or a multiple of the least one.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    statistic : array_like, shape (n,)
        Dimensionless.
    ratio : float
        Share of the mean that a resting foot stays below.
    cycle_s : float
        Length of the centred window of mean and least value: one stride. [s]
    floor, ceiling : float
        Limits of the threshold. Without a floor a person who stands still for a cycle is never at rest: the
        statistic would be compared with itself.
    stillest : float
        A foot is also at rest below this multiple of the least statistic of the stride, as long as that is a tenth of
        its mean at most: a stance of a run is stiller than the rest of its stride and not stiller than a slow swing
        of a walk. 0 leaves that out.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    InputError
        If a setting is out of range.

    Notes
    -----
    The statistics are mean squares, so with a ratio ``rho`` rates (or accelerations) during stance stay below
    ``sqrt(rho)`` of their root mean square over a stride. Scaling the noise that the
    statistic is relative to changes nothing but the meaning of the floor. The mean statistic grows with speed and
    stride frequency, and the threshold with it. It needs half a cycle of data to come: near real time means a delay of
    that.

    References
    ----------
    Own formula; the dependence of the best threshold on gait speed is reviewed by Wahlstrom and Skog (2020), Fifteen
    years of progress at zero velocity, and is linear in the energy of the signals on the walks of docs/foot-mounted.md.
    """
    t = check_times(t, "t")
    value = as_floats(statistic, "statistic", (len(t),))
    for name, number in (("ratio", ratio), ("cycle_s", cycle_s)):
        if not (np.isfinite(number) and number > 0.0):
            raise InputError(f"{name}: expected a positive number, got {number}")
    if not ratio < 1.0:
        raise InputError(f"ratio: expected a share below 1, got {ratio}; above it everything is rest")
    if not 0.0 <= floor <= ceiling:
        raise InputError(f"expected 0 <= floor <= ceiling, got {floor} and {ceiling}")
    if not (stillest == 0.0 or stillest > 1.0):
        raise InputError(f"stillest: expected a multiple above 1, or 0 to leave it out; got {stillest}")
    step = float(np.median(np.diff(t))) if len(t) > 1 else cycle_s
    window = int(np.clip(round(cycle_s / step), 1, len(t)))
    mean = moving_moments(value, window)[0]
    limit = ratio * mean
    if stillest > 0.0:
        from scipy.ndimage import minimum_filter1d

        least = minimum_filter1d(value, window | 1, mode="nearest")
        limit = np.maximum(limit, np.minimum(stillest * least, _MOST_OF_MEAN * mean))
    return np.clip(limit, floor, ceiling)
