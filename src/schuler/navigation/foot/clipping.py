"""Rates beyond the range of the gyroscopes: a plateau in a swing, and the angle that it hides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.recording.series import ImuSeries

_LEVEL, _FLAT = 0.9, 0.004  # of the largest rate of an axis: where a plateau may lie, and its change in a sample
_LEAST_S = 0.02  # a smooth maximum is as flat for less: none of 24 walks that reach no limit, but for one sample in two
_LONGEST_S = 0.2  # a longer one is a foot that is turned steadily
_LEAST_RATE = 4.0  # ranges begin at 250 deg/s [rad/s]
_FOOT = 0.8  # of the plateau: where its flanks are taken from
_SHARE = 0.5  # 1 sigma of the hidden angle over it
_DOUBTFUL_RAD = 0.5  # hidden in the log in all, beyond which the walk is doubted: 0.31 on runs that came out well


@dataclass(frozen=True, eq=False)
class Clips:
    """Places where a gyroscope stayed at the end of its range.

    Attributes
    ----------
    axis : ndarray of int, shape (k,)
    index : ndarray of int, shape (k, 2)
        First and last sample.
    angle : ndarray, shape (k,)
        What the readings lack, signed. [rad]
    """

    axis: IntArray
    index: IntArray
    angle: FloatArray

    def __len__(self) -> int:
        return len(self.axis)

    def where(self, keep: BoolArray) -> Clips:
        """Some of the places; a mask, shape (k,)."""
        return Clips(self.axis[keep], self.index[keep], self.angle[keep])


def gyro_clips(imu: ImuSeries, largest: FloatArray | None = None) -> Clips:
    """Find plateaus of the rates and the angle they hide.

    Parameters
    ----------
    imu : ImuSeries
    largest : ndarray, shape (3,), optional
        Largest rates of the axes, if the series is a part of a log; left out: those of the series. [rad/s]

    Returns
    -------
    Clips

    Notes
    -----
    Calibrated readings of a clipped axis are not quite equal, and a sensor's filter rounds the corners. A plateau is
    where an axis stays near its largest rate, flat for longer than a swing's own maximum is. Between flanks of slopes
    a and b the rate would have gone on as a parabola: over the time d the area above is ``a b / (a + b) d^2 / 3``.
    """
    gyro, dt = imu.rates().gyro, imu.interval
    axes, spans, angles = [], [], []
    for axis in range(3):
        x = gyro[:, axis]
        top = float(np.abs(x).max() if largest is None else largest[axis])
        if top < _LEAST_RATE:
            continue
        high = np.abs(x) > _LEVEL * top
        flat = (np.abs(np.diff(x)) < _FLAT * top) & high[1:] & high[:-1]
        edge = np.diff(np.concatenate(([0], flat.astype(np.int8), [0])))
        for i, j in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True):
            if j > i + 1 and _LEAST_S - 1e-9 < (j - i + 1) * dt < _LONGEST_S:
                axes.append(axis)
                spans.append((i, j))
                angles.append(_hidden(x, int(i), int(j), dt))
    return Clips(np.array(axes, dtype=np.int64), np.array(spans, dtype=np.int64).reshape(-1, 2), np.array(angles))


def _hidden(x: FloatArray, i: int, j: int, dt: float) -> float:
    """Angle above the plateau from sample i to j, from the slopes of its flanks. [rad]"""
    sign = float(np.sign(x[i]))
    y, before, after = sign * x, i, j
    while before > 0 and y[before] > _FOOT * y[i]:
        before -= 1
    while after < len(y) - 1 and y[after] > _FOOT * y[j]:
        after += 1
    rise = float(y[i] - y[before]) / (max(i - before, 1) * dt)
    fall = float(y[j] - y[after]) / (max(after - j, 1) * dt)
    if rise <= 0.0 or fall <= 0.0:  # the log begins or ends here
        return 0.0
    return sign * rise * fall / (rise + fall) * ((j - i) * dt) ** 2 / 3.0


def restored(imu: ImuSeries, clips: Clips) -> ImuSeries:
    """The log with hidden angles put back, as parabolas over the plateaus; rates or increments."""
    if not len(clips):
        return imu
    gyro = imu.gyro.copy()
    to_readings = imu.interval if imu.kind == "increment" else 1.0
    for axis, (i, j), angle in zip(clips.axis, clips.index, clips.angle, strict=True):
        s = (np.arange(j - i + 1) + 0.5) / (j - i + 1)
        shape = s * (1.0 - s)
        gyro[i : j + 1, axis] += angle / imu.interval * to_readings * shape / shape.sum()
    return replace(imu, gyro=gyro)


def clip_noise(imu: ImuSeries, clips: Clips) -> FloatArray:
    """White noise ``N^2`` of the rates that stands for the uncertainty of hidden angles. Shape (3,) [rad^2/s]"""
    total = np.zeros(3)
    np.add.at(total, clips.axis, (_SHARE * clips.angle) ** 2)
    return np.asarray(total / (imu.t[-1] - imu.t[0]))


def clip_sentences(imu: ImuSeries, clips: Clips) -> tuple[list[str], list[str]]:
    """Sentences on clipped gyroscopes: notes, and doubts where much was hidden."""
    if not len(clips):
        return [], []
    rates = imu.rates().gyro
    texts = []
    for axis in np.unique(clips.axis):
        of_axis = clips.axis == axis
        hidden = float(np.abs(clips.angle[of_axis]).sum())
        texts.append(
            f"gyroscope {'xyz'[axis]} stays at its largest rate ({np.abs(rates[:, axis]).max() / units.DEG:.0f} deg/s) "
            f"in {int(of_axis.sum())} places, the first at {imu.t[clips.index[of_axis][0, 0]]:.3f} s: clipped; about "
            f"{hidden / units.DEG:.3g} deg hidden there were put back by the slopes of the flanks, with an uncertainty "
            f"of {100.0 * _SHARE:.0f} %"
        )
    doubtful = float(np.abs(clips.angle).sum()) > _DOUBTFUL_RAD
    advice = "; use a gyroscope of a larger range"
    return ([], [text + advice for text in texts]) if doubtful else (texts, [])
