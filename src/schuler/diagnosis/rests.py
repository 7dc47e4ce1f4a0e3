"""Where the sensor rests, judged without trusting any unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.recording.series import ImuSeries

WINDOW_S = 1.0
_STEADY = 0.03  # of the specific force at rest: its spread on an axis in a window
_SLOW = 0.3  # [m/s]
_QUIET = 3.0  # spread of the rates of a rest, over that of the quietest tenth


@dataclass(frozen=True)
class Rests:
    """Stretches of rest of a second or more.

    Attributes
    ----------
    first, last : ndarray of int, shape (m,)
        Sample range ``first:last`` of each.
    t : ndarray, shape (m, 2)
        Start and stop. [s]
    accel, gyro : ndarray, shape (m, 3)
        Means, in the units of the log.
    accel_sd, gyro_sd : ndarray, shape (m, 3)
        Typical spread of a sample in its second, in the units of the log.
    """

    first: IntArray
    last: IntArray
    t: FloatArray
    accel: FloatArray
    gyro: FloatArray
    accel_sd: FloatArray
    gyro_sd: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    @property
    def seconds(self) -> float:
        """Rest in all. [s]"""
        return float(np.sum(self.t[:, 1] - self.t[:, 0]))


def find_rests(imu: ImuSeries, speed: tuple[FloatArray, FloatArray] | None = None) -> Rests:
    """All stretches of rest of a log.

    Parameters
    ----------
    imu : ImuSeries
        In whatever units, rates or increments.
    speed : (ndarray, ndarray), optional
        Times [s] and speeds [m/s] of another source on the IMU's clock: nothing faster than 0.3 m/s rests.

    Returns
    -------
    Rests
        Empty if there is none.

    Notes
    -----
    A window of a second rests if its specific force is steady to 3 % of the log's typical norm on each axis, does not
    drift, and its rates are as quiet as the quietest tenth of the log and do not turn it. Only ratios are used. Same
    idea as :func:`schuler.recording.io.checks.find_rest`, which stops at the first.
    """
    t = imu.t
    interval = imu.interval if len(t) > 1 else 1.0
    per = max(10, int(np.ceil(WINDOW_S / interval)))
    m = len(t) // per
    if m == 0:
        return _collect(imu, np.zeros(0, dtype=bool), per, None, None)
    f = imu.accel[: m * per].reshape(m, per, 3)
    w = imu.gyro[: m * per].reshape(m, per, 3)
    level = np.linalg.norm(f.mean(axis=1), axis=1)
    typical = float(np.median(np.linalg.norm(imu.accel, axis=1)))
    f_sd, w_sd = f.std(axis=1), w.std(axis=1)
    half = per // 2
    drift = np.linalg.norm(f[:, :half].mean(axis=1) - f[:, half:].mean(axis=1), axis=1)
    steady = (f_sd.max(axis=1) <= _STEADY * typical) & (drift <= 0.01 * typical) & (level > 0.0)
    steady &= np.abs(level - typical) < 0.3 * max(typical, 1e-300)
    noise = w_sd.max(axis=1)
    quietest, loudest = np.quantile(noise, 0.1), np.quantile(noise, 0.9)
    rate = np.linalg.norm(w.mean(axis=1), axis=1)
    # the mean rate at rest is the bias: it must be that of the quietest windows, not merely small
    calm = np.median(w.mean(axis=1)[noise <= quietest], axis=0)
    off = np.linalg.norm(w.mean(axis=1) - calm, axis=1)
    quiet = noise <= _QUIET * quietest
    if loudest > _QUIET * quietest:
        quiet &= (rate <= 0.1 * np.abs(imu.gyro).max()) & (off <= 2.0 * np.maximum(quietest, 1e-300) + 0.005 * _top(w))
    ends = t[: m * per].reshape(m, per)
    if speed is not None:
        middle = ends.mean(axis=1)
        inside = (middle >= speed[0][0]) & (middle <= speed[0][-1])
        quiet &= ~inside | (np.interp(middle, *speed) < _SLOW)
    whole = ends[:, -1] - ends[:, 0] < 1.5 * per * interval
    return _collect(imu, steady & quiet & whole, per, f_sd, w_sd)


def _top(w: FloatArray) -> float:
    return float(np.quantile(np.linalg.norm(w.mean(axis=1), axis=1), 0.98))


def _collect(imu: ImuSeries, still: FloatArray, per: int, f_sd: FloatArray | None, w_sd: FloatArray | None) -> Rests:
    edge = np.diff(np.concatenate(([False], still, [False])).astype(np.int8))
    a, b = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    if not len(a) or f_sd is None or w_sd is None:
        none = np.zeros(0, dtype=np.int64)
        empty = np.zeros((0, 3))
        return Rests(none, none, np.zeros((0, 2)), empty, empty, empty, empty)
    # a change of attitude between neighbouring windows parts two rests
    means = imu.accel[: len(still) * per].reshape(len(still), per, 3).mean(axis=1)
    first, last = [], []
    for i, j in zip(a.tolist(), b.tolist(), strict=True):
        start = i
        for k in range(i + 1, j):
            if np.linalg.norm(means[k] - means[start]) > 0.05 * np.linalg.norm(means[start]):
                first.append(start)
                last.append(k)
                start = k
        first.append(start)
        last.append(j)
    lo, hi = np.array(first) * per, np.array(last) * per
    t = np.stack([imu.t[lo], imu.t[hi - 1]], axis=1)
    accel = np.stack([imu.accel[i:j].mean(axis=0) for i, j in zip(lo, hi, strict=True)])
    gyro = np.stack([imu.gyro[i:j].mean(axis=0) for i, j in zip(lo, hi, strict=True)])
    sd_f = np.stack([np.median(f_sd[i:j], axis=0) for i, j in zip(first, last, strict=True)])
    sd_w = np.stack([np.median(w_sd[i:j], axis=0) for i, j in zip(first, last, strict=True)])
    return Rests(lo, hi, t, accel, gyro, sd_f, sd_w)
