"""Shared cases, and a table of ratios to the peer at the end of a run.

    pytest benchmarks

times this package and the peer (python-ins, in the ``bench`` extra) side by side in one process and prints epochs per
second and ratios. Every number is the best of several rounds on one core.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from schuler import frames
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import gnss_measurements
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import GnssSeries, Increments
from schuler.simulation.motion import ideal_increments
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

ORIGIN = np.array([np.radians(47.0), np.radians(8.0), 450.0])
GYRO_N, ACCEL_N = 1e-4, 2e-3


def drive(seconds: float) -> ManoeuvreMotion:
    lap = [
        Manoeuvre(duration=8.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=1.5),
        Manoeuvre(duration=6.0, speed=16.0),
        Manoeuvre(duration=9.0, turn=-2.0),
        Manoeuvre(duration=10.0, turn=2.5, speed=8.0),
    ]
    return ManoeuvreMotion.of([Manoeuvre(duration=5.0), *lap * (int(seconds / 40.0) + 1)], ORIGIN, bank=0.2)


@pytest.fixture(scope="session")
def log_1000s():
    """100 000 epochs, 1000 s at 100 Hz, with noise: the job all peers were measured on."""
    motion = drive(1000.0)
    t = np.arange(100_001) / 100.0
    dtheta, dv = ideal_increments(motion, t)
    rng = np.random.default_rng(0)
    dtheta = dtheta + GYRO_N * 0.1 * rng.standard_normal(dtheta.shape)
    dv = dv + ACCEL_N * 0.1 * rng.standard_normal(dv.shape)
    return motion, Increments(t[1:], np.full(100_000, 0.01), dtheta, dv)


@pytest.fixture(scope="session")
def million(log_1000s):
    """A million epochs: the log ten times over."""
    _, inc = log_1000s
    n = 10 * len(inc)
    return Increments(
        np.arange(1, n + 1) / 100.0, np.full(n, 0.01), np.tile(inc.dtheta_ib_b, (10, 1)), np.tile(inc.dv_ib_b, (10, 1))
    )


@pytest.fixture(scope="session")
def start(log_1000s):
    s = log_1000s[0].state(np.zeros(1))
    return NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])


@pytest.fixture(scope="session")
def fixes(log_1000s):
    """1 Hz position (1 m) and velocity (5 cm/s)."""
    motion, _ = log_1000s
    t = np.arange(1.0, 1000.0)
    s = motion.state(t)
    rng = np.random.default_rng(1)
    n = len(t)
    return GnssSeries(
        t,
        frames.llh_from_ecef(s.r_eb_e + rng.standard_normal((n, 3))),
        np.tile(np.eye(3), (n, 1, 1)),
        s.v_eb_n + 0.05 * rng.standard_normal((n, 3)),
        np.tile(0.05**2 * np.eye(3), (n, 1, 1)),
    )


@pytest.fixture(scope="session")
def noise():
    """Root densities of gyro and accelerometer noise."""
    return GYRO_N, ACCEL_N


@pytest.fixture(scope="session")
def peer_start(start):
    """Initial state in the peer's form: degrees, and altitude up; skips where the peer is not installed."""
    pytest.importorskip("pyins", reason="the peer is in the bench extra: pip install 'schuler[bench]'")
    import pandas as pd

    llh, v, rpy = start.llh, start.v_eb_n, start.rpy_nb
    return pd.Series(
        [np.degrees(llh[0]), np.degrees(llh[1]), llh[2], *v, *np.degrees(rpy)],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=start.t,
    )


def layout(states: int) -> StateLayout:
    models = {
        "b_a": StateModel.random_walk(0.02, 1e-5),
        "b_g": StateModel.random_walk(1e-3, 1e-7),
        "S_a": StateModel.constant(1e-3),
        "S_g": StateModel.constant(1e-3),
        "M_a6": StateModel.constant(1e-3),
        "M_g": StateModel.constant(1e-3),
    }
    return StateLayout(dict(list(models.items())[: {15: 2, 21: 4, 33: 6}[states]]))


@pytest.fixture(scope="session")
def filter_job(log_1000s, fixes, start):
    """Arguments of a filter run with a number of states."""

    def job(states: int) -> tuple:
        lay = layout(states)
        initial = InitialState.from_sigmas(
            start, lay, attitude=[0.005, 0.005, 0.02], velocity=[0.1] * 3, position=[1.0] * 3
        )
        noise = (np.full(3, GYRO_N**2), np.full(3, ACCEL_N**2))
        return log_1000s[1], gnss_measurements(fixes, [0.0, 0.0, 0.0]), initial, lay, *noise

    return job


def pytest_terminal_summary(terminalreporter, config) -> None:
    session = getattr(config, "_benchmarksession", None)
    if session is None or not session.benchmarks:
        return
    rows: dict[str, list[tuple[str, float]]] = {}
    for b in session.benchmarks:
        if b.stats.rounds:
            rows.setdefault(b.group or "other", []).append((b.name, b.extra_info.get("epochs", 1) / b.stats.min))
    write = terminalreporter.write_line
    terminalreporter.section("epochs per second, best of the rounds, and ratio to the peer")
    for group, entries in rows.items():
        peer = max((rate for name, rate in entries if "peer" in name), default=None)
        write(group)
        for name, rate in sorted(entries, key=lambda e: -e[1]):
            ratio = "" if peer is None else f"{rate / peer:10.1f} x"
            write(f"  {name:<58}{rate:>14,.0f} /s{ratio}")
