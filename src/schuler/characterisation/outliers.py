"""Single samples far from their neighbours, put back to where noise alone would have left them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.characterisation.outlier_mixture import outlier_mixture
from schuler.exceptions import InputError

_WINDOW = 65  # samples whose median is the level; short against any drift worth modelling
_LIMIT = 4.5  # robust sigmas: one good sample in 150 000 is taken for an outlier
_NEAR = 3.5  # below it samples count for the level of the mixture: nearly all noise, of outliers hardly any
_FEWEST = 30  # outliers beyond the limit from which on those below are looked for, too
_CLEAR = 0.9  # probability from which on an outlier counts for how long they last


@dataclass(frozen=True)
class Repair:
    """A signal without its outliers.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Missing samples (NaN) stay missing.
    outlier : ndarray of bool, shape (n,)
        Which samples were replaced.
    sigma : float
        Relative 1-sigma uncertainty of the size of white noise in x, besides that of as many good samples.
    """

    x: FloatArray
    outlier: BoolArray
    sigma: float


def without_outliers(x: ArrayLike, seed: int = 0) -> Repair:
    """Signal with its outliers replaced by the local level plus noise of the local spread.

    Parameters
    ----------
    x : array_like, shape (n,)
        Missing samples (NaN) stay missing.
    seed : int
        Seed of the noise put in, and of the draw of outliers among doubtful samples.

    Returns
    -------
    Repair

    Raises
    ------
    InputError
        If x is not one signal.

    Notes
    -----
    Leaving the samples out instead would leave hardly a long cluster complete; putting in the bare level would take
    white noise away. Outliers are samples beyond 4.5 spreads (median absolute deviation) from the local median; a clean
    log loses one sample in 150 000.

    Thirty of them tell that there are others below. Then a mixture (:mod:`.outlier_mixture`) says how likely
    noise and outliers are at each distance, and clear outliers next to one another how long they last; from both each
    sample has a probability to be an outlier, of a chain of two states, and which ones are is drawn. What is left has
    the distribution of the noise, without the excess of outliers below a limit and without loss of tails beyond it. The
    uncertainty is that of the mixture over blocks of the log, and that of the noise put in.

    What is put in repeats the level's own error and so adds to the noise of means longer than the level's window, by
    twice the share of samples replaced. The window is therefore that of the first minimum of the Allan variance: drift
    outweighs beyond it the noise that this raises.

    References
    ----------
    Tanner and Wong (1987), J. Am. Stat. Assoc. 82(398), 528-540 (imputation by draws); Rabiner (1989), Proc. IEEE
    77(2), 257-286, section III (probabilities of a chain forwards; states drawn backwards).
    """
    from scipy.ndimage import median_filter

    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1:
        raise InputError(f"x: expected one signal, got shape {x.shape}")
    present = np.isfinite(x)
    outlier = np.zeros(len(x), dtype=bool)
    if not present.any():
        return Repair(x.copy(), outlier, 0.0)
    # mirrored ends: an outlier that is the last sample is not repeated
    median = median_filter(np.where(present, x, np.median(x[present])), size=_WINDOW, mode="mirror")
    deviation = np.where(present, x - median, 0.0)
    spread = 0.0
    for _ in range(3):
        spread = _spread(deviation[present & ~outlier])
        if spread == 0.0:
            return Repair(x.copy(), np.zeros(len(x), dtype=bool), 0.0)
        outlier = np.abs(deviation) > _LIMIT * spread
    rng = np.random.default_rng(seed)
    sigma = 0.0
    if np.count_nonzero(outlier) >= _FEWEST:
        outlier, spread, sigma = _drawn_outliers(x, present, deviation, spread, rng)
    repaired = x.copy()
    level, window = _level(x, present & ~outlier)
    noise = np.where(outlier, rng.standard_normal(len(x)), 0.0)
    if np.any(outlier):  # means over the window and longer have the level's error already
        noise -= _running_mean(noise, outlier, window)
    repaired[outlier] = (level + spread * noise)[outlier]
    return Repair(repaired, outlier, sigma)


def _spread(deviation: FloatArray) -> float:
    """Standard deviation of the normal distribution with this median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(deviation)))


def _drawn_outliers(
    x: FloatArray, present: BoolArray, deviation: FloatArray, spread: float, rng: np.random.Generator
) -> tuple[BoolArray, float, float]:
    """Outliers by their probabilities, standard deviation of the noise, and what is unknown of its logarithm."""
    from schuler.characterisation._kernels import draw_states

    # one-sided outliers shift a median, more where they are many: their excess over the limit does not shift a mean
    for _ in range(2):
        deviation = np.where(present, x - _level(x, present & (np.abs(deviation) < _NEAR * spread))[0], 0.0)
        spread = _spread(deviation[present])
    z = deviation[present] / spread
    if np.count_nonzero(np.abs(z) > _LIMIT) < _FEWEST:
        return present & (np.abs(deviation) > _LIMIT * spread), spread, 0.0
    mixture = outlier_mixture(z, _LIMIT)
    share = float(1.0 - mixture.share[0])
    good, bad = np.ones((2, len(x)))
    good[present], bad[present] = (density * len(z) for density in mixture.densities(z))
    clear = share * bad > _CLEAR * (share * bad + (1.0 - share) * good)
    clear &= present
    number = max(int(np.count_nonzero(clear)), 1)
    beside = int(np.count_nonzero(clear[1:] & clear[:-1])) / number
    lasting = float(np.clip(beside * share * len(z) / number, share, 0.99))
    outlier = np.zeros(len(x), dtype=bool)
    draw_states(good, bad, share, lasting, rng.random(len(x)), outlier)
    outlier &= present
    n = len(z)
    unknown = mixture.scatter**2 + (int(np.count_nonzero(outlier)) / n - 1.0) / (2.0 * n)
    return outlier, spread * float(mixture.sigma[0]), float(np.sqrt(max(unknown, 0.0)))


def _level(x: FloatArray, good: BoolArray) -> tuple[FloatArray, int]:
    """Running mean of the good samples over the averaging time where their Allan variance is least first, and that."""
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
    return _running_mean(x, good, window), window


def _running_mean(x: FloatArray, good: BoolArray, window: int) -> FloatArray:
    """Mean of the good samples in a window about each sample; the mean of all where it has none."""
    mean = float(x[good].mean())
    total = np.concatenate(([0.0], np.cumsum(np.where(good, x - mean, 0.0))))
    count = np.concatenate(([0], np.cumsum(good)))
    first = np.maximum(np.arange(len(x)) - window // 2, 0)
    last = np.minimum(first + window, len(x))
    first = np.maximum(last - window, 0)
    number = count[last] - count[first]
    return np.asarray(mean + (total[last] - total[first]) / np.maximum(number, 1))
