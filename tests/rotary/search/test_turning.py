"""Replays of one linearised vehicle with any schedule: as if the turning IMU itself had been linearised."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from schuler.budget.covariance import quantity_sigma, true_covariance
from schuler.budget.linearisation import SENSOR_BLOCKS, linearise
from schuler.budget.scenario import BudgetScenario, linearised_mission, prepare_budget, true_schedule
from schuler.exceptions import InputError
from schuler.recording.series import Increments
from schuler.rotary.aids import in_imu_axes
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu
from schuler.rotary.schemes import continuous, dual_axis, dwell, fixed, reciprocating, tilted
from schuler.rotary.search.objective import scheme_objective
from schuler.rotary.search.turning import turning_mission
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import DEG

AIDS = {"gnss": {"lever_arm_m": (0.8, 0.3, -1.2), "outages_s": ((20.0, 60.0),)}}
LAP = [
    {"duration_s": 5.0}, {"duration_s": 8.0, "speed_m_s": 10.0}, {"duration_s": 6.0, "turn_deg": 90.0},
    {"duration_s": 10.0}, {"duration_s": 8.0, "turn_deg": -70.0, "speed_m_s": 4.0}, {"duration_s": 23.0},
]  # fmt: skip
SCHEMES = [
    continuous("-z", 20.0 * DEG, acceleration=40.0 * DEG, start=3.3),
    tilted(reciprocating("z", 60.0 * DEG, dwell=1.7, acceleration=100.0 * DEG), "x", 25.0 * DEG),
    dwell("x", 4, dwell=2.23, rate=31.0 * DEG),
    dual_axis(8, dwell=1.3, rate=45.0 * DEG, acceleration=90.0 * DEG),
]


def scenario(driving: bool = False, aids: bool = False) -> BudgetScenario:
    still = {"type": "static", "lat_deg": 45.0, "lon_deg": 0.0, "duration_s": 60.0}
    moving = {"type": "manoeuvres", "lat_deg": 45.0, "lon_deg": 0.0, "heading_deg": 30.0, "manoeuvres": LAP}
    return BudgetScenario.parse(
        {
            "motion": moving if driving else still, "start": {"attitude_deg": (0.05, 0.05, 0.2)}, "node_rate_hz": 1.0,
            **(AIDS if aids else {}),
        }
    )  # fmt: skip


@cache
def prepared(driving: bool, aids: bool):
    s = scenario(driving, aids)
    motion = s.motion.build()
    return turning_mission(prepare_budget(s), motion, SENSOR_BLOCKS), motion, s


def reference(schedule, driving, aids):
    """The turning IMU's own motion, linearised by the engine from exact increments."""
    turning, motion, s = prepared(driving, aids)
    turned = RotatingMotion(motion, schedule)
    ideal = ideal_rotating_imu(turned, 100.0)
    increments = Increments(ideal.t[1:], np.diff(ideal.t), ideal.gyro, ideal.accel)
    measured = true_schedule(motion, s)
    if len(measured):
        measured = in_imu_axes(measured, schedule)
    run = linearise(increments, measured, ideal.truth, rate_hz=1.0)
    return replace(turning.fixed, run=run)


SPEC = catalogue.spec("NAV440-emulated")


@pytest.mark.thinned(3)
@pytest.mark.parametrize("schedule", SCHEMES, ids=lambda s: s.name)
@pytest.mark.parametrize(("driving", "aids"), [(False, False), (True, False), (True, True)])
def test_columns_and_covariances_are_those_of_the_turning_imu(schedule, driving, aids):
    turning, *_ = prepared(driving, aids)
    ours, engine = turning.with_schedule(schedule), reference(schedule, driving, aids)
    if aids:
        # discretisation: the engine takes rates as means over 10 ms
        np.testing.assert_allclose(ours.run.H, engine.run.H, atol=2e-2 * np.abs(engine.run.H).max())
    # the engine has further nodes, wherever the IMU has turned by 0.3 rad
    on_its_nodes = replace(turning, fixed=engine).with_schedule(schedule)
    on_its_nodes = replace(on_its_nodes, run=replace(on_its_nodes.run, H=engine.run.H))
    for block in SENSOR_BLOCKS:
        part = ours.run.layout[block]
        columns = slice(part.start - 9, part.stop - 9)
        a, b = on_its_nodes.run.B[:, :, columns], engine.run.B[:, :, columns]
        # discretisation: attitude every 50 ms; velocity and position within one node by pieces of up to half a second,
        # which is (piece / duration)^2 of what a mission adds up to
        for rows, share in ((slice(0, 3), 3e-4), (slice(3, 6), 0.15), (slice(6, 9), 0.2)):
            assert np.abs(a[:, rows] - b[:, rows]).max() <= share * np.abs(b[:, rows]).max() + 1e-4, (block, rows)
    P, Q, own = (true_covariance(m, SPEC) for m in (on_its_nodes, engine, ours))
    for quantity in ("horizontal", "vertical", "velocity", "heading", "tilt"):
        # discretisation
        np.testing.assert_allclose(quantity_sigma(P, quantity), quantity_sigma(Q, quantity), rtol=5e-3)
        np.testing.assert_allclose(quantity_sigma(own, quantity)[-1], quantity_sigma(Q, quantity)[-1], rtol=2e-3)


def test_an_imu_that_does_not_turn_is_the_mission_itself():
    turning, *_ = prepared(True, True)
    still = turning.with_schedule(fixed())
    a, b = (true_covariance(m, SPEC) for m in (still, turning.fixed))
    # discretisation: 20 Hz samples of the budget against pieces of half a second
    np.testing.assert_allclose(
        *(np.sqrt(np.einsum("rii->ri", x)) for x in (a, b)), rtol=2e-3, atol=1e-9
    )  # fmt: skip


def test_accelerometer_bias_under_rotation_in_closed_form():
    """Position from ``b exp(i w t)``: ``(exp(i w t) - 1) / (i w)^2 - t / (i w)`` times the bias."""
    spec = ImuSpec("bias only", TriadSpec(random_walk=0.0), TriadSpec(random_walk=0.0, turn_on_bias=0.1))
    s = scenario()
    mission = linearised_mission(s.motion.build(), true_schedule(s.motion.build(), s), np.zeros(9), states=15)
    objective = scheme_objective(mission, s.motion.build(), spec, statistic="end")
    rate, T = 13.0 * DEG, 60.0
    gain = (np.exp(1j * rate * T) - 1.0) / (1j * rate) ** 2 - T / (1j * rate)
    # what is left out: Schuler's feedback, (w_s T)^2 / 12 = 5e-4, and Coriolis
    assert objective.of(continuous("z", rate)) == pytest.approx(0.1 * np.sqrt(2.0) * abs(gain), rel=5e-3)
    assert objective.of(fixed()) == pytest.approx(0.1 * np.sqrt(2.0) * 0.5 * T**2, rel=1e-3)


def test_scale_factor_about_the_axis_in_closed_form():
    """Heading error of a continuous rotation is ``K w T``; a whole reciprocation takes it off."""
    spec = ImuSpec("scale only", TriadSpec(random_walk=0.0, scale_factor=1e-3), TriadSpec(random_walk=0.0))
    s = scenario()
    mission = linearised_mission(s.motion.build(), true_schedule(s.motion.build(), s), np.zeros(9), states=15)
    objective = scheme_objective(mission, s.motion.build(), spec, quantity="heading", statistic="end")
    rate, T = 12.0 * DEG, 60.0
    # what is left out: the Earth's rate, 6e-4 of the platform's
    assert objective.of(continuous("z", rate)) == pytest.approx(1e-3 * rate * T, rel=1e-3)
    assert objective.of(reciprocating("z", rate)) < 1e-2 * 1e-3 * rate * T


def test_observability_as_an_objective_knows_what_the_thesis_found():
    """At rest with zero velocity: rotation about Y with pitch sees more than level Z rotation; both more than none."""
    rest = {"motion": {"type": "static", "lat_deg": 45.75, "lon_deg": 0.0, "duration_s": 120.0, "rpy_deg": (0, 30, 0)}}
    s = BudgetScenario.parse({**rest, "zero_velocity": {}, "start": {"attitude_deg": (1.0, 1.0, 1.0)}})
    objective = scheme_objective(prepare_budget(s), s.motion.build(), SPEC, quantity="observability")
    left = [objective.of(x) for x in (continuous("x", 10.0 * DEG), continuous("z", 10.0 * DEG), fixed())]
    assert left[0] < left[2]
    assert left[1] < left[2]


def test_statistics_of_the_objective():
    turning, motion, _ = prepared(True, True)
    turn = continuous("z", 20.0 * DEG)
    inside = scheme_objective(turning.fixed, motion, SPEC, in_outages=True)
    t, P = inside.over_time(turn)
    sigma = quantity_sigma(P, "horizontal")
    # rounding: the same replay, source by source and all together
    assert inside.of(turn) == pytest.approx(np.sqrt(np.mean(sigma[(t >= 20.0) & (t < 60.0)] ** 2)), rel=1e-6)
    largest = scheme_objective(turning.fixed, motion, SPEC, statistic="largest")
    assert largest.of(turn) == pytest.approx(sigma.max(), rel=1e-6)
    with pytest.raises(InputError, match="quantity"):
        scheme_objective(turning.fixed, motion, SPEC, quantity="roll")
    with pytest.raises(InputError, match="outages"):
        scheme_objective(prepared(True, False)[0].fixed, motion, SPEC, in_outages=True)
