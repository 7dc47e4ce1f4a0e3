"""Motion: true position, velocity, attitude, and the specific force and angular rate that belong to them exactly.

A *motion* is anything that can be asked for its :class:`MotionState` at any times. The state holds the derivatives,
so what an ideal IMU measures follows without numerical differentiation (inverse mechanization), and the integrals an
IMU reports follow by Gauss-Legendre quadrature to rounding.

References
----------
Groves (2013), chapter 2.3; Yaman (2017), appendix C (inverse mechanization), here in Earth-fixed axes so that a motion
may cross a pole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, slots=True, repr=False)
class MotionState(Abridged):
    """True state of the body at n times.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time. [s]
    r_eb_e, v_eb_e, a_eb_e : ndarray, shape (n, 3)
        Position [m], velocity [m/s] and its derivative [m/s^2] relative to the Earth, Earth-fixed axes.
    C_eb : ndarray, shape (n, 3, 3)
        Attitude, body to Earth-fixed axes.
    omega_eb_b : ndarray, shape (n, 3)
        Angular rate of the body relative to the Earth, body axes. [rad/s]
    """

    t: FloatArray
    r_eb_e: FloatArray
    v_eb_e: FloatArray
    a_eb_e: FloatArray
    C_eb: FloatArray
    omega_eb_b: FloatArray

    @property
    def llh(self) -> FloatArray:
        """Latitude, longitude [rad], ellipsoidal height [m]. Shape (n, 3)."""
        return frames.llh_from_ecef(self.r_eb_e)

    @property
    def v_eb_n(self) -> FloatArray:
        """Velocity north, east, down. Shape (n, 3). [m/s]"""
        v_n: FloatArray = np.einsum("nji,nj->ni", frames.C_en(self.llh), self.v_eb_e)
        return v_n

    @property
    def C_nb(self) -> FloatArray:
        """Attitude, body to north-east-down axes. Shape (n, 3, 3)."""
        C_nb: FloatArray = np.einsum("nji,njk->nik", frames.C_en(self.llh), self.C_eb)
        return C_nb

    @property
    def q_eb(self) -> FloatArray:
        """Attitude as quaternion, body to Earth-fixed axes. Shape (n, 4)."""
        return rotation.quat_from_dcm(self.C_eb)

    @property
    def rpy_nb(self) -> FloatArray:
        """Roll, pitch, yaw. Shape (n, 3). [rad]"""
        return rotation.rpy_from_dcm(self.C_nb)


class Motion(Protocol):
    """A trajectory that can be evaluated anywhere in its span."""

    @property
    def duration(self) -> float:
        """Length of the motion, which starts at zero. [s]"""
        ...

    def state(self, t: FloatArray) -> MotionState:
        """True state at times of shape (n,) within ``[0, duration]``."""
        ...


def check_span(t: FloatArray, duration: float) -> None:
    """Refuse times outside ``[0, duration]``: a motion is not extrapolated. [s]"""
    if len(t) and (t.min() < -1e-6 or t.max() > duration + 1e-6):
        raise InputError(f"asked for {t.min():.3f}..{t.max():.3f} s of a motion that lasts {duration:.3f} s")


def inertial_quantities(state: MotionState, *, earth_rotation: bool = True) -> tuple[FloatArray, FloatArray]:
    """Angular rate and specific force an ideal IMU senses.

    Parameters
    ----------
    state : MotionState
    earth_rotation : bool
        With False the Earth stands still while gravity stays what it is: no Earth rate on the gyros and no Coriolis
        term (the world of Stefanisko's ``gendata``). The mechanization takes the same flag.

    Returns
    -------
    omega_ib_b : ndarray, shape (n, 3)
        Angular rate relative to inertial space, body axes. [rad/s]
    f_ib_b : ndarray, shape (n, 3)
        Specific force, body axes: at rest and level (0, 0, -g). [m/s^2]
    """
    omega = np.array([0.0, 0.0, earth.WGS84.omega_ie if earth_rotation else 0.0])
    omega_ib_b = state.omega_eb_b + np.einsum("nji,j->ni", state.C_eb, omega)
    f_e = state.a_eb_e + 2.0 * np.cross(omega, state.v_eb_e) - earth.gravity_ecef(state.r_eb_e)
    return omega_ib_b, np.einsum("nji,nj->ni", state.C_eb, f_e)


def ideal_rates(motion: Motion, t: ArrayLike, *, earth_rotation: bool = True) -> tuple[FloatArray, FloatArray]:
    """Angular rate and specific force at instants. Shapes (n,) to (n, 3) [rad/s] and (n, 3) [m/s^2]."""
    t = as_floats(t, "t", (None,))
    omega_ib_b, f_ib_b = np.empty((len(t), 3)), np.empty((len(t), 3))
    for first in range(0, len(t), _RATES):  # bounded memory, as of increments
        part = slice(first, first + _RATES)
        omega_ib_b[part], f_ib_b[part] = inertial_quantities(motion.state(t[part]), earth_rotation=earth_rotation)
    return omega_ib_b, f_ib_b


def ideal_increments(
    motion: Motion, t: ArrayLike, *, earth_rotation: bool = True, nodes: int = 4
) -> tuple[FloatArray, FloatArray]:
    """Output of an ideal integrating IMU: the integrals of angular rate and specific force in body axes.

    Parameters
    ----------
    motion : Motion
    t : array_like, shape (n + 1,)
        Increasing limits of the intervals, within the motion. [s]
    earth_rotation : bool
        See :func:`inertial_quantities`.
    nodes : int
        Gauss-Legendre nodes in an interval; the error is of order ``dt**(2 * nodes + 1)``.

    Returns
    -------
    dtheta_ib_b : ndarray, shape (n, 3)
        Integral of the angular rate over ``(t[k], t[k + 1]]``; not the rotation vector of the interval, which
        differs by the coning term. [rad]
    dv_ib_b : ndarray, shape (n, 3)
        Integral of the specific force, in the turning body axes. [m/s]
    """
    t = as_floats(t, "t", (None,))
    if len(t) < 2 or np.any(np.diff(t) <= 0.0):
        raise InputError("t: expected at least two increasing limits of intervals")
    abscissae, weights = np.polynomial.legendre.leggauss(nodes)
    start, dt = t[:-1], np.diff(t)
    dtheta, dv = np.empty((len(dt), 3)), np.empty((len(dt), 3))
    for first in range(0, len(dt), _CHUNK):  # bounded memory for hours of data
        part = slice(first, first + _CHUNK)
        instants = start[part, None] + 0.5 * dt[part, None] * (1.0 + abscissae)
        omega, f = inertial_quantities(motion.state(instants.ravel()), earth_rotation=earth_rotation)
        weight = 0.5 * dt[part, None] * weights
        dtheta[part] = np.einsum("nk,nki->ni", weight, omega.reshape(-1, nodes, 3))
        dv[part] = np.einsum("nk,nki->ni", weight, f.reshape(-1, nodes, 3))
    return dtheta, dv


_CHUNK = 32_768
_RATES = 1 << 20  # instants: a yaw begins anew with them, which moves rates by their rounding


@dataclass(frozen=True, slots=True, repr=False)
class StaticMotion(Abridged):
    """A body at rest on the Earth.

    Attributes
    ----------
    llh : ndarray, shape (3,)
        Latitude, longitude [rad], ellipsoidal height [m].
    rpy_nb : ndarray, shape (3,)
        Roll, pitch, yaw. [rad]
    duration : float
        [s]
    """

    llh: FloatArray
    rpy_nb: FloatArray
    duration: float

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`Motion`."""
        n = len(t)
        zero = np.zeros((n, 3))
        C_eb = frames.C_en(self.llh) @ rotation.dcm_from_rpy(self.rpy_nb)
        r = np.broadcast_to(frames.ecef_from_llh(self.llh), (n, 3))
        return MotionState(t, r, zero, zero, np.broadcast_to(C_eb, (n, 3, 3)), zero)


LocalPath = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
LocalAttitude = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, repr=False)
class LocalMotion(Abridged):
    """Closed-form motion in the straight north-east-down axes of a point on the Earth.

    Attributes
    ----------
    origin_llh : ndarray, shape (3,)
        Origin of the axes: latitude, longitude [rad], ellipsoidal height [m].
    path : callable
        ``t (n,) -> (r_n, v_n, a_n)``, each (n, 3): position [m] and its two derivatives in the axes of the origin.
    attitude : callable
        ``t (n,) -> (C_nb (n, 3, 3), omega_nb_b (n, 3))``: attitude relative to the axes of the origin, and its rate
        in body axes. [rad/s]
    duration : float
        [s]
    """

    origin_llh: FloatArray
    path: LocalPath
    attitude: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    duration: float

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`Motion`."""
        C = frames.C_en(self.origin_llh)
        r, v, a = self.path(t)
        C_nb, omega_nb_b = self.attitude(t)
        return MotionState(t, frames.ecef_from_ned(r, self.origin_llh), v @ C.T, a @ C.T, C @ C_nb, omega_nb_b)


def euler_attitude(angles: LocalAttitude) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Attitude callable of :class:`LocalMotion` from Euler angles and their rates.

    Parameters
    ----------
    angles : callable
        ``t (n,) -> (rpy_nb (n, 3), rpy_rate (n, 3))``. [rad], [rad/s]
    """

    def attitude(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        rpy, rate = angles(t)
        return rotation.dcm_from_rpy(rpy), rotation.body_rate_from_rpy(rpy, rate)

    return attitude


def coning_motion(
    llh: ArrayLike, half_angle: float, rate: float, duration: float, *, origin_attitude: ArrayLike | None = None
) -> LocalMotion:
    """Classical coning: the body's z axis runs round a cone while the body does not turn about it.

    Parameters
    ----------
    llh : array_like, shape (3,)
        Where: latitude, longitude [rad], height [m].
    half_angle : float
        Half the cone's opening. [rad]
    rate : float
        Angular rate of the motion round the cone. [rad/s]
    duration : float
        [s]
    origin_attitude : array_like, shape (3, 3), optional
        ``C_nb`` about which the cone is run; default the axes of the place.

    Returns
    -------
    LocalMotion
        Attitude ``C_nb = C_0 exp([a (cos wt, sin wt, 0) x])``; the z gyro reads the constant
        ``-2 w sin^2(a / 2)`` relative to the Earth although the body never turns about z.

    References
    ----------
    Savage (1998), Strapdown inertial navigation integration algorithm design part 1, eq. (56).
    """
    C_0 = np.eye(3) if origin_attitude is None else as_floats(origin_attitude, "origin_attitude", (3, 3))
    a, w = float(half_angle), float(rate)

    def attitude(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        c, s, zero = np.cos(w * t), np.sin(w * t), np.zeros_like(t)
        C_nb = C_0 @ rotation.dcm_from_rotvec(np.stack((a * c, a * s, zero), axis=-1))
        axial = np.full_like(t, -2.0 * w * np.sin(0.5 * a) ** 2)
        return C_nb, np.stack((-w * np.sin(a) * s, w * np.sin(a) * c, axial), axis=-1)

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        zero = np.zeros((len(t), 3))
        return zero, zero, zero

    return LocalMotion(as_vector3(llh, "llh"), path, attitude, duration)


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
