"""Columns of a recording from VectorNav's IMU, GNSS and INS outputs."""

from __future__ import annotations

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import RATE_ERROR, Columns
from schuler.recording.io.hints import ReadHints

#: Outputs of the IMU in order of preference, and what their columns' names start with.
TRIADS = {"uncompensated": "raw", "compensated": "comp"}
KINDS = ("uncompensated", "delta", "compensated")
# RTKLIB's quality of a fix: two- and three-dimensional, SBAS, float and fixed
QUALITY = {2: 5, 3: 5, 4: 3, 7: 2, 8: 1}
_TWO_D = 2
_ASSUMED_HEIGHT = 100.0  # 1-sigma of the height of a two-dimensional fix, which is held, not measured [m]


def imu_kind(rows: Columns, wanted: str) -> str | None:
    """Which IMU outputs packets hold, the wanted or the first of the order of preference; ``None`` for none."""
    for kind in KINDS if not wanted else (wanted,):
        prefix = TRIADS.get(kind)
        names: tuple[str, ...] = ("dt", "dthx", "dthy", "dthz", "dvx", "dvy", "dvz")
        if prefix is not None:
            names = tuple(f"{prefix}_{letter}{axis}" for letter in "ag" for axis in "xyz")
        if all(name in rows for name in names):
            return kind
    return None


def imu_table(t: FloatArray, rows: Columns, wanted: str, notes: list[str]) -> Table:
    """IMU series of the wanted outputs, or of the preferred ones that are there."""
    kind = imu_kind(rows, wanted)
    values = {"t": t}
    if kind == "delta":
        values |= {f"a{axis}": rows[f"dv{axis}"] for axis in "xyz"}
        values |= {f"g{axis}": rows[f"dth{axis}"] * units.DEG for axis in "xyz"}
        notes.append("imu: increments of angle and velocity over the interval before each packet.")
    else:
        prefix = TRIADS[kind or ""]
        values |= {f"{letter}{axis}": rows[f"{prefix}_{letter}{axis}"] for letter in "ag" for axis in "xyz"}
        notes.append(
            "imu: uncompensated outputs (with the factory's calibration, without the sensor's own bias estimates)."
            if kind == "uncompensated"
            else "imu: compensated outputs: the sensor's filter has taken its bias estimates off, which changes over "
            "the log; log UncompAccel and UncompGyro for navigation of your own."
        )
    if "temp" in rows:
        values["temp"] = rows["temp"]
    return Table(values, kind="increment" if kind == "delta" else "rate")


def gnss_table(t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table:
    """GNSS series of the sensor's fixes."""
    values = {
        "t": t,
        "lat": rows["fix_lat"] * units.DEG,
        "lon": rows["fix_lon"] * units.DEG,
        "h": rows["fix_h"],
        "q": np.array([QUALITY[int(fix)] for fix in rows["fix"]], dtype=np.float64),
    }
    if "ns" in rows:
        values["ns"] = rows["ns"]
    if "sn" in rows:
        sigma = np.stack([rows[name] for name in ("sn", "se", "sd")], axis=1)
        flat = rows["fix"] == _TWO_D
        sigma[flat, 2] = np.maximum(sigma[flat, 2], _ASSUMED_HEIGHT)
        if flat.any():
            notes.append(f"gnss: {int(flat.sum())} fixes are two-dimensional; their height got 100 m 1-sigma.")
        values |= {name: sigma[:, k] for k, name in enumerate(("sn", "se", "sd"))}
    if "fix_vn" in rows:
        values |= {f"v{axis}": rows[f"fix_v{axis}"] for axis in "ned"}
        known = rows.get("sv", np.zeros(len(t)))
        if (guess := known <= 0.0).any():
            given = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else (RATE_ERROR,) * 3
            notes.append(f"gnss: velocities of {int(guess.sum())} fixes have no accuracy; 1-sigma is {given} m/s.")
            values |= {f"sv{axis}": np.where(guess, s, known) for axis, s in zip("ned", given, strict=True)}
        else:
            values |= {f"sv{axis}": known for axis in "ned"}
    notes.append("gnss: the sensor's own receiver (antenna A); heights are ellipsoidal.")
    return Table(values)


def reference_table(t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Reference of the sensor's own solution; its quaternions have their scalar last."""
    values = {"t": t, "lat": rows["lat"] * units.DEG, "lon": rows["lon"] * units.DEG, "h": rows["h"]}
    values |= {name: rows[name] for name in ("vn", "ve", "vd")}
    if "yaw" in rows:
        values |= {name: rows[name] * units.DEG for name in ("roll", "pitch", "yaw")}
    elif "qw" in rows:
        q = np.stack([rows[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
        norm = np.linalg.norm(q, axis=1)
        bad = ~(np.abs(norm - 1.0) < 1e-2)
        q = np.where(bad[:, None], (1.0, 0.0, 0.0, 0.0), q / np.where(bad, 1.0, norm)[:, None])
        if bad.any():
            raise FileFormatError(
                f"{int(bad.sum())} attitudes are no unit quaternions; streams='reference=none' leaves them"
            )
        angles = rotation.rpy_from_quat(q)
        values |= {name: angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    own = ""
    if "spos" in rows:
        own = f" By its own account it is good to {np.median(rows['spos']):.3g} m (median)."
    notes.append(
        f"reference: the sensor's own solution, made of the same IMU and GNSS: to compare with, not a truth.{own}"
    )
    return Table(values)
