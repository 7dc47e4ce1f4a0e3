"""How many times smaller errors become: a ratio of means over runs with its interval, instead of one run of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

_RESAMPLES = 4000


@dataclass(frozen=True)
class Improvement:
    """Ratio of the errors of two ways of doing a thing.

    Attributes
    ----------
    ratio : float
        Mean of the first over mean of the second: above 1 if the second is better.
    low, high : float
        Interval of the ratio.
    probability : float
        Of the interval.
    wins : float
        Share of the runs in which the second has the smaller error.
    single_low, single_high : float
        The same share of single runs of each has its ratio in here: what a comparison of one run with one run shows.
    runs : int
    """

    ratio: float
    low: float
    high: float
    probability: float
    wins: float
    single_low: float
    single_high: float
    runs: int

    @property
    def certain(self) -> bool:
        """Whether the whole interval is above 1."""
        return self.low > 1.0

    def compared(self, claim: tuple[float, float]) -> str:
        """Verdict on a claim that the ratio lies between two numbers: holds, partly, too much, too little."""
        least, most = claim
        if least <= self.low and self.high <= most:
            return "holds"
        if self.high < least:
            return "does not hold: less"
        if self.low > most:
            return "does not hold: more"
        return "holds in part: the interval reaches beyond it"

    def summary(self) -> str:
        """One sentence."""
        return (
            f"{self.ratio:.2f} times smaller ({100 * self.probability:.0f} %: {self.low:.2f} to {self.high:.2f}, "
            f"{self.runs} runs); smaller in {100 * self.wins:.0f} % of runs; single runs give {self.single_low:.2f} "
            f"to {self.single_high:.2f}"
        )


def improvement(
    before: ArrayLike, after: ArrayLike, *, probability: float = 0.95, resamples: int = _RESAMPLES, seed: int = 0
) -> Improvement:
    """Ratio of mean errors with a bootstrap interval.

    Parameters
    ----------
    before, after : array_like, shape (n,)
        Errors of the same n runs (same seeds) both ways; positive.
    probability : float
        Of the intervals.
    resamples : int
        Of the bootstrap: runs drawn with replacement, in pairs.
    seed : int

    Raises
    ------
    InputError
        If lengths differ, there are fewer than ten runs, or an error is not positive.

    References
    ----------
    Efron and Tibshirani (1993), chapter 13 (percentile interval).
    """
    a = as_floats(before, "before", (None,))
    b = as_floats(after, "after", (len(a),))
    if len(a) < 10:
        raise InputError(f"expected ten runs or more for an interval, got {len(a)}")
    if not (np.all(a > 0.0) and np.all(b > 0.0)):
        raise InputError("before, after: expected positive errors")
    if not 0.0 < probability < 1.0:
        raise InputError(f"probability: expected a number between 0 and 1, got {probability!r}")
    rng = np.random.default_rng(seed)
    pick = rng.integers(len(a), size=(resamples, len(a)))
    ratios = a[pick].mean(axis=1) / b[pick].mean(axis=1)
    edges = (0.5 - 0.5 * probability, 0.5 + 0.5 * probability)
    low, high = np.quantile(ratios, edges)
    single = a[rng.integers(len(a), size=resamples)] / b[rng.integers(len(b), size=resamples)]
    one_low, one_high = np.quantile(single, edges)
    return Improvement(
        float(a.mean() / b.mean()), float(low), float(high), probability, float(np.mean(b < a)),
        float(one_low), float(one_high), len(a),
    )  # fmt: skip


def mean_interval(x: FloatArray, *, probability: float = 0.95) -> tuple[float, float, float]:
    """Mean over runs (n,) and its interval from the standard error."""
    from scipy.special import ndtri

    if len(x) < 2:
        raise InputError(f"expected two runs or more for an interval, got {len(x)}")
    half = float(ndtri(0.5 + 0.5 * probability)) * float(np.std(x, ddof=1)) / float(np.sqrt(len(x)))
    mean = float(np.mean(x))
    return mean, mean - half, mean + half


def share_below(values: FloatArray, printed: float, *, resamples: int = _RESAMPLES, seed: int = 0) -> float:
    """How usual a printed mean is: share of means of as many single runs of ours that are no larger.

    Parameters
    ----------
    values : ndarray, shape (cases, n)
        n runs of each case; the printed value is a mean over the cases, one run each.
    printed : float
    """
    rng = np.random.default_rng(seed)
    cases, n = values.shape
    drawn = values[np.arange(cases), rng.integers(n, size=(resamples, cases))]
    return float(np.mean(drawn.mean(axis=1) <= printed))
