"""Solutions as files: what goes in comes out, with where it came from."""

from __future__ import annotations

import numpy as np
import pytest

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.navigation.run import navigate
from schuler.navigation.solution_tables import SOLUTION_FORMAT, read_solution
from schuler.recording.formats.parquet import read_table, write_table
from schuler.simulation.scenario import simulate


@pytest.fixture(scope="module")
def result():
    imu = {
        "gyro": {"arw_deg_rthr": 0.2, "bias_deg_hr": 50.0},
        "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 2.0},
    }
    recording = simulate(
        {
            "name": "short drive",
            "motion": {
                "type": "manoeuvres",
                "lat_deg": 47.0,
                "lon_deg": 8.0,
                "manoeuvres": [{"duration_s": 15.0}, {"duration_s": 10.0, "speed_m_s": 9.0}, {"duration_s": 15.0}],
            },
            "imu": {"rate_hz": 50.0, **imu},
            "gnss": {"rate_hz": 1.0, "lever_arm_m": [0.5, 0.0, -1.0]},
        }
    )
    outages = {"windows_s": [(30.0, 34.0)]}
    return navigate(
        recording,
        {"imu": imu, "gnss": {"lever_arm_m": [0.5, 0.0, -1.0]}, "outages": outages, "filter": {"smooth": True}},
    )


def test_a_long_solution_is_written_in_parts_and_is_the_same_table(result, tmp_path, monkeypatch):
    import pyarrow.parquet as pq

    whole = pq.read_table(result.to_parquet(tmp_path / "whole.parquet"))
    monkeypatch.setattr("schuler.recording.trajectory._BLOCK", 300)
    parts = result.to_parquet(tmp_path / "parts.parquet")
    assert pq.ParquetFile(parts).num_row_groups == -(-len(result.trajectory) // 300)
    assert pq.read_table(parts).equals(whole, check_metadata=True)


def test_a_long_trajectory_keeps_no_conversions_and_converts_the_same(result, monkeypatch):
    """Kept, they would double the memory of a day at 200 Hz."""
    T = result.trajectory.samples(slice(None))
    names = ("llh", "v_eb_n", "q_nb", "rpy_nb")
    kept = [getattr(T, name) for name in names] + [T.moved_by((1.0, 2.0, 3.0)).r_eb_e]
    monkeypatch.setattr("schuler.recording.trajectory.KEPT", 1000)
    monkeypatch.setattr("schuler.recording.trajectory._BLOCK", 300)
    again = result.trajectory.samples(slice(None))
    anew = [getattr(again, name) for name in names] + [again.moved_by((1.0, 2.0, 3.0)).r_eb_e]
    for one, other in zip(kept, anew, strict=True):
        np.testing.assert_array_equal(other, one)
    assert set(T._cache) == set(names)
    assert not again._cache


def test_smoothing_may_forget_what_only_it_needs(result):
    from dataclasses import replace

    assert result.can_smooth
    once = replace(result)
    smoothed = once.smooth(keep=False)
    assert not once.can_smooth
    assert result.can_smooth
    np.testing.assert_array_equal(smoothed.trajectory.r_eb_e, result.smooth().trajectory.r_eb_e)


def test_a_solution_survives_the_file(result, tmp_path):
    path = result.to_parquet(tmp_path / "solution.parquet")
    T, meta = read_solution(path)
    np.testing.assert_array_equal(T.t, result.trajectory.t)
    np.testing.assert_array_equal(T.r_eb_e, result.trajectory.r_eb_e)
    np.testing.assert_array_equal(T.q_eb, result.trajectory.q_eb)
    np.testing.assert_allclose(T.v_eb_e, result.trajectory.v_eb_e, atol=1e-12)  # rounding: stored north, east, down
    assert meta["format"] == SOLUTION_FORMAT
    assert meta["states"] == result.layout.to_dict()
    assert meta["outages"] == [[30.0, 34.0]]
    assert meta["lever_arm_b_m"] == [0.5, 0.0, -1.0]
    assert meta["provenance"]["recording"] == "short drive"
    assert meta["provenance"]["schuler"]
    assert meta["notes"] == list(result.notes)
    assert not meta["smoothed"]
    assert [p.name for p in tmp_path.iterdir()] == ["solution.parquet"]  # no temporary file is left


def test_columns_have_units_in_their_names_and_sigmas(result, tmp_path):
    columns, _ = read_table(result.to_parquet(tmp_path / "solution.parquet"))
    np.testing.assert_allclose(columns["lat_deg"] * units.DEG, result.trajectory.llh[:, 0], rtol=1e-15)
    k = np.searchsorted(columns["t_s"], result.t)
    for name, block, i, scale in (
        ("sigma_position_east_m", "dr", 1, 1.0),
        ("sigma_velocity_down_m_s", "dv", 2, 1.0),
        ("sigma_attitude_down_deg", "dpsi", 2, 1.0 / units.DEG),
        ("sigma_b_g_2", "b_g", 2, 1.0),
    ):
        np.testing.assert_allclose(columns[name][k], result.sigma(block)[:, i] * scale, rtol=1e-6)
    np.testing.assert_allclose(columns["b_a_1"][k], result.parameter("b_a")[:, 1])
    assert len({len(column) for column in columns.values()}) == 1


def test_smoothed_solutions_are_marked(result, tmp_path):
    _, meta = read_solution(result.smooth().to_parquet(tmp_path / "smoothed.parquet"))
    assert meta["smoothed"]


def test_other_tables_are_refused(tmp_path):
    path = write_table(tmp_path / "other.parquet", {"t_s": np.arange(3.0)}, {"format": "schuler/recording/1"})
    with pytest.raises(FileFormatError, match="expected a solution of format 'schuler/solution/1', got"):
        read_solution(path)
