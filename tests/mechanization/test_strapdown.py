"""Strapdown mechanization against closed forms, its own equations, and simulated truth."""

import numpy as np
import pytest

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import Increments
from schuler.simulation.motion import LocalMotion, StaticMotion, coning_motion, ideal_increments, ideal_rates
from schuler.simulation.profiles import SplineMotion

LLH = np.array([np.radians(48.0), np.radians(11.0), 500.0])
FRAMES = ("ecef", "ned")


def increments_of(motion, rate_hz, duration=None, **options):
    t = np.linspace(0.0, duration or motion.duration, round((duration or motion.duration) * rate_hz) + 1)
    dtheta, dv = ideal_increments(motion, t, **options)
    return Increments(t[1:], np.diff(t), dtheta, dv)


def start_of(motion):
    s = motion.state(np.zeros(1))
    return NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])


def errors_at_end(trajectory, motion):
    s = motion.state(trajectory.t[-1:])
    turn = rotation.quat_multiply(trajectory.q_eb[-1], rotation.quat_conjugate(s.q_eb[0]))
    return (
        np.linalg.norm(trajectory.r_eb_e[-1] - s.r_eb_e[0]),
        np.linalg.norm(trajectory.v_eb_e[-1] - s.v_eb_e[0]),
        np.linalg.norm(rotation.rotvec_from_quat(turn)),
    )


def flight(duration=3600.0, step=8.0, seed=1):
    """An hour of a light aircraft that never stops manoeuvring: take-off, climbs, banks of up to 60 deg."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration + 6 * step, step)
    ramp = np.clip((t - 30.0) / 40.0, 0.0, 1.0)
    heading = np.cumsum(0.4 * rng.standard_normal(len(t)) * ramp)
    speed = (70.0 + 15.0 * np.sin(t / 150.0)) * ramp
    north, east = np.cumsum(speed * np.cos(heading) * step), np.cumsum(speed * np.sin(heading) * step)
    height = 500.0 + 600.0 * (1.0 - np.cos(2.0 * np.pi * t / 400.0)) * ramp
    llh = np.stack((LLH[0] + north / 6.37e6, LLH[1] + east / (6.38e6 * np.cos(LLH[0])), height), axis=-1)
    bank = 0.5 * rng.standard_normal(len(t)) * ramp
    pitch = 0.12 * rng.standard_normal(len(t)) * ramp
    return SplineMotion.through(t, llh, np.stack((bank, pitch, heading), axis=-1))


@pytest.mark.campaign
@pytest.mark.thinned(2)
@pytest.mark.parametrize("frame", FRAMES)
def test_an_hour_of_dynamic_flight_comes_back_to_the_truth(frame):
    """Exact increments at 100 Hz: below 1 mm and 1e-9 rad after an hour of steady manoeuvring."""
    motion = flight()
    inc = increments_of(motion, 100.0, 3600.0)
    rate = np.linalg.norm(inc.dtheta_ib_b, axis=1) * 100.0
    force = np.linalg.norm(inc.dv_ib_b, axis=1) * 100.0
    assert rate.max() > np.radians(20.0)  # it is a dynamic flight
    assert force.max() > 15.0
    position, velocity, attitude = errors_at_end(mechanize(inc, start_of(motion), frame=frame), motion)
    # discretisation, of fourth order in the interval
    assert position < 1e-3
    assert velocity < 2e-6
    assert attitude < 1e-9


@pytest.mark.parametrize("frame", FRAMES)
def test_increments_converge_with_fourth_order(frame):
    """Halving the interval divides the attitude error of manoeuvring flight by sixteen."""
    motion = flight(300.0, step=5.0)
    rates = np.array([12.5, 25.0, 50.0])
    errors = np.array(
        [
            errors_at_end(mechanize(increments_of(motion, r, 300.0), start_of(motion), frame=frame), motion)
            for r in rates
        ]
    )
    slopes = np.log2(errors[:-1] / errors[1:])
    assert np.all(slopes[:, 2] > 3.7), slopes  # attitude
    assert np.all(slopes[:, 0] > 2.7), slopes  # position: startup and gravity terms of third order mix in


@pytest.mark.parametrize(("order", "low", "high"), [(2, 1.8, 2.3), (3, 2.7, 3.5)])
def test_rates_converge_with_the_order_of_their_rule(order, low, high):
    """Sampled rates instead of increments: the order of the integration rule limits the order of the result."""
    from schuler.recording.series import ImuSeries

    motion = flight(300.0, step=5.0)
    errors = []
    for rate_hz in (25.0, 50.0, 100.0):
        t = np.linspace(0.0, 300.0, round(300.0 * rate_hz) + 1)
        gyro, accel = ideal_rates(motion, t)
        inc = ImuSeries(t, gyro, accel).increments(order=order)
        errors.append(errors_at_end(mechanize(inc, start_of(motion)), motion))
    slopes = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert np.all((slopes[:, (0, 2)] > low) & (slopes[:, (0, 2)] < high)), slopes


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("lat_deg", [-60.0, 0.0, 40.0, 89.0])
def test_a_body_at_rest_on_the_turning_earth_stays_put(frame, lat_deg):
    """Ten minutes at rest with any attitude: no motion, no turn."""
    llh = np.array([np.radians(lat_deg), 1.0, 100.0])
    motion = StaticMotion(llh, np.array([0.3, -0.4, 2.0]), 600.0)
    position, velocity, attitude = errors_at_end(
        mechanize(increments_of(motion, 100.0), start_of(motion), frame=frame), motion
    )
    # rounding: 60 000 steps of 1e-9 m, carried through the unstable vertical channel
    assert position < 1e-5
    assert velocity < 5e-8
    assert attitude < 1e-11  # at rest every step rounds the same way


def test_the_pole_is_an_ordinary_place_for_the_earth_fixed_mechanization():
    """At rest exactly on the north pole."""
    motion = StaticMotion(np.array([np.pi / 2, 0.0, 0.0]), np.array([0.0, 0.0, 0.5]), 600.0)
    position, _, attitude = errors_at_end(mechanize(increments_of(motion, 50.0), start_of(motion)), motion)
    assert position < 1e-5  # rounding
    assert attitude < 1e-11  # at rest every step rounds the same way


def static_with(duration, rate_hz, *, accel_bias=(0, 0, 0), gyro_bias=(0, 0, 0), llh=LLH, **options):
    motion = StaticMotion(np.asarray(llh, dtype=float), np.zeros(3), duration)
    inc = increments_of(motion, rate_hz, earth_rotation=options.get("earth_rotation", True))
    inc = Increments(
        inc.t, inc.dt, inc.dtheta_ib_b + np.array(gyro_bias) / rate_hz, inc.dv_ib_b + np.array(accel_bias) / rate_hz
    )
    trajectory = mechanize(inc, start_of(motion), **options)
    return trajectory.t, frames.ned_from_ecef(trajectory.r_eb_e, llh), trajectory


def test_schuler_loop_of_an_accelerometer_bias():
    """East accelerometer bias b: east error b / ws^2 (1 - cos ws t) over one Schuler period (84.4 min)."""
    b, llh = 1e-4, np.array([0.0, 0.3, 0.0])
    g, (_, R) = earth.gravity_somigliana(0.0), earth.radii_of_curvature(0.0)
    ws = np.sqrt(g / R)
    assert 2.0 * np.pi / ws / 60.0 == pytest.approx(84.5, abs=0.1)
    t, ned, _ = static_with(5070.0, 2.0, accel_bias=(0.0, b, 0.0), llh=llh, frame="ned", earth_rotation=False)
    # the closed form is for a single channel on a sphere of gravity g: 0.5 percent of flattening and height coupling
    np.testing.assert_allclose(ned[:, 1], b / ws**2 * (1.0 - np.cos(ws * t)), atol=0.006 * 2.0 * b / ws**2)


def test_schuler_loop_of_a_gyro_bias():
    """North gyro bias e: east position error -R e (t - sin(ws t) / ws), growing without end."""
    e, llh = 1e-8, np.array([0.0, 0.3, 0.0])
    g, (_, R) = earth.gravity_somigliana(0.0), earth.radii_of_curvature(0.0)
    ws = np.sqrt(g / R)
    t, ned, _ = static_with(5070.0, 2.0, gyro_bias=(e, 0.0, 0.0), llh=llh, frame="ned", earth_rotation=False)
    expected = R * e * (t - np.sin(ws * t) / ws)
    np.testing.assert_allclose(np.abs(ned[:, 1]), expected, atol=0.006 * expected[-1])


def test_vertical_channel_grows_with_the_hyperbolic_cosine():
    """Vertical accelerometer bias b: height error b / k^2 (cosh(k t) - 1), k^2 = 2 g / R."""
    b = 1e-6
    r = frames.ecef_from_llh(LLH)
    up = -frames.C_en(LLH)[:, 2]
    k = np.sqrt(up @ earth.gravity_gradient_ecef(r) @ up)
    t, ned, _ = static_with(1800.0, 10.0, accel_bias=(0.0, 0.0, b))
    expected = b / k**2 * (np.cosh(k * t) - 1.0)
    # the constant gradient of a sphere, the ellipsoid's differs by 0.5 percent
    np.testing.assert_allclose(ned[:, 2], expected, rtol=0.02, atol=1e-6)


def test_short_runs_grow_with_the_square_and_the_cube():
    """b t^2 / 2 from an accelerometer, g e t^3 / 6 from a gyro, within a minute."""
    g = earth.gravity_ned(LLH[0], LLH[2])[2]
    _, ned, _ = static_with(30.0, 100.0, accel_bias=(1e-3, 0.0, 0.0))
    assert ned[-1, 0] == pytest.approx(0.5 * 1e-3 * 30.0**2, rel=1e-3)  # Schuler: (ws t)^2 / 12 = 1e-4
    _, ned, _ = static_with(30.0, 100.0, gyro_bias=(0.0, 1e-5, 0.0))
    assert ned[-1, 0] == pytest.approx(-g * 1e-5 * 30.0**3 / 6.0, rel=1e-3)


@pytest.mark.parametrize("frame", FRAMES)
def test_coning_is_followed_without_drift(frame):
    """2 deg cone at 5 Hz for a minute: the rate mean is -2 w sin^2(a/2), the attitude returns."""
    a, w = np.radians(2.0), 2.0 * np.pi * 5.0
    motion = coning_motion(LLH, a, w, 60.0)
    inc = increments_of(motion, 200.0)
    omega_ie_b = np.mean(
        np.einsum("nji,nj->ni", motion.state(inc.t).C_nb, np.tile(earth.earth_rate_ned(LLH[0]), (len(inc), 1))), 0
    )
    axial = inc.dtheta_ib_b[:, 2].mean() * 200.0 - omega_ie_b[2]
    assert axial == pytest.approx(-2.0 * w * np.sin(a / 2.0) ** 2, rel=1e-9)  # rounding
    *_, attitude = errors_at_end(mechanize(inc, start_of(motion), frame=frame), motion)
    uncorrected = 60.0 * 2.0 * w * np.sin(a / 2.0) ** 2
    assert attitude < 3e-5 * uncorrected  # discretisation of w dt = 0.16 rad


def test_coning_error_falls_with_the_fourth_power_of_the_interval():
    a, w = np.radians(2.0), 2.0 * np.pi * 5.0
    motion = coning_motion(LLH, a, w, 20.0)
    errors = [
        errors_at_end(mechanize(increments_of(motion, r), start_of(motion)), motion)[2] for r in (100.0, 200.0, 400.0)
    ]
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(slopes > 3.5), slopes


def test_both_frames_agree_on_noisy_data(rng):
    """Any increments at all, not just smooth ones: the two mechanizations solve the same equations."""
    n, rate = 6000, 100.0
    motion = StaticMotion(LLH, np.array([0.1, 0.2, 0.3]), n / rate)
    inc = increments_of(motion, rate)
    inc = Increments(
        inc.t,
        inc.dt,
        inc.dtheta_ib_b + 2e-3 * rng.standard_normal((n, 3)),
        inc.dv_ib_b + 0.05 * rng.standard_normal((n, 3)),
    )
    a, b = (mechanize(inc, start_of(motion), frame=f) for f in FRAMES)
    np.testing.assert_allclose(a.r_eb_e, b.r_eb_e, atol=2e-5)  # discretisation of the turning axes
    np.testing.assert_allclose(a.v_eb_e, b.v_eb_e, atol=2e-6)


def test_uneven_intervals_lose_nothing():
    """Jittered time stamps of exact increments are as good as even ones."""
    motion = flight(300.0, step=5.0)
    jitter = np.random.default_rng(3).uniform(-0.2, 0.2, 300 * 50 + 1) / 50.0
    t = np.arange(300 * 50 + 1) / 50.0 + jitter
    t[0], t[-1] = 0.0, 300.0
    dtheta, dv = ideal_increments(motion, t)
    *_, uneven = errors_at_end(mechanize(Increments(t[1:], np.diff(t), dtheta, dv), start_of(motion)), motion)
    *_, even = errors_at_end(mechanize(increments_of(motion, 50.0, 300.0), start_of(motion)), motion)
    assert uneven < 10.0 * even


def test_quaternion_stays_of_unit_length_over_an_hour(rng):
    n = 360_000
    inc = Increments(
        np.arange(1, n + 1) / 100.0, np.full(n, 0.01), 1e-2 * rng.standard_normal((n, 3)), np.zeros((n, 3))
    )
    q = mechanize(inc, NavState.from_geodetic(0.0, LLH)).q_eb
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-14)  # rounding


def test_large_turns_in_one_interval_are_exact():
    """A constant rate of 150 deg an interval takes the branch without series."""
    rate = np.radians([900.0, -600.0, 1000.0])
    inc = Increments(np.arange(1, 11) * 0.1, np.full(10, 0.1), np.tile(0.1 * rate, (10, 1)), np.zeros((10, 3)))
    start = NavState.from_geodetic(0.0, LLH)
    end = mechanize(inc, start, earth_rotation=False)
    expected = rotation.quat_multiply(start.q_eb, rotation.quat_from_rotvec(rate))
    turn = rotation.quat_multiply(end.q_eb[-1], rotation.quat_conjugate(expected))
    assert np.linalg.norm(rotation.rotvec_from_quat(turn)) < 1e-13  # rounding


def test_the_log_must_start_where_the_state_is():
    motion = StaticMotion(LLH, np.zeros(3), 10.0)
    with pytest.raises(InputError, match=r"initial state is at 5\.0000 s but the first interval begins at 0\.0000 s"):
        mechanize(increments_of(motion, 10.0), NavState.from_geodetic(5.0, LLH))


def test_unknown_frame_is_refused():
    motion = StaticMotion(LLH, np.zeros(3), 1.0)
    with pytest.raises(InputError, match="expected 'ecef' or 'ned', got 'enu'"):
        mechanize(increments_of(motion, 10.0), NavState.from_geodetic(0.0, LLH), frame="enu")


@pytest.mark.parametrize("angle", [0.3, 0.49, 0.51, 0.8, 2.0])
def test_a_constant_turn_with_force_is_the_same_in_coarse_samples(angle):
    """Rotation and velocity of a constant rate and force are exact in any interval: the closed form beyond 0.5 rad.

    What is left is gravity over the interval, which sees the mean position: below 1e-6 m/s.
    """
    h, pieces = 0.01, 32
    rate, force = angle / h * np.array([0.6, -0.48, 0.64]), np.array([20.0, -30.0, 10.0])
    ends = []
    for n in (1, pieces):
        t = np.arange(1, 20 * n + 1) * (h / n)
        ones = np.ones((len(t), 1))
        log = Increments(t, np.full(len(t), h / n), ones * rate * (h / n), ones * force * (h / n))
        ends.append(mechanize(log, NavState.from_geodetic(0.0, LLH, (30.0, -20.0, 1.0), (0.2, -0.3, 1.0))))
    np.testing.assert_allclose(ends[0].v_eb_e[-1], ends[1].v_eb_e[-1], atol=2e-6)
    turn = rotation.quat_multiply(ends[0].q_eb[-1], rotation.quat_conjugate(ends[1].q_eb[-1]))
    assert np.linalg.norm(rotation.rotvec_from_quat(turn)) < 1e-8


def test_series_of_small_turns_are_their_closed_forms():
    """(1 - cos a) / a^2 and (a - sin a) / a^3 to their last digits, on both sides of 0.5 rad; rounding of 1 - cos."""
    from schuler.mechanization.kernels import rotation_coefficients

    for a in (0.2, 0.35, 0.499, 0.501, 0.9):
        first, second = rotation_coefficients.py_func(a * a)
        assert first == pytest.approx((1.0 - np.cos(a)) / a**2, rel=2e-14)
        assert second == pytest.approx((a - np.sin(a)) / a**3, rel=2e-13)


@pytest.mark.parametrize(("frame", "error_m"), [("ecef", 0.0345), ("ned", 0.0475)])
def test_gravity_and_coriolis_are_of_second_order(frame, error_m):
    """Straight on at 270 m/s without a turn nothing else is left: a quarter of the error at half the interval.

    Discretisation: third order shows in the third digit. A Coriolis acceleration of the start that is 5 % off, which
    only the velocity at mid interval feels, adds an error of first order.
    """
    C = np.eye(3)

    def path(t):
        v = np.tile([250.0, 100.0, 0.0], (len(t), 1))
        return t[:, None] * v, v, np.zeros((len(t), 3))

    def level(t):
        return np.tile(C, (len(t), 1, 1)), np.zeros((len(t), 3))

    motion = LocalMotion(np.array([0.8, 0.2, 5000.0]), path, level, 600.0)
    rates = (0.5, 1.0, 2.0)
    ends = (mechanize(increments_of(motion, rate), start_of(motion), frame=frame) for rate in rates)
    errors = np.array([errors_at_end(end, motion)[0] for end in ends])
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2.0, atol=0.01)
    assert errors[1] == pytest.approx(error_m, rel=0.01)


@pytest.mark.parametrize("aside_m", [0.0, 3000.0])
def test_north_east_down_axes_are_refused_at_a_pole(aside_m):
    """Towards the pole at 200 m/s: Earth-fixed axes go through, north-east-down ones say where they stop."""
    t = np.arange(1, 12_001) * 0.05
    ones = np.ones((len(t), 1))
    log = Increments(t, np.full(len(t), 0.05), 0.0 * ones * np.ones(3), ones * [0.0, 0.0, -9.83 * 0.05])
    away = np.hypot(60e3, aside_m) / 6.4e6
    course = np.arctan2(aside_m, 60e3)
    start = NavState.from_geodetic(
        0.0, [0.5 * np.pi - away, 0.3, 1000.0], [200.0 * np.cos(course), 200.0 * np.sin(course), 0.0]
    )
    assert np.isfinite(mechanize(log, start).r_eb_e).all()
    with pytest.raises(InputError, match=r"within 0\.1 deg of a pole at 2[0-9]+\.\d+ s, .* use frame='ecef'"):
        mechanize(log, start, frame="ned")
