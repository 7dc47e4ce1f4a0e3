"""Ranges that the epochs before show to be late, and standard deviations that single points' residuals contradict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.integrity import Integrity
from schuler.gnss.neighbours import late_ranges
from schuler.gnss.point import solve_points
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges, joined_ranges

WINDOW_S = 10.0
BEFORE = 3  # windows before a window by which its reflections are told
EXCLUDED = 6  # schuler.gnss.ranges.REASONS
_EARLY = 1e-3  # of a window: an epoch at its beginning may be stamped so much before
_ROUNDS = 4  # of scaling and solving: exclusions made with the old weights hide a part of the scatter
_SIGMAS = 3.1  # of chance, 99.9 %
_LEAST = 1.25  # standard deviations that are wrong by less do no harm
_SETTLED = 1.05
_ALONE = Integrity(neighbours=False)  # the filter is what ties epochs here, and statistics are those of one epoch


def window_of(t: FloatArray | float, origin: float = 0.0) -> IntArray:
    """Number of the window in which times lie, by the clock of their stamps from an origin on. [s]"""
    return np.floor((np.asarray(t) - origin) / WINDOW_S + _EARLY).astype(np.int64)


def without_reflections(
    ranges: Ranges, before: Ranges | None, notes: list[str], origin: float = 0.0
) -> tuple[Ranges, PointSolution]:
    """Ranges less those that are late by the epochs before them, where one epoch alone cannot tell.

    With many reflections the satellites of an epoch agree with several places: the filter would get them all, with
    standard deviations enlarged to their scatter. The ten seconds in which such an epoch lies are tied by range rates,
    with the thirty before (:func:`schuler.gnss.neighbours.late_ranges`); what comes later has no part in it, so that a
    stream has what a log has. Windows without such epochs stay as they are.

    Parameters
    ----------
    ranges : Ranges
        With positive standard deviations.
    before : Ranges, optional
        Those of the thirty seconds before, less those among ``ranges``.
    notes : list of str
        Gets a sentence if any were left out.
    origin : float
        See :func:`inflate_sigmas`. [s]

    Returns
    -------
    ranges : Ranges
    solution : PointSolution
        Their single points, each epoch by itself, by the standard deviations as they are.
    """
    solution = solve_points(ranges, integrity=_ALONE)
    failed = (solution.status == 5) | (solution.status == 6)
    if not failed.any():
        return ranges, solution
    every = ranges if before is None else joined_ranges([before, ranges])
    points = solution if before is None else solve_points(every, integrity=_ALONE)
    late, window = np.zeros(len(every), dtype=bool), window_of(every.t, origin)
    for w in np.unique(window_of(solution.t[failed], origin)):
        rows = np.flatnonzero((window >= w - BEFORE) & (window <= w))
        k = np.arange(points.epoch[rows[0]], points.epoch[rows[-1]] + 1)
        late[rows] |= late_ranges(every.where(rows), points.where(k), window_of(points.t[k], origin) == w)
    late = late[len(every) - len(ranges) :]
    if not late.any():
        return ranges, solution
    notes.append(
        f"{int(late.sum())} ranges suspected not to be in line of sight, by the epochs before them, were left out with "
        "their range rates"
    )
    ranges = replace(
        ranges,
        reason=np.where(late, EXCLUDED, ranges.reason),
        range_rate=np.where(late, np.nan, ranges.range_rate),
    )
    return ranges, solve_points(ranges, integrity=_ALONE)


def inflate_sigmas(
    ranges: Ranges, notes: list[str], origin: float = 0.0, solution: PointSolution | None = None
) -> tuple[Ranges, PointSolution]:
    """Enlarge standard deviations of ranges that are smaller than their scatter.

    Parameters
    ----------
    ranges : Ranges
        Ranges with positive standard deviations.
    notes : list of str
        Gets a sentence if any were enlarged.
    origin : float
        Where a window begins; by default at every ten seconds of the clock, wherever a log begins. [s]
    solution : PointSolution, optional
        Their single points, each epoch by itself, where they are known.

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
    solution = solve_points(ranges, integrity=_ALONE) if solution is None else solution
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
