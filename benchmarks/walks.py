"""Walks made from the recorded ones, cut, biased, turned, clipped and thinned: ``python -m benchmarks.walks``.

Each walk on a shoe is navigated with defaults after every variation; a table says what the normalised error squared of
the odd and the even names is in the median, and on how many it is above ten, with and without a verdict.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schuler.exceptions import SchulerError
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.foot.errors import walk_errors
from schuler.navigation.foot.rests import detect_rests
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.formats import matlab
from schuler.recording.formats.pyshoe import read_pyshoe
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.rotation import dcm_from_rotvec
from schuler.units import DEG, G0

from .corpus.case import DATA
from .corpus.foot import PLACE, turned_onto

LIMIT = 10.0  # normalised error squared that asks for a verdict
_POINT_M = 0.01  # 1-sigma of a ground point
_LEAST_SWING_S = 0.25

Variation = Callable[[ImuSeries], ImuSeries]


@dataclass(frozen=True)
class Walk:
    """A recorded walk: IMU, and a motion capture or ground points with their times."""

    name: str
    imu: ImuSeries
    truth: Trajectory | tuple[np.ndarray, np.ndarray]

    def nees(self, imu: ImuSeries) -> tuple[float, str]:
        """Horizontal normalised error squared per degree of freedom of a variation of the walk, and its verdict."""
        if isinstance(self.truth, Trajectory):
            result = navigate_foot(imu, {"place": PLACE})
            return walk_errors(result, self.truth, fit="all").nees()[0], result.verdict.status
        result = navigate_foot(imu)
        t, points = self.truth
        inside = (t >= result.t[0]) & (t <= result.t[-1])
        t, points = t[inside], points[inside]
        path = result.position_n()[:, :2]
        e, C = turned_onto(path, points, np.searchsorted(result.t, t - 1e-9))
        at = np.clip(np.searchsorted(result.best.t, t - 1e-9), 0, len(result.best.t) - 1)
        P = result.best.covariance[at][:, 6:8, 6:8]
        P = C @ (P - P[0]) @ C.T + 2.0 * _POINT_M**2 * np.eye(2)
        return float(np.einsum("ni,ni->n", e[1:], np.linalg.solve(P[1:], e[1:, :, None])[:, :, 0]).mean() / 2.0), (
            result.verdict.status
        )


def walks(data: Path) -> list[Walk]:
    """The walks at hand by folder and name."""
    every = []
    for folder in ("pyshoe_vicon", "pyshoe_more"):
        for file in sorted((data / folder).glob("*.mat")):
            recording = read_pyshoe(file).recording
            every.append(Walk(file.stem, recording.need_imu(), recording.need_reference()))
    for file in sorted((data / "llio_foot").glob("*.mat")):
        held = matlab.load(file)
        values, t = np.asarray(held["imu_data"]), np.ravel(held["timestamps"])
        imu = ImuSeries(np.linspace(t[0], t[-1], len(t)), values[:, 3:].copy(), values[:, :3].copy())
        stride = np.ravel(held["strideIndex"]).astype(int) - 1
        points = np.asarray(held["GCP"], dtype=float)
        n = min(len(stride), len(points))
        every.append(Walk(file.stem, imu, (imu.t[stride[:n]], points[:n])))
    return every


def begun(swing: int, share: float) -> Variation:
    """The log from a share of one of its first swings on."""

    def cut(imu: ImuSeries) -> ImuSeries:
        rests = detect_rests(imu, FootConfig().detector, gravity=G0)
        long = np.flatnonzero(rests.start[1:] - rests.stop[:-1] > _LEAST_SWING_S)
        k = long[min(swing, len(long) // 2)]
        return imu.between(rests.stop[k] + share * (rests.start[k + 1] - rests.stop[k]), imu.t[-1])

    return cut


def biased(gyro_deg_s: tuple[float, ...] = (0.0,) * 3, accel: tuple[float, ...] = (0.0,) * 3) -> Variation:
    """Constant errors of gyroscopes [deg/s] and accelerometers [m/s^2] added."""
    return lambda imu: replace(imu, gyro=imu.gyro + DEG * np.array(gyro_deg_s), accel=imu.accel + np.array(accel))


def clipped(accel_g: float = np.inf, gyro_deg_s: float = np.inf) -> Variation:
    """Sensors of a smaller range."""
    f, w = accel_g * G0, gyro_deg_s * DEG
    return lambda imu: replace(imu, accel=np.clip(imu.accel, -f, f), gyro=np.clip(imu.gyro, -w, w))


def turned(*rotvec: float) -> Variation:
    """Axes of another mounting. [rad]"""
    return lambda imu: imu.rotated(dcm_from_rotvec(np.array(rotvec)))


def halved(imu: ImuSeries) -> ImuSeries:
    """Every second sample."""
    return ImuSeries(imu.t[::2], imu.gyro[::2], imu.accel[::2])


def averaged(imu: ImuSeries) -> ImuSeries:
    """Means of two samples."""
    n = len(imu) // 2 * 2
    return ImuSeries(*(x[:n].reshape(-1, 2, *x.shape[1:]).mean(axis=1) for x in (imu.t, imu.gyro, imu.accel)))


def ended(imu: ImuSeries) -> ImuSeries:
    """The first three fifths."""
    return imu.between(imu.t[0], imu.t[0] + 0.6 * (imu.t[-1] - imu.t[0]))


def then(*variations: Variation) -> Variation:
    """One after the other."""

    def all_of(imu: ImuSeries) -> ImuSeries:
        for one in variations:
            imu = one(imu)
        return imu

    return all_of


VARIATIONS: dict[str, tuple[Variation, ...]] = {
    "as recorded": (lambda imu: imu,),
    "begun in a swing": (begun(3, 0.5), begun(1, 0.2), begun(5, 0.8), begun(8, 0.5)),
    "gyro biases of 0.5 to 2 deg/s": (
        biased((1.0, -1.0, 1.0)), biased((-1.0, 1.0, -1.0)), biased((0.0, 0.0, 2.0)), biased((0.5, -0.5, 0.5)),
    ),
    "the same, begun in a swing": (
        then(begun(3, 0.5), biased((1.0, -1.0, 1.0))), then(begun(3, 0.5), biased((-1.0, 1.0, -1.0))),
        then(begun(5, 0.8), biased((-1.0, 1.0, 1.0))), then(begun(1, 0.2), biased((1.0, 1.0, -1.0))),
        then(begun(8, 0.3), biased((0.5, 0.5, 0.5))),
    ),
    "half the rate": (halved, averaged),
    "half the rate, begun in a swing or biased": (
        then(begun(3, 0.5), halved), then(halved, biased((-1.0, 1.0, -1.0))),
    ),
    "axes turned": (
        turned(2.0, 0.0, 0.0), turned(0.7, -1.1, 2.0), then(turned(-1.2, 0.4, 0.9), biased((1.0, -1.0, 1.0))),
    ),
    "forces clipped at 4 and 6 g": (clipped(6.0), clipped(4.0), then(begun(4, 0.4), clipped(6.0))),
    "rates clipped at 300 and 400 deg/s": (clipped(gyro_deg_s=400.0), clipped(gyro_deg_s=300.0)),
    "accelerometer biases of 0.1 to 0.3 m/s^2": (
        biased(accel=(0.2, -0.2, 0.2)), biased(accel=(-0.3, 0.1, 0.2)),
        then(begun(3, 0.6), biased(accel=(0.2, 0.2, -0.2))),
    ),
    "ended while walking": (ended,),
}  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Print one row a kind of variation; 1 if a walk is above the limit and no verdict says so."""
    parser = argparse.ArgumentParser("python -m benchmarks.walks", description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the recordings")
    every = walks(parser.parse_args(argv).data)
    print("| variation | number | median, odd | median, even | above 10 | above 10 and ok | doubtful | refused |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    silent = 0
    for name, variations in VARIATIONS.items():
        nees: tuple[list[float], list[float]] = ([], [])
        above, ok, doubtful, refused = 0, 0, 0, 0
        for variation in variations:
            for k, walk in enumerate(every):
                try:
                    value, status = walk.nees(variation(walk.imu))
                except SchulerError:
                    refused += 1
                    continue
                nees[k % 2].append(value)
                above += value > LIMIT
                doubtful += status != "ok"
                if value > LIMIT and status == "ok":
                    ok += 1
                    print(f"{walk.name}, {name}: {value:.1f}", file=sys.stderr)
        odd, even = (f"{np.median(x):.2f}" for x in nees)
        number = sum(map(len, nees)) + refused
        print(f"| {name} | {number} | {odd} | {even} | {above} | {ok} | {doubtful} | {refused} |", flush=True)
        silent += ok
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())
