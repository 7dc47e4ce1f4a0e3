"""Mechanization of a rotating IMU: both routes against the truth and each other, encoder errors, offsets."""

from itertools import product

import numpy as np
import pytest

from schuler import rotation
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import ImuSeries, Increments
from schuler.recording.trajectory import FullTrajectory
from schuler.rotary import schemes
from schuler.rotary.encoder import Encoder, EncoderReadings, read_encoder
from schuler.rotary.free_navigation import free_run, start_of
from schuler.rotary.mechanization import (
    body_increments,
    body_trajectory,
    mechanize_rotating,
    rates_at_limits,
    sensor_start,
)
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schedule import Schedule, stacked
from schuler.sensors.errors import ImuErrors
from schuler.simulation.motion import Motion, StaticMotion
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG, DEG_PER_HR

W = 10.0 * DEG
LLH = np.array([45.0 * DEG, 0.1, 100.0])
OFFSET = np.array([0.05, 0.03, -0.02])
REST = StaticMotion(LLH, np.array([0.1, -0.2, 0.3]), 60.0)
DRIVE = ManoeuvreMotion.of(
    [Manoeuvre(duration=10.0, speed=10.0), Manoeuvre(duration=10.0, turn=1.5),
     Manoeuvre(duration=20.0, turn=-3.0, speed=15.0), Manoeuvre(duration=20.0, turn=3.0)], LLH, bank=0.3,
)  # fmt: skip
SCHEDULES = {
    "X": schemes.continuous("y", W),
    "Y": schemes.continuous("x", -2.0 * W, acceleration=5.0 * DEG, start=5.003),
    "Z": schemes.continuous("-z", W),
    "reciprocating": schemes.reciprocating("y", 3.0 * W, acceleration=2.0 * W),
    "dual": schemes.dual_axis(8, dwell=2.0, rate=4.0 * W, acceleration=3.0 * W),
    "positions": schemes.dwell("z", 4, dwell=3.0, rate=3.0 * W),
    "cone": stacked(schemes.continuous("z", 7.0 * DEG), schemes.continuous("x", 11.0 * DEG)),
    "mounted": schemes.continuous("z", W).mounted(rotation.dcm_from_rpy([0.3, 0.2, 0.1])),
}


def recorded(vehicle: Motion, schedule: Schedule, offset=(0.0, 0.0, 0.0), rate_hz: float = 100.0) -> Increments:
    ideal = ideal_rotating_imu(RotatingMotion(vehicle, schedule, np.array(offset)), rate_hz)
    return ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()


def differences(a: FullTrajectory, b: FullTrajectory) -> tuple[float, float, float]:
    """Largest differences of position, velocity, attitude, as lengths."""
    turn = rotation.rotvec_from_quat(rotation.quat_multiply(a.q_eb, rotation.quat_conjugate(b.q_eb)))
    return tuple(float(np.linalg.norm(d, axis=1).max()) for d in (a.r_eb_e - b.r_eb_e, a.v_eb_e - b.v_eb_e, turn))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", SCHEDULES)
@pytest.mark.parametrize("vehicle", [REST, DRIVE], ids=["rest", "drive"])
def test_perfect_data_come_back_by_both_routes(name, vehicle):
    """60 s at 100 Hz. Discretisation: a log whose rate jumps within a sample (positions) is the worst."""
    schedule = SCHEDULES[name]
    inc = recorded(vehicle, schedule)
    true = vehicle_truth(RotatingMotion(vehicle, schedule), inc.t)
    limits = (3e-3, 2e-4, 1e-6) if name == "positions" else (1e-4, 2e-6, 5e-9)
    solved = [mechanize_rotating(inc, start_of(vehicle), schedule, route=route) for route in ("sensor", "body")]
    for one in solved:
        assert all(d < limit for d, limit in zip(differences(one, true), limits, strict=True))
    assert all(d < limit for d, limit in zip(differences(*solved), limits, strict=True))


@pytest.mark.parametrize(("route", "order"), [("sensor", 3.0), ("body", 4.0)])
def test_the_error_falls_with_a_power_of_the_interval(route, order):
    """Two axes at once, 60 and 45 deg/s, at 5, 10, 20 Hz: third order in turning axes, fourth in the vehicle's."""
    schedule = stacked(schemes.continuous("z", 60.0 * DEG), schemes.continuous("x", 45.0 * DEG))
    rest = StaticMotion(LLH, np.zeros(3), 20.0)
    errors = []
    for rate_hz in (5.0, 10.0, 20.0):
        inc = recorded(rest, schedule, rate_hz=rate_hz)
        true = vehicle_truth(RotatingMotion(rest, schedule), inc.t)
        errors.append(differences(mechanize_rotating(inc, start_of(rest), schedule, route=route), true)[1])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, order, atol=0.1)


def test_sensor_errors_act_alike_by_both_routes():
    """Biases and matrices in s: same errors of navigation to discretisation, and in both frames of integration."""
    errors = ImuErrors(
        b_g=np.array([30.0, -20.0, 10.0]) * DEG_PER_HR, b_a=[0.1, 0.2, -0.1],
        M_g=1e-3 * np.arange(9.0).reshape(3, 3), M_a=-1e-3 * np.arange(9.0).reshape(3, 3),
    )  # fmt: skip
    for schedule in (SCHEDULES["Z"], SCHEDULES["dual"]):
        one, two = (free_run(REST, schedule, errors, route=route) for route in ("sensor", "body"))
        assert np.abs(one.attitude).max() > 1e-3
        np.testing.assert_allclose(one.attitude, two.attitude, atol=1e-8)
        np.testing.assert_allclose(one.velocity, two.velocity, atol=2e-6)
        np.testing.assert_allclose(one.position, two.position, atol=1e-4)
    inc = recorded(REST, SCHEDULES["dual"])
    frames_ = [mechanize_rotating(inc, start_of(REST), SCHEDULES["dual"], frame=f) for f in ("ecef", "ned")]
    assert all(d < limit for d, limit in zip(differences(*frames_), (1e-4, 2e-6, 1e-9), strict=True))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("route", ["sensor", "body"])
@pytest.mark.parametrize("vehicle", [REST, DRIVE], ids=["rest", "drive"])
def test_a_known_offset_costs_nothing(route, vehicle):
    """100 deg/s, 6 cm: centripetal 0.19 m/s^2. Modelled, the body is navigated to discretisation."""
    schedule = schemes.continuous("z", 100.0 * DEG)
    inc = recorded(vehicle, schedule, OFFSET)
    true = vehicle_truth(RotatingMotion(vehicle, schedule), inc.t)
    solved = mechanize_rotating(inc, start_of(vehicle), schedule, route=route, offset_m=OFFSET)
    r, v, att = differences(solved, true)
    assert r < 2e-3
    assert v < 5e-5
    assert att < 2e-8


def test_an_unmodelled_offset_shows_its_closed_form():
    """Taken as zero: velocity is off by the change of omega x l since the start, position by its integral.

    The start in full motion is given as rest: ``dr = C l - l - t (omega x l)(0)``. Not in the closed form is Coriolis:
    2 W sin(lat) v t^2 / 2 = 0.033 m of the 10 m that gather, 0.001 m/s.
    """
    rate, offset = 20.0 * DEG, np.array([0.5, 0.0, 0.0])
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    run = free_run(
        rest, schemes.continuous("z", rate), ImuErrors.none(), offset_m=offset, modelled_offset_m=np.zeros(3)
    )
    c, s, v0 = np.cos(rate * run.t), np.sin(rate * run.t), rate * 0.5
    north, east = 0.5 * (c - 1.0), 0.5 * s - v0 * run.t
    assert np.abs(east).max() > 9.0
    np.testing.assert_allclose(run.position[:, 0], east, atol=0.035)
    np.testing.assert_allclose(run.position[:, 1], north, atol=0.035)
    np.testing.assert_allclose(run.velocity[:, 0], v0 * (c - 1.0), atol=1.2e-3)
    modelled = free_run(rest, schemes.continuous("z", rate), ImuErrors.none(), offset_m=offset)
    assert modelled.horizontal.max() < 1e-4 * np.abs(east).max()


def test_a_filter_in_imu_axes_starts_and_ends_with_the_same_lever():
    """sensor_start and body_trajectory undo each other; the platform's rate stands for a body at rest. Rounding."""
    schedule = SCHEDULES["cone"]
    body = NavState.from_geodetic(3.0, LLH, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3))
    motion = RotatingMotion(StaticMotion(LLH, np.array([0.1, 0.2, 0.3]), 10.0), schedule, OFFSET)
    s = motion.state(np.array([3.0]))
    start = sensor_start(body, schedule, OFFSET)
    np.testing.assert_allclose(start.r_eb_e, s.r_eb_e[0], atol=2e-9)
    np.testing.assert_allclose(start.v_eb_e, s.v_eb_e[0], atol=1e-15)
    np.testing.assert_allclose(rotation.dcm_from_quat(start.q_eb), s.C_eb[0], atol=1e-15)
    one = FullTrajectory([3.0], start.r_eb_e[None], start.v_eb_e[None], start.q_eb[None])
    back = body_trajectory(one, schedule, OFFSET, schedule.omega_bs_s([3.0]), earth_rotation=False)
    np.testing.assert_allclose(back.v_eb_e, 0.0, atol=1e-15)
    np.testing.assert_allclose(back.r_eb_e[0], body.r_eb_e, atol=2e-9)


def test_an_encoder_of_fifty_hertz_is_enough_at_a_constant_rate():
    """Linear interpolation to 100 Hz of a constant rate is exact: both routes as with the true schedule; rounding."""
    for route in ("sensor", "body"):
        inc = recorded(REST, SCHEDULES["Z"])
        read = read_encoder(SCHEDULES["Z"], Encoder(), 60.0)
        a, b = (mechanize_rotating(inc, start_of(REST), p, route=route) for p in (SCHEDULES["Z"], read))
        assert all(d < limit for d, limit in zip(differences(a, b), (1e-6, 1e-8, 1e-11), strict=True))


def test_coarse_counts_do_not_spoil_the_sensor_route_but_for_the_angle_itself():
    """Counts of 0.5 deg: the sensor route's attitude is off by the count now and then, its velocity not at all.

    The body route takes off differences of counts, whose sum is the angle again: no drift, an error of one count.
    """
    schedule, count = SCHEDULES["Z"], 0.5 * DEG
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    inc = recorded(rest, schedule)
    true = vehicle_truth(RotatingMotion(rest, schedule), inc.t)
    read = read_encoder(schedule, Encoder(resolution=count), 60.0)
    sensor, body = (mechanize_rotating(inc, start_of(rest), read, route=r) for r in ("sensor", "body"))
    assert differences(sensor, true)[1] < 1e-6  # level Z: an error of the start about the force's axis does nothing
    assert differences(sensor, true)[2] < 1.01 * count
    assert differences(body, true)[2] < 1.01 * count


def test_a_zero_offset_about_the_vertical_gives_no_velocity_but_a_tilted_one_does():
    """Du, section 2.4: level static Z rotation is blind to the angle error, but for Earth rate, which it misplaces.

    ``g W cos(lat) dtheta t^2 / 2 = 1.6e-3 m/s``. About X the error tilts the IMU: ``g dtheta t = 1.03 m/s``.
    """
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    off = 0.1 * DEG
    for name, route in product("ZX", ("sensor", "body")):
        schedule = SCHEDULES[name]
        inc = recorded(rest, schedule)
        true = vehicle_truth(RotatingMotion(rest, schedule), inc.t)
        read = read_encoder(schedule, Encoder(zero_offset=off), 60.0)
        error = differences(mechanize_rotating(inc, start_of(rest), read, route=route), true)[1]
        if name == "Z":
            assert error == pytest.approx(9.806 * 7.292e-5 * np.cos(LLH[0]) * off * 60.0**2 / 2.0, rel=0.02)
        else:
            assert error == pytest.approx(9.806 * off * 60.0, rel=0.01)  # g dtheta t, less Schuler feedback 1e-3


def test_commanded_rates_beside_measured_angles():
    """A rate wrong by 1 deg/h drifts 1 deg/h about the axis by the body route; the sensor route never sees it."""
    rest, drift = StaticMotion(LLH, np.zeros(3), 60.0), 1.0 * DEG_PER_HR
    inc = recorded(rest, SCHEDULES["Z"])
    true = vehicle_truth(RotatingMotion(rest, SCHEDULES["Z"]), inc.t)
    wrong = schemes.continuous("-z", W + drift)
    solved = mechanize_rotating(inc, start_of(rest), SCHEDULES["Z"], route="body", rate_platform=wrong)
    assert differences(solved, true)[2] == pytest.approx(drift * 60.0, rel=1e-3)
    same = mechanize_rotating(inc, start_of(rest), SCHEDULES["Z"], route="body", rate_platform=SCHEDULES["Z"])
    assert differences(same, true)[2] < 1e-10


def test_without_rotation_it_is_the_strapdown():
    inc = recorded(DRIVE, schemes.fixed())
    plain = mechanize(inc, start_of(DRIVE))
    sensor, body = (mechanize_rotating(inc, start_of(DRIVE), schemes.fixed(), route=r) for r in ("sensor", "body"))
    for one in (sensor, body):
        assert all(d < limit for d, limit in zip(differences(one, plain), (1e-7, 1e-8, 1e-12), strict=True))


def test_turned_increments_of_uneven_intervals():
    """Quadratic output in s over random intervals is turned exactly but for the quadrature: 1e-12 at 10 deg/s."""
    rng = np.random.default_rng(3)
    limits = np.concatenate(([0.0], np.cumsum(rng.uniform(0.005, 0.02, 40))))
    p = [np.polynomial.Polynomial(rng.normal(size=3)) for _ in range(6)]
    sums = np.stack([q.integ()(limits) for q in p], axis=1)
    inc = Increments(limits[1:], np.diff(limits), np.diff(sums[:, :3], axis=0), np.diff(sums[:, 3:], axis=0))
    schedule = schemes.continuous([0.0, 3.0, 4.0], 30.0 * DEG)
    turned = body_increments(inc, schedule)
    x, w = np.polynomial.legendre.leggauss(12)
    at = limits[:-1, None] + 0.5 * np.diff(limits)[:, None] * (1.0 + x)
    C = schedule.C_bs(at.ravel())
    for part, result in ((p[:3], turned.dtheta_ib_b), (p[3:], turned.dv_ib_b)):
        value = np.einsum("nij,nj->ni", C, np.stack([q(at.ravel()) for q in part], axis=1)).reshape(-1, 12, 3)
        exact = np.einsum("k,nki->ni", w, value) * 0.5 * np.diff(limits)[:, None]
        if part == p[:3]:
            exact -= np.diff(limits)[:, None] * 30.0 * DEG * np.array([0.0, 0.6, 0.8])
        np.testing.assert_allclose(result, exact, atol=1e-12)


def test_rates_at_limits_of_a_parabola():
    """Exact for rates linear in time, also at both ends and over uneven intervals; rounding."""
    limits = np.array([0.0, 0.1, 0.25, 0.3, 0.5])
    summed = np.outer(2.0 * limits + 1.5 * limits**2, [1.0, -1.0, 0.5])
    inc = Increments(limits[1:], np.diff(limits), np.diff(summed, axis=0), np.zeros((4, 3)))
    np.testing.assert_allclose(rates_at_limits(inc), np.outer(2.0 + 3.0 * limits, [1.0, -1.0, 0.5]), atol=1e-13)


def test_wrong_input_is_refused_in_words():
    inc, schedule = recorded(REST, SCHEDULES["Z"], rate_hz=10.0), SCHEDULES["Z"]
    start = start_of(REST)
    with pytest.raises(InputError, match="route: expected"):
        mechanize_rotating(inc, start, schedule, route="encoder")
    with pytest.raises(InputError, match="at least three intervals"):
        mechanize_rotating(inc.between(0.0, 0.2), start, schedule)
    with pytest.raises(InputError, match="encoder log covers"):
        mechanize_rotating(inc, start, EncoderReadings([0.0, 0.5], [[0.0], [0.1]], schedule.axes))
    q = np.array([[1.0, 0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="pass omega_is_s"):
        body_trajectory(FullTrajectory([0.0], start.r_eb_e[None], start.v_eb_e[None], q), schedule, OFFSET)
