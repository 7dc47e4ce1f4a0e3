"""Measurement rows against finite differences of the predicted measurement, and the schedule itself."""

from __future__ import annotations

import numpy as np
import pytest
from filter_cases import moved

from schuler import earth, frames, rotation
from schuler.exceptions import InputError
from schuler.filtering import measurements as ms
from schuler.filtering.limits import MAX_STATES, N_VALUES, PLACES
from schuler.filtering.states import StateLayout, StateModel
from schuler.recording.series import GnssSeries

SENSORS = ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")
LAYOUT = StateLayout({n: StateModel.constant(1.0) for n in (*SENSORS, "lever", "b_r", "b_v", "delay")})
AIDS = (
    "lever", "lever_v", "mount", "odometer", "clock", "clock_drift", "clock_2", "b_heading", "baro", "multipath_1",
    "multipath_2",
)  # fmt: skip
AIDED = StateLayout({n: StateModel.constant(1.0) for n in ("b_a", "b_g", "S_a", "S_g", "M_a", "M_g", "G_g", *AIDS)})
M = LAYOUT.size - 9


def rows(kind, nav, est, raw_rate, raw_force, lever, z, layout=LAYOUT):
    """H and y of the kernel, with the rate that the given parameter estimates make of the raw samples."""
    from schuler.filtering.kernels import update as upd
    from schuler.filtering.kernels.sensor_errors import spread_estimates

    sens = np.zeros(33)
    spread_estimates(est, layout.table(), layout.n_sensor, np.zeros((2, 3, 3)), sens)
    h = 0.01
    f = sens[15:24].reshape(3, 3) @ (raw_force - sens[3:6])
    w = sens[6:15].reshape(3, 3) @ (raw_rate - sens[0:3] - sens[24:33].reshape(3, 3) @ f)
    reg = np.concatenate(([h], h * f, h * w))
    H, y, U = np.zeros((3, MAX_STATES)), np.zeros(3), np.zeros((3, 3))
    at = np.array([layout[name].start if name in layout else -1 for name in PLACES])
    values = np.zeros(N_VALUES)
    values[: len(z)] = z
    n = upd.measurement_rows(
        kind, values, lever, nav, est, reg, sens, layout.table(), layout.n_sensor, at, earth.WGS84.omega_ie, H, y, U
    )
    assert n == ms.DIMENSIONS[kind]
    return H[:n, : layout.size], y[:n].copy(), U


def somewhere(rng):
    llh = np.array([rng.uniform(-1.2, 1.2), rng.uniform(-3, 3), 200.0])
    C_eb = frames.C_en(llh) @ rotation.dcm_from_rpy(rng.uniform(-1, 1, 3))
    return np.concatenate((rotation.quat_from_dcm(C_eb), rng.normal(size=3) * 20, frames.ecef_from_llh(llh)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", [ms.POSITION, ms.VELOCITY, ms.ZERO_VELOCITY, ms.FIX])
def test_measurement_rows_are_the_jacobian_of_the_prediction(kind, seed):
    rng = np.random.default_rng(seed)
    nav = somewhere(rng)
    est = 0.01 * rng.normal(size=M)
    omega, f, lever = rng.normal(size=3), rng.normal(size=3) * 10, rng.normal(size=3)
    z = nav[7:10].copy() if kind in (ms.POSITION, ms.FIX) else np.zeros(3)
    H, _, U = rows(kind, nav, est, omega, f, lever, z)
    np.testing.assert_allclose(U, frames.C_en(frames.llh_from_ecef(nav[7:10])).T, atol=1e-9)

    def predicted(dx):
        _, y, U1 = rows(kind, moved(nav, dx), est + dx[9:], omega, f, lever, z)
        return U @ U1.T @ y  # in the axes of the linearisation point

    steps = np.full(LAYOUT.size, 1e-4)
    steps[3:9], steps[LAYOUT["lever"].start :] = [1e-2] * 3 + [1.0] * 3, 0.1
    left_out = 6e-4 if kind == ms.VELOCITY else 0.0  # sensor errors on the acceleration times the delay of 10 ms
    for k, step in enumerate(steps):
        dx = np.zeros(LAYOUT.size)
        dx[k] = step
        column = (predicted(dx) - predicted(-dx)) / (2 * step)
        if kind == ms.VELOCITY and 6 <= k < 9:
            np.testing.assert_allclose(column, 0.0, atol=1e-4)  # NED axes lean by 1/R with position, left out of H
        elif left_out and 9 <= k < 9 + LAYOUT.n_sensor:
            delayed = 0.05 * abs(est[LAYOUT["delay"].start - 9]) * 500.0
            np.testing.assert_allclose(H[:, k], column, atol=delayed)
        else:
            # discretisation of the central difference, and positions that round at 1e-9 m / 1e-4
            np.testing.assert_allclose(H[:, k], column, atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_delayed_velocity_depends_on_velocity_through_coriolis(seed):
    """The prediction is linear in velocity, so its columns are exact differences: rounding alone is allowed."""
    rng = np.random.default_rng(seed)
    nav, est = somewhere(rng), np.zeros(M)
    est[LAYOUT["delay"].start - 9] = 10.0  # 2 omega_ie times this is 1.5e-3, well above rounding
    omega, f, lever = rng.normal(size=3), rng.normal(size=3) * 10, rng.normal(size=3)
    H, _, _ = rows(ms.VELOCITY, nav, est, omega, f, lever, np.zeros(3))
    for k in range(3, 6):
        dx = np.zeros(LAYOUT.size)
        dx[k] = 1.0
        ahead, behind = (rows(ms.VELOCITY, moved(nav, s * dx), est, omega, f, lever, np.zeros(3))[1] for s in (1, -1))
        np.testing.assert_allclose(H[:, k], 0.5 * (ahead - behind), rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "kind",
    [
        ms.LATERAL, ms.VERTICAL, ms.SPEED, ms.ZERO_RATE, ms.PSEUDORANGE, ms.RANGE_RATE, ms.HEADING, ms.HEIGHT,
        ms.GNSS_HEADING,
    ],
)  # fmt: skip
def test_rows_of_aids_are_the_jacobian_of_the_prediction(kind, seed):
    rng = np.random.default_rng(seed)
    nav = somewhere(rng)
    n = AIDED.size
    est = 0.05 * rng.normal(size=n - 9)
    omega, f, lever = rng.normal(size=3), rng.normal(size=3) * 10, rng.normal(size=3)
    up = nav[7:10] / np.linalg.norm(nav[7:10])
    to_sat = up + rng.normal(size=3) * 0.5
    satellite = nav[7:10] + 2.2e7 * to_sat / np.linalg.norm(to_sat)
    z = {
        ms.PSEUDORANGE: [*satellite, 2.2e7, seed % 2, seed % 3, 1.7],
        ms.RANGE_RATE: [*satellite, *(rng.normal(size=3) * 3e3), 100.0],
        ms.ZERO_RATE: omega,
    }.get(kind, [0.1])
    H, _, _ = rows(kind, nav, est, omega, f, lever, z, AIDED)
    steps = np.full(n, 1e-4)
    steps[3:9] = [1e-2] * 3 + [10.0] * 3
    for name in ("clock", "clock_drift", "clock_2", "baro", "lever", "lever_v"):
        steps[AIDED[name]] = 0.1
    for k, step in enumerate(steps):
        dx = np.zeros(n)
        dx[k] = step
        ahead = rows(kind, moved(nav, dx), est + dx[9:], omega, f, lever, z, AIDED)[1]
        behind = rows(kind, moved(nav, -dx), est - dx[9:], omega, f, lever, z, AIDED)[1]
        column = (ahead - behind) / (2 * step)
        if kind == ms.ZERO_RATE and 9 <= k < 9 + AIDED.n_sensor:
            # regressors are those of the interval, which the same errors change: products of errors are left out
            np.testing.assert_allclose(H[:, k], column, rtol=0.1, atol=0.1 * np.abs(H).max())
            continue
        # discretisation of the central difference; ranges and heights round at 4e-9 m / 1e-4
        bound = 5e-5 if kind in (ms.PSEUDORANGE, ms.HEIGHT) else 3e-6
        np.testing.assert_allclose(H[:, k], column, atol=bound * max(1.0, np.abs(column).max()))


def test_lever_arm_velocity_is_that_of_a_turning_body():
    """Body turning about down at 1 rad/s with the antenna 2 m ahead: it moves to the right with 2 m/s."""
    llh = np.array([0.8, 0.1, 0.0])
    nav = np.concatenate((frames.q_en(llh), np.zeros(3), frames.ecef_from_llh(llh)))
    _, y, _ = rows(
        ms.VELOCITY, nav, np.zeros(M), np.array([0, 0, 1.0]), np.zeros(3), np.array([2.0, 0, 0]), np.zeros(3)
    )
    np.testing.assert_allclose(y, [0.0, 2.0, 0.0], atol=1e-3)  # Earth rate on two metres


def test_rows_at_a_pole_are_finite():
    nav = np.concatenate(([1.0, 0, 0, 0], np.zeros(3), [0.0, 0.0, earth.WGS84.b]))
    H, _, U = rows(ms.POSITION, nav, np.zeros(M), np.zeros(3), np.zeros(3), np.ones(3), nav[7:10])
    assert np.isfinite(H).all()
    np.testing.assert_allclose(U @ U.T, np.eye(3), atol=1e-12)


def gnss(n=4):
    return GnssSeries(
        np.arange(n) + 0.25,
        np.tile([0.8, 0.1, 50.0], (n, 1)),
        np.tile(np.eye(3), (n, 1, 1)),
        np.zeros((n, 3)),
        np.tile(np.eye(3), (n, 1, 1)),
    )


def test_gnss_gives_position_then_velocity_at_each_epoch():
    s = ms.gnss_measurements(gnss(), [1.0, 0.0, 0.0])
    assert s.kind.tolist() == [ms.POSITION, ms.VELOCITY] * 4
    assert s.t.tolist() == [0.25, 0.25, 1.25, 1.25, 2.25, 2.25, 3.25, 3.25]
    assert np.all(s.lever == [1.0, 0.0, 0.0])
    assert len(ms.gnss_measurements(gnss(), [0, 0, 0], use_velocity=False)) == 4


def test_outages_take_gnss_only():
    s = ms.merged(ms.gnss_measurements(gnss(), [0, 0, 0]), ms.zero_velocity([0.5, 1.5, 2.5], 0.02))
    left = s.outside([(1.0, 2.3)])
    assert left.t.tolist() == [0.25, 0.25, 0.5, 1.5, 2.5, 3.25, 3.25]


def test_gate_threshold_is_the_chi_square_quantile():
    assert ms.gate_threshold(0.95, 3) == pytest.approx(7.8147, abs=1e-4)  # printed digits
    assert ms.gate_threshold(None, 3) == np.inf
    for probability in (0.0, 1.0, 1.5, -0.1):
        with pytest.raises(InputError, match="between 0 and 1"):
            ms.gate_threshold(probability, 3)


def test_sigmas_must_be_positive():
    with pytest.raises(InputError, match="expected positive values"):
        ms.position(0.0, [0, 0, 0], [1.0, 0.0, 1.0])


def test_single_measurements_take_sigmas_or_covariances():
    a = ms.position(1.0, [0.5, 0.2, 3.0], [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    b = ms.position(1.0, [0.5, 0.2, 3.0], np.diag([1.0, 4.0, 9.0]), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(a.R, b.R)
    np.testing.assert_allclose(frames.llh_from_ecef(a.z[0, :3]), [0.5, 0.2, 3.0], atol=1e-9)


def test_merging_nothing_is_empty():
    assert len(ms.merged()) == 0
    assert len(ms.merged(ms.MeasurementSchedule.empty())) == 0


def test_windows_contain_their_start_and_not_their_stop():
    t = np.array([0.0, 1.0, 1.5, 2.0, 3.0])
    np.testing.assert_array_equal(ms.in_windows(t, [(1.0, 2.0)]), [False, True, True, False, False])
    np.testing.assert_array_equal(ms.in_windows(t, [(0.0, 1.0), (2.0, 3.0)]), [True, False, False, True, False])


def test_zero_velocity_is_three_numbers_of_one_variance():
    """R is sigma squared on all axes, and the gate that of three degrees of freedom."""
    from scipy.stats import chi2

    s = ms.zero_velocity([0.5, 1.0], 0.03, gate=0.99)
    np.testing.assert_allclose(s.R, np.tile(9e-4 * np.eye(3), (2, 1, 1)), rtol=1e-15)
    np.testing.assert_allclose(s.gate, chi2.ppf(0.99, 3), rtol=1e-12)
    assert np.all(np.isinf(ms.zero_velocity([0.5], 0.03).gate))
    assert not s.z.any()


def test_every_kind_has_as_many_components_as_its_rows():
    """``rows`` compares them; and no two kinds, and no two ends of a measurement, are one number."""
    nav, kinds = somewhere(np.random.default_rng(0)), [k for k in ms.KINDS if k not in (*ms.RESET_KINDS, ms.ARC_START)]
    z = np.concatenate((nav[7:10] + np.array([2e7, 1e7, 0.0]), [2.2e7, 0.0, 0.0]))
    for kind in kinds:
        with np.errstate(invalid="ignore"):  # counted only: a carrier's other epoch is where its satellite is
            rows(kind, nav, np.zeros(M), np.zeros(3), np.array([0.0, 0.0, -9.8]), np.zeros(3), z)
    assert all(ms.DIMENSIONS[kind] == 3 for kind in ms.RESET_KINDS)
    assert ms.DIMENSIONS[ms.ARC_START] == 0
    assert (len(ms.KINDS), len(ms.STATUS)) == (21, 5)


def test_the_antenna_is_at_the_imu_and_the_gate_open_unless_said():
    for one in (
        ms.MeasurementSchedule.of(ms.HEADING, [1.0], [0.1], 0.01),
        ms.position(1.0, [0.5, 0.2, 3.0], [1.0, 1.0, 1.0]),
        ms.velocity(1.0, [0.5, 0.2, 3.0], [1.0, 1.0, 1.0]),
    ):
        np.testing.assert_array_equal(one.lever, np.zeros((1, 3)))
        assert np.isinf(one.gate).all() == (one.kind[0] == ms.HEADING)


def test_fixes_pass_the_gate_of_three_degrees_of_freedom():
    from scipy.stats import chi2

    for schedule in (
        ms.gnss_measurements(gnss(), [0, 0, 0], gate=0.99),
        ms.position(1.0, [0.5, 0.2, 3.0], [1.0, 1.0, 1.0], gate=0.99),
        ms.velocity(1.0, [0.5, 0.2, 3.0], [1.0, 1.0, 1.0], gate=0.99),
    ):
        np.testing.assert_allclose(schedule.gate, chi2.ppf(0.99, 3), rtol=1e-12)


def test_an_empty_schedule_has_the_shapes_of_one_without_times():
    none, empty = ms.MeasurementSchedule.of(ms.POSITION, [], [], []), ms.MeasurementSchedule.empty()
    for name in ("t", "kind", "z", "R", "lever", "gate"):
        assert getattr(empty, name).shape == getattr(none, name).shape
        assert getattr(empty, name).dtype == getattr(none, name).dtype


def test_what_no_filter_has_seen_is_unused():
    from schuler.filtering.filter_arrays import Aiding

    assert set(Aiding.of(ms.position(1.0, [0.8, 0.1, 300.0], [1.0, 1.0, 2.0])).status) == {ms.UNUSED}
    assert set(ms.STATUS) == {ms.UNUSED, ms.ACCEPTED, ms.REJECTED, ms.FORCED, ms.GATED}
