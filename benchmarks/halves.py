"""Free-pose calibrations of random halves of a log's rests against each other: ``python -m benchmarks.halves``.

One split of a log into halves says little of a block of three numbers (95 % of its rms lie between 0.27 and 1.77 where
claims are right); many splits of the same rests say how its rests scatter beside what they claim. These splits share
the noise of one log, so their root mean square differs from log to log too: ``--simulated 40`` prints between which
values 95 % of so many simulated logs have it, with white noise and as many poses.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from schuler.calibration.freepose.bias import bias_difference
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.rests import pose_means
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.result.halves import split, tried
from schuler.calibration.result.parameters import BIAS_G
from schuler.calibration.result.result import CalibrationResult
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White

from .corpus.calibration import mikoff, xsens
from .corpus.case import DATA

#: Logs with rests enough for halves: name, reader of the folder with the data, local gravity, number of rests.
LOGS = {
    "imu_tk_xsens": (xsens, 9.81744, 40),
    "mikoff_mpu9150/imu0": (lambda data: mikoff(data, 0), 9.80665, 18),
    "mikoff_mpu9150/imu1": (lambda data: mikoff(data, 1), 9.80665, 18),
}
BLOCKS = ("b_a", "M_a", "b_g", "M_g", "G_g")


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


def root_mean_squares(imu: ImuSeries, gravity: float, splits: int, seed: int = 0) -> dict[str, float]:
    """Root mean square over the random halves of a log, by block."""
    rms = random_halves(imu, gravity, splits, seed)
    return {block: float(np.sqrt(np.mean(np.square(values)))) for block, values in rms.items()}


def simulated_log(rests: int, seed: int) -> ImuSeries:
    """A hand-held log of a MEMS unit with white noise and poses all round."""
    rng = np.random.default_rng([rests, seed])
    errors = ImuErrors(
        b_a=0.1 * rng.standard_normal(3), M_a=np.triu(0.01 * rng.standard_normal((3, 3))),
        b_g=0.01 * rng.standard_normal(3), M_g=0.01 * rng.standard_normal((3, 3)),
        gyro_noise=NoiseModel((White(3e-4),)), accel_noise=NoiseModel((White(2e-3),)),
    )  # fmt: skip
    return hand_log(errors, rng, rotvecs=spread_turns(rests, rng), rate_hz=50.0, turn_s=1.5)


def bands(rests: int, logs: int, splits: int) -> dict[str, tuple[float, float]]:
    """Root mean squares that 95 % of simulated logs have, by block."""
    drawn: dict[str, list[float]] = {}
    for seed in range(logs):
        for block, value in root_mean_squares(simulated_log(rests, seed), 9.80665, splits, seed).items():
            drawn.setdefault(block, []).append(value)
    return {block: tuple(np.quantile(values, (0.025, 0.975))) for block, values in drawn.items()}


def main(argv: list[str] | None = None) -> int:
    """Print one row a log; 1 if none of them is at hand."""
    parser = argparse.ArgumentParser("python -m benchmarks.halves", description=__doc__)
    parser.add_argument("--splits", type=int, default=40, help="random splits of each log (default 40)")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the recordings")
    parser.add_argument("--simulated", type=int, default=0, help="simulated logs for the band of each (default 0)")
    options = parser.parse_args(argv)
    print(f"{'log':<22}" + "".join(f"{block:>14}" for block in BLOCKS))
    rows, band = 0, {}
    for name, (reader, gravity, rests) in LOGS.items():
        if not (options.data / name.split("/")[0]).is_dir():
            continue
        rms = root_mean_squares(reader(options.data), gravity, options.splits)
        print(f"{name:<22}" + "".join(f"{rms[b]:14.2f}" if b in rms else f"{'':>14}" for b in BLOCKS), flush=True)
        if options.simulated:
            if rests not in band:
                band[rests] = bands(rests, options.simulated, min(options.splits, 8))
            cells = (("{:.2f} to {:.2f}".format(*band[rests][b]) if b in band[rests] else "") for b in BLOCKS)
            print(f"{'  simulated':<22}" + "".join(f"{cell:>14}" for cell in cells), flush=True)
        rows += 1
    return 0 if rows else 1


if __name__ == "__main__":
    sys.exit(main())
