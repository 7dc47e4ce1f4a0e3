"""Smoothing over the outages of an integrated drive: single runs of a campaign through the engine, with its memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schuler.filtering.engine import run as filtered
from schuler.montecarlo.lanes.replay import replay
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import Cell, ResultTable
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.du.study.integrated import IntegratedDrive
from schuler.units import DEG


def smoothed_run(drive: IntegratedDrive, run: int = 0, *, seed: int = 0) -> tuple[NavigationResult, Trajectory]:
    """One run of a campaign once more through the engine, with what smoothing over the outages needs.

    Parameters
    ----------
    drive : IntegratedDrive
    run, seed : int
        As in the campaign.

    Returns
    -------
    result : NavigationResult
        Of the IMU in its own axes; ``.smooth()`` is the smoothed one.
    truth : Trajectory
        Of the same.
    """
    scenario = drive.scenario
    data = replay(scenario, run, seed=seed)
    options = replace(scenario.options, smoother=True, output_rate_hz=10.0)
    forward = filtered(
        data.increments, data.schedule, data.initial, scenario.layout, scenario.gyro_psd, scenario.accel_psd, options
    )
    result = NavigationResult.from_run(
        forward, data.schedule.t, data.schedule.kind, scenario.layout, outages=drive.outages
    )
    return result, scenario.ideal.truth


def smoothing_table(drive: IntegratedDrive, runs: Sequence[int] = range(4), *, seed: int = 0) -> ResultTable:
    """Filtered and smoothed errors in the outages of some runs.

    Parameters
    ----------
    drive : IntegratedDrive
    runs : sequence of int
    seed : int
    """
    squares: dict[str, list[tuple[float, float, float]]] = {"filtered": [], "smoothed": []}
    for k in runs:
        result, truth = smoothed_run(drive, k, seed=seed)
        for name, solved in (("filtered", result), ("smoothed", result.smooth())):
            e = solved.errors(truth)
            inside = np.any([(e.t > a) & (e.t < b - 1e-6) for a, b in drive.outages], axis=0)
            assert e.attitude_n is not None
            squares[name].append((
                float(np.mean(e.horizontal[inside] ** 2)),
                float(np.mean(np.sum(e.attitude_n[inside, :2] ** 2, axis=1))),
                float(np.mean(e.attitude_n[inside, 2] ** 2)),
            ))  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, values in squares.items():
        h, tilt, heading = np.sqrt(np.mean(values, axis=0))
        rows.append((drive.imu.name, drive.name, name, float(h), float(tilt / DEG), float(heading / DEG)))
    return ResultTable(
        f"{drive.imu.name}, {drive.name}: smoothing over the outages",
        ("imu", "imu_is", "solution", "horizontal_m", "tilt_deg", "heading_deg"),
        tuple(rows),
        (f"RMS over {len(squares['filtered'])} runs and all outages",),
    )
