"""System matrices and transitions along motions, against the engine and its error model."""

import numpy as np
import pytest
from scipy.linalg import expm

from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.error_model import ecef_from_ned_states, system_matrix_ecef
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import POSITION, VELOCITY, ZERO_RATE, MeasurementSchedule, merged
from schuler.filtering.states import StateLayout, StateModel
from schuler.frames import ecef_from_llh, llh_from_ecef
from schuler.mechanization.strapdown import NavState
from schuler.observability import (
    degree_of_observability,
    motion_local_spectrum,
    motion_system,
    spectrum,
    system_matrices,
)
from schuler.observability.dynamics import transitions
from schuler.observability.system import state_names
from schuler.recording.series import ImuSeries
from schuler.rotary.rotating_imu import RotatingMotion
from schuler.rotary.schemes import continuous, reciprocating
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import LocalMotion, StaticMotion, euler_attitude, inertial_quantities
from schuler.simulation.waypoints import Waypoint, WaypointMotion
from schuler.units import DEG, DEG_PER_HR

HERE = np.array([45.75 * DEG, 0.1, 0.0])
START = np.array([DEG] * 3 + [0.01] * 3 + [1.0] * 3)
LAYOUT = StateLayout({"b_a": StateModel.constant(0.2), "b_g": StateModel.constant(400.0 * DEG_PER_HR)})
ALL = StateLayout(
    {name: StateModel.constant(0.01) for name in ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")}
    | {"b_a_run": StateModel.gauss_markov(0.01, 50.0)}
)


def still(duration=60.0, rpy=(0.0, 0.0, 0.0)):
    return StaticMotion(HERE, np.array(rpy) * DEG, duration)


def drive():
    points = [Waypoint(llh=HERE + np.array([a, b, 0.0]), speed=12.0) for a, b in ((0, 0), (4e-5, 1e-5), (5e-5, 6e-5))]
    return WaypointMotion.through(points)


def velocities(t, sigma=0.01):
    return MeasurementSchedule.of(VELOCITY, t, np.zeros((len(t), 3)), sigma**2)


def test_system_matrices_are_those_of_the_error_model():
    """Many at once against one at a time; identical formulas, rounding."""
    motion = RotatingMotion(drive(), continuous("z", 20.0 * DEG))
    t = np.array([0.0, 7.0, 31.0])
    F = system_matrices(motion, ALL, t)
    s = motion.state(t)
    omega, f = inertial_quantities(s)
    for k in range(3):
        expected = system_matrix_ecef(ALL, s.C_eb[k], s.r_eb_e[k], omega[k], f[k])
        assert F[k] == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_ned_matrices_are_the_turned_ones():
    """``d(T' Phi T)/dt = F_ned (T' Phi T)``: transitions of both belong together; discretisation."""
    motion, t = drive(), np.linspace(0.0, 20.0, 5)
    a = transitions(lambda x: system_matrices(motion, LAYOUT, x), t)
    b = transitions(lambda x: system_matrices(motion, LAYOUT, x, axes="ned"), t)
    T = ecef_from_ned_states(llh_from_ecef(motion.state(t).r_eb_e), LAYOUT.size)
    for k in range(1, 5):
        assert T[k].T @ a[k] @ T[k - 1] == pytest.approx(b[k], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.4, 3.0, 40.0])
def test_exponentials_in_a_batch_are_those_one_by_one(size):
    """Against SciPy, below and above the norm at which squaring begins; rounding, grown by the squarings."""
    from schuler.observability.dynamics import _exponentials

    A = np.random.default_rng(2).standard_normal((20, 12, 12))
    A *= size / np.abs(A).sum(axis=-2).max()
    expected = expm(A)
    assert np.abs(_exponentials(A) - expected).max() < 1e-13 * (1.0 + size) * np.abs(expected).max()


def test_transitions_of_a_constant_matrix_are_exponentials():
    F = np.random.default_rng(1).standard_normal((4, 4))
    result = transitions(lambda t: np.broadcast_to(F, (len(t), 4, 4)), [0.0, 0.3, 1.0])
    assert result[1] == pytest.approx(expm(0.3 * F), rel=1e-12)
    assert result[2] == pytest.approx(expm(0.7 * F), rel=1e-12)


def test_transitions_are_of_sixth_order():
    """A turning matrix with a closed form: halving the step divides the error by 64."""
    a, w = 1.0, 2.0
    A = np.array([[0.0, -w], [w, 0.0]])
    B = np.array([[0.0, a], [0.0, 0.0]])

    def F(t):
        R = np.array([expm(A * x) for x in t])
        return R @ B @ np.swapaxes(R, 1, 2)

    exact = expm(A * 2.0) @ expm((B - A) * 2.0)
    errors = [np.abs(transitions(F, [0.0, 2.0], step=h)[1] - exact).max() for h in (0.2, 0.1)]
    assert errors[0] / errors[1] == pytest.approx(64.0, rel=0.15)


def test_jumps_of_the_rate_do_not_cost_order():
    """A reciprocating platform without limit of acceleration: with its breaks as exact as a smooth one."""
    motion = RotatingMotion(still(20.0, (0.0, 30.0, 0.0)), reciprocating("z", 73.0 * DEG, turn=200.0 * DEG))

    def F(x):
        return system_matrices(motion, LAYOUT, x)

    t = np.array([0.0, 19.9])
    breaks = motion.schedule.breakpoints(0.0, 20.0)
    assert len(breaks) > 3
    fine = transitions(F, t, step=0.01, breaks=breaks)[1]
    with_breaks = np.abs(transitions(F, t, step=0.1, breaks=breaks)[1] - fine).max()
    without = np.abs(transitions(F, t, step=0.1)[1] - fine).max()
    assert with_breaks < 1e-7  # discretisation
    assert without > 100.0 * with_breaks


@pytest.mark.parametrize("rotating", [False, True])
def test_engine_and_exact_transitions_agree(rotating):
    """Discretisation of the engine at 5 Hz; the doubt is that difference, at least."""
    base = still(30.0, (0.0, 20.0, 0.0))
    motion = RotatingMotion(base, continuous("-z", 10.0 * DEG)) if rotating else base
    t = np.arange(1.0, 30.1)
    both = [
        motion_system(motion, velocities(t), LAYOUT, start_sigma=START, transition=which)
        for which in ("exact", "engine")
    ]
    difference = np.abs(both[0].phi - both[1].phi)
    assert np.all(difference <= both[1].doubt + 1e-12)
    scaled = difference * both[0].sigma / both[0].sigma[:, None]
    size = np.abs(both[0].phi * both[0].sigma / both[0].sigma[:, None]).max()
    assert scaled.max() < 2e-3 * size
    a, b = (spectrum(s.without(("dr",))) for s in both)
    assert a.useful == b.useful == (11 if rotating else 8)
    assert a.values[: a.useful] == pytest.approx(b.values[: a.useful], rel=5e-3)


def test_rows_are_the_engines_in_ned():
    """Position and velocity with lever arm, turned into north, east, down and whitened."""
    motion = still(5.0, (10.0, 20.0, 30.0))
    t = np.array([1.0, 2.0])
    lever = np.array([1.0, 2.0, -0.5])
    R = np.broadcast_to(np.diag([4.0, 9.0, 16.0]), (2, 3, 3))
    z = np.tile(ecef_from_llh(HERE), (2, 1))
    schedule = merged(
        MeasurementSchedule.of(POSITION, t, z, R, lever), MeasurementSchedule.of(VELOCITY, t, np.zeros((2, 3)), 0.25)
    )
    system = motion_system(motion, schedule, LAYOUT, start_sigma=START)
    C_nb = motion.state(t).C_nb[0]
    x, y, z = C_nb @ lever
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert list(system.t[system.at]) == pytest.approx([1.0, 1.0, 2.0, 2.0])
    position = system.H[0]
    assert position[:, 0:3] == pytest.approx(-skew / np.array([[2.0], [3.0], [4.0]]), abs=1e-12)
    assert position[:, 6:9] == pytest.approx(np.diag([1 / 2, 1 / 3, 1 / 4]), abs=1e-9)
    assert system.H[1][:, 3:6] == pytest.approx(2.0 * np.eye(3), abs=1e-9)
    assert system.to_imu == pytest.approx(C_nb, abs=1e-12)


def test_single_numbers_are_whitened_by_their_variance():
    schedule = MeasurementSchedule.of(ZERO_RATE, [1.0], [[0.0, 0.0, 0.0]], 0.04)
    system = motion_system(still(3.0), schedule, LAYOUT, start_sigma=START)
    assert np.count_nonzero(np.any(system.H[0] != 0.0, axis=1)) >= 1
    assert np.abs(system.H[0][:, 12:15]).max() == pytest.approx(5.0, rel=1e-6)


def test_covariance_along_a_system_is_the_engines():
    """The same filter, once in the engine, once on the linear system: sigmas at the end; discretisation."""
    motion = RotatingMotion(still(40.0, (0.0, 30.0, 0.0)), continuous("-z", 10.0 * DEG))
    layout = StateLayout(
        {"b_a": StateModel.gauss_markov(0.05, 300.0), "b_g": StateModel.random_walk(400.0 * DEG_PER_HR, 1e-5)}
    )
    t = np.arange(0.5, 40.01, 0.5)
    psd = np.array([1e-8, 1e-6])
    system = motion_system(
        motion, velocities(t, 0.02), layout, start_sigma=START, gyro_psd=psd[0], accel_psd=psd[1], imu_rate_hz=50.0
    )
    result = degree_of_observability(system, [10.0, 40.0])
    ideal = ideal_imu(motion, 50.0)
    truth = ideal.truth
    increments = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()
    nav = NavState(0.0, truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    initial = InitialState.from_sigmas(nav, layout, attitude=START[:3], velocity=START[3:6], position=START[6:9])
    options = FilterOptions(covariance_rate_hz=None, record_s=10.0)
    done = run(increments, velocities(t, 0.02), initial, layout, np.full(3, psd[0]), np.full(3, psd[1]), options)
    n = layout.size
    P = np.zeros((n, n))
    P[np.tril_indices(n)] = done.rec_P[-1]
    P = P + np.tril(P, -1).T
    T = ecef_from_ned_states(HERE, n)
    expected = np.sqrt(np.diag(T.T @ P @ T))
    assert done.rec_t[-1] == pytest.approx(40.0)
    assert result.sigma[-1] == pytest.approx(expected, rel=5e-3)
    assert np.all(result.ratio[-1, 9:] < 0.5)


def test_without_noise_nothing_is_lost():
    motion = still(20.0)
    t = np.arange(1.0, 20.1)
    system = motion_system(motion, velocities(t), LAYOUT, start_sigma=START, gyro_psd=1e-6, accel_psd=1e-4)
    quiet, noisy = (degree_of_observability(system, [5.0, 20.0], noise=n) for n in (False, True))
    assert np.all(quiet.ratio[-1] <= noisy.ratio[-1] + 1e-12)
    assert np.all(quiet.ratio[1, 9:] <= quiet.ratio[0, 9:] + 1e-12)
    assert np.all((quiet.degree >= 0.0) & (quiet.degree <= 1.0))


def circle(duration=60.0, radius=40.0, rate=0.25):
    """A body that drives round a circle, nose ahead: smooth to any order."""

    def path(t):
        c, s, o = np.cos(rate * t), np.sin(rate * t), np.zeros_like(t)
        r = radius * np.stack((s, 1.0 - c, o), axis=-1)
        return r, radius * rate * np.stack((c, s, o), axis=-1), radius * rate**2 * np.stack((-s, c, o), axis=-1)

    def angles(t):
        o = np.zeros_like(t)
        return np.stack((o, o, rate * t), axis=-1), np.stack((o, o, np.full_like(t, rate)), axis=-1)

    return LocalMotion(HERE, path, euler_attitude(angles), duration)


def test_local_observability_at_rest_and_in_a_turn():
    """At rest heading is hidden; where the force turns all is seen at one moment, without Earth rate (F28)."""
    sigma = np.concatenate((START, np.sqrt(LAYOUT.initial_variances())))
    rest, turn = (
        motion_local_spectrum(motion, LAYOUT, 20.0, sigma, fixed=("dr",), width=4.0, order=9, earth_rotation=False)
        for motion in (still(), circle())
    )
    assert rest.formal == 8
    assert turn.formal == 12
    assert turn.observable().all()
    with pytest.raises(InputError, match="both ends"):
        motion_local_spectrum(circle(), LAYOUT, 0.5, sigma)
    with pytest.raises(InputError, match="measured"):
        motion_local_spectrum(circle(), LAYOUT, 8.0, sigma, measured=("dr",), fixed=("dr",))


def test_a_motion_that_is_not_smooth_is_doubted_not_believed():
    """Way-points are joined by quintic splines: higher derivatives do not exist, and nothing counts as seen by them."""
    sigma = np.concatenate((START, np.sqrt(LAYOUT.initial_variances())))
    result = motion_local_spectrum(drive(), LAYOUT, 20.0, sigma, width=4.0, fixed=("dr",))
    assert result.doubt > 1e-3 * result.values[0]


def test_names():
    assert state_names({"dpsi": 3, "clock": 1, "M_a": 3, "lever": 3}) == (
        "eps_N", "eps_E", "eps_D", "clock", "M_a_xy", "M_a_xz", "M_a_yz", "lever_x", "lever_y", "lever_z",
    )  # fmt: skip
    assert len(state_names({name: ALL[name].stop - ALL[name].start for name in ALL.blocks})) == ALL.size
    with pytest.raises(InputError, match="unknown state block"):
        state_names({"nothing": 3})


def test_faults():
    t = np.array([1.0])
    with pytest.raises(InputError, match="nothing to observe with"):
        motion_system(still(3.0), velocities(np.array([9.0])), LAYOUT, start_sigma=START)
    with pytest.raises(InputError, match="exact"):
        motion_system(still(3.0), velocities(t), LAYOUT, start_sigma=START, transition="best")
    with pytest.raises(InputError, match="increasing"):
        transitions(lambda x: np.zeros((len(x), 2, 2)), [1.0, 0.5])
    with pytest.raises(InputError, match="times"):
        degree_of_observability(motion_system(still(3.0), velocities(t), LAYOUT, start_sigma=START), [2.0, 1.0])
