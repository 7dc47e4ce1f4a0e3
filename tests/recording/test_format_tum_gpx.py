"""TUM trajectories and GPX tracks."""

from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive

from schuler import frames, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read, write

ROWS = "".join(f"1403636579.{k:02d}3555584 {k} 2.0 3.0 0 0 {np.sin(0.1)} {np.cos(0.1)}\n" for k in range(20))
HEAD = "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n"


def test_columns(tmp_path):
    """x east, z up; the quaternion is scalar last: 0.2 rad from east towards north; stamps keep their last digit."""
    (tmp_path / "groundtruth.txt").write_text(HEAD + ROWS)
    run = read(tmp_path / "groundtruth.txt", origin="47,8,400")
    r_n = frames.ned_from_ecef(run.reference.r_eb_e, np.array([47 * units.DEG, 8 * units.DEG, 400.0]))
    np.testing.assert_allclose(r_n[5], (2.0, 5.0, -3.0), atol=1e-8)
    np.testing.assert_allclose(run.reference.rpy_nb[0], (0.0, 0.0, np.pi / 2 - 0.2), atol=1e-6)
    np.testing.assert_allclose(run.reference.t[3], 0.033555584, rtol=0, atol=1e-12)
    with pytest.raises(InputError, match="origin"):
        read(tmp_path / "groundtruth.txt")


def test_without_a_comment_the_format_is_named(tmp_path):
    (tmp_path / "a.txt").write_text(ROWS)
    assert read(tmp_path / "a.txt", format="tum", origin="47,8,400", time="unix").metadata.time.scale == "gps"


def test_other_programs_read_it(tmp_path):
    """A common origin makes two trajectories comparable; NumPy reads eight columns with unit quaternions."""
    run = drive()
    write(run, tmp_path / "truth.tum", origin="48.12845,8.4225,300")
    write(run, tmp_path / "fixes.tum", origin="48.12845,8.4225,300", series="gnss")
    truth, fixes = np.loadtxt(tmp_path / "truth.tum"), np.loadtxt(tmp_path / "fixes.tum")
    np.testing.assert_allclose(np.linalg.norm(truth[:, 4:], axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(truth[::50, 1:4], fixes[:, 1:4], atol=1e-7)
    assert read(tmp_path / "fixes.tum").reference.q_eb is None


def test_faults_name_the_line(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text(HEAD + ROWS.replace("7 2.0", "7 x", 1))
    with pytest.raises(FileFormatError, match=r"a\.txt:10: column 3"):
        read(file, origin="47,8,400")
    file.write_text(HEAD + "1 0 0 0 0 0 0 2\n")
    with pytest.raises(FileFormatError, match="unit quaternion"):
        read(file, origin="47,8,400")
    file.write_text(HEAD + "1403636579763555584 0 0 0 0 0 0 1\n")
    with pytest.raises(FileFormatError, match="nanoseconds"):
        read(file, origin="47,8,400")


def test_gpx_by_another_reader(tmp_path):
    """gpxpy reads points to 1e-9 deg, heights to 1 mm, times in UTC to 1 ms, kind of fix and satellites."""
    gpxpy = pytest.importorskip("gpxpy")
    run = replace(drive(), reference=None)
    run = replace(run, metadata=replace(run.metadata, name="Größe & <Rest>\x01"))
    write(run, tmp_path / "a.gpx")
    with (tmp_path / "a.gpx").open(encoding="utf-8") as stream:
        (track,) = gpxpy.parse(stream).tracks
    assert track.name == "Größe & <Rest>\ufffd"
    points = track.segments[0].points
    np.testing.assert_allclose([p.latitude for p in points], run.gnss.llh[:, 0] / units.DEG, rtol=0, atol=1e-9)
    np.testing.assert_allclose([p.elevation for p in points], run.gnss.llh[:, 2], rtol=0, atol=1e-3)
    utc = points[0].time.timestamp()
    assert utc == pytest.approx(run.metadata.time.epoch_gps_s + run.gnss.t[0] + 315_964_800 - 18, abs=2e-3)
    assert points[3].type_of_gpx_fix == "dgps"
    assert points[3].satellites == 14


def test_gpx_segments_points_and_sea_level(tmp_path):
    gpxpy = pytest.importorskip("gpxpy")
    run = drive(scale="local")
    T = run.reference
    keep = (T.t < T.t[0] + 8.0) | (T.t > T.t[0] + 15.0)
    cut = replace(run, reference=type(T)(T.t[keep], T.r_eb_e[keep]))
    write(cut, tmp_path / "a.gpx", series="reference", max_points=100, geoid_separation=48.0)
    with (tmp_path / "a.gpx").open(encoding="utf-8") as stream:
        (track,) = gpxpy.parse(stream).tracks
    assert len(track.segments) == 2
    assert sum(len(s.points) for s in track.segments) <= 100
    assert track.segments[0].points[0].elevation == pytest.approx(T.llh[0, 2] - 48.0, abs=1e-3)
    assert track.segments[0].points[0].time is None
    for options in ({"series": "imu"}, {"max_points": 1}):
        with pytest.raises(InputError):
            write(cut, tmp_path / "b.gpx", **options)
    with pytest.raises(InputError):
        write(replace(cut, gnss=None), tmp_path / "b.gpx", series="gnss")
    assert not (tmp_path / "b.gpx").exists()


def test_a_track_with_a_place_that_is_no_number_is_refused_without_a_warning(tmp_path):
    points = "".join(
        f'<trkpt lat="{48.0 + 1e-4 * k if k != 16 else "1e999"}" lon="11.5"><ele>500</ele>'
        f"<time>2024-02-08T00:00:{k:02d}Z</time><speed>11.1</speed><course>0</course></trkpt>"
        for k in range(30)
    )
    path = tmp_path / "a.gpx"
    path.write_text(f'<gpx xmlns="http://www.topografix.com/GPX/1/0"><trk><trkseg>{points}</trkseg></trk></gpx>')
    with pytest.raises(FileFormatError, match="row 17: lat is inf"):
        read(path, sigma="1,1,1")
