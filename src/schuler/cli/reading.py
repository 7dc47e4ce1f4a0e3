"""Options on how a log is read, checked and cut, the same in every command, and the reading itself."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from schuler.cli.output import Dashed, Flag, say
from schuler.exceptions import InputError
from schuler.files import read_toml
from schuler.recording.recording import Recording


@Parameter(name="*")
@dataclass(frozen=True)
class Hints:
    """What a log of an IMU does not say of itself.

    Parameters
    ----------
    config
        TOML file whose [recording] section says how to read the logs.
    columns
        Meaning of the columns of a plain text log, such as t,ax,ay,az,gx,gy,gz; - skips one.
    units
        Units of accelerometer and gyro, such as g,deg/s, or counts,counts; a third one is that of the time.
    axes
        Directions of the sensor's x, y, z: FRD, FLU, RFU, ...
    rate
        Sampling rate in Hz of a log without time column.
    kind
        rate or increment.
    scale
        Factors applied before the units, such as accel=0.00333,gyro=0.05, or the array that holds them.
    time
        Meaning of the stamps: gps-tow:WEEK, gps, unix, utc-unix, gps-unix, local.
    delimiter
        comma, semicolon, tab or blank; guessed if left out.
    skip
        Lines at the top to pass over.
    variable
        Array of a MATLAB or NumPy file.
    allow
        Checks to pass over with a note, such as norm,magnitude,truncated.
    streams
        Topic, message or instance for each part, such as imu=/imu/data,gnss=none; schuler info lists them.
    format
        Format of the log, where it does not show it.
    """

    config: Path | None = None
    columns: Dashed = None
    units: str | None = None
    axes: str | None = None
    rate: float | None = None
    kind: str | None = None
    scale: str | None = None
    time: str | None = None
    delimiter: str | None = None
    skip: int | None = None
    variable: str | None = None
    allow: str | None = None
    streams: str | None = None
    format: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """What was said, as ``schuler.read`` takes it."""
        return {k: v for k, v in asdict(self).items() if v is not None and k not in ("config", "start", "stop")}


@Parameter(name="*")
@dataclass(frozen=True)
class LogHints(Hints):
    """What a log of any kind does not say of itself.

    Parameters
    ----------
    height
        ellipsoidal or msl.
    geoid_separation
        Height of the geoid above the ellipsoid in metres, with --height msl.
    sigma
        1-sigma north,east,down in metres (and three of velocity) of a GNSS log without accuracies.
    origin
        Where zero of a local frame is: latitude,longitude in degrees, ellipsoidal height in metres.
    offset
        Seconds to add to the stamps.
    series
        imu, gnss, odometer, heading, height or reference, where a table leaves it open.
    """

    height: str | None = None
    geoid_separation: float | None = None
    sigma: str | None = None
    origin: str | None = None
    offset: float | None = None
    series: str | None = None


@Parameter(name="*")
@dataclass(frozen=True)
class Reading(Hints):
    """How logs are read, and what part of them.

    Parameters
    ----------
    start
        Leave out what is before this second of each log.
    stop
        Leave out what is after this second of each log.
    """

    start: Annotated[float | None, Parameter(name="--from")] = None
    stop: Annotated[float | None, Parameter(name="--to")] = None

    def read(self, log: Path, *, uncalibrated: bool = False) -> Recording:
        """The log, cut as asked for; the norm of an uncalibrated sensor's specific force is not checked in a file."""
        hints = self.given
        # our own files need no hints and take none
        if uncalibrated and not log.is_dir() and hints:
            hints["allow"] = "norm" if self.allow is None else f"{self.allow},norm"
        return cut(read_log(log, self.config, **hints), self.start, self.stop)


@Parameter(name="*")
@dataclass(frozen=True)
class Checking:
    """Checks of a log before its use.

    Parameters
    ----------
    unchecked
        Go on where the checks of units, axes, signs and clocks (schuler check) find an error; the result notes it.
    """

    unchecked: Flag = False

    def stop(self, recording: Recording) -> None:
        """Stop at what is surely wrong, without a word on the rest."""
        from schuler.diagnosis.admission import checked

        checked(recording, unchecked=self.unchecked)

    def passed(self, recording: Recording) -> Recording:
        """The recording with a note on what was checked; what is no reason to stop goes to stderr in sentences."""
        from schuler.diagnosis.admission import diagnosed

        recording, diagnosis = diagnosed(recording, unchecked=self.unchecked)
        if diagnosis is not None:
            for f in (*diagnosis.errors, *diagnosis.warnings):
                if f.code == "axes" and recording.gnss is None:
                    continue  # on a bench any side is up
                say(f"{recording.metadata.name}: {f.severity} {f.code}: {f.text}" + (f" -> {f.fix}" if f.fix else ""))
        return recording


def cut(recording: Recording, start: float | None, stop: float | None) -> Recording:
    """The recording's IMU series between two times from its start. [s]"""
    imu = recording.need_imu()
    if start is None and stop is None:
        return recording
    first, last = 0.0 if start is None else start, float(imu.t[-1] - imu.t[0]) if stop is None else stop
    if not 0.0 <= first < last:
        raise InputError(f"--from and --to: expected 0 <= FROM < TO in seconds, got {first:g} and {last:g}")
    part = imu.between(float(imu.t[0]) + first, float(imu.t[0]) + last)
    note = f"Only {first:g} to {last:g} s of {recording.metadata.name} were used, as asked for."
    return replace(recording, imu=part, metadata=recording.metadata.noting(note))


def read_log(log: Path, config: Path | None, **hints: Any) -> Recording:
    """A log with hints from options; those of a configuration's ``[recording]`` stand behind them."""
    from schuler.recording.io import read

    given = {name: value for name, value in hints.items() if value is not None}
    parts = recording_section(config)
    if not log.exists():
        raise InputError(f"{log}: no such file or folder")
    if log.is_dir():
        from schuler.recording.formats import registry

        if given and ("format" in given or registry.find_folder(log) is not None):
            return read(log, **given)
        if given:
            raise InputError(f"{log} is a folder: say how its files are read in the [recording] section of a --config")
        return read(log, **parts)
    if parts and not all(isinstance(v, dict) for v in parts.values()):
        given = {**parts, **given}
    return read(log, **given)


def recording_section(config: Path | None) -> dict[str, Any]:
    """The ``[recording]`` section of a configuration, empty if there is none."""
    if config is None:
        return {}
    section: dict[str, Any] = read_toml(config).get("recording", {})
    return section
