"""Rates to increments, and increments to rotation and velocity change: exact cases, orders, and the compiled twin."""

from itertools import pairwise

import numpy as np
import pytest
from increments import rotation_vectors, velocity_changes
from scipy.integrate import solve_ivp

from schuler import rotation
from schuler.exceptions import InputError
from schuler.sensors.increments import integrate_rates

EPS = np.finfo(float).eps


def uneven(rng, n, mean=0.01):
    """Times with steps between half and one and a half of the mean."""
    return np.concatenate(([0.0], np.cumsum(mean * rng.uniform(0.5, 1.5, n - 1))))


def slope(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("even", [True, False])
def test_constant_rates_are_integrated_exactly_by_every_order(order, even, rng):
    t = np.linspace(0.0, 1.0, 101) if even else uneven(rng, 101)
    rate = np.array([0.3, -2.0, 9.8])
    increments = integrate_rates(t, np.tile(rate, (101, 1)), order)
    assert increments.shape == (100, 3)
    # rounding; of the divided differences, which are zero but for it
    np.testing.assert_allclose(increments, rate * np.diff(t)[:, None], rtol=1e-14)


@pytest.mark.parametrize(("order", "degree"), [(2, 1), (3, 1), (3, 2)])
@pytest.mark.parametrize("even", [True, False])
def test_polynomials_are_integrated_exactly_up_to_the_order(order, degree, even, rng):
    """Linear rates by the trapezoid, quadratic ones by the parabola; on uneven times too."""
    t = np.linspace(0.0, 1.0, 51) if even else uneven(rng, 51, 0.02)
    c = rng.standard_normal((degree + 1, 3))
    rate = sum(c[k] * t[:, None] ** k for k in range(degree + 1))
    integral = sum(c[k] * t[:, None] ** (k + 1) / (k + 1) for k in range(degree + 1))
    first = 1 if degree == 2 else 0  # the parabola needs two samples before
    increments = integrate_rates(t, rate, order)
    np.testing.assert_allclose(
        increments[first:], np.diff(integral, axis=0)[first:], rtol=0, atol=4e-15
    )  # rounding of the integral


def test_one_order_less_is_not_exact(rng):
    """The counterpart: the next degree is not integrated exactly, so the test above can fail."""
    t = uneven(rng, 51, 0.02)
    x = np.repeat(t[:, None], 3, axis=1)
    assert np.abs(integrate_rates(t, x, 1) - np.diff(x**2 / 2, axis=0)).min() > 1e-5
    assert np.abs(integrate_rates(t, x**2, 2) - np.diff(x**3 / 3, axis=0)).min() > 1e-7
    assert np.abs(integrate_rates(t, x**3, 3)[1:] - np.diff(x**4 / 4, axis=0)[1:]).min() > 1e-9


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("even", [True, False])
def test_the_global_error_falls_with_the_order(order, even):
    """Discretisation: the sum over a fixed time is of the stated order in the spacing."""
    steps, errors = np.array([0.04, 0.02, 0.01, 0.005]), []
    for dt in steps:
        n = round(4.0 / dt)
        # unevenness that is the same function at every resolution, so that the error has one constant
        s = np.linspace(0.0, 1.0, n + 1)
        t = 4.0 * (s if even else s + 0.05 * np.sin(2.0 * np.pi * s))
        rate = np.stack((np.sin(2.0 * t + 0.3), np.cos(3.0 * t), np.exp(-t)), axis=-1)
        exact = [(np.cos(0.3) - np.cos(8.3)) / 2.0, np.sin(12.0) / 3.0, 1.0 - np.exp(-4.0)]
        errors.append(np.linalg.norm(integrate_rates(t, rate, order).sum(axis=0) - exact))
    assert slope(steps, errors) == pytest.approx(order, abs=0.15)


def test_order_one_holds_the_newer_sample():
    t, rate = np.array([0.0, 0.1, 0.3]), np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    np.testing.assert_allclose(integrate_rates(t, rate, 1), [[0.4, 0.5, 0.6], [1.4, 1.6, 1.8]], rtol=4 * EPS)
    np.testing.assert_allclose(integrate_rates(t, rate, 2), [[0.25, 0.35, 0.45], [1.1, 1.3, 1.5]], rtol=4 * EPS)
    np.testing.assert_array_equal(integrate_rates(t, rate), integrate_rates(t, rate, 2))  # the default


def test_the_parabola_uses_no_later_sample(rng):
    """Causal: what comes later changes nothing, as a live filter needs."""
    t, rate = uneven(rng, 20), rng.standard_normal((20, 3))
    for order in (1, 2, 3):
        np.testing.assert_array_equal(integrate_rates(t[:12], rate[:12], order), integrate_rates(t, rate, order)[:11])


def test_two_samples_are_enough_for_every_order():
    t, rate = [0.0, 0.5], [[1.0, 0, 0], [3.0, 0, 0]]
    assert integrate_rates(t, rate, 1)[0, 0] == 1.5
    assert integrate_rates(t, rate, 2)[0, 0] == 1.0
    assert integrate_rates(t, rate, 3)[0, 0] == 1.0  # no history yet: trapezoid


@pytest.mark.parametrize(
    ("t", "rate", "order", "message"),
    [
        ([0.0], [[1.0, 2, 3]], 2, "t: expected at least two samples to integrate between, got 1"),
        ([0.0, 1.0], [[1.0, 2, 3]], 2, r"rate: expected shape \(2, 3\), got \(1, 3\)"),
        ([0.0, 1.0], [[1.0, 2], [1, 2]], 2, r"rate: expected shape \(2, 3\), got \(2, 2\)"),
        ([0.0, 1.0], np.ones((2, 3)), 4, "order: expected 1, 2 or 3, got 4"),
        ([0.0, 1.0], np.ones((2, 3)), "2", "order: expected 1, 2 or 3, got '2'"),
        ([0.0, np.nan], np.ones((2, 3)), 2, "t: expected finite numbers"),
    ],
)
def test_rates_that_cannot_be_integrated(t, rate, order, message):
    with pytest.raises(InputError, match=message):
        integrate_rates(t, rate, order)


def rates(t):
    """A smooth angular rate [rad/s] and specific force [m/s^2] whose directions wander."""
    omega = np.array([1.1 * np.cos(1.3 * t), 0.9 * np.sin(1.7 * t + 0.4), 0.5 + 0.8 * np.sin(0.9 * t)])
    f = np.array([2.0 * np.sin(1.9 * t), 3.0 * np.cos(1.1 * t + 0.2), -9.8 + 1.5 * np.sin(2.3 * t)])
    return omega, f


def true_intervals(limits, both=rates):
    """Increments, rotation vectors and velocity changes of intervals, from a high-order integration of the ODE."""

    def slope_of(t, y):
        omega, f = both(t)
        C = y[:9].reshape(3, 3)
        return np.concatenate(((C @ rotation.skew(omega)).ravel(), C @ f, omega, f))

    dtheta, dv, phi, u = [], [], [], []
    for a, b in pairwise(limits):
        start = np.concatenate((np.eye(3).ravel(), np.zeros(9)))
        end = solve_ivp(slope_of, (a, b), start, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        phi.append(rotation.rotvec_from_dcm(rotation.orthonormalise(end[:9].reshape(3, 3))))
        u.append(end[9:12])
        dtheta.append(end[12:15])
        dv.append(end[15:18])
    return np.array(dtheta), np.array(dv), np.array(phi), np.array(u)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.009, 0.011, 0.1, 0.5, 1.5, 3.0])
@pytest.mark.parametrize("even", [True, False])
def test_a_constant_rate_and_force_are_exact(angle, even, rng):
    """However far an interval turns: the rotation vector is the increment, the velocity change a closed integral."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    dt = np.full(6, 0.1) if even else rng.uniform(0.05, 0.15, 6)
    omega, f = angle / 0.1 * axis, np.array([1.0, -2.0, -9.8])
    dtheta, dv = omega * dt[:, None], f * dt[:, None]
    np.testing.assert_allclose(
        rotation_vectors(dtheta, dt), dtheta, rtol=0, atol=1e-14 * max(angle, 1e-300)
    )  # rounding
    # int C f dt with C = exp([w t x]): along the axis f, across it sine and versine
    phi = angle / 0.1 * dt[:, None]
    along, across, third = axis * (axis @ f), f - axis * (axis @ f), np.cross(axis, f)
    sine = np.sinc(phi / np.pi)
    versine = 0.5 * phi * np.sinc(phi / (2.0 * np.pi)) ** 2
    expected = dt[:, None] * (along + sine * across + versine * third)
    np.testing.assert_allclose(velocity_changes(dtheta, dv, dt), expected, rtol=0, atol=2e-14)  # rounding


def test_a_turn_about_a_fixed_axis_has_no_coning(rng):
    """However the rate changes in size: all increments are parallel, the rotation vector is their own."""
    dtheta = rng.standard_normal((50, 1)) * np.array([0.6, 0.0, -0.8]) * 0.1
    np.testing.assert_allclose(rotation_vectors(dtheta), dtheta, rtol=0, atol=4e-17)  # rounding
    dt = rng.uniform(0.5, 1.5, 50)
    np.testing.assert_allclose(rotation_vectors(dtheta, dt), dtheta, rtol=0, atol=4e-17)


def test_without_rotation_there_is_no_sculling(rng):
    dv = rng.standard_normal((20, 3))
    np.testing.assert_array_equal(velocity_changes(np.zeros((20, 3)), dv), dv)


@pytest.mark.parametrize(
    ("history", "rotation_order", "velocity_order"),
    # local errors: constant rates miss coning of order dt^3, a linear fit leaves dt^4, the parabola dt^5
    [(0, 3, 3), (1, 4, 4), (2, 5, 5), (3, 5, 5)],
)
@pytest.mark.parametrize("ratio", [1.0, 1.4], ids=["even", "uneven"])
def test_the_local_error_falls_with_the_order(history, rotation_order, velocity_order, ratio):
    """Discretisation: slope of one interval's error, after as many intervals before it as ``history``."""
    steps, errors = np.array([0.08, 0.04, 0.02, 0.01]) * 2.0, []
    for h in steps:
        dt = h * ratio ** np.arange(history + 1)[::-1]
        limits = 0.7 + np.concatenate((-np.cumsum(dt[::-1])[::-1], [0.0]))  # the last interval ends at 0.7
        dtheta, dv, phi, u = true_intervals(limits)
        given = None if ratio == 1.0 else np.diff(limits)
        errors.append(
            (
                np.linalg.norm(rotation_vectors(dtheta, given)[-1] - phi[-1]),
                np.linalg.norm(velocity_changes(dtheta, dv, given)[-1] - u[-1]),
            )
        )
    turn, speed = np.transpose(errors)
    assert slope(steps, turn) == pytest.approx(rotation_order, abs=0.25)
    assert slope(steps, speed) == pytest.approx(velocity_order, abs=0.25)


def test_the_global_error_is_of_fourth_order():
    """Attitude and velocity after a fixed time, at four rates; two intervals before the start serve as history."""
    steps, errors = np.array([0.1, 0.05, 0.025, 0.0125]), []
    _, _, phi_true, u_true = true_intervals(np.array([0.0, 2.0]))
    x, w = np.polynomial.legendre.leggauss(8)
    for h in steps:
        limits = h * np.arange(-2, round(2.0 / h) + 1)
        omega, f = (np.moveaxis(a, 0, -1) for a in rates(limits[:-1, None] + 0.5 * h * (1.0 + x)))
        dtheta, dv = 0.5 * h * np.einsum("k,nki->ni", w, omega), 0.5 * h * np.einsum("k,nki->ni", w, f)
        C, v = np.eye(3), np.zeros(3)
        for phi, u in zip(rotation_vectors(dtheta)[2:], velocity_changes(dtheta, dv)[2:], strict=True):
            v = v + C @ u
            C = C @ rotation.dcm_from_rotvec(phi)
        turned = rotation.rotvec_from_dcm(C @ rotation.dcm_from_rotvec(phi_true[0]).T)
        errors.append((np.linalg.norm(turned), np.linalg.norm(v - u_true[0])))
    turn, speed = np.transpose(errors)
    assert slope(steps, turn) == pytest.approx(4.0, abs=0.3)
    assert slope(steps, speed) == pytest.approx(4.0, abs=0.3)


def test_classical_coning():
    """Increments taken for rotation vectors drift by ``a^2 (wh - sin wh) / 2`` each; corrected, by 1 percent of it."""
    a, w, h = 0.01, 2.0 * np.pi * 5.0, 0.005

    def omega_integral(t):
        # body rate (-w sin a sin wt, w sin a cos wt, -2 w sin^2(a / 2)), integrated
        s = np.sin(a)
        return np.stack((s * np.cos(w * t), s * np.sin(w * t), -2.0 * w * np.sin(0.5 * a) ** 2 * t), axis=-1)

    def drift(vectors):
        q = np.array([1.0, 0.0, 0.0, 0.0])
        for v in vectors[40:]:
            q = rotation.quat_multiply(q, rotation.quat_from_rotvec(v))
        return np.linalg.norm(rotation.rotvec_from_quat(q))

    dtheta = np.diff(omega_integral(h * np.arange(401)), axis=0)  # ten turns of the cone; nine are looked at
    uncorrected = 360 * 0.5 * a**2 * (w * h - np.sin(w * h))
    assert drift(dtheta) == pytest.approx(uncorrected, rel=1e-3)  # of order a^2, relative
    assert drift(rotation_vectors(dtheta)) < 0.01 * uncorrected


def test_an_interval_uses_itself_and_two_before(rng):
    """The first none, the second one, the others two; nothing later."""
    dtheta, dv = 0.1 * rng.standard_normal((2, 12, 3))
    dt = rng.uniform(0.5, 1.5, 12)
    for given in (None, dt):
        phi, u = rotation_vectors(dtheta, given), velocity_changes(dtheta, dv, given)
        np.testing.assert_allclose(phi[0], dtheta[0], rtol=0, atol=2e-17)
        for k in range(12):
            part = slice(max(0, k - 2), k + 1)
            h = None if given is None else given[part]
            np.testing.assert_allclose(
                rotation_vectors(dtheta[part], h)[-1], phi[k], rtol=1e-13, atol=1e-16
            )  # rounding
            np.testing.assert_allclose(velocity_changes(dtheta[part], dv[part], h)[-1], u[k], rtol=1e-13, atol=1e-16)
        if given is None:
            alone = rotation_vectors(dtheta[11:], given)
            assert np.abs(alone[0] - phi[11]).max() > 1e-5  # the history does matter


def test_only_ratios_of_the_intervals_count(rng):
    dtheta, dv = 0.1 * rng.standard_normal((2, 12, 3))
    for h in (1e-3, 1.0, 250.0):
        dt = np.full(12, h)
        np.testing.assert_allclose(
            rotation_vectors(dtheta, dt), rotation_vectors(dtheta), rtol=0, atol=1e-15
        )  # rounding
        np.testing.assert_allclose(velocity_changes(dtheta, dv, dt), velocity_changes(dtheta, dv), rtol=0, atol=1e-15)


def test_rotated_axes_give_rotated_answers(rng):
    """Frame invariance of coning and sculling."""
    dtheta, dv = 0.2 * rng.standard_normal((2, 12, 3))
    C = rotation.dcm_from_rotvec(rng.standard_normal(3))
    np.testing.assert_allclose(rotation_vectors(dtheta @ C.T), rotation_vectors(dtheta) @ C.T, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        velocity_changes(dtheta @ C.T, dv @ C.T), velocity_changes(dtheta, dv) @ C.T, rtol=0, atol=1e-15
    )  # rounding


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_short_logs(n, rng):
    dtheta, dv = 0.1 * rng.standard_normal((2, n, 3))
    assert rotation_vectors(dtheta).shape == (n, 3)
    assert velocity_changes(dtheta, dv).shape == (n, 3)
    assert np.isfinite(velocity_changes(dtheta, dv, np.full(n, 0.01))).all()


def test_increments_that_cannot_be_used():
    with pytest.raises(InputError, match=r"increments: expected shape \(n, 3\), got \(4,\)"):
        rotation_vectors(np.zeros(4))
    with pytest.raises(InputError, match=r"dt: expected shape \(4,\), got \(3,\)"):
        rotation_vectors(np.zeros((4, 3)), np.ones(3))
    with pytest.raises(InputError, match="expected finite numbers"):
        rotation_vectors(np.full((4, 3), np.nan))


@pytest.fixture(scope="module")
def compiled():
    """``fit_interval`` and ``body_integrals`` of the compiled mechanization over a log."""
    import numba

    from schuler.mechanization import kernels as _kernels

    fit_interval, body_integrals = _kernels.fit_interval, _kernels.body_integrals

    @numba.njit
    def run(increments, dt):
        poly, out = np.zeros(18), np.empty((len(dt), 6))
        none = np.zeros(6)
        for k in range(len(dt)):
            before = increments[k - 1] if k > 0 else none
            earlier = increments[k - 2] if k > 1 else none
            h1 = dt[k - 1] if k > 0 else 0.0
            h2 = dt[k - 2] if k > 1 else 0.0
            fit_interval(poly, increments[k], before, earlier, dt[k], h1, h2)
            p = body_integrals(poly)
            for i in range(6):
                out[k, i] = p[i]
        return out

    return run


@pytest.mark.parametrize("size", [1e-9, 1e-4, 0.03, 0.6], ids=lambda s: f"{s:g} rad")
@pytest.mark.parametrize("steps", ["even", "uneven", "gap"])
def test_the_compiled_mechanization_does_the_same_arithmetic(compiled, size, steps, rng):
    n = 60
    dtheta, dv = size * rng.standard_normal((n, 3)), 0.1 * rng.standard_normal((n, 3))
    dt = np.full(n, 0.01)
    if steps == "uneven":
        dt = 0.01 * rng.uniform(0.5, 1.5, n)
    elif steps == "gap":
        dt[30] = 0.2
    out = compiled(np.ascontiguousarray(np.hstack((dtheta, dv))), dt)
    np.testing.assert_allclose(out[:, :3], rotation_vectors(dtheta, dt), rtol=1e-12, atol=1e-12 * size)  # rounding
    # rounding; and the compiled series of (1 - cos x) / x^2 stops 2e-12 short of it for turns just below 0.5 rad
    atol = 1e-14 if size < 0.1 else 5e-13
    np.testing.assert_allclose(out[:, 3:], velocity_changes(dtheta, dv, dt), rtol=1e-12, atol=atol)
