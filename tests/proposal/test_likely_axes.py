"""Axes that are not sure: withheld fixes judge, what is alike either way is no question, and up is told by gravity."""

from dataclasses import replace

import numpy as np
import pytest
from places import EXAMPLES

import schuler
from schuler.diagnosis.result import Diagnosis, Finding
from schuler.proposal.axes import borne_out, likely_axes_by_trial, upright_axes
from schuler.proposal.configuration import _question
from schuler.proposal.decision import Decision
from schuler.proposal.files import files_of
from schuler.proposal.judgement import Judgement, judged
from schuler.units import DEG

MIRRORED = Finding("handedness", "error", "the axes are left-handed", 0.6, "scale='ax=-1,gx=-1'")
TURNED = Finding("axes", "warning", "the axes point L, B, U", 0.6, "axes='LBU'")
DOWN = Finding("axes", "warning", "the axes point R, B, D", 0.6, "axes='RBD'")
MOVED = ("axes", "sign of gravity")  # what a diagnosis judges by the motion


@pytest.fixture(scope="module")
def town():
    return schuler.simulate(EXAMPLES / "town.toml")


@pytest.fixture
def folder(town, tmp_path):
    """Write the town's IMU, and fixes of places alone, as tables; the IMU's x mirrored if asked."""

    def written(mirror=False, on_its_back=False, gravity=False, rate_unit="[rad/s]"):
        imu, gnss = town.need_imu().rates(), town.need_gnss()
        sign = np.array([-1.0 if mirror else 1.0, *([-1.0, -1.0] if on_its_back else [1.0, 1.0])])
        accel = imu.accel * (-1.0 if gravity else 1.0)
        rows = np.column_stack((imu.t, accel * sign, imu.gyro * sign))[::2]
        head = "time [s],ax [m/s^2],ay [m/s^2],az [m/s^2]," + ",".join(f"g{x} {rate_unit}".strip() for x in "xyz")
        np.savetxt(tmp_path / "imu.csv", rows, "%.7f", ",", header=head, comments="")
        sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
        rows = np.column_stack((gnss.t, gnss.llh[:, :2] / DEG, gnss.llh[:, 2], sigma))
        head = "time [s],lat [deg],lon [deg],height [m],sn,se,sd"
        np.savetxt(tmp_path / "gps.csv", rows, "%.9f", ",", header=head, comments="")
        return files_of([tmp_path], {})

    return written


def diagnosis(*findings, checked=()):
    return Diagnosis("town", findings, checked=checked)


def test_a_mirrored_log_is_mended_where_fixes_bear_it_out(folder):
    files = folder(mirror=True)
    assert likely_axes_by_trial(files, diagnosis(MIRRORED), {})
    decision = files.decisions[-1]
    assert decision.value is not None
    assert "ax=-1" in decision.value
    assert not likely_axes_by_trial(files, diagnosis(MIRRORED), {})  # once


@pytest.mark.parametrize("finding", [MIRRORED, TURNED], ids=["mirrored", "turned"])
def test_a_good_log_stays_and_nothing_is_asked(folder, finding):
    """A turn of all axes together does little to positions; a mirrored log goes astray."""
    files = folder()
    assert isinstance(_question(files, diagnosis(finding)), schuler.exceptions.InputError)
    assert not likely_axes_by_trial(files, diagnosis(finding), {})
    assert files.decisions[-1].value is None
    assert "60 % likely" in files.decisions[-1].evidence
    assert _question(files, diagnosis(finding)) is None


@pytest.mark.parametrize(("worse", "expected"), [(2.0, "rad/s"), (1.05, None)])
def test_a_unit_that_fixes_bear_out_is_no_question(folder, monkeypatch, worse, expected):
    """What both answers predict about alike stays open."""
    ends = np.array([3.0, 1.0, 4.0, 1.5, 5.0, 9.0, 2.0])

    def judged_by_turns(recording, data):
        turns = np.abs(recording.need_imu().gyro).max() > 0.1  # the town's, in rad/s
        return Judgement(ends if turns else worse * ends * [1.3, 0.7, 1.2, 0.9, 1.1, 1.0, 0.8], 5.0)

    monkeypatch.setattr("schuler.proposal.axes.judged", judged_by_turns)
    answers = {unit: {"recording.imu.units": f"accel=m/s^2,gyro={unit}"} for unit in ("deg/s", "rad/s")}
    best = borne_out(folder(rate_unit=""), answers)
    assert (best and best[0]) == expected


def test_what_the_user_states_is_not_tried(folder):
    files = folder()
    given = {"imu": {"axes": "FRD"}}
    assert not likely_axes_by_trial(files, diagnosis(TURNED), given)
    assert all(d.entry != "recording.imu.axes" for d in files.decisions)


@pytest.mark.parametrize(("findings", "axes"), [((), "FLU"), ((DOWN,), "FLU"), ((DOWN, TURNED), "LBU")])
def test_what_lies_on_its_back_is_turned_over_once(folder, findings, axes):
    """Axes that are likely are taken if they point up; those of a trial that decided nothing give way."""
    files = folder(on_its_back=True)
    files.decisions.append(Decision("recording.imu.axes", None, "tried"))
    assert upright_axes(files, diagnosis(*findings, checked=MOVED), {})
    assert files.entry("imu")["axes"] == axes
    assert [d.value for d in files.decisions if d.entry == "recording.imu.axes"] == [axes]
    assert not upright_axes(files, diagnosis(*findings, checked=MOVED), {})


def test_only_what_lies_on_its_back_by_a_motion_and_is_not_stated_is_turned_over(folder):
    assert not upright_axes(folder(), diagnosis(checked=MOVED), {})
    files = folder(on_its_back=True)
    assert not upright_axes(files, diagnosis(checked=MOVED), {"imu": {"axes": "FRD"}})
    assert "axes" not in files.entry("imu")


def test_withheld_fixes_tell_what_lies_on_its_back_from_a_log_of_gravity(folder):
    """At rest the two look alike, and where no course is sure the diagnosis tells neither."""
    files = folder(gravity=True)
    assert not upright_axes(files, diagnosis(), {})
    assert "axes" not in files.entry("imu")
    files = folder(on_its_back=True)
    files.put("imu", {"scale": "accel=1.001"})  # stated: no other sign is tried
    assert not upright_axes(files, diagnosis(), {})
    files = folder(on_its_back=True)
    assert upright_axes(files, diagnosis(), {})
    assert files.entry("imu")["axes"] == "FLU"


@pytest.mark.realdata
@pytest.mark.campaign
def test_a_walk_with_the_imu_in_hand_is_ok(shared_data):
    """Nothing asked; before, the body was upside down and the run doubtful."""
    proposal = schuler.propose(shared_data / "rtkexp_walk")
    assert proposal.data["recording"]["imu"]["axes"].endswith("U")
    result = schuler.navigate(proposal.recording, proposal.config)
    assert result.verdict.status == "ok"
    assert abs(np.median(result.trajectory.rpy_nb[:, 0])) < 30.0 * DEG


def test_stretches_judge_where_there_are_fixes(town):
    """Fixes that end early: stretches of the length that the log has fixes for."""
    gnss = town.need_gnss()
    fewer = replace(town, gnss=gnss.where(gnss.t <= 80.0), reference=None)
    judgement = judged(fewer, {"imu": {"catalogue": "consumer"}})
    assert judgement is not None
    assert len(judgement.ends) >= 6
    assert judgement.length_s == pytest.approx(80.0 / 36.0, rel=0.15)
