"""The container of ArduPilot's DataFlash logs: messages whose layouts the log itself describes (FMT)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError

START = b"\xa3\x95"
_FMT, _FMT_LENGTH = 128, 89
#: NumPy type and factor of each letter of a format (libraries/AP_Logger/LogStructure.h).
LETTERS: dict[str, tuple[str, float]] = {
    "a": ("32<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0),
    "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "c": ("<i2", 1e-2), "C": ("<u2", 1e-2),
    "e": ("<i4", 1e-2), "E": ("<u4", 1e-2), "L": ("<i4", 1e-7), "M": ("u1", 1.0), "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}  # fmt: skip
_MOST_LOST = 0.01  # share of bytes outside of messages that is damage


@dataclass(frozen=True)
class Layout:
    """Name, size and fields of a kind of message; ``dtype`` is None if its description is not understood."""

    name: str
    length: int
    dtype: np.dtype[Any] | None
    factors: dict[str, float]


@dataclass(frozen=True)
class DataFlash:
    """A log as the places of its messages.

    Attributes
    ----------
    path : Path
    data : ndarray of uint8
        The file.
    layouts : dict of str to Layout
    places : dict of str to ndarray of int
        First byte of each message, by name.
    lost : int
        Bytes that belong to no message.
    cut : bool
        Whether the last message is incomplete.
    """

    path: Path
    data: np.ndarray[Any, np.dtype[np.uint8]]
    layouts: dict[str, Layout]
    places: dict[str, np.ndarray[Any, np.dtype[np.int64]]]
    lost: int
    cut: bool
    _rows: dict[str, np.ndarray[Any, np.dtype[Any]]] = field(default_factory=dict, repr=False, compare=False)

    def count(self, name: str) -> int:
        """Number of messages of a kind."""
        return len(self.places.get(name, ()))

    def fields(self, name: str) -> tuple[str, ...]:
        """Names of the fields of a kind of message; none if there is none of it."""
        layout = self.layouts.get(name)
        return () if layout is None or layout.dtype is None or not self.count(name) else layout.dtype.names or ()

    def columns(self, name: str, labels: tuple[str, ...] = ()) -> dict[str, FloatArray]:
        """Number fields of all messages of a kind, scaled by their letters. Shape (n,) each.

        Raises
        ------
        FileFormatError
            If there is no such message or it lacks a wanted field.
        """
        names = self.fields(name)
        if missing := [n for n in labels if n not in names]:
            raise FileFormatError(
                f"messages {name} have no {', '.join(missing)}; they have {', '.join(names)}", self.path
            )
        layout = self.layouts.get(name)
        if layout is None or (dtype := layout.dtype) is None or not names:
            raise FileFormatError(f"there are no messages {name} of a description that is understood", self.path)
        if name not in self._rows:
            # a window at every byte costs nothing; only those at messages are copied
            windows = np.lib.stride_tricks.sliding_window_view(self.data, layout.length)
            self._rows[name] = windows[self.places[name]][:, 3:].copy().view(dtype)[:, 0]
        rows = self._rows[name]
        picked = labels or tuple(n for n in names if dtype[n].kind in "iuf" and not dtype[n].shape)
        with np.errstate(invalid="ignore"):  # a signalling NaN of a damaged log; it is found out later
            return {n: rows[n].astype(np.float64) * layout.factors[n] for n in picked}


def load(path: Path) -> DataFlash:
    """Find the messages of a log.

    Raises
    ------
    FileFormatError
        If more than a hundredth of the file is no message, or a description contradicts another.
    """
    raw = path.read_bytes()
    size = len(raw)
    lengths = [0] * 256
    lengths[_FMT] = _FMT_LENGTH
    layouts: dict[int, Layout] = {}
    starts: list[list[int]] = [[] for _ in range(256)]
    at, lost, cut = 0, 0, False
    while at < size:
        if raw[at : at + 2] == START and at + 2 < size and (length := lengths[raw[at + 2]]):
            if at + length > size:
                cut = True
                break
            if raw[at + 2] == _FMT:
                number, layout = _described(raw[at + 3 : at + length])
                if number in layouts and layouts[number] != layout and starts[number]:
                    raise FileFormatError(f"byte {at}: messages {number} are described anew, and differently", path)
                if number != _FMT and layout.length > 3:
                    layouts[number] = layout
                    lengths[number] = layout.length
            starts[raw[at + 2]].append(at)
            at += length
        else:
            following = raw.find(START, at + 1)
            following = size if following < 0 else following
            lost += following - at
            at = following
    if lost > max(64, _MOST_LOST * size):
        raise FileFormatError(
            f"{lost} of {size} bytes belong to no message: the log is damaged, or no DataFlash log of ArduPilot", path
        )
    named = {layout.name: layout for layout in layouts.values()}
    places = {
        layout.name: np.array(starts[number], dtype=np.int64) for number, layout in layouts.items() if starts[number]
    }
    return DataFlash(path, np.frombuffer(raw, dtype=np.uint8), named, places, lost, cut)


def _described(body: bytes) -> tuple[int, Layout]:
    """Number and layout that a FMT message describes."""
    number, length = body[0], body[1]
    name, letters, labels = (
        part.rstrip(b"\x00").decode("ascii", "replace") for part in (body[2:6], body[6:22], body[22:86])
    )
    names = labels.split(",")
    types = [LETTERS.get(letter) for letter in letters]
    dtype, factors = None, dict[str, float]()
    if len(names) == len(letters) == len(set(names)) and all(names) and None not in types:
        forms = [(n, *form) for n, form in zip(names, types, strict=True) if form is not None]
        made = np.dtype([(n, ("<i2", 32)) if kind == "32<i2" else (n, kind) for n, kind, _ in forms])
        if made.itemsize == length - 3:
            dtype, factors = made, {n: factor for n, _, factor in forms}
    return number, Layout(name, length, dtype, factors)
