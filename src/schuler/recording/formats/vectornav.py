"""VectorNav logs, binary, ASCII or CSV of VectorNav's programs: IMU, GNSS, and the sensor's own solution as reference.

Packets in ``vectornav_packets``. The sensor's axes are forward-right-down; its accelerometer measures specific force.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import rotation, units
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import vectornav_csv
from schuler.recording.formats.vectornav_packets import Packets, load, looks_like
from schuler.recording.io import parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import RATE_ERROR, Columns, base_of, keep_timed, pick
from schuler.recording.io.streams import Stream, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

#: Hints that mean something here.
HINTS = {"sigma", "axes", "streams", "time", "rate"}
_SOLUTION = ("lat", "lon", "h", "vn", "ve", "vd")
_FIX = ("fix", "fix_lat", "fix_lon", "fix_h")
_MODE, _TRACKING, _LOST = 0x3, 2, 3  # of the INS status
_FIRST_WEEK = 1000.0  # there were no such sensors before; times before are those of a clock not set
#: Outputs of the IMU in order of preference, and what their columns' names start with.
TRIADS = {"uncompensated": "raw", "compensated": "comp"}
KINDS = ("uncompensated", "delta", "compensated")
# RTKLIB's quality of a fix: two- and three-dimensional, SBAS, float and fixed
QUALITY = {2: 5, 3: 5, 4: 3, 7: 2, 8: 1}
_TWO_D = 2
_ASSUMED_HEIGHT = 100.0  # 1-sigma of the height of a two-dimensional fix, which is held, not measured [m]


def sniff(head: bytes, path: Path) -> bool:
    """Whether there are two packets or lines of a VectorNav sensor with right checksums among the first bytes."""
    return looks_like(head) or vectornav_csv.looks_like(head)


def contents(path: Path) -> list[Stream]:
    """Kinds of packets of the log; those that hold several parts of a recording name the first."""
    made = []
    log = _load(path, allow_truncated=True)
    for name, rows in log.columns.items():
        held = held_in(rows)
        t = rows["startup_s"] + rows["startup_rest"] if "startup_s" in rows else rows.get("sow", np.empty(0))
        stream = stream_of(name, "VectorNav", t, held[0] if held else "")
        made.append(
            Stream(name, ", ".join(held), len(next(iter(rows.values()))), stream.start, stream.stop, stream.part)
        )
    return made + [Stream(name, "VectorNav", count) for name, count in log.others.items()]


@np.errstate(invalid="ignore", over="ignore")  # what is no number is refused by the checks of parts.assemble
def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a VectorNav log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams="imu=.."`` with ``uncompensated`` (default where it is logged), ``delta`` (angle and velocity
        increments) or ``compensated`` (less what the sensor's filter takes for biases); ``gnss=none`` and so on leave
        parts out. ``time="local"`` counts from the sensor's start instead of GPS time. ``rate`` of VNIMU and VNYMR
        lines, which have no time. ``axes``, if the sensor's reference frame was not turned to the vehicle's.

    Returns
    -------
    Recording
        On GPS time where the log has it, else in seconds since the sensor started.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, holds none of the parts, or has no times and no ``rate`` is given.
    """
    parts.check_hints(path, hints, HINTS, "a VectorNav log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: a VectorNav log has time='gps' or 'local', got {hints.time!r}")
    log = _load(path, allow_truncated=hints.allows("truncated"))
    notes, chosen = list(log.notes), parse_streams(hints.streams)
    kind = chosen.get("imu", "")
    if kind and kind not in KINDS:
        raise InputError(f"streams: imu of a VectorNav log is one of {', '.join(KINDS)} or none, got {kind!r}")
    parts_of: dict[str, tuple[str, Columns]] = {}
    for part in ("imu", "gnss", "reference"):
        if (part in chosen and chosen[part] is None) or hints.series not in (None, part):
            continue
        best = _best(log, part, kind or "")
        if best is not None:
            parts_of[part] = best
    if kind and "imu" not in parts_of:
        raise InputError(f"streams: the log has no {kind} IMU")
    if not parts_of:
        raise FileFormatError(
            f"expected IMU, GNSS or INS outputs, found packets {', '.join([*log.columns, *log.others])} without them",
            path,
        )
    if "imu" in parts_of and not _has_time(parts_of["imu"][1]):
        return _without_time(log, parts_of, hints, notes)
    if "rate" in hints.given():
        raise InputError(f"{path}: the packets have times; leave out rate")
    local = hints.time == "local" or not any(has_gps(rows) for _, rows in parts_of.values())
    tables, first = _timed_tables(log, parts_of, kind or "", hints, notes, local=local)
    if not tables:
        raise FileFormatError("no packet has a time or a solution; time='local' counts from the sensor's start", path)
    return parts.assemble(path, tables, hints, TimeBase("local") if local else base_of(first), notes)


def _load(path: Path, *, allow_truncated: bool) -> Packets:
    with path.open("rb") as stream:
        head = stream.read(65536)
    return vectornav_csv.load(path, allow_truncated=allow_truncated) if vectornav_csv.looks_like(head) else load(path)


def held_in(rows: Columns) -> list[str]:
    """Parts of a recording that packets of a kind hold."""
    held = ["imu"] if imu_kind(rows, "") else []
    held += ["gnss"] if all(name in rows for name in _FIX) else []
    return held + (["reference"] if all(name in rows for name in _SOLUTION) else [])


def _best(log: Packets, part: str, kind: str) -> tuple[str, Columns] | None:
    """Name and columns of the packets to take for a part: the preferred outputs, then most packets."""
    ranked = []
    for name, rows in log.columns.items():
        n = len(next(iter(rows.values()), ()))
        if part == "imu":
            present = imu_kind(rows, kind)
            if present is not None:
                ranked.append((_has_time(rows), -KINDS.index(present), n, name))
        elif part in held_in(rows):
            ranked.append((has_gps(rows), 0, n, name))
    if not ranked:
        return None
    name = max(ranked)[3]
    return name, log.columns[name]


def has_gps(rows: Columns) -> bool:
    """Whether packets say GPS time."""
    return "gps_s" in rows or ("tow_s" in rows and "week" in rows) or "sow" in rows or "fix_sow" in rows


def _has_time(rows: Columns) -> bool:
    return has_gps(rows) or "startup_s" in rows or "dt" in rows


def _with_clock(rows: Columns, part: str, what: str, *, local: bool, path: Path, notes: list[str]) -> Columns:
    """Rows with columns ``clock_week`` and ``clock_sow`` of the packets' time (week 0 of a local clock), in order."""
    if local:
        if "startup_s" in rows:
            sow = rows["startup_s"] + rows["startup_rest"]
        elif "dt" in rows:
            sow = np.cumsum(rows["dt"])
            notes.append(f"{what}: stamps are the sums of the intervals in the packets.")
        else:
            notes.append(f"{what} has no time on the sensor's clock and was left out.")
            return {}
        rows = rows | {"clock_week": np.zeros(len(sow)), "clock_sow": sow}
        return pick(rows, parts.later(sow, what, path, notes))
    week_and_sow = gps_time(rows, part)
    if week_and_sow is None:
        notes.append(f"{what} has no GPS time and was left out (time='local' counts from the sensor's start).")
        return {}
    rows = rows | {"clock_week": week_and_sow[0], "clock_sow": week_and_sow[1]}
    return keep_timed(rows, "clock_week", "clock_sow", what, path, notes)


def gps_time(rows: Columns, part: str) -> tuple[FloatArray, FloatArray] | None:
    """GPS week (0 before the sensor knows it) and seconds of it of packets, for a part of a recording.

    Returns
    -------
    week, sow : ndarray, shape (n,)
        Of the fixes for the part "gnss" where packets say it; ``None`` if they say no GPS time. [weeks], [s]
    """
    if part == "gnss" and "fix_sow" in rows:
        week, sow = rows["fix_week"], rows["fix_sow"]
    elif part == "gnss" and "fix_tow_s" in rows and "fix_week" in rows:
        week, sow = rows["fix_week"], rows["fix_tow_s"] + rows["fix_tow_rest"]
    elif "sow" in rows:
        week, sow = rows["week"], rows["sow"]
    elif "gps_s" in rows:
        week = np.floor(rows["gps_s"] / WEEK_S)
        sow = rows["gps_s"] - week * WEEK_S + rows["gps_rest"]
    elif "tow_s" in rows and "week" in rows:
        week, sow = rows["week"], rows["tow_s"] + rows["tow_rest"]
    else:
        return None
    return np.where(week >= _FIRST_WEEK, week, 0.0), sow


def _timed_tables(
    log: Packets,
    parts_of: dict[str, tuple[str, Columns]],
    kind: str,
    hints: ReadHints,
    notes: list[str],
    *,
    local: bool,
) -> tuple[dict[str, Table], float]:
    """Tables of the parts on one clock, and the first week."""
    ready: dict[str, Columns] = {}
    for part, (name, rows) in parts_of.items():
        good = with_solution(part, name, rows, notes)
        if part == "gnss":
            good &= new_fixes(rows)
        if good.any():
            made = _with_clock(pick(rows, good), part, f"{part} ({name})", local=local, path=log.path, notes=notes)
            if made and len(made["clock_sow"]):
                ready[part] = made
    first = min((float(rows["clock_week"][0]) for rows in ready.values()), default=0.0)
    tables: dict[str, Table] = {}
    for part, rows in ready.items():
        t = (rows["clock_week"] - first) * WEEK_S + rows["clock_sow"]
        if part == "imu":
            tables[part] = imu_table(t, rows, kind, notes)
        elif part == "gnss":
            tables[part] = gnss_table(t, rows, hints, notes)
        else:
            tables[part] = reference_table(t, rows, notes)
    return tables, first


def with_solution(part: str, name: str, rows: Columns, notes: list[str]) -> BoolArray:
    """Rows with a solution."""
    good = np.ones(len(next(iter(rows.values()))), dtype=bool)
    if part == "imu":
        return good
    if part == "gnss":
        good = np.isin(rows["fix"], list(QUALITY))
        what = "fix"
    else:
        mode = rows["ins"].astype(np.int64) & _MODE if "ins" in rows else np.full(len(good), _TRACKING)
        good = np.isin(mode, (_TRACKING, _LOST)) & ((rows["lat"] != 0.0) | (rows["lon"] != 0.0))
        what = "solution of the INS (status not tracking)"
    if not good.all():
        notes.append(f"{part} ({name}): {int((~good).sum())} packets without a {what} were left out.")
    return good


def new_fixes(rows: Columns) -> BoolArray:
    """Packets whose fix is not that of the packet before: a fix is repeated until the next. Shape (n,)."""
    names: tuple[str, ...] = ("fix_tow_s", "fix_tow_rest") if "fix_tow_s" in rows else ("fix_sow",)
    if names[0] not in rows:
        names = ("fix_lat", "fix_lon", "fix_h")
    new = np.ones(len(rows["fix"]), dtype=bool)
    new[1:] = np.any([rows[name][1:] != rows[name][:-1] for name in names], axis=0)
    return new


def _without_time(
    log: Packets, parts_of: dict[str, tuple[str, Columns]], hints: ReadHints, notes: list[str]
) -> Recording:
    """Lines of an IMU that say no time: counted at a stated rate, or left out beside parts that have times."""
    name, rows = parts_of["imu"]
    if len(parts_of) > 1:
        notes.append(
            f"imu: {name} has no time and cannot be related to the rest of the log; it was left out (series='imu' with "
            "rate=100, or whatever it is, reads it alone; log binary packets with TimeGps for both)."
        )
        rest = {part: entry for part, entry in parts_of.items() if part != "imu"}
        tables, first = _timed_tables(log, rest, "", hints, notes, local=False)
        if not tables:
            raise FileFormatError("nothing of the log can be read but an IMU without time: say series='imu'", log.path)
        return parts.assemble(log.path, tables, hints, base_of(first), notes)
    if hints.rate is None:
        raise InputError(f"{log.path}: {name} lines have no time: say its rate, such as rate=100 [Hz]")
    n = len(next(iter(rows.values())))
    notes.append(f"imu: {name} has no time; stamps are counted at {hints.rate:g} Hz from 0 s, lost lines are not seen.")
    tables = {"imu": imu_table(np.arange(n) / hints.rate, rows, "", notes)}
    made = parts.assemble(log.path, tables, replace(hints, rate=None), TimeBase("local"), notes)
    return replace(made, metadata=replace(made.metadata, options=hints.given()))


def imu_kind(rows: Columns, requested: str) -> str | None:
    """Kind of IMU output in packets: the requested one, or the first in order of preference; ``None`` for none."""
    for kind in KINDS if not requested else (requested,):
        prefix = TRIADS.get(kind)
        names: tuple[str, ...] = ("dt", "dthx", "dthy", "dthz", "dvx", "dvy", "dvz")
        if prefix is not None:
            names = tuple(f"{prefix}_{letter}{axis}" for letter in "ag" for axis in "xyz")
        if all(name in rows for name in names):
            return kind
    return None


def imu_table(t: FloatArray, rows: Columns, requested: str, notes: list[str]) -> Table:
    """IMU series of the wanted outputs, or of the preferred ones that are there."""
    kind = imu_kind(rows, requested)
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
        variances = rows.get("sv", np.zeros(len(t)))
        if (guess := variances <= 0.0).any():
            given = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else (RATE_ERROR,) * 3
            notes.append(f"gnss: velocities of {int(guess.sum())} fixes have no accuracy; 1-sigma is {given} m/s.")
            values |= {f"sv{axis}": np.where(guess, s, variances) for axis, s in zip("ned", given, strict=True)}
        else:
            values |= {f"sv{axis}": variances for axis in "ned"}
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
        leave = "streams='reference=none' leaves it out"
        q = unit_quaternions(q, lambda row, text: FileFormatError(f"attitude {row + 1}: {text}; {leave}"))
        angles = rotation.rpy_from_quat(q)
        values |= {name: angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    own = ""
    if "spos" in rows:
        own = f" By its own account it is good to {np.median(rows['spos']):.3g} m (median)."
    notes.append(
        f"reference: the sensor's own solution, made of the same IMU and GNSS: to compare with, not a truth.{own}"
    )
    return Table(values)
