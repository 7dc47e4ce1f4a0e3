"""Records of a RINEX navigation file: lines of each message and the numbers in their fixed columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS
from schuler.recording.formats.rinex_columns import numbers, satellites, whole_seconds
from schuler.recording.formats.rinex_header import RinexFile
from schuler.recording.io import lines

_WIDTH, _A_LINE = 19, 4
_DATE_3 = ((4, 4), (9, 2), (12, 2), (15, 2), (18, 2), (21, 2))
_DATE_2 = ((3, 2), (6, 2), (9, 2), (12, 2), (15, 2), (17, 5))
#: Messages of version 4 that are laid out as the only ones of version 3 are, by system.
_KNOWN = {"G": ("LNAV",), "J": ("LNAV",), "E": ("INAV", "FNAV"), "C": ("D1", "D2", "D1D2"), "R": ("FDMA",)}
#: Messages of the modernised signals, and their lines.
_NEWER = {"G": {"CNAV": 9, "CNV2": 10}, "J": {"CNAV": 9, "CNV2": 10}, "C": {"CNV1": 10, "CNV2": 10, "CNV3": 9}}
_HEIGHTS = {"R": (4, 5)}  # the fifth line came with version 3.05
_KEPLER_HEIGHT = (8, 8)


@dataclass(frozen=True, slots=True)
class Records:
    """Messages of an RINEX file.

    Attributes
    ----------
    line : ndarray of int, shape (n,)
        First line of each.
    height : ndarray of int, shape (n,)
        Number of lines.
    sat : ndarray of int, shape (n,)
    ionosphere : list of tuple of str and int
        System and message, and first line, of each ionospheric message of version 4.
    newer : tuple of str, length n
        Name of the message where it is one of the modernised signals, else empty.
    """

    line: IntArray
    height: IntArray
    sat: IntArray
    ionosphere: list[tuple[str, int]]
    newer: tuple[str, ...]

    def of(self, system: str, newer: str = "") -> Records:
        """Those of one system; the modernised ones of a name apart."""
        mine = np.array([name == newer for name in self.newer], dtype=bool)
        k = np.flatnonzero((self.sat // 100 == SYSTEMS.index(system)) & mine)
        return Records(self.line[k], self.height[k], self.sat[k], [], (newer,) * len(k))


def records_of(file: RinexFile) -> Records:
    """Find the messages that can be used; all others are counted in the notes.

    Raises
    ------
    FileFormatError
        With the line, for what is no message or does not have as many lines as it should. A last message that is cut
        off is left out, with a note.
    """
    again = file.raw.find(b"RINEX VERSION / TYPE", 80)
    if again >= 0:
        raise file.fault(
            "a second header begins here: read the files one by one and join them (merged_with)",
            int(np.searchsorted(file.starts, again, side="right")) - 1,
        )
    if file.version >= 4.0:
        line, end, names, messages, ionosphere = _framed(file)
    else:
        line, end, ionosphere = *_unframed(file), []
        names, messages = file.columns(line, 0, 3), ["" for _ in line]
        if file.version < 3.0:  # a number without a letter in columns 1 and 2
            names = np.column_stack((np.full(len(line), 32, dtype=np.uint8), names[:, :2]))
    default = file.system if file.version < 3.0 else ""
    sat, wrong = satellites(names, "G" if default == "M" else default, SYSTEMS)
    file.reject(wrong, line, f"a satellite such as G05 (systems {SYSTEMS})")
    height = end - line
    if len(line) and _is_cut(file, int(line[-1]), int(height[-1]), SYSTEMS[int(sat[-1]) // 100], messages[-1]):
        _note_cut(file, int(line[-1]))
        line, height, sat, messages = line[:-1], height[:-1], sat[:-1], messages[:-1]
    if not len(line) and not ionosphere:
        raise file.fault("there is no complete message after the header")
    letters = [SYSTEMS[s // 100] for s in sat.tolist()]
    newer = [
        m if _NEWER.get(x, {}).get(m) == h else "" for x, m, h in zip(letters, messages, height.tolist(), strict=True)
    ]
    used = np.array(
        [bool(n) or (x in _KNOWN and m in ("", *_KNOWN[x])) for x, m, n in zip(letters, messages, newer, strict=True)],
        dtype=bool,
    )
    passed = [f"{SYSTEM_NAMES[x]} {m}".strip() for x, m, u in zip(letters, messages, used, strict=True) if not u]
    if passed:
        counts = ", ".join(f"{passed.count(name)} {name}" for name in sorted(set(passed)))
        file.notes.append(f"Messages that are not used: {counts}.")
    for k in np.flatnonzero(used).tolist():
        low, high = _HEIGHTS.get(letters[k], _KEPLER_HEIGHT)
        if not newer[k] and not low <= height[k] <= high:
            raise file.fault(f"expected a message of {high} lines, got {height[k]}", int(line[k]))
    names_used = tuple(n for n, u in zip(newer, used, strict=True) if u)
    return Records(line[used], height[used], sat[used], ionosphere, names_used)


def dates(file: RinexFile, records: Records) -> IntArray:
    """Reference times of the clocks, seconds since 1980-01-06 of the file's own scale. Shape (n,). [s]"""
    layout = _DATE_2 if file.version < 3.0 else _DATE_3
    values, wrong = zip(*(numbers(file.columns(records.line, first, width)) for first, width in layout), strict=True)
    whole, part, impossible = whole_seconds(np.stack(values, axis=1))
    file.reject(np.any(wrong, axis=0) | impossible, records.line, "date and time of a message")
    return whole + np.round(part).astype(np.int64)


def fields(file: RinexFile, records: Records, height: int) -> FloatArray:
    """Numbers of messages: three of the first line, four of each other; NaN for blanks. Shape (n, 4 height - 1)."""
    margin = 3 if file.version < 3.0 else 4
    at = records.line[:, None] + np.arange(height)
    chars = file.columns(at.ravel(), margin, _WIDTH * _A_LINE)
    values, wrong = numbers(chars.reshape(-1, height * _A_LINE, _WIDTH))
    wrong[:, 0] = False  # satellite's date, read elsewhere
    if wrong.any():
        row, column = (int(k) for k in np.argwhere(wrong)[0])
        line, first = int(at[row, column // _A_LINE]), margin + _WIDTH * (column % _A_LINE)
        raise file.fault(
            f"expected a number in columns {first + 1} to {first + _WIDTH}, got "
            f"{file.text(line)[first : first + _WIDTH]!r}; is the line shifted?",
            line,
        )
    return values[:, 1:]


def _unframed(file: RinexFile) -> tuple[IntArray, IntArray]:
    """First lines of messages, which are those without blanks at their start, and the ends of the messages."""
    body = np.arange(file.body, len(file))
    begins = (file.columns(body, 0, 2) != 32).any(axis=1)
    filled = file.ends[body] > file.starts[body]
    if len(body) and not begins[0] and filled[0]:
        raise _no_message(file, int(body[0]))
    line, end = body[begins], len(file)
    if len(line) and file.cut and line[-1] == end - 1:
        end = int(line[-1])
        _note_cut(file, end)
        line = line[:-1]
    return line, _ends(file, line, end)


def _framed(file: RinexFile) -> tuple[IntArray, IntArray, np.ndarray, list[str], list[tuple[str, int]]]:
    """The same for version 4, whose messages have a line before them that says what they are."""
    body = np.arange(file.body, len(file))
    mark = body[file.chars[file.starts[body]] == ord(">")]
    if len(body) and (not len(mark) or mark[0] != body[0]) and file.text(file.body).strip():
        raise _no_message(file, file.body)
    last = len(file)
    if len(mark) and file.cut and mark[-1] == last - 1:
        last = int(mark[-1])
        _note_cut(file, last)
        mark = mark[:-1]
    heads = [file.text(k).ljust(20) for k in mark.tolist()]
    kinds = [head[2:5] for head in heads]
    end = _ends(file, mark, last)
    ionosphere = [
        (head[6] + " " + head[10:14].strip(), int(k) + 1) for head, kind, k in zip(heads, kinds, mark, strict=True)
        if kind == "ION"
    ]  # fmt: skip
    others = {kind: kinds.count(kind) for kind in sorted(set(kinds)) if kind not in ("EPH", "ION")}
    for kind, count in others.items():
        if kind not in ("STO", "EOP"):
            raise file.fault(f"expected '> EPH', STO, EOP or ION, got {kind!r}", int(mark[kinds.index(kind)]))
        file.notes.append(f"Records that are not used: {count} {kind}.")
    is_orbit = np.array([kind == "EPH" for kind in kinds], dtype=bool)
    line = mark[is_orbit] + 1
    names = file.columns(mark[is_orbit], 6, 3)
    return (
        line,
        end[is_orbit],
        names,
        [h[10:14].strip() for h, k in zip(heads, kinds, strict=True) if k == "EPH"],
        (ionosphere),
    )


def _ends(file: RinexFile, first: IntArray, n_lines: int) -> IntArray:
    """Line behind each message: that of the next one, but for blank lines before it."""
    end = np.append(first[1:], n_lines)
    blank = np.array([not file.text(k - 1).strip() for k in end.tolist()], dtype=bool)
    for k in np.flatnonzero(blank).tolist() if len(first) else ():
        while end[k] > first[k] + 1 and not file.text(int(end[k]) - 1).strip():
            end[k] -= 1
    return end[: len(first)]


def _is_cut(file: RinexFile, line: int, height: int, system: str, message: str) -> bool:
    if any(file.text(k).strip() for k in range(line + height, len(file))):
        return False  # something else follows
    needed = _HEIGHTS.get(system, _KEPLER_HEIGHT)[0]
    if system == "S":
        needed = 4
    needed = _NEWER.get(system, {}).get(message, needed)
    if message in ("", *_KNOWN.get(system, ()), *_NEWER.get(system, ())) and height < needed:
        return True
    margin = 3 if file.version < 3.0 else 4
    return file.cut and line + height == len(file) and (len(file.text(len(file) - 1)) - margin) % _WIDTH != 0


def _no_message(file: RinexFile, line: int) -> FileFormatError:
    form = "'> EPH G01 LNAV'" if file.version >= 4.0 else "a satellite and a date"
    return file.fault(f"expected the start of a message, {form}, got {lines.shorten(file.text(line))}", line)


def _note_cut(file: RinexFile, line: int) -> None:
    file.notes.append(f"The file ends within the message of line {line + 1}, which was left out.")
