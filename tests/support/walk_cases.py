"""Simulated walks shared by the foot tests."""

import numpy as np

from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.simulation.gait import WalkMotion, walk
from schuler.simulation.motion import ideal_increments, ideal_rates

ORIGIN = np.array([np.radians(47.0), np.radians(8.0), 450.0])
PLACE = {"lat_deg": 47.0, "lon_deg": 8.0, "height_m": 450.0}
RATE = 200.0
#: A square: a quarter turn, spread over two strides, after every three.
TURNS = np.tile([0.0, np.pi / 4, np.pi / 4], 4)


def square(**options) -> WalkMotion:
    return walk(ORIGIN, strides=12, turn=TURNS, **options)


def times(motion: WalkMotion) -> np.ndarray:
    return np.arange(int(motion.duration * RATE) + 1) / RATE


def increments_log(motion: WalkMotion) -> ImuSeries:
    """An ideal integrating IMU."""
    t = times(motion)
    dtheta, dv = ideal_increments(motion, t)
    return ImuSeries(t[1:], dtheta, dv, "increment")


def rates_log(motion: WalkMotion) -> ImuSeries:
    """An ideal IMU that is sampled."""
    t = times(motion)
    omega, f = ideal_rates(motion, t)
    return ImuSeries(t, omega, f)


def noisy(
    imu: ImuSeries, rng: np.random.Generator, *, gyro_n: float, accel_n: float, b_g=(0.0, 0.0, 0.0), b_a=(0.0, 0.0, 0.0)
) -> ImuSeries:
    """Increments or rates with white noise of the given densities and constant biases."""
    n, dt = len(imu), 1.0 / RATE
    scale = np.sqrt(dt) if imu.kind == "increment" else 1.0 / np.sqrt(dt)
    by = dt if imu.kind == "increment" else 1.0
    gyro = imu.gyro + by * np.asarray(b_g) + gyro_n * scale * rng.standard_normal((n, 3))
    accel = imu.accel + by * np.asarray(b_a) + accel_n * scale * rng.standard_normal((n, 3))
    return ImuSeries(imu.t, gyro, accel, imu.kind)


def truth(motion: WalkMotion, t: np.ndarray) -> Trajectory:
    s = motion.state(t)
    return Trajectory(t, s.r_eb_e, s.v_eb_e, s.q_eb)
