"""Six axes of six hours at 200 Hz: checks, Allan variances, choice among models, budget."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.characterisation import identify_noise
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import Flicker, GaussMarkov, RandomWalk, White

RATE, SAMPLES = 200.0, 4_320_000


@pytest.fixture(scope="module")
def log():
    gyro = White(1e-4) + RandomWalk(1e-7) + GaussMarkov(2e-5, 100.0)
    accel = White(1e-3) + Flicker(1e-4)
    rng = np.random.default_rng(1)
    axes = [model.sample(SAMPLES, 1.0 / RATE, rng) for model in (gyro, gyro, gyro, accel, accel, accel)]
    axes[5] -= 9.8
    return ImuSeries(np.arange(SAMPLES) / RATE, np.stack(axes[:3], axis=1), np.stack(axes[3:], axis=1))


def test_identification(benchmark, log):
    benchmark.group = "full identification, 6 axes of 4.32 M samples"
    benchmark.extra_info["epochs"] = SAMPLES
    identified = benchmark.pedantic(identify_noise, args=(log,), rounds=2, warmup_rounds=1)
    assert len(identified.axes) == 6
