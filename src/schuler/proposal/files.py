"""Files of a run: which one holds which series, and how each is read as far as it tells itself."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.proposal import arrays, tables
from schuler.proposal.decision import Decision, UndecidedError
from schuler.proposal.rivals import chosen
from schuler.recording.formats import nmea, registry, rtklib, text
from schuler.recording.io import columns, lines, text_head
from schuler.recording.io.folder import folders_in, listed, recognised
from schuler.recording.io.hint_texts import SATELLITES
from schuler.recording.io.hints import ReadHints
from schuler.units import factor_for

#: End of the evidence of a unit that only motion can tell.
UNTIL = "rad/s until the motion says otherwise"
_TRUTH = re.compile(r"truth|reference|ground|(^|[_-])(gt|ref)([_-]|$)", re.IGNORECASE)
_NO_LOGS = (".md", ".json", ".yaml", ".yml", ".toml", ".html", ".tag", ".png", ".jpg", ".pdf", ".py", ".rst")
_ARRAYS = (".npy", ".npz", ".mat")
HALVES = ("accel", "gyro")
_MOST_DEG = 180.0
#: Factors of a u-blox receiver's whole numbers (NAV-PVT): degrees, metres, metres a second.
_UBLOX = {"lat": 1e-7, "lon": 1e-7, "h": 1e-3, "speed": 1e-3, "course": 1e-5, "heading": 1e-5}
_SPEED_SIGMA = 0.1  # of wheels that do not say theirs [m/s]
_CLAIM, _LEAST_CLAIM_M = 3.0, 0.02  # 1-sigma of positions over their scatter, in which slow errors do not show
#: Origin of a local frame that nobody stated: gravity is within 0.03 m/s^2 of that anywhere at sea level.
SOMEWHERE = "45,0,0"


@dataclass
class Files:
    """Log of a run and how it is read.

    Attributes
    ----------
    log : Path
        File or folder.
    entries : dict
        Hints, or an entry of hints for each part of a folder, as :func:`schuler.read` takes them.
    decisions : list of Decision
    ignored : list of str
        Files of a folder that hold no series.
    """

    log: Path
    entries: dict[str, Any] = field(default_factory=dict)
    decisions: list[Decision] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)

    @property
    def by_part(self) -> bool:
        """Whether the entries are of parts."""
        return any(isinstance(e, dict) and n != "streams" for n, e in self.entries.items())

    def entry(self, part: str) -> dict[str, Any] | None:
        """Hints of the file that a part is read from; None if no such file is read by hints of its own.

        Of an IMU in two files they are what both share; :meth:`put` writes them back.
        """
        if not self.by_part:
            return self.entries
        if part == "imu" and "imu" not in self.entries and HALVES[0] in self.entries:
            both = [self.entries[half] for half in HALVES]
            units = ",".join(dict.fromkeys(unit for e in both for unit in str(e.get("units", "")).split(",") if unit))
            return {**both[1], **both[0], **({"units": units} if units else {})}
        entry = self.entries.get(part)
        return entry if isinstance(entry, dict) else None

    def put(self, part: str, new: Mapping[str, Any]) -> None:
        """Change hints of the file that a part is read from, of both files of an IMU in two."""
        if part == "imu" and self.by_part and "imu" not in self.entries:
            for half, other in zip(HALVES, HALVES[::-1], strict=True):
                own = dict(new)
                for name in ("units", "scale"):
                    if name in own:
                        pairs = [pair for pair in str(own[name]).split(",") if not pair.startswith(f"{other}=")]
                        own[name] = ",".join(pairs)
                self.entries[half] |= own
            return
        entry = self.entry(part)
        if entry is not None:
            entry |= new

    def names_of(self, part: str, key: str) -> list[str]:
        """Names of a hint as entries of the configuration, one for each file of an IMU in two."""
        if not self.by_part:
            return [f"recording.{key}"]
        halves = part == "imu" and "imu" not in self.entries
        return [f"recording.{name}.{key}" for name in (HALVES if halves else (part,))]


def hints_of(paths: Sequence[Path], given: Mapping[str, Any]) -> dict[str, Any]:
    """The section ``[recording]`` as the user gave it; that of the IMU of a single file is the file's own.

    Parameters
    ----------
    paths, given
        See :func:`files_of`.

    Raises
    ------
    InputError
        If a single file is given hints of another part.
    """
    hints = dict(given)
    if len(paths) != 1 or not paths[0].is_file():
        return hints
    for part in [p for p, entry in hints.items() if isinstance(entry, Mapping) and p not in ("streams", "scale")]:
        own = dict(hints.pop(part))
        if part != "imu" or "file" in own:
            key = next(iter(own), "...")
            raise InputError(
                f"recording.{part}.{key}: {paths[0].name} is given alone, and has no part {part} of its own: say "
                f"recording.{key}, or give the files of the run or their folder"
            )
        hints = own | hints
    return hints


def files_of(paths: Sequence[Path], given: Mapping[str, Any], *, complete: bool = False) -> Files:
    """Log and parts of a folder, a file or several.

    Parameters
    ----------
    paths : sequence of Path
    given : mapping
        The section ``[recording]`` as far as the user gave it; stands over what is recognised.
    complete : bool
        Files that it names are all there are: none is looked for.

    Raises
    ------
    UndecidedError
        If two files could be the same series and nothing tells which is meant.
    InputError
        If there is no such file, or nothing in it that could be navigated.
    """
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    if len(paths) == 1 and (paths[0].is_file() or registry.find_folder(paths[0]) is not None):
        return _one(paths[0], given)
    if len(paths) == 1:
        log = paths[0]
        names = [p.name for p in sorted(log.iterdir()) if p.is_file() and not p.name.startswith(".")]
    else:
        if folders := [str(p) for p in paths if p.is_dir()]:
            raise InputError(f"expected one folder, or files of one run, got also the folder {', '.join(folders)}")
        log = Path(os.path.commonpath([p.resolve().parent for p in paths]))
        names = [p.resolve().relative_to(log).as_posix() for p in paths]
    if complete and any(isinstance(e, Mapping) and "file" in e for e in given.values()):
        return Files(log, {part: dict(e) if isinstance(e, Mapping) else e for part, e in given.items()})
    return _folder(log, names, given)


def _one(path: Path, given: Mapping[str, Any]) -> Files:
    files = Files(path, dict(given))
    if path.is_file() and "columns" not in given and "format" not in given and _is_plain(path):
        held = recognised(path)
        entry, decisions = _table(path, "recording", held[0] if held else None)
        if entry is None:
            raise _unknown(path, "recording")
        if len(held) > 1:
            accuracy, more = _accuracy(path, "recording", held[1])
            entry, decisions = entry | accuracy, decisions + more
        files.entries = {**entry, **given}
        files.decisions = [d for d in decisions if d.entry.rpartition(".")[2] not in given]
    return files


def _folder(log: Path, names: list[str], given: Mapping[str, Any]) -> Files:
    files = Files(log)
    candidates: dict[str, list[tuple[bool, str, dict[str, Any], list[Decision]]]] = {}
    wholes, tracks = [], []
    meant = {part: str(e["file"]) for part, e in given.items() if isinstance(e, Mapping) and "file" in e}
    for name in names:
        path = log / name
        if path.suffix.lower() in _NO_LOGS:
            continue
        if (rows := arrays.array(path)) is not None and arrays.is_path(rows):
            tracks.append(name)
            continue
        head = _head(path)
        if head.startswith(b"PAR1"):
            wholes.append(name)
            continue
        held = recognised(path)
        named = bool(held)
        if not held and tables.imu_columns(path) is not None:
            held = ("imu",)
        elif held in ((), ("reference",)) and (half := tables.half_of_imu(path)) is not None:
            held = (half,)
        elif not held and registry.find(head, path) is not None:
            wholes.append(name)  # a bag, or what else holds a run
            continue
        if not held:
            files.ignored.append(name)
            continue
        for part in held:
            role = "reference" if part == "gnss" and _TRUTH.search(path.stem) else part
            entry: dict[str, Any] = {"file": name}
            decisions: list[Decision] = []
            extra: dict[str, Any] | None
            if part in HALVES:
                extra, decisions = _half(path, part)
                entry = {"file": name, **extra}
            elif _is_plain(path) or rows is not None:
                extra, decisions = _table(path, f"recording.{role}", part if named else None)
                if extra is None:
                    continue
                entry = {"file": name, **extra}
            candidates.setdefault(role, []).append((named, name, entry, decisions))
    if wholes and not candidates:
        if len(wholes) > 1:
            raise InputError(f"{log}: expected the files of one run, got {', '.join(wholes)}: give one of them")
        return Files(log / wholes[0], dict(given))
    if len(wholes) == 1 and not {"imu", *HALVES} & set(candidates) and "imu" not in meant:
        candidates["imu"] = [(True, wholes[0], {"file": wholes[0]}, [])]  # a log of inertial units beside the fixes
    for part, name in meant.items():
        rivals = [f for f in candidates.get(part, []) if f[1] == name]
        candidates[part] = rivals or [(True, name, {"file": name}, [])]
    if "imu" in candidates or not all(len(candidates.get(half, ())) == 1 for half in HALVES):
        files.ignored += [f[1] for half in HALVES for f in candidates.pop(half, [])]
    if "imu" not in candidates and HALVES[0] not in candidates:
        raise _nothing(log, names, satellites="observations" in candidates)
    if "gnss" in candidates:
        for part in SATELLITES:
            for _, name, _, _ in candidates.pop(part, []):
                if name not in files.ignored:
                    files.ignored.append(name)
    for part, rivals in candidates.items():
        files.entries[part], decisions = chosen(log, part, rivals, files.ignored)
        if isinstance(own := given.get(part), Mapping):
            files.entries[part] |= own
            decisions = [d for d in decisions if d.entry.rpartition(".")[2] not in own]
        files.decisions += decisions
    if tracks and "gnss" not in files.entries:
        _relate(files, tracks, given)
    else:
        files.ignored += tracks
    return files


def _half(path: Path, part: str) -> tuple[dict[str, Any], list[Decision]]:
    """Hints of a file of an accelerometer or a gyroscope alone."""
    columns, evidence = tables.half_columns(path, part)
    entry: dict[str, Any] = {} if columns is None else {"columns": columns}
    decisions = [Decision(f"recording.{part}.file", path.name, evidence)]
    names, stated = _layout(path, columns)
    triad = "ax" if part == "accel" else "gx"
    if triad not in stated:
        unit = UNTIL.partition(" ")[0]
        if part == "accel":
            unit = tables.accel_unit(tables.norm(path, [names.index(name) for name in ("ax", "ay", "az")]))
        entry["units"] = f"{part}={unit}"
    t = tables.column(path, names.index("t")) if "t" in names and "t" not in stated else None
    if t is not None and (clock := tables.time_unit(t)) is not None:
        if clock[0] != "s":
            entry["units"] = ",".join(filter(None, (entry.get("units"), f"t={clock[0]}")))
        if clock[1] is not None:
            entry["time"] = clock[1]
    return entry, decisions


def _relate(files: Files, tracks: list[str], given: Mapping[str, Any]) -> None:
    """Take the path that belongs to an IMU's array as fixes, where turns and accelerations of both tell the rates."""
    imu = files.entries.get("imu", {})
    rows = arrays.array(files.log / str(imu.get("file", "")))
    names = str(imu.get("columns", "")).split(",")
    if rows is None or "t" in names or len(tracks) > 1 or "ax" not in names:
        files.ignored += tracks
        return
    file, path = tracks[0], arrays.array(files.log / tracks[0])
    assert path is not None
    unit = dict(pair.split("=", 1) for pair in str(imu.get("units", "")).split(",") if "=" in pair).get(
        "accel", "m/s^2"
    )
    order = [names.index(name) for name in (*columns.ACCEL, *columns.GYRO)]
    f_si = rows[:, order] * np.repeat((factor_for(unit, "specific force"), 1.0), 3)
    relation = arrays.relation(f_si, path)
    if relation is None:
        raise UndecidedError(
            f"{files.log}: {imu['file']} and {file} have no times, and their turns and accelerations do not tell the "
            "rates: say --set recording.imu.rate=... (samples a second), and of the fixes --set "
            f"recording.gnss.file={file} --set recording.gnss.rate=..."
        )
    sigma = np.maximum(_CLAIM * arrays.scatter(path), _LEAST_CLAIM_M)
    stated = f"{sigma[:2].max():.2g},{sigma[:2].max():.2g},{sigma[2]:.2g}"
    entry = {
        "file": file, "columns": "e,n,-d" if relation.up else "n,e,d", "rate": relation.rate_hz, "sigma": stated,
        "origin": SOMEWHERE,
    }  # fmt: skip
    own = given.get("gnss")
    of_imu = {"rate": relation.ratio * relation.rate_hz, "units": f"accel={unit},gyro={relation.unit}"}
    of_imu = {name: value for name, value in of_imu.items() if name not in given.get("imu", {})}
    imu |= of_imu
    files.entries["gnss"] = entry | (dict(own) if isinstance(own, Mapping) else {})
    files.decisions = [d for d in files.decisions if d.entry.rpartition(".")[2] not in of_imu]
    beside = f"{relation.ratio} samples of {imu['file']} to one of {file}, if they begin and end together"
    why = f"{beside}; {relation.evidence}"
    turned = "the other way" if relation.up else "the same way"
    evidence = {
        "file": "its rows go on as positions do",
        "columns": f"a turn about the plumb line turns the course {turned}; which column is north is not needed",
        "rate": relation.evidence,
        "sigma": f"nobody stated it; {_CLAIM:g} times the scatter of neighbouring positions, at least "
        f"{_LEAST_CLAIM_M:g} m",
        "origin": "where the local frame lies is not stated; elsewhere gravity differs by 0.03 m/s^2 at most, which "
        "the biases take up",
    }
    files.decisions += [Decision(f"recording.imu.{name}", value, why) for name, value in of_imu.items()]
    files.decisions += [Decision(f"recording.gnss.{n}", v, evidence[n]) for n, v in entry.items() if n not in stated]


def _table(path: Path, section: str, part: str | None) -> tuple[dict[str, Any] | None, list[Decision]]:
    """Hints of a plain table: columns where no header names them, the unit of time; None if it cannot be match."""
    entry: dict[str, Any] = {}
    decisions: list[Decision] = []
    if part is None:
        match = tables.imu_columns(path)
        if match is None:
            return None, []
        entry["columns"] = match[0]
        decisions.append(Decision(f"{section}.columns", match[0], match[1]))
    if part not in (None, "imu"):
        entry, decisions = _clock(path, section)
        if part == "gnss" and (scale := _whole_units(path)):
            entry["scale"] = scale
            why = "whole numbers beyond 180: u-blox's units, 1e-7 deg, mm, mm/s and 1e-5 deg"
            decisions.append(Decision(f"{section}.scale", scale, why))
        accuracy, more = ({}, []) if section.endswith("reference") else _accuracy(path, section, part)
        return entry | accuracy, decisions + more
    names, stated = _layout(path, entry.get("columns")) if path.suffix.lower() not in _ARRAYS else (
        str(entry["columns"]).split(","), set()
    )  # fmt: skip
    if "t" not in names and (at := tables.clock_column(path, names)) is not None:
        names[at] = "t"
        entry["columns"] = ",".join(names)
        decisions.append(Decision(f"{section}.columns", entry["columns"], f"column {at + 1} increases like a clock"))
    units: dict[str, str] = {}
    why = ""
    accel = [names.index(name) for name in columns.ACCEL if name in names]
    if len(accel) == 3 and "ax" not in stated:
        norm = tables.norm(path, accel)
        units["accel"] = tables.accel_unit(norm)
        why = f"the norm of specific force is about {norm:.4g}"
    if "gx" in names and "gx" not in stated:
        units["gyro"] = "rad/s"
        why = f"{why}; {UNTIL}" if why else UNTIL
    if units:
        decisions.append(Decision(f"{section}.units", "", why))
    t = tables.column(path, names.index("t")) if "t" in names else None
    clock = None if t is None or "t" in stated else tables.time_unit(t)
    if t is not None and "t" in stated and (unit := tables.unix_unit(t)) is not None:
        dated, more = _dated(section, t, unit)
        entry, decisions = entry | dated, decisions + more
    if t is not None and clock is not None:
        if clock[0] != "s":
            units["t"] = clock[0]
            step = float(np.median(np.diff(t)))
            stamps = f"stamps step by {step:g}, which is no other unit of an IMU's"
            why = f"{stamps}; {why}" if why else stamps
            decisions = [d for d in decisions if d.entry != f"{section}.units"]
            decisions.append(Decision(f"{section}.units", "", why))
        if clock[1] is not None:
            entry["time"] = clock[1]
            decisions.append(
                Decision(f"{section}.time", clock[1], f"stamps of {t[0]:.6g} {clock[0]} are of this century")
            )
    if units:
        entry["units"] = ",".join(f"{group}={unit}" for group, unit in units.items())
        decisions = [replace(d, value=entry["units"]) if d.entry == f"{section}.units" else d for d in decisions]
    return entry, decisions


def _clock(path: Path, section: str) -> tuple[dict[str, Any], list[Decision]]:
    """Hints of a table's clock where its stamps are Unix time, as those of an IMU's beside it are then told."""
    names, stated = _layout(path, None)
    t = tables.column(path, names.index("t")) if "t" in names else None
    unit = None if t is None else tables.unix_unit(t)
    if t is not None and "t" in stated:
        return _dated(section, t, unit) if unit is not None else ({}, [])
    counted = None if t is None or "ax" not in names else tables.time_unit(t)  # those of the IMU in the same table
    if t is not None and unit is None and counted is not None and counted[0] != "s":
        unit = counted[0]
        return {"units": f"t={unit}"}, [Decision(f"{section}.units", f"t={unit}", "as of the IMU in the same rows")]
    if t is None or unit is None:
        return {}, []
    entry = {"time": "unix"} | ({} if unit == "s" else {"units": f"t={unit}"})
    why = f"stamps of {t[0]:.6g} {unit} are of this century"
    return entry, [Decision(f"{section}.{name}", value, why) for name, value in entry.items()]


def _whole_units(path: Path) -> str:
    """Hint ``scale`` of fixes in whole numbers, as a u-blox receiver has them; empty if they are none."""
    names, stated = _layout(path, None)
    if not {"lat", "lon"} <= set(names) or {"lat", "lon"} & stated:
        return ""
    values = {name: tables.column(path, names.index(name)) for name in _UBLOX if name in names and name not in stated}
    whole = {name: x for name, x in values.items() if x is not None and len(x) and (x == np.round(x)).all()}
    if not {"lat", "lon"} <= set(whole) or max(np.abs(whole["lat"]).max(), np.abs(whole["lon"]).max()) <= _MOST_DEG:
        return ""
    return ",".join(f"{name}={_UBLOX[name]:g}" for name in whole)


def _dated(section: str, t: FloatArray, unit: str) -> tuple[dict[str, Any], list[Decision]]:
    """Hint that stamps whose unit the header states are Unix time."""
    return {"time": "unix"}, [Decision(f"{section}.time", "unix", f"stamps of {t[0]:.6g} {unit} are of this century")]


def _accuracy(path: Path, section: str, part: str) -> tuple[dict[str, Any], list[Decision]]:
    """Accuracy of a table's fixes or speeds where no column states it: rules of thumb, as for NMEA without GST."""
    names, _ = _layout(path, None)
    if part == "odometer" and "speed" in names and "sspeed" not in names:
        why = f"no column states an accuracy; {_SPEED_SIGMA:g} m/s is typical of wheels"
        return {"sigma_speed": _SPEED_SIGMA}, [Decision(f"{section}.sigma_speed", _SPEED_SIGMA, why)]
    missing = part == "gnss" and names and not set(columns.SIGMA) <= set(names)
    if not missing or not {"lat", "n", "x"} & set(names):
        return {}, []
    level = nmea.RANGE_ERROR[1]
    numbers = [level, level, nmea.VERTICAL * level]
    if set(columns.VELOCITY[:2]) <= set(names) and not set(columns.VELOCITY_SIGMA[:2]) <= set(names):
        numbers += [nmea.RATE_ERROR] * 3
    sigma = ",".join(f"{number:g}" for number in numbers)
    why = "no column states an accuracy; that of a receiver by itself, from which filter.tune finds the log's own"
    return {"sigma": sigma}, [Decision(f"{section}.sigma", sigma, why)]


def _layout(path: Path, given: str | None) -> tuple[list[str], set[str]]:
    """Names of a table's columns, and those whose unit its header states."""
    opening = text_head.open_text(path, ReadHints())
    fields = [] if opening.header is None else opening.header[1]
    read = text_head.columns_of(opening)
    names = given.split(",") if given is not None else [column[0] if column else "-" for column in read]
    units = [columns.unit_in(field) for field in fields]
    return names, {name for name, unit in zip(names, units, strict=False) if unit is not None}


def _is_plain(path: Path) -> bool:
    """Whether a file is a table of text that no format claims."""
    head = _head(path)
    if not head or b"\x00" in head or head.startswith(b"PAR1") or path.suffix.lower() in _ARRAYS:
        return False
    if registry.find(head, path) is not None or rtklib.looks_like_pos(head) or path.suffix.lower() == ".pos":
        return False
    if text.OWN_MARK.encode() in head:
        return False
    from schuler.recording.io.satellite_files import kinds_of

    return not kinds_of(path, head)


def _head(path: Path) -> bytes:
    try:
        return lines.check_file(path)
    except FileFormatError:
        return b""


def _unknown(path: Path, section: str) -> UndecidedError:
    return UndecidedError(
        f"{path}: neither a header nor the numbers tell the columns: say them, - skips one, such as "
        f"--set {section}.columns='\"t,ax,ay,az,gx,gy,gz\"'"
    )


def _nothing(log: Path, names: list[str], *, satellites: bool) -> InputError:
    if inside := folders_in(log):
        return InputError(f"{log}: no log of an IMU is recognised among {listed(names) or 'no files'}: {inside}")
    positions = f"; schuler points {log} makes positions of its satellite measurements" if satellites else ""
    return InputError(
        f"{log}: no log of an IMU is recognised among {listed(names) or 'no files'}: name the file and its columns, "
        f"--set recording.imu.file=NAME --set recording.imu.columns='\"t,ax,ay,az,gx,gy,gz\"'{positions}"
    )
