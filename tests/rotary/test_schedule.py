"""Schedules: rates are the derivatives of angles, limits are kept, cycles close, biases and scale factors cancel."""

import numpy as np
import pytest

from schuler import rotation
from schuler.exceptions import InputError
from schuler.rotary import schemes
from schuler.rotary.du_axes import du_axis, swap_matrix
from schuler.rotary.gimbals import axis_vector
from schuler.rotary.platform_usage import PlatformLimits, usage, within
from schuler.rotary.profiles import AngleProfile, profile_of, profile_of_rates, turn_pieces
from schuler.rotary.schedule import Schedule, stacked
from schuler.units import DEG

W, A = 10.0 * DEG, 5.0 * DEG

SCHEDULES = {
    "fixed": schemes.fixed("x", 0.3),
    "continuous": schemes.continuous("z", -W),
    "run up": schemes.continuous((1.0, 2.0, -1.0), W, acceleration=A, start=3.0, angle=0.2),
    "reciprocating": schemes.reciprocating("y", W, acceleration=A),
    "both sides": schemes.reciprocating("y", W, turn=-2.0, both_sides=True, dwell=1.0, acceleration=A, angle=0.1),
    "carousel": schemes.carousel("z", W, limit=7.0, acceleration=A, start=2.0),
    "carousel, no limit": schemes.carousel("z", W, limit=7.0),
    "4 positions": schemes.dwell("z", 4, dwell=5.0, rate=W, acceleration=A),
    "given positions": schemes.dwell("x", [0.0, 2.0, -1.0], dwell=2.0, rate=W, acceleration=A),
    "16 positions": schemes.dwell("z", 16, dwell=1.0, rate=W, acceleration=A, back=False),
    "dual": schemes.dual_axis(16, dwell=2.0, rate=3.0 * W, acceleration=3.0 * A, start=1.0),
    "sequence": schemes.sequence(
        ["x", "y", "z"], [(0, 1.0, 1.0), (2, -2.0, 0.0), (1, 0.5, 3.0)], rate=W, acceleration=A, repeat=False
    ),
    "rates": schemes.from_rates("z", [0.0, 2.0, 3.0, 3.0, 8.0], [0.0, 0.3, 0.3, -0.1, 0.0], repeat=True),
    "stacked": stacked(schemes.reciprocating("x", W, acceleration=A), schemes.continuous("z", 3.0 * W)),
    "tilted": schemes.tilted(schemes.continuous("z", W), "y", 30.0 * DEG),
    "mounted": schemes.continuous("z", W).mounted(rotation.dcm_from_rpy([0.1, -0.2, 0.3])),
}  # fmt: skip

every = pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES.keys())


def off_breaks(schedule: Schedule, n: int = 200, stop: float = 150.0, room: float = 5e-3) -> np.ndarray:
    """Times at least ``room`` from any jump."""
    t = np.sort(np.random.default_rng(1).uniform(0.5, stop, n))
    breaks = np.concatenate(([-1.0], schedule.breakpoints(0.0, stop + 1.0)))
    return t[np.min(np.abs(t[:, None] - breaks), axis=1) > room]


@every
def test_rate_is_the_derivative_of_the_angle(schedule):
    """The angle is quadratic between jumps, so a central difference is exact: rounding of 1e-16 * 30 rad / 2 ms."""
    t, h = off_breaks(schedule), 1e-3
    slope = (schedule.angles(t + h) - schedule.angles(t - h)) / (2.0 * h)
    np.testing.assert_allclose(schedule.rates(t), slope, atol=2e-11)
    slope = (schedule.rates(t + h) - schedule.rates(t - h)) / (2.0 * h)
    np.testing.assert_allclose(schedule.accelerations(t), slope, atol=2e-12)


@every
def test_the_angle_is_continuous_at_every_jump(schedule):
    breaks = schedule.breakpoints(0.0, 300.0)
    rate = np.abs(schedule.rates(np.linspace(0.0, 300.0, 2000))).max()
    jump = schedule.angles(breaks + 1e-9) - schedule.angles(breaks - 1e-9)
    assert np.abs(jump).max(initial=0.0) <= 2.1e-9 * rate + 1e-13  # rounding


@every
def test_between_breakpoints_the_acceleration_is_constant(schedule):
    edges = np.concatenate(([0.0], schedule.breakpoints(0.0, 200.0), [200.0]))
    for x in (0.01, 0.3, 0.99):
        inside = edges[:-1] + x * np.diff(edges)
        np.testing.assert_array_equal(
            schedule.accelerations(inside), schedule.accelerations(edges[:-1] + 0.5 * np.diff(edges))
        )


@every
def test_omega_and_alpha_are_the_derivatives_of_the_attitude(schedule):
    """Five-point differences of C_bs: discretisation h^4 w^5 / 30 below 1e-12, rounding 1e-16 / h = 1e-13."""
    t, h = off_breaks(schedule, room=0.03), 1e-2

    def derivative(f):
        return (8.0 * (f(t + h) - f(t - h)) - f(t + 2.0 * h) + f(t - 2.0 * h)) / (12.0 * h)

    C = schedule.C_bs(t)
    np.testing.assert_allclose(C @ np.swapaxes(C, 1, 2), np.broadcast_to(np.eye(3), C.shape), atol=1e-14)
    omega = rotation.unskew(np.swapaxes(C, 1, 2) @ derivative(schedule.C_bs))
    np.testing.assert_allclose(schedule.omega_bs_s(t), omega, atol=3e-11)
    np.testing.assert_allclose(schedule.alpha_bs_s(t), derivative(schedule.omega_bs_s), atol=1e-10)


def test_du_z_is_his_matrix():
    """C_b^s = R3(angle) about up, eq. (2.2), in his axes; rounding."""
    beta = 0.7
    C_bs = swap_matrix(schemes.fixed(du_axis("Z"), beta).C_bs([0.0])[0])
    c, s = np.cos(beta), np.sin(beta)
    np.testing.assert_allclose(C_bs.T, [[c, s, 0], [-s, c, 0], [0, 0, 1]], atol=1e-15)


def test_trapezoid_and_triangle_take_the_times_of_the_closed_forms():
    long = profile_of(turn_pieces(2.0, 0.5, 0.25))
    assert long.start[-1] == pytest.approx(2.0 / 0.5 + 0.5 / 0.25, rel=1e-15)
    short = profile_of(turn_pieces(-0.2, 0.5, 0.25))
    assert short.start[-1] == pytest.approx(2.0 * np.sqrt(0.2 / 0.25), rel=1e-15)
    for profile, turn in ((long, 2.0), (short, -0.2)):
        angle, rate, acceleration = profile.at(np.array([100.0]))
        assert angle[0] == pytest.approx(turn, rel=1e-14)
        assert rate[0] == 0.0
        assert acceleration[0] == 0.0


def test_a_cycle_repeats_and_the_angle_goes_on():
    schedule = SCHEDULES["16 positions"]
    period = 16 * (2.0 * np.pi / 16 / W + W / A if 2.0 * np.pi / 16 > W**2 / A else 2.0 * np.sqrt(np.pi / 8 / A)) + 16
    t = np.linspace(0.0, period, 500)
    np.testing.assert_allclose(schedule.angles(t + 3 * period), schedule.angles(t) + 6.0 * np.pi, atol=1e-9)


@pytest.mark.parametrize("name", ["reciprocating", "both sides", "carousel", "4 positions", "dual"])
def test_turns_there_and_back_leave_no_net_turn(name):
    """What a scale factor adds over a cycle is the net angle; it stays within the largest angle for ever."""
    angles = SCHEDULES[name].angles(np.linspace(0.0, 3000.0, 30_001))
    assert np.abs(angles).max() <= {"reciprocating": 2.0 * np.pi, "both sides": 2.1, "carousel": 7.0,
                                    "4 positions": 2.0 * np.pi, "dual": np.pi}[name] + 1e-9  # fmt: skip


def test_a_carousel_reaches_its_limits_and_passes_zero_at_full_rate():
    used = usage(SCHEDULES["carousel"], 600.0)
    assert used.largest_angle[0] == pytest.approx(7.0, rel=1e-12)
    assert used.largest_acceleration[0] == pytest.approx(A, rel=1e-12)
    schedule = schemes.carousel("z", W, limit=7.0, acceleration=A)
    first = 7.0 / W + W / A  # to the limit from rest
    half = first + 0.5 * (14.0 / W + W / A)
    assert schedule.angles([half])[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert schedule.rates([half])[0, 0] == pytest.approx(-W, rel=1e-12)


@pytest.mark.parametrize("n", [2, 4, 8, 16])
@pytest.mark.parametrize("back", [True, False])
def test_even_positions_are_held_for_equal_times(n, back):
    schedule = schemes.dwell("z", n, dwell=3.0, rate=W, back=back)
    step = 2.0 * np.pi / n / W + 3.0
    t = (np.arange(2 * n) + 1.0) * step - 1.5
    places = np.round(schedule.angles(t)[:, 0] / (2.0 * np.pi / n)) % n
    np.testing.assert_array_equal(np.bincount(places.astype(int), minlength=n), 2)
    np.testing.assert_array_equal(schedule.rates(t), 0.0)
    np.testing.assert_allclose(schedule.C_bs(t).sum(axis=0)[:2], 0.0, atol=1e-13)  # across the axis nothing is left


@pytest.mark.parametrize("n", [4, 8, 16])
def test_dual_axis_positions_cancel_all_biases_and_all_turns(n):
    schedule = schemes.dual_axis(n, dwell=3.0, rate=W, acceleration=A)
    step = np.pi / W + W / A + 3.0
    held = np.arange(n) * step + 0.5
    np.testing.assert_array_equal(schedule.rates(held), 0.0)
    np.testing.assert_allclose(schedule.C_bs(held).sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(usage(schedule, n * step).net_turn, 0.0, atol=1e-12)


@pytest.mark.parametrize("n", [4, 8, 16])
def test_dual_axis_stays_within_half_a_turn(n):
    assert usage(schemes.dual_axis(n, dwell=2.0, rate=W), 1000.0).largest_angle.max() == pytest.approx(np.pi)


def test_usage_of_a_reciprocating_rotation_in_closed_form():
    stroke = 2.0 * np.pi / W + W / A
    used = usage(schemes.reciprocating("z", W, acceleration=A, start=5.0), 5.0 + 10.0 * stroke)
    assert used.travel[0] == pytest.approx(20.0 * np.pi, rel=1e-12)
    assert used.net_turn[0] == pytest.approx(0.0, abs=1e-12)
    assert used.largest_rate[0] == pytest.approx(W, rel=1e-12)
    assert used.largest_acceleration[0] == pytest.approx(A, rel=1e-12)
    assert used.reversals[0] == 9
    assert used.moving[0] == pytest.approx(10.0 * stroke, rel=1e-12)


@pytest.mark.parametrize("positions", [4, 6, 8])
def test_rounding_reverses_nothing(positions):
    """Rates that end at zero but for rounding: a dwell that goes round one way has no reversal."""
    schedule = schemes.dwell(
        "z", positions, dwell=7.0, rate=np.deg2rad(0.59), acceleration=np.deg2rad(0.31), back=False
    )
    assert usage(schedule, 5000.0).reversals[0] == 0.0


def test_usage_counts_a_reversal_within_a_piece_and_jumps():
    swing = usage(schemes.from_rates("z", [0.0, 4.0], [1.0, -1.0]), 4.0)
    assert swing.travel[0] == pytest.approx(2.0)
    assert swing.net_turn[0] == pytest.approx(0.0, abs=1e-15)
    assert swing.largest_angle[0] == pytest.approx(1.0)
    assert swing.reversals[0] == 1
    assert np.isinf(swing.largest_acceleration[0])  # it starts in full motion
    assert usage(schemes.fixed("z"), 10.0).largest_acceleration[0] == 0.0


def test_limits_are_checked_in_words():
    limits = PlatformLimits(rate=W, acceleration=A, angle=2.0 * np.pi, axes=1)
    assert within(SCHEDULES["reciprocating"], limits, 300.0) == []
    broken = within(SCHEDULES["dual"], limits, 300.0)
    assert any("axes" in b for b in broken)
    assert any("rate" in b for b in broken)
    assert any("acceleration of inf" in b for b in within(schemes.continuous("z", W), limits, 10.0))
    assert any("angle" in b for b in within(schemes.continuous("z", W, acceleration=A), limits, 100.0))


def test_a_lever_arm_in_turning_axes_has_its_derivative():
    schedule, t, h = SCHEDULES["stacked"], np.array([3.3, 20.1]), 1e-4
    l_s, rate = schedule.lever_arm_s(t, [0.5, -1.0, 2.0])
    np.testing.assert_allclose(np.linalg.norm(l_s, axis=1), np.sqrt(5.25), rtol=1e-14)
    ends = [schedule.lever_arm_s(t + s * h, [0.5, -1.0, 2.0])[0] for s in (1, -1)]
    np.testing.assert_allclose(rate, (ends[0] - ends[1]) / (2.0 * h), atol=1e-8)  # discretisation h^2 w^3 / 6


def test_delay_stands_still_first():
    schedule = schemes.continuous("z", W, angle=0.4)
    later = schedule.delayed(60.0)
    np.testing.assert_array_equal(later.angles([0.0, 30.0, 59.9])[:, 0], 0.4)
    np.testing.assert_allclose(later.angles([70.0])[0, 0], 0.4 + 10.0 * W, rtol=1e-14)
    assert schedule.delayed(0.0).profiles[0].start is schedule.profiles[0].start


def test_rates_by_nodes_are_integrated_exactly():
    profile = profile_of_rates([0.0, 2.0, 2.0, 5.0], [0.0, 1.0, -1.0, -1.0])
    angle, rate, _ = profile.at(np.array([1.0, 2.0, 5.0, 7.0]))
    np.testing.assert_allclose(angle, [0.25, 1.0, -2.0, -4.0], atol=1e-15)
    np.testing.assert_allclose(rate, [0.5, -1.0, -1.0, -1.0], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: axis_vector("w"), "axis: expected 'x'"),
        (lambda: axis_vector([0.0, 0.0, 0.0]), "length zero"),
        (lambda: schemes.continuous("z", np.nan), "rate: expected a finite"),
        (lambda: schemes.continuous("z", W, acceleration=-1.0), "acceleration: expected a positive"),
        (lambda: schemes.continuous("z", W, start=-1.0), "delay: expected"),
        (lambda: schemes.reciprocating("z", -W), "rate: expected a positive"),
        (lambda: schemes.dwell("z", 1, dwell=1.0, rate=W), "at least two"),
        (lambda: schemes.dwell("z", [0.0, np.inf], dwell=1.0, rate=W), "at least two angles"),
        (lambda: schemes.dual_axis(5, dwell=1.0, rate=W), "4, 8 or 16"),
        (lambda: schemes.dual_axis(8, dwell=1.0, rate=W, outer="z"), "perpendicular"),
        (lambda: schemes.sequence(["z"], [(1, 1.0, 0.0)], rate=W), "a move needs an axis"),
        (lambda: schemes.sequence(["z"], [(0, 0.0, 0.0)], rate=W), "some duration"),
        (lambda: schemes.sequence(["z"], [], rate=W), "expected moves"),
        (lambda: schemes.from_rates("z", [0.0, -1.0], [0.0, 1.0]), "begin at zero"),
        (lambda: stacked(), "at least one schedule"),
        (lambda: stacked(SCHEDULES["mounted"], SCHEDULES["continuous"]), "innermost"),
        (lambda: Schedule(np.eye(3), ()), "a profile for each axis"),
        (lambda: schemes.continuous("z", W).mounted(np.eye(3) * 2.0), "rotation matrix"),
        (lambda: AngleProfile(np.array([1.0]), np.zeros(1), np.zeros(1), np.zeros(1)), "increasing times from zero"),
        (lambda: usage(SCHEDULES["fixed"], 0.0), "duration: expected a positive"),
        (lambda: PlatformLimits(rate=0.0), "limits are positive"),
    ],
)  # fmt: skip
def test_wrong_input_is_refused_in_words(make, message):
    with pytest.raises(InputError, match=message):
        make()
