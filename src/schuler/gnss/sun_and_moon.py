"""Places of the Sun and the Moon, and how they lift the solid Earth."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.units import DEG

_NOON_2000_S = 630_763_218.0  # 2000-01-01 12:00 universal time, with the leap seconds since 2017 [s]
_DAY_S, _CENTURY_DAYS = 86_400.0, 36_525.0
_TILT = 0.409088  # of the ecliptic [rad]
_AU, _EARTH_RADIUS = 1.495978707e11, 6_378_136.6  # [m]
_MASS_SUN, _MASS_MOON = 332_946.0482, 0.0123000371  # over the Earth's
#: Longitude [deg], latitude [deg] and parallax [deg] of the Moon: amplitude, phase [deg], rate [deg a century].
_MOON_LONGITUDE = (
    (6.29, 135.0, 477198.87), (-1.27, 259.3, -413335.36), (0.66, 235.7, 890534.22), (0.21, 269.9, 954397.74),
    (-0.19, 357.5, 35999.05), (-0.11, 186.5, 966404.03),
)  # fmt: skip
_MOON_LATITUDE = (
    (5.13, 93.3, 483202.02), (0.28, 228.2, 960400.89), (-0.28, 318.3, 6003.15), (-0.17, 217.6, -407332.21)
)  # fmt: skip
_MOON_PARALLAX = (
    (0.0518, 135.0, 477198.87), (0.0095, 259.3, -413335.36), (0.0078, 235.7, 890534.22), (0.0028, 269.9, 954397.74)
)  # fmt: skip
_H2, _H2_LATITUDE, _L2, _L2_LATITUDE = 0.6078, -0.0006, 0.0847, 0.0002  # Love's and Shida's numbers
_H3, _L3 = 0.292, 0.015
_K1 = -0.0253  # radial amplitude of what the diurnal wave K1 differs from them [m]


def sun_direction(t: FloatArray) -> FloatArray:
    """Direction to the Sun in Earth-fixed axes, good to 0.05 degrees.

    Parameters
    ----------
    t : ndarray, shape (n,)
        GPS time since 1980-01-06. [s]

    Returns
    -------
    ndarray, shape (n, 3)

    References
    ----------
    The Astronomical Almanac, section C (low-precision formulas for the Sun) and B (Greenwich sidereal time).
    """
    r = sun_position(t)
    return np.asarray(r / np.linalg.norm(r, axis=1)[:, None])


def sun_position(t: FloatArray) -> FloatArray:
    """Sun in Earth-fixed axes; see :func:`sun_direction`. Shape (n, 3). [m]"""
    turn, days = 2.0 * np.pi, (t - _NOON_2000_S) / _DAY_S
    anomaly = turn * np.mod(0.9931333 + 0.0027377786 * days, 1.0)
    longitude = turn * np.mod(0.7790556 + 0.0027379094 * days, 1.0) + 0.033423 * np.sin(anomaly)
    longitude += 0.000349 * np.sin(2.0 * anomaly)
    distance = _AU * (1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2.0 * anomaly))
    return _earth_fixed(longitude, np.zeros_like(days), distance, t)


def moon_position(t: FloatArray) -> FloatArray:
    """Moon in Earth-fixed axes, good to 0.3 degrees and 0.4 % of its distance.

    Parameters
    ----------
    t : ndarray, shape (n,)
        GPS time since 1980-01-06. [s]

    Returns
    -------
    ndarray, shape (n, 3)
        [m]

    References
    ----------
    The Astronomical Almanac, section D (low-precision formulas for geocentric coordinates of the Moon).
    """
    centuries = (t - _NOON_2000_S) / _DAY_S / _CENTURY_DAYS

    def series(terms: tuple[tuple[float, float, float], ...], shift: float) -> FloatArray:
        angles = [DEG * (phase + rate * centuries + shift) for _, phase, rate in terms]
        return np.asarray(sum(a * np.sin(x) for (a, _, _), x in zip(terms, angles, strict=True)))

    longitude = DEG * (218.32 + 481_267.881 * centuries + series(_MOON_LONGITUDE, 0.0))
    latitude = DEG * series(_MOON_LATITUDE, 0.0)
    parallax = DEG * (0.9508 + series(_MOON_PARALLAX, 90.0))
    return _earth_fixed(longitude, latitude, _EARTH_RADIUS / np.sin(parallax), t)


def solid_tide(r_e: FloatArray, t: FloatArray) -> FloatArray:
    """Displacement of the ground by the tides of the solid Earth, good to a centimetre; see :func:`tide_of`.

    Parameters
    ----------
    r_e : ndarray, shape (n, 3)
        Place, Earth-fixed. [m]
    t : ndarray, shape (n,)
        GPS time since 1980-01-06. [s]

    Returns
    -------
    ndarray, shape (n, 3)
        Earth-fixed, to be added to coordinates of the ITRF, which are free of tides by convention. [m]
    """
    return tide_of(r_e, sun_position(t), moon_position(t), t)


def tide_of(r_e: FloatArray, sun_e: FloatArray, moon_e: FloatArray, t: FloatArray) -> FloatArray:
    """Displacement by the tides of given Sun and Moon. Shapes (n, 3), (n, 3), (n, 3), (n,) to (n, 3). [m]

    Notes
    -----
    Degrees 2 and 3 with nominal Love and Shida numbers (step 1), and of the corrections by frequency (step 2) the
    radial part of K1, the largest one. Left out are parts out of phase and the other waves, some millimetres. The
    permanent tide is in it.

    References
    ----------
    IERS Conventions (2010), section 7.1.1.1, eq. (7.5) and (7.6); IERS Standards (1992), Technical Note 13, chapter 7.
    """
    radius = np.linalg.norm(r_e, axis=1)[:, None]
    up = r_e / radius
    legendre = 0.5 * (3.0 * up[:, 2:] ** 2 - 1.0)
    h, shida = _H2 + _H2_LATITUDE * legendre, _L2 + _L2_LATITUDE * legendre
    total = np.zeros_like(r_e)
    for body, mass in ((sun_e, _MASS_SUN), (moon_e, _MASS_MOON)):
        distance = np.linalg.norm(body, axis=1)[:, None]
        toward = body / distance
        x = np.sum(toward * up, axis=1)[:, None]
        across = toward - x * up
        second = mass * _EARTH_RADIUS**4 / distance**3
        total += second * (h * (1.5 * x**2 - 0.5) * up + 3.0 * shida * x * across)
        third = mass * _EARTH_RADIUS**5 / distance**4
        total += third * (_H3 * (2.5 * x**3 - 1.5 * x) * up + _L3 * (7.5 * x**2 - 1.5) * across)
    latitude, longitude = np.arcsin(up[:, 2]), np.arctan2(up[:, 1], up[:, 0])
    wave = _K1 * np.sin(latitude) * np.cos(latitude) * np.sin(_sidereal(t) + longitude)
    return np.asarray(total + wave[:, None] * up)


def _sidereal(t: FloatArray) -> FloatArray:
    """Angle by which the Earth has turned against the equinox. Shape (n,). [rad]"""
    return np.asarray(2.0 * np.pi * np.mod(0.7790572733 + 1.0027379093508 * (t - _NOON_2000_S) / _DAY_S, 1.0))


def _earth_fixed(longitude: FloatArray, latitude: FloatArray, distance: FloatArray, t: FloatArray) -> FloatArray:
    """Ecliptic coordinates of the date in Earth-fixed axes. Shape (n, 3)."""
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    z = np.sin(latitude)
    y, z = np.cos(_TILT) * y - np.sin(_TILT) * z, np.sin(_TILT) * y + np.cos(_TILT) * z
    c, s = np.cos(_sidereal(t)), np.sin(_sidereal(t))
    return np.asarray(distance[:, None] * np.stack((c * x + s * y, -s * x + c * y, z), axis=-1))
