"""Information bound of a field routine on the errors of an IMU, without any filter.

A plain covariance recursion over rests and turns with thirty constants and the attitude as states, as independent of
the filter as can be: closed forms for rests, sums over the motion for turns, no log.
"""

from __future__ import annotations

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import FloatArray
from schuler.sensors.spec import ImuSpec
from schuler.simulation.routine import RoutineMotion
from schuler.simulation.steps import Rest, Routine

AXES = "xyz"
#: Of the upper gauge, in the order of the bound.
NAMES = (
    *(f"b_a_{i}" for i in AXES), *(f"b_g_{i}" for i in AXES),
    *(f"M_a_{i}{j}" for i in AXES for j in AXES if i <= j), *(f"M_g_{i}{j}" for i in AXES for j in AXES),
    *(f"G_g_{i}{j}" for i in AXES for j in AXES),
)  # fmt: skip
# of the first attitude, wide beside what levelling tells [rad]
_TILT = 0.1
# steps of a turn: the attitude between them is good to 1e-3 of the columns
_STEPS = 40


def information_bound(
    spec: ImuSpec,
    routine: Routine,
    place: tuple[float, float, float],
    *,
    heading_sigma: float,
    held: bool = True,
    gravity_in_turns: bool = False,
    settle_s: float = 0.0,
) -> dict[str, float]:
    """Smallest 1-sigma of every parameter after a routine, from the noise and the prior of a specification.

    Parameters
    ----------
    spec : ImuSpec
        White noise and 1-sigma of turn-on bias, scale factor, misalignment, g-sensitivity.
    routine : Routine
    place : (float, float, float)
        Latitude, longitude [rad], height [m].
    heading_sigma : float
        1-sigma of the first heading. [rad]
    held : bool
        It is known that the unit does not turn at rest: three rates are compared with the Earth's, and the attitude
        stays. False: only the rate along the vertical is, and attitude is carried through rests by the gyroscopes.
    gravity_in_turns : bool
        Specific force is gravity alone in turns too, and known to be.
    settle_s : float
        Time at each end of a rest that does not count as rest. [s]

    Returns
    -------
    dict of str to float
        SI; parameters the specification has no uncertainty for are left out.

    Notes
    -----
    Linear at the true values, hence the Cramer-Rao bound of constants in white noise with normal prior. A filter that
    is told less (where the rests are, in which turns a hand accelerates) stays above it.
    """
    prior = np.array([_prior(spec, name) for name in NAMES])
    n = 3 + len(NAMES)
    P = np.zeros((n, n))
    P[:3, :3] = np.diag([_TILT, _TILT, heading_sigma]) ** 2
    P[3:, 3:] = np.diag(prior**2)
    N_a, N_g = spec.accel.random_walk, spec.gyro.random_walk
    g, omega_ie = earth.gravity_ned(place[0], place[2]), earth.earth_rate_ned(place[0])
    motion = RoutineMotion(routine, np.array(place))
    C_en = frames.C_en(np.array(place))

    def carried(P: FloatArray, C: FloatArray, omega: FloatArray, dt: float) -> FloatArray:
        Phi = np.eye(n)
        Phi[:3, 3:] = C @ gyro_columns(omega, -C.T @ g) * dt
        P = Phi @ P @ Phi.T
        P[:3, :3] += N_g**2 * dt * np.eye(3)
        return P

    def levelled(P: FloatArray, C: FloatArray, duration: float) -> FloatArray:
        H = np.hstack((C.T @ rotation.skew(g), accel_columns(-C.T @ g)))
        return _updated(P, H, N_a**2 / duration * np.eye(3))

    for k, step in enumerate(routine.steps):
        C, T = routine.attitudes[k], step.duration_s
        omega = C.T @ omega_ie
        columns = gyro_columns(omega, -C.T @ g)
        if isinstance(step, Rest):
            T = max(T - 2.0 * settle_s, 1e-3)
            for _ in range(2):
                P = carried(P, C, omega, settle_s)
            if held:
                P = levelled(P, C, T)
                P = _updated(P, np.hstack((-C.T @ rotation.skew(omega_ie), columns)), N_g**2 / T * np.eye(3))
                continue
            parts = max(1, round(T))
            down = (C.T @ g / np.linalg.norm(g))[None]
            for _ in range(parts):
                P = carried(P, C, omega, 0.5 * T / parts)
                P = levelled(P, C, T / parts)
                P = _updated(P, np.hstack((np.zeros((1, 3)), down @ columns)), np.array([[N_g**2 * parts / T]]))
                P = carried(P, C, omega, 0.5 * T / parts)
            continue
        dt = T / _STEPS
        state = motion.state(routine.limits[k] + (np.arange(_STEPS) + 0.5) * dt)
        for C_eb, omega_eb_b in zip(state.C_eb, state.omega_eb_b, strict=True):
            C = C_en.T @ C_eb
            P = carried(P, C, omega_eb_b + C.T @ omega_ie, dt)
            if gravity_in_turns:
                P = levelled(P, C, dt)
    sigma = np.sqrt(np.diag(P)[3:])
    return {name: float(s) for name, s, p in zip(NAMES, sigma, prior, strict=True) if p > 0.0}


def accel_columns(f: FloatArray) -> FloatArray:
    """Derivative of the measured specific force with respect to :data:`NAMES`. Shape (3, 30)."""
    return _columns("b_a", {"M_a": f})


def gyro_columns(omega: FloatArray, f: FloatArray) -> FloatArray:
    """Derivative of the measured rate. Shape (3, 30)."""
    return _columns("b_g", {"M_g": omega, "G_g": f})


def _columns(bias: str, matrices: dict[str, FloatArray]) -> FloatArray:
    J = np.zeros((3, len(NAMES)))
    for k, name in enumerate(NAMES):
        row = AXES.index(name[4])
        if name[:3] == bias:
            J[row, k] = 1.0
        elif name[:3] in matrices:
            J[row, k] = matrices[name[:3]][AXES.index(name[5])]
    return J


def _prior(spec: ImuSpec, name: str) -> float:
    triad = spec.accel if name[2] == "a" else spec.gyro
    if name.startswith("b"):
        return triad.turn_on_bias
    if name.startswith("G"):
        return triad.g_sensitivity
    return triad.scale_factor if name[4] == name[5] else triad.misalignment


def _updated(P: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    J = np.eye(len(P)) - K @ H
    return np.asarray(J @ P @ J.T + K @ R @ K.T)
