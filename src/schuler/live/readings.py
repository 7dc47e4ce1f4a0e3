"""Raw samples of an IMU brought to SI and forward-right-down axes, as ``[recording.imu]`` of a configuration says."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.config import NavigationConfig
from schuler.recording.io.checks import MAX_FORCE, MAX_RATE
from schuler.recording.io.columns import ACCEL, GYRO
from schuler.recording.io.hint_texts import axes_matrix, factor, parse_scale, parse_units
from schuler.recording.io.hints import ReadHints
from schuler.recording.series import Kind

_LIMITS = np.array([MAX_RATE] * 3 + [MAX_FORCE] * 3)


@dataclass(frozen=True)
class Readings:
    """Conversion of samples.

    Attributes
    ----------
    kind : {"rate", "increment"}
    gyro, accel : ndarray, shape (3,)
        Factors to SI, along the sensor's axes.
    C_bs : ndarray, shape (3, 3)
        Sensor components to forward, right, down.
    """

    kind: Kind
    gyro: FloatArray
    accel: FloatArray
    C_bs: FloatArray

    @property
    def is_si(self) -> bool:
        """Whether samples come in SI and forward-right-down axes."""
        return bool(np.all(self.gyro == 1.0) and np.all(self.accel == 1.0) and np.array_equal(self.C_bs, np.eye(3)))

    def to_si(self, gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Angular rate and specific force, or their integrals, in SI and forward-right-down axes. Shapes (n, 3)."""
        return (gyro * self.gyro) @ self.C_bs.T, (accel * self.accel) @ self.C_bs.T

    def impossible(self, x: FloatArray, interval_s: float) -> BoolArray | None:
        """Whether samples have readings that no sensor gives; None if there are none of these.

        Parameters
        ----------
        x : ndarray, shape (n, 6)
            Angular rate and specific force, or their integrals, in SI.
        interval_s : float
            Sample interval, for integrals. [s]

        Returns
        -------
        ndarray of bool, shape (n,), or None
        """
        per = 1.0 / interval_s if self.kind == "increment" else 1.0
        with np.errstate(invalid="ignore"):
            possible: BoolArray = np.abs(x) * per <= _LIMITS
        if possible.all():
            return None
        impossible: BoolArray = ~np.all(possible, axis=1)
        return impossible


def imu_readings(config: NavigationConfig, kind: Kind | None = None) -> Readings:
    """Conversion of an IMU's samples by the hints with which its log is read.

    Parameters
    ----------
    config : NavigationConfig
        ``units``, ``scale``, ``axes`` and ``kind`` of ``[recording.imu]``, or of ``[recording]`` without parts; what is
        left out is SI, forward-right-down, rates.
    kind : {"rate", "increment"}, optional
        Samples are in SI and forward-right-down already and of this kind; the hints do not count.

    Raises
    ------
    ConfigError
        If a hint is wrong.
    """
    if kind is not None:
        return Readings(kind, np.ones(3), np.ones(3), np.eye(3))
    part = config.recording.get("imu", config.recording)
    names = {f.name for f in fields(ReadHints)}
    try:
        hints = ReadHints.of(**{name: value for name, value in part.items() if name in names})
        units, scale = parse_units(hints.units, hints.kind), parse_scale(hints.scale)
    except InputError as error:
        raise ConfigError(f"recording: {error}") from None
    if isinstance(scale, str):
        raise ConfigError(f"recording: scale = {scale!r} names an array of a file; give numbers for a stream")

    def factors(group: str, names: tuple[str, ...]) -> FloatArray:
        to_si = factor(units[group], group, hints.kind) if group in units else 1.0
        numbers = [(scale or {}).get(name, (scale or {}).get(group, 1.0)) for name in names]
        return np.array(numbers) * to_si

    return Readings(hints.kind, factors("gyro", tuple(GYRO)), factors("accel", tuple(ACCEL)), axes_matrix(hints.axes))
