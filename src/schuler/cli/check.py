"""``schuler check``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.cli.output import File, Flag, say
from schuler.cli.proposal import recognised_files
from schuler.cli.reading import LogHints, foot_log, recording_section
from schuler.exceptions import InputError
from schuler.files import check_log
from schuler.recording.part import cut

if TYPE_CHECKING:
    from schuler.diagnosis.result import Diagnosis

_HINTS = LogHints()


def check(
    log: Path,
    /,
    *,
    imu: str | None = None,
    gnss: str | None = None,
    report: File = None,
    write: File = None,
    json: Flag = False,
    hints: LogHints = _HINTS,
) -> int:
    """Find what is wrong with a log by physics, with the option that mends it: units, axes, signs, clocks, positions.

    Ends with code 2 if there is an error, so that scripts can stop.

    Parameters
    ----------
    log
        File or folder. Options say how it is to be read, right or wrong: that is what is checked.
    imu
        The IMU's file in a folder, if no configuration says so; options say how it is to be read.
    gnss
        The file of GNSS solutions in a folder, if no configuration says so.
    report
        HTML page with pictures.
    write
        TOML file that gets the cures of what is all but certain, as entries of its [recording] section; the rest of
        it stays.
    json
        Print one JSON object instead of text.
    """
    from schuler.recording.formats import registry

    given, parts = hints.given, recording_section(hints.config)
    check_log(log)
    if log.is_dir():
        if imu is not None or gnss is not None:
            of_gnss = {n: given.pop(n) for n in ("height", "geoid_separation", "sigma", "origin") if n in given}
            if imu is not None:
                parts["imu"] = {"file": imu, **given}
            if gnss is not None:
                parts["gnss"] = {"file": gnss, **of_gnss}
        elif given and "format" not in given and registry.find_folder(log) is None:
            raise InputError(
                f"{log} is a folder: say --imu FILE and --gnss FILE, or how its files are read in the [recording] "
                "section of a --config"
            )
        else:
            parts = {**parts, **given}
    elif parts and not all(isinstance(v, dict) for v in parts.values()):
        parts = {**parts, **given}
    else:
        parts = given
    if not parts:
        parts = recognised_files(log)
    diagnosis = _diagnosed(log, parts, hints)
    print(diagnosis.to_json() if json else diagnosis.summary(command=not log.is_dir(), folder=log.is_dir()))
    if report is not None:
        say(str(diagnosis.report(report)))
    if write is not None:
        return _write_cures(write, log, parts)
    return 0 if diagnosis.ok else 2


def _write_cures(target: Path, log: Path, parts: dict[str, Any]) -> int:
    """Put cures into a configuration; the exit code is 2 where an error has none."""
    from schuler.files import write_text
    from schuler.proposal import propose_reading
    from schuler.proposal.toml import toml_of
    from schuler.toml import merged, toml_with

    entries, decisions = propose_reading(log, parts)
    remarks = {d.entry: d.evidence for d in decisions}
    if target.exists():
        text = target.read_text(encoding="utf-8")
        write_text(target, toml_with(text, {"recording": entries}, remarks), at_once=True)
    else:
        write_text(target, toml_of(merged({}, {"recording": entries}), remarks))
    for d in decisions:
        say(f"{d.entry} = {d.value}: {d.evidence}")
    say(f"configuration: {target}")
    return 0


def _diagnosed(log: Path, parts: dict[str, Any], hints: LogHints) -> Diagnosis:
    """Diagnosis of a log, or of the part of it that was asked for."""
    from schuler.diagnosis import diagnose, diagnose_log
    from schuler.diagnosis.log import read_leniently

    walk = foot_log(log, parts)
    if walk is None and hints.start is None and hints.stop is None:
        return diagnose_log(log, **parts)
    recording, alone, findings = (walk, None, []) if walk is not None else read_leniently(log, **parts)
    if recording is None or alone is not None:
        return diagnose_log(log, **parts)  # says why it cannot be read as one, of which there is no part
    return diagnose(cut(recording, hints.start, hints.stop), findings=tuple(findings))
