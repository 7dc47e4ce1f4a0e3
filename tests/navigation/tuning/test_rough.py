"""White noise of the IMU by one factor, where fixes are too few to tune it term by term; notes are on the run taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.filtering.measurements import VELOCITY
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.imu_noise import NO_NOISE
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.tuning import automatic, rough
from schuler.navigation.tuning.automatic import Supported
from schuler.navigation.tuning.delay import Offset, offset_left
from schuler.navigation.tuning.lever import LEVER_ESTIMATED
from schuler.navigation.tuning.noise import WHITE, with_factors
from schuler.navigation.tuning.rough import Rough, rough_factor, rough_note, with_rough_noise
from schuler.navigation.tuning.tuning import Tuning
from schuler.simulation.scenario import prepare_mission, simulate_mission

CORNERS = [(0, 0, 6), (40, -10, 7), (60, 30, 5), (20, 60, 8)]
POINTS = [{"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} for n, e, v in CORNERS]
BY_NAME = {"imu": {"catalogue": "MPU-6000"}, "filter": {"smooth": False}}


def drive(worse):
    """Under 20 s of a car under way, an MPU-6000 whose white noise is so many times as large, fixes of 5 cm."""
    mission = prepare_mission(
        {
            "seed": 4,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {
                "rate_hz": 50.0, "kind": "increment",
                "gyro": {"arw_deg_rthr": 0.3 * worse, "bias_deg_s": 0.5},
                "accel": {"vrw_m_s_rthr": 0.24 * worse, "bias_mg": 10.0},
            },
            "gnss": {"rate_hz": 1.0, "lever_arm_m": [0.0, 0.0, 0.0], "sigma_position_m": [0.05, 0.05, 0.08]},
        }
    )  # fmt: skip
    recording = simulate_mission(mission).recording.between(0.0, 18.5)
    return replace(recording, gnss=replace(recording.need_gnss(), v_n=None, cov_v_n=None))


@pytest.fixture(scope="module")
def noisy():
    return drive(15.0)


@pytest.fixture(scope="module")
def run(noisy):
    return prepared_run(noisy, NavigationConfig.checked(BY_NAME))


def louder(run):
    return lambda factor: with_factors(run, dict.fromkeys(WHITE, factor))


def test_noise_that_few_fixes_contradict_is_found(run, monkeypatch):
    chosen = rough_factor(run, louder(run))
    assert chosen.factor == 16.0  # simulated 15 times as large
    assert chosen.gain > 8.0
    assert chosen.fits
    monkeypatch.setattr(rough, "LEAST_GAIN", -1e9)
    assert rough_factor(louder(run)(15.0), louder(run)) is None  # fits as it is: nothing is asked


def test_a_start_that_other_noise_does_not_have_is_left_out(run):
    def refused(factor):
        if factor < 10.0:
            raise InputError("no start")
        return louder(run)(factor)

    assert rough_factor(run, refused) == rough_factor(run, louder(run))


def test_many_fixes_and_ranges_are_for_others(run, monkeypatch):
    assert rough_factor(replace(run, ranges=object()), louder(run)) is None
    monkeypatch.setattr(rough, "_MOST", 5)
    assert rough_factor(run, louder(run)) is None


def test_a_run_of_few_fixes_takes_it_unless_noise_is_not_to_be_tuned(noisy):
    result = navigate(noisy, BY_NAME)
    assert sum(note.startswith("fixes are too few to tune noise") for note in result.notes) == 1
    noise = result.provenance["config"]["filter"]["noise"]
    assert noise["gyro"] == 16.0
    left = navigate(noisy, {**BY_NAME, "filter": {"smooth": False, "tune": False}})
    assert not any(note.startswith("fixes are too few") for note in left.notes)
    assert result.innovations.mean_nis() < 1.5 < left.innovations.mean_nis()


def test_an_imu_as_stated_keeps_its_noise():
    assert not any(note.startswith("fixes are too few") for note in navigate(drive(1.0), BY_NAME).notes)


def test_every_axis_is_louder_by_the_same():
    config = NavigationConfig.checked({**BY_NAME, "filter": {"noise": {"gyro": 2.0, "accel": [1.0, 1.5, 3.0]}}})
    noise = with_rough_noise(config, 4.0).filter.noise
    assert noise.gyro == 8.0
    assert tuple(noise.accel_axes) == (4.0, 6.0, 12.0)
    assert "4 times as large (log likelihood +12, of the factors 1, 4 and 16)" in rough_note(Rough(4.0, 12.4, True))


WILD = Tuning(
    {"gyro": 900.0}, {"gyro": (500.0, 1500.0)}, False, 100.0, 10.0, {"position": 9.0}, {"position": 1.0}, 30,
    no_noise=True,
)  # fmt: skip


@pytest.fixture(scope="module")
def plain():
    config = NavigationConfig.checked(BY_NAME)
    return Supported(config, prepared_run(drive(1.0), config), ["of the start"])


def test_noise_without_a_lever_arm_is_not_said_where_one_is_estimated(plain, monkeypatch):
    """A model car, antenna 0.35 m off: its accelerometers would have to be 84 times as noisy without a lever arm."""
    tunings = iter(
        (WILD, replace(WILD, factors={"gyro": 1.1}, intervals={"gyro": (1.0, 1.2)}, better=True, no_noise=False))
    )
    monkeypatch.setattr(automatic, "tune", lambda run, aligned: next(tunings))
    monkeypatch.setattr(automatic, "has_lever", lambda before, after: True)
    offset = Offset(0.02, 0.1)
    monkeypatch.setattr(automatic, "likeliest_offset", lambda prepare: offset)
    notes = automatic._tuned(plain, lambda config, later: plain.run, aligned=True).notes
    assert notes[:3] == ["of the start", LEVER_ESTIMATED, offset_left(offset)]
    assert [note.split(" from")[0] for note in notes[3:]] == ["noise tuned"]


def test_beside_a_lever_arm_an_offset_that_is_likely_is_estimated_too(plain, monkeypatch):
    """Positions alone: an antenna behind and stamps that are late look alike."""
    monkeypatch.setattr(automatic, "tune", lambda run, aligned: WILD)
    monkeypatch.setattr(automatic, "has_lever", lambda before, after: True)
    monkeypatch.setattr(automatic, "likeliest_offset", lambda prepare: Offset(-0.2, 0.03))
    monkeypatch.setattr(automatic, "offset_near", lambda later, prepare: Offset(-0.21, 0.02))

    def prepared_at(config, later):
        return replace(plain.run, fixes_later_s=later)

    tuned = automatic._tuned(plain, prepared_at, aligned=True)
    assert (tuned.run.fixes_later_s, tuned.config.gnss.delay_sigma_s) == (-0.21, 0.02)
    assert tuned.config.gnss.lever_sigma_m > 0.0
    schedule = plain.run.schedule
    kind = np.where(np.arange(len(schedule)) % 2 == 0, VELOCITY, schedule.kind)
    with_velocities = replace(plain.run, schedule=replace(schedule, kind=kind))
    with_speed = automatic._tuned(plain, lambda config, later: with_velocities, aligned=True)
    assert with_speed.config.gnss.delay_sigma_s == 0.0


@pytest.mark.parametrize("fits", [True, False])
def test_noise_of_the_start_before_is_said_unless_the_fixes_fit_the_new_one(plain, monkeypatch, fits):
    given = plain._replace(notes=[*plain.notes, *WILD.sentences()])
    monkeypatch.setattr(automatic, "rough_factor", lambda run, noisier: Rough(4.0, 500.0, fits))
    notes = automatic._with_rough_noise(plain, given, lambda config, later: plain.run, False).notes
    assert any(note.startswith(NO_NOISE) for note in notes) != fits
    assert notes[0] == "of the start"
    assert notes[-1].startswith("fixes are too few to tune noise")
