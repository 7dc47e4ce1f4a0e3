"""White frequency noise of a receiver's clock from its carriers: as simulated, whatever the antenna does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from carrier_town import slipped_town

from schuler import frames
from schuler.exceptions import ConfigError, InputError
from schuler.gnss.clock_noise import clock_frequency_noise
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import prepared_run

V = np.array([3.0, -8.0, 5.0])


def ranges_of(noise, rate_hz=1.0, seed=1, rate_noise=0.01):
    t = np.arange(0.0, 200.0 / rate_hz, 1.0 / rate_hz)
    r = frames.ecef_from_llh(np.array([0.85, 0.16, 320.0])) + t[:, None] * V
    errors = RangeErrors(rate_noise=rate_noise, clock_psd=noise**2, drift_psd=1e-4)
    return synthetic_ranges(
        t, r, np.tile(V, (len(t), 1)), nominal_orbits("GE"), np.random.default_rng(seed), errors, elevation_mask=0.2
    ).ranges


@pytest.mark.parametrize("rate_hz", [1.0, 4.0])
@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_the_noise_of_a_clock_is_that_simulated(noise, rate_hz):
    """Statistical: of 200 epochs 5 % of an rms; what rates leave of noise adds 0.005 m per root second."""
    noises = [clock_frequency_noise(ranges_of(noise, rate_hz, seed), 0.003) for seed in range(3)]
    np.testing.assert_allclose(noises, noise, rtol=0.2)


def test_epochs_of_few_satellites_do_not_count():
    """Four of them, with carriers that jump by metres."""
    ranges = ranges_of(0.1)
    late, few = ranges.t > 150.0, np.isin(ranges.sat, np.unique(ranges.sat)[:4])
    spoiled = replace(ranges, carrier_range=ranges.carrier_range + np.where(late, 5.0 * (ranges.t % 2.0), 0.0))
    cut = spoiled.where(~late | few)
    assert clock_frequency_noise(cut, 0.003) == clock_frequency_noise(ranges.where(~late), 0.003)


def test_too_few_satellites_are_refused():
    ranges = ranges_of(0.1)
    few = replace(ranges, reason=np.where(ranges.t > 20.0, 8, ranges.reason))
    with pytest.raises(InputError, match="needs 30 epochs at which 5 satellites have carriers and range rates, got 20"):
        clock_frequency_noise(few, 0.003)


@pytest.mark.parametrize("most", [None, 3])
def test_the_clock_of_a_filter_has_the_noise_of_the_log(most):
    """Of all satellites, however few of them are used."""
    tight = {"clock_noise_m": "log", "carrier": "time-differenced", "max_satellites": most}
    config = {"imu": {"catalogue": "MTi-G-710"}, "gnss": {"coupling": "tight", "tight": tight}}
    prepared = prepared_run(slipped_town()[0], NavigationConfig.parse(config))
    noise = prepared.layout.models["clock"].noise
    assert noise == pytest.approx(0.2, rel=0.5)  # as simulated; of 40 epochs, beside range rates of 0.05 m/s
    assert any(f"white frequency noise of {noise:.2g} m per root second" in note for note in prepared.notes)


def test_without_carriers_the_log_does_not_tell_the_clock():
    with pytest.raises(ConfigError, match="needs carrier phases"):
        NavigationConfig.parse({"gnss": {"coupling": "tight", "tight": {"clock_noise_m": "log"}}})
