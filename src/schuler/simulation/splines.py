"""Motion through given positions and attitudes at given times, and the smooth curves it is made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.simulation.motion import MotionState, check_span


def geodetic_state(
    t: FloatArray, llh: FloatArray, llh_rate: FloatArray, llh_accel: FloatArray, rpy: FloatArray, rpy_rate: FloatArray
) -> MotionState:
    """Motion state of geodetic coordinates and Euler angles with their derivatives.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Time. [s]
    llh, llh_rate, llh_accel : ndarray, shape (n, 3)
        Latitude, longitude [rad], height [m] and two time derivatives.
    rpy, rpy_rate : ndarray, shape (n, 3)
        Roll, pitch, yaw relative to north-east-down at the body [rad] and time derivatives [rad/s].

    Returns
    -------
    MotionState
        Not for the poles themselves, where latitude and longitude have no derivative.
    """
    E = earth.WGS84
    lat, h = llh[:, 0], llh[:, 2]
    s, c = np.sin(lat), np.cos(lat)
    R_N, R_E = earth.radii_of_curvature(lat)
    w2 = 1.0 - E.e2 * s * s
    # derivatives of the radii with latitude
    R_N_L, R_E_L = 3.0 * E.e2 * s * c / w2 * R_N, E.e2 * s * c / w2 * R_E
    Ld, ld, hd = llh_rate.T
    Ldd, ldd, hdd = llh_accel.T
    v_n = np.stack(((R_N + h) * Ld, (R_E + h) * c * ld, -hd), axis=-1)
    a_n = np.stack(
        (
            (R_N + h) * Ldd + (R_N_L * Ld + hd) * Ld,
            (R_E + h) * c * ldd + ((R_E_L * Ld + hd) * c - (R_E + h) * s * Ld) * ld,
            -hdd,
        ),
        axis=-1,
    )
    omega_en_n = earth.transport_rate_ned(lat, h, v_n)
    C_en, C_nb = frames.C_en(llh), rotation.dcm_from_rpy(rpy)
    v_e = np.einsum("nij,nj->ni", C_en, v_n)
    a_e = np.einsum("nij,nj->ni", C_en, a_n + np.cross(omega_en_n, v_n))
    omega_eb_b = rotation.body_rate_from_rpy(rpy, rpy_rate) + np.einsum("nji,nj->ni", C_nb, omega_en_n)
    return MotionState(t, frames.ecef_from_llh(llh), v_e, a_e, C_en @ C_nb, omega_eb_b)


@dataclass(frozen=True, slots=True)
class SplineMotion:
    """Motion through positions and attitudes at given times, four times continuously differentiable.

    Build it with :meth:`through`.
    """

    duration: float
    _position: Any = field(repr=False)
    _angles: Any = field(repr=False)
    _origin: FloatArray = field(repr=False)

    @classmethod
    def through(cls, t: ArrayLike, llh: ArrayLike, rpy_nb: ArrayLike) -> SplineMotion:
        """Quintic splines through nodes.

        Parameters
        ----------
        t : array_like, shape (n,)
            Increasing times, the first is zero; at least six. [s]
        llh : array_like, shape (n, 3)
            Latitude, longitude [rad], ellipsoidal height [m]; not at a pole. A step of more than half a turn in
            longitude is read as crossing the antimeridian.
        rpy_nb : array_like, shape (n, 3)
            Roll, pitch, yaw [rad]; yaw steps of more than half a turn are read as going the short way round.

        Raises
        ------
        InputError
            If times do not start at zero and increase, or there are too few nodes.
        """
        from scipy.interpolate import make_interp_spline

        t = as_floats(t, "t", (None,))
        llh = as_floats(llh, "llh", (len(t), 3)).copy()
        rpy = as_floats(rpy_nb, "rpy_nb", (len(t), 3)).copy()
        if len(t) < 6 or t[0] != 0.0 or np.any(np.diff(t) <= 0.0):
            raise InputError("t: expected at least six increasing times that start at 0")
        llh[:, 1] = np.unwrap(llh[:, 1])
        rpy[:, 2] = np.unwrap(rpy[:, 2])
        # differences from the first node keep 1e-16 of a degree, not of a turn
        origin = llh[0].copy()
        return cls(float(t[-1]), make_interp_spline(t, llh - origin, k=5), make_interp_spline(t, rpy, k=5), origin)

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        return geodetic_state(
            t,
            self._position(t) + self._origin,
            self._position(t, 1),
            self._position(t, 2),
            self._angles(t),
            self._angles(t, 1),
        )
