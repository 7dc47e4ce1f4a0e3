"""Solutions to report on: the filter tests' simulated drive, with and without what a report can be given."""

from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import aided_cases as ac
import filter_cases as cases
import numpy as np
import pytest

from schuler.filtering import engine
from schuler.filtering.engine import FilterOptions
from schuler.filtering.measurements import GNSS_HEADING, MeasurementSchedule, gnss_measurements
from schuler.filtering.states import StateLayout
from schuler.navigation.result import NavigationResult


@dataclass(frozen=True)
class Run:
    """A solution with everything that can be said about it."""

    result: NavigationResult
    smoothed: NavigationResult | None
    truth: Any
    parameters: Any
    gnss: Any
    ranges: Any = None


NOTES = ('a note with <b>markup</b> & an "apostrophe"\'s trouble', "gyro biases start from zero")


def solution(
    states: int = 15, *, gnss: bool = True, outages=((40.0, 55.0), (70.0, 80.0)), gate=None, wild=(), stop=None
):
    """A run of 100 s; ``wild`` are indices of fixes moved by 50 m, ``stop`` interrupts it."""
    case = cases.Case.of(cases.drive(2.0), 100.0, rate_hz=50.0)
    layout = StateLayout({}) if states == 9 else cases.layout(states)
    rng = np.random.default_rng([3, states])
    parameters = np.sqrt(layout.initial_variances()) * rng.standard_normal(layout.size - 9)
    if states == 9:
        log, history = case.increments, np.zeros((len(case.increments) + 1, 0))
    else:
        log, history = cases.corrupted(case, layout, parameters, rng)
    series = cases.fixes(case, rng)
    if len(wild):
        llh = series.llh.copy()
        llh[list(wild), 0] += 50.0 / 6.4e6
        series = replace(series, llh=llh)
    schedule = gnss_measurements(series, cases.LEVER, gate=gate) if gnss else MeasurementSchedule.empty()
    schedule = schedule.outside(outages)

    def interrupt(fraction: float) -> None:
        if stop is not None and fraction > stop:
            raise KeyboardInterrupt

    options = FilterOptions(smoother=stop is None, hold_s=3.0)
    start = cases.start(case, layout, rng)
    psd = np.full(3, cases.GYRO_N**2), np.full(3, cases.ACCEL_N**2)
    with mock.patch.object(engine, "_CHUNK", 1000):
        forward = engine.run(log, schedule, start, layout, *psd, options, interrupt, keep_part=True)
    result = NavigationResult.from_run(
        forward, schedule.t, schedule.kind, layout, outages=tuple(outages), lever_arm_b=cases.LEVER, notes=NOTES,
        provenance={
            "schuler": "0.0.test", "config": {"imu": {"name": "<i>x</i>", "mount": [1.0, 2.0]}}, "seed": 7,
            "sources": {"log.csv": "ab" * 32}, "recording": "a drive", "elapsed_s": float(rng.random()),
        },
    )  # fmt: skip
    at = np.searchsorted(log.t, result.t - 1e-9) + 1
    smoothed = result.smooth() if stop is None else None
    return Run(result, smoothed, case.truth, history[at], series)


@pytest.fixture(scope="session")
def full() -> Run:
    """15 states, two outages, smoothed, with the truth."""
    return solution()


@pytest.fixture(scope="session")
def wild() -> Run:
    """21 states, no outage, a gate, and fixes that fail it: one alone and seven in a row."""
    return solution(21, outages=(), gate=0.9999, wild=(20, 50, 51, 52, 53, 54, 55, 56))


@pytest.fixture(scope="session")
def make_run():
    return solution


#: Blocks of the run with every aid, beside both biases.
BLOCKS = (
    "lever", "lever_v", "mount", "odometer", "clock", "clock_drift", "clock_2", "b_heading", "baro", "b_r", "b_v",
    "delay",
)  # fmt: skip


@pytest.fixture(scope="session")
def everything() -> Run:
    """Every kind of measurement but resets, every block that aids need; ranges partly left out, and one fault."""
    drive = ac.Drive.of(ac.town(1.5), 90.0)
    over = ac.sky(drive, "GE", 10)
    satellites = np.unique(over.sat)
    reason = np.zeros(len(over), dtype=np.int64)
    reason[(over.sat == satellites[0]) & (over.t < 30.0)] = 3
    reason[(over.sat == satellites[1]) & (over.t > 60.0)] = 4
    reason[::97] = 6
    rng = np.random.default_rng(5)
    over = replace(over, reason=reason, cn0=35.0 + 15.0 * np.sin(over.elevation) + rng.standard_normal(len(over)))
    seen = {}

    def spoiled(ranges):
        wrong = (ranges.sat == satellites[2]) & (ranges.t > 50.0) & (ranges.t < 55.0)
        seen["ranges"] = replace(ranges, pseudorange=ranges.pseudorange + np.where(wrong, 60.0, 0.0))
        return seen["ranges"]

    def two_antennas(truth):
        return replace(ac.heading(truth), kind=np.full(len(truth.drive.fixes_t), GNSS_HEADING))

    aids = [
        ac.gnss, ac.satellites(over, gate=0.9999, spoil=spoiled), ac.zero_velocity, ac.zero_rate, ac.wheels,
        ac.odometer, ac.heading, two_antennas, ac.height, ac.known_places,
    ]  # fmt: skip
    one = ac.filtered(drive, ac.layout(*BLOCKS), aids, 1, lockout=0, smoother=True)
    return Run(one.result, one.result.smooth(), one.truth.reference, one.parameters, None, seen["ranges"])
