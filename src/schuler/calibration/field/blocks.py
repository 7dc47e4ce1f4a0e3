"""Means of raw readings over short blocks, to be compared with gravity and Earth rate."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals


@dataclass(frozen=True)
class Blocks:
    """Means over blocks of samples.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Middle of each block, where its means hold. [s]
    length : ndarray, shape (n,)
        [s]
    f, omega : ndarray, shape (n, 3)
        Mean raw specific force [m/s^2] and angular rate [rad/s], axes of the log.
    rest : ndarray of int, shape (n,)
        Number of the rest that each block belongs to; -1 for a block in motion.
    """

    t: FloatArray
    length: FloatArray
    f: FloatArray
    omega: FloatArray
    rest: IntArray

    def __len__(self) -> int:
        return len(self.t)

    def scatter(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviation of a block's mean about its rest's mean, axis by axis, pooled over all rests.

        Returns
        -------
        f, omega : ndarray, shape (3,)
            [m/s^2], [rad/s] NaN where no rest has two blocks.
        """
        squares, freedom = np.zeros(6), 0
        values = np.hstack((self.f, self.omega))
        for k in np.unique(self.rest[self.rest >= 0]):
            part = values[self.rest == k]
            squares += np.sum((part - part.mean(axis=0)) ** 2, axis=0)
            freedom += len(part) - 1
        sigma = np.sqrt(squares / freedom) if freedom else np.full(6, np.nan)
        return sigma[:3], sigma[3:]


def rest_blocks(imu: ImuSeries, rests: StaticIntervals, block_s: float) -> Blocks:
    """Blocks of equal length that fill the rests.

    Parameters
    ----------
    imu : ImuSeries
        Raw readings, SI.
    rests : StaticIntervals
        Rests of this log.
    block_s : float
        Length, to which a rest is divided evenly; a shorter rest is one block. [s]

    Raises
    ------
    InputError
        If the rests belong to another log.
    """
    if len(imu) != len(rests.mask):
        raise InputError(f"rests: expected those of this log of {len(imu)} samples, got {len(rests.mask)} samples")
    rates = imu.rates()
    h = rates.interval
    edges, number = [], []
    for k, (a, b) in enumerate(rests.index):
        parts = max(1, int((b - a) * h / block_s + 1e-6))
        cut = np.linspace(a, b, parts + 1).round().astype(np.int64)
        edges += list(pairwise(cut))
        number += [k] * parts
    if not edges:
        empty = np.empty((0, 3))
        return Blocks(np.empty(0), np.empty(0), empty, empty, np.empty(0, dtype=np.int64))
    span = np.array(edges)
    count = np.diff(span, axis=1)[:, 0]
    sums = np.vstack((np.zeros(6), np.cumsum(np.hstack((rates.accel, rates.gyro)), axis=0)))
    means = (sums[span[:, 1]] - sums[span[:, 0]]) / count[:, None]
    # an increment belongs to the interval before its stamp, a rate to the stamp
    early = 0.5 * h if imu.kind == "increment" else 0.0
    middle = 0.5 * (rates.t[span[:, 0]] + rates.t[span[:, 1] - 1]) - early
    return Blocks(middle, count * h, means[:, :3], means[:, 3:], np.array(number, dtype=np.int64))


def turning_blocks(
    imu: ImuSeries, rests: StaticIntervals, *, rate_hz: float, gravity: float, tolerance: float
) -> Blocks:
    """Single samples between the rests whose specific force is as large as gravity, at most at ``rate_hz``.

    Parameters
    ----------
    imu : ImuSeries
    rests : StaticIntervals
    rate_hz : float
    gravity : float
        [m/s^2]
    tolerance : float
        Largest difference of the raw specific force's magnitude from gravity: uncalibrated errors and accelerations by
        the hand. [m/s^2]

    Notes
    -----
    A mean over a turn is too short by ``(omega T)^2 / 24``; single samples are taken, 2e-6 at 36 deg/s and 100 Hz.
    """
    rates = imu.rates()
    step = max(1, round(rates.rate_hz / rate_hz))
    if not len(rests):
        chosen = np.empty(0, dtype=np.int64)
    else:
        between = np.arange(rests.index[0, 1], rests.index[-1, 0])
        chosen = between[~rests.mask[between]][::step]
    size = np.linalg.norm(rates.accel[chosen], axis=1)
    chosen = chosen[np.abs(size - gravity) <= tolerance]
    early = 0.5 * rates.interval if imu.kind == "increment" else 0.0
    return Blocks(
        rates.t[chosen] - early,
        np.full(len(chosen), rates.interval),
        rates.accel[chosen],
        rates.gyro[chosen],
        np.full(len(chosen), -1, dtype=np.int64),
    )
