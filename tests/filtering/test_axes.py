"""Body axes that nothing measures: what a covariance says of them when updates turn the estimates."""

from __future__ import annotations

import filter_cases as cases
import numpy as np
import pytest
from dense_filter import dense_smoother

from schuler import earth, frames, rotation
from schuler.filtering import engine
from schuler.filtering.engine import FilterOptions, FilterState, run
from schuler.filtering.error_model import parameter_columns, sensor_matrices
from schuler.filtering.initial_state import InitialState
from schuler.filtering.kernels.axes import turn_axes
from schuler.filtering.measurements import gnss_measurements
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.alignment import levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.observability.filter_system import change_of_axes

LLH = np.array([0.8, 0.2, 300.0])


def layout(states: int, sigma: float = 0.02) -> StateLayout:
    """Blocks of so many states, every response uncertain by ``sigma``."""
    models = {"b_a": 0.5, "b_g": 2e-3, "S_a": sigma, "S_g": sigma, "M_a6": sigma, "M_g": sigma, "G_g": 2e-5}
    return StateLayout({name: StateModel.constant(s) for name, s in list(models.items())[: {33: 6, 42: 7}[states]]})


def rotations(lay: StateLayout, C_eb: np.ndarray, estimates: np.ndarray) -> np.ndarray:
    """N (n, 3) by differences: attitude and responses of body axes turned by a little about each, and back."""
    N, h = np.zeros((lay.size, 3)), 1e-6
    _, _, M_g, M_a, G_g = sensor_matrices(lay, estimates)
    for a in range(3):
        R, R_back = (rotation.dcm_from_quat(rotation.quat_from_rotvec(s * h * np.eye(3)[a])) for s in (1.0, -1.0))
        N[:3, a] = rotation.rotvec_from_quat(rotation.quat_from_dcm(C_eb @ R @ (C_eb @ R_back).T)) / (2.0 * h)
        for k, (sensor, i, source) in enumerate(lay.table()):
            if source > 0:
                T = np.eye(3) + M_a if sensor == 1 else np.eye(3) + M_g if source >= 4 else G_g
                N[9 + k, a] = (T @ (R - R_back))[i, (source - 1) % 3] / (2.0 * h)
    return N


def turned(states: int, seed: int = 1, level: bool = False):
    """Covariances before and after, J, and N before and after, for random updates."""
    lay, rng = layout(states), np.random.default_rng(seed)
    n = lay.size
    nav = NavState.from_geodetic(0.0, LLH, np.zeros(3), np.array([0.0, 0.0, 0.7]) if level else rng.uniform(-1, 1, 3))
    A = rng.standard_normal((n, n))
    before = np.sqrt(lay.initial_variances()) * rng.standard_normal(n - 9)
    state = FilterState(
        InitialState(nav, A @ A.T, before), lay, np.full(3, 1e-8), np.full(3, 1e-6), FilterOptions(), 0.01
    )
    arrays, work = state.arrays, state.work
    P, q = arrays.P[:, :n].copy(), arrays.nav[:4].copy()
    arrays.nav[:4] = rotation.quat_multiply(rotation.quat_from_rotvec(0.1 * rng.standard_normal(3)), q)
    arrays.est[:] = before + 0.3 * np.sqrt(lay.initial_variances()) * rng.standard_normal(n - 9)
    down = np.ascontiguousarray(frames.C_en(LLH)[:, 2])
    turn_axes(
        arrays.P, arrays.nav, arrays.est, q, before, down, state.model.table, lay.n_sensor, arrays.sens, work.M,
        work.sums[0], work.B, work.W,
    )  # fmt: skip
    J = change_of_axes(work.B.T, n)
    N = [rotations(lay, rotation.dcm_from_quat(x), e) for x, e in ((q, before), (arrays.nav[:4], arrays.est))]
    return lay, P, arrays.P[:, :n], J, *N


@pytest.mark.parametrize("states", [33, 42])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rotations_before_become_rotations_after(states, seed):
    """``J N_before = N_after``; of differences, 1e-10. The covariance is turned by it, to rounding."""
    _, P, turned_P, J, before, after = turned(states, seed)
    np.testing.assert_allclose(J @ before, after, atol=1e-8)
    np.testing.assert_allclose(turned_P, J @ P @ J.T, rtol=0, atol=1e-12 * np.abs(P).max())
    assert np.abs(after - before).max() > 0.01


def test_other_directions_stay():
    """Errors of the sensors alone that act like each other, and the heading alone, are not turned (rounding)."""
    lay, _, _, J, *_ = turned(33, level=True)
    kept = np.zeros((lay.size, 2))
    kept[:3, 0] = frames.C_en(LLH)[:, 2]
    kept[lay["b_a"].start, 1], kept[lay["M_a6"].start + 1, 1] = 9.8, 1.0  # of x: bias, and x from z
    np.testing.assert_allclose(J @ kept, kept, atol=0.03 * 0.1)  # rows of I + M_a: second order
    np.testing.assert_allclose((J @ kept)[:, 0], kept[:, 0], atol=1e-12)


def test_nothing_is_learned_of_the_axes(drive_case):
    """Without a lever arm what is known of a rotation of both triads stays what it was, however large updates are.

    Discretisation, 1.2e-5 is seen. Without the change of axes the information is 3 to 20 times that.
    """
    lay = layout(33)
    rng = np.random.default_rng(5)
    parameters = np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9)
    log, _ = cases.corrupted(drive_case, lay, parameters, rng)
    schedule = gnss_measurements(cases.fixes(drive_case, rng, np.zeros(3)), np.zeros(3), gate=None)
    initial = cases.start(drive_case, lay, rng)
    P = initial.P.copy()
    P[:3, :3] = np.eye(3) * 9.0  # the start says nothing of the attitude
    psd = np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2)
    forward = run(log, schedule, InitialState(initial.nav, P, initial.parameters), lay, *psd, FilterOptions())
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay)
    prior = np.diag(lay.initial_variances() ** -1.0)
    N = rotations(lay, rotation.dcm_from_quat(result.states.q_eb[-1]), result.parameters[-1])
    information = N.T @ np.linalg.solve(result.covariance_e[-1], N)
    first = rotations(lay, np.eye(3), np.zeros(lay.size - 9))[9:]
    assert np.diag(information) == pytest.approx(np.diag(first.T @ prior @ first), rel=1e-3)


def test_smoother_equals_dense_rauch_tung_striebel(drive_case):
    """With nodes at which the axes are turned; the tolerance is the rounding of the recursion with inverses."""
    lay = cases.layout(33)
    result = cases.filtered(drive_case, lay, 1, smoother=True)[0]
    nodes = result._nodes
    assert np.sum(nodes.phi[:, 0] < 0.0) > 50
    _, P_s = dense_smoother(nodes, lay.size)
    at = np.searchsorted(nodes.t, result.t + 1e-9) - 1
    sigma = np.sqrt(np.einsum("kii->ki", P_s))[at]
    scale = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(result.smooth().covariance_e / scale, P_s[at] / scale, atol=1e-4)


def test_in_parts_to_the_last_bit(drive_case, monkeypatch):
    """The turn of the axes after a part's last updates is the first node of the next."""
    lay = cases.layout(33)
    once = cases.filtered(drive_case, lay, 1, smoother=True)[0].smooth()
    monkeypatch.setattr(engine, "_CHUNK", 3000)
    monkeypatch.setattr(engine, "_NODE_BYTES", 1)
    parts = cases.filtered(drive_case, lay, 1, smoother=True)[0]
    assert len(parts._nodes._parts) == 4
    np.testing.assert_array_equal(parts.smooth().covariance_e, once.covariance_e)


def test_levelling_teaches_nothing_of_cross_coupling():
    """The attitude of a rest is off by all that acts on forces there: a force left over is that of the noise."""
    lay, noise = layout(33), 1e-4
    level = levelling(np.array([0.0, 0.0, -9.8]), sigma_bias=0.5, sigma_noise=9.8 * noise).with_heading(0.3, 0.1, "")
    nav = NavState.from_geodetic(0.0, LLH, np.zeros(3), level.rpy_nb)
    start = InitialState.from_sigmas(nav, lay, attitude=np.zeros(3), velocity=np.ones(3), position=np.ones(3))
    P = start.aligned(level, lay).P
    tilt = np.sqrt(0.5**2 + (0.02 * 9.8) ** 2) / 9.8
    assert np.sqrt(np.diag(P)[:2]) == pytest.approx([tilt, tilt], rel=2e-3)  # gravity of the place
    C, f_b = level.C_nb, np.array([0.0, 0.0, -9.8])
    H = np.zeros((3, lay.size))
    H[:, :3] = -rotation.skew(C @ f_b)
    for k, (sensor, i, source) in enumerate(lay.table()):
        if sensor == 1:
            H[:, 9 + k] = -C[:, i] * (1.0 if source == 0 else f_b[source - 1])
    assert np.sqrt(np.diag(H @ P @ H.T)[:2]) == pytest.approx(9.8 * noise * np.ones(2), rel=0.2)


SIGMAS = {"b_a": 0.8, "b_g": 0.3, "S_a": 0.03, "S_g": 0.03, "M_a6": 0.02, "M_g": 0.02}
BIASED = StateLayout({name: StateModel.constant(sigma) for name, sigma in SIGMAS.items()})


def levelled_start(lay, truth):
    """Start of a level body at rest by accelerometers of some errors, and all its errors."""
    _, b_a, _, M_a, _ = sensor_matrices(lay, truth)
    f = (np.eye(3) + M_a) @ [0.0, 0.0, -np.linalg.norm(earth.gravity_ned(LLH[0], LLH[2]))] + b_a
    level = levelling(f, sigma_bias=0.8, sigma_noise=1e-4).with_heading(0.0, 1e-3, "given")
    nav = NavState.from_geodetic(0.0, LLH, np.zeros(3), level.rpy_nb)
    start = InitialState.from_sigmas(nav, lay, attitude=np.zeros(3), velocity=np.ones(3), position=np.ones(3))
    start = start.aligned(level, lay)
    psi = rotation.rotvec_from_dcm(level.C_nb)
    return start, np.concatenate((psi, np.zeros(6), start.parameters - truth))


def test_the_size_of_the_force_at_rest_tells_of_errors_along_gravity():
    """A bias of 0.8 m/s^2, a tilt of 5 deg: the error along the levelled force is known to 0.07 m/s^2, and no better.

    400 draws: mean square over variance 1, to 4 standard errors of the square of an exponential (0.14); with the tilt's
    share left out it is 2, taken off instead of added 5. Beforehand the error is known to 0.85 m/s^2.
    """
    rng, sigma = np.random.default_rng(3), np.sqrt(BIASED.initial_variances())
    ratio, spread = [], []
    for _ in range(400):
        truth = sigma * rng.standard_normal(len(sigma))
        start, dx = levelled_start(BIASED, truth)
        C = rotation.dcm_from_rpy(start.nav.rpy_nb)
        f_b = -C.T @ earth.gravity_ned(LLH[0], LLH[2])
        H = np.zeros(BIASED.size)
        columns = parameter_columns(BIASED, np.eye(3), np.zeros(3), f_b, start.parameters)[1]
        H[9:] = f_b @ columns / np.linalg.norm(f_b)
        variance = H @ start.P @ H
        ratio.append((H @ dx) ** 2 / variance)
        spread.append(np.sqrt(variance))
    assert 0.43 < np.mean(ratio) < 1.57
    assert 0.05 < np.mean(spread) < 0.09


def test_with_fewer_states_a_levelled_start_says_nothing_along_gravity():
    models = {name: model for name, model in BIASED.models.items() if name not in ("M_a6", "M_g")}
    lay = StateLayout(models)
    start, _ = levelled_start(lay, np.sqrt(lay.initial_variances()))
    assert not start.parameters.any()
    np.testing.assert_array_equal(np.diag(start.P)[9:], lay.initial_variances())
