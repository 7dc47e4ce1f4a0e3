"""Calibrations of halves of a log against each other, beside what both claim; or against published results."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler.calibration.bench.ferraris import calibrate_ferraris
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.ratetable import calibrate_ratetable
from schuler.calibration.bench.sixposition import calibrate_sixposition
from schuler.calibration.bench.turns import Turns
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal.calibrate import calibrate_thermal
from schuler.calibration.thermal.correction import compensate_thermal
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.recording.formats import matlab
from schuler.recording.series import ImuSeries
from schuler.units import DEG

from .case import Case

_SPAN = re.compile(r"\(([\d.]+)\.\.([\d.]+) s\)")
FACES = ("x_up", "x_down", "y_up", "y_down", "z_up", "z_down")


def agreement(a: CalibrationResult, b: CalibrationResult) -> dict[str, Any]:
    """Difference of two calibrations of one unit beside their claims: scale factors and misalignments in ppm."""
    names = [n for n in a.names if n in b.names]
    i, j = [a.names.index(n) for n in names], [b.names.index(n) for n in names]
    d = a.values[i] - b.values[j]
    P = a.covariance[np.ix_(i, i)] + b.covariance[np.ix_(j, j)]
    return compared(names, d, P)


def compared(names: list[str], d: np.ndarray, P: np.ndarray) -> dict[str, Any]:
    """Differences of parameters beside the covariance that they should have."""
    sigma = np.sqrt(np.diag(P))
    keep = np.isfinite(sigma) & (sigma > 0.0)
    names, d, P, sigma = [n for n, k in zip(names, keep, strict=True) if k], d[keep], P[np.ix_(keep, keep)], sigma[keep]
    z = d / sigma
    squared = float(z @ np.linalg.lstsq(P / np.outer(sigma, sigma), z, rcond=1e-9)[0]) / len(z)
    ppm = np.array([n.startswith("M_") for n in names])
    return {
        "error": 1e6 * float(np.sqrt(np.mean(d[ppm] ** 2))), "claimed": 1e6 * float(np.sqrt(np.mean(sigma[ppm] ** 2))),
        "nees": squared, "nees_band": list(chi_square_band(len(z))),
        "inside": [float(np.mean(np.abs(z) < k)) for k in (1.0, 2.0, 3.0)],
        "worst": f"{names[int(np.abs(z).argmax())]} {np.abs(z).max():.1f} sigma",
    }  # fmt: skip


def freepose(data: Path, reader: Callable[[Path], ImuSeries], gravity: float | None, status: str) -> dict[str, Any]:
    """Every other pose of the log, against the others; what the complete log must be called is known."""
    imu = reader(data)
    options: dict[str, Any] = {} if gravity is None else {"gravity": gravity}
    complete = calibrate_freepose(imu, **options)
    row: dict[str, Any] = {
        "verdict": complete.status,
        "warnings": [f"of {status}"] if complete.status != status else [],
    }
    row["exit"] = int(complete.status == "refused")
    if complete.status == "refused":
        return row
    labels = complete.residuals["accel"].label
    spans = [tuple(map(float, match.groups())) for label in labels if (match := _SPAN.search(label)) is not None]
    parts = [calibrate_freepose(imu, nominal=complete.nominal, intervals=spans[k::2], **options) for k in (0, 1)]
    if any(part.status == "refused" for part in parts):
        return row | {"warnings": [*row["warnings"], "halves refused"]}
    return row | agreement(*parts)


def xsens(data: Path) -> ImuSeries:
    accel, gyro = (np.loadtxt(data / "imu_tk_xsens" / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    return ImuSeries(accel[:, 0], gyro[:, 1:], accel[:, 1:])


def snu(data: Path, number: int) -> ImuSeries:
    log = np.loadtxt(data / "snu_staticposes" / f"imu_good{number}.txt")
    return ImuSeries(log[:, 0] - log[0, 0], log[:, 4:7], log[:, 1:4])


def mikoff(data: Path, number: int) -> ImuSeries:
    log = np.loadtxt(data / "mikoff_mpu9150" / f"imu{number}.log")
    return ImuSeries(np.arange(len(log)) / 100.0, log[:, 3:6], log[:, 0:3])


def ferraris(data: Path) -> dict[str, Any]:
    """Without labels, against imucal's result with its author's labels."""
    folder = data / "imucal_ferraris"
    log = np.genfromtxt(folder / "example_ferraris_session.csv", delimiter=",", skip_header=1)
    imu = ImuSeries(np.arange(len(log)) / 102.4, log[:, 1:4] * DEG, log[:, 4:7])
    theirs = json.loads((folder / "session_expected.json").read_text(encoding="utf-8"))
    result = calibrate_ferraris(imu, gravity=9.81)
    names, d = [], []
    for letter in "ag":
        M = np.diag(theirs[f"K_{letter}"]) @ theirs[f"R_{letter}"] - np.eye(3)
        b = np.array(theirs[f"b_{letter}"]) * (DEG if letter == "g" else 1.0)
        expected = {f"M_{letter}_{x}{y}": M[i, j] for i, x in enumerate("xyz") for j, y in enumerate("xyz")}
        expected |= {f"b_{letter}_{x}": b[i] for i, x in enumerate("xyz")}
        for name, value in expected.items():
            if name in result.names:
                names.append(name)
                d.append(result[name][0] - value)
    k = [result.names.index(n) for n in names]
    row = compared(names, np.array(d), result.covariance[np.ix_(k, k)])
    return {"verdict": result.status, **row, "exit": int(result.status == "refused"), "peer": "imucal, labels"}


def ratetable(data: Path, unit: str) -> dict[str, Any]:
    """The first and the second half of each turn."""
    held = matlab.load(data / "vn200_ratetable" / unit / f"{unit}_gyro60_test.mat")
    parts = [np.asarray(held[f"{face}_gyro"]) for face in FACES]
    rate = 60.0 * DEG * np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    t = 1000.0 * np.arange(6.0)

    def half(which: int) -> CalibrationResult:
        some = [p[len(p) // 2 * which : len(p) // 2 * (which + 1)] for p in parts]
        sigma = np.array([p.std(axis=0) / np.sqrt(len(p)) for p in some])
        turns = Turns(rate, np.array([p.mean(axis=0) for p in some]), sigma, None, t, t + len(some[0]) / 50.0)
        return calibrate_ratetable(turns, gravity=9.79, g_sensitivity=False, latitude=39.0 * DEG)

    first, second = half(0), half(1)
    return {"verdict": first.status, "exit": int(first.status == "refused"), **agreement(first, second)}


def sixposition(data: Path, folder: str, both: bool) -> dict[str, Any]:
    """The first and the second half of each of six poses; one file a pose, or one a sensor."""
    place = data / "vn200_ratetable" / folder

    def samples(face: str) -> tuple[np.ndarray, np.ndarray]:
        files = [place / (f"{face}.mat" if both else f"{face}_{name}.mat") for name in ("accel", "gyro")]
        accel, gyro = (np.asarray(matlab.load(f)[n], float) for f, n in zip(files, ("accel", "gyro"), strict=True))
        return (accel, gyro) if accel.shape[1] == 3 else (accel.T, gyro.T)

    parts = [samples(face) for face in FACES]
    t = 1000.0 * np.arange(6.0)

    def half(which: int) -> CalibrationResult:
        some = [[x[len(x) // 2 * which : len(x) // 2 * (which + 1)] for x in pair] for pair in parts]
        means = [np.array([pair[k].mean(axis=0) for pair in some]) for k in (0, 1)]
        sigma = [np.array([pair[k].std(axis=0) / np.sqrt(len(pair[k])) for pair in some]) for k in (0, 1)]
        return calibrate_sixposition(Poses(*means, *sigma, t, t + 5.0), gravity=9.79)

    first, second = half(0), half(1)
    return {"verdict": first.status, "exit": int(first.status == "refused"), **agreement(first, second)}


def thermal(data: Path) -> dict[str, Any]:
    """Fitted to every other hundred samples, judged by the others: what is left of the gyroscopes."""
    d = np.genfromtxt(data / "imu_thermal" / "imu_raw_data.csv", delimiter="\t", skip_header=1)
    t = 0.1 * np.arange(len(d))  # its stamps are not credible
    odd = (np.arange(len(d)) // 100) % 2 == 1

    def log(k: np.ndarray) -> ImuSeries:
        return ImuSeries(t[k], d[k, 1:4], d[k, 4:7], temperature=d[k, 8])

    result = calibrate_thermal(log(~odd))
    left, before = compensate_thermal(result, log(odd), extrapolate=True).gyro, log(odd).gyro
    rms, raw = (float(np.sqrt(np.mean((x - x.mean(axis=0)) ** 2))) for x in (left, before))
    return {"verdict": result.status, "error": 1e6 * rms, "ratio": rms / raw, "peer": "no calibration"}


def _cases() -> list[Case]:
    logs: list[tuple[str, str, Any, float | None, str]] = [
        ("imu_tk_xsens", "imu_tk_xsens", xsens, 9.81744, "ok"),
        *(
            (f"mikoff_mpu9150/imu{k}", f"mikoff_mpu9150/imu{k}.log", partial(mikoff, number=k), None, "ok")
            for k in (0, 1)
        ),
        *(
            (f"snu_staticposes/good{k}", f"snu_staticposes/imu_good{k}.txt", partial(snu, number=k), 9.79871, status)
            for k, status in ((1, "refused"), (2, "warning"), (3, "ok"))
        ),
    ]
    cases = [
        Case(name, "calibration", (needs,), "ppm", partial(freepose, reader=reader, gravity=g, status=status))
        for name, needs, reader, g, status in logs
    ]
    cases.append(Case("imucal_ferraris", "calibration", ("imucal_ferraris",), "ppm", ferraris))
    for unit in ("IMU0", "IMU1"):
        needs = (f"vn200_ratetable/{unit}",)
        cases.append(Case(f"vn200_ratetable/{unit}", "calibration", needs, "ppm", partial(ratetable, unit=unit)))
    for folder, both in (("unit3_sixpos_50hz", False), ("transfer_align", True)):
        needs = (f"vn200_ratetable/{folder}",)
        run = partial(sixposition, folder=folder, both=both)
        cases.append(Case(f"vn200_ratetable/{folder}", "calibration", needs, "ppm", run))
    cases.append(Case("imu_thermal", "calibration", ("imu_thermal",), "urad/s", thermal))
    return cases


CASES = _cases()
