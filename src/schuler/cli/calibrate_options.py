"""Options that all methods of ``schuler calibrate`` have, and what they read besides logs: rests, sections, numbers."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts import Parameter

from schuler import units as u
from schuler.cli.output import File, Flag, Folder, progress, writable
from schuler.cli.reading import Checking, Reading
from schuler.exceptions import InputError
from schuler.files import note_input
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from schuler.calibration.bench.counts import Triad
    from schuler.calibration.bench.poses import Poses
    from schuler.sensors.spec import ImuSpec

_READING, _CHECKING = Reading(), Checking()


@Parameter(name="*")
@dataclass(frozen=True)
class Site:
    """Where the unit stands.

    Parameters
    ----------
    gravity
        Local gravity in m/s^2. Default: normal gravity at --latitude and --height, else 9.80665.
    latitude
        Degrees, for gravity and Earth rate.
    height
        Above the ellipsoid in metres, for gravity.
    field_strength
        Of the local magnetic field in microtesla, for the scale of a magnetometer in the log. Default: relative.
    """

    gravity: float | None = None
    latitude: float | None = None
    height: float = 0.0
    field_strength: float | None = None

    @property
    def field(self) -> float | None:
        """Strength of the local magnetic field. [T]"""
        if self.field_strength is not None and not 10.0 < self.field_strength < 200.0:
            raise InputError(f"--field-strength: expected microtesla, such as 48.6, got {self.field_strength:g}")
        return None if self.field_strength is None else self.field_strength * u.UT

    @property
    def lat(self) -> float | None:
        """Latitude. [rad]"""
        if self.latitude is not None and not abs(self.latitude) <= 90.0:
            raise InputError(f"--latitude: expected degrees between -90 and 90, got {self.latitude:g}")
        return None if self.latitude is None else self.latitude * u.DEG

    @property
    def g(self) -> float:
        """Local gravity. [m/s^2]"""
        if self.gravity is not None:
            if not 9.0 < self.gravity < 10.5:
                raise InputError(f"--gravity: expected local gravity in m/s^2, such as 9.81, got {self.gravity:g}")
            return self.gravity
        if self.lat is None:
            return u.G0
        from schuler.earth import gravity_somigliana

        return float(gravity_somigliana(self.lat, self.height))


@Parameter(name="*")
@dataclass(frozen=True)
class Sensor:
    """What is known of the IMU.

    Parameters
    ----------
    imu
        Budget of the IMU for weights and as data sheet: a catalogue name or the imu.toml of schuler allan.
    """

    imu: str | None = None

    @property
    def spec(self) -> ImuSpec | None:
        """The budget."""
        from schuler.sensors import catalogue
        from schuler.sensors.spec_file import read_spec

        if self.imu is None:
            return None
        return read_spec(Path(self.imu)) if self.imu.endswith(".toml") else catalogue.spec(self.imu)

    @property
    def noise(self) -> tuple[float, float] | None:
        """N of gyroscopes and accelerometers, if both are known."""
        spec = self.spec
        if spec is None or not (spec.gyro.random_walk and spec.accel.random_walk):
            return None
        return spec.gyro.random_walk, spec.accel.random_walk


@Parameter(name="*")
@dataclass(frozen=True)
class Output:
    """What is written.

    Parameters
    ----------
    out
        Folder for the files. Default: the first log's name with -calibration.
    gauge
        Body axes of the result: lower, upper, symmetric. Default: those of the method.
    previous
        An earlier calibration.yaml of the same unit: what changed beyond its uncertainty.
    serial
        Serial number of the unit; kept in calibration.yaml, as are the next three.
    operator
        Who calibrates.
    place
        Where, in words.
    date
        YYYY-MM-DD. Default: the day of the log, if its clock tells.
    certificate
        HTML file for a certificate, one or two printed pages of A4; needs --serial.
    report
        Write calibration.html and figures.
    json
        Print one JSON object instead of text.
    """

    out: Folder = None
    gauge: Literal["lower", "upper", "symmetric"] | None = None
    previous: Path | None = None
    serial: str = ""
    operator: str = ""
    place: str = ""
    date: str = ""
    certificate: File = None
    report: bool = True
    json: Flag = False

    def check(self) -> None:
        """Refuse, before the work, a date that is none, a certificate of no unit and a place that cannot be written."""
        from schuler.calibration.result.session import Session

        if self.out is None:
            writable(Path())
        Session(date=self.date)
        if self.certificate is not None and not self.serial.strip():
            raise InputError("--certificate: expected the serial number of the unit with it (--serial), got none")


@Parameter(name="*")
@dataclass(frozen=True)
class CalibrationOptions:
    """How the logs of a calibration are read and checked, where and what the unit is, and what is written."""

    reading: Reading = _READING
    checking: Checking = _CHECKING
    site: Site = Site()
    sensor: Sensor = Sensor()
    output: Output = Output()

    def recordings(self, *logs: Path, one_axis: Triad | None = None) -> list[Recording]:
        """The logs, read and checked, of an uncalibrated sensor; one axis alone if the method can use it."""
        from schuler.calibration.bench.one_axis import only_axis

        self.output.check()
        recordings = [self.reading.read(path, uncalibrated=True) for path in logs]
        partly = [
            p for p, r in zip(logs, recordings, strict=True) if "one-axis" in str(r.metadata.options.get("allow"))
        ]
        if partly and (one_axis is None or (only_axis([r.need_imu() for r in recordings]) or " ")[0] != one_axis[0]):
            raise InputError(
                f"{partly[0]}: expected all three axes of a triad; one axis gives its bias and scale factor: an "
                "accelerometer set up and down (schuler calibrate sixposition), a gyroscope turned both ways (schuler "
                "calibrate ratetable), or mean readings beside their reference: schuler calibrate poses means.csv "
                "--table-columns gx,reference --table-units m/s2,deg/s"
            )
        return [self.checking.passed(recording) for recording in recordings]

    def poses(self, recordings: Sequence[Recording], min_rest: float, intervals: Path | None = None) -> Poses:
        """Rests of all logs, one after the other."""
        from schuler.calibration.bench.poses import joined, poses_of

        poses = []
        with progress("looking for rests") as bar:
            for i, recording in enumerate(recordings):
                imu = recording.need_imu()
                spans = None if intervals is None else spans_of(intervals, imu)
                poses.append(poses_of(imu, spans, min_s=min_rest, noise=self.sensor.noise, gravity=self.site.g))
                if bar is not None:
                    bar((i + 1) / len(recordings))
        return joined(poses)


def spans_of(path: Path, imu: ImuSeries) -> list[tuple[float, float]]:
    """Rests of a CSV file with lines START,STOP in seconds from the start of the log, in the time of the log."""
    return [(start, stop) for _, start, stop in _table(path, imu, named=False)]


def sections_of(path: Path, imu: ImuSeries) -> dict[str, tuple[float, float]]:
    """Named sections of a CSV file with lines NAME,START,STOP, likewise."""
    return {name: (start, stop) for name, start, stop in _table(path, imu, named=True)}


def _table(path: Path, imu: ImuSeries, named: bool) -> list[tuple[str, float, float]]:
    """Lines of (NAME,)START,STOP in seconds from the start of the log, in the time of the log."""
    note_input(path)
    shape = "NAME,START,STOP" if named else "START,STOP"
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a CSV file with lines {shape}: {error}") from None
    rows = []
    for number, line in enumerate(lines, 1):
        if not line or line[0].startswith("#"):
            continue
        try:
            name = line[0].strip() if named else ""
            start, stop = (float(cell) for cell in line[int(named) :])
        except ValueError:
            if number == 1:
                continue  # a header
            raise InputError(f"{path}, line {number}: expected {shape} in seconds, got {','.join(line)!r}") from None
        if not 0.0 <= start < stop:
            raise InputError(f"{path}, line {number}: expected 0 <= START < STOP in seconds, got {start:g}, {stop:g}")
        rows.append((name, start + float(imu.t[0]), stop + float(imu.t[0])))
    if not rows:
        raise InputError(f"{path}: expected lines {shape}, got none")
    return rows


def numbers_of(option: str, text: str) -> list[float]:
    """Numbers with commas between them."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option}: expected numbers with commas between them, got {text!r}") from None
