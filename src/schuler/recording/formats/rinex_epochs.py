"""Epochs of a RINEX observation file, and the lines of their satellites.

Versions 3 and 4 mark the lines of epochs, so there is no loop over them. In version 2 each epoch says how far it is to
the next one: that loop reads two numbers of each, and all else is done for all lines at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.gnss.signals import SYSTEMS
from schuler.recording.formats.rinex_columns import numbers, satellites, whole_seconds
from schuler.recording.formats.rinex_header import RinexFile
from schuler.recording.io import lines

_TYPES = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV", "SYS / SCALE FACTOR")
_DATE_3 = ((2, 4), (7, 2), (10, 2), (13, 2), (16, 2), (18, 11))
_DATE_2 = ((1, 2), (4, 2), (7, 2), (10, 2), (13, 2), (15, 11))
_CLOCK_3, _CLOCK_2 = (41, 15), (68, 12)
_SATELLITES_A_LINE = 12
_OBSERVATIONS_A_LINE = 5
_FIELD, _VALUE = 16, 14  # columns of an observation with its two digits, and without
_FORM_2, _FORM_3 = " yy mm dd hh mm ss.sssssss  flag count", "> yyyy mm dd hh mm ss.sssssss  flag count"


@dataclass(frozen=True, slots=True)
class Epochs:
    """Epochs of observations, and one record for each satellite of each of them.

    Attributes
    ----------
    whole : ndarray of int, shape (k,)
        Whole seconds since 1980-01-06 of the file's own time scale. [s]
    part : ndarray, shape (k,)
        The rest. [s]
    clock : ndarray, shape (k,)
        Receiver clock offset, NaN where there is none. [s]
    line : ndarray of int, shape (k,)
        The epoch's line.
    epoch : ndarray of int, shape (n,)
        Epoch of each record.
    record : ndarray of int, shape (n,)
        First line of each record's observations.
    sat : ndarray of int, shape (n,)
    """

    whole: IntArray
    part: FloatArray
    clock: FloatArray
    line: IntArray
    epoch: IntArray
    record: IntArray
    sat: IntArray


def epochs_of(file: RinexFile, types_a_satellite: int) -> Epochs:
    """Find the epochs and the records of satellites.

    Parameters
    ----------
    file : RinexFile
    types_a_satellite : int
        Length of the list of types of a RINEX 2 file, which says how many lines a satellite has.

    Raises
    ------
    FileFormatError
        With the line, where the file does not go on as its epochs say. A file that ends within an epoch is read up to
        the one before, with a note.
    """
    old = file.version < 3.0
    height = max(1, -(-types_a_satellite // _OBSERVATIONS_A_LINE)) if old else 1
    at, count = _by_counting(file, height) if old else _by_mark(file)
    date, clock = (_DATE_2, _CLOCK_2) if old else (_DATE_3, _CLOCK_3)
    values, wrong = zip(*(numbers(file.columns(at, first, width)) for first, width in date), strict=True)
    whole, part, impossible = whole_seconds(np.stack(values, axis=1))
    form = _FORM_2 if old else _FORM_3
    file.reject(np.any(wrong, axis=0) | impossible, at, f"the date of an epoch, {form!r}")
    offset, wrong_offset = numbers(file.columns(at, *clock))
    file.reject(wrong_offset, at, "a receiver clock offset in the columns behind the satellites")
    epoch = np.repeat(np.arange(len(at)), count)
    place = np.arange(len(epoch)) - np.repeat(np.cumsum(count) - count, count)
    if old:
        heads = np.maximum(1, -(-count // _SATELLITES_A_LINE))
        record = at[epoch] + heads[epoch] + place * height
        named = at[epoch] + place // _SATELLITES_A_LINE
        names = file.columns(named, 32 + 3 * (place % _SATELLITES_A_LINE), 3)
    else:
        record = named = at[epoch] + 1 + place
        names = file.columns(record, 0, 3)
    default = "G" if file.system == "M" else file.system
    sat, unknown = satellites(names, default if old else "", SYSTEMS)
    file.reject(unknown, named, f"a satellite such as G05 (systems {SYSTEMS})" + (" in the list" if old else ""))
    return Epochs(whole, part, offset, at, epoch, record, sat)


def _by_mark(file: RinexFile) -> tuple[IntArray, IntArray]:
    """Lines of the epochs of versions 3 and 4, which start with a mark, and their numbers of satellites."""
    marked = file.chars[file.starts] == ord(">")
    marked[: file.body] = False
    at, end = np.flatnonzero(marked), len(file)
    if len(at) and file.cut and at[-1] == end - 1:
        end = int(at[-1])  # the line of the epoch may be cut itself
        _note_cut(file, end)
        at = at[:-1]
    _reject_strays(file, np.arange(file.body, at[0] if len(at) else end))
    flag, wrong_flag = numbers(file.columns(at, 31, 1))
    stated, wrong = numbers(file.columns(at, 32, 3))
    flag = np.nan_to_num(flag).astype(np.int64)  # a blank is a zero
    wrong |= wrong_flag | np.isnan(stated) | (stated < 0) | (flag > 6)
    file.reject(wrong, at, f"an event flag and a number of satellites in columns 32 to 35 of {_FORM_3!r}")
    count = np.where(np.isnan(stated), 0, stated).astype(np.int64)
    present = np.append(at[1:], end)[: len(at)] - at - 1
    for k in np.flatnonzero(present > count).tolist():
        _reject_strays(file, np.arange(at[k] + 1 + count[k], at[k] + 1 + present[k]))
    fewer = present < count
    if len(at) and (fewer[-1] or (at[-1] + count[-1] == end - 1 and _cut_within_a_value(file))):
        _note_cut(file, int(at[-1]))
        at, flag, count, present, fewer = at[:-1], flag[:-1], count[:-1], present[:-1], fewer[:-1]
    if fewer.any():
        file.notes.append(
            f"{np.sum(fewer)} epochs have fewer lines than they say, the first in line {at[np.argmax(fewer)] + 1}; the "
            "lines there are were used."
        )
        count = np.minimum(count, present)
    for k in np.flatnonzero((flag >= 2) & (flag <= 5)).tolist():
        _check_event(file, int(at[k]) + 1, int(at[k]) + 1 + int(count[k]))
    _note_events(file, {str(f): int(np.sum(flag == f)) for f in range(1, 7)})
    used = flag <= 1
    return at[used], count[used]


def _by_counting(file: RinexFile, height: int) -> tuple[IntArray, IntArray]:
    """Lines of the epochs of version 2, where each says how many lines to the next, and their numbers of satellites."""
    raw, starts, n_lines = file.raw, file.starts.tolist(), len(file)
    at: list[int] = []
    counts: list[int] = []
    events = dict.fromkeys("123456", 0)
    line = file.body
    while line < n_lines:
        head = raw[starts[line] : starts[line] + 32].partition(b"\n")[0]
        if not head.strip():
            line += 1
            continue
        flag = head[28:29].decode("latin-1").strip() or "0"
        try:
            count = int(head[29:])
        except ValueError:
            count = -1
        if count < 0 or flag not in "0123456":
            if line == n_lines - 1 and file.cut:
                _note_cut(file, line)
                break
            raise _no_epoch(file, line)
        size = count if flag in "2345" else max(1, -(-count // _SATELLITES_A_LINE)) - 1 + count * height
        end = line + 1 + size
        if end > n_lines or (end == n_lines and _cut_within_a_value(file)):
            _note_cut(file, line)
            break
        if flag in "01":
            at.append(line)
            counts.append(count)
        elif flag in "2345":
            _check_event(file, line + 1, end)
        if flag != "0":
            events[flag] += 1
        line = end
    _note_events(file, events)
    return np.array(at, dtype=np.int64), np.array(counts, dtype=np.int64)


def _reject_strays(file: RinexFile, at: IntArray) -> None:
    for line in at.tolist():
        if file.text(line).strip():
            raise _no_epoch(file, line)


def _no_epoch(file: RinexFile, line: int) -> FileFormatError:
    text = file.text(line)
    if text[60:].strip() == "RINEX VERSION / TYPE":
        return file.fault("a second header begins here: read the files one by one, or join them with a tool", line)
    form = _FORM_2 if file.version < 3.0 else _FORM_3
    return file.fault(
        f"expected the line of an epoch, {form!r}, after as many lines as the epoch before says, "
        f"got {lines.shorten(text)}",
        line,
    )


def _cut_within_a_value(file: RinexFile) -> bool:
    """Whether a file without an end of its last line may have lost digits, and not only fields."""
    if not file.cut:
        return False
    text = file.text(len(file) - 1)
    name = 3 if file.version >= 3.0 else 0
    within = (len(text) - name) % _FIELD
    return len(text) < name or (0 < within < _VALUE and text[-within:].strip() != "")


def _note_cut(file: RinexFile, line: int) -> None:
    file.notes.append(f"The file ends within the epoch of line {line + 1}, which was left out.")


def _check_event(file: RinexFile, first: int, end: int) -> None:
    """Header lines within the file must not change how it is to be read."""
    for line in range(first, end):
        text = file.text(line)
        label = text[60:].strip()
        if label in _TYPES and text[:60].ljust(60) not in file.header.get(label, []):
            raise file.fault(f"{label} changes here, within the file: split the file before this epoch", line)


def _note_events(file: RinexFile, events: dict[str, int]) -> None:
    names = {
        "1": "power failures before an epoch, whose observations are used",
        "2": "starts of motion",
        "3": "new sites",
        "4": "blocks of header lines or comments",
        "5": "external events",
        "6": "records of cycle slips",
    }
    counts = [f"{events[flag]} {name}" for flag, name in names.items() if events[flag]]
    if counts:
        file.notes.append(f"Passed over within the file: {'; '.join(counts)}.")
