"""Hours of a live run with a fault every minute: memory, honesty outside faults, time of each step.

``python -m benchmarks.live_soak --hours 24 [--picture docs/images/live_soak.png]``: a simulated vehicle goes round a
course, with a 200 Hz IMU and fixes at 2 Hz whose errors go on from round to round; between two rounds the IMU pauses
while the vehicle is turned to where it began. Every minute something comes wrong; some runs end by kill -9, and another
process goes on from the state file after a pause.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import frames, rotation, units
from schuler.live import Fix, LiveNavigator
from schuler.recording import Recording
from schuler.simulation import simulate

RATE_HZ, BLOCK = 200.0, 20
SETTLED_S, TURNED_S = 30.0, 2.0  # after a fault or start; between two rounds
_COURSE = (
    (0.0, 0.0, 12.0),
    (200.0, 0.0, 0.0),
    (200.0, 150.0, 0.0),
    (-80.0, 150.0, 8.0),
    (-80.0, 0.0, 0.0),
    (0.0, 0.0, 5.0),
)
SCENARIO = {
    "name": "closed course",
    "motion": {
        "type": "waypoints", "lat_deg": 48.1, "lon_deg": 11.6, "height_m": 500.0, "acceleration_m_s2": 1.8,
        "waypoints": [
            {"north_m": n, "east_m": e, "speed_m_s": 10.0, **({"stop_s": s} if s else {})} for n, e, s in _COURSE
        ],
    },
    "imu": {"rate_hz": RATE_HZ, "gyro": {"arw_deg_rthr": 0.0}, "accel": {"vrw_m_s_rthr": 0.0}},
    "gnss": {
        "rate_hz": 2.0, "first_s": 0.25, "sigma_position_m": [1e-6] * 3, "sigma_velocity_m_s": [1e-6] * 3,
        "lever_arm_m": [0.6, -0.2, -1.1],
    },
}  # fmt: skip
GYRO = {"arw_deg_rthr": 0.25, "bias_deg_hr": 200.0, "in_run_deg_hr": 8.0, "in_run_time_s": 600.0}
ACCEL = {"vrw_m_s_rthr": 0.06, "bias_mg": 4.0, "in_run_mg": 0.05, "in_run_time_s": 600.0}
CONFIG = {
    "imu": {"gyro": GYRO, "accel": ACCEL},
    "gnss": {"lever_arm_m": SCENARIO["gnss"]["lever_arm_m"]},
    "filter": {"states": 15, "tune": False, "smooth": False},
    "aiding": {"zero_velocity": {}, "non_holonomic": {}},
}
SIGMA_R, SIGMA_V = np.array([1.0, 1.0, 1.5]), np.array([0.05, 0.05, 0.08])
FAULTS = ("gap", "pause", "none", "huge", "swapped", "repeated", "late", "far", "garbage", "step", "kill")


@dataclass
class Progress:
    """Samples and rounds given, offset of the stamps by steps and pauses [s], processes so far, newest fault [s]."""

    given: int = 0
    rounds: int = 0
    offset_s: float = 0.0
    processes: int = 0
    fault_s: float = 0.0


class Stream:
    """Errors of one unit on a closed course, any stretch of it by its number of samples since the beginning."""

    def __init__(self, ideal: Recording, seed: int, rounds: int) -> None:
        self.ideal, self.seed = ideal, seed
        imu, rng = ideal.need_imu(), np.random.default_rng(seed)
        self.h, self.n = imu.interval, len(imu)
        self.period = self.n * self.h
        per_h, g = units.DEG / 3600.0, 1e-3 * units.G0
        self.white = np.repeat((GYRO["arw_deg_rthr"] * units.DEG / 60.0, ACCEL["vrw_m_s_rthr"] / 60.0), 3)
        bias = np.repeat((GYRO["bias_deg_hr"] * per_h, ACCEL["bias_mg"] * g), 3) * rng.standard_normal(6)
        run = np.repeat((GYRO["in_run_deg_hr"] * per_h, ACCEL["in_run_mg"] * g), 3)
        a, runs = np.exp(-self.period / 600.0), [run * rng.standard_normal(6)]
        for _ in range(rounds + 1):
            runs.append(a * runs[-1] + run * np.sqrt(1.0 - a * a) * rng.standard_normal(6))
        self.bias = bias + np.array(runs)  # at the beginning of each round, straight between

    def samples(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times [s], angle and velocity increments."""
        k = first + np.arange(count)
        imu, share = self.ideal.need_imu(), ((k % self.n) / self.n)[:, None]
        bias = (1.0 - share) * self.bias[k // self.n] + share * self.bias[k // self.n + 1]
        noise = np.random.default_rng((self.seed, 1, first)).standard_normal((count, 6))
        errors = bias * self.h + self.white * np.sqrt(self.h) * noise
        return (k + 1) * self.h, imu.gyro[k % self.n] + errors[:, :3], imu.accel[k % self.n] + errors[:, 3:]

    def fixes(self, since: float, until: float) -> list[Fix]:
        """Fixes of a stretch of time."""
        g, begin = self.ideal.need_gnss(), float(self.ideal.need_imu().t[0]) - self.h
        made = []
        for turn in range(int(since // self.period), int(until // self.period) + 1):
            t = g.t - begin + turn * self.period
            for k in np.flatnonzero((t > since) & (t <= until) & (g.t - begin <= self.period)):
                rng = np.random.default_rng((self.seed, 2, turn, int(k)))
                north_east = SIGMA_R * rng.standard_normal(3)
                llh = frames.llh_from_ecef(frames.ecef_from_llh(g.llh[k]) + frames.C_en(g.llh[k]) @ north_east)
                v = g.v_n[k] + SIGMA_V * rng.standard_normal(3)
                made.append(Fix(float(t[k]), llh, np.diag(SIGMA_R**2), v, np.diag(SIGMA_V**2)))
        return made

    def nees(self, live: LiveNavigator, t: float) -> float:
        """Square of the error of attitude, velocity and position over its covariance, per component."""
        solution, reference = live.solution(), self.ideal.reference
        assert solution is not None
        k = min(round((t % self.period) / self.h), len(reference.t) - 1)
        C_en = frames.C_en(frames.llh_from_ecef(reference.r_eb_e[k]))
        q = rotation.quat_from_dcm(C_en @ rotation.dcm_from_rpy(solution.rpy_nb))
        turn = rotation.rotvec_from_quat(rotation.quat_multiply(q, rotation.quat_conjugate(reference.q_eb[k])))
        e = np.concatenate((
            C_en.T @ turn, solution.v_eb_n - C_en.T @ reference.v_eb_e[k],
            C_en.T @ (frames.ecef_from_llh(solution.llh) - reference.r_eb_e[k]),
        ))  # fmt: skip
        return float(e @ np.linalg.solve(live.covariance[:9, :9], e)) / 9.0


def resident_mb() -> float:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def child(folder: Path, seed: int, hours: float, by_one: bool) -> None:
    """Navigate until the end, or until the fault that kills this process."""
    stream = Stream(simulate(SCENARIO), seed, int(hours * 3600.0 / 60.0) + 2)
    total, state, where = int(hours * 3600.0 * RATE_HZ), folder / "state", folder / "progress.json"
    at = Progress(**json.loads(where.read_text())) if where.exists() else Progress()
    at.processes += 1
    live = (
        LiveNavigator.load(state) if state.exists() else LiveNavigator.from_config(CONFIG, kind="increment", lag_s=5.0)
    )
    waiting: list[tuple[float, Fix]] = []
    steps, squares, aligned = np.zeros(60, dtype=np.int64), [], -np.inf
    log, spent, minute = (folder / "log.jsonl").open("a"), time.process_time(), at.given
    longest = 0.0
    while at.given < total:
        begin = at.given * stream.h
        rng = np.random.default_rng((seed, 3, at.given))
        fault = ""
        if (at.given // BLOCK) % int(60.0 * RATE_HZ / BLOCK) == int(30.0 * RATE_HZ / BLOCK):
            fault = str(rng.choice(FAULTS))
            at.fault_s = begin
        if fault in ("gap", "pause", "kill"):
            at.given += int(rng.uniform(*{"gap": (4, 60), "pause": (400, 12000), "kill": (200, 4000)}[fault]))
        if fault == "step":
            at.offset_s += float(rng.choice([-3000.0, 7.0, 5000.0]))
        if fault == "kill":
            where.write_text(json.dumps(vars(at)))
            log.flush()
            os.kill(os.getpid(), signal.SIGKILL)
        if at.given // stream.n > at.rounds:
            at.rounds = at.given // stream.n
            at.offset_s += TURNED_S
            at.fault_s = begin
        count = min(BLOCK, stream.n - at.given % stream.n)
        t, gyro, accel = stream.samples(at.given, count)
        end = float(t[-1])
        late = 2.0 if fault == "late" else 0.1
        for fix in stream.fixes(begin, end):
            llh = fix.llh * np.nan if fault == "garbage" else fix.llh + (1e-4 if fault == "far" else 0.0)
            sent = Fix(fix.t + at.offset_s, llh, fix.cov_r_n, fix.v_n, fix.cov_v_n)
            waiting += [(end + late, sent)] * (2 if fault == "repeated" else 1)
        t = t + at.offset_s
        if count < BLOCK:
            fault = ""
        elif fault == "none":
            gyro[3] = np.nan
        elif fault == "huge":
            accel[5] *= 1e6
        elif fault == "swapped":
            t[[4, 9]] = t[[9, 4]]
        elif fault == "repeated":
            t[7] = t[6]
        due = [fix for when, fix in waiting if when <= end]
        waiting = [(when, fix) for when, fix in waiting if when > end]
        if by_one:
            for k in range(count):
                before = time.thread_time_ns()
                live.imu(t[k], gyro[k], accel[k])
                for fix in due if k == count - 1 else ():
                    live.take(fix)
                if k == count - 1:
                    live.solution()
                took = (time.thread_time_ns() - before) * 1e-9
                longest = max(longest, took)
                steps[min(int(10.0 * np.log10(max(took, 1e-7) / 1e-7)), 59)] += 1
        else:
            live.imu_many(t, gyro, accel)
            for fix in due:
                live.take(fix)
        at.given += count
        if count == BLOCK and (at.given // BLOCK) % int(10.0 * RATE_HZ / BLOCK) == 0:
            solution = live.solution()
            aligned = -np.inf if solution is None else max(aligned, live.initial.nav.t - at.offset_s)
            if solution is not None and live.health == "ok" and end - max(aligned, at.fault_s) > SETTLED_S:
                squares.append(stream.nees(live, end))
        if at.given - minute >= 60.0 * RATE_HZ:
            live.save(state)
            now = time.process_time()
            row = {
                "hours": at.given * stream.h / 3600.0, "resident_mb": resident_mb(), "health": live.health,
                "us_a_sample": (now - spent) / (at.given - minute) * 1e6, "process": at.processes, "nees": squares,
                "steps": steps.tolist() if by_one else [], "longest_ms": 1e3 * longest,
            }  # fmt: skip
            log.write(json.dumps(row) + "\n")
            log.flush()
            steps[:], squares, spent, minute, longest = 0, [], now, at.given, 0.0
    where.write_text(json.dumps(vars(at)))


def draw(path: Path, rows: list[dict]) -> None:
    """Memory, and the normalised squares, over the hours."""
    from matplotlib.figure import Figure

    figure = Figure((8.0, 4.4), layout="constrained")
    memory, honesty = figure.subplots(2, 1, sharex=True)
    hours = np.array([row["hours"] for row in rows])
    memory.plot(hours, [row["resident_mb"] for row in rows], ".", ms=2)
    top = 1.2 * max(row["resident_mb"] for row in rows)
    memory.set(ylabel="resident memory [MB]", ylim=(0.0, top))
    honesty.semilogy(
        np.repeat(hours, [len(row["nees"]) for row in rows]), [x for row in rows for x in row["nees"]], ".", ms=2
    )
    honesty.axhline(1.0, color="k", lw=0.8)
    honesty.set(ylabel="NEES / 9, outside faults", xlabel="time of the stream [h]")
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--by-one", action="store_true", help="sample by sample, the solution ten times a second, timed"
    )
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--child", action="store_true")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    if options.child:
        child(folder, options.seed, options.hours, options.by_one)
        return
    command = [sys.executable, "-m", "benchmarks.live_soak", "--child", "--folder", str(folder), "--hours",
               str(options.hours), "--seed", str(options.seed), *(["--by-one"] if options.by_one else [])]  # fmt: skip
    killed = 0
    while (code := subprocess.run(command, check=False).returncode) == -signal.SIGKILL:
        killed += 1
    if code:
        raise SystemExit(f"the run raised an exception, see above; folder {folder}")
    rows = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    print("\n".join(summary(rows, killed)))
    if options.picture is not None:
        draw(options.picture, rows)


def summary(rows: list[dict], killed: int) -> list[str]:
    """Sentences on a run."""
    squares = np.array([x for row in rows for x in row["nees"]])
    memory = np.array([row["resident_mb"] for row in rows])
    lines = [
        f"{rows[-1]['hours']:.2f} h at {RATE_HZ:g} Hz, a fault every minute, {killed} times killed",
        f"memory {memory.min():.0f} to {memory.max():.0f} MB, last {memory[-1]:.0f}",
        f"NEES / 9 outside faults: mean {squares.mean():.2f} of {len(squares)}, 99 % below "
        f"{np.quantile(squares, 0.99):.2f}",
        f"{np.median([row['us_a_sample'] for row in rows]):.1f} us of a processor a sample, simulation with it",
    ]
    steps = np.sum([row["steps"] for row in rows if row["steps"]], axis=0)
    if np.sum(steps):
        share = np.cumsum(steps) / np.sum(steps)
        at = {p: 1e-4 * 10.0 ** ((np.searchsorted(share, p) + 1) / 10.0) for p in (0.5, 0.99, 0.9999)}
        worst = max(row["longest_ms"] for row in rows)
        lines.append(
            f"{np.sum(steps)} steps: half below {at[0.5]:.3g} ms, 99 % below {at[0.99]:.3g}, 99.99 % below "
            f"{at[0.9999]:.3g}, longest {worst:.3g} ms"
        )
    return lines


if __name__ == "__main__":
    main()
