"""The motion of an IMU that a platform turns on a vehicle, and what an ideal IMU there reports."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import Kind
from schuler.recording.trajectory import FullTrajectory
from schuler.rotary.schedule import Schedule
from schuler.rotation import skew
from schuler.simulation.imu import IdealImu, ideal_imu
from schuler.simulation.motion import Motion, MotionState, StaticMotion, inertial_quantities

_STEP = 2e-3  # of the difference that gives a vehicle's angular acceleration [s]


@dataclass(frozen=True, eq=False, repr=False)
class RotatingMotion(Abridged):
    """Motion of the IMU itself: its own axes ``s`` take the place of the body's.

    Attributes
    ----------
    vehicle : Motion
        Motion of the body; the platform's axes meet at its origin.
    schedule : Schedule
        Zero of its time is zero of the motion's.
    offset_m : ndarray, shape (3,)
        From the point where the axes meet to the accelerometers, IMU axes: they feel centripetal and tangential
        acceleration. [m]

    Notes
    -----
    Exact, with one exception: an offset on a vehicle that itself turns needs the vehicle's angular acceleration, which
    a motion does not hold. It is a five-point difference over 8 ms (errors of 1e-9 rad/s^2 on smooth motions, times
    the offset); without offset, or on a vehicle at rest, it is not used.

    References
    ----------
    Du (2015), eqs. (2.2)-(2.4), whose ``f_sb = 0`` holds only for an IMU on the axis. Groves (2013), eq. (3.91) ff.
    """

    vehicle: Motion
    schedule: Schedule
    offset_m: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset_m", as_vector3(self.offset_m, "RotatingMotion.offset_m"))

    @property
    def duration(self) -> float:
        """That of the vehicle. [s]"""
        return self.vehicle.duration

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`; after a jump of rate, where there is one."""
        body, platform = self.vehicle.state(t), self.schedule
        C_bs, omega_bs_s = platform.C_bs(t), platform.omega_bs_s(t)
        C_es = body.C_eb @ C_bs
        carried = np.einsum("nji,nj->ni", C_bs, body.omega_eb_b)  # the vehicle's rate in IMU axes
        omega = carried + omega_bs_s
        if not self.offset_m.any():
            return MotionState(t, body.r_eb_e, body.v_eb_e, body.a_eb_e, C_es, omega)
        # d/dt of C_sb omega_eb_b in the turning axes
        alpha = platform.alpha_bs_s(t) - np.cross(omega_bs_s, carried)
        alpha += np.einsum("nji,nj->ni", C_bs, angular_acceleration(self.vehicle, t))
        r, v, a = moved_by_lever(omega, alpha, self.offset_m)
        return MotionState(
            t, body.r_eb_e + _turned(C_es, r), body.v_eb_e + _turned(C_es, v), body.a_eb_e + _turned(C_es, a), C_es,
            omega,
        )  # fmt: skip


def moved_by_lever(
    omega: FloatArray, alpha: FloatArray, lever: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration of a point of a turning body relative to its origin, in the body's axes.

    Parameters
    ----------
    omega, alpha : ndarray, shape (n, 3)
        Angular rate [rad/s] and acceleration [rad/s^2].
    lever : ndarray, shape (3,)
        [m]

    Returns
    -------
    r, v, a : ndarray, shape (n, 3)
        ``l``, ``omega x l`` and ``alpha x l + omega x (omega x l)``. [m], [m/s], [m/s^2]
    """
    v = np.cross(omega, lever)
    return np.broadcast_to(lever, omega.shape), v, np.cross(alpha, lever) + np.cross(omega, v)


def angular_acceleration(vehicle: Motion, t: FloatArray) -> FloatArray:
    """Derivative of a motion's ``omega_eb_b``, by differences of fourth order. Shapes (n,) to (n, 3). [rad/s^2]"""
    if isinstance(vehicle, StaticMotion):
        return np.zeros((len(t), 3))
    if vehicle.duration < 4.0 * _STEP:
        raise InputError(f"a motion of {vehicle.duration} s is too short for an IMU off the axis; give 10 ms or more")
    centre = np.clip(t, 2.0 * _STEP, vehicle.duration - 2.0 * _STEP)
    nodes = np.arange(-2, 3)
    omega = vehicle.state((centre[:, None] + _STEP * nodes).ravel()).omega_eb_b.reshape(-1, 5, 3)
    # derivative of the quartic through five nodes; off their centre only at the motion's ends
    coefficients = np.linalg.inv(np.vander(nodes.astype(np.float64), 5, increasing=True))
    x = (t - centre) / _STEP
    slopes = np.stack([k * x ** (k - 1) if k else np.zeros_like(x) for k in range(5)], axis=-1)
    alpha: FloatArray = np.einsum("nk,kj,nji->ni", slopes, coefficients, omega) / _STEP
    return alpha


def ideal_rotating_imu(
    motion: RotatingMotion, rate_hz: float, *, kind: Kind = "increment", earth_rotation: bool = True
) -> IdealImu:
    """Ideal output of a rotating IMU, exact also where the platform's rate or acceleration jumps within a sample.

    Parameters
    ----------
    motion : RotatingMotion
    rate_hz : float
        Sampling rate.
    kind, earth_rotation
        See :func:`schuler.simulation.imu.ideal_imu`, whose quadrature expects smooth samples: an interval with a jump
        is integrated here in parts.

    Returns
    -------
    IdealImu
        In IMU axes; ``truth`` is that of the IMU, see :func:`schuler.rotary.mechanization.body_trajectory` for the
        vehicle's.

    Notes
    -----
    Off the axis a jump of the rate is a blow to the accelerometers, of which an increment would hold the integral
    ``(jump of omega) x offset``; it is added.
    """
    ideal = ideal_imu(motion, rate_hz, kind=kind, earth_rotation=earth_rotation)
    breaks = motion.schedule.breakpoints(0.0, float(ideal.t[-1]))
    if kind == "rate" or len(breaks) == 0:
        return ideal
    gyro, accel = ideal.gyro.copy(), ideal.accel.copy()
    holders = np.searchsorted(ideal.t, breaks, side="right") - 1
    for k in np.unique(holders):
        cuts = np.concatenate((ideal.t[k : k + 1], breaks[holders == k], ideal.t[k + 1 : k + 2]))
        cuts = cuts[np.concatenate(([True], np.diff(cuts) > 1e-12))]
        gyro[k], accel[k] = _in_parts(motion, cuts, earth_rotation)
    if motion.offset_m.any():
        before = motion.schedule.omega_bs_s(breaks - _TINY)
        jump = motion.schedule.omega_bs_s(breaks + _TINY) - before
        np.add.at(accel, holders, np.where(np.abs(jump) > 1e-6, jump, 0.0) @ skew(motion.offset_m))
    return ideal._replace(gyro=gyro, accel=accel)


_TINY = 1e-9  # to either side of a jump [s]


def _in_parts(motion: RotatingMotion, cuts: FloatArray, earth_rotation: bool) -> tuple[FloatArray, FloatArray]:
    """Integrals over ``cuts[0]..cuts[-1]`` whose inner points are jumps."""
    x, w = np.polynomial.legendre.leggauss(6)
    h = np.diff(cuts)
    t = (cuts[:-1, None] + 0.5 * h[:, None] * (1.0 + x)).ravel()
    weight = (0.5 * h[:, None] * w).ravel()
    omega, f = inertial_quantities(motion.state(t), earth_rotation=earth_rotation)
    return weight @ omega, weight @ f


def _turned(C: FloatArray, v: FloatArray) -> FloatArray:
    turned: FloatArray = np.einsum("nij,nj->ni", C, v)
    return turned


def vehicle_truth(motion: RotatingMotion, t: ArrayLike) -> FullTrajectory:
    """True trajectory of the vehicle under the IMU at times (n,)."""
    from schuler.simulation.imu import truth

    return truth(motion.vehicle, np.asarray(t, dtype=np.float64))
