"""Least squares of many epochs at once: rows side by side, ranges iterated, range rates, a robust start."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.dop import design, inverse_normal
from schuler.gnss.ranges import Ranges, predicted_ranges, predicted_rates

_ITERATIONS = 25
_CONVERGED = 1e-4  # step after which the next is below rounding: convergence is quadratic [m]
FAR = 1e9  # no receiver is there [m]
_ROBUST_ITERATIONS = 25
_HUBER = 1.345


@dataclass(frozen=True)
class Padded:
    """Rows of k epochs side by side, m places each; unused places are masked and hold harmless numbers."""

    row: IntArray
    usable: BoolArray
    group: IntArray
    n_groups: int
    r_s: FloatArray
    v_s: FloatArray
    rho: FloatArray
    rate: FloatArray
    has_rate: BoolArray
    w: FloatArray
    w_rate: FloatArray

    @classmethod
    def of(
        cls, ranges: Ranges, rows: slice, epoch: IntArray, count: int, sigma: FloatArray, sigma_rate: FloatArray
    ) -> Padded:
        """Place the rows; those that are not to be used get a place too, for their residuals."""
        finite = np.asarray(np.isfinite(ranges.r_sat_e[rows]).all(axis=1))
        usable = np.asarray((ranges.reason[rows] == 0) & np.isfinite(ranges.pseudorange[rows]) & finite)
        has_rate = np.asarray(
            usable & np.isfinite(ranges.range_rate[rows]) & np.isfinite(ranges.v_sat_e[rows]).all(axis=1)
        )
        number = np.bincount(epoch, minlength=count)
        place = np.arange(len(epoch)) - np.repeat(np.cumsum(number) - number, number)
        shape = (count, max(int(number.max(initial=0)), 1))

        def put(values: FloatArray | IntArray | BoolArray, empty: float, good: BoolArray | None = None) -> np.ndarray:
            a = np.full((*shape, *values.shape[1:]), empty, dtype=values.dtype)
            keep = slice(None) if good is None else good
            a[epoch[keep], place[keep]] = values[keep]
            return a

        return cls(
            put(np.arange(len(epoch)), -1),
            put(usable, False),
            put(ranges.group[rows], 0),
            len(ranges.groups),
            put(ranges.r_sat_e[rows], 1.0, finite),
            put(ranges.v_sat_e[rows], 0.0, has_rate),
            put(ranges.pseudorange[rows], 0.0, usable),
            put(ranges.range_rate[rows], 0.0, has_rate),
            put(has_rate, False),
            put(1.0 / sigma, 0.0),
            put(1.0 / sigma_rate, 0.0),
        )

    def of_epochs(self, k: IntArray) -> Padded:
        """Some of the epochs."""
        return Padded(
            self.row[k], self.usable[k], self.group[k], self.n_groups, self.r_s[k], self.v_s[k], self.rho[k],
            self.rate[k], self.has_rate[k], self.w[k], self.w_rate[k],
        )  # fmt: skip


@dataclass
class Fit:
    """Least squares of some epochs: unknowns, normalised design and differences, cofactors of the unknowns."""

    x: FloatArray  # (k, 3): position, or velocity
    clocks: FloatArray  # (k, g)
    A: FloatArray
    y: FloatArray  # of zero clocks at x
    residual: FloatArray  # normalised
    cofactor: FloatArray
    solvable: BoolArray
    converged: BoolArray
    seen: BoolArray
    used: BoolArray

    @property
    def redundancy(self) -> IntArray:
        """Rows less unknowns. Shape (k,)."""
        return np.asarray(np.sum(self.used, axis=1) - 3 - np.sum(self.seen, axis=1), dtype=np.int64)

    @property
    def statistic(self) -> FloatArray:
        """Sum of squared normalised residuals. Shape (k,)."""
        return np.asarray(np.sum(self.residual**2, axis=1))

    def replace_at(self, k: IntArray, other: Fit) -> None:
        """Put the epochs of another fit in the places k."""
        for f in fields(self):
            getattr(self, f.name)[k] = getattr(other, f.name)

    def at(self, k: IntArray) -> Fit:
        """Some of the epochs."""
        return Fit(*(getattr(self, f.name)[k] for f in fields(self)))


def fit_ranges(p: Padded, used: BoolArray, start: FloatArray) -> Fit:
    """Gauss-Newton from ``start``; the clocks are linear and need none."""
    r = start.copy()
    converged = np.zeros(len(r), dtype=bool)
    active = np.arange(len(r))
    for _ in range(_ITERATIONS):
        step, solvable = _step(p.of_epochs(active), used[active], r[active])
        r[active] += step
        size = np.sqrt(np.sum(step * step, axis=1))
        converged[active] = solvable & (size < _CONVERGED)
        far = ~np.isfinite(r[active]).all(axis=1) | (np.abs(r[active]).max(axis=1) > FAR)
        r[active[far]] = 0.0
        active = active[~converged[active] & solvable & ~far]
        if len(active) == 0:
            break
    return linearised(p, used, r, converged)


def _normalised(
    p: Padded, used: BoolArray, r: FloatArray, weight: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    predicted, gradient = predicted_ranges(p.r_s, r[:, None, :])
    w = p.w if weight is None else p.w * weight
    A = design(gradient, p.group, p.n_groups, used) * w[..., None]
    return A, np.where(used, p.rho - predicted, 0.0) * w


def _step(p: Padded, used: BoolArray, r: FloatArray, weight: FloatArray | None = None) -> tuple[FloatArray, BoolArray]:
    A, y = _normalised(p, used, r, weight)
    cofactor, solvable, _ = inverse_normal(A, used, p.group, p.n_groups)
    return _unknowns(A, y, cofactor)[:, :3], solvable


def _unknowns(A: FloatArray, y: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Least-squares unknowns. The second round repairs what rounding lost if weights or clocks are of unequal size."""
    transposed = np.swapaxes(A, 1, 2)
    x = np.zeros((len(A), A.shape[2], 1))
    for _ in range(2):
        x += cofactor @ (transposed @ (y[..., None] - A @ x))
    return x[..., 0]


def linearised(p: Padded, used: BoolArray, r: FloatArray, converged: BoolArray) -> Fit:
    """The solution about r, which a last step leaves where it is."""
    A, y = _normalised(p, used, r)
    cofactor, solvable, seen = inverse_normal(A, used, p.group, p.n_groups)
    x = _unknowns(A, y, cofactor)
    residual = y - np.einsum("kmi,ki->km", A, x)
    return Fit(r + x[:, :3], x[:, 3:], A, y, residual, cofactor, solvable, converged & solvable, seen, used)


def fit_rates(p: Padded, used: BoolArray, r: FloatArray) -> Fit:
    """Velocity and drift, which are linear."""
    predicted, gradient = predicted_rates(p.r_s, p.v_s, r[:, None, :], np.zeros(3))
    one = np.zeros_like(p.group)
    A = design(gradient, one, 1, used) * p.w_rate[..., None]
    y = np.where(used, p.rate - predicted, 0.0) * p.w_rate
    cofactor, solvable, seen = inverse_normal(A, used, one, 1)
    x = _unknowns(A, y, cofactor)
    residual = y - np.einsum("kmi,ki->km", A, x)
    return Fit(x[:, :3], x[:, 3:], A, y, residual, cofactor, solvable, solvable, seen, used)


def robust_positions(p: Padded, used: BoolArray, start: FloatArray) -> FloatArray:
    """Positions by iterated least squares with Huber's weights: near the truth even with outliers of kilometres."""
    r = start.copy()
    weight = np.ones_like(p.w)
    for _ in range(_ROBUST_ITERATIONS):
        A, y = _normalised(p, used, r, weight)
        cofactor, _, _ = inverse_normal(A, used, p.group, p.n_groups)
        x = _unknowns(A, y, cofactor)
        size = np.abs(y - np.einsum("kmi,ki->km", A, x)) / np.maximum(weight, 1e-12)
        r += x[:, :3]
        weight = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(size, _HUBER)))
    return r
