"""One small log of every format that is read, for the tests that damage logs or run the cookbook on them.

Binary logs of receivers and autopilots come from the encoders of the tests, which share no code with the readers.
"""

import functools
import gzip
import importlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import encode_vectornav
import numpy as np
import places
from format_drives import WEEK, drive

from schuler.recording import Recording, Trajectory
from schuler.recording.io import write

#: Formats that ``recording.io`` reads itself, beside those of the registry.
OLDER = (
    "text", "csv", "parquet", "matlab4", "matlab5", "npy", "npz", "pos", "ubx", "nmea", "rinex_observations",
    "rinex_navigation", "rinex_gzip", "hatanaka", "psins_imu", "psins_ranges", "instinct_csv", "folder",
)  # fmt: skip
TABLE = {"columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s"}


@dataclass(frozen=True)
class Sample:
    """A log: what is opened, with which hints, and which files of it are damaged."""

    path: Path
    hints: dict[str, Any] = field(default_factory=dict)
    files: tuple[Path, ...] = ()

    @property
    def damaged(self) -> tuple[Path, ...]:
        return self.files or (self.path,)


def module(name: str) -> ModuleType:
    """A helper module, or a module of the tests of recordings, for the logs it makes."""
    paths = list((places.TESTS / "recording").rglob(f"{name}.py"))
    return places.module(paths[0].relative_to(places.TESTS).as_posix()) if paths else importlib.import_module(name)


@functools.cache
def run(seconds: float = 2.0, rate: float = 50.0, kind: str = "rate") -> Recording:
    """A few seconds of the test drive."""
    return drive(seconds, rate, kind=kind)


def first_lines(path: Path, n: int) -> Path:
    path.write_text("\n".join(path.read_text().splitlines()[:n]) + "\n")
    return path


def mcap(folder: Path) -> Sample:
    module("test_rosbag").json_mcap(folder / "log.mcap", n=12, compression="zstd")
    return Sample(folder / "log.mcap", {"allow": "norm"})


def mcap_ros2(folder: Path) -> Sample:
    write(run(1.0), folder / "log.mcap")
    return Sample(folder / "log.mcap", {"allow": "norm"})


def bag1(folder: Path, compression: str = "none", n: int = 12) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    made, store = module("test_rosbag"), get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(folder / "log.bag")
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k in range(n):
            t = 1_700_000_000.0 + 0.01 * k
            raw = store.serialize_ros1(made.imu_fields(t, store, "ros1"), "sensor_msgs/msg/Imu")
            writer.write(connection, round(t * 1e9), raw)
    return folder / "log.bag"


def rosbag(folder: Path) -> Sample:
    return Sample(bag1(folder), {"allow": "norm"})


def rosbag_lz4(folder: Path) -> Sample:
    return Sample(bag1(folder, "lz4"), {"allow": "norm"})


def rosbag_bz2(folder: Path) -> Sample:
    return Sample(bag1(folder, "bz2"), {"allow": "norm"})


def rosbag_ros2(folder: Path) -> Sample:
    files = write(run(1.0), folder / "log.rosbag2")
    return Sample(folder / "log.rosbag2", {"allow": "norm"}, tuple(p for p in files if p.is_file()))


def px4(folder: Path) -> Sample:
    (folder / "log.ulg").write_bytes(module("test_px4").flight(seconds=0.6, imu=("sensor_combined", "vehicle_imu")))
    return Sample(folder / "log.ulg", {"allow": "norm", "sigma_height": 1.0, "streams": "imu=sensor_combined:0"})


def ardupilot(folder: Path) -> Sample:
    made = module("test_ardupilot")
    (folder / "log.bin").write_bytes(made.encoder.log(made.messages(seconds=1.0), made.NAMES))
    return Sample(folder / "log.bin", {"allow": "norm", "sigma_height": 1.0})


def novatel(folder: Path) -> Sample:
    return Sample(module("test_format_novatel").log_of(run(1.0, 125.0, "increment"), folder / "log.gps"), NORM)


def sbf(folder: Path) -> Sample:
    return Sample(module("test_format_sbf").log_of(run(), folder / "log.sbf"), NORM)


def vectornav(folder: Path) -> Sample:
    return Sample(module("test_format_vectornav").log_of(run(), folder / "vn.bin"), NORM)


def vectornav_lines(folder: Path) -> Sample:
    (folder / "vn.txt").write_bytes(
        b"".join(
            encode_vectornav.line("VNIMU,+00.2,-00.1,+00.4,+00.1,-00.2,-09.79,+00.01,+00.02,-00.03,+21.5,+101.3")
            for _ in range(60)
        )
    )
    return Sample(folder / "vn.txt", {"rate": 50.0, "allow": "norm"})


def vectornav_csv(folder: Path) -> Sample:
    rows = imu_rows()
    names = [f"{name}{axis}" for name in ("UncompAcc", "UncompGyro") for axis in "XYZ"]
    lines = [",".join(["TimeStartup", "GpsTow", "GpsWeek", *names])]
    lines += [",".join(map(str, [7 * 10**9 + 20_000_000 * k, round(row[0] * 1e9), WEEK, *row[1:].tolist()]))
              for k, row in enumerate(rows)]  # fmt: skip
    (folder / "vn.csv").write_text("\n".join(lines) + "\n")
    return Sample(folder / "vn.csv", NORM)


def xsens_text(folder: Path) -> Sample:
    rows = imu_rows() * (1.0, 1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
    names = ["PacketCounter", "SampleTimeFine", *(f"{name}_{axis}" for name in ("Acc", "Gyr") for axis in "XYZ")]
    lines = ["// Start Time: Unknown", "// Update Rate: 50.0Hz", "// Firmware Version: 4.0.2", "\t".join(names)]
    lines += ["\t".join(map(str, [k, 200 * k, *row[1:].tolist()])) for k, row in enumerate(rows)]
    (folder / "MT_01.txt").write_text("\n".join(lines) + "\n")
    return Sample(folder / "MT_01.txt", NORM)


def xsens(folder: Path) -> Sample:
    return Sample(module("test_format_xsens").log_of(run(1.0), folder / "log.mtb"), NORM)


def sbg(folder: Path) -> Sample:
    return Sample(module("test_format_sbg").log_of(run(), folder / "log.bin"), NORM)


def euroc(folder: Path) -> Sample:
    module("test_format_euroc").data_set(folder / "set", n=60)
    names = ("imu0", "state_groundtruth_estimate0")
    files = tuple(folder / "set" / "mav0" / name / "data.csv" for name in names)
    return Sample(folder / "set", {"axes": "URF", "origin": "47,8,400", "allow": "norm"}, files)


def kitti(folder: Path) -> Sample:
    made = module("test_format_kitti").kitti(folder / "drive", n=12)
    files = (made / "oxts" / "timestamps.txt", made / "oxts" / "data" / "0000000005.txt")
    return Sample(made, NORM, files)


def kf_gins(folder: Path) -> Sample:
    made = module("test_format_kf_gins")
    for name, text in (("imu.txt", made.IMU[:4000]), ("gnss.txt", made.FIXES), ("truth.nav", made.RESULTS)):
        (folder / name).write_text(text[: text.rfind("\n") + 1])
    files = tuple(folder / name for name in ("imu.txt", "gnss.txt", "truth.nav"))
    return Sample(folder, {"format": "kf_gins", "allow": "norm"}, files)


def sbet(folder: Path) -> Sample:
    write(run(), folder / "mission.sbet")
    return Sample(folder / "mission.sbet", {"allow": "truncated"})


def netcdf(folder: Path) -> Sample:
    write(replace(run(), reference=None), folder / "run.nc")
    return Sample(folder / "run.nc")


def netcdf_packed(folder: Path) -> Sample:
    write(replace(run(), reference=None), folder / "run.nc", compress=True)
    return Sample(folder / "run.nc")


def hdf5(folder: Path) -> Sample:
    import h5py

    imu = run().imu
    assert imu is not None
    with h5py.File(folder / "log.h5", "w") as file:
        for name, values in {"imu/time": imu.t, "imu/acc": imu.accel, "imu/gyr": imu.gyro}.items():
            file.create_dataset(name, data=np.asarray(values), compression="gzip")
    return Sample(folder / "log.h5", {"units": "m/s^2,rad/s", "allow": "norm"})


def matlab73(folder: Path) -> Sample:
    import h5py

    imu = run().imu
    assert imu is not None
    path = folder / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["imu"] = np.column_stack((imu.t, imu.accel, imu.gyro)).T
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(text + path.read_bytes()[len(text) :])
    return Sample(path, TABLE | NORM)


def tum(folder: Path) -> Sample:
    made = module("test_format_tum_gpx")
    (folder / "a.txt").write_text(made.HEAD + made.ROWS)
    return Sample(folder / "a.txt", {"origin": "47,8,400"})


def solution(folder: Path) -> Sample:
    return Sample(module("test_format_solution").solution(folder / "solution.parquet", run()))


def navego(folder: Path) -> Sample:
    imu = run().imu
    assert imu is not None
    data = {"imu": {"t": imu.t[:, None], "fb": imu.accel, "wb": imu.gyro}}
    import scipy.io

    scipy.io.savemat(folder / "a.mat", data, do_compression=False)
    return Sample(folder / "a.mat", {"format": "navego", "allow": "norm"})


def psins(folder: Path) -> Sample:
    import scipy.io

    made = run(kind="increment").imu
    assert made is not None
    imu = np.column_stack((made.gyro, made.accel, made.t))
    scipy.io.savemat(folder / "a.mat", {"trj": {"imu": imu, "ts": 0.02}})
    return Sample(folder / "a.mat", {"format": "psins", "allow": "norm"})


def gnss_ins_sim(folder: Path) -> Sample:
    module("test_format_simulators").gnss_ins_sim(folder)
    for path in folder.iterdir():
        first_lines(path, 40)
    n = min(len(path.read_text().splitlines()) for path in folder.glob("gps*.csv"))
    for path in folder.glob("gps*.csv"):
        first_lines(path, n)
    files = tuple(folder / name for name in ("gyro-0.csv", "time.csv", "gps-0.csv", "ref_pos.csv", "ref_att_euler.csv"))
    return Sample(folder, {"sigma": "1,1,2,0.1,0.1,0.1", "allow": "norm"}, files)


def comma2k19(folder: Path) -> Sample:
    module("test_format_simulators").comma2k19(folder)
    names = ("processed_log/IMU/gyro/t", "processed_log/IMU/accelerometer/value", "global_pose/frame_positions")
    return Sample(folder, {"sigma": "5,5,10", "allow": "norm"}, tuple(folder / name for name in names))


def imr(folder: Path) -> Sample:
    (folder / "a.imr").write_bytes(module("test_format_waypoint").imr(n=40))
    return Sample(folder / "a.imr", {"allow": "norm"})


def waypoint(folder: Path) -> Sample:
    module("test_format_waypoint").export(folder / "a.txt")
    return Sample(first_lines(folder / "a.txt", 20))


def android(folder: Path) -> Sample:
    module("test_format_phones").gnss_logger(folder / "log.txt", n=60)
    return Sample(folder / "log.txt", {"allow": "norm"})


def sensor_logger(folder: Path) -> Sample:
    module("test_format_phones").sensor_logger(folder)
    for path in folder.iterdir():
        first_lines(path, 40)
    names = ("Gyroscope.csv", "TotalAcceleration.csv", "Location.csv")
    return Sample(folder, {"allow": "norm"}, tuple(folder / name for name in names))


def phyphox(folder: Path) -> Sample:
    module("test_format_tracks").phyphox(folder, n=60)
    return Sample(folder, {"allow": "norm"}, tuple(sorted(folder.rglob("*.csv"))))


def gpx(folder: Path) -> Sample:
    path = folder / "a.gpx"
    path.write_text(module("test_format_tracks").gpx_text(["<speed>11.1</speed><course>0</course><hdop>2</hdop>"] * 30))
    return Sample(path)


def kml(folder: Path) -> Sample:
    path = folder / "a.kml"
    path.write_text(module("test_format_tracks").kml_text(30))
    return Sample(path)


def oan(folder: Path) -> Sample:
    module("test_format_phones").oan(folder)
    for path in folder.iterdir():
        first_lines(path, 40)
    return Sample(folder, {"allow": "norm"}, tuple(sorted(folder.iterdir())))


def imu_rows() -> np.ndarray:
    imu = run().imu
    assert imu is not None
    return np.column_stack((imu.t, imu.accel, imu.gyro))


def text(folder: Path) -> Sample:
    np.savetxt(folder / "log.txt", imu_rows(), fmt="%.9f", header="time acc gyr")
    return Sample(folder / "log.txt", TABLE | NORM)


def csv(folder: Path) -> Sample:
    files = write(replace(run(1.0), reference=None), folder / "run.csv")
    return Sample(folder / "run.csv", {}, tuple(files))


def parquet(folder: Path) -> Sample:
    write(run(1.0), folder / "run.parquet")
    return Sample(folder / "run.parquet")


def parquet_foreign(folder: Path) -> Sample:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = imu_rows()
    names = ("t", "ax", "ay", "az", "gx", "gy", "gz")
    pq.write_table(pa.table({name: rows[:, k] for k, name in enumerate(names)}), folder / "log.parquet")
    return Sample(folder / "log.parquet", TABLE | NORM)


def matlab(folder: Path, version: str) -> Sample:
    import scipy.io

    scipy.io.savemat(folder / "log.mat", {"imu": imu_rows()}, format=version)
    return Sample(folder / "log.mat", TABLE | NORM)


def matlab4(folder: Path) -> Sample:
    return matlab(folder, "4")


def matlab5(folder: Path) -> Sample:
    return matlab(folder, "5")


def npy(folder: Path) -> Sample:
    np.save(folder / "log.npy", imu_rows())
    return Sample(folder / "log.npy", TABLE | NORM)


def npz(folder: Path) -> Sample:
    np.savez_compressed(folder / "log.npz", imu=imu_rows())
    return Sample(folder / "log.npz", TABLE | NORM)


def pos(folder: Path) -> Sample:
    write(run(12.0), folder / "rover.pos")
    return Sample(folder / "rover.pos")


def ubx(folder: Path) -> Sample:
    made = module("test_ubx")
    pieces = [
        made.pvt(itow=408_640_000 + 1000 * k, when=(2025, 8, 28, 17, 30, 22 + k))
        + made.rawx(408_640.0 + k, made.measurement(), made.measurement(sv=7, pr=2.3e7))
        for k in range(8)
    ]
    (folder / "rover.ubx").write_bytes(b"".join(pieces) + made.GGA)
    return Sample(folder / "rover.ubx")


def nmea(folder: Path) -> Sample:
    made = module("test_nmea")
    times = [f"1730{k:02d}.00" for k in range(20)]
    (folder / "rover.nmea").write_text(
        "".join(made.rmc(time=t) + made.gga(time=t) + made.gst(time=t) + made.gsa() for t in times), newline=""
    )
    return Sample(folder / "rover.nmea")


def rinex_observations(folder: Path) -> Sample:
    (folder / "rover.obs").write_text(module("test_dispatch_satellites").observations())
    return Sample(folder / "rover.obs")


def rinex_navigation(folder: Path) -> Sample:
    made = module("test_dispatch_satellites")
    (folder / "brdc.nav").write_text(made.GLONASS + made.gps_message(5) + made.glonass_message(5, 1))
    return Sample(folder / "brdc.nav")


def rinex_gzip(folder: Path) -> Sample:
    data = module("test_dispatch_satellites").observations(n=30).encode()
    (folder / "rover.obs.gz").write_bytes(gzip.compress(data))
    return Sample(folder / "rover.obs.gz")


def hatanaka(folder: Path) -> Sample:
    from hatanaka import rnx2crx

    text = module("test_rinex_observation").V3
    (folder / "rover.crx").write_bytes(rnx2crx(text.encode("latin-1")))
    return Sample(folder / "rover.crx")


def psins_imu(folder: Path) -> Sample:
    (folder / "log.imu").write_text(
        module("test_psins_ranges").HEADER + "10 20 30 1 2 125\n-10 -20 -30 -1 -2 125\n" * 9
    )
    return Sample(folder / "log.imu")


def psins_ranges(folder: Path) -> Sample:
    import scipy.io

    made = module("test_psins_ranges").arrays()
    made["ephs"][4, [2, 3, 4, 6, 10, 12]] = (1e-4, 1e-11, 0.0, 50.0, 0.01, 5153.7)  # clock, radius, shape of the orbit
    made["ephs"][4, [7, 8, 9, 11, 14, 15, 16, 17, 18, 19, 20, 21]] = 1e-8
    scipy.io.savemat(folder / "log.mat", made)
    return Sample(folder / "log.mat")


def instinct_csv(folder: Path) -> Sample:
    made = module("test_instinct_csv")
    (folder / "vn.csv").write_text(
        "\n".join([made.GNSS, *(made.fix(385_980.8 + k, 385_980.794 + k) for k in range(6))])
    )
    return Sample(folder / "vn.csv")


def folder_of_logs(folder: Path) -> Sample:
    write(replace(run(1.0), gnss=None, reference=None), folder / "imu.csv")
    write(replace(run(4.0), imu=None, reference=None), folder / "gnss.pos")
    return Sample(folder, {}, (folder / "imu.csv", folder / "gnss.pos"))


NORM = {"allow": "norm"}
#: Sample by name; variants of a format have its name before an underscore, see :data:`VARIANTS`.
MAKERS: dict[str, Callable[[Path], Sample]] = {
    f.__name__: f for f in (
        mcap, rosbag, px4, ardupilot, novatel, sbf, vectornav, xsens, sbg, euroc, kitti, kf_gins, sbet, netcdf, tum,
        solution, navego, psins, gnss_ins_sim, comma2k19, imr, waypoint, android, sensor_logger, phyphox, gpx, kml, oan,
        text, csv,
        parquet, matlab4, matlab5, npy, npz, pos, ubx, nmea, rinex_observations, rinex_navigation, rinex_gzip, hatanaka,
        psins_imu, psins_ranges, instinct_csv,
    )
} | {"folder": folder_of_logs}  # fmt: skip
VARIANTS: dict[str, Callable[[Path], Sample]] = {
    f.__name__: f for f in (
        mcap_ros2, rosbag_lz4, rosbag_bz2, rosbag_ros2, vectornav_lines, netcdf_packed, hdf5, matlab73,
        parquet_foreign, vectornav_csv, xsens_text,
    )
}  # fmt: skip
ALL = MAKERS | VARIANTS


def make(name: str, folder: Path) -> Sample:
    """The sample of a name, in an empty folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return ALL[name](folder)


__all__ = ["ALL", "MAKERS", "OLDER", "VARIANTS", "WEEK", "Sample", "Trajectory", "make", "module", "run"]
