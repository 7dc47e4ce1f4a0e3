"""Numbers in the lines of a text file, read at the speed of compiled code, and the line a fault is on.

Large files go through :mod:`schuler.recording.io.numbers`, others through NumPy. Either knows only whether lines are
good. When one is not, it is judged field by field; errors are rare, and then a second pass is the smaller cost.
"""

from __future__ import annotations

import csv
import io
import itertools
import mmap
import re
import warnings
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.io.numbers import Numbers, read_numbers

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_DATE = re.compile(r"\d{1,4}[-/:]\d{1,2}[-/:]\d{1,4}")
_HEAD_BYTES = 1 << 16
_NOT_PRINTED = bytes(code for code in range(32) if code not in b"\t\n\v\f\r\x1b")
_PACKED = (".gz", ".bz2", ".xz", ".lzma")
#: Longest line that is split into fields: twenty thousand columns. [characters]
LONGEST = 1 << 19
#: Size of a file from which loading the compiled code is worth its half a second. [bytes]
MANY = 4_000_000


@dataclass(frozen=True, slots=True)
class TextTable:
    """Layout of a table in a text file: first line, delimiter, comments.

    Attributes
    ----------
    path : Path
    first : int
        One-based number of the first line that may hold numbers.
    delimiter : str
        One character; a blank stands for any run of white space.
    comment : str
        Start of a comment; the remainder of the line is ignored.
    encoding : str
        ``latin-1`` unless there is a byte-order mark: numbers are ASCII, and comments may be in any encoding.
    replaced : str
        Characters that stand for a blank (the strokes and colons of dates).
    decimal : {".", ","}
        Decimal point; a comma only where the delimiter is none.
    header : str
        Line of the names, as it stands in the file; where it comes again, of a logger that began anew, it is no row.
    """

    path: Path
    first: int = 1
    delimiter: str = ","
    comment: str = "#"
    encoding: str = "latin-1"
    replaced: str = ""
    decimal: str = "."
    header: str = ""

    def split(self, line: str) -> list[str]:
        """Fields of one line without its comment; none of a blank line. A FileFormatError if no log has such a line."""
        if len(line) > LONGEST:
            raise FileFormatError(
                f"a line has {len(line)} characters, those of a table at most {LONGEST}: it is damaged or no table",
                self.path,
            )
        line = self.bare(line)
        line = line.strip(" \r\n") if self.delimiter == "\t" else line.strip()
        if not line:
            return []
        if self.delimiter == " ":
            return line.split()
        if '"' in line:
            try:
                return [field.strip() for field in next(csv.reader([line], delimiter=self.delimiter))]
            except csv.Error:
                return [line]
        return [field.strip() for field in line.split(self.delimiter)]

    def bare(self, line: str) -> str:
        """A line without its comment, and with what stands for blanks and points replaced by them."""
        if self.header and line.strip() == self.header:
            return ""
        line = line.partition(self.comment)[0].replace(self.decimal, ".")
        for character in self.replaced:
            line = line.replace(character, " ")
        return line

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of every line that has any, from ``first`` on."""
        with self.path.open(encoding=self.encoding, errors="replace", newline=None) as stream:
            for number, line in enumerate(itertools.islice(stream, self.first - 1, None), self.first):
                if fields := self.split(line):
                    yield number, fields

    def line_of(self, row: int) -> int | None:
        """Line of the file that holds a row (counted from zero)."""
        return next((number for number, _ in itertools.islice(self.rows(), row, None)), None)


def is_number(field: str) -> bool:
    """Whether a field is a finite decimal number as written by a logger."""
    return _NUMBER.fullmatch(field) is not None


def is_value(field: str) -> bool:
    """Whether a field is a number or stands for a missing one: anything but a word."""
    return not field or is_number(field) or _NOT_FINITE.fullmatch(field) is not None


def is_decimal_comma(field: str) -> bool:
    """Whether a field is a number with a comma for its point."""
    return _DECIMAL_COMMA.fullmatch(field) is not None


def decode(text: str) -> str:
    """Text that was read as Latin-1 but is UTF-8, as UTF-8; other text as it is."""
    try:
        return text.encode("latin-1").decode("utf-8")
    except UnicodeError:
        return text


def shorten(text: str, length: int = 80) -> str:
    """A piece of a file in quotes for a message, cut to a length."""
    text = decode(text)
    return repr(text if len(text) <= length else f"{text[: length - 3]}...")


def check_file(path: Path) -> bytes:
    """First bytes of a file that exists and is not empty.

    Raises
    ------
    FileFormatError
        If there is no such file, nothing in it, or one and the same byte throughout.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except FileNotFoundError as error:
        raise FileFormatError(f"there is no such file (working folder {Path.cwd()})", path) from error
    except OSError as error:
        raise FileFormatError(f"cannot be opened: {error.strerror or error}", path) from error
    if not head:
        raise FileFormatError("the file is empty", path)
    if len(head) == _HEAD_BYTES and head.count(head[:1]) == len(head):
        raise FileFormatError(
            f"its first {_HEAD_BYTES // 1024} KiB are all the byte 0x{head[0]:02X}: its place was kept and nothing "
            "written, or it is damaged; copy it from the logger again",
            path,
        )
    return head


def is_binary(head: bytes) -> bool:
    """Whether zero bytes in the beginning of a file are those of binary data.

    A text may hold some, too, where a logger lost power or a wire was loose: all but a tenth of what is not zero stands
    in lines without any, and these are of printed characters.
    """
    if b"\x00" not in head:
        return False
    sound = b"".join(line for line in head.splitlines(keepends=True) if b"\x00" not in line)
    written = len(head) - head.count(b"\x00")
    return 10 * len(sound) < 9 * written or len(sound.translate(None, _NOT_PRINTED)) < len(sound)


def encoding_of(head: bytes, path: Path) -> str:
    """Encoding to open a text file with.

    Raises
    ------
    FileFormatError
        If the file is UTF-16 or not text at all.
    """
    if head.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FileFormatError("expected UTF-8 or ASCII text, got UTF-16: save the file as UTF-8 or plain CSV", path)
    if is_binary(head):
        raise FileFormatError(
            "expected text, got a binary file (with zero bytes); text, .parquet, .mat, .npy, .npz and .pos are read",
            path,
        )
    return "latin-1"


def load(
    table: TextTable, n_columns: int, used: list[int], *, allow_truncated: bool = False
) -> tuple[FloatArray, bool]:
    """Numbers of the used columns of every line.

    Parameters
    ----------
    table : TextTable
    n_columns : int
        Fields every line must have.
    used : list of int
        Columns wanted, counted from zero, in the order wanted.
    allow_truncated : bool
        Leave out a last line that was cut off.

    Returns
    -------
    values : ndarray, shape (n, len(used))
        Finite and not finite numbers as they stand.
    truncated : bool
        Whether a last line was left out.

    Raises
    ------
    FileFormatError
        With the line of the first fault.
    """
    if used and is_large(table):
        numbers = read_numbers(table, n_columns, used)
        if numbers is not None and (whole := _all_or_cut(table, n_columns, used, numbers, allow_truncated)) is not None:
            return numbers.values.T, whole == "cut"
    values = _fast(table, n_columns, used, None) if used else None
    if values is not None:
        return values, False
    count, cut = _check_lines(table.rows(), table, n_columns, used, allow_truncated)
    if count == 0:
        raise FileFormatError("there are no rows of numbers", table.path)
    values = _fast(table, n_columns, used, count) if used else np.empty((count, 0))
    if values is None:
        raise FileFormatError(
            "cannot be read as a table of numbers; check that it is plain text with one delimiter", table.path
        )
    return values, cut


def load_stamps(
    table: TextTable, n_columns: int, decimals: int, *, rounded: bool = False, allow_truncated: bool = False
) -> tuple[IntArray, FloatArray, bool] | None:
    """The first column of a large table as whole numbers, without loss, and the others; ``None`` if it is not plain.

    Parameters
    ----------
    table : TextTable
    n_columns : int
        Fields every line must have.
    decimals : int
        The whole numbers count 10^-decimals.
    rounded : bool
        Further decimals are rounded, half to even; otherwise a table with any is not plain.
    allow_truncated : bool
        Leave out a last line that was cut off.

    Returns
    -------
    stamps : ndarray of int64, shape (n,)
    values : ndarray, shape (n, n_columns - 1)
    truncated : bool
        Whether a last line was left out.

    Raises
    ------
    FileFormatError
        With the line of the first fault.
    """
    if not is_large(table):
        return None
    used = list(range(1, n_columns))
    numbers = read_numbers(table, n_columns, used, decimals=decimals, rounded=rounded)
    if numbers is None:
        return None
    whole = _all_or_cut(table, n_columns, [0, *used], numbers, allow_truncated)
    return None if whole is None else (numbers.stamps, numbers.values.T, whole == "cut")


def is_large(table: TextTable) -> bool:
    """Whether a file is worth compiled code."""
    return table.path.stat().st_size >= MANY


def repeated_headers(table: TextTable) -> int:
    """How often the line of the names comes again below the first rows."""
    text = table.header.encode(table.encoding, errors="replace")
    if not text:
        return 0
    with table.path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        count, at = 0, data.find(text)
        while at >= 0:
            begins, ends = at == 0 or data[at - 1 : at] == b"\n", data[at + len(text) : at + len(text) + 1].isspace()
            count += begins and ends
            at = data.find(text, at + 1)
    return max(count - 1, 0)


def _all_or_cut(
    table: TextTable, n_columns: int, used: list[int], numbers: Numbers, allow_truncated: bool
) -> Literal["all", "cut"] | None:
    """Whether numbers are all of the file, or all but a last line that was cut off; ``None`` if other code must look.

    Raises
    ------
    FileFormatError
        If the first line that was not understood is at fault.
    """
    count = numbers.values.shape[1]
    if count == 0:
        return None
    with table.path.open("rb") as stream:
        if numbers.rest == stream.seek(0, 2):
            return "all"
        stream.seek(0)
        number = 1 + sum(block.count(b"\n") for block in _blocks(stream, numbers.rest))
        text = io.TextIOWrapper(stream, encoding=table.encoding, errors="replace", newline=None)
        line = next(text)
        fields = table.split(line)
        # quotes may go on over the end of a line
        if not fields or '"' in line or fault_of(table, fields, n_columns, used) is None:
            return None
        others = ((k, fields) for k, line in enumerate(text, number + 1) if (fields := table.split(line)))
        first = (number, fields)
        _check_lines(itertools.chain([first], others), table, n_columns, used, allow_truncated, before=count)
    return "cut"


def _blocks(stream: BinaryIO, size: int) -> Iterator[bytes]:
    """The first bytes of a file, a piece at a time."""
    while size > 0 and (block := stream.read(min(size, 1 << 20))):
        size -= len(block)
        yield block


def _fast(table: TextTable, n_columns: int, used: list[int], count: int | None) -> FloatArray | None:
    """All rows by NumPy's compiled reader, ``None`` if it stumbles; ``count`` says that so many lines were checked."""
    # NumPy reads the file itself as long as nothing has to be taken out of its lines. Without usecols it also checks
    # that every line has as many fields; once each line was checked the unused columns may hold words.
    # By the name it would unpack what is called .gz, .bz2 or .xz and is a text.
    direct = count is None and not table.replaced and table.decimal == "." and table.path.suffix not in _PACKED
    delimiter = None if table.delimiter == " " else table.delimiter
    with warnings.catch_warnings(), closing(_bare_lines(table)) as bare:
        warnings.simplefilter("error")
        try:
            values = np.loadtxt(
                str(table.path) if direct else bare,
                delimiter=delimiter,
                comments=table.comment if direct else None,
                skiprows=table.first - 1 if direct else 0,
                usecols=None if count is None else used,
                max_rows=count,
                ndmin=2,
                encoding=table.encoding,
                quotechar=None if delimiter is None else '"',
            )
        except (ValueError, TypeError, OverflowError, RuntimeError, Warning):
            return None
    if count is None:
        if values.shape[1] != n_columns:
            return None
        if used != list(range(n_columns)):
            values = values[:, used]
    return np.ascontiguousarray(values, dtype=np.float64)


def _bare_lines(table: TextTable) -> Generator[str, None, None]:
    """Lines without comments and without characters to be replaced, those left blank dropped."""
    with table.path.open(encoding=table.encoding, errors="replace", newline=None) as stream:
        for line in itertools.islice(stream, table.first - 1, None):
            if (text := table.bare(line)).strip():
                yield text


def _check_lines(
    rows: Iterable[tuple[int, list[str]]],
    table: TextTable,
    n_columns: int,
    used: list[int],
    allow_truncated: bool,
    before: int = 0,
) -> tuple[int, bool]:
    """Number of good rows (``before`` these there are more), and whether a cut last one follows; raises at a fault."""
    count, fault = before, None
    for number, fields in rows:
        if fault is not None:
            raise fault
        message = fault_of(table, fields, n_columns, used)
        if message is None:
            count += 1
        else:
            fault = FileFormatError(message, table.path, number)
    if fault is None:
        return count, False
    if _ends_with_newline(table.path) or count == 0:
        raise fault
    if allow_truncated:
        return count, True
    raise FileFormatError(
        "the last line is incomplete, the log was cut off there: delete that line, or pass allow='truncated'",
        table.path,
        fault.line,
    )


def fault_of(table: TextTable, fields: list[str], n_columns: int, used: list[int]) -> str | None:
    """What is wrong with a line of a table, None if its used columns are numbers."""
    if len(fields) != n_columns:
        ending = "; the last one is empty, so lines end in a delimiter: end columns with ',-'" if not fields[-1] else ""
        return (
            f"expected {n_columns} columns, got {len(fields)}{ending}; correct the line, leave a few garbled ones out "
            "with bad_lines=0.01, or say what the columns are (columns, delimiter, skip)"
        )
    for column in used:
        field = fields[column]
        if not is_value(field):
            shown = shorten(field, 40)
            if is_decimal_comma(field):
                return f"column {column + 1}: expected a decimal point as in the first rows, got {shown}; write points"
            if _DATE.match(field):
                return (
                    f"column {column + 1}: expected a number, got {shown}; write seconds (hint time says what they "
                    "count from), or in the column t of every row a date such as 2024-05-01T12:00:00.25Z"
                )
            return f"column {column + 1}: expected a number, got {shown}; correct the line, or skip the column with -"
        if not field:
            return f"column {column + 1}: the field is empty; fill or delete the line, or skip the column with -"
    return None


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, 2)
        return stream.read(1) in b"\r\n"
