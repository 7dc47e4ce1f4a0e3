"""Outages of a real car, like with like: both clocks of the log, without and with wheels.

    python -m benchmarks.car ../shared/data

prints the tables of docs/validation.md: outages of 15 s every 45 s, mean of the largest horizontal error at the
antenna, causal and smoothed, and NEES of horizontal position per degree of freedom. The published set begins at 40 s.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler.navigation.evaluation.errors import outage_errors, trajectory_errors
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.recording.io import read
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory

EXAMPLE = Path(__file__).parents[1] / "examples" / "rtkexp_drive.toml"
PUBLISHED = 40.0  # start of the first outage [s]
OTHERS = (25.0, 32.0, 47.0, 55.0)
#: The derived file, which the peers' programs were given: its clock is 290 ppm slow.
DERIVED = {
    "file": "imu_gpst.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": "gps-tow:2374",
    "axes": "BRU",
}  # fmt: skip


class Row(NamedTuple):
    """One configuration on one set of windows: means of the largest horizontal errors [m], NEES of two axes."""

    clock: str
    wheels: bool
    first_s: float
    causal: float
    smoothed: float
    nees: float


def recordings(data: Path) -> dict[str, Recording]:
    """The drive by its two clocks: the board's own and the derived one."""
    hints = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))["recording"]
    folder = data / "rtkexp_drive"
    return {"derived": read(folder, imu=DERIVED, gnss=hints["gnss"]), "board": read(folder, **hints)}


def row(recording: Recording, clock: str, wheels: bool, first_s: float) -> Row:
    """Navigate with the example's configuration, with or without its wheels."""
    entries: dict[str, Any] = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    if not wheels:
        del entries["aiding"]["non_holonomic"]
    entries["outages"] = {"every_s": 45.0, "length_s": 15.0, "first_s": first_s}
    result = navigate(recording, entries)
    g = recording.need_gnss()
    reference = Trajectory.from_geodetic(g.t, g.llh, g.v_n)
    means = [_mean_largest(x, reference) for x in (result, result.smooth())]
    return Row(clock, wheels, first_s, *means, _nees(result, reference))


def _mean_largest(result: NavigationResult, reference: Trajectory) -> float:
    errors = trajectory_errors(result.trajectory.moved_by(_lever(result)), reference)
    return float(np.mean([o.max_horizontal for o in outage_errors(errors, result.outages)]))


def _nees(result: NavigationResult, reference: Trajectory) -> float:
    """From one second after the start of an outage."""
    errors = trajectory_errors(result.trajectory.moved_by(_lever(result)), reference)
    values = []
    for start, stop in result.outages:
        for k in np.flatnonzero((result.t >= start + 1.0) & (result.t < stop)):
            j = int(np.argmin(np.abs(errors.t - result.t[k])))
            if abs(errors.t[j] - result.t[k]) < 0.06:
                d = errors.position_n[j, :2]
                values.append(d @ np.linalg.solve(result.covariance[k, 6:8, 6:8], d) / 2.0)
    return float(np.mean(values))


def _lever(result: NavigationResult) -> np.ndarray:
    """To the antenna as the run has it in the end."""
    lever: np.ndarray = result.lever_arm_b + result.parameter("lever")[-1]
    return lever


def main(data: Path) -> None:
    """Print the table."""
    print(f"{'clock':<8} {'wheels':<6} {'first':>5} {'causal':>7} {'smoothed':>8} {'NEES':>5}")
    for clock, recording in recordings(data).items():
        for wheels in (False, True):
            for first in (PUBLISHED, *OTHERS):
                r = row(recording, clock, wheels, first)
                used = "yes" if wheels else "no"
                print(
                    f"{clock:<8} {used:<6} {first:5.0f} {r.causal:6.2f}m {r.smoothed:7.2f}m {r.nees:5.2f}", flush=True
                )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data"))
