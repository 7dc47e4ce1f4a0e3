"""Levels that change between parts of a log: chance in stationary noise, halves of a modulated one, a burst."""

import numpy as np
import pytest

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.nonstationarity import allow_for, level_scatter, scatter_findings
from schuler.sensors.noise import GaussMarkov, RandomWalk, White

RATE = 100.0


def of(x):
    curve = allan_deviation(x, RATE)
    return curve, level_scatter(x, curve)


def modulated(depth, n, rng, parts=64):
    """White noise whose log level wanders like flicker: octaves of blocks, each adds the same variance."""
    level, length = np.zeros(n), n
    while length >= n // parts:
        level += np.repeat(depth * rng.standard_normal(-(-n // length)), length)[:n]
        length //= 2
    return np.exp(level) * rng.standard_normal(n)


WANDERING = White(1.0) + RandomWalk(0.05)


@pytest.mark.parametrize(
    ("model", "logs"),
    [
        (WANDERING, 15),
        *(
            pytest.param(model, 500, marks=pytest.mark.campaign)
            for model in (White(1.0), WANDERING, White(1.0) + GaussMarkov(0.5, 3.0))
        ),
    ],
)
def test_stationary_noise_keeps_its_bounds(model, logs):
    """Statistical, neighbours depend on each other: 10 % of averaging times are wider, 1 % of logs have a finding."""
    rng = np.random.default_rng(3)
    improbable, wider, findings = [], [], []
    for _ in range(logs):
        curve, scatter = of(model.sample(8192, 1.0 / RATE, rng))
        improbable.append(scatter.probability < 0.01)
        wider.append(scatter.sigma > 0.0)
        findings += scatter_findings("gyro_x", scatter, 81.92)
        bounded = allow_for(curve, scatter)
        same = scatter.sigma == 0.0
        np.testing.assert_array_equal(bounded.low[same], curve.low[same])
        np.testing.assert_array_equal(bounded.high[same], curve.high[same])
    assert np.mean(improbable) < (0.02 if logs > 100 else 0.06)
    assert np.mean(wider) < (0.12 if logs > 100 else 0.2)
    assert len(findings) < (12 if logs > 100 else 2)


@pytest.mark.parametrize("logs", [15, pytest.param(300, marks=pytest.mark.campaign)])
def test_halves_of_a_modulated_noise_agree_within_what_halves_claim(logs):
    """Statistical: 95 % intervals of halves, of sampling error alone and with the level, hold their difference."""
    rng = np.random.default_rng(4)
    sampling, allowed = [], []
    for _ in range(logs):
        halves = [of(part) for part in np.split(modulated(0.2, 16384, rng), 2)]
        d = np.log(halves[0][0].deviation[0] / halves[1][0].deviation[0])
        for bounds, inside in ((False, sampling), (True, allowed)):
            curves = [allow_for(c, s) if bounds else c for c, s in halves]
            inside.append(abs(d) < np.hypot(*(0.5 * np.log(c.high[0] / c.low[0]) for c in curves)))
    assert np.mean(sampling) < 0.3
    assert np.mean(allowed) > (0.9 if logs > 100 else 0.8)


def test_a_burst_is_named_with_its_place_and_its_times():
    x = np.random.default_rng(5).standard_normal(32768)
    x[20480:24576] *= 3.0  # the sixth eighth
    curve, scatter = of(x)
    (finding,) = scatter_findings("accel_y", scatter, 327.68)
    assert (finding.code, finding.severity) == ("level", "warning")
    assert (finding.start_s, finding.stop_s) == pytest.approx((204.8, 245.76))
    assert finding.text.startswith(
        "accel_y: the level of the noise is not the same throughout, at averaging times from"
    )
    assert scatter.ratio[0] == pytest.approx(3.0, rel=0.05)  # statistical: 1 % each
    assert np.all(allow_for(curve, scatter).high >= curve.high)
    weak = np.where(np.arange(32768) < 16384, 1.0, 1.06) * np.random.default_rng(6).standard_normal(32768)
    assert [f.severity for f in scatter_findings("accel_y", of(weak)[1], 327.68)] == ["note"]


def test_halves_and_quarters_tell_of_averaging_times_that_eighths_do_not_hold():
    """A random walk ten times as steep in the first half; freedom in closed form, of one, three and seven squares."""
    rng = np.random.default_rng(8)
    n = 16384
    x = np.cumsum(np.where(np.arange(n) < n // 2, 0.3, 0.03) * rng.standard_normal(n)) + rng.standard_normal(n)
    curve, scatter = of(x)
    m = np.round(curve.tau * RATE)
    for least, most, freedom in ((0, n / 48, 9 / 1.75), (n / 48, n / 24, 4 / 1.5), (n / 24, n, 1.0)):
        at = (m > least) & (m <= most)
        np.testing.assert_allclose(scatter.freedom[at], freedom, rtol=1e-12)
        assert (scatter.sigma[at] > 0.1).any()
    longest = (m > n / 48) & (m <= n / 12)
    assert np.isnan(scatter.probability[longest]).all()  # of a finding, which names an eighth
    assert np.all(allow_for(curve, scatter).high[longest] > 1.5 * curve.high[longest])


def test_gaps_and_short_logs_are_not_judged_where_they_cannot_be():
    rng = np.random.default_rng(7)
    _, scatter = of(rng.standard_normal(40))
    assert not scatter.sigma.any()
    assert np.isnan(scatter.probability).all()
    assert np.all(scatter.largest == -1)
    x = rng.standard_normal(16384)
    x[4096:6144] = np.nan  # all of the third eighth
    _, scatter = of(x)
    assert np.isnan(scatter.probability).all()
    x[4100:6140] = rng.standard_normal(2040)  # now four samples at each of its ends are missing
    _, scatter = of(x)
    assert (scatter.probability[:3] > 1e-3).all()  # by chance
    assert scatter.sigma.max() < 0.05
