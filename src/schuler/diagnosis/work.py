"""What is found on the way through a diagnosis, for the checks that come after."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from schuler.arrays import FloatArray
from schuler.diagnosis.accel_unit import Scaling
from schuler.diagnosis.findings import Finding
from schuler.diagnosis.lag import Lag
from schuler.diagnosis.motion import Motion, WindowMeans
from schuler.diagnosis.positions import GnssView
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.standstill.unscaled import UnscaledRests

USUAL_GRAVITY = 9.806  # where nothing is known of the place [m/s^2]
VEHICLE = 0.4  # share of accelerations that the path explains, of a body that goes where it points


@dataclass
class Work:
    """What is found on the way."""

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
    means: WindowMeans | None = None
    apart: Lag | None = None
    untold: list[str] = field(default_factory=list)

    @property
    def offset(self) -> float:
        """What was added to the IMU's stamps on reading. [s]"""
        options = self.recording.metadata.options
        entry = options.get("imu")
        given = (entry if isinstance(entry, dict) else options).get("offset", 0.0)
        return float(given) if isinstance(given, int | float) else 0.0
