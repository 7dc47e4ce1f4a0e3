"""Live walks: the numbers of a log's run stride by stride, long stands, pauses, impossible samples, the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import walk_cases as wc
from command import refusal, run

from schuler import frames
from schuler.exceptions import ConfigError
from schuler.live import Fix, LiveFoot
from schuler.navigation.foot import navigate_foot
from schuler.navigation.solution_tables import read_solution
from schuler.recording.formats.pyshoe import read_pyshoe
from schuler.recording.io import write
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.simulation.gait import walk

NOISE = 2e-3, 5e-2  # of a poor MEMS IMU, each sample [rad/s], [m/s^2]


def walked(strides=14, seed=3, **options):
    """Log of a walk with noise in rates, and its motion."""
    motion = walk(wc.ORIGIN, strides=strides, **options)
    imu = wc.rates_log(motion)
    rng = np.random.default_rng(seed)
    return motion, replace(
        imu,
        gyro=imu.gyro + rng.normal(0.0, NOISE[0], imu.gyro.shape),
        accel=imu.accel + rng.normal(0.0, NOISE[1], imu.accel.shape),
    )


def streamed(imu, size=40, config=None):
    """A live walk of a log that comes in pieces, its smoothed strides, and its events."""
    strides, events = [], []
    live = LiveFoot(
        {"place": wc.PLACE} if config is None else config, kind=imu.kind, on_event=events.append,
        on_stride=lambda stride, health, newest: strides.append(stride),
    )  # fmt: skip
    for k in range(0, len(imu), size):
        live.imu_many(imu.t[k : k + size], imu.gyro[k : k + size], imu.accel[k : k + size])
    live.finish()
    return live, strides, events


def path_of(strides):
    """Times and positions of smoothed strides."""
    return (
        np.concatenate([stride.trajectory.t for stride in strides]),
        np.concatenate([stride.trajectory.r_eb_e for stride in strides]),
    )  # fmt: skip


def assert_that_of_the_log(imu, live, strides):
    log = navigate_foot(imu, live.config).smoothed
    t, r = path_of(strides)
    np.testing.assert_array_equal(t, log.trajectory.t)
    # rounding: sums of windows that begin elsewhere
    np.testing.assert_allclose(r, log.trajectory.r_eb_e, rtol=0, atol=1e-7)
    covariance = np.concatenate([stride.covariance_e for stride in strides])
    np.testing.assert_allclose(covariance, log.covariance_e, rtol=1e-6, atol=1e-12)


@pytest.mark.campaign
@pytest.mark.parametrize("size", [1, 37, 3000])
def test_strides_are_those_of_the_log(size):
    """In whatever pieces it comes; the gait is what was learnt from the first six strides."""
    imu = walked(strides=8 if size == 1 else 14)[1]
    live, strides, _ = streamed(imu, size)
    assert live.health == "ok"
    assert live.config.detector.cycle_s == pytest.approx(1.0, abs=0.02)  # a swing of 0.45 s, a rest of 0.55 s
    assert_that_of_the_log(imu, live, strides)


def test_increments_are_taken_as_they_are():
    imu = wc.noisy(wc.increments_log(walked()[0]), np.random.default_rng(4), gyro_n=2e-4, accel_n=5e-3)
    live, strides, _ = streamed(imu)
    assert_that_of_the_log(imu, live, strides)


def test_increments_of_long_intervals_pass():
    """A swing at 50 Hz: 0.3 rad in an interval."""
    live = LiveFoot(kind="increment")
    live.imu_many(0.02 * np.arange(1, 11), np.full((10, 3), 0.3), np.full((10, 3), 0.5))
    assert not live.events
    live.imu(0.22, np.full(3, 20.0), np.zeros(3))
    assert "1 not finite or impossible" in live.events[0].text


@pytest.mark.campaign
def test_a_long_stand_is_cut_and_its_memory_bounded():
    """Two minutes at rest in mid-walk: cut every ten seconds in log and stream, no more samples kept than for that."""
    imu = walked()[1]
    at = int(np.searchsorted(imu.t, 12.75))  # in the middle of a stance
    more = round(120.0 * wc.RATE)
    rng = np.random.default_rng(5)
    still = [np.repeat(x[at : at + 1], more, axis=0) for x in (imu.gyro, imu.accel)]
    still = [x + rng.normal(0.0, sigma, x.shape) for x, sigma in zip(still, NOISE, strict=True)]
    t = np.arange(len(imu) + more) / wc.RATE + imu.t[0]
    gyro, accel = (np.insert(x, at, y, axis=0) for x, y in zip((imu.gyro, imu.accel), still, strict=True))
    imu = ImuSeries(t, gyro, accel)
    strides, most = [], 0
    live = LiveFoot({"place": wc.PLACE}, on_stride=lambda stride, health, newest: strides.append(stride))
    for k in range(0, len(imu), 40):
        live.imu_many(t[k : k + 40], gyro[k : k + 40], accel[k : k + 40])
        if t[k] > 30.0:
            most = max(most, len(live._samples))
    live.finish()
    assert most < 40.0 * wc.RATE
    assert sum(stride.trajectory.t[-1] - stride.trajectory.t[0] > 9.0 for stride in strides) > 8
    assert_that_of_the_log(imu, live, strides)


@pytest.mark.campaign
def test_the_newest_solution_is_that_of_the_filter_within_its_claim():
    """Asked ten times a second, in swings and stances that are not certain yet, beside the filter of the whole log."""
    imu = walked()[1]
    live, asked = LiveFoot({"place": wc.PLACE}), []
    for k in range(0, len(imu), 20):
        live.imu_many(imu.t[k : k + 20], imu.gyro[k : k + 20], imu.accel[k : k + 20])
        asked.append(live.solution())
    asked = [s for s in asked if s is not None]
    assert len(asked) > 80
    log = navigate_foot(imu, live.config).navigation.trajectory
    at = np.searchsorted(log.t, [s.t - 1e-9 for s in asked])
    e = np.array([frames.ned_from_ecef(log.r_eb_e[i], s.llh) for i, s in zip(at, asked, strict=True)])
    in_sigmas = np.abs(e) / [s.sigma_r_n for s in asked]
    assert in_sigmas.max() < 3.0  # a stance comes late, by half a window of the detector
    assert np.median(in_sigmas) < 0.1


def test_a_pause_breaks_the_walk_off_and_the_next_one_says_how_uncertain_it_is():
    imu = walked(strides=24)[1]
    events, keep = [], (imu.t < 15.3) | (imu.t > 19.3)
    live = LiveFoot({"place": wc.PLACE}, on_event=events.append)
    t, gyro, accel = imu.t[keep], imu.gyro[keep], imu.accel[keep]
    before = None
    for k in range(0, len(t), 20):
        live.imu_many(t[k : k + 20], gyro[k : k + 20], accel[k : k + 20])
        if t[k] < 15.0:
            before = live.solution()
    after = live.solution()
    assert [e.text for e in events if "goes on at the next rest" in e.text]
    assert live.health == "ok"
    assert np.max(before.sigma_r_n) < 0.5
    assert np.min(after.sigma_r_n) > 7.0  # 2 m/s over four seconds
    assert after.sigma_psi_n[2] > 1.0  # and nobody saw it turn [rad]
    # four strides were not seen
    north = frames.ned_from_ecef(frames.ecef_from_llh(after.llh)[None], wc.ORIGIN)[0]
    assert np.linalg.norm(north) == pytest.approx(20 * 1.3, abs=2.6)


def test_samples_that_no_imu_gives_are_left_out_and_said():
    imu = walked()[1]
    t, gyro, accel = imu.t.copy(), imu.gyro.copy(), imu.accel.copy()
    gyro[2000, 1], accel[2100, 0], accel[2200, 2], gyro[2300] = np.nan, np.inf, 1e9, -1e7
    t[2400], t[4600] = t[2390], t[4599]  # events of a sort come every ten seconds
    events = []
    live = LiveFoot({"place": wc.PLACE}, on_event=events.append)
    for k in range(0, len(t), 33):
        live.imu_many(t[k : k + 33], gyro[k : k + 33], accel[k : k + 33])
    live.take(Fix.from_sigmas(30.0, wc.ORIGIN, np.ones(3)))
    live.finish()
    message = " ".join(event.text for event in events)
    for words in ("not finite or impossible", "out of order", "repeated", "Fix: left out"):
        assert words in message
    assert live.health == "ok"
    north, east, _ = frames.ned_from_ecef(frames.ecef_from_llh(live.solution().llh)[None], wc.ORIGIN)[0]
    assert np.hypot(north, east) == pytest.approx(14 * 1.3, abs=0.1)


def damage(seed, t, gyro, accel):
    """A stretch of a log, other than it should be, one of eight kinds."""
    rng = np.random.default_rng(seed)
    k, n = int(rng.integers(0, len(t) - 600)), int(rng.integers(1, 600))
    rows = slice(k, k + n)
    if (kind := seed % 8) == 0:
        gyro[rows] = rng.normal(0.0, 30.0, (n, 3))
    elif kind == 1:
        accel[rows] *= rng.choice([-1.0, 10.0, 100.0])
    elif kind == 2:
        gyro[rows], accel[rows] = 0.0, 0.0
    elif kind == 3:
        t[k:] += rng.choice([0.05, 3.0, 1e6, -1.0, -100.0])
    elif kind == 4:
        gyro[rows], accel[rows] = gyro[k], accel[k]
    elif kind == 5:
        accel[rows] += rng.normal(0.0, 300.0, 3)
    elif kind == 6:
        t[rows] = t[k]
    else:
        gyro[rows] = np.nan


@pytest.mark.thinned(12)
@pytest.mark.parametrize("seed", range(48))
def test_whatever_comes_solutions_are_numbers(seed):
    """Two stretches of damage in a walk; no exception, no warning, nothing that is not finite."""
    imu = walked(strides=12, seed=seed)[1]
    t, gyro, accel = imu.t.copy(), imu.gyro.copy(), imu.accel.copy()
    damage(seed, t, gyro, accel)
    damage(seed // 8 + 3 * seed, t, gyro, accel)
    live = LiveFoot({"place": wc.PLACE})
    for k in range(0, len(t), 53):
        live.imu_many(t[k : k + 53], gyro[k : k + 53], accel[k : k + 53])
        if (s := live.solution()) is not None:
            assert np.isfinite([*s.llh, *s.v_eb_n, *s.rpy_nb, *s.sigma_r_n, *s.sigma_psi_n]).all()
    live.finish()


def test_it_coasts_where_no_stance_comes():
    imu = walked()[1]
    live = LiveFoot({"place": wc.PLACE})
    until = int(np.searchsorted(imu.t, 14.0))
    live.imu_many(imu.t[:until], imu.gyro[:until], imu.accel[:until])
    assert live.health == "ok"
    swing = slice(until - 100, until - 100 + round(0.3 * wc.RATE))  # over and over, without its stance
    for k in range(20):
        n = swing.stop - swing.start
        t = imu.t[until - 1] + (k * n + np.arange(1, n + 1)) / wc.RATE
        live.imu_many(t, imu.gyro[swing] + 3.0, imu.accel[swing])
    assert live.health == "coasting"
    turning = np.full((61 * 200, 3), 5.0)
    live.imu_many(t[-1] + np.arange(1, 61 * 200 + 1) / wc.RATE, turning, turning)
    assert live.health == "aligning"
    assert "no stance for 60 s" in live.events[-1].text


@pytest.mark.parametrize("threshold", ["time", "noise"])
def test_thresholds_that_look_at_all_of_a_log_are_refused(threshold):
    with pytest.raises(ConfigError, match=r"detector\.threshold = '.*live, give 'motion' or a number"):
        LiveFoot({"detector": {"threshold": threshold}})


def test_nobody_who_walks_is_no_error():
    """Somebody who stands, nothing at all, one sample: no solution, no exception."""
    live = LiveFoot()
    assert live.solution() is live.smoothed() is None
    live.finish()
    live.imu(0.0, np.zeros(3), np.array([0.0, 0.0, -9.8]))
    live.finish()
    assert live.health == "aligning"


@pytest.mark.campaign
def test_the_command_writes_newest_and_smoothed_solutions(capsys, tmp_path):
    imu = walked()[1]
    write(Recording(imu=imu), tmp_path / "shoe.parquet")
    place = [f"--set=place.{name}={value}" for name, value in wc.PLACE.items()]
    code, _, err = run(
        capsys, "live", f"replay:{tmp_path / 'shoe.parquet'}?speed=0", "--foot", "--headless", *place,
        "--record", tmp_path / "record", "--out", f"json:{tmp_path / 'out.jsonl'}",
    )  # fmt: skip
    assert code == 0, err
    newest, smoothed = (read_solution(tmp_path / f"record/{name}.parquet")[0] for name in ("solution", "smoothed"))
    assert newest.t[-1] == pytest.approx(imu.t[-1], abs=0.11)
    log = navigate_foot(imu, streamed(imu)[0].config).smoothed.trajectory
    at = np.searchsorted(log.t, smoothed.t - 1e-9)
    # rounding, of stamps and of the gait that pieces of other lengths show
    np.testing.assert_allclose(smoothed.r_eb_e, log.r_eb_e[at], rtol=0, atol=2e-3)
    assert np.median(np.diff(smoothed.t)) == pytest.approx(0.1, abs=0.051)
    assert "smoother_lag_s" in (tmp_path / "out.jsonl").read_text()


def test_the_command_says_what_a_walk_has_not(capsys):
    assert "--foot has no --state" in refusal(capsys, "live", "-", "--foot", "--state", "s.state")
    assert "expected --config FILE" in refusal(capsys, "live", "-")


@pytest.mark.realdata
def test_a_walk_of_the_laboratory_comes_out_as_from_its_log(shared_data):
    """Without clipped gyroscopes, which a log puts back by its largest rate, and a stream by the largest so far."""
    imu = read_pyshoe(shared_data / "pyshoe_vicon/2017-11-22-11-23-25.mat").recording.need_imu()
    live, strides, _ = streamed(imu, config={})
    assert_that_of_the_log(imu, live, strides)
    whole = navigate_foot(imu, {"filter": {"smooth": "stride"}}).smoothed.trajectory.r_eb_e
    # the gait of all the walk instead of its first six strides; 4 mm seen
    assert np.linalg.norm(path_of(strides)[1] - whole, axis=1).max() < 0.02
