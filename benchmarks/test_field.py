"""Field calibration: one log, and runs of the Monte Carlo, 540 s at 100 Hz each (54 000 epochs a pass)."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.calibration.field.options import FieldOptions
from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, field_run, simulated_unit
from schuler.reproduce.yaman.study.static_unit import StaticJob, static_unit
from schuler.reproduce.yaman.study.tables import static_spec
from schuler.sensors import catalogue
from schuler.standstill.rests import field_rests

SEEDS = np.random.SeedSequence(1).spawn(5)


def job(grade: str, rests: str, options: FieldOptions | None = None) -> FieldJob:
    return FieldJob(catalogue.spec(grade), rests=rests, options=options or FieldOptions())


@pytest.mark.benchmark(group="field campaign, runs")
@pytest.mark.parametrize("rests", ["found", "given"])
@pytest.mark.parametrize("grade", ["yaman-automotive", "yaman-tactical"])
def test_campaign(benchmark, grade, rests):
    """Draw, simulate, calibrate until settled, compare: five runs on one processor."""
    work = job(grade, rests)
    passes = [field_run(work, child).passes for child in SEEDS]
    benchmark.extra_info["runs"] = len(SEEDS)
    benchmark.extra_info["epochs"] = len(work.ideal.gyro) * sum(passes)
    benchmark.pedantic(lambda: [field_run(work, child) for child in SEEDS], rounds=3)


@pytest.mark.benchmark(group="field calibration of one log")
@pytest.mark.parametrize("what", ["simulate", "find rests", "one pass as the source", "until settled"])
def test_parts(benchmark, what):
    work = job("yaman-automotive", "given", FieldOptions.thesis() if "source" in what else None)
    (imu, _), _, heading = simulated_unit(work, SEEDS[0])
    calibration = calibrated(work, imu, heading)
    benchmark.extra_info["epochs"] = len(imu) * (len(calibration.passes) if "pass" in what or "settled" in what else 1)
    calls = {"simulate": lambda: simulated_unit(work, SEEDS[0]), "find rests": lambda: field_rests(imu)}
    benchmark.pedantic(calls.get(what, lambda: calibrated(work, imu, heading)), rounds=5, warmup_rounds=1)


@pytest.mark.benchmark(group="static test, units")
def test_static(benchmark):
    work = StaticJob(FieldJob(static_spec("MPU-6000"), rests="given"))
    benchmark.extra_info["units"] = 1
    benchmark.pedantic(lambda: static_unit(work, SEEDS[0]), rounds=3, warmup_rounds=1)
