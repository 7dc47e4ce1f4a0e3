"""Folders of logs as people have them, made of a drive in closed form whose truth stands beside them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from diagnosis_drives import drive

from schuler import units
from schuler.recording.io import write
from schuler.recording.io.clock import to_unix
from schuler.recording.recording import Recording
from schuler.timebase import calendar

_SEPARATION = 47.5  # geoid above the ellipsoid [m]
#: Rows are where the board's x, y, z point in the vehicle: x right, y up, z back.
BOARD_RUB = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Folder:
    """A folder with its clean recording and what only its maker knows."""

    path: Path
    truth: Recording  # of which the fixes are good to 2 cm
    clock_s: float  # to be added to the board's seconds for those of the recording


def sentence(body):
    total = 0
    for character in body:
        total ^= ord(character)
    return f"${body}*{total:02X}\r\n"


def nmea(recording):
    """GGA and RMC of every fix, on UTC."""
    g, epoch = recording.gnss, recording.metadata.time.epoch_gps_s
    lines = []
    for t, (lat, lon, h), v in zip(g.t, g.llh, g.v_n, strict=True):
        at = calendar(epoch + t - 18.0)  # leap seconds since 2017
        lat_deg, lon_deg = lat / units.DEG, lon / units.DEG
        clock = at.strftime("%H%M%S.") + f"{at.microsecond // 10000:02d}"
        place = f"{int(lat_deg):02d}{60 * (lat_deg % 1):09.6f},N,{int(lon_deg):03d}{60 * (lon_deg % 1):09.6f},E"
        speed, course = np.hypot(v[0], v[1]) / units.KNOT, np.arctan2(v[1], v[0]) / units.DEG % 360.0
        lines.append(sentence(f"GPGGA,{clock},{place},1,09,0.9,{h - _SEPARATION:.2f},M,{_SEPARATION:.1f},M,,"))
        lines.append(sentence(f"GPRMC,{clock},A,{place},{speed:.3f},{course:.2f},{at.strftime('%d%m%y')},,,A"))
    return "".join(lines)


def phone_fixes(recording, rng, sigma=1.5):
    """Fixes of a phone: once a second, metres off, slowly wandering."""
    g = recording.gnss
    g = g.where(np.arange(len(g)) % 5 == 0)
    noise = rng.normal(0.0, sigma, (len(g), 3))
    noise = 0.3 * noise + 0.7 * np.cumsum(rng.normal(0.0, 0.25, noise.shape), axis=0)
    llh = g.llh + noise * [1.0 / 6.378e6, 1.0 / (6.378e6 * np.cos(g.llh[0, 0])), -1.0]
    return replace(g, llh=llh)


def arduino(folder, seed=5):
    """An Arduino's IMU (g, deg/s, ms since its start with jitter and a gap, odd header, turned) and a phone's NMEA."""
    rng = np.random.default_rng(seed)
    clean = drive(duration=240.0, rate=100.0, seed=seed, noise=(0.05, 0.003))
    imu = clean.imu
    keep = (imu.t < 120.0) | (imu.t > 120.35)
    start = 3.217
    ms = np.round(1000.0 * (imu.t[keep] + start) + rng.uniform(-1.5, 1.5, keep.sum()))
    ms = np.maximum.accumulate(ms)
    f = imu.accel[keep] @ BOARD_RUB.T / units.G0
    w = imu.gyro[keep] @ BOARD_RUB.T / units.DEG
    with (folder / "LOG0042.TXT").open("w", encoding="ascii") as out:
        out.write("MPU6050 found, calibrating\nDone.\n\nt(ms);AcX;AcY;AcZ;Tmp(C);GyX;GyY;GyZ\n")
        for k in range(len(ms)):
            a, b = ";".join(f"{x:.4f}" for x in f[k]), ";".join(f"{x:.3f}" for x in w[k])
            out.write(f"{ms[k]:.0f};{a};{25.0 + k / 1e5:.2f};{b}\n")
    (folder / "phone.nmea").write_text(nmea(replace(clean, gnss=phone_fixes(clean, rng))), encoding="ascii", newline="")
    return Folder(folder, clean, -start)


def simulated(duration=150.0, seed=11):
    """Drive with a good MEMS and fixes of a phone, and the truth; an antenna in the IMU."""
    clean = drive(duration=duration, rate=50.0, seed=seed, noise=(0.05, 0.003))
    fixes = phone_fixes(clean, np.random.default_rng(seed))
    n = len(fixes)
    cov, cov_v = np.tile(1.5**2 * np.eye(3), (n, 1, 1)), np.tile(0.1**2 * np.eye(3), (n, 1, 1))
    return clean, replace(clean, gnss=replace(fixes, cov_r_n=cov, cov_v_n=cov_v))


def iso(recording, t):
    """Dates of UTC to the microsecond."""
    ns = np.round(to_unix(t, recording.metadata.time) / 1e3).astype(np.int64).astype("M8[us]")
    return [f"{text}Z" for text in np.datetime_as_string(ns).tolist()]


def written(recording, folder, name, **options):
    """As one of our writers has it."""
    write(recording, folder / name, **options)


def one_part(recording, part):
    others = {other: None for other in ("imu", "gnss", "reference") if other != part}
    return replace(recording, **others)


def waypoint_and_rtklib(recording, folder):
    write(one_part(recording, "imu"), folder / "rover.imr")
    write(one_part(recording, "gnss"), folder / "rover.pos")


def two_sensors_and_gpx(recording, folder):
    """Accelerometer in g and gyroscope in deg/s with stamps of their own, three bare axes each; a watch's track."""
    imu = recording.imu
    later = imu.t[:-1] + 0.007
    rates = np.stack([np.interp(later, imu.t, imu.gyro[:, k]) for k in range(3)], axis=1)
    tables = {
        "accel.csv": ("time,x (g),y (g),z (g)", imu.t, imu.accel @ BOARD_RUB.T / units.G0),
        "gyro.csv": ("time,x (deg/s),y (deg/s),z (deg/s)", later, rates @ BOARD_RUB.T / units.DEG),
    }
    for name, (head, t, values) in tables.items():
        rows = (f"{at},{a:.5f},{b:.5f},{c:.5f}" for at, (a, b, c) in zip(iso(recording, t), values, strict=True))
        (folder / name).write_text("\n".join((head, *rows)) + "\n", encoding="ascii")
    write(one_part(recording, "gnss"), folder / "watch.gpx")


def text_and_nmea(recording, folder):
    """No header, Unix milliseconds, millig and deg/s, a temperature; a receiver's sentences."""
    imu = recording.imu
    ms = to_unix(imu.t, recording.metadata.time) // 10**6
    values = np.hstack((imu.accel @ BOARD_RUB.T / units.G0 * 1e3, imu.gyro @ BOARD_RUB.T / units.DEG))
    rows = (f"{at} " + " ".join(f"{x:.3f}" for x in row) for at, row in zip(ms, values, strict=True))
    (folder / "board.log").write_text("\n".join(rows) + "\n", encoding="ascii")
    (folder / "receiver.nmea").write_text(nmea(recording), encoding="ascii", newline="")


def over_ground(recording):
    g = recording.gnss
    return np.hypot(g.v_n[:, 0], g.v_n[:, 1]), np.arctan2(g.v_n[:, 1], g.v_n[:, 0]) / units.DEG % 360.0


def sensor_logger(recording, folder):
    """The phone upright in its holder, its screen to the driver."""
    imu, g = recording.imu, recording.gnss

    def save(name, head, t, values):
        ns = to_unix(t, recording.metadata.time)
        rows = (
            f"{at},{s:.3f},{','.join(f'{x:.9g}' for x in v)}" for at, s, v in zip(ns, t - t[0], values, strict=True)
        )
        (folder / f"{name}.csv").write_text("\n".join((f"time,seconds_elapsed,{head}", *rows)) + "\n")

    save("TotalAcceleration", "x,y,z", imu.t, imu.accel @ BOARD_RUB.T)
    save("Gyroscope", "x,y,z", imu.t, imu.gyro @ BOARD_RUB.T)
    speed, course = over_ground(recording)
    n = len(g)
    place = np.column_stack((g.llh[:, :2] / units.DEG, g.llh[:, 2], np.full(n, 2.3), np.full(n, 1.5), speed, course,
                             np.full(n, 0.1), np.full(n, 1.0)))  # fmt: skip
    save("Location", "latitude,longitude,altitude,horizontalAccuracy,verticalAccuracy,speed,bearing,speedAccuracy,"
         "bearingAccuracy", g.t, place)  # fmt: skip


def phyphox(recording, folder):
    """Seconds of the experiment; the gyroscope runs at stamps of its own."""
    imu, g = recording.imu, recording.gnss
    zero = imu.t[0]

    def save(name, head, t, values):
        rows = (f"{at - zero:.9E},{','.join(f'{x:.12E}' for x in v)}" for at, v in zip(t, values, strict=True))
        (folder / f"{name}.csv").write_text("\n".join((f'"Time (s)",{head}', *rows)) + "\n", encoding="utf-8")

    later = imu.t[:-1] + 0.004
    rates = np.stack([np.interp(later, imu.t, imu.gyro[:, k]) for k in range(3)], axis=1)
    save("Accelerometer", ",".join(f'"Acceleration {c} (m/s^2)"' for c in "xyz"), imu.t, imu.accel @ BOARD_RUB.T)
    save("Gyroscope", ",".join(f'"Gyroscope {c} (rad/s)"' for c in "xyz"), later, rates @ BOARD_RUB.T)
    speed, course = over_ground(recording)
    place = np.column_stack((g.llh[:, :2] / units.DEG, g.llh[:, 2], speed, course, np.full((len(g), 2), (2.3, 1.5))))
    head = ("Latitude (°)", "Longitude (°)", "Height (m)", "Velocity (m/s)", "Direction (°)", "Horizontal Accuracy (m)",
            "Vertical Accuracy (m)")  # fmt: skip
    save("Location", ",".join(f'"{word}"' for word in head), g.t, place)
    (folder / "meta").mkdir()
    start = to_unix(np.array([zero]), recording.metadata.time)[0] / 1e9
    text = f'"event","experiment time","system time","system time text"\n"START",0.0,{start:.6f},"-"\n'
    (folder / "meta" / "time.csv").write_text(text)


def gnss_logger(recording, folder):
    imu, g = recording.imu, recording.gnss
    head = (
        "# Version: v3.0.6.4 Platform: 14 Manufacturer: Google Model: Pixel 7\n#\n"
        "# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2\n"
        "# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec\n"
        "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
        "UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters\n#\n"
    )
    zero = imu.t[0]
    rows = []
    for name, values in (("UncalAccel", imu.accel @ BOARD_RUB.T), ("UncalGyro", imu.gyro @ BOARD_RUB.T)):
        ms = to_unix(imu.t, recording.metadata.time) // 10**6
        ns = np.round((imu.t - zero) * 1e9).astype(np.int64) + 500 * 10**9
        rows += [(n, f"{name},{m},{n},{a:.9g},{b:.9g},{c:.9g}") for m, n, (a, b, c) in zip(ms, ns, values, strict=True)]
    speed, course = over_ground(recording)
    ms, ns = to_unix(g.t, recording.metadata.time) // 10**6, np.round((g.t - zero) * 1e9).astype(np.int64) + 500 * 10**9
    for m, n, (lat, lon, h), v, c in zip(ms, ns, g.llh, speed, course, strict=True):
        place = f"{lat / units.DEG:.10f},{lon / units.DEG:.10f},{h:.4f}"
        rows.append((n, f"Fix,GPS,{place},{v:.6f},2.3,{c:.6f},{m},0.1,1.0,{n},1.5"))
    text = "\n".join(row for _, row in sorted(rows, key=lambda row: row[0]))
    (folder / "gnss_log.txt").write_text(head + text + "\n")


#: Folder of a simulated drive by the name of its format; all but the first ones are turned (x right, y up, z back).
FOLDERS = {
    "parquet": lambda r, f: written(r, f, "drive.parquet"),
    "csv": lambda r, f: written(r, f, "drive.csv"),
    "netcdf": lambda r, f: written(r, f, "drive.nc"),
    "mcap": lambda r, f: written(r, f, "drive.mcap"),
    "imr-pos": waypoint_and_rtklib, "two-sensors-gpx": two_sensors_and_gpx, "text-nmea": text_and_nmea,
    "sensor-logger": sensor_logger, "phyphox": phyphox, "gnss-logger": gnss_logger,
}  # fmt: skip
