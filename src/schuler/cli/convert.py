"""``schuler convert``, and how every command reads a log."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.cli.output import Flag, print_json, say
from schuler.exceptions import ConfigError, InputError
from schuler.gnss.signals import satellite_name
from schuler.recording.recording import TIMED, Recording


def read_log(log: Path, config: Path | None, **hints: Any) -> Recording:
    """A log with hints from options; those of a configuration's ``[recording]`` stand behind them."""
    from schuler.recording.io import read

    given = {name: value for name, value in hints.items() if value is not None}
    parts: dict[str, Any] = {}
    if config is not None:
        try:
            parts = tomllib.loads(config.read_text(encoding="utf-8")).get("recording", {})
        except FileNotFoundError:
            raise ConfigError(f"{config}: no such configuration file") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{config}: not a TOML file: {error}") from None
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


def convert(
    log: Path,
    out: Path,
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
    series: str | None = None,
    allow: str | None = None,
    streams: str | None = None,
    origin: str | None = None,
    format: str | None = None,
    to: str | None = None,
    json: Flag = False,
) -> None:
    """Convert a readable log to another format, in SI and forward-right-down.

    Parameters
    ----------
    log
        File or folder: plain text, Parquet, RTKLIB .pos, RINEX, u-blox .ubx, NMEA, MATLAB .mat, NumPy .npy and .npz,
        and the formats that schuler info --formats lists.
    out
        What to write; the suffix names the format: .parquet, .csv, .pos, .kml, .geojson, .mcap, ...
    config
        TOML file whose [recording] section says how to read it.
    columns
        Meaning of the columns, such as t,ax,ay,az,gx,gy,gz; - skips one.
    units
        Units of accelerometer and gyro, such as g,deg/s; a third one is that of the time.
    axes
        Directions of the sensor's x, y, z: FRD, FLU, RFU, ...
    rate
        Sampling rate in Hz of a log without time column.
    kind
        rate or increment.
    scale
        Factors applied before the units, such as accel=0.00333,gyro=0.05.
    time
        Meaning of the stamps: gps-tow:WEEK, gps, unix, utc-unix, gps-unix, local.
    height
        ellipsoidal or msl.
    geoid_separation
        Height of the geoid above the ellipsoid in metres, with --height msl.
    sigma
        1-sigma north,east,down in metres (and three of velocity) of a GNSS log without accuracies.
    delimiter
        comma, semicolon, tab or blank; guessed if left out.
    skip
        Lines at the top to pass over.
    variable
        Array of a MATLAB or NumPy file.
    series
        imu, gnss, odometer, heading, height or reference, where a table leaves it open.
    allow
        Checks to pass over with a note, such as norm,magnitude.
    streams
        Topic, message or instance for each part, such as imu=/imu/data,gnss=none; schuler info lists them.
    origin
        Where zero of a local frame is: latitude,longitude in degrees, ellipsoidal height in metres.
    format
        Format of the log, where it does not show it.
    to
        Format to write, where the suffix does not tell.
    json
        Print one JSON object.
    """
    from schuler.recording.io import write
    from schuler.recording.io.dispatch import left_out

    recording = read_log(
        log, config, columns=columns, units=units, axes=axes, rate=rate, kind=kind, scale=scale, time=time,
        height=height, geoid_separation=geoid_separation, sigma=sigma, delimiter=delimiter, skip=skip,
        variable=variable, series=series, allow=allow, streams=streams, origin=origin, format=format,
    )  # fmt: skip
    written = write(recording, out, format=to)
    missing = left_out(recording, out, to)
    if json:
        print_json(
            {**described(recording), "files": {"written": written}, "left_out": missing.split(", ") if missing else []}
        )
    else:
        say(recording.summary())
        if missing:
            say(f"not in {out.name}, whose format does not hold them: {missing}")
        print("\n".join(str(path) for path in written))


def described(recording: Recording) -> dict[str, Any]:
    """What is in a recording, for JSON."""
    timed = any(getattr(recording, name) is not None for name in TIMED)
    data: dict[str, Any] = {
        "name": recording.metadata.name,
        "start_s": recording.start if timed else None,
        "stop_s": recording.stop if timed else None,
        "time": recording.metadata.time.describe(),
        "notes": recording.metadata.notes,
        "sources": recording.metadata.sources,
    }
    if recording.imu is not None:
        imu, gaps = recording.imu, recording.imu.gaps()
        rates = imu.rates()
        data["imu"] = {
            "samples": len(imu),
            "rate_hz": imu.rate_hz,
            "kind": imu.kind,
            "median_specific_force_m_s2": float(np.median(np.linalg.norm(rates.accel, axis=1))),
            "max_rate_deg_s": float(np.linalg.norm(rates.gyro, axis=1).max() / units.DEG),
            "gaps": len(gaps),
            "longest_gap_s": float(gaps[:, 1].max()) if len(gaps) else 0.0,
        }
    if recording.gnss is not None:
        sigma = np.sqrt(np.einsum("nii->ni", recording.gnss.cov_r_n))
        data["gnss"] = {
            "epochs": len(recording.gnss),
            "velocity": recording.gnss.v_n is not None,
            "median_sigma_horizontal_m": float(np.median(np.hypot(sigma[:, 0], sigma[:, 1]))),
            "median_sigma_vertical_m": float(np.median(sigma[:, 2])),
        }
    if recording.odometer is not None:
        data["odometer"] = {"samples": len(recording.odometer)}
    for name in ("heading", "height"):
        if (series := getattr(recording, name)) is not None:
            data[name] = {"samples": len(series)}
    if (observed := recording.observations) is not None:
        data["observations"] = {
            "epochs": len(observed.epochs),
            "samples": len(observed),
            "satellites": [satellite_name(int(sat)) for sat in np.unique(observed.sat)],
            "signals": observed.signals,
        }
    if (broadcast := recording.ephemerides) is not None:
        data["ephemerides"] = {
            "kepler": len(broadcast.kepler),
            "glonass": len(broadcast.glonass),
            "satellites": [satellite_name(int(s)) for s in np.unique((*broadcast.kepler.sat, *broadcast.glonass.sat))],
            "klobuchar": broadcast.klobuchar_alpha is not None and broadcast.klobuchar_beta is not None,
        }
    if recording.ranges is not None:
        data["ranges"] = {"samples": len(recording.ranges), "used": int(recording.ranges.used.sum())}
    if recording.reference is not None:
        data["reference"] = {"samples": len(recording.reference), "attitude": recording.reference.q_eb is not None}
    return data
