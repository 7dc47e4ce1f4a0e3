"""A short simulated drive of a configured IMU: a run to take a test vector from, where there is no log."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.export.design import check_exported
from schuler.navigation.config import NavigationConfig, OutageSection
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.run import prepared_run
from schuler.simulation.scenario import Scenario, prepare_mission, simulate_mission

_STOP_S = 20.0
#: A lap through a few streets, with stops; north, east [m], speed [m/s].
_WAY = ((0.0, 0.0, 10.0), (250.0, 0.0, 12.0), (350.0, 150.0, 9.0), (200.0, 300.0, 12.0), (0.0, 200.0, 8.0))


def simulated_run(
    config: NavigationConfig, rate_hz: float = 100.0, seed: int = 0
) -> tuple[NavigationConfig, PreparedRun]:
    """A prepared run of a simulated drive with the IMU, the lever arms and the aids of a configuration.

    Parameters
    ----------
    config : NavigationConfig
    rate_hz : float
        Sample rate of the IMU. [Hz]
    seed : int

    Returns
    -------
    config : NavigationConfig
        That of the run: axes and clock of the IMU need no correction, nothing is withheld.
    prepared : PreparedRun

    Raises
    ------
    ConfigError
        If the configuration uses what is not exported.
    """
    aiding, gnss, imu = config.aiding, config.gnss, config.imu
    check_exported(config)  # the drive has no series for other aids
    section = imu.model_dump(include={"catalogue", "spec", "gyro", "accel"}, exclude_defaults=True)
    stops = {0: _STOP_S, len(_WAY) - 1: 5.0}
    way = [
        {"north_m": n, "east_m": e, "speed_m_s": v, **({"stop_s": stops[i]} if i in stops else {})}
        for i, (n, e, v) in enumerate(_WAY)
    ]
    data: dict[str, Any] = {
        "motion": {"type": "waypoints", "lat_deg": 48.137, "lon_deg": 11.575, "height_m": 560.0, "waypoints": way},
        "imu": {"rate_hz": rate_hz, **section},
        "gnss": {"lever_arm_m": gnss.lever_arm_m},
    }
    if aiding.odometer is not None:
        data["odometer"] = {"lever_arm_m": aiding.odometer.lever_m}
    simulation = simulate_mission(prepare_mission(Scenario.parse(data)), np.random.default_rng(seed))
    plain = imu.model_copy(update={"mount_rpy_deg": (0.0, 0.0, 0.0), "clock_shift_s": 0.0, "calibration": None})
    used = config.model_copy(update={"imu": plain, "outages": OutageSection()})
    return used, prepared_run(simulation.recording, used)
