"""Recordings and other tables as pandas data frames, units in ``frame.attrs``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from schuler.exceptions import InputError, MissingExtraError
from schuler.recording.recording import Recording
from schuler.recording.tables.tables import Tables, document_of, recording_of, tables_of

if TYPE_CHECKING:
    import pandas as pd


def to_pandas(data: Recording | Tables) -> dict[str, pd.DataFrame]:
    """Data frames of a recording.

    Returns
    -------
    dict of str to DataFrame
        One for each part, the columns of docs/interop.md in SI. ``frame.attrs["units"]`` has the unit of each column,
        ``frame.attrs["schuler"]`` what :func:`from_pandas` needs besides. The values are copies.

    Raises
    ------
    MissingExtraError
        Without pandas (extra ``frames``).
    """
    pd = _pandas()
    tables = tables_of(data)
    frames = {}
    for name, table in tables.columns.items():
        frame = pd.DataFrame({column: values.copy() for column, values in table.items()})
        frame.attrs.update(tables.attributes(name))
        frames[name] = frame
    return frames


def from_pandas(frames: pd.DataFrame | Mapping[str, pd.DataFrame], **options: Any) -> Recording:
    """Recording of data frames, the inverse of :func:`to_pandas`.

    Parameters
    ----------
    frames : DataFrame or mapping of str to DataFrame
        Of parts by name (imu, gnss, ...). One alone is what its ``attrs["part"]`` says, else an IMU. Times are the
        column ``t``, or an index of numbers of this name. Units other than SI are in ``frame.attrs["units"]``.
    **options
        As of :func:`schuler.recording.tables.tables.recording_of`: kind, time, name.

    Raises
    ------
    InputError
        If a frame cannot be the part it is named after.
    """
    return recording_of(tables_from_pandas(frames), **options)


def tables_from_pandas(frames: pd.DataFrame | Mapping[str, pd.DataFrame]) -> Tables:
    """Tables of data frames, for :func:`recording_of` and :func:`schuler.navigation.solution_tables.result_of`."""
    pd = _pandas()
    if isinstance(frames, pd.DataFrame):
        frames = {str(frames.attrs.get("part", "imu")): frames}
    if not isinstance(frames, Mapping) or not all(isinstance(f, pd.DataFrame) for f in frames.values()):
        raise InputError(f"expected a data frame of pandas, or a mapping of names to them, got {type(frames).__name__}")
    columns, units = {}, {}
    document: dict[str, Any] = {}
    for name, frame in frames.items():
        if not frame.columns.is_unique:
            raise InputError(f"{name}: expected columns of different names, got {', '.join(map(str, frame.columns))}")
        table = {column: frame[column].to_numpy() for column in frame.columns}
        if "t" not in table and frame.index.name == "t":
            table["t"] = frame.index.to_numpy()
        columns[str(name)] = table
        units[str(name)] = {str(k): str(v) for k, v in dict(frame.attrs.get("units", {})).items()}
        document = document or document_of(frame.attrs.get("schuler"))
    return Tables(columns, units, document)


def _pandas() -> Any:
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingExtraError("pandas", "frames", "exchange with pandas") from error
    return pd
