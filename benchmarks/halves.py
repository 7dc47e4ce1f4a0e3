"""Free-pose calibrations of random halves of a log's rests against each other: ``python -m benchmarks.halves``.

One split of a log into halves says little of a block of three numbers (95 % of its rms lie between 0.27 and 1.77 where
claims are right); many splits of the same rests say how its rests scatter beside what they claim.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from schuler.calibration.freepose.bias import bias_difference
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.rests import pose_means
from schuler.calibration.result.halves import split, tried
from schuler.calibration.result.parameters import BIAS_G
from schuler.calibration.result.result import CalibrationResult
from schuler.recording.series import ImuSeries

from .corpus.calibration import mikoff, xsens
from .corpus.case import DATA

#: Logs with rests enough for halves: name, reader of the folder with the data, local gravity.
LOGS = {
    "imu_tk_xsens": (xsens, 9.81744),
    "mikoff_mpu9150/imu0": (lambda data: mikoff(data, 0), 9.80665),
    "mikoff_mpu9150/imu1": (lambda data: mikoff(data, 1), 9.80665),
}


def random_halves(imu: ImuSeries, gravity: float, splits: int, seed: int = 0) -> dict[str, list[float]]:
    """Root mean square differences in claimed sigmas, by block, of random halves of the rests."""
    complete = calibrate_freepose(imu, gravity=gravity, halves=False)
    spans = complete.extra["intervals"]
    rates, n = imu.rates(), len(spans)
    index = np.searchsorted(rates.t, np.array(spans))
    rests = pose_means(rates, imu.interval, index, 0)
    force = "G_g_xx" in complete.names
    rng = np.random.default_rng(seed)
    rms: dict[str, list[float]] = {}

    def half(which: np.ndarray) -> CalibrationResult:
        some = [spans[i] for i in which]
        return calibrate_freepose(
            imu, gravity=gravity, intervals=some, nominal=complete.nominal, g_sensitivity=force, halves=False
        )

    for _ in range(splits):
        first = np.isin(np.arange(n), rng.permutation(n)[: n // 2])
        pair = tried(half, (np.flatnonzero(first), np.flatnonzero(~first)))
        if pair is None:
            continue  # a half whose poses determine too little
        stated = None
        if not force:
            variance = complete.nominal[1] ** 2 * bias_difference(rates, rests, first)
            stated = dict(zip(BIAS_G, variance.tolist(), strict=True))
        of_split = split("random", pair[0], pair[1], (), stated)
        for block, z in ({} if of_split is None else of_split.rms).items():
            rms.setdefault(block, []).append(z)
    return rms


def main(argv: list[str] | None = None) -> int:
    """Print one row a log; 1 if none of them is at hand."""
    parser = argparse.ArgumentParser("python -m benchmarks.halves", description=__doc__)
    parser.add_argument("--splits", type=int, default=40, help="random splits of each log (default 40)")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the recordings")
    options = parser.parse_args(argv)
    blocks = ("b_a", "M_a", "b_g", "M_g", "G_g")
    print(f"{'log':<22}{'splits':>7}" + "".join(f"{block:>7}" for block in blocks))
    rows = 0
    for name, (reader, gravity) in LOGS.items():
        if not (options.data / name.split("/")[0]).is_dir():
            continue
        rms = random_halves(reader(options.data), gravity, options.splits)
        cells = "".join(f"{np.sqrt(np.mean(np.square(rms[b]))):7.2f}" if b in rms else f"{'':>7}" for b in blocks)
        print(f"{name:<22}{len(rms.get('b_a', ())):>7}{cells}")
        rows += 1
    return 0 if rows else 1


if __name__ == "__main__":
    sys.exit(main())
