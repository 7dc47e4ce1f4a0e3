"""Single samples far from their neighbours, put back to where noise alone would have left them."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.exceptions import InputError

_WINDOW = 65  # samples whose median is the level; short against any drift worth modelling
_LIMIT = 4.5  # robust sigmas: one good sample in 150 000 is taken for an outlier
_LOWEST = 3.0  # limit where there are so many outliers that few of the samples beyond are good ones
_MANY = 1e-3  # share of outliers from which on the limit is lowered
_GOOD = 0.1  # share of good samples among those replaced that is put up with below the usual limit


def without_outliers(x: ArrayLike, seed: int = 0) -> tuple[FloatArray, BoolArray]:
    """Signal with its outliers replaced by the local level plus noise of the local spread.

    Parameters
    ----------
    x : array_like, shape (n,)
        Missing samples (NaN) stay missing.
    seed : int
        Seed of the noise put in.

    Returns
    -------
    repaired : ndarray, shape (n,)
    outlier : ndarray of bool, shape (n,)
        Which samples were replaced.

    Raises
    ------
    InputError
        If x is not one signal.

    Notes
    -----
    Leaving the samples out instead would leave hardly a long cluster complete; putting in the bare level would take
    white noise away. The spread is the median absolute deviation from the local median over the whole signal, which up
    to half of the samples cannot move much; it is taken again from what is left.

    The limit is 4.5 spreads, or where there are many outliers down to 3: the least beyond which no more than a tenth of
    the samples are what noise alone has there (a false discovery rate). So a clean log loses nothing, and 5 % outliers
    of five sigma, a third of which are below 4.5, are found.

    What is put in repeats the level's own error and so adds to the noise of means longer than the level's window, by
    twice the share of samples replaced. The window is therefore that of the first minimum of the Allan variance: drift
    outweighs beyond it the noise that this raises.
    """
    return repaired_signals(x, (0.0,), seed)[0]


def repaired_signals(x: ArrayLike, offsets: tuple[float, ...], seed: int = 0) -> list[tuple[FloatArray, BoolArray]]:
    """Signal without its outliers for several limits, to see how what follows moves with them.

    Parameters
    ----------
    x, seed
        As for :func:`without_outliers`.
    offsets : tuple of float
        Added to the limit that :func:`without_outliers` takes. [spread]

    Returns
    -------
    list of (ndarray, ndarray of bool)
        Repaired signal and which samples were replaced, for each offset.
    """
    from scipy.ndimage import median_filter

    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1:
        raise InputError(f"x: expected one signal, got shape {x.shape}")
    present = np.isfinite(x)
    none = np.zeros(len(x), dtype=bool)
    if not present.any():
        return [(x.copy(), none)] * len(offsets)
    # mirrored ends: an outlier that is the last sample is not repeated
    median = median_filter(np.where(present, x, np.median(x[present])), size=_WINDOW, mode="mirror")
    size = np.where(present, np.abs(x - median), 0.0)
    return [_repaired(x, present, size, offset, seed) for offset in offsets]


def _repaired(
    x: FloatArray, present: BoolArray, size: FloatArray, offset: float, seed: int
) -> tuple[FloatArray, BoolArray]:
    outlier = np.zeros(len(x), dtype=bool)
    spread, limit = 0.0, _LIMIT
    for _ in range(3):
        spread = 1.4826 * float(np.median(size[present & ~outlier]))
        if spread == 0.0:
            return x.copy(), np.zeros(len(x), dtype=bool)
        limit = _limit(size[present], spread) + offset
        outlier = size > limit * spread
    repaired = x.copy()
    noise = _noise(int(outlier.sum()), int(present.sum()), limit, np.random.default_rng(seed))
    repaired[outlier] = _level(x, present & ~outlier)[outlier] + spread * noise
    return repaired, outlier


def _limit(size: FloatArray, spread: float) -> float:
    """From how many spreads on a sample is an outlier."""
    from scipy.stats import norm

    limits = np.arange(_LOWEST, _LIMIT, 0.1)
    beyond = np.array([np.count_nonzero(size > limit * spread) for limit in limits])
    few_good = (2.0 * norm.sf(limits) * len(size) < _GOOD * beyond) & (beyond > _MANY * len(size))
    return float(limits[np.argmax(few_good)]) if few_good.any() else _LIMIT


def _noise(count: int, samples: int, limit: float, rng: np.random.Generator) -> FloatArray:
    """Normal noise for the samples replaced, with the tails beyond the limit that the good ones among them had."""
    from scipy.stats import norm

    noise: FloatArray = rng.standard_normal(count)
    beyond = float(norm.sf(limit))
    tails = rng.permutation(count)[: round(2.0 * beyond * samples)]
    noise[tails] = rng.choice([-1.0, 1.0], len(tails)) * norm.isf(beyond * rng.random(len(tails)))
    return noise


def _level(x: FloatArray, good: BoolArray) -> FloatArray:
    """Running mean of the good samples over the averaging time where their Allan variance is least first."""
    mean = float(x[good].mean())
    total = np.concatenate(([0.0], np.cumsum(np.where(good, x - mean, 0.0))))
    count = np.concatenate(([0], np.cumsum(good)))
    window, least = _WINDOW, np.inf
    for m in _WINDOW * 2 ** np.arange(max(1, int(np.log2(max(len(x) / (8 * _WINDOW), 1.0))) + 1)):
        edges = np.arange(0, len(x) + 1, m)
        number = np.diff(count[edges])
        full = number > 0.5 * m
        means = np.where(full, np.diff(total[edges]) / np.maximum(number, 1), np.nan)
        change = np.diff(means)
        change = change[np.isfinite(change)]
        variance = 0.5 * float(np.mean(change**2)) if len(change) else np.inf
        if variance >= least:
            break  # beyond a Gauss-Markov process the curve falls once more
        window, least = int(m), variance
    first = np.maximum(np.arange(len(x)) - window // 2, 0)
    last = np.minimum(first + window, len(x))
    first = np.maximum(last - window, 0)
    number = count[last] - count[first]
    return np.asarray(mean + (total[last] - total[first]) / np.maximum(number, 1))
