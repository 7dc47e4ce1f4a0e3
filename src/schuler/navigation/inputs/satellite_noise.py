"""Standard deviations of satellite measurements, enlarged where the residuals of single points contradict them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.integrity import Integrity
from schuler.gnss.point import solve_points
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges

WINDOW_S = 10.0
_EARLY = 1e-3  # of a window: an epoch at its beginning may be stamped so much before
_ROUNDS = 4  # of scaling and solving: exclusions made with the old weights hide a part of the scatter
_SIGMAS = 3.1  # of chance, 99.9 %
_LEAST = 1.25  # standard deviations that are wrong by less do no harm
_SETTLED = 1.05
_ALONE = Integrity(neighbours=False)  # the filter is what ties epochs here, and statistics are those of one epoch


def window_of(t: FloatArray | float, origin: float = 0.0) -> IntArray:
    """Number of the window in which times lie, by the clock of their stamps from an origin on. [s]"""
    return np.floor((np.asarray(t) - origin) / WINDOW_S + _EARLY).astype(np.int64)


def inflate_sigmas(ranges: Ranges, notes: list[str], origin: float = 0.0) -> tuple[Ranges, PointSolution]:
    """Enlarge standard deviations of ranges that are smaller than their scatter.

    Parameters
    ----------
    ranges : Ranges
        Ranges with positive standard deviations.
    notes : list of str
        Gets a sentence if any were enlarged.
    origin : float
        Where a window begins; by default at every ten seconds of the clock, wherever a log begins. [s]

    Returns
    -------
    ranges : Ranges
    solution : PointSolution
        Single points with fault detection, by the standard deviations returned.

    Notes
    -----
    The variance factor of adjustment theory, in windows of ten seconds: the median over epochs of the weighted sum of
    squared residuals, after fault exclusion, over the median of its chi-square distribution. Where it exceeds what
    true standard deviations pass with 99.9 %, and 1.25 squared, all of the window's are scaled by its root. They are
    never made smaller, because an error that all satellites of an epoch share, or that lasts, does not show in
    residuals. A filter that is too sure of its measurements rejects good ones one by one, and goes astray; a receiver
    in a hand has range rates of twice the scatter of one that stands still.

    The median keeps a fault of a few epochs from passing as noise.

    References
    ----------
    Teunissen, P. J. G. (2000), Testing Theory, chapter 4 (overall model test and variance factor).
    """
    range_factor, rate_factor = np.ones(len(ranges)), np.ones(len(ranges))
    solution = solve_points(ranges, integrity=_ALONE)
    window = window_of(solution.t, origin)
    larger_range, larger_rate = np.zeros((2, len(solution)), dtype=bool)
    for _ in range(_ROUNDS):
        tested = solution.status != 2
        freedom, rate_freedom = solution.redundancy, np.maximum(solution.n_rates - 4, 0)
        of_range = _factors(solution.statistic, freedom, tested & (freedom > 0), larger_range, window)
        of_rate = _factors(solution.velocity_statistic, rate_freedom, rate_freedom > 0, larger_rate, window)
        if max(of_range.max(), of_rate.max()) < _SETTLED:
            break
        larger_range, larger_rate = larger_range | (of_range > 1.0), larger_rate | (of_rate > 1.0)
        range_factor *= of_range[solution.epoch]
        rate_factor *= of_rate[solution.epoch]
        scaled = replace(
            ranges, sigma_range=ranges.sigma_range * range_factor, sigma_rate=ranges.sigma_rate * rate_factor
        )
        solution = solve_points(scaled, integrity=_ALONE)
    for factor, name in ((range_factor, "ranges"), (rate_factor, "range rates")):
        more = factor > 1.0
        if more.any():
            notes.append(
                f"standard deviations of {int(more.sum())} {name} were enlarged, by {np.median(factor[more]):.1f} "
                f"(median) to {factor.max():.1f}: single points scatter more than they say"
            )
    if (range_factor == 1.0).all() and (rate_factor == 1.0).all():
        return ranges, solution
    return replace(
        ranges, sigma_range=ranges.sigma_range * range_factor, sigma_rate=ranges.sigma_rate * rate_factor
    ), solution


def _factors(
    statistic: FloatArray, freedom: IntArray, tested: BoolArray, larger: BoolArray, window: IntArray
) -> FloatArray:
    """Factor on the standard deviations of each epoch, 1 or more; epochs without redundancy take their window's.

    ``larger`` are the epochs enlarged before, which need no clear case any more.
    """
    from scipy.special import chdtri

    factors = np.ones(len(statistic))
    tested = tested & np.isfinite(statistic)
    if not tested.any():
        return factors
    normal = statistic[tested] / chdtri(freedom[tested], 0.5)
    windows = window[tested]
    for w in np.unique(windows):
        members = windows == w
        ratio = float(np.median(normal[members]))
        # a median of n values of relative spread sqrt(2 / f) has 1.2533 times that of their mean
        spread = 1.2533 * np.sqrt(2.0 / float(freedom[tested][members].mean()) / members.sum())
        clear = ratio > 1.0 + _SIGMAS * spread and ratio > _LEAST**2
        if clear or (ratio > _SETTLED**2 and larger[window == w].any()):
            factors[window == w] = np.sqrt(ratio)
    return factors
