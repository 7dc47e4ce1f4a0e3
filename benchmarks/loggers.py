"""Folders as loggers leave them, of simulated drives, navigated without a configuration.

    python -m benchmarks.loggers [--seeds FIRST:LAST] [--keep FOLDER]

Each seed draws names, units, axes, delimiters, clocks, rates and pauses, and how the fixes are written: NMEA, a table
of their own, or columns beside the IMU's. A line a folder: the question or refusal, or the horizontal error against the
truth over that of a configuration by hand. Seeds below 250 were in view when the readers were written.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import schuler
from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import SchulerError
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.recording.io.clock import to_unix
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import Trajectory

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
from diagnosis_drives import drive
from messy_folders import nmea

IMU, BOUND = "MPU-6000", 1.3
NAMES = (
    "ax,ay,az,gx,gy,gz", "acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "AccX,AccY,AccZ,GyroX,GyroY,GyroZ",
    "accelX,accelY,accelZ,gyroX,gyroY,gyroZ", "Accel_X,Accel_Y,Accel_Z,Gyr_X,Gyr_Y,Gyr_Z", "AcX,AcY,AcZ,GyX,GyY,GyZ",
    "linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,angular_velocity.x,angular_velocity.y,"
    "angular_velocity.z", "fx,fy,fz,wx,wy,wz", "IMU_AccelX,IMU_AccelY,IMU_AccelZ,IMU_GyroX,IMU_GyroY,IMU_GyroZ",
)  # fmt: skip
#: Unit of the accelerometer and gyroscope: numbers to one SI unit, decimals, and how a header writes it.
ACCEL = {
    "g": (1.0 / units.G0, 4, "g"), "mg": (1e3 / units.G0, 1, "mg"), "m/s2": (1.0, 4, "m/s^2"),
    "counts": (16384.0 / units.G0, 0, ""),
}  # fmt: skip
GYRO = {
    "deg/s": (1.0 / units.DEG, 3, "deg/s"), "rad/s": (1.0, 5, "rad/s"), "mdps": (1e3 / units.DEG, 0, "mdps"),
    "counts": (131.0 / units.DEG, 0, ""),
}  # fmt: skip
CLOCKS = {
    "s": ("t", "time", "Time (s)", "timestamp"), "ms": ("millis", "time_ms", "t(ms)"), "us": ("micros", "time_us"),
    "unix_s": ("timestamp", "unix_time"), "unix_ms": ("timestamp", "unix_ms"), "unix_ns": ("timestamp", "time_ns"),
    "iso": ("datetime", "timestamp"), "day": ("time", "clock"),
}  # fmt: skip
PLACES = ("lat,lon,alt", "latitude,longitude,altitude", "gps_lat,gps_lon,gps_alt", "lat,lng,height")
SPEEDS = {"m/s": (1.0, "speed"), "km/h": (3.6, "speed_kmh"), "kn": (1.0 / units.KNOT, "speed_knots")}


@dataclass(frozen=True)
class Folder:
    """A folder, its drive without errors of sensors, the fixes that were written, and what was drawn."""

    path: Path
    truth: Recording
    fixes: GnssSeries
    velocities: bool
    drawn: str


def rotations() -> list[FloatArray]:
    """The 24 ways in which a board's axes lie along the vehicle's. Shapes (3, 3)."""
    out = []
    for order, signs in itertools.product(itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)):
        C = np.zeros((3, 3))
        C[range(3), order] = signs
        if np.linalg.det(C) > 0.0:
            out.append(C)
    return out


def one(rng: np.random.Generator, choices: Iterable[Any]) -> Any:
    """One of some choices."""
    listed = list(choices)
    return listed[rng.integers(len(listed))]


def stamps(recording: Recording, t: FloatArray, clock: str, zero: float) -> list[str]:
    """Times as a logger writes them."""
    counter = {"s": (1.0, 4), "ms": (1e3, 0), "us": (1e6, 0)}
    if clock in counter:
        scale, decimals = counter[clock]
        values = scale * (t - zero)
        return [f"{x % 2.0**32:.{decimals}f}" for x in (np.round(values) if decimals == 0 else values)]
    ns = to_unix(t, recording.metadata.time)
    if clock in ("unix_s", "unix_ms", "unix_ns"):
        return [f"{x / 1e9:.3f}" if clock == "unix_s" else str(x // (10**6 if clock == "unix_ms" else 1)) for x in ns]
    dates = np.datetime_as_string(np.round(ns / 1e6).astype(np.int64).astype("M8[ms]")).tolist()
    return [f"{x}Z" if clock == "iso" else x.split("T")[1] for x in dates]


def column(values: FloatArray, decimals: int) -> list[str]:
    """Numbers as text."""
    return [f"{x:.{decimals}f}" for x in values]


def save(path: Path, rng: np.random.Generator, head: Sequence[str], cols: Sequence[list[str]], delimiter: str) -> None:
    """Write a table with a banner, line ends and a last line as they come; no header where there is none."""
    comma = delimiter == ";"
    rows = [delimiter.join(x.replace(".", ",") if comma and "T" not in x else x for x in row) for row in zip(*cols)]  # noqa: B905
    words = [name.replace(" ", "") if delimiter == " " else name for name in head]
    banner = one(rng, ("", "", "# logger v1.2\n", "Initializing...\nIMU OK\n"))
    text = banner + "\n".join(([delimiter.join(words)] if words else []) + rows) + one(rng, ("", "\n"))
    path.write_text(text, encoding=one(rng, ("utf-8", "utf-8", "utf-8-sig")), newline=one(rng, ("\n", "\r\n")))


def fixes_of(rng: np.random.Generator, truth: Recording) -> GnssSeries:
    """Fixes of a receiver by itself: once a second, metres off, wandering; no accuracy is written."""
    g = truth.need_gnss()
    g = g.where(np.arange(len(g)) % 5 == 0)
    n, sigma = len(g), one(rng, (1.0, 2.5))
    off = 0.3 * rng.normal(0.0, sigma, (n, 3)) + 0.5 * np.cumsum(rng.normal(0.0, 0.15, (n, 3)), axis=0)
    llh = g.llh + off * [1.0 / 6.378e6, 1.0 / (6.378e6 * np.cos(g.llh[0, 0])), -1.0]
    return replace(g, llh=llh, v_n=g.need_velocity()[0] + rng.normal(0.0, 0.1, (n, 3)))


def made(path: Path, seed: int) -> Folder:
    """Make the folder of a seed."""
    rng = np.random.default_rng(seed)
    rate = one(rng, (25.0, 50.0, 50.0, 100.0, 100.0, 200.0))
    truth = drive(duration=one(rng, (150.0, 240.0)), rate=rate, seed=int(rng.integers(1000)), noise=(0.05, 0.003))
    g, imu = fixes_of(rng, truth), truth.need_imu()
    C = one(rng, rotations())
    bias = rng.normal(0.0, 0.5 * units.DEG, 3), rng.normal(0.0, 0.15, 3)
    accel = one(rng, ACCEL)
    gyro = "counts" if accel == "counts" else one(rng, ("deg/s", "deg/s", "rad/s", "mdps"))
    layout, clock = one(rng, ("beside", "table", "nmea")), one(rng, CLOCKS)
    delimiter = one(rng, (",", ",", ",", ";", "\t", " "))
    t = imu.t + (rng.uniform(-0.1, 0.1, len(imu.t)) / rate if rng.random() < 0.5 else 0.0)
    lost = rng.uniform(60.0, 120.0) if rng.random() < 0.3 else np.inf
    keep = (imu.t < lost) | (imu.t > lost + 0.3)
    zero = imu.t[0] - rng.uniform(0.0, 60.0)
    if clock == "us" and rng.random() < 0.4:
        zero = imu.t[0] - 2.0**32 / 1e6 + 60.0  # micros() begins again a minute after the start
    names = one(rng, NAMES).split(",")
    stated = one(rng, ("{}", "{}", "{} ({})", "{}[{}]")) if accel != "counts" else "{}"
    head, cols = [one(rng, CLOCKS[clock])], [stamps(truth, t[keep], clock, zero)]
    for triad, b, unit, table in ((imu.accel, bias[1], accel, ACCEL), (imu.gyro, bias[0], gyro, GYRO)):
        scale, decimals, word = table[unit]
        head += [stated.format(name, word) for name in names[:3]]
        names = names[3:]
        cols += [column(x, decimals) for x in (scale * (triad[keep] + b) @ C.T).T]
    if rng.random() < 0.4:
        head.append(one(rng, ("temp", "T")))
        cols.append(column(25.0 + np.arange(len(cols[0])) / 1e4, 2))
    v_n = g.need_velocity()[0]
    scale, word = SPEEDS[one(rng, SPEEDS)]
    place, fixes = one(rng, PLACES).split(","), [column(x, 7) for x in g.llh[:, :2].T / units.DEG]
    fixes.append(column(g.llh[:, 2], 2))
    moving = layout == "nmea" or rng.random() < 0.6
    if moving:
        place += [word, one(rng, ("course", "heading"))]
        fixes += [
            column(scale * np.hypot(v_n[:, 0], v_n[:, 1]), 3),
            column(np.arctan2(v_n[:, 1], v_n[:, 0]) / units.DEG % 360.0, 2),
        ]
    between = one(rng, ("", "held", "0.000000")) if delimiter != " " else "held"
    if layout == "beside":
        at = np.searchsorted(imu.t[keep], g.t - 1e-6)
        k = np.searchsorted(at, np.arange(len(cols[0])), side="right") - 1
        new = np.isin(np.arange(len(cols[0])), at)
        head += place
        cols += [
            [f[i] if i >= 0 and (first or between == "held") else between.replace("held", "0.0")
             for i, first in zip(k, new, strict=True)] for f in fixes
        ]  # fmt: skip
    elif layout == "nmea":
        (path / "gps.nmea").write_text(nmea(replace(truth, gnss=g)), newline="")
    else:
        other = clock if clock in ("ms", "us") and zero > imu.t[0] - 61.0 else one(rng, ("unix_s", "unix_ms", "iso"))
        save(path / "gps.csv", rng, [one(rng, CLOCKS[other]), *place], [stamps(truth, g.t, other, zero), *fixes],
             delimiter)  # fmt: skip
    headed = layout == "beside" or rng.random() < 0.85
    save(path / "DATA001.TXT", rng, head if headed else [], cols if headed else cols[:7], delimiter)
    drawn = f"{accel} {gyro} {clock} {layout} {delimiter!r} {rate:g} Hz{'' if headed else ' no header'}"
    return Folder(path, truth, g, moving, drawn)


def error_of(folder: Folder, recording: Recording, config: Any) -> tuple[float, str]:
    """RMS horizontal error beside the truth, whose clock the fixes tell, and the verdict. [m]"""
    result = schuler.navigate(recording, config)
    g, own = folder.fixes, recording.need_gnss()
    near = [int(np.argmin(np.sum((g.llh[:, :2] - llh[:2]) ** 2, axis=1))) for llh in own.llh]
    later = float(np.median(g.t[near] - own.t))
    fixes = folder.truth.need_gnss()
    path = Trajectory.from_geodetic(fixes.t - later, fixes.llh, fixes.v_n)
    return float(np.sqrt(np.mean(trajectory_errors(result.trajectory, path).horizontal ** 2))), result.verdict.status


def by_hand(folder: Folder) -> float:
    """The same of one who knows units, axes, clock and accuracies."""
    n, moving = len(folder.fixes), folder.velocities
    cov, cov_v = np.tile(4.0 * np.eye(3), (n, 1, 1)), np.tile(0.04 * np.eye(3), (n, 1, 1))
    v_n = folder.fixes.v_n if moving else None
    fixes = replace(folder.fixes, cov_r_n=cov, v_n=v_n, cov_v_n=cov_v if moving else None)
    config = {"imu": {"catalogue": IMU}, "aiding": {"non_holonomic": {}}}
    return error_of(folder, replace(folder.truth, gnss=fixes), config)[0]


def main() -> None:
    """Navigate the folders and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="300:340")
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    ratios, refused, unsaid = [], 0, 0
    for seed in range(*map(int, options.seeds.split(":"))):
        with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = (options.keep or Path(scratch)) / f"seed{seed}"
            path.mkdir(parents=True)
            folder = made(path, seed)
            try:
                proposal = schuler.propose(path, imu=IMU)
                error, status = error_of(folder, proposal.recording, proposal.config)
            except SchulerError as reason:
                refused += 1
                print(f"{seed}: {folder.drawn}: {str(reason)[:200]}", flush=True)
                continue
            ratio = error / by_hand(folder)
            ratios.append(ratio)
            unsaid += ratio > 2.0 and status == "ok"
            print(f"{seed}: {folder.drawn}: {error:.2f} m, {ratio:.2f}, {status}", flush=True)
    print(
        f"{refused} of {refused + len(ratios)} refused or asked; error over that by hand: median "
        f"{np.median(ratios):.2f}, at most {BOUND} in {sum(r <= BOUND for r in ratios)} of {len(ratios)}, largest "
        f"{max(ratios):.2f}; above 2 and ok: {unsaid}"
    )


if __name__ == "__main__":
    main()
