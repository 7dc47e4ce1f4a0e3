"""MATLAB files of NaveGo and PSINS, written by SciPy; the names in them seen without loading."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from format_drives import drive, same_trajectory

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import matlab
from schuler.recording.formats.matlab import variables
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
    matrices = variables(tmp_path / "a.mat")
    assert set(matrices) == {"imu1", "gnss", "ref", "note", "x"}
    assert matrices["imu1"].fields == ("t", "fb", "wb", "arw", "freq")
    assert matrices["x"].shape == (5, 7)
    assert matrices["x"].fields == ()


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
        with pytest.raises(FileFormatError, match=r"claims? 2000000000"):
            read(file, format="navego")


@pytest.mark.parametrize("head", [b"", b"MATLAB 5.0 MAT-file"])
def test_a_file_of_chance_takes_no_memory(tmp_path, head):
    """Errors keep what their functions held: a log that several readers try was in memory as often."""
    path = tmp_path / "a.mat"
    path.write_bytes(head + np.random.default_rng(0).bytes(4_000_000))
    tracemalloc.start()
    try:
        errors = []
        for _ in range(3):
            with pytest.raises(FileFormatError) as caught:
                matlab.load(path)
            errors.append(caught)
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


def test_an_empty_file_has_no_variables(tmp_path):
    (tmp_path / "a.mat").touch()
    assert matlab.load(tmp_path / "a.mat") == {}


@pytest.mark.realdata
def test_real_files_are_equal_to_scipys(shared_data):
    """Every array of every MATLAB file up to version 7 of the data folder, bit for bit as SciPy reads it."""
    seen = 0
    for path in shared_data.rglob("*.mat"):
        head = path.read_bytes()[:128]
        if head.startswith(b"MATLAB 7.3") or b"\x00" not in head:
            continue
        mine, theirs = matlab.load(path), scipy_io.loadmat(path)
        for name, value in theirs.items():
            if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
                np.testing.assert_array_equal(mine[name], value)
                seen += 1
    assert seen > 20


@pytest.mark.parametrize("compress", [True, False])
def test_arrays_of_every_type_are_equal_to_scipys(tmp_path, compress):
    """Types, shapes, texts, structures in structures; what holds no log is passed over."""
    rng = np.random.default_rng(7)
    arrays = {
        f"a_{t}": (100 * rng.standard_normal((3, 4))).astype(t)
        for t in ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]
    }
    more = {"three": rng.standard_normal((2, 3, 4)), "empty": np.empty((0, 3)), "yes": np.array([[True, False]])}
    other = {"text": "Größe", "cells": np.array([1, "a"], dtype=object), "z": np.array([1j]), "m": np.eye(3)}
    scipy_io.savemat(tmp_path / "a.mat", {**arrays, **more, **other, "s": {"x": 1.5, "in": {"v": np.arange(3.0)}}},
                     do_compression=compress)  # fmt: skip
    mine, theirs = matlab.load(tmp_path / "a.mat"), scipy_io.loadmat(tmp_path / "a.mat")
    for name in (*arrays, *more, "m"):
        np.testing.assert_array_equal(mine[name], theirs[name])
        assert mine[name].dtype == theirs[name].dtype
    assert mine["text"] == "Größe"
    assert "cells" not in mine
    assert "z" not in mine
    assert mine["s"]["x"].item() == 1.5
    np.testing.assert_array_equal(mine["s"]["in"]["v"], [[0.0, 1.0, 2.0]])
    assert matlab.load(tmp_path / "a.mat", {"m"}).keys() == {"m"}


@pytest.mark.parametrize("order", ["<", ">"])
def test_version_4(tmp_path, order):
    """Two matrices, one of whole numbers, in both byte orders; SciPy's own file of this version."""
    a, b = np.arange(6.0).reshape(2, 3), np.array([[1, -2]], dtype="i2")
    data = b""
    for name, array, kind in ((b"a\0", a, 0), (b"bb\0", b, 30)):
        mopt = kind + (1000 if order == ">" else 0)
        data += struct.pack(f"{order}5i", mopt, *array.shape, 0, len(name)) + name
        data += array.astype(array.dtype.newbyteorder(order)).tobytes(order="F")
    (tmp_path / "a.mat").write_bytes(data)
    made = matlab.load(tmp_path / "a.mat")
    np.testing.assert_array_equal(made["a"], a)
    np.testing.assert_array_equal(made["bb"], b)
    np.testing.assert_array_equal(scipy_io.loadmat(tmp_path / "a.mat")["bb"], b)
    (tmp_path / "a.mat").write_bytes(data[:-2])
    with pytest.raises(FileFormatError, match=r"byte 70 .claims the shape \(1, 2\) in 2 bytes"):
        matlab.load(tmp_path / "a.mat")


@pytest.mark.realdata
def test_other_files_are_not_claimed(shared_data):
    """The MATLAB files of the data folder are neither NaveGo's nor trajectories of PSINS."""
    from schuler.recording.formats import navego, psins

    for path in shared_data.rglob("*.mat"):
        head = path.read_bytes()[:200]
        assert not navego.sniff(head, path)
        assert not psins.sniff(head, path)
