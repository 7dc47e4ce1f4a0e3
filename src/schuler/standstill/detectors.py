"""Test statistics of standing still over a moving window, for zero-velocity updates and for calibration.

All are ratios: about 1 while the unit rests, larger in motion, if the noise given is right. Sums are taken block by
block with the mean of the block removed, so a log of days in many poses loses no digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil
from typing import Literal, get_args

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.units import G0

Kind = Literal[
    "moving deviation", "printed", "glrt", "acceleration variance", "acceleration magnitude", "angular rate energy"
]
KINDS: tuple[str, ...] = get_args(Kind)

#: Mean rate that counts as turning in the moving deviation, about 1 deg/s (Yaman 2017, chapter 6). [rad/s]
MAX_RATE = 0.0175

_PART = 1 << 16  # samples whose windows are looked at together


def moving_moments(x: ArrayLike, window: int) -> tuple[FloatArray, FloatArray]:
    """Mean and variance over a centred moving window.

    Parameters
    ----------
    x : array_like, shape (n,) or (n, k)
        Time along axis 0.
    window : int
        Samples in a window, at least 1 and at most n. Window k covers samples ``k - (window - 1) // 2`` to
        ``k + window // 2``; the half windows at the ends take the value of the nearest complete one.

    Returns
    -------
    mean, variance : ndarray, shape of x
        The variance is the sum of squares about the window's own mean divided by ``window``. [x], [x^2]

    Raises
    ------
    InputError
        If x is not finite, or the window does not fit into it.

    Notes
    -----
    A window is the end of one block of ``window`` samples and the beginning of the next. Sums from the end and from
    the beginning of each block, about the block's mean, give both parts; they are joined by the rule of Chan, Golub
    and LeVeque (1983). No sum is longer than a window, and the effort does not depend on its length.
    """
    x = as_floats(x, "x")
    mean, variance = np.empty_like(x), np.empty_like(x)
    for rows, m, v in _moments_by_parts(x, window):
        mean[rows], variance[rows] = m, v
    return mean, variance


def _moments_by_parts(
    x: FloatArray, window: int, less: FloatArray | float = 0.0
) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
    """Rows, and :func:`moving_moments` of ``x - less`` there, of one part of a log after the other."""
    n, W = len(x), int(window)
    if not 1 <= W <= n:
        raise InputError(f"window: expected 1 to {n} samples, the length of the log, got {W}; choose a shorter window")
    flat = x.reshape(n, -1)
    each = max(_PART // W, 1)  # blocks whose windows begin in a part
    before = (W - 1) // 2  # samples of a window ahead of the one that it is of
    for first in range(0, n - W + 1, each * W):
        part = flat[first : first + (each + 1) * W] - less
        mean, squares = _windows(part, W)
        start = 0 if first == 0 else first + before
        stop = n if first + each * W > n - W else first + each * W + before
        # the half windows at the ends take the value of the nearest complete one
        pick = np.clip(np.arange(start, stop) - before - first, 0, len(mean) - 1)
        shape = (stop - start, *x.shape[1:])
        yield slice(start, stop), mean[pick].reshape(shape), (squares[pick] / W).reshape(shape)


def _windows(flat: FloatArray, W: int) -> tuple[FloatArray, FloatArray]:
    """Mean, and sum of squares about it, of every complete window. Shapes (n, k) to (n - W + 1, k)."""
    n = len(flat)
    blocks = ceil(n / W) + 1
    padded = np.concatenate((flat, np.broadcast_to(flat[-1], (blocks * W - n, flat.shape[1]))))
    padded = padded.reshape(blocks, W, -1)
    centre = padded.mean(axis=1, keepdims=True)
    d = padded - centre
    count = np.arange(W + 1.0)[:, None]

    def parts(d: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and sum of squares about it of the first 0..W samples of every block."""
        zero = np.zeros((blocks, 1, d.shape[2]))
        s = np.concatenate((zero, np.cumsum(d, axis=1)), axis=1)
        q = np.concatenate((zero, np.cumsum(d * d, axis=1)), axis=1)
        mean = s / np.maximum(count, 1.0)
        return mean, np.maximum(q - s * mean, 0.0)

    m_head, q_head = parts(d)
    m_tail, q_tail = parts(d[:, ::-1])
    # the window that starts at sample j of block b: the last W - j samples of b and the first j of b + 1
    m1, q1 = m_tail[:-1, :0:-1] + centre[:-1], q_tail[:-1, :0:-1]
    m2, q2 = m_head[1:, :-1] + centre[1:], q_head[1:, :-1]
    share = count[:-1] / W
    mean = (m1 + share * (m2 - m1)).reshape(-1, flat.shape[1])[: n - W + 1]
    squares = (q1 + q2 + W * share * (1.0 - share) * (m2 - m1) ** 2).reshape(-1, flat.shape[1])[: n - W + 1]
    return mean, squares


def window_samples(imu: ImuSeries, window_s: float) -> int:
    """Samples in a window of ``window_s`` seconds at the median rate, at least 2.

    Raises
    ------
    InputError
        If the window is not positive or longer than the log.
    """
    if not (np.isfinite(window_s) and window_s > 0.0):
        raise InputError(f"window_s: expected a positive time, got {window_s} s")
    if len(imu) < 2:
        raise InputError(f"the log has {len(imu)} sample; a window needs at least 2")
    W = max(2, round(window_s * imu.rate_hz))
    if len(imu) < W:
        raise InputError(
            f"window_s: {window_s} s are {W} samples, but the log has only {len(imu)}; choose a shorter one"
        )
    return W


def statistic(
    imu: ImuSeries,
    kind: Kind = "moving deviation",
    window_s: float = 1.0,
    *,
    sigma_f: ArrayLike,
    sigma_w: ArrayLike,
    gravity: float = G0,
    gyro_bias: ArrayLike = (0.0, 0.0, 0.0),
    max_rate: float = MAX_RATE,
) -> FloatArray:
    """Test statistic of standing still around every sample.

    Parameters
    ----------
    imu : ImuSeries
        Rates or increments; increments are divided by their intervals.
    kind : str
        ``moving deviation``
            ``max(s_i^2 / sigma_i^2, |mean omega - b_g|^2 / max_rate^2)`` over the six axes i, s_i the standard
            deviation over the window. Needs no calibrated accelerometer.
        ``printed``
            ``max(s^2(|f|) / sigma_f^2, s^2(|omega|) / sigma_w^2)`` as printed by Yaman: turning uniformly about any
            axis looks like rest. For comparison only.
        ``glrt``
            ``mean(|f - g f_m / |f_m||^2 / sigma_f^2 + |omega - b_g|^2 / sigma_w^2)``, f_m the mean over the window:
            the likelihood-ratio test ("SHOE").
        ``acceleration variance``
            ``mean(|f - f_m|^2) / sigma_f^2``
        ``acceleration magnitude``
            ``mean((|f| - g)^2) / sigma_f^2``
        ``angular rate energy``
            ``mean(|omega - b_g|^2) / sigma_w^2``
    window_s : float
        Length of the window, centred on the sample. [s]
    sigma_f, sigma_w : float or array_like of shape (3,)
        Standard deviation of a sample at rest, of specific force [m/s^2] and angular rate [rad/s]; three values are
        for the axes. The two of norms (``printed``, ``acceleration magnitude``) take their root mean square.
    gravity : float
        Local gravity, for ``glrt`` and ``acceleration magnitude``. [m/s^2]
    gyro_bias : array_like, shape (3,)
        Subtracted from the rates. [rad/s]
    max_rate : float
        Mean rate that counts as 1 in ``moving deviation``. [rad/s]

    Returns
    -------
    ndarray, shape (n,)
        Dimensionless; compare with :func:`schuler.standstill.thresholds.threshold`. Within half a window of the ends
        it is that of the nearest complete window.

    Raises
    ------
    InputError
        If the kind is unknown, a sigma is not positive, or the window does not fit.

    References
    ----------
    Skog, Handel, Nilsson, Rantakokko (2010), eqs. (10)-(18), without their common threshold; Yaman (2017), eqs.
    (4-65), (4-66). Departure from Yaman: deviations are taken of every axis, not of the norms, and the mean rate is
    tested as well, since the norms are constant in uniform rotation.
    """
    if kind not in KINDS:
        raise InputError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    W = window_samples(imu, window_s)
    sf, sw = per_axis_sigma(sigma_f, "sigma_f"), per_axis_sigma(sigma_w, "sigma_w")
    rates = imu.rates()
    f, bias = rates.accel, as_vector3(gyro_bias, "gyro_bias")
    if kind == "moving deviation":
        return moving_deviation(rates, W, sf, sw, bias, positive_number(max_rate, "max_rate"))[0]
    omega = rates.gyro - bias
    if kind == "printed":
        norms = np.stack((np.linalg.norm(f, axis=1) / _rms(sf), np.linalg.norm(omega, axis=1) / _rms(sw)), axis=1)
        return np.asarray(moving_moments(norms, W)[1].max(axis=1))
    if kind == "acceleration magnitude":
        return (
            moving_moments((np.linalg.norm(f, axis=1) - positive_number(gravity, "gravity")) ** 2, W)[0] / _rms(sf) ** 2
        )
    if kind == "angular rate energy":
        return moving_moments(np.sum((omega / sw) ** 2, axis=1), W)[0]
    f_m, variance = moving_moments(f, W)
    spread: FloatArray = np.sum(variance / sf**2, axis=1)
    if kind == "acceleration variance":
        return spread
    # the part of f - g f_m/|f_m| that is common to the window, along f_m
    norm = np.linalg.norm(f_m, axis=1, keepdims=True)
    none = norm[:, 0] == 0.0  # free fall, or a sensor without power: off by gravity in whatever direction
    excess = f_m * (1.0 - positive_number(gravity, "gravity") / np.where(none[:, None], 1.0, norm))
    excess[none, 2] = -gravity
    energy = moving_moments(np.sum((omega / sw) ** 2, axis=1), W)[0]
    return np.asarray(spread + np.sum((excess / sf) ** 2, axis=1) + energy)


def moving_deviation(
    rates: ImuSeries, W: int, sigma_f: FloatArray, sigma_w: FloatArray, gyro_bias: FloatArray, max_rate: float
) -> tuple[FloatArray, FloatArray]:
    """The statistic ``moving deviation`` and the mean rate that is part of it, from one pass over the log.

    Parameters
    ----------
    rates : ImuSeries
    W : int
        Samples of a window.
    sigma_f, sigma_w : ndarray, shape (3,)
        Standard deviation of a sample at rest. [m/s^2], [rad/s]
    gyro_bias : ndarray, shape (3,)
        [rad/s]
    max_rate : float
        [rad/s]

    Returns
    -------
    value : ndarray, shape (n,)
        As :func:`statistic`.
    rate : ndarray, shape (n,)
        As :func:`mean_rate`. [rad/s]
    """
    value, rate = np.empty(len(rates)), np.empty(len(rates))
    # part by part: all of a day at 200 Hz at once would take 8 GB
    for rows, mean, variance in _moments_by_parts(rates.gyro, W, gyro_bias):
        rate[rows] = np.linalg.norm(mean, axis=1)
        value[rows] = np.maximum((rate[rows] / max_rate) ** 2, (variance / sigma_w**2).max(axis=1))
    for rows, _, variance in _moments_by_parts(rates.accel, W):
        np.maximum(value[rows], (variance / sigma_f**2).max(axis=1), out=value[rows])
    return value, rate


def mean_rate(imu: ImuSeries, window_s: float, gyro_bias: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Magnitude of the mean angular rate over the window, bias removed. Shape (n,). [rad/s]"""
    bias, rate = as_vector3(gyro_bias, "gyro_bias"), np.empty(len(imu))
    for rows, mean, _ in _moments_by_parts(imu.rates().gyro, window_samples(imu, window_s)):
        rate[rows] = np.linalg.norm(mean - bias, axis=1)
    return rate


def per_axis_sigma(value: ArrayLike, name: str) -> FloatArray:
    """One positive 1-sigma value for all axes, or three. Shape (3,)."""
    sigma = as_floats(value, name)
    if sigma.shape not in ((), (3,)) or not np.all(sigma > 0.0):
        raise InputError(f"{name}: expected one positive number or three, got {value!r}")
    return np.broadcast_to(sigma, (3,))


def _rms(sigma: FloatArray) -> float:
    return float(np.sqrt(np.mean(sigma**2)))


def positive_number(value: float, name: str) -> float:
    """The value, if it is finite and above zero; InputError otherwise."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name}: expected a positive number, got {value}")
    return float(value)
