"""Synthetic ranges: consistent with their own motion, statistics as asked, masks and limits."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.point import solve_points
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.gnss.synthetic import EXACT, RangeErrors, Sector, broadcast_satellites, synthetic_ranges
from schuler.units import DEG

HERE = frames.ecef_from_llh(np.array([0.85, 0.16, 400.0]))


def still(t, errors=None, seed=1, systems="G", **options):
    t = np.asarray(t, dtype=float)
    r = np.broadcast_to(HERE, (len(t), 3))
    return synthetic_ranges(
        t, r, np.zeros_like(r), nominal_orbits(systems), np.random.default_rng(seed), errors, **options
    )


def test_range_rates_are_derivatives_of_the_ranges():
    """As measured, receiver at 300 m/s; central difference over 2 s, truncation 2e-5 m/s (third derivative / 6)."""
    t = np.array([0.0, 1.0, 2.0])
    v = np.array([100.0, -200.0, 200.0])
    s = synthetic_ranges(
        t, HERE + v * t[:, None], np.broadcast_to(v, (3, 3)), nominal_orbits("GE"), np.random.default_rng(0),
        replace(EXACT, clock=5.0, drift=3.0, offsets=(2.0,)),
    )  # fmt: skip
    q = s.ranges
    first, middle, last = (q.where(s.epoch == k) for k in range(3))
    assert np.array_equal(first.sat, last.sat)
    numerical = 0.5 * (last.pseudorange - first.pseudorange)
    measured = s.observations().range_rate[s.epoch == 1]
    assert np.abs(numerical - measured).max() < 5e-5
    # ... which the linear model misses by the ratio of a second of reception to one of transmission
    assert 5e-4 < np.abs(numerical - middle.range_rate).max() < 4e-3


def test_the_signal_left_the_satellite_a_travel_time_ago():
    s = still([0.0, 10.0], EXACT)
    orbits = nominal_orbits("G")
    for k in range(0, len(s.ranges), 3):
        q = s.ranges
        one = orbits.where(orbits.sat == q.sat[k])
        r, _ = one.states(np.array([q.t[k] - q.pseudorange[k] / SPEED_OF_LIGHT]))
        assert np.abs(r[0, 0] - q.r_sat_e[k]).max() < 1e-7  # rounding


def test_directions():
    s = still([0.0], EXACT, elevation_mask=-0.5 * np.pi)
    q = s.ranges
    ned = (q.r_sat_e - HERE) @ frames.C_en(np.array([0.85, 0.16, 400.0]))
    distance = np.linalg.norm(ned, axis=1)
    assert ned[:, 0] == pytest.approx(distance * np.cos(q.elevation) * np.cos(q.azimuth), abs=1e-6)
    assert ned[:, 1] == pytest.approx(distance * np.cos(q.elevation) * np.sin(q.azimuth), abs=1e-6)
    assert ned[:, 2] == pytest.approx(-distance * np.sin(q.elevation), abs=1e-6)
    assert len(q) == 24


def test_mask_sectors_and_limits():
    everything = still(np.arange(0.0, 7200.0, 600.0), EXACT, systems="GE")
    assert everything.ranges.elevation.min() >= 5.0 * DEG
    wall = Sector(350.0 * DEG, 100.0 * DEG, 40.0 * DEG)  # through north
    q = still(np.arange(0.0, 7200.0, 600.0), EXACT, systems="GE", blocked=[wall]).ranges
    behind = ((q.azimuth > 350.0 * DEG) | (q.azimuth < 100.0 * DEG)) & (q.elevation <= 40.0 * DEG)
    assert not behind.any()
    a = everything.ranges
    gone = ((a.azimuth >= 350.0 * DEG) | (a.azimuth <= 100.0 * DEG)) & (a.elevation <= 40.0 * DEG)
    assert len(q) == len(a) - gone.sum()
    limits = np.array([4, 3, 2, 1] * 3)
    few = still(np.arange(0.0, 7200.0, 600.0), EXACT, systems="GE", max_satellites=limits)
    assert list(np.bincount(few.epoch)) == list(limits)
    for k in range(12):  # the highest stay
        assert few.ranges.elevation[few.epoch == k].min() >= np.sort(a.elevation[everything.epoch == k])[-limits[k]]


def test_reproducible_from_the_seed():
    a, b, c = (still(np.arange(50.0), seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(a.ranges.pseudorange, b.ranges.pseudorange)
    assert not np.array_equal(a.ranges.pseudorange, c.ranges.pseudorange)


def test_truth_and_error_add_up():
    exact, noisy = still(np.arange(50.0), EXACT), still(np.arange(50.0))
    q = noisy.ranges
    back = q.pseudorange - noisy.error - noisy.clock[noisy.epoch, q.group]
    assert back == pytest.approx(exact.ranges.pseudorange, abs=1e-7)
    back = q.range_rate - noisy.rate_error - noisy.drift[noisy.epoch]
    assert back == pytest.approx(exact.ranges.range_rate, abs=1e-10)


@pytest.mark.parametrize("part", ["noise", "multipath", "atmosphere"])
def test_errors_have_the_stated_standard_deviation(part):
    """Samples 20 correlation times apart are independent; standard error of a variance sqrt(2 / n)."""
    budget = replace(EXACT, **{part: 2.0}, rate_noise=0.1)
    s = still(np.arange(0.0, 60_000.0, 20.0), budget)
    z = s.error / s.ranges.sigma_range
    assert abs(np.mean(z**2) - 1.0) < 4.0 * np.sqrt(2.0 / len(z))
    assert abs(np.mean(z)) < 4.0 / np.sqrt(len(z))
    z = s.rate_error / s.ranges.sigma_rate
    assert abs(np.mean(z**2) - 1.0) < 4.0 * np.sqrt(2.0 / len(z))
    high = s.ranges.elevation > 85.0 * DEG
    assert s.ranges.sigma_range[high] == pytest.approx(2.0, rel=0.01)


def test_multipath_is_correlated_as_asked():
    tau = 30.0
    s = still(np.arange(0.0, 9000.0, 10.0), replace(EXACT, multipath=1.0, multipath_tau=tau))
    q = s.ranges
    products = []
    for sat in np.unique(q.sat):
        k = np.flatnonzero(q.sat == sat)
        z, t = s.error[k] / q.sigma_range[k], q.t[k]
        follows = np.diff(t) < 15.0
        products.append((z[1:] * z[:-1])[follows])
    c = np.concatenate(products)
    expected = np.exp(-10.0 / tau)
    # Bartlett: variance of a lag-1 autocorrelation of this process; mean of squares varies too, so twice it
    se = np.sqrt((1.0 + expected**2) / (1.0 - expected**2) * 2.0 / len(c))
    assert abs(c.mean() - expected) < 4.0 * se


def test_the_clock_walks_as_its_densities_say():
    """Steps: variance of the drift S_d dt, of the phase beyond it S_f dt + S_d dt^3 / 3, covariance S_d dt^2 / 2."""
    dt, S_f, S_d = 2.0, 0.3, 0.2
    s = still(
        dt * np.arange(4000), replace(EXACT, clock=10.0, drift=1.0, clock_psd=S_f, drift_psd=S_d), max_satellites=1
    )
    drift = np.diff(s.drift)
    phase = np.diff(s.clock[:, 0]) - s.drift[:-1] * dt
    n = len(drift)
    expected = np.array([[S_f * dt + S_d * dt**3 / 3.0, S_d * dt**2 / 2.0], [S_d * dt**2 / 2.0, S_d * dt]])
    covariance = np.cov(phase, drift)
    se = np.sqrt((expected**2 + np.outer(np.diag(expected), np.diag(expected))) / n)
    assert np.all(np.abs(covariance - expected) < 4.0 * se)
    assert s.clock[0, 0] == 10.0
    assert s.drift[0] == 1.0


def test_groups_have_their_own_clock():
    s = still([0.0, 1.0], replace(EXACT, offsets=(7.0, -9.0)), systems="GER")
    assert s.ranges.groups == ("G", "E", "R")
    assert s.clock[0] == pytest.approx([0.0, 7.0, -9.0])
    assert np.array_equal(s.ranges.group == 2, s.ranges.sat // 100 == 1)


def test_observations_are_stamped_by_the_receivers_clock():
    s = still([0.0, 1.0], replace(EXACT, clock=SPEED_OF_LIGHT * 1e-3))
    o = s.observations()
    assert o.epochs == pytest.approx([1e-3, 1.001], abs=1e-12)
    assert np.array_equal(o.pseudorange, s.ranges.pseudorange)
    assert set(o.signal) == {0}


@pytest.mark.parametrize("kind", ["circular", "messages"])
def test_observations_and_messages_lead_back_to_the_truth(kind):
    """Through the choice of messages, orbits, transmission times and preparation of a real log.

    A clock of 1 ms and microsecond rounding of the time of reception leave 0.2 us times 4 km/s in the ranges.
    """
    epoch, t = 1_400_000_000.0, np.arange(0.0, 600.0, 20.0)
    systems = "GEC" if kind == "circular" else "GREC"
    orbits = nominal_orbits(systems, epoch_gps_s=epoch)
    ephemerides = orbits.ephemerides(epoch, epoch + 600.0)
    v = np.array([10.0, -5.0, 3.0])
    r = HERE + v * t[:, None]
    # GLONASS channels come with its messages; circular orbits are not what its users compute
    satellites = orbits if kind == "circular" else broadcast_satellites(ephemerides, epoch_gps_s=epoch)
    s = synthetic_ranges(
        t, r, np.broadcast_to(v, r.shape), satellites, np.random.default_rng(0),
        replace(EXACT, clock=3e5, drift=40.0, offsets=(10.0, -20.0, 30.0)[: len(systems) - 1]),
        epoch_gps_s=epoch, elevation_mask=11.0 * DEG,
    )  # fmt: skip
    ranges = prepare_ranges(s.observations(), ephemerides, ionosphere="none", troposphere="none")
    assert len(ranges.groups) == len(systems)
    assert set(ranges.reason) == {0}
    points = solve_points(ranges)
    assert points.ok.all()
    assert np.abs(points.r_e - r).max() < 1e-4
    assert np.abs(points.v_e - v).max() < 1e-6
    assert np.abs(points.drift - s.drift).max() < 1e-6
    order = [ranges.groups.index(g) for g in s.ranges.groups]
    assert np.abs(points.clock[:, order] - s.clock).max() < 1e-4


def test_inputs_are_checked():
    with pytest.raises(InputError, match="increasing"):
        still([0.0, 0.0])
    with pytest.raises(InputError, match="ever visible"):
        still([0.0], elevation_mask=1.5)
    with pytest.raises(InputError, match="offsets"):
        still([0.0], RangeErrors(offsets=(1.0,)))
    with pytest.raises(InputError, match="max_satellites"):
        still([0.0, 1.0], max_satellites=[1, 2, 3])
    with pytest.raises(InputError, match="noise"):
        RangeErrors(noise=-1.0)
    with pytest.raises(InputError, match="multipath_tau"):
        RangeErrors(multipath_tau=0.0)
