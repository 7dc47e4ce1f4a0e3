"""The uncoupled architecture: position and velocity put where GNSS is, and what may be claimed after it."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.filtering import measurements as ms
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateModel
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.navigation.aids.satellite import resets
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.recording.series import GnssSeries

# good gyros: without updates a bias of 400 deg/h turns the attitude by more than a linear filter can follow
QUIET = {"b_a": StateModel.random_walk(0.01, 2e-5), "b_g": StateModel.random_walk(5e-5, 1e-6)}
RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


def series(truth, lever):
    """Fixes of an antenna at ``lever``, white noise."""
    loose = ac.gnss(truth, lever=lever, nominal_lever=lever)
    r, v = loose.where(loose.kind == ms.POSITION), loose.where(loose.kind == ms.VELOCITY)
    return GnssSeries(r.t, frames.llh_from_ecef(r.z[:, :3]), r.R, v.z[:, :3], v.R)


def reset_aid(lever, every_s=0.0):
    return lambda truth: resets(series(truth, lever), lever, every_s=every_s)


def test_the_antenna_is_put_where_the_fix_is(drive):
    """To rounding, for a turned body with a lever arm; attitude and estimates are left alone to the last bit."""
    truth = ac.Truth(drive, ac.layout("lever"), np.random.default_rng(0))
    fixes = series(truth, truth.lever)
    schedule = resets(fixes, ac.LEVER)
    log = truth.log
    # a log cut at the fix, so that the state at its end is the state after the reset
    k = 40
    t = np.round(fixes.t[k], 2)
    schedule = replace(schedule, t=np.where(schedule.t == fixes.t[k], t, schedule.t))
    last = schedule.where(schedule.t == t)
    log = log.between(0.0, t + 1e-6)
    start = ac.initial(truth)
    before = run(log, MeasurementSchedule.empty(), start, truth.layout, *ac.NOISE)
    after = run(log, last, start, truth.layout, *ac.NOISE)
    np.testing.assert_array_equal(after.q[-1], before.q[-1])
    np.testing.assert_array_equal(after.rec_est[-1], before.rec_est[-1])
    nav = NavState(t, after.r[-1], after.v[-1], after.q[-1])
    C_eb = rotation.dcm_from_quat(nav.q_eb)
    antenna = nav.r_eb_e + C_eb @ ac.LEVER
    np.testing.assert_allclose(antenna, frames.ecef_from_llh(fixes.llh[k]), atol=1e-8)  # rounding of 6e6 m
    # its velocity: that of the fix less the turning of the lever arm, mean rate of the last interval
    w = log.dtheta_ib_b[-1] / log.dt[-1] - C_eb.T @ [0.0, 0.0, earth.WGS84.omega_ie]
    v_n = frames.C_en(fixes.llh[k]).T @ (nav.v_eb_e + C_eb @ np.cross(w, ac.LEVER))
    np.testing.assert_allclose(v_n, fixes.v_n[k], atol=1e-3)  # discretisation: mean rate, not the instant's
    assert np.all(after.status == ms.ACCEPTED)


def test_covariance_after_a_reset_is_that_of_the_fix_and_nothing_else(drive):
    """Position and velocity: R exactly, no correlation with anything; the rest of P as it was."""
    truth = ac.Truth(drive, ac.layout(), np.random.default_rng(1))
    s = resets(series(truth, np.zeros(3)), np.zeros(3))
    t = np.round(s.t[80], 2)
    last = replace(s.where([80, 81]), t=np.full(2, t))
    assert last.kind.tolist() == [ms.RESET_POSITION, ms.RESET_VELOCITY]
    log, start = truth.log.between(0.0, t + 1e-6), ac.initial(truth)
    free = run(log, MeasurementSchedule.empty(), start, truth.layout, *ac.NOISE)
    after = run(log, last, start, truth.layout, *ac.NOISE)
    P, Q = (unpack_symmetric(x.rec_P[-1:], 15)[0] for x in (free, after))
    C = frames.C_en(frames.llh_from_ecef(after.r[-1]))
    # rounding, and north-east-down axes taken where the filter was before the reset: 1e-4 rad for some hundred metres
    np.testing.assert_allclose(C.T @ Q[6:9, 6:9] @ C, last.R[0], atol=1e-3)
    np.testing.assert_allclose(C.T @ Q[3:6, 3:6] @ C, last.R[1], atol=1e-6)
    rest = [0, 1, 2, *range(9, 15)]
    assert np.all(Q[np.ix_([3, 4, 5], rest)] == 0.0)
    assert np.all(Q[np.ix_([6, 7, 8], [*rest, 3, 4, 5])] == 0.0)
    np.testing.assert_array_equal(Q[np.ix_(rest, rest)], P[np.ix_(rest, rest)])


def test_between_resets_it_is_the_strapdown(drive):
    truth = ac.Truth(drive, ac.layout(), np.random.default_rng(2))
    s = resets(series(truth, np.zeros(3)), np.zeros(3)).where([20, 21])
    t = np.round(s.t[0], 2)
    log, start = truth.log.between(0.0, t + 5.0), ac.initial(truth)
    forward = run(log, replace(s, t=np.full(2, t)), start, truth.layout, *ac.NOISE)
    k = int(np.searchsorted(log.t, t + 1e-6)) - 1
    nav = NavState(float(log.t[k]), forward.r[k], forward.v[k], forward.q[k])
    free = mechanize(log.between(log.t[k], log.t[-1] + 1e-6), nav)
    # discretisation: the first intervals of a new run know no earlier samples
    np.testing.assert_allclose(forward.r[-1], free.r_eb_e[-1], atol=1e-4)


@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("every_s", [0.0, 10.0])
def test_claims_are_honest_without_a_lever_arm(drive, runs, every_s):
    """Fixes whose errors are white are independent of all the filter had: the covariance after a reset is exact.

    What is given up is what an update would have learned: attitude and biases keep their initial uncertainty.
    """
    lay = ac.layout(**QUIET)
    c = ac.Campaign.of(drive, lay, [reset_aid(np.zeros(3), every_s)], range(runs))
    low, high = chi_square_band(lay.size, runs, 0.9999)
    at = c.nees[:, [5, 15, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)


def test_nothing_is_learned(drive):
    """Parameters stay where they are and their sigmas do not fall; a loosely coupled filter's do."""
    one = ac.filtered(drive, ac.layout(), [reset_aid(np.zeros(3))], 0)
    assert np.all(one.result.parameters == 0.0)
    assert np.all(np.diff(one.result.sigma("b_g"), axis=0) >= 0.0)
    assert np.all(one.result.sigma("dpsi")[-1] > ac.START_ATT)
    loose = ac.filtered(drive, ac.layout(), [ac.gnss], 0)
    assert np.all(loose.result.sigma("b_g")[-1] < 0.2 * one.result.sigma("b_g")[-1])


def test_with_a_lever_arm_the_claim_leaves_its_attitude_out(drive):
    """Stated limitation: after a reset the IMU's position is wrong by the fix and by ``C l`` of a wrong attitude.

    The filter claims the fix's error only. With 10 m of lever arm and centimetre fixes that is far too little: a reset
    gives no covariance of the lever arm, and one to rely on needs the loosely coupled filter.
    """
    lever = np.array([10.0, 0.0, 0.0])

    def precise(truth):
        g = series(truth, lever)
        n = len(g)
        r = truth.body(truth.drive.at_fixes).point(lever)[0]
        g = replace(g, llh=frames.llh_from_ecef(r), cov_r_n=np.tile(1e-4 * np.eye(3), (n, 1, 1)))
        return resets(g, lever, every_s=1.0)

    c = ac.Campaign.of(drive, ac.layout(), [precise], range(10))
    assert c.nees[:, 20].mean() > 3.0


def test_resets_take_every_fix_or_some(drive):
    truth = ac.Truth(drive, ac.layout(), np.random.default_rng(3))
    g = series(truth, np.zeros(3))
    assert len(resets(g, np.zeros(3))) == 2 * len(g)
    some = resets(g, np.zeros(3), every_s=5.0)
    assert np.diff(np.unique(some.t)).min() == pytest.approx(5.0)
    only = resets(GnssSeries(g.t, g.llh, g.cov_r_n), np.zeros(3))
    assert set(only.kind.tolist()) == {ms.RESET_POSITION}


def test_a_run_with_resets_is_not_smoothed(drive):
    truth = ac.Truth(drive, ac.layout(), np.random.default_rng(4))
    s = resets(series(truth, np.zeros(3)), np.zeros(3))
    with pytest.raises(InputError, match="a run with resets has no memory to smooth over"):
        run(truth.log, s, ac.initial(truth), truth.layout, *ac.NOISE, FilterOptions(smoother=True))


def test_an_outage_takes_resets_too(drive):
    truth = ac.Truth(drive, ac.layout(), np.random.default_rng(4))
    s = resets(series(truth, np.zeros(3)), np.zeros(3))
    left = s.outside([(30.0, 60.0)])
    assert not np.any((left.t >= 30.0) & (left.t < 60.0))
    assert len(left) < len(s)
