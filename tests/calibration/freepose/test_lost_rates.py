"""Clipped gyroscopes and spikes in the turns of a hand-rotated log: named, and their turns left out."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.lost_rates import clipped_rates, lost_rates, spiked_rates
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White


@pytest.fixture(scope="module")
def imu():
    rng = np.random.default_rng(3)
    errors = ImuErrors(
        b_a=np.array([0.1, -0.05, 0.2]), b_g=np.array([0.01, -0.02, 0.005]), M_a=0.01 * np.eye(3), M_g=0.02 * np.eye(3),
        gyro_noise=NoiseModel((White(1e-4),)), accel_noise=NoiseModel((White(1e-3),)),
    )  # fmt: skip
    return hand_log(errors, rng, rotvecs=spread_turns(14, rng), rest_s=3.0, turn_s=1.5, initial_rest_s=3.0).rates()


def spoiled(imu, how):
    gyro = imu.gyro.copy()
    moving = np.flatnonzero(np.linalg.norm(gyro, axis=1) > 1.0)
    if how == "clipped":
        limit = 0.8 * np.abs(gyro).max()
        gyro = np.clip(gyro, -limit, limit)
    elif how == "spikes":
        gyro[moving[[100, 260]], [1, 2]] += 20.0
    return replace(imu, gyro=gyro)


def test_a_log_without_them_has_none(imu):
    at, sentences = lost_rates(imu.t, imu.gyro)
    assert (len(at), sentences) == (0, ())
    resting = np.zeros((500, 3))
    assert len(lost_rates(imu.t[:500], resting)[0]) == 0


@pytest.mark.parametrize("unit", [1.0, 3754.9])
def test_clipped_samples_and_spikes_are_found_in_any_unit(imu, unit):
    clipped = spoiled(imu, "clipped").gyro
    at, axes = clipped_rates(unit * clipped)
    np.testing.assert_array_equal(at, np.flatnonzero((np.abs(clipped) >= np.abs(clipped).max()).any(axis=1)))
    assert set(axes) <= set("xyz")
    assert axes
    spikes = spoiled(imu, "spikes").gyro
    np.testing.assert_array_equal(spiked_rates(unit * spikes), np.flatnonzero((spikes != imu.gyro).any(axis=1)))


@pytest.mark.parametrize(("how", "word"), [("clipped", "clipped; turn more slowly"), ("spikes", "2 single rates")])
def test_turns_with_lost_rates_are_left_out_and_named(imu, how, word):
    """What is left determines M_g as well as so many turns can: a few times the sigma of all of them, not a hundred."""
    whole = calibrate_freepose(imu, halves=False)
    result = calibrate_freepose(spoiled(imu, how), halves=False)
    assert any(word in verdict for verdict in result.verdicts)
    at = [name.startswith("M_g") for name in result.names]
    z = (result.values - whole.values)[at] / result.sigma[at]
    assert np.sqrt(np.mean(z**2)) < 2.0  # statistical, nine numbers
    assert result.sigma[at].max() < 10.0 * whole.sigma[at].max()
    assert result.extra["turns"] < whole.extra["turns"] == 13
