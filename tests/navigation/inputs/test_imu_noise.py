"""White noise that a log scatters by is noise, and more is none."""

import numpy as np
import pytest

from schuler.navigation.inputs.imu_noise import is_no_noise
from schuler.recording.series import ImuSeries

STATED = (np.full(3, 1e-8), np.full(3, 1e-6))  # [rad^2/s], [m^2/s^3]


def log(rng, times, kind="rate"):
    """White noise so many times as large as stated, and smooth motion."""
    n, rate = 5000, 50.0
    t = np.arange(n) / rate
    slow = np.sin(2.0 * np.pi * 0.2 * t)[:, None]
    gyro, accel = (
        times * np.sqrt(q * rate) * rng.standard_normal((n, 3)) + size * slow
        for q, size in zip(STATED, (0.2, 1.0), strict=True)
    )
    scale = 1.0 if kind == "rate" else 1.0 / rate
    return ImuSeries(t, scale * gyro, scale * accel, kind=kind)


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("triad", [0, 1])
def test_noise_is_believed_as_far_as_samples_scatter(rng, kind, triad):
    """Law: 1.75 times the scatter; 4 % is statistical (5000 samples), and what motion adds."""
    imu = log(rng, 400.0, kind)
    for factor, expected in ((400.0, False), (1.69 * 400.0, False), (1.81 * 400.0, True)):
        factors = (factor, 1.0) if triad == 0 else (1.0, factor)
        assert is_no_noise(imu, STATED, factors) is expected


def test_sixty_times_is_believed_of_any_budget(rng):
    quiet = log(rng, 1.0)
    assert not is_no_noise(quiet, STATED, (59.0, 59.0))
    assert is_no_noise(quiet, STATED, (1.0, 61.0))
