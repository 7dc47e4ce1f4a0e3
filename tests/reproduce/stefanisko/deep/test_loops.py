"""Conventional loops of the tracking study: noise, lag, loss of lock and search against what theory says."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.deep.correlator import GPS_CA, Correlator, ratio_from_dbhz
from schuler.reproduce.stefanisko.study.deep.loops import ScalarLoops, in_reach, track

COR = Correlator()
BIT = GPS_CA.bit


def still(seconds: float, channels: int) -> np.ndarray:
    return np.zeros((2 * round(seconds / BIT) + 1, channels))


def strength(seconds: float, channels: int, dbhz: float) -> np.ndarray:
    return np.full((round(seconds / BIT), channels), float(ratio_from_dbhz(dbhz)))


@pytest.mark.parametrize("bandwidth", [2.0, 5.0])
@pytest.mark.parametrize("dbhz", [30.0, 45.0])
def test_noise_of_the_loops_is_sqrt_2_b_t(bandwidth, dbhz):
    """Variance over 64 channels and 18 s; what is left is discretisation: ``B T`` is 0.04 and 0.1."""
    loops = ScalarLoops(frequency_bandwidth=bandwidth)
    zero = still(20.0, 64)
    one = track(loops, COR, zero, zero, strength(20.0, 64, dbhz), np.random.default_rng(3))
    sigma, sigma_rate = loops.sigmas(COR, ratio_from_dbhz(dbhz))
    settled = slice(100, None)
    # statistical: 18 s x 4 B independent values in each of 64 channels, 1 %; discretisation: up to 15 % at B T = 0.1
    assert one.range_error[settled].std() == pytest.approx(sigma, rel=0.06)
    assert one.rate_error[settled].std() == pytest.approx(sigma_rate, rel=0.03 + 1.2 * bandwidth * BIT)
    assert one.usable.all()
    assert abs(one.range_error[settled].mean()) < 5.0 * sigma / np.sqrt(64 * 18 * 4)


@pytest.mark.parametrize("bandwidth", [2.0, 5.0])
def test_acceleration_is_followed_and_jerk_lags(bandwidth):
    """Second order: no error under acceleration, ``-jerk / omega^2`` under jerk. Exact signals."""
    loops = ScalarLoops(frequency_bandwidth=bandwidth)
    t = 0.01 * np.arange(2 * 500 + 1)[:, None]
    rng = np.random.default_rng(0)
    acceleration, jerk = 30.0, 3.0
    one = track(loops, COR, 0.5 * acceleration * t**2, acceleration * t, strength(10.0, 1, 45.0), rng, scale=0.0)
    assert abs(one.rate_error[-1, 0]) < 1e-6
    # a rate held over a bit is right in its middle, a T^2 / 8 short at its end
    assert one.range_error[-1, 0] == pytest.approx(-acceleration * BIT**2 / 8.0, rel=1e-6)
    one = track(loops, COR, jerk / 6.0 * t**3, 0.5 * jerk * t**2, strength(10.0, 1, 45.0), rng, scale=0.0)
    omega = bandwidth / 0.53
    lag = -jerk / omega**2
    # the lag is that of mid-bit; at its end the loop's acceleration, 1.414 jerk / omega behind, is half a bit short
    assert one.rate_error[-1, 0] == pytest.approx(lag * (1.0 - 0.707 * omega * BIT), rel=0.02)  # the sine's bend
    _, claimed = ScalarLoops(frequency_bandwidth=bandwidth, jerk=jerk).sigmas(COR, 1e9)
    assert claimed == pytest.approx(abs(lag), rel=0.01)


def test_too_much_jerk_for_a_narrow_loop_is_too_much():
    """25 Hz are the end of the discriminator: 4.8 m/s of lag; 1 Hz follows less than 17 m/s^3, 5 Hz up to 400."""
    t = 0.01 * np.arange(2 * 500 + 1)[:, None]
    jerk = 60.0
    for bandwidth, held in ((1.0, False), (5.0, True)):
        one = track(
            ScalarLoops(frequency_bandwidth=bandwidth), COR, jerk / 6.0 * t**3, 0.5 * jerk * t**2,
            strength(10.0, 1, 45.0), np.random.default_rng(0), scale=0.0,
        )  # fmt: skip
        assert bool(one.on_signal(COR)[-1, 0] & one.locked[-1, 0]) is held


def test_wide_loops_lose_weak_signals():
    """Noise within the discriminator's reach: 3 sigma of 25 Hz at 5 Hz bandwidth are passed at about 20 dB-Hz."""
    zero = still(20.0, 48)
    shares = {}
    for bandwidth in (2.0, 10.0):
        for dbhz in (30.0, 20.0):
            loops = ScalarLoops(frequency_bandwidth=bandwidth)
            one = track(loops, COR, zero, zero, strength(20.0, 48, dbhz), np.random.default_rng(1))
            shares[bandwidth, dbhz] = (one.locked & one.on_signal(COR)).all(axis=0).mean()
    assert shares[2.0, 30.0] == shares[10.0, 30.0] == 1.0
    assert shares[2.0, 20.0] > 0.8
    assert shares[10.0, 20.0] < 0.1


def test_a_lost_signal_is_found_again_and_used_when_it_has_settled():
    loops = ScalarLoops(acquire=3.0, settle=2.0)
    cn0 = strength(30.0, 16, 45.0)
    t = BIT * np.arange(1, len(cn0) + 1)
    cn0[(t > 5.0) & (t < 10.0)] = ratio_from_dbhz(0.0)
    zero = still(30.0, 16)
    one = track(loops, COR, zero, zero, cn0, np.random.default_rng(2))
    assert one.usable[t < 5.0].all()
    assert not one.locked[(t > 8.5) & (t < 12.9)].any()
    assert one.locked[t > 13.1].all()
    assert not one.usable[(t > 8.5) & (t < 14.9)].any()
    assert one.usable[t > 15.1].all()
    assert one.on_signal(COR)[t > 15.1].all()
    assert np.abs(one.range_error[-1]).max() < 6.0
    assert one.cn0[-1] == pytest.approx(np.full(16, ratio_from_dbhz(45.0)), rel=0.3)


def test_measured_strength_follows_a_fade_within_half_a_second():
    """Otherwise the loop would be left without gain: 5 sigma are passed, and the mean starts anew."""
    cn0 = strength(10.0, 32, 45.0)
    t = BIT * np.arange(1, len(cn0) + 1)
    cn0[t > 5.0] = ratio_from_dbhz(25.0)
    zero = still(10.0, 32)
    one = track(ScalarLoops(), COR, zero, zero, cn0, np.random.default_rng(2))
    at = int(np.argmin(np.abs(t - 5.5)))
    assert 10.0 * np.log10(np.median(one.cn0[at])) == pytest.approx(25.0, abs=5.0)
    assert one.on_signal(COR)[-1].mean() > 0.9


def test_reach_and_refusals():
    assert in_reach(COR, np.array([0.0, 292.0, 294.0]), np.array([9.4, 0.0, 0.0])).tolist() == [True, True, False]
    assert not in_reach(COR, np.zeros(1), np.full(1, 9.6))[0]
    with pytest.raises(InputError, match="bandwidth"):
        ScalarLoops(code_bandwidth=0.0)
    with pytest.raises(InputError, match="ranges"):
        track(ScalarLoops(), COR, np.zeros((5, 2)), np.zeros((5, 2)), np.ones((3, 2)), np.random.default_rng(0))
