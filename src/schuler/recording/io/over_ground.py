"""Horizontal velocities from speed and course over ground, as NMEA, phones and cars have them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.units import DEG

#: 1-sigma of the heights of fixes that have none. [m]
NO_HEIGHT = 1000.0
#: 1-sigma of the vertical velocity of a vehicle or a walker whose log has none. [m/s]
NO_VERTICAL_RATE = 10.0
#: 1-sigma of a velocity that is missing at single fixes. [m/s]
NO_VELOCITY = 1000.0
#: Radius over sigma: 68 % of errors of two equal axes are within 1.51 of their sigma: sqrt(-2 ln 0.32).
CIRCLE_68 = float(np.sqrt(-2.0 * np.log(0.32)))
_ENOUGH = 10  # pairs of fixes that a scatter is taken from
_LONGEST = 3.0  # between the two fixes of a pair [s]
_TO_SIGMA = 1.4826  # of a median of absolute values
_WALKING, _DISPLACED, _SAME = 0.8, 5.0, 15.0 * DEG  # [m/s], [m], [rad]
_LEAST = 0.05  # 1-sigma speed of the best receiver [m/s]


def velocities(
    t: FloatArray,
    place: tuple[FloatArray, FloatArray],
    speed: FloatArray,
    course: FloatArray,
    sigma: tuple[FloatArray | None, FloatArray | None],
    notes: list[str],
) -> dict[str, FloatArray]:
    """Columns of a GNSS table that speed and course make, with a note; none if nothing tells how accurate they are.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the fixes. [s]
    place : (ndarray, ndarray), shapes (n,)
        Latitude and longitude. [rad]
    speed, course : ndarray, shape (n,)
        NaN where a fix has none: too slow for a course, the velocity may point anywhere. [m/s], [rad]
    sigma : (ndarray, ndarray) or None for either, shapes (n,)
        1-sigma of speed and course, where they were measured; across the course no less than that of the speed is
        believed. [m/s], [rad]
    notes : list of str
        Takes a sentence.
    """
    moving = np.isfinite(speed)
    if not moving.any():
        return {}
    of_speed, of_course = sigma
    none = "no vertical one (it is zero with a 1-sigma of 10 m/s)"
    if of_speed is not None and np.all(of_speed[moving] > 0.0):
        along = np.where(moving, of_speed, NO_VELOCITY)
        notes.append(f"Velocities are speed and course, with their accuracies; there is {none}.")
    else:
        both = moving & np.isfinite(course)
        scatter = velocity_scatter(t[both], place[0][both], place[1][both], speed[both], course[both])
        if not np.isfinite(scatter):
            notes.append("Speed and course were not used: no accuracy was measured, and the fixes are too few for one.")
            return {}
        along = np.where(moving, scatter, NO_VELOCITY)
        notes.append(
            f"Velocities are speed and course; there is {none}. No accuracy of speed was measured: 1-sigma is "
            f"{scatter:.2g} m/s, by their differences to the displacements."
        )
    v, angle = np.where(moving, speed, 0.0), np.where(np.isfinite(course), course, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # of damaged numbers: what is not finite is refused with its row
        anywhere = moving & ~np.isfinite(course)
        along = np.where(anywhere, np.hypot(along, v), along)
        v = np.where(anywhere, 0.0, v)
        across = along
        if of_course is not None:
            across = np.maximum(along, v * np.where(np.isfinite(of_course), of_course, 0.0))
        c, s = np.cos(angle), np.sin(angle)
        return {
            "vn": v * c, "ve": v * s, "vd": np.zeros_like(v),
            "svn": np.hypot(along * c, across * s), "sve": np.hypot(along * s, across * c),
            "svd": np.full_like(v, NO_VERTICAL_RATE),
            "cvne": (along**2 - across**2) * c * s, "cvnd": np.zeros_like(v), "cved": np.zeros_like(v),
        }  # fmt: skip


def is_course(values: Mapping[str, FloatArray]) -> bool:
    """Whether a direction beside speeds is that of motion: within 15 deg of displacements, in the median.

    Parameters
    ----------
    values : mapping of str to ndarray, shape (n,)
        ``lat``, ``lon``, ``course`` [rad] and ``speed`` [m/s] of fixes.

    Notes
    -----
    A compass may point anywhere, and so may an antenna pair. Displacements are of 5 m or more, so that errors of
    positions are a small angle.
    """
    lat, lon, course, speed = (values[name] for name in ("lat", "lon", "course", "speed"))
    moving = np.isfinite(speed) & (speed > _WALKING)
    if moving.sum() < _ENOUGH:
        return False
    meridian, normal = earth.radii_of_curvature(lat[:1])
    place = np.stack((meridian[0] * lat, normal[0] * np.cos(lat[0]) * np.unwrap(lon)))
    stride = np.linalg.norm(np.diff(place), axis=0)
    usual = float(np.median(stride[moving[1:]])) if moving[1:].any() else 0.0
    if not usual > 0.0:
        return False
    k = 2 * max(1, int(np.ceil(0.5 * _DISPLACED / usual)))
    step = place[:, k:] - place[:, :-k]
    far = (np.linalg.norm(step, axis=0) > _DISPLACED) & moving[k // 2 : len(moving) - k // 2]
    off = np.arctan2(step[1], step[0]) - course[k // 2 : len(course) - k // 2]
    off = np.abs((off[far] + np.pi) % (2.0 * np.pi) - np.pi)
    return bool(len(off) >= _ENOUGH and np.median(off) < _SAME)


def measured(accuracy: FloatArray, other: FloatArray) -> bool:
    """Whether accuracies are positive, and change as those of another quantity do: what never changes is a constant."""
    if not np.all(accuracy > 0.0):
        return False
    return len(accuracy) <= _ENOUGH or bool(np.ptp(accuracy) > 0.0 or np.ptp(other) == 0.0)


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
    with np.errstate(invalid="ignore", over="ignore"):  # of damaged numbers, which are refused with their row
        meridian, normal = earth.radii_of_curvature(lat[:-1])
        step = np.stack((meridian * np.diff(lat), normal * np.cos(lat[:-1]) * np.diff(np.unwrap(lon))))
        v = np.stack((speed * np.cos(course), speed * np.sin(course)))
        off = (step[:, pair] / dt[pair]) - 0.5 * (v[:, 1:] + v[:, :-1])[:, pair]
    off = off[np.isfinite(off)]
    if not len(off):
        return float("nan")
    return max(_LEAST, _TO_SIGMA * float(np.median(np.abs(off))))
