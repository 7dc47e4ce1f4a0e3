"""Ionosphere by Galileo's three broadcast coefficients: the model NTCM-G, which needs no maps."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.gnss.ionosphere import DAY_S, F_L1
from schuler.timebase import GPS_EPOCH
from schuler.units import DEG

#: Coefficients k1 to k12 of the model, the last two in TECU and TECU/sfu.
_K = (
    0.92519, 0.16951, 0.00443, 0.06626, 0.00899, 0.21289, -0.15414, -0.38439, 1.14023, 1.20556, 1.41808, 0.13985,
)  # fmt: skip
_EARTH_KM, _SHELL_KM = 6371.0, 450.0
_POLE_LAT, _POLE_LON = 79.74 * DEG, -71.78 * DEG  # geomagnetic dipole
_SQUEEZED = 0.9782  # factor on zenith angles in the mapping to the shell
_DELAY = 40.3e16  # of a code by 1 TECU, times the inverse square of the frequency [m Hz^2]


def ntcm_g(
    ai: tuple[float, float, float],
    llh: ArrayLike,
    elevation: ArrayLike,
    azimuth: ArrayLike,
    gps_s: ArrayLike,
    frequency_hz: ArrayLike = F_L1,
) -> FloatArray:
    """Ionospheric delay of a code measurement by the coefficients of Galileo's effective ionisation.

    Parameters
    ----------
    ai : tuple of 3 floats
        ``ai0`` [sfu], ``ai1`` [sfu/deg], ``ai2`` [sfu/deg^2] as broadcast by Galileo; used for all systems.
    llh : array_like, shape (3,) or (n, 3)
        Receiver: latitude, longitude [rad], height [m], which is ignored.
    elevation, azimuth : array_like, shape (n,)
        Elevation of the satellite; below the horizon it counts as zero. [rad]
    gps_s : array_like, shape () or (n,)
        GPS time, counted from 1980-01-06; the day of the year and the time of day matter. [s]
    frequency_hz : array_like, shape () or (n,)
        The delay grows with its inverse square. [Hz]

    Returns
    -------
    ndarray, shape (n,)
        Positive: the code comes late, so it is subtracted from the pseudorange. [m]

    Notes
    -----
    A thin shell at 450 km, whose electron content is a product of five factors: local time with the Sun's height,
    season, geomagnetic latitude, the two crests beside the geomagnetic equator, and the Sun's activity, which the three
    coefficients tell (one number for the whole Earth). The model is of UTC; GPS time, 18 s ahead, is taken for it.
    NeQuick-G, which the coefficients are made for, needs tables of the layers and integrates along the ray.

    References
    ----------
    European Union (2022), Galileo Open Service - NTCM G Ionospheric Model Description, issue 1.0, equations 1 to 34;
    Hoque, M. M., Jakowski, N., Orus-Perez, R. (2019), GPS Solutions 23, 41.
    """
    llh = np.asarray(llh, dtype=np.float64)
    lat, lon = llh[..., 0], llh[..., 1]
    E = np.maximum(np.asarray(elevation, dtype=np.float64), 0.0)
    A, t = np.asarray(azimuth, dtype=np.float64), np.asarray(gps_s, dtype=np.float64)
    radii = _EARTH_KM / (_EARTH_KM + _SHELL_KM)
    psi = 0.5 * np.pi - E - np.arcsin(radii * np.cos(E))
    pierce_lat = np.arcsin(np.sin(lat) * np.cos(psi) + np.cos(lat) * np.sin(psi) * np.cos(A))
    pierce_lon = lon + np.arcsin(np.sin(psi) * np.sin(A) / np.cos(pierce_lat))
    day = _day_of_year(t)
    day_time = 2.0 * np.pi * (t % DAY_S) / DAY_S + pierce_lon  # mean solar time of the pierce point [rad]
    content = (
        _daily(day_time, pierce_lat, day) * _seasonal(day) * _geomagnetic(pierce_lat, pierce_lon)
        * (_K[10] + _K[11] * effective_ionisation(ai))
    )  # fmt: skip
    at_shell = np.arcsin(radii * np.sin(_SQUEEZED * (0.5 * np.pi - E)))
    return np.asarray(_DELAY / np.asarray(frequency_hz, dtype=np.float64) ** 2 * content / np.cos(at_shell))


def effective_ionisation(ai: tuple[float, float, float]) -> float:
    """Galileo's three coefficients as one number, which takes the place of the Sun's radio flux F10.7. [sfu]

    The root mean square of ``ai0 + ai1 mu + ai2 mu^2`` over modified dip latitudes ``mu`` of -70 to 70 deg (equation 2
    of the model's description, whose constants are printed to six digits).
    """
    first, second, third = ai
    square = first**2 + 1633.33 * second**2 + 4_802_000.0 * third**2 + 3266.67 * first * third
    return float(np.sqrt(square))


def _day_of_year(gps_s: FloatArray) -> FloatArray:
    """1 on the first of January."""
    date = np.datetime64(GPS_EPOCH, "D") + np.floor(gps_s / DAY_S).astype("timedelta64[D]")
    return np.asarray((date - date.astype("datetime64[Y]").astype("datetime64[D]")).astype(np.float64) + 1.0)


def _daily(day_time: FloatArray, lat: FloatArray, day: FloatArray) -> FloatArray:
    """Dependence on local time and on how high the Sun is (equations 4 to 7, 28 to 30)."""
    declination = 23.44 * DEG * np.sin(0.9856 * DEG * (day - 80.7))
    noon = np.cos(lat - declination)
    hours = (
        _K[0] * np.cos(day_time - 14.0 * 15.0 * DEG)
        + _K[1] * np.cos(2.0 * day_time) + _K[2] * np.sin(2.0 * day_time)
        + _K[3] * np.cos(3.0 * day_time) + _K[4] * np.sin(3.0 * day_time)
    )  # fmt: skip
    return np.asarray(noon + 0.4 + (noon - 2.0 / np.pi * lat * np.sin(declination)) * hours)


def _seasonal(day: FloatArray) -> FloatArray:
    """Dependence on the season, once and twice a year (equations 8 to 10)."""
    year = 2.0 * np.pi / 365.25
    return np.asarray(1.0 + _K[5] * np.cos(year * (day - 18.0)) + _K[6] * np.cos(2.0 * year * (day - 6.0)))


def _geomagnetic(lat: FloatArray, lon: FloatArray) -> FloatArray:
    """Dependence on geomagnetic latitude, and both crests beside the equator (equations 11 to 14, 31)."""
    magnetic = np.arcsin(np.sin(lat) * np.sin(_POLE_LAT) + np.cos(lat) * np.cos(_POLE_LAT) * np.cos(lon - _POLE_LON))
    north = np.exp(-0.5 * ((magnetic - 16.0 * DEG) / (12.0 * DEG)) ** 2)
    south = np.exp(-0.5 * ((magnetic + 10.0 * DEG) / (13.0 * DEG)) ** 2)
    return np.asarray((1.0 + _K[7] * np.cos(magnetic)) * (1.0 + _K[8] * north + _K[9] * south))
