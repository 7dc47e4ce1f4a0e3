"""Axes that are likely, but not sure: withheld fixes judge, and what is alike either way is no question."""

import numpy as np
import pytest
from places import EXAMPLES

import schuler
from schuler.diagnosis.result import Diagnosis, Finding
from schuler.proposal.configuration import _likely_axes_by_trial, _question
from schuler.proposal.files import files_of
from schuler.units import DEG

MIRRORED = Finding("handedness", "error", "the axes are left-handed", 0.6, "scale='ax=-1,gx=-1'")
TURNED = Finding("axes", "warning", "the axes point L, B, U", 0.6, "axes='LBU'")


@pytest.fixture(scope="module")
def town():
    return schuler.simulate(EXAMPLES / "town.toml")


@pytest.fixture
def folder(town, tmp_path):
    """Write the town's IMU, and fixes of places alone, as tables; the IMU's x mirrored if asked."""

    def written(mirror=False):
        imu, gnss = town.need_imu().rates(), town.need_gnss()
        sign = np.array([-1.0 if mirror else 1.0, 1.0, 1.0])
        rows = np.column_stack((imu.t, imu.accel * sign, imu.gyro * sign))[::2]
        head = "time [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
        np.savetxt(tmp_path / "imu.csv", rows, "%.7f", ",", header=head, comments="")
        sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
        rows = np.column_stack((gnss.t, gnss.llh[:, :2] / DEG, gnss.llh[:, 2], sigma))
        head = "time [s],lat [deg],lon [deg],height [m],sn,se,sd"
        np.savetxt(tmp_path / "gps.csv", rows, "%.9f", ",", header=head, comments="")
        return files_of([tmp_path], {})

    return written


def diagnosis(*findings):
    return Diagnosis("town", findings)


def test_a_mirrored_log_is_mended_where_fixes_bear_it_out(folder):
    files = folder(mirror=True)
    assert _likely_axes_by_trial(files, diagnosis(MIRRORED), {})
    decision = files.decisions[-1]
    assert decision.value is not None
    assert "ax=-1" in decision.value
    assert not _likely_axes_by_trial(files, diagnosis(MIRRORED), {})  # once


@pytest.mark.parametrize("finding", [MIRRORED, TURNED], ids=["mirrored", "turned"])
def test_a_good_log_stays_and_nothing_is_asked(folder, finding):
    """A turn of all axes together does little to positions; a mirrored log goes astray."""
    files = folder()
    assert isinstance(_question(files, diagnosis(finding)), schuler.exceptions.InputError)
    assert not _likely_axes_by_trial(files, diagnosis(finding), {})
    assert files.decisions[-1].value is None
    assert "60 % likely" in files.decisions[-1].evidence
    assert _question(files, diagnosis(finding)) is None


def test_what_the_user_states_is_not_tried(folder):
    files = folder()
    given = {"imu": {"axes": "FRD"}}
    assert not _likely_axes_by_trial(files, diagnosis(TURNED), given)
    assert all(d.entry != "recording.imu.axes" for d in files.decisions)
