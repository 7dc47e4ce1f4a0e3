"""Modulation of biases, counter-rotation of the vehicle, residues; errors of platforms; axes of Du."""

import numpy as np
import pytest

from schuler import rotation
from schuler.exceptions import InputError
from schuler.rotary import gimbals, schemes
from schuler.rotary.du_axes import du_axis, enu_errors, installation_matrix, rpy_from_du, swap_matrix, swap_vector
from schuler.rotary.encoder import platform_error
from schuler.rotary.modulated_errors import (
    _steps,
    bias_in_n,
    effective_rate,
    modulation,
    open_loop_errors,
    residue,
    turning_vehicle,
)
from schuler.rotary.rotating_imu import RotatingMotion
from schuler.rotary.schedule import stacked
from schuler.sensors.errors import ImuErrors
from schuler.simulation.motion import StaticMotion, inertial_quantities
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG

W = 10.0 * DEG
LLH = np.array([45.0 * DEG, 0.0, 0.0])
REST = StaticMotion(LLH, np.zeros(3), 400.0)
BIAS = np.array([3.0, -2.0, 1.0])  # Du's axes


def test_a_z_rotation_modulates_as_printed():
    """Eqs. (2.6)-(2.9) in Du's axes; rounding."""
    t = np.linspace(0.0, 72.0, 200)
    seen = swap_vector(bias_in_n(RotatingMotion(REST, schemes.continuous(du_axis("Z"), W)), swap_vector(BIAS), t))
    c, s = np.cos(W * t), np.sin(W * t)
    np.testing.assert_allclose(seen, np.stack((3 * c + 2 * s, 3 * s - 2 * c, 1.0 + 0 * t), axis=1), atol=1e-13)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, -1.0])
def test_a_vehicle_that_turns_back_undoes_the_modulation(share):
    """Effective rate: platform plus vehicle. At -rate of the platform the bias stands still in n (Du, section 2.3).

    The vehicle's turn is relative to axes that turn with the Earth: rounding.
    """
    vehicle = turning_vehicle(LLH, share * W, 72.0)  # about down; the platform turns by -W about down
    motion = RotatingMotion(vehicle, schemes.continuous(du_axis("Z"), W))
    t = np.linspace(0.0, 72.0, 145)
    np.testing.assert_allclose(effective_rate(motion, t), (1.0 - share) * W, atol=1e-15)
    result = modulation(motion, swap_vector(BIAS), t)
    expected = swap_vector(BIAS) if share == 1.0 else swap_vector([0.0, 0.0, 1.0])
    np.testing.assert_allclose(result.mean_n[-1], expected, atol=1e-12)  # 72 s are whole revolutions of all of them
    np.testing.assert_allclose(result.bias_n[0], result.mean_n[0])


def test_a_turning_vehicle_turns_about_its_own_down_axis_alone():
    """In whatever attitude it began: what is left of its rates is the Earth's."""
    state = turning_vehicle(LLH, 0.1, 20.0, rpy_nb=(0.2, -0.3, 1.0)).state(np.linspace(0.0, 20.0, 5))
    gyro = inertial_quantities(state)[0]
    np.testing.assert_allclose(np.linalg.norm(gyro - [0.0, 0.0, 0.1], axis=1), 7.292115e-5, rtol=1e-6)


def test_running_mean_of_a_modulated_bias():
    """sin(wt) / (wt) of the closed form; quadrature below 1e-12."""
    t = np.linspace(0.0, 50.0, 51)
    mean = modulation(RotatingMotion(REST, schemes.continuous("z", W)), [1.0, 0.0, 0.0], t).mean_n
    np.testing.assert_allclose(mean[1:, 0], np.sin(W * t[1:]) / (W * t[1:]), atol=1e-12)


def test_steps_are_short_beside_a_revolution_a_second():
    """sin(wt) / (wt) again; quadrature below 1e-9."""
    w, t = 2.0 * np.pi, 10.3
    left = residue(RotatingMotion(REST, schemes.continuous("z", w)), t).bias
    np.testing.assert_allclose(left[0, 0], np.sin(w * t) / (w * t), atol=1e-9)


def test_open_loop_errors_of_a_conventional_imu_are_polynomials():
    """eps = d t, dv = b t + eps x f / 2 t, dr = b t^2 / 2 + ...; rounding of the sums."""
    t = np.array([0.0, 10.0, 100.0])
    d, b, g = np.array([1e-4, -2e-4, 3e-4]), np.array([0.1, 0.2, -0.1]), inertial_quantities(REST.state(np.zeros(1)))[1]
    run = open_loop_errors(RotatingMotion(REST, schemes.fixed()), ImuErrors(b_g=d, b_a=b), t)
    pull = np.cross(d, g[0])
    np.testing.assert_allclose(run.attitude, np.outer(t, d), atol=1e-14)
    np.testing.assert_allclose(run.velocity, np.outer(t, b) + np.outer(t**2 / 2, pull), rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(run.position, np.outer(t**2 / 2, b) + np.outer(t**3 / 6, pull), rtol=1e-11, atol=1e-10)


def test_residue_of_a_z_rotation():
    """Over whole turns the mean keeps the axis, and twice the double mean is the tilt of the start's phase."""
    result = residue(RotatingMotion(REST, schemes.continuous("z", W)), 72.0)
    np.testing.assert_allclose(result.bias, np.diag([0.0, 0.0, 1.0]), atol=1e-12)
    # integral of C is (sin, 1 - cos) / w: its mean is (0, 1 / w), times 2 / T
    tilt = 2.0 / (W * 72.0)
    np.testing.assert_allclose(result.bias_twice, [[0, -tilt, 0], [tilt, 0, 0], [0, 0, 1]], atol=1e-12)
    K = np.zeros((3, 3))
    K[0, 2] = 1.0
    mean = np.einsum("nij,ij->n", result.matrix, K)
    np.testing.assert_allclose(mean, 0.0, atol=2e-4 * W)  # Earth rate across the axis stays


@pytest.mark.parametrize(("n", "bias", "matrix"), [(4, False, False), (8, False, True), (16, True, True)])
def test_dual_axis_schemes_leave_what_they_say(n, bias, matrix):
    """Mean rate of error from biases and from installation; quadrature and rounding, Earth rate for the matrices."""
    rate, limit = 3.0 * W, 6.0 * W
    cycle = n * (np.pi / rate + rate / limit + 3.0)
    rest = StaticMotion(LLH, np.zeros(3), cycle + 1.0)
    schedule = schemes.dual_axis(n, dwell=3.0, rate=rate, acceleration=limit)
    result = residue(RotatingMotion(rest, schedule), cycle)
    assert bool(np.abs(result.bias).max() < 1e-9) is bias
    assert bool(np.abs(result.matrix).max() < 1.1 * 7.292e-5) is matrix
    if n == 16:  # mean tilt of installation is that of a single axis at best: K
        assert 0.5 * np.abs(result.matrix_twice).max() * cycle == pytest.approx(1.0, abs=0.01)
    conventional = residue(RotatingMotion(REST, schemes.fixed()), 100.0)
    np.testing.assert_allclose(conventional.bias, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(conventional.bias_twice, np.eye(3), atol=1e-12)


def test_wrong_times_are_refused():
    motion = RotatingMotion(REST, schemes.fixed())
    with pytest.raises(InputError, match="increasing times"):
        open_loop_errors(motion, ImuErrors(), [1.0, 0.0])
    for t in ([1.0, 1.0], [1.0, 0.5], [1.0]):
        with pytest.raises(InputError, match="increasing times"):
            open_loop_errors(motion, ImuErrors(), t)
    for step in (0.0, -0.5, float("nan")):
        with pytest.raises(InputError, match="positive step"):
            open_loop_errors(motion, ImuErrors(), [0.0, 1.0], step=step)
    with pytest.raises(InputError, match="duration"):
        residue(motion, 0.0)
    np.testing.assert_allclose(residue(motion, 0.5).bias, np.eye(3), atol=1e-13)  # however short


PLATFORMS = {
    "one": schemes.continuous("-z", W),
    "two": stacked(schemes.continuous("x", 7.0 * DEG), schemes.continuous("z", 11.0 * DEG)),
    "three, mounted": stacked(
        schemes.continuous("x", 7.0 * DEG), schemes.reciprocating("y", W), schemes.continuous("z", 11.0 * DEG)
    ).mounted(rotation.dcm_from_rpy([0.1, 0.2, 0.3])),
}  # fmt: skip


@pytest.mark.parametrize("schedule", PLATFORMS.values(), ids=PLATFORMS.keys())
def test_platform_errors_are_the_derivative_of_the_body_route(schedule):
    """Numerical twin: s -> b with angles and rates moved either way, central difference; rounding 1e-15 / 1e-4."""
    rng = np.random.default_rng(5)
    t = rng.uniform(1.0, 30.0, 20)
    n, m = len(t), len(schedule.axes)
    omega, f = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) * 10.0
    C_nb = rotation.dcm_from_rpy(rng.normal(size=(n, 3)))
    d_angle, d_rate = rng.normal(size=(n, m)), rng.normal(size=(n, m))

    def turned(h):
        angles, rates = schedule.angles(t) + h * d_angle, schedule.rates(t) + h * d_rate
        C_bs = gimbals.C_bs(schedule.axes, angles, schedule.C_mount)
        inside = omega - gimbals.omega_bs_s(schedule.axes, angles, rates, schedule.C_mount)
        return np.einsum("nij,njk,nk->ni", C_nb, C_bs, inside), np.einsum("nij,njk,nk->ni", C_nb, C_bs, f)

    h = 1e-4
    for result, plus, minus in zip(
        platform_error(schedule, t, C_nb, omega, f, d_angle, d_rate), turned(h), turned(-h), strict=True
    ):
        np.testing.assert_allclose(result, (plus - minus) / (2.0 * h), atol=2e-6)  # h^2 |f| |d|^3 / 6 and rounding


def test_platform_errors_about_the_vertical_are_the_corrected_ones():
    """(2.20), (2.21) with minus phi^x: in Du's axes +dtheta z x f and + dtheta z x omega, minus the rate's error."""
    schedule = PLATFORMS["one"]
    motion = RotatingMotion(REST, schedule)
    t = np.array([0.0, 3.0, 11.0])
    omega, f = inertial_quantities(motion.state(t))
    C_nb = REST.state(t).C_nb
    d_omega, d_f = platform_error(schedule, t, C_nb, omega, f, 1e-3, 1e-5)
    np.testing.assert_allclose(swap_vector(d_f), 0.0, atol=1e-8)  # level: no error of velocity
    north = 7.292115e-5 * np.cos(LLH[0])
    np.testing.assert_allclose(swap_vector(d_omega), np.tile([-1e-3 * north, 0.0, -1e-5], (3, 1)), atol=1e-12)


def test_the_swap_is_a_rotation_and_its_own_inverse():
    v, M = np.array([1.0, 2.0, 3.0]), np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(swap_vector(v), [2.0, 1.0, -3.0])
    np.testing.assert_array_equal(swap_vector(swap_vector(v)), v)
    np.testing.assert_array_equal(swap_matrix(M) @ swap_vector(v), swap_vector(M @ v))
    np.testing.assert_allclose(np.cross(swap_vector(v), swap_vector(M[0])), swap_vector(np.cross(v, M[0])))
    np.testing.assert_array_equal(du_axis("X"), [0, 1, 0])
    np.testing.assert_array_equal(du_axis("Y"), [1, 0, 0])
    np.testing.assert_array_equal(du_axis("Z"), [0, 0, -1])
    with pytest.raises(InputError, match="'X', 'Y' or 'Z'"):
        du_axis("W")


def test_recommended_attitude_matrix_in_du_axes():
    """The standard form R3(A) R1(-p) R2(-r), printed element by element; rounding."""
    A, r, p = 0.5, 0.2, -0.3
    cA, sA, cr, sr, cp, sp = np.cos(A), np.sin(A), np.cos(r), np.sin(r), np.cos(p), np.sin(p)
    printed = [
        [cA * cr + sA * sp * sr, sA * cp, cA * sr - sA * sp * cr],
        [-sA * cr + cA * sp * sr, cA * cp, -sA * sr - cA * sp * cr],
        [-cp * sr, sp, cp * cr],
    ]
    np.testing.assert_allclose(swap_matrix(rotation.dcm_from_rpy(rpy_from_du(A, r, p))), printed, atol=1e-15)
    du2015 = [
        [cA * cr, cA * sr * sp + sA * cp, -cA * sr * cp + sA * sp],
        [-sA * cr, -sA * sr * sp + cA * cp, sA * sr * cp + cA * sp],
        [sr, -cr * sp, cr * cp],
    ]
    result = swap_matrix(rotation.dcm_from_rpy(rpy_from_du(A, r, p, printed=True)))
    np.testing.assert_allclose(result, du2015, atol=1e-15)


def test_matrices_of_errors_and_attitude_errors_in_du_axes():
    M = installation_matrix(xy=1.0, xz=2.0, yx=3.0, yz=4.0, zx=5.0, zy=6.0)
    # output right by input forward is ours output y by input x
    assert M[1, 0] == 1.0
    assert M[1, 2] == -2.0
    assert M[0, 1] == 3.0
    eps = np.array([1e-4, -2e-4, 3e-4])  # east, north, up
    C = rotation.dcm_from_rpy([0.1, 0.2, 0.3])
    np.testing.assert_allclose(enu_errors(rotation.dcm_from_rotvec(swap_vector(eps)) @ C, C), eps, atol=1e-11)


def test_a_vehicle_that_holds_its_heading_changes_nothing_at_high_latitude():
    """Eastwards at 75 degrees the axes turn with the meridians, the vehicle with them: the platform alone modulates."""
    commands = [Manoeuvre(duration=30.0, speed=250.0), Manoeuvre(duration=60.0)]
    vehicle = ManoeuvreMotion.of(commands, np.array([75.0 * DEG, 0.3, 1e4]), heading=0.5 * np.pi, bank=0.0)
    motion = RotatingMotion(vehicle, schemes.continuous("z", W))
    t = np.linspace(40.0, 80.0, 21)
    s = motion.state(t)
    turn = np.linalg.norm(s.v_eb_e, axis=1) * np.tan(s.llh[:, 0]) / 6.4e6
    assert turn.min() > 1e-4  # rad/s that would be seen otherwise
    np.testing.assert_allclose(effective_rate(motion, t), W, atol=2e-8)


MOUNTED = schemes.fixed().mounted(rotation.dcm_from_rpy([0.4, -0.3, 1.1]))


def test_open_loop_errors_take_every_element_of_the_matrices():
    """At rest, mounted askew: eps = C (M_g w + G_g f) t, and the force error C M_a f t beside eps x f; rounding."""
    rng = np.random.default_rng(3)
    M_g, M_a, G_g = (scale * rng.standard_normal((3, 3)) for scale in (10.0, 1e-3, 1e-6))
    motion, t = RotatingMotion(REST, MOUNTED), np.array([0.0, 5.0, 60.0])
    omega, f = (x[0] for x in inertial_quantities(motion.state(np.zeros(1))))
    C = motion.state(np.zeros(1)).C_nb[0]
    run = open_loop_errors(motion, ImuErrors(M_g=M_g, M_a=M_a, G_g=G_g), t)
    rate = C @ (M_g @ omega + G_g @ f)
    np.testing.assert_allclose(run.attitude, np.outer(t, rate), rtol=1e-10, atol=1e-14)
    pull = np.cross(rate, C @ f)
    np.testing.assert_allclose(
        run.velocity, np.outer(t, C @ M_a @ f) + np.outer(t**2 / 2, pull), rtol=1e-10, atol=1e-12
    )  # fmt: skip


def test_residue_of_an_imu_that_stands_askew_is_its_attitude():
    """Nothing turns: bias C, matrix C_ni omega_k, once and twice. Rounding."""
    motion = RotatingMotion(REST, MOUNTED)
    state = motion.state(np.zeros(1))
    C, omega = state.C_nb[0], inertial_quantities(state)[0][0]
    left = residue(motion, 50.0)
    for bias in (left.bias, left.bias_twice):
        np.testing.assert_allclose(bias, C, atol=1e-12)
    for matrix in (left.matrix, left.matrix_twice):
        np.testing.assert_allclose(matrix, np.einsum("ni,k->nik", C, omega), atol=1e-16)


@pytest.mark.parametrize("off", [-3e-10, 0.0, 3e-10])
def test_a_time_beside_a_jump_is_the_jump(off):
    """Steps of a quadrature are no shorter than rounding of the times, on whichever side of a jump they end."""
    motion = RotatingMotion(StaticMotion(LLH, np.zeros(3), 200.0), schemes.reciprocating("z", W))
    breaks = motion.schedule.breakpoints(0.0, 150.0)
    t = np.concatenate(([0.0], breaks + off, [150.0]))
    limits, kept = _steps(motion, t, 0.7)
    assert np.diff(limits).min() > 1e-3
    np.testing.assert_array_equal(limits[kept], t)


def test_the_quadrature_is_of_eighth_order():
    """Mean of a modulated bias, whose closed form is a sine: half the step, a 256th of the error."""
    motion, t = RotatingMotion(REST, schemes.continuous("z", W)), np.array([0.0, 40.0])
    exact = np.sin(W * 40.0) / W
    errors = [
        abs(open_loop_errors(motion, ImuErrors(b_g=np.array([1.0, 0.0, 0.0])), t, step=step).attitude[-1, 0] - exact)
        for step in (10.0, 5.0)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=0.2)


def test_a_quadrature_stops_at_jumps_and_nowhere_without_need():
    """Times asked for half a second before and behind a jump leave the jump in; there are no more steps than that."""
    moving = RotatingMotion(StaticMotion(LLH, np.zeros(3), 200.0), schemes.reciprocating("z", W))
    breaks = moving.schedule.breakpoints(0.0, 150.0)
    for t in (np.array([0.0, 150.0]), np.array([0.0, breaks[0] - 0.5, breaks[0] + 0.5, 150.0])):
        coarse, fine = (
            open_loop_errors(moving, ImuErrors(b_g=np.array([1.0, 2.0, 0.0])), t, step=step).attitude[-1]
            for step in (1.0, 0.25)
        )
        np.testing.assert_allclose(coarse, fine, atol=1e-9)
    limits, kept = _steps(moving, np.array([0.0, breaks[0] + 0.5, 150.0]), 1.0)
    assert np.abs(limits - breaks[0]).min() < 1e-9  # also the jump before the second time
    assert list(limits[kept]) == [0.0, breaks[0] + 0.5, 150.0]
    still = RotatingMotion(REST, schemes.fixed())
    np.testing.assert_allclose(_steps(still, np.array([0.0, 10.0]), 0.1)[0], np.linspace(0.0, 10.0, 101), atol=1e-12)
    np.testing.assert_array_equal(_steps(still, np.array([0.0, 0.05]), 0.1)[0], [0.0, 0.05])


@pytest.mark.parametrize("off", [-3e-10, 3e-10])
def test_a_quadrature_that_begins_beside_a_jump_begins_at_it(off):
    moving = RotatingMotion(StaticMotion(LLH, np.zeros(3), 200.0), schemes.reciprocating("z", W))
    first = moving.schedule.breakpoints(0.0, 150.0)[0]
    limits, _ = _steps(moving, np.array([first + off, first + 1.0]), 0.7)
    assert np.diff(limits).min() > 1e-3


def test_how_the_imu_sits_on_the_platform_changes_no_effective_rate():
    """The innermost axis is the platform's, whatever axes the IMU reads it in; rounding."""
    schedule = schemes.continuous(du_axis("Z"), W).mounted(rotation.dcm_from_rpy([0.4, -0.7, 1.1]))
    motion = RotatingMotion(turning_vehicle(LLH, 0.3 * W, 72.0), schedule)
    np.testing.assert_allclose(effective_rate(motion, np.linspace(0.0, 72.0, 20)), 0.7 * W, atol=1e-15)
