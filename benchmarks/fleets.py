"""Fleets of simulated units, as in ``test_freepose``: this process alone, and joined by another one.

    python -m benchmarks.fleets [--units 1000] [--rounds 2] [--halves 1 0]

Processor time is that of this process and of the one that joins it, its start included: what is more than with one is
the price of sharing, on a loaded machine too, while the ratio on the wall needs an idle one. In a file of its own: a
process that joins first imports what was started, and the imports of the other benchmarks take as long as its own.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from schuler.calibration.freepose.fleet import calibrate_fleet
from schuler.recording.series import ImuSeries


def hand_logs(units: int) -> list[ImuSeries]:
    """One log of each unit, drawn from one specification: 105 s at 50 Hz, 20 poses."""
    from schuler.calibration.freepose.simulation import hand_log
    from schuler.sensors.errors import ImuErrors
    from schuler.sensors.noise import NoiseModel, White
    from schuler.sensors.spec import ImuSpec, TriadSpec

    spec = ImuSpec(
        name="of the fleet",
        gyro=TriadSpec.gyro(arw_deg_rthr=1.0, bias_deg_s=0.5, scale_percent=1.0, misalignment_percent=1.0),
        accel=TriadSpec.accelerometer(vrw_m_s_rthr=0.12, bias_mg=30.0, scale_percent=0.5, misalignment_percent=0.5),
    )
    logs = []
    for sequence in np.random.SeedSequence(1).spawn(units):
        rng = np.random.default_rng(sequence)
        noise = {"gyro_noise": NoiseModel((White(3e-4),)), "accel_noise": NoiseModel((White(2e-3),))}
        errors = replace(ImuErrors.draw(spec, rng, gauge="upper"), **noise)
        logs.append(hand_log(errors, rng, poses=20, rest_s=3.0, turn_s=1.5, rate_hz=50.0))
    return logs


def processor_s() -> tuple[float, float]:
    """Processor time of this process, and of those it has started and that have ended. [s]"""
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, others.ru_utime + others.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--halves", type=int, nargs="+", default=[1, 0])
    given = parser.parse_args()
    logs = hand_logs(given.units)
    calibrate_fleet(logs[:1])
    for halves in map(bool, given.halves):
        wall: dict[int | None, float] = dict.fromkeys((1, 2, None), np.inf)
        cpu: dict[int | None, tuple[float, float]] = dict.fromkeys(wall, (np.inf, np.inf))
        for _ in range(given.rounds):
            for workers in wall:
                began, (own, others) = time.perf_counter(), processor_s()
                calibrate_fleet(logs, workers=workers, halves=halves)
                wall[workers] = min(wall[workers], time.perf_counter() - began)
                now = processor_s()
                cpu[workers] = min(cpu[workers], (now[0] - own, now[1] - others), key=sum)
        print(
            f"fleet of {given.units}, halves={halves}: one {wall[1]:.1f} s, two {wall[2]:.1f} s: ratio "
            f"{wall[1] / wall[2]:.2f}; by default {wall[None]:.1f} s; processor one {sum(cpu[1]):.1f} s, two "
            f"{cpu[2][0]:.1f} + {cpu[2][1]:.1f} s; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
