"""Live walks beside the same walks from their logs: ``python -m benchmarks.live_foot``.

Every walk of the recordings is sent in blocks of 0.2 s; its strides, smoothed as they come, are compared with
``schuler foot`` with ``filter.smooth = "stride"``: of the gait that was learnt live, and with defaults.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from schuler.live import LiveFoot
from schuler.navigation.foot import navigate_foot
from schuler.navigation.result import NavigationResult
from schuler.recording.formats import matlab
from schuler.recording.formats.pyshoe import read_pyshoe
from schuler.recording.series import ImuSeries

from .corpus.case import DATA

_BLOCK = 40


def main() -> None:
    """Print a line a walk, and medians."""
    print(f"{'walk':32}{'s':>6}{'first stride at':>17}{'same gait [m]':>15}{'defaults [m]':>14}{'us/sample':>11}")
    rows = []
    for folder in ("pyshoe_vicon", "pyshoe_more", "llio_foot"):
        for path in sorted((DATA / folder).glob("*.mat")):
            imu = read_pyshoe(path).recording.need_imu() if "pyshoe" in folder else _llio(path)
            rows.append(_walk(imu))
            first, same, defaults, cost = rows[-1]
            length = imu.t[-1] - imu.t[0]
            print(f"{path.stem:32}{length:6.0f}{first:17.1f}{same:15.2e}{defaults:14.4f}{1e6 * cost:11.1f}")
    first, same, defaults, cost = np.array(rows).T
    print(f"{len(rows)} walks; medians: first stride {np.median(first):.1f} s, {1e6 * np.median(cost):.0f} us a sample")
    print(f"same gait: {np.sum(same < 1e-7)} below 1e-7 m, median {np.median(same):.4f}, largest {same.max():.2f} m")
    low, high = np.quantile(defaults, [0.5, 0.9])
    print(f"defaults: median {low:.4f}, 90 % below {high:.3f}, largest {defaults.max():.2f} m")


def _llio(path: Path) -> ImuSeries:
    held = matlab.load(path)
    imu, t = np.asarray(held["imu_data"]), np.asarray(held["timestamps"]).ravel()
    return ImuSeries(np.linspace(t[0], t[-1], len(t)), imu[:, 3:].copy(), imu[:, :3].copy())


def _walk(imu: ImuSeries) -> tuple[float, float, float, float]:
    """Time of the first stride [s], largest differences from the log's run with the same gait and with defaults [m],
    and time a sample [s].
    """
    strides: list[NavigationResult] = []
    at: list[float] = []

    def keep(stride: NavigationResult, health: str, newest: float) -> None:
        strides.append(stride)
        at.append(newest)

    live = LiveFoot(on_stride=keep)
    began = time.perf_counter()
    for k in range(0, len(imu), _BLOCK):
        live.imu_many(imu.t[k : k + _BLOCK], imu.gyro[k : k + _BLOCK], imu.accel[k : k + _BLOCK])
    live.finish()
    cost = (time.perf_counter() - began) / len(imu)
    t = np.concatenate([s.trajectory.t for s in strides])
    r = np.concatenate([s.trajectory.r_eb_e for s in strides])
    same, defaults = (
        _largest(t, r, navigate_foot(imu, config).best) for config in (live.config, {"filter": {"smooth": "stride"}})
    )
    return at[0] - float(imu.t[0]), same, defaults, cost


def _largest(t: np.ndarray, r: np.ndarray, log: NavigationResult) -> float:
    _, i, j = np.intersect1d(t, log.trajectory.t, return_indices=True)
    return float(np.linalg.norm(r[i] - log.trajectory.r_eb_e[j], axis=1).max())


if __name__ == "__main__":
    main()
