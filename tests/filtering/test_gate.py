"""Innovation test: a wrong fix is told from a wrong filter, live as in a batch run, and the smoother knows."""

from __future__ import annotations

from dataclasses import replace

import filter_cases as cases
import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.measurements import (
    ACCEPTED,
    FORCED,
    POSITION,
    REJECTED,
    VELOCITY,
    gnss_measurements,
)
from schuler.navigation.evaluation.consistency import nees
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult

LAYOUT = cases.layout(15)
OUTAGE = ((50.0, 75.0),)


def setup(case, seed=0, *, gate=0.9999, velocity=True, fixes=None, rough=0.0, bump=0.0):
    """Log, measurements, start; white noise ``rough`` times what is stated comes on top, and a specific force ``bump``
    [m/s^2] in the outage that no state knows of.
    """
    rng = np.random.default_rng(seed)
    b = np.sqrt(LAYOUT.initial_variances()) * rng.standard_normal(LAYOUT.size - 9)
    log, history = cases.corrupted(case, LAYOUT, b, rng)
    gnss = cases.fixes(case, rng)
    schedule = gnss_measurements(gnss if fixes is None else fixes(gnss), cases.LEVER, gate=gate, use_velocity=velocity)
    root, inside = rough * np.sqrt(log.dt)[:, None], (log.t > OUTAGE[0][0]) & (log.t < OUTAGE[0][1])
    dv = log.dv_ib_b + cases.ACCEL_N * root * rng.standard_normal((len(log), 3))
    dv[inside, 1] += bump * log.dt[inside]
    dtheta = log.dtheta_ib_b + cases.GYRO_N * root * rng.standard_normal((len(log), 3))
    log = replace(log, dtheta_ib_b=dtheta, dv_ib_b=dv)
    return log, schedule, cases.start(case, LAYOUT, rng), history


NOISE = (np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2))


def offset(schedule, kind, metres, inside):
    """Measurements of a kind moved up by some metres (or metres per second) where ``inside``."""
    z = schedule.z.copy()
    mine = (schedule.kind == kind) & inside
    up = (
        schedule.z[mine][:, :3] / np.linalg.norm(schedule.z[mine][:, :3], axis=1)[:, None]
        if kind == POSITION
        else (1, 0, 0)
    )
    z[mine, :3] += metres * np.asarray(up)
    return replace(schedule, z=z)


def of_kind(forward, schedule, kind, start, stop):
    return forward.status[(schedule.kind == kind) & (schedule.t > start) & (schedule.t < stop)]


def test_chi_square_innovations_leave_everything_as_it_was(drive_case):
    """Well-modelled runs and single blunders: to the last bit those of a gate that only rejects."""
    for seed in range(3):
        log, schedule, initial, _ = setup(drive_case, seed)
        schedule = offset(schedule, POSITION, 40.0, np.round(schedule.t) % 20 == 0)
        new, plain = (run(log, schedule, initial, LAYOUT, *NOISE, FilterOptions(lockout=k)) for k in (10, 0))
        np.testing.assert_array_equal(new.status, plain.status)
        np.testing.assert_array_equal(new.r, plain.r)
        np.testing.assert_array_equal(new.rec_P, plain.rec_P)
        assert (new.status == REJECTED).sum() >= 5
        assert new.noise_factors == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("velocity", [True, False])
def test_drift_of_an_outage_is_readmitted_with_the_second_fix(drive_case, velocity):
    """A specific force of 0.15 m/s^2 that nobody stated drifts by many sigmas in 25 s, and honest fixes are taken."""
    log, schedule, initial, _ = setup(drive_case, velocity=velocity, bump=0.15)
    schedule = schedule.outside(OUTAGE)
    forward = run(log, schedule, initial, LAYOUT, *NOISE)
    after = of_kind(forward, schedule, POSITION, 75.0, 80.0)
    assert after[0] == REJECTED
    assert after[1] == FORCED
    assert np.all(after[2:] == ACCEPTED)
    never = run(log, schedule, initial, LAYOUT, *NOISE, FilterOptions(lockout=0))
    assert np.all(of_kind(never, schedule, POSITION, 75.0, 80.0) == REJECTED)


def test_a_jump_is_held_off_while_velocities_agree_and_not_for_ever(drive_case):
    log, schedule, initial, _ = setup(drive_case)
    moved = offset(schedule, POSITION, 30.0, schedule.t > 60.0)
    held = run(log, moved, initial, LAYOUT, *NOISE)
    assert np.all(of_kind(held, moved, POSITION, 60.0, 1e9) == REJECTED)
    assert np.all(of_kind(held, moved, VELOCITY, 60.0, 1e9) != REJECTED)
    short = run(log, moved, initial, LAYOUT, *NOISE, FilterOptions(hold_s=19.5))
    status = of_kind(short, moved, POSITION, 60.0, 1e9)
    first = int(np.flatnonzero(status == FORCED)[0])
    assert first == 20  # seconds, one fix each
    assert np.all(status[first + 1 :] == ACCEPTED)


def test_a_readmitted_jump_moves_position_and_nothing_else(drive_case):
    """Closed form: attitude and velocity stay where they were to a hundredth of what the old rule made of 30 m."""
    log, schedule, initial, _ = setup(drive_case)
    moved = offset(schedule, POSITION, 30.0, schedule.t > 60.0)
    moved = moved.where((moved.kind == POSITION) | (moved.t < 60.0))
    options = FilterOptions(hold_s=5.0, record_s=0.1)
    forward = run(log, moved, initial, LAYOUT, *NOISE, options)
    clean = run(log, moved, initial, LAYOUT, *NOISE, replace(options, lockout=0))
    at = int(np.argmax(forward.rec_t > moved.t[(moved.kind == POSITION) & (forward.status == FORCED)][0] + 0.05))
    difference = forward.rec_nav[at] - clean.rec_nav[at]
    assert np.linalg.norm(difference[7:10]) == pytest.approx(30.0, abs=4.0)  # noise of fixes
    assert np.linalg.norm(difference[4:7]) < 0.3
    assert np.abs(difference[:4]).max() < 2e-3


def test_fixes_that_scatter_are_noisier_than_they_say(drive_case):
    """1-sigma stated 20 times too small: found from the fixes' own differences, and the run is the one it should be."""

    def worse(gnss):
        return replace(gnss, cov_r_n=gnss.cov_r_n / 400.0)

    log, schedule, initial, _ = setup(drive_case, fixes=worse)
    forward = run(log, schedule, initial, LAYOUT, *NOISE)
    assert 5.0 < forward.noise_factors[1] ** 0.5 < 60.0
    assert forward.noise_factors[2] == 1.0
    assert np.mean(of_kind(forward, schedule, POSITION, 60.0, 1e9) == ACCEPTED) > 0.9


def test_noise_of_the_imu_follows_innovations_within_bounds(drive_case):
    """Stated 30 times too small, positions only."""
    log, schedule, initial, _ = setup(drive_case, velocity=False, rough=30.0)
    outcome = run(log, schedule, initial, LAYOUT, *NOISE)
    assert 4.0 < outcome.noise_factors[0] <= 1000.0
    assert outcome.noise_factors[1] == 1.0
    off = run(log, schedule, initial, LAYOUT, *NOISE, FilterOptions(adaptive=False))
    assert off.noise_factors == (1.0, 1.0, 1.0)


def test_live_navigator_readmits_as_the_batch_run(drive_case):
    """Outage, readmission, scattering fixes, noise that adapts: to the last bit."""
    log, schedule, initial, _ = setup(drive_case, fixes=lambda g: replace(g, cov_r_n=g.cov_r_n / 100.0), bump=0.15)
    schedule = schedule.outside(OUTAGE)
    batch = run(log, schedule, initial, LAYOUT, *NOISE)
    assert (batch.status == FORCED).any()
    live = Navigator(initial, LAYOUT, *NOISE, interval_s=0.01)
    cases.stream(live, log, schedule)
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_array_equal(live.parameters, batch.rec_est[-1])
    np.testing.assert_array_equal([o.nis for o in live.outcomes], batch.nis)


def test_batch_and_smoothed_solutions_are_consistent_after_readmission(drive_case):
    """Noise stated 10 times too small, an outage, positions alone: normalised errors of navigation after it."""
    causal, smoothed = [], []
    for seed in range(8):
        log, schedule, initial, _ = setup(drive_case, seed, velocity=False, rough=10.0)
        schedule = schedule.outside(OUTAGE)
        forward = run(log, schedule, initial, LAYOUT, *NOISE, FilterOptions(smoother=True))
        result = NavigationResult.from_run(forward, schedule.t, schedule.kind, LAYOUT)
        for solution, values in ((result, causal), (result.smooth(), smoothed)):
            values.append(nees(solution, drive_case.truth)[80:110] / 9.0)
    # statistical: 8 runs, correlated within each; 30 to 1000 with the old rule
    assert np.median(causal) < 3.0
    assert np.median(smoothed) < 3.0


def test_order_of_measurements_of_one_time_does_not_matter(drive_case):
    """Measurements of one time: positions first or velocities first, the same runs readmit."""
    log, schedule, initial, _ = setup(drive_case, bump=0.15)
    schedule = schedule.outside(OUTAGE)
    order = np.lexsort((-schedule.kind, schedule.t))
    other = schedule.where(order)
    a, b = (run(log, s, initial, LAYOUT, *NOISE) for s in (schedule, other))
    assert np.linalg.norm(a.r[-1] - b.r[-1]) < 1.0
