"""Folders as apps and loggers leave them, of a simulated drive; their headers are written from memory."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from benchmarks import loggers
from diagnosis_drives import drive
from messy_folders import BOARD_RUB, nmea

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.recording.io.clock import to_unix
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries

FLU = np.diag([1.0, -1.0, -1.0])  # rows are where x, y, z of the sensor point in the vehicle
RFU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Drive:
    """Readings of a sensor mounted in a car, and the latest fix at each of them."""

    truth: Recording
    fixes: GnssSeries
    t: FloatArray
    accel: FloatArray
    gyro: FloatArray
    latest: np.ndarray
    dates: list[str]

    def at(self, values: FloatArray, decimals: int) -> list[str]:
        """Values of the latest fix at each sample."""
        return loggers.column(values[self.latest], decimals)

    @property
    def places(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Latitude and longitude [deg], height [m], speed [m/s], course [deg] of the fixes."""
        v, llh = self.fixes.need_velocity()[0], self.fixes.llh
        course = np.arctan2(v[:, 1], v[:, 0]) / units.DEG % 360.0
        return llh[:, 0] / units.DEG, llh[:, 1] / units.DEG, llh[:, 2], np.hypot(v[:, 0], v[:, 1]), course


def driven(rate: float, C: FloatArray) -> Drive:
    """A drive of 200 s with a sensor along whose axes ``C`` turns the vehicle's."""
    rng = np.random.default_rng(7)
    truth = drive(duration=200.0, rate=rate, seed=7, noise=(0.05, 0.003))
    fixes, imu = loggers.fixes_of(rng, truth), truth.need_imu()
    bias = rng.normal(0.0, 0.15, 3), rng.normal(0.0, 0.5 * units.DEG, 3)
    ns = np.round(to_unix(imu.t, truth.metadata.time) / 1e6).astype(np.int64).astype("M8[ms]")
    latest = np.clip(np.searchsorted(fixes.t, imu.t + 1e-9, side="right") - 1, 0, None)
    dates = [stamp.replace("T", " ") for stamp in np.datetime_as_string(ns).tolist()]
    return Drive(truth, fixes, imu.t - imu.t[0], (imu.accel + bias[0]) @ C.T, (imu.gyro + bias[1]) @ C.T, latest, dates)


def save(path: Path, head: list[str], cols: list[list[str]], delimiter: str = ",", before: str = "") -> None:
    """Write a table below some lines."""
    rows = [delimiter.join(row) for row in zip(*cols, strict=True)]
    path.write_text(before + "\n".join([delimiter.join(head), *rows]) + "\n", encoding="utf-8")


def triad(values: FloatArray, scale: float, decimals: int) -> list[list[str]]:
    """Three columns in another unit."""
    return [loggers.column(scale * x, decimals) for x in values.T]


def andro_sensor(path: Path) -> Drive:
    d = driven(50.0, BOARD_RUB)
    lat, lon, h, speed, course = d.places
    still = np.tile(BOARD_RUB @ [0.0, 0.0, -9.81], (len(d.t), 1))
    kinds = ("ACCELEROMETER", "m/s²"), ("GRAVITY", "m/s²"), ("LINEAR ACCELERATION", "m/s²"), ("GYROSCOPE", "rad/s")
    head = [f"{sensor} {c} ({unit})" for sensor, unit in kinds for c in "XYZ"]
    head += ["LOCATION Latitude : ", "LOCATION Longitude : ", "LOCATION Altitude ( m)", "LOCATION Altitude-google ( m)",
             "LOCATION Speed ( Kmh)", "LOCATION ORIENTATION (°)", "Satellites in range", "Time since start in ms ",
             "YYYY-MO-DD HH-MI-SS_SSS"]  # fmt: skip
    cols = [*triad(d.accel, 1.0, 4), *triad(still, 1.0, 4), *triad(d.accel - still, 1.0, 4), *triad(d.gyro, 1.0, 4)]
    cols += [d.at(lat, 7), d.at(lon, 7), d.at(h, 1), d.at(h - 47.5, 1), d.at(3.6 * speed, 2), d.at(course, 1)]
    cols += [["12 / 14"] * len(d.t), loggers.column(1e3 * d.t, 0), [f"{s[:-4]}:{s[-3:]}" for s in d.dates]]
    save(path / "Sensor_record.csv", head, cols, ";")
    return d


def sensor_log(path: Path) -> Drive:
    """Gravity of an iPhone points down: its accelerations are minus the specific force."""
    d = driven(100.0, RFU)
    lat, lon, h, speed, course = d.places
    head = [
        "loggingTime(txt)", "locationLatitude(WGS84)", "locationLongitude(WGS84)", "locationAltitude(m)",
        "locationSpeed(m/s)", "locationCourse(°)", "accelerometerTimestamp_sinceReboot(s)",
        "accelerometerAccelerationX(G)", "accelerometerAccelerationY(G)", "accelerometerAccelerationZ(G)",
        "gyroTimestamp_sinceReboot(s)", "gyroRotationX(rad/s)", "gyroRotationY(rad/s)", "gyroRotationZ(rad/s)",
        "motionUserAccelerationX(G)", "motionUserAccelerationY(G)", "motionUserAccelerationZ(G)",
    ]  # fmt: skip
    user = d.accel - d.accel.mean(axis=0)
    cols = [[f"{s} +0000" for s in d.dates], d.at(lat, 8), d.at(lon, 8), d.at(h, 3), d.at(speed, 2), d.at(course, 2)]
    cols += [loggers.column(53211.25 + d.t, 6), *triad(d.accel, -1.0 / units.G0, 6), loggers.column(53211.252 + d.t, 6)]
    save(path / "iPhone.csv", head, [*cols, *triad(d.gyro, 1.0, 6), *triad(user, -1.0 / units.G0, 6)])
    return d


def blackbox(path: Path) -> Drive:
    """Counts of 2048 in a g, whole deg/s; fixes in a file of their own on the same clock."""
    d = driven(200.0, FLU)
    lat, lon, h, speed, course = d.places
    triads = [f"{sensor}[{k}]" for sensor in ("gyroADC", "accSmooth") for k in range(3)]
    head = ["loopIteration", "time (us)", *triads, "motor[0]"]
    n, zero = len(d.t), 41234567.0
    cols = [loggers.column(np.arange(n), 0), loggers.column(zero + 1e6 * d.t, 0), *triad(d.gyro, 1.0 / units.DEG, 0)]
    save(path / "LOG.01.csv", head, [*cols, *triad(d.accel, 2048.0 / units.G0, 0), ["1200"] * n], ", ")
    head = [
        "time (us)",
        "GPS_numSat",
        "GPS_coord[0]",
        "GPS_coord[1]",
        "GPS_altitude",
        "GPS_speed (m/s)",
        "GPS_ground_course",
    ]
    t = zero + 1e6 * (d.fixes.t - d.truth.need_imu().t[0])
    numbers = ((t, 0), (0.0 * t + 14.0, 0), (lat, 7), (lon, 7), (h - 47.5, 0), (speed, 2), (course, 1))
    save(path / "LOG.01.gps.csv", head, [loggers.column(x, k) for x, k in numbers], ", ")
    return d


def openlog(path: Path) -> Drive:
    """Whole numbers of a u-blox receiver beside an IMU in mg and deg/s, times of day beside dates."""
    d = driven(25.0, FLU)
    lat, lon, h, speed, course = d.places
    head = [
        "rtcDate", "rtcTime", "gps_Date", "gps_Time", "gps_Lat", "gps_Long", "gps_Alt", "gps_AltMSL", "gps_SIV",
        "gps_GroundSpeed", "gps_Heading", "aX", "aY", "aZ", "gX", "gY", "gZ", "imu_degC",
    ]  # fmt: skip
    day = [f"{s[5:7]}/{s[8:10]}/{s[:4]}" for s in d.dates]
    clock = [s[11:] for s in d.dates]
    second = [clock[np.flatnonzero(d.latest == k)[0]][:8] for k in d.latest]
    cols = [day, [s[:-1] for s in clock], day, second, d.at(1e7 * lat, 0), d.at(1e7 * lon, 0), d.at(1e3 * h, 0)]
    cols += [d.at(1e3 * h - 47500.0, 0), ["14"] * len(day), d.at(1e3 * speed, 0), d.at(1e5 * course, 0)]
    cols += [*triad(d.accel, 1e3 / units.G0, 2), *triad(d.gyro, 1.0 / units.DEG, 2), ["30.25"] * len(day)]
    save(path / "dataLog00003.TXT", head, cols)
    return d


def shimmer(path: Path) -> Drive:
    """Units in a line below the header, and NMEA."""
    d = driven(100.0, FLU)
    stem = "Shimmer_5E6D_"
    unix = to_unix(d.truth.need_imu().t, d.truth.metadata.time) / 1e6
    head = [f"{stem}Timestamp_Unix_CAL", *(f"{stem}{s}_{c}_CAL" for s in ("Accel_WR", "Gyro") for c in "XYZ")]
    cols = [["ms", *loggers.column(unix, 3)]]
    cols += [["m/(s^2)", *x] for x in triad(d.accel, 1.0, 6)] + [
        ["deg/s", *x] for x in triad(d.gyro, 1.0 / units.DEG, 6)
    ]
    save(path / "Session1.csv", head, cols, "\t", '"sep=\t"\n')
    (path / "gps.nmea").write_text(nmea(replace(d.truth, gnss=d.fixes)), newline="")
    return d


def movella_dot(path: Path) -> Drive:
    """A counter of microseconds that a format of ours reads, and NMEA."""
    d = driven(60.0, FLU)
    ticks = (3123456789 + np.round(60.0 * d.t) * 16667) % 2**32
    head = ["PacketCounter", "SampleTimeFine", *(f"{s}_{c}" for s in ("FreeAcc", "Acc", "Gyr") for c in "XYZ")]
    cols = [
        loggers.column(np.arange(len(d.t)), 0),
        loggers.column(ticks, 0),
        *triad(d.accel - [0.0, 0.0, 9.81], 1.0, 6),
    ]
    cols += [*triad(d.accel, 1.0, 6), *triad(d.gyro, 1.0 / units.DEG, 6)]
    save(path / "DOT.csv", head, cols, ",", "sep=,\nDeviceTag:,Xsens DOT\nOutputRate:,60Hz\n\n")
    (path / "gps.nmea").write_text(nmea(replace(d.truth, gnss=d.fixes)), newline="")
    return d


def sensor_words(path: Path) -> Drive:
    """A word for the sensor at the beginning of each line, and a time of the phone's and of the sensor's."""
    d = driven(100.0, BOARD_RUB)
    lat, lon, h, speed, course = d.places
    head = "% ACCE;AppTimestamp(s);SensorTimestamp(s);Acc_X(m/s^2);Acc_Y(m/s^2);Acc_Z(m/s^2)\n"
    head += "% GYRO;AppTimestamp(s);SensorTimestamp(s);Gyr_X(rad/s);Gyr_Y(rad/s);Gyr_Z(rad/s)\n"
    head += "% GNSS;AppTimestamp(s);SensorTimeStamp(s);Latit(deg);Long(deg);Altitude(m);Bearing(deg);Speed(m/s)\n"
    rows = []
    for word, values, late in (("ACCE", d.accel, 0.0), ("GYRO", d.gyro, 0.001)):
        rows += [(t + late, f"{word};{5.0 + t + late:.3f};{7e4 + t:.3f};{x:.5f};{y:.5f};{z:.5f}")
                 for t, (x, y, z) in zip(d.t, values, strict=True)]  # fmt: skip
    at = d.fixes.t - d.truth.need_imu().t[0]
    rows += [
        (t, f"GNSS;{5.0 + t:.3f};{1.7e9 + t:.3f};{a:.7f};{b:.7f};{c:.2f};{e:.2f};{s:.2f}")
        for t, a, b, c, e, s in zip(at, lat, lon, h, course, speed, strict=True)
    ]
    (path / "logfile.txt").write_text(head + "\n".join(row for _, row in sorted(rows)) + "\n")
    return d


def flight_tables(path: Path) -> Drive:
    """Tables of a flight controller's messages: units in names, whole numbers of fixes, one clock in microseconds."""
    d = driven(200.0, np.eye(3))
    lat, lon, h, speed, course = d.places
    clock = 3e6 + 1e6 * d.t
    head = ["timestamp", *(f"{name}[{k}]" for name in ("gyro_rad", "accelerometer_m_s2") for k in range(3))]
    save(
        path / "log_sensor_combined_0.csv",
        head,
        [loggers.column(clock, 0), *triad(d.gyro, 1.0, 7), *triad(d.accel, 1.0, 6)],
    )
    t, v = 3e6 + 1e6 * (d.fixes.t - d.truth.need_imu().t[0]), d.fixes.need_velocity()[0]
    head = ["timestamp", "lat", "lon", "alt", "eph", "epv", "vel_m_s", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s", "cog_rad"]
    cols = [loggers.column(x, k) for x, k in ((t, 0), (1e7 * lat, 0), (1e7 * lon, 0), (1e3 * (h - 47.5), 0))]
    cols += [["1.5"] * len(t), ["2.5"] * len(t), loggers.column(speed, 3), *triad(v, 1.0, 3)]
    save(path / "log_vehicle_gps_position_0.csv", head, [*cols, loggers.column(units.DEG * course, 5)])
    return d


def adafruit(path: Path) -> Drive:
    """Blocks of lines as Adafruit's examples print them, with the times of a serial monitor."""
    d = driven(50.0, FLU)
    rows = []
    for stamp, f, w in zip(d.dates, d.accel, d.gyro, strict=True):
        block = (
            "\t\tTemperature 25.31 deg C",
            f"\t\tAccel X: {f[0]:.2f} \tY: {f[1]:.2f} \tZ: {f[2]:.2f} m/s^2 ",
            f"\t\tGyro X: {w[0]:.2f} \tY: {w[1]:.2f} \tZ: {w[2]:.2f} radians/s ",
            "",
        )
        rows += [f"{stamp[11:23]} -> {line}" for line in block]
    (path / "serial.txt").write_text("\n".join(rows) + "\n")
    (path / "gps.nmea").write_text(nmea(replace(d.truth, gnss=d.fixes)), newline="")
    return d


def ros2_echo(path: Path) -> Drive:
    """Messages as ``ros2 topic echo --csv`` prints them: every field, no header."""
    d = driven(100.0, FLU)
    stamps = [
        np.asarray(to_unix(t, d.truth.metadata.time)).astype(np.int64) for t in (d.t + d.truth.imu.t[0], d.fixes.t)
    ]
    nine = "0.01,0.0,0.0,0.0,0.01,0.0,0.0,0.0,0.01"
    rows = [
        f"{ns // 10**9},{ns % 10**9},imu_link,0.0,0.0,0.0,1.0,{nine},{w[0]:.9f},{w[1]:.9f},{w[2]:.9f},{nine},"
        f"{f[0]:.9f},{f[1]:.9f},{f[2]:.9f},{nine}"
        for ns, w, f in zip(stamps[0].tolist(), d.gyro, d.accel, strict=True)
    ]
    (path / "imu.csv").write_text("\n".join(rows) + "\n")
    variances = "2.25,0.0,0.0,0.0,2.25,0.0,0.0,0.0,9.0"
    rows = [
        f"{ns // 10**9},{ns % 10**9},gps,0,1,{lat:.9f},{lon:.9f},{h:.3f},{variances},2"
        for ns, lat, lon, h in zip(stamps[1].tolist(), *d.places[:3], strict=True)
    ]
    (path / "fix.csv").write_text("\n".join(rows) + "\n")
    return d


def decimeter_challenge(path: Path) -> Drive:
    """Sensors a row each, places that all satellites of an epoch repeat, and the truth."""
    d = driven(100.0, BOARD_RUB)
    t, fixes = (
        np.round(np.asarray(to_unix(t, d.truth.metadata.time)) / 1e6).astype(np.int64).tolist()
        for t in (d.t + d.truth.imu.t[0], d.fixes.t)
    )
    rows = ["MessageType,utcTimeMillis,MeasurementX,MeasurementY,MeasurementZ,BiasX,BiasY,BiasZ"]
    for ms, f, w in zip(t, d.accel, d.gyro, strict=True):
        rows.append(f"UncalAccel,{ms},{f[0]:.6f},{f[1]:.6f},{f[2]:.6f},0.0,0.0,0.0")
        rows.append(f"UncalGyro,{ms},{w[0]:.7f},{w[1]:.7f},{w[2]:.7f},0.0,0.0,0.0")
    (path / "device_imu.csv").write_text("\n".join(rows) + "\n")
    rows = ["MessageType,utcTimeMillis,TimeNanos,Svid,Cn0DbHz," + ",".join(f"WlsPosition{c}EcefMeters" for c in "XYZ")]
    for ms, r in zip(fixes, frames.ecef_from_llh(d.fixes.llh), strict=True):
        rows += [f"Raw,{ms},{ms}000000,{sat},38.5,{r[0]:.4f},{r[1]:.4f},{r[2]:.4f}" for sat in range(3, 9)]
    (path / "device_gnss.csv").write_text("\n".join(rows) + "\n")
    rows = [
        "MessageType,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,BearingDegrees,UnixTimeMillis"
    ]
    rows += [
        f"Fix,GT,{lat:.9f},{lon:.9f},{h:.3f},{speed:.3f},{course:.2f},{ms}"
        for lat, lon, h, speed, course, ms in zip(*d.places, fixes, strict=True)
    ]
    (path / "ground_truth.csv").write_text("\n".join(rows) + "\n")
    return d


def counts_of_no_unit(path: Path) -> Drive:
    """Counts whose number in a g is near thousandths of a g, and far enough from them."""
    d = driven(50.0, FLU)
    head = ["time_ms", *(f"raw_{sensor}{c}" for sensor in "ag" for c in "xyz")]
    cols = [*triad(d.accel, 1670.0 / units.G0, 0), *triad(d.gyro, 16.4 / units.DEG, 0)]
    save(path / "log.csv", head, [loggers.column(1e3 * d.t, 0), *cols])
    (path / "gps.nmea").write_text(nmea(replace(d.truth, gnss=d.fixes)), newline="")
    return d


LAYOUTS: tuple[Callable[[Path], Drive], ...] = (
    andro_sensor, sensor_log, blackbox, openlog, shimmer, movella_dot, sensor_words, flight_tables, adafruit,
    ros2_echo, decimeter_challenge, counts_of_no_unit,
)  # fmt: skip
