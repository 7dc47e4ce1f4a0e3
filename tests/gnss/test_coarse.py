"""Rough positions, directions, medians, and the clock's milliseconds."""

import numpy as np
import pytest
from sky import HOME, ephemerides, observe

from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.gnss.coarse import coarse_track, directions, epoch_medians, geometric_ranges
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.receiver_clock import MILLISECOND, millisecond_steps


def sats_above(n, rng):
    elevation, azimuth = rng.uniform(0.2, 1.5, n), rng.uniform(-np.pi, np.pi, n)
    line = np.stack(
        (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)), axis=-1
    )
    return HOME + 2.2e7 * line @ C_en(llh_from_ecef(HOME)).T, elevation, azimuth


def test_directions_of_known_satellites(rng):
    r_sat, elevation, azimuth = sats_above(50, rng)
    lines_of_sight = directions(HOME, r_sat)
    assert np.allclose(lines_of_sight[0], elevation, rtol=0.0, atol=1e-12)
    assert np.allclose(lines_of_sight[1], azimuth, rtol=0.0, atol=1e-12)
    up = HOME + C_en(llh_from_ecef(HOME)) @ np.array([0.0, 0.0, -1e6])
    assert directions(HOME, up[None])[0][0] == pytest.approx(np.pi / 2.0)


def test_exact_ranges_give_the_place(rng):
    r_sat, _, _ = sats_above(7, rng)
    t_fix, r_fix = coarse_track(np.zeros(7), geometric_ranges(r_sat, HOME[None]) + 3e5, r_sat)
    assert t_fix.tolist() == [0.0]
    assert np.allclose(r_fix[0], HOME, atol=1e-3)


@pytest.mark.parametrize(
    ("count", "which", "error"), [*((8, 3, error) for error in (1e4, -1e5, 3e7)), *((6, k, 3e4) for k in range(6))]
)
def test_a_gross_error_is_left_out_also_of_six_satellites(count, which, error):
    r_sat, _, _ = sats_above(count, np.random.default_rng(4))
    p = geometric_ranges(r_sat, HOME[None])
    p[which] += error
    _, r_fix = coarse_track(np.zeros(count), p, r_sat)
    assert np.linalg.norm(r_fix[0] - HOME) < 1.0


def test_too_few_or_hopeless_epochs_give_nothing(rng):
    r_sat, _, _ = sats_above(5, rng)
    assert len(coarse_track(np.zeros(3), np.full(3, 2.2e7), r_sat[:3])[0]) == 0
    assert len(coarse_track(np.zeros(5), rng.uniform(2e7, 2.5e7, 5), r_sat)[0]) == 0
    twice = np.repeat(r_sat[:2], 2, axis=0)
    assert len(coarse_track(np.zeros(4), np.full(4, 2.2e7), twice)[0]) == 0
    assert coarse_track(np.zeros(0), np.zeros(0), np.zeros((0, 3)))[1].shape == (0, 3)


def test_a_long_log_costs_no_more_than_five_hundred_fixes(rng):
    r_sat, _, _ = sats_above(5, rng)
    n = 3000
    t = np.repeat(np.arange(n) * 30.0, 5)
    p = np.tile(geometric_ranges(r_sat, HOME[None]), n)
    t_fix, _ = coarse_track(t, p, np.tile(r_sat, (n, 1)))
    assert len(t_fix) <= 501
    assert np.all(np.diff(t_fix) >= 10.0)


def test_a_track_does_not_depend_on_where_a_log_begins(rng):
    """One fix in ten seconds of the clock; an epoch stamped a little before a whole second belongs to it."""
    r_sat, _, _ = sats_above(5, rng)
    t = np.repeat(np.arange(40.0) - 1e-4, 5)
    p = np.tile(geometric_ranges(r_sat, HOME[None]), 40)
    whole, _ = coarse_track(t, p, np.tile(r_sat, (40, 1)))
    np.testing.assert_allclose(whole, [0.0, 10.0, 20.0, 30.0], rtol=0.0, atol=2e-4)
    cut, _ = coarse_track(t[35:], p[35:], np.tile(r_sat, (33, 1)))
    np.testing.assert_array_equal(cut[1:], whole[1:])


def test_medians_of_epochs(rng):
    epoch = np.sort(rng.integers(0, 40, 300))
    value = rng.standard_normal(300)
    value[::7] = np.nan
    value[epoch == 5] = np.nan
    lines_of_sight = epoch_medians(epoch, value, 41)
    for i in range(41):
        v = value[(epoch == i) & np.isfinite(value)]
        assert (np.isnan(lines_of_sight[i]) and not len(v)) or lines_of_sight[i] == np.median(v)


def steps_of(t, clock_ms, drift=None):
    t = np.asarray(t, dtype=float)
    rates = np.full(len(t), np.nan) if drift is None else np.broadcast_to(drift, t.shape)
    return millisecond_steps(t, np.asarray(clock_ms) * MILLISECOND, rates)


def test_steps_of_several_sizes():
    steps, irregular = steps_of(range(6), [0.0, 1.0, 1.0, -2.0, -2.0, 0.02])
    assert steps.tolist() == [0, 1, 1, -2, -2, 0]
    assert len(irregular) == 0


def test_a_drift_is_no_step():
    t = np.arange(0.0, 300.0, 30.0)
    clock = 0.02 * t  # 20 us/s, more than half a millisecond between epochs
    assert not steps_of(t, clock, 0.02 * MILLISECOND)[0].any()
    assert len(steps_of(t, clock)[1]) > 0  # nobody could know, so it is said


def test_without_doppler_the_rate_before_counts():
    t = np.arange(0.0, 300.0, 30.0)
    clock = 0.003 * t
    clock[5:] += 1.0
    steps, irregular = steps_of(t, clock)
    assert steps.tolist() == [0] * 5 + [1] * 5
    assert len(irregular) == 0


def test_gaps_and_unknown_clocks():
    steps, _ = steps_of([0.0, 1.0, 2.0, 100.0], [0.0, np.nan, 1.0, 5.0])
    assert steps.tolist() == [0, 0, 1, 1]
    assert steps_of([], [])[0].tolist() == []


def test_what_is_no_millisecond_is_reported():
    steps, irregular = steps_of([0.0, 1.0, 2.0], [0.0, 0.4, 0.4])
    assert steps.tolist() == [0, 0, 0]
    assert irregular.tolist() == [1]


def test_a_receiver_in_the_stratosphere(rng):
    eph = ephemerides(rng, "GE", 14)
    place = ecef_from_llh([-0.6, 2.5, 35e3])
    r = prepare_ranges(observe(eph, [0.0], lambda t: place, lambda t: 0.0), eph, ionosphere="none")
    assert np.isfinite(r.elevation).all()
    assert np.isfinite(r.pseudorange).all()


def test_a_log_of_wrong_times_is_given_up_soon_and_its_end_still_found(monkeypatch):
    """Searches grow as the root of twice the number of epochs; what is right behind them is found after a pause."""
    from schuler.gnss import coarse

    r_sat, _, _ = sats_above(8, np.random.default_rng(2))
    right = geometric_ranges(r_sat, HOME[None])
    wrong = right + np.linspace(-4e4, 4e4, 8) ** 2 / 1e4
    searched = []
    search = coarse._fix
    monkeypatch.setattr(coarse, "_fix", lambda *given: searched.append(1) or search(*given))
    epochs = 200
    t, sats = np.repeat(np.arange(float(epochs)), 8), np.tile(r_sat, (epochs, 1))
    assert len(coarse_track(t, np.tile(wrong, epochs), sats)[0]) == 0
    assert len(searched) <= coarse._PATIENCE + 1 + np.sqrt(2.0 * epochs)
    late = np.where(t < 100.0, np.tile(wrong, epochs), np.tile(right, epochs))
    t_fix, r_fix = coarse_track(t, late, sats)
    assert 100.0 <= t_fix[0] < 115.0
    assert np.allclose(r_fix, HOME, atol=1e-3)  # rounding
