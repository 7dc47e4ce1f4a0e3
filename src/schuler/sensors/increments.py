"""Increments of an IMU that reports rates; the mechanization takes only increments."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError


def integrate_rates(t: ArrayLike, rate: ArrayLike, order: int = 2) -> FloatArray:
    """Integrals of sampled rates over the intervals between samples.

    Parameters
    ----------
    t : array_like, shape (n,)
        Increasing sample times; spacing may vary. [s]
    rate : array_like, shape (n, 3)
        Instantaneous samples of angular rate [rad/s] or specific force [m/s^2].
    order : {1, 2, 3}
        Order of the rule: the newer sample held over the interval (1: right for an IMU that reports the mean of the
        interval that ends at the stamp), trapezoid (2), parabola through this and the two samples before (3).

    Returns
    -------
    ndarray, shape (n - 1, 3)
        Increments over ``(t[k], t[k + 1]]``; global error of the given order in the spacing.

    Raises
    ------
    InputError
        If there are fewer than two samples or the order is unknown.
    """
    t = as_floats(t, "t", (None,))
    x = as_floats(rate, "rate", (len(t), 3))
    if len(t) < 2:
        raise InputError(f"t: expected at least two samples to integrate between, got {len(t)}")
    h = np.diff(t)[:, None]
    if order == 1:
        return h * x[1:]
    increments: FloatArray = 0.5 * h * (x[:-1] + x[1:])
    if order == 3:
        h1, h0 = h[1:], h[:-1]
        # second divided difference of three samples: curvature the trapezoid leaves out, -h^3 / 6 of it
        curvature = ((x[2:] - x[1:-1]) / h1 - (x[1:-1] - x[:-2]) / h0) / (h0 + h1)
        increments[1:] -= curvature * h1**3 / 6.0
    elif order != 2:
        raise InputError(f"order: expected 1, 2 or 3, got {order!r}")
    return increments
