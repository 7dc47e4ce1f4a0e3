"""Drives one after the other with faults every few seconds: no exception, bounded memory, and a good end."""

import json
import subprocess
import sys

import live_cases as cases
import numpy as np
import pytest
from places import ROOT

from schuler.live import Event, Fix, LiveNavigator


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2])
def test_faults_every_few_seconds(tmp_path, seed):
    """Gaps, garbage, late, repeated and misplaced messages, clock steps, restarts from a file; then a clean drive."""
    rng, recording = np.random.default_rng(seed), cases.drive()
    imu, fixes = recording.imu, cases.fixes(recording)
    config = {**cases.CONFIG, "aiding": {"zero_velocity": {}, "non_holonomic": {}}}
    events: list[Event] = []
    live = LiveNavigator.from_config(config, kind=imu.kind, lag_s=5.0, on_event=events.append)
    shift = 0.0
    for drive in range(5):
        clean = drive == 4
        arrivals = []
        for fix in fixes:
            fault = "" if clean or rng.random() > 0.2 else rng.choice(["late", "very late", "none", "far", "twice"])
            t, llh, delay = fix.t + shift, fix.llh, 0.1
            delay += {"late": 2.0, "very late": 20.0}.get(fault, 0.0)
            llh = llh * np.nan if fault == "none" else llh + (1e-4 if fault == "far" else 0.0)
            sent = Fix(t, llh, fix.cov_r_n, fix.v_n, fix.cov_v_n)
            arrivals += [(t + delay, sent)] * (2 if fault == "twice" else 1)
        arrivals.sort(key=lambda a: a[0])
        k = 0
        while k < len(imu):
            part = slice(k, k + 20)
            t, gyro, accel = imu.t[part] + shift, imu.gyro[part].copy(), imu.accel[part].copy()
            fault = "" if clean or rng.random() > 0.05 else rng.choice(["gap", "pause", "none", "huge", "swap", "back"])
            k += 20
            if fault == "gap":
                k += int(rng.integers(1, 40))
            elif fault == "pause" and rng.random() < 0.1:
                k += 500
            elif fault == "none":
                gyro[3] = np.nan
            elif fault == "huge":
                accel[5] *= 1e6
            elif fault == "swap":
                t[[4, 9]] = t[[9, 4]]
            elif fault == "back":
                t[7] -= 3600.0
            live.imu_many(t, gyro, accel)
            while arrivals and arrivals[0][0] <= t[-1]:
                live.take(arrivals.pop(0)[1])
            if rng.random() < 0.002:
                path = live.save(tmp_path / "state")
                live = LiveNavigator.load(path, on_event=events.append)
            solution = live.solution()
            if solution is not None:
                assert np.isfinite(np.concatenate((solution.llh, solution.rpy_nb, solution.sigma_r_n))).all()
        shift += 140.0 + float(rng.choice([0.0, 0.0, 50.0, -30.0]))
    assert live.health == "ok"
    off = np.linalg.norm(cases.position(live.solution()) - recording.reference.r_eb_e[-1])
    assert off < 4.0 * np.linalg.norm(live.solution().sigma_r_n)  # statistical
    run = live._stream.run.filter
    assert len(run.samples) < 100 * (5 + 2)  # the lag, and what comes between two looks at the health
    assert len(run.snapshots) < 2 * (5 + 2)
    assert len(run.aiding.t) < 20 * (5 + 2)
    assert live._stream._collection is None
    assert len(live.events) <= 1000
    assert {e.kind for e in events} >= {"start", "imu", "measurement", "late", "health", "state"}


@pytest.mark.campaign
def test_killed_and_restored(tmp_path):
    """Six minutes of the soak at 200 Hz: processes that end by kill -9 are followed by others that stay honest."""
    command = [sys.executable, "-m", "benchmarks.live_soak", "--hours", "0.1", "--folder", tmp_path]
    subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    squares = 9.0 * np.array([x for row in rows for x in row["nees"]])
    assert rows[-1]["process"] > 1
    assert rows[-1]["health"] == "ok"
    assert 9.0 * 0.2 < squares.mean() < 9.0 + 5.0 * np.sqrt(2.0 * 9.0 / len(squares))  # statistical: 5 standard errors
