"""The smoother against a dense Rauch-Tung-Striebel recursion, and its consistency."""

from __future__ import annotations

from dataclasses import replace

import filter_cases as cases
import numpy as np
import pytest
from dense_filter import dense_smoother, dense_transition
from places import ROOT

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.filtering import engine
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, gnss_measurements
from schuler.mechanization.strapdown import NavState
from schuler.navigation.evaluation.consistency import chi_square_band, nees
from schuler.navigation.result import NavigationResult
from schuler.recording.series import GnssSeries


def after_drift(case, lay, late=0.0):
    """A run that readmits fixes after an outage, in which 0.6 m/s^2 acted that no state knows of.

    Fixes ``late`` seconds after an epoch with a record fall between it and the next interval, which is too short.
    """
    rng = np.random.default_rng(1)
    log, _ = cases.corrupted(case, lay, np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9), rng)
    schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER).outside(((50.0, 75.0),))
    dv = log.dv_ib_b.copy()
    dv[(log.t > 50.0) & (log.t < 75.0), 1] += 0.6 * log.dt[0]
    log = replace(log, dv_ib_b=dv, dt=log.dt - 2.0 * late)
    if late > 0.0:
        schedule = replace(schedule, t=np.floor(schedule.t) + late)
    psd = np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2)
    forward = run(log, schedule, cases.start(case, lay, rng), lay, *psd, FilterOptions(smoother=True))
    return NavigationResult.from_run(forward, schedule.t, schedule.kind, lay)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("epochs", "late"), [(7, 0.0), (500, 0.0), (100, 1e-4)])
def test_a_long_run_is_smoothed_in_parts_to_the_last_bit(drive_case, monkeypatch, epochs, late):
    """A day's nodes are kept a part at a time. Here with ends at fixes, between them, before them and where P was
    enlarged; in the last case updates of a part's last node are in the next part.
    """
    lay = cases.StateLayout({"b_a": cases.StateModel.gauss_markov(0.03, 200.0), "b_g": cases.StateModel.constant(1e-3)})
    once = after_drift(drive_case, lay, late)
    monkeypatch.setattr(engine, "_CHUNK", epochs)
    monkeypatch.setattr(engine, "_NODE_BYTES", 1)
    parts = after_drift(drive_case, lay, late)
    shared = [nodes.upd[0] for _, begins, nodes in parts._nodes.backwards() if not begins]
    assert any(shared) == (late > 0.0)
    assert len(parts._nodes._parts) == -(-parts.epochs // epochs)
    assert parts.propagations == once.propagations
    for a, b in zip(once._nodes, parts._nodes.whole(), strict=True):
        np.testing.assert_array_equal(a, b)
    expected = once.smooth()
    for keep in (True, True, False):  # again, when all parts but the first must be filtered again
        got = parts.smooth(keep=keep)
        for name in ("q_eb", "v_eb_e", "r_eb_e"):
            np.testing.assert_array_equal(getattr(got.trajectory, name), getattr(expected.trajectory, name))
            np.testing.assert_array_equal(getattr(got.states, name), getattr(expected.states, name))
        np.testing.assert_array_equal(got.parameters, expected.parameters)
        np.testing.assert_array_equal(got.covariance_e, expected.covariance_e)
    assert not parts.can_smooth


def test_a_fix_at_the_end_of_what_counts_as_one_time_leaves_no_record_open(drive_case):
    """A fix 1e-9 s after a sample is taken at it: its node, at the fix's time, is that of the sample's record.

    It was given to the record before, whose memory was used as it came: a NaN in one run of many.
    """
    lay = cases.StateLayout({"b_a": cases.StateModel.gauss_markov(0.03, 200.0), "b_g": cases.StateModel.constant(1e-3)})

    def smoothed(late):
        rng = np.random.default_rng(1)
        log, _ = cases.corrupted(drive_case, lay, np.zeros(lay.size - 9), rng)
        schedule = gnss_measurements(cases.fixes(drive_case, rng), cases.LEVER)
        at = log.t[np.searchsorted(log.t, schedule.t + 1e-6) - 1]
        schedule = replace(schedule, t=at + late)
        psd = np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2)
        forward = run(log, schedule, cases.start(drive_case, lay, rng), lay, *psd, FilterOptions(smoother=True))
        return NavigationResult.from_run(forward, schedule.t, schedule.kind, lay).smooth()

    exact, late = smoothed(0.0), smoothed(1e-9)
    # discretisation: 1e-9 s of motion
    np.testing.assert_allclose(late.states.r_eb_e, exact.states.r_eb_e, atol=1e-6, rtol=0.0)
    np.testing.assert_allclose(late.covariance_e, exact.covariance_e, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("readmitted", [False, True])
def test_smoother_equals_dense_rauch_tung_striebel(drive_case, readmitted):
    """State corrections and covariances at all nodes, by the recursion with inverses; also where P was enlarged."""
    lay = cases.StateLayout(
        {
            "b_a": cases.StateModel.gauss_markov(0.03, 200.0),
            "b_g": cases.StateModel.random_walk(1e-3, 1e-6),
            "S_g": cases.StateModel.constant(1e-3),
        }
    )
    n = lay.size
    result = after_drift(drive_case, lay) if readmitted else cases.filtered(drive_case, lay, 1, smoother=True)[0]
    nodes = result._nodes
    assert np.any(np.diff(nodes.t) == 0.0) == readmitted
    plus, P_s = dense_smoother(nodes, n)
    smoothed = result.smooth()
    at = np.searchsorted(nodes.t, result.t + 1e-9) - 1
    sigma = np.sqrt(np.einsum("kii->ki", P_s))[at]
    ours = np.concatenate(
        (
            rotation.rotvec_from_quat(
                rotation.quat_multiply(smoothed.states.q_eb, rotation.quat_conjugate(result.states.q_eb))
            ),
            smoothed.states.v_eb_e - result.states.v_eb_e,
            smoothed.states.r_eb_e - result.states.r_eb_e,
            smoothed.parameters - result.parameters,
        ),
        axis=1,
    )
    # rounding: the recursion with inverses loses digits where sigmas differ by 1e8
    np.testing.assert_allclose(ours / sigma, plus[at] / sigma, atol=1e-4)
    scale = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(smoothed.covariance_e / scale, P_s[at] / scale, atol=1e-4)


def test_smoothed_solution_is_better_and_honest(drive_case):
    lay = cases.layout(21)
    values, ratio = [], []
    for seed in range(25):
        result, parameters = cases.filtered(drive_case, lay, seed, smoother=True)
        smoothed = result.smooth()
        values.append(nees(smoothed, drive_case.truth, parameters))
        ratio.append(smoothed.errors(drive_case.truth).rms_horizontal / result.errors(drive_case.truth).rms_horizontal)
    values = np.array(values)
    low, high = chi_square_band(lay.size, 25, 0.9999)
    at = values[:, [5, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
    assert np.mean(ratio) < 0.75


def test_smoothed_covariance_is_never_larger(drive_case):
    result, _ = cases.filtered(drive_case, cases.layout(21), 0, smoother=True)
    smoothed = result.smooth()
    before, after = (np.sqrt(np.einsum("kii->ki", r.covariance_e)) for r in (result, smoothed))
    assert np.all(after <= before * (1.0 + 1e-9))
    np.testing.assert_allclose(after[-1], before[-1], rtol=1e-12)  # the end has no later measurement


def test_constants_stay_constant_when_smoothed(drive_case):
    """A random constant has one best estimate: smoothed, it is the same at all times and the filter's last."""
    result, _ = cases.filtered(drive_case, cases.layout(21), 2, smoother=True)
    S = result.smooth().parameter("S_g")
    np.testing.assert_allclose(S, np.broadcast_to(S[-1], S.shape), rtol=1e-9)  # rounding
    np.testing.assert_allclose(S[-1], result.parameter("S_g")[-1], rtol=1e-12)


def test_corrections_between_nodes_follow_the_motion(drive_case):
    """The trajectory at IMU rate has no steps at the nodes: its velocity is the derivative of its position."""
    result, _ = cases.filtered(drive_case, cases.layout(15), 4, smoother=True)
    T = result.smooth().trajectory
    middle = 0.5 * (T.v_eb_e[1:] + T.v_eb_e[:-1]) * np.diff(T.t)[:, None]
    step = np.abs(np.diff(T.r_eb_e, axis=0) - middle).max()
    raw = result.trajectory
    rough = np.abs(
        np.diff(raw.r_eb_e, axis=0) - 0.5 * (raw.v_eb_e[1:] + raw.v_eb_e[:-1]) * np.diff(raw.t)[:, None]
    ).max()
    assert step < 2e-4  # m per sample, linear interpolation of corrections over 0.1 s
    assert rough > 100 * step  # the filtered one jumps at every fix


def test_a_run_that_kept_nothing_cannot_be_smoothed(drive_case):
    result, _ = cases.filtered(drive_case, cases.layout(15), 0)
    with pytest.raises(InputError, match="kept nothing to smooth: navigate with smoother=True"):
        result.smooth()


def test_smoothing_twice_changes_nothing(drive_case):
    smoothed = cases.filtered(drive_case, cases.layout(15), 0, smoother=True)[0].smooth()
    assert smoothed.smooth() is smoothed


def test_smoothed_covariance_stays_positive_through_a_long_outage(drive_case):
    """Where hundreds of metres of uncertainty meet a fix of a centimetre, P - P Lam P cancels nearly all of P.

    Found on a real drive: with Lam itself carried backwards, some variances came out negative.
    """
    rng = np.random.default_rng(11)
    lay = cases.StateLayout(
        {"b_a": cases.StateModel.gauss_markov(0.05, 300.0), "b_g": cases.StateModel.gauss_markov(2e-3, 300.0)}
    )
    truth = drive_case.truth
    sigma = np.array([0.01, 0.01, 0.02])
    log, _ = cases.corrupted(drive_case, lay, 0.5 * np.sqrt(lay.initial_variances()), rng)
    s = drive_case.truth_fixes
    keep = (s.t < 5.0) | (s.t > 60.0)
    C = frames.C_en(frames.llh_from_ecef(s.r_eb_e))
    r = s.r_eb_e + np.einsum("nij,nj->ni", C, sigma * rng.standard_normal((len(s.t), 3)))
    fixes = GnssSeries(s.t, frames.llh_from_ecef(r), np.tile(np.diag(sigma**2), (len(s.t), 1, 1))).where(keep)
    nav = NavState(0.0, truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    initial = InitialState.from_sigmas(nav, lay, attitude=[0.01, 0.01, 0.2], velocity=[0.2] * 3, position=sigma)
    forward = run(
        log, gnss_measurements(fixes, np.zeros(3), gate=None), initial, lay,
        np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2), FilterOptions(smoother=True),
    )  # fmt: skip
    result = NavigationResult.from_run(forward, fixes.t, np.ones(len(fixes.t), np.int64), lay)
    smoothed = result.smooth()
    assert result.sigma("dr").max() > 50.0
    scale = np.sqrt(np.einsum("kii->ki", smoothed.covariance_e))
    correlation = smoothed.covariance_e / (scale[:, :, None] * scale[:, None, :])
    assert np.linalg.eigvalsh(correlation).min() > 1e-6
    # the same recursion in extended precision (where the platform has it)
    n, nodes, Lam = lay.size, result._nodes, np.zeros((lay.size, lay.size), np.longdouble)
    at = np.searchsorted(nodes.t, result.t - 1e-9)
    P = unpack_symmetric(nodes.P, n).astype(np.longdouble)
    dense = np.empty((len(nodes.t), n, n))
    for j in range(len(nodes.t) - 1, -1, -1):
        for u in range(nodes.upd[j] - 1, (nodes.upd[j - 1] if j else 0) - 1, -1):
            F = np.eye(n) - nodes.W[u].T.astype(np.longdouble) @ nodes.G[u]
            Lam = F.T @ Lam @ F + nodes.G[u].T.astype(np.longdouble) @ nodes.G[u]
        dense[j] = P[j] - P[j] @ Lam @ P[j]
        Phi = dense_transition(nodes, j, n) if j else np.eye(n)
        Lam = Phi.T @ Lam @ Phi
    expected = np.sqrt(np.einsum("kii->ki", dense[at]))
    np.testing.assert_allclose(scale, expected, rtol=1e-5)  # rounding; sigmas fall by 2e4 at the fix


def test_states_that_are_hardly_seen_leave_no_infinities():
    """Rows of the square root that decay to denormal numbers once made the covariance NaN, compiled only."""

    from schuler.navigation.run import navigate
    from schuler.simulation.scenario import simulate

    examples = ROOT / "examples"
    result = navigate(simulate(examples / "town_tight.toml"), examples / "town_tight_navigation.toml").smooth()
    assert np.isfinite(result.covariance_e).all()


def test_estimates_gone_wild_are_an_error_and_no_overrun(drive_case):
    """A bias of 60 rad/s turns the filter in every epoch; room for nodes is made for what the readings turn."""
    lay = cases.layout(15)
    start = cases.start(drive_case, lay, np.random.default_rng(1))
    start = replace(start, parameters=np.full(6, 60.0))
    psd = np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2)
    with pytest.raises(InputError, match="the filter diverged"):
        run(drive_case.increments, MeasurementSchedule.empty(), start, lay, *psd, FilterOptions(smoother=True))


def test_corrections_turn_a_trajectory_about_all_axes():
    """Between nodes the correction is linear, and a turn in Earth-fixed axes multiplies the attitude from the left."""
    from schuler import rotation
    from schuler.filtering.kernels.smoother import apply_corrections

    rng = np.random.default_rng(4)
    node_t, t = np.array([0.0, 1.0, 2.0]), np.array([0.25, 1.0, 1.75])
    minus, plus = 0.3 * rng.standard_normal((3, 9)), 0.3 * rng.standard_normal((3, 9))
    q = rotation.quat_from_rotvec(rng.standard_normal((3, 3)))
    v, r = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    dx = np.array([0.75 * plus[0] + 0.25 * minus[1], plus[1], 0.25 * plus[1] + 0.75 * minus[2]])
    expected = rotation.quat_multiply(rotation.quat_from_rotvec(dx[:, :3]), q)
    new_q, new_v, new_r = q.copy(), v.copy(), r.copy()
    apply_corrections(t, new_q, new_v, new_r, node_t, minus, plus)
    np.testing.assert_allclose(new_q, expected, atol=1e-14)
    np.testing.assert_allclose(new_v, v + dx[:, 3:6], atol=1e-15)
    np.testing.assert_allclose(new_r, r + dx[:, 6:9], atol=1e-15)
