"""Flenniken's triads: their matrices, the printed slip, their inverses, and the way to ImuErrors and back."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.rotation import dcm_from_rotvec, skew
from schuler.sensors import (
    AccelerometerTriad,
    GaussMarkov,
    GyroTriad,
    ImuErrors,
    NoiseModel,
    RandomWalk,
    SimpleTriad,
    White,
)
from schuler.sensors.triads import C_FRD_FUR, frd_from_fur, fur_from_frd, imu_errors, triads_of

SIGMAS = 4.0  # statistical tolerances: standard errors, seeds fixed
ANGLES = {"misalignment": [1e-3, -2e-3, 3e-3], "non_orthogonality": [-4e-3, 5e-3, 6e-3]}
TWO = White(1.0) + GaussMarkov(1.0, 2.0) + GaussMarkov(1.0, 3.0)
NOISE = {"bias": [0.1, -0.2, 0.3], "N": [0.01] * 3, "sigma_b": [0.02] * 3, "tau": [5.0] * 3}


def truth(n: int = 50) -> np.ndarray:
    return np.random.default_rng(50).normal(0.0, 10.0, (n, 3))


def test_there_are_48_parameters():
    assert (len(GyroTriad().parameters()), len(AccelerometerTriad().parameters())) == (21, 27)
    assert len(SimpleTriad().parameters()) == 12
    assert GyroTriad(scale_factor=[1e-4, 2e-4, 3e-4]).parameters()["scale_factor_y"] == 2e-4


@pytest.mark.parametrize("triad", [SimpleTriad(), GyroTriad(), AccelerometerTriad()], ids=lambda t: type(t).__name__)
def test_without_errors_they_read_the_truth(triad):
    np.testing.assert_array_equal(triad.apply(truth(), 0.01, np.random.default_rng(0)), truth())


@pytest.mark.parametrize("kind", [GyroTriad, AccelerometerTriad])
def test_without_advanced_terms_they_are_the_simple_triad(kind):
    got = kind(**NOISE).apply(truth(), 0.01, np.random.default_rng(1))
    np.testing.assert_array_equal(got, SimpleTriad(**NOISE).apply(truth(), 0.01, np.random.default_rng(1)))


def test_the_simple_triad_is_bias_moving_bias_and_white_noise():
    """Each axis with its own numbers: variance N^2 rate + sigma_b^2, covariance after 1 s sigma_b^2 exp(-1 / tau)."""
    triad = SimpleTriad(bias=[1.0, 2.0, 3.0], N=[0.1, 0.2, 0.0], sigma_b=[0.5, 0.0, 2.0], tau=[0.02, 1.0, 0.05])
    n, dt = 100_000, 0.1
    y = triad.apply(np.zeros((n, 3)), dt, np.random.default_rng(51))
    noise = [triad.noise(k) for k in range(3)]
    for k in range(3):
        a = np.exp(-dt / triad.tau[k])  # correlation of the moving bias from sample to sample
        gm, white = triad.sigma_b[k] ** 2, triad.N[k] ** 2 / dt
        assert noise[k] == NoiseModel((White(triad.N[k]), GaussMarkov(triad.sigma_b[k], triad.tau[k])))
        error = np.sqrt((gm * (1 + a) / (1 - a) + white) / n)
        assert abs(y[:, k].mean() - triad.bias[k]) < SIGMAS * error
        spread = np.sqrt(2.0 / n * (1 + a * a) / (1 - a * a)) * (gm + white)
        assert abs(y[:, k].var() - gm - white) < SIGMAS * spread
    assert abs(np.corrcoef(y.T) - np.eye(3)).max() < SIGMAS * 1.2 / np.sqrt(n)


def test_one_parameter_changes_nothing_but_its_own_effect():
    quiet = SimpleTriad(**{**NOISE, "N": [0.01, 0.0, 0.01]})
    difference = SimpleTriad(**NOISE).apply(truth(), 0.1, np.random.default_rng(2)) - quiet.apply(
        truth(), 0.1, np.random.default_rng(2)
    )
    assert not difference[:, [0, 2]].any()
    assert difference[:, 1].all()


def test_small_angles_are_symmetric_plus_skew():
    triad = GyroTriad(scale_factor=[1e-4, 2e-4, 3e-4], **ANGLES)
    M = triad.matrix(small_angle=True)
    S, A = 0.5 * (M + M.T), 0.5 * (M - M.T)
    np.testing.assert_allclose(A, -skew(ANGLES["misalignment"]), rtol=1e-14, atol=1e-18)  # rounding
    Dx, Dy, Dz = ANGLES["non_orthogonality"]
    expected = np.array([[1e-4, Dz, Dy], [Dz, 2e-4, Dx], [Dy, Dx, 3e-4]])
    np.testing.assert_allclose(S, expected, rtol=1e-14)  # rounding
    np.testing.assert_allclose(triad.matrix(), M, atol=1e-6)  # third powers of angles to 11 mrad


def test_a_turned_triad_is_misaligned():
    """Sensing axes turned by delta read C^T u."""
    delta = 1e-4 * np.array([1.0, -2.0, 3.0])
    response = np.eye(3) + GyroTriad(misalignment=delta).matrix()
    np.testing.assert_allclose(response, dcm_from_rotvec(delta).T, atol=1e-7)  # second order


def test_rows_of_the_thesis():
    """(6.1), (6.2) and (6.9), written out."""
    triad = AccelerometerTriad(
        scale_factor=[1e-3, 2e-3, 3e-3], asymmetry=[4e-3, 5e-3, 6e-3], quadratic=[1e-4, 2e-4, 3e-4], **ANGLES
    )
    (x, y, z), d, D = (3.0, -4.0, 5.0), ANGLES["misalignment"], ANGLES["non_orthogonality"]
    got = triad.respond([[x, y, z]])[0]
    a_x = 1.001 * x + 4e-3 * x + 1e-4 * x**2 + np.sin(D[2] + d[2]) * y + np.sin(D[1] - d[1]) * z
    a_y = 1.002 * y - 5e-3 * y + 2e-4 * y**2 + np.sin(D[2] - d[2]) * x + np.sin(D[0] + d[0]) * z
    a_z = 1.003 * z + 6e-3 * z + 3e-4 * z**2 + np.sin(D[1] + d[1]) * x + np.sin(D[0] - d[0]) * y
    np.testing.assert_allclose(got, [a_x, a_y, a_z], rtol=1e-14)  # rounding


@pytest.mark.parametrize("printed", [False, True])
def test_rows_of_the_gyroscopes(printed):
    """(6.7) corrected and as printed, (6.8), (6.9), written out with rates of the thesis: roll, yaw, pitch."""
    triad = GyroTriad(scale_factor=[1e-3, 2e-3, 3e-3], bias=[0.1, 0.2, 0.3], printed=printed, **ANGLES)
    (roll, yaw, pitch), d, D = (0.3, -0.4, 0.5), ANGLES["misalignment"], ANGLES["non_orthogonality"]
    sign = -1.0 if printed else 1.0
    g_roll = 1.001 * roll + np.sin(D[1] - sign * d[1]) * pitch + np.sin(D[2] + sign * d[2]) * yaw + 0.1
    g_yaw = 1.002 * yaw + np.sin(D[2] - d[2]) * roll + np.sin(D[0] + d[0]) * pitch + 0.2
    g_pitch = 1.003 * pitch + np.sin(D[1] + d[1]) * roll + np.sin(D[0] - d[0]) * yaw + 0.3
    got = triad.apply([[roll, yaw, pitch]], 0.01, np.random.default_rng(0))[0]
    np.testing.assert_allclose(got, [g_roll, g_yaw, g_pitch], rtol=1e-14)  # rounding


def test_angles_are_what_an_axis_reads_of_another():
    """(6.13)-(6.15): the angle about x from y and z, about y from x and z, about z from x and y; Delta alike."""
    for axis, (i, j) in enumerate([(1, 2), (0, 2), (0, 1)]):
        angle = np.zeros(3)
        angle[axis] = 0.2  # large: the sine shows
        turned = AccelerometerTriad(misalignment=angle).matrix()
        leaning = AccelerometerTriad(non_orthogonality=angle).matrix()
        assert np.arcsin([abs(turned[i, j]), abs(turned[j, i])]) == pytest.approx([0.2, 0.2], rel=1e-12)
        assert turned[i, j] == -turned[j, i]
        assert np.arcsin([leaning[i, j], leaning[j, i]]) == pytest.approx([0.2, 0.2], rel=1e-12)
        assert np.count_nonzero(turned) == np.count_nonzero(leaning) == 2


@pytest.mark.parametrize(("kind", "number"), [(SimpleTriad, 12), (GyroTriad, 21), (AccelerometerTriad, 27)])
def test_every_parameter_has_an_effect_of_its_own(kind, number):
    """None without effect, none with that of another; tau only beside a sigma_b."""
    u = np.array([[3.0, -4.0, 5.0], [-2.0, 1.0, -7.0]])
    effects = []
    for name in kind.names():
        for k in range(3):
            also = {"sigma_b": [1e-3] * 3} if name == "tau" else {}
            value = np.ones(3) if name == "tau" else np.zeros(3)
            value[k] = 0.01
            pair = kind(**also), kind(**also, **{name: value})
            without, with_it = (triad.apply(u, 0.1, np.random.default_rng(9)) for triad in pair)
            effects.append(with_it - without)
    flat = np.array(effects).reshape(number, -1)
    apart = np.abs(flat[:, None] - flat).max(axis=-1) + np.eye(number)
    assert np.abs(flat).max(axis=1).min() > 1e-7
    assert apart.min() > 1e-7


def test_print_differs_in_the_roll_row_only():
    """And there only by the signs of delta_Gy and delta_Gz."""
    d, D = np.array(ANGLES["misalignment"]), ANGLES["non_orthogonality"]
    right, printed = GyroTriad(**ANGLES), GyroTriad(**ANGLES, printed=True)
    np.testing.assert_array_equal(printed.matrix()[1:], right.matrix()[1:])
    flipped = GyroTriad(misalignment=d * [1, -1, -1], non_orthogonality=D)
    np.testing.assert_array_equal(printed.matrix()[0], flipped.matrix()[0])
    assert (printed.matrix()[0, 1:] != right.matrix()[0, 1:]).all()
    same = [GyroTriad(**{name: [0.0, 1e-4, 0.0]}, printed=True).matrix()[0, 2] for name in ANGLES]
    assert same[0] == same[1]  # what is wrong with it: delta_Gy cannot be told from Delta_Gy
    np.testing.assert_array_equal(
        GyroTriad(non_orthogonality=D, printed=True).matrix(), GyroTriad(non_orthogonality=D).matrix()
    )


def test_compensation_is_the_inverse():
    triad = AccelerometerTriad(
        bias=[0.01, -0.02, 0.03],
        scale_factor=[1e-2, -2e-2, 3e-2],
        asymmetry=[1e-3, -2e-3, 3e-3],
        quadratic=[1e-5, -2e-4, 3e-5],
        **ANGLES,
    )
    u = np.concatenate([truth(), np.zeros((1, 3)), [[80.0, -80.0, 0.0]]])
    y = triad.apply(u, 0.01, np.random.default_rng(3))
    np.testing.assert_allclose(triad.compensate(y), u, atol=1e-12)  # rounding
    gyro = GyroTriad(bias=[1e-3, 0.0, 0.0], scale_factor=[1e-2, 0.0, 0.0], **ANGLES)
    np.testing.assert_allclose(gyro.compensate(gyro.apply(u, 0.01, np.random.default_rng(3))), u, atol=1e-12)


def test_axes():
    up, right = [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    np.testing.assert_array_equal(frd_from_fur(up), [0.0, 0.0, -1.0])
    np.testing.assert_array_equal(frd_from_fur(right), [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(fur_from_frd(frd_from_fur(truth())), truth())
    assert np.linalg.det(C_FRD_FUR) == pytest.approx(1.0)  # so rates turn like vectors
    # at rest and level the y accelerometer of the thesis reads +g, our z accelerometer -g
    np.testing.assert_array_equal(fur_from_frd([0.0, 0.0, -9.8]), [0.0, 9.8, 0.0])


def test_imu_errors_read_the_same():
    gyro = GyroTriad(bias=[1e-3, 2e-3, 3e-3], scale_factor=[1e-3, 2e-3, 3e-3], **ANGLES)
    accel = AccelerometerTriad(bias=[0.1, 0.2, 0.3], scale_factor=[-1e-3, 2e-3, 3e-3], **ANGLES)
    errors = imu_errors(gyro, accel)
    omega, f = truth() * 0.01, truth()[::-1]
    got_g, got_a, _ = errors.apply_rates(frd_from_fur(omega), frd_from_fur(f), 0.01, np.random.default_rng(0))
    rng = np.random.default_rng(0)
    np.testing.assert_allclose(got_g, frd_from_fur(gyro.apply(omega, 0.01, rng)), atol=1e-14)  # rounding
    np.testing.assert_allclose(got_a, frd_from_fur(accel.apply(f, 0.01, rng)), atol=1e-13)  # rounding


def test_there_and_back():
    gyro, accel = GyroTriad(**NOISE, **ANGLES), AccelerometerTriad(scale_factor=[1e-3, 2e-3, 3e-3], **NOISE)
    back = triads_of(imu_errors(gyro, accel))
    for one, other in zip((gyro, accel), back, strict=True):
        assert other.parameters() == pytest.approx(one.parameters(), rel=1e-12, abs=1e-17)  # rounding
    M = 0.01 * np.random.default_rng(4).standard_normal((3, 3))
    errors = ImuErrors(b_g=[1.0, 2.0, 3.0], M_g=M, M_a=M.T, gyro_noise=NoiseModel((White(0.1),)))
    again = imu_errors(*triads_of(errors))
    np.testing.assert_allclose(again.M_g, M, rtol=1e-12)
    np.testing.assert_allclose(again.M_a, M.T, rtol=1e-12)
    np.testing.assert_array_equal(again.b_g, errors.b_g)
    assert again.gyro_noise.white == White(0.1)
    assert not triads_of(errors)[0].sigma_b.any()


def test_nonlinear_terms_are_dropped_only_on_request():
    accel = AccelerometerTriad(asymmetry=[1e-3, 0.0, 0.0], scale_factor=[1e-3, 0.0, 0.0])
    with pytest.raises(InputError, match="asymmetry: ImuErrors is linear"):
        imu_errors(SimpleTriad(), accel)
    assert imu_errors(SimpleTriad(), accel, drop_nonlinear=True).M_a[0, 0] == 1e-3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SimpleTriad(bias=[1.0]), r"bias: expected shape \(3,\)"),
        (lambda: SimpleTriad(N=[1.0, -1.0, 0.0]), "N: expected one finite number, not negative"),
        (lambda: SimpleTriad(tau=[1.0, 0.0, 1.0]), "tau: expected one positive"),
        (lambda: GyroTriad().apply(np.zeros(3), 0.1, np.random.default_rng(0)), r"u: expected shape \(n, 3\)"),
        (lambda: GyroTriad(scale_factor=[-1.0] * 3).compensate(np.ones((1, 3))), "no inverse"),
        (lambda: AccelerometerTriad(quadratic=[1.0] * 3).compensate(np.full((1, 3), -9.0)), "a small part of the resp"),
        (lambda: AccelerometerTriad(printed=True), "only the gyroscope's"),
        (lambda: imu_errors(SimpleTriad(N=[1.0, 2.0, 3.0]), SimpleTriad()), "gyro: expected the same N"),
        (lambda: imu_errors(SimpleTriad(N=[1.0, 2.0, 2.0]), SimpleTriad()), "gyro: expected the same N"),
        (lambda: imu_errors(SimpleTriad(), SimpleTriad(sigma_b=[2.0, 2.0, 1.0])), "accel: expected the same N"),
        (lambda: triads_of(ImuErrors(gyro_noise=TWO)), "gyro_noise: expected white noise and at most one Gauss"),
        (lambda: triads_of(ImuErrors(G_g=np.eye(3))), "G_g: the triads have no such error"),
        (lambda: triads_of(ImuErrors(gyro_range=1.0)), "gyro_range: the triads have no such error"),
        (lambda: triads_of(ImuErrors(M_a=np.full((3, 3), 2.0))), "M_a: expected off-diagonal elements that are sines"),
        (lambda: triads_of(ImuErrors(accel_noise=NoiseModel((RandomWalk(1.0),)))), "accel_noise: expected white"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call()
