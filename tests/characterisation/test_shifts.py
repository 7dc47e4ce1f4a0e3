"""Small shifts of level: the same likelihood as the general fit, found where they are, none in clean logs."""

import numpy as np
import pytest
from scipy.stats import binom

from schuler.characterisation import shifts, trends
from schuler.characterisation.shifts import level_shifts
from schuler.sensors.noise import Flicker, GaussMarkov, Ramp, RandomWalk, White, flicker

COLOURS = [
    White(1.0),
    White(1.0) + flicker(0.5),
    White(0.3) + Flicker(1.0),
    White(1.0) + RandomWalk(0.05),
    White(0.1) + RandomWalk(1.0),
    White(1.0) + GaussMarkov(0.5, 60.0),
    White(1.0) + Ramp(1e-2),
]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("model", COLOURS[:5])
def test_the_likelihood_is_that_of_the_general_fit(model, rng):
    x = model.sample(2400, 0.5, rng)
    y, duration, _ = trends.block_means(x, 2.0)
    J = len(y)
    shapes = (np.arange(J)[:, None] >= np.arange(3, J - 3)).astype(float)
    fits = trends.fit_shapes(y, shapes, duration)[1]
    k = int(np.argmax([fit.likelihood for fit in fits]))
    first, height, likelihood = shifts._likeliest(y)
    assert first == k + 3
    assert height == pytest.approx(fits[k].value, rel=1e-6)  # rounding, of nearly singular proportions
    assert likelihood == pytest.approx(fits[k].likelihood, rel=1e-6)


@pytest.mark.parametrize("place", [0.05, 0.3, 0.5, 0.97])
def test_a_shift_of_a_third_of_a_sample_is_found(place):
    x = (White(1e-3) + Flicker(1e-4)).sample(60_000, 0.01, np.random.default_rng(2))
    x[int(place * len(x)) :] += 3e-3
    (steps,) = level_shifts(x, 100.0, axis="gyro_y")
    assert steps.code == "step"
    assert steps.severity == "warning"
    assert steps.start_s - 5.0 <= 600.0 * place <= steps.stop_s + 5.0  # a block of 5 s
    height = float(steps.text.split("shifts by ")[1].split(" ")[0])
    assert height == pytest.approx(3e-3, abs=1e-3)  # statistical: 4.5e-4 a block


def test_several_shifts_are_found_one_by_one():
    x = (White(1e-3) + Flicker(5e-5)).sample(60_000, 0.01, np.random.default_rng(3))
    x[15_000:] += 4e-3
    x[40_000:] -= 6e-3
    steps = level_shifts(x, 100.0)
    assert len(steps) == 2
    assert sorted(f.start_s for f in steps) == pytest.approx([145.0, 395.0], abs=6.0)  # a block


@pytest.mark.parametrize("logs", [42, pytest.param(210, marks=pytest.mark.campaign)])
def test_clean_logs_have_no_more_shifts_than_stated(logs):
    rng = np.random.default_rng(4)
    count = sum(bool(level_shifts(COLOURS[k % len(COLOURS)].sample(2400, 0.5, rng), 2.0)) for k in range(logs))
    assert count <= binom.isf(1e-3, logs, trends.FALSE_ALARM)  # statistical
