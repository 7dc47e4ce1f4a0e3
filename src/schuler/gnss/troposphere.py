"""Troposphere: Saastamoinen's zenith delays in a standard atmosphere, and their growth towards the horizon."""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.units import DEG

Mapping = Literal["cosecant", "niell"]

TOP_M = 11_000.0  # the standard atmosphere's straight temperature profile ends here [m]
BOTTOM_M = -1_000.0
LOWEST = 2.0 * DEG  # elevations below count as this: both mappings are meaningless there [rad]

#: Niell's coefficients a, b, c at 15, 30, 45, 60, 75 deg latitude: yearly mean and amplitude (hydrostatic), wet.
_LATITUDES = np.array([15.0, 30.0, 45.0, 60.0, 75.0]) * DEG
_MEAN = 1e-3 * np.array(
    [
        [1.2769934, 1.2683230, 1.2465397, 1.2196049, 1.2045996],
        [2.9153695, 2.9152299, 2.9288445, 2.9022565, 2.9024912],
        [62.610505, 62.837393, 63.721774, 63.824265, 64.258455],
    ]
)
_AMPLITUDE = 1e-5 * np.array(
    [
        [0.0, 1.2709626, 2.6523662, 3.4000452, 4.1202191],
        [0.0, 2.1414979, 3.0160779, 7.2562722, 11.723375],
        [0.0, 9.0128400, 4.3497037, 84.795348, 170.37206],
    ]
)
_WET = np.array(
    [
        [5.8021897e-4, 5.6794847e-4, 5.8118019e-4, 5.9727542e-4, 6.1641693e-4],
        [1.4275268e-3, 1.5138625e-3, 1.4572752e-3, 1.5007428e-3, 1.7599082e-3],
        [4.3472961e-2, 4.6729510e-2, 4.3908931e-2, 4.4626982e-2, 5.4736038e-2],
    ]
)
_HEIGHT = (2.53e-5, 5.49e-3, 1.14e-3)
_COLDEST_DAY, _YEAR_DAYS, _DAY_S = 28.0, 365.25, 86_400.0


def standard_atmosphere(height: ArrayLike, humidity: float = 0.7) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pressure, temperature and vapour pressure of the standard atmosphere.

    Parameters
    ----------
    height : array_like
        Above sea level; held at -1 and 11 km outside of these. The ellipsoidal height will do: 50 m are 0.6 %. [m]
    humidity : float
        Relative humidity, 0 to 1, the same at all heights.

    Returns
    -------
    pressure, temperature, vapour : ndarray
        [Pa], [K], [Pa]

    References
    ----------
    ICAO Doc 7488 (15 degC, 1013.25 hPa, -6.5 K/km); saturation over water: WMO-No. 8, annex 4.B.
    """
    if not 0.0 <= humidity <= 1.0:
        raise InputError(f"humidity: expected 0 to 1, got {humidity}; 50 percent is 0.5")
    h = np.clip(np.asarray(height, dtype=np.float64), BOTTOM_M, TOP_M)
    T = 288.15 - 6.5e-3 * h
    P = 101_325.0 * (T / 288.15) ** 5.2559
    celsius = T - 273.15
    e = 611.2 * humidity * np.exp(17.62 * celsius / (243.12 + celsius))
    return np.asarray(P), np.asarray(T), np.asarray(e)


def zenith_delays(lat: ArrayLike, height: ArrayLike, humidity: float = 0.7) -> tuple[FloatArray, FloatArray]:
    """Hydrostatic and wet delay straight up.

    Parameters
    ----------
    lat : array_like
        Latitude. [rad]
    height : array_like
        See :func:`standard_atmosphere`. [m]
    humidity : float

    Returns
    -------
    hydrostatic, wet : ndarray
        [m]

    References
    ----------
    Saastamoinen, J. (1972), Geophys. Monogr. 15, 247-251; Davis et al. (1985), Radio Science 20, eq. (A11) (gravity
    at the centre of mass of the column).
    """
    P, T, e = standard_atmosphere(height, humidity)
    h = np.clip(np.asarray(height, dtype=np.float64), BOTTOM_M, TOP_M)
    gravity = 1.0 - 2.66e-3 * np.cos(2.0 * np.asarray(lat, dtype=np.float64)) - 2.8e-7 * h
    hydrostatic, wet = 2.2768e-5 * P / gravity, 2.277e-5 * (1255.0 / T + 0.05) * e
    return np.asarray(hydrostatic), np.asarray(wet + 0.0 * hydrostatic)


def niell_mapping(
    elevation: ArrayLike, lat: ArrayLike, height: ArrayLike, gps_s: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Niell's hydrostatic and wet mapping functions: slant delay over zenith delay, good to 3 deg.

    Parameters
    ----------
    elevation : array_like
        [rad]
    lat, height : array_like
        Latitude [rad], height above sea level [m].
    gps_s : array_like
        GPS time; only the day of the year matters. [s]

    Returns
    -------
    hydrostatic, wet : ndarray
        [-]

    References
    ----------
    Niell, A. E. (1996), J. Geophys. Res. 101(B2), 3227-3246, tables 3 and 4.
    """
    lat = np.asarray(lat, dtype=np.float64)
    sine = np.sin(np.maximum(np.asarray(elevation, dtype=np.float64), LOWEST))
    day = np.asarray(gps_s, dtype=np.float64) / _DAY_S + 5.0  # 1980-01-06 is day 6; the year's length in the mean
    season = np.cos(2.0 * np.pi * (day - _COLDEST_DAY) / _YEAR_DAYS) * np.where(lat < 0.0, -1.0, 1.0)
    flat = np.abs(lat)
    a, b, c = (
        np.interp(flat, _LATITUDES, _MEAN[i]) - np.interp(flat, _LATITUDES, _AMPLITUDE[i]) * season for i in range(3)
    )
    km = np.asarray(height, dtype=np.float64) / 1000.0
    hydrostatic = _fraction(sine, a, b, c) + (1.0 / sine - _fraction(sine, *_HEIGHT)) * km
    wet = _fraction(sine, *(np.interp(flat, _LATITUDES, _WET[i]) for i in range(3)))
    return np.asarray(hydrostatic), np.asarray(wet)


def saastamoinen(
    llh: ArrayLike,
    elevation: ArrayLike,
    gps_s: ArrayLike = 0.0,
    *,
    humidity: float = 0.7,
    mapping: Mapping = "niell",
) -> FloatArray:
    """Tropospheric delay along the line of sight.

    Parameters
    ----------
    llh : array_like, shape (3,) or (n, 3)
        Receiver: latitude, longitude [rad], height [m].
    elevation : array_like, shape (n,)
        Elevation of the satellite; below 2 deg the delay of 2 deg is returned. [rad]
    gps_s : array_like, shape () or (n,)
        GPS time, for the season in Niell's mapping. [s]
    humidity : float
        Relative humidity, 0 to 1.
    mapping : {"niell", "cosecant"}
        ``cosecant`` is ``1 / sin(elevation)``: 0.1 % too long at 45 deg, 1.7 % at 15 deg, 13 % at 5 deg.

    Returns
    -------
    ndarray, shape (n,)
        Positive, to be subtracted from the pseudorange; the same on all frequencies. [m]

    Raises
    ------
    InputError
        For an unknown mapping or a humidity outside [0, 1].

    Notes
    -----
    The zenith delay of a standard atmosphere is wrong by about 5 cm, mostly in its wet part; see
    :mod:`schuler.gnss.weighting`.
    """
    llh = np.asarray(llh, dtype=np.float64)
    lat, height = llh[..., 0], llh[..., 2]
    hydrostatic, wet = zenith_delays(lat, height, humidity)
    if mapping == "niell":
        h = np.clip(height, BOTTOM_M, TOP_M)
        m_h, m_w = niell_mapping(elevation, lat, h, gps_s)
        return np.asarray(hydrostatic * m_h + wet * m_w)
    if mapping == "cosecant":
        return np.asarray((hydrostatic + wet) / np.sin(np.maximum(np.asarray(elevation, dtype=np.float64), LOWEST)))
    raise InputError(f"mapping: expected niell or cosecant, got {mapping!r}")


def _fraction(sine: FloatArray, a: ArrayLike, b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Marini's continued fraction, one at the zenith."""
    a, b, c = np.asarray(a), np.asarray(b), np.asarray(c)
    return np.asarray((1.0 + a / (1.0 + b / (1.0 + c))) / (sine + a / (sine + b / (sine + c))))
