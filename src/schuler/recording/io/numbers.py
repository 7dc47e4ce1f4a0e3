"""Tables of numbers in text files, a piece of the file at a time, by compiled code on every core.

What the compiled code does not understand it leaves to :mod:`schuler.recording.io.lines`, which knows all there is to
know of text files and says what is wrong with a line. Numbers are those of Python's ``float``, to the last bit.
"""

from __future__ import annotations

import functools
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import numpy as np

from schuler.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from schuler.recording.io.lines import TextTable

_PIECE = 1 << 21  # bytes read at a time: with its numbers it stays in the caches
_MOST_THREADS = 4
_MARGIN = 1.02  # rows expected beyond those the first piece lets expect

Bytes = np.ndarray[Any, np.dtype[np.uint8]]
_Buffers = tuple[FloatArray, IntArray, IntArray]
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Numbers:
    """Rows that were read.

    Attributes
    ----------
    values : ndarray, shape (k, n)
        A row for each wanted column.
    stamps : ndarray of int64, shape (n,)
        The column of whole numbers, empty if none was asked for.
    rest : int
        Byte at which the first line begins that was not understood; the file's size if all were.
    """

    values: FloatArray
    stamps: IntArray
    rest: int


def read_numbers(
    table: TextTable, n_columns: int, used: list[int], *, decimals: int | None = None, rounded: bool = False
) -> Numbers | None:
    """Numbers of the used columns of a table up to the first line that is not plain.

    Parameters
    ----------
    table : TextTable
    n_columns : int
        Fields every line must have.
    used : list of int
        Columns wanted as doubles, counted from zero, in the order wanted; others may hold words.
    decimals : int, optional
        Read column 0 (which is not among ``used``) as whole multiples of 10^-decimals.
    rounded : bool
        Let these be rounded, half to even; otherwise a line with more decimals is not understood.

    Returns
    -------
    Numbers or None
        ``None`` if the way the table is cut is not one of the compiled code.
    """
    from schuler.recording.io import _kernels

    if (rules := _rules(table)) is None:
        return None
    _kernels.prepare_lines()
    comment = np.frombuffer(table.comment.encode("ascii"), dtype=np.uint8)
    target = np.full(n_columns, _kernels.SKIPPED)
    target[used] = np.arange(len(used))
    if decimals is not None:
        target[0] = _kernels.WHOLE
    decimal = table.decimal.encode("ascii")
    fixed = (rules, comment, target, decimals or 0, rounded, *_tables())

    buffers: list[_Buffers] = []
    least = 2 * n_columns  # bytes of a row

    def parse(place: tuple[int, bytes]) -> tuple[int, int, bool, _Buffers]:
        """End of what was understood of a piece, its rows, whether that is all of it, and where they are."""
        at, piece = place
        if decimal != b".":
            piece = piece.replace(decimal, b".")
        n = len(piece) // least + 1
        # pieces are of much the same size, so that the next one fits into what another one has left
        into = buffers.pop() if buffers else None
        if into is None or into[0].shape[1] < n:
            n += n // 8
            into = np.empty((len(used), n)), np.empty(n, dtype=np.int64), np.empty((n, 4), dtype=np.int64)
        rows, n_odd, end = _kernels.read_lines(np.frombuffer(piece, dtype=np.uint8), *fixed, *into)
        for row, k, begin, stop in into[2][:n_odd].tolist():
            into[0][k, row] = float(piece[begin:stop])
        return at + end, rows, end == len(piece), into

    buffer = _Gathered(len(used), decimals is not None)
    threads = min(os.cpu_count() or 1, _MOST_THREADS)
    with table.path.open("rb") as stream, ThreadPoolExecutor(threads) as pool:
        size = os.fstat(stream.fileno()).st_size
        if (start := _skip(stream, table)) is None:
            return None
        rest = start
        for rest, rows, complete, into in _in_order(pool, parse, _pieces(stream, start), threads):
            buffer.take(into[0], into[1], rows, (size - start) / (rest - start + 1))
            buffers.append(into)
            if not complete:
                break
    return Numbers(*buffer.all(), min(rest, size))


def _in_order(
    pool: ThreadPoolExecutor, work: Callable[[_Item], _Result], items: Iterable[_Item], ahead: int
) -> Iterator[_Result]:
    """Results of some work in the order of what it is done on, which is taken only a little ahead."""
    waiting: deque[Future[_Result]] = deque()
    for item in items:
        waiting.append(pool.submit(work, item))
        if len(waiting) > ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


class _Gathered:
    """Arrays that grow by the numbers of pieces; more memory is asked for than is used, which costs none."""

    def __init__(self, columns: int, whole: bool) -> None:
        self.n = 0
        self.values = np.empty((columns, 0))
        self.stamps = np.empty(0, dtype=np.int64)
        self.whole = whole

    def take(self, values: FloatArray, stamps: IntArray, rows: int, times: float) -> None:
        """Take over the first rows of a piece that is ``times`` smaller than the file."""
        end = self.n + rows
        if end > self.values.shape[1]:
            room = end + end // 2 if self.n else max(end, int(_MARGIN * rows * times) + 1000)
            old, whole = self.values, self.stamps
            self.values = np.empty((len(old), room))
            self.values[:, : self.n] = old[:, : self.n]
            if self.whole:
                self.stamps = np.empty(room, dtype=np.int64)
                self.stamps[: self.n] = whole[: self.n]
        self.values[:, self.n : end] = values[:, :rows]
        if self.whole:
            self.stamps[self.n : end] = stamps[:rows]
        self.n = end

    def all(self) -> tuple[FloatArray, IntArray]:
        """The rows that were taken."""
        return self.values[:, : self.n], self.stamps[: self.n]


def _pieces(stream: BinaryIO, at: int) -> Iterator[tuple[int, bytes]]:
    """Whole lines from a place in a file on, and where each piece begins; a last line gets an end if it has none."""
    stream.seek(at)
    kept = b""
    while block := stream.read(_PIECE):
        end = block.rfind(b"\n") + 1
        if not end:  # a line longer than a piece is for other code
            yield at, b"\x00\n"
            return
        piece, kept = kept + block[:end], block[end:]
        yield at, piece
        at += len(piece)
    if kept:
        yield at, kept + b"\n"


def _skip(stream: BinaryIO, table: TextTable) -> int | None:
    """Place of the first line in a file; ``None`` if its lines may end otherwise than by line feeds."""
    at = len(stream.read(3)) if table.encoding == "utf-8-sig" else 0
    stream.seek(at)
    for _ in range(table.first - 1):
        line = stream.readline(_PIECE)
        if b"\r" in line.removesuffix(b"\r\n") or not line.endswith(b"\n"):
            return None
        at += len(line)
    return at


def _rules(table: TextTable) -> Bytes | None:
    """Class of each character; ``None`` for ways to cut lines that the compiled code does not know."""
    from schuler.recording.io import _kernels as k

    special = table.delimiter + table.replaced + table.comment[:1] + table.decimal.replace(".", "")
    if (
        len(table.delimiter) != 1
        or not table.comment.isascii()
        or len(set(special)) != len(special)
        or any(not c.isascii() or c.isalnum() or c in '+-."\r\n' for c in special)
        or not table.comment.isprintable()
        or (table.comment[:1].isspace())
    ):
        return None
    blanks = table.delimiter == " "
    rules = np.full(256, k.BAD, dtype=np.uint8)
    rules[33:127] = k.OTHER
    rules[127:] = k.BAD if blanks else k.OTHER  # among them are blanks of other alphabets
    rules[[ord(c) for c in "0123456789+-.eE"]] = k.NUMBER
    rules[ord('"')] = k.BAD
    rules[[ord(c) for c in " \t" + table.replaced]] = k.DELIMITER if blanks else k.BLANK
    rules[ord(table.delimiter)] = k.DELIMITER
    rules[ord("\r")], rules[ord("\n")] = k.RETURN, k.END
    rules[ord(table.comment[0])] = k.COMMENT
    return rules


@functools.cache
def _tables() -> tuple[np.ndarray[Any, Any], ...]:
    """Powers of ten to 128 bits, of two, and of ten as doubles and whole numbers, for the compiled code."""
    from schuler.recording.io import _kernels

    tens = np.empty((_kernels.MOST - _kernels.LEAST + 1, 2), dtype=np.uint64)
    for k in range(len(tens)):
        q = k + _kernels.LEAST
        above, below = (10**q, 1) if q >= 0 else (1, 10**-q)
        shift = 128 - above.bit_length() + below.bit_length()
        bits = (above << shift) // below if shift >= 0 else (above >> -shift) // below
        bits >>= bits.bit_length() - 128
        tens[k] = bits >> 64, bits & (2**64 - 1)
    twos = np.ldexp(1.0, np.arange(_kernels.LEAST_TWO, 1024))
    return (
        tens,
        twos,
        np.array([float(10**k) for k in range(23)]),
        np.array([10**k for k in range(19)], dtype=np.uint64),
    )
