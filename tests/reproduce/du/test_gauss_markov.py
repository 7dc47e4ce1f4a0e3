"""Gauss-Markov biases from the autocorrelation of a log at rest."""

import numpy as np
import pytest

from schuler.characterisation.correlation import expected_autocovariance
from schuler.exceptions import InputError
from schuler.filtering.states import StateModel
from schuler.recording.series import ImuSeries
from schuler.reproduce.du.study.gauss_markov import fit_bias, static_models
from schuler.reproduce.du.study.imus import MTI_G, NAV440, TAU_S
from schuler.reproduce.du.study.integrated import IntegratedDrive
from schuler.sensors.noise import GaussMarkov, NoiseModel, White
from schuler.units import DEG_PER_HR


def log(triad, seconds, seed, rate=1.0):
    """Three axes of white noise and a Gauss-Markov bias, with a constant that the fit must not see."""
    model = NoiseModel((White(triad.random_walk), GaussMarkov(triad.in_run_bias, triad.in_run_time)))
    drawn = model.sample((round(seconds * rate), 3), 1.0 / rate, np.random.default_rng(seed))
    return drawn + np.array([3.0, -2.0, 1.0])


@pytest.mark.parametrize("imu", [NAV440, MTI_G], ids=lambda i: i.name)
def test_sigma_and_tau_come_back(imu):
    """Also of the MTi-G, whose white noise at 1 Hz is nine times its bias."""
    for triad in (imu.spec.gyro, imu.spec.accel):
        fits = [fit_bias(log(triad, 14400.0, seed), 1.0) for seed in range(8)]
        sigma = np.array([f.sigma for f in fits]) / triad.in_run_bias
        tau = np.array([f.tau for f in fits]) / TAU_S
        # statistical: 48 correlation times, three axes; 15 and 30 % of scatter, a third of it in the mean of eight
        assert np.mean(sigma) == pytest.approx(1.0, abs=0.2)
        assert np.exp(np.mean(np.log(tau))) == pytest.approx(1.0, abs=0.4)
        assert np.mean([f.white for f in fits]) == pytest.approx(triad.random_walk, rel=0.02)
        assert np.mean([f.sigma_range[0] <= f.sigma <= f.sigma_range[1] for f in fits]) > 0.7


def test_an_expected_autocovariance_is_fitted_exactly(monkeypatch):
    from schuler.characterisation.correlation import Correlation
    from schuler.reproduce.du.study import gauss_markov

    process, duration = GaussMarkov(2.0, 120.0), 4000.0

    def exact(x, rate, longest_s):
        lag = np.arange(round(longest_s * rate) + 1) / rate
        value = expected_autocovariance(process, lag, duration)
        value[0] += 9.0 * rate
        return Correlation(lag, value, np.ones_like(lag), duration)

    monkeypatch.setattr(gauss_markov, "autocorrelation", exact)
    fit = fit_bias(np.zeros((4000, 1)), 1.0)
    # discretisation: the grid of correlation times is 12 % wide
    assert fit.tau == pytest.approx(120.0, rel=0.07)
    assert fit.sigma == pytest.approx(2.0, rel=0.05)
    assert fit.white == pytest.approx(3.0, rel=0.05)


def test_a_layout_for_the_filter():
    n = 120_000
    rng = np.random.default_rng(2)
    gyro, accel = NAV440.spec.gyro, NAV440.spec.accel
    parts = [
        NoiseModel((White(t.random_walk), GaussMarkov(t.in_run_bias, 60.0))).sample((n, 3), 0.02, rng)
        for t in (gyro, accel)
    ]
    imu = ImuSeries(0.02 * np.arange(n), parts[0], parts[1] + (0.0, 0.0, -9.81))
    result = static_models(imu)
    assert result.gyro.sigma / DEG_PER_HR == pytest.approx(10.0, rel=0.4)  # statistical, 40 correlation times
    assert 20.0 < result.gyro.tau < 180.0
    layout = result.layout(gyro_turn_on=100.0 * DEG_PER_HR, accel_turn_on=0.1)
    assert layout.models["b_g"] == StateModel.gauss_markov(result.gyro.sigma, result.gyro.tau, 100.0 * DEG_PER_HR)
    assert IntegratedDrive(NAV440, layout=layout).states is layout
    assert "tau_s" in result.summary()


def test_no_bias_is_said_to_be_none():
    white = np.random.default_rng(4).standard_normal((400, 1))
    alternating = np.where(np.arange(400) % 2, 1.0, -1.0)[:, None] * 0.1 + 1e-6 * white
    fit = fit_bias(alternating, 1.0, longest_s=11.0)
    if fit.sigma == 0.0:
        with pytest.raises(InputError, match="no slow bias"):
            fit.model(1.0)
    assert fit.sigma < 0.02


def test_what_cannot_be_fitted():
    with pytest.raises(InputError, match="at least 40 s"):
        fit_bias(np.random.default_rng(0).standard_normal((2000, 3)), 100.0)
    t = np.concatenate((np.arange(100), np.arange(200, 300))) * 0.01
    with pytest.raises(InputError, match="gaps"):
        static_models(ImuSeries(t, np.zeros((200, 3)), np.zeros((200, 3))))
