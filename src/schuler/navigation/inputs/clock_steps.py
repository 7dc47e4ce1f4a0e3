"""Steps of a receiver's clock, taken out of ranges, carriers and single points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.clock_noise import common_changes
from schuler.gnss.coarse import epoch_medians
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges

_SMALLEST_JUMP = 20.0  # that codes show; what is less is their noise, which the clock states follow [m]
_CLEAR_JUMP = 10.0  # times the usual scatter from epoch to epoch
_LONGEST_GAP_S = 10.0  # over which a clock is expected to run on
_LASTING = 4  # epochs after which a jump must still be there; a bad solution is not
_CLEAR_STEP = 3.5  # times the stated noise of the clock: at 3.9 the default gate rejects all phases of an epoch
_CLEAR_PARTING = 3.0  # times what codes and carriers usually part by, median of an epoch's satellites


def without_clock_jumps(ranges: Ranges, solution: PointSolution, notes: list[str]) -> tuple[Ranges, PointSolution]:
    """Ranges and solutions with the receiver clock made continuous.

    Parameters
    ----------
    ranges : Ranges
    solution : PointSolution
        Single-point solutions of these ranges.
    notes : list of str
        Gets a sentence if there are jumps.

    Notes
    -----
    A jump is what the clocks of all systems move by between two solved epochs beyond what their drift explains (the
    mean of both ends' from range rates, else the usual rate), if it is more than 20 m and ten times the usual scatter,
    and the medians of five epochs on both sides show it. Whole milliseconds have been taken out before, by
    :func:`schuler.gnss.preparation.prepare_ranges`; this serves other steps and ranges that were prepared elsewhere. A
    jump while there are too few satellites for a solution is assigned to the next solved epoch.
    """
    k = np.flatnonzero(solution.ok)
    if len(k) < 3:
        return ranges, solution
    t, clock, drift = solution.t[k], solution.clock[k], solution.drift[k]
    dt = np.diff(t)
    steps = np.diff(clock, axis=0)
    seen = np.isfinite(steps).any(axis=1)
    common = np.full(len(dt), np.nan)
    common[seen] = np.nanmedian(steps[seen], axis=1)
    expected = 0.5 * (drift[1:] + drift[:-1])
    rate = common / dt
    usual_rate = float(np.nanmedian(rate)) if seen.any() else 0.0
    expected = np.where(np.isfinite(expected), expected, usual_rate)
    left = common - expected * dt
    tested = seen & (dt <= _LONGEST_GAP_S)
    if not tested.any():
        return ranges, solution
    scatter = 1.4826 * float(np.median(np.abs(left[tested] - np.median(left[tested]))))
    clear = np.flatnonzero(tested & (np.abs(left) > max(_SMALLEST_JUMP, _CLEAR_JUMP * scatter)))
    level = np.concatenate(([0.0], np.cumsum(np.where(tested, left, 0.0))))
    lasting = [_lasting(level, int(i)) for i in clear]
    jumps = clear[np.array(lasting, dtype=bool)]
    if not len(jumps):
        return ranges, solution
    notes.append(
        f"the receiver clock jumped {len(jumps)} times, first by {left[jumps[0]]:+.1f} m at {t[jumps[0] + 1]:.3f} s: "
        "taken out"
    )
    return _codes_without(ranges, solution, t[jumps + 1], left[jumps])


def without_clock_steps(
    ranges: Ranges, solution: PointSolution, sigma: float, noise: float, notes: list[str]
) -> tuple[Ranges, PointSolution]:
    """Ranges, carriers and solutions without steps of the receiver clock beyond its noise, as carriers show them.

    Parameters
    ----------
    ranges : Ranges
        With carrier phases, arcs free of slips.
    solution : PointSolution
        Single-point solutions of these ranges.
    sigma : float
        1-sigma of a phase of a strong satellite overhead. [m]
    noise : float
        White frequency noise of the clock, as the filter has it. [m/sqrt(s)]
    notes : list of str
        Gets a sentence if there are steps.

    Notes
    -----
    What all satellites' carriers change beside their range rates (:func:`schuler.gnss.clock_noise.common_changes`) is
    the clock's, and to the filter, which sees one satellite after the other, as many slips. Beyond 3.5 times the noise
    it is taken out of codes and carriers alike, or of carriers alone where codes and carriers parted by it. Nothing
    else can be hurt: a common change is the clock's to any filter. Epochs of fewer than five satellites stay.
    """
    t, dt, common = common_changes(ranges, sigma)
    steps = np.flatnonzero(np.abs(common) > _CLEAR_STEP * noise * np.sqrt(dt))
    if not len(steps):
        return ranges, solution
    c = carrier_changes(ranges, sigma)
    parting = c.change - (ranges.pseudorange[c.now] - ranges.pseudorange[c.before])
    parted = epoch_medians(np.searchsorted(t, ranges.t[c.now]), parting, len(t))
    usual = 1.4826 * float(np.nanmedian(np.abs(parted))) if np.isfinite(parted).any() else 0.0
    alone = np.abs(parted[steps]) > _CLEAR_PARTING * usual
    alone &= np.abs(parted[steps] - common[steps]) < np.abs(parted[steps])
    notes.append(
        f"the receiver clock stepped by more than {_CLEAR_STEP:g} times its noise at {len(steps)} epochs, first by "
        f"{common[steps[0]]:+.2f} m at {t[steps[0]]:.3f} s: taken out"
        + (f", {int(alone.sum())} times of carrier phases alone" if alone.any() else "")
    )
    carriers = ranges.carrier_range - _sum_until(t[steps], common[steps], ranges.t)
    shared = steps[~alone]
    return _codes_without(replace(ranges, carrier_range=carriers), solution, t[shared], common[shared])


def _codes_without(
    ranges: Ranges, solution: PointSolution, times: FloatArray, steps: FloatArray
) -> tuple[Ranges, PointSolution]:
    """Pseudoranges and clocks of single points less the steps up to their times."""
    ranges = replace(ranges, pseudorange=ranges.pseudorange - _sum_until(times, steps, ranges.t))
    return ranges, replace(solution, clock=solution.clock - _sum_until(times, steps, solution.t)[:, None])


def _sum_until(times: FloatArray, steps: FloatArray, t: FloatArray) -> FloatArray:
    """Sum of the steps up to each time of ``t``, and with it. Shapes (k,), (k,), (n,) to (n,)."""
    return np.concatenate(([0.0], np.cumsum(steps)))[np.searchsorted(times, t, side="right")]


def _lasting(level: FloatArray, i: int) -> bool:
    """Whether the level of a clock before and after interval ``i`` differs for more than an epoch or two."""
    before, after = level[max(i - _LASTING, 0) : i + 1], level[i + 1 : i + 2 + _LASTING]
    return bool((np.median(after) - np.median(before)) / (level[i + 1] - level[i]) > 0.5)
