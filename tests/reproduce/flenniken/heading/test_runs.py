"""Readings and filters over many runs: consistent, and as the source's figures say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.reproduce.flenniken.study.heading import (
    BiasTruth,
    gauss_markov_bias,
    gyro_readings,
    heading_bound,
    heading_nees,
    heading_outages,
    recorded_outage,
    run_filter,
    split_bias,
)
from schuler.reproduce.flenniken.study.heading.outages import FIX_SIGMA, position_outage
from schuler.reproduce.flenniken.study.tables import AFTER_S, BOUND_DEG, OUTAGE_DEG
from schuler.sensors.catalogue import spec
from schuler.units import DEG, G0

CONSUMER = spec("flenniken-consumer").gyro
N, SIGMA, TAU = CONSUMER.random_walk, CONSUMER.in_run_bias, CONSUMER.in_run_time


def fixes_each_second(rate_hz, seconds, until):
    t = np.arange(1, round(rate_hz * seconds) + 1) / rate_hz
    return t, (np.abs(t - np.round(t)) < 0.25 / rate_hz) & (t <= until + 1e-9)


@pytest.mark.parametrize("count", [120, 1])
def test_readings_have_the_moments_of_the_continuous_process(count):
    """Integral over 60 s, white and wandering, in short samples and in one; 4 standard errors of 8000 runs."""
    truth = BiasTruth(N, SIGMA, 100.0, 0.3)
    increments, bias = gyro_readings(truth, 60.0 / count, count, 8000, np.random.default_rng(1))
    total, z = increments.sum(axis=0), 60.0 / 100.0
    expected = N**2 * 60.0 + 2.0 * SIGMA**2 * 100.0**2 * (z - 1.0 + np.exp(-z))
    error = np.sqrt(2.0 / 8000)
    assert abs(np.var(total) / expected - 1.0) < 4.0 * error
    assert abs(total.mean() - 0.3 * 60.0) < 4.0 * np.sqrt(expected / 8000)
    assert abs(np.var(bias[-1]) / SIGMA**2 - 1.0) < 4.0 * error
    covariance = SIGMA**2 * 100.0 * (1.0 - np.exp(-z))  # of the bias and its integral
    spread = np.sqrt((expected * SIGMA**2 + covariance**2) / 8000)
    assert abs(np.cov(total, bias[-1])[0, 1] - covariance) < 4.0 * spread


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_filters_are_consistent_with_biases_of_both_signs(sign):
    """NEES per state of 400 runs at one time: 1 within 4 standard errors, sqrt(2 / (400 n))."""
    t, fix = fixes_each_second(10.0, 150.0, 120.0)
    rng = np.random.default_rng(3)
    increments, bias = gyro_readings(BiasTruth(N, SIGMA, TAU), 0.1, len(t), 400, rng)
    heading = FIX_SIGMA * rng.standard_normal(400)  # the filter starts at zero
    fixes = heading + FIX_SIGMA * rng.standard_normal((len(t), 1, 400))
    model = gauss_markov_bias(N, SIGMA, TAU, sigma_heading=FIX_SIGMA)
    done = run_filter(model, increments, 0.1, fixes, np.array([[FIX_SIGMA**2]]), fix)
    for k in (400, 1199, len(t) - 1):
        error = done.estimate[k] - np.stack((heading, bias[k]))
        nees = np.einsum("ir,ij,jr->r", error, np.linalg.inv(done.P[k]), error) / 2.0
        assert abs(nees.mean() - 1.0) < 4.0 * np.sqrt(1.0 / 400)
    constant = sign * 1.0 * DEG
    increments, bias = gyro_readings(BiasTruth(N, SIGMA, TAU, constant), 0.1, len(t), 400, rng)
    model = split_bias(N, SIGMA, TAU, sigma_heading=FIX_SIGMA, sigma_constant=abs(constant))
    done = run_filter(model, increments, 0.1, fixes, np.array([[FIX_SIGMA**2]]), fix)
    error = done.estimate[1199, 1] + done.estimate[1199, 2] - bias[1199]
    sigma = np.sqrt(np.array([0, 1, 1]) @ done.P[1199] @ np.array([0, 1, 1]))
    # one draw of the constant for all runs: the estimate is biased by the prior, little beside the noise here
    assert abs(np.std(error) / sigma - 1.0) < 4.0 / np.sqrt(2.0 * 400)
    assert abs(error.mean()) < 0.2 * sigma


@pytest.mark.parametrize(("rate_hz", "reading"), [(10.0, "continuous"), (10.0, "sampled"), (100.0, "sampled")])
def test_printed_process_noise_is_inconsistent(rate_hz, reading):
    """Eq. (4.17): no reading of the printed Q gives a NEES of one; ours does. 4 and 6 standard errors."""
    error = np.sqrt(1.0 / 500)
    assert abs(heading_nees(CONSUMER, rate_hz=rate_hz, runs=500, seed=4) - 1.0) < 4.0 * error
    assert abs(heading_nees(CONSUMER, rate_hz=rate_hz, reading=reading, runs=500, seed=4) - 1.0) > 6.0 * error


def test_steady_bounds_are_those_of_the_source():
    """Ranges quoted in the source's text, and independent numbers to their printed digits."""
    for grade, (quoted, after, before) in BOUND_DEG.items():
        gyro = spec(f"flenniken-{grade}").gyro
        model = gauss_markov_bias(gyro.random_walk, gyro.in_run_bias, gyro.in_run_time, sigma_heading=FIX_SIGMA)
        bound = heading_bound(model, FIX_SIGMA)
        assert quoted[0] <= round(bound.steady_posterior / DEG, 3) <= quoted[1]
        assert_allclose(bound.steady_posterior / DEG, after, rtol=5e-3)
        if before is not None:
            assert_allclose(bound.steady_prior / DEG, before, rtol=5e-3)
        assert bound.free[-1] > 10.0 * bound.aided[-1]


def test_outage_table():
    """An independent program's table within 10 %; 1500 runs scatter by 1.8 %."""
    result = heading_outages(spec("flenniken-consumer"), runs=1500, seed=5)
    for i, truth in enumerate(result.truths):
        for j, name in enumerate(result.filters):
            ours = [result.at(seconds)[i, j] / DEG for seconds in AFTER_S]
            assert_allclose(ours, OUTAGE_DEG[truth, name], rtol=0.1)
    assert "walking bias" in result.summary()
    end = result.rms[:, :, -1]
    wandering, constant = end[0], end[1]
    names = list(result.filters)
    assert wandering[names.index("Gauss-Markov")] == wandering.min()
    assert constant[names.index("Gauss-Markov")] == constant.max()
    # the filter that fell asleep believes a degree where it errs by eighteen
    assert result.sigma[names.index("constant, asleep"), -1] < 0.1 * wandering[names.index("constant, asleep")]


def test_one_log_of_a_gyroscope_like_the_sources():
    """The filter with both biases holds the constant part; the Gauss-Markov one lets it decay and drifts most."""
    result = recorded_outage(seed=2)
    end = {name: abs(error[-1]) for name, (error, _) in result.items()}
    assert end["Gauss-Markov"] == max(end.values())
    assert end["both"] < 0.5 * end["Gauss-Markov"]


def test_many_logs_of_another_gyroscope():
    """Without a constant bias the Gauss-Markov filter is right: RMS over runs is its sigma, 4 standard errors."""
    result = recorded_outage(
        seed=3, runs=300, truth=BiasTruth(N, SIGMA, TAU), start_s=120.0, outage_s=120.0, rate_hz=2.0
    )
    error, run = result["Gauss-Markov"]
    assert error.shape == (480,)
    rms = np.sqrt(np.mean(run.estimate[-1, 0] ** 2))
    assert abs(rms / run.sigma[-1, 0] - 1.0) < 4.0 / np.sqrt(2.0 * 300)


def test_six_state_filter():
    """Check case of an independent program; 600 runs scatter by 2.9 %, tolerance 4 standard errors and its printed
    digits.
    """
    result = position_outage(BiasTruth(0.003 * G0, 2.4e-3 * G0, 100.0, 0.01 * G0), runs=600, seed=6)
    last = int(np.searchsorted(result.run.t, 300.0 - 1e-6))
    assert_allclose(result.rms[last, [0, 2]], [0.029, 0.19], rtol=0.13)
    assert_allclose(result.rms[last, 4] / G0, 1.02e-3, rtol=0.13)
    assert_allclose(result.rms[-1, [0, 2]], [0.78, 21.3], rtol=0.13)
    assert_allclose(result.rms[-1, :4], result.run.sigma[-1, :4], rtol=0.12)
