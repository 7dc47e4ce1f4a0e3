"""Headers of apps and loggers: each column is told by the words of all, and what is another quantity is not taken."""

import numpy as np
import pytest

from schuler import read
from schuler.exceptions import InputError
from schuler.recording.formats.text import recognised_series
from schuler.recording.io import columns, header_words

SENSOR_LOG = (
    "loggingTime(txt),locationTimestamp_since1970(s),locationLatitude(WGS84),locationLongitude(WGS84),"
    "locationAltitude(m),locationSpeed(m/s),locationCourse(°),locationHorizontalAccuracy(m),"
    "accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),accelerometerAccelerationY(G),"
    "accelerometerAccelerationZ(G),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),"
    "gyroRotationZ(rad/s),motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s),"
    "motionUserAccelerationX(G),motionUserAccelerationY(G),motionUserAccelerationZ(G)"
)
ANDRO_SENSOR = (
    "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);LINEAR ACCELERATION X (m/s²);"
    "LINEAR ACCELERATION Y (m/s²);LINEAR ACCELERATION Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);"
    "GYROSCOPE Z (rad/s);LOCATION Latitude : ;LOCATION Longitude : ;LOCATION Altitude ( m);"
    "LOCATION Altitude-google ( m);LOCATION Speed ( Kmh);Time since start in ms "
)
BLACKBOX = "time (us), gyroADC[0], gyroADC[1], gyroADC[2], accSmooth[0], accSmooth[1], accSmooth[2], motor[0]"
FLIGHT = (
    "Clock:Tick#,Clock:offsetTime,IMU_ATTI(0):Longitude,IMU_ATTI(0):Latitude,IMU_ATTI(0):accelX,IMU_ATTI(0):accelY,"
    "IMU_ATTI(0):accelZ,IMU_ATTI(0):accelComposite,IMU_ATTI(0):gyroX,IMU_ATTI(0):gyroY,IMU_ATTI(0):gyroZ,GPS(0):Long,"
    "GPS(0):Lat,GPS(0):heightMSL,GPS(0):velN,GPS(0):velE,GPS(0):velD"
)
TRIADS = "ax ay az gx gy gz"


def named(header, delimiter=","):
    """Short names of a header by position, what is not known left out."""
    read = columns.recognise_all(header.split(delimiter))
    return {k: column[0] for k, column in enumerate(read) if column is not None}


@pytest.mark.parametrize(
    ("header", "delimiter", "at", "names"),
    [
        (SENSOR_LOG, ",", [2, 3, 4, 5, 6, 8, 9, 10, 11, 13, 14, 15], f"lat lon h speed course t {TRIADS}"),
        (ANDRO_SENSOR, ";", [0, 1, 2, 6, 7, 8, 9, 10, 11, 13, 14], f"{TRIADS} lat lon h speed t"),
        (BLACKBOX, ",", [0, 1, 2, 3, 4, 5, 6], "t gx gy gz ax ay az"),
        ("time (us),GPS_fixType,GPS_coord[0],GPS_coord[1],GPS_altitude,GPS_speed (m/s)", ",", [0, 2, 3, 4, 5],
         "t lat lon h speed"),
        (FLIGHT, ",", [1, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16], f"t {TRIADS} lon lat h vn ve vd"),
        ("time,gFx,gFy,gFz,ax,ay,az,wx,wy,wz", ",", [0, 1, 2, 3, 7, 8, 9], f"t {TRIADS}"),
        ("cts,Accelerometer (z) [m/s²],Accelerometer (x) [m/s²],Accelerometer (y) [m/s²]", ",", [0, 1, 2, 3],
         "t az ax ay"),
        ("rtcTime,gps_Time,gps_Lat,gps_Long,gps_Alt,gps_AltMSL,aX,aY,aZ,gX,gY,gZ", ",",
         [0, 2, 3, 4, 6, 7, 8, 9, 10, 11], f"t lat lon h {TRIADS}"),
        ("timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],accelerometer_m_s2[0],accelerometer_m_s2[1],"
         "accelerometer_m_s2[2]", ",", [0, 1, 2, 3, 4, 5, 6], "t gx gy gz ax ay az"),
        ("Time (UTC),PosLat (deg),PosLon (deg),PosAlt (m),VelNorth (m/s),VelEast (m/s),VelDown (m/s),"
         "AngleRateX (deg/s),AngleRateY (deg/s),AngleRateZ (deg/s),AngleX (deg)", ",", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
         "t lat lon h vn ve vd gx gy gz"),
        ("Time,GPS Latitude,GPS Longitude,InlineAcc,LateralAcc,VerticalAcc,RollRate,PitchRate,YawRate,Lap", ",",
         range(9), f"t lat lon {TRIADS}"),
        ("EPOCH_NS,ACC_X_MPS2,ACC_Y_MPS2,ACC_Z_MPS2,GYR_X_RADPS,GYR_Y_RADPS,GYR_Z_RADPS", ",", range(7), f"t {TRIADS}"),
        ("SampleTimeFine,FreeAcc_X,FreeAcc_Y,FreeAcc_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z", ",",
         [0, 4, 5, 6, 7, 8, 9], f"t {TRIADS}"),
        ("time,I[0].pqr[0],I[0].pqr[1],I[0].pqr[2],I[0].acc[0],I[0].acc[1],I[0].acc[2],status", ",", range(7),
         "t gx gy gz ax ay az"),
        ("time,week,status,lla[0],lla[1],lla[2],hMSL,hAcc,vAcc", ",", [0, 3, 4, 5, 7, 8], "t lat lon h radius sd"),
        ("time,lat,lon,ele,hdop,sat", ",", [0, 1, 2, 3, 4], "t lat lon h hdop"),
        ("Timpstemp,imgid,lat,lon,alt,s_variance_m_s,vel_n_m_s,vel_e_m_s,vel_d_m_s,", ",", [0, 2, 3, 4, 6, 7, 8],
         "t lat lon h vn ve vd"),
    ],
)  # fmt: skip
def test_words_tell_the_columns_of_a_header(header, delimiter, at, names):
    assert named(header, delimiter) == dict(zip(at, names.split(), strict=True))


@pytest.mark.parametrize(
    "header",
    [
        "userAccelerationX,userAccelerationY,userAccelerationZ",  # without gravity
        "accel_bias_x,accel_bias_y,accel_bias_z,gyro_std_x,gyro_std_y,gyro_std_z",
        "device accelerometer x,device accelerometer y",  # an axis is missing
        "front_gyro_raw_x,front_gyro_raw_y,front_gyro_raw_z,rear_gyro_raw_x,rear_gyro_raw_y,rear_gyro_raw_z",
        "home_latitude,home_longitude",
        "sensorLatitude",
    ],
)
def test_other_quantities_and_two_sensors_of_a_kind_are_left_open(header):
    assert not named(header)


def test_a_spelling_that_is_known_stands_over_words():
    assert named("ax,ay,az,device acc x,device acc y,device acc z,time,packet time") == {
        0: "ax", 1: "ay", 2: "az", 6: "t",
    }  # fmt: skip


def test_units_stand_in_brackets_behind_a_time_or_below_the_header():
    assert columns.unit_in("Time since start in ms ") == "ms"
    assert columns.unit_in("Accelerometer (z) [m/s²]") == "m/s²"
    assert columns.unit_in("Accel_X_CAL [m/(s^2)]") == "m/(s^2)"
    assert columns.unit_in("gyroADC[0]") is None
    assert columns.unit_in("locationLatitude(WGS84)") is None
    assert header_words.time_unit("rise in s") is None


def test_a_log_states_its_units_in_a_line_of_their_own_below_settings(tmp_path):
    t = 1e3 * np.arange(50.0) / 50.0
    rows = "".join(f"{x:.1f}\t9.8\t0.0\t1.0\t90.0\t0.0\t0.0\t17 V\n" for x in t)
    stem = "Unit_5E6D"
    names = [f"{stem}_Timestamp", *(f"{stem}_{s}_{c}_CAL" for s in ("Accel_WR", "Gyro") for c in "XYZ"), "Battery"]
    units = ["ms", *["m/(s^2)"] * 3, *["deg/s"] * 3, "none"]
    log = tmp_path / "log.csv"
    log.write_text('"sep=\t"\nLaps\t1\n' + "\t".join(names) + "\n" + "\t".join(units) + "\n" + rows)
    imu = read(log).need_imu()
    np.testing.assert_allclose(imu.t[-1], 0.98, atol=1e-12)  # rounding
    np.testing.assert_allclose(imu.gyro[:, 0], np.pi / 2.0, atol=1e-12)  # rounding
    np.testing.assert_allclose(imu.accel[0], [9.8, 0.0, 1.0], atol=1e-12)


def test_a_temperature_of_no_known_unit_is_left_out_and_said(tmp_path):
    log = tmp_path / "log.csv"
    rows = "".join(f"{k / 50:.2f},0.0,0.0,-9.8,0.0,0.0,0.0,31.2\n" for k in range(50))
    log.write_text("t (s),ax (m/s^2),ay (m/s^2),az (m/s^2),gx (rad/s),gy (rad/s),gz (rad/s),T(°)\n" + rows)
    recording = read(log)
    assert recording.need_imu().temperature is None
    assert any("temperature was left out" in note and "T(°)" in note for note in recording.metadata.notes)


@pytest.mark.parametrize(("number", "kept"), [("4400", False), ("-3920", False), ("44", True), ("-40", True)])
def test_a_temperature_in_counts_or_hundredths_is_left_out_and_said(tmp_path, number, kept):
    log = tmp_path / "log.csv"
    rows = "".join(f"{k / 50:.2f},0,0,-9.81,0,0,0,{number}\n" for k in range(50))
    log.write_text("t,ax,ay,az,gx,gy,gz,temp\n" + rows)
    recording = read(log, units="m/s^2,rad/s")
    assert (recording.need_imu().temperature is not None) == kept
    assert any("temperature was left out" in note for note in recording.metadata.notes) != kept
    if not kept:  # a stated unit is believed, and what it makes is checked
        with pytest.raises(InputError, match="the temperature is"):
            read(log, units="accel=m/s^2,gyro=rad/s,temp=degC")


def test_of_two_columns_that_may_be_heights_neither_is_taken_and_both_are_named(tmp_path):
    path = tmp_path / "fixes.csv"
    rows = "".join(f"{k},48.{k:02},11.5,500,600\n" for k in range(20))
    path.write_text("time,lat,lon,alt_a,alt_b\n" + rows, encoding="utf-8")
    notes = read(path, sigma="1,1,2").metadata.notes
    assert any("alt_a, alt_b" in note and "h=alt_a" in note for note in notes)


def test_places_without_heights_are_fixes_whose_height_says_nothing(tmp_path):
    log = tmp_path / "log.csv"
    head = "time (s),gFx (g),gFy (g),gFz (g),wx (rad/s),wy (rad/s),wz (rad/s),Latitude,Longitude,Speed (m/s)\n"
    rows = "".join(f"{k / 50:.2f},0,0,-1.0,0,0,0,{48.7 + 1e-5 * (k // 10):.5f},9.1,0.0\n" for k in range(50))
    log.write_text(head + rows)
    recording = read(log, sigma="3,3,5")
    assert any("no height beside latitude and longitude" in note for note in recording.metadata.notes)
    np.testing.assert_array_equal(recording.need_gnss().llh[:, 2], 0.0)
    np.testing.assert_array_equal(recording.need_gnss().cov_r_n, np.tile(np.diag([9.0, 9.0, 1e6]), (5, 1, 1)))
    with pytest.raises(InputError, match="no column is a height"):
        read(log, sigma="3,3,5", height="ellipsoidal")


@pytest.mark.parametrize(
    ("last", "height", "unit"),
    [
        ("altWGS84", "altWGS84", None),
        ("AltMSL;AltHAE", "AltHAE", None),  # of two that above the ellipsoid
        ("GpsAltFeet;baro_altitude", "GpsAltFeet", "ft"),
        ("elev mm;satellite_elevation", "elev mm", "mm"),
        ("HeightAboveSea;alt_rate", "HeightAboveSea", None),
        ("alt_a;alt_b", None, None),  # either may be it
        ("alternator;hgt_sigma;halt", None, None),
    ],
)
def test_a_height_of_fixes_by_the_beginning_of_its_word(last, height, unit):
    header = ["time", "lat", "lon", *last.split(";")]
    read = dict(zip(header, columns.recognise_all(header), strict=True))
    assert [name for name, column in read.items() if column and column[0] == "h"] == ([height] if height else [])
    if height is not None:
        assert read[height] == ("h", unit)


def test_units_among_the_words_of_a_sensor():
    assert columns.unit_in("gyro_rad[0]") == "rad/s"
    assert columns.unit_in("accelerometer_m_s2[1]") == "m/s^2"
    assert columns.unit_in("gyroADC[0]") is None


def test_a_line_of_units_and_one_of_sources_stand_below_a_header(tmp_path):
    path = tmp_path / "session.csv"
    head = [
        "Session,Home",
        "timestamp,lap_number,x_acc,y_acc,z_acc,x_rate_of_rotation,y_rate_of_rotation,z_rate_of_rotation",
    ]
    units = ["unix time,,G,G,G,deg/s,deg/s,deg/s", ",,101: acc,101: acc,101: acc,102: gyro,102: gyro,102: gyro"]
    rows = [f"{1.7e9 + k / 20:.3f},1,0.01,0.02,-1.0,0.1,0.2,{k % 5}" for k in range(200)]
    path.write_text("\n".join([*head, *units, *rows]) + "\n")
    imu = read(path, time="unix").need_imu()
    np.testing.assert_allclose(imu.accel[0], np.array([0.01, 0.02, -1.0]) * 9.80665, rtol=1e-12)
    np.testing.assert_allclose(imu.gyro[3], np.deg2rad([0.1, 0.2, 3.0]), rtol=1e-12)


def test_three_axes_of_some_sensor_are_no_reference(tmp_path):
    for name, size in (("magnetometer", 40.0), ("truth", 6.4e6)):
        rows = "".join(f"{k / 10},{size},{0.1 * k},{-0.2 * k}\n" for k in range(50))
        (tmp_path / f"{name}.csv").write_text(f"time,x,y,z\n{rows}")
    assert recognised_series(tmp_path / "magnetometer.csv") == ()
    assert recognised_series(tmp_path / "truth.csv") == ("reference",)


def test_settings_in_quotes_above_a_header_and_a_hash_among_its_units(tmp_path):
    settings = '"Driver","X"\n"Time","10:11 AM"\n"Sample Rate","50"\n\n'
    head = '"Time","Nsat","InlineAcc","LateralAcc","VerticalAcc","RollRate","PitchRate","YawRate"\n'
    units = '"s","#","g","g","g","deg/s","deg/s","deg/s"\n\n'
    rows = "".join(f'"{k / 50:.2f}","14","0.1","0.0","-1.0","0.1","0.2","{k % 5}"\n' for k in range(200))
    path = tmp_path / "session.csv"
    path.write_text(settings + head + units + rows)
    imu = read(path).need_imu()
    np.testing.assert_allclose(np.diff(imu.t), 0.02, atol=1e-12)  # rounding
    np.testing.assert_allclose(imu.gyro[3], np.deg2rad([0.1, 0.2, 3.0]), rtol=1e-12)
