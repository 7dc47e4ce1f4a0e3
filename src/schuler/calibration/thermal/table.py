"""Tables of a sensor against temperature: range, knots, values to interpolate between, heating and cooling apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal import noise as thermal_noise
from schuler.calibration.thermal.noise import Noise
from schuler.exceptions import InputError


def knots(low: float, high: float, step: float | None) -> FloatArray:
    """Temperatures of a table: both ends, and multiples of a round step between them.

    Parameters
    ----------
    low, high : float
        [degC]
    step : float, optional
        None: about a tenth of the range, 1, 2 or 5 times a power of ten. [K]
    """
    if step is None:
        rough = (high - low) / 10.0
        power = 10.0 ** np.floor(np.log10(rough))
        step = float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(np.log(m * power / rough))))
    inner = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)
    # a knot close to an end would be known badly and say nothing new
    inner = inner[(inner > low + 0.4 * step) & (inner < high - 0.4 * step)]
    return np.concatenate(([low], inner, [high]))


def hats(T: FloatArray, at: FloatArray) -> FloatArray:
    """Weights of linear interpolation between knots ``at``, shape (n, k); beyond the ends the end."""
    k = len(at)
    j = np.clip(np.searchsorted(at, T, side="right") - 1, 0, k - 2)
    w = np.clip((T - at[j]) / (at[j + 1] - at[j]), 0.0, 1.0)
    out = np.zeros((len(T), k))
    rows = np.arange(len(T))
    out[rows, j] += 1.0 - w
    out[rows, j + 1] += w
    return out


def table(y: FloatArray, up: FloatArray, down: FloatArray, noise: Noise, relative_to: FloatArray) -> dict[str, Any]:
    """Values at the knots of one axis, from both directions together and apart.

    Parameters
    ----------
    y : ndarray, shape (J,)
        Block means. [x]
    up, down : ndarray, shape (J, k)
        Block means of :func:`hats` while heating and while cooling, zero otherwise.
    noise : Noise
    relative_to : ndarray, shape (k,) of weights
        The value these weights give is subtracted from all (zeros: none), for what has no absolute value.

    Returns
    -------
    dict
        ``value``, ``sigma``; ``heating``, ``cooling``, ``gap`` = heating - cooling, ``gap_sigma``: lists of length k,
        None where a direction did not come by. [x]
    """
    k = up.shape[1]
    X = np.concatenate((up, down), axis=1)
    # a knot that is only touched from the side cannot be estimated: half a block's worth is the least
    seen: BoolArray = np.asarray(X.sum(axis=0) > 0.5)
    solution = thermal_noise.fit(y, X[:, seen], noise)
    x, C = np.full(2 * k, np.nan), np.zeros((2 * k, 2 * k))
    x[seen] = solution.x
    C[np.ix_(seen, seen)] = solution.covariance
    # mean of both directions where there are both
    L = np.zeros((k, 2 * k))
    for i in range(k):
        there = [j for j in (i, i + k) if seen[j]]
        L[i, there] = 1.0 / max(len(there), 1)
    available: BoolArray = np.asarray(L.any(axis=1))
    x0 = np.where(seen, x, 0.0)
    if relative_to.any():
        weights = np.where(available, relative_to, 0.0)
        zero = (weights / max(weights.sum(), 1e-300)) @ L
        x0 = x0 - float(zero @ x0) * seen
        C = _shifted(C, zero, seen)
    value, sigma = L @ x0, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", L, C, L), 0.0))
    both: BoolArray = np.asarray(seen[:k] & seen[k:])
    D = np.concatenate((np.eye(k), -np.eye(k)), axis=1)
    gap, gap_sigma = D @ x0, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", D, C, D), 0.0))
    return {
        "value": _listed(value, available),
        "sigma": _listed(sigma, available),
        "heating": _listed(x0[:k], seen[:k]),
        "cooling": _listed(x0[k:], seen[k:]),
        "gap": _listed(gap, both),
        "gap_sigma": _listed(gap_sigma, both),
    }


def _shifted(C: FloatArray, zero: FloatArray, seen: BoolArray) -> FloatArray:
    """Covariance of ``x - (zero . x)`` for the elements that were seen."""
    T = np.eye(len(C)) - np.outer(seen, zero)
    return np.asarray(T @ C @ T.T)


def _listed(x: FloatArray, available: BoolArray) -> list[float | None]:
    return [float(v) if ok else None for v, ok in zip(x, available, strict=True)]


def interpolated(temperature: FloatArray, at: list[float], values: list[float | None]) -> FloatArray:
    """Linear interpolation in a table; knots without a value are skipped."""
    available = [(t, v) for t, v in zip(at, values, strict=True) if v is not None]
    return np.interp(temperature, [t for t, _ in available], [v for _, v in available])


#: Below this span of temperatures nothing is fitted; below the second the result carries a warning. [K]
SMALLEST_SPAN, NARROW_SPAN = 5.0, 20.0


def reference_of(wanted: float | None, low: float, high: float) -> float:
    """Reference temperature: as wanted, or 25 degC, or the middle of the range if that is outside. [degC]"""
    if wanted is None:
        return 25.0 if low <= 25.0 <= high else float(round(0.5 * (low + high)))
    if not low <= wanted <= high:
        raise InputError(
            f"reference_temperature: expected a temperature of the data, {low:.1f} to {high:.1f} degC, got {wanted}"
        )
    return float(wanted)


def refused(names: tuple[str, ...], verdicts: list[str]) -> CalibrationResult:
    """A result without values, that says why."""
    p = len(names)
    return CalibrationResult(
        "thermal", names, np.zeros(p), np.diag(np.full(p, np.inf)), "full", status="refused", verdicts=tuple(verdicts),
    )  # fmt: skip
