"""Receiver clocks and Gauss-Markov states in the engine: propagation, decay of estimates, and their smoothing."""

from __future__ import annotations

import aided_cases as ac
import numpy as np
import pytest
from dense_filter import dense_smoother

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.filter_arrays import aligned
from schuler.filtering.initial_state import InitialState
from schuler.filtering.limits import MAX_STATES
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.evaluation.consistency import chi_square_band, nees
from schuler.navigation.result import NavigationResult
from schuler.recording.series import Increments
from schuler.simulation.motion import StaticMotion, ideal_increments

CLOCK = ("clock", "clock_drift")


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(1.0), 60.0)


def a_covariance(rng, n):
    """Symmetric and positive, sigmas from 1e-5 to 1e2 as a filter has them."""
    A = rng.normal(size=(n, n))
    C = A @ A.T / n + 0.1 * np.eye(n)
    d = 10.0 ** rng.uniform(-5.0, 2.0, n) / np.sqrt(np.diag(C))
    return C * np.outer(d, d)


@pytest.mark.parametrize("seconds", [0.01, 0.1, 1.0, 30.0])
def test_flush_is_the_matrix_exponential(seconds):
    """Clock, drift and Gauss-Markov states between others: P -> Phi P Phi' with Phi = exp(F T), to rounding."""
    from scipy.linalg import expm

    from schuler.filtering.kernels import covariance as k

    lay = StateLayout(
        {
            "lever": StateModel.constant(1.0),
            "clock_2": StateModel.constant(1.0),
            "clock_drift": StateModel.random_walk(1.0, 1.0),
            "b_r": StateModel.gauss_markov(2.0, 60.0),
            "clock": StateModel.random_walk(1.0, 1.0),
            "b_v": StateModel.gauss_markov(1.0, 7.0),
        }
    )
    n, c = lay.size, lay["clock"].start
    assert lay["clock_drift"].start == c + 1
    rng = np.random.default_rng(int(1000 * seconds))
    F = np.zeros((n, n))
    F[range(9, n), range(9, n)] = -lay.dynamics()[:, 0]
    F[c, c + 1] = 1.0
    P0 = a_covariance(rng, n)
    P = aligned(n, MAX_STATES)
    P[:, :n] = P0
    nav = np.concatenate(([1.0, 0, 0, 0], np.zeros(3), frames.ecef_from_llh(ac.ORIGIN)))
    acc, B, A = np.zeros(8), np.zeros((0, 9)), np.zeros((9, 9))
    acc[0], acc[2:8] = seconds, rng.normal(size=6) * 10.0
    A[2, 2] = 1.0
    rows, turned, D, mean = aligned(9, MAX_STATES), aligned(9, MAX_STATES), np.zeros(n - 9), np.zeros(n - 9)
    decays = k.decay(lay.dynamics(), seconds, D, mean)
    no_sensors = np.zeros(0, dtype=np.int64)
    k.flush(P, nav, acc, A, B, rows, turned, D, mean, no_sensors, 0, decays, earth.WGS84.omega_ie)
    k.add_clock_drift(P, c, seconds)
    Phi = expm(F * seconds)
    Phi[:9, :9] = A  # the navigation part has tests of its own
    expected = Phi @ P0 @ Phi.T
    d = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(P[:, :n] / np.outer(d, d), expected / np.outer(d, d), atol=1e-12)
    np.testing.assert_allclose(D, np.exp(-lay.dynamics()[:, 0] * seconds), rtol=1e-12)
    assert np.all(P[:, n:] == 0.0)


def standing(lay, seconds=60.0, P=None, parameters=None, **options):
    """A run at rest without measurements."""
    motion = StaticMotion(ac.ORIGIN, np.zeros(3), seconds)
    t = np.linspace(0.0, seconds, round(seconds * 50) + 1)
    log = Increments(t[1:], np.diff(t), *ideal_increments(motion, t))
    s = motion.state(np.zeros(1))
    nav = ac.NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])
    start = InitialState.from_sigmas(
        nav, lay, attitude=[1e-3] * 3, velocity=[0.1] * 3, position=[1.0] * 3, parameters=parameters
    )
    if P is not None:
        start = InitialState(nav, P, start.parameters)
    forward = run(log, MeasurementSchedule.empty(), start, lay, *ac.NOISE, FilterOptions(**options))
    return NavigationResult.from_run(forward, np.empty(0), np.empty(0, dtype=int), lay)


@pytest.mark.parametrize(("rate", "tolerance"), [(10.0, 1e-3), (1.0, 0.02)])
def test_clock_variance_grows_as_the_two_state_model_says(rate, tolerance):
    """s^2 + s_d^2 t^2 + q t + q_d t^3 / 3, and the covariance s_d^2 t + q_d t^2 / 2 (Groves (2013), eq. (9.152)).

    Discretisation: noise in halves before and after a step T gives q_d T^3 / 2 in it instead of a third.
    """
    lay = StateLayout({"clock_drift": StateModel.random_walk(0.5, 0.2), "clock": StateModel.random_walk(3.0, 1.0)})
    result = standing(lay, covariance_rate_hz=rate)
    t, P = result.t, result.covariance_e
    np.testing.assert_allclose(P[:, 9, 9], 9.0 + 0.25 * t**2 + t + 0.04 * t**3 / 3.0, rtol=tolerance)
    np.testing.assert_allclose(P[:, 9, 10], 0.25 * t + 0.04 * t**2 / 2.0, rtol=1e-9)
    np.testing.assert_allclose(P[:, 10, 10], 0.25 + 0.04 * t, rtol=1e-9)


def test_clock_estimate_runs_with_its_drift():
    """Exactly: offset + drift t, no other block touched."""
    lay = StateLayout({name: StateModel.constant(1.0) for name in ("clock_2", *CLOCK, "baro")})
    result = standing(lay, parameters=lay.values(clock=[50.0], clock_drift=[-0.7], clock_2=[3.0], baro=[4.0]))
    np.testing.assert_allclose(result.parameter("clock")[:, 0], 50.0 - 0.7 * result.t, rtol=1e-12)  # rounding
    np.testing.assert_array_equal(result.parameter("clock_drift")[:, 0], -0.7)
    np.testing.assert_array_equal(result.parameter("clock_2")[:, 0], 3.0)
    np.testing.assert_array_equal(result.parameter("baro")[:, 0], 4.0)


@pytest.mark.parametrize("rate", [None, 10.0, 1.0])
def test_estimates_of_gauss_markov_states_decay(rate):
    """With their correlation time and whatever the propagation rate, sensor biases and correlated errors alike."""
    lay = StateLayout(
        {
            "b_a_run": StateModel.gauss_markov(0.01, 30.0),
            "b_g": StateModel.constant(1e-4),
            "b_r": StateModel.gauss_markov(1.0, 12.0),
        }
    )
    result = standing(
        lay, covariance_rate_hz=rate, parameters=lay.values(b_a_run=[0.01, -0.02, 0.0], b_g=[1e-4] * 3, b_r=[1, -2, 3])
    )
    t = result.t[:, None]
    # rounding of some thousand factors
    np.testing.assert_allclose(result.parameter("b_a_run"), [0.01, -0.02, 0.0] * np.exp(-t / 30.0), rtol=1e-10)
    np.testing.assert_allclose(result.parameter("b_r"), [1, -2, 3] * np.exp(-t / 12.0), rtol=1e-10)
    np.testing.assert_array_equal(result.parameter("b_g"), np.full((len(t), 3), 1e-4))
    # stationary: the variance stays what it is; discretisation of the noise, (T / tau)^2 / 6 of sigma
    np.testing.assert_allclose(result.sigma("b_r"), 1.0, rtol=2e-3)


def test_decaying_bias_moves_the_solution_as_its_decay_says():
    """An accelerometer bias estimate that decays is taken out as it decays: v = b tau (1 - exp(-t / tau)).

    Discretisation: held over each step of 0.1 s, a part T / 2 tau too much.
    """
    b, tau = 0.01, 20.0
    lay = StateLayout({"b_a": StateModel.gauss_markov(0.01, tau)})
    held = standing(StateLayout({"b_a": StateModel.constant(0.01)}), seconds=20.0)
    moved = standing(lay, seconds=20.0, parameters=lay.values(b_a=[b, 0.0, 0.0]), covariance_rate_hz=None)
    north = frames.C_en(frames.llh_from_ecef(moved.states.r_eb_e[0]))[:, 0]
    v = (moved.states.v_eb_e - held.states.v_eb_e) @ north
    np.testing.assert_allclose(v, -b * tau * (1.0 - np.exp(-moved.t / tau)), rtol=2e-3)


SMOOTHED = {
    "tight": ((*CLOCK, "clock_2"), "GE", {}),
    "tight, biases decay": (CLOCK, "G", {"b_a": StateModel.gauss_markov(0.05, 30.0)}),
    "all at once": ((*CLOCK, "clock_2", "b_r", "b_v", "lever", "delay", "baro"), "GE", {}),
}


@pytest.mark.parametrize("name", SMOOTHED)
def test_smoother_equals_dense_rauch_tung_striebel(drive, name):
    """Clock, other clocks, Gauss-Markov states: corrections and covariances at all records."""
    blocks, systems, models = SMOOTHED[name]
    lay = ac.layout(*blocks, **models)
    aids = [ac.satellites(ac.sky(drive, systems, 5))]
    if name == "all at once":
        aids += [ac.gnss, ac.height]
    n = lay.size
    one = ac.filtered(drive, lay, aids, 1, smoother=True)
    result, nodes = one.result, one.result._nodes
    assert nodes.i_clock == lay["clock"].start
    plus, P_s = dense_smoother(nodes, n)
    smoothed = result.smooth()
    at = np.searchsorted(nodes.t, result.t - 1e-9)
    sigma = np.sqrt(np.einsum("kii->ki", P_s))[at]
    q, p = result.states.q_eb, smoothed.states.q_eb
    ours = np.concatenate(
        (
            rotation.rotvec_from_quat(rotation.quat_multiply(p, rotation.quat_conjugate(q))),
            smoothed.states.v_eb_e - result.states.v_eb_e,
            smoothed.states.r_eb_e - result.states.r_eb_e,
            smoothed.parameters - result.parameters,
        ),
        axis=1,
    )
    assert np.abs(plus[at] / sigma)[:, lay["clock"].start].max() > 0.5  # there is something to smooth
    # rounding: the recursion with inverses loses digits where sigmas differ by 1e8
    np.testing.assert_allclose(ours / sigma, plus[at] / sigma, atol=1e-4)
    scale = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(smoothed.covariance_e / scale, P_s[at] / scale, atol=1e-4)


@pytest.mark.parametrize("aid", ["wheels", "height", "heading", "tight"])
def test_smoother_takes_measurements_of_one_number(drive, aid):
    """However many states there are: nothing in the backward pass may run out of the range of numbers."""
    aids = {
        "wheels": [ac.gnss, ac.wheels],
        "height": [ac.height],
        "heading": [ac.heading],
        "tight": [ac.satellites(ac.sky(drive, "G", 8))],
    }[aid]
    lay = ac.layout("S_a", "S_g", "b_a_run", "b_g_run", "lever", "lever_v", "mount", *CLOCK, "baro", "b_heading")
    one = ac.filtered(drive, lay, aids, 1, smoother=True)
    smoothed = one.result.smooth()
    assert np.isfinite(smoothed.covariance_e).all()
    assert np.isfinite(smoothed.parameters).all()
    assert np.isfinite(smoothed.trajectory.r_eb_e).all()
    before, after = (np.sqrt(np.einsum("kii->ki", r.covariance_e)) for r in (one.result, smoothed))
    assert np.all(after <= before * (1.0 + 1e-9))


@pytest.mark.parametrize("runs", [25, pytest.param(200, marks=pytest.mark.slow)])
def test_27_states_are_honest_filtered_and_smoothed(drive, runs):
    """Constant biases and wandering ones beside them, scale factors: the filter tells them apart as well as it says."""
    lay = ac.layout("S_a", "S_g", "b_a_run", "b_g_run")
    assert lay.size == 27
    filtered, smoothed, share = [], [], []
    for seed in range(runs):
        one = ac.filtered(drive, lay, [ac.gnss], seed, smoother=True)
        filtered.append(nees(one.result, one.truth.reference, one.parameters))
        after = one.result.smooth()
        smoothed.append(nees(after, one.truth.reference, one.parameters))
        share.append(after.sigma("dpsi")[20] / one.result.sigma("dpsi")[20])
    low, high = chi_square_band(27, runs, 0.9999)
    for values in (filtered, smoothed):
        at = np.array(values)[:, [5, 20, 40, 57]].mean(axis=0)
        assert np.all((at > low) & (at < high)), (low, at, high)
    assert np.mean(share) < 0.95


def test_a_clock_needs_its_drift():
    with pytest.raises(InputError, match="clock and clock_drift go together"):
        StateLayout({"clock": StateModel.constant(1.0)})
