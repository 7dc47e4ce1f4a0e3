"""NetCDF-4 and HDF5 files: our own NetCDF, arrays of other HDF5 files by name, MATLAB 7.3.

Ours has a group for each part with the columns of :mod:`schuler.recording.io.own`, SI units in the attribute ``units``
and what is not a column as a JSON document in the attribute ``schuler`` of the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.files import hashed
from schuler.recording.formats.registry import check_installed, needs
from schuler.recording.io import child, lines, own, own_satellites
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.own import Columns
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording

FORMAT = "schuler/netcdf/1"
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PACKED = 200  # deflate packs zeros by 1032, no log by more than this
_FEW = 1 << 26  # bytes that are no matter
_MOST = 500  # arrays of a file of others that are looked at
_DEEPEST = 50  # groups inside one another
_Array = np.ndarray[Any, np.dtype[Any]]


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is HDF5, at its start or behind the block of text with which MATLAB 7.3 begins."""
    return head.startswith(_SIGNATURE) or (head.startswith(b"MATLAB 7.3") and head[512:520] == _SIGNATURE)


def holds(path: Path) -> tuple[str, ...]:
    """Parts of one of our own files."""
    try:
        check_installed("h5py", "netcdf", "reading NetCDF and HDF5 files")
        return child.call(series_in, path)
    except Exception:  # whatever is wrong is said when the file is read
        return ()


def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of one of our NetCDF files, or of the arrays of another HDF5 file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        None for our own. For others ``columns`` maps names to datasets, groups with dots between
        (``"t=imu.time,accel=imu.acc,gyro=imu.gyr"``), and ``units`` and the rest as for tables.

    Raises
    ------
    FileFormatError
        If the file is damaged, newer than this package, or claims arrays far larger than itself.
    MissingExtraError
        Without h5py (extra ``hdf5``).
    """
    check_installed("h5py", "netcdf", "reading NetCDF and HDF5 files")
    head = lines.check_file(path)
    with hashed([path]) as sources:
        document, arrays = child.call(extract, path, head.startswith(b"MATLAB"))
        if document is None:
            return recording_of_arrays(path, arrays, replace(hints, format=None), [])
        own.refuse_hints(replace(hints, format=None), path)
        made = _parts(arrays, document, path)
        hashes = sources()
    metadata = own.metadata_from(document, path, lambda: hashes)
    if hints.name:
        metadata = replace(metadata, name=hints.name)
    return Recording(**made, metadata=metadata)


def series_in(path: Path) -> tuple[str, ...]:
    """Names of the parts in one of our own files, by its document."""
    import h5py

    with h5py.File(path, "r") as file:
        return tuple(_document(file, path)["series"])


def extract(path: Path, transposed: bool) -> tuple[dict[str, Any] | None, dict[str, Any]]:
    """Numbers of a file: everything that libhdf5 has to do with it.

    Parameters
    ----------
    path : Path
    transposed : bool
        Matrices of another program's file are stored columns first.

    Returns
    -------
    document : dict or None
        Of one of our own files.
    arrays : dict
        Its columns by part and name, or the arrays of another file by their path with dots.

    Raises
    ------
    FileFormatError
        If the file is damaged, newer than this package, or claims arrays far larger than itself.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if "schuler" not in file.attrs:
                return None, _arrays(h5py, file, path, transposed=transposed)
            document = _document(file, path)
            own.check_format(document.get("format"), FORMAT, path, document.get("package"))
            return document, _columns(h5py, file, document, path)
    except SchulerError:
        raise
    except Exception as error:  # a damaged file makes the library fail in ways that are not listed anywhere
        raise FileFormatError(
            f"cannot be read as HDF5 ({type(error).__name__}: {error}); is it complete?", path
        ) from error


def _document(file: Any, path: Path) -> dict[str, Any]:
    text = file.attrs["schuler"]
    try:
        document = json.loads(text.decode() if isinstance(text, bytes) else str(text))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"the attribute that describes this file is damaged ({error}); write it anew", path
        ) from error
    if not isinstance(document, dict):
        raise FileFormatError("the attribute that describes this file is damaged; write it anew", path)
    return document


def _columns(h5py: Any, file: Any, document: Mapping[str, Any], path: Path) -> dict[str, Columns]:
    """Columns of each part of one of our own files."""
    columns: dict[str, Columns] = {}
    for name, entry in own.check_series(document, path).items():
        group = file.get(name)
        if not isinstance(group, h5py.Group) or not isinstance(file.get(name, getlink=True), h5py.HardLink):
            raise FileFormatError(f"the group {name} is missing; write the file anew", path)
        flat: Columns = {}
        for column, dataset in group.items():
            if column not in own.COLUMNS[name] or not isinstance(dataset, h5py.Dataset):
                continue
            if not isinstance(group.get(column, getlink=True), h5py.HardLink):
                raise FileFormatError(f"{name}/{column} is a link to another place, which is not followed", path)
            if dataset.shape != (entry.get("rows"),):
                raise FileFormatError(f"{name}/{column}: expected {entry.get('rows')} rows, got {dataset.shape}", path)
            dtype = np.int64 if column in own.INTEGERS else np.float64
            flat[column] = _values(dataset, path).astype(dtype, copy=False)
        if not flat:
            raise FileFormatError(f"the group {name} has no columns; write the file anew", path)
        columns[name] = flat
    return columns


def _parts(columns: Mapping[str, Columns], document: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Series of the columns of one of our own files."""
    entries = own.check_series(document, path)
    made: dict[str, Any] = {}
    satellites: dict[str, Columns] = {}
    for name, flat in columns.items():
        if name in own_satellites.TABLES:
            satellites[name] = flat
            continue
        try:
            made[name] = own.unflatten(name, flat, str(entries[name].get("kind", "rate")))
        except KeyError as error:
            raise FileFormatError(f"the column {error} of {name} is missing; write the file anew", path) from error
        except SchulerError as error:
            raise FileFormatError(f"{name}: {error}", path) from error
    return made | own.satellite_parts(satellites, document, path)


def _values(dataset: Any, path: Path) -> _Array:
    """Numbers of a dataset; one that claims far more than the file holds is refused before it is allocated."""
    if dataset.dtype.kind not in "fiu":
        raise FileFormatError(f"{dataset.name}: expected numbers, got {dataset.dtype}", path)
    if dataset.external or dataset.is_virtual:
        raise FileFormatError(f"{dataset.name} is kept in another file, which is not opened", path)
    size = int(np.prod(dataset.shape, dtype=np.float64)) * dataset.dtype.itemsize
    if size > max(_FEW, _PACKED * path.stat().st_size):
        raise FileFormatError(
            f"{dataset.name} claims {size} bytes in a file of {path.stat().st_size}: it is damaged", path
        )
    values: _Array = np.asarray(dataset[()])
    return values


def _arrays(h5py: Any, file: Any, path: Path, *, transposed: bool) -> dict[str, _Array]:
    """Vectors and matrices by their path with dots; ``transposed`` for MATLAB, which stores columns first."""
    items: dict[str, Any] = {}

    def visit(name: str, item: Any) -> bool | None:
        if name.count("/") > _DEEPEST:  # each is looked for from the root on
            raise FileFormatError(f"its groups stand more than {_DEEPEST} deep in each other: it is no log", path)
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and 1 <= len(item.shape) <= 2 and item.size:
            items[name.replace("/", ".")] = item
        return True if len(items) >= _MOST else None

    file.visititems(visit)
    total = sum(item.size * item.dtype.itemsize for item in items.values())
    if total > max(_FEW, _PACKED * path.stat().st_size):
        raise FileFormatError(f"its arrays claim {total} bytes in a file of {path.stat().st_size}: it is damaged", path)
    arrays = {name: _values(item, path) for name, item in items.items() if not name.startswith("#refs#")}
    return {name: array.T if transposed else array for name, array in arrays.items()}


def write(recording: Recording, path: Path, compress: bool = False) -> list[Path]:
    """Write all parts of a recording as one NetCDF-4 file, bit for bit.

    Parameters
    ----------
    recording : Recording
    path : Path
    compress : bool
        Pack by deflate, about half the size at a tenth of the speed.

    Returns
    -------
    list of Path
        The file. ``xarray.open_dataset(path, group="imu")`` opens a part with its units.

    Raises
    ------
    MissingExtraError
        Without h5netcdf (extra ``hdf5``).
    InputError
        If the recording has no rows.
    """
    try:
        import h5netcdf
    except ImportError as error:
        raise needs("h5netcdf", "netcdf", "writing NetCDF files") from error
    if not isinstance(compress, bool):
        raise InputError(f"compress: expected true or false, got {compress!r}")
    flat = own.flatten(recording)
    document = {"format": FORMAT, **own.document(recording, flat)}
    kind = "rate" if recording.imu is None else recording.imu.kind
    si = own.INCREMENT_UNITS if kind == "increment" else own.UNITS
    base = recording.metadata.time
    options = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if compress else {}
    with files.replacing(path) as temporary, h5netcdf.File(temporary, "w") as file:
        file.attrs["Conventions"] = "CF-1.10"
        file.attrs["title"] = recording.metadata.name
        file.attrs["time_reference"] = base.describe()
        file.attrs["schuler"] = own.to_json(document)
        for name, table in flat.items():
            group = file.create_group(name)
            along = "t" if "t" in table and name not in own_satellites.TABLES else "row"
            group.dimensions = {along: own.rows(table)}
            for column, values in table.items():
                dtype = np.int64 if column in own.INTEGERS else np.float64
                data = np.ascontiguousarray(values, dtype=dtype)
                variable = group.create_variable(column, (along,), dtype, data=data, **options)
                variable.attrs["units"] = si.get(column, "1")
                if column == "t":
                    variable.attrs["long_name"] = base.describe()
    return [Path(path)]
