"""Errors that stay with a satellite: honest with a state for each, over-confident without."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.filtering.engine import run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import PSEUDORANGE
from schuler.filtering.states import CHANNELS, StateLayout, StateModel
from schuler.gnss.slow_errors import SlowRangeError, slow_channels, slow_sigmas
from schuler.navigation.aids.satellite import range_measurements

RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]
SLOW = SlowRangeError(0.8, 20.0)
LAYOUT = ac.layout("clock", "clock_drift", "clock_2")


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


def with_channels(count):
    model = StateModel.gauss_markov(SLOW.sigma, SLOW.tau)
    return StateLayout({**LAYOUT.models, **dict.fromkeys(CHANNELS[:count], model)})


def reflected(over, slow):
    """Ranges as of ``aided_cases.satellites``, with a Gauss-Markov error of each satellite besides."""

    def aid(truth):
        r = ac.measured(truth, over)
        t, epoch = np.unique(r.t, return_inverse=True)
        sats, place = np.unique(r.sat, return_inverse=True)
        error = truth.draws(len(t), len(sats))
        keep = np.exp(-np.diff(t) / SLOW.tau)
        for k in range(1, len(t)):
            error[k] = keep[k - 1] * error[k - 1] + np.sqrt(1.0 - keep[k - 1] ** 2) * error[k]
        late = r.pseudorange + SLOW.sigma * SLOW.scale(r) * error[epoch, place]
        return range_measurements(replace(r, pseudorange=late), ac.LEVER, gate=None, slow=slow)

    return aid


@pytest.mark.parametrize("runs", RUNS)
def test_nees_and_nis_with_a_state_for_each_satellite(drive, runs):
    """Three satellites for a third of the time, whose channels go on while they are not seen."""
    t = drive.fixes_t
    over = ac.sky(drive, "GE", np.where((t > 40.0) & (t < 80.0), 3, 9))
    count = slow_channels(over, SLOW.tau, len(CHANNELS)).max()
    ac.Campaign.of(drive, LAYOUT, [reflected(over, SLOW)], range(runs), filter_layout=with_channels(count)).check()


def test_over_confident_without_them(drive):
    over = ac.sky(drive, "GE", 9)
    c = ac.Campaign.of(drive, LAYOUT, [reflected(over, None)], range(8), filter_layout=LAYOUT)
    assert c.nees[:, [30, 60, 90, 115]].mean() > 2.0


def test_a_satellite_without_a_channel_counts_as_white_noise_as_large(drive):
    """Closed form: the variance of the mean of n samples tends to ``s^2 (1 + a) / (1 - a) / n``."""
    over = ac.sky(drive, "GE", 9)
    n, a = 20_000, np.exp(-1.0 / SLOW.tau)
    j = np.arange(1, n)
    variance = SLOW.sigma**2 * (1.0 + 2.0 * np.sum((1.0 - j / n) * a**j))
    expected = variance * SLOW.scale(over) ** 2
    np.testing.assert_allclose(slow_sigmas(over, SLOW) ** 2, expected, rtol=1e-2)  # the ends of a finite mean
    many = [replace(over, sat=over.sat + 10 * k) for k in range(4)]
    crowd = replace(
        over,
        **{
            name: np.concatenate([getattr(r, name) for r in many])[np.argsort(np.tile(over.t, 4), kind="stable")]
            for name in (
                "t", "sat", "group", "r_sat_e", "v_sat_e", "pseudorange", "range_rate", "sigma_range", "sigma_rate",
                "elevation", "azimuth", "cn0", "reason", "carrier_range", "arc", "wavelength", "bands_apart",
            )
        },
    )  # fmt: skip
    rows = range_measurements(crowd, ac.LEVER, use_rates=False, slow=SLOW)
    alone = rows.z[:, 5] == 0.0
    assert 0 < alone.sum() < len(rows)
    assert rows.z[:, 5].max() == len(CHANNELS)
    added = rows.R[:, 0, 0] - crowd.sigma_range**2
    np.testing.assert_allclose(added[~alone], 0.0, atol=1e-12)  # rounding
    np.testing.assert_allclose(added[alone], slow_sigmas(crowd, SLOW)[alone] ** 2, rtol=1e-9)


def test_a_channel_has_one_satellite_at_a_time_and_another_after_five_correlation_times(drive):
    over = ac.sky(drive, "GE", 6)
    first, second = np.unique(over.sat)[:2]
    t = over.t
    one = over.where((over.sat == first) & (t < 30.0) | (over.sat == second) & (t > 60.0))
    assert slow_channels(one, 4.0, 5).tolist() == [1] * len(one)  # 30 s are more than 20 s
    later = slow_channels(one, 10.0, 5)
    assert set(later[one.sat == first]) == {1}
    assert set(later[one.sat == second]) == {2}
    assert set(slow_channels(one, 10.0, 1)[one.sat == second]) == {0, 1}  # free from 80 s on
    channel = slow_channels(over, 20.0, 24)
    for epoch in np.unique(t):
        mine = channel[t == epoch]
        assert len(set(mine)) == len(mine)
    unused = replace(over, reason=np.full(len(over), 3))
    assert not slow_channels(unused, 20.0, 24).any()


def test_live_epochs_smoother_and_batch_agree_and_a_result_shows_no_channel(drive):
    """Smoothed and causal end at the same state (rounding), and the smoothed one is nearer to the truth."""
    from schuler.filtering.engine import FilterOptions
    from schuler.navigation.result import NavigationResult

    over = ac.sky(drive, "GE", 7)
    lay = with_channels(int(slow_channels(over, SLOW.tau, 24).max()))
    causal, smoothed = [], []
    for seed in range(3):
        truth = ac.Truth(drive, LAYOUT, np.random.default_rng([11, seed]))
        schedule = reflected(over, SLOW)(truth)
        forward = run(truth.log, schedule, ac.initial(truth, lay), lay, *ac.NOISE, FilterOptions(smoother=True))
        result = NavigationResult.from_run(forward, schedule.t, schedule.kind, lay, lever_arm_b=ac.LEVER)
        assert result.layout.blocks == LAYOUT.blocks
        after = result.smooth()
        np.testing.assert_allclose(after.states.r_eb_e[-1], result.states.r_eb_e[-1], atol=1e-6)
        for one, into in ((result, causal), (after, smoothed)):
            into.append(np.linalg.norm(one.states.r_eb_e - truth.reference.at(one.t).r_eb_e, axis=1))
    assert np.sqrt(np.mean(np.square(smoothed))) < np.sqrt(np.mean(np.square(causal)))


def test_a_start_without_channels_has_them_at_their_sigma(drive):
    """The numbers of a start that has them, to the last bit."""
    over = ac.sky(drive, "GE", 7)
    lay = with_channels(int(slow_channels(over, SLOW.tau, 24).max()))
    truth = ac.Truth(drive, LAYOUT, np.random.default_rng(5))
    schedule, whole, m = reflected(over, SLOW)(truth), ac.initial(truth, lay), LAYOUT.size
    part = InitialState(whole.nav, whole.P[:m, :m], whole.parameters[: m - 9])
    one, other = (run(truth.log, schedule, start, lay, *ac.NOISE) for start in (whole, part))
    np.testing.assert_array_equal(one.rec_P, other.rec_P)
    np.testing.assert_array_equal(one.r, other.r)


def test_channels_without_a_gap_and_room_for_them():
    with pytest.raises(InputError, match="numbered from 1"):
        StateLayout({**LAYOUT.models, CHANNELS[1]: StateModel.constant(1.0)})
    full = with_channels(24)
    assert full.size == LAYOUT.size + 24
    assert full.visible.blocks == LAYOUT.blocks


def test_the_scale_grows_as_the_multipath_of_the_simulation(drive):
    over = ac.sky(drive, "GE", 9)
    expected = np.sqrt(0.5 + 0.5 / np.sin(over.elevation) ** 2)
    np.testing.assert_allclose(SLOW.scale(over), expected, rtol=1e-12)
    rows = range_measurements(over, ac.LEVER, slow=SLOW)
    ranges = rows.kind == PSEUDORANGE
    np.testing.assert_allclose(np.sort(rows.z[ranges, 6]), np.sort(expected), rtol=1e-12)
    assert not rows.z[~ranges, 7].any()
