"""Time of each step of a live run at 200 Hz: one sample, and the solution with it; time of a sample in blocks.

``python -m benchmarks.live_latency --minutes 60 [--aids] [--fast] [--blocks] [--picture FILE]``: a simulated car on a
course, fixes at 2 Hz that come 0.1 s late, 15 states. Steps count from the moment on when the start
is settled. Each has its time by the clock, which holds what other programs of the machine took, and that of the
processor; garbage collections are timed by themselves. In real time, or with ``--fast`` without waiting. ``--blocks``
prints the processor's time a sample instead, by one and in blocks, with and without solutions.
"""

from __future__ import annotations

import argparse
import gc
import time
from pathlib import Path

import numpy as np
from benchmarks.live_soak import ACCEL, CONFIG, GYRO, SCENARIO, SIGMA_R, SIGMA_V

from schuler.live import LiveNavigator
from schuler.recording import Recording
from schuler.simulation import simulate

RATE_HZ, LATE_S, SETTLED_S, ROUND_S = 200.0, 0.1, 100.0, 130.0
LIMIT_MS = 2.0
QUANTILES = (0.5, 0.99, 0.999, 0.9999, 1.0)


def drive(minutes: float) -> Recording:
    """Rounds of the closed course of :mod:`benchmarks.live_soak`, with errors of IMU and receiver."""
    course = SCENARIO["motion"]["waypoints"]
    rounds = int((minutes * 60.0 + SETTLED_S) / ROUND_S) + 2
    motion = {**SCENARIO["motion"], "waypoints": course + course[1:] * (rounds - 1)}
    gnss = {**SCENARIO["gnss"], "sigma_position_m": SIGMA_R.tolist(), "sigma_velocity_m_s": SIGMA_V.tolist()}
    imu = {"rate_hz": RATE_HZ, "gyro": GYRO, "accel": ACCEL}
    return simulate({**SCENARIO, "seed": 5, "motion": motion, "imu": imu, "gnss": gnss})


def steps(recording: Recording, minutes: float, aids: bool, fast: bool) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Times of the steps by the clock and of the processor, and of garbage collections. [ms]"""
    imu, g = recording.need_imu(), recording.need_gnss()
    v_n, cov_v_n = g.need_velocity()
    live = LiveNavigator.from_config({k: v for k, v in CONFIG.items() if aids or k != "aiding"}, kind=imu.kind)
    t, fixes = imu.t.tolist(), (g.t + LATE_S).tolist()
    n = min(int(minutes * 60.0 * RATE_HZ), len(t) - int(SETTLED_S * RATE_HZ))
    taken, own, pauses, began = np.empty(n), np.empty(n), [], [0]

    def watch(phase: str, _: dict[str, int]) -> None:
        if phase == "start":
            began[0] = time.perf_counter_ns()
        else:
            pauses.append((time.perf_counter_ns() - began[0]) / 1e6)

    def step(i: int, k: int) -> int:
        live.imu(t[i], imu.gyro[i], imu.accel[i])
        while k < len(fixes) and fixes[k] <= t[i]:
            live.fix(g.t[k], g.llh[k], g.cov_r_n[k], v_n[k], cov_v_n[k])
            k += 1
        live.solution()
        return k

    k, first = 0, int(SETTLED_S * RATE_HZ)
    for i in range(first):
        k = step(i, k)
    gc.collect()
    gc.freeze()
    gc.callbacks.append(watch)
    due = time.perf_counter()
    for i in range(n):
        due += 1.0 / RATE_HZ
        while not fast and (wait := due - time.perf_counter()) > 0.0:
            time.sleep(wait)
        before, before_own = time.perf_counter_ns(), time.thread_time_ns()
        k = step(first + i, k)
        own[i] = time.thread_time_ns() - before_own
        taken[i] = time.perf_counter_ns() - before
    gc.callbacks.remove(watch)
    return taken / 1e6, own / 1e6, pauses


def time_a_sample(recording: Recording, block: int, asked: int) -> float:
    """Processor's time a sample of samples given ``block`` together, fixes at 1 Hz in time. [us]

    The solution is asked for every ``asked`` samples, never if that is 0.
    """
    imu, g = recording.need_imu(), recording.need_gnss()
    v_n, cov_v_n = g.need_velocity()
    live = LiveNavigator.from_config({k: v for k, v in CONFIG.items() if k != "aiding"}, kind=imu.kind)
    n, k, began, first = len(imu.t), 0, 0.0, 0
    for i in range(0, n, block):
        if not first and i > 3.0 * SETTLED_S * RATE_HZ:
            first, began = i, time.process_time()
        while k < len(g.t) and g.t[k] <= imu.t[min(i + block, n) - 1]:
            live.fix(g.t[k], g.llh[k], g.cov_r_n[k], v_n[k], cov_v_n[k])
            k += 2
        if block == 1:
            live.imu(imu.t[i], imu.gyro[i], imu.accel[i])
        else:
            live.imu_many(imu.t[i : i + block], imu.gyro[i : i + block], imu.accel[i : i + block])
        if asked and i % asked == 0:
            live.solution()
    live.solution()
    return 1e6 * (time.process_time() - began) / (n - first)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--aids", action="store_true")
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--blocks", action="store_true")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    curves: dict[str, np.ndarray] = {}
    recording = drive(options.minutes)
    if options.blocks:
        for block, asked in ((1, 0), (20, 0), (100, 0), (1, 20), (20, 20)):
            each = min(time_a_sample(recording, block, asked) for _ in range(3))
            print(f"blocks of {block}, solution every {asked or 'no'} samples: {each:.2f} us a sample", flush=True)
        return
    for aids in (False, True) if options.aids else (False,):
        name = "GNSS, zero velocity, wheels" if aids else "GNSS"
        taken, own, pauses = steps(recording, options.minutes, aids, options.fast)
        for what, times in (("clock", taken), ("processor", own)):
            text = ", ".join(f"{q:.5g}" for q in np.quantile(times, QUANTILES))
            above = int((times > LIMIT_MS).sum())
            print(
                f"{name}, {len(times)} steps, {what}: {text} ms ({QUANTILES}); {above} above {LIMIT_MS:g} ms",
                flush=True,
            )
        print(f"{name}: {len(pauses)} garbage collections, the longest {max(pauses, default=0.0):.3g} ms", flush=True)
        curves[f"{name}, processor"], curves[f"{name}, clock"] = own, taken
    if options.picture is not None:
        draw(options.picture, curves)


def draw(path: Path, curves: dict[str, np.ndarray]) -> None:
    """Histograms of step times."""
    from matplotlib.figure import Figure

    figure = Figure((8.0, 3.6), layout="constrained")
    ax = figure.add_subplot()
    bins = np.geomspace(5e-3, 500.0, 100)
    for name, times in curves.items():
        ax.hist(times, bins, histtype="step", lw=1.2 if "processor" in name else 0.7, label=name)
    ax.axvline(LIMIT_MS, color="0.4", ls=":", lw=1.0)
    ax.set(xscale="log", yscale="log", xlabel="time of a step [ms]", ylabel="steps")
    ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
