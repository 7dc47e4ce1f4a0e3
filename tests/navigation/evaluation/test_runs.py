"""Runs against a reference: closed forms of the numbers, clocks, points, pauses, bounds."""

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import FileFormatError, InputError
from schuler.navigation.evaluation.runs import Run, compare_runs, in_gaps, read_run
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase
from schuler.units import DEG

ORIGIN = np.array([47.0 * DEG, 8.0 * DEG, 400.0])
T = np.arange(0.0, 101.0)


def straight(ahead=0.0, right=0.0, up=0.0, *, t=T, course=0.7, speed=10.0, velocity=True):
    """A straight way at a course, displaced ahead, to the right and up."""
    u, w = np.array([np.cos(course), np.sin(course), 0.0]), np.array([-np.sin(course), np.cos(course), 0.0])
    n = np.outer(speed * t + ahead, u) + np.outer(np.broadcast_to(right, t.shape), w) - [0.0, 0.0, up]
    C = frames.C_en(ORIGIN)
    r = frames.ecef_from_llh(ORIGIN) + n @ C.T
    return Trajectory(t, r, np.tile(C @ (speed * u), (len(t), 1)) if velocity else None)


def run(trajectory, name="run", **more):
    return Run(name, trajectory, more.pop("time", TimeBase()), **more)


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("course", [-2.0, 0.3, 1.9])
def test_along_is_ahead_and_across_is_to_the_right(course, velocity):
    truth = run(straight(course=course, velocity=velocity), "truth")
    (n,) = compare_runs([run(straight(3.0, -4.0, 1.5, course=course))], truth).numbers
    # a kilometre of Earth's curvature is 8 cm of height, and nothing to the side
    assert n["mean_along_m"] == pytest.approx(3.0, abs=1e-3)
    assert n["mean_across_m"] == pytest.approx(-4.0, abs=1e-3)
    assert n["rms_horizontal_m"] == pytest.approx(5.0, abs=1e-3)
    assert n["drms2_m"] == pytest.approx(10.0, abs=2e-3)
    assert n["cep50_m"] == pytest.approx(5.0, abs=1e-3)
    assert n["rms_vertical_m"] == pytest.approx(1.5, abs=1e-3)
    assert n["relative_per_100m_m"] == pytest.approx(0.0, abs=1e-3)


def test_relative_error_is_what_is_gained_on_100_m():
    """An error that grows to the right by 0.2 m each second at 10 m/s gains 2 m on 100 m."""
    (n,) = compare_runs([run(straight(right=0.2 * T))], run(straight(), "truth")).numbers
    assert n["relative_per_100m_m"] == pytest.approx(2.0, rel=1e-3)


def test_a_reference_at_rest_has_no_track():
    (n,) = compare_runs([run(straight(1.0, speed=0.0))], run(straight(speed=0.0), "truth")).numbers
    assert n["rms_horizontal_m"] == pytest.approx(1.0, abs=1e-6)
    assert [n[k] for k in ("rms_along_m", "mean_across_m", "relative_per_100m_m", "rms_heading_deg")] == [None] * 4


def test_a_table_of_fixes_without_accuracies_is_a_run(tmp_path):
    """A phone's log has none, and a comparison weighs nothing by them; what is no table is refused as before."""
    llh = frames.llh_from_ecef(straight().r_eb_e)
    rows = (f"{t},{lat / DEG:.9f},{lon / DEG:.9f},{h:.4f}" for t, (lat, lon, h) in zip(T, llh, strict=True))
    path = tmp_path / "phone.csv"
    path.write_text("time,latitude (deg),longitude (deg),altitude (m)\n" + "\n".join(rows) + "\n")
    (n,) = compare_runs([run(straight())], read_run(path)).numbers
    assert n["rms_horizontal_m"] == pytest.approx(0.0, abs=1e-3)  # printed digits
    path.write_text("no table\n")
    with pytest.raises(FileFormatError, match="no row of numbers"):
        read_run(path)


def test_dated_clocks_are_brought_together():
    truth = run(straight(), "truth", time=TimeBase("gps", 1e9))
    early = straight()
    late = Trajectory(early.t - 50.0, early.r_eb_e, early.v_eb_e)
    comparison = compare_runs([run(late, time=TimeBase("gps", 1e9 + 50.0))], truth)
    assert comparison.numbers[0]["max_horizontal_m"] < 1e-6
    assert not comparison.notes
    assert "not dated" in compare_runs([run(early)], truth).notes[0]


def test_only_what_all_cover_is_compared_and_pauses_count_for_nobody():
    half = run(straight(t=T[T >= 50.0]), "half")
    holes = straight(1.0, t=T[(T < 60.0) | (T > 79.5)])
    comparison = compare_runs([half, run(holes, "holes")], run(straight(), "truth"))
    assert comparison.span == (50.0, 100.0)
    assert "50 % of the reference's epochs" in comparison.notes[0]
    assert [n["coverage_percent"] for n in comparison.numbers] == pytest.approx([100.0, 100.0 * 31.0 / 51.0])
    assert in_gaps(holes.t, np.array([59.0, 60.0, 79.0, 80.0])).tolist() == [False, True, True, False]
    with pytest.raises(InputError, match=r"times that overlap, got truth 0\.000\.\.100\.000 s, run 200\.000"):
        compare_runs([run(straight(t=T + 200.0))], run(straight(), "truth"))


def test_a_run_of_the_imu_is_moved_to_the_antenna():
    base = straight(course=0.0)
    q = np.tile(Trajectory.from_geodetic([0.0], ORIGIN[None], C_nb=np.eye(3)[None]).q_eb, (len(T), 1))
    imu = Trajectory(base.t, base.r_eb_e, base.v_eb_e, q)
    arm = np.array([0.5, 1.0, -1.5])
    truth = run(straight(0.5, 1.0, 1.5, course=0.0), "fixes", point="antenna")
    (n,) = compare_runs([run(imu, point="imu", lever_arm_b=arm)], truth).numbers
    assert n["max_horizontal_m"] < 1e-3
    assert n["max_vertical_m"] < 1e-3
    (note,) = compare_runs([run(straight(), point="antenna")], run(imu, "truth", point="imu")).notes
    assert "the lever arm is in the differences" in note


def test_bounds_in_either_order_of_words():
    runs = [run(straight(1.0), "a"), run(straight(3.0), "b")]
    comparison = compare_runs(runs, run(straight(), "truth"), bounds={"horizontal_rms_m": 2.0, "cep95_m": 9.0})
    assert comparison.broken == {"rms_horizontal_m": ("b",)}
    assert not comparison.passes
    assert compare_runs(runs, run(straight(), "truth"), bounds={"rms_horizontal_m": 3.1}).passes
    with pytest.raises(InputError, match=r"bounds: expected one of rms_horizontal_m, .* got 'rms'"):
        compare_runs(runs, bounds={"rms": 1.0})
    with pytest.raises(InputError, match="rms_heading_deg: expected runs and a reference that have it"):
        compare_runs(runs, bounds={"rms_heading_deg": 1.0})


def test_without_a_reference_the_first_run_is_it():
    comparison = compare_runs([run(straight(), "a"), run(straight(2.0), "b")])
    assert (comparison.reference, comparison.names, comparison.against_run) == ("a", ("b",), True)
    assert "smallest horizontal difference" in comparison.sentences()[0]
    with pytest.raises(InputError, match="two or more, or a reference, got 1"):
        compare_runs([run(straight())])


def test_command_compares_files_of_other_programs(tmp_path, capsys):
    import json

    from schuler.cli import main

    time = TimeBase("gps", 1.3e9)

    def written(name, trajectory):
        n = len(trajectory)
        series = GnssSeries(trajectory.t, trajectory.llh, np.tile(np.eye(3), (n, 1, 1)))
        recording = Recording(gnss=series, reference=trajectory, metadata=Metadata(name="x", time=time))
        io.write(recording, tmp_path / name)
        return str(tmp_path / name)

    truth = written("truth.csv", straight())
    pos, tum, parquet = (written(n, straight(a)) for n, a in (("a.pos", 1.0), ("b.tum", 2.0), ("c.parquet", 3.0)))
    assert read_run(pos).point == "antenna"
    arguments = ["compare", pos, tum, parquet, "--reference", truth, "--out", str(tmp_path / "out"), "--json"]
    assert main([*arguments, "--max", "horizontal_rms_m=2.5"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert [r["rms_along_m"] for r in data["runs"]] == pytest.approx([1.0, 2.0, 3.0], abs=0.01)
    assert (data["broken"], data["passes"]) == ({"rms_horizontal_m": ["c"]}, False)
    page = (tmp_path / "out" / "runs.html").read_text()
    assert page.index("Tracks") < page.index("Numbers")
    assert main([*arguments, "--max", "horizontal_rms_m=3.5", "--force"]) == 0
    capsys.readouterr()
    for wrong, message in (
        ([pos], "expected two runs or more"), ([pos, tum, "--max", "cep50_m"], "--max: expected NAME=VALUE"),
        ([pos, tum, "--max", "cep=1"], "--max: expected one of"), ([pos, "--modes", "ins"], "--config: expected"),
        ([pos, tum, "--config", "x.toml"], "--config: expected one log"),
    ):  # fmt: skip
        assert main(["compare", *wrong]) == 2
        assert message in capsys.readouterr().err
