"""Strapdown: from increments of an IMU to position, velocity and attitude, in Earth-fixed or north-east-down axes.

Both mechanizations use exact rotations and the same coning, sculling and gravity; they agree to rounding and to the
discretisation of their own navigation axes. Earth-fixed is the default: it is faster and has no pole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler import earth, frames, rotation, units
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory

Frame = Literal["ecef", "ned"]


#: Latitude up to which north-east-down axes are integrated: 200 m/s at 100 Hz are 1 mm off there, 2 cm at 2 km.
_NEAREST_POLE = 89.9 * units.DEG


@dataclass(frozen=True, repr=False)
class NavState(Abridged):
    """Position, velocity and attitude at one time.

    Attributes
    ----------
    t : float
        [s]
    r_eb_e, v_eb_e : ndarray, shape (3,)
        Position [m] and velocity [m/s], Earth-fixed axes.
    q_eb : ndarray, shape (4,)
        Attitude, body to Earth-fixed axes.
    """

    t: float
    r_eb_e: FloatArray
    v_eb_e: FloatArray
    q_eb: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "r_eb_e", as_vector3(self.r_eb_e, "NavState.r_eb_e"))
        object.__setattr__(self, "v_eb_e", as_vector3(self.v_eb_e, "NavState.v_eb_e"))
        q = as_floats(self.q_eb, "NavState.q_eb", (4,))
        norm = float(np.linalg.norm(q))
        if abs(norm - 1.0) > 1e-6:
            raise InputError(f"NavState.q_eb: expected a unit quaternion, got one of norm {norm:.6g}")
        object.__setattr__(self, "q_eb", q / norm)

    @classmethod
    def from_geodetic(
        cls, t: float, llh: ArrayLike, v_eb_n: ArrayLike = (0.0, 0.0, 0.0), rpy_nb: ArrayLike = (0.0, 0.0, 0.0)
    ) -> NavState:
        """From latitude, longitude [rad], height [m], velocity north-east-down [m/s] and roll, pitch, yaw [rad]."""
        llh = as_vector3(llh, "llh")
        q_en = frames.q_en(llh)
        return cls(
            float(t),
            frames.ecef_from_llh(llh),
            rotation.rotate(q_en, as_vector3(v_eb_n, "v_eb_n")),
            rotation.quat_multiply(q_en, rotation.quat_from_rpy(as_vector3(rpy_nb, "rpy_nb"))),
        )

    @property
    def llh(self) -> FloatArray:
        """Latitude, longitude [rad], ellipsoidal height [m]. Shape (3,)."""
        return frames.llh_from_ecef(self.r_eb_e)

    @property
    def v_eb_n(self) -> FloatArray:
        """Velocity north, east, down. Shape (3,). [m/s]"""
        return rotation.rotate(rotation.quat_conjugate(frames.q_en(self.llh)), self.v_eb_e)

    @property
    def q_nb(self) -> FloatArray:
        """Attitude, body to north-east-down axes. Shape (4,)."""
        return rotation.quat_multiply(rotation.quat_conjugate(frames.q_en(self.llh)), self.q_eb)

    @property
    def rpy_nb(self) -> FloatArray:
        """Roll, pitch, yaw. Shape (3,). [rad]"""
        return rotation.rpy_from_quat(self.q_nb)


@explains_arguments
def mechanize(
    increments: Increments, initial: NavState, *, frame: Frame = "ecef", earth_rotation: bool = True
) -> FullTrajectory:
    """Integrate a log of increments from a known start, without any correction.

    Parameters
    ----------
    increments : Increments
        In body axes; the first interval must begin at ``initial.t`` (to 1 ms).
    initial : NavState
        Start of the integration.
    frame : {"ecef", "ned"}
        Axes of the integration. North-east-down is for comparison with other programs; it fails near the poles.
    earth_rotation : bool
        With False the Earth stands still (see :func:`schuler.simulation.motion.inertial_quantities`).

    Returns
    -------
    Trajectory
        One state for each interval's end.

    Raises
    ------
    InputError
        If the log does not start where the initial state is, or the frame is unknown; if the path comes within 0.1 deg
        of a pole in north-east-down axes, where they turn too fast for the interval.

    Notes
    -----
    The discretisation error of the sensors' integrals is of fourth order in the interval for smooth motion; that of
    gravity and Coriolis, taken at mid interval, of second: 3 cm in ten minutes at 250 m/s and 1 Hz, 1e-5 m at 100 Hz,
    below the first wherever a body turns or shakes. The vertical channel of any
    free-running mechanization is unstable: a height error grows with a time constant of 570 s.

    References
    ----------
    Groves (2013), chapter 5; Savage (1998).
    """
    from schuler.mechanization import kernels as _kernels

    if frame not in ("ecef", "ned"):
        raise InputError(f"frame: expected 'ecef' or 'ned', got {frame!r}")
    if abs(increments.start - initial.t) > 1e-3:
        raise InputError(
            f"the initial state is at {initial.t:.4f} s but the first interval begins at {increments.start:.4f} s; "
            "cut the log with .between(...) or give the state of that time"
        )
    _kernels.prepare_strapdown()
    n = len(increments)
    q, v, r = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
    omega = earth.WGS84.omega_ie if earth_rotation else 0.0
    log = (increments.dtheta_ib_b, increments.dv_ib_b, increments.dt)
    if frame == "ecef":
        nav = np.concatenate((initial.q_eb, initial.v_eb_e, initial.r_eb_e))
        _kernels.strapdown(*log, nav, omega, 0, q, v, r)
        return FullTrajectory(increments.t, r, v, q)
    nav = np.concatenate((initial.q_nb, initial.v_eb_n, initial.llh))
    _kernels.strapdown(*log, nav, omega, 1, q, v, r)
    if not np.abs(r[:, 0]).max(initial=0.0) < _NEAREST_POLE:
        k = int(np.flatnonzero(~(np.abs(r[:, 0]) < _NEAREST_POLE))[0])
        raise InputError(
            f"the path comes within 0.1 deg of a pole at {increments.t[k]:.3f} s, where north-east-down axes turn "
            "faster than the interval resolves: use frame='ecef'; its .v_eb_n and .rpy_nb are north-east-down"
        )
    q_en = frames.q_en(r)
    return FullTrajectory(
        increments.t, frames.ecef_from_llh(r), rotation.rotate(q_en, v), rotation.quat_multiply(q_en, q)
    )


def derivative_ecef(
    C_eb: ArrayLike, v_eb_e: ArrayLike, r_eb_e: ArrayLike, omega_ib_b: ArrayLike, f_ib_b: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time derivatives of the Earth-fixed navigation equations: what the mechanization integrates.

    Parameters
    ----------
    C_eb : array_like, shape (3, 3)
    v_eb_e, r_eb_e : array_like, shape (3,)
        [m/s], [m]
    omega_ib_b, f_ib_b : array_like, shape (3,)
        [rad/s], [m/s^2]

    Returns
    -------
    C_dot, v_dot, r_dot : ndarray, shapes (3, 3), (3,), (3,)

    References
    ----------
    Groves (2013), eqs. (5.24)-(5.39).
    """
    C, v, r = np.asarray(C_eb), np.asarray(v_eb_e), np.asarray(r_eb_e)
    omega_ie = np.array([0.0, 0.0, earth.WGS84.omega_ie])
    C_dot = C @ rotation.skew(omega_ib_b) - rotation.skew(omega_ie) @ C
    return C_dot, C @ np.asarray(f_ib_b) + earth.gravity_ecef(r) - 2.0 * np.cross(omega_ie, v), v


def derivative_ned(
    C_nb: ArrayLike, v_eb_n: ArrayLike, llh: ArrayLike, omega_ib_b: ArrayLike, f_ib_b: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time derivatives of the north-east-down navigation equations.

    Parameters
    ----------
    C_nb : array_like, shape (3, 3)
    v_eb_n, llh : array_like, shape (3,)
        [m/s], [rad, rad, m]
    omega_ib_b, f_ib_b : array_like, shape (3,)
        [rad/s], [m/s^2]

    Returns
    -------
    C_dot, v_dot, llh_dot : ndarray, shapes (3, 3), (3,), (3,)

    References
    ----------
    Groves (2013), eqs. (5.41)-(5.56); Yaman (2017), eqs. (2-18)-(2-20), (2-27), (2-48).
    """
    C, v = np.asarray(C_nb), np.asarray(v_eb_n, dtype=np.float64)
    lat, _, h = np.asarray(llh, dtype=np.float64)
    omega_ie, omega_en = earth.earth_rate_ned(lat), earth.transport_rate_ned(lat, h, v)
    C_dot = C @ rotation.skew(omega_ib_b) - rotation.skew(omega_ie + omega_en) @ C
    v_dot = C @ np.asarray(f_ib_b) + earth.gravity_ned(lat, h) - np.cross(2.0 * omega_ie + omega_en, v)
    R_N, R_E = earth.radii_of_curvature(lat)
    return C_dot, v_dot, np.array([v[0] / (R_N + h), v[1] / ((R_E + h) * np.cos(lat)), -v[2]])
