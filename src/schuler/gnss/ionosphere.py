"""Ionosphere: Klobuchar's model of GPS and of BeiDou, and the combination of two frequencies that is free of it."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.gnss.signals import SPEED_OF_LIGHT

F_L1 = 1575.42e6  # frequency of the model's delay [Hz]
F_B1I = 1561.098e6  # the same of BeiDou's [Hz]
DAY_S = 86_400.0
_EARTH_KM, _SHELL_KM = 6378.0, 375.0  # of BeiDou's model
_BDT_BEHIND_GPS_S = 14.0


def klobuchar(
    alpha: tuple[float, float, float, float],
    beta: tuple[float, float, float, float],
    llh: ArrayLike,
    elevation: ArrayLike,
    azimuth: ArrayLike,
    gps_s: ArrayLike,
    frequency_hz: ArrayLike = F_L1,
) -> FloatArray:
    """Ionospheric delay of a code measurement by the broadcast model.

    Parameters
    ----------
    alpha, beta : tuple of 4 floats
        Amplitude [s, s/semicircle, ...] and period [s, s/semicircle, ...] as broadcast by GPS; used for all systems.
    llh : array_like, shape (3,) or (n, 3)
        Receiver: latitude, longitude [rad], height [m], which is ignored.
    elevation, azimuth : array_like, shape (n,)
        Elevation of the satellite; below the horizon it counts as zero. [rad]
    gps_s : array_like, shape () or (n,)
        GPS time; only the time of day matters. [s]
    frequency_hz : array_like, shape () or (n,)
        The delay grows with its inverse square. [Hz]

    Returns
    -------
    ndarray, shape (n,)
        Positive: the code comes late, so it is subtracted from the pseudorange. [m]

    Notes
    -----
    A thin shell at 350 km, half a cosine by day, 5 ns by night; half of the delay remains, as root mean square.
    The local time of the pierce point is taken modulo a day.

    References
    ----------
    IS-GPS-200, 20.3.3.5.2.5; Klobuchar, J. A. (1987), IEEE Trans. AES-23(3), 325-331; Groves (2013), section 9.3.2.
    """
    llh = np.asarray(llh, dtype=np.float64)
    lat, lon = llh[..., 0] / np.pi, llh[..., 1] / np.pi  # the model counts in semicircles
    E = np.maximum(np.asarray(elevation, dtype=np.float64), 0.0) / np.pi
    A = np.asarray(azimuth, dtype=np.float64)
    psi = 0.0137 / (E + 0.11) - 0.022
    pierce_lat = np.clip(lat + psi * np.cos(A), -0.416, 0.416)
    pierce_lon = lon + psi * np.sin(A) / np.cos(np.pi * pierce_lat)
    magnetic_lat = pierce_lat + 0.064 * np.cos((pierce_lon - 1.617) * np.pi)
    local = (0.5 * DAY_S * pierce_lon + np.asarray(gps_s, dtype=np.float64)) % DAY_S
    slant = 1.0 + 16.0 * (0.53 - E) ** 3
    amplitude = np.maximum(np.polynomial.polynomial.polyval(magnetic_lat, alpha), 0.0)
    period = np.maximum(np.polynomial.polynomial.polyval(magnetic_lat, beta), 72_000.0)
    x = 2.0 * np.pi * (local - 50_400.0) / period
    day = np.where(np.abs(x) < 1.57, amplitude * (1.0 - x**2 / 2.0 + x**4 / 24.0), 0.0)
    scale = (F_L1 / np.asarray(frequency_hz, dtype=np.float64)) ** 2
    return np.asarray(SPEED_OF_LIGHT * slant * (5e-9 + day) * scale)


def klobuchar_beidou(
    alpha: tuple[float, float, float, float],
    beta: tuple[float, float, float, float],
    llh: ArrayLike,
    elevation: ArrayLike,
    azimuth: ArrayLike,
    gps_s: ArrayLike,
    frequency_hz: ArrayLike = F_B1I,
) -> FloatArray:
    """Ionospheric delay of a code measurement by BeiDou's eight broadcast parameters.

    Parameters
    ----------
    alpha, beta : tuple of 4 floats
        Amplitude [s, s/semicircle, ...] and period [s, s/semicircle, ...] as messages D1 and D2 have them.
    llh, elevation, azimuth, gps_s, frequency_hz
        As for :func:`klobuchar`; at frequencies other than B1I's the delay is scaled by their inverse square.

    Returns
    -------
    ndarray, shape (n,)
        Positive. [m]

    Notes
    -----
    Unlike GPS's the shell is at 375 km and pierced by geometry, the polynomials are of the geographic latitude's size,
    the cosine is a cosine, periods stay within 20 to 48 hours, and the slant is that of a sphere.

    References
    ----------
    BDS-SIS-ICD B1I 3.0, section 5.2.4.7.
    """
    llh = np.asarray(llh, dtype=np.float64)
    lat, lon = llh[..., 0], llh[..., 1]
    E = np.maximum(np.asarray(elevation, dtype=np.float64), 0.0)
    A = np.asarray(azimuth, dtype=np.float64)
    sin_zenith = _EARTH_KM / (_EARTH_KM + _SHELL_KM) * np.cos(E)  # at the shell
    psi = 0.5 * np.pi - E - np.arcsin(sin_zenith)
    pierce_lat = np.arcsin(np.sin(lat) * np.cos(psi) + np.cos(lat) * np.sin(psi) * np.cos(A))
    pierce_lon = lon + np.arcsin(np.sin(psi) * np.sin(A) / np.cos(pierce_lat))
    seconds = np.asarray(gps_s, dtype=np.float64) - _BDT_BEHIND_GPS_S
    local = (seconds + 0.5 * DAY_S * pierce_lon / np.pi) % DAY_S
    semicircles = np.abs(pierce_lat) / np.pi
    amplitude = np.maximum(np.polynomial.polynomial.polyval(semicircles, alpha), 0.0)
    period = np.clip(np.polynomial.polynomial.polyval(semicircles, beta), 72_000.0, 172_800.0)
    x = local - 50_400.0
    day = np.where(np.abs(x) < 0.25 * period, amplitude * np.cos(2.0 * np.pi * x / period), 0.0)
    scale = (F_B1I / np.asarray(frequency_hz, dtype=np.float64)) ** 2
    return np.asarray(SPEED_OF_LIGHT * (5e-9 + day) * scale / np.sqrt(1.0 - sin_zenith**2))


def ionosphere_free(
    first: ArrayLike, second: ArrayLike, f_first_hz: ArrayLike, f_second_hz: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Combination of two pseudoranges in which delays proportional to ``1/f^2`` cancel.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        Pseudoranges of one satellite on two frequencies. [m]
    f_first_hz, f_second_hz : array_like, shape () or (n,)
        Their frequencies, different from each other. [Hz]

    Returns
    -------
    combined : ndarray, shape (n,)
        ``(f1^2 P1 - f2^2 P2) / (f1^2 - f2^2)``. [m]
    noise_factor : ndarray, shape (n,)
        Standard deviation of the combination for independent errors of 1 m on both: 2.98 for L1/L2, 2.59 for L1/L5.

    Raises
    ------
    InputError
        For equal frequencies.

    References
    ----------
    IS-GPS-200, 20.3.3.3.3.3; Groves (2013), section 9.3.2.
    """
    a, b = np.asarray(f_first_hz, dtype=np.float64) ** 2, np.asarray(f_second_hz, dtype=np.float64) ** 2
    if np.any(a == b):
        raise InputError("ionosphere-free combination: expected two different frequencies")
    first_share = a / (a - b)
    p1, p2 = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    # written about the first one: no loss of digits in the difference of two large products
    combined = p1 + (first_share - 1.0) * (p1 - p2)
    return np.asarray(combined), np.asarray(np.hypot(first_share, first_share - 1.0) + 0.0 * p1)
