"""Simulated runs shared by the filter tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, gnss_measurements
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries, Increments
from schuler.recording.trajectory import Trajectory
from schuler.simulation.imu import truth
from schuler.simulation.motion import Motion, ideal_increments
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

ORIGIN = np.array([np.radians(47.0), np.radians(8.0), 450.0])
LEVER = np.array([1.2, -0.4, -0.9])
GYRO_N, ACCEL_N = 1e-4, 2e-3
SIGMA_R, SIGMA_V = np.array([0.8, 0.8, 1.5]), np.array([0.05, 0.05, 0.08])
START_ATT, START_V, START_R = np.array([0.01, 0.01, 0.05]), np.full(3, 0.1), np.array([0.8, 0.8, 1.5])


def drive(minutes: float = 2.0) -> Motion:
    """A car that starts, turns left and right, brakes and stops, again and again."""
    turn = np.pi / 2
    lap = [
        Manoeuvre(duration=8.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=turn),
        Manoeuvre(duration=6.0, speed=16.0),
        Manoeuvre(duration=7.0, turn=-1.3 * turn, climb=0.4),
        Manoeuvre(duration=8.0, speed=6.0),
        Manoeuvre(duration=6.0, turn=-1.1 * turn, climb=0.0),
        Manoeuvre(duration=10.0, turn=1.8 * turn, speed=14.0),
        Manoeuvre(duration=8.0, speed=0.0),
    ]
    commands = [Manoeuvre(duration=5.0), *lap * (int(minutes) + 1)]
    return ManoeuvreMotion.of(commands, ORIGIN, heading=0.4, bank=0.3)


@dataclass(frozen=True)
class Case:
    """An ideal log with its truth; errors are added by seed."""

    increments: Increments
    fixes_t: np.ndarray
    truth_fixes: object
    truth: Trajectory

    @classmethod
    def of(
        cls, motion: Motion, seconds: float, rate_hz: float = 100.0, fix_s: float = 1.0, offset: float = 0.0037
    ) -> Case:
        t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
        dtheta, dv = ideal_increments(motion, t)
        fixes = np.arange(fix_s + offset, seconds, fix_s)
        return cls(
            Increments(t[1:], np.diff(t), dtheta, dv),
            fixes,
            motion.state(fixes),
            truth(motion, np.arange(0.0, seconds + 0.5)),
        )


def layout(states: int = 21) -> StateLayout:
    models = {
        "b_a": StateModel.random_walk(0.05, 2e-5),
        "b_g": StateModel.random_walk(2e-3, 1e-6),
        "S_a": StateModel.constant(3e-3),
        "S_g": StateModel.constant(3e-3),
        "M_a6": StateModel.constant(2e-3),
        "M_g": StateModel.constant(2e-3),
        "G_g": StateModel.constant(2e-5),
        "lever": StateModel.constant(0.2),
    }
    names = {15: 2, 21: 4, 33: 6, 42: 7, 45: 8}[states]
    return StateLayout(dict(list(models.items())[:names]))


def corrupted(
    case: Case, lay: StateLayout, parameters: np.ndarray, rng: np.random.Generator, walk: bool = True
) -> tuple[Increments, np.ndarray]:
    """The log with parameter errors and noise from the filter's own model; also the parameters at every epoch's end."""
    from schuler.filtering.error_model import sensor_matrices

    inc = case.increments
    n, h = len(inc), inc.dt[:, None]
    history = np.tile(parameters, (n + 1, 1))
    if walk:
        beta, q = lay.dynamics().T
        e = np.exp(-beta * inc.dt[0])
        step = np.sqrt(np.where(beta > 0, q * (1 - e**2) / (2 * np.where(beta > 0, beta, 1.0)), q * inc.dt[0]))
        from scipy.signal import lfilter

        for k in np.flatnonzero((q > 0) | (beta > 0)):
            w = step[k] * rng.standard_normal(n)
            history[1:, k] = lfilter([1.0], [1.0, -e[k]], w, zi=[e[k] * parameters[k]])[0]
    _, _, M_g, M_a, G_g = sensor_matrices(lay, np.zeros(lay.size - 9))
    bias = {
        name: 0.5
        * (
            history[1:, lay[name].start - 9 : lay[name].stop - 9]
            + history[:-1, lay[name].start - 9 : lay[name].stop - 9]
        )
        for name in ("b_a", "b_g")
    }
    fixed = parameters.copy()
    fixed[:6] = 0.0
    _, _, M_g, M_a, G_g = sensor_matrices(lay, fixed)
    f, w = inc.dv_ib_b, inc.dtheta_ib_b
    root = np.sqrt(h)
    dv = f + f @ M_a.T + bias["b_a"] * h + ACCEL_N * root * rng.standard_normal((n, 3))
    dtheta = w + w @ M_g.T + f @ G_g.T + bias["b_g"] * h + GYRO_N * root * rng.standard_normal((n, 3))
    return Increments(inc.t, inc.dt, dtheta, dv), history


def fixes(case: Case, rng: np.random.Generator, lever: np.ndarray = LEVER) -> GnssSeries:
    s = case.truth_fixes
    n = len(case.fixes_t)
    r = s.r_eb_e + s.C_eb @ lever
    v = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, lever))
    C = frames.C_en(frames.llh_from_ecef(r))
    r = r + np.einsum("nij,nj->ni", C, SIGMA_R * rng.standard_normal((n, 3)))
    v_n = np.einsum("nji,nj->ni", C, v) + SIGMA_V * rng.standard_normal((n, 3))
    return GnssSeries(
        case.fixes_t,
        frames.llh_from_ecef(r),
        np.tile(np.diag(SIGMA_R**2), (n, 1, 1)),
        v_n,
        np.tile(np.diag(SIGMA_V**2), (n, 1, 1)),
    )


def start(case: Case, lay: StateLayout, rng: np.random.Generator, parameters=None) -> InitialState:
    """Truth at the start, wrong by draws of the stated uncertainty."""
    T = case.truth
    C = frames.C_en(T.llh[0])
    nav = NavState(
        0.0,
        T.r_eb_e[0] + C @ (START_R * rng.standard_normal(3)),
        T.v_eb_e[0] + C @ (START_V * rng.standard_normal(3)),
        rotation.quat_multiply(rotation.quat_from_rotvec(C @ (START_ATT * rng.standard_normal(3))), T.q_eb[0]),
    )
    return InitialState.from_sigmas(
        nav, lay, attitude=START_ATT, velocity=START_V, position=START_R, parameters=parameters
    )


def filtered(case: Case, lay: StateLayout, seed: int, **options) -> tuple[NavigationResult, np.ndarray]:
    """One run: parameters drawn from their models, noise, filter. Returns the result and true parameters at records."""
    rng = np.random.default_rng([7, seed])
    parameters = np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9)
    log, history = corrupted(case, lay, parameters, rng)
    lever = LEVER.copy()
    nominal = lever
    if "lever" in lay:
        lever = nominal + parameters[lay["lever"].start - 9 : lay["lever"].stop - 9]
    schedule = gnss_measurements(fixes(case, rng, lever), nominal, gate=None)
    options = FilterOptions(**options)
    forward = run(log, schedule, start(case, lay, rng), lay, np.full(3, GYRO_N**2), np.full(3, ACCEL_N**2), options)
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay, lever_arm_b=nominal)
    at = np.searchsorted(log.t, result.t - 1e-9) + 1
    return result, history[at]


def stream(live: Navigator, log: Increments, schedule: MeasurementSchedule, late_s: float = 0.0) -> None:
    """Feed a navigator sample by sample; each measurement comes so long after its time."""
    arrival, first = schedule.t + late_s, 0
    for k in range(len(log)):
        due = int(np.searchsorted(arrival, log.t[k] + 1e-9, side="right"))
        if due > first:
            live.aid(schedule.where(np.arange(first, due)))
            first = due
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k])


def moved(nav, dx):
    """The state of a kernel (10,) with an error (9,) added: attitude, velocity, position."""
    n = nav.copy()
    n[:4] = rotation.quat_multiply(rotation.quat_from_rotvec(dx[:3]), nav[:4])
    n[4:7] += dx[3:6]
    n[7:10] += dx[6:9]
    return n
