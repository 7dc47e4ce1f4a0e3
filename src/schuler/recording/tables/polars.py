"""Recordings and other tables as polars data frames; units beside them, as polars has no attributes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from schuler.exceptions import InputError, MissingExtraError
from schuler.recording.recording import Recording
from schuler.recording.tables.tables import Tables, document_of, recording_of, tables_of

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class PolarsFrames:
    """Polars data frames with their attributes.

    Attributes
    ----------
    frames : dict of str to polars.DataFrame
        By name of the part.
    attributes : dict of str to dict
        Entries: ``units`` (unit of each column) and ``schuler`` (what :func:`from_polars` needs besides).
    """

    frames: dict[str, pl.DataFrame]
    attributes: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> pl.DataFrame:
        return self.frames[name]


def to_polars(data: Recording | Tables) -> PolarsFrames:
    """Polars data frames of a recording.

    Returns
    -------
    PolarsFrames
        ``result["imu"]`` is a frame, ``result.attributes["imu"]["units"]`` has its units.

    Raises
    ------
    MissingExtraError
        Without polars (extra ``frames``).
    """
    pl = _polars()
    tables = tables_of(data)
    frames = {name: pl.DataFrame({c: values.copy() for c, values in t.items()}) for name, t in tables.columns.items()}
    return PolarsFrames(frames, {name: tables.attributes(name) for name in frames})


def from_polars(data: PolarsFrames | pl.DataFrame | Mapping[str, pl.DataFrame], **options: Any) -> Recording:
    """Recording of polars data frames, the inverse of :func:`to_polars`.

    Parameters
    ----------
    data : PolarsFrames, DataFrame or mapping of str to DataFrame
        Frames without attributes are in SI; one alone is an IMU.
    **options
        As of :func:`schuler.recording.tables.tables.recording_of`: kind, time, name.

    Raises
    ------
    InputError
        If a frame cannot be the part it is named after.
    """
    return recording_of(tables_from_polars(data), **options)


def tables_from_polars(data: PolarsFrames | pl.DataFrame | Mapping[str, pl.DataFrame]) -> Tables:
    """Tables of data frames, for :func:`recording_of` and :func:`schuler.navigation.solution_tables.result_of`."""
    pl = _polars()
    if isinstance(data, pl.DataFrame):
        data = {"imu": data}
    if not isinstance(data, PolarsFrames):
        if not isinstance(data, Mapping):
            raise InputError(f"expected a data frame of polars or a mapping to them, got {type(data).__name__}")
        data = PolarsFrames(dict(data))
    columns, units = {}, {}
    document: dict[str, Any] = {}
    for name, frame in data.frames.items():
        if not isinstance(frame, pl.DataFrame):
            raise InputError(f"{name}: expected a data frame of polars, got {type(frame).__name__}")
        attributes = data.attributes.get(name, {})
        columns[name] = {column: frame[column].to_numpy() for column in frame.columns}
        units[name] = {str(k): str(v) for k, v in dict(attributes.get("units", {})).items()}
        document = document or document_of(attributes.get("schuler"))
    return Tables(columns, units, document)


def _polars() -> Any:
    try:
        import polars as pl
    except ImportError as error:
        raise MissingExtraError("polars", "frames", "exchange with polars") from error
    return pl
