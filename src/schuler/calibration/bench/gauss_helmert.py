"""Adjustment of a triad from magnitudes: least squares with the condition ``|v(Y + e; b, s, theta)| = rho``.

Observations and parameters cannot be separated in this condition, so it is a Gauss-Helmert model: the smallest weighted
corrections e are sought that make every attitude fulfil its condition exactly. Parameters are in the order
:data:`schuler.calibration.bench.sensor_geometry.PARAMETERS`. One unit x stands for m/s^2 or rad/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.calibration.bench.adjustment import Adjustment
from schuler.calibration.bench.magnitude import condition_of, ellipsoid_start, possible, sphere_start
from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.exceptions import InputError

Order: TypeAlias = Literal[3, 6, 9]
Start: TypeAlias = Literal["continuation", "ellipsoid", "zeros"]

#: Combinations of parameters known no better than this (bias over rho, scale factor, rad) count as not determined: the
#: linearised condition does not hold over such a range.
LARGEST_SIGMA = 0.3
#: And those known this many times worse than the best one: biases and scale factors of a thousandth tilt the poses by
#: as much, so it would be the errors, not the poses, that tell such parameters apart.
WEAKEST = 1e3
#: Singular values of the scaled design below this share of the largest one are rounding.
RANK_TOLERANCE = 1e-8
#: Columns shorter than this share of the longest are not scaled up to unit length.
SHORTEST_COLUMN = 1e-2
#: Largest change of s and theta in one iteration.
STEP_LIMIT = 0.3


def adjust(
    Y: ArrayLike,
    sigma: ArrayLike,
    rho: ArrayLike,
    order: Order = 9,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    fixed: Mapping[str, float] | None = None,
    start: Start | ArrayLike = "continuation",
    max_iterations: int = 100,
    tolerance: float = 1e-8,
    step_limit: float | None = STEP_LIMIT,
    largest_sigma: float = LARGEST_SIGMA,
    pope: bool = True,
) -> Adjustment:
    """Bias, scale factors and non-orthogonality of one triad from readings whose true magnitude is known.

    Parameters
    ----------
    Y : array_like, shape (n, 3)
        Mean reading in each attitude. [x]
    sigma : array_like, shape (), (3,) or (n, 3)
        1-sigma uncertainty of the means: ``N / sqrt(duration)`` for white noise. [x]
    rho : array_like, shape () or (n,)
        Magnitude of the reference: gravity, Earth rate, table rate. [x]
    order : {3, 6, 9}
        Estimate the biases; scale factors too; angles too. What is not estimated is zero, unless ``fixed``.
    prior : mapping of str to (value, sigma), optional
        What is known of estimated parameters before.
    fixed : mapping of str to float, optional
        Parameters that are held: with the angles of an earlier calibration, order 6 needs six attitudes only.
    start : {"continuation", "ellipsoid", "zeros"} or array_like, shape (9,)
        Continuation solves for 3, 6, 9 parameters in turn, the first from the centre of the sphere that fits best,
        which is a linear problem. The ellipsoid that fits best gives all nine at once; it needs nine attitudes and one
        rho. Zeros fail where the bias is about as large as rho.
    max_iterations : int
    tolerance : float
        Ends when no parameter moves by more than this part of its (uncorrelated) uncertainty.
    step_limit : float or None
        Largest change of a scale factor or angle in an iteration.
    largest_sigma : float
        Combinations of bias over rho, scale factors and angles more uncertain than this are left as they started and
        reported as undetermined, and so are those :data:`WEAKEST` times worse than the best one if there is no prior.
        Infinite: only those that change nothing.
    pope : bool
        False leaves out the term ``B (Y_obs - Y_i)`` and evaluates at the readings instead of the adjusted readings,
        the textbook mistake Pope (1972) warns of; for comparison.

    Returns
    -------
    Adjustment
        It may not have converged, and parameters may be undetermined: look at ``converged`` and ``undetermined``.

    Raises
    ------
    InputError
        If shapes disagree, a sigma or rho is not positive, a name is unknown.

    Notes
    -----
    Everything is divided by the median of rho inside, and the columns of A are scaled to unit length, because bias in
    rad/s and scale factors differ by 1e5. The step solves the scaled system by singular values, without the null space.
    A column that is short because no pose shows its parameter stays short: scaled up, it would be told apart from
    others by noise alone.

    References
    ----------
    Hayal (2010), section 3.4, eqs. (3.26) to (3.57), with ``e = Y - Y_obs`` throughout (his (3.25) has the other sign)
    and the prior term iterated; Pope (1972); Schaffrin and Snow (2009).
    """
    Y = as_floats(Y, "Y", (None, 3))
    n = len(Y)
    if n == 0:
        raise InputError("Y: expected one attitude or more, got none")
    if order not in (3, 6, 9):
        raise InputError(f"order: expected 3, 6 or 9, got {order!r}")
    variance = np.broadcast_to(_positive(sigma, "sigma", ((), (3,), (n, 3))), (n, 3)) ** 2
    rho = np.broadcast_to(_positive(rho, "rho", ((), (n,))), (n,))
    fixed, prior = dict(fixed or {}), dict(prior or {})
    _check_names(fixed, prior)
    L = float(np.median(rho))
    unit = np.array([L] * 3 + [1.0] * 6)
    free = np.array([i < order and name not in fixed for i, name in enumerate(PARAMETERS)])
    if not free.any():
        raise InputError(f"fixed: expected some of the {order} parameters to be left to estimate, got {fixed}")
    x = np.array([fixed.get(name, 0.0) for name in PARAMETERS]) / unit
    problem = _Problem(
        Y / L,
        variance / L**2,
        rho / L,
        _scaled_priors(prior, unit),
        max_iterations,
        tolerance,
        step_limit,
        largest_sigma,
        pope,
    )
    stages = [free]
    if isinstance(start, str):
        if start == "continuation":
            if free[:3].all():
                x[:3] = sphere_start(problem.Y, problem.rho, x[3:6], x[6:])
            stages = [free & (np.arange(9) < m) for m in (3, 6, 9) if m <= order]
        elif start == "ellipsoid":
            guess = ellipsoid_start(problem.Y, problem.rho)
            x = np.where(free, guess, x)
        elif start != "zeros":
            raise InputError(f"start: expected 'continuation', 'ellipsoid', 'zeros' or nine values, got {start!r}")
    else:
        x = np.where(free, as_floats(start, "start", (9,)) / unit, x)
    history: list[FloatArray] = []
    for i, stage in enumerate(stages):
        if stage.any() and not (i and (stage == stages[i - 1]).all()):
            solution = _iterate(problem, x, stage, history)
            if solution.converged:
                x = solution.x  # where the next stage begins
    return _adjustment(problem, solution, free, unit, history)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Everything over the median reference; ``known``: prior values and their sigma, infinite where there is none."""

    Y: FloatArray
    variance: FloatArray
    rho: FloatArray
    priors: tuple[FloatArray, FloatArray]
    max_iterations: int
    tolerance: float
    step_limit: float | None
    largest_sigma: float
    pope: bool


@dataclass(frozen=True, eq=False)
class _Solution:
    x: FloatArray
    e: FloatArray
    free: BoolArray
    converged: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class _Linear:
    """The linearised problem with unit weights: ``A dx + w = r``, prior rows below; columns scaled by 1/D."""

    A: FloatArray
    w: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    U: FloatArray
    S: FloatArray
    Vt: FloatArray
    rank: int


def _linearise(p: _Problem, x: FloatArray, e: FloatArray, free: BoolArray) -> _Linear:
    at = p.Y + e if p.pope else p.Y
    f, A, B = condition_of(at, p.rho, x)
    C = _weights(B, p.variance)
    w = f - np.sum(B * e, axis=1) if p.pope else f
    priors = np.flatnonzero(free & np.isfinite(p.priors[1]))
    rows = np.zeros((len(priors), 9))
    rows[np.arange(len(priors)), priors] = 1.0 / p.priors[1][priors]
    data = A[:, free] / np.sqrt(C)[:, None]
    design = np.vstack((data, rows[:, free]))
    D = np.linalg.norm(design, axis=0)
    D = np.maximum(D, SHORTEST_COLUMN * D.max() or 1.0)
    U, S, Vt = np.linalg.svd(design / D, full_matrices=True)
    with np.errstate(divide="ignore"):
        uncertain = np.linalg.norm(Vt[: len(S)] / D, axis=1) / S
    # singular values fall, so the uncertain directions are the last ones but for scaling
    limit = p.largest_sigma
    if not len(priors) and np.isfinite(limit):
        limit = min(limit, WEAKEST * float(uncertain.min()))
    keep = (S[0] * RANK_TOLERANCE < S) & (uncertain <= limit)
    place = np.concatenate((np.flatnonzero(keep), np.flatnonzero(~keep), np.arange(len(S), len(Vt))))
    Vt, rank = Vt[place], int(keep.sum())
    U, S = np.hstack((U[:, place[: len(S)]], U[:, len(S) :])), S[place[: len(S)]]
    misfit = np.concatenate((w / np.sqrt(C), (x[priors] - p.priors[0][priors]) / p.priors[1][priors]))
    return _Linear(design, misfit, B, C, D, U, S, Vt, rank)


def _iterate(p: _Problem, x: FloatArray, free: BoolArray, history: list[FloatArray]) -> _Solution:
    """Newton-Gauss from ``x``; stops where the triad becomes impossible."""
    n, e, start = len(p.Y), np.zeros_like(p.Y), x
    for i in range(p.max_iterations):
        q = _linearise(p, x, e, free)
        r = q.rank
        step = np.zeros(9)
        step[free] = -(q.Vt[:r].T @ ((q.U[:, :r].T @ q.w) / q.S[:r])) / q.D
        if p.step_limit is not None and (largest := float(np.abs(step[3:]).max())) > p.step_limit:
            step *= p.step_limit / largest
        correction = -p.variance * q.B * ((q.w[:n] + q.A[:n] @ step[free]) / np.sqrt(q.C))[:, None]
        x = x + step
        history.append(x)
        if not possible(x):
            return _Solution(start, np.zeros_like(e), free, False, i + 1)
        moved = (np.abs(step[free]) * q.D).max()
        wandered = (np.abs(correction - e) / np.sqrt(p.variance)).max()
        e = correction
        # the second pair: nothing but rounding is left, however small sigma
        if (moved < p.tolerance and wandered < 1e-6) or (np.abs(step).max() < 1e-15 and np.abs(e).max() < 1e-13):
            return _Solution(x, e, free, True, i + 1)
    return _Solution(x, e, free, False, p.max_iterations)


def _adjustment(
    p: _Problem, solution: _Solution, free: BoolArray, unit: FloatArray, history: list[FloatArray]
) -> Adjustment:
    """Cofactor, residuals and tests at the end of the iteration, in the units of the caller."""
    n, x, e = len(p.Y), solution.x, solution.e
    q = _linearise(p, x, e, free)
    r, L = q.rank, unit[0]
    Q = (q.Vt[:r].T / q.S[:r] ** 2) @ q.Vt[:r] / np.outer(q.D, q.D)
    null = q.Vt[r:].T / q.D[:, None]  # in natural units
    null /= np.linalg.norm(null, axis=0)
    lost = (np.abs(null) > 1e-2).any(axis=1)
    cofactor, normal, null_space = np.zeros((9, 9)), np.zeros((9, 9)), np.zeros((9, null.shape[1]))
    Q[lost, :] = Q[:, lost] = 0.0
    Q[lost, lost] = np.inf
    cofactor[np.ix_(free, free)] = Q
    normal[np.ix_(free, free)] = q.A.T @ q.A
    null_space[free] = null
    undetermined = np.zeros(9, dtype=bool)
    undetermined[free] = lost
    scale = np.outer(unit, unit)
    # part of each weighted misfit that the parameters take up: hat matrix of the weighted design
    redundancy = 1.0 - np.sum(q.U[:, :r] ** 2, axis=1)[:n]
    f, _, B = condition_of(p.Y, p.rho, x)
    v = np.sqrt(f + p.rho**2)
    C = _weights(B, p.variance)
    freedom = len(q.w) - r
    misfit = q.w[n:]  # of the prior
    total = float(np.sum(e * e / p.variance) + misfit @ misfit)
    cofactor *= scale
    return Adjustment(
        x * unit, free, undetermined, null_space, normal / scale, cofactor,
        float((q.S[0] / q.S[-1]) ** 2) if r == len(q.S) == q.Vt.shape[0] else float("inf"),
        e * L, (v - p.rho) * L, np.sqrt(C * np.clip(redundancy, 0.0, 1.0)) / (2.0 * p.rho) * L,
        np.clip(redundancy, 0.0, 1.0), total / freedom if freedom > 0 else float("nan"), freedom,
        solution.converged, solution.iterations, np.array(history) * unit,
    )  # fmt: skip


def _weights(B: FloatArray, variance: FloatArray) -> FloatArray:
    """Variance of each misclosure, not below that at a hundredth of rho: a reading may be equal to the bias."""
    return np.asarray(np.maximum(np.sum(B * B * variance, axis=1), 4e-4 * variance.min(axis=1)))


def _positive(value: ArrayLike, name: str, shapes: tuple[tuple[int, ...], ...]) -> FloatArray:
    x = as_floats(value, name)
    if x.shape not in shapes or (x <= 0.0).any():
        raise InputError(
            f"{name}: expected positive numbers of shape {' or '.join(map(str, shapes))}, got shape {x.shape}, "
            f"smallest {x.min() if x.size else 'none'}"
        )
    return x


def _check_names(fixed: Mapping[str, float], prior: Mapping[str, tuple[float, float]]) -> None:
    for name in (*fixed, *prior):
        if name not in PARAMETERS:
            raise InputError(f"fixed, prior: expected names out of {', '.join(PARAMETERS)}, got {name!r}")
    if both := set(fixed) & set(prior):
        raise InputError(f"fixed, prior: expected each name in one of them, got {', '.join(sorted(both))} in both")
    as_floats(list(fixed.values()), "fixed")
    for name, (value, sigma) in prior.items():
        if not (np.isfinite(value) and sigma > 0.0):
            raise InputError(f"prior: expected a number and a positive sigma for {name}, got {value!r}, {sigma!r}")


def _scaled_priors(prior: Mapping[str, tuple[float, float]], unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    values = np.array([prior[name][0] if name in prior else 0.0 for name in PARAMETERS])
    sigma = np.array([prior[name][1] if name in prior else np.inf for name in PARAMETERS])
    return values / unit, sigma / unit
