"""How often ``schuler check`` is wrong: simulated drives of every kind and cuts of real recordings, all in order.

    python benchmarks/check_campaign.py [--drives 1000] [--cuts 500] [--half odd|even] [--only KIND] [--faults]

Nothing is wrong with any of them: clocks, units and axes are right, so that every error is a false one. Prints false
errors and warnings by kind and code. Drives are 60 to 200 s at low rates; number ``k`` is made from seed ``k``. Cuts
have random starts and lengths; each third one has positions only and each third fixes that are held. With ``--faults``
each drive is spoilt by one random fault besides, and the likelihoods said are set beside the share that was right.

Thresholds are chosen on odd numbers (``--half odd``) and reported on even ones. Needs ``../shared/data`` for cuts.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import json
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import schuler
from schuler import frames, rotation
from schuler.diagnosis.result import Diagnosis
from schuler.diagnosis.run import diagnose
from schuler.earth import gravity_somigliana
from schuler.exceptions import SchulerError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.timebase import TimeBase
from schuler.units import DEG

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SCHULER_DATA", ROOT.parent / "shared" / "data"))
sys.path.append(str(ROOT / "tests" / "support"))

_FINE = 0.01  # step in which motion is made [s]
_ORIGIN = np.array([np.radians(48.7), np.radians(9.1), 300.0])
BINS = (0.0, 0.5, 0.8, 0.9, 0.97, 0.99, 1.001)

# ------------------------------------------------------------------------------------------------------------- drives


def _smooth(x: np.ndarray, seconds: float) -> np.ndarray:
    """Running mean, twice: continuous in its first derivative."""
    n = max(int(seconds / _FINE / 2), 1) * 2 + 1
    kernel = np.ones(n) / n
    for _ in range(2):
        x = np.convolve(np.pad(x, n // 2, mode="edge"), kernel, "valid")
    return x


def _steps(t: np.ndarray, rng: np.random.Generator, every: float, values: Callable[[int], np.ndarray]) -> np.ndarray:
    """Values that change at random times, ``every`` seconds apart in the mean."""
    n = max(int(t[-1] / every * 2) + 2, 2)
    at = np.cumsum(rng.uniform(0.5, 1.5, n) * every)
    return np.asarray(values(n))[np.clip(np.searchsorted(at, t), 0, n - 1)]


def _wander(t: np.ndarray, rng: np.random.Generator, period: tuple[float, float], size: float) -> np.ndarray:
    """Sum of five sines of random period and phase, of a standard deviation ``size``."""
    w = 2.0 * np.pi / rng.uniform(*period, 5)
    return size * np.sqrt(2.0 / 5.0) * np.sin(w[:, None] * t + rng.uniform(0.0, 6.3, (5, 1))).sum(axis=0)


def _path(kind: str, t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speed, course and slope over time."""
    begin = _smooth((t > rng.choice([-1.0, rng.uniform(3.0, 25.0)])).astype(float), 5.0)
    top = rng.uniform(6.0, 28.0)
    start = rng.uniform(-np.pi, np.pi)
    none = np.zeros_like(t)
    slope = rng.choice([0.0, 1.0]) * _wander(t, rng, (30.0, 120.0), 0.025)
    stops = _smooth(_steps(t, rng, 25.0, lambda n: rng.choice([0.0, 0.6, 1.0, 1.2], n, p=[0.15, 0.25, 0.4, 0.2])), 6.0)
    if kind == "straight":
        speed = begin * top * (stops if rng.random() < 0.6 else 1.0 + _wander(t, rng, (15.0, 60.0), 0.03))
        return speed, start + _wander(t, rng, (8.0, 40.0), 0.01), slope
    if kind == "circle":
        rate = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.4)
        top = min(top, 5.0 / abs(rate))
        speed = begin * top * (1.0 + _wander(t, rng, (10.0, 60.0), rng.choice([0.005, 0.05])))
        return speed, start + rate * np.cumsum(speed / top) * _FINE, none
    if kind in ("few turns", "figure of eight", "town", "reversing"):
        if kind == "few turns":
            corners = _steps(t, rng, t[-1] / 3.0, lambda n: np.cumsum(rng.choice([-1.0, 0.0, 1.0], n)) * np.pi / 2)
            course = _smooth(corners, 4.0) + _wander(t, rng, (10.0, 40.0), 0.008)
        elif kind == "figure of eight":
            period = rng.uniform(25.0, 60.0)
            course = 2.0 * np.pi * np.sin(2.0 * np.pi * t / period) * rng.uniform(0.5, 0.7)
        else:
            corners = _steps(t, rng, 15.0, lambda n: np.cumsum(rng.uniform(-2.0, 2.0, n)))
            course = _smooth(corners, 4.0) + _wander(t, rng, (5.0, 30.0), 0.02)
        speed = begin * min(top, 14.0) * (1.0 if kind == "figure of eight" else stops)
        if kind == "reversing":
            speed = speed * _smooth(_steps(t, rng, 30.0, lambda n: rng.choice([1.0, 1.0, -0.3], n)), 3.0)
        return speed, start + course, slope
    if kind == "highway":
        speed = begin * (25.0 + _wander(t, rng, (30.0, 90.0), 1.5))
        return speed, start + _wander(t, rng, (40.0, 150.0), 0.15), slope
    if kind == "parked":
        return none, start + none, none
    # on foot, and where a body may go any way
    walk = {"running": 3.5, "foot": 1.3, "quadrotor": 2.5}.get(kind, 1.3) * rng.uniform(0.8, 1.2)
    corners = _smooth(_steps(t, rng, 20.0, lambda n: np.cumsum(rng.uniform(-2.0, 2.0, n))), 1.5)
    go = _smooth(_steps(t, rng, 30.0, lambda n: rng.choice([0.0, 1.0, 1.0, 1.1], n)), 1.5)
    return begin * walk * go, start + corners, slope


KINDS = (
    "straight", "circle", "few turns", "figure of eight", "town", "reversing", "highway", "parked",
    "hand-held", "running", "foot", "quadrotor", "turned by hand",
)  # fmt: skip
FIXES = ("full", "positions", "held", "held positions")


def _body(
    kind: str, t: np.ndarray, speed: np.ndarray, course: np.ndarray, slope: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity, attitude (roll, pitch, heading) and shocks of specific force of the body."""
    v_n = speed[:, None] * np.stack((np.cos(course) * np.cos(slope), np.sin(course) * np.cos(slope), -np.sin(slope)), 1)
    shocks = np.zeros((len(t), 3))
    rpy = np.stack((np.zeros_like(t), slope, course), axis=1)
    if kind in ("hand-held", "turned by hand"):
        held = _smooth(_steps(t, rng, 25.0, lambda n: rng.uniform(-0.9, 0.9, n)), 1.5)
        pose = _smooth(
            _steps(t, rng, 4.0 if kind == "turned by hand" else 60.0, lambda n: rng.uniform(-1.2, 1.2, n)), 1
        )
        other = _smooth(
            _steps(t, rng, 5.0 if kind == "turned by hand" else 60.0, lambda n: rng.uniform(-3.1, 3.1, n)), 1
        )
        if kind == "turned by hand":
            return 0.0 * v_n, np.stack((other, pose, held), axis=1), shocks
        swing = np.minimum(np.abs(speed), 1.0)
        step = np.cumsum(2.0 * np.pi * 1.8 * _FINE * np.ones_like(t))
        rpy = np.stack(
            (0.5 * other + 0.15 * swing * np.sin(step / 2), pose + 0.1 * swing * np.sin(step), course + held), axis=1
        )
        v_n[:, 2] += swing * 0.25 * np.sin(step)
        return v_n, rpy, shocks
    if kind in ("running", "foot"):
        cadence = rng.uniform(1.25, 1.5) if kind == "running" else rng.uniform(0.8, 1.0)
        phase = 2.0 * np.pi * np.cumsum(cadence * (1.0 + _wander(t, rng, (5.0, 20.0), 0.03))) * _FINE
        swing = np.clip(
            1.0 - (0.4 if kind == "running" else 1.0) * np.cos(phase) - 0.6 * np.cos(2 * phase + 0.5), 0.0, 3
        )
        if kind == "running":
            swing = swing + 0.15
        v_n = v_n * swing[:, None]
        go = np.clip(speed, 0.0, 1.0)
        v_n[:, 2] -= go * 0.8 * np.sin(phase) * (swing > 0.2)
        v_n = np.stack([_smooth(x, 0.06) for x in v_n.T], axis=1)
        pitch = slope + go * (0.9 if kind == "running" else 0.6) * np.sin(phase - 0.8) * np.clip(swing, 0.0, 1.0)
        rpy = np.stack((0.1 * go * np.sin(phase), _smooth(pitch, 0.06), course + 0.1 * go * np.sin(phase)), axis=1)
        hit = np.diff(np.floor(phase / (2.0 * np.pi)), prepend=0.0) > 0.0
        kick = np.convolve(hit * go, np.exp(-np.arange(8) / 2.0) * np.cos(np.arange(8) * 1.3), "full")[: len(t)]
        return v_n, rpy, kick[:, None] * rng.normal(0.0, 60.0 if kind == "running" else 25.0, (len(t), 3))
    if kind == "quadrotor":
        v_n = np.stack([_wander(t, rng, (4.0, 25.0), s) for s in (1.5, 1.5, 0.4)], axis=1)
        v_n *= _smooth((t > 5.0).astype(float), 3.0)[:, None]
        a_n = np.gradient(v_n, _FINE, axis=0)
        heading = rng.uniform(-3.0, 3.0) + _smooth(
            _steps(t, rng, 12.0, lambda n: np.cumsum(rng.normal(0, 1.0, n))), 3.0
        )
        c, s = np.cos(heading), np.sin(heading)
        forward, right = c * a_n[:, 0] + s * a_n[:, 1], -s * a_n[:, 0] + c * a_n[:, 1]
        return v_n, np.stack((np.arctan(right / 9.8), -np.arctan(forward / 9.8), heading), axis=1), shocks
    # a vehicle pitches and leans a little with what it does
    a = np.gradient(speed, _FINE)
    turn = np.gradient(course, _FINE) * speed
    soft = rng.uniform(0.0, 0.004)
    rough = np.clip(np.abs(speed) / 5.0, 0.0, 1.0)
    rpy[:, 0] += _smooth(-soft * turn, 0.3) + rough * _wander(t, rng, (0.8, 4.0), 0.004)
    rpy[:, 1] += _smooth(soft * a, 0.3) + rough * _wander(t, rng, (0.7, 4.0), 0.003)
    return v_n, rpy, shocks


def drive(number: int) -> tuple[str, Recording]:
    """Drive of a number: its kind with the fixes it has, and its recording, in order in every respect."""
    rng = np.random.default_rng([20, number])
    kind = KINDS[(number // 2) % len(KINDS)]
    fixes = FIXES[int(rng.integers(len(FIXES)))]
    seconds = float(rng.uniform(60.0, 200.0))
    t = np.arange(0.0, seconds, _FINE)
    speed, course, slope = _path(kind, t, rng)
    v_n, rpy, shocks = _body(kind, t, speed, course, slope, rng)
    imu = _readings(kind, t, v_n, rpy, shocks, rng)
    gnss = _fixes(fixes, t, v_n, rpy, rng)
    metadata = Metadata(f"{kind}, {fixes}", TimeBase("gps", 1.4e9))
    return f"{kind}, {fixes}", Recording(imu=imu, gnss=gnss, metadata=metadata)


def _readings(
    kind: str, t: np.ndarray, v_n: np.ndarray, rpy: np.ndarray, shocks: np.ndarray, rng: np.random.Generator
) -> ImuSeries:
    C_nb = rotation.dcm_from_rpy(rpy)
    gravity = float(gravity_somigliana(_ORIGIN[0], _ORIGIN[2]))
    a_n = np.gradient(v_n, _FINE, axis=0)
    f = np.einsum("nji,nj->ni", C_nb, a_n - np.array([0.0, 0.0, gravity])) + shocks
    w = rotation.body_rate_from_rpy(rpy, np.gradient(rpy, _FINE, axis=0))
    if kind not in ("hand-held", "turned by hand"):
        mount = rotation.dcm_from_rpy(rng.normal(0.0, 2.0 * DEG, (1, 3)))[0]
        f, w = f @ mount, w @ mount
    every = int(rng.choice([1, 2, 4])) if kind in ("running", "foot") else int(rng.choice([2, 4, 5]))
    n = len(t) // every
    # means over the sampling interval: a sensor's own filter
    f, w = (x[: n * every].reshape(n, every, 3).mean(axis=1) for x in (f, w))
    moving = np.clip(np.abs(v_n[: n * every : every]).sum(axis=1) / 5.0, 0.0, 1.0)[:, None]
    grade = rng.uniform(0.0, 1.0)
    f_sd, w_sd = 0.005 + 0.05 * grade**2, 0.0003 + 0.004 * grade**2
    shake = rng.uniform(0.0, 0.6) * (kind not in ("hand-held", "turned by hand"))
    f = f * (1.0 + rng.normal(0.0, 0.004, 3)) + rng.normal(0.0, 0.08 * grade + 0.01, 3)
    w = w * (1.0 + rng.normal(0.0, 0.005, 3)) + rng.normal(0.0, 0.005 * grade + 1e-4, 3)
    f = f + rng.normal(0.0, 1.0, f.shape) * (f_sd + shake * moving)
    w = w + rng.normal(0.0, 1.0, w.shape) * (w_sd + 0.03 * shake * moving)
    return ImuSeries(t[: n * every : every] + 0.5 * (every - 1) * _FINE, w, f)


def _fixes(kind: str, t: np.ndarray, v_n: np.ndarray, rpy: np.ndarray, rng: np.random.Generator) -> GnssSeries:
    rate = float(rng.choice([1.0, 2.0, 5.0, 10.0]))
    at = np.arange(rng.uniform(0.0, 1.0), t[-1] - 0.1, 1.0 / rate)
    arm = rng.normal(0.0, 0.7, 3) * rng.choice([0.0, 1.0])
    w = np.gradient(rpy[:, 2], _FINE)
    C_nb = rotation.dcm_from_rpy(rpy)
    lever = C_nb @ arm
    r = np.cumsum(v_n, axis=0) * _FINE + lever
    v = v_n + np.stack((-w * lever[:, 1], w * lever[:, 0], np.zeros_like(w)), axis=1)
    receiver = str(rng.choice(["rtk", "good", "code", "phone"]))
    white, slow, sigma_v = {
        "rtk": (0.01, 0.005, 0.03), "good": (0.3, 0.5, 0.05), "code": (0.8, 2.0, 0.1), "phone": (1.5, 4.0, 0.3),
    }[receiver]  # fmt: skip
    n = len(at)
    up = np.array([1.0, 1.0, 1.6])
    drift = np.stack([_wander(at, rng, (60.0, 300.0), slow) for _ in range(3)], axis=1)
    r_g = np.stack([np.interp(at, t, x) for x in r.T], axis=1) + (rng.normal(0.0, white, (n, 3)) + drift) * up
    v_g = np.stack([np.interp(at, t, x) for x in v.T], axis=1) + rng.normal(0.0, sigma_v, (n, 3)) * up
    if "held" in kind:
        fine = np.arange(at[0], at[-1], 1.0 / rng.choice([10.0, 20.0, 50.0]))
        index = np.searchsorted(at, fine, side="right") - 1
        at, r_g, v_g = fine, r_g[index], v_g[index]
    cov_r = np.diag((np.hypot(white, slow) * up) ** 2)
    llh = _llh(r_g)
    velocity = None if "positions" in kind else v_g
    cov_v = None if "positions" in kind else np.tile(np.diag((sigma_v * up) ** 2), (len(at), 1, 1))
    return GnssSeries(at, llh, np.tile(cov_r, (len(at), 1, 1)), velocity, cov_v)


def _llh(r_n: np.ndarray) -> np.ndarray:
    """Places north, east, down of the origin."""
    return np.asarray(frames.llh_from_ecef(frames.ecef_from_ned(r_n, _ORIGIN)))


@functools.cache
def _town() -> Recording:
    return schuler.simulate(ROOT / "examples" / "town.toml")


def town(number: int) -> tuple[str, Recording]:
    """Cut of the simulated town of the examples, positions only in two of three."""
    rng = np.random.default_rng([22, number])
    fixes = ("positions", "full", "positions")[number % 3]
    return f"simulated town, {fixes}", _cut(_town(), fixes, rng)


# --------------------------------------------------------------------------------------------------------------- cuts


def _cut(recording: Recording, fixes: str, rng: np.random.Generator) -> Recording:
    """A part of random start and length, as it stands, with positions only, or with fixes held five times."""
    imu, gnss = recording.imu, recording.gnss
    assert imu is not None
    span = float(imu.t[-1] - imu.t[0])
    length = min(float(rng.uniform(20.0, 200.0)), span)
    a = float(imu.t[0] + rng.uniform(0.0, span - length))
    use = (imu.t >= a) & (imu.t <= a + length)
    imu = replace(
        imu, t=imu.t[use], gyro=imu.gyro[use], accel=imu.accel[use],
        temperature=None if imu.temperature is None else imu.temperature[use],
        magnetometer=None if imu.magnetometer is None else imu.magnetometer[use],
    )  # fmt: skip
    if gnss is not None:
        gnss = gnss.where(np.asarray((gnss.t >= a) & (gnss.t <= a + length)))
        if len(gnss) < 2:
            gnss = None
    if gnss is not None and fixes in ("positions", "held positions"):
        gnss = replace(gnss, v_n=None, cov_v_n=None)
    if gnss is not None and "held" in fixes:
        step = float(np.median(np.diff(gnss.t))) / 5.0
        t = np.arange(gnss.t[0], gnss.t[-1], step)
        index = np.searchsorted(gnss.t, t + 1e-9, side="right") - 1
        change = {name: None if (x := getattr(gnss, name)) is None else x[index]
                  for name in ("llh", "cov_r_n", "v_n", "cov_v_n", "quality") if hasattr(gnss, name)}  # fmt: skip
        gnss = GnssSeries(t, **change)
    return replace(recording, imu=imu, gnss=gnss, reference=None, ranges=None, observations=None, ephemerides=None)


def _fixes_of(t: np.ndarray, r_n: np.ndarray, sigma: float, v_n: np.ndarray | None = None) -> GnssSeries:
    cov = np.tile(np.eye(3) * sigma**2, (len(t), 1, 1))
    return GnssSeries(t, _llh(r_n), cov, v_n, None if v_n is None else cov)


def _plain(name: str, imu: ImuSeries, gnss: GnssSeries | None) -> Recording:
    return Recording(imu=imu, gnss=gnss, metadata=Metadata(name, TimeBase("gps", 1.4e9)))


def _euroc(folder: Path) -> Recording:
    """A quadrotor, with fixes of 5 Hz made of its truth: z of the room up."""
    y = np.loadtxt(folder / "mav0/imu0/data.csv", delimiter=",", skiprows=1)
    x = np.loadtxt(folder / "mav0/state_groundtruth_estimate0/data.csv", delimiter=",", skiprows=1)
    t0 = y[0, 0]
    t, at = (y[:, 0] - t0) * 1e-9, (x[:, 0] - t0) * 1e-9
    flip = np.array([1.0, -1.0, -1.0])
    every = np.searchsorted(at, np.arange(at[0], at[-1], 0.2))
    rng = np.random.default_rng(1)
    r = x[every, 1:4] * flip + rng.normal(0.0, 0.05, (len(every), 3))
    v = x[every, 8:11] * flip + rng.normal(0.0, 0.05, (len(every), 3))
    return _plain(folder.name, ImuSeries(t, y[:, 1:4], y[:, 4:7]), _fixes_of(at[every], r, 0.05, v))


def _shoe(path: Path) -> Recording:
    """A foot, with positions of 5 Hz by motion capture where they were recorded."""
    from scipy.io import loadmat

    m = loadmat(path)
    if "imu_data" in m:
        y, t = m["imu_data"], m["timestamps"].ravel()
        return _plain(path.stem, ImuSeries(t - t[0], y[:, 3:], y[:, :3]), None)
    y, r = m["imu"], m["gt"]
    t = np.arange(len(y)) / 200.0
    every = np.flatnonzero(np.isfinite(r).all(axis=1))[::40]
    return _plain(path.stem, ImuSeries(t, y[:, 3:], y[:, :3]), _fixes_of(t[every], r[every] * [1.0, -1.0, -1.0], 0.02))


def _morpinet(folder: Path, unit: int) -> Recording:
    """A car of a metre, positions only; the RTK's first sample is 1.0 s after the IMU's."""
    y, r = np.load(folder / f"IMU_h_{unit}.npy"), np.load(folder / "ned_h.npy")
    t, at = np.arange(len(y)) / 120.0, np.arange(len(r)) / 10.0
    return _plain(f"morpinet {unit}", ImuSeries(t, y[:, 3:] * DEG, y[:, :3]), _fixes_of(at, r, 0.02))


def _phone(folder: Path) -> Recording:
    """A phone in a car: gyro at the times of the accelerometer."""

    def table(name: str, skip: int, columns: tuple[int, ...]) -> np.ndarray:
        path = next(folder.glob(f"*_{name}.csv"))
        return np.loadtxt(path, delimiter=";", skiprows=skip, usecols=columns)

    f, w, g = table("Acc", 3, (0, 1, 2, 3)), table("Gyro", 3, (0, 1, 2, 3)), table("GNSS", 1, tuple(range(11)))
    t0 = f[0, 0]
    t, tw, tg = ((x[:, 0] - t0) * 1e-9 for x in (f, w, g))
    gyro = np.stack([np.interp(t, tw, w[:, k]) for k in (1, 2, 3)], axis=1)
    speed, course = g[:, 5], g[:, 6] * DEG
    v = np.stack((speed * np.cos(course), speed * np.sin(course), 0.0 * speed), axis=1)
    keep = np.concatenate(([True], np.diff(tg) > 0.0))
    cov_r = np.array([np.diag([s**2, s**2, u**2]) for s, u in g[:, [7, 8]]])
    cov_v = np.array([np.diag([s**2, s**2, 100.0]) for s in g[:, 9]])
    llh = np.column_stack((g[:, 2] * DEG, g[:, 3] * DEG, g[:, 4]))
    gnss = GnssSeries(tg[keep], llh[keep], cov_r[keep], v[keep], cov_v[keep])
    return _plain("phone", ImuSeries(t, gyro, f[:, 1:]), gnss)


def _loaders() -> dict[str, Callable[[], Recording]]:
    """Every recording with an IMU, by name."""
    from real_recordings import GOOD

    out: dict[str, Callable[[], Recording]] = {}
    for name, (options, _) in GOOD.items():
        if "spirent" in name or "thermal" in name:  # no IMU; stamps that are not those of its samples
            continue
        path, hints = DATA / name.partition("#")[0], dict(options)
        if "ferraris_session" in name:
            hints["allow"] = "norm"
        out[name] = functools.partial(schuler.read, path, **hints)
    for folder in sorted((DATA / "euroc_imu").glob("*_*")):
        out[f"euroc_imu/{folder.name}"] = functools.partial(_euroc, folder)
    for path in sorted([*(DATA / "pyshoe_more").glob("*.mat"), *(DATA / "llio_foot").glob("*.mat")]):
        out[f"{path.parent.name}/{path.stem}"] = functools.partial(_shoe, path)
    for path in sorted((DATA / "pyshoe_vicon").glob("*.mat")):
        out[f"{path.parent.name}/{path.name}"] = functools.partial(_shoe, path)
    for unit in range(1, 6):
        out[f"morpinet_car/{unit}"] = functools.partial(_morpinet, DATA / "morpinet_car", unit)
    for unit in range(2):
        hints = {"columns": "ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "rate": 100.0, "delimiter": "space"}
        out[f"mikoff_mpu9150/{unit}"] = functools.partial(schuler.read, DATA / f"mikoff_mpu9150/imu{unit}.log", **hints)
    out["oan_phone_drive"] = functools.partial(_phone, DATA / "oan_phone_drive")
    return out


WITH_FIXES = ("rtkexp_drive", "oan_phone_drive", "rtkexp_walk", "morpinet_car", "euroc_imu", "psins_tc", "pyshoe")


@functools.lru_cache(maxsize=3)
def _read(name: str) -> Recording:
    recording = _loaders()[name]()
    if recording.gnss is None and recording.imu is not None:
        from schuler.diagnosis.heights import single_points

        points = single_points(recording)
        recording = replace(recording, gnss=points)
    return recording


def cuts(number: int) -> list[tuple[int, str]]:
    """Number and recording of each cut, those with fixes four times as often, sorted by recording to read each once."""
    names = sorted(_loaders())
    groups: dict[str, list[str]] = defaultdict(list)
    for name in names:
        groups[name.split("/")[0]].append(name)
    weight = [8 if g in ("rtkexp_drive", "oan_phone_drive") else 4 if g.startswith(WITH_FIXES) else 1 for g in groups]
    places = np.repeat(list(groups), weight)
    out = []
    for k in range(number):
        rng = np.random.default_rng([21, k])
        group = groups[str(places[k % len(places)])]
        out.append((k, group[int(rng.integers(len(group)))]))
    return sorted(out, key=lambda item: item[1])


def cut(number: int, name: str) -> tuple[str, Recording]:
    """Cut of a number from a recording."""
    rng = np.random.default_rng([23, number])
    recording = _read(name)
    fixes = ("as recorded", "positions", "held positions" if number % 2 else "held")[number % 3]
    what = name.split("/")[0] + (f", {fixes}" if recording.gnss is not None else "")
    return what, _cut(recording, fixes, rng)


# ----------------------------------------------------------------------------------------------------------- campaign


def of_half(number: int, half: str | None) -> bool:
    """Whether a number belongs to the half that is asked for."""
    return half is None or (number % 2 == 1) == (half == "odd")


def cases(
    drives: int, towns: int, cut_number: int, half: str | None, only: str | None, first: int = 0
) -> Iterator[tuple[Any, ...]]:
    """Source, number, kind and recording of each case."""
    for k in range(first, first + drives):
        if of_half(k, half) and (only is None or only in KINDS[(k // 2) % len(KINDS)]):
            yield ("drive", k, *drive(k))
    for k in range(towns):
        if of_half(k, half) and (only is None or only in "simulated town"):
            yield ("town", k, *town(k))
    for k, name in cuts(cut_number) if cut_number else []:
        if of_half(k, half) and (only is None or only in name):
            what, recording = cut(k, name)
            yield "cut", k, what, recording


def spoilt(recording: Recording, number: int) -> tuple[Recording, Any] | None:
    """The recording with one random fault, and the fault."""
    import corruptions as suite

    rng = np.random.default_rng([24, number])
    able = [f for f in suite.FAULTS if not f.text]
    for _ in range(20):
        fault = able[int(rng.integers(len(able)))]
        try:
            return suite.apply(recording, (fault,), rng), fault
        except (ValueError, IndexError, TypeError, SchulerError, AttributeError):
            continue
    return None


class Table:
    """Counts of false errors and warnings by kind and code, and of likelihoods beside what was right."""

    def __init__(self) -> None:
        self.kinds: Counter[str] = Counter()
        self.false: Counter[tuple[str, str, str]] = Counter()
        self.lines: list[str] = []
        self.counts: dict[str, list[tuple[float, bool]]] = defaultdict(list)
        self.named: Counter[bool] = Counter()
        self.others: list[str] = []

    def add(self, source: str, number: int, kind: str, diagnosis: Diagnosis) -> None:
        """Count what was found in a case that is in order."""
        self.kinds[source] += 1
        for f in diagnosis.findings:
            # fixes that are held are so; what a real recording has besides is not known
            if f.severity == "note" or ("held" in kind and f.code in ("gnss_repeated", "gnss_fused")):
                continue
            self.false[(f.severity, f.code, f"{source}: {kind}")] += 1
            if source != "cut":
                self.counts[f.code].append((f.confidence, False))
            if f.severity == "error":
                self.lines.append(f"  {source} {number} ({kind}) {f.code} {100 * f.confidence:.1f} %: {f.text[:150]}")

    def add_spoilt(self, case: str, fault: Any, clean: Diagnosis, diagnosis: Diagnosis) -> None:
        """Count what was found in a case with a fault, what the clean case shows too left out."""
        self.named[fault.named_by(diagnosis)] += 1
        for f in diagnosis.findings:
            if f.severity != "note" and not clean.has(f.code):
                self.counts[f.code].append((f.confidence, f.code in fault.codes))
                if f.severity == "error" and f.code not in fault.codes:
                    self.others.append(f"  {case}, {fault.name}: {f.code} {100 * f.confidence:.1f} %: {f.text[:120]}")

    def text(self, seconds: float) -> str:
        """The tables in words and numbers."""
        total = sum(self.kinds.values())
        out = [f"{total} cases ({', '.join(f'{v} {k}s' for k, v in self.kinds.items())}), {seconds:.0f} s"]
        for severity in ("error", "warning"):
            of = Counter[str]()
            for (s, code, _), n in self.false.items():
                of[code] += n * (s == severity)
            out.append(
                f"false {severity}s: {sum(of.values())}  " + ", ".join(f"{c} {n}" for c, n in of.most_common() if n)
            )
        out += self.lines
        if self.named:
            out.append(f"faults named: {self.named[True]} of {sum(self.named.values())}; errors beside them:")
            out += self.others
        if any(right for counts in self.counts.values() for _, right in counts):
            out.append("likelihood said: right of all")
            for code, counts in {"all": [x for s in self.counts.values() for x in s], **self.counts}.items():
                row = []
                for a, b in itertools.pairwise(BINS):
                    inside = [right for p, right in counts if a <= p < b]
                    if inside:
                        row.append(f"{a:.2f}-{min(b, 1):.2f}: {sum(inside)} of {len(inside)}")
                out.append(f"  {code:16s} " + "; ".join(row))
        return "\n".join(out)


def campaign(
    drives: int,
    towns: int,
    cut_number: int,
    *,
    half: str | None = None,
    only: str | None = None,
    faults: bool = False,
    first: int = 0,
) -> Table:
    """Diagnose every case."""
    table = Table()
    for source, number, kind, recording in cases(drives, towns, cut_number, half, only, first):
        diagnosis = diagnose(recording)
        table.add(source, number, kind, diagnosis)
        if faults and (made := spoilt(recording, number)) is not None:
            table.add_spoilt(f"{source} {number} ({kind})", made[1], diagnosis, diagnose(made[0]))
    return table


def main() -> None:
    """Run the campaign of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=1000)
    parser.add_argument("--towns", type=int, default=60)
    parser.add_argument("--cuts", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    parser.add_argument("--half", choices=("odd", "even"))
    parser.add_argument("--only")
    parser.add_argument("--faults", action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    begin = time.process_time()
    cut_number = args.cuts if DATA.is_dir() else 0
    table = campaign(
        args.drives, args.towns, cut_number,
        half=args.half, only=args.only, faults=args.faults, first=args.first,
    )  # fmt: skip
    print(table.text(time.process_time() - begin))
    if args.json:
        rows = [{"severity": s, "code": c, "case": k, "number": n} for (s, c, k), n in table.false.items()]
        args.json.write_text(json.dumps({"cases": dict(table.kinds), "false": rows}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
