"""Temperature ramp: one pose at rest while the temperature goes up and down."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.result.result import Residuals
from schuler.calibration.thermal import log as thermal_log
from schuler.calibration.thermal import noise as thermal_noise
from schuler.calibration.thermal import table as thermal_table
from schuler.calibration.thermal.log import Branch
from schuler.calibration.thermal.noise import Noise

#: Columns a difference between heating and cooling is described with: constant, linear, quadratic in temperature.
_GAP_COLUMNS = 3
#: Overlap of heating and cooling below which only a constant difference is looked for. [K]
_OVERLAP = 10.0
#: A better degree by BIC is mentioned from this difference on ("very strong" in the literature).
_STRONG = 10.0
HIGHEST_DEGREE = 6
#: The noise is not known but estimated: simulated logs without hysteresis exceed this in 0.5 to 3 % of the axes.
FALSE_ALARM = 1e-3


@dataclass(frozen=True, eq=False)
class Curve:
    """One axis against temperature.

    Attributes
    ----------
    x : ndarray, shape (degree + 1,)
        Coefficients of powers of ``T - T0``. [x/K^k]
    covariance : ndarray
    degree : int
    criterion : dict of str to float
        BIC by degree, relative to the best.
    hysteresis : dict
        Plain numbers, see :func:`schuler.calibration.thermal.calibrate.calibrate_thermal`.
    table : dict
    noise : dict
    residual : ndarray, shape (J,)
        Block means less the polynomial. [x]
    freedom : int
    """

    x: FloatArray
    covariance: FloatArray
    degree: int
    criterion: dict[str, float]
    hysteresis: dict[str, Any]
    table: dict[str, Any]
    noise: Noise
    residual: FloatArray
    freedom: int


def powers(T: FloatArray, T0: float, columns: int) -> FloatArray:
    """Powers 0, 1, ... of ``T - T0``, shape (n, columns)."""
    return np.asarray((T - T0)[..., None] ** np.arange(columns))


def curves(
    Y: FloatArray,
    T: FloatArray,
    ways: list[Branch],
    edges: IntArray,
    T0: float,
    degree: int | Literal["auto"],
    at: FloatArray,
    relative: list[bool],
    sigma: FloatArray | None = None,
) -> list[Curve]:
    """Fit every axis of a log.

    Parameters
    ----------
    Y : ndarray, shape (n, k)
        Samples of k axes.
    T : ndarray, shape (n,)
        [degC]
    ways : list of Branch
    edges : ndarray of int, shape (J,)
        First samples of the blocks.
    T0 : float
        Reference temperature. [degC]
    degree : int or "auto"
    at : ndarray
        Knots of the table. [degC]
    relative : list of bool
        Axes of which only the change from T0 counts.
    sigma : ndarray, shape (k,), optional
        White noise of a sample of each axis; None: noise is found out.

    Returns
    -------
    list of Curve
    """
    s = thermal_log.directions(len(T), ways)
    y = thermal_log.means(Y, edges)
    J = len(edges)
    highest = int(min(HIGHEST_DEGREE, max(1, J // 8)))
    highest = max(highest, degree if degree != "auto" else 0)
    span = float(np.ptp(T))
    # powers of T - T0 in units of the range: raw ones lose digits
    P = powers((T - T0) / span, 0.0, highest + 1)
    common = overlap(ways)
    columns = 0 if common is None else _GAP_COLUMNS if common[1] - common[0] >= _OVERLAP else 1
    G = 0.5 * s[:, None] * P[:, :columns]
    # means of powers, not powers of means: exact for a polynomial sensor whatever the blocks
    P, G = thermal_log.means(P, edges), thermal_log.means(G, edges)
    hats = thermal_table.hats(T, at)
    up, down = (thermal_log.means(hats * (s == way)[:, None], edges) for way in (1.0, -1.0))
    at_T0 = thermal_table.hats(np.array([T0]), at)[0]
    units = span ** np.arange(highest + 1)
    out = []
    if sigma is None:
        noises = thermal_noise.noise_of(y, np.concatenate((P[:, : highest + 1], G), axis=1))
    else:
        noises = thermal_noise.white(y, sigma / np.sqrt(len(T) / J))
    for i, noise in enumerate(noises):
        chosen, criterion = _degree(y[:, i], P, G, noise, degree)
        smaller = thermal_noise.fit(y[:, i], P[:, : chosen + 1], noise)
        gap = _gap(y[:, i], P[:, : chosen + 1], G, noise, common, T0, span)
        full = gap["fit"] if gap["found"] else smaller
        p = chosen + 1
        C = full.covariance[:p, :p] / np.outer(units[:p], units[:p])
        x = full.x[:p] / units[:p]
        gap.pop("fit")
        left = y[:, i] - P[:, :p] @ full.x[:p]
        again = _repeatability(left, thermal_log.means(T, edges), ways, edges, noise)
        gap["repeatability"] = again
        table = thermal_table.table(y[:, i], up, down, noise, at_T0 if relative[i] else np.zeros(len(at)))
        freedom = J - p - (columns if gap["found"] else 0)
        out.append(Curve(x, C, chosen, criterion, gap, table, noise, left, freedom))
    return out


def _degree(
    y: FloatArray, P: FloatArray, G: FloatArray, noise: Noise, degree: int | Literal["auto"]
) -> tuple[int, dict[str, float]]:
    """Degree to use, and BIC of each degree tried less the least; hysteresis is allowed for in all of them."""
    values = {
        d: thermal_noise.bic(thermal_noise.fit(y, np.concatenate((P[:, : d + 1], G), axis=1), noise), noise, d + 1)
        for d in range(P.shape[1])
    }
    least = min(values.values())
    best = min(d for d, v in values.items() if v <= least + 1e-6)
    return (best if degree == "auto" else degree), {str(d): round(v - least, 3) for d, v in values.items()}


def _gap(
    y: FloatArray,
    P: FloatArray,
    G: FloatArray,
    noise: Noise,
    common: tuple[float, float] | None,
    T0: float,
    span: float,
) -> dict[str, Any]:
    """Difference between heating and cooling of one axis: test, largest value, its uncertainty and temperature."""
    without = thermal_noise.fit(y, P, noise)
    if common is None or G.shape[1] == 0:
        return {
            "checked": False, "found": False, "p_value": None, "largest": None, "sigma": None, "temperature": None,
            "coefficients": [], "fit": without,
        }  # fmt: skip
    within = thermal_noise.fit(y, np.concatenate((P, G), axis=1), noise)
    p, m = P.shape[1], G.shape[1]
    p_value = thermal_noise.better(without, within, noise, m)
    T = np.linspace(*common, 201)
    B = powers((T - T0) / span, 0.0, m)
    d, C = B @ within.x[p:], within.covariance[p:, p:]
    k = int(np.argmax(np.abs(d)))
    return {
        "checked": True,
        "found": bool(p_value < FALSE_ALARM),
        "p_value": p_value,
        "largest": float(d[k]),
        "sigma": float(np.sqrt(B[k] @ C @ B[k])),
        "temperature": float(T[k]),
        "coefficients": [float(c) for c in within.x[p:] / span ** np.arange(m)],
        "fit": within,
    }


def _repeatability(
    left: FloatArray, T: FloatArray, ways: list[Branch], edges: IntArray, noise: Noise
) -> dict[str, Any] | None:
    """Largest mean difference between two branches of one direction at the temperatures that both pass."""
    solution = []
    rough = float(np.std(np.diff(left))) / np.sqrt(2.0)
    for i, a in enumerate(ways):
        for b in ways[i + 1 :]:
            low = max(min(a.start, a.stop), min(b.start, b.stop))
            high = min(max(a.start, a.stop), max(b.start, b.stop))
            if a.direction != b.direction or high - low < 0.5 * _OVERLAP:
                continue
            first, second = ((edges >= w.first) & (edges < w.last) & (low <= T) & (high >= T) for w in (a, b))
            if first.sum() < 2 or second.sum() < 2:
                continue
            weights = second / second.sum() - first / first.sum()
            value = float(weights @ left)
            clear = bool(abs(value) > 5.0 * rough * np.linalg.norm(weights))
            sigma = float(noise.sigma * np.linalg.norm(weights @ noise.L))
            solution.append((value, sigma, a.direction, clear))
    if not solution:
        return None
    value, sigma, way, clear = max(solution, key=lambda v: abs(v[0]))
    direction = "heating" if way > 0 else "cooling"
    return {"difference": value, "sigma": sigma, "direction": direction, "beyond_white_noise": clear}


def overlap(ways: list[Branch]) -> tuple[float, float] | None:
    """Lowest and highest temperature that were passed both heating and cooling; None if there are none."""
    low, high = np.inf, -np.inf
    for a in ways:
        for b in ways:
            if a.direction > 0 > b.direction:
                bottom = max(min(a.start, a.stop), min(b.start, b.stop))
                top = min(max(a.start, a.stop), max(b.start, b.stop))
                if top > bottom:
                    low, high = min(low, bottom), max(high, top)
    return (low, high) if high > low else None


def strongly_better(curve: Curve) -> int | None:
    """A higher degree that BIC prefers very strongly, or None."""
    best = min(curve.criterion, key=lambda d: (curve.criterion[d], int(d)))
    used = curve.criterion.get(str(curve.degree), 0.0)
    return int(best) if int(best) > curve.degree and used > _STRONG else None


def residuals(
    solution: list[Curve], y: FloatArray, T: FloatArray, ways: list[Branch], edges: IntArray, at: FloatArray, unit: str
) -> Residuals:
    """What a correction with the polynomials leaves, by axis, branch and piece of the table.

    Parameters
    ----------
    found : list of Curve
        Three axes.
    y : ndarray, shape (J, 3)
        Block means. [unit]
    T : ndarray, shape (J,)
        Block means. [degC]
    ways, edges, at
        As for :func:`curves`.
    unit : str
    """
    label, value, sigma, before = [], [], [], []
    for i, (axis, curve) in enumerate(zip("xyz", solution, strict=True)):
        level = float(np.mean(y[:, i]))
        for way in ways:
            for low, high in pairwise(at):
                here = (edges >= way.first) & (edges < way.last) & (low <= T) & (high > T)
                if here.sum() < 2:
                    continue
                L = here / here.sum()
                label.append(f"{axis}, {'heating' if way.direction > 0 else 'cooling'} {low:.0f}..{high:.0f} degC")
                value.append(float(L @ curve.residual))
                sigma.append(float(curve.noise.sigma * np.linalg.norm(L @ curve.noise.L)))
                before.append(float(L @ y[:, i]) - level)
    return Residuals(tuple(label), np.array(value), np.array(sigma), unit, np.array(before))
