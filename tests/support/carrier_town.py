"""The town's first forty seconds with carriers, of which one satellite's slip twice: log, satellite, subject."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
from places import ROOT

from schuler.navigation.config import NavigationConfig
from schuler.navigation.report.subject import Subject
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording
from schuler.simulation.scenario import prepare_mission, simulate_mission

SLIPS = {20.0: 3.0, 30.0: -2.0}  # time [s] and size [m]
LEVER = (0.8, 0.0, -1.2)


@cache
def slipped_town() -> tuple[Recording, int, Subject]:
    """Navigated with changes of carriers, reported on with ranges, single points and truth."""
    mission = tomllib.loads((ROOT / "examples" / "town_tight.toml").read_text(encoding="utf-8"))
    mission["satellites"] |= {"windows": [], "faults": []}
    log = simulate_mission(prepare_mission(mission)).recording.between(0.0, 40.0)
    r = log.ranges
    sat = int(np.unique(r.sat)[1])
    added = sum(size * ((r.sat == sat) & (r.t >= t - 0.1)) for t, size in SLIPS.items())
    log = replace(log, ranges=replace(r, carrier_range=r.carrier_range + added))
    result = navigate(log, configuration("time-differenced"))
    return (
        log,
        sat,
        Subject(result, reference=log.need_reference(), origin=0.0, ranges=result.ranges, points=result.points),
    )


def configuration(carrier: str) -> NavigationConfig:
    """Tight coupling with or without carriers."""
    return NavigationConfig.checked(
        {
            "imu": {"catalogue": "MTi-G-710"},
            "gnss": {"coupling": "tight", "lever_arm_m": LEVER, "tight": {"carrier": carrier}},
            "filter": {"smooth": False, "tune": False},
        }
    )
