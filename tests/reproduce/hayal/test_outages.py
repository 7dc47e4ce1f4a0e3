"""Hayal's outage study, emulated: honest, and as large as an independent prototype; the source's are out of reach."""

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import DivergenceError, InputError
from schuler.navigation.evaluation import outages
from schuler.navigation.states import imu_spec, state_layout
from schuler.reproduce.hayal.study.outages import outage_grid
from schuler.reproduce.hayal.study.tables import LENGTHS, PROTOTYPE, PUBLISHED, SEEDINGS
from schuler.reproduce.hayal.study.walk import (
    CalibrationSigma,
    CartWalk,
    cart_config,
    cart_recording,
    seeded_start,
)


@pytest.fixture(scope="module")
def walk():
    return CartWalk.of(6.0, rate_hz=50.0)


@pytest.fixture(scope="module")
def grid(walk):
    return outage_grid(walk, imus=("HG1700",), seedings=("Original", "3.3"), draws=6, outages=8, seed=3)


def test_the_tables_are_those_printed():
    assert PUBLISHED["HG1700", 60.0][1] == (24.0717, 147.1561)
    gain = 100.0 * (1.0 - 147.1561 / 183.4135)
    assert gain == pytest.approx(19.8, abs=0.05)  # the abstract's number; printed digits
    assert set(PROTOTYPE) == {(imu, s) for imu in ("HG1700", "HG1900") for s in SEEDINGS}


def test_sizes_of_the_prototype(grid):
    """Another program, two draws of 66 outages: 40 %, since ours has six draws of a short walk; statistical."""
    for k, length in enumerate(LENGTHS):
        assert grid.total("HG1700", "Original", length) == pytest.approx(PROTOTYPE["HG1700", "Original"][k], rel=0.40)


def test_the_filter_is_honest_in_every_outage(grid):
    """Six independent draws, outages of one draw share their biases: NEES within 0.5 to 1.7; statistical."""
    for s in grid.statistics.values():
        for length in LENGTHS:
            assert 0.5 < s.nees(length) < 1.7, (s.name, length)


def test_a_calibration_gains_little_where_gps_estimates_the_biases(grid):
    """Improvement of 0.3 to 4 % in the field's configuration. Law: no more than a fifth either way."""
    for length in LENGTHS:
        gain = 1.0 - grid.total("HG1700", "3.3", length) / grid.total("HG1700", "Original", length)
        assert abs(gain) < 0.2


def test_the_start_has_the_calibrations_values_and_covariance(walk):
    recording, errors, _ = cart_recording(walk, "HG1700", 1, 0, False)
    config = cart_config("HG1700", wander=False)
    layout = state_layout(config, imu_spec(config))
    sigma = CalibrationSigma(np.arange(1.0, 10.0) * 1e-5, np.arange(1.0, 10.0) * 1e-6, np.full(3, 2e-6))
    starts = {s: seeded_start(recording, config, errors, s, sigma, np.random.default_rng(5)) for s in SEEDINGS}
    spread = {s: np.sqrt(np.diag(start.P)) for s, start in starts.items()}
    assert np.all(starts["Original"].parameters == 0.0)
    np.testing.assert_allclose(spread["3.0"][layout["S_a"]], sigma.accel[3:6])
    np.testing.assert_allclose(spread["3.3"][layout["b_g"]], sigma.gyro_bias)
    np.testing.assert_allclose(spread["3.9"][layout["b_g"]], sigma.gyro[:3])
    M_g = layout["M_g"]
    np.testing.assert_allclose(spread["3.9"][M_g][[0, 1, 3]], sigma.gyro[6:])
    for start in starts.values():  # zero in truth and filter: 27 states live
        assert np.all(np.diag(start.P)[M_g][[2, 4, 5]] == 0.0)
    left = starts["3.9"].parameters[layout["b_a"].start - 9 :][:3] - errors.b_a
    assert np.all(np.abs(left) < 5.0 * sigma.accel[:3])
    np.testing.assert_array_equal(starts["3.0"].nav.r_eb_e, starts["3.9"].nav.r_eb_e)  # shared draws
    assert np.all(errors.M_g[np.tril_indices(3, -1)] == 0.0)


def test_calibration_sigmas_of_the_method():
    """Attitude subset 3 is nearly singular in one angle: 808 urad against 49 and 43 in an independent program."""
    sigma = CalibrationSigma.of("HG1700")
    assert sigma.accel[7] > 5.0 * max(sigma.accel[6], sigma.accel[8])
    assert sigma.gyro_bias.max() < 1e-5
    assert sigma.gyro[3:6].min() > 10.0 * 150e-6  # scale factors from Earth rate: worse than the data sheet


def test_the_table_has_source_and_prototype(grid):
    table = grid.table()
    assert len(table) == 2 * len(LENGTHS)
    row = table.row(imu="HG1700", seeding="3.3", outage_s=60.0)
    assert row["source_sigma_m"] == 147.8637
    assert row["source_gain_percent"] == pytest.approx(19.4, abs=0.05)
    assert row["outages"] == 48
    json.dumps(grid.to_dict())


def test_interruption_keeps_what_was_finished(walk):
    def stop(fraction):
        raise KeyboardInterrupt

    result = outage_grid(walk, imus=("HG1700",), draws=1, outages=2, progress=stop)
    assert list(result.statistics) == [("HG1700", "Original")]
    assert not result.complete


def test_a_filter_that_diverges_is_counted_and_its_error_is_infinite(walk, monkeypatch):
    """Of three draws the covariance of the second breaks down from the middle on."""
    runs = []
    navigate = outages.navigate

    def breaking(recording, config, **options):
        result = navigate(recording, config, **options)
        runs.append(result)
        if len(runs) != 2:
            return result
        covariance = result.covariance_e.copy()
        covariance[len(covariance) // 2 :, 9, 9] = -1e-4
        return replace(result, covariance_e=covariance)

    monkeypatch.setattr(outages, "navigate", breaking)
    result = outage_grid(walk, imus=("HG1700",), seedings=("Original",), draws=3, outages=2)
    assert result.diverged == {("HG1700", "Original"): 1}
    assert len(result.statistics["HG1700", "Original"]) == 4
    assert result.total("HG1700", "Original", 2.0) == np.inf
    del runs[1:]
    config = cart_config("HG1700", 0.0, wander=False)
    recording, errors, rng = cart_recording(walk, "HG1700", 1, 0, wander=False)
    start = seeded_start(recording, config, errors, "Original", CalibrationSigma.of("HG1700"), rng)
    with pytest.raises(DivergenceError, match=r"diverged with GNSS, before \d+\.\d s"):
        outages.outage_statistics(recording, config, lengths=LENGTHS, starts=[60.0, 200.0], initial=start)


def test_what_cannot_be_done_is_said(walk):
    with pytest.raises(InputError, match="expected IMUs of"):
        outage_grid(walk, imus=("LN-200",))


@pytest.mark.slow
def test_full_grid():
    """25 minutes, 66 outages, ten draws: prototype within 25 %, NEES within 0.7 to 1.35."""
    result = outage_grid(imus=("HG1700", "HG1900"), seedings=("Original",), draws=10)
    for imu in ("HG1700", "HG1900"):
        for k, length in enumerate(LENGTHS):
            assert result.total(imu, "Original", length) == pytest.approx(PROTOTYPE[imu, "Original"][k], rel=0.25)
            assert 0.7 < result.statistics[imu, "Original"].nees(length) < 1.35
