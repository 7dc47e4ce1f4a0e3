"""What errors of a platform's angles and rates do to the specific force and rate handed to navigation."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.rotary import gimbals
from schuler.rotary.encoder import Platform


def platform_error(
    platform: Platform,
    t: ArrayLike,
    C_nb: ArrayLike,
    omega_is_s: ArrayLike,
    f_is_s: ArrayLike,
    angle_error: ArrayLike,
    rate_error: ArrayLike = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """First-order errors of the turned IMU output in navigation axes, body route.

    Parameters
    ----------
    platform : Platform
        True angles and rates, m axes.
    t : array_like, shape (n,)
        [s]
    C_nb : array_like, shape (n, 3, 3) or (3, 3)
        Attitude of the vehicle.
    omega_is_s, f_is_s : array_like, shape (n, 3)
        Output of the IMU. [rad/s], [m/s^2]
    angle_error, rate_error : array_like, shape (n, m) or broadcast to it
        Estimate minus truth of the platform's angles and rates. Rates that are differences of the angles have the
        derivative of the angles' error and nothing else. [rad], [rad/s]

    Returns
    -------
    d_omega_n, d_f_n : ndarray, shape (n, 3)
        [rad/s], [m/s^2]

    Notes
    -----
    With ``C_hat_bs = (I + [dphi x]) C_bs``, ``dphi = sum of angle errors times axes``::

        d_f_n     = C_nb (dphi x C_bs f)
        d_omega_n = C_nb (dphi x C_bs omega_is - d omega_bs_b)

    A level vehicle at rest that is turned about the vertical has its force along the axis: an error of the angle then
    makes no error of velocity. An offset tau between the clocks of encoder and IMU is an angle error of ``rate tau``.

    References
    ----------
    Du (2015), eqs. (2.19)-(2.21), generalised to several axes; its ``phi`` is minus ours, so the signs its prose drops
    stand here as they must.
    """
    t = as_floats(t, "t", (None,))
    angles, rates = platform.angles(t), platform.rates(t)
    d_angle = np.broadcast_to(np.asarray(angle_error, dtype=np.float64), angles.shape)
    d_rate = np.broadcast_to(np.asarray(rate_error, dtype=np.float64), angles.shape)
    C_bs = gimbals.C_bs(platform.axes, angles, platform.C_mount)
    axes_b = np.einsum("nij,nmj->nmi", C_bs, gimbals.axes_in_s(platform.axes, angles, platform.C_mount))
    dphi = np.zeros((len(t), 3))
    d_bs_b = np.zeros((len(t), 3))
    for k in range(len(platform.axes)):
        # an axis is itself turned by the errors of those outside it
        d_bs_b += d_rate[:, k, None] * axes_b[:, k] + rates[:, k, None] * np.cross(dphi, axes_b[:, k])
        dphi += d_angle[:, k, None] * axes_b[:, k]
    omega_b = np.einsum("nij,nj->ni", C_bs, as_floats(omega_is_s, "omega_is_s", (len(t), 3)))
    f_b = np.einsum("nij,nj->ni", C_bs, as_floats(f_is_s, "f_is_s", (len(t), 3)))
    C = np.broadcast_to(np.asarray(C_nb, dtype=np.float64), (len(t), 3, 3))
    return (
        np.einsum("nij,nj->ni", C, np.cross(dphi, omega_b) - d_bs_b),
        np.einsum("nij,nj->ni", C, np.cross(dphi, f_b)),
    )
