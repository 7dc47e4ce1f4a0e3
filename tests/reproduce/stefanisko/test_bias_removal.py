"""Stefanisko's two ways to remove a bias at rest: closed forms, an independent simulation, and what they must
refuse.
"""

import json

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.reproduce.stefanisko.study.bias_removal import (
    CHECK,
    STRATEGIES,
    bias_study,
    corrected_log,
    expected_at_rest,
    mean_removed,
    moving_mean_removed,
)
from schuler.reproduce.stefanisko.study.experiment import ACCEL_NOISE, ESIEE, GYRO_NOISE, IMU_INTERVAL_S

RUNS = 150


@pytest.fixture(scope="module")
def study():
    return bias_study(RUNS)


def still(seconds=6.0, rng=None, moving=False, bias=0.3):
    """A log at rest, or one that drives off and stops."""
    t = IMU_INTERVAL_S * np.arange(1, round(seconds / IMU_INTERVAL_S) + 1)
    rng = rng or np.random.default_rng(1)
    omega, f = expected_at_rest(ESIEE)
    gyro = omega + GYRO_NOISE / np.sqrt(IMU_INTERVAL_S) * rng.standard_normal((len(t), 3))
    accel = f + bias + ACCEL_NOISE / np.sqrt(IMU_INTERVAL_S) * rng.standard_normal((len(t), 3))
    if moving:
        accel[:, 0] += np.where(t > 4.0, 2.0 * np.sin(2.0 * np.pi * t / 7.0), 0.0)
    return ImuSeries(t, gyro, accel)


def test_the_mean_takes_a_constant_out_and_leaves_gravity():
    """The source subtracts gravity too (E23). Rounding."""
    _, f = expected_at_rest(ESIEE)
    samples = np.tile(f + np.array([0.5, -0.3, 0.1]), (100, 1))
    np.testing.assert_allclose(mean_removed(samples, samples, f), np.tile(f, (100, 1)), atol=1e-12)
    np.testing.assert_allclose(mean_removed(samples + 1.0, samples, f) - f, np.ones((100, 3)), atol=1e-12)
    with pytest.raises(InputError, match="at least one sample"):
        mean_removed(samples, np.empty((0, 3)), f)


@pytest.mark.parametrize("blocks", [False, True])
def test_the_moving_mean_by_its_definition(blocks):
    """Slow definition, sample by sample; rounding."""
    rng = np.random.default_rng(2)
    x, before, expected, w = rng.standard_normal((50, 3)), rng.standard_normal((20, 3)), np.array([1.0, 2.0, 3.0]), 7
    result = moving_mean_removed(x, w, expected, blocks=blocks, before=before)
    whole = np.concatenate((before[-w:], x))
    for k in range(50):
        j = (k // w) * w if blocks else k
        np.testing.assert_allclose(result[k], x[k] - whole[j : j + w].mean(axis=0) + expected, atol=1e-12)


def test_the_moving_mean_destroys_motion():
    """Displacement tends to half a window times velocity: of 125 m only 5 remain (3.10); discretisation."""
    h, w = IMU_INTERVAL_S, 167
    t = h * np.arange(4000)
    a = np.where(t < 4.0, 2.5, np.where((t > 12.5) & (t < 16.5), -2.5, 0.0))
    velocity = np.cumsum(a) * h
    v = float(velocity.max())
    corrected = moving_mean_removed(np.column_stack((a, a, a)), w, np.zeros(3), before=np.zeros((w, 3)))[:, 0]
    left = np.cumsum(np.cumsum(corrected) * h) * h
    assert np.sum(velocity) * h == pytest.approx(125.0, rel=0.01)
    assert left[round(12.0 / h)] == pytest.approx(0.5 * w * h * v, rel=0.02)


def test_end_errors_are_those_of_an_independent_simulation(study):
    """Its 400 runs, printed to two digits; ours with 150: 30 % is five standard errors."""
    for name in STRATEGIES:
        np.testing.assert_allclose(study.rms(name), CHECK[name], rtol=0.30)


def test_closed_forms_of_the_vertical(study):
    """Down sees accelerometer noise only: N sqrt(T^3/12) in-sample, N sqrt(7 T^3/12) outside; 4 standard errors."""
    spread = 4.0 / np.sqrt(2.0 * RUNS)
    root = ACCEL_NOISE * np.sqrt(20.0**3 / 12.0)
    assert study.rms("mean, same stretch")[2] == pytest.approx(root, rel=spread)
    assert study.rms("mean, stretch before")[2] == pytest.approx(np.sqrt(7.0) * root, rel=spread)


def test_in_sample_flatters(study):
    """The finding: judged on other data the mean is worse by a factor of about two, and loses to the moving mean."""
    inside, outside = study.rms("mean, same stretch"), study.rms("mean, stretch before")
    assert np.all(outside > 1.5 * inside)
    assert np.all(study.rms("moving mean, blocks") < outside)
    table = study.table()
    assert table.column("strategy") == list(STRATEGIES)
    json.dumps(study.to_dict())


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_stretch_of_a_log_is_corrected(strategy):
    log = still(20.0)
    part = corrected_log(log, strategy, 5.0, 8.0, ESIEE)
    _, f = expected_at_rest(ESIEE)
    assert part.t[0] >= 5.0 - 1e-6
    assert part.kind == "rate"
    left = np.abs(part.accel.mean(axis=0) - f)
    assert np.all(left > 0.25) if strategy == "none" else np.all(left < 0.02)


@pytest.mark.parametrize("strategy", STRATEGIES[1:])
def test_a_log_that_moves_is_refused(strategy):
    with pytest.raises(InputError, match="bias removal needs rest"):
        corrected_log(still(20.0, moving=True), strategy, 5.0, 8.0, ESIEE)
    corrected_log(still(20.0, moving=True), "none", 5.0, 8.0, ESIEE)


def test_what_cannot_be_done_is_said():
    with pytest.raises(InputError, match="expected one of none, mean"):
        corrected_log(still(), "median", 1.0, 3.0, ESIEE)
    with pytest.raises(InputError, match="no stretch before"):
        corrected_log(still(), "mean, stretch before", 1.0, 5.0, ESIEE, check_rest=False)
    with pytest.raises(InputError, match="window: expected 1 to 5"):
        moving_mean_removed(np.zeros((5, 3)), 6, np.zeros(3))
    with pytest.raises(InputError, match="before: expected at least 3"):
        moving_mean_removed(np.zeros((5, 3)), 3, np.zeros(3), before=np.zeros((2, 3)))


def test_interruption_keeps_the_runs_that_were_finished():
    def stop(fraction):
        if fraction >= 0.2:
            raise KeyboardInterrupt

    result = bias_study(10, length_s=2.0, progress=stop)
    assert len(result.end_n["none"]) == 2
    assert not result.complete
