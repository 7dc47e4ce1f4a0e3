"""Baselines: known integers, honest covariances, slips of both signs, two receivers on one antenna."""

from dataclasses import replace

import numpy as np
import pytest
from receiver_pairs import HOME_LLH, pair

import schuler
from schuler.exceptions import InputError
from schuler.frames import llh_from_ecef
from schuler.gnss import prepare_ranges, solve_points
from schuler.gnss.baseline import solve_baseline
from schuler.gnss.differences import cycle_slips, single_differences
from schuler.recording import read_rinex_navigation, read_rinex_observation

# Model: the forward model turns axes, ours has Sagnac's to first order (0.1 mm, almost the same for both antennas);
# the troposphere is that of an approximate height, 0.3 mm a metre in down.
MODEL = 3e-4


def moving(t):
    return 120.0 + 3.0 * t, -80.0 + np.sin(t), 5.0 + 0.1 * t


@pytest.fixture(scope="module")
def exact():
    return pair(np.random.default_rng(3), moving, np.arange(8.0))


@pytest.fixture(scope="module")
def resting():
    return pair(np.random.default_rng(4), lambda _: (40.0, 30.0, -2.0), np.arange(10.0), bands=("1C",))


def solve(p, **options):
    return solve_baseline(p.rover, p.base, p.ephemerides, HOME_LLH, **options)


def slipped(o, sat, after, cycles, signals=None):
    """A slip of one satellite's carriers from a time on."""
    k = (o.sat == sat) & (o.t > after)
    if signals is not None:
        k &= np.isin(o.signal, [o.signals.index(s) for s in signals])
    assert k.any()
    return replace(o, carrier=o.carrier + cycles * k)


def test_exact_measurements_give_the_path(exact):
    s = solve(exact)
    assert s.fixed.all()
    np.testing.assert_allclose(s.baseline_n, exact.baseline_n, atol=MODEL)
    np.testing.assert_allclose(s.t, exact.t, atol=1e-5)  # the receiver clock is known as well as its first epoch's


def test_noisy_measurements_are_fixed_to_millimetres(exact):
    s = solve(exact.noisy(np.random.default_rng(5)))
    assert s.fix_share == 1.0
    error = s.baseline_n - exact.baseline_n
    sigma = np.sqrt(np.diagonal(s.cov_baseline_n, axis1=1, axis2=2))
    assert np.all(np.abs(error) < 4.5 * sigma)  # statistical, 24 numbers
    assert sigma.max() < 0.01
    before = np.sqrt(np.diagonal(s.cov_float_n, axis1=1, axis2=2))
    assert np.all(before > 10.0 * sigma)


def _consistency(p, runs, static):
    fixed, floating = [], []
    for seed in range(runs):
        s = solve(p.noisy(np.random.default_rng(1000 + seed)), static=static)
        error, before = s.baseline_n[-1] - p.baseline_n[-1], s.float_n[-1] - p.baseline_n[-1]
        fixed.append(error @ np.linalg.solve(s.cov_baseline_n[-1], error))
        floating.append(before @ np.linalg.solve(s.cov_float_n[-1], before))
    width = 3.5 * np.sqrt(2.0 / (3.0 * runs))  # statistical: the mean of chi-square with 3 per run
    assert abs(np.mean(fixed) / 3.0 - 1.0) < width
    assert abs(np.mean(floating) / 3.0 - 1.0) < width


@pytest.mark.campaign
@pytest.mark.parametrize("static", [False, pytest.param(True, marks=pytest.mark.campaign)])
def test_covariances_are_honest(resting, static):
    _consistency(resting, 20, static)


@pytest.mark.campaign
@pytest.mark.parametrize("static", [False, True])
def test_covariances_are_honest_in_many_runs(exact, resting, static):
    _consistency(resting if static else exact, 200, static)


@pytest.mark.parametrize("cycles", [1.0, -1.0, 0.5, -40.0])
def test_slips_of_either_receiver_are_found(exact, cycles):
    p = exact.noisy(np.random.default_rng(6))
    sats = np.unique(p.rover.sat)
    rover = slipped(p.rover, sats[1], 3.5, cycles, ("1C",))
    base = slipped(p.base, sats[4], 4.5, -cycles, ("1C",))
    s = solve(replace(p, rover=rover, base=base))
    assert s.slips.tolist() == [0, 0, 0, 0, 1, 1, 0, 0]
    assert np.all(s.fixed[:4])
    assert np.all(s.fixed[4:] == (cycles != 0.5))  # what is left of half a cycle is no integer, which the ratio tells
    error = np.abs(s.baseline_n - p.baseline_n)
    assert error[s.fixed].max() < 0.04  # statistical: 5 of the largest sigma
    assert solve(p).slips.sum() == 0


def test_slips_that_a_receiver_states_are_placed_among_few(exact):
    """Four satellites agree with some place whatever one of them jumps by; half cycles count too."""
    p = exact.noisy(np.random.default_rng(6))
    four = np.unique(p.rover.sat)[:4]
    p = replace(p, rover=p.rover.where(np.isin(p.rover.sat, four)))
    jumped = slipped(p.rover, four[1], 3.5, 1.0)
    sudden = (jumped.sat == four[1]) & (jumped.t == np.unique(jumped.t)[4])
    silent, stated, half = (replace(jumped, lock=k * sudden.astype(np.int64)) for k in (0, 1, 2))
    begun = [begins_of(replace(p, rover=rover)) for rover in (silent, stated, half)]
    assert not begun[0].any()
    for stated_begins in begun[1:]:
        assert stated_begins.tolist() == [False, True, False, False]
    always = replace(p.rover, lock=np.ones(len(p.rover), dtype=np.int64))
    assert not begins_of(replace(p, rover=always)).any()  # a receiver that always says so says nothing


def begins_of(p):
    """Whether satellites' phases on the first band begin anew at the fifth epoch."""
    d = single_differences(
        p.rover, p.base, p.ephemerides, HOME_LLH, systems="GEC", elevation_mask=0.2, cn0_mask=30.0, sigma_code=0.3,
        sigma_carrier=0.003, static=False,
    )  # fmt: skip
    begins, _ = cycle_slips(d, static=False)
    first = np.array(d.band) == "1"
    assert first.sum() == 4
    return begins[4, first]


@pytest.mark.campaign
def test_slips_of_one_cycle_at_random(exact):
    """All are found, no other phase is suspected, no wrong integers are accepted."""
    rng = np.random.default_rng(9)
    for _ in range(150):
        p = exact.noisy(rng)
        k, at = rng.integers(len(p.rover)), int(rng.integers(1, 8))
        name = p.rover.signals[p.rover.signal[k]]
        rover = slipped(p.rover, p.rover.sat[k], at - 0.5, rng.choice([-1.0, 1.0]), (name,))
        s = solve(replace(p, rover=rover))
        assert s.slips.tolist() == [int(i == at) for i in range(8)]
        assert np.abs(s.baseline_n - p.baseline_n)[s.fixed].max() < 0.04  # statistical: 5 of the largest sigma


def test_every_system_on_every_band():
    p = pair(np.random.default_rng(10), moving, np.arange(2.0), bands=("1C", "2W", "5Q"), systems="GECJ", each=12)
    s = solve(p, systems="GECJ")
    assert s.notes[0].count("with") == 10  # three of GPS and QZSS, E1 and E5a, B1I and B3I
    assert s.fixed.all()
    np.testing.assert_allclose(s.baseline_n, p.baseline_n, atol=MODEL)


def test_static_is_the_better_for_knowing_it(resting):
    p = resting.noisy(np.random.default_rng(7))
    free, still = solve(p), solve(p, static=True)
    assert np.all(np.diff(np.trace(still.cov_float_n, axis1=1, axis2=2)) < 0.0)
    assert np.trace(still.cov_baseline_n[-1]) < 0.3 * np.trace(free.cov_baseline_n[-1])  # a tenth, but for the geometry
    assert solve(p, fix=False).n_fixed.sum() == 0


def test_the_first_epoch_on_two_bands_is_fixed_partly_or_all(exact):
    p = exact.noisy(np.random.default_rng(8), sigma_code=1.0)
    part, every = solve(p, sigma_code=1.0), solve(p, sigma_code=1.0, partial=False)
    assert part.fixed.sum() >= every.fixed.sum()
    right = np.abs(part.baseline_n - p.baseline_n)[part.fixed]
    sigma = np.sqrt(np.diagonal(part.cov_baseline_n, axis1=1, axis2=2))[part.fixed]
    assert np.all(right < 4.5 * sigma)  # statistical


@pytest.fixture(scope="module")
def thinning():
    """One band; of some fifteen satellites five are left from the eighth epoch on."""
    p = pair(np.random.default_rng(3), moving, np.arange(16.0), bands=("1C",), systems="GE", each=18)
    p = p.noisy(np.random.default_rng(5))
    five = np.unique(p.rover.sat[p.rover.t > 14.0])[:5]
    return replace(p, rover=p.rover.where(np.isin(p.rover.sat, five) | (p.rover.t < 7.5)))


def test_integers_that_are_held_outlast_satellites(thinning):
    free, held = solve(thinning), solve(thinning, hold=3)
    assert held.fixed[3:].all()
    assert free.fixed[8:].sum() < held.fixed[8:].sum()
    error = held.baseline_n - thinning.baseline_n
    sigma = np.sqrt(np.diagonal(held.cov_baseline_n, axis1=1, axis2=2))
    assert np.all(np.abs(error) < 4.5 * sigma)  # statistical, 48 numbers
    assert sigma[8:].max() < 0.1
    with pytest.raises(InputError, match="hold"):
        solve(thinning, hold=-1)


def test_integers_that_are_wrong_are_given_up(exact, monkeypatch):
    """A slip that nobody notices: the epoch has no baseline, and the next begin anew."""
    p = exact.noisy(np.random.default_rng(6))
    rover = slipped(p.rover, np.unique(p.rover.sat)[1], 4.5, 2.0, ("1C",))

    def unnoticed(d, *, static):
        begins = np.zeros(d.carrier.shape, dtype=bool)
        begins[0] = True
        return begins, np.zeros_like(begins)

    monkeypatch.setattr("schuler.gnss.baseline.cycle_slips", unnoticed)
    s = solve(replace(p, rover=rover), hold=2)
    assert s.ok.tolist() == [True] * 5 + [False] + [True] * 2
    assert s.fixed[-1]
    assert np.abs(s.baseline_n - p.baseline_n)[s.fixed].max() < 0.04  # statistical: 5 of the largest sigma


def test_a_part_of_the_integers_is_no_fix_by_itself(thinning):
    """Half of the combinations may leave decimetres: such a position is the better for them, and not called fixed."""
    s = solve(thinning, least_success=0.9)
    largest = np.sqrt(np.diagonal(s.cov_baseline_n, axis1=1, axis2=2).max(axis=1))
    np.testing.assert_array_equal(s.fixed, (s.n_fixed > 0) & (largest < 0.1))


def test_time_axes_with_other_zeros_and_a_base_that_misses_epochs(exact):
    b = exact.base.where(exact.base.t > 2.5)
    b = replace(b, t=b.t + 50.0, epoch_gps_s=b.epoch_gps_s - 50.0)
    s = solve(replace(exact, base=b))
    assert len(s) == 5
    assert any("3 of 8 epochs of the rover have none of the base" in note for note in s.notes)
    np.testing.assert_allclose(s.baseline_n, exact.baseline_n[3:], atol=MODEL)


def test_what_cannot_be_solved_says_why(exact):
    rover, base = exact.rover.where(exact.rover.t < 3.5), exact.base.where(exact.base.t > 4.5)
    with pytest.raises(InputError, match=r"no common epochs: rover from .* 2\.001 s apart"):
        solve(replace(exact, rover=rover, base=base))
    silent = replace(exact.base, carrier=np.full(len(exact.base), np.nan))
    with pytest.raises(InputError, match=r"base none"):
        solve(replace(exact, base=silent))
    with pytest.raises(InputError, match=r"base_llh: \d+ m from where"):
        solve_baseline(exact.rover, exact.base, exact.ephemerides, HOME_LLH + np.array([1e-3, 0.0, 0.0]))
    with pytest.raises(InputError, match="GLONASS"):
        solve(exact, systems="GR")
    with pytest.raises(InputError, match="sigma_code"):
        solve(exact, sigma_code=0.0)


def test_too_few_satellites_give_no_baseline(exact):
    """Three satellites of one system are two differences on each of two bands, whatever their number."""
    rover = exact.rover
    few = np.unique(rover.sat[rover.sat < 100])[:3]
    s = solve(replace(exact, rover=rover.where(np.isin(rover.sat, few) | (rover.t < 3.5))))
    assert s.ok.tolist() == [True] * 4 + [False] * 4
    assert s.fix_share == 0.5
    assert np.isnan(s.llh[4:]).all()
    assert s.summary().startswith("4 of 8 epochs solved")


def test_what_is_said_and_drawn(exact):
    s = solve(exact)
    assert s.summary().startswith("8 of 8 epochs solved, kinematic, 100.0 % fixed; last baseline 141.000")
    figure = s.figure()
    assert [panel.y_label for panel in figure.panels] == ["north [m]", "east [m]", "down [m]", "ratio, at most 100"]
    s.plot()
    np.testing.assert_allclose(s.llh[0], llh_from_ecef(s.r_e[0]), rtol=1e-15)


@pytest.mark.campaign
@pytest.mark.realdata
def test_two_receivers_on_one_roof(shared_data):
    """VN310 and Reach M2 share one antenna, as it turns out: the baseline is zero."""
    folder = shared_data / "instinct_tckf"
    name = folder / "reach-m2-01_raw_202306291111"
    base, ephemerides = read_rinex_observation(f"{name}.23O"), read_rinex_navigation(f"{name}.nav")
    rover = schuler.read(folder / "vn310-gnss.csv").observations
    points = solve_points(prepare_ranges(base, ephemerides, systems="GEC"))
    llh = llh_from_ecef(points.r_e[points.ok].mean(axis=0))
    s = solve_baseline(rover, base, ephemerides, llh)
    assert s.fix_share == 1.0
    half = len(s) // 2
    first, second = s.baseline_n[:half].mean(axis=0), s.baseline_n[half:].mean(axis=0)
    assert np.abs(first - second).max() < 0.001  # seen: 0.25 mm
    still = solve_baseline(rover, base, ephemerides, llh, static=True)
    np.testing.assert_allclose(first, still.baseline_n[-1], atol=0.001)
    np.testing.assert_allclose(still.baseline_n[-1], 0.0, atol=0.001)  # seen: 0.3 mm
    floating = solve_baseline(rover, base, ephemerides, llh, fix=False)
    assert np.abs(floating.baseline_n).max() < 0.3
    partly = solve_baseline(rover, base, ephemerides, llh, sigma_code=1.0, sigma_carrier=0.01)  # three times the noise
    part = (partly.n_fixed > 0) & (partly.n_fixed < partly.n_ambiguities)
    assert 0 < part.sum() < 20  # seen: 6
    assert partly.fix_share > 0.95
    length = np.linalg.norm(partly.baseline_n, axis=1)
    assert length[part].max() < 0.1  # seen: 45 mm
    assert length[partly.fixed].max() < 0.01  # seen: 2.5 mm; a wrong integer is 0.19 m
