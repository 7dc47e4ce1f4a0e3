"""IONEX files: maps of the ionosphere's electron content, version 1.

Source: Schaer, Gurtner and Feltens (1998), IONEX: The IONosphere Map EXchange Format Version 1; version 1.1 (2015).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.ionosphere_maps import IonosphereMaps
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.formats.sp3 import gps_times
from schuler.recording.io.lines import shorten
from schuler.units import DEG

VERSION = "IONEX VERSION / TYPE"
_NO_VALUE = 9999  # of a place without content
_LARGEST = 1000.0  # content that there may be [TECU]
_KINDS = ("TEC", "RMS", "HEIGHT")


@dataclass
class _Header:
    """Grid and shell of a file: (first, last, step) of latitudes, longitudes [deg] and heights [km]."""

    axes: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    exponent: int = -1
    radius: float = 6371.0
    modified: bool = False


def read_ionex(path: Path | str) -> IonosphereMaps:
    """Maps of electron content and of their errors.

    Parameters
    ----------
    path : Path or str
        Version 1; plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    IonosphereMaps
        On GPS time (the files have universal time). Longitudes are closed to a whole turn where the file ends a step
        before it. Maps of heights are passed over.

    Raises
    ------
    FileFormatError
        With file and line, for what is no IONEX file, maps of more than one height, malformed lines, maps that do not
        fill their grid, contents that are impossible, and epochs out of order.
    """
    path = Path(path)
    notes: list[str] = []
    lines = unpack(path, notes).decode("latin-1").splitlines()
    if not lines or lines[0][60:].strip() != VERSION or not lines[0][:8].strip().startswith("1."):
        raise FileFormatError(f"expected an IONEX file of version 1, got {shorten(lines[0] if lines else '')}", path, 1)
    header, body = _header(lines, path)
    lat, lon = (_grid(header.axes[name], path) for name in ("LAT", "LON"))
    dates: list[list[float]] = []
    maps: dict[str, dict[int, FloatArray]] = {kind: {} for kind in _KINDS}
    at = body
    while at < len(lines):
        kind = next((x for x in _KINDS if lines[at][60:].strip() == f"START OF {x} MAP"), None)
        if kind is None:
            at += 1
            continue
        begin, at = (
            at,
            next((k for k in range(at, len(lines)) if lines[k][60:].strip() == f"END OF {kind} MAP"), len(lines)),
        )
        if at == len(lines):
            notes.append(f"{path.name} is cut within a map, which was left out")
            break
        if kind == "HEIGHT":
            continue
        date, values = _map(lines, begin, at, header, lat, lon, path)
        if date not in dates:
            dates.append(date)
        maps[kind][dates.index(date)] = values
    if not maps["TEC"]:
        raise FileFormatError("no map of electron content is complete in it", path)
    keep = sorted(maps["TEC"])
    t = gps_times(np.array([dates[k] for k in keep]), "UTC", path)
    none = np.full((len(lat), len(lon)), np.nan)
    content = np.stack([maps["TEC"][k] for k in keep])
    sigma = np.stack([maps["RMS"].get(k, none) for k in keep])
    lat, lon, content, sigma = _increasing(lat, lon, content, sigma)
    height = header.axes["HGT"][0] * 1e3
    try:
        return IonosphereMaps(t, lat, lon, content, sigma, height, header.radius * 1e3, header.modified, tuple(notes))
    except InputError as error:
        raise FileFormatError(str(error), path) from None


def _header(lines: list[str], path: Path) -> tuple[_Header, int]:
    """Header and the first line after it."""
    out = _Header()
    for k, line in enumerate(lines):
        label, text = line[60:].strip(), line[:60]
        if label == "END OF HEADER":
            missing = [name for name in ("LAT", "LON", "HGT") if name not in out.axes]
            if missing:
                raise FileFormatError(
                    f"expected {missing[0]}1 / {missing[0]}2 / D{missing[0]} in the header", path, k + 1
                )
            return out, k + 1
        for name in ("LAT", "LON", "HGT"):
            if label.startswith(f"{name}1 / {name}2"):
                first, last, step = _numbers(text, 3, path, k)
                out.axes[name] = (first, last, step)
        if label == "EXPONENT":
            out.exponent = int(_numbers(text, 1, path, k)[0])
        elif label == "BASE RADIUS":
            out.radius = _numbers(text, 1, path, k)[0]
        elif label == "MAPPING FUNCTION":
            out.modified = text.strip() == "MSLM"
        elif label == "MAP DIMENSION" and _numbers(text, 1, path, k)[0] != 2:
            raise FileFormatError("expected maps of one height (dimension 2), got those of several", path, k + 1)
    raise FileFormatError("the header has no END OF HEADER", path, len(lines))


def _grid(axis: tuple[float, float, float], path: Path) -> FloatArray:
    """Values of an axis in the order of the file. [deg]"""
    first, last, step = axis
    count = round((last - first) / step) + 1 if step else 0
    if count < 2 or abs(first + (count - 1) * step - last) > 1e-3:
        raise FileFormatError(f"expected a grid from {first:g} to {last:g} degrees in whole steps, got {step:g}", path)
    return np.asarray(first + step * np.arange(count), dtype=np.float64)


def _map(
    lines: list[str], begin: int, end: int, header: _Header, lat: FloatArray, lon: FloatArray, path: Path
) -> tuple[list[float], FloatArray]:
    """Date of a map and its values in the order of the file. (a, b) [TECU]"""
    date, exponent, row = None, header.exponent, -1
    table: list[list[float]] = [[] for _ in lat]
    for k in range(begin + 1, end):
        line, label = lines[k], lines[k][60:].strip()
        if label == "EPOCH OF CURRENT MAP":
            date = _numbers(line[:36], 6, path, k)
        elif label == "EXPONENT":
            exponent = int(_numbers(line[:60], 1, path, k)[0])
        elif label.startswith("LAT/LON1"):
            row = int(np.argmin(np.abs(lat - _numbers(line[2:8], 1, path, k)[0])))
        elif row < 0:
            raise FileFormatError(f"expected a latitude before values, got {shorten(line)}", path, k + 1)
        else:
            width = [line[i : i + 5] for i in range(0, len(line.rstrip()), 5)]
            values = _numbers(" ".join(width), len(width), path, k)
            table[row] += [np.nan if v == _NO_VALUE else v * 10.0**exponent for v in values]
    if date is None:
        raise FileFormatError("expected EPOCH OF CURRENT MAP in the map that begins here", path, begin + 1)
    if any(len(values) != len(lon) for values in table):
        raise FileFormatError(
            f"expected {len(lat)} latitudes of {len(lon)} values in the map that begins here", path, begin + 1
        )
    out = np.array(table)
    if np.nanmax(np.abs(out), initial=0.0) > _LARGEST:
        raise FileFormatError(
            f"expected contents below {_LARGEST:g} TECU, got {np.nanmax(np.abs(out)):g}: is EXPONENT right?",
            path,
            begin + 1,
        )
    return date, out


def _increasing(
    lat: FloatArray, lon: FloatArray, content: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Axes in increasing order [rad], and closed in longitude."""
    if lat[1] < lat[0]:
        lat, content, sigma = lat[::-1], content[:, ::-1], sigma[:, ::-1]
    if lon[1] < lon[0]:
        lon, content, sigma = lon[::-1], content[:, :, ::-1], sigma[:, :, ::-1]
    if abs(lon[-1] + (lon[1] - lon[0]) - lon[0] - 360.0) < 1e-6:
        lon = np.append(lon, lon[0] + 360.0)
        content, sigma = (np.concatenate((x, x[:, :, :1]), axis=2) for x in (content, sigma))
    return DEG * lat, DEG * lon, np.ascontiguousarray(content), np.ascontiguousarray(sigma)


def _numbers(text: str, count: int, path: Path, line: int) -> list[float]:
    try:
        values = [float(v) for v in text.split()]
    except ValueError:
        values = []
    if len(values) < count or not np.isfinite(values).all():
        raise FileFormatError(f"expected {count} numbers, got {shorten(text.strip())}", path, line + 1)
    return values[:count]
