"""What a diagnosis may find, and one such thing with its evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Severity: TypeAlias = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

#: Every code, in the order of a summary, and what it means. An error makes results garbage; a warning makes them worse
#: or needs an option; a note is worth knowing.
CODES = {
    "unreadable": "the file could not be read, even leniently",
    "refused": "the reader refuses the log as it stands; the rest was found with its checks lifted",
    "accel_unit": "specific force in another unit than stated, or counts",
    "accel_scale": "specific force at rest is off by a few per cent",
    "no_gravity": "the log holds linear acceleration, gravity was taken out",
    "gyro_unit": "angular rate in another unit than stated, or counts",
    "kind": "increments taken for rates, or rates for increments",
    "gravity_sign": "the accelerometer shows gravity, not specific force",
    "gyro_sign": "the gyroscope turns the other way",
    "handedness": "left-handed axes: two exchanged or one reversed",
    "accel_axes": "accelerometer axes other than those of the gyroscope",
    "gyro_axes": "gyroscope axes other than those of the accelerometer",
    "axes": "the sensor's axes are not forward, right, down",
    "clock_unknown": "nothing relates the clocks of the files",
    "no_overlap": "IMU and GNSS times have nothing in common",
    "leap_seconds": "IMU and GNSS are the leap seconds apart: UTC taken for GPS time or the reverse",
    "time_offset": "the IMU's clock is early or late",
    "time_unit": "time stamps in another unit than stated",
    "clock_drift": "the IMU's clock runs at another rate",
    "position_unit": "latitude and longitude in another unit than stated",
    "position_order": "latitude and longitude exchanged",
    "longitude_sign": "longitude or east velocity with the wrong sign",
    "latitude_sign": "latitude or north velocity with the wrong sign",
    "velocity_axes": "velocity east-north-up (or other axes) taken for north-east-down",
    "vertical_sign": "vertical velocity up taken for down",
    "velocity_unit": "velocity in another unit than stated",
    "velocity_wrong": "velocity does not belong to the positions",
    "height_level": "heights above sea level taken for ellipsoidal, or not stated",
    "height_unit": "heights in another unit than stated",
    "gaps": "samples are missing",
    "jitter": "time stamps jitter",
    "duplicates": "samples repeat the time of the one before",
    "backward_times": "time stamps go back",
    "missing": "values are not numbers",
    "resampled": "the log was interpolated to its rate",
    "repeated": "samples are held: the log is faster than the sensor",
    "saturated": "readings at the end of the range",
    "stuck": "readings that stopped changing",
    "quantised": "noise lost in rounding",
    "spikes": "single samples far off",
    "imu_noise": "more noise at rest than any IMU in use",
    "dead_axis": "an axis that shows nothing",
    "gnss_gaps": "GNSS outages",
    "gnss_repeated": "GNSS positions held while moving",
    "gnss_jumps": "GNSS positions that jump",
    "gnss_noise": "GNSS positions noisier than their accuracies: noise was added, or accuracies are too good",
    "gnss_smoothed": "GNSS solution that was filtered or smoothed",
    "gnss_fused": "GNSS solution that holds inertial data already",
    "gnss_delay": "GNSS velocity late against GNSS positions",
    "mount": "mount angles, estimated",
    "lever_arm": "lever arm to the antenna, estimated",
    "unchecked": "something that could not be checked with this log",
}


def number_of(count: int, what: str) -> str:
    """``1 gap``, ``2 gaps``.

    Parameters
    ----------
    count : int
    what : str
        In the singular.
    """
    return f"{int(count)} {what}{'s' * (int(count) != 1)}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a log, on what evidence, and what to do.

    Attributes
    ----------
    code : str
        One of :data:`CODES`.
    severity : {"error", "warning", "note"}
        With an error results are garbage.
    text : str
        One sentence: what was seen and what it means.
    confidence : float
        Probability that this is the cause, as judged from the evidence. [0..1]
    fix : str
        The option of the reader that mends it, as in ``units='g,deg/s'``; empty if there is none.
    evidence : dict
        Numbers behind the sentence, units in their names.
    part : str
        Series it is about: imu, gnss, ...
    """

    code: str
    severity: Severity
    text: str
    confidence: float = 1.0
    fix: str = ""
    evidence: dict[str, Any] = field(default_factory=dict)
    part: str = "imu"

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "code": self.code,
            "severity": self.severity,
            "part": self.part,
            "text": self.text,
            "confidence": round(self.confidence, 3),
            "fix": self.fix,
            "evidence": self.evidence,
        }
