"""One Parquet file of a campaign: rows of runs, with what they are of and which could not be done."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.files import replacing
from schuler.montecarlo.rows import Rows, joined

FORMAT = "schuler/montecarlo/1"
_KEY = b"schuler"
_GROUP_BYTES = 1 << 24  # of a row group, before compression


@contextmanager
def writer(path: Path, like: Rows, document: Mapping[str, Any], failures: Mapping[int, str]) -> Iterator[Any]:
    """A Parquet file with the columns of some rows; yields a function that takes rows, ascending.

    Row groups are cut by the number of rows only, so that the bytes do not depend on the pieces in which they come.
    """
    pa, pq = pyarrow_needed()
    shapes = like.shapes
    schema = pa.schema(
        [pa.field("run", pa.int64()), *(pa.field(n, _type(pa, t, s)) for n, (t, s) in shapes.items())],
        metadata={
            _KEY: json.dumps(
                {
                    "format": FORMAT,
                    **document,
                    "columns": [[n, t, list(s)] for n, (t, s) in shapes.items()],
                    "failures": {str(k): failures[k] for k in sorted(failures)},
                },
                sort_keys=True,
            ).encode()
        },
    )
    size = 8 + sum(8 * int(np.prod(s)) for _, s in shapes.values())
    group = int(np.clip(_GROUP_BYTES // size, 1, 1 << 16))
    waiting: list[Rows] = []
    with replacing(path, at_once=True) as temporary:
        with pq.ParquetWriter(temporary, schema, compression="zstd") as writer:

            def flush(least: int) -> None:
                held = sum(len(r.runs) for r in waiting)
                if not held or held < least:
                    return
                rows = joined(waiting)
                complete = held if least == 1 else held - held % group
                for a in range(0, complete, group):
                    cut = slice(a, min(a + group, complete))
                    arrays = [pa.array(rows.runs[cut])]
                    for name, (_, shape) in shapes.items():
                        flat = pa.array(rows.columns[name][cut].reshape(-1))
                        arrays.append(pa.FixedSizeListArray.from_arrays(flat, int(np.prod(shape))) if shape else flat)
                    writer.write_table(pa.Table.from_arrays(arrays, schema=schema), row_group_size=group)
                rest = rows.where(int(rows.runs[complete]), int(rows.runs[-1])) if complete < held else None
                waiting[:] = [] if rest is None else [rest]

            def write(rows: Rows) -> None:
                if len(rows.runs):
                    waiting.append(rows)
                flush(max(group, 2))

            yield write
            flush(1)
        with temporary.open("rb+") as handle:
            os.fsync(handle.fileno())
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Also the new name is on the disk then; not every system lets a folder be opened."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _type(pa: Any, dtype: str, shape: tuple[int, ...]) -> Any:
    kind = {"float64": pa.float64(), "int64": pa.int64(), "bool": pa.bool_()}[dtype]
    return pa.list_(kind, int(np.prod(shape))) if shape else kind


def document_of(path: Path) -> dict[str, Any]:
    """What a file says of itself; one that is damaged is a :class:`FileFormatError`."""
    _, pq = pyarrow_needed()
    try:
        document = json.loads((pq.read_schema(path).metadata or {})[_KEY])
        assert {"runs", "first", "columns", "failures"} <= set(document)
    except (OSError, ValueError, KeyError, AssertionError, RecursionError) as error:
        raise FileFormatError(
            f"damaged or no part of a campaign ({error}); delete it, and its runs are done anew", path
        ) from None
    return dict(document)


def pieces(path: Path) -> Iterator[Rows]:
    """Rows of a file a row group at a time; its failures with the first."""
    _, pq = pyarrow_needed()
    document = document_of(path)
    failures = {int(k): why for k, why in document["failures"].items()}
    if not document["columns"]:
        yield Rows(np.zeros(0, dtype=np.int64), {}, failures)
        return
    try:
        with pq.ParquetFile(path) as file:
            for group in range(file.num_row_groups):
                table = file.read_row_group(group)
                columns = {}
                for name, dtype, shape in document["columns"]:
                    x = table.column(name).combine_chunks()
                    x = x.flatten() if shape else x
                    columns[name] = x.to_numpy(zero_copy_only=False).astype(dtype).reshape(-1, *shape)
                yield Rows(table.column("run").to_numpy(), columns, failures if group == 0 else {})
    except (OSError, ValueError, KeyError) as error:
        raise FileFormatError(
            f"damaged ({error}); delete it, and its runs are done anew: run the campaign again", path
        ) from None


def pyarrow_needed() -> tuple[Any, Any]:
    """The library and its Parquet module."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise MissingExtraError("pyarrow", "data", "the store of a campaign") from None
    return pa, pq
