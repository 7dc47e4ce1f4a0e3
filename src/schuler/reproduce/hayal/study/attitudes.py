"""Attitudes of a box put down by hand on its faces, edges and corners, for simulations."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.design.plans import ATTITUDES
from schuler.exceptions import InputError


def ordered_attitudes() -> FloatArray:
    """The 26 directions in an order that fits the source's field scenarios. Shape (26, 3).

    Faces, then edges between x and y or z by twos, the edges between y and z last, then corners. The source does not
    state its order; with this one its first ten determine no theta_zx and its last ten hardly s_y, s_z, which is what
    its uncertainties show.
    """
    edges = ATTITUDES[6:18].reshape(3, 4, 3)  # xy, xz, yz
    xy, xz, yz = edges
    return np.vstack((ATTITUDES[:6], xy[:2], xz[:2], xy[2:], xz[2:], yz, ATTITUDES[18:]))


def scenario(number: int) -> FloatArray:
    """Directions of the source's scenarios: 1 all 26, 2 the first 18, 3 the first 10, 4 the last 10.

    Raises
    ------
    InputError
        If there is no such scenario.
    """
    cuts = {1: slice(None), 2: slice(18), 3: slice(10), 4: slice(16, None)}
    if number not in cuts:
        raise InputError(f"number: expected scenario 1, 2, 3 or 4, got {number!r}")
    return ordered_attitudes()[cuts[number]]


def attitude_rotation(angles: ArrayLike) -> FloatArray:
    """Rotation of vector components to another attitude, ``R3(alpha) R2(chi) R1(eta)``.

    Parameters
    ----------
    angles : array_like, shape (..., 3)
        (eta, chi, alpha) about x, y, z; alpha acts last, so it is no heading. [rad]

    Returns
    -------
    ndarray, shape (..., 3, 3)

    References
    ----------
    Hayal (2010), eq. (4.10).
    """
    e, x, a = np.moveaxis(as_floats(angles, "angles"), -1, 0)
    ce, se, cx, sx, ca, sa = np.cos(e), np.sin(e), np.cos(x), np.sin(x), np.cos(a), np.sin(a)
    rows = (
        (ca * cx, ca * sx * se + sa * ce, -ca * sx * ce + sa * se),
        (-sa * cx, -sa * sx * se + ca * ce, sa * sx * ce + ca * se),
        (sx, -cx * se, cx * ce),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def study_attitudes(
    directions: ArrayLike, heading: float, disturbance: float, rng: np.random.Generator | None = None
) -> FloatArray:
    """Attitudes of a box put down by hand.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Down in body axes.
    heading : float
        Heading of the box before it is turned onto each side the shortest way. [rad]
    disturbance : float
        1 sigma of each of three angles. [rad]
    rng : numpy.random.Generator, optional
        Not needed without disturbance.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        ``C_bn``: components in north-east-down to components in the body.
    """
    d = as_floats(directions, "directions", (None, 3))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    C = np.empty((len(d), 3, 3))
    for i, u in enumerate(d):
        C[i] = _shortest(u)
    C = C @ attitude_rotation((0.0, 0.0, heading))
    if disturbance:
        if rng is None:
            raise InputError("rng: expected a generator for the disturbance, got None")
        C = attitude_rotation(disturbance * rng.standard_normal((len(d), 3))) @ C
    return np.asarray(C)


def _shortest(u: FloatArray) -> FloatArray:
    """Rotation with the smallest angle that takes (0, 0, 1) to ``u``; half a turn about x to the opposite."""
    if u[2] < -1.0 + 1e-12:
        return np.diag((1.0, -1.0, -1.0))
    x, y, z = u
    return np.array(
        (
            (1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), x),
            (-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), y),
            (-x, -y, z),
        )
    )
