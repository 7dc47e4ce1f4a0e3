"""Encoder: what its readings and the angles between them are worth."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.rotary import schemes
from schuler.rotary.encoder import Encoder, EncoderReadings, read_encoder
from schuler.units import DEG

W = 10.0 * DEG
T_IMU = np.arange(0, 1001) * 0.01


def test_a_perfect_encoder_of_a_constant_rate_is_exact_at_imu_epochs():
    schedule = schemes.continuous("z", W)
    for between in ("linear", "cubic"):
        read = read_encoder(schedule, Encoder(), 10.0, between=between)
        np.testing.assert_allclose(read.angles(T_IMU), schedule.angles(T_IMU), atol=1e-14)  # rounding
        np.testing.assert_allclose(read.rates(T_IMU), schedule.rates(T_IMU), atol=1e-12)
        np.testing.assert_allclose(read.C_bs(T_IMU), schedule.C_bs(T_IMU), atol=1e-14)
        np.testing.assert_allclose(read.omega_bs_s(T_IMU), schedule.omega_bs_s(T_IMU), atol=1e-12)


def test_linear_interpolation_misses_the_sag_and_cubic_does_not():
    """Evenly accelerated: the chord misses a h^2 / 8 in the middle; parabolas are kept. Rounding."""
    schedule = schemes.from_rates("z", [0.0, 20.0], [0.0, 2.0])
    middle = np.arange(20, 400) * 0.02 + 0.01
    linear, cubic = (read_encoder(schedule, Encoder(), 10.0, between=b) for b in ("linear", "cubic"))
    np.testing.assert_allclose(linear.angles(middle) - schedule.angles(middle), 0.1 * 0.02**2 / 8.0, atol=1e-13)
    np.testing.assert_allclose(cubic.angles(middle), schedule.angles(middle), atol=1e-13)
    t = middle + 0.003
    np.testing.assert_allclose(cubic.rates(t), schedule.rates(t), atol=1e-11)


def test_a_time_offset_is_an_angle_error_of_rate_times_offset():
    """10 deg/s by 5 ms are 0.05 deg (Du, section 2.4)."""
    schedule = schemes.continuous("z", W)
    read = read_encoder(schedule, Encoder(time_offset=0.005), 10.0)
    np.testing.assert_allclose(read.angles(T_IMU) - schedule.angles(T_IMU), 0.05 * DEG, atol=1e-14)


def test_quantisation_rounds_to_counts_and_zero_offset_adds():
    schedule = schemes.continuous("z", W)
    count = 0.1 * DEG
    read = read_encoder(schedule, Encoder(resolution=count), 10.0)
    np.testing.assert_allclose(read.angle / count, np.round(read.angle / count), atol=1e-9)
    assert np.abs(read.angle - schedule.angles(read.t)).max() <= 0.5 * count + 1e-15
    shifted = read_encoder(schedule, Encoder(zero_offset=0.2), 10.0)
    np.testing.assert_allclose(shifted.angle - schedule.angles(shifted.t), 0.2, atol=1e-15)


def test_noise_has_its_deviation_and_its_seed():
    """1-sigma of the sample deviation is sigma / sqrt(2 n); 4 of them allowed (statistical, fixed seed)."""
    schedule = schemes.continuous("z", W)
    read = read_encoder(schedule, Encoder(noise=1e-3), 100.0, np.random.default_rng(4))
    error = (read.angle - schedule.angles(read.t)).ravel()
    assert abs(error.std() / 1e-3 - 1.0) < 4.0 / np.sqrt(2.0 * len(error))
    again = read_encoder(schedule, Encoder(noise=1e-3), 100.0, np.random.default_rng(4))
    np.testing.assert_array_equal(read.angle, again.angle)


def test_every_axis_is_read():
    schedule = schemes.dual_axis(8, dwell=1.0, rate=5.0 * W, acceleration=10.0 * W)
    read = read_encoder(schedule, Encoder(interval=0.001), 20.0, between="cubic")
    t = np.arange(2000) * 0.01
    np.testing.assert_allclose(read.C_bs(t), schedule.C_bs(t), atol=2e-6)  # discretisation at the jumps of acceleration


def test_rates_of_readings_sum_to_the_angles():
    """Gauss quadrature of the cubic's rate over each reading interval is its angle difference; rounding."""
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.01, 0.03, 50))
    read = EncoderReadings(t, rng.normal(size=(50, 1)).cumsum(axis=0) * 0.01, [[0.0, 0.0, 1.0]], between="cubic")
    x, w = np.polynomial.legendre.leggauss(3)
    at = t[:-1, None] + 0.5 * np.diff(t)[:, None] * (1.0 + x)
    swept = (read.rates(at.ravel()).reshape(-1, 3) @ w) * 0.5 * np.diff(t)
    np.testing.assert_allclose(swept, np.diff(read.angle[:, 0]), atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Encoder(interval=0.0), "interval > 0"),
        (lambda: read_encoder(schemes.fixed(), Encoder(noise=1.0), 1.0), "needs a generator"),
        (lambda: read_encoder(schemes.fixed(), Encoder(), 0.0), "duration"),
        (lambda: read_encoder(schemes.fixed(), Encoder(), 1.0).angles([2.0]), "covers"),
        (lambda: EncoderReadings(np.array([0.0]), np.zeros((1, 1)), np.eye(3)[2:]), "at least two readings"),
        (lambda: EncoderReadings(np.arange(3.0), np.zeros((3, 1)), np.eye(3)[2:], between="nearest"), "between"),
    ],
)
def test_wrong_input_is_refused_in_words(make, message):
    with pytest.raises(InputError, match=message):
        make()
