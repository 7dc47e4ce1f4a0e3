"""Motion and what an ideal IMU senses of it: closed forms, consistent derivatives, exact integrals."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.simulation import motion as motion_module
from schuler.simulation.motion import (
    LocalMotion,
    StaticMotion,
    coning_motion,
    euler_attitude,
    geodetic_state,
    ideal_increments,
    ideal_rates,
    inertial_quantities,
)
from schuler.simulation.profiles import SplineMotion

EPS = np.finfo(float).eps
PI = np.pi
DEG = PI / 180.0
OMEGA_IE = 7.292115e-5
MUNICH = np.array([48.0 * DEG, 11.0 * DEG, 500.0])
PLACES = {
    "Munich": MUNICH,
    "equator": np.array([0.0, 0.0, 0.0]),
    "southern hemisphere": np.array([-33.9 * DEG, 151.2 * DEG, 20.0]),
    "antimeridian": np.array([-17.0 * DEG, PI, 0.0]),
    "north pole": np.array([PI / 2, 0.0, 0.0]),
    "south pole": np.array([-PI / 2, 0.0, 2800.0]),
}


def derivative(function, t, step):
    """Five-point central difference, error of order step^4."""
    return (8.0 * (function(t + step) - function(t - step)) - (function(t + 2 * step) - function(t - 2 * step))) / (
        12.0 * step
    )


# --------------------------------------------------------------------------------------------- motions


def still(t):
    zero = np.zeros((len(t), 3))
    return zero, zero, zero


def circle(radius, rate):
    """North-east circle, clockwise seen from above, that starts north of the centre going east."""

    def path(t):
        c, s, zero = np.cos(rate * t), np.sin(rate * t), np.zeros_like(t)
        r = radius * np.stack((c, s, zero), axis=-1)
        v = radius * rate * np.stack((-s, c, zero), axis=-1)
        return r, v, -(rate**2) * r

    return path


def heading_along(rate):
    """Level, the nose along the velocity of :func:`circle`."""

    def angles(t):
        zero = np.zeros_like(t)
        return np.stack((zero, zero, 0.5 * PI + rate * t), axis=-1), np.stack((zero, zero, zero + rate), axis=-1)

    return euler_attitude(angles)


def wild_path(t):
    r = np.stack((300.0 * np.sin(0.31 * t), 40.0 * t + 20.0 * np.cos(0.7 * t), -15.0 * np.sin(1.1 * t)), axis=-1)
    v = np.stack((93.0 * np.cos(0.31 * t), 40.0 - 14.0 * np.sin(0.7 * t), -16.5 * np.cos(1.1 * t)), axis=-1)
    a = np.stack((-28.83 * np.sin(0.31 * t), -9.8 * np.cos(0.7 * t), 18.15 * np.sin(1.1 * t)), axis=-1)
    return r, v, a


def wild_angles(t):
    rpy = np.stack((0.8 * np.sin(0.9 * t), 0.4 * np.cos(0.5 * t), 0.6 * t), axis=-1)
    rate = np.stack((0.72 * np.cos(0.9 * t), -0.2 * np.sin(0.5 * t), 0.6 + 0.0 * t), axis=-1)
    return rpy, rate


def wild(origin=MUNICH):
    return LocalMotion(origin, wild_path, euler_attitude(wild_angles), 60.0)


def flight(crossing=False, seed=3):
    """A winding flight through nodes every five seconds; ``crossing`` puts the antimeridian in its middle."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 121.0, 5.0)
    east = 0.002 * np.linspace(-1.0, 1.0, len(t)) + 2e-5 * rng.standard_normal(len(t))
    lon = PI + east if crossing else 0.2 + east
    lat = 0.7 + 1e-4 * np.cumsum(rng.standard_normal(len(t)))
    llh = np.stack((lat, np.arctan2(np.sin(lon), np.cos(lon)), 1000.0 + 30.0 * rng.standard_normal(len(t))), axis=-1)
    yaw = PI - 0.3 + np.cumsum(0.3 * rng.standard_normal(len(t)))  # wanders across south, where atan2 jumps
    rpy = np.stack((0.4 * rng.standard_normal(len(t)), 0.2 * rng.standard_normal(len(t)), yaw), axis=-1)
    rpy[:, 2] = np.arctan2(np.sin(yaw), np.cos(yaw))
    return SplineMotion.through(t, llh, rpy), t, llh, rpy


MOVING = {
    "spline": lambda: flight()[0],
    "spline across the antimeridian": lambda: flight(crossing=True)[0],
    "closed form": wild,
    "closed form at the pole": lambda: wild(PLACES["north pole"]),
    "circle": lambda: LocalMotion(MUNICH, circle(100.0, 0.2), heading_along(0.2), 60.0),
    "coning": lambda: coning_motion(MUNICH, 0.1, 3.0, 60.0),
}


@pytest.fixture(params=list(MOVING))
def moving(request):
    return MOVING[request.param]()


# ---------------------------------------------------------------------------------------------- at rest


@pytest.mark.parametrize("place", list(PLACES))
def test_a_level_body_at_rest_feels_minus_gravity_and_the_earth_rate(place):
    """``f = (0, 0, -g)`` level and north; the gyros read ``omega_ie (cos L, 0, -sin L)``; also at the poles."""
    llh = PLACES[place]
    omega, f = ideal_rates(StaticMotion(llh, np.zeros(3), 10.0), [0.0, 3.0, 10.0])
    for k in range(3):
        np.testing.assert_allclose(omega[k], OMEGA_IE * np.array([np.cos(llh[0]), 0.0, -np.sin(llh[0])]), atol=1e-19)
        np.testing.assert_allclose(f[k], -earth.gravity_ned(llh[0], llh[2]), rtol=0, atol=2e-14)  # rounding
        assert f[k, 2] == pytest.approx(-earth.gravity_somigliana(llh[0], llh[2]), abs=2e-7)  # its height series


def test_a_body_at_the_north_pole_by_hand():
    """9.8321849 m/s^2 down and one turn a day about up: minus about the down axis."""
    omega, f = ideal_rates(StaticMotion(PLACES["north pole"], np.zeros(3), 1.0), [0.0])
    np.testing.assert_allclose(f[0], [0.0, 0.0, -9.8321849378], rtol=0, atol=2e-9)  # truncation of the zonals
    np.testing.assert_allclose(omega[0], [0.0, 0.0, -OMEGA_IE], rtol=0, atol=1e-19)


@pytest.mark.parametrize("place", list(PLACES))
def test_attitude_turns_what_a_resting_body_feels(place, rng):
    llh = PLACES[place]
    for rpy in rng.uniform(-1.5, 1.5, (10, 3)):
        omega, f = ideal_rates(StaticMotion(llh, rpy, 1.0), [0.5])
        C_nb = rotation.dcm_from_rpy(rpy)
        np.testing.assert_allclose(f[0], -C_nb.T @ earth.gravity_ned(llh[0], llh[2]), rtol=0, atol=2e-14)  # rounding
        np.testing.assert_allclose(omega[0], C_nb.T @ earth.earth_rate_ned(llh[0]), rtol=0, atol=1e-19)  # rounding


def test_signs_of_a_tilted_body_by_hand():
    """Nose up: the x accelerometer reads plus. Right wing down: the y accelerometer reads minus."""
    up = ideal_rates(StaticMotion(MUNICH, np.array([0.0, 0.1, 0.0]), 1.0), [0.0])[1][0]
    right = ideal_rates(StaticMotion(MUNICH, np.array([0.1, 0.0, 0.0]), 1.0), [0.0])[1][0]
    g = float(earth.gravity_ned(MUNICH[0], MUNICH[2])[2])
    np.testing.assert_allclose(
        up, [g * np.sin(0.1), 0.0, -g * np.cos(0.1)], rtol=0, atol=5e-6
    )  # north gravity at height
    np.testing.assert_allclose(right, [0.0, -g * np.sin(0.1), -g * np.cos(0.1)], rtol=0, atol=5e-6)


@pytest.mark.parametrize("place", list(PLACES))
def test_the_state_of_a_body_at_rest(place):
    llh, rpy = PLACES[place], np.array([0.1, -0.2, 0.3])
    state = StaticMotion(llh, rpy, 5.0).state(np.array([0.0, 5.0]))
    np.testing.assert_allclose(state.llh[:, [0, 2]], np.tile(llh[[0, 2]], (2, 1)), rtol=0, atol=4e-9)  # rounding
    assert np.all(state.v_eb_n == 0.0)
    assert np.all(state.a_eb_e == 0.0)
    assert np.all(state.omega_eb_b == 0.0)
    np.testing.assert_allclose(rotation.dcm_from_quat(state.q_eb), state.C_eb, rtol=0, atol=8 * EPS)  # rounding
    np.testing.assert_allclose(frames.C_en(state.llh) @ state.C_nb, state.C_eb, rtol=0, atol=8 * EPS)  # rounding
    np.testing.assert_allclose(state.rpy_nb[0], rpy, rtol=0, atol=16 * EPS)  # rounding; longitude 0 at the poles


def test_increments_at_rest_are_rates_times_the_interval():
    static = StaticMotion(MUNICH, np.array([0.3, -0.1, 2.0]), 10.0)
    t = np.array([0.0, 0.01, 0.5, 10.0])
    omega, f = ideal_rates(static, t[1:])
    dtheta, dv = ideal_increments(static, t)
    np.testing.assert_allclose(dtheta, omega * np.diff(t)[:, None], rtol=1e-14)  # rounding
    np.testing.assert_allclose(dv, f * np.diff(t)[:, None], rtol=1e-14)  # rounding


# ---------------------------------------------------------------------------------- closed forms of motion


def test_circular_motion_feels_the_centripetal_acceleration():
    """20 m/s round 100 m, clockwise: 4 m/s^2 to the right, yaw rate +0.2 rad/s; on an Earth that stands still."""
    motion = LocalMotion(MUNICH, circle(100.0, 0.2), heading_along(0.2), 60.0)
    t = np.linspace(0.0, 60.0, 50)
    omega, f = ideal_rates(motion, t, earth_rotation=False)
    np.testing.assert_allclose(omega, np.tile([0.0, 0.0, 0.2], (50, 1)), rtol=0, atol=4 * EPS)  # rounding
    state = motion.state(t)
    gravity = np.einsum("nji,nj->ni", state.C_eb, earth.gravity_ecef(state.r_eb_e))
    np.testing.assert_allclose(f + gravity, np.tile([0.0, 4.0, 0.0], (50, 1)), rtol=0, atol=1e-13)  # rounding
    # gravity leans by 100 m / R = 1.6e-5 rad across the circle
    g = float(earth.gravity_ned(MUNICH[0], MUNICH[2])[2])
    np.testing.assert_allclose(f, np.tile([0.0, 4.0, -g], (50, 1)), rtol=0, atol=2e-4)


def test_circular_motion_feels_the_coriolis_acceleration():
    """Going east at the start, keeping to the path takes ``2 omega x v = 2 omega v (sin L, 0, cos L)`` more."""
    motion = LocalMotion(MUNICH, circle(100.0, 0.2), heading_along(0.2), 60.0)
    with_earth, without = (ideal_rates(motion, [0.0], earth_rotation=flag) for flag in (True, False))
    L, v = MUNICH[0], 20.0
    f_n = rotation.dcm_from_rpy([0.0, 0.0, PI / 2]) @ (with_earth[1] - without[1])[0]
    expected = 2.0 * OMEGA_IE * v * np.array([np.sin(L), 0.0, np.cos(L)])
    np.testing.assert_allclose(f_n, expected, rtol=0, atol=1e-14)  # rounding
    np.testing.assert_allclose(
        with_earth[0] - without[0], [OMEGA_IE * np.array([0.0, -np.cos(L), -np.sin(L)])], rtol=0, atol=1e-16
    )  # east is forward, so north is on the left


@pytest.mark.parametrize("speed", [250.0, -250.0, 465.1])
def test_eotvos_effect_along_the_equator(speed):
    """Level flight due east at the equator: ``f_up = g - 2 omega v - v^2 / (a + h)``, nothing sideways."""
    h = 10_000.0
    t = np.linspace(0.0, 100.0, 11)
    llh = np.stack((np.zeros(11), -0.1 + speed / (earth.WGS84.a + h) * t, np.full(11, h)), axis=-1)
    motion = SplineMotion.through(t, llh, np.tile([0.0, 0.0, np.copysign(PI / 2, speed)], (11, 1)))
    omega, f = ideal_rates(motion, [0.0, 33.3, 100.0])
    g = float(earth.gravity_ned(0.0, h)[2])
    up = g - 2.0 * OMEGA_IE * speed - speed**2 / (earth.WGS84.a + h)
    np.testing.assert_allclose(f, np.tile([0.0, 0.0, -up], (3, 1)), rtol=0, atol=1e-8)  # rounding of the spline's nodes
    turn = OMEGA_IE + speed / (earth.WGS84.a + h)  # about north: left of an eastbound body, right of a westbound one
    np.testing.assert_allclose(omega, np.tile([0.0, -np.copysign(turn, speed), 0.0], (3, 1)), rtol=0, atol=1e-12)


def test_a_flight_along_a_meridian():
    """Due north: the arc takes ``v^2 / R_N`` off the weight, the meridian turns west: ``2 omega v sin L`` that way."""
    t, speed = np.linspace(0.0, 100.0, 11), 200.0
    R_N, _ = earth.radii_of_curvature(MUNICH[0])
    lat_rate = speed / (R_N + 500.0)
    llh = np.stack((MUNICH[0] + lat_rate * (t - 50.0), np.full(11, 0.2), np.full(11, 500.0)), axis=-1)
    omega, f = ideal_rates(SplineMotion.through(t, llh, np.zeros((11, 3))), [50.0])
    gravity, L = earth.gravity_ned(MUNICH[0], 500.0), MUNICH[0]
    # dR_N/dL = 3 e^2 R_N sin L cos L / (1 - e^2 sin^2 L) makes the speed grow a little
    e2 = earth.WGS84.e2
    grows = 3.0 * e2 * np.sin(L) * np.cos(L) / (1.0 - e2 * np.sin(L) ** 2) * R_N * lat_rate**2
    expected = [grows - gravity[0], -2.0 * OMEGA_IE * speed * np.sin(L), speed**2 / (R_N + 500.0) - gravity[2]]
    np.testing.assert_allclose(f[0], expected, rtol=0, atol=1e-8)  # rounding of the spline's nodes
    np.testing.assert_allclose(omega[0], [OMEGA_IE * np.cos(L), -lat_rate, -OMEGA_IE * np.sin(L)], rtol=0, atol=1e-12)


@pytest.mark.parametrize("half_angle", [1e-6, 0.01, 0.5, 2.0])
@pytest.mark.parametrize("rate", [3.0, -20.0])
def test_coning_has_a_constant_axial_rate(half_angle, rate):
    """``-2 w sin^2(a / 2)`` about z, though the body never turns about z; across it the rate has size w sin a."""
    motion = coning_motion(MUNICH, half_angle, rate, 10.0)
    t = np.linspace(0.0, 10.0, 101)
    omega, f = ideal_rates(motion, t, earth_rotation=False)
    np.testing.assert_allclose(omega[:, 2], -2.0 * rate * np.sin(0.5 * half_angle) ** 2, rtol=1e-14)  # rounding
    size = np.hypot(omega[:, 0], omega[:, 1])
    np.testing.assert_allclose(size, abs(rate) * np.sin(half_angle), rtol=1e-13)  # rounding
    z_n = motion.state(t).C_nb[:, :, 2]
    np.testing.assert_allclose(z_n[:, 2], np.cos(half_angle), rtol=0, atol=1e-14)  # the axis keeps to its cone
    np.testing.assert_allclose(
        np.linalg.norm(f, axis=1), np.linalg.norm(earth.gravity_ned(MUNICH[0], 500.0)), rtol=1e-14
    )


def test_coning_mean_rate_over_whole_turns_is_all_axial():
    """What the gyros integrate over a turn of the cone: nothing across, ``-2 w sin^2(a / 2) T`` along."""
    a, w = 0.02, 2.0 * PI * 5.0
    dtheta, _ = ideal_increments(coning_motion(MUNICH, a, w, 1.0), np.linspace(0.0, 1.0, 101), earth_rotation=False)
    np.testing.assert_allclose(dtheta.sum(axis=0), [0.0, 0.0, -2.0 * w * np.sin(a / 2) ** 2], rtol=0, atol=1e-12)


def test_coning_about_another_attitude(rng):
    C_0 = rotation.dcm_from_rotvec(rng.standard_normal(3))
    plain, turned = coning_motion(MUNICH, 0.3, 2.0, 5.0), coning_motion(MUNICH, 0.3, 2.0, 5.0, origin_attitude=C_0)
    t = np.linspace(0.0, 5.0, 7)
    np.testing.assert_allclose(turned.state(t).C_nb, C_0 @ plain.state(t).C_nb, rtol=0, atol=16 * EPS)  # rounding
    np.testing.assert_array_equal(turned.state(t).omega_eb_b, plain.state(t).omega_eb_b)
    with pytest.raises(InputError, match=r"origin_attitude: expected shape \(3, 3\)"):
        coning_motion(MUNICH, 0.3, 2.0, 5.0, origin_attitude=[1.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"llh: expected shape \(3,\)"):
        coning_motion([0.1, 0.2], 0.3, 2.0, 5.0)


# -------------------------------------------------------------------------------- derivatives are consistent


def test_velocity_acceleration_and_rate_are_the_derivatives_they_say(moving):
    """``r' = v``, ``v' = a``, ``C_eb' = C_eb [omega_eb_b x]``, at random times and at the ends of the motion's span."""
    step = 0.02
    times = np.concatenate((np.random.default_rng(5).uniform(1.0, moving.duration - 1.0, 40), [2 * step]))
    for time in times:
        t = np.array([time])
        state = moving.state(t)
        # rounding of r, 1e-9 m, over the step; discretisation: step^4 / 30 of the fifth derivative
        r_dot = derivative(lambda t: moving.state(t).r_eb_e, t, step)
        np.testing.assert_allclose(r_dot, state.v_eb_e, rtol=0, atol=5e-6)
        # rounding of v, 2e-14 m/s, over the step
        v_dot = derivative(lambda t: moving.state(t).v_eb_e, t, step)
        np.testing.assert_allclose(v_dot, state.a_eb_e, rtol=0, atol=5e-6)
        C_dot = derivative(lambda t: moving.state(t).C_eb, t, step)
        np.testing.assert_allclose(C_dot, state.C_eb @ rotation.skew(state.omega_eb_b), rtol=0, atol=2e-6)


def test_attitudes_of_a_motion_are_rotations(moving):
    C = moving.state(np.linspace(0.0, moving.duration, 200)).C_eb
    np.testing.assert_allclose(C @ np.swapaxes(C, 1, 2), np.broadcast_to(np.eye(3), C.shape), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(C), 1.0, rtol=0, atol=1e-14)  # rounding


def test_a_motion_asked_for_many_times_is_a_loop(moving):
    t = np.random.default_rng(1).uniform(0.0, moving.duration, 20)
    state = moving.state(t)
    assert state.t is t
    for name in ("r_eb_e", "v_eb_e", "a_eb_e", "C_eb", "omega_eb_b"):
        many = getattr(state, name)
        one = np.concatenate([getattr(moving.state(t[k : k + 1]), name) for k in range(20)])
        np.testing.assert_allclose(many, one, rtol=1e-12, atol=4e-9 if name == "r_eb_e" else 1e-13)  # rounding


def test_geodetic_state_agrees_with_numerical_derivatives():
    """Large rates, so that a wrong term of the derivatives of the radii would show."""

    def llh(t):
        return np.stack(
            (0.6 + 0.02 * t + 0.003 * np.sin(t), 1.0 + 0.05 * t + 0.01 * t**2, 2e4 + 3e3 * np.cos(t)), axis=-1
        )

    def llh_rate(t):
        return np.stack((0.02 + 0.003 * np.cos(t), 0.05 + 0.02 * t, -3e3 * np.sin(t)), axis=-1)

    def llh_accel(t):
        return np.stack((-0.003 * np.sin(t), 0.02 + 0.0 * t, -3e3 * np.cos(t)), axis=-1)

    def state(t):
        return geodetic_state(t, llh(t), llh_rate(t), llh_accel(t), *wild_angles(t))

    for time in np.linspace(-2.0, 2.0, 9):
        t = np.array([time])
        s = state(t)
        # discretisation, relative to 4e5 m/s and 1e5 m/s^2
        np.testing.assert_allclose(derivative(lambda t: state(t).r_eb_e, t, 1e-2), s.v_eb_e, rtol=0, atol=2e-3)
        np.testing.assert_allclose(derivative(lambda t: state(t).v_eb_e, t, 1e-2), s.a_eb_e, rtol=0, atol=2e-3)
        C_dot = derivative(lambda t: state(t).C_eb, t, 1e-2)
        np.testing.assert_allclose(C_dot, s.C_eb @ rotation.skew(s.omega_eb_b), rtol=0, atol=1e-8)
        np.testing.assert_allclose(s.llh[0, 1:], llh(t)[0, 1:], rtol=0, atol=4e-9)
        np.testing.assert_allclose(s.rpy_nb[0, :2], wild_angles(t)[0][0, :2], rtol=0, atol=1e-14)


# -------------------------------------------------------------------------------------------- splines


@pytest.mark.parametrize("crossing", [False, True])
def test_splines_pass_their_nodes(crossing):
    motion, t, llh, rpy = flight(crossing)
    state = motion.state(t)
    assert motion.duration == t[-1]
    np.testing.assert_allclose(state.llh[:, [0, 2]], llh[:, [0, 2]], rtol=0, atol=1e-8)  # rounding
    for k, angles in ((1, state.llh), (2, state.rpy_nb)):
        expected = llh[:, 1] if k == 1 else rpy[:, 2]
        np.testing.assert_allclose(np.sin(0.5 * (angles[:, k] - expected)), 0.0, rtol=0, atol=1e-14)  # modulo a turn
    np.testing.assert_allclose(state.rpy_nb[:, :2], rpy[:, :2], rtol=0, atol=1e-13)  # rounding


def test_crossing_the_antimeridian_is_nothing_special():
    """The same flight elsewhere gives the same specific force and angular rate."""
    here, there = flight(crossing=False)[0], flight(crossing=True)[0]
    lon = flight(crossing=True)[0].state(np.linspace(0, 120, 50)).llh[:, 1]
    assert lon.max() > 3.1  # it does cross
    assert lon.min() < -3.1
    t = np.linspace(0.0, 120.0, 500)
    for a, b in zip(ideal_rates(here, t), ideal_rates(there, t), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-7)  # rounding of pi + 0.002 in the nodes, over 25 s^2
    speed = np.linalg.norm(there.state(t).v_eb_e, axis=1)
    assert speed.max() < 1000.0  # nobody flew round the Earth


@pytest.mark.parametrize("rate", [0.2, -0.2])
def test_yaw_goes_the_short_way_round(rate):
    """A steady turn through south, where yaw jumps from +180 to -180 deg, is a steady turn."""
    t = np.arange(0.0, 41.0, 2.0)
    yaw = 2.0 + rate * t
    rpy = np.stack((0.0 * t, 0.0 * t, np.arctan2(np.sin(yaw), np.cos(yaw))), axis=-1)
    assert np.ptp(np.diff(rpy[:, 2])) > 6.0  # there is a jump in the nodes
    motion = SplineMotion.through(t, np.tile(MUNICH, (len(t), 1)), rpy)
    omega, f = ideal_rates(motion, np.linspace(0.0, 40.0, 200), earth_rotation=False)
    np.testing.assert_allclose(omega, np.tile([0.0, 0.0, rate], (200, 1)), rtol=0, atol=1e-12)  # rounding
    np.testing.assert_allclose(f[:, 2], -earth.gravity_ned(MUNICH[0], MUNICH[2])[2], rtol=0, atol=1e-13)  # rounding


def test_splines_are_smooth_at_their_nodes():
    """Four times continuously differentiable: the jerk does not jump at a node, nor does its slope."""
    motion, t, _, _ = flight()
    for node in t[4:-4]:
        for order, step, bound in ((1, 1e-2, 1e-6), (2, 1e-2, 1e-4)):
            sides = []
            for side in (-1.0, 1.0):
                at = node + side * step * np.arange(6)
                sides.append(
                    np.polynomial.polynomial.polyfit(side * step * np.arange(6), motion.state(at).a_eb_e, 5)[order]
                )
            np.testing.assert_allclose(sides[0], sides[1], rtol=0, atol=bound * 100.0)


def test_quintic_nodes_are_reproduced_exactly():
    """A longitude and a height that are polynomials of degree five come back between the nodes as well."""
    t = np.linspace(0.0, 10.0, 12)
    x = np.linspace(0.0, 10.0, 101)

    def lon(t):
        return 1e-4 * t + 1e-6 * t**2 - 1e-9 * t**5

    def height(t):
        return 100.0 + 3.0 * t - 0.2 * t**3 + 0.001 * t**5

    motion = SplineMotion.through(t, np.stack((0.0 * t, lon(t), height(t)), axis=-1), np.zeros((12, 3)))
    back = motion.state(x).llh
    np.testing.assert_allclose(back[:, 1], lon(x), rtol=0, atol=1e-14)  # rounding
    np.testing.assert_allclose(back[:, 2], height(x), rtol=0, atol=1e-8)  # rounding


@pytest.mark.parametrize(
    ("t", "llh", "message"),
    [
        (np.arange(5.0), np.zeros((5, 3)), "at least six increasing times that start at 0"),
        (np.arange(1.0, 8.0), np.zeros((7, 3)), "start at 0"),
        ([0.0, 1, 2, 2, 3, 4, 5], np.zeros((7, 3)), "increasing"),
        (np.arange(7.0), np.zeros((6, 3)), r"llh: expected shape \(7, 3\), got \(6, 3\)"),
        (np.arange(7.0), np.full((7, 3), np.nan), "llh: expected finite numbers"),
    ],
)
def test_splines_refuse_nodes_they_cannot_use(t, llh, message):
    with pytest.raises(InputError, match=message):
        SplineMotion.through(t, llh, np.zeros((len(t), 3)))


def test_nodes_are_not_changed_by_unwrapping():
    t = np.arange(7.0)
    llh = np.stack((np.zeros(7), np.array([3.0, 3.1, -3.1, -3.0, -2.9, -2.8, -2.7]), np.zeros(7)), axis=-1)
    rpy = np.stack((np.zeros(7), np.zeros(7), llh[:, 1]), axis=-1)
    kept = llh.copy(), rpy.copy()
    SplineMotion.through(t, llh, rpy)
    np.testing.assert_array_equal(llh, kept[0])
    np.testing.assert_array_equal(rpy, kept[1])


# ------------------------------------------------------------------------------------ inertial quantities


def test_switching_the_earth_off_removes_exactly_earth_rate_and_coriolis(moving):
    state = moving.state(np.linspace(0.0, moving.duration, 100))
    omega_1, f_1 = inertial_quantities(state)
    omega_0, f_0 = inertial_quantities(state, earth_rotation=False)
    np.testing.assert_array_equal(omega_0, state.omega_eb_b)
    C_be, omega_ie = np.swapaxes(state.C_eb, 1, 2), np.array([0.0, 0.0, OMEGA_IE])
    np.testing.assert_allclose(omega_1 - omega_0, C_be @ omega_ie, rtol=0, atol=1e-15)  # rounding of the rates
    coriolis = 2.0 * np.cross(omega_ie, state.v_eb_e)
    np.testing.assert_allclose(f_1 - f_0, (C_be @ coriolis[:, :, None])[:, :, 0], rtol=0, atol=1e-13)  # rounding
    # gravity stays what it is
    f_e = np.einsum("nij,nj->ni", state.C_eb, f_0)
    np.testing.assert_allclose(f_e, state.a_eb_e - earth.gravity_ecef(state.r_eb_e), rtol=0, atol=1e-13)


def test_specific_force_is_the_inertial_acceleration_without_gravitation(moving):
    """``f = r_i'' - gravitation`` and ``C_ib' = C_ib [omega_ib x]``, differentiated in axes that do not turn."""

    def inertial(t):
        state, C_ie = moving.state(t), frames.C_ie(t)
        return np.einsum("nij,nj->ni", C_ie, state.r_eb_e), C_ie @ state.C_eb

    step = 0.02
    for time in (1.0, 7.3, 20.0, moving.duration - 2.0):
        t = np.array([time])
        state = moving.state(t)
        omega, f = inertial_quantities(state)
        r, C_ib = inertial(t)
        # second difference, error of order step^4
        r2 = -(inertial(t + 2 * step)[0] + inertial(t - 2 * step)[0]) + 16.0 * (
            inertial(t + step)[0] + inertial(t - step)[0]
        )
        r2 = (r2 - 30.0 * r) / (12.0 * step**2)
        gravitation = np.einsum("nij,nj->ni", frames.C_ie(t), earth.gravitation_ecef(state.r_eb_e))
        f_i = np.einsum("nij,nj->ni", C_ib, f)
        np.testing.assert_allclose(f_i, r2 - gravitation, rtol=0, atol=2e-4)  # rounding of r, 1e-9 m, over step^2
        C_dot = derivative(lambda t: inertial(t)[1], t, step)
        np.testing.assert_allclose(C_dot, C_ib @ rotation.skew(omega), rtol=0, atol=2e-6)  # discretisation


# ----------------------------------------------------------------------------------------- increments


@pytest.mark.parametrize("earth_rotation", [True, False])
def test_increments_are_the_integrals_of_the_rates(moving, earth_rotation):
    """Against SciPy's adaptive quadrature."""
    t = np.array([0.3, 0.31, 0.4, 1.0])

    def both(time):
        omega, f = ideal_rates(moving, [time], earth_rotation=earth_rotation)
        return np.concatenate((omega[0], f[0]))

    expected = np.array([quad_vec(both, a, b, epsabs=1e-13, epsrel=1e-13)[0] for a, b in pairwise(t)])
    dtheta, dv = ideal_increments(moving, t, earth_rotation=earth_rotation, nodes=12)
    np.testing.assert_allclose(dtheta, expected[:, :3], rtol=0, atol=1e-12)  # rounding
    np.testing.assert_allclose(dv, expected[:, 3:], rtol=0, atol=1e-12)  # rounding
    dtheta, dv = ideal_increments(moving, t, earth_rotation=earth_rotation)
    np.testing.assert_allclose(dtheta[:2], expected[:2, :3], rtol=0, atol=1e-12)  # four nodes do over 0.1 s
    np.testing.assert_allclose(dv[:2], expected[:2, 3:], rtol=0, atol=1e-12)


def test_increments_add_up(moving):
    """The increment over an interval is the sum over its parts."""
    fine = np.linspace(0.0, 10.0, 1001)
    few = np.concatenate(([0.0], np.sort(np.random.default_rng(2).choice(fine[1:-1], 150, replace=False)), [10.0]))
    for a, b in zip(ideal_increments(moving, fine), ideal_increments(moving, few, nodes=14), strict=True):
        sums = np.add.reduceat(a, np.searchsorted(fine, few)[:-1], axis=0)
        np.testing.assert_allclose(sums, b, rtol=0, atol=2e-11)  # rounding of 1e3 terms


def test_error_of_the_quadrature_falls_with_the_order_of_its_nodes():
    """Discretisation: an increment's error falls with ``dt**(2 nodes + 1)``."""
    motion = coning_motion(MUNICH, 0.8, 5.0, 10.0)
    for nodes in (1, 2, 3):
        errors, steps = [], np.array([0.2, 0.1, 0.05])
        for dt in steps:
            t = 1.0 + np.array([0.0, dt])
            exact = ideal_increments(motion, t, nodes=15)
            got = ideal_increments(motion, t, nodes=nodes)
            errors.append(np.linalg.norm(np.concatenate([(a - b)[0] for a, b in zip(got, exact, strict=True)])))
        slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
        assert slope == pytest.approx(2 * nodes + 1, abs=0.2)


def test_long_logs_are_worked_through_in_pieces(monkeypatch, moving):
    """The pieces that bound the memory change nothing, wherever they are cut."""
    t = np.linspace(0.0, 5.0, 101)
    whole = ideal_increments(moving, t)
    for chunk in (1, 7, 50, 99, 100):
        monkeypatch.setattr(motion_module, "_CHUNK", chunk)
        for a, b in zip(ideal_increments(moving, t), whole, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)  # rounding


@pytest.mark.parametrize("t", [[0.0], [], [0.0, 0.0], [0.0, 2.0, 1.0]])
def test_limits_of_intervals_must_increase(t):
    with pytest.raises(InputError, match="t: expected at least two increasing limits of intervals"):
        ideal_increments(StaticMotion(MUNICH, np.zeros(3), 1.0), t)


def test_increments_are_not_rotation_vectors():
    """Over an interval of a cone the two differ by the coning term, which the docstring warns of."""
    motion = coning_motion(MUNICH, 0.1, 10.0, 1.0)
    t = np.array([0.0, 0.1])
    dtheta, _ = ideal_increments(motion, t, earth_rotation=False)
    C = motion.state(t).C_eb
    turn = rotation.rotvec_from_dcm(C[0].T @ C[1])
    assert np.linalg.norm(turn - dtheta[0]) > 1e-4
    # a triangle with its apex on the axis instead of a sector: half the cross product of the two tilts; of order a^4
    np.testing.assert_allclose(turn[2], -0.5 * 0.1**2 * np.sin(1.0), rtol=0, atol=5e-6)
    np.testing.assert_allclose(dtheta[0, 2], -2.0 * 10.0 * np.sin(0.05) ** 2 * 0.1, rtol=1e-13)
