"""Septentrio logs (SBF): the receiver's fixes with covariances, heading, the IMU of its INS, and its INS as reference.

Blocks and units: Septentrio, "SBF Reference Guide"; frames in ``sbf_blocks``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.sbf_blocks import NOT_USED, Blocks, inertial, load, looks_like, sensor
from schuler.recording.io import columns, parts
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import (
    NO_VELOCITY,
    RATE_ERROR,
    Columns,
    base_of,
    keep_timed,
    pick,
    preferred,
    same_time,
    weeks_to_seconds,
)
from schuler.recording.io.streams import Stream, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S

#: Hints that mean something here.
HINTS = {"sigma", "axes", "streams", "sigma_heading_deg"}
_PARTS = {"PVTGeodetic": "gnss", "INSNavGeod": "reference", "ExtSensorMeas": "imu", "AttEuler": "heading"}
_TYPE, _TWO_D = 0x0F, 0x80  # of a mode
# RTKLIB's quality of a mode: stand-alone, differential, fixed, float, SBAS, the same with a moving base, PPP
_QUALITY = {1: 5, 2: 4, 4: 1, 5: 2, 6: 3, 7: 1, 8: 2, 10: 6}
_ASSUMED_HEIGHT = 100.0  # 1-sigma of the height of a two-dimensional fix, which is held, not measured [m]
_ACCURACY_AT, _ACCURACY_BYTES = 90, 4  # of PVTGeodetic from revision 2 on: two numbers of 0.01 m
_UNKNOWN = 65535


def sniff(head: bytes, path: Path) -> bool:
    """Whether a whole block of SBF with a right CRC is among the first bytes."""
    return looks_like(head)


def contents(path: Path) -> list[Stream]:
    """Blocks of the log that can be read, and those of other kinds."""
    return _streams(load(path))


def _streams(log: Blocks) -> list[Stream]:
    made = []
    for name in log.places:
        rows = log.columns(name)
        t = weeks_to_seconds(rows["week"], rows["ms"] * 1e-3, rows["week"].max(initial=0.0))
        made.append(stream_of(name, "SBF", t, _PARTS.get(name, "")))
    return made + [Stream(f"block {number}", "SBF", count) for number, count in log.others.items()]


@np.errstate(invalid="ignore", over="ignore")  # what is no number is refused by the checks of parts.assemble
def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a Septentrio log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams`` leaves parts out (``"imu=none"``). ``axes`` of ExtSensorMeas, default "FLU", as Septentrio builds
        its IMU in. ``sigma`` where there are no covariances, ``sigma_heading_deg`` where there is no AttCovEuler.

    Returns
    -------
    Recording
        On GPS time from the start of the first block's week.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, or holds no fix, no IMU and no INS solution.
    """
    parts.check_hints(path, hints, HINTS, "an SBF log")
    log = load(path)
    notes, chosen, streams = list(log.notes), parse_streams(hints.streams), _streams(log)
    taken = {part: preferred(streams, part, chosen, (name,), notes) for name, part in _PARTS.items()}
    if hints.series is not None:
        taken = {part: name if part == hints.series else None for part, name in taken.items()}
    rows: dict[str, Columns] = {}
    for part, name in taken.items():
        if name is None:
            continue
        made = imu_rows(log, notes) if part == "imu" else solutions(log, part, name, notes)
        made["sow"] = made["ms"] * 1e-3
        made = keep_timed(made, "week", "sow", name, path, notes)
        if len(made["week"]):
            rows[part] = made
    tables: dict[str, Table] = {}
    first = min((float(r["week"][0]) for r in rows.values()), default=0.0)
    for part, made in rows.items():
        t = weeks_to_seconds(made["week"], made["sow"], first)
        table = {"imu": imu_table, "gnss": gnss_table, "heading": heading_table, "reference": _reference}[part](
            log, t, made, hints, notes
        )
        if table is not None:
            tables[part] = table
    if not tables:
        present = ", ".join([*log.places, *(f"block {number}" for number in log.others)]) or "none"
        raise FileFormatError(
            f"expected PVTGeodetic with a fix, ExtSensorMeas or INSNavGeod, found {present} without one: enable them, "
            "or convert to RINEX for raw measurements",
            path,
        )
    return parts.assemble(path, tables, hints, base_of(first), notes)


def _key(rows: Columns) -> IntArray:
    return (rows["week"] * (WEEK_S * 1e3) + rows["ms"]).astype(np.int64)


def _said(rows: Columns, names: tuple[str, ...]) -> BoolArray:
    """Rows in which none of the numbers is marked as not to be used. Shape (n,)."""
    return np.asarray(np.all([rows[name] > NOT_USED for name in names], axis=0))


def solutions(log: Blocks, part: str, name: str, notes: list[str]) -> Columns:
    """Rows of a block that hold a solution."""
    if part == "reference":
        rows = inertial(log)
        missing = len(log.places[name]) - len(rows["week"])
        if missing:
            notes.append(f"{name}: {missing} blocks without attitude or velocity were left out (setINSNav switches).")
        good = (rows["error"] == 0) & _said(rows, ("lat", "lon", "h", "heading", "pitch", "roll", "ve", "vn", "vu"))
    else:
        rows = log.columns(name)
        kind = rows["mode"].astype(np.int64) & _TYPE
        if part == "gnss":
            good = (rows["error"] == 0) & np.isin(kind, list(_QUALITY)) & _said(rows, ("lat", "lon", "h"))
        else:
            good = (rows["error"].astype(np.int64) & 0x0F == 0) & (rows["mode"] > 0) & _said(rows, ("heading",))
    if not good.all():
        notes.append(f"{name}: {int((~good).sum())} epochs without a solution were left out.")
    return pick(rows, good)


def imu_rows(log: Blocks, notes: list[str]) -> Columns:
    """Specific force and angular rate of ExtSensorMeas of the same times, of one sensor."""
    triads = []
    for kind, what in ((0, "specific force"), (1, "angular rate")):
        rows = sensor(log, kind)
        sources = np.unique(rows["source"])
        if len(sources) > 1:
            notes.append(f"ExtSensorMeas: {what} of {len(sources)} sensors; the first was read.")
            rows = pick(rows, rows["source"] == sources[0])
        good = _said(rows, ("x", "y", "z"))
        if not good.all():
            notes.append(f"ExtSensorMeas: {int((~good).sum())} samples of {what} not to be used were left out.")
        triads.append(pick(rows, good))
    force, rate = triads
    match = same_time(_key(force), _key(rate))
    both = match >= 0
    lone = int((~both).sum()) + len(rate["week"]) - int(both.sum())
    if lone and (len(force["week"]) or len(rate["week"])):
        notes.append(
            f"ExtSensorMeas: {lone} samples have no counterpart (force or rate) at their time and were left out."
        )
    made = pick(force, both)
    return made | {f"w{axis}": rate[axis][match[both]] for axis in "xyz"}


def imu_table(log: Blocks, t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table:
    """IMU series of samples of :func:`imu_rows` at their times."""
    notes.append(f"imu: ExtSensorMeas, sensor model {int(rows['model'][0])}; stamps are whole milliseconds.")
    values = {"t": t}
    values |= {f"a{axis}": rows[axis] for axis in "xyz"}
    values |= {f"g{axis}": rows[f"w{axis}"] * units.DEG for axis in "xyz"}
    return Table(values, axes="FLU")


def _covariance(log: Blocks, name: str, rows: Columns) -> tuple[FloatArray, FloatArray, BoolArray]:
    """1-sigma north, east, down and covariances NE, ND, ED at the times of solutions, and where they are known."""
    cov = log.columns(name)
    match = same_time(_key(rows), _key(cov))
    matched = {label: values[match] for label, values in cov.items()} if len(cov["nn"]) else None
    if matched is None:
        n = len(rows["week"])
        return np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool)
    variance = np.stack([matched[label] for label in ("nn", "ee", "uu")], axis=1)
    cross = np.stack((matched["ne"], -matched["nu"], -matched["eu"]), axis=1)
    good = (match >= 0) & (matched["error"] == 0) & np.all(variance > 0.0, axis=1) & np.all(cross > NOT_USED, axis=1)
    good &= np.all(cross < -NOT_USED, axis=1)
    return np.sqrt(np.where(good[:, None], variance, 1.0)), np.where(good[:, None], cross, 0.0), good


def gnss_table(log: Blocks, t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table | None:
    """GNSS series of PVTGeodetic, with the covariances of the same times.

    Raises
    ------
    FileFormatError
        If no epoch has an accuracy.
    """
    sigma, cross, stated_here = _covariance(log, "PosCovGeodetic", rows)
    if not stated_here.all():
        other, stated = _accuracy(log, rows, hints)
        fill = ~stated_here & stated
        sigma[fill] = other[fill]
        if fill.any():
            how = "the hint sigma" if hints.sigmas is not None else "HAccuracy and VAccuracy (2DRMS and 2-sigma)"
            notes.append(f"PVTGeodetic: {int(fill.sum())} epochs have no PosCovGeodetic; 1-sigma is from {how}.")
        stated_here = stated_here | stated
        if not stated_here.all():
            notes.append(f"PVTGeodetic: {int((~stated_here).sum())} epochs without an accuracy were left out.")
        if not stated_here.any():
            raise FileFormatError("no epoch has an accuracy: enable PosCovGeodetic, or say sigma='N,E,D' [m]", log.path)
    sigma, cross, rows, t = sigma[stated_here], cross[stated_here], pick(rows, stated_here), t[stated_here]
    mode = rows["mode"].astype(np.int64)
    if (flat := (mode & _TWO_D) > 0).any():
        sigma[flat, 2] = np.maximum(sigma[flat, 2], _ASSUMED_HEIGHT)
        cross[flat] = 0.0
        notes.append(f"PVTGeodetic: {int(flat.sum())} fixes are two-dimensional; their height got 100 m 1-sigma.")
    values = {
        "t": t,
        "lat": rows["lat"],
        "lon": rows["lon"],
        "h": rows["h"],
        "q": np.array([_QUALITY[int(kind)] for kind in mode & _TYPE], dtype=np.float64),
        "ns": np.where(rows["satellites"] < 255.0, rows["satellites"], 0.0),
    }
    values |= {name: sigma[:, k] for k, name in enumerate(("sn", "se", "sd"))}
    values |= {name: cross[:, k] for k, name in enumerate(("cne", "cnd", "ced"))}
    dop = log.columns("DOP")
    if len(dop["week"]):
        match = same_time(_key(rows), _key(dop))
        values |= {name: np.where(match >= 0, 0.01 * dop[name][match], np.nan) for name in columns.DILUTION}
    notes.append("gnss: PVTGeodetic, of the antenna or marker the receiver is set to; heights are ellipsoidal.")
    return Table(values | _velocity(log, rows, hints, notes))


def _accuracy(log: Blocks, rows: Columns, hints: ReadHints) -> tuple[FloatArray, BoolArray]:
    """1-sigma north, east, down of a hint or of PVTGeodetic itself, and where there is one."""
    n = len(rows["week"])
    if hints.sigmas is not None:
        return np.tile(np.array(hints.sigmas[:3]), (n, 1)), np.ones(n, dtype=bool)
    at = rows["at"].astype(np.int64) + _ACCURACY_AT
    long = at + _ACCURACY_BYTES <= rows["stop"]
    raw = log.data[np.where(long, at, 0)[:, None] + np.arange(_ACCURACY_BYTES)].view("<u2").astype(np.float64)
    good = long & np.all((raw > 0) & (raw < _UNKNOWN), axis=1)
    horizontal, vertical = raw[:, 0] * 0.01 / 2.0 / np.sqrt(2.0), raw[:, 1] * 0.01 / 2.0
    return np.stack((horizontal, horizontal, vertical), axis=1), good


def _velocity(log: Blocks, rows: Columns, hints: ReadHints, notes: list[str]) -> dict[str, FloatArray]:
    present = _said(rows, ("vn", "ve", "vu"))
    if not present.any():
        return {}
    sigma, cross, with_covariance = _covariance(log, "VelCovGeodetic", rows)
    if (guess := present & ~with_covariance).any():
        given = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else (RATE_ERROR,) * 3
        sigma[guess] = given
        notes.append(
            f"PVTGeodetic: velocities of {int(guess.sum())} epochs have no VelCovGeodetic; 1-sigma is {given[0]:g}, "
            f"{given[1]:g}, {given[2]:g} m/s (hint sigma with six numbers replaces it)."
        )
    if not present.all():
        sigma[~present], cross[~present] = NO_VELOCITY, 0.0
        notes.append(
            f"PVTGeodetic: {int((~present).sum())} epochs have no velocity; it was set to zero with a 1-sigma of "
            f"{NO_VELOCITY:g} m/s."
        )
    v = np.where(present[:, None], np.stack((rows["vn"], rows["ve"], -rows["vu"]), axis=1), 0.0)
    values = {name: v[:, k] for k, name in enumerate(("vn", "ve", "vd"))}
    values |= {name: sigma[:, k] for k, name in enumerate(("svn", "sve", "svd"))}
    return values | {name: cross[:, k] for k, name in enumerate(("cvne", "cvnd", "cved"))}


def heading_table(log: Blocks, t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table | None:
    """Heading of the receiver's antennas; ``None`` without an accuracy."""
    cov = log.columns("AttCovEuler")
    values = {"t": t, "heading": rows["heading"] * units.DEG}
    match = same_time(_key(rows), _key(cov))
    variance = cov["heading"][match] if len(cov["heading"]) else np.zeros(len(t))
    good = (match >= 0) & (variance > 0.0)
    if good.any():
        if not good.all():
            notes.append(f"AttEuler: {int((~good).sum())} epochs without an accuracy (AttCovEuler) were left out.")
        values = pick(values, good) | {"sheading": np.sqrt(variance[good]) * units.DEG}
    elif hints.sigma_heading_deg is None:
        notes.append("AttEuler has no accuracy (AttCovEuler) and was left out; sigma_heading_deg=.. reads it.")
        return None
    notes.append("heading: AttEuler, of the antennas, turned as the receiver's setAttitudeOffset says.")
    return Table(values)


def _reference(log: Blocks, t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table:
    notes.append(
        "reference: INSNavGeod, the receiver's own inertial solution, made of the same sensors: to compare with, not a "
        "truth; of the point its settings name (IMU, antenna or a point of interest)."
    )
    return Table({
        "t": t,
        "lat": rows["lat"],
        "lon": rows["lon"],
        "h": rows["h"],
        "vn": rows["vn"],
        "ve": rows["ve"],
        "vd": -rows["vu"],
        "roll": rows["roll"] * units.DEG,
        "pitch": rows["pitch"] * units.DEG,
        "yaw": rows["heading"] * units.DEG,
    })  # fmt: skip
