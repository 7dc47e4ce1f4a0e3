"""A live run by ranges has the numbers of a batch run; epochs of raw measurements are corrected as those of a log."""

from dataclasses import replace

import live_cases as cases
import numpy as np
import pytest
from places import EXAMPLES

from schuler.exceptions import ConfigError
from schuler.gnss.preparation import MILLISECOND
from schuler.gnss.ranges import joined_ranges
from schuler.live import LiveNavigator, SatelliteEpoch
from schuler.live.playback import messages
from schuler.live.satellites import LiveSatellites
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.satellite_noise import window_of
from schuler.navigation.inputs.satellites import satellites
from schuler.navigation.run import navigate
from schuler.recording.io import read
from schuler.simulation import simulate

ROUNDING = 1e-8  # geodetic coordinates and sums over blocks of other lengths [m]
SCENARIO = {
    **{name: part for name, part in cases.SCENARIO.items() if name != "gnss"},
    "satellites": {
        "systems": "GE", "rate_hz": 1.0, "noise_m": 0.5, "rate_noise_m_s": 0.05, "multipath_m": 0.0,
        "clock_m": 3000.0, "clock_drift_m_s": 30.0, "offsets_m": [12.0], "lever_arm_m": [0.6, -0.2, -1.1],
    },
}  # fmt: skip
CONFIG = {
    **cases.CONFIG,
    "gnss": {"coupling": "tight", "lever_arm_m": [0.6, -0.2, -1.1]},
}


@pytest.fixture(scope="module")
def recording():
    return simulate(SCENARIO)


@pytest.fixture(scope="module")
def psins(shared_data):
    return read(shared_data / "psins_tc" / "insgpseo_tc.mat")


def epochs(measured):
    return [SatelliteEpoch(measured.where(measured.t == t)) for t in np.unique(measured.t)]


def fed(live, recording, late=0.0, start=-np.inf, stop=np.inf):
    """Times and Earth-fixed positions after every epoch, a second apart or more, with epochs so late."""
    stream = [(t + (late if isinstance(m, SatelliteEpoch) else 0.0), m) for t, m in messages(recording, 0.2)]
    rows, due = [], -np.inf
    for t, message in sorted(stream, key=lambda pair: pair[0]):
        if not start < t <= stop:
            continue
        live.take(message)
        if isinstance(message, SatelliteEpoch) and t >= due and (solution := live.solution()) is not None:
            rows.append((solution.t, *cases.position(solution)))
            due = t + 0.9
    solution = live.solution()
    return np.array([*rows, (solution.t, *cases.position(solution))])


def distances(rows, result):
    tr = result.trajectory
    return np.linalg.norm(tr.r_eb_e[np.searchsorted(tr.t, rows[:, 0] - 1e-6)] - rows[:, 1:], axis=1)


@pytest.mark.parametrize("late", [0.0, pytest.param(1.5, marks=pytest.mark.campaign)])
def test_ranges_give_the_batch_run(recording, late):
    """In time to rounding; late ones after the replay."""
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    rows = fed(live, recording, late)
    same = distances(rows, navigate(recording, CONFIG, initial=live.initial))
    settled = rows[:, 0] > live.initial.nav.t + 61.0
    assert settled.sum() > 20
    assert same[-1] < ROUNDING
    assert (same[settled].max() < ROUNDING) == (late == 0.0)
    assert live.health == "ok"
    assert live.layout.size == 15 + 3  # clock, drift, Galileo's clock


def after_windows(rows, start):
    """Rows asked for when ten seconds had just become complete, a minute after the start or later."""
    return (np.diff(window_of(rows[:, 0] + 0.02), prepend=0) > 0) & (rows[:, 0] > start + 61.0)


@pytest.mark.campaign
@pytest.mark.parametrize("late", [0.0, pytest.param(1.5, marks=pytest.mark.campaign)])
def test_ten_seconds_that_are_complete_are_those_of_a_log(recording, late):
    """Standard deviations a third of the truth for a quarter of a minute: a log enlarges them by the scatter of ten
    seconds, live by those before each epoch until the ten are complete."""
    r = recording.ranges
    wrong = (r.t > 66.0) & (r.t < 81.0)
    sentence = replace(recording, ranges=replace(r, sigma_range=r.sigma_range / np.where(wrong, 3.0, 1.0)))
    sentence = sentence.between(0.0, 93.0)
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    rows = fed(live, sentence, late)
    same = distances(rows, navigate(sentence, CONFIG, initial=live.initial))
    assert same[rows[:, 0] > live.initial.nav.t + 61.0].max() > 1e-4  # until they are complete
    assert same[-1] < ROUNDING
    if late == 0.0:
        complete = after_windows(rows, live.initial.nav.t)
        assert complete.sum() >= 2
        assert same[complete].max() < ROUNDING


def test_a_restart_goes_on_to_the_same_last_bit(recording, tmp_path):
    """While it collects, and with late epochs under way."""
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    part = recording.between(0.0, 45.0)
    fed(live, part, 0.3, stop=40.0)
    other = LiveNavigator.load(live.save(tmp_path / "state"))
    ends = [fed(run, part, 0.3, start=40.0) for run in (live, other)]
    np.testing.assert_array_equal(ends[0][-1], ends[1][-1])
    assert live.save(tmp_path / "one").read_bytes() == other.save(tmp_path / "two").read_bytes()


def test_what_comes_wrong_is_said(recording):
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    fed(live, recording.between(0.0, 30.0))
    before = live.covariance
    first, last = (epochs(recording.ranges)[k] for k in (20, 30))
    live.take(first)  # a second time
    live.take(SatelliteEpoch(last.measured.where([])))
    live.take(SatelliteEpoch(replace(last.measured, t=last.measured.t + 1e4)))
    np.testing.assert_array_equal(live.covariance, before)
    sentence = [e.text for e in live.events[-3:]]
    assert "came before" in sentence[0]
    assert "got none" in sentence[1]
    assert "another zero" in sentence[2]


def test_a_fault_and_a_jump_of_the_clock_are_found_as_in_a_log(recording):
    """The same numbers as in the log, once five epochs have shown that the jump lasts."""
    ranges, config = recording.ranges, NavigationConfig.checked(CONFIG)
    times = np.unique(ranges.t)
    jump, fault = times[50], (ranges.t == times[40]) & (ranges.sat == ranges.sat[ranges.t == times[40]][0])
    bad = replace(ranges, pseudorange=ranges.pseudorange + 150.0 * (ranges.t >= jump) + 300.0 * fault)
    live, usable, notes = LiveSatellites(config), [], []
    for epoch in epochs(bad)[:70]:
        taken, sentences = live.take(epoch)
        usable.append(taken.usable)
        notes += sentences
    log, _ = satellites(replace(recording, ranges=bad), config, [])
    log = log.where(log.used)
    made = joined_ranges(usable)
    made = made.where(made.used)
    assert not np.any((made.t == times[40]) & (made.sat == ranges.sat[fault][0]))
    for t in times[[30, 45, 50, 55, 69]]:
        a, b = log.where(log.t == t), made.where(made.t == t)
        np.testing.assert_array_equal(a.sat, b.sat)
        np.testing.assert_allclose(a.pseudorange, b.pseudorange, rtol=0.0, atol=1e-6)  # rounding of 2e7 m
    assert sum("jumped by +15" in note for note in notes) == 1
    assert any("excluded by fault detection" in note for note in notes)


@pytest.mark.campaign
def test_reflections_are_left_out_as_in_a_log(recording):
    """Five satellites late by 25 to 65 m for 25 s, which no epoch alone can tell."""
    ranges, config = recording.ranges, NavigationConfig.checked(CONFIG)
    ranges = ranges.where((ranges.t > 19.0) & (ranges.t < 71.0))
    late = np.zeros(len(ranges))
    for k, sat in enumerate(np.unique(ranges.sat)[:5].tolist()):
        late += (ranges.sat == sat) * (ranges.t >= 35.0) * (ranges.t < 60.0) * (25.0 + 10.0 * k)
    bad = replace(ranges, pseudorange=ranges.pseudorange + late)
    log, _ = satellites(replace(recording, ranges=bad), config, [])
    live, at_once, compared = LiveSatellites(config), [], 0
    for epoch in epochs(bad):
        at_once.append(live.take(epoch)[0].usable)
        live.forget(epoch.t)
        _, again = live.complete(live.epochs[-1])
        due = window_of(epoch.t) - 1
        if again is not None and due >= 3:
            of_log = log.where(log.used & (window_of(log.t) == due))
            assert of_log.sat.tolist() == again.sat[again.used].tolist()
            np.testing.assert_allclose(again.sigma_range[again.used], of_log.sigma_range, rtol=1e-9)
            compared += 1
    assert compared >= 3
    newest = joined_ranges(at_once)
    of_late = (late > 0.0) & ranges.used
    kept = np.isin(ranges.t * 1000.0 + ranges.sat, newest.t[newest.used] * 1000.0 + newest.sat[newest.used])
    assert kept[of_late].mean() < 0.3  # by the past alone, in the first seconds too


@pytest.mark.campaign
@pytest.mark.realdata
def test_raw_epochs_are_corrected_as_in_a_log(psins):
    """A step of a millisecond is taken out of both; the place is the log's once ten seconds are complete."""
    config = NavigationConfig.checked({"imu": {"catalogue": "MTi-G-710"}, "gnss": {"coupling": "tight"}})
    o = psins.observations.where(psins.observations.t >= psins.imu.t[0])
    o = replace(o, pseudorange=o.pseudorange + MILLISECOND * (o.t >= np.unique(o.t)[60]))
    log, _ = satellites(replace(psins, observations=o), config, [])
    live = LiveSatellites(config)
    live.learn(psins.ephemerides)
    live.learn(psins.ephemerides)
    assert len(live.ephemerides.kepler) == len(psins.ephemerides.distinct().kepler)
    taken = []
    for epoch in epochs(o)[:90]:
        taken.append(live.take(epoch))
        live.complete(taken[-1][0])
    assert not any(notes for _, notes in taken)  # milliseconds are no jump
    made = joined_ranges([epoch.usable for epoch, _ in taken])
    log = log.where(log.used & (log.t <= made.t[-1]))
    made = made.where(made.used)
    np.testing.assert_array_equal(made.sat, log.sat)
    off = np.abs(made.pseudorange - log.pseudorange)
    complete = window_of(made.t) < window_of(made.t[-1])
    assert off[complete].max() < 1e-6  # rounding of 2e7 m
    assert off.max() < 0.02  # atmosphere at a place 100 m off
    np.testing.assert_array_equal(made.t[complete], log.t[complete])
    np.testing.assert_allclose(made.t, log.t, rtol=0.0, atol=2e-6)  # places make microseconds round otherwise


@pytest.mark.realdata
@pytest.mark.campaign
def test_a_stream_of_raw_measurements_gives_the_batch_run(psins):
    config = NavigationConfig.load(EXAMPLES / "psins_tc.toml", [("filter.smooth", False), ("filter.tune", False)])
    live = LiveNavigator.from_config(config, kind=psins.imu.kind)
    rows = fed(live, psins)
    same = distances(rows, navigate(psins, config, initial=live.initial))
    complete = after_windows(rows, live.initial.nav.t)
    assert complete.sum() > 5
    assert same[complete].max() < ROUNDING
    assert same[rows[:, 0] > live.initial.nav.t + 61.0].max() < 1e-3  # atmosphere 100 m off, as above; seen 7e-5


def test_what_a_live_run_has_not_is_refused():
    tight = ({"carrier": "time-differenced"}, {"antenna": "TRM57971.00"}, {"ionosphere": "maps"})
    for entry in (*({"tight": part} for part in tight), {"correlated": {"position_sigma_m": 1.0}}):
        with pytest.raises(ConfigError, match="a live run"):
            LiveNavigator.from_config({**CONFIG, "gnss": {**CONFIG["gnss"], **entry}})


def test_messages_of_the_other_coupling_are_ignored(recording):
    loose = LiveNavigator.from_config(cases.CONFIG)
    loose.take(epochs(recording.ranges)[0])
    assert loose.events == []


@pytest.mark.campaign
def test_after_a_pause_biases_are_kept_and_the_clock_is_not(recording):
    """The receiver has set its clock by 500 km in the meantime; the run aligns anew and goes where the log goes."""
    live = LiveNavigator.from_config(CONFIG, kind=recording.imu.kind)
    fed(live, recording.between(0.0, 45.0))
    before = live.parameters[:3]
    later = recording.ranges.t > 50.0
    moved = replace(recording.ranges, pseudorange=recording.ranges.pseudorange + 5e5 * later)
    rows = fed(live, replace(recording, ranges=moved), start=50.0)
    truth = recording.reference.r_eb_e[np.searchsorted(recording.reference.t, rows[-1, 0] - 1e-6)]
    assert np.linalg.norm(rows[-1, 1:] - truth) < 5.0  # statistical: ranges of 0.5 m
    assert live.health == "ok"
    assert any("with the biases of before" in e.text for e in live.events)
    sigma = np.sqrt(np.diag(live.initial.P)[9:12])
    assert np.all(np.abs(live.initial.parameters[:3] - before) < 5.0 * sigma + 1e-4)
