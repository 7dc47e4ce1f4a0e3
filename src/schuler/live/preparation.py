"""Samples of a live IMU made ready for the filter: vehicle axes, GNSS clock, calibrated, integrated, pauses bridged.

Block by block the same steps as :func:`schuler.navigation.inputs.preparation.prepared_imu` takes for a log, and
:meth:`schuler.recording.series.ImuSeries.increments` after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.thermal.correction import compensate_thermal
from schuler.live.columns import Columns
from schuler.live.queue import SIZE
from schuler.live.readings import Readings
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.preparation import MISSING
from schuler.navigation.inputs.spikes import IN_A_ROW, SPIKE
from schuler.navigation.recent_samples import RecentSamples
from schuler.navigation.start.calibration import CalibrationStart
from schuler.recording.io.checks import MAX_FORCE, MAX_RATE
from schuler.recording.series import ImuSeries, Kind
from schuler.sensors.increments import integrate_rates


@dataclass(frozen=True)
class PreparedSamples:
    """Consecutive samples as the filter and the aids take them, body axes.

    Attributes
    ----------
    t, dt : ndarray, shape (n,)
        End and length of each interval. [s]
    dtheta, dv : ndarray, shape (n, 3)
        Increments. [rad], [m/s]
    unknown : ndarray, shape (n, 2)
        1-sigma of rate [rad/s] and specific force [m/s^2] over the interval where it bridges a pause, else zero.
    rate, force : ndarray, shape (n, 3)
        As sampled, or the means over the interval. [rad/s], [m/s^2]
    """

    t: FloatArray
    dt: FloatArray
    dtheta: FloatArray
    dv: FloatArray
    unknown: FloatArray
    rate: FloatArray
    force: FloatArray

    def __len__(self) -> int:
        return len(self.t)


class SamplePreparation:
    """Preparation of one block of samples after the other.

    Parameters
    ----------
    config : NavigationConfig
        ``imu.mount_rpy_deg``, ``imu.clock_shift_s`` and ``imu.rate_order`` are used.
    kind : {"rate", "increment"}
    interval_s : float
        Nominal sample interval. [s]
    calibrated : CalibrationStart, optional
        Start from a calibration, whose correction is applied.
    """

    def __init__(
        self, config: NavigationConfig, kind: Kind, interval_s: float, calibrated: CalibrationStart | None
    ) -> None:
        self.kind, self.order, self.shift = kind, config.imu.rate_order, config.imu.clock_shift_s
        mount = config.imu.mount_rpy_deg
        self._C_bs = rotation.dcm_from_rpy(np.array(mount) * units.DEG) if any(mount) else None
        self.calibrated = calibrated
        self.recent = RecentSamples(interval_s)
        self.before = np.empty((0, 7))  # the last two samples: time, rate, specific force (SI, corrected)
        self._max_gap_s = config.imu.max_gap_s
        self._usual: Callable[[FloatArray, float, Columns, int], bool] | None = None
        self._x = np.empty((SIZE, 6))

    def take_usual(self, rows: FloatArray, last: float, readings: Readings, columns: Columns) -> bool:
        """Raw samples made ready in one compiled call and appended to columns, if all of them are as usual.

        Parameters
        ----------
        rows : ndarray, shape (n, 8)
            Time, rate, specific force, temperature, in units and axes of the sensor.
        last : float
            Stamp of the sample before them. [s]
        readings : Readings
            Conversion to SI, always the same.
        columns : Columns
            ``t``, ``dt``, ``dtheta``, ``dv``, ``unknown``.

        Returns
        -------
        bool
            False, with nothing taken, where a sample is late, repeated or beyond what moves, at the beginning of a run,
            with a calibration and with parabolas through rates: that is for :meth:`take`.
        """
        n = len(rows)
        if len(self.before) < 2 or self.calibrated is not None or self.order == 3 or n > SIZE:
            return False
        if self._usual is None:
            self._usual = self._compiled(readings)
        place = columns.room(n)
        if not self._usual(rows, last, columns, place):
            return False
        columns.grow(n)
        self.recent.count += n
        return True

    def motion(self, count: int) -> FloatArray:
        """Rate and specific force of the samples that :meth:`take_usual` took last. Shape (n, 6)."""
        return self._x[:count]

    def take(
        self, t: FloatArray, gyro: FloatArray, accel: FloatArray, temperature: FloatArray
    ) -> tuple[PreparedSamples, list[str]]:
        """Samples in SI and the IMU's forward-right-down axes, made ready, and sentences on what was bridged.

        Parameters
        ----------
        t : ndarray, shape (n,)
            Increasing, also beyond the block before. [s]
        gyro, accel : ndarray, shape (n, 3)
        temperature : ndarray, shape (n,)
            NaN where there is none. [degC]
        """
        h = self.recent.interval_s
        t = t + self.shift if self.shift else t
        dt = np.diff(t, prepend=self.before[-1, 0] if len(self.before) else t[0] - h) if len(t) else t
        calibrated = self.calibrated
        if calibrated is not None:
            gyro, accel = self._in_si(calibrated, t, dt, gyro, accel, temperature)
        if self._C_bs is not None:
            gyro, accel = gyro @ self._C_bs.T, accel @ self._C_bs.T
        if self.kind == "increment":
            dtheta, dv, unknown, sentences = self.recent.checked_block(t, dt, gyro, accel)
            if calibrated is not None:
                dtheta, dv = calibrated.correction.apply(dtheta, dv, dt[:, None])
            self.before = np.vstack((self.before, np.column_stack((t, dtheta, dv))))[-2:]
            rate, force = dtheta / dt[:, None], dv / dt[:, None]
            return PreparedSamples(t, dt, dtheta, dv, unknown, rate, force), sentences
        if calibrated is not None:
            gyro, accel = calibrated.correction.apply(gyro, accel, 1.0)
        keep = self._motion(gyro, accel)
        sentences = [f"{t[i]:.3f} s: a single reading is no motion and left out" for i in np.flatnonzero(~keep)]
        rows = np.vstack((self.before, np.column_stack((t, gyro, accel))[keep]))
        if len(rows) < 2:
            self.before = rows
            return _no_samples(), sentences
        skip = max(len(self.before) - 1, 0)  # intervals that were taken before
        self.before = rows[-2:]
        t, x = rows[:, 0], rows[:, 1:]
        dtheta, dv = (integrate_rates(t, x[:, k : k + 3], self.order)[skip:] for k in (0, 3))
        dt, t, x = np.diff(t)[skip:], t[1 + skip :], x[1 + skip :]
        dtheta, dv, unknown, more = self.recent.checked_block(t, dt, dtheta, dv)
        return PreparedSamples(t, dt, dtheta, dv, unknown, x[:, :3], x[:, 3:]), sentences + more

    def document(self) -> dict[str, Any]:
        """What goes on from one block to the next, for files."""
        r = self.recent
        recent = {"rows": r.rows.copy(), "largest": r.largest.copy(), "count": r.count.copy()}
        return {"before": self.before.copy(), "recent": recent}

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from a :meth:`document`."""
        self.before = np.array(document["before"])
        for name, value in document["recent"].items():
            getattr(self.recent, name)[...] = value

    def _compiled(self, readings: Readings) -> Callable[[FloatArray, float, Columns, int], bool]:
        """The compiled function for usual samples with everything that it needs."""
        from schuler.jit import direct
        from schuler.live import _kernels

        _kernels.prepare_live()
        recent, mounted = self.recent, self._C_bs is not None
        factors = np.concatenate((readings.gyro, readings.accel))
        axes = np.ascontiguousarray(np.stack((readings.C_bs, self._C_bs if self._C_bs is not None else np.eye(3))))
        numbers = np.array(
            [
                self.shift, recent.interval_s, self._max_gap_s, MISSING, MAX_RATE, MAX_FORCE, *SPIKE, recent.keep,
                self.kind == "rate", self.order, readings.is_si, mounted, 0.0,
            ]
        )  # fmt: skip
        take_samples = direct(_kernels.take_samples)

        def take(rows: FloatArray, last: float, columns: Columns, place: int) -> bool:
            numbers[-1] = recent.count[0]
            m = columns.memory
            return bool(
                take_samples(
                    rows, last, numbers, factors, axes, self.before, recent.rows, recent.largest, m["t"], m["dt"],
                    m["dtheta"], m["dv"], m["unknown"], place, self._x,
                )
            )  # fmt: skip

        return take

    def _in_si(
        self, calibrated: CalibrationStart, t: FloatArray, dt: FloatArray, gyro: FloatArray, accel: FloatArray,
        temperature: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """Samples times the factors of the calibration, with the part that depends on temperature taken out."""
        factor_accel, factor_gyro = calibrated.calibration.nominal
        gyro, accel = gyro * factor_gyro, accel * factor_accel
        if "thermal" not in calibrated.calibration.extra or not len(t):
            return gyro, accel
        h = dt[:, None] if self.kind == "increment" else 1.0
        rates = ImuSeries(t, gyro / h, accel / h, "rate", temperature)
        rates = compensate_thermal(calibrated.calibration, rates)
        return rates.gyro * h, rates.accel * h

    def _motion(self, gyro: FloatArray, accel: FloatArray) -> BoolArray:
        """Readings that a vehicle can have, by those before; a fourth one in a row is believed. Shape (n,)."""
        rate, force = np.abs(gyro).max(axis=1, initial=0.0), np.abs(accel).max(axis=1, initial=0.0)
        keep = np.ones(len(gyro), dtype=bool)
        for i in np.flatnonzero((rate > 20.0) | (force > 190.0)):  # the rest cannot be spikes
            doubted = i >= IN_A_ROW and not keep[i - IN_A_ROW : i].any()
            keep[i] = doubted or not self.recent.is_spike(float(rate[i]), float(force[i]))
        return keep


def _no_samples() -> PreparedSamples:
    none = np.empty(0)
    return PreparedSamples(none, none, *(np.empty((0, width)) for width in (3, 3, 2, 3, 3)))
