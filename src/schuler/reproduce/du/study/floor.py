"""Noise floor of a free-inertial run by white noise of the gyroscopes: no rotation gets below it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.units import G0


@dataclass(frozen=True)
class NoiseFloor:
    """Root mean squares over time and ensemble; horizontal ones of both components together.

    Attributes
    ----------
    horizontal_position, horizontal_velocity : float
        [m], [m/s]
    attitude : float
        About each axis. [rad]
    """

    horizontal_position: float
    horizontal_velocity: float
    attitude: float


def noise_floor(random_walk: float, duration: float, *, gravity: float = G0) -> NoiseFloor:
    """Floor of a run from a perfect start.

    Parameters
    ----------
    random_walk : float
        Angle random walk N. [rad/sqrt(s)]
    duration : float
        T; up to ten minutes, flat Earth. [s]
    gravity : float
        [m/s^2]

    Returns
    -------
    NoiseFloor
        ``sqrt(2) g N sqrt(T^5 / 120)``, ``sqrt(2) g N sqrt(T^3 / 12)``, ``N sqrt(T / 2)``.

    Notes
    -----
    Means over time of ``N^2 t``, ``g^2 N^2 t^3 / 3`` and ``g^2 N^2 t^5 / 20``. A mean over runs of root mean squares
    over time is some 10 % smaller than this root of the mean over both.

    References
    ----------
    Integrals of angle random walk over a flat Earth, for the tests of Du (2015), section 4.1.
    """
    g_n = gravity * random_walk
    return NoiseFloor(
        float(np.sqrt(2.0 * duration**5 / 120.0)) * g_n,
        float(np.sqrt(2.0 * duration**3 / 12.0)) * g_n,
        random_walk * float(np.sqrt(0.5 * duration)),
    )


def noise_growth(random_walk: float, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error growth by white noise of the gyroscopes, from a perfect start, flat Earth.

    Parameters
    ----------
    random_walk : float
        Angle random walk N. [rad/sqrt(s)]
    t : array_like, shape (n,)
        [s]

    Returns
    -------
    attitude, velocity, position : ndarray, shape (n,)
        1-sigma about each axis, and of each horizontal component: ``N sqrt(t)``, ``g N sqrt(t^3 / 3)``,
        ``g N sqrt(t^5 / 20)``. [rad], [m/s], [m]

    References
    ----------
    Integrals of angle random walk over a flat Earth, for the tests of Du (2015), section 4.1.
    """
    t = np.maximum(np.asarray(t, dtype=np.float64), 0.0)
    g_n = G0 * random_walk
    return (
        np.asarray(random_walk * np.sqrt(t)), np.asarray(g_n * np.sqrt(t**3 / 3.0)),
        np.asarray(g_n * np.sqrt(t**5 / 20.0)),
    )  # fmt: skip
