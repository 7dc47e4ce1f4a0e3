"""A recording with every series there is, and configurations for it."""

import aided_cases as ac
import numpy as np

from schuler import frames, units
from schuler.filtering import measurements as ms
from schuler.navigation.config import NavigationConfig
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, OdometerSeries, ScalarSeries

IMU = {
    "gyro": {"arw_deg_rthr": ac.GYRO_N * 60.0 / units.DEG, "bias_deg_hr": 2e-3 * 3600.0 / units.DEG},
    "accel": {"vrw_m_s_rthr": ac.ACCEL_N * 60.0, "bias_mg": 0.05e3 / units.G0},
}
MOUNT, SCALE, HEADING_BIAS = np.array([0.02, -0.03]), 0.02, 0.04


def parse(**sections):
    return NavigationConfig.parse({"imu": IMU, **sections})


def drawn() -> ac.Truth:
    """A drive whose mount, odometer scale and heading bias are as above."""
    lay = ac.layout("mount", "odometer", "baro", "b_heading", "clock", "clock_drift", "clock_2")
    given = {"mount": MOUNT, "odometer": SCALE, "b_heading": HEADING_BIAS}
    return ac.Truth(ac.Drive.of(ac.town(2.0), 120.0), lay, np.random.default_rng(42), given)


def recorded(truth: ac.Truth) -> Recording:
    """The log of that drive."""
    s = ac.gnss(truth)
    position, velocity = (s.where(s.kind == k) for k in (ms.POSITION, ms.VELOCITY))
    odo, head, high = ac.odometer(truth), ac.heading(truth), ac.height(truth)
    return Recording(
        imu=truth.series(),
        gnss=GnssSeries(position.t, frames.llh_from_ecef(position.z[:, :3]), position.R, velocity.z[:, :3], velocity.R),
        odometer=OdometerSeries(odo.t, odo.z[:, 0], np.full(len(odo), ac.SIGMA_ODO)),
        heading=ScalarSeries(head.t, head.z[:, 0], np.full(len(head), ac.SIGMA_HEADING)),
        height=ScalarSeries(high.t, high.z[:, 0], np.full(len(high), ac.SIGMA_HEIGHT)),
        ranges=ac.measured(truth, ac.sky(truth.drive, "GE", 10)),
        reference=truth.reference,
    )


def config(recording, **sections):
    rpy = np.degrees(recording.reference.rpy_nb[1])
    data = {
        "imu": IMU,
        "gnss": {"lever_arm_m": list(ac.LEVER)},
        "alignment": {"method": "given", "rpy_deg": list(rpy), "sigma_deg": [0.3, 0.3, 0.6]},
        "outages": {"windows_s": [[60.0, 100.0]]},
        "filter": {"tune": False},
    }
    for name, section in sections.items():
        data[name] = {**data.get(name, {}), **section}
    return data
