"""Tables as loggers of an IMU and a receiver write them: fixes between samples, times of day, counters, names."""

import numpy as np
import pytest

import schuler
from schuler.exceptions import FileFormatError
from schuler.recording.io import columns, dates
from schuler.units import DEG, G0

IMU = "millis,ax,ay,az,gx,gy,gz"
READ = {"units": "g,deg/s", "sigma": "2,2,3,0.2,0.2,0.2"}
N, EVERY = 400, 40  # samples at 50 Hz, a fix after so many


def lat(k):
    return 48.7 + 1e-5 * k


def log(tmp_path, between, header=f"{IMU},lat,lon,alt,speed,course", stamp=lambda k: str(20 * k), fields=None):
    """A table whose fixes come once in ``EVERY`` rows, and what stands between them."""
    rows = []
    for k in range(N):
        i, first = divmod(k, EVERY)
        fix = f"{lat(i):.7f},9.1000000,300.0,{1.39 + 0.01 * i:.2f},0.0" if fields is None else fields(i)
        if k < EVERY:
            fix = ",".join({"empty": "", "held": "0.0", "zero": "0.000000"}[between] for _ in fix.split(","))
        elif first and between != "held":
            fix = ",".join("" if between == "empty" else "0.000000" for _ in fix.split(","))
        rows.append(f"{stamp(k)},0.01,0.02,-1.0,0.1,0.2,0.3,{fix}")
    path = tmp_path / "DATA001.TXT"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize("between", ["empty", "held", "zero"])
def test_fixes_between_samples_are_read_where_they_are_new(tmp_path, between):
    recording = schuler.read(log(tmp_path, between), **READ)
    np.testing.assert_allclose(recording.imu.t, 0.02 * np.arange(N), rtol=0, atol=1e-12)  # rounding
    np.testing.assert_allclose(recording.imu.accel[:, 2], -G0)
    fixes = N // EVERY - 1
    np.testing.assert_allclose(recording.gnss.t, 0.02 * EVERY * np.arange(1, fixes + 1), rtol=0, atol=1e-12)
    np.testing.assert_allclose(recording.gnss.llh[:, 0], lat(np.arange(1, fixes + 1)) * DEG, rtol=0, atol=1e-15)
    np.testing.assert_allclose(recording.gnss.v_n[:, 0], 1.39 + 0.01 * np.arange(1, fixes + 1), atol=1e-12)
    notes = recording.metadata.notes
    assert sum("9 rows bring a new fix" in note for note in notes) == 1
    assert len(set(notes)) == len(notes)
    assert not any("one clock of unknown epoch" in note for note in notes)
    assert schuler.read(log(tmp_path, between), series="imu", **READ).gnss is None


def test_a_fix_that_is_repeated_with_another_speed_is_new(tmp_path):
    path = log(tmp_path, "held", fields=lambda i: f"48.7000000,9.1000000,300.0,{0.1 * i:.1f},0.0")
    assert len(schuler.read(path, **READ).gnss.t) == N // EVERY - 1


def test_a_heading_between_samples_is_no_column_of_the_imu(tmp_path):
    recording = schuler.read(log(tmp_path, "empty", header=f"{IMU},lat,lon,alt,speed,heading"), **READ)
    assert len(recording.imu.t) == N
    assert len(recording.gnss.t) == N // EVERY - 1


def test_a_table_without_any_fix_says_so(tmp_path):
    path = log(tmp_path, "empty", fields=lambda i: ",,,,")
    with pytest.raises(FileFormatError, match="no row has a number in"):
        schuler.read(path, **READ)
    assert len(schuler.read(path, series="imu", **READ).imu.t) == N


def test_speeds_of_wheels_between_samples_are_read(tmp_path):
    path = log(tmp_path, "empty", header=f"{IMU},speed", fields=lambda i: f"{0.1 * i:.1f}")
    recording = schuler.read(path, units="g,deg/s", sigma_speed=0.1)
    np.testing.assert_allclose(recording.odometer.speed, 0.1 * np.arange(1, 10), atol=1e-12)


def test_times_of_day_go_on_over_midnight(tmp_path):
    def clock(k):
        s = 86_396.0 + 0.02 * k
        h, rest = divmod(s % 86_400.0, 3600.0)
        return f"{int(h):02d}:{int(rest // 60):02d}:{rest % 60:06.3f}"

    path = log(tmp_path, "empty", header=IMU.replace("millis", "Time") + ",lat,lon,alt,speed,course", stamp=clock)
    recording = schuler.read(path, **READ)
    np.testing.assert_allclose(recording.imu.t, 86_396.0 + 0.02 * np.arange(N), rtol=0, atol=1e-9)  # rounding
    assert recording.metadata.time.scale == "local"
    assert any("times of day, of no stated date" in note for note in recording.metadata.notes)
    np.testing.assert_allclose(np.diff(recording.gnss.t), 0.8, atol=1e-9)


@pytest.mark.parametrize("day", ["2024-05-17", "2024/5/17", "17.05.2024"])
def test_a_date_beside_a_time_of_day_is_its_day(tmp_path, day):
    header = "date,time" + IMU.removeprefix("millis") + ",lat,lon,alt,speed,course"
    path = log(tmp_path, "held", header=header, stamp=lambda k: f"{day},12:00:{0.02 * k:06.3f}")
    whole = log(
        tmp_path, "held", header=header.removeprefix("date,"), stamp=lambda k: f"2024-05-17T12:00:{0.02 * k:06.3f}Z"
    )
    both, one = schuler.read(path, **READ), schuler.read(whole, **READ)
    assert both.metadata.time == one.metadata.time
    np.testing.assert_array_equal(both.imu.t, one.imu.t)
    np.testing.assert_array_equal(both.gnss.t, one.gnss.t)


def test_seconds_of_day_stop_at_the_first_that_is_none():
    t, bad = dates.seconds_of_day(["23:59:59.5", "0:00:00,25", "24:00:00"])
    np.testing.assert_allclose(t, [86_399.5, 86_400.25])
    assert bad == 2


def test_a_counter_of_32_bits_is_counted_on(tmp_path):
    header = IMU.replace("millis", "micros") + ",lat,lon,alt,speed,course"
    path = log(tmp_path, "held", header=header, stamp=lambda k: str((2**32 - 2_000_000 + 20_000 * k) % 2**32))
    recording = schuler.read(path, **READ)
    np.testing.assert_allclose(np.diff(recording.imu.t), 0.02, atol=1e-9)
    assert any("began again 1 times" in note for note in recording.metadata.notes)
    back = log(tmp_path, "held", header=header, stamp=lambda k: str(20_000 * (k if k < 200 else k - 100)))
    with pytest.raises(FileFormatError, match="is earlier than the row before"):
        schuler.read(back, **READ)


def test_a_counter_that_begins_again_before_the_first_fix_is_one_clock(tmp_path):
    header = IMU.replace("millis", "micros") + ",lat,lon,alt,speed,course"
    path = log(tmp_path, "empty", header=header, stamp=lambda k: str((2**32 - 200_000 + 20_000 * k) % 2**32))
    recording = schuler.read(path, **READ)
    assert recording.gnss.t[0] - recording.imu.t[0] == pytest.approx(0.02 * EVERY, abs=1e-9)


@pytest.mark.parametrize(("turned", "used"), [(0.0, True), (60.0, False)])
def test_a_heading_beside_a_speed_is_a_course_if_it_is_the_direction_of_motion(tmp_path, turned, used):
    path = tmp_path / "gps.csv"
    rows = [f"{k},{lat(k):.7f},9.1,300,{1.112:.3f},{turned:.1f}" for k in range(60)]
    path.write_text("\n".join(["time,gps_lat,gps_lon,gps_alt,gps_speed,gps_heading", *rows]) + "\n")
    recording = schuler.read(path, sigma="2,2,3,0.2,0.2,0.2")
    assert (recording.gnss.v_n is not None) == used
    assert any("not the direction of motion" in note for note in recording.metadata.notes) != used


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("gps_lat", "lat", None), ("GPS Altitude (m)", "h", "m"), ("speedKmph", "speed", "km/h"),
        ("speed_kmh", "speed", "km/h"), ("speed_knots", "speed", "kn"), ("numSV", "ns", None), ("sats", "ns", None),
        ("field.linear_acceleration.x", "ax", None), ("angular_velocity.z", "gz", None), ("timeMs", "t", "ms"),
        ("unix_ms", "t", "ms"), ("GyroX_dps", "gx", "deg/s"), ("IMU_AccelY", "ay", None), ("gps_time", "t", None),
    ],
)  # fmt: skip
def test_names_as_loggers_spell_them(header, name, unit):
    assert columns.recognise(header) == (name, unit)


@pytest.mark.parametrize(
    ("header", "names"),
    [
        ("time,ax,T", ["t", "ax", "temp"]), ("T,ax,temp", ["t", "ax", "temp"]), ("time,T,temp", ["t", None, "temp"]),
        ("millis,datetime,ax", ["t", None, "ax"]), ("datetime,T (C),ax", ["t", "temp", "ax"]),
        ("time,tow,ax", ["t", "t", "ax"]),
    ],
)  # fmt: skip
def test_one_time_is_told_among_columns_that_could_be_it(header, names):
    read = columns.recognise_all(header.split(","))
    assert [column and column[0] for column in read] == names
