"""Folders of logs as people have them, made of a drive in closed form whose truth stands beside them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from diagnosis_drives import drive

from schuler import units
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
