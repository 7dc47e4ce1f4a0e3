"""Gravity and Earth rate as measurements of an IMU at rest: rows of H against numerical and printed derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from filter_cases import moved

from schuler import earth, frames, rotation
from schuler.filtering import measurements as ms
from schuler.filtering.error_model import sensor_matrices
from schuler.filtering.limits import MAX_STATES, N_VALUES, PLACES
from schuler.filtering.states import StateLayout, StateModel

OMEGA = earth.WGS84.omega_ie
THESIS = ("b_a", "b_g", "S_a", "M_a", "S_g", "M_g", "G_g")
#: Sensor blocks in several selections, with and without g-sensitivity; one order is not that of the kernels' tables.
LAYOUTS = {
    "thesis": THESIS,
    "full": ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g"),
    "run": ("G_g", "b_g_run", "b_a_run", "b_g", "b_a", "M_g"),
    "biases": ("b_g", "b_a"),
    "accelerometers": ("S_a", "b_a", "M_a"),
    "gyroscopes": ("M_g", "S_g", "b_g"),
    "no biases": ("M_a6", "G_g", "S_g"),
    "with others": ("b_a", "b_g", "G_g", "lever", "odometer"),
}
KINDS = [ms.GRAVITY, ms.GRAVITY_VECTOR, ms.EARTH_RATE, ms.EARTH_RATE_MAGNITUDE]
#: 1-sigma of the estimates that are linearised at: those of a cheap unit.
SIZES = {"b_a": 0.5, "b_g": 2e-3, "G_g": 1e-4, "S_a": 0.02, "S_g": 0.02, "M_a": 0.02, "M_g": 0.02}


def layout(name: str) -> StateLayout:
    return StateLayout({block: StateModel.constant(1.0) for block in LAYOUTS[name]})


def rows(kind, nav, est, z, lay):
    """H and y of the kernel."""
    from schuler.filtering.kernels import update as upd
    from schuler.filtering.kernels.sensor_errors import spread_estimates

    sens, reg = np.zeros(33), np.full(7, np.nan)  # regressors of the interval play no part
    spread_estimates(est, lay.table(), lay.n_sensor, np.zeros((2, 3, 3)), sens)
    H, y, U, values = np.zeros((3, MAX_STATES)), np.zeros(3), np.zeros((3, 3)), np.zeros(N_VALUES)
    values[: len(z)] = z
    at = np.array([lay[name].start if name in lay else -1 for name in PLACES])
    n = upd.measurement_rows(
        kind, values, np.zeros(3), nav, est, reg, sens, lay.table(), lay.n_sensor, at, OMEGA, H, y, U
    )
    assert n == ms.DIMENSIONS[kind]
    return H[:n, : lay.size], y[:n].copy()


def estimates(lay: StateLayout, rng: np.random.Generator, sign: float) -> np.ndarray:
    """Half-normal sizes, all of one sign."""
    est = np.zeros(lay.size - 9)
    for name in lay.models:
        part = slice(lay[name].start - 9, lay[name].stop - 9)
        est[part] = sign * SIZES.get(name[:3], 0.1) * np.abs(rng.normal(size=part.stop - part.start))
    return est


def resting(lay: StateLayout, rng: np.random.Generator, sign: float):
    """Navigation state of any attitude, estimates, and the readings such a unit has at rest if they are right."""
    llh = np.array([rng.uniform(-1.4, 1.4), rng.uniform(-3, 3), rng.uniform(-100, 4000)])
    C_nb = rotation.dcm_from_rpy(rng.uniform(-1, 1, 3) * [3.0, 1.5, 3.0])
    C_eb = frames.C_en(llh) @ C_nb
    nav = np.concatenate((rotation.quat_from_dcm(C_eb), 0.1 * rng.normal(size=3), frames.ecef_from_llh(llh)))
    est = estimates(lay, rng, sign)
    b_g, b_a, M_g, M_a, G_g = sensor_matrices(lay, est)
    f, w = -C_nb.T @ earth.gravity_ned(llh[0], llh[2]), C_nb.T @ earth.earth_rate_ned(llh[0])
    z = np.concatenate((b_a + f + M_a @ f, b_g + w + M_g @ w + G_g @ f))
    return llh, C_nb, nav, est, z


def numerical(kind, nav, est, z, lay, steps):
    """Jacobian of y with all errors, estimate minus truth, by central differences in the axes of ``nav``."""
    U = frames.C_en(frames.llh_from_ecef(nav[7:10])).T
    columns = []
    for k, step in enumerate(steps):
        sides = []
        for sign in (1.0, -1.0):
            dx = np.zeros(lay.size)
            dx[k] = sign * step
            displaced = moved(nav, dx)
            y = rows(kind, displaced, est + dx[9:], z, lay)[1]
            sides.append(U @ frames.C_en(frames.llh_from_ecef(displaced[7:10])) @ y if len(y) == 3 else y)
        columns.append((sides[0] - sides[1]) / (2.0 * step))
    return np.array(columns).T


#: Steps of the differences: Earth rate is 7e-5 rad/s, and its magnitude far from linear in anything as large.
STEPS = {"dv": 1e-2, "dr": 10.0, "b_a": 1e-4, "b_g": 1e-8, "G_g": 1e-9, "M_a": 1e-5, "S_a": 1e-5}


def steps_of(lay: StateLayout) -> np.ndarray:
    steps = np.empty(lay.size)
    for name in lay.blocks:
        steps[lay[name]] = STEPS.get(name[:3], 1e-4)
    return steps


def agree(H, N, lay, kind):
    """Block by block, relative to the block's size in N. Tolerance: discretisation of the differences, rounding."""
    size = 10.0 if kind in (ms.GRAVITY, ms.GRAVITY_VECTOR) else 2e-3
    for name in lay.blocks:
        if name == "dr":
            continue
        part, step = lay[name], STEPS.get(name[:3], 1e-4)
        # y is a difference of numbers of this size, biases and Earth rate
        rounding = 2e-15 * size / step
        block = np.abs(N[:, part]).max()
        np.testing.assert_allclose(H[:, part], N[:, part], atol=2e-6 * block + rounding, err_msg=name)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_the_jacobian_of_the_prediction(kind, name, sign):
    """At readings that agree with the state. Position is left out of H, see below."""
    lay, rng = layout(name), np.random.default_rng([kind, int(sign) + 1])
    for _ in range(3):
        _, _, nav, est, z = resting(lay, rng, sign)
        H, y = rows(kind, nav, est, z, lay)
        # rounding; the plumb line leans from the ellipsoid's normal by 3e-6 rad at 4 km, that times Earth rate
        assert np.all(np.abs(y) < (1e-8 if kind <= ms.GRAVITY_VECTOR else 2.4e-10))
        agree(H, numerical(kind, nav, est, z, lay, steps_of(lay)), lay, kind)
        np.testing.assert_array_equal(H[:, 3:9], 0.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_rows_where_readings_and_state_do_not_agree(kind, sign):
    """Readings off by 0.5 m/s^2 and 300 deg/h: sensor columns are those of the readings, not of what was expected.

    The attitude columns of the vector are by choice those of gravity itself: a tilt that is not found yet, or an
    error of the accelerometers, would otherwise tell about heading. Scale factors and misalignments see the Earth's
    rate, not the measured one, whose noise is in the difference too.
    """
    lay, rng = layout("full"), np.random.default_rng(int(sign) + 5)
    for _ in range(3):
        llh, _, nav, est, z = resting(lay, rng, sign)
        z = z + np.concatenate((0.5 * rng.normal(size=3), 1.5e-3 * rng.normal(size=3)))
        H, _ = rows(kind, nav, est, z, lay)
        N = numerical(kind, nav, est, z, lay, steps_of(lay))
        if kind == ms.GRAVITY_VECTOR:
            C_en = frames.C_en(llh)
            # psi x (C f) with C f = -g: the cross matrix of gravity, from Earth-fixed to north, east, down axes
            expected = rotation.skew(earth.gravity_ned(llh[0], llh[2])) @ C_en.T
            np.testing.assert_allclose(H[:, :3], expected, atol=1e-8)  # gravity of two formulas, rounding
            assert np.abs(N[:, :3] - H[:, :3]).max() > 0.1
            N[:, :3] = H[:, :3]
        if kind in (ms.EARTH_RATE, ms.EARTH_RATE_MAGNITUDE):
            for block in ("S_g", "M_g", "b_a", "S_a", "M_a6"):
                N[:, lay[block]] = H[:, lay[block]]
        agree(H, N, lay, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_position_hardly_matters(kind):
    """What is left out of H: at most 3.1e-6 m/s^2 of gravity a metre, 1.6e-6 of its direction, 1.2e-11 rad/s."""
    lay, rng = layout("thesis"), np.random.default_rng(kind)
    bound = {ms.GRAVITY: 3.2e-6, ms.GRAVITY_VECTOR: 3.2e-6}.get(kind, OMEGA / 6.3e6)
    for _ in range(5):
        _, _, nav, est, z = resting(lay, rng, 1.0)
        steps = steps_of(lay)
        steps[6:9] = 1000.0
        N = numerical(kind, nav, est, z, lay, steps)
        assert np.abs(N[:, 6:9]).max() < bound
        assert np.abs(N[:, 3:6]).max() < 1e-9


def test_given_gravity_replaces_that_of_the_ellipsoid():
    lay, rng = layout("thesis"), np.random.default_rng(8)
    llh, _, nav, est, z = resting(lay, rng, -1.0)
    g = earth.gravity_ned(llh[0], llh[2])
    more = 1.001 * np.linalg.norm(g)
    _, y = rows(ms.GRAVITY, nav, est, [*z, more], lay)
    np.testing.assert_allclose(y, [-0.001 * np.linalg.norm(g)], atol=1e-8)  # rounding of positions
    H, y = rows(ms.GRAVITY_VECTOR, nav, est, [*z, more], lay)
    np.testing.assert_allclose(y, 0.001 * g, atol=1e-8)
    H0, _ = rows(ms.GRAVITY_VECTOR, nav, est, z, lay)
    np.testing.assert_allclose(H[:, :3], 1.001 * H0[:, :3], rtol=1e-12)
    np.testing.assert_array_equal(H[:, 9:], H0[:, 9:])


def test_reduced_vector_takes_the_accelerometers_for_perfect():
    lay, rng = layout("full"), np.random.default_rng(9)
    _, _, nav, est, z = resting(lay, rng, 1.0)
    z[:3] += 0.1
    H, y = rows(ms.GRAVITY_VECTOR, nav, est, [*z, 0.0, 0.0], lay)
    reduced, y_reduced = rows(ms.GRAVITY_VECTOR, nav, est, [*z, 0.0, 1.0], lay)
    np.testing.assert_array_equal(y, y_reduced)
    np.testing.assert_array_equal(H[:, :3], reduced[:, :3])
    assert np.abs(H[:, 9:]).max() > 1.0
    np.testing.assert_array_equal(reduced[:, 3:], 0.0)


# -------------------------------------------------------------------------------------------- as printed by Yaman
# There all measurements are dz = external - indicated = H x, navigation errors indicated minus true, sensor errors
# what is in the readings. Estimate minus truth is minus that for sensors and the same for the attitude.


def printed(C_nb, f, w):
    """A*, A** of specific force and G*, G**, G*** of rate and force, (4-3), (4-4) corrected by FIX 8."""
    A2 = np.array([[f[1], f[2], 0], [0, 0, f[2]], [0, 0, 0]])
    G2 = np.array([[w[1], w[2], 0, 0, 0, 0], [0, 0, w[0], w[2], 0, 0], [0, 0, 0, 0, w[0], w[1]]])
    return np.diag(f), A2, np.diag(w), G2, np.kron(np.eye(3), f)


def at_zero(seed):
    """A state without sensor errors in the layout of the thesis."""
    lay, rng = layout("thesis"), np.random.default_rng(seed)
    llh, C_nb, nav, _, _ = resting(lay, rng, 1.0)
    f, w = -C_nb.T @ earth.gravity_ned(llh[0], llh[2]), C_nb.T @ earth.earth_rate_ned(llh[0])
    return lay, llh, C_nb, nav, f, w


def blocks_of(lay, H, *names):
    return np.hstack([H[:, lay[name]] for name in names])


@pytest.mark.parametrize("seed", range(3))
def test_printed_gravity_magnitude(seed):
    """(4-50): H_P1 = -(1/h) f' [I | A* | A**], at indicated readings with errors in them."""
    lay, _, C_nb, nav, f, w = at_zero(seed)
    f = f + np.random.default_rng(seed).normal(size=3)
    H, y = rows(ms.GRAVITY, nav, np.zeros(30), np.concatenate((f, w)), lay)
    A1, A2, *_ = printed(C_nb, f, w)
    h = np.linalg.norm(f)
    expected = -(1.0 / h) * f @ np.hstack((np.eye(3), A1, A2))
    # y is minus dz, its sensor errors are minus x: the same H
    np.testing.assert_allclose(blocks_of(lay, H, "b_a", "S_a", "M_a")[0], expected, rtol=1e-12)
    np.testing.assert_allclose(
        expected,
        -np.array([*f, f[0] ** 2, f[1] ** 2, f[2] ** 2, f[0] * f[1], f[0] * f[2], f[1] * f[2]]) / h,
        rtol=1e-12,
    )
    np.testing.assert_array_equal(blocks_of(lay, H, "dpsi", "dv", "dr", "b_g", "S_g", "M_g", "G_g"), 0.0)
    g = np.linalg.norm(earth.gravity_ned(*frames.llh_from_ecef(nav[7:10])[[0, 2]]))
    np.testing.assert_allclose(y, h - g, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_printed_earth_rate_magnitude(seed):
    """(4-57) with FIX 12: H_P2 = -(1/|w|) w' [I | 0 | G***]; the thesis drops S_g and M_g, kept here at Earth rate."""
    lay, _, C_nb, nav, f, earths = at_zero(seed)
    w = earths + 1e-3 * np.random.default_rng(seed).normal(size=3)
    H, y = rows(ms.EARTH_RATE_MAGNITUDE, nav, np.zeros(30), np.concatenate((f, w)), lay)
    *_, G1, G2, G3 = printed(C_nb, f, earths)
    h = np.linalg.norm(w)
    np.testing.assert_allclose(
        blocks_of(lay, H, "b_g", "G_g")[0], -(1.0 / h) * w @ np.hstack((np.eye(3), G3)), rtol=1e-12
    )
    np.testing.assert_allclose(H[0, lay["G_g"]].reshape(3, 3), -np.outer(w, f) / h, rtol=1e-12)
    np.testing.assert_allclose(
        blocks_of(lay, H, "S_g", "M_g")[0], -(1.0 / h) * w @ np.hstack((G1, G2)), rtol=1e-9
    )  # at most the Earth's rate: nothing beside the biases
    np.testing.assert_array_equal(blocks_of(lay, H, "dpsi", "dv", "dr", "b_a", "S_a", "M_a"), 0.0)
    np.testing.assert_allclose(y, h - OMEGA, atol=1e-18)


@pytest.mark.parametrize("seed", range(3))
def test_corrected_vertical_earth_rate(seed):
    """Yaman (4-51)-(4-57) along the vertical: u = f/|f| is up, z = Om sin L - u.w, H = -u' [I | G* | G** | G***]."""
    lay, llh, C_nb, nav, f, earths = at_zero(seed)
    w = earths + 1e-3 * np.random.default_rng(seed).normal(size=3)
    H, y = rows(ms.EARTH_RATE, nav, np.zeros(30), np.concatenate((f, w)), lay)
    *_, G1, G2, G3 = printed(C_nb, f, earths)
    u = f / np.linalg.norm(f)
    expected = -u @ np.hstack((np.eye(3), G1, G2, G3))
    np.testing.assert_allclose(blocks_of(lay, H, "b_g", "S_g", "M_g", "G_g")[0], expected, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(y, u @ w - OMEGA * np.sin(llh[0]), atol=1e-17)
    np.testing.assert_array_equal(blocks_of(lay, H, "dpsi", "dv", "dr"), 0.0)  # needs no attitude
    # the measured vertical turns with the accelerometers: (w - (u.w) u)/|f|, 1e-4 of the Earth's rate per mg
    lean = -(earths - (u @ earths) * u) / np.linalg.norm(f)
    A1, A2, *_ = printed(C_nb, f, w)
    np.testing.assert_allclose(
        blocks_of(lay, H, "b_a", "S_a", "M_a")[0], lean @ np.hstack((np.eye(3), A1, A2)), rtol=1e-9, atol=1e-18
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reduced", [False, True])
def test_printed_gravity_vector(seed, reduced):
    """(4-61) to (4-64): dz = g + C f = -[f_n x] dPsi + C (b_a + A* S_a + A** M_a); reduced without the sensors."""
    lay, llh, C_nb, nav, f, w = at_zero(seed)
    H, y = rows(ms.GRAVITY_VECTOR, nav, np.zeros(30), [*f, *w, 0.0, float(reduced)], lay)
    f_n = C_nb @ f
    # y is dz itself here, so the attitude has the printed sign and sensors (minus x) the other
    np.testing.assert_allclose(H[:, :3] @ frames.C_en(llh), -rotation.skew(f_n), atol=1e-8)
    A1, A2, *_ = printed(C_nb, f, w)
    expected = 0.0 if reduced else -C_nb @ np.hstack((np.eye(3), A1, A2))
    np.testing.assert_allclose(blocks_of(lay, H, "b_a", "S_a", "M_a"), expected, atol=1e-9)
    np.testing.assert_array_equal(blocks_of(lay, H, "dv", "dr", "b_g", "S_g", "M_g", "G_g"), 0.0)
    np.testing.assert_allclose(y, f_n + earth.gravity_ned(llh[0], llh[2]), atol=1e-8)


def test_turning_about_the_vertical_is_never_seen_by_gravity():
    """The rows of the vector have the vertical in their null space, at any attitude."""
    lay = layout("thesis")
    for seed in range(5):
        _, llh, _, nav, f, w = at_zero(seed)
        H, _ = rows(ms.GRAVITY_VECTOR, nav, np.zeros(30), np.concatenate((f, w)), lay)
        down = frames.C_en(llh)[:, 2]
        # north gravity is 7.9e-9 of height: at 4 km 3e-5 m/s^2
        assert np.abs(H[:, :3] @ down).max() < 1e-4


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("down", [-1.0, 1.0])
def test_magnitude_cannot_tell_earth_rate_from_g_sensitivity(axis, down):
    """The flaw of P2, Yaman (4-57): with axis i vertical, G_ii wrong by 2 Om sin L / g reads the same as the right one.

    The projection tells them apart: it sees twice the vertical Earth rate.
    """
    lay, latitude = layout("thesis"), np.radians(39.92)
    llh = np.array([latitude, 0.3, 0.0])
    up_b = -down * np.eye(3)[axis]
    # any attitude that has this direction up
    north = np.eye(3)[(axis + 1) % 3]
    C_nb = np.stack((north, np.cross(-up_b, north), -up_b))
    assert np.linalg.det(C_nb) == pytest.approx(1.0)
    g = np.linalg.norm(earth.gravity_ned(latitude, 0.0))
    f, w = g * up_b, C_nb.T @ earth.earth_rate_ned(latitude)
    nav = np.concatenate((rotation.quat_from_dcm(frames.C_en(llh) @ C_nb), np.zeros(3), frames.ecef_from_llh(llh)))
    wrong = 2.0 * OMEGA * np.sin(latitude) / g
    reading = w.copy()
    est = lay.values(G_g=wrong * np.eye(3).ravel())
    z = np.concatenate((f, reading))
    for kind, same in ((ms.EARTH_RATE_MAGNITUDE, True), (ms.EARTH_RATE, False)):
        _, true = rows(kind, nav, np.zeros(30), z, lay)
        _, y = rows(kind, nav, est, z, lay)
        assert abs(true[0]) < 1e-18
        if same:
            assert abs(y[0]) < 1e-18  # rounding
        else:
            np.testing.assert_allclose(abs(y[0]), 2.0 * OMEGA * np.sin(latitude), rtol=1e-6)
