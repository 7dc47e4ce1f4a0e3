"""Our own Parquet files: every series of a recording, and other tables, with all that is known about them.

A recording is one table: a column ``series`` and the columns of all parts, one row group per part, null where a
part has no such column. What is not a column is a JSON document in the schema's metadata under the key ``schuler``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError, MissingExtraError, SchulerError
from schuler.files import hashed, package_version
from schuler.recording.io import columns, own, own_satellites
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.own import Columns
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

_Columns = Mapping[str, np.ndarray[Any, np.dtype[Any]]]

FORMAT = "schuler/recording/2"
KEY = b"schuler"
_FAMILY = FORMAT.rpartition("/")[0]
_ROOM = 1 << 28  # what any file may unpack to [byte]
_ALIKE = 1 << 16  # rows of a column that says the same in each
_PACKED = 200  # times its size, beyond that: a log has a time column, which packs by 5


def write_parquet(recording: Recording, path: Path | str) -> list[Path]:
    """Write a recording as one Parquet file, bit for bit.

    Returns
    -------
    list of Path
        The file.

    Raises
    ------
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    pa, pq = _pyarrow("writing Parquet")
    flat = own.flatten(recording)
    names = list(dict.fromkeys(name for table in flat.values() for name in table))
    kind = "rate" if recording.imu is None else recording.imu.kind
    si = own.INCREMENT_UNITS if kind == "increment" else own.UNITS
    types = {name: pa.int64() if name in own.INTEGERS else pa.float64() for name in names}
    document = {"format": f"{_FAMILY}/{own.version(recording)}", **own.document(recording, flat)}
    schema = pa.schema(
        [pa.field("series", pa.string()), *(pa.field(n, types[n], metadata={"unit": si[n]}) for n in names)],
        metadata={KEY: own.to_json(document).encode()},
    )
    # noise does not pack: without compression a file is hardly larger, and is read twice as fast; numbers of few
    # values (of a converter, of a receiver) are kept short by their dictionaries
    with files.replacing(path) as temporary, pq.ParquetWriter(temporary, schema, compression="none") as writer:
        for series, table in flat.items():
            rows = own.rows(table)
            nothing = {kind: _alike(pa.nulls(min(rows, _ALIKE), kind), rows) for kind in (pa.int64(), pa.float64())}
            arrays = [_alike(pa.array([series] * min(rows, _ALIKE), pa.string()), rows)]
            arrays += [
                pa.array(np.ascontiguousarray(table[n]), types[n]) if n in table else nothing[types[n]] for n in names
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema), row_group_size=rows)
    return [Path(path)]


def _alike(part: Any, rows: int) -> Any:
    """A column of one value, of a part of it over and over: of a day at 200 Hz each would take 140 MB."""
    pa, _ = _pyarrow("writing Parquet")
    return pa.chunked_array([part] * (rows // len(part)) + [part.slice(0, rows % len(part))], part.type)


def read_parquet(path: Path, hints: ReadHints) -> Recording:
    """Recording of a Parquet file: our own without hints, another table with ``columns`` and ``units``.

    Raises
    ------
    FileFormatError
        If the file is damaged, newer than this package, or holds something other than a recording.
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    file, document = _open(path)
    with file:
        if document is None:
            return _read_foreign(path, file, hints)
        own.refuse_hints(hints, path)
        own.check_format(document.get("format"), FORMAT, path, document.get("package"))
        with hashed([path]) as sources:
            made = _parts(path, file, document)
            metadata = own.metadata_from(document, path, sources)
    if hints.name:
        metadata = replace(metadata, name=hints.name)
    return Recording(**made, metadata=metadata)


def _parts(path: Path, file: Any, document: Mapping[str, Any]) -> dict[str, Any]:
    """Each part of one of our files, from the row group that is its own."""
    entries = own.check_series(document, path)
    if file.num_row_groups != len(entries):
        raise FileFormatError(
            f"expected {len(entries)} series, got {file.num_row_groups} row groups; write it anew", path
        )
    made: dict[str, Any] = {}
    satellites: dict[str, Columns] = {}
    for group, (name, entry) in enumerate(entries.items()):
        flat = _RowGroup(path, file, group, name)
        own.check_rows(name, entry, flat.rows, path)
        if name in own_satellites.TABLES:
            satellites[name] = flat.read()
            continue
        try:
            made[name] = own.unflatten(name, flat, str(entry.get("kind", "rate")))
        except FileFormatError:
            raise
        except KeyError as error:
            raise FileFormatError(f"the column {error} of {name} is missing; write the file anew", path) from error
        except SchulerError as error:
            raise FileFormatError(f"{name}: {error}", path) from error
        del flat
        _pyarrow("reading Parquet")[0].default_memory_pool().release_unused()
    if made.get("imu") is not None and made.get("reference") is not None:
        made["imu"] = _sharing_stamps(made["imu"], made["reference"].t)
    return made | own.satellite_parts(satellites, document, path)


def _sharing_stamps(imu: ImuSeries, t: FloatArray) -> ImuSeries:
    """The series with its stamps out of those of the truth, if they are among them: of a day at 200 Hz 140 MB."""
    first = int(np.searchsorted(t, imu.t[0]))
    same = t[first : first + len(imu)]
    return replace(imu, t=same) if np.array_equal(same, imu.t) else imu


class _RowGroup(dict[str, np.ndarray[Any, np.dtype[Any]]]):
    """Columns of one part, each read when it is asked for: all at once take as much as the part that is made of them.

    Those of the other parts, which are null here, are not even read.
    """

    def __init__(self, path: Path, file: Any, group: int, part: str) -> None:
        super().__init__()
        self._path, self._file, self._group, self._part = path, file, group, part
        self._left = own.COLUMNS[part] & set(file.schema_arrow.names)
        self.rows: int = file.metadata.row_group(group).num_rows

    def read(self) -> Columns:
        """All columns."""
        for name in [n for n in self._file.schema_arrow.names if n in self._left]:
            self.get(name)
        if not self:
            raise FileFormatError(f"the columns of {self._part} are missing; write the file anew", self._path)
        return dict(self)

    def get(self, name: str, default: Any = None) -> Any:
        """A column, or the default if there is none or it has no value."""
        if name in self._left:
            self._left.remove(name)
            path, file = self._path, self._file
            table = _guarded(path, lambda: file.read_row_group(self._group, columns=[name], use_threads=False))
            column = _to_numpy(table, path)[name]
            if column is not None:
                # a damaged page may end before its column does, of which pyarrow says nothing of columns read alone
                if len(column) != self.rows:
                    raise FileFormatError(
                        f"expected {self.rows} rows of {self._part}, got {len(column)} of its column {name}: "
                        "the file is damaged; write it anew",
                        path,
                    )
                # those that become arrays of a series as they are must be written to, which pyarrow's cannot be
                self[name] = column if column.flags.writeable or name in own.JOINED else column.copy()
        return super().get(name, default)

    def __contains__(self, name: object) -> bool:
        return self.get(str(name)) is not None

    def __missing__(self, name: str) -> Any:
        if (column := self.get(name)) is None:
            raise KeyError(name)
        return column


def write_table(path: Path | str, columns: _Columns | Iterable[_Columns], meta: Mapping[str, Any]) -> Path:
    """Write a table of equally long columns with a document about it.

    Parameters
    ----------
    path : Path or str
    columns : mapping of str to ndarray, shape (n,), or an iterable of them
        Floating-point, integer, boolean or text columns; of an iterable, parts of the table one below the other, which
        are made, written and forgotten in turn.
    meta : mapping
        Plain values for the JSON document, with at least ``format``, for example ``"schuler/solution/1"``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If columns differ in length or have more than one axis, or the document cannot be JSON.
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    _, pq = _pyarrow("writing Parquet")
    if "format" not in meta:
        raise InputError("write_table: expected at least one column, and a format name in meta")
    document = own.to_json({"package": f"schuler {package_version()}", **meta})
    parts = iter([columns] if isinstance(columns, Mapping) else columns)
    table = _arrow_table(next(parts, {}), document)
    repeating = [n for n in table.column_names if _repeats(table.column(n))]
    with (
        files.replacing(path) as temporary,
        pq.ParquetWriter(temporary, table.schema, use_dictionary=repeating) as writer,
    ):
        writer.write_table(table)
        for part in parts:
            del table
            table = _arrow_table(part, document)
            writer.write_table(table)
    return Path(path)


def _repeats(column: Any) -> bool:
    """Whether a column is kept short by a dictionary of its values: texts, and numbers that are held."""
    values = column.to_numpy()
    return bool(values.dtype.kind == "O" or 2 * np.count_nonzero(values[1:] != values[:-1]) < len(values))


def _arrow_table(columns: _Columns, document: str) -> Any:
    pa, _ = _pyarrow("writing Parquet")
    if not columns:
        raise InputError("write_table: expected at least one column, and a format name in meta")
    arrays = {name: np.ascontiguousarray(values) for name, values in columns.items()}
    shapes = {name: array.shape for name, array in arrays.items()}
    if any(len(shape) != 1 for shape in shapes.values()) or len(set(shapes.values())) != 1:
        raise InputError(f"write_table: expected columns of one length and one axis, got {shapes}")
    bad = [name for name, array in arrays.items() if array.dtype.kind not in "fiubU"]
    if bad:
        raise InputError(f"write_table: expected numbers, booleans or text, got {arrays[bad[0]].dtype} in {bad[0]!r}")
    table = pa.table({name: pa.array(array) for name, array in arrays.items()})
    return table.replace_schema_metadata({KEY: document.encode()})


def read_table(path: Path | str, format: str | None = None) -> tuple[Columns, dict[str, Any]]:
    """Columns and document of a file written by :func:`write_table`.

    Parameters
    ----------
    path : Path or str
    format : str, optional
        The format expected, for example ``"schuler/solution/1"``; older versions of it are let through.

    Returns
    -------
    columns : dict of str to ndarray, shape (n,)
        Missing values of number columns are NaN.
    meta : dict

    Raises
    ------
    FileFormatError
        If the file is damaged, of another format, or newer than ``format``.
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    path = Path(path)
    file, document = _open(path)
    with file:
        table = _guarded(path, file.read)
    if document is None:
        raise FileFormatError(
            "this Parquet file was not written by schuler; read its columns with read(..., columns=...)", path
        )
    if format is not None:
        own.check_format(document.get("format"), format, path, document.get("package"))
    empty = np.full(table.num_rows, np.nan)
    return {n: empty if column is None else column.copy() for n, column in _to_numpy(table, path).items()}, document


def _open(path: Path) -> tuple[Any, dict[str, Any] | None]:
    """An open Parquet file, and our document in it if there is one."""
    _, pq = _pyarrow("reading Parquet")
    if not path.is_file():
        raise FileFormatError(f"there is no such file (working folder {Path.cwd()})", path)
    file = _guarded(path, lambda: pq.ParquetFile(path))
    _guarded(path, lambda: _check_size(file, path))
    names = file.schema_arrow.names
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise FileFormatError(f"expected each column once, got {twice[0]!r} twice; write the file anew", path)
    text = (file.schema_arrow.metadata or {}).get(KEY)
    if text is None:
        return file, None
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"the document schuler wrote with the file is damaged ({error}); write it anew", path
        ) from error
    if not isinstance(document, dict):
        raise FileFormatError("the document schuler wrote with the file is damaged; write it anew", path)
    return file, document


def _check_size(file: Any, path: Path) -> None:
    """Refuse a file whose numbers would take far more memory than any log of its size: it is damaged, or a trap."""
    size = path.stat().st_size
    if file.metadata.num_rows * file.metadata.num_columns * 8 <= _ROOM:
        return
    claimed = 0
    for k in range(file.metadata.num_row_groups):
        group = file.metadata.row_group(k)
        for j in range(group.num_columns):
            column = group.column(j)
            nothing = column.statistics is not None and column.statistics.null_count == column.num_values
            claimed += 0 if nothing else column.num_values * 8
    if claimed > max(_ROOM, _PACKED * size):
        raise FileFormatError(f"its columns claim {claimed} bytes in a file of {size}: it is damaged", path)


def _read_foreign(path: Path, file: Any, hints: ReadHints) -> Recording:
    names = list(file.schema_arrow.names)
    if hints.columns is None or hints.units is None:
        raise FileFormatError(
            "this Parquet file was not written by schuler: say which column is what with columns='t=stamp,ax=acc_x,...'"
            f" and units='m/s^2,rad/s'; it has {', '.join(names)}",
            path,
        )
    table = _guarded(path, file.read)
    arrays = {n: a for n, a in _to_numpy(table, path).items() if a is not None and a.dtype.kind in "fiu"}
    if "=" not in hints.columns:
        # names in order are meant for the columns in order
        specs = [entry.strip() for entry in hints.columns.split(",")]
        if len(specs) != len(names):
            raise FileFormatError(f"columns names {len(specs)} of {len(names)} columns: {', '.join(names)}", path)
        mapped = [f"{spec}={n}" for spec, n in zip(specs, names, strict=True) if spec not in columns.SKIPS]
        hints = replace(hints, columns=",".join(mapped))
    return recording_of_arrays(path, arrays, hints, [])


def _to_numpy(table: Any, path: Path) -> dict[str, np.ndarray[Any, np.dtype[Any]] | None]:
    """Columns as arrays, ``None`` for one without any value; nulls among numbers become NaN."""
    result: dict[str, np.ndarray[Any, np.dtype[Any]] | None] = {}
    for name in table.column_names:
        column = table.column(name)
        if column.null_count == len(column) and len(column):
            result[name] = None
        else:
            result[name] = _guarded(path, lambda column=column: np.asarray(column.to_numpy(zero_copy_only=False)))
    return result


def _guarded(path: Path, action: Any) -> Any:
    """The action's value; whatever pyarrow raises on damaged files becomes an error of ours."""
    pa, _ = _pyarrow("reading Parquet")
    try:
        return action()
    except SchulerError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileFormatError(f"cannot be read as Parquet ({first}); is the file complete?", path) from error


def _pyarrow(purpose: str) -> tuple[Any, Any]:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "data", purpose) from error
    return pa, pq
