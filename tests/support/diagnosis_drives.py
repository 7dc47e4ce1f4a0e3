"""A drive in closed form, and ways to spoil it."""

from dataclasses import replace

import numpy as np

from schuler import rotation
from schuler.earth import gravity_somigliana, radii_of_curvature
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.timebase import TimeBase

LAT, LON = np.radians(48.7), np.radians(9.1)
SWAP_XY = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def motion(t):
    """Speed, heading, pitch, roll over time of a drive through a hilly town; at rest for the first 15 s."""
    go = np.clip((t - 15.0) / 5.0, 0.0, 1.0) ** 2
    speed = go * (9.0 + 4.0 * np.sin(0.21 * t) + 2.0 * np.sin(0.53 * t + 1.0))
    heading = 0.4 + go * (1.2 * np.sin(0.11 * t) + 0.9 * np.sin(0.27 * t) + 0.02 * t + 0.04 * np.sin(1.5 * t))
    slope = go * 0.05 * np.sin(0.07 * t)
    pitch = slope + go * 0.012 * np.sin(1.3 * t)
    roll = go * (0.025 * np.sin(0.9 * t) + 0.015 * np.sin(1.7 * t + 0.3))
    return speed, heading, slope, pitch, roll


def drive(duration=180.0, rate=100.0, seed=3, noise=(0.03, 0.002)):
    """Recording of the drive with an IMU of a good MEMS and a GNSS receiver at 5 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)

    def velocity(x):
        speed, heading, slope, *_ = motion(x)
        return np.stack(
            (
                speed * np.cos(heading) * np.cos(slope),
                speed * np.sin(heading) * np.cos(slope),
                -speed * np.sin(slope),
            ),
            axis=1,
        )

    def attitude(x):
        _, heading, _, pitch, roll = motion(x)
        return np.stack((roll, pitch, heading), axis=1)

    h = 1e-3
    a_n = (velocity(t + h) - velocity(t - h)) / (2.0 * h)
    rpy = attitude(t)
    rpy_rate = (attitude(t + h) - attitude(t - h)) / (2.0 * h)
    C_nb = rotation.dcm_from_rpy(rpy)
    g = float(gravity_somigliana(LAT, 300.0))
    f = np.einsum("nji,nj->ni", C_nb, a_n - np.array([0.0, 0.0, g]))
    w = rotation.body_rate_from_rpy(rpy, rpy_rate)
    f = f + rng.normal(0.0, noise[0], f.shape) + np.array([0.05, -0.04, 0.06])
    w = w + rng.normal(0.0, noise[1], w.shape) + np.array([0.002, -0.001, 0.0015])
    imu = ImuSeries(t, w, f)

    fine = np.arange(0.0, duration, 0.01)
    v = velocity(fine)
    r = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * (v[1:] + v[:-1]) * 0.01, axis=0)))
    tg = np.arange(0.3, duration - 0.5, 0.2)
    rg = np.stack([np.interp(tg, fine, r[:, k]) for k in range(3)], axis=1) + rng.normal(0.0, 0.02, (len(tg), 3))
    R_N, R_E = radii_of_curvature(LAT)
    llh = np.stack(
        (LAT + rg[:, 0] / (R_N + 300.0), LON + rg[:, 1] / ((R_E + 300.0) * np.cos(LAT)), 300.0 - rg[:, 2]), axis=1
    )
    n = len(tg)
    vg = velocity(tg) + rng.normal(0.0, 0.02, (n, 3))
    gnss = GnssSeries(tg, llh, np.tile(np.eye(3) * 0.02**2, (n, 1, 1)), vg, np.tile(np.eye(3) * 0.03**2, (n, 1, 1)))
    return Recording(imu=imu, gnss=gnss, metadata=Metadata("drive", TimeBase("gps", 1.4e9)))


def with_imu(recording, **changes):
    return replace(recording, imu=replace(recording.imu, **changes))


def with_gnss(recording, **changes):
    return replace(recording, gnss=replace(recording.gnss, **changes))


def turned(recording, accel, gyro):
    """IMU with its axes mapped by two matrices."""
    imu = recording.imu
    return with_imu(recording, accel=imu.accel @ np.asarray(accel).T, gyro=imu.gyro @ np.asarray(gyro).T)
