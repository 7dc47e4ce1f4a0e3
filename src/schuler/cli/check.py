"""``schuler check``."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from schuler.cli.output import Flag, say
from schuler.exceptions import ConfigError, InputError


def check(
    log: Path,
    /,
    *,
    config: Path | None = None,
    columns: str | None = None,
    units: str | None = None,
    axes: str | None = None,
    rate: float | None = None,
    kind: str | None = None,
    scale: str | None = None,
    time: str | None = None,
    height: str | None = None,
    geoid_separation: float | None = None,
    sigma: str | None = None,
    delimiter: str | None = None,
    skip: int | None = None,
    variable: str | None = None,
    offset: float | None = None,
    series: str | None = None,
    streams: str | None = None,
    format: str | None = None,
    imu: str | None = None,
    gnss: str | None = None,
    report: Path | None = None,
    json: Flag = False,
) -> int:
    """Find what is wrong with a log by physics, with the option that mends it: units, axes, signs, clocks, positions.

    Ends with code 2 if there is an error, so that scripts can stop.

    Parameters
    ----------
    log
        File or folder. Options say how it is to be read, right or wrong: that is what is checked.
    config
        TOML file whose [recording] section says how to read it.
    columns
        Meaning of the columns of a plain text log.
    units
        Units of accelerometer and gyro, such as g,deg/s.
    axes
        Directions of the sensor's x, y, z: FRD, FLU, RFU, ...
    rate
        Sampling rate in Hz of a log without time column.
    kind
        rate or increment.
    scale
        Factors applied before the units, such as accel=0.00333,gyro=0.05.
    time
        Meaning of the stamps: gps-tow:WEEK, gps, unix, local.
    height
        ellipsoidal or msl.
    geoid_separation
        Height of the geoid above the ellipsoid in metres, with --height msl.
    sigma
        1-sigma north,east,down in metres of a GNSS log without accuracies.
    delimiter
        comma, semicolon, tab or blank.
    skip
        Lines at the top to pass over.
    variable
        Array of a MATLAB or NumPy file.
    offset
        Seconds to add to the stamps.
    series
        imu, gnss, odometer, heading, height or reference, where a table leaves it open.
    streams
        Topic, message or instance for each part, such as imu=/imu/data,gnss=none.
    format
        Format of the log, where it does not show it.
    imu, gnss
        Files of a folder, if no configuration says so; the other options are those of the IMU's file.
    report
        HTML page with pictures.
    json
        Print one JSON object instead of text.
    """
    from schuler.diagnosis import diagnose_log

    given: dict[str, Any] = {
        "columns": columns, "units": units, "axes": axes, "rate": rate, "kind": kind, "scale": scale, "time": time,
        "height": height, "geoid_separation": geoid_separation, "sigma": sigma, "delimiter": delimiter, "skip": skip,
        "variable": variable, "offset": offset, "series": series, "streams": streams, "format": format,
    }  # fmt: skip
    given = {name: value for name, value in given.items() if value is not None}
    parts = _section(config)
    if not log.exists():
        raise InputError(f"{log}: no such file or folder")
    if log.is_dir():
        if imu is not None or gnss is not None:
            of_gnss = {n: given.pop(n) for n in ("height", "geoid_separation", "sigma") if n in given}
            if imu is not None:
                parts["imu"] = {"file": imu, **given}
            if gnss is not None:
                parts["gnss"] = {"file": gnss, **of_gnss}
        elif given and "format" not in given:
            raise InputError(
                f"{log} is a folder: say --imu FILE and --gnss FILE, or how its files are read in the "
                f"[recording] section of "
                "a --config"
            )
        else:
            parts = {**parts, **given}
    elif parts and not all(isinstance(v, dict) for v in parts.values()):
        parts = {**parts, **given}
    else:
        parts = given
    found = diagnose_log(log, **parts)
    print(found.to_json() if json else found.summary())
    if report is not None:
        say(str(found.report(report)))
    return 0 if found.ok else 2


def _section(config: Path | None) -> dict[str, Any]:
    if config is None:
        return {}
    try:
        section: dict[str, Any] = tomllib.loads(config.read_text(encoding="utf-8")).get("recording", {})
    except FileNotFoundError:
        raise ConfigError(f"{config}: no such configuration file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{config}: not a TOML file: {error}") from None
    return section
