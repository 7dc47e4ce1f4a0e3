"""A clock shift that is proposed is as uncertain as it is, and so is the lever arm that is estimated beside it."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_drives import drive, motion, with_gnss

import schuler
from schuler import rotation
from schuler.diagnosis.result import Finding
from schuler.earth import radii_of_curvature
from schuler.proposal import configuration
from schuler.proposal.clock import SIGMA, uncertainty_of_shift
from schuler.proposal.decision import UndecidedError
from schuler.proposal.files import files_of
from schuler.units import DEG

ARM = np.array([0.6, 0.3, -0.8])
SPEED = 9.0  # of the drive, some m/s
RIGHT, WRONG = 0.2, 0.13  # 0.07 s are 0.6 m of a lever arm [s]


def late(offset, arm=(0.0, 0.0, 0.0), duration=60.0):
    """A drive whose IMU has stamps so much too small, without velocities; the antenna elsewhere. [s], [m]"""
    recording = drive(duration=duration)
    gnss = recording.gnss
    _, heading, _, pitch, roll = motion(gnss.t)
    r = np.einsum("nij,j->ni", rotation.dcm_from_rpy(np.stack((roll, pitch, heading), axis=1)), np.array(arm))
    R_N, R_E = radii_of_curvature(gnss.llh[0, 0])
    llh = gnss.llh + r / [R_N, R_E * np.cos(gnss.llh[0, 0]), -1.0]
    recording = with_gnss(recording, llh=llh, v_n=None, cov_v_n=None)
    return replace(recording, imu=recording.imu.shifted(-offset))


def written(recording, folder):
    """The folder with its IMU and fixes as two tables."""
    imu, gnss = recording.imu, recording.gnss
    readings = "time [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
    for name, head, columns in (
        ("imu.csv", readings, (imu.t, imu.accel, imu.gyro)),
        ("gps.csv", "time [s],lat [deg],lon [deg],height [m]", (gnss.t, gnss.llh / [DEG, DEG, 1.0])),
    ):
        np.savetxt(folder / name, np.column_stack(columns), "%.9f", delimiter=",", header=head, comments="")
    return folder


@pytest.fixture(scope="module")
def diagnosed():
    recording = late(RIGHT)
    diagnosis = schuler.check(recording, quick=True)
    diagnosis.estimates["time_offset_sigma_s"] = 0.02
    return recording, diagnosis


def test_a_shift_is_as_uncertain_as_an_antenna_elsewhere_makes_it(diagnosed):
    decision = uncertainty_of_shift(*diagnosed, {})
    assert decision.entry == SIGMA
    assert 0.5 / (1.5 * SPEED) < decision.value < 0.5 / (0.5 * SPEED)
    assert "antenna" in decision.evidence


@pytest.mark.parametrize("gnss", [{"lever_arm_m": [0, 0, 0]}, {"delay_sigma_s": 0.1}, {"coupling": "tight"}])
def test_what_is_stated_needs_none(diagnosed, gnss):
    assert uncertainty_of_shift(*diagnosed, {"gnss": gnss}) is None


def test_a_shift_beyond_doubt_is_no_question_and_a_likely_one_is(diagnosed, tmp_path):
    recording, diagnosis = diagnosed
    files = files_of([written(recording, tmp_path)], {})
    findings = [Finding("time_offset", "error", "late", p, "offset=-0.8 for the IMU") for p in (0.99, 0.9)]
    assert configuration._question(files, replace(diagnosis, findings=(findings[0],))) is None
    assert isinstance(configuration._question(files, replace(diagnosis, findings=(findings[1],))), UndecidedError)


@pytest.mark.campaign
def test_a_shift_beyond_doubt_is_taken_unasked(tmp_path):
    proposal = schuler.propose(written(late(0.8, duration=150.0), tmp_path), imu="MPU-6000", trials=False)
    assert proposal.config.imu.clock_shift_s == pytest.approx(0.8, abs=0.05)
    assert proposal.config.imu.clock_shift_sigma_s > 0.02


@pytest.mark.campaign
def test_a_lever_arm_beside_an_uncertain_shift_is_claimed_for_what_it_is_and_the_solution_has_the_times_of_gnss():
    recording = late(RIGHT, ARM, duration=150.0)
    imu = {"catalogue": "MPU-6000", "clock_shift_s": WRONG}
    asked = {"filter": {"tune": "auto", "smooth": False}}
    fixed = schuler.navigate(recording, {"imu": imu, **asked})
    free = schuler.navigate(recording, {"imu": {**imu, "clock_shift_sigma_s": 0.06}, **asked})
    off = [np.abs(r.parameter("lever")[-1, :2] - ARM[:2]) / r.sigma("lever")[-1, :2] for r in (fixed, free)]
    assert off[0].max() > 6.0
    assert off[1].max() < 3.5  # statistical
    assert free.provenance["config"]["imu"]["clock_shift_s"] == pytest.approx(RIGHT, abs=0.02)
    assert abs(free.fixes_later_s) < 0.01
    assert any("clock_shift_sigma_s" in note for note in free.notes)
