"""Growth bounded by gravity: one horizontal channel with its Schuler feedback, and the unstable vertical one.

One channel on a sphere: ``dv/dt = - g phi + f``, ``dphi/dt = v / R + omega`` with tilt phi, so that velocity and
position swing with the Schuler period of 84 minutes. Earth rate, which couples the two channels within a day, is left
out: valid for a few hours.
"""

from __future__ import annotations

from math import factorial
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.units import G0

Cause: TypeAlias = Literal[
    "accel bias", "gyro bias", "accel noise", "gyro noise", "initial tilt", "initial velocity", "initial position"
]

#: Radius of the sphere that has the Earth's volume. [m]
RADIUS = (WGS84.a**2 * WGS84.b) ** (1.0 / 3.0)


def schuler_frequency(gravity: float = G0, radius: float = RADIUS) -> float:
    """``sqrt(g / R)``, a turn in 84 minutes. [rad/s]"""
    return float(np.sqrt(gravity / radius))


def horizontal(
    cause: Cause, t: ArrayLike, size: float, *, gravity: float = G0, radius: float = RADIUS
) -> tuple[FloatArray, FloatArray]:
    """1-sigma of velocity and position from one cause.

    Parameters
    ----------
    cause : str
        One of :data:`Cause`.
    t : array_like
        [s]
    size : float
        1-sigma of a constant [m/s^2], [rad/s], [rad], [m/s], [m], or root density of noise, SI.
    gravity, radius : float
        [m/s^2], [m]

    Returns
    -------
    velocity, position : ndarray
        Absolute values. [m/s], [m]

    References
    ----------
    Groves (2013), table 5.1 and section 5.7; noise by the integral of the squared impulse response.
    """
    t = np.asarray(t, dtype=np.float64)
    w = schuler_frequency(gravity, radius)
    s, c = np.sin(w * t), np.cos(w * t)
    half = 2.0 * np.sin(0.5 * w * t) ** 2  # 1 - cos without cancellation
    forms: dict[str, tuple[FloatArray, FloatArray]] = {
        "accel bias": (s / w, half / w**2),
        "gyro bias": (radius * half, radius * _late(w, t)),
        "initial tilt": (radius * w * s, radius * half),
        "initial velocity": (c, s / w),
        "initial position": (np.zeros_like(t), np.ones_like(t)),
    }
    if cause in forms:
        velocity, position = forms[cause]
        return np.abs(size * velocity), np.abs(size * position)
    if cause == "accel noise":
        return size * np.sqrt(_squares(w, t, "cos")), size / w * np.sqrt(_squares(w, t, "sin"))
    if cause == "gyro noise":
        return size * gravity / w * np.sqrt(_squares(w, t, "sin")), size * radius * np.sqrt(_squares(w, t, "1-cos"))
    raise InputError(f"cause: expected one of {', '.join(Cause.__args__)}, got {cause!r}")  # type: ignore[attr-defined]


def vertical(
    cause: Literal["accel bias", "accel noise", "initial velocity", "initial position"],
    t: ArrayLike,
    size: float,
    *,
    gravity: float = G0,
    radius: float = RADIUS,
) -> tuple[FloatArray, FloatArray]:
    """1-sigma of vertical velocity and position: gravity, weaker above, makes it grow e-fold in 9.5 minutes.

    Parameters and returns as of :func:`horizontal`.

    References
    ----------
    Groves (2013), section 5.7.1: exponential with ``sqrt(2 g / R)``.
    """
    t = np.asarray(t, dtype=np.float64)
    k = np.sqrt(2.0 * gravity / radius)
    s, c = np.sinh(k * t), np.cosh(k * t)
    forms: dict[str, tuple[FloatArray, FloatArray]] = {
        "accel bias": (s / k, 2.0 * np.sinh(0.5 * k * t) ** 2 / k**2),
        "initial velocity": (c, s / k),
        "initial position": (k * s, c),
    }
    if cause in forms:
        velocity, position = forms[cause]
        return np.abs(size * velocity), np.abs(size * position)
    if cause == "accel noise":
        twice = 0.25 * np.sinh(2.0 * k * t) / k
        x = k * t
        low = t * x**2 / 3.0 * (1.0 + x**2 / 5.0 + 2.0 * x**4 / 105.0)
        square = np.where(x < 0.05, low, twice - 0.5 * t)
        return size * np.sqrt(twice + 0.5 * t), size / k * np.sqrt(square)
    raise InputError(f"cause: expected accel bias, accel noise, initial velocity or position, got {cause!r}")


def _late(w: float, t: FloatArray) -> FloatArray:
    """``t - sin(w t) / w`` without cancellation."""
    x = w * t
    series = t * x**2 / 6.0 * (1.0 - x**2 / 20.0 * (1.0 - x**2 / 42.0))
    return np.asarray(np.where(x < 0.05, series, t - np.sin(x) / w))


def _squares(w: float, t: FloatArray, form: str) -> FloatArray:
    """Integral of cos^2, sin^2 or (1 - cos)^2 of ``w s`` from 0 to t."""
    x = w * t
    twice = 0.25 * np.sin(2.0 * x) / w
    if form == "cos":
        return np.asarray(0.5 * t + twice)
    if form == "sin":
        low = t * x**2 / 3.0 * (1.0 - x**2 / 5.0 + 2.0 * x**4 / 105.0)
        return np.asarray(np.where(x < 0.05, low, 0.5 * t - twice))
    terms = ((-1.0) ** k * (0.5 * 4.0**k - 2.0) * x ** (2 * k) / (factorial(2 * k) * (2 * k + 1)) for k in range(2, 10))
    low = t * sum(terms)
    return np.asarray(np.where(x < 0.5, low, 1.5 * t - 2.0 * np.sin(x) / w + twice))
