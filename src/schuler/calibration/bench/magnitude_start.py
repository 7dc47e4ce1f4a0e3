"""First guesses for a triad from magnitudes, by linear equations: no iteration, no guess needed."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.bench.sensor_geometry import triad_matrix, triad_parameters
from schuler.exceptions import InputError

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
