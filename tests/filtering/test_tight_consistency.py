"""Tightly coupled: honest with any number of clocks and satellites, and the loosely coupled filter in the limit."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest

from schuler import rotation
from schuler.filtering import engine
from schuler.filtering.engine import run
from schuler.filtering.measurements import ACCEPTED, REJECTED, gnss_measurements
from schuler.filtering.states import StateModel
from schuler.gnss.point import solve_points
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.evaluation.consistency import chi_square_band, nees
from schuler.navigation.result import NavigationResult
from schuler.recording.satellite_positions import gnss_series

RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]
CLOCK = ("clock", "clock_drift")
LIMIT = 1e-4  # of a sigma


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


@pytest.mark.thinned(5)
@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize(
    ("systems", "most", "clocks"), [("G", 8, ()), ("GE", 10, ("clock_2",)), ("GREC", 14, ac.CLOCKS_BETWEEN)]
)
def test_nees_with_one_two_and_four_clocks(drive, systems, most, clocks, runs):
    """Offset and drift of the first clock and the offsets between clocks all walk."""
    over = ac.sky(drive, systems, most)
    assert len(over.groups) == len(systems)
    ac.Campaign.of(drive, ac.layout(*CLOCK, *clocks), [ac.satellites(over)], range(runs)).check()


@pytest.mark.parametrize("runs", RUNS)
def test_nees_with_an_unknown_lever_arm_and_aids(drive, runs):
    lay = ac.layout(*CLOCK, "clock_2", "lever", "mount", "lever_v")
    aids = [ac.satellites(ac.sky(drive, "GE", 10)), ac.wheels, ac.zero_velocity]
    ac.Campaign.of(drive, lay, aids, range(runs)).check()


@pytest.mark.thinned(5)
@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("most", [3, 2, 1, 0])
def test_nees_through_a_minute_with_a_subset_of_satellites(drive, most, runs):
    """Eight satellites, then three, two, one or none from 45 to 105 s, then eight again."""
    t = drive.fixes_t
    over = ac.sky(drive, "G", np.where((t > 45.0) & (t < 105.0), most, 8))
    ac.Campaign.of(drive, ac.layout(*CLOCK), [ac.satellites(over)], range(runs)).check(looks=(30, 50, 70, 104, 115))


def test_each_satellite_helps(drive):
    """The fewer, the more the uncertainty grows in that minute: bounded by three, slowed by two and one."""
    t, sigma = drive.fixes_t, {}
    for most in (8, 4, 3, 2, 1, 0):
        over = ac.sky(drive, "G", np.where((t > 45.0) & (t < 105.0), most, 8))
        one = ac.filtered(drive, ac.layout(*CLOCK), [ac.satellites(over)], 0)
        sigma[most] = np.linalg.norm(one.result.sigma("dr")[103])
        assert np.isfinite(one.result.covariance_e).all()
        # continuous: no step of the solution where satellites go or come, in units of what is claimed
        error = one.result.errors(one.truth.reference)
        assert error.max_horizontal < 6.0 * np.linalg.norm(one.result.sigma("dr"), axis=1).max()
    values = list(sigma.values())
    assert values == sorted(values), sigma
    assert sigma[8] < 1.5
    assert sigma[3] < 0.35 * sigma[0]
    assert sigma[1] < 0.98 * sigma[0]


@pytest.mark.parametrize("runs", RUNS)
def test_nees_with_three_satellites_from_the_start(drive, runs):
    over = ac.sky(drive, "G", 3)
    ac.Campaign.of(drive, ac.layout(*CLOCK), [ac.satellites(over)], range(runs)).check()


@pytest.mark.parametrize("most", [2, 1])
def test_one_or_two_satellites_from_the_start_are_bounded(drive, most):
    """Gyro biases of 400 deg/h then turn the attitude by radians before they are known: more than a linear filter can.

    Every state is within its sigma (the spread over runs), the joint NEES is not: 1.1 with two satellites and 19 with
    one after two minutes, 400 runs.
    """
    runs = 40
    c = ac.Campaign.of(drive, ac.layout(*CLOCK), [ac.satellites(ac.sky(drive, "G", most))], range(runs))
    squares = (c.final**2).mean(axis=0)
    low, high = chi_square_band(1, runs, 1.0 - 1e-5)
    assert np.all((squares > low) & (squares < high)), squares
    assert np.isfinite(c.nees).all()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("block", [*CLOCK, "clock_2", "lever"])
def test_each_clock_is_estimated_with_either_sign(drive, block, sign):
    """Hardly any noise in the ranges, one block off: its estimate follows the truth, walks and all."""
    lay = ac.layout(*CLOCK, "clock_2", "lever")
    size = lay[block].stop - lay[block].start
    given = {name: np.zeros(lay[name].stop - lay[name].start) for name in lay.models}
    given[block] = sign * lay.models[block].sigma * np.ones(size)
    one = ac.filtered(drive, lay, [ac.satellites(ac.sky(drive, "GE", 12))], 4, given=given, noise=0.02)
    part = slice(lay[block].start - 9, lay[block].stop - 9)
    sigma = one.result.sigma(block)
    observable = sigma[-1] < 0.5 * lay.models[block].sigma
    assert observable.sum() >= (2 if block == "lever" else 1)
    error = one.result.parameters[:, part] - one.parameters[:, part]
    assert np.all(
        np.abs(error[-20:, observable]) < 1.0 * sigma[-20:, observable]
    )  # statistical: noise is far below a sigma
    assert np.all(sign * one.result.parameters[-1, part][observable] > 0.0)


@pytest.mark.parametrize("runs", RUNS)
def test_gate_keeps_the_filter_honest_with_a_faulty_satellite(drive, runs):
    """One of eight satellites is wrong by +-40 m and 3 m/s from 40 to 80 s: rejected, and NEES stays in its band."""
    over = ac.sky(drive, "G", 8)
    bad = np.unique(over.sat)[2]
    during = (over.sat == bad) & (over.t > 40.0) & (over.t < 80.0)

    def spoil(ranges):
        return replace(
            ranges,
            pseudorange=ranges.pseudorange + np.where(during, np.where(ranges.t < 60.0, 40.0, -40.0), 0.0),
            range_rate=ranges.range_rate + np.where(during, 3.0, 0.0),
        )

    lay = ac.layout(*CLOCK)
    gated = ac.satellites(over, gate=0.9999, spoil=spoil)
    c = ac.Campaign.of(drive, lay, [gated], range(runs), lockout=0)
    low, high = chi_square_band(lay.size, runs, 0.9999)
    at = c.nees[:, [30, 45, 60, 75, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
    one = ac.filtered(drive, lay, [gated], 0, lockout=0)
    i = one.result.innovations
    both = merged_flags(over, during)
    assert np.mean(i.status[both] == REJECTED) > 0.99
    assert np.mean(i.status[~both] == ACCEPTED) > 0.998  # 99.99 percent gates
    spoiled = ac.Campaign.of(drive, lay, [ac.satellites(over, spoil=spoil)], range(4))
    assert spoiled.nees[:, 45:80].mean() > 10.0


def merged_flags(over, flag):
    """A flag of ranges for the schedule of ranges and range rates: at each time all ranges, then all rates."""
    return np.concatenate([np.tile(flag[over.t == t], 2) for t in np.unique(over.t)])


def no_memory(noise):
    """Clock models that forget everything between two epochs."""
    drift = 0.1 * noise
    return {
        "clock": StateModel.random_walk(100.0 + noise, noise),
        "clock_drift": StateModel.random_walk(10.0 + drift, drift),
    }


def loose_and_tight(drive, clock_noise, *, rates=False, systems="G", most=8, errors=0.01):
    """The same ranges used satellite by satellite, and as least-squares solutions with their full covariance.

    ``errors`` scales everything that is wrong, not what the filters take it for: relinearisation between satellites
    falls with its square. Returns the largest differences of states and covariances in sigmas.
    """
    between = ac.CLOCKS_BETWEEN[: len(systems) - 1]
    truth = ac.Truth(drive, ac.layout(*CLOCK, *between), np.random.default_rng(8), noise=errors)
    over = ac.sky(drive, systems, most)
    slant = 1.0 / np.sin(over.elevation)
    over = replace(over, sigma_range=ac.SIGMA_RANGE * slant, sigma_rate=ac.SIGMA_RATE * slant)
    ranges = ac.measured(truth, over)
    points = solve_points(ranges, integrity=None)
    assert points.ok.all()
    loose = gnss_measurements(gnss_series(points), ac.LEVER, gate=None, use_velocity=rates)
    tight = range_measurements(ranges, ac.LEVER, use_rates=rates, gate=None)
    start = ac.initial(truth, ac.layout())
    memory = no_memory(clock_noise) | {name: no_memory(clock_noise)["clock"] for name in between}
    lay = ac.layout(**memory)
    n = lay.size
    P = np.diag(np.concatenate((np.zeros(9), lay.initial_variances())))
    P[:15, :15] = start.P
    a = run(truth.log, loose, start, ac.layout(), *ac.NOISE)
    b = run(truth.log, tight, engine.InitialState(start.nav, P, np.zeros(n - 9)), lay, *ac.NOISE)
    Pa, Pb = engine.unpack_symmetric(a.rec_P, 15), engine.unpack_symmetric(b.rec_P, n)[:, :15, :15]
    d = np.sqrt(np.einsum("kii->ki", Pa))
    q, p = a.rec_nav[:, :4], b.rec_nav[:, :4]
    turned = rotation.rotvec_from_quat(rotation.quat_multiply(p, rotation.quat_conjugate(q)))
    moved = np.concatenate((turned, b.rec_nav[:, 4:] - a.rec_nav[:, 4:], b.rec_est[:, :6] - a.rec_est), axis=1) / d
    return np.array([np.abs(moved).max(), np.abs((Pb - Pa) / (d[:, :, None] * d[:, None, :])).max()])


def test_tight_is_loose_in_the_limit_of_a_clock_without_memory(drive):
    """Ranges only, in sigmas: what the clock's memory adds falls with the square of its noise.

    A clock known to 1 km before an epoch and to metres after it leaves 1e-5 of the information; rounding of variances
    that differ as much is below that.
    """
    differences = np.array([loose_and_tight(drive, s)[1] for s in (10.0, 100.0)])
    assert 30.0 < differences[0] / differences[1] < 110.0, differences  # a hundred, less what linearisation leaves
    assert np.all(loose_and_tight(drive, 3000.0) < LIMIT)


def test_tight_is_loose_with_two_clocks(drive):
    assert np.all(loose_and_tight(drive, 3000.0, systems="GE", most=10) < LIMIT)


def test_tight_is_loose_with_range_rates_too(drive):
    """Position and velocity solutions are correlated through the lines of sight, which the loose filter is not told.

    A metre moves a range rate by a tenth of a millimetre per second, a per mille of its sigma.
    """
    assert np.all(loose_and_tight(drive, 3000.0, rates=True) < 5e-3)


def test_tight_is_nearly_loose_with_errors_of_full_size(drive):
    """Attitude corrections of many small steps do not commute: second-order effects of a few hundredths of a sigma."""
    assert np.all(loose_and_tight(drive, 3000.0, rates=True, errors=1.0) < 0.1)


@pytest.mark.parametrize(("errors", "bound"), [(0.01, 1e-5), (1.0, 0.1)])
def test_order_of_satellites_within_an_epoch_does_not_matter(drive, errors, bound):
    """In sigmas. With small errors what is left is rounding, with real ones the linearisation between satellites."""
    truth = ac.Truth(drive, ac.layout(*CLOCK, "clock_2"), np.random.default_rng(3), noise=errors)
    tight = ac.satellites(ac.sky(drive, "GE", 10))(truth)
    shuffled = tight.where(np.lexsort((np.random.default_rng(0).random(len(tight)), tight.t)))
    start = ac.initial(truth)
    a, b = (run(truth.log, s, start, truth.layout, *ac.NOISE) for s in (tight, shuffled))
    P, Q = (engine.unpack_symmetric(x.rec_P, truth.layout.size) for x in (a, b))
    d = np.sqrt(np.einsum("kii->ki", P))
    moved = np.concatenate((a.rec_nav[:, 4:] - b.rec_nav[:, 4:], a.rec_est - b.rec_est), axis=1) / d[:, 3:]
    assert np.abs(moved).max() < bound, np.abs(moved).max()
    assert np.abs((P - Q) / (d[:, :, None] * d[:, None, :])).max() < bound


def test_exact_ranges_leave_an_exact_start_alone(drive):
    """No noise, no bias, perfect start: neither the Earth's turning nor the lever arm nor a clock pulls it away."""
    lay = ac.layout(*CLOCK)
    zero = {name: np.zeros(lay[name].stop - lay[name].start) for name in lay.models}
    truth = ac.Truth(drive, lay, np.random.default_rng(0), zero, noise=0.0)
    schedule = ac.satellites(ac.sky(drive, "G", 8))(truth)
    T = truth.reference
    nav = ac.NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0])
    start = engine.InitialState.from_sigmas(nav, lay, attitude=ac.START_ATT, velocity=ac.START_V, position=ac.START_R)
    forward = run(truth.log, schedule, start, lay, *ac.NOISE)
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay)
    errors = result.errors(T)
    # discretisation: the antenna's velocity takes the mean rate of an interval, half a sample old
    assert errors.max_horizontal < 5e-3
    assert np.abs(result.parameter("clock")).max() < 5e-3
    assert np.abs(forward.innovation[schedule.kind == 8, 0]).max() < 5e-3
    assert np.abs(forward.innovation[schedule.kind == 9, 0]).max() < 5e-3


def test_smoothed_tight_solution_is_honest(drive):
    lay = ac.layout(*CLOCK, "clock_2")
    t = drive.fixes_t
    over = ac.sky(drive, "GE", np.where((t > 45.0) & (t < 75.0), 2, 10))
    values, better = [], []
    for seed in range(25):
        one = ac.filtered(drive, lay, [ac.satellites(over)], seed, smoother=True)
        smoothed = one.result.smooth()
        values.append(nees(smoothed, one.truth.reference, one.parameters))
        better.append(
            smoothed.errors(one.truth.reference).rms_horizontal / one.result.errors(one.truth.reference).rms_horizontal
        )
    low, high = chi_square_band(lay.size, 25, 0.9999)
    at = np.array(values)[:, [5, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
    assert np.mean(better) < 0.6
