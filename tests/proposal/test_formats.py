"""One simulated drive as folders of ten formats, each navigated without a configuration, as by one who knows."""

from dataclasses import replace

import numpy as np
import pytest
from messy_folders import FOLDERS, simulated

import schuler
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.recording.trajectory import Trajectory

IMU = "MPU-6000"
BOUND = 1.3  # the issue's


@pytest.fixture(scope="module")
def drive():
    """Truth, what the formats are written from, and the error of a configuration by hand."""
    truth, recording = simulated()
    config = {"imu": {"catalogue": IMU}, "aiding": {"non_holonomic": {}}, "filter": {"tune": False}}
    places = replace(recording, gnss=replace(recording.gnss, v_n=None, cov_v_n=None))
    return truth, recording, *(rms(truth, r, config) for r in (recording, places))


def rms(truth, recording, config):
    """Horizontal error beside the truth. [m]"""
    result = schuler.navigate(recording, config)
    later = recording.metadata.time.epoch_gps_s - truth.metadata.time.epoch_gps_s
    fixes = truth.gnss
    errors = trajectory_errors(result.trajectory, Trajectory.from_geodetic(fixes.t - later, fixes.llh, fixes.v_n))
    return float(np.sqrt(np.mean(errors.horizontal**2)))


@pytest.mark.campaign
@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_of_any_format_is_navigated_as_by_one_who_knows(name, drive, tmp_path):
    truth, recording, by_hand, without_velocities = drive
    if name == "two-sensors-gpx":  # a GPX has none
        by_hand = without_velocities
    FOLDERS[name](recording, tmp_path)
    proposal = schuler.propose(tmp_path, imu=IMU, given={"filter.tune": False})  # tuning is tested where it is made
    error = rms(truth, proposal.recording, proposal.config)
    print(f"{name}: {error:.3f} m, by hand {by_hand:.3f} m, {error / by_hand:.2f}")
    assert error < BOUND * by_hand
