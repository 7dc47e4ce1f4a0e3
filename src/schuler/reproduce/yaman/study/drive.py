"""Yaman's two drives, simulated with what can be recovered from his results: length, outage, sensor errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.trajectory import Trajectory
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG, DEG_PER_HR, MG, UG

#: Elmadag near Ankara. [rad], [m]
ELMADAG = np.array([39.92 * DEG, 33.23 * DEG, 1100.0])
#: Length of the drive and the outage. [s]
DRIVES = {1: (561.0, 63.0), 2: (600.0, 101.0)}
#: Constant errors recovered from the tables, forward, right, down. [m/s^2], [rad/s]
RAW = {"b_a": np.array([13.4, 13.4, 99.0]) * MG, "b_g": np.array([8.8, 8.8, 86.0]) * DEG_PER_HR}
CALIBRATED = {"b_a": np.array([3.2, 3.2, 1.0]) * MG, "b_g": np.array([7.8, 7.8, 20.0]) * DEG_PER_HR}
#: White noise of the MPU-6000. [m/s^2/sqrt(Hz)], [rad/s/sqrt(Hz)]
ACCEL_NOISE, GYRO_NOISE = 400.0 * UG, 0.005 * DEG
GNSS_RATE_HZ = 5.0
_ROAD_GYRO, _ROAD_ACCEL = 0.5 * DEG, 0.3  # 1-sigma of the shaking on a road [rad/s], [m/s^2]


@dataclass(frozen=True)
class Drive:
    """A simulated drive with the same noise on a raw and a calibrated IMU.

    Attributes
    ----------
    number : {1, 2}
    raw, calibrated : Recording
    outage : tuple of (start, stop)
        [s]
    """

    number: int
    raw: Recording
    calibrated: Recording
    outage: tuple[float, float]

    @classmethod
    def of(cls, number: int, seed: int = 1, rate_hz: float = 100.0) -> Drive:
        """Simulate a drive: 40 s at rest, laps with turns and stops of about ten seconds, no slip."""
        if number not in DRIVES:
            raise InputError(f"drive: expected 1 or 2, got {number!r}")
        length, lost = DRIVES[number]
        motion = route(length + 1.0)
        ideal = ideal_imu(motion, rate_hz)
        noise = np.random.SeedSequence(seed).spawn(3)
        parts = {}
        shaken = vibration(ideal.truth, np.random.default_rng(noise[2])) / rate_hz
        gnss = simulate_gnss(
            motion,
            GnssModel(
                rate_hz=GNSS_RATE_HZ, sigma_position=(0.5, 0.5, 1.0), sigma_velocity=(0.05, 0.05, 0.05),
                drift_position=(1.8, 1.8, 5.0), drift_time=60.0,
            ),
            np.random.default_rng(noise[1]),
        )  # fmt: skip
        for name, errors in (("raw", RAW), ("calibrated", CALIBRATED)):
            imu = simulate_imu(
                ideal,
                ImuErrors(
                    b_a=errors["b_a"],
                    b_g=errors["b_g"],
                    gyro_noise=NoiseModel((White(GYRO_NOISE),)),
                    accel_noise=NoiseModel((White(ACCEL_NOISE),)),
                ),
                np.random.default_rng(noise[0]),
            ).imu
            imu = replace(imu, gyro=imu.gyro + shaken[:, :3], accel=imu.accel + shaken[:, 3:])
            whole = Recording(imu, gnss, reference=ideal.truth, metadata=Metadata(name=f"drive {number}, {name} IMU"))
            parts[name] = first_part(whole, length)
        start = round(0.5 * length)
        return cls(number, parts["raw"], parts["calibrated"], (float(start), start + lost))


def first_part(recording: Recording, length_s: float) -> Recording:
    """A recording up to a time after zero: laps are whole, the source's drives are not. [s]"""
    imu, gnss, reference = recording.imu, recording.gnss, recording.reference
    return replace(
        recording,
        imu=None if imu is None else imu.between(-np.inf, length_s),
        gnss=None if gnss is None else gnss.between(-np.inf, length_s),
        reference=None if reference is None else reference.between(-np.inf, length_s),
    )


def vibration(truth: Trajectory, rng: np.random.Generator) -> FloatArray:
    """Vibration of an IMU that moves, as rates. Shape (n - 1, 6). [rad/s], [m/s^2]

    Without it a simulated car at constant speed is as quiet as one at rest, and zero-velocity updates stop it.
    Differences of white noise: they are seen by a detector of rest and integrate to nothing.
    """
    moving = np.linalg.norm(truth.v_eb_n, axis=1) > 0.2
    white = rng.standard_normal((len(truth), 6)) * np.repeat((_ROAD_GYRO, _ROAD_ACCEL), 3) / np.sqrt(2.0)
    shaken: FloatArray = np.diff(white * moving[:, None], axis=0)
    return shaken


def route(length_s: float) -> ManoeuvreMotion:
    """A town drive of at least the given length: rest, then laps of turns both ways, hills and stops."""
    turn = 0.5 * np.pi
    lap = [
        Manoeuvre(duration=10.0, speed=13.0),
        Manoeuvre(duration=12.0, climb=0.3),
        Manoeuvre(duration=8.0, turn=turn, climb=0.0),
        Manoeuvre(duration=10.0, speed=16.0),
        Manoeuvre(duration=12.0),
        Manoeuvre(duration=7.0, speed=8.0),
        Manoeuvre(duration=8.0, turn=-0.8 * turn),
        Manoeuvre(duration=8.0, speed=14.0, climb=-0.3),
        Manoeuvre(duration=10.0, climb=0.0),
        Manoeuvre(duration=9.0, speed=0.0),
        Manoeuvre(duration=12.0),
        Manoeuvre(duration=9.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=1.2 * turn),
        Manoeuvre(duration=14.0),
    ]
    commands = [Manoeuvre(duration=40.0)]
    while sum(c.duration for c in commands) < length_s:
        commands += lap
    return ManoeuvreMotion.of(commands, ELMADAG, heading=0.3, bank=0.0)
