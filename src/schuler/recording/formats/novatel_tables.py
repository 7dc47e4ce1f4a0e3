"""Columns of a recording from NovAtel's position, velocity, heading and inertial messages."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.recording.formats import parts
from schuler.recording.formats.novatel_frames import TYPES, Messages
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import (
    NO_VELOCITY,
    RATE_ERROR,
    Columns,
    keep_timed,
    pick,
    velocity_at,
    weeks_to_seconds,
)
from schuler.recording.io.hints import ReadHints

#: Positions that are read, in order of preference, and the velocity that belongs to each.
POSITIONS = {"BESTGNSSPOS": "BESTGNSSVEL", "BESTPOS": "BESTVEL", "RTKPOS": "BESTVEL", "PSRPOS": "PSRVEL"}
#: Types of positions and velocities that come from the receiver's inertial solution.
AIDED_BY_INS = frozenset(number for name, number in TYPES.items() if name.startswith("INS_"))
# RTKLIB's quality of a position type; every other is single
_QUALITY = {
    **dict.fromkeys((48, 49, 50, 51, 56), 1),
    **dict.fromkeys((32, 33, 34, 55), 2),
    **dict.fromkeys((18, 52), 3),
    **dict.fromkeys((17, 20, 54, 57), 4),
    **dict.fromkeys((64, 65, 68, 69, 73, 74, 77, 78, 79, 80), 6),
    19: 7,
}
_WGS84 = 61.0
_FARTHEST = 0.6  # of a velocity from its position: a latency of a quarter second, at 1 Hz [s]


def gnss_table(
    log: Messages, name: str, t: FloatArray, rows: Columns, first: float, hints: ReadHints, notes: list[str]
) -> Table:
    """GNSS series of a position message, with the velocity that belongs to it; ``first`` is the week of time zero."""
    values = {
        "t": t,
        "lat": rows["lat"] * units.DEG,
        "lon": rows["lon"] * units.DEG,
        "h": rows["msl"] + rows["undulation"],
        "sn": rows["slat"],
        "se": rows["slon"],
        "sd": rows["sh"],
        "q": np.array([_QUALITY.get(int(kind), 5) for kind in rows["type"]], dtype=np.float64),
        "ns": rows["used"],
    }
    notes.append(
        f"{name}: heights above mean sea level were made ellipsoidal with the receiver's own undulation (median "
        f"{np.median(rows['undulation']):.2f} m)."
    )
    datum = log.words.get(f"{name}.datum", "WGS84")
    if datum != "WGS84" or np.any((rows["datum"] >= 0.0) & (rows["datum"] != _WGS84)):
        notes.append(f"{name}: positions are not on WGS 84 by the receiver's own setting; they were taken as they are.")
    velocity = POSITIONS[name]
    if velocity in log.columns:
        values |= _velocity(log, velocity, t, first, hints, notes)
    notes.append(f"gnss: {name}, of the antenna.")
    return Table(values)


def _velocity(
    log: Messages, name: str, t: FloatArray, first: float, hints: ReadHints, notes: list[str]
) -> dict[str, FloatArray]:
    rows = log.columns[name]
    good = (rows["status"] == 0) & (rows["type"] > 0) & ~np.isin(rows["type"], list(AIDED_BY_INS))
    rows = keep_timed(pick(rows, good), "header_week", "header_sow", name, log.path, notes)
    if not len(rows["speed"]):
        notes.append(f"{name} has no velocity of GNSS alone.")
        return {}
    t_v = weeks_to_seconds(rows["header_week"], rows["header_sow"], first) - rows["latency"]
    later = parts.later(t_v, f"{name} without its latency", log.path, notes)
    rows, t_v = pick(rows, later), t_v[later]
    track = rows["track"] * units.DEG
    v = np.stack((rows["speed"] * np.cos(track), rows["speed"] * np.sin(track), -rows["up"]), axis=1)
    found, near = velocity_at(t, t_v, v, _FARTHEST)
    given = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else (RATE_ERROR,) * 3
    latency = float(np.median(rows["latency"]))
    notes.append(
        f"{name}: velocities come without accuracy; 1-sigma is {given[0]:g}, {given[1]:g}, {given[2]:g} m/s (hint "
        f"sigma with six numbers replaces it). Their latency (median {latency:.3g} s) was taken off, and they were "
        "interpolated to the positions (linear)."
    )
    if not near.all():
        notes.append(
            f"{name}: {int((~near).sum())} positions have no velocity near; it was set to zero with a 1-sigma of "
            f"{NO_VELOCITY:g} m/s."
        )
    sigma = np.where(near[:, None], np.array(given), NO_VELOCITY)
    made = {label: found[:, k] for k, label in enumerate(("vn", "ve", "vd"))}
    return made | {label: sigma[:, k] for k, label in enumerate(("svn", "sve", "svd"))}


def heading_table(name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Heading of two antennas."""
    notes.append(f"heading: {name}, of the line between two antennas, which need not be the body's x axis.")
    return Table({"t": t, "heading": rows["heading"] * units.DEG, "sheading": rows["sheading"] * units.DEG})


def reference_table(log: Messages, name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Reference of an inertial solution. SPAN's roll, pitch and azimuth are those of axes forward-right-down."""
    if "msl" in rows:
        height = rows["msl"] + rows["undulation"]
        notes.append(f"{name}: heights above mean sea level were made ellipsoidal with the receiver's undulation.")
    else:
        height = rows["h"]
    values = {
        "t": t,
        "lat": rows["lat"] * units.DEG,
        "lon": rows["lon"] * units.DEG,
        "h": height,
        "vn": rows["vn"],
        "ve": rows["ve"],
        "vd": -rows["vu"],
        "roll": rows["roll"] * units.DEG,
        "pitch": rows["pitch"] * units.DEG,
        "yaw": rows["azimuth"] * units.DEG,
    }
    sigma = rows if "slat" in rows else log.columns.get("INSSTDEVS", log.columns.get("INSSTDEV"))
    own = ""
    if sigma is not None:
        at = np.median(
            np.stack([sigma[f"s{axis}"] for axis in ("lat", "lon", "h", "roll", "pitch", "azimuth")]), axis=1
        )
        own = (
            f" By its own account it is good to {np.hypot(at[0], at[1]):.3g} m horizontally, {at[2]:.3g} m vertically, "
            f"{at[3]:.3g}, {at[4]:.3g}, {at[5]:.3g} deg in roll, pitch, azimuth (medians)."
        )
    notes.append(
        f"reference: {name}, the receiver's own inertial solution, made of the same sensors: to compare with, not a "
        f"truth; at the IMU, or where SETINSTRANSLATION USER put it.{own}"
    )
    return Table(values)
