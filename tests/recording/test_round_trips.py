"""Every format that is written, read back: values equal to the precision the format states, and what it loses named.

The table below is the statement: tolerances are half of the last digit written (printed digits), the rounding of
float64 on the way through degrees or Earth-fixed axes (rounding), or zero where every bit is kept. Tests of single
formats look closer; this one holds that no format is left out.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from format_drives import WEEK, drive

from schuler import rotation, units
from schuler.recording import Recording
from schuler.recording.formats import registry
from schuler.recording.io import read, write
from schuler.recording.io.dispatch import WRITERS, left_out

TOW = f"gps-tow:{WEEK}"
#: One part in the last of 17 digits, of numbers of the size of gravity.
DIGITS = 4e-15


@dataclass(frozen=True)
class Kept:
    """What of a part comes back, to which absolute tolerance: times [s], places [m], velocities [m/s], angles [rad],
    specific forces and rates (or increments), variances (relative); ``None`` is lost."""

    t: float = 0.0
    place: float | None = None
    velocity: float | None = None
    angle: float | None = None
    accel: float | None = None
    gyro: float | None = None
    variance: float | None = None
    diagonal: bool = False
    quality: bool = False


@dataclass(frozen=True)
class Format:
    """A format: the file written, how it is read back, what of each part is kept, and whether metadata are."""

    file: str
    parts: dict[str, Kept]
    name: str | None = None
    options: dict[str, Any] = field(default_factory=dict)
    hints: dict[str, Any] = field(default_factory=dict)
    kind: str = "rate"
    metadata: tuple[str, ...] = ("time",)


BITS = {
    "imu": Kept(accel=0.0, gyro=0.0),
    "gnss": Kept(place=0.0, velocity=0.0, variance=0.0, quality=True),
    "reference": Kept(place=0.0, velocity=0.0, angle=0.0),
}
#: Stamps are whole nanoseconds since 1970, where float64 times of week have 6e-11 s: rounding to a nanosecond.
ROS = {
    "imu": Kept(t=1e-9, accel=0.0, gyro=0.0),
    "gnss": Kept(t=1e-9, place=1e-8, velocity=0.0, variance=1e-14),  # NavSatStatus has fewer kinds of fixes
    "reference": Kept(t=1e-9, place=1e-8, velocity=1e-13, angle=1e-14),
}
FORMATS = {
    "parquet": Format("run.parquet", BITS, metadata=("time", "name", "notes", "axes", "options")),
    # every digit, of degrees
    "csv": Format("run.csv", {"imu": BITS["imu"], "gnss": Kept(place=1e-9, velocity=0.0, variance=1e-15, quality=True),
                              "reference": BITS["reference"]}, metadata=("time", "name", "notes", "axes", "options")),
    "netcdf": Format("run.nc", BITS, metadata=("time", "name", "notes", "axes", "options")),
    # degrees with 11 decimals, metres with 6; square roots of variances with 6 decimals or 5 digits
    "pos": Format(
        "run.pos", {"gnss": Kept(t=1e-9, place=1.5e-6, velocity=5.1e-7, variance=1e-3, quality=True)},
    ),
    "kml": Format("run.kml", {"gnss": Kept(place=1.5e-3)}, metadata=("name",)),
    "geojson": Format("run.geojson", {"gnss": Kept(place=1.5e-3)}, metadata=("name",)),
    "gpx": Format("run.gpx", {"gnss": Kept(t=5.1e-4, place=1.5e-3)}, metadata=("name",)),
    "mcap": Format("run.mcap", ROS),
    "rosbag": Format("run.rosbag2", ROS),
    "euroc": Format("euroc", {"imu": Kept(t=2e-9, accel=DIGITS, gyro=DIGITS),
                              "reference": Kept(t=2e-9, place=5e-9, velocity=1e-12, angle=1e-12)}, "euroc"),
    "kitti": Format("kitti", {"imu": Kept(t=2e-9, accel=1e-14, gyro=1e-15),
                              "reference": Kept(t=2e-9, place=2e-8, velocity=1e-12, angle=1e-12)}, "kitti",
                    hints={"time": "unix"}),
    # degrees of places with 12 decimals, of angles with 9, metres with 9
    "kf_gins": Format("kf", {"imu": Kept(t=5.1e-10, accel=1e-17, gyro=1e-17),
                             "gnss": Kept(t=5.1e-10, place=1.5e-7, velocity=5.1e-10, variance=1e-7, diagonal=True),
                             "reference": Kept(t=5.1e-10, place=1.5e-7, velocity=1e-9, angle=2e-11)}, "kf_gins",
                      hints={"format": "kf_gins", "time": TOW}, kind="increment"),
    "sbet": Format("run.sbet", {"reference": Kept(place=1e-8, velocity=1e-12, angle=1e-14)}, hints={"time": TOW}),
    "tum": Format("run.tum", {"reference": Kept(t=2e-9, place=5e-9, angle=1e-12)}),
    # the largest increment is 2^30 counts
    "imr": Format("run.imr", {"imu": Kept(accel=2e-10, gyro=8e-12)}, hints={"time": TOW}, kind="increment"),
}  # fmt: skip


def kml(path: Path) -> Recording:
    """The moving track of a KML file: when and where."""
    space = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    return _points([c.text.split() for c in ElementTree.parse(path).iterfind(".//gx:coord", space)])


def gpx(path: Path) -> Recording:
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    points = ElementTree.parse(path).findall(".//g:trkpt", space)
    return _points([(p.get("lon"), p.get("lat"), p.find("g:ele", space).text) for p in points])


def geojson(path: Path) -> Recording:
    lines = [f["geometry"]["coordinates"] for f in json.loads(path.read_text())["features"]]
    return _points([point for line in lines for point in line])


def _points(rows: list) -> np.ndarray:
    lon, lat, h = np.array(rows, dtype=float).T
    return np.column_stack((lat * units.DEG, lon * units.DEG, h))


READERS: dict[str, Callable[[Path], Any]] = {"kml": kml, "gpx": gpx, "geojson": geojson}


def metres(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of places given as latitude, longitude and height, to 1 %."""
    d = (a - b) * np.column_stack((np.full(len(a), 6.4e6), 6.4e6 * np.cos(a[:, 0]), np.ones(len(a))))
    return float(np.abs(d).max())


def test_no_format_that_is_written_is_left_out():
    assert set(FORMATS) == set(WRITERS.values()) | {name for name, _, _ in registry.WRITERS}
    for name, suffixes, held in registry.WRITERS:
        assert set(FORMATS[name].parts) <= set(held)
        assert Path(FORMATS[name].file).suffix in (*suffixes, "")


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_written_comes_back(name, tmp_path):
    pytest.importorskip({"mcap": "rosbags", "rosbag": "rosbags", "netcdf": "h5netcdf"}.get(name, "numpy"))
    form = FORMATS[name]
    run = drive(kind=form.kind)
    path = tmp_path / form.file
    files = write(run, path, format=form.name, **form.options)
    assert all(file.exists() for file in files)
    if name in READERS:
        llh, kept = READERS[name](path), form.parts["gnss"]
        assert len(llh) == len(run.gnss)
        assert metres(run.gnss.llh, llh) <= kept.place
        assert run.metadata.name in path.read_text()
        return
    back = read(path, **form.hints)
    for part in ("imu", "gnss", "reference"):
        assert (getattr(back, part) is not None) == (part in form.parts), part
    lost = left_out(run, path, form.name).replace(" ", "").split(",")
    assert not set(form.parts) & set(lost)
    if "imu" in form.parts:
        kept = form.parts["imu"]
        assert back.imu.kind == form.kind
        same(back.imu.t, run.imu.t, kept.t)
        same(back.imu.accel, run.imu.accel, kept.accel)
        same(back.imu.gyro, run.imu.gyro, kept.gyro)
    if "gnss" in form.parts:
        check_fixes(run, back, form.parts["gnss"])
    if "reference" in form.parts:
        check_reference(run, back, form.parts["reference"])
    for what in form.metadata:
        assert getattr(back.metadata, what) == getattr(run.metadata, what), what


@pytest.mark.parametrize("name", ["euroc", "kf_gins", "kitti", "sbet", "tum", "imr"])
def test_a_local_clock_keeps_its_intervals(name, tmp_path):
    """Without a time of week, stamps may begin elsewhere; everything else is as above."""
    form = FORMATS[name]
    run = drive(scale="local", kind=form.kind)
    write(run, tmp_path / form.file, format=form.name)
    back = read(tmp_path / form.file, **{k: v for k, v in form.hints.items() if k != "time"})
    for part in form.parts:
        same(np.diff(getattr(back, part).t), np.diff(getattr(run, part).t), max(2.0 * form.parts[part].t, 1e-11))
    if "imu" in form.parts:
        same(back.imu.gyro, run.imu.gyro, form.parts["imu"].gyro)
    if "reference" in form.parts:
        same(back.reference.r_eb_e, run.reference.r_eb_e, 3e-7)


def same(mine, theirs, tolerance: float) -> None:
    np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=tolerance)


def check_fixes(run: Recording, back: Recording, kept: Kept) -> None:
    same(back.gnss.t, run.gnss.t, kept.t)
    assert metres(run.gnss.llh, back.gnss.llh) <= kept.place
    assert (back.gnss.v_n is None) == (kept.velocity is None)
    if kept.velocity is not None:
        same(back.gnss.v_n, run.gnss.v_n, kept.velocity)
    for name in ("cov_r_n", "cov_v_n"):
        mine, theirs = getattr(back.gnss, name), getattr(run.gnss, name)
        scale = np.sqrt(np.einsum("nii->ni", theirs))
        if kept.diagonal:
            theirs = theirs * np.eye(3)
        assert (np.abs(mine - theirs) / (scale[:, :, None] * scale[:, None, :])).max() <= kept.variance, name
    if kept.quality:
        np.testing.assert_array_equal(back.gnss.quality, run.gnss.quality)


def check_reference(run: Recording, back: Recording, kept: Kept) -> None:
    same(back.reference.t, run.reference.t, kept.t)
    same(back.reference.r_eb_e, run.reference.r_eb_e, kept.place)
    assert (back.reference.v_eb_e is None) == (kept.velocity is None)
    if kept.velocity is not None:
        same(back.reference.v_eb_e, run.reference.v_eb_e, kept.velocity)
    q = rotation.quat_multiply(rotation.quat_conjugate(back.reference.q_eb), run.reference.q_eb)
    angle = np.linalg.norm(rotation.rotvec_from_quat(q), axis=1)
    assert angle.max() <= max(kept.angle, 1e-15)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", [name for name in FORMATS if name not in READERS])
def test_a_second_round_trip_changes_nothing(name, tmp_path):
    """Written once more, what came back is the same to float64: nothing drifts with every conversion."""
    pytest.importorskip({"mcap": "rosbags", "rosbag": "rosbags", "netcdf": "h5netcdf"}.get(name, "numpy"))
    form = FORMATS[name]
    folders = [tmp_path / "a", tmp_path / "b"]
    run = replace(drive(8.0, kind=form.kind))
    for folder in folders:
        folder.mkdir()
        write(run, folder / form.file, format=form.name)
        run, before = read(folder / form.file, **form.hints), run
    for part in form.parts:
        same(getattr(run, part).t, getattr(before, part).t, 1e-9)
    if "gnss" in form.parts:
        assert metres(run.gnss.llh, before.gnss.llh) <= 1e-8
    if "imu" in form.parts:
        same(run.imu.accel, before.imu.accel, 1e-14)
