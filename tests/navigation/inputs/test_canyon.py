"""A simulated town whose satellites are reflected a third of the time: fault detection is the better choice."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording
from schuler.simulation.scenario import prepare_mission, simulate_mission
from schuler.units import DEG


@pytest.fixture(scope="module")
def mission():
    data = tomllib.loads((ROOT / "examples" / "town_tight.toml").read_text(encoding="utf-8"))
    data["satellites"] |= {"windows": [], "faults": []}
    return prepare_mission(data)


def drive(mission, seed: int, noise: int | None = None) -> Recording:
    """A drive with the reflections of ``seed``, and its noise unless that of another seed is asked for.

    From 20 s on satellites below 50 deg are late for 5 to 20 s, then not for 25 s, in the mean; higher ones 175 s.

    A reflection's detour is constant, and exponentially distributed with a mean of 27 m. Range rates have none of it.
    """
    log = simulate_mission(mission, np.random.default_rng(seed if noise is None else noise)).recording
    r, rng = log.ranges, np.random.default_rng(10_000 + seed)
    late = np.zeros(len(r))
    for sat in np.unique(r.sat):
        own = r.sat == sat
        direct = 25.0 if np.median(r.elevation[own]) < 50.0 * DEG else 175.0
        t, last = r.t[own].min() + 20.0, r.t[own].max()
        while t < last:
            begin = t + rng.exponential(direct)
            t = begin + rng.uniform(5.0, 20.0)
            late[own & (r.t >= begin) & (r.t < t)] = rng.exponential(27.0)
    return replace(log, ranges=replace(r, pseudorange=r.pseudorange + late))


def horizontal_rms(log: Recording, *, integrity: bool) -> float:
    """By ranges and range rates alone, causal. [m]"""
    tight = {"clock_noise_m": 0.2, "clock_drift_noise_m_s": 0.05, "integrity": integrity}
    config = {
        "imu": {"catalogue": "MTi-G-710"},
        "gnss": {"coupling": "tight", "lever_arm_m": (0.8, 0.0, -1.2), "tight": tight},
        "filter": {"smooth": False},
    }
    return float(navigate(log, NavigationConfig.checked(config)).errors(log.need_reference()).rms_horizontal)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [7, 14, 22])
def test_fault_detection_is_the_better_choice(mission, seed):
    """0.60, 0.53, 0.60 m; without 1.48, 1.00, 0.72 m; untuned 0.56, 0.71, 0.66 and 1.12, 0.88, 0.65."""
    log = drive(mission, seed)
    with_it, without = (horizontal_rms(log, integrity=on) for on in (True, False))
    assert with_it < 0.8
    assert with_it < without


@pytest.mark.campaign
def test_fault_detection_is_better_where_one_drive_says_otherwise(mission):
    """Reflections of the two seeds of forty that are worse for it (by 0.26 and 0.24 m), with four other noises each.

    One drive's difference scatters by 0.3 m whatever the reflections; these eight are better by 0.12 +- 0.03 m.
    """
    runs = [drive(mission, seed, noise) for seed in (15, 21) for noise in range(5000, 5004)]
    less = np.array([horizontal_rms(log, integrity=False) - horizontal_rms(log, integrity=True) for log in runs])
    assert less.mean() > 2.0 * less.std(ddof=1) / np.sqrt(len(less)), less
