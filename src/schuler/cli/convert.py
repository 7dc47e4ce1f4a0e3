"""``schuler convert``, and what is in a recording, for JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.cli.output import Flag, print_json, say, writable
from schuler.cli.reading import LogHints
from schuler.diagnosis.result import as_options
from schuler.gnss.signals import satellite_name
from schuler.recording.recording import TIMED, Recording

_HINTS = LogHints()


def convert(log: Path, out: Path, /, *, to: str | None = None, json: Flag = False, hints: LogHints = _HINTS) -> None:
    """Convert a readable log to another format, in SI and forward-right-down.

    Parameters
    ----------
    log
        File or folder: plain text, Parquet, RTKLIB .pos, RINEX, u-blox .ubx, NMEA, MATLAB .mat, NumPy .npy and .npz,
        and the formats that schuler info --formats lists.
    out
        What to write; the suffix names the format: .parquet, .csv, .pos, .kml, .geojson, .mcap, ...
    to
        Format to write, where the suffix does not tell.
    json
        Print one JSON object instead of text.
    """
    from schuler.recording.io import write
    from schuler.recording.io.dispatch import left_out

    writable(out.parent)
    recording = hints.read(log)
    written = write(recording, out, format=to)
    missing = left_out(recording, out, to)
    if json:
        print_json(
            {**described(recording), "files": {"written": written}, "left_out": missing.split(", ") if missing else []}
        )
    else:
        say(as_options(recording.summary()))
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
            **{f"median_{name.lower()}": value for name, value in recording.gnss.median_dop().items()},
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
            "precise_orbits": 0 if broadcast.precise_orbits is None else len(broadcast.precise_orbits.sat),
            "precise_clocks": 0 if broadcast.precise_clocks is None else len(broadcast.precise_clocks.sat),
            "klobuchar": broadcast.klobuchar_alpha is not None and broadcast.klobuchar_beta is not None,
        }
    if recording.ranges is not None:
        data["ranges"] = {"samples": len(recording.ranges), "used": int(recording.ranges.used.sum())}
    if recording.reference is not None:
        data["reference"] = {"samples": len(recording.reference), "attitude": recording.reference.q_eb is not None}
    return data
