"""Files that lie beside logs and are none: what they are, so that a refusal can say it."""

from __future__ import annotations

import json
import re
from pathlib import Path

_MAGIC = {
    b"\x1f\x8b": "compressed (gzip): unpack it",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"%PDF": "a PDF document",
    b"TIMETAG RTKLIB": "RTKLIB's time tags of another file: give that one, its name without .tag",
}
_DOCUMENTS = (".md", ".rst", ".html")
_WORD = re.compile(r"[A-Za-z]{2,}")
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(e[-+]?\d+)?$", re.IGNORECASE)
_MOST = 65536


def not_a_log(path: Path) -> str | None:
    """What a file is that is no log, in a few words; None if it may be one.

    Parameters
    ----------
    path : Path
        That no reader took.
    """
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        head = stream.read(_MOST)
    if not head.strip():
        return "empty"
    for magic, what in _MAGIC.items():
        if head.startswith(magic):
            return what
    if b"\x00" in head:
        return None
    if path.suffix.lower() in _DOCUMENTS or path.name.upper() in ("README", "LICENSE"):
        return "text for people to read, not numbers"
    text = head.decode("utf-8", errors="replace").strip()
    if text[0] in "{[" and _is_json(text, complete=len(head) < _MOST):
        return "a JSON file: settings, labels or results, not samples"
    lines = [line for line in text.splitlines() if line.strip()][:60]
    prose = sum(map(_is_prose, lines))
    table = sum(map(_is_numbers, lines))
    if prose > 0 and table < 3 and prose >= 0.5 * len(lines):
        return "text for people to read, not numbers"
    return None


def _is_json(text: str, *, complete: bool) -> bool:
    try:
        json.loads(text)
    except json.JSONDecodeError:
        return not complete and text[:2].strip() in ("{", '{"', "[", "[{")
    return True


def _is_prose(line: str) -> bool:
    """Words with blanks between them, more than anything else."""
    parts = line.split()
    words = sum(bool(_WORD.search(part)) for part in parts)
    return words >= 3 and words > 0.6 * len(parts) and line.count(",") < 0.5 * len(parts)


def _is_numbers(line: str) -> bool:
    parts = [part for part in re.split(r"[,;\s]+", line.strip()) if part]
    return len(parts) > 0 and all(_NUMBER.match(part) for part in parts)
