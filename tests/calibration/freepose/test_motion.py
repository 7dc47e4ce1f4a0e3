"""Size effect and delay from turns: discretisation order, derivatives, covariance, laws."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.gyro import GyroFit
from schuler.calibration.freepose.motion import HELD, PLACES, gained_velocity
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.freepose.turns import Turns, vertical_residuals
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.units import G0

RELATIVE = np.array([[0.0, 0.0, 0.0], [0.02, -0.01, 0.03], [-0.02, 0.015, 0.01]])
COMMON = np.array([0.05, 0.07, 0.1])
ERRORS = ImuErrors(
    b_g=[0.01, -0.02, 0.005], b_a=[0.2, 0.1, -0.3], M_g=0.01 * np.arange(-4, 5).reshape(3, 3),
    M_a=[[0.01, 0.02, -0.01], [0.0, -0.01, 0.03], [0.0, 0.0, 0.02]],
)  # fmt: skip
N_G, N_A = 3e-4, 2e-3


def log_of(errors=ERRORS, seed=1, n=20, turns_seed=5, **options):
    rotvecs = spread_turns(n, np.random.default_rng(turns_seed))
    return hand_log(errors, np.random.default_rng(seed), rotvecs=rotvecs, **options)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("delay", [0.004, 0.0, -0.003])
def test_places_and_delay_are_found(delay):
    """Discretisation: second order in the sampling interval, 10 um and 1 us at 100 Hz; carried 0.1 m to and fro."""
    error = []
    for rate in (100.0, 200.0):
        imu = log_of(places=RELATIVE + COMMON, delay=delay, sway=0.1, rate_hz=rate, n=12)
        result = calibrate_freepose(imu, size_effect=True, delay=True)
        assert result.names[21:] == (*PLACES, "delay")
        error.append(np.abs(result.values[21:] - [*RELATIVE[1:].ravel(), delay]))
        assert {n: result.fixed[n] for n in HELD} == HELD
    assert error[0][:6].max() < 3e-5
    assert error[0][6] < 2e-6
    assert error[1][:6].max() < 0.35 * error[0][:6].max()  # a quarter is second order
    np.testing.assert_allclose(
        result.values[:21], calibrate_freepose(imu).values, atol=1e-15
    )  # they change nothing else


def test_without_them_the_unit_seems_to_gain_velocity():
    imu = log_of(places=RELATIVE, delay=0.004)
    velocity = calibrate_freepose(imu, size_effect=True, delay=True).residuals["velocity"]
    assert np.median(velocity.before) > 0.05
    assert velocity.rms < 1e-4


def test_one_place_for_all_accelerometers_is_no_size_effect():
    """Law: equal lever arms gain no velocity between rests. Discretisation."""
    result = calibrate_freepose(log_of(places=np.tile(COMMON, (3, 1))), size_effect=True)
    np.testing.assert_allclose(result.values[21:], 0.0, atol=3e-5)


def turns_of(imu, result) -> Turns:
    """The turns of a log of a perfect unit."""
    rates, up = imu.rates(), result.residuals["accel"].direction
    spans = [
        [np.searchsorted(imu.t, b), np.searchsorted(imu.t, a)]
        for (_, b), (a, _) in itertools.pairwise(result.extra["intervals"])
    ]
    pair = np.stack((np.arange(len(spans)), np.arange(1, len(spans) + 1)), axis=1)
    return Turns(rates.t, rates.gyro, rates.accel, 0.0, np.array(spans), pair, up, G0 * up, np.eye(3), np.zeros(3))


def test_the_true_places_of_all_three_leave_no_velocity():
    """The x accelerometer too, which the fit takes for its reference. Discretisation, 100 Hz."""
    places = RELATIVE + COMMON
    imu = log_of(ImuErrors(), places=places)
    turns = turns_of(imu, calibrate_freepose(imu))
    fit = fit_of(np.zeros((3, 3)), np.zeros(3))
    np.testing.assert_allclose(gained_velocity(turns, 1.0, fit, G0, places, 0.0)[0], 0.0, atol=1e-3)
    only_x = np.where(np.arange(3)[:, None] == 0, places, 0.0)
    assert np.abs(gained_velocity(turns, 1.0, fit, G0, only_x, 0.0)[0]).max() > 0.05


def test_g_sensitivity_is_taken_out_before():
    G = 2e-4 * np.array([[1.0, -0.5, 0.2], [0.3, -1.0, 0.6], [-0.4, 0.8, 0.7]])
    imu = log_of(replace(ERRORS, G_g=G), places=RELATIVE, delay=0.002)
    result = calibrate_freepose(imu, g_sensitivity=True, size_effect=True, delay=True)
    assert len(result.names) == 37
    np.testing.assert_allclose(result.values[30:], [*RELATIVE[1:].ravel(), 0.002], atol=3e-5)  # discretisation


def fit_of(M, b) -> GyroFit:
    """What :func:`gained_velocity` needs of a fit."""
    empty = np.zeros((0, 0))
    return GyroFit(
        M, b, np.zeros((3, 3)), (slice(0), slice(0), slice(0)), empty, empty, 0.0, 0.0, empty, 0.0, 0, empty, empty,
        empty, empty, empty, empty,
    )  # fmt: skip


@pytest.mark.parametrize("before", [0.0, 0.5])
def test_derivatives_by_places(before):
    """Linear in the places, so differences are exact but for rounding; turns that close, so that no tilt is left."""
    rng = np.random.default_rng(8)
    t = np.cumsum(rng.uniform(0.008, 0.012, 80))
    gyro, accel = 2.0 * rng.standard_normal((80, 3)), 10.0 * rng.standard_normal((80, 3))
    turns = Turns(
        t, gyro, accel, before, np.array([[3, 33], [35, 75]]), np.array([[0, 1], [1, 2]]), np.eye(3), np.eye(3),
        np.eye(3) + 0.01 * rng.standard_normal((3, 3)), 0.1 * rng.standard_normal(3),
    )  # fmt: skip
    M, b = 0.01 * rng.standard_normal((3, 3)), 0.01 * rng.standard_normal(3)
    C = vertical_residuals(turns, 1.1, M, b, None)[2]
    up = [np.array([0.6, 0.0, 0.8])]
    for k in range(2):
        up.append(C[k].T @ up[-1])
    turns = replace(turns, up=np.array(up))
    places = 0.1 * rng.standard_normal((3, 3))
    _, by_places, _ = gained_velocity(turns, 1.1, fit_of(M, b), G0, places, 0.0)
    for i, j in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, j] = 1.0
        twin = gained_velocity(turns, 1.1, fit_of(M, b), G0, places + d, 0.0)[0]
        twin = twin - gained_velocity(turns, 1.1, fit_of(M, b), G0, places, 0.0)[0]
        np.testing.assert_allclose(by_places[:, :, i, j], twin, atol=1e-10)


def test_derivative_by_delay():
    """Against a central difference over turns from rest to rest: 1 % is what straight lines between samples make."""
    imu = log_of(ImuErrors(), rate_hz=200.0)
    turns = turns_of(imu, calibrate_freepose(imu))
    fit = fit_of(np.zeros((3, 3)), np.zeros(3))
    v, _, by_delay = gained_velocity(turns, 1.0, fit, G0, np.zeros((3, 3)), 0.0)
    np.testing.assert_allclose(v, 0.0, atol=1e-3)
    h = 1e-4
    plus, minus = (gained_velocity(turns, 1.0, fit, G0, np.zeros((3, 3)), s * h)[0] for s in (1.0, -1.0))
    np.testing.assert_allclose(by_delay, (plus - minus) / (2.0 * h), atol=0.01 * np.abs(by_delay).max())
    assert np.abs(by_delay).max() > 5.0


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [20, pytest.param(400, marks=pytest.mark.slow)])
def test_covariance_is_the_scatter(runs):
    """Statistical, five standard errors, and 15 % for what the first two steps leave in and is not counted."""
    errors = replace(ERRORS, gyro_noise=NoiseModel((White(N_G),)), accel_noise=NoiseModel((White(N_A),)))
    z = []
    for k in range(runs):
        imu = log_of(errors, seed=k, places=RELATIVE, delay=0.002)
        r = calibrate_freepose(imu, noise=(N_G, N_A), size_effect=True, delay=True)
        z.append((r.values - [*(r.values[:21]), *RELATIVE[1:].ravel(), 0.002])[21:] / r.sigma[21:])
    z = np.array(z)
    scale = np.sqrt((z**2).mean(axis=0))
    assert (np.abs(scale - 1.0) < 5.0 / np.sqrt(2.0 * runs) + 0.15).all(), scale
