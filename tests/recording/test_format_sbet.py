"""SBET files: records by hand, wander angles and axes of other programs, round trips, what is refused."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.sbet import write_accuracy
from schuler.recording.io import read, write

TIME = f"gps-tow:{WEEK}"


def records(wander=0.0, axes="NED", n=500):
    """A drive as records packed one by one, in wander-azimuth axes turned by ``wander`` or in other axes."""
    run = drive()
    T = run.reference
    out = b""
    for k in range(n):
        vn, ve, vd = T.v_eb_n[k]
        c, s = np.cos(wander), np.sin(wander)
        v = {"NED": (c * vn - s * ve, s * vn + c * ve, vd), "ENU": (ve, vn, -vd), "plain": (vn, ve, vd)}[axes]
        roll, pitch, yaw = T.rpy_nb[k]
        out += struct.pack(
            "<17d", T.t[k], *T.llh[k], *v, roll, pitch, yaw + wander, wander, *run.imu.accel[k], *run.imu.gyro[k]
        )
    return out, run


@pytest.mark.parametrize(
    ("wander", "axes"), [(0.0, "NED"), (0.7, "NED"), (-2.0, "NED"), (0.7, "plain"), (0.0, "ENU"), (0.5, "ENU")]
)
def test_axes_show_in_the_positions(tmp_path, wander, axes):
    """Whatever axes the velocities are in, they come out north, east, down, and a note names the axes."""
    data, run = records(wander, axes)
    (tmp_path / "sbet_a.out").write_bytes(data)
    back = read(tmp_path / "sbet_a.out", time=TIME)
    same_trajectory(back.reference, run.reference.between(0, run.reference.t[499]), t=1e-9, r=1e-8, v=1e-11, q=1e-12)
    word = {"NED": "minus the wander", "plain": "north, east", "ENU": "east, north"}[axes]
    assert any(word in note and ("z up" in note) == (axes == "ENU") for note in back.metadata.notes)


def test_at_rest_nothing_is_claimed(tmp_path):
    data, _ = records(0.3, n=150)
    (tmp_path / "x.sbet").write_bytes(data)
    assert any("hardly moves" in note for note in read(tmp_path / "x.sbet").metadata.notes)


def test_accuracies_beside(tmp_path):
    data, run = records()
    (tmp_path / "sbet_a.out").write_bytes(data)
    t = run.reference.t[:500:10]
    ones = np.ones((len(t), 3))
    write_accuracy(
        tmp_path / "smrmsg_a.out",
        np.append(t, t[-1] + 1),
        0.02 * np.ones((51, 3)),
        0.01 * np.ones((51, 3)),
        np.radians(0.5) * np.ones((51, 3)),
    )
    note = next(n for n in read(tmp_path / "sbet_a.out").metadata.notes if "smrmsg_a.out" in n)
    assert "30.00, 30.00, 30.00 arcmin" in note
    fixes = read(tmp_path / "sbet_a.out", series="gnss").gnss
    np.testing.assert_allclose(np.sqrt(np.diag(fixes.cov_r_n[7])), 0.02 * ones[0])
    with pytest.raises(FileFormatError, match="read the sbet"):
        read(tmp_path / "smrmsg_a.out")


def test_without_accuracies_fixes_need_them(tmp_path):
    (tmp_path / "sbet_a.out").write_bytes(records()[0])
    with pytest.raises(InputError, match="sigma"):
        read(tmp_path / "sbet_a.out", series="gnss")


def test_cut_off(tmp_path):
    data, _ = records(n=20)
    (tmp_path / "a.out").write_bytes(data[:-50])
    with pytest.raises(FileFormatError, match="cut off"):
        read(tmp_path / "a.out")
    assert len(read(tmp_path / "a.out", allow="truncated").reference) == 19


def test_only_a_whole_reference_is_written(tmp_path):
    run = drive()
    for other in (replace(run, reference=None), replace(run, reference=replace(run.reference, q_eb=None))):
        with pytest.raises(InputError):
            write(other, tmp_path / "x.sbet")
    assert list(tmp_path.iterdir()) == []


def test_other_binary_files_are_not_claimed(tmp_path):
    (tmp_path / "x.bin").write_bytes(np.random.default_rng(1).bytes(136 * 10))
    with pytest.raises(FileFormatError, match="binary"):
        read(tmp_path / "x.bin")
