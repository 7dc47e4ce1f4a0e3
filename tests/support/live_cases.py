"""Drives for live runs, and a stream of their messages in the order of arrival."""

import numpy as np

from schuler.live import Fix, LiveNavigator
from schuler.recording import Recording
from schuler.simulation import simulate

SCENARIO = {
    "name": "round the block",
    "seed": 3,
    "motion": {
        "type": "waypoints",
        "lat_deg": 48.1,
        "lon_deg": 11.6,
        "height_m": 500.0,
        "acceleration_m_s2": 1.8,
        "waypoints": [
            {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 11.0, "stop_s": 12.0},
            {"north_m": 160.0, "east_m": 10.0, "speed_m_s": 9.0},
            {"north_m": 250.0, "east_m": 130.0, "speed_m_s": 12.0},
            {"north_m": 260.0, "east_m": 330.0, "speed_m_s": 8.0, "stop_s": 6.0},
            {"north_m": 100.0, "east_m": 420.0, "speed_m_s": 10.0},
            {"north_m": -80.0, "east_m": 350.0, "speed_m_s": 12.0, "stop_s": 5.0},
        ],
    },
    "imu": {
        "rate_hz": 100.0,
        "gyro": {"arw_deg_rthr": 0.25, "bias_deg_hr": 200.0, "in_run_deg_hr": 8.0, "in_run_time_s": 600.0},
        "accel": {"vrw_m_s_rthr": 0.06, "bias_mg": 4.0, "in_run_mg": 0.05, "in_run_time_s": 600.0},
    },
    "gnss": {
        "rate_hz": 2.0,
        "first_s": 0.25,
        "sigma_position_m": [1.0, 1.0, 1.5],
        "sigma_velocity_m_s": [0.05, 0.05, 0.08],
        "lever_arm_m": [0.6, -0.2, -1.1],
    },
}
CONFIG = {
    "imu": {name: SCENARIO["imu"][name] for name in ("gyro", "accel")},
    "gnss": {"lever_arm_m": SCENARIO["gnss"]["lever_arm_m"]},
    "filter": {"states": 15, "tune": False, "smooth": False},
}


def drive() -> Recording:
    """Two minutes with stops, increments of a MEMS IMU and fixes of a receiver."""
    return simulate(SCENARIO)


def fixes(recording: Recording) -> list[Fix]:
    g = recording.need_gnss()
    return [
        Fix(
            float(g.t[k]), g.llh[k], g.cov_r_n[k], None if g.v_n is None else g.v_n[k],
            None if g.cov_v_n is None else g.cov_v_n[k],
        )
        for k in range(len(g))
    ]  # fmt: skip


def fed(
    live: LiveNavigator, recording: Recording, late: float = 0.0, block: int = 20, every_s: float = 1.0
) -> np.ndarray:
    """Times and Earth-fixed positions of the solution about once a second, while a recording streams.

    Fixes arrive ``late`` seconds after their time, samples in blocks; at the end the fixes that are under way arrive.
    """
    imu, waiting = recording.need_imu(), fixes(recording)
    shift, rows, due = live.config.imu.clock_shift_s, [], -np.inf
    for i in range(0, len(imu), block):
        part = slice(i, i + block)
        live.imu_many(imu.t[part], imu.gyro[part], imu.accel[part])
        while waiting and waiting[0].t + late <= imu.t[part][-1] + shift:
            live.take(waiting.pop(0))
        if imu.t[part][-1] >= due and (solution := live.solution()) is not None:
            rows.append((solution.t, *position(solution)))
            due = imu.t[part][-1] + every_s
    for fix in waiting:
        live.take(fix)
    solution = live.solution()
    assert solution is not None
    return np.array([*rows, (solution.t, *position(solution))])


def position(solution) -> np.ndarray:
    from schuler import frames

    return frames.ecef_from_llh(solution.llh)
