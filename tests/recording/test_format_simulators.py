"""Folders of gnss-ins-sim and segments of comma2k19."""

import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import rotation, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read


def gnss_ins_sim(folder, runs=(0,)):
    """What gnss-ins-sim writes, of the test drive: NumPy's text with headers."""
    run = drive()
    T, g = run.reference, run.gnss

    def save(name, header, rows):
        np.savetxt(folder / name, rows, header=header, delimiter=",", comments="", fmt="%.17g")

    deg = 1.0 / units.DEG
    save("time.csv", "time (sec)", T.t)
    for k in runs:
        save(f"accel-{k}.csv", "accel_x (m/s^2),accel_y (m/s^2),accel_z (m/s^2)", run.imu.accel)
        save(f"gyro-{k}.csv", "gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)", run.imu.gyro * deg)
        head = "gps_lat (deg),gps_lon (deg),gps_alt (m),gps_vN (m/s),gps_vE (m/s),gps_vD (m/s)"
        save(f"gps-{k}.csv", head, np.column_stack((g.llh * (deg, deg, 1), g.v_n)))
    save("gps_time.csv", "gps_time (sec)", g.t)
    save("ref_pos.csv", "ref_pos_lat (deg),ref_pos_lon (deg),ref_pos_alt (m)", T.llh * (deg, deg, 1))
    save("ref_vel.csv", "ref_vel_x (m/s),ref_vel_y (m/s),ref_vel_z (m/s)", T.v_eb_n)
    save("ref_att_euler.csv", "ref_Yaw (deg),ref_Pitch (deg),ref_Roll (deg)", T.rpy_nb[:, ::-1] * deg)
    return run


def test_gnss_ins_sim(tmp_path):
    run = gnss_ins_sim(tmp_path)
    back = read(tmp_path, sigma="1,1,2,0.1,0.1,0.1")
    np.testing.assert_array_equal(back.imu.accel, run.imu.accel)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=1e-14, atol=1e-18)
    np.testing.assert_allclose(back.gnss.llh, run.gnss.llh, rtol=1e-14)
    np.testing.assert_array_equal(back.gnss.v_n, run.gnss.v_n)
    same_trajectory(back.reference, run.reference, t=0.0, r=1e-8, v=1e-12, q=1e-12)
    assert read(tmp_path).gnss is None


def test_gnss_ins_sim_runs_and_frames(tmp_path):
    gnss_ins_sim(tmp_path, runs=(0, 3))
    assert "Run 3 of 2 (0, 3)." in read(tmp_path, streams="imu=3").metadata.notes
    with pytest.raises(InputError, match="N of 0, 3"):
        read(tmp_path, streams="imu=1")
    (tmp_path / "ref_pos.csv").write_text("ref_pos_x (m),ref_pos_y (m),ref_pos_z (m)\n1,2,3\n")
    back = read(tmp_path)
    assert back.reference is None
    assert any("ref_frame=1" in note for note in back.metadata.notes)


def test_gnss_ins_sim_refused(tmp_path):
    gnss_ins_sim(tmp_path)
    rows = (tmp_path / "gyro-0.csv").read_text().splitlines()
    (tmp_path / "gyro-0.csv").write_text("\n".join(rows[:-1]) + "\n")
    with pytest.raises(FileFormatError, match="expected 1000 rows"):
        read(tmp_path)
    (tmp_path / "gyro-0.csv").write_text("\n".join([rows[0], "1,x,2", *rows[2:]]) + "\n")
    with pytest.raises(FileFormatError, match=r"gyro-0\.csv"):
        read(tmp_path)
    (tmp_path / "gyro-0.csv").write_text("\n".join(["wx,wy,wz", *rows[1:]]) + "\n")
    with pytest.raises(FileFormatError, match=r"gyro-0\.csv:1: expected the header gyro_x"):
        read(tmp_path)


def comma2k19(folder, swapped=False, gps=True, offset=0.0):
    """A segment of the test drive; ``swapped``: orientations turn from Earth-fixed to camera axes."""
    run = drive()
    T, g = run.reference, run.gnss
    boot = T.t[0] - 500.0

    def save(name, *arrays):
        for part, values in zip(("t", "value"), arrays, strict=False):
            path = folder / name / part
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as stream:
                np.save(stream, values)

    t = T.t - boot
    save("processed_log/IMU/accelerometer", t + offset, run.imu.accel)
    save("processed_log/IMU/gyro", t, run.imu.gyro)
    course = np.rad2deg(np.arctan2(g.v_n[:, 1], g.v_n[:, 0])) % 360.0
    fixes = np.column_stack((g.llh[:, :2] / units.DEG, np.hypot(*g.v_n.T[:2]), g.t + 1.5e9, g.llh[:, 2], course))
    save("processed_log/GNSS/live_gnss_ublox", g.t - boot, fixes)
    save("processed_log/CAN/speed", t, np.linalg.norm(T.v_eb_n, axis=1)[:, None])
    pose = folder / "global_pose"
    pose.mkdir()
    q = rotation.quat_conjugate(T.q_eb) if swapped else T.q_eb
    pairs = np.column_stack((np.full(len(t), WEEK), T.t))
    arrays = {"frame_times": t, "frame_positions": T.r_eb_e, "frame_velocities": T.v_eb_e, "frame_orientations": q}
    for name, values in (arrays | ({"frame_gps_times": pairs} if gps else {})).items():
        with (pose / name).open("wb") as stream:
            np.save(stream, values)
    return run


@pytest.mark.parametrize("swapped", [False, True])
def test_comma2k19(tmp_path, swapped):
    """GPS time by the poses' pairs; orientations either way round give a car that drives forward."""
    run = comma2k19(tmp_path, swapped)
    back = read(tmp_path, sigma="5,5,10", sigma_speed=0.1)
    assert back.metadata.time == run.metadata.time
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(back.imu.accel, run.imu.accel)
    np.testing.assert_allclose(back.gnss.llh, run.gnss.llh, rtol=1e-14)
    if back.gnss.v_n is not None:  # of ten pairs of fixes and more
        np.testing.assert_allclose(back.gnss.v_n[:, :2], run.gnss.v_n[:, :2], atol=1e-12)
    assert "processed_log/IMU/gyro/value" in back.metadata.sources
    assert back.odometer.speed[-1] == pytest.approx(np.linalg.norm(run.reference.v_eb_n[-1]))
    same_trajectory(back.reference, run.reference, t=1e-7, r=0.0, v=0.0, q=1e-14)


def test_comma2k19_two_clocks(tmp_path):
    """Specific forces are interpolated to the gyro's times; without accuracies fixes and speed are left out."""
    run = comma2k19(tmp_path, gps=False, offset=0.005)
    back = read(tmp_path)
    assert back.metadata.time.scale == "local"
    assert back.gnss is None
    assert back.odometer is None
    assert any("interpolated" in note for note in back.metadata.notes)
    expected = 0.25 * run.imu.accel[:-2] + 0.75 * run.imu.accel[1:-1]
    np.testing.assert_allclose(back.imu.accel[: len(expected)], expected, atol=1e-9)


def test_comma2k19_refused(tmp_path):
    comma2k19(tmp_path)
    file = tmp_path / "processed_log/IMU/gyro/value"
    good = file.read_bytes()
    file.write_bytes(good.replace(b"(1000, 3)", b"(9000000000, 3)").replace(b"3), }       ", b"3), }"))
    with pytest.raises(FileFormatError, match="complete"):
        read(tmp_path)
    with file.open("wb") as stream:
        np.save(stream, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(FileFormatError, match="NumPy"):
        read(tmp_path)
