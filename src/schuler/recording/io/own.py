"""The flat form of a recording that our own CSV and Parquet files share: columns in SI and a document of the rest."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.files import package_version
from schuler.recording.io import columns, own_satellites
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hint_texts import SERIES
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries, stated_dilution
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase

#: SI unit of each column in files.
UNITS = {
    **own_satellites.UNITS,
    **{name: {"t": "s", "temp": "degC", "angle": "rad", "length": "m", "velocity": "m/s"}.get(group or "", "1")
       for name, group in columns.GROUP.items()},
    **dict.fromkeys(columns.ACCEL, "m/s^2"),
    **dict.fromkeys(columns.GYRO, "rad/s"),
    **dict.fromkeys(columns.MAG, "T"),
    **dict.fromkeys((*columns.CROSS, "cnn", "cee", "cdd"), "m^2"),
    **dict.fromkeys((*columns.VELOCITY_CROSS, "cvnn", "cvee", "cvdd"), "m^2/s^2"),
}  # fmt: skip
INCREMENT_UNITS = {**UNITS, **dict.fromkeys(columns.ACCEL, "m/s"), **dict.fromkeys(columns.GYRO, "rad")}
#: Columns of whole numbers.
INTEGERS = own_satellites.INTEGERS | {"q", "ns"}
#: Tables in the order in which they are written.
TABLES = (*SERIES, *own_satellites.TABLES)
#: Columns that each table may have in files of ours.
COLUMNS = {name: {*columns.BELONGS.get(name, ()), *own_satellites.TABLES.get(name, ())} for name in TABLES}
COLUMNS["gnss"] |= {"cnn", "cee", "cdd", "cvnn", "cvee", "cvdd"}
#: Parts that came with version 2 of the formats; a file without them is of version 1, which older releases read.
_SECOND = ("heading", "height", *own_satellites.TABLES)
_ELEMENTS = {"nn": (0, 0), "ne": (0, 1), "nd": (0, 2), "ee": (1, 1), "ed": (1, 2), "dd": (2, 2)}

Columns = own_satellites.Columns
#: Columns that are put side by side when a series is made of them.
JOINED = (
    {*columns.ACCEL, *columns.GYRO, *columns.MAG, *columns.GEODETIC, *columns.VELOCITY}
    | {*columns.ECEF, *columns.ECEF_VELOCITY, *columns.QUATERNION}
) - {"h"}  # a height may be a series of its own
_BLOCK = 8192  # rows of a few columns, which fit into a cache


def version(recording: Recording) -> int:
    """Version of our formats that a recording needs: 2 with satellites, heading, height, magnetometer, DOP; else 1."""
    second = any(getattr(recording, name) is not None for name in _SECOND)
    second |= recording.imu is not None and recording.imu.magnetometer is not None
    return 2 if second or (recording.gnss is not None and recording.gnss.dop is not None) else 1


def rows(table: Columns) -> int:
    """Number of rows of a table."""
    return len(next(iter(table.values())))


def flatten(recording: Recording) -> dict[str, Columns]:
    """Columns in SI of each part of a recording that has rows, in the order of :data:`TABLES`. Shapes (n,)."""
    flat: dict[str, Columns] = {}
    if (imu := recording.imu) is not None:
        flat["imu"] = {"t": imu.t, **_split(columns.ACCEL, imu.accel), **_split(columns.GYRO, imu.gyro)}
        if imu.temperature is not None:
            flat["imu"]["temp"] = imu.temperature
        if imu.magnetometer is not None:
            flat["imu"] |= _split(columns.MAG, imu.magnetometer)
    if (gnss := recording.gnss) is not None:
        table: Columns = {"t": gnss.t, **_split(columns.GEODETIC, gnss.llh), **_split_cov("c", gnss.cov_r_n)}
        if gnss.v_n is not None and gnss.cov_v_n is not None:
            table |= {**_split(columns.VELOCITY, gnss.v_n), **_split_cov("cv", gnss.cov_v_n)}
        optional = {"q": gnss.quality, "ns": gnss.n_satellites, "received": gnss.received}
        table |= {name: values for name, values in optional.items() if values is not None}
        flat["gnss"] = table if gnss.dop is None else table | _split(columns.DILUTION, gnss.dop)
    if (odometer := recording.odometer) is not None:
        flat["odometer"] = {"t": odometer.t, "speed": odometer.speed, "sspeed": odometer.sigma}
    if (heading := recording.heading) is not None:
        flat["heading"] = {"t": heading.t, "heading": heading.value, "sheading": heading.sigma}
    if (height := recording.height) is not None:
        flat["height"] = {"t": height.t, "h": height.value, "sh": height.sigma}
    if (reference := recording.reference) is not None:
        flat["reference"] = {"t": reference.t, **_split(columns.ECEF, reference.r_eb_e)}
        if reference.v_eb_e is not None:
            flat["reference"] |= _split(columns.ECEF_VELOCITY, reference.v_eb_e)
        if reference.q_eb is not None:
            flat["reference"] |= _split(columns.QUATERNION, reference.q_eb)
    return flat | own_satellites.flatten(recording)


def unflatten(
    name: str, flat: Columns, kind: str = "rate"
) -> ImuSeries | GnssSeries | OdometerSeries | ScalarSeries | Trajectory:
    """Series of its columns in SI; the inverse of :func:`flatten` but for satellite parts (:func:`satellite_parts`).

    Raises
    ------
    KeyError
        If a column is missing.
    """
    if name == "imu":
        accel, gyro = _join(columns.ACCEL, flat), _join(columns.GYRO, flat)
        magnetometer = _join(columns.MAG, flat) if "mx" in flat else None
        return ImuSeries(flat["t"], gyro, accel, kind, flat.get("temp"), magnetometer)  # type: ignore[arg-type]
    if name == "gnss":
        has_velocity = "vn" in flat
        return GnssSeries(
            flat["t"],
            _join(columns.GEODETIC, flat),
            _join_cov("c", flat),
            _join(columns.VELOCITY, flat) if has_velocity else None,
            _join_cov("cv", flat) if has_velocity else None,
            flat.get("q"),
            flat.get("ns"),
            flat.get("received"),
            stated_dilution(*(flat.get(name) for name in columns.DILUTION)),
        )
    if name == "odometer":
        return OdometerSeries(flat["t"], flat["speed"], flat["sspeed"])
    if name == "heading":
        return ScalarSeries(flat["t"], flat["heading"], flat["sheading"])
    if name == "height":
        return ScalarSeries(flat["t"], flat["h"], flat["sh"])
    if name == "reference":
        return Trajectory(
            flat["t"],
            _join(columns.ECEF, flat),
            _join(columns.ECEF_VELOCITY, flat) if "vx" in flat else None,
            _attitude(flat) if "qw" in flat else None,
        )
    raise KeyError(name)


def _attitude(flat: Columns) -> FloatArray:
    """Quaternions of the reference. Shape (n, 4)."""
    return unit_quaternions(
        _join(columns.QUATERNION, flat), lambda row, text: InputError(f"row {row + 1}, qw, qx, qy, qz: {text}"), 1e-3
    )


def satellite_parts(
    flat: Mapping[str, Columns], document: Mapping[str, Any], path: Path, *, alone: bool = False
) -> dict[str, Any]:
    """Observations, ranges and ephemerides of the tables that were read and of the file's document.

    Parameters
    ----------
    flat : mapping of str to dict
        Columns of each table.
    document : mapping
        Has the constants of every part; a part without rows has no table and is made of them alone.
    path : Path
        For messages.
    alone : bool
        Only the parts whose tables are given.

    Raises
    ------
    FileFormatError
        If a column is missing or the document is damaged.
    """
    made = {}
    try:
        constants = document.get("satellites", {})
        for name in own_satellites.TABLES:
            if name in flat or (not alone and name in constants and name not in document["series"]):
                made[name] = own_satellites.unflatten(name, flat.get(name, {}), constants[name])
    except (KeyError, TypeError, ValueError, AttributeError, SchulerError) as error:
        raise FileFormatError(
            f"the satellite measurements written with the file are damaged ({error!r}); write it anew", path
        ) from error
    return made


def document(recording: Recording, flat: Mapping[str, Columns]) -> dict[str, Any]:
    """Document beside the columns: metadata, for each table its number of rows and kind, constants of satellite parts.

    Raises
    ------
    InputError
        If no part has any rows.
    """
    m = recording.metadata
    series: dict[str, dict[str, Any]] = {name: {"rows": rows(table)} for name, table in flat.items()}
    if not series:
        raise InputError(f"{m.name}: there is nothing to write; all its parts are empty")
    if recording.imu is not None:
        series["imu"]["kind"] = recording.imu.kind
    satellites = own_satellites.constants(recording)
    return {
        "package": f"schuler {package_version()}",
        "series": series,
        **({"satellites": satellites} if satellites else {}),
        "metadata": {
            "name": m.name,
            "time": time_document(m.time),
            "sources": dict(m.sources),
            "axes": m.axes,
            "notes": list(m.notes),
            "options": dict(m.options),
        },
    }


def time_document(time: TimeBase) -> dict[str, Any]:
    """A time base as plain values."""
    return {"scale": time.scale, "epoch_gps_s": time.epoch_gps_s}


def to_json(document: Mapping[str, Any], indent: int | None = None) -> str:
    """JSON text of a document; paths and the like become text.

    Raises
    ------
    InputError
        If it holds NaN or infinity, which JSON has not.
    """
    try:
        return json.dumps(document, allow_nan=False, default=_plain, indent=indent, ensure_ascii=True)
    except ValueError as error:
        raise InputError("metadata: expected finite numbers, got NaN or infinity, which JSON cannot hold") from error


def metadata_from(
    document: Mapping[str, Any], path: Path, hashes: Callable[[], dict[str, str]] | None = None
) -> Metadata:
    """Metadata of a document, with the file it was read from among the sources.

    Parameters
    ----------
    document : mapping
    path : Path
    hashes : callable, optional
        Returns the hash of the file by its name, where it is taken already (:func:`.sources.hashed`).

    Raises
    ------
    FileFormatError
        If an entry is missing or of the wrong type.
    """
    try:
        m = document["metadata"]
        own = {path.name: files.sha256(path)} if hashes is None else hashes()
        return Metadata(
            name=str(m["name"]),
            time=time_from(m["time"]),
            sources={**{str(k): str(v) for k, v in m["sources"].items()}, **own},
            axes=str(m["axes"]),
            notes=tuple(str(note) for note in m["notes"]),
            options=dict(m["options"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(
            f"the metadata written with the file is damaged ({error!r}); write it anew", path
        ) from error


def time_from(entry: Mapping[str, Any]) -> TimeBase:
    """Time base of its plain values; ``ValueError`` if they are none."""
    scale, epoch = entry["scale"], float(entry["epoch_gps_s"])
    if scale not in ("gps", "utc", "local") or not abs(epoch) < 1e11:
        raise ValueError(f"time base {scale!r}, {epoch!r}")
    return TimeBase(scale, epoch)


def refuse_hints(hints: ReadHints, path: Path) -> None:
    """Our own files say everything themselves.

    Raises
    ------
    InputError
        If any hint but ``name``, ``series``, ``allow`` and ``truth_fixes`` is given.
    """
    if surplus := sorted(set(hints.given()) - {"name", "series", "allow", "truth_fixes"}):
        raise InputError(f"{path} was written by schuler and needs no hints; leave out {', '.join(surplus)}")


def check_rows(name: str, entry: Mapping[str, Any], came: int, path: Path) -> None:
    """Refuse a table that does not have the rows that its document states.

    Parameters
    ----------
    name : str
        The series.
    entry : mapping
        Of the document's ``series``.
    came : int
        Rows read.
    path : Path

    Raises
    ------
    FileFormatError
        If rows are missing or too many.
    """
    if entry.get("rows") != came:
        raise FileFormatError(
            f"expected {entry.get('rows')} rows of {name}, got {came}: the file was cut off or edited; write it anew",
            path,
        )


def check_format(name: object, expected: str, path: Path, package: object = None) -> None:
    """Check a format name such as ``schuler/recording/1``.

    Raises
    ------
    FileFormatError
        If it is another format, or a newer version of this one.
    """
    family, _, version = str(name).rpartition("/")
    family_read, _, version_read = expected.rpartition("/")
    if family != family_read or not (version.isascii() and version.isdigit() and len(version) < 7):
        raise FileFormatError(f"expected the format {expected}, got {name!r}: this file holds something else", path)
    if int(version) > int(version_read):
        raise FileFormatError(
            f"the file is {name}, written by {package or 'a newer schuler'}; this one reads up to {expected}: "
            "update with pip install -U schuler",
            path,
        )


def check_series(document: Mapping[str, Any], path: Path) -> dict[str, Mapping[str, Any]]:
    """The entry ``series`` of a document; a :class:`FileFormatError` if it is damaged."""
    series = document.get("series")
    if (
        not isinstance(series, Mapping)
        or not series
        or not all(name in TABLES and isinstance(entry, Mapping) for name, entry in series.items())
    ):
        raise FileFormatError("the list of series written with the file is damaged; write it anew", path)
    return dict(series)


def _split(names: tuple[str, ...], values: FloatArray) -> Columns:
    return {name: values[:, k] for k, name in enumerate(names)}


def _join(names: tuple[str, ...], flat: Columns) -> FloatArray:
    """Columns side by side, made a block at a time so that the lines of the cache are filled while they are there."""
    joined = np.empty((len(flat[names[0]]), len(names)))
    for start in range(0, len(joined), _BLOCK):
        for k, name in enumerate(names):
            joined[start : start + _BLOCK, k] = flat[name][start : start + _BLOCK]
    for name in names:  # a day at 200 Hz is not kept twice
        del flat[name]
    return joined


def _split_cov(stem: str, cov: FloatArray) -> Columns:
    return {f"{stem}{key}": cov[:, i, j] for key, (i, j) in _ELEMENTS.items()}


def _join_cov(stem: str, flat: Columns) -> FloatArray:
    cov = np.empty((len(flat["t"]), 3, 3))
    for key, (i, j) in _ELEMENTS.items():
        cov[:, i, j] = cov[:, j, i] = flat[f"{stem}{key}"]
    return cov


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    return str(value)
