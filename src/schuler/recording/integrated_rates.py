"""Increments of a log of rates: integrated once, or of a long log whenever they are asked for."""

from __future__ import annotations

from typing import Self

import numpy as np

from schuler.arrays import FloatArray
from schuler.recording.series import ImuSeries, Increments
from schuler.recording.trajectory import KEPT
from schuler.sensors.increments import integrate_rates

_BLOCK = 1 << 17  # samples that are integrated at a time


def integrated(imu: ImuSeries, order: int) -> Increments:
    """Increments over the intervals between samples of rates, those of a long log an :class:`IntegratedRates`.

    Parameters
    ----------
    imu : ImuSeries
        Of rates, n samples.
    order : {1, 2, 3}
        Rule of :func:`schuler.sensors.increments.integrate_rates`.

    Returns
    -------
    Increments
        n - 1 intervals.
    """
    if len(imu) > KEPT:
        return IntegratedRates(imu, order)
    dtheta, dv = (integrate_rates(imu.t, rates, order) for rates in (imu.gyro, imu.accel))
    return Increments(imu.t[1:], np.diff(imu.t), dtheta, dv)


class IntegratedRates(Increments):
    """Increments of rates, made anew when asked for: kept, those of a day at 200 Hz take 970 MB.

    Parameters
    ----------
    imu : ImuSeries
        Of rates, n samples.
    order : {1, 2, 3}
    rows : slice, optional
        Of the n - 1 intervals; default all.
    t : ndarray, optional
        Ends of these intervals, where they are not the samples' times. [s]
    """

    def __init__(self, imu: ImuSeries, order: int, rows: slice | None = None, t: FloatArray | None = None) -> None:
        first, stop, _ = (rows or slice(None)).indices(len(imu) - 1)
        for rates in (imu.gyro[:3], imu.accel[:3]):
            integrate_rates(imu.t[:3], rates, order)  # refuses an order that there is not, now
        object.__setattr__(self, "t", imu.t[first + 1 : stop + 1] if t is None else t)
        object.__setattr__(self, "_source", (imu, order, first))

    _source: tuple[ImuSeries, int, int]

    @property
    def dt(self) -> FloatArray:
        """Length of each interval. Shape (n,). [s]"""
        return self._lengths(slice(0, len(self)))

    @property
    def dtheta_ib_b(self) -> FloatArray:
        """Integrals of angular rate, body axes. Shape (n, 3). [rad]"""
        return self._whole(0)

    @property
    def dv_ib_b(self) -> FloatArray:
        """Integrals of specific force, body axes. Shape (n, 3). [m/s]"""
        return self._whole(1)

    @property
    def start(self) -> float:
        """Beginning of the first interval. [s]"""
        return float(self.t[0] - self._lengths(slice(0, 1))[0])

    def arrays(self, rows: slice) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Integrals of angular rate [rad] and specific force [m/s], lengths and ends [s] of some intervals."""
        return *self._integrals(rows), self._lengths(rows), self.t[rows]

    def shifted(self, seconds: float) -> Self:
        """The same increments, their intervals ``seconds`` later."""
        imu, order, first = self._source
        return type(self)(imu, order, slice(first, first + len(self)), self.t + seconds)

    def _part(self, rows: slice) -> Increments:
        imu, order, first = self._source
        if rows.stop - rows.start > KEPT:
            return IntegratedRates(imu, order, slice(first + rows.start, first + rows.stop), self.t[rows])
        dtheta, dv, dt, t = self.arrays(rows)
        return Increments(t, dt, dtheta, dv)

    def _lengths(self, rows: slice) -> FloatArray:
        imu, _, first = self._source
        start, stop, _ = rows.indices(len(self))
        return np.diff(imu.t[first + start : first + stop + 1])

    def _integrals(self, rows: slice) -> tuple[FloatArray, FloatArray]:
        imu, order, first = self._source
        start, stop, _ = rows.indices(len(self))
        begin = max(first + start - 1, 0)  # a parabola goes through the sample before the interval, too
        samples, own = slice(begin, first + stop + 1), slice(first + start - begin, None)
        dtheta, dv = (integrate_rates(imu.t[samples], rates[samples], order)[own] for rates in (imu.gyro, imu.accel))
        return dtheta, dv

    def _whole(self, sensor: int) -> FloatArray:
        values = np.empty((len(self), 3))
        for start in range(0, len(self), _BLOCK):
            rows = slice(start, start + _BLOCK)
            values[rows] = self._integrals(rows)[sensor]
        return values
