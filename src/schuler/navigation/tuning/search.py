"""Largest likelihood over factors on noise terms, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.likelihood import Residuals
from schuler.navigation.tuning.noise import WHITE, with_factors

_PRIOR = np.log(10.0)  # 1-sigma of ln(factor) before anything is measured: a decade
_STEP = 0.1  # of ln(factor), for differences
_LARGEST = 9.0  # of |ln(factor)|
_GAIN = 0.5  # log likelihood that a further step has to win
_STRIDE = 2.5  # longest step of ln(factor)
_STARTS = (0.0, 1.2, 2.4, 3.6, -1.2)  # ln(factor) of the IMU's white noise that the search may begin with
LEAST_GAIN = 8.0  # of log likelihood for other noise or further states: chi-square of 16
_SURE = 2.0  # standard errors by which held-back fixes have to be likelier
_BLOCK_S = 30.0  # stretches of the log whose gradients are taken as independent: twice the longest horizon


@dataclass(frozen=True)
class Fit:
    """Factors of largest likelihood.

    Attributes
    ----------
    factors : dict of str to float
        By term.
    spread : dict of str to float
        1-sigma of ln(factor).
    loss, loss_before : float
        Negative log likelihood there and with all factors 1.
    residuals : Residuals
        Innovations there.
    """

    factors: dict[str, float]
    spread: dict[str, float]
    loss: float
    loss_before: float
    residuals: Residuals


def fit(
    prepared: PreparedRun,
    residuals: Callable[[PreparedRun], Residuals],
    terms: tuple[str, ...],
    *,
    start: Mapping[str, float] | None = None,
    floors: Mapping[str, float] | None = None,
    iterations: int = 12,
) -> Fit:
    """Minimise the negative log likelihood of innovations over factors on noise.

    Parameters
    ----------
    prepared : PreparedRun
    residuals : callable
        Innovations of a run, see :func:`~schuler.navigation.tuning.likelihood.residuals_of`.
    terms : tuple of str
    start : mapping, optional
        Factors to begin with; default: 1, or the best of a few on the IMU's white noise.
    floors : mapping, optional
        Smallest factors.
    iterations : int
        At most.

    Notes
    -----
    Fisher scoring with numerical derivatives of innovations and variances, damped (Levenberg, Marquardt): the expected
    curvature of a normal density of mean m and variance s is ``m' m' / s + (s' / s)^2 / 2``. What the log does not show
    stays where it was: ln(factor) has a normal prior of one decade. The spread is that of a composite likelihood, the
    inverse curvature around the scatter of the gradient over stretches of the log (White (1982), Econometrica 50(1)),
    and at least the inverse curvature.
    """
    n = len(terms)
    low = np.array([max(-_LARGEST, np.log((floors or {}).get(name, 1e-9))) for name in terms])

    def at(x: FloatArray) -> Residuals:
        return residuals(with_factors(prepared, dict(zip(terms, np.exp(x), strict=True))))

    def loss(x: FloatArray, r: Residuals) -> float:
        value = float(r.scores().sum() + 0.5 * np.sum((x / _PRIOR) ** 2))
        return value if np.isfinite(value) else np.inf

    x = np.zeros(n)
    r = at(x)
    best = before = loss(x, r)
    white = np.isin(terms, list(WHITE))
    for shift in _STARTS[1:] if start is None else ():
        other = np.maximum(np.where(white, shift, 0.0), low)
        q = at(other)
        value = loss(other, q)
        if value < best:
            x, r, best = other, q, value
        elif shift > 0.0 and value > best + 20.0:
            break
    if start is not None:
        other = np.maximum(np.array([np.log(start.get(name, 1.0)) for name in terms]), low)
        q = at(other)
        value = loss(other, q)
        if value < best:
            x, r, best = other, q, value
    damping, gradients, curvature = 1e-2, np.zeros((n, len(r.t))), np.eye(n) / _PRIOR**2
    for _ in range(iterations):
        gradients, curvature = _derivatives(x, r, at)
        gradient = gradients.sum(axis=1) + x / _PRIOR**2
        curvature = curvature + np.eye(n) / _PRIOR**2
        gained = 0.0
        for _ in range(5):
            step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
            step *= min(1.0, _STRIDE / max(float(np.abs(step).max()), 1e-12))
            other = np.clip(x + step, low, _LARGEST)
            q = at(other)
            value = loss(other, q)
            if value < best:
                gained = best - value
                x, r, best = other, q, value
                damping = max(0.2 * damping, 1e-3)
                break
            damping *= 5.0
        if gained < _GAIN:
            break
    spread = _spread(gradients, curvature, r)
    return Fit(
        dict(zip(terms, np.exp(x).tolist(), strict=True)),
        dict(zip(terms, spread.tolist(), strict=True)),
        best,
        before,
        r,
    )


def _derivatives(x: FloatArray, r: Residuals, at: Callable[[FloatArray], Residuals]) -> tuple[FloatArray, FloatArray]:
    """Gradient of each judging fix, shape (n, k), and expected curvature, shape (n, n)."""
    z, sigma, share = r.normalised, np.sqrt(r.variance), r.influence()
    dz, dlog = [], []
    for i in range(len(x)):
        moved = x.copy()
        moved[i] += _STEP
        q = at(moved)
        dz.append((q.innovation - r.innovation) / _STEP / sigma)
        dlog.append(0.5 * np.log(q.variance / r.variance) / _STEP)
    m, s = np.array(dz), np.array(dlog)
    gradients = np.sum(r.weight * (share * z * m + (1.0 - share * z**2) * s), axis=2)
    curvature = np.einsum("ikc,jkc->ij", r.weight * np.minimum(share, 1.0) * m, m)
    curvature += 2.0 * np.einsum("ikc,jkc->ij", r.weight * s, s)
    return gradients, curvature


def _spread(gradients: FloatArray, curvature: FloatArray, r: Residuals) -> FloatArray:
    """1-sigma of ln(factor)."""
    inverse = np.linalg.inv(curvature)
    scatter = block_scatter(gradients, r.t)
    sandwich = np.diag(inverse @ scatter @ inverse)
    few = 1.0 + 1.2 / (block_count(r.t) - 1)  # of Student's distribution over the normal one, at 95 %
    spread: FloatArray = few * np.sqrt(np.maximum(sandwich, np.diag(inverse)))
    return spread


def block_count(t: FloatArray) -> int:
    """Number of stretches that a log is cut into."""
    return int(np.clip(np.ptp(t) / _BLOCK_S, 4, 30))


def block_sums(values: FloatArray, t: FloatArray) -> FloatArray:
    """Sums over the stretches of a log, shape (n, blocks) of values of shape (n, k)."""
    span = float(np.ptp(t))
    count = block_count(t)
    block = np.minimum((count * (t - t.min()) / max(span, 1e-9)).astype(np.int64), count - 1)
    return np.stack([np.bincount(block, row, minlength=count) for row in values])


def block_scatter(values: FloatArray, t: FloatArray) -> FloatArray:
    """Covariance of sums over a log from the sums over its stretches, shape (n, n) of values of shape (n, k)."""
    sums = block_sums(values, t)
    count = sums.shape[1]
    sums = sums - sums.mean(axis=1, keepdims=True)
    scatter: FloatArray = sums @ sums.T * count / (count - 1)
    return scatter


def gain_of(before: Residuals, after: Residuals) -> tuple[float, float]:
    """Log likelihood won, and its 1-sigma from the scatter over stretches of the log."""
    won = before.scores() - after.scores()
    return float(won.sum()), float(np.sqrt(block_scatter(won[None, :], before.t)[0, 0]))


def proven(before: Residuals, after: Residuals) -> bool:
    """Whether fixes are likelier by 8 and two standard errors: of the sum over all stretches of the log, or of votes.

    A log likelihood won mostly in one stretch has a standard error as large as itself, though all stretches win: each
    has a vote too, whole where it wins or loses 8.
    """
    won = block_sums((before.scores() - after.scores())[None, :], before.t)[0]
    votes = np.clip(won / LEAST_GAIN, -1.0, 1.0)
    n = len(won)
    sure = any(x.sum() > _SURE * np.sqrt(n) * x.std(ddof=1) for x in (won, votes))
    return bool(won.sum() > LEAST_GAIN and sure)
