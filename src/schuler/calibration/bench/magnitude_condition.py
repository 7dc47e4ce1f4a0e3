"""The condition that a triad's readings, freed of its errors, have the magnitude of the reference."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.bench.sensor_geometry import triad_inverse


def condition(Y: ArrayLike, rho: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition of each attitude and its derivatives.

    Parameters
    ----------
    Y : array_like, shape (n, 3)
        Readings. [x]
    rho : array_like, shape () or (n,)
        Magnitude of the reference. [x]
    values : array_like, shape (9,)
        In the order :data:`schuler.calibration.bench.sensor_geometry.PARAMETERS`.

    Returns
    -------
    f : ndarray, shape (n,)
        ``|v|^2 - rho^2``. [x^2]
    A : ndarray, shape (n, 9)
        By the parameters.
    B : ndarray, shape (n, 3)
        By the readings of the same attitude.

    References
    ----------
    Hayal (2010), eqs. (3.19), (3.63) to (3.74); with zero s, theta they become (3.80) to (3.89). Derivatives by the
    angles are his in a shorter form.
    """
    Y, x = as_floats(Y, "Y", (None, 3)), as_floats(values, "values", (9,))
    return condition_of(Y, as_floats(rho, "rho"), x)


def condition_of(Y: FloatArray, rho: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same without checks, for loops."""
    k = 1.0 + x[3:6]
    yz, zx, zy = x[6:]
    W = triad_inverse(np.zeros(3), x[6:])
    u = (Y - x[:3]) / k
    v = u @ W.T
    B = 2.0 * (v @ W) / k  # G / (1 + s)
    y_and_z = v[:, 1] + v[:, 2] * np.tan(zx)
    A = np.empty((len(Y), 9))
    A[:, :3] = -B
    A[:, 3:6] = -B * u
    A[:, 6] = 2.0 * y_and_z * (v[:, 0] + v[:, 1] * np.tan(yz))
    A[:, 7] = 2.0 * v[:, 2] * y_and_z
    A[:, 8] = 2.0 * v[:, 2] * (np.tan(zy) * (v[:, 2] - v[:, 1] * np.tan(zx)) - v[:, 0] / np.cos(zx))
    return np.sum(v * v, axis=1) - rho**2, A, B


def possible(x: FloatArray) -> bool:
    """Whether nine values are those of a triad at all, for iterations that went astray."""
    return bool(np.isfinite(x).all() and (x[3:6] > -0.9).all() and (np.abs(x[6:]) < 1.4).all())
