"""``schuler calibrate field`` as scripts use it: keys of the JSON, files, options, exit codes, one-line errors."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command import answer, refusal, run
from places import ROOT

from schuler.calibration.result.parameters import vector
from schuler.calibration.result.result import CalibrationResult
from schuler.cli import main
from schuler.recording import io
from schuler.recording.formats.parquet import read_table
from schuler.recording.recording import Metadata, Recording
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission
from schuler.units import DEG

LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
ROUTINE = thesis_routine(dwell_s=5.0, repeats=1)  # 150 s
LONG = ROUTINE.rests[np.diff(ROUTINE.rests)[:, 0] > 2.0]  # two of 1.75 s are no rests by themselves
PLACE = ("--latitude", 39.92, "--height", 1000.0)
AUTOMOTIVE = ("--imu", "yaman-automotive", *PLACE, "--no-report", "--json")
NORTH = ("--heading", "0,1")


def simulated(name: str, seed: int, kind="rate"):
    """A log of the short routine at 50 Hz, and the errors in it."""
    rng = np.random.default_rng(seed)
    errors = ImuErrors.draw(catalogue.spec(name), rng, gauge="upper")
    return simulate_imu(ideal_imu(RoutineMotion(ROUTINE, LLH), 50.0, kind=kind), errors, rng).imu, errors


def write(imu, path):
    io.write(Recording(imu=imu, metadata=Metadata(name="turned")), path)
    return path


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """An automotive unit turned by hand, and its errors."""
    imu, errors = simulated("yaman-automotive", 3)
    return write(imu, tmp_path_factory.mktemp("field") / "turned.parquet"), errors


def printed_calibration(log, folder, *options):
    """What the command prints as JSON, its files in a folder."""
    arguments = ("calibrate", "field", log, "--imu", "yaman-automotive", *PLACE, "--heading", "0,1", *options)
    with pytest.MonkeyPatch.context() as patch:
        printed = []
        patch.setattr("schuler.cli.calibrate_output.print_json", printed.append)
        code = main([str(a) for a in (*arguments, "--out", folder, "--json")])
    assert code == 0
    return printed[0]


@pytest.fixture(scope="module")
def calibrated(turned, tmp_path_factory):
    """Its calibration with all files but the report and its figures, as JSON."""
    return printed_calibration(turned[0], tmp_path_factory.mktemp("calibrated"), "--no-report")


@pytest.mark.campaign
def test_json_and_files_are_those_of_every_method(turned, tmp_path):
    calibrated = printed_calibration(turned[0], tmp_path)
    assert calibrated.keys() >= {"status", "gauge", "parameters", "condition", "residual_rms", "verdicts", "next_pose"}
    assert (calibrated["command"], calibrated["method"]) == ("calibrate", "field")
    assert (calibrated["status"], calibrated["gauge"]) == ("ok", "upper")
    for path in calibrated["files"].values():
        assert path.stat().st_size > 0
    figures = {name for name in calibrated["files"] if name.startswith("figure_field")}
    assert figures >= {f"figure_field_{w}_png" for w in ("convergence", "estimates", "rests", "innovations")}
    assert {f"figure_output_{triad}_png" for triad in ("accel", "gyro")} <= set(calibrated["files"])
    assert 'id="history"' in calibrated["files"]["report"].read_text(encoding="utf-8")
    # statistical: 30 parameters, once, 4 sigma
    result = CalibrationResult.from_yaml(calibrated["files"]["calibration"])
    off = (result.values - vector(turned[1], result.names)) / result.sigma
    assert len(off) == 30
    assert np.abs(off).max() < 4.0
    assert result.provenance["sources"]


def test_json_says_how_it_came_about(calibrated):
    course = calibrated["field"]
    assert len(course["rests"]) == len(LONG) == 25
    assert course["passes"] >= 2
    assert course["heading_deg"] is None
    assert set(course["nis"]) == {"gravity_vector", "zero_rate"}
    for kind in course["nis"].values():  # statistical: hundreds of components, 5 standard errors
        assert abs(kind["mean"] - 1.0) < 5.0 * np.sqrt(2.0 / kind["components"])
    names = set(calibrated["parameters"]) - {"M_a_yx", "M_a_zx", "M_a_zy"}
    assert set(course["below_tenth_s"]) == names
    assert 0.0 < course["below_tenth_s"]["b_a_z"] < ROUTINE.duration


def test_the_history_ends_at_the_result(calibrated):
    path = calibrated["files"]["history"]
    assert path.name == "history.csv"
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    assert float(rows[-1]["t [s]"]) == pytest.approx(LONG[-1, 1], abs=1.0)
    for name, unit in (("b_a_x", "m/s^2"), ("M_g_yz", "-"), ("G_g_xx", "(rad/s)/(m/s^2)")):
        stated = calibrated["parameters"][name]
        assert float(rows[-1][f"{name} [{unit}]"]) == stated["value"]
        assert float(rows[-1][f"sigma_{name} [{unit}]"]) == pytest.approx(stated["sigma"], rel=1e-12)  # rounding
        assert float(rows[-1][f"left_{name} [-]"]) == pytest.approx(calibrated["observability"][name])


def test_another_gauge_an_earlier_calibration_and_a_parquet_history(calibrated, turned, tmp_path, capsys):
    data = answer(
        capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path, "--gauge", "lower",
        "--previous", calibrated["files"]["calibration"], "--history", "parquet",
    )  # fmt: skip
    assert data["gauge"] == "lower"
    assert data["changed"] == []
    same = CalibrationResult.from_yaml(calibrated["files"]["calibration"]).in_gauge("lower")
    assert data["parameters"]["M_g_xy"]["value"] == pytest.approx(same["M_g_xy"][0], abs=1e-12)  # rounding
    columns, meta = read_table(data["files"]["history"])
    assert meta["gauge"] == "upper"
    assert columns["b_a_x"][-1] == calibrated["parameters"]["b_a_x"]["value"]
    assert "report" not in data["files"]


def test_printed_for_people(turned, tmp_path, capsys):
    code, out, err = run(
        capsys, "calibrate", "field", turned[0], "--imu", "yaman-automotive", *PLACE, "--heading", "0,1", "--no-report",
        "--out", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert "field calibration: ok, can be used" in out
    assert "25 intervals at rest" in out
    assert "sigma" in out
    assert f"history: {tmp_path / 'history.csv'}" in out
    assert "turned:" in err


def test_heading_is_found_where_it_is_not_given(turned, tmp_path, capsys):
    """It is zero; 1-sigma of tens of degrees on so short a log, stated and kept within 3."""
    code, out, err = run(capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, "--out", tmp_path)
    assert code == 0, err
    angle, sigma = json.loads(out)["field"]["heading_deg"]
    assert abs(angle) < 3.0 * sigma < 180.0


def test_accelerometers_alone_by_the_size_of_gravity(turned, tmp_path, capsys):
    """Gyroscopes that are not estimated would be believed: 100 deg/h, in attitudes that bend the misalignments."""
    data = answer(capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, "--out", tmp_path, "--states", "M_a,b_a,S_a")
    assert set(data["field"]["nis"]) == {"gravity"}
    result = CalibrationResult.from_yaml(data["files"]["calibration"])
    assert result.names[:3] == ("b_a_x", "b_a_y", "b_a_z")
    assert len(result.names) == 9
    off = (result.values - vector(turned[1], result.names)) / result.sigma
    assert np.abs(off).max() < 4.0  # statistical, 9 parameters


def test_the_source_for_comparison(turned, tmp_path, capsys):
    data = answer(capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path, "--thesis")
    assert data["field"]["passes"] == 1
    assert "earth_rate_magnitude" in data["field"]["nis"]
    assert data["provenance"]["options"]["earth_rate"] == "magnitude"


def test_rests_of_a_file_are_used(turned, tmp_path, capsys):
    table = tmp_path / "rests.csv"
    spans = [(a + 0.5, b - 0.5) for a, b in ROUTINE.rests - io.read(turned[0]).need_imu().t[0]]
    table.write_text("start,stop\n" + "\n".join(f"{a:.3f},{b:.3f}" for a, b in spans), encoding="utf-8")
    code, out, err = run(
        capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path, "--intervals", table
    )
    assert code == 0, err
    result = np.array(json.loads(out)["field"]["rests"])
    np.testing.assert_allclose(result, spans, atol=0.021)  # a sample


def test_an_earlier_calibration_as_prior(calibrated, turned, tmp_path, capsys):
    """What it says counts: uncertainties shrink by the root of two where both know as much (rounding apart)."""
    code, out, err = run(
        capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path, "--prior",
        calibrated["files"]["calibration"],
    )  # fmt: skip
    assert code == 0, err
    again = json.loads(out)["parameters"]
    for name in ("b_a_x", "M_a_zz", "b_g_y"):
        assert again[name]["sigma"] < 0.85 * calibrated["parameters"][name]["sigma"]


def test_consumer_gyroscopes_off_by_tens_of_degrees_per_second(tmp_path, capsys):
    """MPU-6000: 20 deg/s, 80 mg, 3 %. The first attitude would be lost before the first correction."""
    imu, errors = simulated("MPU-6000", 3)
    assert np.abs(errors.b_g).max() > 30.0 * DEG
    log = write(imu, tmp_path / "mpu.parquet")
    code, out, err = run(
        capsys, "calibrate", "field", log, "--imu", "MPU-6000", *PLACE, "--no-report", "--json", "--out", tmp_path
    )
    assert code == 0, err
    result = CalibrationResult.from_yaml(json.loads(out)["files"]["calibration"])
    off = (result.values - vector(errors, result.names)) / result.sigma
    assert np.abs(off).max() < 4.0  # statistical, 30 parameters


def test_a_simulated_routine_knows_its_place_and_its_biases(tmp_path, capsys):
    """``schuler simulate`` of a routine, then its calibration without a word on the place."""
    scenario = Scenario.parse(
        {
            "seed": 7,
            "motion": {
                "type": "routine", "dwell_s": 5.0, "repeats": 1, "lat_deg": 39.92, "lon_deg": 33.2, "height_m": 1000.0,
                "rpy_deg": [0.0, 0.0, 60.0],
            },
            "imu": {"rate_hz": 50.0, "catalogue": "yaman-automotive"},
        }
    )  # fmt: skip
    run_ = simulate_mission(prepare_mission(scenario))
    io.write(run_.recording, tmp_path / "turned.parquet")
    data = answer(
        capsys, "calibrate", "field", tmp_path / "turned.parquet", "--imu", "yaman-automotive", "--heading", "60,1",
        "--no-report", "--json", "--out", tmp_path,
    )  # fmt: skip
    for i, axis in enumerate("xyz"):
        result = data["parameters"][f"b_a_{axis}"]
        assert abs(result["value"] - run_.errors.b_a[i]) < 4.0 * result["sigma"]
    assert data["provenance"]["latitude"] == pytest.approx(39.92 * DEG)
    again = simulate_mission(prepare_mission(scenario)).recording
    np.testing.assert_array_equal(again.need_imu().accel, run_.recording.need_imu().accel)


def test_the_coach_ends_with_a_calibration(turned, tmp_path, capsys):
    code, out, err = run(capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path, "--coach")
    assert code == 0, err
    assert "to go" in err
    assert json.loads(out)["method"] == "field"


def test_too_few_rests_are_refused_with_what_to_do(turned, tmp_path, capsys):
    code, out, err = run(
        capsys, "calibrate", "field", turned[0], *AUTOMOTIVE, *NORTH, "--out", tmp_path / "o", "--to", "17"
    )
    assert code == 2
    data = json.loads(out)
    assert data["status"] == "refused"
    assert "turn by 45 deg or more" in " ".join(data["verdicts"])
    assert not (tmp_path / "o").exists()
    assert "refused; only 3 rests" in err


def test_a_unit_that_is_not_what_it_is_said_to_be(tmp_path, capsys):
    """An MPU-6000 said to be an automotive unit: its bias of 50 deg/s is 900 sigma of that; it is no silent number."""
    log = write(simulated("MPU-6000", 3)[0], tmp_path / "mpu.parquet")
    arguments = ("calibrate", "field", log, *PLACE, "--heading", "0,1", "--no-report", "--json", "--out", tmp_path)
    code, out, err = run(capsys, *arguments, "--imu", "yaman-automotive")
    assert code == 0, err
    data = json.loads(out)
    assert data["status"] == "warning"
    assert "b_g_y is off by" in " ".join(data["verdicts"])
    code, _, err = run(capsys, *arguments, "--imu", "VN-200")  # no scale factors, hence no way to explain the log
    assert code == 2
    assert "not" in err


def test_a_log_in_counts_is_not_calibrated_to_nonsense(turned, tmp_path, capsys):
    imu = io.read(turned[0]).need_imu()
    log = write(replace(imu, accel=imu.accel * 400.0), tmp_path / "counts.parquet")
    code, out, err = run(capsys, "calibrate", "field", log, "--imu", "yaman-automotive", *PLACE, "--no-report")
    assert (code, out) == (2, "")
    assert "accel_unit: the norm of specific force is" in err
    assert "--units counts,counts" in err
    # whoever goes on in spite of the checks is stopped by the filter's own limit
    again = ("calibrate", "field", log, "--imu", "yaman-automotive", *PLACE, "--no-report", "--unchecked")
    code, _, err = run(capsys, *again)
    assert code == 2
    assert "expected a specific force of about 9.8 m/s^2 at rest" in err
    assert "--scale" in err
    assert "counts,counts" in err


KNOWN = ("--imu", "yaman-automotive")
THERE = (*KNOWN, "--latitude", "40")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("{log}", "--latitude", "40"), "--imu: expected what is known of the IMU before"),
        (("{log}", *KNOWN), "--latitude: expected degrees"),
        (("{log}", *KNOWN, "--coach"), "--latitude: expected degrees with --coach"),
        (("{log}", *KNOWN, "--latitude", "91"), "between -90 and 90"),
        (("{log}", *THERE, "--heading", "north"), "--heading: expected"),
        (("{log}", *THERE, "--heading", "90"), "--heading: expected DEG,SIGMA"),
        (("{log}", *THERE, "--heading", "90,0"), "--heading: expected DEG,SIGMA"),
        (("{log}", *THERE, "--states", "b_a,b_x"), "--states: expected some of"),
        (("{log}", *THERE, "--states", "b_a,b_a"), "each once"),
        (("{log}", *THERE, "--gravity", "32"), "--gravity: expected"),
        (("{log}", *THERE, "--prior", "none.yaml"), "none.yaml"),
        (("{log}", *THERE, "--history", "xlsx"), "--history"),
        (("{log}", "--imu", "no such IMU", "--latitude", "40"), "no such IMU"),
        (("missing.parquet", *THERE), "no such file or folder"),
        (("-", *THERE), "add --coach"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_2(arguments, message, turned, capsys):
    assert message in refusal(capsys, "calibrate", "field", *(a.format(log=turned[0]) for a in arguments))


def test_a_log_that_never_rests(turned, tmp_path, capsys):
    imu = io.read(turned[0]).need_imu()
    rng = np.random.default_rng(0)
    log = write(
        replace(imu, gyro=imu.gyro + 0.05 * np.cumsum(rng.standard_normal(imu.gyro.shape), 0)), tmp_path / "a.parquet"
    )
    code, _, err = run(capsys, "calibrate", "field", log, "--imu", "yaman-automotive", *PLACE, "--no-report")
    assert code == 2
    assert "no rest" in err


PAGE = ROOT / "docs" / "field-calibration.md"


@pytest.mark.campaign
def test_the_documented_program_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(program, str(PAGE), "exec"), {})
    assert (tmp_path / "unit7.html").stat().st_size > 0
    assert (tmp_path / "unit7-history.csv").stat().st_size > 0


def test_the_commands_documented_exist(capsys):
    """Every option the pages name for this method, and every key of its JSON."""
    main(["calibrate", "field", "--help"])
    given = set(re.findall(r"--[a-z][a-z-]*", capsys.readouterr().out))
    page = PAGE.read_text(encoding="utf-8")
    others = {"--calibration", "--config"}  # of navigate
    assert set(re.findall(r"--[a-z][a-z-]*", page)) - others <= given
    commands = (PAGE.parent / "commands.md").read_text(encoding="utf-8")
    for key in ("passes", "rests", "rest_notes", "heading_deg", "nis.<kind>", "below_tenth_s.<name>"):
        assert f"`{key}`" in commands
    for figure in (*(f"field_{w}" for w in ("convergence", "estimates", "rests", "innovations")), "output_accel"):
        assert f"`{figure}`" in page
