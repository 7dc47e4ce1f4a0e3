"""The Earth: reference ellipsoids, radii of curvature, gravity, Earth rate and transport rate.

Two words are kept apart. *Gravitation* is the attraction of mass alone; *gravity* is gravitation plus the centrifugal
acceleration of the rotating Earth, what a plumb line shows. All latitudes are geodetic, all heights ellipsoidal.

References
----------
Groves (2013), chapter 2.4; Moritz, Geodetic Reference System 1980 (zonal coefficients of a level ellipsoid);
NIMA TR 8350.2 (WGS 84 constants).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from schuler.arrays import ArrayLike, FloatArray


@dataclass(frozen=True)
class Ellipsoid:
    """A level ellipsoid: its shape, mass and rotation define its gravity field completely.

    Attributes
    ----------
    a : float
        Equatorial radius. [m]
    f : float
        Flattening. [-]
    GM : float
        Gravitational parameter. [m^3/s^2]
    omega_ie : float
        Rotation rate. [rad/s]
    gamma_e : float
        Normal gravity on the equator. [m/s^2]
    k : float
        Somigliana's constant ``b gamma_p / (a gamma_e) - 1``. [-]
    J2 : float
        Dynamical form factor (second zonal harmonic). [-]
    """

    name: str
    a: float
    f: float
    GM: float
    omega_ie: float
    gamma_e: float
    k: float
    J2: float

    @property
    def b(self) -> float:
        """Polar radius. [m]"""
        return self.a * (1.0 - self.f)

    @property
    def e2(self) -> float:
        """First eccentricity squared. [-]"""
        return self.f * (2.0 - self.f)

    @cached_property
    def zonals(self) -> tuple[float, float, float]:
        """Zonal harmonics J2, J4, J6 of the normal gravity field. [-]

        The field of a level ellipsoid has only even zonals, and they follow from J2 and the eccentricity
        (Moritz, eq. (2-92) of Heiskanen & Moritz). J8 = -1.4e-11 adds less than 1.3e-9 m/s^2 and is left out.
        """
        e2 = self.e2
        J4, J6 = (
            (-1) ** (n + 1) * 3.0 * e2**n / ((2 * n + 1) * (2 * n + 3)) * (1.0 - n + 5.0 * n * self.J2 / e2)
            for n in (2, 3)
        )
        return self.J2, J4, J6


WGS84 = Ellipsoid(
    name="WGS 84",
    a=6378137.0,
    f=1.0 / 298.257223563,
    GM=3.986004418e14,
    omega_ie=7.292115e-5,
    gamma_e=9.7803253359,
    k=0.00193185265241,
    J2=1.082629821313e-3,
)
GRS80 = Ellipsoid(
    name="GRS 80",
    a=6378137.0,
    f=1.0 / 298.257222101,
    GM=3.986005e14,
    omega_ie=7.292115e-5,
    gamma_e=9.7803267715,
    k=0.001931851353,
    J2=1.08263e-3,
)


def radii_of_curvature(lat: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> tuple[FloatArray, FloatArray]:
    """Meridian and transverse radius of curvature.

    Parameters
    ----------
    lat : array_like
        Geodetic latitude. [rad]
    ellipsoid : Ellipsoid

    Returns
    -------
    R_N, R_E : ndarray
        Meridian (north-south) and transverse (east-west) radius, shape of ``lat``. [m]

    References
    ----------
    Groves (2013), eqs. (2.105), (2.106); Yaman (2017), eqs. (2-1), (2-2).
    """
    w2 = 1.0 - ellipsoid.e2 * np.sin(np.asarray(lat, dtype=np.float64)) ** 2
    w = np.sqrt(w2)
    return ellipsoid.a * (1.0 - ellipsoid.e2) / (w2 * w), ellipsoid.a / w


def gravity_somigliana(lat: ArrayLike, h: ArrayLike = 0.0, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Magnitude of normal gravity: Somigliana's closed formula with a second-order height reduction.

    Parameters
    ----------
    lat : array_like
        Geodetic latitude. [rad]
    h : array_like
        Ellipsoidal height. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    ndarray
        Down component of gravity; broadcast shape of ``lat`` and ``h``. [m/s^2]

    Notes
    -----
    Exact on the ellipsoid. The height reduction is a truncated series: against the exact field of
    :func:`gravity_ned` it is 7e-7 m/s^2 off at 10 km and 1.5e-4 m/s^2 at 100 km, and it has no north component.

    References
    ----------
    Groves (2013), eqs. (2.134), (2.139); Stefanisko (2015), eq. (1.23) with the missing factor ``1 - 2 sin^2 L`` of
    the flattening restored.
    """
    s2 = np.sin(np.asarray(lat, dtype=np.float64)) ** 2
    h = np.asarray(h, dtype=np.float64)
    E = ellipsoid
    surface = E.gamma_e * (1.0 + E.k * s2) / np.sqrt(1.0 - E.e2 * s2)
    m = E.omega_ie**2 * E.a**2 * E.b / E.GM
    gravity: FloatArray = surface * (1.0 - 2.0 / E.a * (1.0 + E.f * (1.0 - 2.0 * s2) + m) * h + 3.0 / E.a**2 * h**2)
    return gravity


def gravitation_j2(r_eb_e: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Gravitation of a point mass with the second zonal harmonic, in Earth-fixed axes.

    Parameters
    ----------
    r_eb_e : array_like, shape (..., 3)
        Position. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    ndarray, shape (..., 3)
        Attraction of mass alone, without the centrifugal part. [m/s^2]

    References
    ----------
    Groves (2013), eq. (2.142).
    """
    return _gravitation(r_eb_e, (ellipsoid.J2, 0.0, 0.0), ellipsoid)


def gravitation_ecef(r_eb_e: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Normal gravitation (zonal harmonics to degree 6) in Earth-fixed axes. Shapes (..., 3) [m] to (..., 3) [m/s^2]."""
    return _gravitation(r_eb_e, ellipsoid.zonals, ellipsoid)


def gravity_ecef(r_eb_e: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Normal gravity in Earth-fixed axes: the model of both mechanizations and of the simulator.

    Parameters
    ----------
    r_eb_e : array_like, shape (..., 3)
        Position, on or outside the ellipsoid or a little inside. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    ndarray, shape (..., 3)
        Gravitation plus centrifugal acceleration. [m/s^2]

    Notes
    -----
    The exact field of the level ellipsoid to 2e-9 m/s^2 on its surface (the first harmonic left out), closer above;
    it has the small north component at height that the usual formula lacks, 8e-9 m/s^2 per metre at 45 deg.
    """
    r = np.asarray(r_eb_e, dtype=np.float64)
    centrifugal: FloatArray = ellipsoid.omega_ie**2 * r * np.array([1.0, 1.0, 0.0])
    return gravitation_ecef(r, ellipsoid) + centrifugal


def gravity_ned(lat: ArrayLike, h: ArrayLike = 0.0, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Normal gravity in north-east-down axes: the same field as :func:`gravity_ecef`.

    Parameters
    ----------
    lat : array_like
        Geodetic latitude. [rad]
    h : array_like
        Ellipsoidal height. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    gravity_n : ndarray, shape (..., 3)
        North, east, down; at rest the accelerometers read its negative. [m/s^2]
    """
    lat, h = np.broadcast_arrays(np.asarray(lat, dtype=np.float64), np.asarray(h, dtype=np.float64))
    s, c = np.sin(lat), np.cos(lat)
    R_E = ellipsoid.a / np.sqrt(1.0 - ellipsoid.e2 * s * s)
    zero = np.zeros_like(s)
    r = np.stack(((R_E + h) * c, zero, ((1.0 - ellipsoid.e2) * R_E + h) * s), axis=-1)
    g = gravity_ecef(r, ellipsoid)
    return np.stack((-s * g[..., 0] + c * g[..., 2], zero, -c * g[..., 0] - s * g[..., 2]), axis=-1)


def gravity_gradient_ecef(r_eb_e: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Derivative of gravity with respect to position, spherical part plus centrifugal, for error models.

    Parameters
    ----------
    r_eb_e : array_like, shape (..., 3)
        Position. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Change of gravity per metre, Earth-fixed axes. [1/s^2]

    Notes
    -----
    Flattening changes it by 0.5 percent, far below what an error model of a filter needs.

    References
    ----------
    Groves (2013), eq. (14.49), written without the approximation of its trace.
    """
    r = np.asarray(r_eb_e, dtype=np.float64)
    r2 = np.sum(r * r, axis=-1)[..., None, None]
    outer = r[..., :, None] * r[..., None, :]
    gradient: FloatArray = ellipsoid.GM / r2**1.5 * (3.0 * outer / r2 - np.eye(3))
    return gradient + ellipsoid.omega_ie**2 * np.diag([1.0, 1.0, 0.0])


def earth_rate_ned(lat: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Earth rate ``omega_ie_n`` in north-east-down axes. Shape of ``lat`` [rad] plus (3,). [rad/s]

    References
    ----------
    Groves (2013), eq. (2.123).
    """
    lat = np.asarray(lat, dtype=np.float64)
    return ellipsoid.omega_ie * np.stack((np.cos(lat), np.zeros_like(lat), -np.sin(lat)), axis=-1)


def transport_rate_ned(lat: ArrayLike, h: ArrayLike, v_eb_n: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Transport rate ``omega_en_n``: how fast north-east-down axes turn as they move over the Earth.

    Parameters
    ----------
    lat, h : array_like
        Geodetic latitude [rad] and ellipsoidal height [m].
    v_eb_n : array_like, shape (..., 3)
        Velocity north, east, down. [m/s]
    ellipsoid : Ellipsoid

    Returns
    -------
    omega_en_n : ndarray, shape (..., 3)
        Unbounded towards the poles, where north stops meaning anything: use the Earth-fixed mechanization there.
        [rad/s]

    References
    ----------
    Groves (2013), eq. (5.44); Yaman (2017), eq. (2-21).
    """
    v = np.asarray(v_eb_n, dtype=np.float64)
    lat, h = np.asarray(lat, dtype=np.float64), np.asarray(h, dtype=np.float64)
    R_N, R_E = radii_of_curvature(lat, ellipsoid)
    east = v[..., 1] / (R_E + h)
    return np.stack((east, -v[..., 0] / (R_N + h), -east * np.tan(lat)), axis=-1)


def _gravitation(r_eb_e: ArrayLike, zonals: tuple[float, float, float], ellipsoid: Ellipsoid) -> FloatArray:
    r = np.asarray(r_eb_e, dtype=np.float64)
    J2, J4, J6 = zonals
    r2 = np.sum(r * r, axis=-1)
    s = r[..., 2] ** 2 / r2
    t = ellipsoid.a**2 / r2
    p2, p4, p6 = 1.5 * J2 * t, -0.625 * J4 * t**2, 0.0625 * J6 * t**3
    equatorial = (
        1.0
        + p2 * (1.0 - 5.0 * s)
        + p4 * (3.0 - s * (42.0 - 63.0 * s))
        + p6 * (35.0 - s * (945.0 - s * (3465.0 - 3003.0 * s)))
    )
    polar = (
        1.0
        + p2 * (3.0 - 5.0 * s)
        + p4 * (15.0 - s * (70.0 - 63.0 * s))
        + p6 * (245.0 - s * (2205.0 - s * (4851.0 - 3003.0 * s)))
    )
    factor = -ellipsoid.GM / (r2 * np.sqrt(r2))
    gravitation: FloatArray = factor[..., None] * r * np.stack((equatorial, equatorial, polar), axis=-1)
    return gravitation
