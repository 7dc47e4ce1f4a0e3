"""Damaged rows of a text table: left out where they are few, as ``bad_lines`` says it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schuler.exceptions import SchulerError
from schuler.proposal.decision import Decision
from schuler.proposal.files import Files
from schuler.proposal.hints import is_plain
from schuler.recording.formats import text
from schuler.recording.io import packed
from schuler.recording.io.garbled import is_sound
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import Raw
from schuler.recording.io.text_head import open_text

_SHARE = 0.01  # of the rows of a table that are left out unasked


def leave_out_garbled(files: Files, given: Mapping[str, Any]) -> bool:
    """Put ``bad_lines`` into the hints of tables that can be read only so; whether there were any.

    Parameters
    ----------
    files : Files
        Changed in place, decisions too.
    given : mapping
        Hints that stand.
    """
    done = False
    for part, entry in list(files.entries.items()) if files.by_part else [("", files.entries)]:
        stated = given.get(part, {}) if part else given
        if not isinstance(entry, Mapping) or "bad_lines" in entry or "bad_lines" in stated:
            continue
        path = packed.resolved(files.log / str(entry["file"])) if "file" in entry else files.log
        if not path.is_file() or not is_plain(path) or _tables(path, entry):
            continue
        if mended := _tables(path, {**entry, "bad_lines": _SHARE}):
            notes = [note for raw in mended for note in raw.notes if "left out" in note or "sorted" in note]
            why = "it cannot be read without: " + " ".join(dict.fromkeys(notes)).rstrip(".")
            new = {**entry, "bad_lines": _SHARE}
            files.entries = {**files.entries, part: new} if part else new
            label = f"recording.{part}.bad_lines" if part else "recording.bad_lines"
            files.decisions.append(Decision(label, _SHARE, why))
            done = True
    return done


def _tables(path: Path, entry: Mapping[str, Any]) -> list[Raw]:
    """Tables of a file whose rows are sound; none if a line is garbled or a row is no later than the one before."""
    try:
        hints = ReadHints.of(**{name: value for name, value in entry.items() if name != "file"})
        raws = [raw for raw, _ in text.tables(open_text(path, hints), hints)]
    except SchulerError:
        return []
    return raws if all(map(is_sound, raws)) else []
