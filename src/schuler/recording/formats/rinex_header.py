"""RINEX files as lines of bytes: unpacked, told apart, their headers taken to pieces.

What both readers share. The lines are never cut into Python strings one by one: a file is one array of bytes with the
places of its lines, from which :meth:`RinexFile.columns` takes fixed columns of many lines at once.

Observation types: a type of RINEX 3 and 4 is a kind (C code, L phase, D Doppler, S strength), a band and an attribute:
``C1C``. RINEX 2 has a kind and a band only, and which signal was tracked is partly left to the reader. Assumed is:

=========  ==================================  =================================
RINEX 2    Systems                             Signal
=========  ==================================  =================================
C1         GPS, GLONASS, QZSS, SBAS            1C
C1, L1..   Galileo                             1X
C1, C2..   BeiDou (B1)                         2I
P1         GPS 1W, GLONASS 1P
C2         GPS, QZSS 2X (L2C), GLONASS 2C
P2         GPS 2W, GLONASS 2P
C5-C8      all                                 5X, 6X, 7X, 8X; BeiDou 7I, 6I
CA-CD      version 2.12                        1C, 1X, 2X, GLONASS 2C
=========  ==================================  =================================

Phase, Doppler and strength of band 1 go with C1 where the file has C1, else with P1; those of band 2 with P2 where the
file has it, else with C2. They may come from the other tracking loop of the band: the wavelength is the same.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import BoolArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.gnss.signals import SYSTEMS
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.io import lines

WIDEST = 1 << 14  # blanks after the last line, so that no window of columns runs out of the file
KINDS = {
    "O": "observations",
    "N": "navigation messages",
    "G": "GLONASS navigation messages",
    "H": "SBAS navigation messages",
    "E": "Galileo navigation messages",
    "L": "Galileo navigation messages",
    "J": "QZSS navigation messages",
    "M": "meteorological data",
    "C": "clocks",
    "B": "SBAS broadcast data",
}
_BLANK = 32
_VERSIONS = (2, 3, 4)
_FIRST, _END = "RINEX VERSION / TYPE", "END OF HEADER"
CODES = "CLDS"
_OLD_ATTRIBUTES = {
    ("E", "1"): "1X", ("C", "1"): "2I", ("C", "2"): "2I", ("C", "7"): "7I", ("C", "6"): "6I",
    ("G", "1"): "1C", ("R", "1"): "1C", ("J", "1"): "1C", ("S", "1"): "1C",
    ("G", "2"): "2X", ("R", "2"): "2C", ("J", "2"): "2X",
}  # fmt: skip
_OLD_PRECISE = {("G", "1"): "1W", ("G", "2"): "2W", ("R", "1"): "1P", ("R", "2"): "2P"}
_OLD_CIVIL = {"A": "1C", "B": "1X", "C": "2X", "D": "2C"}


@dataclass(frozen=True, slots=True)
class RinexFile:
    """A RINEX file in memory.

    Attributes
    ----------
    path : Path
    raw : bytes
        The text with line feeds only.
    chars : ndarray of uint8
        The same with :data:`WIDEST` blanks behind it.
    starts, ends : ndarray of int, shape (n_lines,)
        First byte and end of each line in ``raw``.
    body : int
        First line after the header.
    version : float
    kind : str
        Letter of the file's kind, see :data:`KINDS`.
    system : str
        Letter of its satellites' system; ``M`` for several, ``G`` where the file does not say.
    header : dict of str to list of str
        First 60 columns of the lines of each label.
    cut : bool
        Whether the last line has no end.
    notes : list of str
        Grows while the file is read.
    """

    path: Path
    raw: bytes
    chars: np.ndarray
    starts: IntArray
    ends: IntArray
    body: int
    version: float
    kind: str
    system: str
    header: dict[str, list[str]]
    cut: bool
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.starts)

    def text(self, line: int) -> str:
        """One line; any encoding will do, since only ASCII has a meaning."""
        return self.raw[self.starts[line] : self.ends[line]].decode("latin-1")

    def columns(self, at: IntArray, first: int | IntArray, width: int) -> np.ndarray:
        """Fixed columns of some lines, blank where a line is shorter. Shape (len(at), width), uint8."""
        begin = self.starts[at] + first
        length = self.ends[at] - begin
        # a start behind the end of a short line at the end of the file is still within the blanks
        windows: np.ndarray = np.lib.stride_tricks.sliding_window_view(self.chars, width)[begin]
        short = np.flatnonzero(length < width)
        if len(short):
            rows = windows[short]
            rows[np.arange(width) >= length[short, None]] = _BLANK
            windows[short] = rows
        return windows

    def first_text(self, label: str) -> str | None:
        """First 60 columns of the header's first line with a label."""
        texts = self.header.get(label)
        return texts[0] if texts else None

    def fault(self, message: str, line: int | None = None) -> FileFormatError:
        """The error for a line, counted from zero."""
        return FileFormatError(message, self.path, None if line is None else int(line) + 1)

    def reject(self, wrong: BoolArray, at: IntArray, expected: str) -> None:
        """Raise for the first line of ``at`` that is wrong, saying what was expected and what stands there."""
        if wrong.any():
            line = int(at[int(np.flatnonzero(wrong)[0])])
            raise self.fault(f"expected {expected}, got {lines.shorten(self.text(line))}", line)


def read_lines(path: Path | str) -> RinexFile:
    """A RINEX file, unpacked, with its header read.

    Parameters
    ----------
    path : Path or str
        Plain, or packed with gzip, bzip2, zip, compress (.Z) or Hatanaka's scheme (.crx, .YYd).

    Raises
    ------
    FileFormatError
        If the file is missing, empty, no text, no RINEX, of an unknown version, or ends within its header.
    InputError
        If it is packed in a way that needs a library which is not installed.
    """
    path = Path(path)
    notes: list[str] = []
    raw = unpack(path, notes)
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FileFormatError("expected ASCII text, got UTF-16: save the file as plain text", path)
    if b"\r" in raw:
        raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    version, kind, system = _first_line(raw, path)
    cut = not raw.endswith(b"\n")
    if cut:
        raw += b"\n"
    chars = np.frombuffer(raw + b" " * WIDEST, dtype=np.uint8)
    ends = np.flatnonzero(chars[: len(raw)] == 10)
    starts = np.concatenate(([0], ends[:-1] + 1))
    header, body = _header(raw, starts, ends, path)
    return RinexFile(path, raw, chars, starts, ends, body, version, kind, system, header, cut, notes)


def _first_line(raw: bytes, path: Path) -> tuple[float, str, str]:
    line = raw[:200].partition(b"\n")[0].decode("latin-1").rstrip()
    if line[60:].strip() != _FIRST:
        if b"\x00" in raw[:4096]:
            raise FileFormatError("expected RINEX text, got a binary file; convert it to RINEX first", path)
        raise FileFormatError(
            f"expected a RINEX file, whose first line has {_FIRST!r} from column 61 on, got {lines.shorten(line)}",
            path,
            1,
        )
    number = line[:9].strip()
    if not re.fullmatch(r"\d+(\.\d*)?", number) or int(float(number)) not in _VERSIONS:
        raise FileFormatError(f"expected RINEX version 2, 3 or 4, got {number!r}", path, 1)
    version, kind = float(number), line[20:21].upper()
    if kind not in KINDS:
        raise FileFormatError(
            f"expected the kind of file in column 21 (O: observations, N: navigation), got {kind!r}", path, 1
        )
    system = line[40:41].upper().strip() or {"G": "R", "H": "S", "E": "E", "L": "E", "J": "J"}.get(kind, "G")
    return version, kind, system


def _header(raw: bytes, starts: IntArray, ends: IntArray, path: Path) -> tuple[dict[str, list[str]], int]:
    header: dict[str, list[str]] = {}
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        line = raw[start:end].decode("latin-1")
        label = line[60:].strip()
        if label == _END:
            return header, k + 1
        if label == _FIRST and k > 0:
            raise FileFormatError(f"a second {_FIRST!r} before {_END!r}; are two files mixed up?", path, k + 1)
        header.setdefault(label, []).append(line[:60].ljust(60))
    raise FileFormatError(f"the header has no {_END!r}: the file is cut off or not RINEX", path, len(starts))


def header_numbers(file: RinexFile, label: str, width: int, count: int) -> tuple[float, ...] | None:
    """Numbers in equal columns of a header line, None if the line is missing or any number is."""
    text = file.first_text(label)
    return None if text is None else numbers_in(text, width, count)


def numbers_in(text: str, width: int, count: int, first: int = 0) -> tuple[float, ...] | None:
    """Numbers in equal columns of a text (D or E exponents), None if any is missing or no number."""
    values: list[Any] = [text[first + k * width : first + (k + 1) * width].strip() for k in range(count)]
    try:
        return tuple(float(v.upper().replace("D", "E")) for v in values)
    except ValueError:
        return None


def broadcast_leap_seconds(file: RinexFile) -> int | None:
    """GPS time minus UTC as the header has it, from BeiDou's count too. [s]"""
    text = file.first_text("LEAP SECONDS")
    if text is None or not text[:6].strip().isdecimal():
        return None
    # BeiDou counts from 2006, when GPS was 14 s ahead of UTC
    return int(text[:6].strip()) + (14 if text[24:27].strip() in ("BDS", "BDT") else 0)


@dataclass(frozen=True, slots=True)
class SystemTypes:
    """Observation types and signals of one system.

    Attributes
    ----------
    codes : tuple of str
        Types in the order of the file.
    columns : dict of str to dict of str to int
        For each signal, the places of its kinds (``C``, ``L``, ``D``, ``S``).
    """

    codes: tuple[str, ...]
    columns: dict[str, dict[str, int]]


def types_of(file: RinexFile) -> dict[str, SystemTypes]:
    """Observation types by the letter of the system.

    Raises
    ------
    FileFormatError
        If the header does not list them, or does so in a way that cannot be read.
    """
    if file.version < 3.0:
        codes = _old_types(file)
        return {system: _in_signals(codes, [_old_signal(c, system, codes) for c in codes]) for system in SYSTEMS}
    by_system = {}
    for system, codes in _new_types(file).items():
        if system not in SYSTEMS:
            continue
        named = [_new_signal(c, system, file.version) for c in codes]
        if named != [(c[0], c[1:]) for c in codes] and system == "C":
            file.notes.append("BeiDou's B1 is called 1I in version 3.02 and was taken as 2I, as in all others.")
        by_system[system] = _in_signals(codes, named)
    return by_system


def _in_signals(codes: list[str], named: list[tuple[str, str]]) -> SystemTypes:
    columns: dict[str, dict[str, int]] = {}
    for place, (kind, signal) in enumerate(named):
        if kind in CODES and signal:
            columns.setdefault(signal, {}).setdefault(kind, place)
    return SystemTypes(tuple(codes), columns)


def _new_types(file: RinexFile) -> dict[str, list[str]]:
    label = "SYS / # / OBS TYPES"
    codes_of: dict[str, list[str]] = {}
    counts: dict[str, int] = {}
    system = ""
    for text in file.header.get(label, []):
        if text[0] != " ":
            system, count = text[0].upper(), text[3:6].strip()
            if system in codes_of or not count.isdecimal():
                raise file.fault(f"{label}: expected one list with a count for each system, got {text.strip()!r}")
            counts[system], codes_of[system] = int(count), []
        if not system:
            raise file.fault(f"{label}: expected the letter of a system, got {text.strip()!r}")
        codes_of[system] += text[6:60].split()
    for system, codes in codes_of.items():
        if len(codes) != counts[system] or any(len(c) != 3 for c in codes):
            raise file.fault(
                f"{label}: expected {counts[system]} types such as C1C of system {system}, got {' '.join(codes)}"
            )
    if not codes_of:
        raise file.fault(f"the header has no {label!r}: is it a file of observations?")
    return codes_of


def _new_signal(code: str, system: str, version: float) -> tuple[str, str]:
    if system == "C" and round(version, 2) == 3.02 and code[1] == "1" and code[2] in "IQX":
        return code[0], "2" + code[2]
    return code[0], code[1:]


def _old_types(file: RinexFile) -> list[str]:
    label = "# / TYPES OF OBSERV"
    texts = file.header.get(label, [])
    if not texts or not texts[0][:6].strip().isdecimal():
        raise file.fault(f"the header has no {label!r} with their number: is it a file of observations?")
    count = int(texts[0][:6].strip())
    codes = [code for text in texts for code in text[6:60].split()]
    if len(codes) != count or any(len(c) != 2 for c in codes):
        raise file.fault(f"{label}: expected {count} types such as C1, got {' '.join(codes)}")
    return [c.upper() for c in codes]


def _old_signal(code: str, system: str, codes: list[str]) -> tuple[str, str]:
    """Kind and signal of a RINEX 2 type, ``""`` for a signal the system does not have."""
    kind, band = code[0], code[1]
    if band in _OLD_CIVIL:
        signal = _OLD_CIVIL[band]
        return (kind, signal) if (system, signal[0]) in _OLD_ATTRIBUTES or system == "E" else (kind, "")
    if kind == "P":
        return "C", _OLD_PRECISE.get((system, band), "")
    civil = _OLD_ATTRIBUTES.get((system, band), f"{band}X" if band in "5678" else "")
    precise = _OLD_PRECISE.get((system, band))
    if kind == "C" or precise is None:
        return kind, civil
    prefers_precise = band == "2" or f"C{band}" not in codes
    return kind, precise if prefers_precise and f"P{band}" in codes else civil
