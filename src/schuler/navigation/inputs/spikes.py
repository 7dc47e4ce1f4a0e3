"""Spikes of an IMU log: one to three readings in a row that no vehicle moves by."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.recording.io.checks import largest
from schuler.recording.series import ImuSeries
from schuler.units import G0

#: Readings beyond either may be no motion: vehicles bear that for less than a sample.
SPIKE = (20.0, 20.0 * G0)  # [rad/s], [m/s^2]
#: Readings in a row within which a spike lies: a frame or two of a bus that are damaged; a launch or a crash lasts.
IN_A_ROW = 3
_TIMES = 4.0  # those beside it, that a spike is beyond
_BESIDE = 3  # readings on either side
_RARE = 0.01  # share of the readings beyond from which they are how the IMU reads
_AGREE = (0.5, 2.0)  # the means before and after it: nothing has happened [rad/s], [m/s^2]


def without_spikes(imu: ImuSeries, notes: list[str]) -> ImuSeries:
    """Put the mean rate of the readings beside it in place of every spike.

    Parameters
    ----------
    imu : ImuSeries
    notes : list of str
        Gets a sentence on what was replaced.

    Notes
    -----
    A reading of more than 20 g or 20 rad/s that is real is a shock: it lasts, or rings, and the motion after it is
    another one. A spike is at most three readings long, the three before and the three after it are below a fourth of
    it, as is one between two others, and their means agree to 2 m/s^2 and 0.5 rad/s.
    """
    h = imu.interval if imu.kind == "increment" else 1.0
    mended: dict[str, FloatArray] = {}
    first, count = "", 0
    for i, (name, unit) in enumerate((("gyro", "rad/s"), ("accel", "m/s^2"))):
        values = getattr(imu, name)
        if len(imu) <= 2 * _BESIDE or largest(values) <= SPIKE[i] * h:
            continue
        dt = np.diff(imu.t, prepend=imu.t[0] - h) if imu.kind == "increment" else np.ones(len(imu))
        for run, rate in _spikes(values, dt, h, i):
            size = float(np.abs(values[run] / dt[run, None]).max())
            mended.setdefault(name, values.copy())[run] = rate * dt[run, None]
            first = first or f"the first at {imu.t[run[0]]:.3f} s, {size:.3g} {unit}"
            count += len(run)
    if not count:
        return imu
    notes.append(
        f"{count} IMU readings are no motion ({first}): up to {IN_A_ROW} in a row between readings that agree with "
        "each other; replaced by the mean rate of these"
    )
    return replace(imu, gyro=mended.get("gyro", imu.gyro), accel=mended.get("accel", imu.accel))


def _spikes(values: FloatArray, dt: FloatArray, h: float, i: int) -> Iterator[tuple[IntArray, FloatArray]]:
    """Rows of each spike of a triad, and the mean rate beside it."""
    size = np.abs(values).max(axis=1) / np.maximum(dt, h)  # stamps that jitter make no rates
    high = np.flatnonzero(size > SPIKE[i])
    if len(high) > _RARE * len(size):  # it often reads as much
        return
    for run in np.split(high, np.flatnonzero(np.diff(high) >= IN_A_ROW) + 1):
        if not len(run) or run[-1] - run[0] >= IN_A_ROW or run[0] < _BESIDE or run[-1] + _BESIDE >= len(size):
            continue
        beside = (slice(run[0] - _BESIDE, run[0]), slice(run[-1] + 1, run[-1] + 1 + _BESIDE))
        before, after = ((values[k] / dt[k, None]).mean(axis=0) for k in beside)
        between = np.setdiff1d(np.arange(run[0], run[-1]), run)  # two of three: a blow would not pause
        calm = _TIMES * max(size[k].max() for k in (*beside, between) if len(size[k])) < size[run].min()
        if calm and np.abs(after - before).max() <= _AGREE[i]:
            yield run, 0.5 * (before + after)
