"""Text as loggers write it: dates, speed and course, velocities without a vertical one, signs."""

import numpy as np
import pytest

import schuler
from schuler.exceptions import FileFormatError, InputError
from schuler.timebase import calendar

READ = {"units": "g,deg/s"}


def imu(tmp_path, stamps, header="time,ax,ay,az,gx,gy,gz", row="0.01,0.02,-1.0,0.1,0.2,0.3", name="imu.csv"):
    path = tmp_path / name
    path.write_text("\n".join([header, *(f"{stamp},{row}" for stamp in stamps)]) + "\n")
    return path


def clocks(n=200, end="Z", day="2024-05-01"):
    return [f"{day}T12:00:{k // 100:02d}.{k % 100:02d}{end}" for k in range(n)]


def test_a_zone_is_taken_off(tmp_path):
    utc = schuler.read(imu(tmp_path, clocks()), **READ)
    east = schuler.read(imu(tmp_path, [s.replace("T12", "T14") for s in clocks(end="+02:00")]), **READ)
    west = schuler.read(imu(tmp_path, [s.replace("T12", " 08") for s in clocks(end="-0400")]), **READ)
    assert utc.metadata.time == east.metadata.time == west.metadata.time
    for other in (east, west):
        np.testing.assert_array_equal(utc.imu.t, other.imu.t)
    first = calendar(utc.metadata.time.epoch_gps_s + utc.imu.t[0])
    assert first.isoformat() == "2024-05-01T12:00:18"  # 18 leap seconds


def test_without_a_zone_dates_are_utc_and_it_is_said(tmp_path):
    path = imu(tmp_path, clocks(end=""))
    plain = schuler.read(path, **READ)
    np.testing.assert_array_equal(plain.imu.t, schuler.read(imu(tmp_path, clocks(), name="z.csv"), **READ).imu.t)
    assert any("without a zone are taken as UTC" in note for note in plain.metadata.notes)
    gps = schuler.read(path, time="gps-unix", **READ)
    assert plain.imu.t[0] - gps.imu.t[0] == 18.0


def test_nanoseconds_are_kept(tmp_path):
    stamps = [f"2024-05-01T12:00:00.{k * 1_000_003:09d}Z" for k in range(200)]
    t = schuler.read(imu(tmp_path, stamps), **READ).imu.t
    np.testing.assert_allclose(np.diff(t), 1_000_003e-9, atol=2e-10)  # rounding: seconds of a week


def test_a_column_of_dates_is_the_time_where_none_is_named(tmp_path):
    path = imu(tmp_path, clocks(), header="logged at,ax,ay,az,gx,gy,gz")
    np.testing.assert_allclose(np.diff(schuler.read(path, **READ).imu.t), 0.01, atol=1e-9)


@pytest.mark.parametrize("wrong", ["2024-13-01T12:00:00Z", "2024-05-01T25:00:00Z", "12:00:01.5", "0.5"])
def test_what_is_no_date_is_named_with_its_line(tmp_path, wrong):
    stamps = clocks()
    stamps[7] = wrong
    with pytest.raises(FileFormatError, match=r"2024-05-01T12:00:00\.25Z") as error:
        schuler.read(imu(tmp_path, stamps), **READ)
    assert error.value.line == 9


def test_a_hint_against_the_zone_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="leave time out"):
        schuler.read(imu(tmp_path, clocks()), time="gps-tow:2300", **READ)
    with pytest.raises(FileFormatError, match="the hint units says ms"):
        schuler.read(imu(tmp_path, clocks()), units="g,deg/s,ms")


def test_a_sign_before_a_name_changes_that_column(tmp_path):
    path = imu(tmp_path, np.arange(200) * 0.01)
    plain = schuler.read(path, columns="t,ax,ay,az,gx,gy,gz", **READ).imu
    turned = schuler.read(path, columns="t,-ax,ay,az,gx,gy,-gz", **READ)
    np.testing.assert_array_equal(turned.imu.accel, plain.accel * [-1.0, 1.0, 1.0])
    np.testing.assert_array_equal(turned.imu.gyro, plain.gyro * [1.0, 1.0, -1.0])
    assert "Signs were changed: ax, gz." in turned.metadata.notes
    mapped = schuler.read(path, columns="t=time,-ax=ax,ay=ay,az=az,gx=gx,gy=gy,-gz=gz", **READ).imu
    np.testing.assert_array_equal(mapped.accel, turned.imu.accel)
    headed = imu(tmp_path, np.arange(200) * 0.01, header="time,-ax,ay,az,gx,gy,-gz", name="h.csv")
    np.testing.assert_array_equal(schuler.read(headed, **READ).imu.gyro, turned.imu.gyro)
    with pytest.raises(InputError, match="'t' is not known"):
        schuler.read(path, columns="-t,ax,ay,az,gx,gy,gz", **READ)


def fixes(tmp_path, header, columns, n=60):
    """Fixes every second, 10 m/s to the north-east. Heights 100 m."""
    t, v = np.arange(n) * 1.0, 10.0 / np.sqrt(2.0)
    lat, lon = 48.0 + v * t / 111_196.0, 11.0 + v * t / (111_320.0 * np.cos(np.deg2rad(48.0)))
    rows = (f"{a:.1f},{b:.9f},{c:.9f},100.0,{columns}" for a, b, c in zip(t, lat, lon, strict=True))
    path = tmp_path / "fixes.csv"
    path.write_text("\n".join([f"t,lat,lon,h,{header}", *rows]) + "\n")
    return path


def test_speed_and_course_of_fixes_are_their_horizontal_velocity(tmp_path):
    log = schuler.read(fixes(tmp_path, "speed [km/h],course", "36.0,45.0"), sigma="2,2,4")
    np.testing.assert_allclose(log.gnss.v_n, np.tile([np.sqrt(50.0), np.sqrt(50.0), 0.0], (60, 1)), rtol=1e-12)
    assert np.all(log.gnss.cov_v_n[:, 2, 2] == 100.0)  # nothing is said of the vertical one
    assert log.odometer is None
    assert np.all(np.sqrt(log.gnss.cov_v_n[:, 0, 0]) < 0.2)  # by their differences to the displacements, least 0.05
    stated = schuler.read(fixes(tmp_path, "sog,cog,sspeed", "10.0,-135.0,0.3"), sigma="2,2,4")
    np.testing.assert_allclose(stated.gnss.v_n[:, 0], -np.sqrt(50.0))
    np.testing.assert_allclose(stated.gnss.cov_v_n[:, 0, 0], 0.09)
    given = schuler.read(fixes(tmp_path, "speed,course", "10.0,45.0"), sigma="2,2,4,0.2,0.2,0.3")
    np.testing.assert_allclose(given.gnss.cov_v_n[:, 1, 1], 0.04)
    assert not any("hint sigma was not used" in note for note in given.metadata.notes)


def test_a_course_of_minus_one_is_none(tmp_path):
    log = schuler.read(fixes(tmp_path, "speed,course,sspeed", "0.2,-1,0.1"), sigma="2,2,4")
    np.testing.assert_array_equal(log.gnss.v_n, 0.0)
    np.testing.assert_allclose(log.gnss.cov_v_n[:, 0, 0], 0.1**2 + 0.2**2)  # it may point anywhere


@pytest.mark.parametrize(("names", "sigma"), [("vn,ve", "2,2,4,0.1,0.2,0.3"), ("vn,ve,svn,sve", "2,2,4")])
def test_horizontal_velocities_say_nothing_of_the_vertical_one(tmp_path, names, sigma):
    columns = "7.0,7.1" + (",0.1,0.2" if "svn" in names else "")
    log = schuler.read(fixes(tmp_path, names, columns), sigma=sigma)
    np.testing.assert_array_equal(log.gnss.v_n, np.tile([7.0, 7.1, 0.0], (60, 1)))
    np.testing.assert_allclose(log.gnss.cov_v_n, np.tile(np.diag([0.01, 0.04, 100.0]), (60, 1, 1)))
    assert any("no vertical velocity" in note for note in log.metadata.notes)


GARBLED = ("0.5,0.01,0.0", "0.5,#\x7f,0.02,-1,0.1,0.2,0.3", "0.5,0.01,0.02-1.0,0.1,0.2,0.3,0.4", "1.2.3,0,0,1,0,0,0")


def table(tmp_path, columns):
    path = tmp_path / "fixes.csv"
    np.savetxt(path, np.stack(list(columns.values()), axis=1), delimiter=",", header=",".join(columns), comments="")
    return path


def test_accuracies_of_phones_are_radii_that_hold_68_percent(tmp_path):
    """sqrt(-2 ln 0.32) = 1.5096 sigma of two equal axes."""
    radius = 3.0 + 0.1 * (np.arange(60) % 5)
    level = {"time": np.arange(60.0), "lat": 48.0 + 1e-4 * np.arange(60), "lon": np.full(60, 11.0), "alt": np.zeros(60)}
    log = schuler.read(table(tmp_path, level | {"accuracy": radius}))
    np.testing.assert_allclose(np.sqrt(log.gnss.cov_r_n[:, 0, 0]), radius / 1.5096, rtol=1e-4)  # printed digits
    np.testing.assert_allclose(np.sqrt(log.gnss.cov_r_n[:, 2, 2]), 2.0 * radius, rtol=1e-12)
    both = level | {"Horizontal Accuracy (m)": radius, "Vertical Accuracy (m)": 5.0 + radius}
    np.testing.assert_allclose(np.sqrt(schuler.read(table(tmp_path, both)).gnss.cov_r_n[:, 2, 2]), 5.0 + radius)
    radius[7] = 0.0
    log = schuler.read(table(tmp_path, level | {"accuracy": radius}), sigma="4,4,6")
    np.testing.assert_allclose(np.sqrt(log.gnss.cov_r_n[:, 0, 0]), 4.0)
    assert any("zero or missing, so that none is used" in note for note in log.metadata.notes)


def garble(path, at, wrong=GARBLED):
    rows = path.read_text().splitlines()
    for k, text in zip(at, wrong, strict=True):
        rows.insert(k, text)
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("stamps", [np.arange(200) * 0.01, clocks()])
@pytest.mark.parametrize("columns", [None, "t,ax,ay,az,gx,gy,gz"])
def test_garbled_lines_up_to_a_share_are_left_out_and_counted(tmp_path, stamps, columns):
    hints = READ | ({} if columns is None else {"columns": columns})
    clean = schuler.read(imu(tmp_path, stamps, name="clean.csv"), **hints)
    path = garble(imu(tmp_path, stamps), (1, 50, 60, 90))  # the first: a log that begins in the middle of a line
    with pytest.raises(FileFormatError):
        schuler.read(path, **hints)
    log = schuler.read(path, bad_lines=0.02, **hints)
    np.testing.assert_array_equal(log.imu.t, clean.imu.t)
    np.testing.assert_array_equal(log.imu.accel, clean.imu.accel)
    assert "4 garbled lines of 204 were left out." in log.metadata.notes
    with pytest.raises(FileFormatError, match=r"4 of 204 lines are garbled, more than bad_lines=0.01 allows") as error:
        schuler.read(path, bad_lines=0.01, **hints)
    assert error.value.line == 2


def test_a_clean_log_is_the_same_with_garbled_lines_allowed(tmp_path):
    path = imu(tmp_path, np.arange(200) * 0.01)
    plain, lenient = schuler.read(path, **READ), schuler.read(path, bad_lines=0.1, **READ)
    np.testing.assert_array_equal(plain.imu.gyro, lenient.imu.gyro)
    assert plain.metadata.notes == lenient.metadata.notes
    for share in (-0.1, 0.5, "some"):
        with pytest.raises(InputError, match="bad_lines"):
            schuler.read(path, bad_lines=share, **READ)


def test_faults_of_good_rows_name_their_line(tmp_path):
    path = garble(imu(tmp_path, np.arange(200) * 0.01), (50, 60), ("#!", "0.575,0.01,0.02,-1.0,0.1,0.2,9e4"))
    path = garble(path, (10,), ("junk,junk",))
    with pytest.raises(FileFormatError, match="gyro reaches") as error:
        schuler.read(path, bad_lines=0.02, **READ)
    assert error.value.line == 62
