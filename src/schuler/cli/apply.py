"""``schuler apply``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from schuler.cli.calibrate_options import Site
from schuler.cli.output import File, Flag, print_json, say
from schuler.cli.reading import LogHints, read_log
from schuler.exceptions import InputError
from schuler.recording.part import cut

_HINTS, _SITE = LogHints(), Site()


def apply(
    calibration: Path,
    log: Path,
    /,
    *,
    out: Annotated[File, Parameter(required=True)],
    serial: str = "",
    to: str | None = None,
    report: bool = True,
    json: Flag = False,
    site: Site = _SITE,
    hints: LogHints = _HINTS,
) -> None:
    """Take the calibrated errors out of a log: a corrected log, and a page before and after.

    A calibration of another unit, other units or another temperature is refused, and a log that is corrected already;
    --allow serial, units, temperature, corrected passes over it.

    Parameters
    ----------
    calibration
        File of schuler calibrate.
    log
        Log of the same unit, read as the calibrated one was.
    out
        What to write; the suffix names the format: .parquet, .csv, .mat, ...
    serial
        Serial number of the unit that recorded the log.
    to
        Format to write, where the suffix does not tell.
    report
        Write the page before and after beside it.
    json
        Print one JSON object instead of text.
    """
    from schuler.calibration.result.application import ALLOWANCES, apply_calibration
    from schuler.calibration.result.result import CalibrationResult
    from schuler.files import sha256
    from schuler.recording.io import write
    from schuler.recording.io.dispatch import WRITERS, left_out

    assert out is not None  # required
    result = CalibrationResult.from_yaml(calibration)
    given = hints.given
    wanted = [a.strip() for a in (given.pop("allow", None) or "").split(",") if a.strip()]
    ours = [a for a in wanted if a in ALLOWANCES]
    checks = [a for a in wanted if a not in ALLOWANCES]
    if given and not log.is_dir():  # readings of an uncalibrated sensor need not have the norm of gravity
        checks.append("norm")
    if checks:
        given["allow"] = ",".join(checks)
    recording = cut(read_log(log, hints.config, **given), hints.start, hints.stop)
    stated = site.gravity is not None or site.latitude is not None
    try:
        applied = apply_calibration(result, recording, serial=serial, gravity=site.g if stated else None, allow=ours)
    except InputError as error:
        raise InputError(str(error).replace("nevertheless allow ", "nevertheless say --allow ")) from None
    metadata = applied.recording.metadata
    metadata = replace(metadata, sources={**metadata.sources, calibration.name: sha256(calibration)})
    applied = replace(applied, recording=replace(applied.recording, metadata=metadata))
    if "imu" in left_out(applied.recording, out, to):
        raise InputError(f"--out: expected a format that holds an IMU, such as .parquet or .csv, got {out.name}")
    written = write(applied.recording, out, format=to)
    files = {"corrected": written}
    keeps = to is None and WRITERS.get(out.suffix.lower()) in ("parquet", "csv")
    if report:
        files["report"] = [applied.report(out.with_name(f"{out.stem}-applied.html"))]
    if json:
        print_json({"command": "apply", **applied.to_dict(), "metadata_kept": keeps, "files": files})
        return
    print(applied.summary())
    if not keeps:
        say(f"{out.name}: its format has no place for what was applied; .parquet and .csv keep it")
    print("\n".join(f"{name}: {path}" for name, paths in files.items() for path in paths))
