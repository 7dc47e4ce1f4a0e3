"""Counted pulses: their lattice, the noise behind them, and sensors that do not count."""

import numpy as np
import pytest

from schuler.characterisation import axis_noise, identify_noise
from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.counting import counted_model, pulse_lattice
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import Counted, NoiseModel, RandomWalk, ShotNoise, White, quantise

RATE = 100.0


def log_of(process: Counted, n: int, seed: int) -> np.ndarray:
    """A log with its mean. [x]"""
    return process.sample(n, 1.0 / RATE, np.random.default_rng(seed)) + process.mean


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("quantum", "mean", "read_rate_hz"),
    [(5e-3, 9.823, 125.0), (1e-5, 2.3e-4, 150.0), (2e-3, 0.051, 50.0), (0.7, -11.0, 100.0), (3e-4, 0.013, 80.0)],
)
def test_the_lattice_is_found(quantum, mean, read_rate_hz):
    """Quantum and read rate to rounding; jitter makes the counter turn to and fro."""
    process = Counted(White(quantum * 0.02), ShotNoise(0.08 * quantum, 20.0, 0.03), quantum, mean, read_rate_hz)
    grid = pulse_lattice(log_of(process, 40_000, 1), RATE)
    assert grid is not None
    assert grid.quantum == pytest.approx(quantum, rel=1e-6)
    assert grid.read_rate_hz == pytest.approx(read_rate_hz, rel=1e-9)


def test_slips_of_the_counter_do_not_hide_the_lattice():
    process = Counted(White(1e-4), ShotNoise(4e-4, 20.0, 0.03), 5e-3, 9.823, 125.0)
    x = log_of(process, 40_000, 2)
    x[[1000, 9001, 30_003]] += 5e-3 / 4.0 * RATE
    grid = pulse_lattice(x, RATE)
    assert grid is not None
    assert (grid.quantum, grid.read_rate_hz) == pytest.approx((5e-3, 125.0))


def test_noise_shows_no_lattice_beyond_its_resolution():
    x = np.random.default_rng(3).standard_normal(40_000)
    assert pulse_lattice(x, RATE) is None
    grid = pulse_lattice(quantise(x, 0.5), RATE)
    assert grid is not None
    assert (grid.quantum, grid.read_rate_hz) == pytest.approx((0.5 / RATE, RATE))


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("quantum", "mean", "read_rate_hz", "N", "jitter"),
    [(5e-3, 9.823, 125.0, 1.5e-4, 0.08), (2e-5, 3.1e-4, 100.0, 1.2e-6, 0.1), (1e-3, 0.012, 150.0, 3e-5, 0.06)],
)
def test_noise_behind_the_counter_comes_back(quantum, mean, read_rate_hz, N, jitter):
    """Statistical and by degeneracy of the terms: jitter to 15 %, N to 30 %; the curve to 5 % up to 10 s, since the
    pulses' pattern is one realisation."""
    truth = Counted(White(N), ShotNoise(jitter * quantum, 20.0, 0.02), quantum, mean, read_rate_hz, span=1200.0)
    x = log_of(truth, 120_000, 4)
    lattice = pulse_lattice(x, RATE)
    curve = allan_deviation(x, RATE, taus="log", noise=0.0)
    assert lattice is not None
    grid = counted_model(curve, lattice, float(x.mean()), 1.0 / RATE, len(x))
    assert grid is not None
    sigma = np.sqrt(sum(float(t.autocovariance(0.0)) for t in grid.jitter.terms))
    assert sigma == pytest.approx(jitter * quantum, rel=0.15)
    white = [t.N for t in grid.inner.terms if isinstance(t, White)]
    assert white == pytest.approx([N], rel=0.3)
    m = np.array([1, 2, 4, 10, 30, 100, 300, 1000])
    ratio = np.sqrt(grid.discrete_allan_variance(m, 1.0 / RATE) / truth.discrete_allan_variance(m, 1.0 / RATE))
    np.testing.assert_allclose(ratio, 1.0, atol=0.05)


def test_pulses_that_noise_hides_have_no_model_of_their_own():
    process = Counted(White(2e-3), NoiseModel(), 1e-3, 0.05, RATE)
    x = log_of(process, 60_000, 5)
    lattice = pulse_lattice(x, RATE)
    assert lattice is not None
    curve = allan_deviation(x, RATE, taus="log", noise=0.0)
    assert counted_model(curve, lattice, float(x.mean()), 1.0 / RATE, len(x)) is None


def imu_with(z: np.ndarray) -> ImuSeries:
    """The signal as z accelerometer among five axes of white noise."""
    rng = np.random.default_rng(6)
    gyro, accel = 1e-4 * rng.standard_normal((len(z), 3)), 1e-3 * rng.standard_normal((len(z), 3))
    accel[:, 2] = z
    return ImuSeries(np.arange(1, len(z) + 1) / RATE, gyro, accel)


@pytest.mark.campaign
def test_the_person_is_told():
    truth = Counted(White(1.5e-4) + RandomWalk(1e-5), ShotNoise(3e-4, 20.0, 0.02), 5e-3, 10.0121, 125.0)
    grid = identify_noise(imu_with(log_of(truth, 30_000, 7)), models=("N", "N+K"))
    axis = grid.axes["accel_z"]
    text = next(f.text for f in axis.findings if f.code == "counted")
    assert "0.005 m/s^2*s" in text
    assert "125 Hz and interpolated to 100 Hz" in text
    assert [type(term) for term in axis.model.terms] == [Counted]
    assert all(f.code != "counted" for name in grid.axes if name != "accel_z" for f in grid.axes[name].findings)
    assert np.isfinite(axis.curve.low).all()
    assert np.isfinite(grid.axes["accel_z"].fitted(axis.curve.tau)).all()


@pytest.mark.campaign
def test_a_sensor_that_rounds_every_sample_is_as_before(monkeypatch):
    """Coarse, but its sum wanders off any lattice: the path of counters changes nothing."""
    x = (White(1.0) + RandomWalk(0.02)).sample(60_000, 1.0 / RATE, np.random.default_rng(8)) + 0.3
    imu = imu_with(quantise(x, 40.0))
    now = identify_noise(imu).axes["accel_z"]
    assert "coarse" in {f.code for f in now.findings}
    monkeypatch.setattr(axis_noise, "_pulses", lambda *_: None)
    before = identify_noise(imu).axes["accel_z"]
    assert now.findings == before.findings
    assert now.terms == before.terms
    np.testing.assert_array_equal(now.fitted(now.curve.tau), before.fitted(before.curve.tau))
