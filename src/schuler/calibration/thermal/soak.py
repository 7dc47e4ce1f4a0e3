"""Temperature soak: poses at rest at several temperatures; bias and scale factor against temperature, jointly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.calibration.bench.poses import Poses
from schuler.exceptions import InputError

PLATEAU = 3.0  # poses whose temperatures differ by less belong to one soak [K]
_CONDITION = 1e4  # of the design with columns of unit length, beyond which parameters are left out
_LEAST = 0.05  # an axis is determined only if it points up about as much as the others, not by 2 deg of set-up scatter
_ITERATIONS = 30
FALSE_ALARM = 0.01
HIGHEST_DEGREE = 6


@dataclass(frozen=True, eq=False)
class Soak:
    """Poses in a row, with their temperatures.

    Attributes
    ----------
    f, omega, sigma_f, sigma_omega : ndarray, shape (n, 3)
        As in :class:`~schuler.calibration.bench.poses.Poses`.
    T : ndarray, shape (n,)
        [degC]
    group : ndarray of int, shape (n,)
        Number of the soak, in order of time.
    level : ndarray, shape (m,)
        Mean temperature of each soak. [degC]
    way : ndarray, shape (m,)
        +1 reached by heating, -1 by cooling; 0 for the first, of which nobody knows.
    """

    f: FloatArray
    omega: FloatArray
    sigma_f: FloatArray
    sigma_omega: FloatArray
    T: FloatArray
    group: IntArray
    level: FloatArray
    way: FloatArray


@dataclass(frozen=True, eq=False)
class AccelFit:
    """Accelerometer triad against temperature from the magnitude of gravity.

    Attributes
    ----------
    x : ndarray
        Coefficients: of each axis' bias (polynomial, then half the gap), of each axis' scale factor, then M_yx, M_zx,
        M_zy; as far as ``mode`` says.
    covariance : ndarray
    residual, sigma : ndarray, shape (n,)
        ``|(I + M)^-1 (f - b)| - g`` and what the noise makes of it. [m/s^2]
    mode : {"all", "scale", "bias"}
    condition : float
        Of the normal matrix with unit diagonal.
    """

    x: FloatArray
    covariance: FloatArray
    residual: FloatArray
    sigma: FloatArray
    mode: Literal["all", "scale", "bias"]
    condition: float

    @property
    def squares(self) -> float:
        """Weighted residuals squared."""
        return float(np.sum((self.residual / self.sigma) ** 2))


def gathered(poses: list[Poses]) -> Soak:
    """Poses of all soaks in one.

    Parameters
    ----------
    poses : list of Poses
        One for each soak, or any number; a soak ends where the temperature moves by more than :data:`PLATEAU`.

    Raises
    ------
    InputError
        If there is no pose, or one has no temperature.
    """
    if not poses or not any(len(p) for p in poses):
        raise InputError("poses: expected poses at several temperatures, got none")
    for k, p in enumerate(poses):
        if p.temperature is None:
            raise InputError(f"poses: expected temperatures, but number {k} has none; a log needs a temperature column")
    f, omega, sigma_f, sigma_omega = (
        np.concatenate([getattr(p, name) for p in poses]) for name in ("f", "omega", "sigma_f", "sigma_omega")
    )
    T = np.concatenate([p.temperature for p in poses if p.temperature is not None])
    group, members = np.zeros(len(T), dtype=np.int64), [0]
    first = np.cumsum([0, *(len(p) for p in poses)])
    for k in range(1, len(T)):
        moved = abs(T[k] - np.mean(T[members])) > PLATEAU
        # another list element is another soak, even at the same temperature: it may have been reached the other way
        apart = k in first and abs(T[k] - np.mean(T[members])) > 0.5 * PLATEAU
        members = [k] if moved or apart else [*members, k]
        group[k] = group[k - 1] + (moved or apart)
    level = np.array([T[group == g].mean() for g in range(group[-1] + 1)])
    way = np.sign(np.diff(level, prepend=level[0]))
    return Soak(f, omega, sigma_f, sigma_omega, T, group, level, way)


def distinct(level: FloatArray) -> int:
    """Number of temperatures that differ by :data:`PLATEAU` or more."""
    return 1 + int(np.count_nonzero(np.diff(np.sort(level)) > PLATEAU))


def gap_columns(soak: Soak) -> tuple[int, tuple[float, float] | None]:
    """How many columns of a difference between heating and cooling the soaks support, and where both came by."""
    up, down = soak.level[soak.way > 0], soak.level[soak.way < 0]
    if not len(up) or not len(down):
        return 0, None
    low, high = max(up.min(), down.min()), min(up.max(), down.max())
    if high < low - PLATEAU:
        return 0, None
    pairs = sum(1 for t in up if np.min(np.abs(down - t)) < PLATEAU)
    return min(2, pairs), (float(low), float(max(high, low)))


def bases(soak: Soak, T0: float, span: float, degree: int, gaps: int) -> tuple[FloatArray, FloatArray]:
    """Columns of the biases, shape (n, degree + 1 + gaps), and of the scale factors, (n, degree + 1)."""
    P = ((soak.T - T0) / span)[:, None] ** np.arange(max(degree, gaps - 1) + 1)
    s = 0.5 * soak.way[soak.group]
    return np.concatenate((P[:, : degree + 1], s[:, None] * P[:, :gaps]), axis=1), P[:, : degree + 1]


def unpacked(
    x: FloatArray, Bb: FloatArray, Bs: FloatArray, mode: Literal["all", "scale", "bias"]
) -> tuple[FloatArray, FloatArray]:
    """Bias, shape (n, 3) [m/s^2], and response I + M, shape (n, 3, 3), of each pose."""
    mb, ms = Bb.shape[1], Bs.shape[1]
    b = Bb @ x[: 3 * mb].reshape(3, mb).T
    R = np.broadcast_to(np.eye(3), (len(Bb), 3, 3)).copy()
    if mode != "bias":
        s = Bs @ x[3 * mb : 3 * (mb + ms)].reshape(3, ms).T
        R[:, [0, 1, 2], [0, 1, 2]] += s
    if mode == "all":
        R[:, [1, 2, 2], [0, 0, 1]] += x[3 * (mb + ms) :]
    return b, R


def model(
    x: FloatArray, f: FloatArray, g: float, Bb: FloatArray, Bs: FloatArray, mode: Literal["all", "scale", "bias"]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition ``|(I + M)^-1 (f - b)| - g`` of each pose, its derivative, and that by the measured f.

    Returns
    -------
    r : ndarray, shape (n,)
        [m/s^2]
    J : ndarray, shape (n, p)
        dr/dx.
    w : ndarray, shape (n, 3)
        dr/df.

    References
    ----------
    Hayal (2010), eq. (3.19) with parameters that depend on temperature.
    """
    b, R = unpacked(x, Bb, Bs, mode)
    v = np.linalg.solve(R, (f - b)[..., None])[..., 0]
    length = np.linalg.norm(v, axis=1)
    w = np.linalg.solve(np.swapaxes(R, 1, 2), (v / length[:, None])[..., None])[..., 0]
    parts = [-w[:, [i]] * Bb for i in range(3)]
    if mode != "bias":
        parts += [-(w[:, i] * v[:, i])[:, None] * Bs for i in range(3)]
    if mode == "all":
        parts.append(-w[:, [1, 2, 2]] * v[:, [0, 0, 1]])
    return length - g, np.concatenate(parts, axis=1), w


def fit_accel(
    soak: Soak, g: float, Bb: FloatArray, Bs: FloatArray, scale: bool | None, start: AccelFit | None = None
) -> AccelFit | None:
    """Fit the accelerometers with as many parameters as the poses determine.

    Parameters
    ----------
    soak : Soak
    g : float
        [m/s^2]
    Bb, Bs : ndarray
        See :func:`bases`.
    scale : bool, optional
        Estimate scale factors; None: if the poses allow.
    start : AccelFit, optional
        Only its mode is tried.

    Returns
    -------
    AccelFit or None
        None if not even biases are determined.
    """
    modes: tuple[Literal["all", "scale", "bias"], ...] = ("all", "scale", "bias")
    if start is not None:
        modes = (start.mode,)
    elif scale is not None:
        modes = modes[:2] if scale else modes[2:]
    for mode in modes:
        p = 3 * Bb.shape[1] + (3 * Bs.shape[1] if mode != "bias" else 0) + (3 if mode == "all" else 0)
        if len(soak.f) < p:
            continue
        x = np.zeros(p)
        r, J, w = model(x, soak.f, g, Bb, Bs, mode)
        sigma = np.sqrt(np.sum((w * soak.sigma_f) ** 2, axis=1))
        column = np.linalg.norm(J / sigma[:, None], axis=0)
        if _one_sided(column, Bb.shape[1], Bs.shape[1]) or np.linalg.cond(J / sigma[:, None] / column) > _CONDITION:
            continue
        for _ in range(_ITERATIONS):
            A = J / sigma[:, None]
            column = np.linalg.norm(A, axis=0)
            step = np.linalg.lstsq(A / column, -r / sigma, rcond=None)[0] / column
            x = x + step
            r, J, w = model(x, soak.f, g, Bb, Bs, mode)
            if not np.isfinite(r).all():
                return None
            if np.abs(step * column).max() < 1e-9 * (1.0 + np.abs(x * column).max()):
                break
        A = J / sigma[:, None]
        column = np.linalg.norm(A, axis=0)
        N = (A / column).T @ (A / column)
        C = np.linalg.inv(N) / np.outer(column, column)
        return AccelFit(x, C, r, sigma, mode, float(np.linalg.cond(N)))
    return None


def _one_sided(column: FloatArray, mb: int, ms: int) -> bool:
    """Whether an axis hardly ever points up, by the lengths of the columns of its bias and scale factor."""
    b, s = column[: 3 * mb].reshape(3, mb), column[3 * mb : 3 * (mb + ms)].reshape(-1, ms)
    return any(len(c) > 0 and bool((c.min(axis=0) < _LEAST * c.max(axis=0)).any()) for c in (b, s))


def of_axis(fit: AccelFit, what: Literal["bias", "scale"], axis: int, Bb: FloatArray, Bs: FloatArray) -> slice:
    """Where the coefficients of an axis stand in ``fit.x``; for biases with the gap after the polynomial."""
    mb, ms = Bb.shape[1], Bs.shape[1]
    if what == "bias":
        return slice(axis * mb, (axis + 1) * mb)
    return slice(3 * mb + axis * ms, 3 * mb + (axis + 1) * ms)


def plateau_values(soak: Soak, g: float, fit: AccelFit, Bb: FloatArray, Bs: FloatArray) -> dict[str, Any]:
    """Bias and scale factor of every soak by itself, non-orthogonality held, for the table.

    Returns
    -------
    dict
        ``b_a_x`` ... and ``M_a_xx`` ...: ``value`` and ``sigma``, a number for each soak, None where its poses do not
        determine it.
    """
    names = [f"b_a_{i}" for i in "xyz"] + ([f"M_a_{i}{i}" for i in "xyz"] if fit.mode != "bias" else [])
    out: dict[str, Any] = {n: {"value": [], "sigma": []} for n in names}
    b, R = unpacked(fit.x, Bb, Bs, fit.mode)
    for k in range(len(soak.level)):
        here: BoolArray = soak.group == k
        v = np.linalg.solve(R[here], (soak.f[here] - b[here])[..., None])[..., 0]
        w = np.linalg.solve(np.swapaxes(R[here], 1, 2), (v / np.linalg.norm(v, axis=1, keepdims=True))[..., None])[
            ..., 0
        ]
        A = -w if fit.mode == "bias" else -np.concatenate((w, w * v), axis=1)
        A = A / fit.sigma[here, None]
        column = np.linalg.norm(A, axis=0)
        enough = len(A) >= A.shape[1] and (column > 0.0).all() and np.linalg.cond(A / column) < _CONDITION
        if not enough:
            for n in names:
                out[n]["value"].append(None)
                out[n]["sigma"].append(None)
            continue
        # one step from the joint fit is exact enough: what a soak differs by is small
        step = np.linalg.lstsq(A, -(np.linalg.norm(v, axis=1) - g) / fit.sigma[here], rcond=None)[0]
        sigma = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
        level = np.concatenate((b[here].mean(axis=0), np.diagonal(R[here].mean(axis=0)) - 1.0))
        for n, x0, dx, s in zip(names, level, step, sigma, strict=False):
            out[n]["value"].append(float(x0 + dx))
            out[n]["sigma"].append(float(s))
    return out
