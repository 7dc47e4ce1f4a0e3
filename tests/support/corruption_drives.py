"""The two good drives that are spoilt: one real, one simulated."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import schuler
from schuler.recording.recording import Recording

_TOWN = {
    "name": "corner drive",
    "seed": 4,
    "motion": {
        "type": "waypoints",
        "lat_deg": 48.137,
        "lon_deg": 11.575,
        "height_m": 560.0,
        "waypoints": [
            {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 20.0},
            {"north_m": 250.0, "east_m": 0.0, "height_m": 564.0, "speed_m_s": 12.0},
            {"north_m": 350.0, "east_m": 150.0, "height_m": 572.0, "speed_m_s": 9.0},
            {"north_m": 200.0, "east_m": 380.0, "height_m": 565.0, "speed_m_s": 14.0},
            {"north_m": -100.0, "east_m": 350.0, "height_m": 554.0, "speed_m_s": 10.0, "stop_s": 10.0},
            {"north_m": -200.0, "east_m": 100.0, "height_m": 562.0, "speed_m_s": 12.0},
            {"north_m": -20.0, "east_m": -40.0, "speed_m_s": 8.0, "stop_s": 5.0},
        ],
    },
    "imu": {"rate_hz": 100.0, "kind": "rate", "catalogue": "MTi-G-710"},
    "gnss": {"rate_hz": 5.0, "sigma_position_m": [0.02, 0.02, 0.04], "sigma_velocity_m_s": [0.03, 0.03, 0.05]},
}


#: How the real drive must be read: its sensor is backward, right, up, its clock 0.125 s late, its heights the sea's.
REAL = {
    "imu": {"file": "imu_gpst.csv", "time": "gps-tow:2374", "axes": "BRU", "offset": -0.125,
            "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s"},
    "gnss": {"file": "gnss_1934_sf.pos", "height": "msl", "geoid_separation": -17.0},
}  # fmt: skip


@cache
def simulated() -> Recording:
    """A drive through a town of 206 s, MEMS IMU at 100 Hz with vibration noise, RTK at 5 Hz."""
    made = schuler.simulate(_TOWN)
    return replace(made, reference=None)


@cache
def real(shared: Path, *, seconds: float | None = None) -> Recording:
    """The RTK drive of rtkexp as it must be read; from its start, ``seconds`` long."""
    drive = schuler.read(shared / "rtkexp_drive", **REAL)
    if seconds is None:
        return drive
    stop = drive.imu.t[0] + seconds
    k, g = drive.imu.t <= stop, drive.gnss
    i = drive.imu
    return replace(
        drive, imu=replace(i, t=i.t[k], gyro=i.gyro[k], accel=i.accel[k]), gnss=g.where(np.asarray(g.t <= stop))
    )
