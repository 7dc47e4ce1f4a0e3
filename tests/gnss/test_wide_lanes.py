"""Wide lanes: integers that are given come back, and far bases have fixes although both skies differ."""

from dataclasses import replace

import numpy as np
import pytest
from receiver_pairs import HOME_LLH, cycles_of, pair

from schuler.exceptions import InputError
from schuler.gnss import solve_baseline
from schuler.gnss.wide_lanes import wide_lane_integers
from schuler.units import DEG

FAR = (28_000.0, -9_000.0, 40.0)
F_L1 = 1575.42e6


def drawn(rng, epochs, satellites, sigma, gaps=True):
    """Combinations of satellites that rise, set and slip, with noise of this 1-sigma; arcs, and their integers."""
    arc = np.cumsum(rng.random((epochs, satellites)) < 3.0 / epochs, axis=0) + 1
    if gaps:
        arc[rng.random(arc.shape) < 0.1] = 0
    value = rng.integers(-30, 30, (arc.max() + 1, satellites))
    integers = np.take_along_axis(value, arc, axis=0)
    clock = 0.3 * np.cumsum(rng.standard_normal((epochs, 1)), axis=0)
    return integers + clock + sigma * rng.standard_normal(arc.shape), arc, integers


@pytest.mark.parametrize("runs", [20, pytest.param(1000, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("sigma", [0.3, 0.8])
def test_integers_come_back_or_are_left_open(runs, sigma):
    """Arcs of some 40 epochs. Wrong ones: at most one in a thousand by design, three standard errors above it here."""
    rng, wrong, taken, rows = np.random.default_rng(5), 0, 0, 0
    for _ in range(runs):
        cycles, arc, integers = drawn(rng, 120, 8, sigma)
        off = wide_lane_integers(cycles, np.full(arc.shape, sigma), arc) - np.where(arc > 0, integers, np.nan)
        off -= np.nanmedian(off)  # the arc that all others are less of
        rows, taken = rows + int((arc > 0).sum()), taken + int(np.isfinite(off).sum())
        wrong += int((np.abs(off) > 0.5).sum())
    assert wrong <= 1e-3 * taken + 3.0 * np.sqrt(40.0 * 1e-3 * taken)
    assert (0.9 if sigma < 0.5 else 0.2) < taken / rows < (1.0 if sigma < 0.5 else 0.8)


def test_codes_that_err_for_long_make_no_integers():
    """Errors of 0.6 cycles that last for twenty epochs average out twenty times as slowly: residuals tell."""
    rng, wrong, taken = np.random.default_rng(6), 0, 0
    for _ in range(20):
        cycles, arc, integers = drawn(rng, 120, 8, 0.0, gaps=False)
        slow = np.empty(arc.shape)
        slow[0] = rng.standard_normal(8)
        for k in range(1, 120):
            slow[k] = np.exp(-0.05) * slow[k - 1] + np.sqrt(1.0 - np.exp(-0.1)) * rng.standard_normal(8)
        got = wide_lane_integers(cycles + 0.6 * slow, np.full(arc.shape, 0.6), arc)
        off = got - integers
        off -= np.nanmedian(off)
        taken, wrong = taken + int(np.isfinite(off).sum()), wrong + int((np.abs(off) > 0.5).sum())
    assert taken < 0.5 * 20 * arc.size
    assert wrong < 0.02 * 20 * arc.size


@pytest.fixture(scope="module")
def far():
    """A quarter of an hour at rest, 29 km from the base, exact."""
    t = np.arange(0.0, 900.0, 10.0)
    return pair(np.random.default_rng(3), lambda _: FAR, t, systems="GE", each=18, bands=("1C", "5Q"))


def under_another_sky(p, rng, sigma=0.2):
    """The rover's ionosphere differs from the base's by this much, 1-sigma of a satellite on L1, and drifts. [m]"""
    o, delay = p.rover, np.zeros(len(p.rover))
    for sat in np.unique(o.sat):
        a, b = sigma * rng.standard_normal(2)
        mine = o.sat == sat
        delay[mine] = a + 0.3 * b * o.t[mine] / 900.0
    cycle = cycles_of(o)
    delay *= (cycle * F_L1 / 299_792_458.0) ** 2
    return replace(p, rover=replace(o, pseudorange=o.pseudorange + delay, carrier=o.carrier - delay / cycle))


def solve(p, **options):
    return solve_baseline(p.rover, p.base, p.ephemerides, HOME_LLH, systems="GE", static=True, **options)


@pytest.mark.parametrize("runs", [1, pytest.param(40, marks=pytest.mark.campaign)])
def test_a_far_base_has_fixes_without_the_ionosphere(far, runs):
    """Fixed ones are right: none beyond five sigma; with one ionosphere for both the same logs are decimetres off."""
    errors, last, same = [], [], []
    for seed in range(runs):
        rng = np.random.default_rng([7, seed])
        p = under_another_sky(far.noisy(rng), rng)
        s = solve(p, ionosphere="free")
        error = (s.baseline_n - p.baseline_n) / np.sqrt(np.diagonal(s.cov_baseline_n, axis1=1, axis2=2))
        errors.append(np.abs(error[s.fixed]).max(initial=0.0))
        last.append(s.fixed[-1])
        same.append(np.abs(solve(p).baseline_n[-1] - p.baseline_n[-1]).max())
    assert np.max(errors) < 5.0
    assert np.mean(last) > 0.9
    assert np.median(same) > 0.05
    assert s.verdict.status == "ok"
    assert set(s.band) == {"15"}
    assert any("wide lanes of" in note for note in s.notes)


def test_exact_measurements_give_the_baseline(far):
    p = replace(far, rover=far.rover.where(far.rover.t < 100.0), base=far.base.where(far.base.t < 100.0))
    p = under_another_sky(p, np.random.default_rng(2))
    s = solve(p, ionosphere="free", elevation_mask=20.0 * DEG, sigma_code=0.02)
    assert s.fixed[-1]
    np.testing.assert_allclose(
        s.baseline_n[s.fixed], far.baseline_n[: len(s)][s.fixed], atol=0.01
    )  # model at 29 km, see test_baseline


def test_one_band_has_no_wide_lane(far):
    o = far.base.where(far.base.signal == far.base.signals.index("1C"))
    with pytest.raises(InputError, match="free needs carriers on two bands of a system in both receivers"):
        solve(replace(far, base=o), ionosphere="free")
    with pytest.raises(InputError, match='expected "same" or "free"'):
        solve(far, ionosphere="klobuchar")
