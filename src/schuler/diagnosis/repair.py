"""Text logs with rows that no reader takes: left out or sorted, so that the rest can be judged, and said."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np

from schuler.diagnosis.result import Finding
from schuler.exceptions import FileFormatError
from schuler.recording.formats import rtklib, text
from schuler.recording.io import dispatch, lines
from schuler.recording.io.assemble import recording_from
from schuler.recording.io.hint_texts import factor, parse_units
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import HUGE, Raw
from schuler.recording.io.text_head import open_text
from schuler.recording.recording import Recording


def repaired(path: Path, hints: ReadHints) -> tuple[Recording, list[Finding]]:
    """A table with rows left out that have no number or whose time does not increase, and findings on them.

    Parameters
    ----------
    path : Path
    hints : ReadHints

    Raises
    ------
    SchulerError
        If that is not what is wrong with it.
    """
    with dispatch.guarded(path):
        with path.open("rb") as stream:
            head = stream.read(65536)
        if lines.is_binary(head):
            raise FileFormatError("only text can be repaired", path)
        if path.suffix.lower() == ".pos" or rtklib.looks_like_pos(head):
            return _repaired_pos(path, hints)
        findings: list[Finding] = []
        parts = []
        for raw, own in text.tables(open_text(path, hints), hints):
            own_findings = _without_missing(raw)
            if "t" in raw.values:
                unit = parse_units(own.units, own.kind).get("t") or raw.stated.get("t") or "s"
                own_findings += _in_order(raw, factor(unit, "t", own.kind))
            if not all(map(len, raw.values.values())):
                raise FileFormatError("no row is left without those that hold no number", path)
            parts.append(recording_from(raw, own))
            findings += [f for f in own_findings if f.code not in [other.code for other in findings]]
        return text.joined(parts, hints), findings


def _without_missing(raw: Raw) -> list[Finding]:
    names = list(raw.values)
    bad = np.zeros(len(raw.values[names[0]]), dtype=bool)
    where = []
    for name in names:
        wrong = ~(np.abs(raw.values[name]) <= HUGE)
        if wrong.any():
            where.append(name)
        bad |= wrong
    if not bad.any():
        return []
    raw.keep(np.flatnonzero(~bad))
    text_ = f"{int(bad.sum())} rows hold values that are no numbers ({', '.join(where)}); they were left out here"
    evidence = {"rows": int(bad.sum()), "columns": where}
    return [Finding("missing", "error", text_, 1.0, "fill or delete these rows", evidence)]


def _in_order(raw: Raw, unit: float) -> list[Finding]:
    """Sort rows by their stamps, in a unit of so many seconds, and leave repeated ones out."""
    t = raw.values["t"]
    findings = []
    step = np.diff(t)
    same = int(np.count_nonzero(step == 0.0))
    back = np.flatnonzero(step < 0.0)
    if len(back):
        k = int(back[0])
        text_ = (
            f"time stamps go back {len(back)} times, first after {unit * t[k]:.6f} s (to {unit * t[k + 1]:.6f} s): "
            "rows were swapped, two runs were joined, or a counter wrapped around"
        )
        evidence = {"times": len(back), "at_s": float(unit * t[k]), "by_s": float(-unit * step[k])}
        findings.append(Finding("backward_times", "error", text_, 1.0, "sort the log, or cut it there", evidence))
    order = np.argsort(t, kind="stable")
    raw.keep(order)
    t = raw.values["t"]
    first = np.concatenate(([True], np.diff(t) > 0.0))
    again = int(np.count_nonzero(~first))
    if again:
        same = again
    if same:
        k = int(np.flatnonzero(~first)[0])
        text_ = (
            f"{same} rows repeat the time of another one, first {unit * t[k]:.6f} s: rows were written twice, or the "
            f"clock is too "
            "coarse for the rate"
        )
        fix = "delete the repeated rows; or leave the stamps out and say rate=..."
        findings.append(Finding("duplicates", "error", text_, 1.0, fix, {"rows": same, "at_s": float(unit * t[k])}))
    raw.keep(np.flatnonzero(first))
    return findings


def _repaired_pos(path: Path, hints: ReadHints) -> tuple[Recording, list[Finding]]:
    """An RTKLIB solution with its rows sorted and repeated ones left out."""
    lines = path.read_text(encoding="latin-1").splitlines()
    head = [line for line in lines if line.startswith("%")]
    rows = [line for line in lines if line.strip() and not line.startswith("%")]
    keys = [" ".join(row.split()[:2]) for row in rows]
    order = sorted(range(len(rows)), key=lambda k: keys[k])
    findings = []
    back = sum(b < a for a, b in itertools.pairwise(keys))
    if back:
        text_ = f"the epochs of the solution go back {back} times"
        findings.append(Finding("backward_times", "error", text_, 1.0, "sort the log", {"times": back}, "gnss"))
    unique: list[int] = []
    again = 0
    for k in order:
        if unique and keys[unique[-1]] == keys[k]:
            again += 1
        else:
            unique.append(k)
    if again:
        text_ = f"{again} epochs of the solution are there twice"
        fix = "delete the repeated rows"
        findings.append(Finding("duplicates", "error", text_, 1.0, fix, {"rows": again}, "gnss"))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_text("\n".join([*head, *(rows[k] for k in unique)]) + "\n", encoding="latin-1")
        return dispatch.read_one(copy, hints), findings
