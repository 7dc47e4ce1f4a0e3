"""Cycle slips that a receiver does not state: by codes, range rates, other satellites and a second band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.differences import outlying_phases
from schuler.gnss.ranges import Ranges, predicted_ranges
from schuler.gnss.signals import SPEED_OF_LIGHT

_CYCLE = SPEED_OF_LIGHT / 1.57542e9  # a slip is said in cycles of L1, the shortest there is [m]
_SMALLEST_SLIP = 0.3  # half a cycle is the smallest there is [cycles]
_SIGMAS = 5.0  # of a change against the range rates of both its ends
_JERK = 2.0  # of a receiver, 1-sigma, that the mean of two range rates does not follow [m/s^3]
_RESET = 20.0  # by which changes of code and carrier differ on all satellites where the clock was set [m]


def without_slips(ranges: Ranges, r_e: FloatArray, sigma: float, notes: list[str]) -> Ranges:
    """Ranges whose arcs also end at slips that no receiver stated.

    Parameters
    ----------
    ranges : Ranges
    r_e : ndarray, shape (n, 3)
        Approximate antenna of each row, good to some ten metres. [m]
    sigma : float
        See :func:`carrier_changes`. [m]
    notes : list of str
        Gets a sentence on slips and on settings of the clock that carriers do not share with codes.

    Notes
    -----
    Three tests of what changed from epoch to epoch. Codes and carriers of all satellites move apart by more than 20 m
    where the receiver set its clock: all arcs end. A change that differs from that by both range rates, the median of
    the satellites taken off, by more than 0.3 cycles and five sigma is a slip. What is left must fit one displacement
    and one clock (Baarda's data snooping, with five satellites and more); where five cannot tell which one jumped, all
    arcs end. With fewer, two bands tell where their carriers part, whichever slipped (two that slip alike do not part);
    what remains is the inertial prediction in the filter.
    """
    c = carrier_changes(ranges, sigma)
    if not len(c.now):
        return ranges
    slipped = np.zeros(len(c.now), dtype=bool)
    reset = np.zeros(len(c.now), dtype=bool)
    dt = ranges.t[c.now] - ranges.t[c.before]
    here = 0.5 * (r_e[c.now] + r_e[c.before])
    predicted, gradient = predicted_ranges(ranges.r_sat_e[c.now], here)
    moved = c.change - (predicted - predicted_ranges(ranges.r_sat_e[c.before], here)[0])
    code = c.change - (ranges.pseudorange[c.now] - ranges.pseudorange[c.before])
    rate = c.change - 0.5 * dt * (ranges.range_rate[c.now] + ranges.range_rate[c.before])
    doubt = np.hypot(0.5 * dt * np.hypot(ranges.sigma_rate[c.now], ranges.sigma_rate[c.before]), _JERK * dt**3 / 12.0)
    apart = np.abs(ranges.bands_apart[c.now] - ranges.bands_apart[c.before])
    parted = apart > np.maximum(_SIGMAS * np.sqrt(2.0) * c.sigma, _SMALLEST_SLIP * _CYCLE)
    bounds = np.flatnonzero(np.diff(ranges.t[c.now]) > 0.0) + 1
    for i, j in zip(np.concatenate(([0], bounds)), np.concatenate((bounds, [len(c.now)])), strict=True):
        part = np.arange(i, j)
        if np.isfinite(code[part]).any() and abs(np.nanmedian(code[part])) > _RESET:
            reset[part] = True
            continue
        against = rate[part] - (np.nanmedian(rate[part]) if np.isfinite(rate[part]).any() else 0.0)
        bound = np.maximum(_SIGMAS * np.hypot(doubt[part], c.sigma[part]), _SMALLEST_SLIP * _CYCLE)
        slipped[part] = np.abs(against) > bound  # without a rate: no
        left = part[~slipped[part]]
        if len(left) > 4:
            A = np.column_stack((gradient[left], np.ones(len(left))))
            jumped = outlying_phases(A, moved[left], c.sigma[left], np.full(len(left), _CYCLE))
            slipped[left] = True if jumped is None else jumped
        else:  # where satellites are many the others tell, and do not end an arc for a slip of the other band
            slipped[left] = parted[left]
    if slipped.any():
        notes.append(
            f"{int(slipped.sum())} of {len(c.now)} changes of carrier phases are cycle slips by the other "
            "satellites, their range rates or a second band"
        )
    if reset.any():
        count = len(np.unique(ranges.t[c.now[reset]]))
        notes.append(f"codes and carriers moved apart together at {count} epochs: carrier phases begin anew there")
    fresh = np.zeros(len(ranges), dtype=bool)
    fresh[c.now[slipped | reset]] = True
    order = np.argsort(ranges.sat, kind="stable")
    arc = np.empty(len(ranges), dtype=np.int64)
    arc[order] = ranges.arc[order] + np.cumsum(fresh[order])
    return replace(ranges, arc=arc)
