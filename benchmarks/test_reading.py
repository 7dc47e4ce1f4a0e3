"""Reading a million rows of each common layout: files to recordings, beside what other programs make of the same file.

Ours includes everything that is done to a log: units, axes, checks against gravity, gaps and jitter, the file's hash.
The peers only make tables of numbers. "Epochs" are rows. All may use every core.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import schuler
from schuler import rotation
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase

ROWS = 1_000_000
FEW = 100_000  # for the peers that take ten seconds for a million
RATE = 200.0
POS = (
    "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
    "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) "
    "age(s)  ratio\n"
)


@pytest.fixture(scope="module")
def drive():
    """IMU and reference of 5000 s at 200 Hz, at rest for the first ten."""
    rng = np.random.default_rng(0)
    k = np.arange(ROWS)[:, None]
    t = 200_000.0 + k[:, 0] / RATE
    moving = k >= 10 * RATE
    gyro = moving * 0.02 * np.sin(k * [1e-3, 2e-3, 3e-3]) + 1e-3 * rng.standard_normal((ROWS, 3))
    accel = [0.0, 0.0, -9.81] + moving * 0.3 * np.sin(k * [2e-3, 1e-3, 3e-3]) + 0.02 * rng.standard_normal((ROWS, 3))
    a = k[:, 0] / RATE * 0.01
    llh = np.column_stack((0.82 + 1e-4 * np.sin(a), 0.2 + 1e-4 * np.cos(a), 500.0 + 5.0 * np.sin(a)))
    v_n = np.column_stack((6.37 * np.cos(a), -4.35 * np.sin(a), -0.05 * np.cos(a)))
    C_nb = rotation.dcm_from_rpy(np.column_stack((0.01 * np.sin(a), 0.02 * np.cos(a), a % 6.28 - 3.14)))
    metadata = Metadata(name="bench", time=TimeBase("gps", 2374 * 604_800.0))
    reference = Trajectory.from_geodetic(t, llh, v_n, C_nb)
    return Recording(imu=ImuSeries(t, gyro, accel), reference=reference, metadata=metadata)


@pytest.fixture(scope="module")
def files(drive, tmp_path_factory):
    """Each layout, and the beginning of the generic text for slow peers."""
    folder = tmp_path_factory.mktemp("reading")
    imu = Recording(imu=drive.imu, metadata=drive.metadata)
    reference = Recording(reference=drive.reference, metadata=drive.metadata)
    paths = {
        "csv": folder / "log.csv",
        "few": folder / "few.csv",
        "pos": folder / "rover.pos",
        "EuRoC": folder / "euroc",
        "KF-GINS": folder / "imu.txt",
        "TUM": folder / "path.txt",
        "IMR": folder / "log.imr",
        "SBET": folder / "sbet_log.out",
        "NetCDF": folder / "log.nc",
        "Parquet": folder / "log.parquet",
    }
    schuler.write(imu, paths["EuRoC"], format="euroc")
    schuler.write(imu, paths["KF-GINS"], format="kf_gins")
    schuler.write(reference, paths["TUM"], format="tum")
    schuler.write(imu, paths["IMR"])
    schuler.write(reference, paths["SBET"], format="sbet")
    for name in ("NetCDF", "Parquet"):
        schuler.write(imu, paths[name])
    rows = np.column_stack((drive.imu.t, drive.imu.gyro, drive.imu.accel))
    fmt = "%.6f" + ",%.10f" * 3 + ",%.9f" * 3 + "\n"
    for name, n in (("csv", ROWS), ("few", FEW)):
        with paths[name].open("w") as stream:
            stream.write("t,gx,gy,gz,ax,ay,az\n")
            stream.writelines(fmt % tuple(row) for row in rows[:n].tolist())
    with paths["pos"].open("w") as stream:
        stream.write(POS)
        stamps = (
            f"2025/07/{day:02d} {hour:02d}:{minute:02d}:{second:02d}.{part}00"
            for day, hour, minute, second, part in itertools.product(*map(range, (6, 24, 60, 60, 10)))
            if day > 0
        )
        tail = "   1  12   0.0101   0.0093   0.0210   0.0012  -0.0020   0.0031   0.80    3.1\n"
        for stamp, (lat, lon, h) in zip(stamps, np.degrees(drive.reference.llh).tolist(), strict=False):
            stream.write(f"{stamp} {lat:14.9f} {lon:14.9f} {np.radians(h):10.4f}{tail}")
    return paths


HINTS = {"csv": {"units": "m/s^2,rad/s"}, "KF-GINS": {"format": "kf_gins"}}
SERIES = {"pos": "gnss", "TUM": "reference", "SBET": "reference"}


@pytest.mark.parametrize("name", ["csv", "EuRoC", "KF-GINS", "TUM", "pos", "IMR", "SBET", "NetCDF", "Parquet"])
def test_read(benchmark, files, name):
    benchmark.group = f"reading {name}"
    benchmark.extra_info["epochs"] = ROWS
    read = benchmark.pedantic(schuler.read, args=(files[name],), kwargs=HINTS.get(name, {}), rounds=5, warmup_rounds=1)
    assert len(getattr(read, SERIES.get(name, "imu"))) >= ROWS - 1  # a rate makes one increment less


def peer_of(benchmark, name, read, *args, rows=ROWS, **kwargs):
    benchmark.group = f"reading {name}"
    benchmark.extra_info["epochs"] = rows
    return benchmark.pedantic(read, args=args, kwargs=kwargs, rounds=3)


TABLES = {
    "csv": {},
    "EuRoC": {"comment": "#", "header": None},
    "KF-GINS": {"sep": r"\s+", "header": None},
    "TUM": {"sep": r"\s+", "header": None, "comment": "#"},
    "pos": {"sep": r"\s+", "header": None, "comment": "%"},
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("precision", ["fast", "round_trip"])
def test_peer_pandas(benchmark, files, name, precision):
    """The default is up to an ulp off; round_trip gives the nearest double, as we do."""
    pandas = pytest.importorskip("pandas", reason="the peer is in the bench extra: pip install 'schuler[bench]'")
    path = files[name] / "mav0/imu0/data.csv" if name == "EuRoC" else files[name]
    options = {} if precision == "fast" else {"float_precision": "round_trip"}
    table = peer_of(benchmark, name, pandas.read_csv, path, **TABLES[name], **options)
    assert len(table) >= ROWS - 1


@pytest.mark.parametrize("name", ["csv", "EuRoC"])
def test_peer_pyarrow(benchmark, files, name):
    csv = pytest.importorskip("pyarrow.csv", reason="the peer is in the data extra: pip install 'schuler[data]'")
    path = files[name] / "mav0/imu0/data.csv" if name == "EuRoC" else files[name]
    assert len(peer_of(benchmark, name, csv.read_csv, path)) == ROWS


def test_peer_numpy(benchmark, files):
    table = peer_of(benchmark, "csv", np.loadtxt, files["few"], rows=FEW, delimiter=",", skiprows=1)
    assert table.shape == (FEW, 7)


@pytest.mark.parametrize(("name", "dtype"), [("SBET", "<f8"), ("IMR", "<f8, 6<i4")])
def test_peer_numpy_fromfile(benchmark, files, name, dtype):
    """The bytes as they are, no number looked at: what memory allows."""
    peer_of(benchmark, name, np.fromfile, files[name], dtype=dtype)


def test_peer_xarray(benchmark, files):
    xarray = pytest.importorskip("xarray", reason="the peer is in the frames extra: pip install 'schuler[frames]'")
    pytest.importorskip("h5netcdf")
    table = peer_of(benchmark, "NetCDF", lambda path: xarray.load_dataset(path, group="imu"), files["NetCDF"])
    assert table.sizes["t"] == ROWS


def test_peer_pyarrow_parquet(benchmark, files):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the peer is in the data extra")
    assert len(peer_of(benchmark, "Parquet", parquet.read_table, files["Parquet"])) == ROWS


@pytest.mark.parametrize("name", ["NetCDF", "Parquet"])
def test_peer_copy_of_memory(benchmark, name):
    """The same seven columns, copied from memory to memory."""
    peer_of(benchmark, name, np.ones((ROWS, 7)).copy)
