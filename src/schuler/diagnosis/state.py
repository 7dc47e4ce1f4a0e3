"""State of a diagnosis: results of the checks so far, which later checks need."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from schuler.arrays import FloatArray
from schuler.diagnosis.accel_unit import Scaling
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion
from schuler.diagnosis.positions import GnssView
from schuler.diagnosis.result import Finding
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.standstill.unscaled import UnscaledRests

USUAL_GRAVITY = 9.806  # where the log has no position [m/s^2]
VEHICLE = 0.4  # share of accelerations that the path explains, of a body that goes where it points


@dataclass
class DiagnosisState:
    """Results of the checks so far.

    Attributes
    ----------
    recording : Recording
        As read.
    findings : list of Finding
    checked, undetermined : list of str
        What was checked, and what this log cannot tell.
    estimates, curves : dict
        See :class:`~schuler.diagnosis.result.Diagnosis`.
    gravity : float
        At the place, if it has a position. [m/s^2]
    scaling : Scaling
        Unit and kind of the accelerometer's numbers.
    gyro_factor : float
        Makes the gyroscope's numbers rad/s.
    rests : UnscaledRests or None
    imu, gnss : series or None
        None if too short for any check; ``gnss`` may be single points of satellite measurements.
    view : GnssView or None
    motion : Motion or None
        By GNSS.
    lag : Lag or None
        Between the IMU and ``motion``.
    apart : Lag or None
        Between logs whose times do not overlap, by the motion in both.
    """

    recording: Recording
    findings: list[Finding] = field(default_factory=list)
    checked: list[str] = field(default_factory=list)
    estimates: dict[str, Any] = field(default_factory=dict)
    curves: dict[str, FloatArray] = field(default_factory=dict)
    gravity: float = USUAL_GRAVITY
    scaling: Scaling = field(default_factory=Scaling)
    gyro_factor: float = 1.0
    rests: UnscaledRests | None = None
    imu: ImuSeries | None = None
    gnss: GnssSeries | None = None
    view: GnssView | None = None
    motion: Motion | None = None
    lag: Lag | None = None
    apart: Lag | None = None
    undetermined: list[str] = field(default_factory=list)

    @property
    def offset(self) -> float:
        """Time added to the IMU's stamps on reading. [s]"""
        options = self.recording.metadata.options
        entry = options.get("imu")
        stated = (entry if isinstance(entry, dict) else options).get("offset", 0.0)
        return float(stated) if isinstance(stated, int | float) else 0.0
