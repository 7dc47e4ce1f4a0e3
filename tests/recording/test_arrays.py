"""MATLAB and NumPy files: which array is which, on its side or not, and what is refused as ambiguous."""

import zipfile

import numpy as np
import pytest
import scipy.io

from schuler.exceptions import FileFormatError
from schuler.recording.io import read

SI = {"units": "m/s^2,rad/s"}
COLUMNS = "t,ax,ay,az,gx,gy,gz"


@pytest.fixture(params=[".mat", ".npz"])
def archive(request, tmp_path):
    """Write named arrays to either kind of file."""

    def write(**arrays):
        path = tmp_path / f"log{request.param}"
        if request.param == ".mat":
            scipy.io.savemat(path, arrays)
        else:
            np.savez(path, **arrays)
        return path

    return write


def check(recording, still):
    np.testing.assert_array_equal(recording.imu.t, still[:, 0])
    np.testing.assert_array_equal(recording.imu.accel, still[:, 1:4])
    np.testing.assert_array_equal(recording.imu.gyro, still[:, 4:7])


def test_a_matrix_is_read_upright_or_on_its_side(archive, still):
    for matrix in (still, still.T):
        check(read(archive(imu=matrix), columns=COLUMNS, **SI), still)
        check(read(archive(data=matrix, gt=np.zeros((300, 3))), columns=COLUMNS, variable="data", **SI), still)
        check(read(archive(data=np.vstack((matrix.T, still.T)) if matrix is still else np.hstack((still, still))),
                   columns=COLUMNS + ",*", **SI), still)  # fmt: skip


def test_the_order_of_a_matrix_has_to_be_said(archive, still):
    with pytest.raises(FileFormatError, match=r"the order of the columns of imu is not known.*imu \(300 x 7\)"):
        read(archive(imu=still), **SI)
    with pytest.raises(FileFormatError, match="the order of the columns of data is not known"):
        read(archive(data=still), variable="data", **SI)


def test_time_may_lie_in_an_array_of_its_own(archive, still):
    check(read(archive(imu=still[:, 1:], ts=still[None, :, 0]), columns=COLUMNS[2:], **SI), still)
    check(read(archive(imu=still[:, 1:], clock=still[:, :1]), columns="t=clock," + COLUMNS[2:], **SI), still)
    with pytest.raises(FileFormatError, match="there is no time column: name one with columns"):
        read(archive(imu=still[:, 1:]), columns=COLUMNS[2:], **SI)
    r = read(archive(imu=still[:, 1:], ts=np.zeros(300)), columns=COLUMNS[2:], rate=100, **SI)
    np.testing.assert_allclose(r.imu.t, still[:, 0], atol=1e-12)  # rounding


def test_separate_arrays_are_known_by_their_names(archive, still):
    check(read(archive(accel=still[:, 1:4], gyro=still[:, 4:7].T, t=still[:, 0]), **SI), still)
    r = read(archive(f_b=still[:, 1:4], omega=still[:, 4:7], time=still[:, 0], other=np.ones((2, 2))), **SI)
    check(r, still)
    assert "accel was taken from the array f_b." in r.metadata.notes
    mapped = "t=stamp,accel=xl,gyro=ars"
    check(read(archive(xl=still[:, 1:4], ars=still[:, 4:7], stamp=still[:, 0]), columns=mapped, **SI), still)


def test_structures_are_looked_into(tmp_path, still):
    path = tmp_path / "log.mat"
    scipy.io.savemat(
        path, {"imu": {"fb": still[:, 1:4], "wb": still[:, 4:7], "t": still[:, 0], "name": "x"}, "n": "text"}
    )
    check(read(path, **SI), still)
    check(read(path, columns="t=imu.t,accel=imu.fb,gyro=imu.wb", **SI), still)


@pytest.mark.parametrize(
    ("arrays", "hints", "message"),
    [
        ({"a": (5, 7), "b": (9, 7)}, {"columns": COLUMNS}, r"a, b have as many: say variable=.* a \(5 x 7\), b"),
        ({"a": (5, 6)}, {"columns": COLUMNS}, "columns names 7 columns, and no array has as many"),
        ({"a": (7, 7)}, {"columns": COLUMNS}, r"a has the shape \(7, 7\), which does not tell its 7 columns"),
        ({"a": (5, 7)}, {"columns": COLUMNS, "variable": "b"}, "there is no array 'b'; the file holds a"),
        ({"array": (5, 3)}, {}, "of three columns it is not known what they are: say columns='gx,gy,gz'"),
        ({"accel": (5, 3)}, {}, "no array of three columns is called gyro: say columns="),
        ({"accel": (5, 3), "acc": (5, 3), "gyro": (5, 3)}, {}, "accel may be any of accel, acc"),
        ({"accel": (3, 3), "gyro": (3, 3)}, {}, r"accel: expected N x 3 or 3 x N values, got the shape \(3, 3\)"),
        ({"accel": (5, 3), "gyro": (6, 3), "t": (5,)}, {}, "expected columns of one length"),
        ({"a": (5, 3)}, {"columns": "t=a,accel=a,gyro=a"}, r"t=a: expected a vector, got the shape \(5, 3\)"),
        ({"a": (5, 6), "k": (5,)}, {"columns": COLUMNS[2:], "scale": "k"}, "k holds 5 factors for 6 columns of a"),
        ({"a": (5, 6)}, {"columns": COLUMNS[2:], "scale": "lsb"}, "there is no array 'lsb'"),
        ({"a": (2, 2, 2)}, {}, "there are no arrays of real numbers with one or two axes"),
    ],
)  # fmt: skip
def test_what_is_ambiguous_is_refused_with_a_list(tmp_path, arrays, hints, message):
    path = tmp_path / "log.npz"
    np.savez(path, **{name: np.zeros(shape) for name, shape in arrays.items()})
    with pytest.raises(FileFormatError, match=message):
        read(path, **hints, **SI)


def test_an_archive_of_logs_is_named_as_one(tmp_path):
    """Phones export folders as ZIP, which NumPy's archives are, too."""
    path = tmp_path / "walk.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(6):
            archive.writestr(f"log/Sensor{k}.csv", "time,x,y,z\n0,1,2,3\n")
    message = "a ZIP archive of 'log/Sensor0.csv', .* and 2 more, not of arrays: unpack it, and give the folder"
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_counts_times_an_array_of_factors(archive, still):
    lsb = np.array([0.01, 0.01, 0.01, 0.00025, 0.00025, 0.00025])
    values = np.column_stack((np.rad2deg(still[:, 4:7]), still[:, 1:4] / 9.80665))
    counts = np.round(values / lsb).astype(np.int16)
    hints = {"columns": "gx,gy,gz,ax,ay,az", "units": "g,deg/s", "rate": 100}
    r = read(archive(counts=counts, lsb=lsb), scale="lsb", **hints)
    np.testing.assert_allclose(r.imu.accel, counts[:, 3:] * lsb[3:] * 9.80665, rtol=1e-14)  # rounding
    assert "The columns of counts were multiplied by lsb." in r.metadata.notes


def test_a_single_array(tmp_path, still):
    path = tmp_path / "log.npy"
    np.save(path, still)
    check(read(path, columns=COLUMNS, **SI), still)
    still[7, 2] = np.nan
    np.save(path, still)
    with pytest.raises(FileFormatError, match=r"log.npy: row 8: ay is nan, no number"):
        read(path, columns=COLUMNS, **SI)


@pytest.mark.skipif(np.finfo(np.longdouble).max == np.finfo(np.float64).max, reason="no wider floats on this machine")
def test_numbers_beyond_double_precision_are_refused_with_their_row(tmp_path, still):
    wide = still.astype(np.longdouble)
    np.save(tmp_path / "wide.npy", wide)
    check(read(tmp_path / "wide.npy", columns=COLUMNS, **SI), still)
    wide[4, 2] = np.longdouble("1e400")
    np.save(tmp_path / "wide.npy", wide)
    with pytest.raises(FileFormatError, match="row 5"):
        read(tmp_path / "wide.npy", columns=COLUMNS, **SI)


def test_matlab_text_is_read_as_text(tmp_path, still):
    path = tmp_path / "log.mat"
    np.savetxt(path, still, fmt="%16.8e")
    np.testing.assert_allclose(read(path, columns=COLUMNS, **SI).imu.accel, still[:, 1:4], rtol=1e-8)  # printed digits


def test_a_damaged_file_of_version_7_3_is_refused(tmp_path):
    path = tmp_path / "log.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n" + b"\x00" * 100)
    with pytest.raises(FileFormatError, match="cannot be read as HDF5"):
        read(path)


@pytest.mark.parametrize("suffix", [".mat", ".npz", ".npy"])
def test_damaged_archives_are_errors_of_ours(tmp_path, still, suffix, rng):
    path = tmp_path / f"log{suffix}"
    {".mat": lambda: scipy.io.savemat(path, {"imu": still}), ".npz": lambda: np.savez(path, imu=still),
     ".npy": lambda: np.save(path, still)}[suffix]()  # fmt: skip
    whole = path.read_bytes()
    for _ in range(60):
        data = bytearray(whole[: rng.integers(8, len(whole))])
        for k in rng.integers(6, min(len(data), 400), 3):
            data[k] = rng.integers(256)
        path.write_bytes(bytes(data))
        with pytest.raises(FileFormatError):
            read(path, columns=COLUMNS + ",-", **SI)  # one column too many, lest a harmless change be read


def test_objects_are_not_unpickled(tmp_path):
    path = tmp_path / "log.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FileFormatError, match="must be complete and hold plain numbers"):
        read(path)
