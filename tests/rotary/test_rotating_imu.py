"""Motion of a rotating IMU: derivatives belong to each other, centripetal terms by hand, exact increments at jumps."""

import numpy as np
import pytest

from schuler import earth, rotation
from schuler.exceptions import InputError
from schuler.rotary import schemes
from schuler.rotary.modulated_errors import turning_vehicle
from schuler.rotary.rotating_imu import RotatingMotion, angular_acceleration, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schedule import stacked
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import (
    LocalMotion,
    StaticMotion,
    coning_motion,
    euler_attitude,
    ideal_increments,
    inertial_quantities,
)
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG

W = 10.0 * DEG
LLH = np.array([45.0 * DEG, 0.1, 100.0])
REST = StaticMotion(LLH, np.array([0.1, -0.2, 0.3]), 60.0)
OFFSET = np.array([0.05, 0.03, -0.02])
SPIN = stacked(schemes.continuous("x", 7.0 * DEG), schemes.continuous("z", 11.0 * DEG))


def driving() -> ManoeuvreMotion:
    turns = [Manoeuvre(duration=10.0, speed=10.0), Manoeuvre(duration=10.0, turn=1.5),
             Manoeuvre(duration=20.0, turn=-3.0, speed=15.0)]  # fmt: skip
    return ManoeuvreMotion.of(turns, LLH, bank=0.3)


@pytest.mark.parametrize("vehicle", [REST, driving()], ids=["rest", "drive"])
def test_derivatives_of_the_state_belong_to_each_other(vehicle):
    """Five-point differences; tolerances are rounding of Earth radii over the step: 1e-9 / 1e-2 m/s."""
    motion, t, h = RotatingMotion(vehicle, SPIN, OFFSET), np.array([1.0, 9.3, 17.7, 33.1]), 1e-2

    def derivative(name):
        f = [getattr(motion.state(t + k * h), name) for k in (-2, -1, 1, 2)]
        return (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)

    s = motion.state(t)
    np.testing.assert_allclose(s.v_eb_e, derivative("r_eb_e"), atol=2e-6)
    np.testing.assert_allclose(s.a_eb_e, derivative("v_eb_e"), atol=2e-6)
    np.testing.assert_allclose(s.omega_eb_b, rotation.unskew(np.swapaxes(s.C_eb, 1, 2) @ derivative("C_eb")), atol=2e-7)


def test_without_offset_only_the_axes_turn():
    motion = RotatingMotion(driving(), SPIN)
    t = np.linspace(0.0, 40.0, 50)
    s, body = motion.state(t), motion.vehicle.state(t)
    for name in ("r_eb_e", "v_eb_e", "a_eb_e"):
        np.testing.assert_array_equal(getattr(s, name), getattr(body, name))
    np.testing.assert_allclose(s.C_eb, body.C_eb @ SPIN.C_bs(t), atol=1e-15)
    assert motion.duration == 40.0


@pytest.mark.parametrize(("rate_deg", "printed"), [(10.0, 1.5e-3), (100.0, 0.15)])
def test_five_centimetres_off_the_axis_feel_centripetal_force(rate_deg, printed):
    """omega^2 l: 1.5e-3 m/s^2 at 10 deg/s, 0.15 at 100 (printed digits), inwards, constant in s."""
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    rate, offset = rate_deg * DEG, np.array([0.05, 0.0, 0.0])
    t = np.linspace(0.0, 30.0, 100)
    on, off = (
        inertial_quantities(RotatingMotion(rest, schemes.continuous("z", rate), o).state(t), earth_rotation=False)[1]
        for o in (np.zeros(3), offset)
    )
    np.testing.assert_allclose(off - on, np.broadcast_to([-(rate**2) * 0.05, 0.0, 0.0], on.shape), atol=2e-7)
    assert rate**2 * 0.05 == pytest.approx(printed, rel=0.02)


def test_a_run_up_feels_the_tangential_acceleration():
    """alpha l across the lever, alpha = 20 deg/s^2; tolerance: gravity changes by 3e-6 m/s^2/m over the offset."""
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    schedule = schemes.continuous("z", 100.0 * DEG, acceleration=20.0 * DEG)
    t = np.array([1e-9])
    on, off = (
        inertial_quantities(RotatingMotion(rest, schedule, o).state(t), earth_rotation=False)[1]
        for o in (np.zeros(3), np.array([0.05, 0.0, 0.0]))
    )
    np.testing.assert_allclose(off - on, [[0.0, 20.0 * DEG * 0.05, 0.0]], atol=3e-7)


def test_at_rest_a_z_rotation_turns_earth_rate_and_keeps_gravity():
    """omega_is_s about Z, in our axes; rounding."""
    rest = StaticMotion(LLH, np.zeros(3), 60.0)
    t = np.linspace(0.0, 36.0, 40)
    omega, f = inertial_quantities(RotatingMotion(rest, schemes.continuous("-z", W)).state(t))
    We, lat = earth.WGS84.omega_ie, LLH[0]
    east, north = We * np.cos(lat) * np.sin(W * t), We * np.cos(lat) * np.cos(W * t)
    np.testing.assert_allclose(omega, np.stack((north, east, 0.0 * t - We * np.sin(lat) - W), axis=1), atol=1e-15)
    np.testing.assert_allclose(f, np.broadcast_to([0.0, 0.0, f[0, 2]], f.shape), atol=1e-6)  # deflection of the zonals
    assert f[0, 2] == pytest.approx(-9.8060, abs=2e-3)


def test_the_angular_acceleration_of_a_vehicle_matches_closed_forms():
    """Also at both ends, where the stencil is off its centre: discretisation h^4, rounding 1e-15 / 2e-3."""
    w = 2.0
    angles = lambda t: (  # noqa: E731
        np.stack((0.0 * t, 0.0 * t, np.sin(w * t)), axis=1),
        np.stack((0.0 * t, 0.0 * t, w * np.cos(w * t)), axis=1),
    )
    path = lambda t: (np.zeros((len(t), 3)),) * 3  # noqa: E731
    motion = LocalMotion(LLH, path, euler_attitude(angles), 5.0)
    t = np.array([0.0, 1e-3, 1.0, 2.5, 4.999, 5.0])
    expected = np.zeros((6, 3))
    expected[:, 2] = -(w**2) * np.sin(w * t)
    np.testing.assert_allclose(angular_acceleration(motion, t), expected, atol=1e-9)
    a, rate = 0.1, 3.0
    cone = coning_motion(LLH, a, rate, 5.0)
    expected = np.stack((-np.sin(a) * rate**2 * np.cos(rate * t), -np.sin(a) * rate**2 * np.sin(rate * t), 0 * t), 1)
    np.testing.assert_allclose(angular_acceleration(cone, t), expected, atol=1e-9)
    assert not angular_acceleration(REST, t).any()


JUMPY = {
    "positions": schemes.dwell("z", 4, dwell=1.003, rate=50.0 * DEG),
    "dual": schemes.dual_axis(8, dwell=0.5, rate=90.0 * DEG, acceleration=200.0 * DEG),
    "reciprocating": schemes.reciprocating("x", 100.0 * DEG, acceleration=150.0 * DEG),
}


@pytest.mark.parametrize("schedule", JUMPY.values(), ids=JUMPY.keys())
@pytest.mark.parametrize("offset", [np.zeros(3), OFFSET], ids=["on", "off"])
def test_increments_across_jumps_are_the_sum_of_fine_ones(schedule, offset):
    """50 Hz increments are sums of those of a grid that hits every jump, blows of the rate included; rounding."""
    rest = StaticMotion(LLH, np.array([0.1, -0.2, 0.3]), 12.0)
    motion = RotatingMotion(rest, schedule, offset)
    ideal = ideal_rotating_imu(motion, 50.0)
    fine = np.union1d(ideal.t, schedule.breakpoints(0.0, 12.0))
    fine = fine[np.concatenate(([True], np.diff(fine) > 1e-8))]
    # a hair inside each interval, so that no node lies on a jump
    dtheta, dv = ideal_increments(motion, fine, nodes=6)
    breaks = schedule.breakpoints(0.0, 12.0)
    blow = np.cross(schedule.omega_bs_s(breaks + 1e-8) - schedule.omega_bs_s(breaks - 1e-8), offset)
    blow[np.abs(blow) < 1e-6] = 0.0
    for result, parts, extra in ((ideal.gyro, dtheta, 0.0 * blow), (ideal.accel, dv, blow)):
        total = np.zeros_like(result)
        np.add.at(total, np.searchsorted(ideal.t, fine[:-1] + 1e-7) - 1, parts)
        np.add.at(total, np.clip(np.searchsorted(ideal.t, breaks + 1e-9, side="right") - 1, 0, len(result) - 1), extra)
        np.testing.assert_allclose(result, total, atol=2e-9)


def test_smooth_schedules_give_what_ideal_imu_gives():
    motion = RotatingMotion(REST, SPIN, OFFSET)
    one, two = ideal_rotating_imu(motion, 20.0), ideal_imu(motion, 20.0)
    np.testing.assert_array_equal(one.gyro, two.gyro)
    np.testing.assert_array_equal(one.accel, two.accel)


def test_a_jump_on_the_sampling_grid_needs_no_cut():
    schedule = schemes.from_rates("z", [0.0, 1.0, 1.0, 2.0], [0.2, 0.2, -0.3, -0.3])
    ideal = ideal_rotating_imu(
        RotatingMotion(StaticMotion(LLH, np.zeros(3), 2.0), schedule), 10.0, earth_rotation=False
    )
    np.testing.assert_allclose(ideal.gyro[:, 2], np.repeat([0.02, -0.03], 10), atol=1e-12)


def test_rates_are_samples_and_the_vehicle_is_kept():
    motion = RotatingMotion(driving(), SPIN)
    ideal = ideal_rotating_imu(motion, 10.0, kind="rate")
    np.testing.assert_array_equal(ideal.gyro, inertial_quantities(motion.state(ideal.t))[0])
    body = vehicle_truth(motion, ideal.t)
    np.testing.assert_array_equal(body.r_eb_e, ideal.truth.r_eb_e)


def test_a_vehicle_that_turns_back_holds_the_imu_still():
    motion = RotatingMotion(turning_vehicle(LLH, -W, 30.0), schemes.continuous("z", W))
    s = motion.state(np.linspace(0.0, 30.0, 20))
    np.testing.assert_allclose(s.omega_eb_b, 0.0, atol=1e-16)
    np.testing.assert_allclose(s.C_nb, np.broadcast_to(np.eye(3), s.C_nb.shape), atol=1e-14)


def test_an_offset_on_a_motion_too_short_for_a_difference_is_refused():
    cone = coning_motion(LLH, 0.1, 3.0, 0.005)
    with pytest.raises(InputError, match="too short"):
        RotatingMotion(cone, SPIN, OFFSET).state(np.array([0.0]))
