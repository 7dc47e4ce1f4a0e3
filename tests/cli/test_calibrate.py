"""``schuler calibrate`` as scripts use it: keys of the JSON, files, exit codes, one-line errors."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import answer, refusal, run

from schuler.calibration.freepose.simulation import hand_log
from schuler.calibration.result.result import CalibrationResult
from schuler.cli import main
from schuler.cli.app import METHODS
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import White
from schuler.units import DEG, G0

ERRORS = ImuErrors(
    b_a=np.array([0.05, -0.03, 0.02]),
    M_a=np.array([[0.004, 0.001, -0.002], [0.0, -0.003, 0.0015], [0.0, 0.0, 0.002]]),
    b_g=np.array([0.004, -0.002, 0.001]),
    M_g=np.array([[0.005, 0.002, -0.001], [0.001, -0.004, 0.003], [-0.002, 0.001, 0.003]]),
    gyro_noise=White(1e-4) + White(0.0),
    accel_noise=White(1e-3) + White(0.0),
)
#: The keys scripts rely on (design, section 5).
KEYS = {"status", "gauge", "parameters", "condition", "residual_rms", "verdicts", "next_pose"}
HALF = 0.5 * np.pi


def write(imu: ImuSeries, path, name: str = "unit"):
    io.write(Recording(imu=imu, metadata=Metadata(name=name)), path)
    return path


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    """A unit put down in 24 poses by hand."""
    path = tmp_path_factory.mktemp("hand") / "hand.parquet"
    return write(hand_log(ERRORS, np.random.default_rng(1)).rates(), path)


@pytest.fixture(scope="module")
def faces(tmp_path_factory):
    """Six faces and back: z down, x up, x down, z up, y ... by quarter and half turns."""
    turns = np.array([[0.0, HALF, 0.0], [0.0, np.pi, 0.0], [0.0, HALF, 0.0], [HALF, 0.0, 0.0], [np.pi, 0.0, 0.0]])
    path = tmp_path_factory.mktemp("faces") / "faces.parquet"
    return write(hand_log(ERRORS, np.random.default_rng(2), rotvecs=turns, rest_s=6.0).rates(), path)


def within(data, name, value, sigmas=4.0):
    result = data["parameters"][name]
    assert abs(result["value"] - value) < sigmas * result["sigma"] + 1e-12, (name, result, value)


def test_freepose_finds_the_errors_and_writes_its_files(hand, tmp_path, capsys):
    data = answer(capsys, "calibrate", "freepose", hand, "--out", tmp_path, "--json")
    assert data.keys() >= KEYS
    assert (data["command"], data["method"], data["gauge"]) == ("calibrate", "freepose", "upper")
    within(data, "b_a_x", 0.05)
    within(data, "M_a_xy", 0.001)
    within(data, "M_g_yz", 0.003)
    assert data["parameters"]["b_g_x"]["unit"] == "rad/s"
    files = data["files"]
    assert {"calibration", "report"} <= files.keys()
    again = CalibrationResult.from_yaml(files["calibration"])
    assert again["b_a_x"][0] == data["parameters"]["b_a_x"]["value"]
    assert again.provenance["sources"] == data["provenance"]["sources"]
    assert (tmp_path / "calibration.html").read_text().startswith("<!")


def test_another_gauge_and_an_earlier_calibration(hand, tmp_path, capsys):
    first = tmp_path / "a" / "calibration.yaml"
    code, _, err = run(capsys, "calibrate", "freepose", hand, "--out", tmp_path / "a", "--no-report")
    assert code == 0, err
    data = answer(
        capsys, "calibrate", "freepose", hand, "--out", tmp_path / "b", "--no-report", "--json", "--gauge", "lower",
        "--previous", first,
    )  # fmt: skip
    assert data["gauge"] == "lower"
    assert data["changed"] == []
    assert data["parameters"]["M_a_xy"].get("fixed")


def test_sixposition(faces, tmp_path, capsys):
    data = answer(
        capsys, "calibrate", "sixposition", faces, "--out", tmp_path, "--no-report", "--json", "--gravity", G0
    )
    assert data["gauge"] == "full"
    within(data, "b_a_z", 0.02)
    within(data, "M_a_xx", 0.004)
    within(data, "M_a_yz", 0.0015)


@pytest.mark.parametrize("form", ["counts", "numbers", "one sensor"])
def test_a_table_as_loggers_write_it_needs_no_option(hand, tmp_path, capsys, form):
    """A raw sensor is further from gravity than 5 %: that is what is to be calibrated, and stops no command here."""
    imu = io.read(hand).need_imu()
    accel, gyro = imu.accel + np.array([0.0, 0.0, 0.8]), imu.gyro
    path = tmp_path / "unit.csv"
    if form == "counts":
        ms, whole = np.round(1e3 * (imu.t - imu.t[0])), (accel / G0 * 16384.0, gyro / DEG * 65.5)
        np.savetxt(
            path, np.column_stack((ms, *whole)), "%.0f", ",", header="millis,AcX,AcY,AcZ,GyX,GyY,GyZ", comments=""
        )
    elif form == "numbers":
        np.savetxt(path, np.column_stack((imu.t, accel, gyro)), "%.6f")
    else:
        np.savetxt(path, np.column_stack((imu.t, accel)), "%.6f", ",", header="t,x,y,z", comments="")
    data = answer(capsys, "calibrate", "freepose", path, "--out", tmp_path / "o", "--json", "--no-report")
    assert data["status"] == "ok"
    for axis, bias in zip("xyz", ERRORS.b_a + np.array([0.0, 0.0, 0.8]), strict=True):
        within(data, f"b_a_{axis}", bias, sigmas=5.0)  # statistical, and rounding of the counts


def test_a_log_without_a_method_is_told_one(hand, capsys):
    assert "calibrate freepose" in refusal(capsys, "calibrate", hand)


def test_multiposition_needs_no_fixture(hand, tmp_path, capsys):
    data = answer(
        capsys, "calibrate", "multiposition", hand, "--out", tmp_path, "--no-report", "--json", "--gyro-order", "3",
        "--latitude", 47.0, "--gravity", G0,
    )  # fmt: skip
    assert data["gauge"] == "lower"
    assert data["parameters"]["M_a_yy"]["sigma"] < 1e-3


def test_ratetable(tmp_path, capsys):
    """Both ways about each axis, level, then the six parameters of bias and response."""
    dt, rng = 0.01, np.random.default_rng(3)
    omega, f = [], []
    for axis in range(3):
        up = -G0 * np.eye(3)[axis]
        for speed in (30.0, -30.0):
            for rate, seconds in ((0.0, 4.0), (speed, 14.0)):
                n = round(seconds / dt)
                omega.append(np.tile(rate * DEG * np.eye(3)[axis], (n, 1)))
                f.append(np.tile(up, (n, 1)))
    gyro, accel, _ = ERRORS.apply_rates(np.concatenate(omega), np.concatenate(f), dt, rng)
    log = write(ImuSeries(np.arange(len(gyro)) * dt, gyro, accel), tmp_path / "table.parquet")
    data = answer(
        capsys, "calibrate", "ratetable", log, "--rates", "30", "--no-g-sensitivity", "--latitude", 0.0,
        "--out", tmp_path, "--no-report", "--json",
    )  # fmt: skip
    within(data, "M_g_xx", 0.005, 6.0)
    within(data, "b_g_y", -0.002, 6.0)


def test_thermal_ramp(tmp_path, capsys):
    rng = np.random.default_rng(4)
    n = 4_000
    T = np.concatenate((np.linspace(-10.0, 60.0, n // 2), np.linspace(60.0, -10.0, n // 2)))
    gyro = 1e-3 * rng.standard_normal((n, 3)) + 1e-4 * (T[:, None] - 25.0) + [0.01, 0.0, 0.0]
    accel = 1e-2 * rng.standard_normal((n, 3)) + [0.0, 0.0, -G0]
    log = write(ImuSeries(0.1 * np.arange(n), gyro, accel, temperature=T), tmp_path / "chamber.parquet")
    data = answer(capsys, "calibrate", "thermal", log, "--out", tmp_path, "--no-report", "--json")
    within(data, "b_g_x", 0.01, 5.0)
    assert data["parameters"]["b_a_x"]["sigma"] is None
    assert "b_a_x" in data["undetermined"]
    assert data["extra"]["thermal"]["coefficients"]["b_g_x"][1] == pytest.approx(1e-4, rel=0.05)


def test_too_few_poses_are_refused_with_what_to_do(tmp_path, capsys):
    log = write(hand_log(ERRORS, np.random.default_rng(1), poses=4).rates(), tmp_path / "few.parquet")
    code, out, err = run(capsys, "calibrate", "freepose", log, "--out", tmp_path / "o", "--json", "--no-report")
    assert code == 2
    data = json.loads(out)
    assert data["status"] == "refused"
    assert data["next_pose"] or any("Collect" in v or "put" in v for v in data["verdicts"])
    assert not (tmp_path / "o" / "calibration.yaml").exists()
    assert "refused" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("freepose", "missing.parquet"), "no such file or folder"),
        (("freepose", "{hand}", "--gravity", "32"), "--gravity: expected local gravity in m/s^2"),
        (("freepose", "{hand}", "--intervals", "{hand}"), "expected a CSV file with lines START,STOP"),
        (("freepose", "{hand}", "--rests", "tedaldi"), "--initial-rest: expected the seconds at rest"),
        (("sixposition", "{hand}", "--latitude", "95"), "--latitude: expected degrees between -90 and 90"),
        (("sixposition", "{hand}", "--headings", "north"), "--headings: expected numbers with commas"),
        (("multiposition", "{hand}", "--table-rate", "0,30"), "--table-rate: expected"),
        (("ratetable", "{hand}"), "--rates"),
        (("thermal", "{hand}"), "temperature"),
        (("thermal", "{hand}", "{hand}"), "--soak"),
        (("freepose", "{hand}", "--imu", "no such IMU"), "no such IMU"),
        (("sevenposition", "{hand}"), "sevenposition"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_2(arguments, message, hand, capsys):
    assert message in refusal(capsys, "calibrate", *(a.format(hand=hand) for a in arguments))


def test_rests_as_published(hand, tmp_path, capsys):
    """What was tried is in the JSON; a log that moves at the start has no rests and no threshold has a cost."""
    options = ("--rests", "tedaldi", "--no-report", "--json", "--out", tmp_path)
    data = answer(capsys, "calibrate", "freepose", hand, "--initial-rest", 15, *options)
    within(data, "M_a_zz", 0.002)
    assert data["provenance"]["options"]["rests"] == "tedaldi"
    assert data["extra"]["poses"] == 24
    assert [k for k, _, _ in data["extra"]["tried"]] == list(range(2, 11))
    code, out, _ = run(capsys, "calibrate", "freepose", hand, "--initial-rest", 60, *options)
    assert code == 2
    assert json.loads(out)["extra"]["tried"][-1][2] is None


@pytest.mark.realdata
def test_rests_as_published_of_a_recording(shared_data, tmp_path, capsys):
    """imu_tk's 14 rests of good3, and its numbers to 1e-3, in its form ``T K = (I + M)^-1``, ``B = b``."""
    log = shared_data / "snu_staticposes" / "imu_good3.txt"
    data = answer(
        capsys, "calibrate", "freepose", log, "--columns", "t,ax,ay,az,gx,gy,gz,*", "--units", "m/s^2,rad/s",
        "--gravity", 9.79871, "--initial-rest", 4, "--rests", "tedaldi", "--no-report", "--json", "--out", tmp_path,
    )  # fmt: skip
    expected = json.loads((log.parent / "expected.json").read_text())["imu_good3"]
    assert data["extra"]["poses"] == expected["n_intervals"] == 14
    assert data["extra"]["margin"] == 2.0
    assert data["nominal"] == [1.0, 1.0]
    for triad, name, bias in (("a", "acc", 1e-3 * 9.79871), ("g", "gyro", 1e-5)):
        M = np.array([[data["parameters"][f"M_{triad}_{i}{j}"]["value"] for j in "xyz"] for i in "xyz"])
        product = np.linalg.inv(np.eye(3) + M)
        np.testing.assert_allclose(np.diag(product), expected[name]["K"], atol=1.5e-3)
        np.testing.assert_allclose(product / np.diag(product), expected[name]["T"], atol=1.5e-3)
        b = [data["parameters"][f"b_{triad}_{i}"]["value"] for i in "xyz"]
        np.testing.assert_allclose(b, expected[name]["B"], atol=bias)


def test_intervals_of_a_file_are_used(hand, tmp_path, capsys):
    imu = io.read(hand).need_imu()
    result = hand_rests(imu)
    table = tmp_path / "rests.csv"
    table.write_text("start,stop\n# seconds\n" + "\n".join(f"{a:.3f},{b:.3f}" for a, b in result), encoding="utf-8")
    code, out, err = run(
        capsys, "calibrate", "freepose", hand, "--intervals", table, "--out", tmp_path, "--no-report", "--json"
    )
    assert code == 0, err
    within(json.loads(out), "M_a_zz", 0.002)


def hand_rests(imu: ImuSeries) -> list[tuple[float, float]]:
    """20 s, then every 5 s three seconds of rest, with a margin."""
    starts = [0.0, *(20.0 + 2.0 + 5.0 * k for k in range(23))]
    return [(a + 0.2, a + (19.8 if a == 0.0 else 2.8)) for a in starts]


@pytest.mark.parametrize("method", METHODS)
def test_every_method_has_help_with_an_example(method, capsys):
    assert main(["calibrate", method, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"schuler calibrate {method}" in text
    assert "Example:" in text


def test_counts_are_a_unit(tmp_path, capsys):
    """A log in counts gives factors to SI, and parameters relative to them."""
    imu = hand_log(ERRORS, np.random.default_rng(1)).rates()
    counts = replace(imu, gyro=np.round(imu.gyro * 5000.0), accel=np.round(imu.accel * 400.0))
    lines = ["t,ax,ay,az,gx,gy,gz"]
    lines += [
        f"{t:.3f},{','.join(f'{v:.0f}' for v in (*a, *g))}"
        for t, a, g in zip(counts.t, counts.accel, counts.gyro, strict=True)
    ]
    log = tmp_path / "counts.csv"
    log.write_text("\n".join(lines), encoding="utf-8")
    data = answer(
        capsys, "calibrate", "freepose", log, "--units", "counts,counts", "--out", tmp_path, "--no-report", "--json"
    )
    assert data["nominal"][0] == pytest.approx(1.0 / 400.0, rel=0.01)
    assert data["nominal"][1] == pytest.approx(1.0 / 5000.0, rel=0.02)
    # bias over scale does not depend on the factor
    true = ERRORS.b_a[0] / (1.0 + ERRORS.M_a[0, 0])
    p = data["parameters"]
    assert p["b_a_x"]["value"] / (1.0 + p["M_a_xx"]["value"]) == pytest.approx(true, abs=1e-3)
