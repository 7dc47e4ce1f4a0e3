"""Scatter in the plane: covariance ellipse and circular error probable."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.units import DEG

_NODES = 96  # of a quadrature over a quarter of a turn


@dataclass(frozen=True)
class ImpactEllipse:
    """1-sigma ellipse of a scatter.

    Attributes
    ----------
    center : ndarray, shape (2,)
        Downrange, crossrange. [m]
    P : ndarray, shape (2, 2)
        [m^2]
    """

    center: FloatArray
    P: FloatArray

    @property
    def axes(self) -> tuple[float, float]:
        """Semi-major and semi-minor axis, 1-sigma. [m]"""
        small, large = np.sqrt(np.maximum(np.linalg.eigvalsh(self.P), 0.0))
        return float(large), float(small)

    @property
    def angle(self) -> float:
        """From downrange to the major axis, towards crossrange, in (-pi/2, pi/2]. [rad]"""
        return float(0.5 * np.arctan2(2.0 * self.P[0, 1], self.P[0, 0] - self.P[1, 1]))

    @property
    def cep(self) -> float:
        """Circular error probable about the center: half of a normal scatter is nearer. [m]"""
        return circular_error_probable(self.P)

    def outline(self, probability: float | None = None, points: int = 181) -> FloatArray:
        """Points of the 1-sigma ellipse, or of the one that holds a share of a normal scatter. Shape (points, 2)."""
        if probability is not None and not 0.0 < probability < 1.0:
            raise InputError(f"probability: expected a number between 0 and 1, got {probability!r}")
        size = 1.0 if probability is None else float(np.sqrt(-2.0 * np.log1p(-probability)))
        (a, b), phi = self.axes, np.linspace(0.0, 2.0 * np.pi, points)
        c, s = np.cos(self.angle), np.sin(self.angle)
        x, y = size * a * np.cos(phi), size * b * np.sin(phi)
        return np.asarray(self.center + np.stack((c * x - s * y, s * x + c * y), axis=1))

    def summary(self) -> str:
        """Center, axes and CEP."""
        a, b = self.axes
        return (
            f"center {self.center[0]:+.1f} m downrange, {self.center[1]:+.1f} m crossrange; 1-sigma ellipse "
            f"{a:.1f} x {b:.1f} m at {self.angle / DEG:.0f} deg; CEP {self.cep:.1f} m about the center"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON. [m], [rad]"""
        return {
            "center": self.center.tolist(), "P": self.P.tolist(), "axes": self.axes, "angle": self.angle,
            "cep": self.cep,
        }  # fmt: skip


def circular_error_probable(P: ArrayLike, probability: float = 0.5) -> float:
    """Radius about the mean that holds a share of a normal scatter.

    Parameters
    ----------
    P : array_like, shape (2, 2)
        Covariance. [m^2]
    probability : float

    Returns
    -------
    float
        [m]

    Notes
    -----
    Of each x within R along the major axis the share of y within ``sqrt(R^2 - x^2)`` is an error function; the sum
    over x is taken by Gauss-Legendre quadrature and R found by bisection. For a circle it is ``1.1774 sigma``, for a
    line ``0.6745 sigma``.
    """
    P = as_floats(P, "P", (2, 2))
    if not 0.0 < probability < 1.0:
        raise InputError(f"probability: expected a number between 0 and 1, got {probability!r}")
    b, a = np.sqrt(np.maximum(np.linalg.eigvalsh(P), 0.0))
    if a == 0.0:
        return 0.0
    ratio = max(b / a, 1e-6)
    low, high = 0.0, 40.0
    for _ in range(60):
        R = 0.5 * (low + high)
        low, high = (R, high) if _share(R, ratio) < probability else (low, R)
    return float(a * 0.5 * (low + high))


def _share(R: float, ratio: float) -> float:
    """Share of a normal scatter with deviations 1 and ``ratio`` within R; x = R sin u."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    u = 0.25 * np.pi * (nodes + 1.0)
    inner = np.array([erf(y) for y in R * np.cos(u) / (ratio * np.sqrt(2.0))])
    density = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * (R * np.sin(u)) ** 2)
    return float(0.25 * np.pi * np.sum(weights * density * inner * R * np.cos(u)))
