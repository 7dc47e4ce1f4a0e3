"""NumPy twins of the compiled coning and sculling corrections."""

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError


def rotation_vectors(dtheta: ArrayLike, dt: ArrayLike | None = None) -> FloatArray:
    """Rotation vector of each interval from angle increments: the coning correction.

    Parameters
    ----------
    dtheta : array_like, shape (n, 3)
        Integrals of the body rate over consecutive intervals. [rad]
    dt : array_like, shape (n,), optional
        Lengths of the intervals; equal if left out. [s]

    Returns
    -------
    ndarray, shape (n, 3)
        ``phi`` with ``C(k-1, k) = exp([phi x])``. The first uses no history, the second one increment, the others
        two. [rad]

    Notes
    -----
    Same arithmetic as the compiled mechanization: the rate is a parabola through the integrals of this and the two
    previous intervals, ``phi = dtheta + a0 x (a1 / 12 + a2 / 24)``.

    References
    ----------
    Savage (1998), J. Guidance 21(1), eqs. (33)-(38), extended by the quadratic term.
    """
    a0, a1, a2 = _polynomial(dtheta, dt)
    return np.asarray(dtheta, dtype=np.float64) + np.cross(a0, a1 / 12.0 + a2 / 24.0)


def velocity_changes(dtheta: ArrayLike, dv: ArrayLike, dt: ArrayLike | None = None) -> FloatArray:
    """Velocity change of each interval in the body axes at its start: rotation and sculling corrections.

    Parameters
    ----------
    dtheta, dv : array_like, shape (n, 3)
        Integrals of body rate [rad] and specific force [m/s] over consecutive intervals.
    dt : array_like, shape (n,), optional
        Lengths of the intervals; equal if left out. [s]

    Returns
    -------
    ndarray, shape (n, 3)
        [m/s]

    References
    ----------
    Savage (1998), J. Guidance 21(2), eqs. (30)-(42); fourth-order terms derived in docs/mechanization.md.
    """
    a0, a1, a2 = _polynomial(dtheta, dt)
    b0, b1, b2 = _polynomial(dv, dt)
    dtheta, dv = np.asarray(dtheta, dtype=np.float64), np.asarray(dv, dtype=np.float64)
    if dtheta.shape != dv.shape:
        raise InputError(f"expected as many velocity as angle increments, got {dv.shape} and {dtheta.shape}")
    angle = np.linalg.norm(dtheta, axis=-1, keepdims=True)
    first = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = (angle - np.sin(angle)) / angle**3
    second = np.where(angle > 1e-2, exact, 1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0)
    turned = np.cross(dtheta, dv)
    sculling = np.cross(a0, b1 / 12.0 + b2 / 24.0) + np.cross(b0, a1 / 12.0 + a2 / 24.0)
    fourth = (np.cross(a0, np.cross(a0, b1)) - np.cross(a1, np.cross(a0, b0))) / 24.0
    change: FloatArray = dv + first * turned + second * np.cross(dtheta, turned) + sculling + fourth
    return change


def _polynomial(x: ArrayLike, dt: ArrayLike | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of ``rate(s) h = a0 + a1 s + a2 s^2 / 2`` on each interval; the NumPy twin of ``fit_interval``."""
    x = as_floats(x, "increments", (None, 3))
    h = np.ones(len(x)) if dt is None else as_floats(dt, "dt", (len(x),))
    if np.any(h <= 0.0):
        raise InputError(f"dt: expected positive intervals, got {h.min()}")
    u = x / h[:, None]
    d2, d3 = np.zeros_like(x), np.zeros_like(x)
    d2[1:] = (u[1:] - u[:-1]) / (h[1:] + h[:-1])[:, None]
    d3[2:] = (d2[2:] - d2[1:-1]) / (h[2:] + h[1:-1] + h[:-2])[:, None]
    h1 = np.concatenate((h[:1], h[:-1]))[:, None]
    h = h[:, None]
    return x - h * h * (d2 + h1 * d3), 2.0 * h * h * (d2 + (h1 - h) * d3), 6.0 * h**3 * d3
