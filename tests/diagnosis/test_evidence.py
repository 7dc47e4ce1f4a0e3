"""Single pieces of evidence: what each sees, and what it must not take for a fault."""

from __future__ import annotations

import copy
import tracemalloc
from dataclasses import replace

import corruption_drives
import corruptions as suite
import diagnosis_drives as drives
import numpy as np
import pytest

import schuler
from schuler.calibration.freepose.simulation import hand_log
from schuler.diagnosis import sampling
from schuler.diagnosis.gyro_unit import are_counts, by_turns, turns_between
from schuler.diagnosis.lag import explained
from schuler.diagnosis.motion import WindowMeans, motion_of
from schuler.diagnosis.run import diagnose
from schuler.diagnosis.sampling import check_temperature
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.sensors import ImuErrors
from schuler.standstill.unscaled import unscaled_rests
from schuler.units import DEG, G0


@pytest.fixture(scope="module")
def good():
    return drives.drive()


@pytest.fixture(scope="module")
def flat():
    """The simulated town without its hills: nothing rolls."""
    scenario = copy.deepcopy(corruption_drives._TOWN)
    for point in scenario["motion"]["waypoints"]:
        point.pop("height_m", None)
    return replace(schuler.simulate(scenario), reference=None)


def untold(diagnosis):
    return " ".join(f.text for f in diagnosis.findings if f.code == "unchecked")


def test_many_shifts_at_once_are_each_of_them_by_itself(good):
    motion, means = motion_of(good.gnss.t, good.gnss.v_n, 9.81), WindowMeans(good.imu)
    shifts = np.array([-300.0, -3.0, -0.1, 0.0, 0.25, 170.0])
    for ahead in (0.0, 1.5):
        whole = explained(means, motion, shifts, None, ahead)
        each = np.concatenate([explained(means, motion, shifts[k : k + 1], None, ahead) for k in range(len(shifts))])
        np.testing.assert_allclose(whole, each, rtol=0.0, atol=1e-12)  # rounding
        assert whole[0].max() == 0.0  # nothing in common
        assert whole[3].min() > 0.9


def test_counted_and_searched_samples_are_the_same(good):
    """Even stamps are found by counting, others by searching: the same integral."""
    even, uneven = WindowMeans(good.imu), WindowMeans(good.imu)
    uneven.step = 0.0
    assert even.step > 0.0
    t = np.random.default_rng(1).uniform(-5.0, 200.0, 1000)
    for a, b in zip(even.at(t, 0.5), uneven.at(t, 0.5), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_roll_axis_of_the_gyro_is_seen_in_turns_on_a_slope():
    """The town has slopes of some per cent and its vehicle never leans."""
    town = corruption_drives.simulated()
    assert "roll axis" not in untold(diagnose(town))
    bad = suite.apply(town, (suite.BY_NAME["gyro's x reversed"],), None)
    assert diagnose(bad).codes() == ("gyro_axes",)


def test_on_a_flat_road_it_is_said_that_the_roll_axis_cannot_be_judged(flat):
    bad = suite.apply(flat, (suite.BY_NAME["gyro's x reversed"],), None)
    for recording in (flat, bad):
        diagnosis = diagnose(recording)
        assert diagnosis.codes() == ()
        assert "the gyro's roll axis (nothing rolled, nor turned on a slope)" in untold(diagnosis)


def test_a_smoothed_solution_shows_in_changes_of_speed_where_turns_are_slow(flat):
    rng = np.random.default_rng(1)
    smoothed = suite.apply(flat, (suite.BY_NAME["GNSS smoothed"],), rng)
    diagnosis = diagnose(smoothed)
    assert diagnosis.codes() == ("gnss_smoothed",)
    assert diagnosis.findings[0].evidence["gain"] < 0.2


def test_a_pause_of_the_log_is_no_smoothing(good):
    means = WindowMeans(suite.apply(good, (suite.BY_NAME["samples lost"],), np.random.default_rng(2)).imu)
    whole = means.without_pause(good.gnss.t[10:-10], 0.5)
    assert 0 < np.count_nonzero(~whole) < 0.2 * len(whole)


def test_a_stuck_axis_of_a_log_that_holds_its_samples(good):
    both = [suite.BY_NAME["gyro stuck for 4 s"], suite.BY_NAME["held"]]
    diagnosis = diagnose(suite.apply(good, both, np.random.default_rng(3)))
    assert set(diagnosis.codes()) == {"stuck", "repeated"}


def test_an_axis_rounded_to_one_step_is_not_called_dead():
    town = suite.apply(corruption_drives.simulated(), (suite.BY_NAME["rounded"],), None)
    assert np.ptp(town.imu.gyro[:, 0]) == 0.0
    assert diagnose(town).codes() == ("quantised",)
    gyro = town.imu.gyro.copy()
    gyro[:, 0] = 0.0123  # no step of it
    assert "dead_axis" in diagnose(drives.with_imu(town, gyro=gyro)).codes()


def test_a_knock_is_no_spike():
    """A single reading far off is one, if no other axis feels it; a knock is felt by all."""
    shaking = drives.drive(noise=(0.15, 0.002))
    f, w = shaking.imu.accel.copy(), shaking.imu.gyro.copy()
    f[9000, 0] += 12.0 * np.quantile(np.abs(np.diff(f[:, 0])), 0.99)
    assert diagnose(drives.with_imu(shaking, accel=f)).codes() == ("spikes",)
    w[9000:9003] += 5.0 * np.quantile(np.abs(np.diff(w, axis=0)), 0.99, axis=0) * [[1], [-1], [1]]
    assert diagnose(drives.with_imu(shaking, accel=f, gyro=w)).codes() == ()


def test_a_temperature_no_sensor_follows_gives_the_stamps_away(good):
    n = len(good.imu)
    imu = replace(good.imu, temperature=np.linspace(-20.0, 70.0, n))
    assert check_temperature(imu) == []  # half a kelvin a second
    (diagnosis,) = check_temperature(replace(imu, t=imu.t / 10.0))
    assert (diagnosis.code, diagnosis.severity) == ("time_unit", "warning")
    assert check_temperature(replace(imu, t=imu.t / 10.0, temperature=np.full(n, 30.0))) == []


def _turned(angles, rate=50.0):
    """Half turns about x by hand, seen by a gyro that shows 70 % of them."""
    f, w = [], []
    attitude = 0.0
    for angle in angles:
        for step, n in ((0.0, 400), (angle / 50, 50)):
            for _ in range(n):
                attitude += step
                f.append((0.0, -9.81 * np.sin(attitude), -9.81 * np.cos(attitude)))
                w.append((0.7 * step * rate, 0.0, 0.0))
    f += [f[-1]] * 400
    w += [(0.0, 0.0, 0.0)] * 400
    rng = np.random.default_rng(1)
    f, w = np.array(f) + rng.normal(0, 0.01, (len(f), 3)), np.array(w) + rng.normal(0, 0.001, (len(w), 3))
    return ImuSeries(np.arange(len(f)) / rate, w, f)


def test_one_or_two_turns_are_not_explained_by_chance():
    """A factor of 50 turns many times and ends anywhere; axes need three turns."""
    imu = _turned([np.pi, np.pi])
    turns = turns_between(imu, unscaled_rests(imu))
    assert len(turns) == 2
    factor, P, _ = by_turns(turns, imu.interval, ("rad/s", 1.0))
    assert factor == pytest.approx(1.0 / 0.7, rel=0.1)
    np.testing.assert_array_equal(P, np.eye(3))
    assert diagnose(Recording(imu=imu, metadata=Metadata("turns"))).ok


@pytest.mark.parametrize("factor", [1.0, 1.0 / DEG])
def test_a_large_zero_rate_output_is_no_turning(factor):
    """Put down by hand in twelve poses: 20 deg/s, which data sheets of cheap gyroscopes allow, in every one of them."""
    imu = hand_log(ImuErrors(), np.random.default_rng(5), poses=12, initial_rest_s=5.0).rates()
    rng = np.random.default_rng(6)
    gyro = imu.gyro + rng.normal(0.0, 1e-3, imu.gyro.shape) + 20.0 * DEG * np.array([1.0, -1.0, 1.0])
    imu = replace(imu, gyro=factor * gyro, accel=imu.accel + rng.normal(0.0, 0.02, imu.accel.shape))
    assert len(unscaled_rests(imu)) == 12
    diagnosis = diagnose(Recording(imu=imu, metadata=Metadata("biased")))
    assert "unit of angular rate (turns of gravity)" in diagnosis.checked
    assert diagnosis.codes() == (() if factor == 1.0 else ("gyro_unit",))


def test_a_turntable_is_no_rest():
    """Specific force is constant about the vertical, too; gravity along one axis alone leaves a bias unproven."""
    rng = np.random.default_rng(7)
    n = 6000
    turning = np.repeat([[0.0, 0.0, 20.0 * DEG], [0.0, 0.0, 60.0 * DEG]], n // 2, axis=0)
    f = np.array([0.0, 0.0, -G0]) + rng.normal(0.0, 0.02, (n, 3))
    imu = ImuSeries(np.arange(n) / 100.0, turning + rng.normal(0.0, 1e-3, (n, 3)), f)
    shaken = replace(imu, gyro=imu.gyro + rng.normal(0.0, 0.02, (n, 3)) * (np.arange(n) >= n // 2)[:, None])
    assert len(unscaled_rests(shaken)) == 0


@pytest.mark.campaign
def test_one_line_of_python(good):
    assert schuler.check(good).require().ok
    bad = drives.with_imu(good, accel=good.imu.accel / G0, gyro=good.imu.gyro / DEG)
    with pytest.raises(InputError, match=r"accel_unit: .*-> units='g.*gyro_unit: .*See schuler check") as error:
        schuler.check(bad).require()
    assert "--unchecked" not in str(error.value)
    assert "\n" not in str(error.value)
    # nothing is as sure as that
    assert not schuler.check(bad).require(1.1).ok
    assert schuler.check(bad, quick=True).codes() == ("accel_unit", "gyro_unit")


def test_one_line_for_a_file(tmp_path):
    path = tmp_path / "none.csv"
    with pytest.raises(InputError, match="no such file"):
        schuler.check(path)
    path.write_text("Nothing but words in here.\nAnd these are some more of them.\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"unreadable: .*no log but text"):
        schuler.check(path).require()


@pytest.mark.parametrize(("kind", "most"), [("rate", 9.5), ("increment", 10.5)])
def test_means_of_a_long_log_take_memory_of_few_of_its_columns(rng, kind, most):
    """A day at 200 Hz: 140 MB a column. The integral is six, rates of one triad of increments three more."""
    t = 0.005 * np.arange(100_000)
    imu = ImuSeries(t, rng.normal(size=(len(t), 3)), rng.normal(size=(len(t), 3)), kind)
    tracemalloc.start()
    WindowMeans(imu)
    peak = tracemalloc.get_traced_memory()[1] / (8 * len(t))
    tracemalloc.stop()
    assert peak < most


@pytest.mark.parametrize(("kind", "step", "most"), [("rate", 1.0, 7.0), ("increment", 0.005, 10.0)])
def test_checking_a_long_log_takes_memory_of_few_of_its_columns(rng, kind, step, most):
    """Besides the log's own seven. All channels in one table, their changes and copies of these to sort took 19."""
    t, noise = 0.005 * np.arange(100_000), rng.normal(size=(2, 100_000, 3))
    imu = ImuSeries(t, step * noise[0], step * (noise[1] + [0.0, 0.0, -9.8]), kind)
    recording = Recording(imu=imu, metadata=Metadata("long"))
    schuler.check(recording)
    tracemalloc.start()
    schuler.check(recording)
    peak = tracemalloc.get_traced_memory()[1] / (8 * len(t))
    tracemalloc.stop()
    assert peak < most


def test_a_lone_spike_is_found_at_the_edge_of_a_block(rng, monkeypatch):
    x = rng.normal(size=1000)
    x[[1, 63, 64, 65, 130, 500, 998]] += 1000.0
    lone = list(sampling._lone(x, 100.0))
    assert [j for j, _ in lone] == [0, 129, 499, 997]
    monkeypatch.setattr(sampling, "_BLOCK", 64)
    assert list(sampling._lone(x, 100.0)) == lone


def test_readings_that_are_no_counts_by_their_size_are_not_copied(rng):
    gyro = rng.normal(size=(100_000, 3))
    tracemalloc.start()
    assert not are_counts(gyro)
    peak = tracemalloc.get_traced_memory()[1] / (8 * len(gyro))
    tracemalloc.stop()
    assert peak < 1.0
    assert are_counts(np.round(1000.0 * gyro))
    assert not are_counts(np.round(1e5 * gyro))
    assert not are_counts(1000.0 * gyro)
