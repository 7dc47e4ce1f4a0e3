"""Other programs open what we write and find the same numbers: their own libraries, or the layout as published.

Tolerances are those of ``test_round_trips.py``. Programs that are not installed are skipped, with their name.
"""

import importlib.util
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from format_drives import ORIGIN, WEEK, drive

from schuler import frames, rotation, units
from schuler.recording.io import write

UNIX = 315_964_800 - 18  # of the GPS epoch, less the leap seconds of the drive's week
EPOCH = WEEK * 604_800.0
FLU = np.array((1.0, -1.0, -1.0))
PLACE = "48.12845,8.4225,300"


@pytest.fixture(scope="module")
def run():
    return drive()


def same(mine, theirs, tolerance: float) -> None:
    np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=tolerance)


def enu(llh: np.ndarray) -> np.ndarray:
    """East, north, up about the origin the trajectories are written with. Shape (n, 3)."""
    lat, lon, h = map(float, PLACE.split(","))
    origin = np.array((lat * units.DEG, lon * units.DEG, h))
    return frames.ned_from_ecef(frames.ecef_from_llh(llh), origin)[:, [1, 0, 2]] * (1.0, 1.0, -1.0)


def test_pandas_and_pyarrow_read_parquet(run, tmp_path):
    pandas = pytest.importorskip("pandas")
    parquet = pytest.importorskip("pyarrow.parquet")
    write(run, tmp_path / "run.parquet")
    table = pandas.read_parquet(tmp_path / "run.parquet")
    imu = table[table["series"] == "imu"]
    np.testing.assert_array_equal(imu[["ax", "ay", "az"]].to_numpy(), run.imu.accel)
    fixes = table[table["series"] == "gnss"]
    np.testing.assert_array_equal(fixes["t"].to_numpy(), run.gnss.t)
    schema = parquet.read_schema(tmp_path / "run.parquet")
    assert schema.field("ax").metadata[b"unit"] == b"m/s^2"
    document = json.loads(schema.metadata[b"schuler"])
    assert document["metadata"]["time"] == {"scale": "gps", "epoch_gps_s": EPOCH}


def test_polars_reads_parquet(run, tmp_path):
    polars = pytest.importorskip("polars")
    write(run, tmp_path / "run.parquet")
    table = polars.read_parquet(tmp_path / "run.parquet").filter(polars.col("series") == "reference")
    np.testing.assert_array_equal(table.select("x", "y", "z").to_numpy(), run.reference.r_eb_e)


def test_pandas_reads_csv(run, tmp_path):
    """Every part is a file of its own with units in its names of columns."""
    pandas = pytest.importorskip("pandas")
    files = write(run, tmp_path / "run.csv")
    imu = pandas.read_csv(files[0], comment="#", float_precision="round_trip")
    np.testing.assert_array_equal(imu.filter(regex="^a[xyz]").to_numpy(), run.imu.accel)
    fixes = pandas.read_csv(next(file for file in files if "gnss" in file.name), comment="#",
                            float_precision="round_trip")  # fmt: skip
    same(fixes.filter(regex="^lat").to_numpy()[:, 0] * units.DEG, run.gnss.llh[:, 0], 1e-15)


def test_xarray_reads_netcdf(run, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    write(run, tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc", group="imu", engine="h5netcdf") as imu:
        np.testing.assert_array_equal(imu["gz"].to_numpy(), run.imu.gyro[:, 2])
        assert imu["gz"].attrs["units"] == "rad/s"
    with xarray.open_dataset(tmp_path / "run.nc", group="gnss", engine="h5netcdf") as fixes:
        np.testing.assert_array_equal(fixes["h"].to_numpy(), run.gnss.llh[:, 2])


def test_pos_is_as_rtklib_describes_it(run, tmp_path):
    """Columns by RTKLIB's manual, appendix A; signed square roots of the covariances, up instead of down."""
    write(run, tmp_path / "run.pos")
    lines = (tmp_path / "run.pos").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("%")]
    numbers = np.array([[float(field) for field in row[2:]] for row in rows])
    stamp = np.array([f"{row[0].replace('/', '-')}T{row[1]}" for row in rows], dtype="M8[ns]")
    gps = (stamp - np.datetime64("1980-01-06", "ns")).astype(np.int64) * 1e-9
    same(gps - EPOCH, run.gnss.t, 3e-7)
    same(numbers[:, :2] * units.DEG, run.gnss.llh[:, :2], 1.1e-13)
    same(numbers[:, 2], run.gnss.llh[:, 2], 5.1e-7)
    np.testing.assert_array_equal(numbers[:, 3:5], np.column_stack((run.gnss.quality, run.gnss.n_satellites)))
    C = run.gnss.cov_r_n
    for column, variance in ((5, C[:, 0, 0]), (8, C[:, 0, 1]), (9, -C[:, 1, 2]), (10, -C[:, 0, 2])):
        same(np.abs(numbers[:, column]) * numbers[:, column], variance, 1e-6)
    same(numbers[:, 13:16], run.gnss.v_n * (1.0, 1.0, -1.0), 5.1e-7)


def test_fastkml_and_the_schema_of_ogc_accept_kml(run, tmp_path):
    """Valid by the OGC's schema but for Google's tracks, which have one of their own; longitude stands first."""
    fastkml = pytest.importorskip("fastkml")
    pytest.importorskip("lxml")
    write(run, tmp_path / "run.kml")
    document = fastkml.KML.parse(tmp_path / "run.kml", strict=True, validate=True)
    tracks = [g for g in _geometries(document.features) if type(g).__name__ == "Track"]
    [track] = tracks
    points = np.array([(p.x, p.y, p.z) for p in (item.coord for item in track.track_items)])
    same(points[:, :2], run.gnss.llh[:, [1, 0]] / units.DEG, 5.1e-10)
    same(points[:, 2], run.gnss.llh[:, 2], 5.1e-4)
    first = track.track_items[0].when.dt.timestamp()
    assert first == pytest.approx(EPOCH + run.gnss.t[0] + UNIX, abs=1e-3)


def _geometries(features):
    for feature in features:
        if hasattr(feature, "features"):
            yield from _geometries(feature.features)
        elif getattr(feature, "kml_geometry", None) is not None:
            yield feature.kml_geometry


def test_geojson_is_as_rfc_7946_describes_it(run, tmp_path):
    """Longitude, latitude, height; also by pygeoif where it is installed."""
    write(run, tmp_path / "run.geojson")
    collection = json.loads((tmp_path / "run.geojson").read_text())
    [feature] = collection["features"]
    assert feature["geometry"]["type"] == "LineString"
    same(np.array(feature["geometry"]["coordinates"])[:, :2], run.gnss.llh[:, [1, 0]] / units.DEG, 1e-8)
    pygeoif = pytest.importorskip("pygeoif")
    shape = pygeoif.shape(feature["geometry"])
    assert shape.geom_type == "LineString"
    same(shape.bounds[1] * units.DEG, run.gnss.llh[:, 0].min(), 1e-10)


def test_gpxpy_reads_gpx(run, tmp_path):
    gpxpy = pytest.importorskip("gpxpy")
    write(run, tmp_path / "run.gpx")
    [track] = gpxpy.parse((tmp_path / "run.gpx").read_text()).tracks
    points = [p for segment in track.segments for p in segment.points]
    same([(p.latitude * units.DEG, p.longitude * units.DEG) for p in points], run.gnss.llh[:, :2], 1e-11)
    same([p.elevation for p in points], run.gnss.llh[:, 2], 5.1e-4)
    same([p.time.timestamp() for p in points], EPOCH + run.gnss.t + UNIX, 5.1e-4)
    assert [p.satellites for p in points] == [14] * len(points)


def test_rosbags_reads_bags_and_the_messages_in_mcap(run, tmp_path):
    """ROS 2 messages by rosbags' own decoder, out of its own container and out of the mcap library's."""
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    write(run, tmp_path / "run.rosbag2")
    with AnyReader([tmp_path / "run.rosbag2"]) as reader:
        bag = [(c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
    check_ros(run, bag)
    library = pytest.importorskip("mcap.reader")
    write(run, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        entries = library.make_reader(stream, validate_crcs=True).iter_messages()
        check_ros(run, [(c.topic, store.deserialize_cdr(m.data, schema.name)) for schema, c, m in entries])


def check_ros(run, messages) -> None:
    imu = [m for topic, m in messages if topic == "/imu/data"]
    force = np.array([[getattr(m.linear_acceleration, axis) for axis in "xyz"] for m in imu])
    np.testing.assert_array_equal(force * FLU, run.imu.accel)
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in imu])
    same(stamps * 1e-9 - UNIX - EPOCH, run.imu.t, 3e-7)
    assert {m.orientation_covariance[0] for m in imu} == {-1.0}  # no orientation in it
    fixes = [m for topic, m in messages if topic == "/gnss/fix"]
    same([(m.latitude * units.DEG, m.longitude * units.DEG) for m in fixes], run.gnss.llh[:, :2], 3e-16)
    cov = np.array([m.position_covariance for m in fixes]).reshape(-1, 3, 3)
    turn = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    same(turn @ cov @ turn.T, run.gnss.cov_r_n, 1e-16)
    assert {m.child_frame_id for topic, m in messages if topic == "/reference/odometry"} == {"imu_link"}
    poses = [m.pose.pose for topic, m in messages if topic == "/reference/odometry"]
    place = np.array([(p.position.x, p.position.y, p.position.z) for p in poses])
    same(np.linalg.norm(np.diff(place, axis=0), axis=1).sum(),
         np.linalg.norm(np.diff(run.reference.r_eb_e, axis=0), axis=1).sum(), 1e-5)  # fmt: skip


@pytest.fixture
def evo(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))  # where evo keeps settings
    pytest.importorskip("evo", reason="evo is not installed")
    from evo.tools import file_interface

    return file_interface


def test_evo_reads_tum(run, tmp_path, evo):
    write(run, tmp_path / "run.tum", origin=PLACE)
    path = evo.read_tum_trajectory_file(tmp_path / "run.tum")
    same(path.positions_xyz, enu(run.reference.llh), 1e-7)
    same(path.timestamps, EPOCH + run.reference.t + UNIX, 5e-7)
    check_attitude(run, path.orientations_quat_wxyz)


def test_evo_reads_euroc(run, tmp_path, evo):
    files = write(run, tmp_path / "set", format="euroc", origin=PLACE)
    truth = next(file for file in files if "groundtruth" in str(file))
    path = evo.read_euroc_csv_trajectory(truth)
    same(path.positions_xyz, enu(run.reference.llh), 1e-7)
    check_attitude(run, path.orientations_quat_wxyz)
    imu = np.loadtxt(next(file for file in files if "imu0" in str(file) and file.suffix == ".csv"), delimiter=",")
    same(imu[:, 4:7] * FLU, run.imu.accel, 4e-15)  # columns as the data set's paper says: rates, then accelerations


def check_attitude(run, q_wxyz) -> None:
    """Forward, left, up to east, north, up of the origin, against forward, right, down to north, east, down."""
    C = rotation.dcm_from_quat(np.asarray(q_wxyz))
    lat, lon, h = map(float, PLACE.split(","))
    C_en = frames.C_en(np.array((lat * units.DEG, lon * units.DEG, h)))
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    same(C_en @ swap @ C * FLU, rotation.dcm_from_quat(run.reference.q_eb), 1e-9)


def test_pykitti_reads_kitti(run, tmp_path):
    """Packets by name, and poses on its Mercator plane: metres of a sphere, so relative to a few parts in 1000."""
    entries = importlib.util.find_spec("pykitti")
    if entries is None or not entries.submodule_search_locations:
        pytest.skip("pykitti is not installed")
    # its package needs OpenCV for the images of a drive, which are not asked for here
    path = Path(entries.submodule_search_locations[0]) / "utils.py"
    spec = importlib.util.spec_from_file_location("pykitti_utils", path)
    utils = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(utils)
    write(run, tmp_path / "drive", format="kitti")
    entries = utils.load_oxts_packets_and_poses(sorted((tmp_path / "drive" / "oxts" / "data").glob("*.txt")))
    assert len(entries) == len(run.reference)
    packets = [item.packet for item in entries]
    same([(p.lat * units.DEG, p.lon * units.DEG) for p in packets], run.reference.llh[:, :2], 3e-16)
    same([p.alt for p in packets], run.reference.llh[:, 2], 1e-8)
    same([(p.vn, p.ve, -p.vu) for p in packets], run.reference.v_eb_n, 1e-12)
    same([(p.ax, -p.ay, -p.az) for p in packets], run.imu.accel, 1e-14)
    same([p.roll for p in packets], run.reference.rpy_nb[:, 0], 1e-12)
    poses = np.array([item.T_w_imu for item in entries])
    moved = frames.ned_from_ecef(run.reference.r_eb_e, ORIGIN)[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    far = np.linalg.norm(moved[-1])
    same(poses[-1, :3, 3] - poses[0, :3, 3], moved[-1] - moved[0], 0.005 * far)
    forward = poses[-1, :3, 0]  # its x axis looks where the vehicle drives
    step = moved[-1] - moved[-2]
    assert forward @ step / np.linalg.norm(step) > 0.99


def test_kf_gins_finds_its_columns(run, tmp_path):
    """KF-GINS' README: time, increments of angle and velocity; time, position, 1-sigma; week, time, ..."""
    write(run, tmp_path / "kf", format="kf_gins")
    inc = run.imu.increments()
    imu = np.loadtxt(tmp_path / "kf" / "imu.txt")
    same(imu[:, 0], inc.t, 5.1e-10)
    same(imu[:, 1:4], inc.dtheta_ib_b, 1e-17)
    same(imu[:, 4:7], inc.dv_ib_b, 1e-16)
    truth = np.loadtxt(tmp_path / "kf" / "truth.nav")
    assert set(truth[:, 0]) == {WEEK}
    same(truth[:, 2:4] * units.DEG, run.reference.llh[:, :2], 1e-14)
    same(truth[:, 5:8], run.reference.v_eb_n, 5.1e-10)
    same(np.sin(truth[:, 10] * units.DEG), np.sin(run.reference.rpy_nb[:, 2]), 1e-10)


def test_sbet_is_as_applanix_describes_it(run, tmp_path):
    """17 little-endian doubles: time, latitude, longitude [rad], height, velocities, roll, pitch, platform heading,
    wander angle, accelerations, rates."""
    write(run, tmp_path / "run.sbet")
    rows = np.array(list(struct.iter_unpack("<17d", (tmp_path / "run.sbet").read_bytes())))
    np.testing.assert_array_equal(rows[:, 0], run.reference.t)
    np.testing.assert_array_equal(rows[:, 1:4], run.reference.llh)
    same(rows[:, 4:7], run.reference.v_eb_n, 1e-12)
    same(rows[:, 7:10], run.reference.rpy_nb, 1e-12)
    assert not rows[:, 10].any()
    np.testing.assert_array_equal(rows[:, 11:14], run.imu.accel)


def test_imr_is_as_novatel_describes_it(run, tmp_path):
    """A header of 512 bytes whose scales turn counts into degrees and m/s (Waypoint manual, IMR format)."""
    write(run, tmp_path / "run.imr")
    data = (tmp_path / "run.imr").read_bytes()
    magic, little, _, theta, velocity, rate, gyro, accel = struct.unpack_from("<8sbdiiddd", data)
    assert (magic, little, theta, velocity) == (b"$IMURAW\0", 0, 1, 1)
    assert rate == pytest.approx(50.0)
    rows = np.array(list(struct.iter_unpack("<d6i", data[512:])))
    inc = run.imu.increments()
    np.testing.assert_array_equal(rows[:, 0], inc.t)
    right_forward_up = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    same(rows[:, 1:4] * gyro * units.DEG @ right_forward_up, inc.dtheta_ib_b, 8e-12)
    same(rows[:, 4:7] * accel @ right_forward_up, inc.dv_ib_b, 2e-10)


def test_every_written_format_has_a_foreign_reader():
    """A test of this file opens each of them."""
    from tests.recording.test_round_trips import FORMATS

    names = {"kf_gins": "kf_gins", "netcdf": "netcdf", "rosbag": "bags"}
    here = Path(__file__).read_text(encoding="utf-8").lower()
    tests = [line for line in here.splitlines() if line.startswith("def test_")]
    for name in FORMATS:
        assert any(names.get(name, name) in line for line in tests), name
