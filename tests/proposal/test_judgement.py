"""What withheld fixes decide, and the error budget an IMU is given."""

import numpy as np
import pytest
from diagnosis_drives import drive

from schuler import units
from schuler.diagnosis.result import Diagnosis
from schuler.exceptions import InputError
from schuler.proposal.imu_model import imu_entries
from schuler.proposal.judgement import Judgement
from schuler.proposal.setup import has, nested, trials
from schuler.recording.series import ImuSeries
from schuler.standstill.unscaled import unscaled_rests


def ends(values):
    return Judgement(np.asarray(values, dtype=float), 10.0)


def test_smaller_errors_in_every_stretch_are_better():
    other = ends([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    assert ends(other.ends * [0.5, 0.6, 0.5, 0.4, 0.5, 0.6, 0.5, 0.5]).better_than(other, 2.0)


@pytest.mark.parametrize("least", [1.0, 2.0])
def test_what_changes_nothing_or_only_one_stretch_is_not_better(least):
    other = ends([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    assert not other.better_than(other, least)
    assert not ends([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.1]).better_than(other, 2.0)


def test_what_the_motion_shows_is_turned_down_only_where_it_is_worse():
    other = ends([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    mixed = other.ends * [1.2, 0.8, 1.1, 0.9, 1.2, 0.85, 1.0, 1.02]
    assert ends(mixed).better_than(other, -1.0)
    assert not ends(1.5 * mixed).better_than(other, -1.0)


def test_few_stretches_decide_nothing():
    assert not ends([0.1, 0.1]).better_than(ends([1.0, 1.0]), 2.0)


def at_rest(noise, bias):
    """Half a minute of rest; noise of the gyroscope as a root density, bias on each axis."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 30.0, 0.01)
    gyro = rng.normal(0.0, noise / np.sqrt(0.01), (len(t), 3)) + bias
    accel = rng.normal(0.0, 0.01, (len(t), 3)) + np.array([0.0, 0.0, -9.81])
    return ImuSeries(t, gyro, accel)


@pytest.mark.parametrize(
    ("noise_deg_rthr", "bias_deg_hr", "grade"),
    [(0.1, 3.0, "tactical"), (0.1, 500.0, "consumer"), (3.0, 3.0, "consumer")],
)
def test_the_grade_is_the_worse_of_noise_and_bias_at_rest(noise_deg_rthr, bias_deg_hr, grade):
    imu = at_rest(noise_deg_rthr * units.DEG_PER_RTHR, bias_deg_hr * units.DEG_PER_HR)
    assert imu_entries(None, imu, unscaled_rests(imu), [])[0] == {"catalogue": grade}


def test_the_imu_is_the_one_named_first_by_the_user_then_by_the_header():
    imu = drive(duration=20.0).imu
    assert imu_entries("mpu6000", imu, None, ["MTi-G-710"])[0] == {"catalogue": "MPU-6000"}
    assert imu_entries(None, imu, None, ["board with MPU-9150, firmware 2"])[0] == {"catalogue": "MPU-9150"}
    with pytest.raises(InputError, match="did you mean"):
        imu_entries("MPU-600", imu, None, [])


def test_a_grade_stays_one_and_a_set_of_a_thesis_is_taken_by_its_own_name():
    """A grade says that the part is not known, so that biases typical of it are taken; a simulation has none."""
    imu = drive(duration=20.0).imu
    assert imu_entries("Consumer", imu, None, [])[0] == {"catalogue": "consumer"}
    assert imu_entries("Flenniken_consumer", imu, None, [])[0] == {"catalogue": "flenniken-consumer"}


@pytest.mark.parametrize(("mount", "least"), [(None, 2.0), ([0.0, 0.0, 0.5], -1.0)])
def test_wheels_need_fixes_that_bear_them_out_unless_the_motion_shows_which_axis_points_forward(mount, least):
    estimates = {"explained_by_imu": [0.99, 0.2, 0.9]}
    if mount is not None:
        estimates |= {"mount_deg": mount, "mount_sigma_deg": [1.0, 1.0, 1.0]}
    [wheels] = trials(drive(duration=20.0), Diagnosis("drive", estimates=estimates))
    assert wheels[0] == {"aiding.non_holonomic": {}}
    assert wheels[2] == least


def test_names_with_dots_are_nested_entries():
    data = nested({"imu.clock_shift_s": 0.1, "aiding.zero_rate": {}})
    assert data == {"imu": {"clock_shift_s": 0.1}, "aiding": {"zero_rate": {}}}
    assert has(data, "aiding.zero_rate")
    assert not has(data, "aiding.zero_velocity")
