"""EuRoC data sets: a writer of the test's own, round trips, what is refused."""

import numpy as np
import pytest
from format_drives import drive

from schuler.cli import main
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read, write

IMU_HEAD = "#timestamp [ns]," + ",".join(
    [f"w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"a_RS_S_{a} [m s^-2]" for a in "xyz"]
)
TRUTH_HEAD = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
START = 1_403_636_579_763_555_584  # ns, no multiple of the 256 ns that float64 can tell apart


def data_set(folder, sensor="", n=400):
    """An EuRoC folder as the data set has it: a vehicle whose x points up, z forward, at rest, facing east."""
    rows = [f"{START + 5_000_000 * k},0.01,0.02,{0.03 + 1e-5 * k:.6f},9.81,0.0,0.0" for k in range(n)]
    for name, head, lines in (
        ("imu0", IMU_HEAD, rows),
        # sensor x up, y right (south when facing east), z forward (east)
        ("state_groundtruth_estimate0", TRUTH_HEAD,
         [f"{START + 50_000_000 * k},{k},2.0,3.0,0.5,-0.5,0.5,0.5" for k in range(n // 10)]),
    ):  # fmt: skip
        (folder / "mav0" / name).mkdir(parents=True)
        (folder / "mav0" / name / "data.csv").write_text("\n".join([head, *lines]) + "\n")
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(sensor)
    return folder


def test_columns_and_axes(tmp_path):
    """Hand-made numbers end in the right places: gyro first, x up is minus down; stamps to the nanosecond."""
    folder = data_set(tmp_path, "#VI-Sensor imu\nsensor_type: imu\ncomment: VI-Sensor IMU (ADIS16448)\n")
    run = read(folder, origin="47,8,400")
    np.testing.assert_allclose(run.imu.accel[0], (0.0, 0.0, -9.81), atol=1e-12)
    np.testing.assert_allclose(run.imu.gyro[0], (0.03, 0.02, -0.01), atol=1e-12)
    assert run.imu.t[0] == pytest.approx(0.763555584, abs=1e-9)
    np.testing.assert_allclose(np.diff(run.imu.t), 0.005, atol=1e-12)
    assert any("VI-Sensor" in note for note in run.metadata.notes)
    tables = ("imu0", "state_groundtruth_estimate0")
    assert set(run.metadata.sources) == {f"mav0/{name}/data.csv" for name in tables}
    moved = run.reference.llh[-1] - run.reference.llh[0]
    assert moved[1] > 0.0
    assert abs(moved[0]) < 1e-9


def test_attitude_of_the_sensor(tmp_path):
    """The identity quaternion of a sensor in axes FLU is a body facing east and level."""
    folder = data_set(tmp_path)
    truth = folder / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    truth.write_text(f"{TRUTH_HEAD}\n{START},0,0,0,1,0,0,0\n{START + 10**9},1,0,0,1,0,0,0\n")
    run = read(folder, origin="47,8,400", axes="FLU", allow="norm")
    np.testing.assert_allclose(run.reference.rpy_nb[0], (0.0, 0.0, np.pi / 2), atol=1e-12)


def test_ground_truth_needs_an_origin(tmp_path):
    folder = data_set(tmp_path)
    run = read(folder, axes="URF")
    assert run.reference is None
    assert any("origin=" in note for note in run.metadata.notes)
    with pytest.raises(InputError, match="origin="):
        read(folder / "mav0" / "state_groundtruth_estimate0" / "data.csv")


def test_unix_time(tmp_path):
    """Stamps stated to be Unix time become GPS time with the 16 leap seconds of 2014."""
    run = read(data_set(tmp_path), axes="URF", time="unix")
    gps = START // 10**9 - 315_964_800 + 16
    assert run.metadata.time.scale == "gps"
    assert run.metadata.time.epoch_gps_s + np.floor(run.imu.t[0]) == gps
    assert run.imu.t[0] % 1.0 == pytest.approx(0.763555584, abs=1e-9)


def test_increments_are_written_as_rates(tmp_path):
    write(drive(kind="increment"), tmp_path / "set", format="euroc")
    back, run = read(tmp_path / "set"), drive()
    assert back.imu.kind == "rate"
    np.testing.assert_allclose(back.imu.accel[1:], run.imu.accel[1:], atol=1e-9)


def test_nothing_is_written_over(tmp_path):
    (tmp_path / "set").mkdir()
    with pytest.raises(InputError, match="exists"):
        write(drive(), tmp_path / "set", format="euroc")
    assert sorted(tmp_path.iterdir()) == [tmp_path / "set"]


def test_a_failure_leaves_nothing(tmp_path):
    run = drive()
    with pytest.raises(InputError, match="origin"):
        write(run, tmp_path / "set", format="euroc", origin="91,0,0")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("line", "message"),
    [("1,2,3", r"data.csv:6: expected 7 columns"), (f"{START},0,0,x,0,0,9.8", r"data.csv:6: column 4"),
     (f"{START},0,0,nan,0,0,9.8", r"data.csv:6: column 4: expected a finite")],
)  # fmt: skip
def test_faults_name_the_line(tmp_path, line, message):
    file = data_set(tmp_path) / "mav0" / "imu0" / "data.csv"
    rows = file.read_text().splitlines()
    rows[5] = line
    file.write_text("\n".join(rows) + "\n")
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, axes="URF")


def test_a_clock_that_was_set(tmp_path):
    file = data_set(tmp_path) / "mav0" / "imu0" / "data.csv"
    rows = file.read_text().splitlines()
    file.write_text("\n".join([rows[0], *rows[200:], *rows[1:200]]) + "\n")
    with pytest.raises(FileFormatError, match="go back"):
        read(tmp_path, axes="URF")


def test_ground_truth_with_velocity_and_biases(tmp_path, capsys):
    """17 columns as the original has: the names of its biases hold those of the IMU. Opened by every command."""
    folder = data_set(tmp_path / "V1_02_medium", "comment: VI-Sensor IMU (ADIS16448)\n")
    more = [f" v_RS_R_{a} [m s^-1]" for a in "xyz"]
    more += [f" b_w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f" b_a_RS_S_{a} [m s^-2]" for a in "xyz"]
    file = folder / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    rows = file.read_text().splitlines()[1:]
    file.write_text("\n".join([TRUTH_HEAD + "," + ",".join(more), *(f"{r},20,0,0,1,2,3,4,5,6" for r in rows)]) + "\n")
    run = read(folder, origin="47,8,400")
    np.testing.assert_allclose(run.reference.v_eb_n[0], (0.0, 20.0, 0.0), atol=1e-9)
    assert len(run.imu) == 400
    for command in ("info", "check"):
        assert main([command, str(folder), "--origin", "47,8,400"]) in (0, 2)
        output = capsys.readouterr()
        assert "expected 7 columns" not in output.out + output.err
        assert "is a folder: say" not in output.err
    assert main(["info", str(folder), "--origin", "47,8,400"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  - ")]
    assert len(lines) == len(set(lines))
