"""MATLAB files of NaveGo and PSINS, written by SciPy; the names in them seen without loading."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from format_damage import check_damaged
from format_drives import drive, same_trajectory

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.mat_peek import check_sizes, variables
from schuler.recording.io import read

scipy_io = pytest.importorskip("scipy.io")


def navego(path, compress=True, **changes):
    run = drive()
    T, g = run.reference, run.gnss
    data = {
        "imu1": {"t": run.imu.t[:, None], "fb": run.imu.accel, "wb": run.imu.gyro, "arw": np.ones(3), "freq": 50.0},
        "gnss": {"t": g.t[:, None], "lat": g.llh[:, :1], "lon": g.llh[:, 1:2], "h": g.llh[:, 2:], "vel": g.v_n,
                 "stdm": [1.0, 2.0, 3.0], "stdv": [0.1, 0.2, 0.3], "larm": np.zeros((3, 1))},
        "ref": {"t": T.t[:, None], "lat": T.llh[:, :1], "lon": T.llh[:, 1:2], "h": T.llh[:, 2:], "vel": T.v_eb_n,
                "roll": T.rpy_nb[:, :1], "pitch": T.rpy_nb[:, 1:2], "yaw": T.rpy_nb[:, 2:], "freq": 50.0},
        "note": "words",
    }  # fmt: skip
    scipy_io.savemat(path, {**data, **changes}, do_compression=compress)
    return run


@pytest.mark.parametrize("compress", [True, False])
def test_names_are_seen(tmp_path, compress):
    navego(tmp_path / "a.mat", compress, x=np.zeros((5, 7)))
    found = variables(tmp_path / "a.mat")
    assert set(found) == {"imu1", "gnss", "ref", "note", "x"}
    assert found["imu1"].fields == ("t", "fb", "wb", "arw", "freq")
    assert found["x"].shape == (5, 7)
    assert found["x"].fields == ()


@pytest.mark.parametrize("compress", [True, False])
def test_navego(tmp_path, compress):
    """All numbers are SI already and come back bit for bit, but for the way to Earth-fixed axes."""
    run = navego(tmp_path / "a.mat", compress)
    back = read(tmp_path / "a.mat", time="gps-tow:2300")
    np.testing.assert_array_equal(back.imu.accel, run.imu.accel)
    np.testing.assert_array_equal(back.imu.gyro, run.imu.gyro)
    np.testing.assert_array_equal(back.gnss.llh, run.gnss.llh)
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_r_n[0])), (1.0, 2.0, 3.0))
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_v_n[0])), (0.1, 0.2, 0.3))
    assert back.metadata.time == run.metadata.time
    same_trajectory(back.reference, run.reference, t=0.0, r=1e-8, v=1e-12, q=1e-12)


def test_navego_choices(tmp_path):
    """Several units need a choice; a ref is preferred to results; fixes without accuracies need one."""
    run = navego(tmp_path / "a.mat")
    other = {"t": run.imu.t, "fb": run.imu.accel, "wb": run.imu.gyro}
    navego(tmp_path / "a.mat", imu2=other)
    with pytest.raises(InputError, match=r"imu1 .*imu2"):
        read(tmp_path / "a.mat")
    assert read(tmp_path / "a.mat", streams="imu=imu2,gnss=none").gnss is None
    g = run.gnss
    bare = {"t": g.t, "lat": g.llh[:, 0], "lon": g.llh[:, 1], "h": g.llh[:, 2], "vel": g.v_n}
    navego(tmp_path / "a.mat", gnss=bare)
    with pytest.raises(InputError, match="sigma"):
        read(tmp_path / "a.mat")
    assert read(tmp_path / "a.mat", sigma="1,1,2,0.1,0.1,0.1").gnss is not None


def test_navego_faults(tmp_path):
    run = navego(tmp_path / "a.mat")
    navego(tmp_path / "a.mat", imu1={"t": run.imu.t, "fb": run.imu.accel[:-1], "wb": run.imu.gyro})
    with pytest.raises(FileFormatError, match=r"imu1\.fb: expected 1000 x 3"):
        read(tmp_path / "a.mat")
    with pytest.raises(InputError, match="leave out units"):
        read(tmp_path / "a.mat", units="g,deg/s", format="navego")
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.mat").read_bytes()[:-3000])
    with pytest.raises(FileFormatError):
        read(tmp_path / "a.mat")


def psins(path, trj=True, **more):
    """Right-forward-up increments, east-north-up velocities, yaw from north over west."""
    run = drive(kind="increment")
    T, rfu = run.reference, np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    rpy, v = T.rpy_nb, T.v_eb_n
    imu = np.column_stack((run.imu.gyro @ rfu.T, run.imu.accel @ rfu.T, run.imu.t))
    avp = np.column_stack((rpy[:, 1], rpy[:, 0], -rpy[:, 2], v[:, 1], v[:, 0], -v[:, 2], T.llh, T.t))
    data = {"imu": imu, "avp": avp}
    scipy_io.savemat(path, {**({"trj": {**data, "ts": 0.02}} if trj else data), **more}, do_compression=True)
    return run


@pytest.mark.parametrize("trj", [True, False])
def test_psins(tmp_path, trj):
    run = psins(tmp_path / "a.mat", trj)
    back = read(tmp_path / "a.mat")
    assert back.imu.kind == "increment"
    assert back.metadata.axes == "RFU"
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, atol=1e-18)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, atol=1e-18)
    same_trajectory(back.reference, run.reference, t=0.0, r=1e-8, v=1e-12, q=1e-12)


def test_psins_fixes(tmp_path):
    run = drive()
    g = run.gnss
    v = g.v_n[:, [1, 0, 2]] * (1, 1, -1)
    psins(tmp_path / "a.mat", trj=False, gps=np.column_stack((v, g.llh, g.t)))
    assert any("sigma" in note for note in read(tmp_path / "a.mat").metadata.notes)
    back = read(tmp_path / "a.mat", sigma="1,1,2,0.1,0.1,0.1")
    np.testing.assert_allclose(back.gnss.v_n, g.v_n)
    np.testing.assert_array_equal(back.gnss.llh, g.llh)


@pytest.mark.parametrize("compress", [True, False])
def test_a_claimed_size_is_not_allocated(tmp_path, compress):
    """A field that claims 2 GB, or the shape of 2 GB, in a file of a few kilobytes."""
    file = tmp_path / "a.mat"
    fb = np.arange(300.0).reshape(100, 3)
    scipy_io.savemat(file, {"imu": {"t": np.arange(100.0), "fb": fb, "wb": fb}}, do_compression=False)
    data = file.read_bytes()
    size, shape = struct.pack("<II", 9, 2400), struct.pack("<IIii", 5, 8, 100, 3)
    for old, new in ((size, struct.pack("<II", 9, 2_000_000_000)), (shape, struct.pack("<IIii", 5, 8, 90_000_000, 3))):
        assert old in data
        bad = data.replace(old, new, 1)
        if compress:
            packed = zlib.compress(bad[128:])
            bad = bad[:128] + struct.pack("<II", 15, len(packed)) + packed
        file.write_bytes(bad)
        with pytest.raises(FileFormatError, match="claims"):
            read(file, format="navego")
    if compress:
        inner = data[128:132] + struct.pack("<I", 2_000_000_000) + data[136:]
        packed = zlib.compress(inner)
        file.write_bytes(data[:128] + struct.pack("<II", 15, len(packed)) + packed)
        with pytest.raises(FileFormatError, match="claims 2000000000 bytes"):
            read(file, format="navego")


@pytest.mark.realdata
def test_good_files_pass_the_check_of_sizes(shared_data):
    for path in shared_data.rglob("*.mat"):
        if path.read_bytes()[:10] == b"MATLAB 5.0":
            check_sizes(path)


@pytest.mark.realdata
def test_other_files_are_not_claimed(shared_data):
    """The MATLAB files of the data folder are neither NaveGo's nor trajectories of PSINS."""
    from schuler.recording.formats import navego, psins

    for path in shared_data.rglob("*.mat"):
        head = path.read_bytes()[:200]
        assert not navego.sniff(head, path)
        assert not psins.sniff(head, path)


def test_damaged_files(tmp_path):
    """100 damaged files, not compressed so that damage is not found by a checksum."""
    run = drive(1.0)
    file = tmp_path / "a.mat"
    imu = {"t": run.imu.t, "fb": run.imu.accel, "wb": run.imu.gyro}
    scipy_io.savemat(file, {"imu": imu}, do_compression=False)
    check_damaged(file.read_bytes(), file, lambda: read(file, format="navego"), examples=100, memory_mb=20.0)
