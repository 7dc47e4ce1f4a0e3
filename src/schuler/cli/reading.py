"""Options on how a log is read, checked and cut, the same in every command, and the reading itself."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from schuler.cli.output import Dashed, Flag, say
from schuler.exceptions import InputError
from schuler.files import check_log, read_toml
from schuler.recording.part import cut
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
    bad_lines
        Largest share of garbled, empty, repeated or late lines of a text log, which are left out or sorted in and
        counted, such as 0.01.
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
    bad_lines: float | None = None
    allow: str | None = None
    streams: str | None = None
    format: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """What was said, as ``schuler.read`` takes it."""
        return {k: v for k, v in asdict(self).items() if v is not None and k not in ("config", "start", "stop")}


@Parameter(name="*")
@dataclass(frozen=True)
class Part:
    """Part of each log.

    Parameters
    ----------
    start
        Leave out what is before this second of each log.
    stop
        Leave out what is after this second of each log.
    """

    start: Annotated[float | None, Parameter(name="--from")] = None
    stop: Annotated[float | None, Parameter(name="--to")] = None

    def of(self, recording: Recording) -> Recording:
        """The recording, cut as asked for."""
        return cut(recording, self.start, self.stop)


@Parameter(name="*")
@dataclass(frozen=True)
class Reading(Part, Hints):
    """How logs are read, and what part of them."""

    def read(self, log: Path, *, uncalibrated: bool = False, proposing: bool = True) -> Recording:
        """The log, cut as asked for; the norm of an uncalibrated sensor's specific force is not checked in a file.

        Hints that it needs and that are not given are proposed, unless it still grows: its motion is still to come.
        """
        if uncalibrated:
            self = of_part(self, log)
        hints = self.given
        # our own files need no hints and take none
        if uncalibrated and not log.is_dir() and hints:
            hints["allow"] = ",".join([*([hints["allow"]] if hints.get("allow") else []), "norm"])
        try:
            recording = read_log(log, self.config, **hints)
        except InputError:
            from schuler.cli.proposal import proposed_hints
            from schuler.recording.io import read

            decisions: list[str] = []
            asked = self.config is None and proposing
            proposal = proposed_hints(log, self.given, decisions.append) if asked else None
            if proposal is None:
                raise
            if uncalibrated and not log.is_dir():
                proposal["allow"] = ",".join(filter(None, (proposal.get("allow"), "norm")))
            recording = read(log, **{**hints, **proposal})  # where this fails it says what is missing, and only that
            for decision in decisions:
                say(decision)
        return cut(recording, self.start, self.stop)


@Parameter(name="*")
@dataclass(frozen=True)
class LogHints(Reading):
    """How a log of any kind is read, and what part of it.

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
        from schuler.diagnosis.result import as_options

        recording, diagnosis = diagnosed(recording, unchecked=self.unchecked)
        if diagnosis is not None:
            for f in (*diagnosis.errors, *diagnosis.warnings):
                if f.code == "axes" and recording.gnss is None:
                    continue  # on a bench any side is up
                text = f"{recording.metadata.name}: {f.severity} {f.code}: {f.text}"
                say(as_options(text + (f" -> {f.fix}" if f.fix else "")), f.severity)
        return recording


def of_part(reading: Reading, log: Path) -> Reading:
    """Options of a log whose columns are one triad, or one axis, alone: what it does not have is not missed."""
    names = _columns(log, reading.columns)
    if reading.columns is None and reading.config is None and {"x", "y", "z"} <= names:
        from schuler.proposal.halves import sensor_alone

        if (alone := sensor_alone(log)) is not None:
            hints, why = alone
            say(f"{log.name}: {' '.join(f'--{name} {value}' for name, value in hints.items())}: {why}")
            reading = replace(reading, columns=hints["columns"], units=reading.units or hints.get("units"))
            names = _columns(log, reading.columns)
    of_triad = {t: names & {t, *(letter + a for a in "xyz")} for t, letter in (("accel", "a"), ("gyro", "g"))}
    held = [t for t, its_axes in of_triad.items() if its_axes]
    if len(held) != 1 or "*" in names:
        return reading
    allow = [f"no-{'gyro' if held[0] == 'accel' else 'accel'}"]
    if held[0] not in names and len(of_triad[held[0]]) < 3:
        allow.append("one-axis")
    units = reading.units
    if units is not None and "=" not in units and "," not in units:
        units = f"{held[0]}={units}"
    given = [] if reading.allow is None else reading.allow.split(",")
    return replace(reading, units=units, allow=",".join([*given, *(a for a in allow if a not in given)]))


def _columns(log: Path, stated: str | None) -> set[str]:
    """Names of the columns of a text log, as stated or in its first line; empty if neither has any."""
    if stated is None:
        if log.suffix.lower() not in (".csv", ".txt", ".dat") or not log.is_file():
            return set()
        with log.open("rb") as stream:
            stated = stream.read(4096).decode("latin-1").lstrip("\ufeff# \t").partition("\n")[0]
        stated = re.sub(r"[;\t ]+", ",", stated)
    names = (column.partition("=")[0].strip().strip('"').lower() for column in stated.split(","))
    return {name.removeprefix("-") for name in names}


def read_log(log: Path, config: Path | None, **hints: Any) -> Recording:
    """A log with hints from options; those of a configuration's ``[recording]`` stand behind them."""
    from schuler.recording.io import read

    given = {name: value for name, value in hints.items() if value is not None}
    parts = recording_section(config)
    check_log(log)
    if (walk := foot_log(log, given)) is not None:
        return walk
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


def is_trial(log: Path, given: dict[str, Any]) -> bool:
    """Whether a log is a PyShoe trial and no option describes it as something else."""
    from schuler.recording.formats.pyshoe import is_pyshoe

    return log.suffix.lower() == ".mat" and not given.keys() - {"variable"} and is_pyshoe(log)


def foot_log(log: Path, given: dict[str, Any]) -> Recording | None:
    """A log in a form that only data sets of walks have: a PyShoe trial or an OpenShoe log; None of others."""
    from schuler.recording.formats.openshoe import read_microstrain_text, read_openshoe_mat
    from schuler.recording.formats.pyshoe import read_pyshoe

    if is_trial(log, given):
        return read_pyshoe(log).recording
    if log.suffix.lower() == ".mat" and "rate" in given and not given.keys() - {"rate", "variable"}:
        return read_openshoe_mat(log, rate_hz=given["rate"], variable=given.get("variable", "u"))
    if (log / "data_inert.txt").is_file() or log.name == "data_inert.txt":
        return read_microstrain_text(log, rate_hz=given.get("rate", 250.0))
    return None


def recording_section(config: Path | None) -> dict[str, Any]:
    """The ``[recording]`` section of a configuration, empty if there is none."""
    if config is None:
        return {}
    section: dict[str, Any] = read_toml(config).get("recording", {})
    return section
