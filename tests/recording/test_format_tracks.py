"""Tracks of maps and phones as fixes: GPX, KML, exports of phyphox; local frames; fixes made of a reference."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive

from schuler import frames, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import gpx
from schuler.recording.io import read, write
from schuler.timebase import UNIX_TO_GPS_S

START = 1_707_350_382.25  # Unix time


def gps(recording):
    return recording.metadata.time.epoch_gps_s + recording.gnss.t


def test_gpx_of_ours_comes_back(tmp_path):
    """Round trip: places to the printed digits, times to the millisecond."""
    run = replace(drive(), reference=None)
    gpx.write(run, tmp_path / "a.gpx")
    back = read(tmp_path / "a.gpx")
    np.testing.assert_allclose(back.gnss.llh[:, :2], run.gnss.llh[:, :2], rtol=0.0, atol=1e-9 * units.DEG)
    np.testing.assert_allclose(back.gnss.llh[:, 2], run.gnss.llh[:, 2], rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(gps(back), run.metadata.time.epoch_gps_s + run.gnss.t, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[0, 0, 0]), 2.0 / np.sqrt(2.0))  # differential, HDOP unknown
    assert any("states no accuracy" in note for note in back.metadata.notes)


def gpx_text(points):
    rows = "".join(
        f'<trkpt lat="{48 + k * 1e-4:.6f}" lon="11.5"><ele>500</ele>'
        f"<time>2024-02-08T00:00:{k:02d}Z</time>{more}</trkpt>"
        for k, more in enumerate(points)
    )
    return (
        f'<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/0"><trk><trkseg>{rows}</trkseg></trk></gpx>'
    )


def test_gpx_speed_course_and_dilution(tmp_path):
    """11.1 m/s to the north, as displacements say; HDOP multiplies the range error of a phone."""
    path = tmp_path / "a.gpx"
    path.write_text(gpx_text(["<speed>11.1</speed><course>0</course><hdop>2.0</hdop>"] * 20))
    back = read(path)
    np.testing.assert_allclose(back.gnss.v_n[:, 0], 11.1)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[:, 0, 0]), 5.0 * 2.0 / np.sqrt(2.0))
    np.testing.assert_array_equal(back.gnss.dop, [[2.0, np.nan]] * 20)
    assert read(path, sigma="3,3,5").gnss.cov_r_n[0, 0, 0] == pytest.approx(9.0)


def test_gpx_keeps_dilutions(tmp_path):
    """Round trip, in hundredths; a point whose VDOP is not known has none, in a track without any there are none."""
    run = replace(drive(), reference=None)
    dop = np.column_stack((np.linspace(0.6, 4.0, len(run.gnss)), np.linspace(1.0, 9.0, len(run.gnss)))).round(2)
    dop[3, 1] = np.nan
    gpx.write(replace(run, gnss=replace(run.gnss, dop=dop)), tmp_path / "a.gpx")
    np.testing.assert_array_equal(read(tmp_path / "a.gpx").gnss.dop, dop)
    gpx.write(run, tmp_path / "b.gpx")
    assert read(tmp_path / "b.gpx").gnss.dop is None


def test_what_is_no_log_of_fixes_is_refused(tmp_path):
    path = tmp_path / "a.gpx"
    path.write_text(gpx_text([""] * 20).replace("<time>", "<cmt>").replace("</time>", "</cmt>"))
    with pytest.raises(FileFormatError, match="is a drawing"):
        read(path)
    path.write_text(gpx_text([""] * 20)[:-40])
    with pytest.raises(FileFormatError, match="not complete XML"):
        read(path)
    path.write_text('<!DOCTYPE a [<!ENTITY b "c">]>' + gpx_text([""] * 20))
    with pytest.raises(FileFormatError, match="entities"):
        read(path)
    path.write_text(gpx_text([""] * 20).replace('lat="48.000300"', 'lat="x"'))
    with pytest.raises(FileFormatError, match="expected a number as lat"):
        read(path)


KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>{}</Document></kml>"""


MODE = "<altitudeMode>absolute</altitudeMode>"


def kml_points(n):
    return [f"2024-02-08T00:00:{k:02d}Z" for k in range(n)], [(11.5 + k * 1e-4, 48.0, 500.0 + k) for k in range(n)]


def kml_text(n):
    when, places = kml_points(n)
    track = "".join(f"<when>{t}</when>" for t in when)
    track += "".join(f"<gx:coord>{lon} {lat} {h}</gx:coord>" for lon, lat, h in places)
    return KML.format(f"<Placemark><gx:Track>{MODE}{track}</gx:Track></Placemark>")


def test_kml_track_and_points(tmp_path):
    when, places = kml_points(10)
    path = tmp_path / "a.kml"
    path.write_text(kml_text(10))
    first = read(path)
    np.testing.assert_allclose(first.gnss.llh[:, 1] / units.DEG, [p[0] for p in places])
    np.testing.assert_allclose(first.gnss.llh[:, 2], [p[2] for p in places])
    path.write_text(KML.format("".join(
        f"<Placemark><TimeStamp><when>{t}</when></TimeStamp><Point>{MODE}<coordinates>{lon},{lat},{h}</coordinates>"
        "</Point></Placemark>" for t, (lon, lat, h) in zip(when, places, strict=True)
    )))  # fmt: skip
    second = read(path)
    assert np.array_equal(first.gnss.llh, second.gnss.llh)
    assert np.array_equal(gps(first), gps(second))


def test_kml_on_the_ground_has_no_heights(tmp_path):
    rows = "".join(f"<when>2024-02-08T00:00:{k:02d}Z</when>" for k in range(5))
    rows += "".join(f"<gx:coord>11.5 48.{k} 0</gx:coord>" for k in range(5))
    path = tmp_path / "a.kml"
    path.write_text(KML.format(f"<gx:Track>{rows}</gx:Track>"))
    back = read(path)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[:, 2, 2]), 1000.0)
    assert any("without a height" in note for note in back.metadata.notes)


def phyphox(folder, pause_s=0.0, delimiter=",", n=400):
    """A phone on its back, top forward, at 50 Hz, the gyroscope a third of an interval later."""
    run = drive()
    quoted = delimiter.join

    def save(name, head, t, rows):
        lines = [quoted(f'"{word}"' for word in head)]
        for at, row in zip(t, rows, strict=True):
            text = quoted(f"{float(x):.12E}" for x in (at, *row))
            lines.append(text.replace(".", ",") if delimiter != "," else text)
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

    t = np.arange(n) / 50.0
    to_phone = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    save("Accelerometer", ["Time (s)", *(f"Acceleration {c} (m/s^2)" for c in "xyz")], t, run.imu.accel[:n] @ to_phone)
    save("Gyroscope", ["Time (s)", *(f"Gyroscope {c} (rad/s)" for c in "xyz")], t, run.imu.gyro[:n] @ to_phone)
    llh, v = run.reference.llh[:n:50], run.reference.v_eb_n[:n:50]
    course = np.arctan2(v[:, 1], v[:, 0]) / units.DEG % 360.0
    rows = np.column_stack((llh[:, :2] / units.DEG, llh[:, 2], np.hypot(v[:, 0], v[:, 1]), course,
                            np.full(len(llh), 3.0), np.full(len(llh), 5.0)))  # fmt: skip
    head = ["Time (s)", "Latitude (°)", "Longitude (°)", "Height (m)", "Velocity (m/s)", "Direction (°)",
            "Horizontal Accuracy (m)", "Vertical Accuracy (°)"]  # fmt: skip
    save("Location", head, t[::50], rows)
    (folder / "meta").mkdir()
    (folder / "meta" / "time.csv").write_text(
        '"event","experiment time","system time","system time text"\n'
        f'"START",0.000000000E0,{START:.3f},"-"\n"PAUSE",2.0,{START + 2.0:.3f},"-"\n'
        f'"START",2.0,{START + 2.0 + pause_s:.3f},"-"\n'
    )
    return run


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_phyphox(tmp_path, delimiter):
    """Axes of a phone, Unix time of the experiment's start, accuracies as radii of 68 %; decimal commas too."""
    run = phyphox(tmp_path, delimiter=delimiter)
    back = read(tmp_path)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel[:400], atol=1e-10)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro[:400], atol=1e-12)
    assert gps(back)[0] == pytest.approx(START - UNIX_TO_GPS_S + 18.0, abs=1e-6)
    np.testing.assert_allclose(back.gnss.llh[0], run.reference.llh[0], atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_r_n[0])), (3 / 1.5096, 3 / 1.5096, 5.0), rtol=1e-4)
    alone = read(tmp_path / "Location.csv", time="local")
    assert np.array_equal(alone.gnss.llh, back.gnss.llh)


def test_phyphox_pauses_count_on_by_the_phone_s_clock(tmp_path):
    phyphox(tmp_path, pause_s=7.0)
    back = read(tmp_path)
    assert np.diff(back.gnss.t).max() == pytest.approx(8.0, abs=1e-6)
    assert np.diff(back.gnss.t).min() == pytest.approx(1.0, abs=1e-6)


def test_phyphox_zip_is_its_folder(tmp_path):
    (tmp_path / "a").mkdir()
    phyphox(tmp_path / "a")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for file in (tmp_path / "a").rglob("*.csv"):
            archive.write(file, file.relative_to(tmp_path / "a").as_posix())
    folder, packed = read(tmp_path / "a"), read(tmp_path / "a.zip")
    assert np.array_equal(folder.imu.accel, packed.imu.accel)
    assert np.array_equal(folder.gnss.llh, packed.gnss.llh)
    (tmp_path / "b.zip").write_bytes((tmp_path / "a.zip").read_bytes()[:-60])
    with pytest.raises(FileFormatError):
        read(tmp_path / "b.zip")


def test_phyphox_zip_with_a_damaged_stream_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Gyroscope.csv", "0.0,1.0,2.0\n" * 300)
        archive.writestr("meta/time.csv", "")
    data = bytearray((tmp_path / "a.zip").read_bytes())
    data[43] = 0xFF  # the first byte of the stream: a block of a type that is none
    (tmp_path / "a.zip").write_bytes(data)
    with pytest.raises(FileFormatError, match="complete zip"):
        read(tmp_path / "a.zip")


def test_a_local_frame_is_placed_at_its_origin(tmp_path):
    """North, east, down (or up, with a sign) of an origin, as fixes and as reference; without one it is asked for."""
    rng = np.random.default_rng(2)
    r_n = rng.uniform(-100.0, 100.0, (20, 3))
    path = tmp_path / "truth.csv"
    path.write_text(
        "t,north,east,down\n" + "\n".join(f"{k},{n!r},{e!r},{d!r}" for k, (n, e, d) in enumerate(r_n.tolist()))
    )
    origin = np.array([48.1 * units.DEG, 11.6 * units.DEG, 560.0])
    expected = frames.ecef_from_ned(r_n, origin)
    truth = read(path, origin="48.1,11.6,560")
    np.testing.assert_allclose(truth.reference.r_eb_e, expected, atol=1e-6)
    fixes = read(path, origin="48.1,11.6,560", series="gnss", sigma="1,1,2")
    np.testing.assert_allclose(frames.ecef_from_llh(fixes.gnss.llh), expected, atol=1e-6)
    flipped = read(path, columns="t,e,n,-d", skip=1, origin="48.1,11.6,560")
    np.testing.assert_allclose(
        flipped.reference.r_eb_e, frames.ecef_from_ned(r_n[:, [1, 0, 2]] * (1, 1, -1), origin), atol=1e-6
    )
    with pytest.raises(InputError, match="origin="):
        read(path)


def test_fixes_made_of_a_reference_have_the_noise_they_state(tmp_path):
    """Statistical: the mean square of 3 n normal numbers, to four standard errors."""
    run = replace(drive(), gnss=None)
    write(run, tmp_path / "a.csv")
    back = read(tmp_path / "a.csv", truth_fixes="0.1,0.05")
    error = frames.ecef_from_llh(back.gnss.llh) - back.reference.at(back.gnss.t).r_eb_e
    n = error.size
    assert np.mean(error**2) == pytest.approx(0.05**2, abs=4.0 * 0.05**2 * np.sqrt(2.0 / n))
    np.testing.assert_allclose(back.gnss.cov_r_n[0], 0.05**2 * np.eye(3), atol=1e-15)
    assert any("no measurements" in note for note in back.metadata.notes)
    with pytest.raises(InputError, match="there are fixes"):
        read_with_fixes(tmp_path)


def read_with_fixes(folder):
    write(drive(), folder / "b.csv")
    return read(folder / "b.csv", truth_fixes="1,0.05")
