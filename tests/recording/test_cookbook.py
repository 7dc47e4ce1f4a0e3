"""Every page of docs/formats runs: its commands through the command line, then its Python, on small logs made here."""

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import samples
from format_drives import drive
from places import DOCS

import schuler
from schuler.cli import main
from schuler.recording.formats import (
    ardupilot,
    novatel,
    px4,
    registry,
    ros_messages,
    ros_recording,
    sbf,
    sbg,
    xsens_messages,
)
from schuler.recording.formats.novatel_frames import IMU_TYPES
from schuler.recording.formats.novatel_frames import LAYOUTS as NOVATEL

PAGES = sorted((DOCS / "formats").glob("*.md"))
SECTIONS = ("What is assumed", "Traps", "How to check")

pytest.importorskip("rosbags")
pytest.importorskip("pyulog")
pytest.importorskip("h5netcdf")
pytest.importorskip("pyarrow")


def made(name: str) -> object:
    return samples.module(name)


def ros(folder: Path) -> None:
    """A ROS 1 bag with an IMU, fixes, their velocity and an odometry."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, ros2, bag = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE), made("test_rosbag")
    kinds = {"/imu": "sensor_msgs/Imu", "/gps/fix": "sensor_msgs/NavSatFix", "/odometry": "nav_msgs/Odometry",
             "/gps/vel": "geometry_msgs/TwistWithCovarianceStamped"}  # fmt: skip
    fields = {"/imu": bag.REST, "/gps/fix": bag.FIX, "/odometry": {"pose.pose.orientation.w": 1.0},
              "/gps/vel": {f"twist.covariance.{k}": 0.01 for k in (0, 7, 14)}}  # fmt: skip
    ns = 1_700_000_000 * 10**9 + np.arange(40) * 10**8
    with Writer(folder / "drive.bag") as writer:
        for topic, kind in kinds.items():
            name = kind.replace("/", "/msg/")
            connection = writer.add_connection(topic, name, typestore=store)
            texts = {"header.frame_id": "frame"} | ({"child_frame_id": "base"} if topic == "/odometry" else {})
            raw = ros_messages.encode(kind, ns, fields[topic], texts)
            for stamp, cdr in zip(ns, raw, strict=True):
                writer.write(connection, int(stamp), ros2.cdr_to_ros1(cdr, name))


def ardupilot_log(folder: Path) -> None:
    flash = made("test_ardupilot")
    body = flash.messages()
    for k in range(100):
        t = flash.us(60.0 + k / 100)
        body += [flash.message("GYR", t, 0, t, 0, 0, 0), flash.message("ACC", t, 0, t, 0, 0, -9.8)]
    (folder / "flight.bin").write_bytes(flash.encoder.log(body, (*flash.NAMES, "ACC", "GYR")))


def novatel_logs(folder: Path) -> None:
    nov, log = made("encode_novatel"), made("test_format_novatel")
    run = drive(rate=125.0, kind="increment")
    log.log_of(run, folder / "span.gps")
    rate = drive(8.0, 100.0, kind="increment")
    kinds = {
        "raw.gps": next(k for k in IMU_TYPES.values() if k.name == "HG1700_AG58"),
        "other.gps": SimpleNamespace(accel=2.3283e-10, gyro=1.1642e-10),
    }
    for name, kind in kinds.items():
        counts = zip(rate.imu.t, log.counts_of(rate, kind), strict=True)
        (folder / name).write_bytes(b"".join(nov.rawimu(samples.WEEK, t, c) for t, c in counts))


def septentrio(folder: Path) -> None:
    encode, log = made("encode_sbf"), made("test_format_sbf")
    run = drive()
    log.log_of(run, folder / "rover.sbf")
    log.log_of(run, folder / "plain.sbf", covariances=False)
    with (log.log_of(run, folder / "dual.sbf")).open("ab") as stream:
        for t in run.gnss.t:
            stream.write(encode.attitude(samples.WEEK, round(t * 1000), 77.5, 1.5, 0.0))


def vectornav(folder: Path) -> None:
    made("test_format_vectornav").log_of(drive(), folder / "vn300.bin")
    (folder / "vn100.txt").write_bytes(samples.vectornav_lines(folder).path.read_bytes())
    (folder / "vn300.csv").write_bytes(samples.vectornav_csv(folder).path.read_bytes())


def xsens(folder: Path) -> None:
    made("test_format_xsens").log_of(drive(), folder / "MT_0120067F_001.mtb")
    (folder / "MT_0120067F_001-000.txt").write_bytes(samples.xsens_text(folder).path.read_bytes())


def sub(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


def kf_gins(folder: Path) -> None:
    run, texts = sub(folder, "dataset"), made("test_format_kf_gins")
    (run / "imu.txt").write_text(texts.IMU)
    (run / "gnss.txt").write_text(texts.FIXES)


def psins(folder: Path) -> None:
    mat = made("test_format_mat")
    mat.psins(folder / "trj.mat")
    g = drive().gnss
    mat.psins(folder / "fixes.mat", trj=False, gps=np.column_stack((g.v_n[:, [1, 0, 2]] * (1, 1, -1), g.llh, g.t)))
    (folder / "simu.imu").write_bytes(samples.psins_imu(folder).path.read_bytes())


def waypoint(folder: Path) -> None:
    made("test_format_waypoint").export(folder / "export.txt")


def rtklib(folder: Path) -> None:
    schuler.write(drive(), folder / "rover.pos")
    lines = (folder / "rover.pos").read_text().splitlines()
    (folder / "sea_level.pos").write_text("\n".join(line for line in lines if "ellipsoidal" not in line) + "\n")


def rinex(folder: Path) -> None:
    files = made("test_dispatch_satellites")
    run = sub(folder, "run")
    for where in (folder, run):
        (where / "rover.obs").write_text(files.observations())
        (where / "brdc.nav").write_text(files.GLONASS + files.gps_message(5) + files.glonass_message(5, 1))
    imu = drive(4.0).imu
    base = schuler.recording.recording.Metadata(time=schuler.timebase.TimeBase("gps", files.WEEK * 604_800.0))
    shifted = replace(imu, t=imu.t - imu.t[0] + files.TOW)
    schuler.write(schuler.recording.Recording(shifted, metadata=base), run / "imu.csv")


def text(folder: Path) -> None:
    imu = drive().imu
    turn = np.array((1.0, -1.0, -1.0))
    rows = np.column_stack((imu.accel * turn / 9.80665, np.degrees(imu.gyro * turn), 20.0 * np.arange(len(imu))))
    np.savetxt(folder / "imu.csv", rows, delimiter=",", fmt="%.17g")


def parquet(folder: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    run = drive()
    schuler.write(run, folder / "drive.parquet")
    columns = {"stamp": run.imu.t, **{f"a_{c}": run.imu.accel[:, k] for k, c in enumerate("xyz")}}
    columns |= {f"w_{c}": np.degrees(run.imu.gyro[:, k]) for k, c in enumerate("xyz")}
    pq.write_table(pa.table(columns), folder / "logger.parquet")


def drive_parquet(folder: Path) -> None:
    schuler.write(drive(), folder / "drive.parquet")


def hdf5(folder: Path) -> None:
    import h5py

    imu = drive().imu
    with h5py.File(folder / "log.h5", "w") as file:
        for name, values in {"imu/time": imu.t, "imu/acc": imu.accel, "imu/gyr": imu.gyro}.items():
            file[name] = np.asarray(values)


def matlab(folder: Path) -> None:
    import scipy.io

    rfu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    inc, imu = drive(kind="increment").imu, drive().imu
    scipy.io.savemat(folder / "run.mat", {"imu": np.column_stack((inc.gyro @ rfu, inc.accel @ rfu, inc.t))})
    log = {"t": imu.t, "acc": imu.accel / 9.80665, "gyr": np.degrees(imu.gyro)}
    scipy.io.savemat(folder / "arrays.mat", {"log": log})


def numpy_files(folder: Path) -> None:
    np.savez(folder / "log.npz", imu=samples.imu_rows())
    np.save(folder / "log.npy", samples.imu_rows())


def imr(folder: Path) -> None:
    schuler.write(drive(), folder / "span.imr")


def sbet(folder: Path) -> None:
    (folder / "sbet_mission.out").write_bytes(made("test_format_sbet").records()[0])


def copied(maker: Callable[[Path], samples.Sample], name: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        maker(sub(folder, "made")).path.rename(folder / name)

    return make


#: What makes the files a page names, in the working folder.
FILES: dict[str, Callable[[Path], object]] = {
    "ros": ros, "mcap": lambda f: schuler.write(drive(), f / "drive.mcap"),
    "px4": lambda f: (f / "flight.ulg").write_bytes(
        made("test_px4").flight(imu=("sensor_combined", "sensor_gyro"))
    ),
    "ardupilot": ardupilot_log, "ublox": samples.ubx, "nmea": copied(samples.nmea, "receiver.nmea"),
    "novatel": novatel_logs, "septentrio": septentrio, "vectornav": vectornav, "xsens": xsens,
    "sbg": lambda f: made("test_format_sbg").log_of(drive(), f / "ellipse.bin"),
    "euroc": lambda f: made("test_format_euroc").data_set(
        sub(f, "MH_01_easy"), "comment: VI-Sensor IMU (ADIS16448)\n"
    ),
    "kitti": lambda f: made("test_format_kitti").kitti(f / "2011_09_26_drive_0005_sync"),
    "tum": lambda f: samples.tum(f).path.rename(f / "groundtruth.txt"),
    "kf-gins": kf_gins, "navego": lambda f: made("test_format_mat").navego(f / "navego.mat"), "psins": psins,
    "comma2k19": lambda f: made("test_format_simulators").comma2k19(sub(f, "segment")),
    "gnss-ins-sim": lambda f: made("test_format_simulators").gnss_ins_sim(sub(f, "results")),
    "android": lambda f: made("test_format_phones").gnss_logger(f / "gnss_log.txt"),
    "sensor-logger": lambda f: made("test_format_phones").sensor_logger(sub(f, "phone")),
    "phyphox": lambda f: made("test_format_tracks").phyphox(sub(f, "walk")),
    "oan": lambda f: made("test_format_phones").oan(sub(f, "phone")),
    "sbet": sbet, "imr": imr, "waypoint": waypoint, "rtklib": rtklib, "rinex": rinex, "csv": text,
    "parquet": parquet, "netcdf": drive_parquet, "hdf5": hdf5, "matlab": matlab, "numpy": numpy_files,
    "tracks": drive_parquet,
    "solution": lambda f: made("test_format_solution").solution(f / "smoothed.parquet", drive(8.0)),
}  # fmt: skip
#: Pages whose name is not the format's in the registry.
NAMES = {"rosbag": "ros", "sbf": "septentrio", "kf_gins": "kf-gins", "gnss_ins_sim": "gnss-ins-sim",
         "sensor_logger": "sensor-logger", "gpx": "tracks", "kml": "tracks"}  # fmt: skip


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def page_of(name: str) -> str:
    return (DOCS / "formats" / f"{name}.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
@pytest.mark.thinned(6)
def test_the_page_runs(page, tmp_path, monkeypatch, capsys):
    """Commands end well (``check`` may find something in a toy log), and so does the Python."""
    monkeypatch.chdir(tmp_path)
    FILES[page.stem](tmp_path)
    [commands] = blocks(page, "sh")
    for line in commands.splitlines():
        words = shlex.split(line, comments=True)
        assert words[0] == "schuler", line
        code = main(words[1:])
        output = capsys.readouterr()
        if words[1] == "check":
            assert code in (0, 2), line
            assert " error" in output.out or code == 0, output.err
        else:
            assert code == 0, f"{line}: {output.err}"
    names: dict = {}
    for code in blocks(page, "python"):
        exec(compile(code, str(page), "exec"), names)
    read = [value for value in names.values() if isinstance(value, schuler.Recording)]
    assert read or page.stem == "rinex"
    assert all(value.metadata.sources for value in read)


def test_every_format_has_a_page():
    """Of the registry, read or written, and no page is left without files; the index links all."""
    formats = {name for name, _ in registry.FORMATS} | {name for name, _, _ in registry.WRITERS}
    stems = {page.stem for page in PAGES}
    assert {NAMES.get(name, name) for name in formats} <= stems
    assert stems == set(FILES)
    index = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(formats/([\w-]+)\.md\)", index)) == stems
    for _, suffixes, _ in registry.WRITERS:
        assert all(f"`{suffix}`" in index for suffix in suffixes)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_page_has_its_sections(page):
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)", text, re.MULTILINE)[:3] == list(SECTIONS)
    for target in re.findall(r"\]\(([\w./-]+\.md)\)", text):
        assert (page.parent / target).exists(), target


def test_the_tables_name_what_is_read():
    for kind in ros_recording.PARTS:
        assert kind in page_of("ros") or f"`{kind.partition('/')[2]}`" in page_of("ros"), kind
    for topic in (*px4.TOPICS, *px4.HELPERS):
        assert f"`{topic}`" in page_of("px4"), topic
    for letters in ("IMU", "ACC+GYR", "GPS", "GPA", "BARO", "POS", "ATT", "XKF1", "NKF1", "AEl", "Und"):
        assert f"`{letters}`" in page_of("ardupilot"), letters
    assert ardupilot.QUALITY.keys() == {3, 4, 5, 6}
    for name in sbf._PARTS:
        assert name in page_of("septentrio"), name
    for name in sbg._PARTS:
        assert name in page_of("sbg"), name
    for name in (n for n in NOVATEL if novatel._PARTS.get(n) in ("imu", "gnss")):
        assert name in page_of("novatel"), name
    assert f"{len(IMU_TYPES)} types" in page_of("novatel")
    assert xsens_messages.SYSTEMS[0] in page_of("xsens")
