"""System matrices against finite differences of the navigation equations, and the compiled transition against them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.filtering.error_model import (
    ecef_from_ned_states,
    noise_density,
    sensor_matrices,
    system_matrix_ecef,
    system_matrix_ned,
)
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import derivative_ecef, derivative_ned

BLOCKS = ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")
LAYOUT = StateLayout({name: StateModel.constant(1.0) for name in BLOCKS})
M = LAYOUT.size - 9


def random_state(seed):
    rng = np.random.default_rng(seed)
    llh = np.array([rng.uniform(-1.3, 1.3), rng.uniform(-3, 3), rng.uniform(-500, 9000)])
    v_n = rng.uniform(-150, 150, 3) * [1, 1, 0.1]
    C_nb = rotation.dcm_from_rpy(rng.uniform(-1, 1, 3) * [1.0, 1.2, 3.0])
    omega, f = rng.normal(size=3), rng.normal(size=3) * 5 + [0, 0, -9.8]
    scale = np.concatenate([np.full(3, s) for s in (0.1, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3)])
    return llh, v_n, C_nb, omega, f, scale * rng.normal(size=M)


def sensed(estimates, true_parameters, omega, f):
    """What the filter makes of the true rate and force with its own parameter estimates: the exact sensor model."""
    b_g, b_a, M_g, M_a, G_g = sensor_matrices(LAYOUT, true_parameters)
    omega_m, f_m = b_g + omega + M_g @ omega + G_g @ f, b_a + f + M_a @ f
    b_g, b_a, M_g, M_a, G_g = sensor_matrices(LAYOUT, estimates)
    f_hat = np.linalg.solve(np.eye(3) + M_a, f_m - b_a)
    return np.linalg.solve(np.eye(3) + M_g, omega_m - b_g - G_g @ f_hat), f_hat


def numerical_F(derivative, C, v, position, omega, f, parameters, steps):
    """Jacobian of the error dynamics by central differences, errors as estimate minus truth."""
    C_dot0 = derivative(C, v, position, omega, f)[0]

    def rates(dx):
        C_hat = rotation.dcm_from_rotvec(dx[:3]) @ C
        omega_hat, f_hat = sensed(parameters + dx[9:], parameters, omega, f)
        C_dot, v_dot, r_dot = derivative(C_hat, v + dx[3:6], position + dx[6:9], omega_hat, f_hat)
        return np.concatenate((rotation.unskew(C_dot @ C.T + C_hat @ C_dot0.T), v_dot, r_dot))

    columns = []
    for k, step in enumerate(steps):
        dx = np.zeros(len(steps))
        dx[k] = step
        columns.append((rates(dx) - rates(-dx)) / (2 * step))
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(5))
def test_ecef_system_matrix_is_the_jacobian_of_the_mechanization(seed):
    llh, v_n, C_nb, omega, f, parameters = random_state(seed)
    r, C_en = frames.ecef_from_llh(llh), frames.C_en(llh)
    C, v = C_en @ C_nb, C_en @ v_n
    F = system_matrix_ecef(LAYOUT, C, r, omega, f, parameters)
    steps = np.concatenate((np.full(3, 1e-5), np.full(3, 1e-2), np.full(3, 100.0), np.full(M, 1e-5)))
    N = numerical_F(derivative_ecef, C, v, r, omega, f, parameters, steps)
    # discretisation of the central difference, relative to the size of each block
    np.testing.assert_allclose(F[:9, :6], N[:, :6], atol=1e-7)
    np.testing.assert_allclose(F[:9, 9:], N[:, 9:], rtol=1e-6, atol=1e-7)
    # the gradient is that of a sphere, flattening changes it by up to one percent
    np.testing.assert_allclose(F[3:6, 6:9], N[3:6, 6:9], atol=0.01 * np.abs(N[3:6, 6:9]).max())
    np.testing.assert_allclose(F[6:9, 6:9], N[6:9, 6:9], atol=1e-9)


@pytest.mark.parametrize("position", ["radians", "metres"])
@pytest.mark.parametrize("seed", range(5))
def test_ned_system_matrix_is_the_jacobian_of_the_mechanization(seed, position):
    llh, v, C, omega, f, parameters = random_state(seed)
    F = system_matrix_ned(LAYOUT, C, v, llh, omega, f, parameters, position=position)
    R_N, R_E = earth.radii_of_curvature(llh[0])
    scale = np.array([R_N + llh[2], (R_E + llh[2]) * np.cos(llh[0]), -1.0])
    steps = np.concatenate((np.full(3, 1e-5), np.full(3, 1e-2), [1e-6, 1e-6, 10.0], np.full(M, 1e-5)))
    N = numerical_F(derivative_ned, C, v, llh, omega, f, parameters, steps)
    if position == "metres":
        # dr = scale(llh) * dllh: its rate has the rate of the scale too
        N[:, 6:9] /= scale
        N[6:9] *= scale[:, None]
        llh_dot = derivative_ned(C, v, llh, omega, f)[2]
        ahead = llh + 1.0 * llh_dot
        R_N1, R_E1 = earth.radii_of_curvature(ahead[0])
        rate = np.array([R_N1 + ahead[2], (R_E1 + ahead[2]) * np.cos(ahead[0]), -1.0]) - scale
        N[6:9, 6:9] += np.diag(rate / scale)
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        for columns in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, None)):
            block = N[rows, columns]
            size = np.abs(block).max()
            # discretisation, relative to the block; the scale rate above is a forward difference
            np.testing.assert_allclose(F[rows, columns], block, atol=2e-4 * size + 1e-12)


def test_a_sign_error_in_the_gyro_bias_column_would_be_seen():
    """The comparison above has teeth: the error a rival ships changes a block by twice its size."""
    llh, _, C_nb, omega, f, _ = random_state(0)
    C, r = frames.C_en(llh) @ C_nb, frames.ecef_from_llh(llh)
    F = system_matrix_ecef(LAYOUT, C, r, omega, f)
    part = LAYOUT["b_g"]
    np.testing.assert_allclose(F[0:3, part], -C, atol=1e-12)
    np.testing.assert_allclose(F[3:6, LAYOUT["b_a"]], -C, atol=1e-12)


def test_ned_and_ecef_matrices_describe_one_motion():
    """Rotated into each other they differ only by how the axes themselves turn and lean with position."""
    llh, v_n, C_nb, omega, f, _ = random_state(3)
    v_n = np.zeros(3)
    lay = StateLayout({"b_a": StateModel.constant(1.0), "b_g": StateModel.constant(1.0)})
    C_en = frames.C_en(llh)
    T = ecef_from_ned_states(llh, lay.size)
    F_e = T.T @ system_matrix_ecef(lay, C_en @ C_nb, frames.ecef_from_llh(llh), omega, f) @ T
    F_n = system_matrix_ned(lay, C_nb, v_n, llh, omega, f)
    np.testing.assert_allclose(F_n[0:3, 0:3], F_e[0:3, 0:3], atol=1e-15)
    np.testing.assert_allclose(
        F_n[3:6, [0, 1, 2, 3, 4, 5, *range(9, 15)]], F_e[3:6, [0, 1, 2, 3, 4, 5, *range(9, 15)]], atol=1e-12
    )
    np.testing.assert_allclose(F_n[6:9, 3:6], F_e[6:9, 3:6], atol=1e-12)


def test_noise_density_turns_with_the_body():
    _, _, C_nb, *_ = random_state(1)
    Q = noise_density(LAYOUT, C_nb, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    np.testing.assert_allclose(Q[0:3, 0:3], C_nb @ np.diag([1.0, 2.0, 3.0]) @ C_nb.T)
    np.testing.assert_allclose(np.trace(Q[3:6, 3:6]), 15.0)


def test_state_rotation_is_orthogonal():
    T = ecef_from_ned_states([0.7, -2.0, 0.0], 15)
    np.testing.assert_allclose(T @ T.T, np.eye(15), atol=1e-15)


def compiled_transition(poly_of, h, steps, nav, lay, estimates):
    """Transition accumulated by the kernels over some samples of given interval polynomials."""
    from schuler.filtering.kernels import accumulation as acc_k
    from schuler.filtering.kernels import covariance as k
    from schuler.filtering.kernels import sensor_errors as sens_k
    from schuler.mechanization import kernels as mech

    m = lay.size - 9
    sens, acc, B, A = np.zeros(33), np.zeros(8), np.zeros((m, 9)), np.zeros((9, 9))
    past, moment = np.zeros((steps, acc_k.N_PAST)), np.zeros(3)
    A[2, 2] = 1.0
    sens_k.spread_estimates(estimates, lay.table(), lay.n_sensor, np.zeros((2, 3, 3)), sens)
    for i in range(steps):
        raw, poly = poly_of(i * h), np.zeros(18)
        sens_k.compensate(poly, raw, sens, h, True)
        force = mech.advance_ecef(nav, poly, h, earth.WGS84.omega_ie)
        acc_k.store_interval(past, i, acc, moment, nav, *force, poly, h, np.zeros(7))
    acc_k.parameter_columns(
        past, steps, acc, moment, sens, lay.table(), m, True, "G_g" in lay, np.zeros(9), np.zeros((4, 7, 9)), B
    )
    k.transition(A, acc, nav, earth.WGS84.omega_ie)
    return np.hstack((A, B.T))


@pytest.mark.parametrize("seed", range(4))
def test_compiled_transition_solves_the_error_equation(seed):
    """Accumulated over 0.1 s of turning, accelerating motion: it tends to the solution of dPhi/dt = F(t) Phi."""
    llh, v_n, C_nb, omega0, f0, parameters = random_state(seed)
    rng = np.random.default_rng(seed)
    omega1, f1 = rng.normal(size=3) * 5, rng.normal(size=3) * 20  # rates of change
    span = 0.1
    C_en = frames.C_en(llh)
    nav = np.concatenate((rotation.quat_from_dcm(C_en @ C_nb), C_en @ v_n, frames.ecef_from_llh(llh)))
    b_g, b_a, M_g, M_a, G_g = sensor_matrices(LAYOUT, parameters)

    def polynomials(h):
        """Raw increments' polynomials of what a sensor with these parameters would report."""

        def poly_of(t):
            out = np.zeros(18)
            w, f = omega0 + omega1 * t, f0 + f1 * t
            out[0:3] = h * (b_g + w + M_g @ w + G_g @ f)
            out[3:6] = h * h * (omega1 + M_g @ omega1 + G_g @ f1)
            out[9:12] = h * (b_a + f + M_a @ f)
            out[12:15] = h * h * (f1 + M_a @ f1)
            return out

        return poly_of

    def equation(t, y):
        C = y[:9].reshape(3, 3)
        omega, f = omega0 + omega1 * t, f0 + f1 * t
        F = system_matrix_ecef(LAYOUT, C, y[9:12], omega, f, parameters)
        C_dot, v_dot, r_dot = derivative_ecef(C, y[12:15], y[9:12], omega, f)
        Phi = y[15:].reshape(LAYOUT.size, LAYOUT.size)
        return np.concatenate((C_dot.ravel(), r_dot, v_dot, (F[:9] @ Phi).ravel(), np.zeros(M * LAYOUT.size)))

    y0 = np.concatenate(((C_en @ C_nb).ravel(), nav[7:10], nav[4:7], np.eye(LAYOUT.size).ravel()))
    end = solve_ivp(equation, (0.0, span), y0, rtol=1e-11, atol=1e-14).y[:, -1]
    expected = end[15:].reshape(LAYOUT.size, LAYOUT.size)[:9]
    errors = []
    for steps in (10, 20, 40):
        Phi = compiled_transition(polynomials(span / steps), span / steps, steps, nav.copy(), LAYOUT, parameters)
        worst = []
        for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
            for columns in (slice(0, 3), slice(3, 6), slice(6, 9), *(LAYOUT[b] for b in BLOCKS)):
                size = np.abs(expected[rows, columns]).max()
                if size > 1e-12:
                    worst.append(np.abs(Phi[rows, columns] - expected[rows, columns]).max() / size)
        errors.append(max(worst))
    # discretisation, mid-point rule: second order in the sample interval; 1e-5 remains of Coriolis on B, left out
    assert errors[0] < 1e-2, errors  # of the gyro columns of position, which are of third order in the span themselves
    assert errors[1] < errors[0] / 3.3 + 1e-5
    assert errors[2] < errors[1] / 3.3 + 1e-5


def test_what_turns_a_free_transition_is_that_of_its_system_matrix():
    """Without specific force Coriolis and gravity stand alone, less identity and drift, which hide them in a norm.

    Discretisation: 2 % is what gravity adds to Coriolis over a second, in the next order.
    """
    from schuler.filtering.kernels.covariance import transition

    r = frames.ecef_from_llh([0.7, -2.1, 300.0])
    A, acc, T = np.eye(9), np.zeros(8), 1.0
    acc[0] = T
    transition(A, acc, np.concatenate(([1.0, 0.0, 0.0, 0.0], np.zeros(3), r)), earth.WGS84.omega_ie)
    F = system_matrix_ecef(LAYOUT, np.eye(3), r, np.zeros(3), np.zeros(3), np.zeros(M))[:9, :9]
    drift = np.eye(9)
    drift[6:9, 3:6] = T * np.eye(3)
    left, expected = A - drift, expm(F * T) - drift
    for i in (0, 3, 6):
        for j in (0, 3, 6):
            block = expected[i : i + 3, j : j + 3]
            np.testing.assert_allclose(left[i : i + 3, j : j + 3], block, atol=0.02 * np.abs(block).max())


def test_coriolis_of_what_a_tilt_makes_of_specific_force_is_that_of_the_system_matrix():
    """Constant force in Earth axes for a second, less the force itself, beside which Coriolis does not show.

    Discretisation: 2 % is more than gravity and the next order of the Earth's turn add.
    """
    from schuler.filtering.kernels.covariance import transition

    r, f, T = frames.ecef_from_llh([0.7, -2.1, 300.0]), np.array([3.0, -2.0, 9.0]), 1.0
    A, acc = np.eye(9), np.concatenate(([T, 0.0], f * T, 0.5 * f * T * T))
    transition(A, acc, np.concatenate(([1.0, 0.0, 0.0, 0.0], np.zeros(3), r)), earth.WGS84.omega_ie)
    F = system_matrix_ecef(LAYOUT, np.eye(3), r, np.zeros(3), f, np.zeros(M))[:9, :9]
    left, expected = (X[3:6, 0:3] - T * F[3:6, 0:3] for X in (A, expm(F * T)))
    np.testing.assert_allclose(left, expected, atol=0.02 * np.abs(expected).max())


def test_unknown_position_unit_is_refused():
    llh, v, C, omega, f, _ = random_state(0)
    with pytest.raises(InputError, match="expected 'metres' or 'radians', got 'degrees'"):
        system_matrix_ned(LAYOUT, C, v, llh, omega, f, position="degrees")


def test_noise_density_along_a_body_axis_is_that_axis_own():
    """Variance of the projection on each sensor axis, for axes that differ: gyroscopes turn, accelerometers push."""
    _, _, C, *_ = random_state(3)
    gyro, accel = np.array([1.0, 4.0, 9.0]), np.array([16.0, 25.0, 36.0])
    Q = noise_density(LAYOUT, C, gyro, accel)
    np.testing.assert_allclose(np.diag(C.T @ Q[0:3, 0:3] @ C), gyro, rtol=1e-13)
    np.testing.assert_allclose(np.diag(C.T @ Q[3:6, 3:6] @ C), accel, rtol=1e-13)
    assert not Q[0:3, 3:6].any()


def test_parameters_forget_as_their_models_say():
    """Of a Gauss-Markov state the expectation decays with its time constant, in either axes; others stay."""
    models = {"b_a": StateModel.gauss_markov(1e-3, 200.0), "b_g": StateModel.gauss_markov(1e-6, 50.0)}
    layout = StateLayout({**models, "S_a": StateModel.constant(1.0), "S_g": StateModel.random_walk(1.0, 1e-3)})
    llh, v_n, C_nb, omega, f, _ = random_state(0)
    expected = np.diag(np.repeat([-1.0 / 200.0, -1.0 / 50.0, 0.0, 0.0], 3))
    C_eb, r_e = frames.C_en(llh) @ C_nb, frames.ecef_from_llh(llh)
    for F in (
        system_matrix_ecef(layout, C_eb, r_e, omega, f),
        system_matrix_ned(layout, C_nb, v_n, llh, omega, f),
    ):
        np.testing.assert_allclose(F[9:, 9:], expected, rtol=1e-14)  # rounding
        assert not F[9:, :9].any()


def test_sensor_errors_are_those_of_the_sensors_states_alone():
    more = StateLayout({**LAYOUT.models, "lever": StateModel.constant(1.0), "odometer": StateModel.constant(1.0)})
    est = np.random.default_rng(1).standard_normal(more.size - 9)
    for one, other in zip(sensor_matrices(more, est), sensor_matrices(LAYOUT, est[:M]), strict=True):
        np.testing.assert_array_equal(one, other)
