"""Where the pixels of a picture are: world files and GeoTIFF tags; longitude and latitude, Web Mercator, UTM."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.earth import WGS84
from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.plotting.figure import ByteArray

_SCALE, _TIE, _TRANSFORM, _KEYS = 33550, 33922, 34264, 34735  # tags of GeoTIFF
_RASTER_TYPE, _GEOGRAPHIC, _PROJECTED = 1025, 2048, 3072  # its keys
_FALSE_EAST, _FALSE_NORTH, _UTM_SCALE = 500_000.0, 10_000_000.0, 0.9996
_MERCATOR = "Web Mercator"
_DEGREES = "longitude and latitude"


@dataclass(frozen=True)
class Georeference:
    """Place of a picture.

    Attributes
    ----------
    affine : tuple of 6 floats
        ``x = a column + b row + c``, ``y = d column + e row + f``, of the upper left corner of a pixel.
    crs : str, optional
        ``longitude and latitude`` [deg], ``Web Mercator`` [m], ``UTM 13N`` [m]; None if the file does not say: then the
        one of the three that puts the picture onto the track.
    """

    affine: tuple[float, float, float, float, float, float]
    crs: str | None = None

    def pixel(
        self, lon: FloatArray, lat: FloatArray, near_llh: FloatArray, shape: tuple[int, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Column and row (with fractions) of places.

        Parameters
        ----------
        lon, lat : ndarray, shape (n,)
            [rad]
        near_llh : ndarray, shape (3,)
            A point of the track, whose UTM zone is tried.
        shape : tuple of int
            Shape of the picture.
        """
        x, y = project(self.crs_near(near_llh, shape), lon, lat)
        a, b, c, d, e, f = self.affine
        determinant = a * e - b * d
        u, v = x - c, y - f
        return (e * u - b * v) / determinant, (a * v - d * u) / determinant

    def crs_near(self, near_llh: FloatArray, shape: tuple[int, ...]) -> str:
        """The coordinates that are meant: as the file says, or those that bring the picture nearest to the track."""
        if self.crs is not None:
            return self.crs
        a, b, c, d, e, f = self.affine
        h, w = shape[0], shape[1]
        middle = a * w / 2 + b * h / 2 + c, d * w / 2 + e * h / 2 + f
        size = max(abs(a) * w + abs(b) * h, abs(d) * w + abs(e) * h)

        def distance(crs: str) -> float:
            x, y = project(crs, near_llh[1:2], near_llh[:1])
            return float(np.hypot(x[0] - middle[0], y[0] - middle[1])) / size

        return min((_DEGREES, _MERCATOR, utm_zone(near_llh)), key=distance)

    def describe(self, near_llh: FloatArray, shape: tuple[int, ...]) -> str:
        """Coordinates and the picture's corners in them."""
        a, b, c, d, e, f = self.affine
        h, w = shape[0], shape[1]
        digits = 4 if self.crs_near(near_llh, shape) == _DEGREES else 0
        return (
            f"{self.crs_near(near_llh, shape)}, from ({c:.{digits}f}, {f:.{digits}f}) to "
            f"({a * w + b * h + c:.{digits}f}, {d * w + e * h + f:.{digits}f})"
        )


def read_picture(path: Path) -> tuple[ByteArray, Georeference]:
    """Pixels (h, w, 4) of a picture, and where it is.

    Raises
    ------
    FileFormatError
        If it cannot be read, or nothing says where it is.
    MissingExtraError
        Without Pillow.
    """
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError:
        raise MissingExtraError("Pillow", "plot", "a picture as background") from None
    try:
        with Image.open(path) as image:
            tags: dict[int, Any] = dict(getattr(image, "tag_v2", {}))
            pixels = np.asarray(image.convert("RGBA"))
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError) as error:
        raise FileFormatError(
            f"background: this picture cannot be read ({error}); expected PNG, JPEG or GeoTIFF, cut to the area", path
        ) from None
    world = _world_file(path)
    if world is not None:
        return pixels, Georeference(_world(world), _from_prj(path))
    if _KEYS in tags:
        return pixels, _geotiff(tags, path)
    raise FileFormatError(
        f"background: nothing says where this picture is; expected a world file beside it "
        f"({path.with_suffix(_world_suffix(path)).name}) or a GeoTIFF",
        path,
    )


def project(crs: str, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coordinates of places.

    Parameters
    ----------
    crs : str
        As :attr:`Georeference.crs`.
    lon, lat : ndarray, shape (n,)
        [rad]

    References
    ----------
    Kruger (1912) as in Karney (2011), J. Geodesy 85(8), to the third order of n: below a millimetre in a zone.
    """
    if crs == _DEGREES:
        return lon / units.DEG, lat / units.DEG
    if crs == _MERCATOR:
        return WGS84.a * lon, WGS84.a * np.arcsinh(np.tan(lat))
    number, north = int(crs[4:-1]), crs.endswith("N")
    n = WGS84.f / (2.0 - WGS84.f)
    radius = WGS84.a / (1.0 + n) * (1.0 + n**2 / 4.0)
    alpha = (
        n / 2.0 - 2.0 * n**2 / 3.0 + 5.0 * n**3 / 16.0, 13.0 * n**2 / 48.0 - 3.0 * n**3 / 5.0, 61.0 * n**3 / 240.0,
    )  # fmt: skip
    e = np.sqrt(WGS84.f * (2.0 - WGS84.f))
    dlon = lon - (6.0 * number - 183.0) * units.DEG
    tau = np.sinh(np.arctanh(np.sin(lat)) - e * np.arctanh(e * np.sin(lat)))
    xi, eta = np.arctan2(tau, np.cos(dlon)), np.arcsinh(np.sin(dlon) / np.hypot(tau, np.cos(dlon)))
    x, y = eta.copy(), xi.copy()
    for j, coefficient in enumerate(alpha, start=1):
        x += coefficient * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        y += coefficient * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
    k = _UTM_SCALE * radius
    return _FALSE_EAST + k * x, k * y + (0.0 if north else _FALSE_NORTH)


def utm_zone(llh: FloatArray) -> str:
    """The UTM zone of a place, such as ``UTM 13N`` (without the exceptions around Norway)."""
    number = int(np.floor(llh[1] / units.DEG / 6.0)) % 60
    return f"UTM {(number + 30) % 60 + 1}{'N' if llh[0] >= 0.0 else 'S'}"


def _world_suffix(path: Path) -> str:
    """.pgw of .png, .jgw of .jpg and .jpeg, .tfw of .tif."""
    s = path.suffix.lower()
    return f".{s[1]}{s[-1]}w"


def _world_file(path: Path) -> Path | None:
    names = [path.with_suffix(_world_suffix(path)), path.with_name(path.name + "w"), path.with_suffix(".wld")]
    names += [n.with_suffix(n.suffix.upper()) for n in names]
    return next((n for n in names if n.is_file()), None)


def _world(path: Path) -> tuple[float, float, float, float, float, float]:
    """Six numbers a, d, b, e, c, f; c and f of the middle of the upper left pixel."""
    try:
        a, d, b, e, c, f = (float(word.replace(",", ".")) for word in path.read_text(encoding="ascii").split())
    except (ValueError, UnicodeDecodeError):
        raise FileFormatError("background: expected a world file of six numbers", path) from None
    if a * e - b * d == 0.0:
        raise FileFormatError("background: the world file's pixels have no area", path)
    return a, b, c - 0.5 * (a + b), d, e, f - 0.5 * (d + e)


def _from_prj(path: Path) -> str | None:
    """Coordinates by the name in a .prj file (well-known text) beside the picture; None without one."""
    prj = path.with_suffix(".prj")
    if not prj.is_file():
        return None
    text = prj.read_text(encoding="utf-8", errors="replace")
    zone = re.search(r"UTM[ _]zone[ _](\d{1,2})([NS])?", text, re.IGNORECASE)
    if zone:
        south = zone[2] in ("S", "s") or "10000000" in text
        return f"UTM {int(zone[1])}{'S' if south else 'N'}"
    if "Pseudo-Mercator" in text or "Pseudo_Mercator" in text or "Web_Mercator" in text:
        return _MERCATOR
    if "PROJC" not in text:
        return _DEGREES
    name = text.split('"')[1] if '"' in text else text[:40]
    raise FileFormatError(f"background: {_only(name)}", prj)


def _geotiff(tags: dict[int, Any], path: Path) -> Georeference:
    keys = {int(k): int(v) for k, place, _, v in np.reshape(tags[_KEYS], (-1, 4))[1:].tolist() if place == 0}
    if _TRANSFORM in tags:
        m = tags[_TRANSFORM]
        affine = (m[0], m[1], m[3], m[4], m[5], m[7])
    elif _SCALE in tags and _TIE in tags:
        (sx, sy), (i, j, _, x, y) = tags[_SCALE][:2], tags[_TIE][:5]
        affine = (sx, 0.0, x - i * sx, 0.0, -sy, y + j * sy)
    else:
        raise FileFormatError("background: this GeoTIFF has no scale with a tie point, and no transformation", path)
    a, b, c, d, e, f = (float(v) for v in affine)
    if keys.get(_RASTER_TYPE) == 2:  # of the middle of the pixel
        c, f = c - 0.5 * (a + b), f - 0.5 * (d + e)
    code = keys.get(_PROJECTED, 0)
    if code:
        crs = _of_epsg(code)
        if crs is None:
            raise FileFormatError(f"background: {_only(f'EPSG:{code}')}", path)
    elif keys.get(_GEOGRAPHIC):
        crs = _DEGREES
    else:
        crs = None
    return Georeference((a, b, c, d, e, f), crs)


def _of_epsg(code: int) -> str | None:
    """WGS 84, ETRS89 and NAD83 agree to a metre or two, which no map behind a track shows."""
    if code in (3857, 900913):
        return _MERCATOR
    for first, zones, offset, letter in (
        (32601, 60, 1, "N"), (32701, 60, 1, "S"), (25828, 11, 28, "N"), (26901, 23, 1, "N"),
    ):  # fmt: skip
        if first <= code < first + zones:
            return f"UTM {code - first + offset}{letter}"
    return None


def _only(what: str) -> str:
    return f"expected longitude and latitude, Web Mercator or UTM, got {what}; convert with gdalwarp -t_srs EPSG:3857"
