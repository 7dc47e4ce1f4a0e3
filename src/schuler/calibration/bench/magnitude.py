"""Condition that a triad's readings, freed of its errors, have the magnitude of the reference; linear first guesses."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.bench.sensor_geometry import triad_inverse, triad_matrix, triad_parameters
from schuler.exceptions import InputError


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


#: Readings that scatter less than this part of rho in a direction say nothing on the bias there.
NARROW = 0.02

_ZEROS = (0.0, 0.0, 0.0)


def sphere_start(Y: ArrayLike, rho: ArrayLike, s: ArrayLike = _ZEROS, theta: ArrayLike = _ZEROS) -> FloatArray:
    """Bias as the centre of the sphere that fits best.

    Parameters
    ----------
    Y : array_like, shape (n, 3)
        Readings. [x]
    rho : array_like, shape () or (n,)
        True magnitudes. [x]
    s, theta : array_like, shape (3,)
        Scale factors and angles, if known. [-], [rad]

    Returns
    -------
    ndarray, shape (3,)
        Bias. [x] Zero across a plane (or line, or point) in which the readings lie.

    Notes
    -----
    ``|Y - b|^2 = rho^2`` is linear in b and ``|b|^2``: ``2 Y . b - |b|^2 = |Y|^2 - rho^2``. Taking ``|b|^2`` for a
    fourth unknown costs little accuracy and works for a bias of any size.
    """
    M = triad_matrix(s, theta)
    y = np.linalg.solve(M, as_floats(Y, "Y", (None, 3)).T).T
    rho = np.broadcast_to(as_floats(rho, "rho"), (len(y),))
    # about the mean of the readings, for the rounding of a large bias
    middle = y.mean(axis=0)
    z = y - middle
    _, spread, Vt = np.linalg.svd(z / np.sqrt(len(z)), full_matrices=True)
    wide = Vt[: len(spread)][spread > NARROW * np.median(rho)]
    design = np.column_stack((2.0 * z @ wide.T, -np.median(rho) * np.ones(len(z))))
    solution = np.linalg.lstsq(design, np.sum(z * z, axis=1) - rho**2, rcond=1e-10)[0]
    return np.asarray(M @ (wide.T @ (wide @ middle + solution[:-1])))


def ellipsoid_start(Y: ArrayLike, rho: ArrayLike) -> FloatArray:
    """All nine parameters from the ellipsoid that fits best.

    Parameters
    ----------
    Y : array_like, shape (n, 3)
        Readings, nine or more. [x]
    rho : array_like, shape () or (n,)
        True magnitude, the same for all. [x]

    Returns
    -------
    ndarray, shape (9,)
        Bias [x], scale-factor errors [-], angles [rad].

    Raises
    ------
    InputError
        If there are fewer than nine readings, rho is not the same for all, or what fits best is no ellipsoid.

    Notes
    -----
    The ten coefficients of the quadric are the singular vector of the smallest singular value. Setting the right-hand
    side to one instead fails where the origin lies on the surface, that is, where the bias is as large as rho.
    """
    Y = as_floats(Y, "Y", (None, 3))
    rho = np.broadcast_to(as_floats(rho, "rho"), (len(Y),))
    if len(Y) < 9 or np.ptp(rho) > 1e-9 * rho[0]:
        raise InputError(
            f"start: an ellipsoid needs nine readings or more of one magnitude, got {len(Y)}; use 'continuation'"
        )
    y = Y / rho[0]
    middle = y.mean(axis=0)
    x, yy, z = (y - middle).T
    products = (2.0 * x * yy, 2.0 * yy * z, 2.0 * x * z)
    design = np.column_stack((x * x, yy * yy, z * z, *products, 2.0 * x, 2.0 * yy, 2.0 * z, np.ones(len(x))))
    q = np.linalg.svd(design)[2][-1]
    E = np.array(((q[0], q[3], q[5]), (q[3], q[1], q[4]), (q[5], q[4], q[2])))
    if np.linalg.eigvalsh(E)[1] < 0.0:
        E, q = -E, -q
    if np.linalg.eigvalsh(E)[0] <= 0.0:
        raise InputError("start: the readings fit no ellipsoid, they are too few or too much alike; use 'continuation'")
    centre = -np.linalg.solve(E, q[6:9])
    size = centre @ E @ centre - q[9]
    if size <= 0.0:
        raise InputError("start: the readings fit no ellipsoid, they are too few or too much alike; use 'continuation'")
    # (y - c)' E (y - c) = size and y - c = M v with |v| = 1, so M M' = size E^-1
    s, theta = triad_parameters(np.linalg.cholesky(size * np.linalg.inv(E)))
    return np.concatenate(((centre + middle) * rho[0], s, theta))
