"""Hand-turned logs made from the recorded ones, cut, thinned, rescaled, knocked: ``python -m benchmarks.hand_logs``.

Each log is calibrated by free pose after every variation and compared with the log as recorded: root mean square
difference of the determined parameters over the 1 sigma of the variation, of the odd and of the even names. Parts share
readings with the whole, so a number well below one is no merit; one beyond three with status ``ok`` is a failure.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import SchulerError
from schuler.recording.series import ImuSeries
from schuler.units import DEG, G0

from .corpus.calibration import mikoff, snu, xsens
from .corpus.case import DATA

LIMIT = 3.0  # rms difference in claimed sigmas that asks for a verdict

#: Logs by name: reader of the folder with the data, local gravity.
LOGS = {
    "imu_tk_xsens": (xsens, 9.81744),
    "mikoff_mpu9150/imu0": (partial(mikoff, number=0), G0),
    "mikoff_mpu9150/imu1": (partial(mikoff, number=1), G0),
    "snu_staticposes/good2": (partial(snu, number=2), 9.79871),
    "snu_staticposes/good3": (partial(snu, number=3), 9.79871),
}
EVEN = ("imu_tk_xsens", "mikoff_mpu9150/imu0", "snu_staticposes/good3")  # of the corpus, reported

Spans = list[tuple[float, float]]
Variation = Callable[[ImuSeries, Spans], ImuSeries]


def cut(first: float, last: float) -> Variation:
    """From one share of the log to another."""
    return lambda imu, spans: imu.between(*(imu.t[0] + share * (imu.t[-1] - imu.t[0]) for share in (first, last)))


def begun_in_a_turn(imu: ImuSeries, spans: Spans) -> ImuSeries:
    """The log from the middle of its first turn on."""
    return imu.between(0.5 * (spans[0][1] + spans[1][0]), imu.t[-1])


def every(n: int) -> Variation:
    """Every n-th sample."""
    return lambda imu, spans: ImuSeries(imu.t[::n], imu.gyro[::n], imu.accel[::n])


def means_of(n: int) -> Variation:
    """Means of n samples."""

    def averaged(imu: ImuSeries, spans: Spans) -> ImuSeries:
        k = len(imu) // n * n
        return ImuSeries(*(x[:k].reshape(-1, n, *x.shape[1:]).mean(axis=1) for x in (imu.t, imu.gyro, imu.accel)))

    return averaged


def in_units(accel: float, gyro: float, whole: bool = False) -> Variation:
    """Readings in other units, rounded to whole counts if wanted."""

    def rescaled(imu: ImuSeries, spans: Spans) -> ImuSeries:
        f, omega = imu.accel * accel, imu.gyro * gyro
        return replace(imu, accel=np.rint(f) if whole else f, gyro=np.rint(omega) if whole else omega)

    return rescaled


def short_rests(seconds: float) -> Variation:
    """Each rest ends after some seconds."""

    def shortened(imu: ImuSeries, spans: Spans) -> ImuSeries:
        keep = np.ones(len(imu), dtype=bool)
        for start, stop in spans:
            i, j = np.searchsorted(imu.t, (start + seconds, stop))
            keep[i : max(i, j - 1)] = False
        step = np.diff(imu.t, prepend=imu.t[0])
        return ImuSeries(imu.t[0] + np.cumsum(step[keep]), imu.gyro[keep], imu.accel[keep])

    return shortened


def knocked(share: float) -> Variation:
    """A knock of 60 ms in some rests."""

    def disturbed(imu: ImuSeries, spans: Spans) -> ImuSeries:
        rng, f, omega = np.random.default_rng(0), imu.accel.copy(), imu.gyro.copy()
        force = 0.3 * np.median(np.linalg.norm(f - f.mean(axis=0), axis=1))
        rate = 0.3 * omega.std(axis=0)
        for k in rng.choice(len(spans), max(1, int(share * len(spans))), replace=False):
            a, b = np.searchsorted(imu.t, spans[k])
            first = int(rng.integers(a + (b - a) // 4, b - (b - a) // 4))
            at = slice(first, first + max(2, round(0.06 * imu.rate_hz)))
            f[at] += force * rng.standard_normal(f[at].shape)
            omega[at] += rate * rng.standard_normal(f[at].shape)
        return replace(imu, accel=f, gyro=omega)

    return disturbed


VARIATIONS: dict[str, tuple[Variation, tuple[float, float]]] = {
    "last two thirds": (cut(1.0 / 3.0, 1.0), (1.0, 1.0)),
    "first half": (cut(0.0, 0.5), (1.0, 1.0)),
    "first third": (cut(0.0, 1.0 / 3.0), (1.0, 1.0)),
    "begun in a turn": (begun_in_a_turn, (1.0, 1.0)),
    "every second sample": (every(2), (1.0, 1.0)),
    "means of two": (means_of(2), (1.0, 1.0)),
    "means of five": (means_of(5), (1.0, 1.0)),
    "g and deg/s": (in_units(1.0 / G0, 1.0 / DEG), (1.0 / G0, 1.0 / DEG)),
    "mg and mdps": (in_units(1e3 / G0, 1e3 / DEG), (1e3 / G0, 1e3 / DEG)),
    "coarse counts": (in_units(102.0, 3000.0, whole=True), (102.0, 3000.0)),
    "rests of 2 s": (short_rests(2.0), (1.0, 1.0)),
    "rests of 1 s": (short_rests(1.0), (1.0, 1.0)),
    "knocks in a tenth of the rests": (knocked(0.1), (1.0, 1.0)),
    "knocks in a third of the rests": (knocked(1.0 / 3.0), (1.0, 1.0)),
}


def differences(base: CalibrationResult, result: CalibrationResult, units: tuple[float, float]) -> np.ndarray:
    """Differences to the log as recorded over the 1 sigma of the variation, of what both determine."""
    out = []
    for name in base.names:
        if name[:3] not in ("b_a", "M_a", "b_g", "M_g") or name not in result.names:
            continue
        (x, sigma), (true, sigma_given) = result[name], base[name]
        if not np.isfinite(sigma) or not np.isfinite(sigma_given):
            continue
        k = "ag".index(name[2])
        one = float(name[0] == "M" and name[-1] == name[-2])
        out.append(((one + x) * base.nominal[k] / (result.nominal[k] * units[k]) - one - true) / sigma)
    return np.array(out)


def main(argv: list[str] | None = None) -> int:
    """Print one row a variation; 1 if a log is off by more than the limit with status ``ok``."""
    parser = argparse.ArgumentParser("python -m benchmarks.hand_logs", description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the recordings")
    data = parser.parse_args(argv).data
    logs = {name: (reader(data), g) for name, (reader, g) in LOGS.items() if (data / name.split("/")[0]).is_dir()}
    bases = {name: calibrate_freepose(imu, gravity=g) for name, (imu, g) in logs.items()}
    print("| variation | rms, odd | rms, even | ok | warning | refused |\n|---|---|---|---|---|---|", flush=True)
    silent = 0
    for title, (variation, units) in VARIATIONS.items():
        rms: tuple[list[str], list[str]] = ([], [])
        status: list[str] = []
        for name, (imu, g) in logs.items():
            try:
                result = calibrate_freepose(variation(imu, bases[name].extra["intervals"]), gravity=g)
            except SchulerError:
                status.append("refused")
                continue
            status.append(result.status)
            if result.status == "refused":
                continue
            off = float(np.sqrt(np.mean(differences(bases[name], result, units) ** 2)))
            rms[name in EVEN].append(f"{off:.2f}")
            silent += off > LIMIT and result.status == "ok"
            if off > LIMIT:
                print(f"{name}, {title}: {off:.1f}, {result.status}", file=sys.stderr)
        counts = " | ".join(str(status.count(s)) for s in ("ok", "warning", "refused"))
        print(f"| {title} | {', '.join(rms[0])} | {', '.join(rms[1])} | {counts} |", flush=True)
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())
