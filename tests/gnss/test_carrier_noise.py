"""Noise of carriers from the log: white, lasting and walking noise as simulated, slips, and what a run makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from carrier_town import slipped_town

from schuler import frames
from schuler.exceptions import ConfigError, InputError
from schuler.gnss.carrier_noise import carrier_noise
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.gnss.weighting import noise_scale
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import prepared_run

V = np.array([3.0, -8.0, 5.0])
DT, TAU = 0.25, 1.0


@pytest.fixture(scope="module")
def sky():
    t = np.arange(0.0, 60.0, DT)
    r = frames.ecef_from_llh(np.array([0.85, 0.16, 320.0])) + t[:, None] * V
    errors = RangeErrors(carrier=0.0, carrier_walk=0.0, clock_psd=0.04)
    made = synthetic_ranges(
        t, r, np.tile(V, (len(t), 1)), nominal_orbits("GE"), np.random.default_rng(2), errors, elevation_mask=0.2
    ).ranges
    return made, r[np.searchsorted(t, made.t - 1e-6)] + 5.0  # the antenna to some metres


def noisy(ranges, *, white=0.0, lasting=0.0, walk=0.0):
    """Carriers with white noise, a Gauss-Markov error of a second, and a random walk."""
    rng, error = np.random.default_rng(7), np.zeros(len(ranges))
    scale = noise_scale(ranges.elevation, ranges.cn0, "elevation+cn0")
    keep = np.exp(-DT / TAU)
    for sat in np.unique(ranges.sat):
        mine = np.flatnonzero(ranges.sat == sat)
        n = rng.standard_normal((3, len(mine)))
        slow = np.empty(len(mine))
        slow[0] = n[1, 0]
        for k in range(1, len(mine)):
            slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * n[1, k]
        error[mine] = scale[mine] * (white * n[0] + lasting * slow) + walk * np.sqrt(DT) * np.cumsum(n[2])
    return replace(ranges, carrier_range=ranges.carrier_range + error)


def test_white_noise_is_that_simulated_and_a_walk_is_not_counted(sky):
    """Statistical: 240 epochs of a dozen satellites."""
    ranges, near = sky
    np.testing.assert_allclose(carrier_noise(noisy(ranges, white=0.004), near, 0.0), 0.004, rtol=0.12)
    short, _ = carrier_noise(noisy(ranges, white=0.004, walk=0.01), near, 0.01)
    assert short == pytest.approx(0.004, rel=0.12)


def test_noise_that_lasts_weighs_what_it_does_in_averages(sky):
    """White noise of s and a Gauss-Markov error of sigma: s^2 + sigma^2 coth(dt / 2 tau) in averages."""
    ranges, near = sky
    short, lasting = carrier_noise(noisy(ranges, white=0.002, lasting=0.006), near, 0.0)
    assert short == pytest.approx(np.hypot(0.002, 0.006 * np.sqrt(1.0 - np.exp(-DT / TAU))), rel=0.12)
    expected = np.hypot(0.002, 0.006 / np.sqrt(np.tanh(0.5 * DT / TAU)))
    assert lasting == pytest.approx(expected, rel=0.2)  # three of four: what lasts beyond 3 s is left out
    assert lasting > 2.5 * short


def test_slips_do_not_count(sky):
    ranges, near = sky
    clean = noisy(ranges, white=0.004)
    step = 0.19 * ((clean.sat == clean.sat[0]) & (clean.t > 30.0))
    slipped = replace(clean, carrier_range=clean.carrier_range + step)
    np.testing.assert_allclose(carrier_noise(slipped, near, 0.0), carrier_noise(clean, near, 0.0), rtol=0.1)


def test_too_few_satellites_are_refused(sky):
    ranges, near = sky
    few = replace(ranges, reason=np.where(np.isin(ranges.sat, np.unique(ranges.sat)[:5]), ranges.reason, 8))
    with pytest.raises(InputError, match="needs 30 pairs of epochs with carriers of 6 satellites"):
        carrier_noise(few, near, 0.0)


def test_a_run_takes_the_noise_of_the_log():
    """Simulated with 2 mm: never below what theory has."""
    tight = {"carrier_sigma_m": "log", "carrier": "time-differenced", "max_satellites": 4}
    config = {"imu": {"catalogue": "MTi-G-710"}, "gnss": {"coupling": "tight", "tight": tight}}
    prepared = prepared_run(slipped_town()[0], NavigationConfig.parse(config))
    assert any("1-sigma in the filter: 3.0 mm" in note for note in prepared.notes)
    with pytest.raises(ConfigError, match='carrier_sigma_m = "log" needs carrier phases'):
        NavigationConfig.parse({"gnss": {"coupling": "tight", "tight": {"carrier_sigma_m": "log"}}})
