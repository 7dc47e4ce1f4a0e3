"""Free-pose calibration: one real log against 0.46 s of the C++ original, and a fleet of 1000 simulated units."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from benchmarks.fleets import hand_logs

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.fleet import calibrate_fleet
from schuler.recording.series import ImuSeries

DATA = Path(os.environ.get("SCHULER_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "imu_tk_xsens"
UNITS = 1000


@pytest.mark.benchmark(group="free-pose calibration, 51 175 samples, 38 poses (imu_tk in C++: 0.46 s)")
@pytest.mark.parametrize("options", [{}, {"g_sensitivity": True}, {"size_effect": True, "delay": True}], ids=str)
def test_real_log(benchmark, options):
    if not DATA.is_dir():
        pytest.skip(f"the recording is not here: {DATA}")
    accel, gyro = np.loadtxt(DATA / "xsens_acc.mat"), np.loadtxt(DATA / "xsens_gyro.mat")
    imu = ImuSeries(accel[:, 0], gyro[:, 1:], accel[:, 1:])
    options = {"gravity": 9.81744, "initial_rest_s": 50.0} | options
    calibrate_freepose(imu, **options)
    benchmark.extra_info["epochs"] = len(imu)
    benchmark.pedantic(calibrate_freepose, args=(imu,), kwargs=options, rounds=15)


@pytest.fixture(scope="module")
def fleet():
    return hand_logs(UNITS)


@pytest.mark.benchmark(group=f"fleet of {UNITS} units, units per second")
@pytest.mark.parametrize("workers", [1, None], ids=["one process", "all processors"])
def test_fleet(benchmark, fleet, workers):
    calibrate_freepose(fleet[0])
    benchmark.extra_info["epochs"] = UNITS
    table = benchmark.pedantic(calibrate_fleet, args=(fleet,), kwargs={"workers": workers}, rounds=1)
    assert len(table) == UNITS
    assert table.count("ok") + table.count("warning") > 0.95 * UNITS
