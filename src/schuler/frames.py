"""Frames and positions: geodetic, Earth-fixed and local coordinates, and the matrices between the axes.

Frames (docs/conventions.md): ``i`` inertial, ``e`` Earth-fixed (x to the Greenwich meridian, z to the north pole),
``n`` north-east-down, ``b`` body (forward, right, down), ``s`` the IMU's own axes.

A geodetic position is ``llh``: latitude, longitude [rad], ellipsoidal height [m]. Longitudes are returned in
(-pi, pi]; at the poles the longitude 0 is returned and stands for a choice of axes, not for a place.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.earth import WGS84, Ellipsoid


def ecef_from_llh(llh: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Earth-fixed position of geodetic coordinates.

    Parameters
    ----------
    llh : array_like, shape (..., 3)
        Latitude, longitude [rad], ellipsoidal height [m].
    ellipsoid : Ellipsoid

    Returns
    -------
    r_eb_e : ndarray, shape (..., 3)
        Position. [m]

    References
    ----------
    Groves (2013), eq. (2.112).
    """
    lat, lon, h = np.moveaxis(np.asarray(llh, dtype=np.float64), -1, 0)
    s, c = np.sin(lat), np.cos(lat)
    R_E = ellipsoid.a / np.sqrt(1.0 - ellipsoid.e2 * s * s)
    p = (R_E + h) * c
    return np.stack((p * np.cos(lon), p * np.sin(lon), ((1.0 - ellipsoid.e2) * R_E + h) * s), axis=-1)


def llh_from_ecef(r_eb_e: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Geodetic coordinates of an Earth-fixed position.

    Parameters
    ----------
    r_eb_e : array_like, shape (..., 3)
        Position, at least 45 km from the Earth's centre. [m]
    ellipsoid : Ellipsoid

    Returns
    -------
    llh : ndarray, shape (..., 3)
        Latitude, longitude [rad], ellipsoidal height [m].

    Notes
    -----
    Two of Bowring's steps on the reduced latitude, which converge quadratically: 1e-15 rad and rounding of the height
    (4e-9 m for a round trip) from -100 km to satellite orbits, poles and equator included, with no branch.

    References
    ----------
    Bowring, B. R. (1976), Survey Review 23(181), 323-327.
    """
    x, y, z = np.moveaxis(np.asarray(r_eb_e, dtype=np.float64), -1, 0)
    a, b, e2 = ellipsoid.a, ellipsoid.b, ellipsoid.e2
    p = np.hypot(x, y)
    # tangent of the reduced latitude kept as (sine, cosine) so that neither the equator nor a pole divides by zero
    S, C = a * z, b * p
    for _ in range(2):
        norm = np.sqrt(S * S + C * C)
        s, c = S / norm, C / norm
        S, C = (1.0 - ellipsoid.f) * (z + e2 / (1.0 - e2) * b * s**3), (p - e2 * a * c**3)
    S = S / (1.0 - ellipsoid.f)
    norm = np.sqrt(S * S + C * C)
    s, c = S / norm, C / norm
    h = p * c + z * s - a * np.sqrt(1.0 - e2 * s * s)
    # adding zero turns -0.0 into 0.0, which keeps longitudes in (-pi, pi] and zero at the poles
    return np.stack((np.arctan2(S, C), np.arctan2(y + 0.0, x + 0.0), h), axis=-1)


def C_en(llh: ArrayLike) -> FloatArray:
    """Direction cosine matrix from north-east-down to Earth-fixed axes at a position.

    Parameters
    ----------
    llh : array_like, shape (..., 2) or (..., 3)
        Latitude and longitude [rad]; a height is ignored.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``v_e = C_en @ v_n``.

    References
    ----------
    Groves (2013), eq. (2.150) transposed.
    """
    llh = np.asarray(llh, dtype=np.float64)
    sL, cL, sl, cl = np.sin(llh[..., 0]), np.cos(llh[..., 0]), np.sin(llh[..., 1]), np.cos(llh[..., 1])
    C = np.empty((*sL.shape, 3, 3))
    C[..., 0, 0], C[..., 0, 1], C[..., 0, 2] = -sL * cl, -sl, -cL * cl
    C[..., 1, 0], C[..., 1, 1], C[..., 1, 2] = -sL * sl, cl, -cL * sl
    C[..., 2, 0], C[..., 2, 1], C[..., 2, 2] = cL, 0.0, -sL
    return C


def q_en(llh: ArrayLike) -> FloatArray:
    """Quaternion of :func:`C_en`. Shapes (..., 2 or 3) to (..., 4)."""
    llh = np.asarray(llh, dtype=np.float64)
    # C_en = Rz(lon) Ry(-(pi/2 + lat))
    half_lon, half = 0.5 * llh[..., 1], -0.5 * (0.5 * np.pi + llh[..., 0])
    sz, cz, sy, cy = np.sin(half_lon), np.cos(half_lon), np.sin(half), np.cos(half)
    return np.stack((cz * cy, -sz * sy, cz * sy, sz * cy), axis=-1)


def C_ie(t: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Direction cosines from Earth-fixed to inertial axes that coincide at ``t = 0``. Shapes (...) to (..., 3, 3).

    References
    ----------
    Groves (2013), eq. (2.145) transposed.
    """
    angle = ellipsoid.omega_ie * np.asarray(t, dtype=np.float64)
    s, c = np.sin(angle), np.cos(angle)
    C = np.zeros((*angle.shape, 3, 3))
    C[..., 0, 0], C[..., 0, 1], C[..., 1, 0], C[..., 1, 1], C[..., 2, 2] = c, -s, s, c, 1.0
    return C


def ned_from_ecef(r_eb_e: ArrayLike, origin_llh: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """North, east, down coordinates of a position about an origin, straight axes (no curvature).

    Parameters
    ----------
    r_eb_e : array_like, shape (..., 3)
        Position. [m]
    origin_llh : array_like, shape (3,) or (..., 3)
        Latitude, longitude [rad], height [m] of the origin.
    ellipsoid : Ellipsoid

    Returns
    -------
    ndarray, shape (..., 3)
        Components of the difference in the axes of the origin. [m]
    """
    origin_llh = np.asarray(origin_llh, dtype=np.float64)
    difference = np.asarray(r_eb_e, dtype=np.float64) - ecef_from_llh(origin_llh, ellipsoid)
    ned: FloatArray = np.einsum("...ji,...j->...i", C_en(origin_llh), difference)
    return ned


def ecef_from_ned(r_n: ArrayLike, origin_llh: ArrayLike, ellipsoid: Ellipsoid = WGS84) -> FloatArray:
    """Earth-fixed position of local coordinates; the inverse of :func:`ned_from_ecef`. Shapes (..., 3). [m]"""
    origin_llh = np.asarray(origin_llh, dtype=np.float64)
    rotated = np.einsum("...ij,...j->...i", C_en(origin_llh), np.asarray(r_n, dtype=np.float64))
    position: FloatArray = ecef_from_llh(origin_llh, ellipsoid) + rotated
    return position


def wrap_angle(angle: ArrayLike) -> FloatArray:
    """The same angle in (-pi, pi]. [rad]"""
    angle = np.asarray(angle, dtype=np.float64)
    wrapped: FloatArray = -((np.pi - angle) % (2.0 * np.pi) - np.pi)
    return wrapped
