"""Truth for simulated drives with every aid: a vehicle, an IMU in it, and all parameters wrong as their models say.

The vehicle's axle moves without slip; the IMU sits off it by a lever arm and turned by mount angles that are drawn,
like all parameters, from the models of the layout. Truth of every parameter is known at every epoch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filter_cases import ACCEL_N, GYRO_N, LEVER, ORIGIN

from schuler import rotation
from schuler.filtering.error_model import sensor_matrices
from schuler.filtering.states import StateLayout, StateModel
from schuler.recording.series import ImuSeries, Increments
from schuler.recording.trajectory import Trajectory
from schuler.simulation.motion import Motion, MotionState, ideal_increments, inertial_quantities
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

LEVER_V = np.array([-1.4, 0.3, 0.6])  # nominal, IMU to the middle of the rear axle

#: Models of all blocks that aids need; the IMU's own biases are in every layout.
MODELS = {
    "b_a": StateModel.random_walk(0.05, 2e-5),
    "b_g": StateModel.random_walk(2e-3, 1e-6),
    "S_a": StateModel.constant(3e-3),
    "S_g": StateModel.constant(3e-3),
    "b_a_run": StateModel.gauss_markov(0.01, 60.0),
    "b_g_run": StateModel.gauss_markov(3e-4, 40.0),
    "lever": StateModel.constant(0.3),
    "lever_v": StateModel.constant(0.3),
    "mount": StateModel.constant(0.03),
    "odometer": StateModel.constant(0.03),
    "clock": StateModel.random_walk(100.0, 0.3),
    "clock_drift": StateModel.random_walk(10.0, 0.1),
    "clock_2": StateModel.random_walk(30.0, 0.02),
    "clock_3": StateModel.random_walk(30.0, 0.02),
    "clock_4": StateModel.random_walk(30.0, 0.02),
    "b_heading": StateModel.constant(0.05),
    "baro": StateModel.random_walk(20.0, 0.05),
    "b_r": StateModel.gauss_markov(2.0, 60.0),
    "b_v": StateModel.gauss_markov(0.1, 20.0),
    "delay": StateModel.constant(0.1),
}

CLOCKS_BETWEEN = ("clock_2", "clock_3", "clock_4")


def layout(*blocks: str, **models: StateModel) -> StateLayout:
    """Both biases and the named blocks, with the models above or those given."""
    names = ("b_a", "b_g", *(b for b in blocks if b not in ("b_a", "b_g")))
    return StateLayout({name: MODELS[name] for name in names} | models)


def town(minutes: float = 2.0) -> Motion:
    """A car with stops of eight seconds between its turns."""
    turn = np.pi / 2
    lap = [
        Manoeuvre(duration=8.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=turn),
        Manoeuvre(duration=6.0, speed=15.0, climb=0.3),
        Manoeuvre(duration=7.0, turn=-1.3 * turn, climb=0.0),
        Manoeuvre(duration=8.0, speed=0.0),
        Manoeuvre(duration=8.0),
        Manoeuvre(duration=8.0, speed=10.0),
        Manoeuvre(duration=9.0, turn=1.8 * turn),
        Manoeuvre(duration=7.0, turn=-turn),
        Manoeuvre(duration=8.0, speed=0.0),
        Manoeuvre(duration=4.0),
    ]
    return ManoeuvreMotion.of([Manoeuvre(duration=8.0), *lap * (int(minutes) + 1)], ORIGIN, heading=0.4, bank=0.3)


@dataclass(frozen=True)
class Drive:
    """An ideal drive of the axle, sampled where runs need it."""

    motion: Motion
    seconds: float
    increments: Increments
    rate: np.ndarray  # omega_ib at the limits of the intervals and their middles, alternating
    record: MotionState
    fixes_t: np.ndarray
    aids_t: np.ndarray
    at_fixes: MotionState
    at_aids: MotionState

    @classmethod
    def of(cls, motion: Motion, seconds: float, rate_hz: float = 100.0, record_s: float = 1.0) -> Drive:
        n = round(seconds * rate_hz)
        t = np.arange(n + 1) / rate_hz
        fine = motion.state(np.arange(2 * n + 1) / (2.0 * rate_hz))
        # between samples; every second aid is at the time of a fix
        fixes_t, aids_t = (np.round(np.arange(s + 0.0037, seconds - 0.3, s), 9) for s in (1.0, 0.5))
        return cls(
            motion, seconds, Increments(t[1:], np.diff(t), *ideal_increments(motion, t)), inertial_quantities(fine)[0],
            motion.state(np.arange(0.0, seconds + 0.5 * record_s, record_s)), fixes_t, aids_t,
            motion.state(fixes_t), motion.state(aids_t),
        )  # fmt: skip


@dataclass(frozen=True)
class Body:
    """The IMU at some times."""

    r: np.ndarray
    v: np.ndarray
    C: np.ndarray
    omega: np.ndarray  # omega_eb, body axes

    def point(self, lever: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity of a point of the body, Earth-fixed."""
        return self.r + self.C @ lever, self.v + np.einsum("nij,nj->ni", self.C, np.cross(self.omega, lever))

    @property
    def q(self) -> np.ndarray:
        return rotation.quat_from_dcm(self.C)


class Truth:
    """One draw: parameters with their walks, the IMU's place in the vehicle, the log it wrote."""

    def __init__(
        self, drive: Drive, lay: StateLayout, rng: np.random.Generator, given: dict | None = None, *, noise: float = 1.0
    ):
        self.drive, self.layout, self.rng, self.noise = drive, lay, rng, noise
        p = noise * np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9)
        for name, value in (given or {}).items():
            p[lay[name].start - 9 : lay[name].stop - 9] = value
        inc = drive.increments
        n, h = len(inc), float(inc.dt[0])
        self.t = np.concatenate(([0.0], inc.t))
        self.history = _walks(lay, p, n, h, rng, noise)
        self.C_vb = rotation.dcm_from_rpy(np.array([0.0, *self.constant("mount", 2)]))
        self.lever_v = LEVER_V + self.constant("lever_v", 3)
        self.lever = LEVER + self.constant("lever", 3)
        w = drive.rate @ self.C_vb
        turning = np.cross(w, np.cross(w, self.lever_v))
        f = inc.dv_ib_b @ self.C_vb - np.cross(np.diff(w[::2], axis=0), self.lever_v)
        f -= h / 6.0 * (turning[:-2:2] + 4.0 * turning[1::2] + turning[2::2])  # Simpson's rule
        g = inc.dtheta_ib_b @ self.C_vb
        fixed = p.copy()
        for name in ("b_a", "b_g", "b_a_run", "b_g_run"):
            if name in lay:
                fixed[lay[name].start - 9 : lay[name].stop - 9] = 0.0
        _, _, M_g, M_a, G_g = sensor_matrices(lay, fixed)
        root = noise * np.sqrt(h)
        self.log = Increments(
            inc.t, inc.dt,
            g + g @ M_g.T + f @ G_g.T + self._bias("b_g") * h + GYRO_N * root * rng.standard_normal((n, 3)),
            f + f @ M_a.T + self._bias("b_a") * h + ACCEL_N * root * rng.standard_normal((n, 3)),
        )  # fmt: skip
        body = self.body(drive.record)
        self.reference = Trajectory(drive.record.t, body.r, body.v, body.q)

    def constant(self, name: str, size: int) -> np.ndarray:
        """Value of a block at the start, zero if it is not in the layout."""
        return self.history[0, self._columns(name)] if name in self.layout else np.zeros(size)

    def at(self, name: str, t: np.ndarray) -> np.ndarray:
        """Values of a block at times. Shape (k, size)."""
        if name not in self.layout:
            return np.zeros((len(t), 1))
        return np.stack([np.interp(t, self.t, x) for x in self.history[:, self._columns(name)].T], axis=1)

    def body(self, s: MotionState) -> Body:
        """The IMU where the axle is ``s``."""
        C, omega = s.C_eb @ self.C_vb, s.omega_eb_b @ self.C_vb
        arm = np.einsum("nij,nj->ni", C, np.cross(omega, self.lever_v))
        return Body(s.r_eb_e - C @ self.lever_v, s.v_eb_e - arm, C, omega)

    def series(self) -> ImuSeries:
        return ImuSeries(self.log.t, self.log.dtheta_ib_b, self.log.dv_ib_b, "increment")

    def draws(self, *shape: int) -> np.ndarray:
        return self.noise * self.rng.standard_normal(shape)

    def _columns(self, name: str) -> slice:
        part = self.layout[name]
        return slice(part.start - 9, part.stop - 9)

    def _bias(self, name: str) -> np.ndarray:
        """Mean bias over each interval."""
        total = sum(self.history[:, self._columns(b)] for b in (name, f"{name}_run") if b in self.layout)
        return 0.5 * (total[1:] + total[:-1])


def _walks(
    lay: StateLayout, p: np.ndarray, n: int, h: float, rng: np.random.Generator, noise: float = 1.0
) -> np.ndarray:
    """Parameters at the limits of all intervals (n + 1, m), drawn from the models with their exact step covariance."""
    from scipy.signal import lfilter

    history = np.tile(p, (n + 1, 1))
    beta, q = lay.dynamics().T
    keep = np.exp(-beta * h)
    step = noise * np.sqrt(np.where(beta > 0, q * -np.expm1(-2 * beta * h) / np.where(beta > 0, 2 * beta, 1), q * h))
    for k in np.flatnonzero((q > 0) | (beta > 0)):
        w = step[k] * rng.standard_normal(n)
        history[1:, k] = lfilter([1.0], [1.0, -keep[k]], w, zi=[keep[k] * p[k]])[0]
    if "clock" in lay:
        c = lay["clock"].start - 9
        drift = history[:, c + 1]
        history[1:, c] += np.cumsum(0.5 * (drift[1:] + drift[:-1]) * h)
    return history
