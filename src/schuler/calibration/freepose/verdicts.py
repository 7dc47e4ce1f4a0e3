"""Verdicts of a free-pose calibration: undetermined and weak parameters, and the pose or turn that helps most."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.design.plans import ATTITUDES, words_of
from schuler.calibration.freepose.accel import AccelFit, magnitude_residuals, response

#: 1-sigma beyond which a data sheet is better: elements of M [-], b_a [m/s^2], b_g [rad/s], G_g.
USELESS = {"M_a": 0.01, "M_g": 0.02, "b_a": 0.1, "b_g": 0.01, "G_g": 1e-3}
#: 1-sigma over that of as many poses spread evenly, beyond which the poses are badly distributed.
DILUTION = 8.0
# largest eigenvalue of the normal matrix with unit diagonal, relative to the largest, that counts as zero
_NOTHING = 1e-11


def undetermined_parameters(normal: FloatArray) -> tuple[BoolArray, list[FloatArray], float]:
    """Parameters that a normal matrix does not determine.

    Returns
    -------
    ndarray of bool, shape (p,)
    list of ndarray, shape (p,)
        Undetermined combinations, unit vectors of scaled parameters.
    float
        Condition number with unit diagonal.
    """
    d = np.sqrt(np.maximum(np.diag(normal), 0.0))
    empty = d <= 1e-14 * d.max(initial=1e-300)
    scale = np.where(empty, 1.0, d)
    values, Q = np.linalg.eigh(normal / np.outer(scale, scale))
    none = values <= _NOTHING * values.max()
    mask = empty | (np.abs(Q[:, none]) > 1e-3).any(axis=1)
    condition = float("inf") if none.any() else float(values.max() / values.min())
    return mask, [Q[:, k] for k in np.flatnonzero(none)], condition


def sigma_of_even_poses(fit: AccelFit, gravity: float) -> FloatArray:
    """1-sigma of the nine accelerometer parameters with as many poses spread evenly. Shape (9,)."""
    y = fit.p[:3] + gravity * ATTITUDES @ response(fit.p).T
    _, J, _ = magnitude_residuals(fit.p, y, gravity)
    weight = float((fit.weight / (fit.sigma**2 + fit.spread**2)).sum()) / len(J)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(weight * J.T @ J))))


def next_pose(fit: AccelFit, covariance: FloatArray, gravity: float) -> tuple[FloatArray, float]:
    """Direction to put up that is most informative on the accelerometers, and the 1-sigma of its residual [m/s^2].

    The residual of a new pose has variance ``J P J^T`` by the present parameters; the largest is the most informative
    (D-optimality, one pose at a time).
    """
    y = fit.p[:3] + gravity * ATTITUDES @ response(fit.p).T
    _, J, _ = magnitude_residuals(fit.p, y, gravity)
    variance = np.einsum("kp,pq,kq->k", J, covariance, J)
    # ties go to faces, which are easiest
    kinds = np.abs(ATTITUDES).sum(axis=1)  # 1 of a face, 1.4 of an edge, 1.7 of a corner
    k = int(np.argmax(variance * (1.0 - 1e-3 * kinds)))
    return np.asarray(ATTITUDES[k]), float(np.sqrt(variance[k]))


def missing_directions(up: FloatArray | None, count: int) -> str:
    """Faces and edges that have not been up yet, at most ``count`` of them, in words."""
    missing = np.ones(18, dtype=bool)
    if up is not None and len(up):
        missing = (up @ ATTITUDES[:18].T).max(axis=0) < np.cos(0.4)
    chosen = [words_of(d) for d in ATTITUDES[:18][missing][:count]]
    return "; ".join(chosen)


def weak_accelerometers(
    names: tuple[str, ...], sigma: FloatArray, fit: AccelFit, gravity: float
) -> tuple[list[str], list[str]]:
    """Undetermined accelerometer parameters, and those that other poses would determine much better."""
    even = sigma_of_even_poses(fit, gravity)
    undetermined = [n for n, s in zip(names, sigma, strict=True) if not s < USELESS[n[:3]]]
    diluted = [n for n, s, e in zip(names, sigma, even, strict=True) if n not in undetermined and s > DILUTION * e]
    return undetermined, diluted


def weak_gyroscopes(names: tuple[str, ...], sigma: FloatArray, even: float) -> tuple[list[str], list[str]]:
    """Undetermined and weak gyroscope parameters; ``even`` is 1-sigma of M_g after as many good turns."""
    undetermined = [n for n, s in zip(names, sigma, strict=True) if not s < USELESS[n[:3]]]
    diluted = [
        n for n, s in zip(names, sigma, strict=True) if n[:3] == "M_g" and n not in undetermined and s > DILUTION * even
    ]
    return undetermined, diluted


def turn_advice(names: list[str]) -> str:
    """Turns that determine elements of M_g, b_g or G_g."""
    columns = sorted({n[-1] for n in names if n[:3] == "M_g"})
    parts = []
    if columns:
        which = " and ".join(columns)
        parts.append(
            f"turn by 90 deg or more about {which} while that axis lies level, both ways and from several faces; a "
            "turn about the vertical does not count, gravity does not see it"
        )
    if any(n[:3] == "b_g" for n in names):
        parts.append("rest longer at the start for the gyro bias")
    if any(n[:3] == "G_g" for n in names):
        parts.append("rest longer with each axis up and down for the g-sensitivity")
    return "; ".join(parts)


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
