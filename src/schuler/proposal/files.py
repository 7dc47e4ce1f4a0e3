"""Files of a run: which one holds which series, and how each is read as far as it tells itself."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.files import check_log
from schuler.proposal import arrays, halves, tables
from schuler.proposal.decision import Decision, UndecidedError
from schuler.proposal.hints import (
    accuracy_hints,
    half_hints,
    head_of,
    is_plain,
    missing_half,
    span_of,
    table_hints,
    unit_of,
)
from schuler.proposal.rivals import chosen
from schuler.recording.formats import registry
from schuler.recording.io import columns, packed
from schuler.recording.io.folder import folders_in, listed, names_in, parted, recognised
from schuler.recording.io.hint_texts import SATELLITES
from schuler.units import factor_for

_TRUTH = re.compile(r"truth|reference|ground|(^|[_-])(gt|ref)([_-]|$)", re.IGNORECASE)
_NO_LOGS = (".md", ".json", ".yaml", ".yml", ".toml", ".html", ".tag", ".png", ".jpg", ".pdf", ".py", ".rst")
HALVES = ("accel", "gyro")
_BOTH = "an IMU has both; log the {} too"
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
                self.entries[half] |= {name: value for name, value in own.items() if value != ""}
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
    if len(paths) != 1 or not paths[0].is_file() or packed.tables(paths[0]):
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
        check_log(path)
    several = paths[0].is_file() and "columns" not in given and "format" not in given and packed.tables(paths[0])
    if len(paths) == 1 and not several and (paths[0].is_file() or registry.find_folder(paths[0]) is not None):
        return _one(paths[0], given)
    if len(paths) == 1:
        log, names = paths[0], names_in(paths[0])
        single: list[str] = []
        if several:  # hints that name no part are of its IMU
            given, own = parted(given)
            files = _folder(log, names, given)
            files.put("imu", own)
            files.decisions = [d for d in files.decisions if d.entry not in {f"recording.imu.{name}" for name in own}]
            return files
    else:
        log, single, names = _several(paths)
    if complete and any(isinstance(e, Mapping) and "file" in e for e in given.values()):
        return Files(log, {part: dict(e) if isinstance(e, Mapping) else e for part, e in given.items()})
    return _folder(log, names, given, single)


def _several(paths: Sequence[Path]) -> tuple[Path, list[str], list[str]]:
    """Folder of files of one run, the names in it of those that were given one by one, and of all: also a folder's."""
    folders = [p for p in paths if p.is_dir()]
    if len(folders) > 1:
        raise InputError(f"expected one folder and files of its run, got the folders {', '.join(map(str, folders))}")
    log = Path(os.path.commonpath([p.resolve() if p.is_dir() else p.resolve().parent for p in paths]))
    single = []
    for path in (p for p in paths if p.is_file()):
        name = path.resolve().relative_to(log).as_posix()
        single += [f"{name}/{table}" for table in packed.tables(path)] or [name]
    names = dict.fromkeys(single)
    for folder in folders:
        inside = folder.resolve().relative_to(log)
        whole = registry.find_folder(folder) is not None
        names |= dict.fromkeys((inside / name).as_posix() for name in ([""] if whole else names_in(folder)))
    return log, single, list(names)


def _one(path: Path, given: Mapping[str, Any]) -> Files:
    files = Files(path, dict(given))
    described = {"columns", "format", "variable"} & given.keys()
    if path.is_file() and not described and (is_plain(path) or arrays.array(path) is not None):
        held = recognised(path)
        entry, decisions = table_hints(path, "recording", held[0] if held else None)
        if entry is None:
            raise _unknown(path, "recording")
        if len(held) > 1:
            accuracy, more = accuracy_hints(path, "recording", held[1])
            entry, decisions = entry | accuracy, decisions + more
        files.entries = {**entry, **given}
        files.decisions = [d for d in decisions if d.entry.rpartition(".")[2] not in given]
    return files


def _folder(log: Path, names: list[str], given: Mapping[str, Any], single: Sequence[str] = ()) -> Files:
    """Parts of a run among the files of a folder; those that were given one by one come before the others."""
    files = Files(log)
    candidates: dict[str, list[tuple[bool, str, dict[str, Any], list[Decision]]]] = {}
    wholes, tracks = [], []
    meant = {part: str(e["file"]) for part, e in given.items() if isinstance(e, Mapping) and "file" in e}
    for name in names:
        path = packed.resolved(log / name)
        if path.suffix.lower() in _NO_LOGS:
            continue
        if path.is_dir():  # it is one log
            wholes.append(name)
            continue
        if (rows := arrays.array(path)) is not None and arrays.is_path(rows):
            tracks.append(name)
            continue
        head = head_of(path)
        if head.startswith(b"PAR1"):
            wholes.append(name)
            continue
        held = recognised(path)
        named = bool(held)
        if not held and tables.imu_columns(path) is not None:
            held = ("imu",)
        elif held in ((), ("reference",)) and (half := halves.half_of_imu(path)) is not None:
            held = (half,)
        elif not held and registry.find(head, path) is not None:
            wholes.append(name)  # a bag, or what else holds a run
            continue
        elif not held and tables.fix_columns(path) is not None:
            held = ("gnss",)
        if not held:
            files.ignored.append(name)
            continue
        for part in held:
            role = "reference" if part == "gnss" and _TRUTH.search(path.stem) else part
            entry: dict[str, Any] = {"file": name}
            decisions: list[Decision] = []
            extra: dict[str, Any] | None
            if part in HALVES:
                extra, decisions = half_hints(path, part)
                entry = {"file": name, **extra}
            elif is_plain(path) or rows is not None:
                extra, decisions = table_hints(path, f"recording.{role}", part if named else None)
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
        if part != "ephemerides" and (first := [f for f in rivals if f[1] in single]):
            files.ignored += [f[1] for f in rivals if f not in first and f[1] not in files.ignored]
            rivals = first
        files.entries[part], decisions = chosen(log, part, rivals, files.ignored)
        if isinstance(own := given.get(part), Mapping):
            files.entries[part] |= own
            decisions = [d for d in decisions if d.entry.rpartition(".")[2] not in own]
        files.decisions += decisions
    _share_counter(files)
    if tracks and "gnss" not in files.entries:
        _relate(files, tracks, given)
    else:
        files.ignored += tracks
    return files


def _share_counter(files: Files) -> None:
    """Take stamps of fixes and speeds for counts of the IMU's clock where they run through the same numbers."""
    unit = unit_of(files.entry("imu"), "t")
    half: dict[str, Any] = next((files.entries[name] for name in ("imu", *HALVES) if name in files.entries), {})
    span = span_of(packed.resolved(files.log / str(half.get("file", ""))), half.get("columns"))
    for part in ("gnss", "odometer"):
        entry = files.entries.get(part)
        if unit is None or span is None or entry is None or "time" in entry or unit_of(entry, "t") is not None:
            continue
        other = span_of(packed.resolved(files.log / str(entry["file"])), entry.get("columns"))
        if other is not None and other[0] < span[1] and span[0] < other[1]:
            entry["units"] = ",".join(filter(None, (str(entry.get("units", "")), f"t={unit}")))
            why = (
                f"stamps of {other[0]:.6g} to {other[1]:.6g} count as the IMU's do, from {span[0]:.6g} to {span[1]:.6g}"
            )
            files.decisions.append(Decision(f"recording.{part}.units", entry["units"], why))


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


def _unknown(path: Path, section: str) -> InputError:
    if (missing := missing_half(path)) is not None:
        return InputError(
            f"{path}: its header names {missing[0]} but no {missing[1]}: {_BOTH.format(missing[2])}, or say which "
            f"columns they are, --set {section}.columns='\"t,ax,ay,az,gx,gy,gz\"' (- skips one)"
        )
    return UndecidedError(
        f"{path}: neither a header nor the numbers tell the columns: say them, - skips one, such as "
        f"--set {section}.columns='\"t,ax,ay,az,gx,gy,gz\"'"
    )


def _nothing(log: Path, names: list[str], *, satellites: bool) -> InputError:
    if inside := folders_in(log):
        return InputError(f"{log}: no log of an IMU is recognised among {listed(names) or 'no files'}: {inside}")
    for name in names:
        path = packed.resolved(log / name)
        if path.is_file() and is_plain(path) and (missing := missing_half(path)) is not None:
            return InputError(f"{log}: {name} has {missing[0]} but no {missing[1]}: {_BOTH.format(missing[2])}")
    positions = f"; schuler points {log} makes positions of its satellite measurements" if satellites else ""
    return InputError(
        f"{log}: no log of an IMU is recognised among {listed(names) or 'no files'}: name the file and its columns, "
        f"--set recording.imu.file=NAME --set recording.imu.columns='\"t,ax,ay,az,gx,gy,gz\"'{positions}"
    )
