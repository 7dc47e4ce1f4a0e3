"""Recordings and other tables as trees of xarray datasets, units in the attributes of each variable.

The tree is laid out as our NetCDF files are: ``to_xarray(recording).to_netcdf("drive.nc")`` writes one that
:func:`schuler.read` opens, and ``xarray.open_datatree("drive.nc")`` opens what :func:`schuler.write` wrote.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import InputError, MissingExtraError
from schuler.recording.formats import netcdf
from schuler.recording.io import own, own_satellites
from schuler.recording.recording import Recording
from schuler.recording.tables.tables import Tables, document_of, recording_of, tables_of

if TYPE_CHECKING:
    import xarray as xr


def to_xarray(data: Recording | Tables) -> xr.DataTree:
    """Tree of datasets of a recording.

    Returns
    -------
    DataTree
        A dataset for each part, ``tree["imu"]["ax"]`` along ``t`` (satellite parts, whose times repeat, along ``row``).
        ``variable.attrs["units"]`` has the unit, ``tree.attrs["schuler"]`` what :func:`from_xarray` needs besides.

    Raises
    ------
    MissingExtraError
        Without xarray (extra ``frames``).
    """
    library = _xarray()
    tables = tables_of(data)
    document = tables.document | ({"format": netcdf.FORMAT} if isinstance(data, Recording) else {})
    datasets = {}
    for name, table in tables.columns.items():
        along = "t" if _increasing(name, table) else "row"
        units = tables.units.get(name, {})
        variables = {
            c: library.Variable((along,), values.copy(), {"units": units[c]} if c in units else {})
            for c, values in table.items()
        }
        datasets[f"/{name}"] = library.Dataset(variables)
    attributes = {"Conventions": "CF-1.10", "schuler": own.to_json(document)}
    tree: xr.DataTree = library.DataTree.from_dict({"/": library.Dataset(attrs=attributes), **datasets})
    return tree


def from_xarray(data: xr.DataTree | xr.Dataset, **options: Any) -> Recording:
    """Recording of a tree of datasets, the inverse of :func:`to_xarray`.

    Parameters
    ----------
    data : DataTree or Dataset
        A tree whose children are parts by name, or one dataset, which is an IMU. Units are attributes of variables.
    **options
        As of :func:`schuler.recording.tables.tables.recording_of`: kind, time, name.

    Raises
    ------
    InputError
        If a dataset cannot be the part it is named after.
    """
    return recording_of(tables_from_xarray(data), **options)


def tables_from_xarray(data: xr.DataTree | xr.Dataset) -> Tables:
    """Tables of datasets, for :func:`recording_of` and :func:`schuler.navigation.solution_tables.result_of`."""
    xr = _xarray()
    if isinstance(data, xr.Dataset):
        data = xr.DataTree.from_dict({"/": xr.Dataset(attrs=data.attrs), "/imu": data})
    if not isinstance(data, xr.DataTree):
        raise InputError(f"expected a DataTree or a Dataset of xarray, got {type(data).__name__}")
    columns, units = {}, {}
    for name, node in data.children.items():
        variables = {str(c): v for c, v in node.variables.items()}
        if wrong := [c for c, v in variables.items() if v.ndim != 1]:
            raise InputError(f"{name}.{wrong[0]}: expected one dimension; split vectors into ax, ay, az")
        columns[name] = {c: v.to_numpy() for c, v in variables.items()}
        units[name] = {c: str(v.attrs["units"]) for c, v in variables.items() if "units" in v.attrs}
    return Tables(columns, units, document_of(data.attrs.get("schuler")))


def _increasing(name: str, table: own.Columns) -> bool:
    return "t" in table and name not in own_satellites.TABLES and bool(np.all(np.diff(table["t"]) > 0.0))


def _xarray() -> Any:
    try:
        import xarray as xr
    except ImportError as error:
        raise MissingExtraError("xarray", "frames", "exchange with xarray") from error
    if not hasattr(xr, "DataTree"):
        raise InputError(f"xarray {xr.__version__} has no DataTree; update it: pip install -U 'schuler[frames]'")
    return xr
