"""A solution whose lever arm nobody knows is the antenna's, says so, and claims no other point."""

from __future__ import annotations

import numpy as np
import pytest
from places import module

from schuler.filtering.measurements import POSITION, gnss_measurements
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.runs import compare_runs, read_run
from schuler.navigation.inputs.antenna import ANTENNA_POINT, antenna_note, is_of_antenna
from schuler.navigation.run import navigate
from schuler.navigation.solution_tables import write_solution

tn = module("navigation/test_navigate.py")

ARM = [0.8, 0.4, -1.2]


@pytest.fixture(scope="module")
def recording():
    points = [
        {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 20.0, "stop_s": 10.0},
        {"north_m": 500.0, "east_m": 100.0, "speed_m_s": 25.0},
        {"north_m": 900.0, "east_m": 400.0, "speed_m_s": 20.0},
    ]
    return tn.drive(points=points, lever_arm_m=ARM, sigma_position_m=[0.02, 0.02, 0.03], rate_hz=5.0)


def config(**gnss):
    return {"imu": dict(tn.IMU), "gnss": gnss, "filter": {"smooth": False, "tune": False}}


def test_where_no_arm_is_stated_the_antenna_is_claimed_and_met(recording, tmp_path):
    """The same drive with its arm stated is the IMU's: either claim holds at its point, and not at the other."""
    truth = recording.reference
    points = {"imu": truth, "antenna": truth.moved_by(np.array(ARM))}
    for gnss, point in (({}, "antenna"), ({"lever_arm_m": ARM}, "imu")):
        result = navigate(recording, config(**gnss))
        notes = [note for note in result.notes if note.startswith(ANTENNA_POINT)]
        assert result.point == point
        assert len(notes) == sum(r.startswith(ANTENNA_POINT) for r in result.verdict.remarks) == int(point == "antenna")
        for name, path in points.items():
            errors = result.errors(path).between(30.0, 1e9)
            assert (errors.rms_horizontal < 0.1) == (name == point)
        run = read_run(write_solution(result, tmp_path / f"{point}.parquet"))
        assert run.point == point
    assert any(
        "the lever arm is in the differences" in note
        for note in compare_runs([tmp_path / "antenna.parquet"], tmp_path / "imu.parquet").notes
    )


def test_it_is_not_notes_beside_claims_that_hold_the_arm():
    assert not antenna_note(np.full((10, 2), 0.8))
    assert "claimed to 0.57 m" in antenna_note(np.full((10, 2), 0.4))[0]
    assert not antenna_note(np.zeros((0, 2)))


def test_an_arm_that_is_estimated_or_asked_for_is_of_the_imu():
    fixes = gnss_measurements(tn.drive().gnss, np.zeros(3))
    plain, estimated = StateLayout({}), StateLayout({"lever": StateModel(0.5)})
    parsed = NavigationConfig.parse(config())
    assert is_of_antenna(parsed, fixes.kind, plain)
    assert not is_of_antenna(parsed, fixes.kind, estimated)
    assert not is_of_antenna(NavigationConfig.parse(config(lever_arm_m=[0.0, 0.0, 0.0])), fixes.kind, plain)
    assert not is_of_antenna(parsed, fixes.kind[fixes.kind != POSITION], plain)
