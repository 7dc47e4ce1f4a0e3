"""Live run of a real drive against the batch run: late fixes, time a sample, time a call.

``python -m benchmarks.live FOLDER --config examples/rtkexp_drive.toml [--picture docs/images/live.png]`` with the
folder of the recording. Fixes arrive 0, 0.2, 1 and 5 s after their time. The picture shows how far the live solution,
asked for ten times a second with whatever had come, is from the batch run of the same start.
"""

from __future__ import annotations

import argparse
import time
import tomllib
from pathlib import Path

import numpy as np

from schuler import frames
from schuler.live import LiveNavigator
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.recording.io import read
from schuler.recording.recording import Recording

LATENESS_S = (0.0, 0.2, 1.0, 5.0)
BLOCKS = (1, 20, 100)


def stream(recording: Recording, config: dict, late_s: float, block: int, ask_s: float = 0.1) -> tuple:
    """Navigator after a recording, its positions when asked, times of its calls [s] and processor time [s].

    Positions have time [s] and Earth-fixed coordinates [m]; shape (n, 4).
    """
    live = LiveNavigator.from_config(config, kind=recording.need_imu().kind)
    imu, gnss, shift = recording.need_imu(), recording.need_gnss(), live.config.imu.clock_shift_s
    t, k, asked, rows, calls = imu.t.tolist(), 0, -np.inf, [], []
    begin = time.process_time()
    for i in range(0, len(t), block):
        stop = min(i + block, len(t))
        before = time.perf_counter()
        if block == 1:
            live.imu(t[i], imu.gyro[i], imu.accel[i])
        else:
            live.imu_many(imu.t[i:stop], imu.gyro[i:stop], imu.accel[i:stop])
        calls.append(time.perf_counter() - before)
        while k < len(gnss) and gnss.t[k] + late_s <= t[stop - 1] + shift:
            velocity = () if gnss.v_n is None or gnss.cov_v_n is None else (gnss.v_n[k], gnss.cov_v_n[k])
            live.fix(gnss.t[k], gnss.llh[k], gnss.cov_r_n[k], *velocity)
            k += 1
        if t[stop - 1] >= asked + ask_s and (solution := live.solution()) is not None:
            asked = t[stop - 1]
            rows.append((solution.t, *frames.ecef_from_llh(solution.llh)))
    spent = time.process_time() - begin
    for j in range(k, len(gnss)):  # still under way
        live.fix(gnss.t[j], gnss.llh[j], gnss.cov_r_n[j])
    solution = live.solution()
    assert solution is not None
    return live, np.array([*rows, (solution.t, *frames.ecef_from_llh(solution.llh))]), np.array(calls), spent


def apart(rows: np.ndarray, result: NavigationResult) -> np.ndarray:
    """Distance of positions from those of a run. Shape (n,). [m]"""
    at = np.searchsorted(result.trajectory.t, rows[:, 0] - 1e-6)
    return np.asarray(np.linalg.norm(result.trajectory.r_eb_e[at] - rows[:, 1:], axis=1))


def draw(path: Path, curves: dict[float, tuple[np.ndarray, np.ndarray]]) -> None:
    """Distances over time, one curve for each lateness."""
    from matplotlib.figure import Figure

    figure = Figure((8.0, 3.6), layout="constrained")
    ax = figure.add_subplot()
    for late, (t, d) in curves.items():
        part = np.append(np.floor(t[:-1] / 5.0), np.inf)  # the last one is with all fixes
        first = np.flatnonzero(np.diff(part, prepend=-1.0))
        largest = np.maximum(np.maximum.reduceat(d, first), 1e-10)
        ax.semilogy(np.append(t[first[:-1]], t[-1] + 5.0), largest, lw=1.0, label=f"fixes {late:g} s late")
    ax.set(xlabel="time [s]", ylabel="live - batch [m], largest in 5 s", ylim=(1e-10, 10.0))
    ax.legend(loc="center left", fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    config = tomllib.loads(options.config.read_text(encoding="utf-8"))
    recording = read(options.folder, **config.get("recording", {}))
    config.pop("outages", None)
    config["filter"] = {**config.get("filter", {}), "tune": False, "smooth": False}
    loose = {name: section for name, section in config.items() if name != "aiding"}
    curves: dict[float, tuple[np.ndarray, np.ndarray]] = {}
    for name, used in (("GNSS only", loose), ("all aids", config)):
        whole = navigate(recording, used)
        for late in LATENESS_S:
            live, rows, _, _ = stream(recording, used, late, 20)
            same = navigate(recording, used, initial=live.initial)
            d, settled = apart(rows, same), rows[:, 0] > same.trajectory.t[0] + 61.0
            print(
                f"{name}, fixes {late:g} s late: from the batch run of the same start {np.median(d[settled]):.2g} m "
                f"(median), {d[settled].max():.2g} m (largest), {d[-1]:.2g} m with all fixes; from the batch run "
                f"{np.median(apart(rows, whole)[settled]):.2g} m (median)"
            )
            if name == "GNSS only":
                curves[late] = rows[settled, 0] - rows[0, 0], d[settled]
        for block in BLOCKS:
            _, _, calls, spent = stream(recording, used, 0.0, block, 1.0)
            quantiles = np.quantile(calls, (0.5, 0.99, 0.9999)) * 1e3
            print(
                f"{name}, blocks of {block}: {spent / len(recording.need_imu()) * 1e6:.3g} us of a processor a sample; "
                f"a call {quantiles[0]:.2g} ms (median), {quantiles[1]:.2g} (99 %), {quantiles[2]:.3g} (99.99 %)"
            )
    if options.picture is not None:
        draw(options.picture, curves)


if __name__ == "__main__":
    main()
