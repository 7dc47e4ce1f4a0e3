"""Horizontal velocities from speed and course over ground, as NMEA, phones and cars have them."""

from __future__ import annotations

import numpy as np

from schuler import earth
from schuler.arrays import ArrayLike, FloatArray

#: 1-sigma of the vertical velocity of a vehicle or a walker whose log has none. [m/s]
NO_VERTICAL_RATE = 10.0
_ENOUGH = 10  # pairs of fixes that a scatter is taken from
_LONGEST = 3.0  # between the two fixes of a pair [s]
_TO_SIGMA = 1.4826  # of a median of absolute values
_LEAST = 0.05  # 1-sigma speed of the best receiver [m/s]


def velocity_columns(
    speed: FloatArray, course: FloatArray, sigma_speed: ArrayLike, sigma_course: ArrayLike | None = None
) -> dict[str, FloatArray]:
    """Columns of a GNSS table, with a vertical velocity of zero and the 1-sigma :data:`NO_VERTICAL_RATE`.

    Parameters
    ----------
    speed, course : ndarray, shape (n,)
        [m/s]; from true north over east [rad].
    sigma_speed : array_like, shape (n,) or ()
        1-sigma of the speed. [m/s]
    sigma_course : array_like, shape (n,) or (), optional
        1-sigma of the course; across the course no less than ``sigma_speed`` is believed. Default: as along. [rad]
    """
    along = np.broadcast_to(np.asarray(sigma_speed, dtype=float), speed.shape)
    across = along if sigma_course is None else np.maximum(along, speed * np.asarray(sigma_course))
    c, s = np.cos(course), np.sin(course)
    return {
        "vn": speed * c, "ve": speed * s, "vd": np.zeros_like(speed),
        "svn": np.hypot(along * c, across * s), "sve": np.hypot(along * s, across * c),
        "svd": np.full_like(speed, NO_VERTICAL_RATE),
        "cvne": (along**2 - across**2) * c * s, "cvnd": np.zeros_like(speed), "cved": np.zeros_like(speed),
    }  # fmt: skip


def velocity_scatter(t: FloatArray, lat: FloatArray, lon: FloatArray, speed: FloatArray, course: FloatArray) -> float:
    """1-sigma of a horizontal component of velocity, from its difference to displacements; NaN of too few fixes. [m/s]

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the fixes. [s]
    lat, lon : ndarray, shape (n,)
        [rad]
    speed, course : ndarray, shape (n,)
        [m/s], [rad]

    Notes
    -----
    The median of ``|dr / dt - mean of the velocities at both ends|``, made a sigma. The noise of positions and what
    accelerations change between two fixes are in it: it is an upper bound.
    """
    dt = np.diff(t)
    pair = (dt > 0.0) & (dt < _LONGEST)
    if pair.sum() < _ENOUGH:
        return float("nan")
    meridian, normal = earth.radii_of_curvature(lat[:-1])
    step = np.stack((meridian * np.diff(lat), normal * np.cos(lat[:-1]) * np.diff(np.unwrap(lon))))
    v = np.stack((speed * np.cos(course), speed * np.sin(course)))
    off = (step[:, pair] / dt[pair]) - 0.5 * (v[:, 1:] + v[:, :-1])[:, pair]
    return max(_LEAST, _TO_SIGMA * float(np.median(np.abs(off))))
