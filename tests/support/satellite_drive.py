"""A car of two minutes with an IMU and its biases, and what a satellite receiver on it measures, errors and all."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import navigate
from schuler.recording.recording import Metadata, Recording
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.timebase import TimeBase

IMU = "HG1700-flenniken"
EPOCH = 1.3e9
LEVER = np.array([0.4, -0.2, -1.0])
ORIGIN = np.array([0.85, 0.16, 320.0])
BUDGET = RangeErrors(noise=0.5, rate_noise=0.05, multipath=0.0, atmosphere=0.0, clock=3e4, drift=20.0, offsets=(15.0,))

CLOCK = {"systems": "GE", "clock_noise_m": 0.2, "clock_drift_noise_m_s": 0.2}  # as the budget has it


class Case:
    """An ideal drive and what a receiver on it measures."""

    def __init__(self) -> None:
        lap = [
            Manoeuvre(duration=8.0, speed=10.0),
            Manoeuvre(duration=7.0, turn=1.5),
            Manoeuvre(duration=9.0, turn=-2.0, speed=14.0),
            Manoeuvre(duration=10.0, turn=1.2, speed=8.0),
        ]
        motion = ManoeuvreMotion.of([Manoeuvre(duration=6.0), *lap * 4], ORIGIN, heading=0.4, bank=0.2)
        self.ideal = ideal_imu(motion, 50.0)
        self.truth = self.ideal.truth
        self.imu = simulate_imu(
            self.ideal, ImuErrors.draw(catalogue.spec(IMU), np.random.default_rng(3)), np.random.default_rng(4)
        ).imu
        self.t = np.arange(0.5, 120.0, 0.5)
        s = motion.state(self.t)
        arm = np.einsum("nij,nj->ni", s.C_eb, np.cross(s.omega_eb_b, LEVER))
        self.r, self.v = s.r_eb_e + s.C_eb @ LEVER, s.v_eb_e + arm
        self.orbits = nominal_orbits("GE")

    def made(self, seed=5, **more):
        return synthetic_ranges(
            self.t, self.r, self.v, self.orbits, np.random.default_rng(seed), BUDGET, epoch_gps_s=EPOCH,
            elevation_mask=0.2, **more,
        )  # fmt: skip

    def recording(self, ranges=None, **more) -> Recording:
        time = Metadata(time=TimeBase("gps", EPOCH))
        return Recording(imu=self.imu, ranges=ranges, reference=self.truth, metadata=time, **more)

    def navigated(self, ranges=None, parts=None, base=None, base_station=None, **tight):
        if base_station is not None:
            tight["base"] = {"llh_deg": base_station, "code_sigma_m": 0.5}
        config = {
            "imu": {"catalogue": IMU},
            "gnss": {"coupling": "tight", "lever_arm_m": tuple(LEVER), "tight": {**CLOCK, **tight}},
            "filter": {"smooth": False, "tune": False},
        }
        return navigate(self.recording(ranges, **(parts or {})), NavigationConfig.parse(config), base=base)

    def error_n(self, result) -> np.ndarray:
        """Position error north, east, down at the records."""
        d = result.states.r_eb_e - self.truth.at(result.t).r_eb_e
        return np.einsum("nji,nj->ni", frames.C_en(result.states.llh), d)
