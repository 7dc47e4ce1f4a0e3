"""NetCDF and HDF5: round trips to the bit, other libraries read what we write, claimed sizes, damaged files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import own, read, write

h5py = pytest.importorskip("h5py")
h5netcdf = pytest.importorskip("h5netcdf")


@pytest.mark.parametrize("compress", [False, True])
def test_round_trip_of_all_parts(aided, tmp_path, compress):
    """Every column of every part is equal to the last bit, and so is what stands beside them."""
    write(aided, tmp_path / "run.nc", compress=compress)
    back = read(tmp_path / "run.nc")
    mine, theirs = own.flatten(aided), own.flatten(back)
    assert {n: set(t) for n, t in mine.items()} == {n: set(t) for n, t in theirs.items()}
    for name, table in mine.items():
        for column, values in table.items():
            np.testing.assert_array_equal(theirs[name][column], values, err_msg=f"{name}.{column}")
    assert back.metadata.notes == aided.metadata.notes
    assert back.metadata.time == aided.metadata.time
    assert back.imu.kind == "rate"


def test_increments_stay_increments(run, tmp_path):
    write(replace(run, imu=replace(run.imu, kind="increment")), tmp_path / "run.nc")
    assert read(tmp_path / "run.nc").imu.kind == "increment"
    with h5netcdf.File(tmp_path / "run.nc") as file:
        assert file["imu"]["gx"].attrs["units"] == "rad"


def test_other_libraries_read_it(run, tmp_path):
    """h5netcdf sees dimensions, units and values; SciPy-like tools by plain HDF5."""
    write(run, tmp_path / "run.nc")
    with h5netcdf.File(tmp_path / "run.nc") as file:
        assert file["imu"].dimensions["t"].size == len(run.imu)
        assert file["imu"]["ax"].dimensions == ("t",)
        assert file["gnss"]["lat"].attrs["units"] == "rad"
        assert file.attrs["Conventions"] == "CF-1.10"
        np.testing.assert_array_equal(file["imu"]["gz"][:], run.imu.gyro[:, 2])


def test_arrays_of_other_files(still, tmp_path):
    """Datasets by name, groups with dots between."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["imu/time"] = still[:, 0]
        file["imu/acc"] = still[:, 1:4]
        file["imu/gyr"] = still[:, 4:7]
        file["label"] = "words are passed over"
    run = read(tmp_path / "log.h5", columns="t=imu.time,accel=imu.acc,gyro=imu.gyr", units="m/s^2,rad/s")
    np.testing.assert_array_equal(run.imu.accel, still[:, 1:4])
    assert read(tmp_path / "log.h5", units="m/s^2,rad/s").imu is not None  # these names are known
    with pytest.raises(InputError, match=r"imu\.acc"):
        read(tmp_path / "log.h5", columns="t=time,accel=acc,gyro=gyr", units="m/s^2,rad/s")


def test_matlab_7_3(still, tmp_path):
    """MATLAB 7.3 is HDF5 behind 512 bytes of text, with matrices on their sides."""
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["imu"] = still.T
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    data = path.read_bytes()
    path.write_bytes(text + data[len(text) :])
    run = read(path, columns="t,ax,ay,az,gx,gy,gz", units="m/s^2,rad/s")
    np.testing.assert_array_equal(run.imu.gyro, still[:, 4:7])


def test_a_claimed_size_is_not_allocated(run, tmp_path):
    """A dataset of 2.4 GB that takes no room in the file is refused, ours and of others."""
    write(run, tmp_path / "run.nc")
    with h5py.File(tmp_path / "run.nc", "r+") as file:
        for name in list(file["imu"]):
            del file["imu"][name]
        file["imu"].create_dataset("ax", shape=(300_000_000,), dtype="f8", chunks=(1024,))
        document = json.loads(file.attrs["schuler"])
        document["series"]["imu"]["rows"] = 300_000_000
        file.attrs["schuler"] = json.dumps(document)
    with pytest.raises(FileFormatError, match="ax claims"):
        read(tmp_path / "run.nc")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.create_dataset("accel", shape=(100_000_000, 3), dtype="f8", chunks=(1024, 3))
    with pytest.raises(FileFormatError, match="claim"):
        read(tmp_path / "other.h5", columns="accel=accel", rate=100, units="g,deg/s", allow="no-gyro")


def test_refused(run, tmp_path):
    path = tmp_path / "run.nc"
    write(run, path)
    with pytest.raises(InputError, match="needs no hints"):
        read(path, axes="FLU")
    with h5py.File(path, "r+") as file:
        document = json.loads(file.attrs["schuler"])
        file.attrs["schuler"] = json.dumps({**document, "format": "schuler/netcdf/9"})
    with pytest.raises(FileFormatError, match="update"):
        read(path)
    write(run, path)
    with h5py.File(path, "r+") as file:
        del file["gnss/lat"]
    with pytest.raises(FileFormatError, match="'lat' of gnss"):
        read(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(FileFormatError, match="complete"):
        read(path)
    with pytest.raises(InputError, match="compress"):
        write(run, tmp_path / "x.nc", compress="yes")
    assert not (tmp_path / "x.nc").exists()
