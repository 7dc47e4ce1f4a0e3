"""The engine's bookkeeping: asynchronous measurements, gates, outages, chunks, order, live use, interruption."""

from __future__ import annotations

from dataclasses import replace

import filter_cases as cases
import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering import engine
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    ACCEPTED,
    FORCED,
    GATED,
    POSITION,
    REJECTED,
    UNUSED,
    MeasurementSchedule,
    gnss_measurements,
    position,
    velocity,
)
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.navigation.navigator import Navigator
from schuler.recording.series import Increments

NOISE = (np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2))


def setup(case, states=21, seed=0, gate=None):
    lay = cases.layout(states)
    rng = np.random.default_rng(seed)
    log, _ = cases.corrupted(case, lay, np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9), rng)
    schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER, gate=gate)
    return log, schedule, cases.start(case, lay, rng), lay


def test_without_measurements_it_is_the_strapdown(drive_case):
    """Free inertial: the filter's trajectory is the mechanization's, bit for bit."""
    log, _, initial, lay = setup(drive_case, 15)
    forward = run(log, MeasurementSchedule.empty(), initial, lay, *NOISE)
    free = mechanize(log, initial.nav)
    np.testing.assert_array_equal(forward.r, free.r_eb_e)
    np.testing.assert_array_equal(forward.q, free.q_eb)


def test_a_measurement_acts_at_its_own_time(drive_case):
    """A fix between two samples: predicting to its time and on equals a log that was sampled there."""
    log, schedule, initial, lay = setup(drive_case)
    schedule = schedule.where(schedule.kind == 1)
    k = int(np.searchsorted(log.t, schedule.t[0]))
    part = (schedule.t[0] - log.t[k - 1]) / log.dt[k]
    assert 0.1 < part < 0.9
    split = Increments(
        np.insert(log.t, k, schedule.t[0]),
        np.insert(log.dt, k, part * log.dt[k]),
        np.insert(log.dtheta_ib_b, k, part * log.dtheta_ib_b[k], axis=0),
        np.insert(log.dv_ib_b, k, part * log.dv_ib_b[k], axis=0),
    )
    dt, w, f = split.dt.copy(), split.dtheta_ib_b.copy(), split.dv_ib_b.copy()
    dt[k + 1], w[k + 1], f[k + 1] = (1 - part) * log.dt[k], (1 - part) * log.dtheta_ib_b[k], (1 - part) * log.dv_ib_b[k]
    split = Increments(split.t, dt, w, f)
    first = schedule.where(schedule.t == schedule.t[0])
    a = run(log.between(0.0, 3.0), first, initial, lay, *NOISE)
    b = run(split.between(0.0, 3.0), first, initial, lay, *NOISE)
    # discretisation: the split log knows the increments of the two parts, the other a parabola through three
    np.testing.assert_allclose(a.innovation, b.innovation, atol=1e-4)
    np.testing.assert_allclose(a.r[-1], b.r[-1], atol=1e-3)
    P, Q = (engine.unpack_symmetric(x.rec_P[-1:], lay.size)[0] for x in (a, b))
    d = np.sqrt(np.diag(P))
    np.testing.assert_allclose(P / np.outer(d, d), Q / np.outer(d, d), atol=1e-4)


def test_order_of_measurements_of_one_time_does_not_matter(drive_case):
    """Position then velocity, or velocity then position: the same estimate and covariance."""
    log, schedule, initial, lay = setup(drive_case)
    swapped = schedule.where(np.arange(len(schedule)).reshape(-1, 2)[:, ::-1].ravel())
    a, b = (run(log, s, initial, lay, *NOISE) for s in (schedule, swapped))
    P, Q = (engine.unpack_symmetric(x.rec_P, lay.size) for x in (a, b))
    d = np.sqrt(np.einsum("kii->ki", P))
    # relinearisation between the two updates, in units of sigma
    assert np.abs((P - Q) / (d[:, :, None] * d[:, None, :])).max() < 2e-3
    np.testing.assert_allclose(a.r, b.r, atol=2e-3)


def test_chunks_of_the_log_join_without_a_seam(drive_case, monkeypatch):
    log, schedule, initial, lay = setup(drive_case)
    complete = run(log, schedule, initial, lay, *NOISE, FilterOptions(smoother=True))
    monkeypatch.setattr(engine, "_CHUNK", 997)
    parts = run(log, schedule, initial, lay, *NOISE, FilterOptions(smoother=True))
    for name in ("t", "q", "v", "r", "rec_t", "rec_P", "status", "nis"):
        np.testing.assert_array_equal(getattr(complete, name), getattr(parts, name))
    np.testing.assert_array_equal(complete.nodes.P, parts.nodes.P)


def test_live_navigator_gives_the_batch_numbers(drive_case):
    log, schedule, initial, lay = setup(drive_case)
    batch = run(log, schedule, initial, lay, *NOISE)
    live = Navigator(initial, lay, *NOISE, interval_s=0.01)
    cases.stream(live, log, schedule)
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_array_equal(live.parameters, batch.rec_est[-1])
    assert len(live.outcomes) == len(schedule)
    np.testing.assert_array_equal([o.nis for o in live.outcomes], batch.nis)
    assert {o.status for o in live.outcomes} == {"accepted"}


def test_late_measurements_fit_a_navigator_that_waits(drive_case):
    """Fixes announced 0.2 s late with a delay of 0.25 s: still the batch's numbers, and a state for now."""
    log, schedule, initial, lay = setup(drive_case)
    log = log.between(0.0, 20.0)
    schedule = schedule.where(schedule.t < 19.0)
    batch = run(log, schedule, initial, lay, *NOISE)
    live = Navigator(initial, lay, *NOISE, interval_s=0.01, delay_s=0.25)
    cases.stream(live, log, schedule, late_s=0.2)
    assert live.state.t == pytest.approx(log.t[-1] - 0.25, abs=0.011)
    ahead = live.predicted
    assert ahead.t == log.t[-1]
    live.finish()
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_allclose(ahead.r_eb_e, batch.r[-1], atol=1e-6)  # no fix in the last quarter second
    np.testing.assert_allclose(live.covariance, live.covariance.T, atol=1e-12)


def test_too_late_a_measurement_is_refused(drive_case):
    log, schedule, initial, lay = setup(drive_case, 15)
    live = Navigator(initial, lay, *NOISE, interval_s=0.01)
    for k in range(300):
        live.imu(log.t[k], log.dtheta_ib_b[k], log.dv_ib_b[k])
    with pytest.raises(InputError, match=r"comes too late, the filter is at 3\.0000 s; .* delay_s"):
        live.aid(schedule.where([0]))
    with pytest.raises(InputError, match=r"expected a sample after 3\.000000 s"):
        live.imu(2.5, np.zeros(3), np.zeros(3))


def test_gate_rejects_blunders_and_counts_them(drive_case):
    log, schedule, initial, lay = setup(drive_case, gate=0.9999)
    bad = np.flatnonzero((schedule.kind == 1) & (np.round(schedule.t) % 20 == 0))
    z = schedule.z.copy()
    z[bad] += 40.0
    blunders = MeasurementSchedule(schedule.t, schedule.kind, z, schedule.R, schedule.lever, schedule.gate)
    forward = run(log, blunders, initial, lay, *NOISE)
    clean = run(log, schedule, initial, lay, *NOISE)
    assert np.all(forward.status[bad] == REJECTED)
    others = np.setdiff1d(np.arange(len(schedule)), bad)
    assert np.mean(forward.status[others] == ACCEPTED) > 0.99
    assert np.linalg.norm(forward.r[-1] - clean.r[-1]) < 1.0


def test_lock_out_ends(drive_case):
    """All fixes move by 30 m: after the given time one is taken, marked, and the filter follows."""
    log, schedule, initial, lay = setup(drive_case, gate=0.999)
    z = schedule.z.copy()
    late = (schedule.t > 60.0) & (schedule.kind == 1)
    z[late] += 30.0
    moved = MeasurementSchedule(schedule.t, schedule.kind, z, schedule.R, schedule.lever, schedule.gate)
    forward = run(log, moved, initial, lay, *NOISE, FilterOptions(hold_s=4.5))
    status = forward.status[late]
    assert status[:5].tolist() == [REJECTED] * 5
    assert status[5] == FORCED
    assert np.all(status[6:] == ACCEPTED)
    never = run(log, moved, initial, lay, *NOISE, FilterOptions(lockout=0))
    assert np.all(never.status[late] == REJECTED)


def test_measurements_outside_the_log_are_unused(drive_case):
    log, schedule, initial, lay = setup(drive_case)
    forward = run(log.between(0.0, 50.0), schedule, initial, lay, *NOISE)
    assert np.all(forward.status[schedule.t > 50.1] == UNUSED)
    assert np.isnan(forward.nis[schedule.t > 50.1]).all()
    assert np.all(forward.status[schedule.t < 50.0] == ACCEPTED)


def test_covariance_stays_symmetric_and_positive(drive_case):
    """Centimetre fixes on a start that is kilometres and tens of degrees uncertain."""
    log, schedule, initial, lay = setup(drive_case)
    tight = MeasurementSchedule(schedule.t, schedule.kind, schedule.z, schedule.R * 1e-6, schedule.lever, schedule.gate)
    vague = InitialState(
        initial.nav,
        initial.P + np.diag(np.r_[np.full(3, 0.1), np.full(3, 1e2), np.full(3, 1e6), np.zeros(12)]),
        initial.parameters,
    )
    forward = run(log, tight, vague, lay, *NOISE)
    P = engine.unpack_symmetric(forward.rec_P, lay.size)
    d = np.sqrt(np.einsum("kii->ki", P))
    assert np.isfinite(d).all()
    assert np.linalg.eigvalsh(P / (d[:, :, None] * d[:, None, :])).min() > -1e-9  # rounding


def test_anisotropic_noise_follows_the_body(drive_case):
    """Only the x gyro is noisy and the body is level, heading 0.4 rad: tilt grows about that axis."""
    log, _, initial, _ = setup(drive_case, 15)
    lay = StateLayout({})
    P = np.zeros((9, 9))
    start = InitialState(initial.nav, P, np.zeros(0))
    forward = run(log.between(0.0, 1.0), MeasurementSchedule.empty(), start, lay, [1e-6, 0, 0], [0, 0, 0])
    from schuler.navigation.result import NavigationResult

    result = NavigationResult.from_run(forward, np.empty(0), np.empty(0, dtype=int), lay)
    C = result.covariance[0][:3, :3]
    x = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    np.testing.assert_allclose(C, 1e-6 * np.outer(x, x), atol=6e-8)  # start is a few degrees off


def test_free_covariance_grows_as_theory_says():
    """Static, level: tilt N sqrt(t), velocity g N sqrt(t^3/3), position g N sqrt(t^5/20) from gyro noise alone."""
    from schuler.navigation.result import NavigationResult
    from schuler.simulation.motion import StaticMotion, ideal_increments

    motion = StaticMotion(cases.ORIGIN, np.zeros(3), 60.0)
    t = np.linspace(0.0, 60.0, 6001)
    log = Increments(t[1:], np.diff(t), *ideal_increments(motion, t))
    case_start = motion.state(np.zeros(1))
    nav = cases.NavState(0.0, case_start.r_eb_e[0], case_start.v_eb_e[0], case_start.q_eb[0])
    N = 1e-4
    lay = StateLayout({"b_a": StateModel.constant(0.0)})
    start = InitialState(nav, np.zeros((12, 12)), np.zeros(3))
    forward = run(log, MeasurementSchedule.empty(), start, lay, np.full(3, N**2), np.zeros(3))
    result = NavigationResult.from_run(forward, np.empty(0), np.empty(0, dtype=int), lay)
    T, g = result.t, 9.807
    # discretisation and 0.5 percent of Schuler feedback over a minute
    np.testing.assert_allclose(result.sigma("dpsi")[:, 0], N * np.sqrt(T), rtol=2e-3)
    np.testing.assert_allclose(result.sigma("dv")[5:, 0], g * N * np.sqrt(T[5:] ** 3 / 3), rtol=6e-3)
    np.testing.assert_allclose(result.sigma("dr")[10:, 0], g * N * np.sqrt(T[10:] ** 5 / 20), rtol=1e-2)


def test_interruption_keeps_what_was_done(drive_case, monkeypatch):
    log, schedule, initial, lay = setup(drive_case)
    monkeypatch.setattr(engine, "_CHUNK", 2000)

    def stop(fraction):
        if fraction > 0.4:
            raise KeyboardInterrupt

    options = FilterOptions(smoother=True)
    with pytest.raises(KeyboardInterrupt):  # a part is kept only if it is asked for
        run(log, schedule, initial, lay, *NOISE, options, progress=stop)
    forward = run(log, schedule, initial, lay, *NOISE, options, progress=stop, keep_part=True)
    assert not forward.complete
    assert forward.t[-1] == pytest.approx(60.0)
    assert forward.nodes is None


def test_output_can_be_thinned(drive_case):
    log, schedule, initial, lay = setup(drive_case)
    full = run(log, schedule, initial, lay, *NOISE)
    thin = run(log, schedule, initial, lay, *NOISE, FilterOptions(output_rate_hz=10.0, record_s=5.0))
    np.testing.assert_array_equal(thin.r, full.r[::10])
    assert len(thin.rec_t) == 24
    np.testing.assert_array_equal(thin.rec_t[:2], [5.0, 10.0])


def test_zero_velocity_holds_a_static_imu():
    from schuler.filtering.measurements import zero_velocity
    from schuler.simulation.motion import StaticMotion, ideal_increments

    motion = StaticMotion(cases.ORIGIN, np.array([0.02, -0.01, 1.0]), 120.0)
    t = np.linspace(0.0, 120.0, 12001)
    dtheta, dv = ideal_increments(motion, t)
    rng = np.random.default_rng(0)
    log = Increments(
        t[1:], np.diff(t), dtheta + 1e-5 * rng.standard_normal(dtheta.shape), dv + np.array([1e-4, -2e-4, 3e-4])
    )
    s = motion.state(np.zeros(1))
    lay = cases.layout(15)
    nav = cases.NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])
    initial = InitialState.from_sigmas(nav, lay, attitude=[0.01] * 3, velocity=[0.01] * 3, position=[0.1] * 3)
    forward = run(log, zero_velocity(np.arange(1.0, 120.0), 0.01), initial, lay, *NOISE)
    assert np.linalg.norm(forward.r[-1] - s.r_eb_e[0]) < 0.5
    assert np.linalg.norm(forward.v[-1]) < 0.01
    assert np.all(forward.status == ACCEPTED)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"covariance_rate_hz": -1.0}, "covariance_rate_hz: expected a positive number"),
        ({"record_s": 0.0}, "record_s: expected a positive number"),
        ({"lockout": -1}, "lockout: expected a count"),
        ({"hold_s": 0.0}, "hold_s: expected a positive number"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        FilterOptions(**options)


def test_initial_state_is_checked(drive_case):
    _, _, initial, lay = setup(drive_case)
    with pytest.raises(InputError, match="expected a symmetric matrix"):
        InitialState(initial.nav, initial.P + np.triu(np.ones((21, 21)), 1), initial.parameters)
    with pytest.raises(InputError, match="the initial covariance has 21 states, the layout 15"):
        run(drive_case.increments, MeasurementSchedule.empty(), initial, cases.layout(15), *NOISE)
    late = drive_case.increments.between(5.0, 10.0)
    with pytest.raises(InputError, match=r"initial state is at 0\.0000 s but the first interval begins at 5\.0000 s"):
        run(late, MeasurementSchedule.empty(), initial, lay, *NOISE)


def test_the_covariance_grows_over_a_bridged_pause(drive_case):
    """Closed form: rates unknown by a constant c over a pause h leave c h of velocity and attitude."""
    log, _, initial, lay = setup(drive_case, 15)
    k = 200
    t, dt, w, f = (np.delete(x, slice(k, k + 50), axis=0) for x in (log.t, log.dt, log.dtheta_ib_b, log.dv_ib_b))
    dt[k] = t[k] - t[k - 1]
    w[k], f[k] = (log.dtheta_ib_b[k : k + 51].sum(axis=0), log.dv_ib_b[k : k + 51].sum(axis=0))
    paused = Increments(t, dt, w, f)
    options = {"record_s": 0.01, "covariance_rate_hz": None}
    plain = run(paused, MeasurementSchedule.empty(), initial, lay, *NOISE, FilterOptions(**options))
    doubt = FilterOptions(**options, gap_s=0.1, gap_gyro=0.02, gap_accel=0.5)
    grown = run(paused, MeasurementSchedule.empty(), initial, lay, *NOISE, doubt)
    at = int(np.argmin(np.abs(plain.rec_t - t[k])))
    P, Q = (engine.unpack_symmetric(x.rec_P[at : at + 1], lay.size)[0] for x in (plain, grown))
    added = np.diag(Q - P)[:6]
    # discretisation: attitude noise halved before and after the transition also turns gravity into velocity
    np.testing.assert_allclose(added[:3], (0.02 * dt[k]) ** 2, rtol=1e-3)
    assert np.all(added[3:6] >= 0.999 * (0.5 * dt[k]) ** 2)
    before = engine.unpack_symmetric(np.array([plain.rec_P[at - 2], grown.rec_P[at - 2]]), lay.size)
    np.testing.assert_array_equal(before[0], before[1])


def test_measurements_that_are_not_used_move_nothing(drive_case):
    """Fixes at 20 Hz between samples cut the intervals in pieces; unused, they leave the strapdown's end (0.1 mm)."""
    log, _, initial, lay = setup(drive_case, 15)
    t = np.arange(0.0137, 119.9, 0.05)
    ignored = MeasurementSchedule.of(POSITION, t, np.zeros((len(t), 3)), 1.0, gate=-1.0)
    forward = run(log, ignored, initial, lay, *NOISE)
    assert np.all(forward.status == GATED)
    free = mechanize(log, initial.nav)
    assert np.linalg.norm(forward.r[-1] - free.r_eb_e[-1]) < 1e-4  # what a quadratic interval leaves out
    assert np.linalg.norm(forward.v[-1] - free.v_eb_e[-1]) < 1e-6


def test_an_exact_live_fix_of_the_antenna_has_no_innovation(drive_case):
    """position() and velocity() take the lever arm from the IMU to the antenna, in body axes, while the body turns."""
    log, k = drive_case.increments, 1700
    states = cases.drive(2.0).state(np.array([0.0, log.t[k]]))
    lay = cases.layout(15)
    initial = replace(
        cases.start(drive_case, lay, np.random.default_rng(0)),
        nav=NavState(0.0, states.r_eb_e[0], states.v_eb_e[0], states.q_eb[0]),
        parameters=np.zeros(6),
    )
    lever = np.array([3.0, -2.0, -1.5])
    C = states.C_eb[1]
    llh = frames.llh_from_ecef(states.r_eb_e[1] + C @ lever)
    v_n = frames.C_en(llh).T @ (states.v_eb_e[1] + C @ np.cross(states.omega_eb_b[1], lever))
    live = Navigator(initial, lay, *NOISE, interval_s=0.01)
    live.aid(position(log.t[k], llh, np.ones(3), lever))
    live.aid(velocity(log.t[k], v_n, np.ones(3), lever))
    for i in range(k + 1):
        live.imu(log.t[i], log.dtheta_ib_b[i], log.dv_ib_b[i])
    assert np.linalg.norm(np.cross(states.omega_eb_b[1], lever)) > 0.3  # it does turn
    for outcome, limit in zip(live.outcomes, (1e-3, 2e-3), strict=True):  # mean rate of a sample for its end's
        assert np.abs(outcome.innovation).max() < limit, outcome.kind
