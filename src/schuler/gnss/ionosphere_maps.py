"""Maps of the ionosphere's electron content over time, and the delay along a line of sight through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.ionosphere import DAY_S, F_L1

_TECU = 1e16  # electrons a square metre
_DELAY = 40.308  # of a code: this times electrons a square metre over the frequency squared [m^3/s^2]
_UNSTATED = 3.0  # 1-sigma of maps that state none; the IGS gives 2 to 8 for final ones [TECU]
_MODIFIED = (0.9782, 506_700.0)  # factor of the zenith angle and height of the shell of the modified mapping [m]
_GAP = 1.5  # in steps between maps, over which nothing is interpolated


@dataclass(frozen=True)
class IonosphereMaps:
    """Vertical electron content on a thin shell, on a grid of places, at some times.

    Attributes
    ----------
    t : ndarray, shape (k,)
        GPS time since 1980-01-06, increasing. [s]
    lat, lon : ndarray, shape (a,), (b,)
        Geocentric latitude and longitude, both increasing; longitudes span a whole turn, both ends there. [rad]
    content : ndarray, shape (k, a, b)
        NaN where there is none. [TECU]
    sigma : ndarray, shape (k, a, b)
        1-sigma; NaN where it is not stated. [TECU]
    height, radius : float
        Of the shell above the base sphere, and of the base sphere. [m]
    modified : bool
        Zenith angles at the shell by the modified single-layer mapping, as the maps were made; else by geometry.
    notes : tuple of str
    """

    t: FloatArray
    lat: FloatArray
    lon: FloatArray
    content: FloatArray
    sigma: FloatArray
    height: float
    radius: float
    modified: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.t), len(self.lat), len(self.lon))
        for name in ("content", "sigma"):
            if getattr(self, name).shape != shape:
                raise InputError(f"IonosphereMaps.{name}: expected shape {shape}, got {getattr(self, name).shape}")
        if any(np.any(np.diff(x) <= 0.0) for x in (self.t, self.lat, self.lon)):
            raise InputError("IonosphereMaps: expected increasing times, latitudes and longitudes")
        if abs(self.lon[-1] - self.lon[0] - 2.0 * np.pi) > 1e-6:
            raise InputError("IonosphereMaps: expected longitudes of a whole turn, the first one again at the end")

    def merged_with(self, other: IonosphereMaps) -> IonosphereMaps:
        """Maps of both, such as two days; where both have a time this one's counts.

        Raises
        ------
        InputError
            If their grids or shells differ.
        """
        alike = self.lat.shape == other.lat.shape and self.lon.shape == other.lon.shape
        shells = [(x.height, x.radius, x.modified) for x in (self, other)]
        if (
            not alike
            or not np.allclose(self.lat, other.lat)
            or not np.allclose(self.lon, other.lon)
            or len(set(shells)) > 1
        ):
            raise InputError("ionosphere maps of different grids or shells cannot be joined: give those of one centre")
        t, first = np.unique(np.concatenate((self.t, other.t)), return_index=True)
        content, sigma = (np.concatenate((getattr(self, n), getattr(other, n)))[first] for n in ("content", "sigma"))
        return IonosphereMaps(t, self.lat, self.lon, content, sigma, *shells[0], self.notes + other.notes)


def map_delays(
    maps: IonosphereMaps, llh: ArrayLike, elevation: ArrayLike, azimuth: ArrayLike, gps_s: ArrayLike,
    frequency_hz: ArrayLike = F_L1,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Ionospheric delay of a code measurement by maps, and its uncertainty.

    Parameters
    ----------
    maps : IonosphereMaps
    llh : array_like, shape (3,) or (n, 3)
        Receiver; its height counts as that of the base sphere. [rad, rad, m]
    elevation, azimuth : array_like, shape (n,)
        Below the horizon the elevation counts as zero. [rad]
    gps_s : array_like, shape () or (n,)
        GPS time since 1980-01-06. [s]
    frequency_hz : array_like, shape () or (n,)

    Returns
    -------
    delay, sigma : ndarray, shape (n,)
        Positive: the code comes late. NaN outside of the maps' times and where they have no value. [m], [m]

    Notes
    -----
    Where the line of sight pierces the shell, four neighbours of each of the two maps around the time are interpolated
    bilinearly, and both linearly in time, each map turned with the Sun since its own time: the ionosphere stays below
    the Sun much more than above the ground.

    References
    ----------
    Schaer, S., Gurtner, W., Feltens, J. (1998), IONEX: The IONosphere Map EXchange Format Version 1, section 3, eq. (3)
    and the appendix; Schaer, S. (1999), Mapping and Predicting the Earth's Ionosphere Using GPS, dissertation, Bern,
    section 2.2 (mapping functions).
    """
    llh = np.asarray(llh, dtype=np.float64)
    zenith = 0.5 * np.pi - np.maximum(np.asarray(elevation, dtype=np.float64), 0.0)
    azimuth, t = np.asarray(azimuth, dtype=np.float64), np.asarray(gps_s, dtype=np.float64)
    at_shell = np.arcsin(maps.radius / (maps.radius + maps.height) * np.sin(zenith))
    angle = zenith - at_shell  # between receiver and pierce point, seen from the Earth's centre
    lat_0 = _geocentric(llh[..., 0])
    lat = np.arcsin(np.clip(np.sin(lat_0) * np.cos(angle) + np.cos(lat_0) * np.sin(angle) * np.cos(azimuth), -1.0, 1.0))
    lon = llh[..., 1] + np.arctan2(
        np.sin(angle) * np.sin(azimuth),
        np.cos(lat_0) * np.cos(angle) - np.sin(lat_0) * np.sin(angle) * np.cos(azimuth),
    )
    t, lat, lon = (np.array(x) for x in np.broadcast_arrays(t, lat, lon))
    content, sigma = _at(maps, t, lat, lon)
    if maps.modified:
        factor, height = _MODIFIED
        at_shell = np.arcsin(maps.radius / (maps.radius + height) * np.sin(factor * zenith))
    scale = _DELAY * _TECU / np.asarray(frequency_hz, dtype=np.float64) ** 2 / np.cos(at_shell)
    return np.asarray(scale * content), np.asarray(scale * np.where(np.isfinite(sigma), sigma, _UNSTATED))


def _geocentric(lat: FloatArray) -> FloatArray:
    """Geocentric latitude at the ellipsoid (WGS 84). [rad]"""
    return np.asarray(np.arctan((1.0 - 6.69437999014e-3) * np.tan(lat)))


def _at(maps: IonosphereMaps, t: FloatArray, lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Content and 1-sigma at times and places of the shell. Shapes (n,). [TECU]"""
    k = np.clip(np.searchsorted(maps.t, t, side="right") - 1, 0, max(len(maps.t) - 2, 0))
    last = np.minimum(k + 1, len(maps.t) - 1)
    width = maps.t[last] - maps.t[k]
    usual = float(np.median(np.diff(maps.t))) if len(maps.t) > 1 else 0.0
    inside: BoolArray = (t >= maps.t[k]) & (t <= maps.t[last]) & (width <= _GAP * usual)
    share = np.where(width > 0.0, (t - maps.t[k]) / np.where(width > 0.0, width, 1.0), 0.0)
    values = []
    for table in (maps.content, maps.sigma):
        early = _in_map(table, maps, k, lat, lon + 2.0 * np.pi * (t - maps.t[k]) / DAY_S)
        late = _in_map(table, maps, last, lat, lon + 2.0 * np.pi * (t - maps.t[last]) / DAY_S)
        values.append(np.where(inside, (1.0 - share) * early + share * late, np.nan))
    return values[0], values[1]


def _in_map(table: FloatArray, maps: IonosphereMaps, k: IntArray, lat: FloatArray, lon: FloatArray) -> FloatArray:
    """Bilinear values of maps k at places; beyond the outermost latitudes theirs. Shape (n,)."""
    lat = np.clip(lat, maps.lat[0], maps.lat[-1])
    lon = maps.lon[0] + np.mod(lon - maps.lon[0], 2.0 * np.pi)
    i = np.clip(np.searchsorted(maps.lat, lat, side="right") - 1, 0, len(maps.lat) - 2)
    j = np.clip(np.searchsorted(maps.lon, lon, side="right") - 1, 0, len(maps.lon) - 2)
    p = (lat - maps.lat[i]) / (maps.lat[i + 1] - maps.lat[i])
    q = (lon - maps.lon[j]) / (maps.lon[j + 1] - maps.lon[j])
    south = (1.0 - q) * table[k, i, j] + q * table[k, i, j + 1]
    north = (1.0 - q) * table[k, i + 1, j] + q * table[k, i + 1, j + 1]
    return np.asarray((1.0 - p) * south + p * north)
