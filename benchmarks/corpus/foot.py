"""Walks with an IMU on a shoe, navigated with defaults, against motion capture, ground points, or their own start."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.foot.errors import walk_errors
from schuler.navigation.foot.result import FootResult
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.formats import matlab
from schuler.recording.formats.openshoe import read_openshoe_mat
from schuler.recording.formats.pyshoe import PLACE_DEG, read_pyshoe
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries

from .case import DATA, Case
from .judgement import independent

PLACE = dict(zip(("lat_deg", "lon_deg", "height_m"), PLACE_DEG, strict=True))


def _row(result: FootResult) -> dict[str, Any]:
    verdict = getattr(result, "verdict", None)
    level = getattr(verdict, "level", getattr(verdict, "status", verdict))
    return {
        "verdict": None if verdict is None else str(level),
        "exit": int(level == "failed"),
        "notes": len(result.notes),
    }


def pyshoe(data: Path, file: str) -> dict[str, Any]:
    """Against the motion capture; the peer is the author's error, with a threshold chosen with the truth in view."""
    trial = read_pyshoe(data / file)
    result = navigate_foot(trial.recording, {"place": PLACE})
    reference = trial.recording.need_reference()
    smoothed = walk_errors(result, reference, fit="all")
    filtered = walk_errors(result, reference, fit="all", smoothed=False)
    z = smoothed.position_n[smoothed.at_rest, :2] / np.sqrt(np.einsum("kii->ki", smoothed.covariance_n)[:, :2])
    extent = float(np.hypot(*result.position_n()[:, :2].T).max())
    own = walk_errors(result, reference, fit_distance_m=min(0.8, 0.5 * extent)).author_error
    return {
        **_row(result), "error": filtered.rms_horizontal, "smoothed": smoothed.rms_horizontal, **_claims(
            z, smoothed.nees()[0], float(np.sqrt(np.mean(np.einsum("kii->k", smoothed.covariance_n[:, :2, :2]))))
        ),
        "peer": "author's best threshold", "peer_error": trial.errors["shoe"], "ratio": own / trial.errors["shoe"],
    }  # fmt: skip


def _claims(z: np.ndarray, nees: float, claimed: float) -> dict[str, Any]:
    n = max(round(np.mean([independent(z[:, k]) for k in (0, 1)])), 1)
    return {
        "claimed": claimed, "nees": nees, "nees_band": list(chi_square_band(2, n)),
        "inside": [float(np.mean(np.abs(z) < k)) for k in (1.0, 2.0, 3.0)],
        "median_sigmas": float(np.median(np.hypot(*z.T))),
    }  # fmt: skip


def turned_onto(track: np.ndarray, points: np.ndarray, stride: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Track at the strides turned (and mirrored, if that fits better) about the first point onto ground points."""
    at = track[stride] - track[stride[0]]
    fits = []
    for flip in (np.eye(2), np.diag([1.0, -1.0])):
        p = (points - points[0]) @ flip
        s, c = np.sum(at[:, 0] * p[:, 1] - at[:, 1] * p[:, 0]), np.sum(at * p)
        angle = np.arctan2(s, c)
        C = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        fits.append((at @ C.T - p, C))
    return min(fits, key=lambda fit: float(np.sum(fit[0] ** 2)))


def llio(data: Path, file: str) -> dict[str, Any]:
    """Against the ground points of the strides; the peer is the authors' stored track."""
    held = matlab.load(data / file)
    imu, t = np.asarray(held["imu_data"]), np.asarray(held["timestamps"]).ravel()
    stride = np.asarray(held["strideIndex"], dtype=int).ravel() - 1
    points = np.asarray(held["GCP"], dtype=float)
    series = ImuSeries(np.linspace(t[0], t[-1], len(t)), imu[:, 3:].copy(), imu[:, :3].copy())
    result = navigate_foot(Recording(imu=series, metadata=Metadata(name=Path(file).stem)))
    n = min(len(stride), len(points))
    stride, points = stride[:n], points[:n]
    if n < 3:
        raise ValueError(f"{n} ground points")
    row = _row(result)
    for name, smoothed in (("error", False), ("smoothed", True)):
        path = result.position_n(smoothed=smoothed)[:, :2]
        k = np.clip(np.searchsorted(result.t, series.t[stride] - 1e-9), 0, len(path) - 1)
        e, C = turned_onto(path, points, k)
        row[name] = float(np.sqrt(np.mean(np.sum(e**2, axis=1))))
    solution = result.best
    at = np.clip(np.searchsorted(solution.t, series.t[stride] - 1e-9), 0, len(solution.t) - 1)
    P = C @ solution.covariance[at][:, 6:8, 6:8] @ C.T
    keep = slice(1, None)
    P, e = P[keep] + 0.01**2 * np.eye(2), e[keep]  # ground points: a centimetre
    squared = np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]) / 2.0
    z = e / np.sqrt(np.einsum("nii->ni", P))
    row |= _claims(z, float(squared.mean()), float(np.sqrt(np.mean(np.einsum("nii->n", P)))))
    theirs, _ = turned_onto(np.asarray(held["pyshoeTrajectory"], dtype=float), points, stride)
    peer = float(np.sqrt(np.mean(np.sum(theirs**2, axis=1))))
    return row | {"peer": "authors' LSTM track", "peer_error": peer, "ratio": row["smoothed"] / peer}


def openshoe(data: Path) -> dict[str, Any]:
    """A square that ends where it began: the error is the distance from start to end."""
    result = navigate_foot(read_openshoe_mat(data / "openshoe" / "square2.mat", rate_hz=250.0))
    end = result.position_n()[-1]
    before = result.position_n(smoothed=False)[-1]
    P = result.best.covariance[-1][6:8, 6:8] + 0.05**2 * np.eye(2)  # put back by eye
    squared = float(end[:2] @ np.linalg.solve(P, end[:2]) / 2.0)
    z = np.atleast_2d(end[:2] / np.sqrt(np.diag(P)))
    return {
        **_row(result), "error": float(np.hypot(*before[:2])), "smoothed": float(np.hypot(*end[:2])),
        **_claims(z, squared, float(np.sqrt(np.trace(P)))),
    }  # fmt: skip


def _cases() -> list[Case]:
    cases = [Case("openshoe/square2", "foot", ("openshoe/square2.mat",), "m", openshoe)]
    for folder, reader in (("pyshoe_vicon", pyshoe), ("pyshoe_more", pyshoe), ("llio_foot", llio)):
        files = sorted((DATA / folder).glob("*.mat"))
        if not files:
            cases.append(Case(folder, "foot", (folder,), "m", partial(reader, file=folder)))
        for file in files:
            name = f"{folder}/{file.stem.replace('SensorConnectData_', '')}"
            path = f"{folder}/{file.name}"
            cases.append(Case(name, "foot", (path,), "m", partial(reader, file=path)))
    return cases


CASES = _cases()
