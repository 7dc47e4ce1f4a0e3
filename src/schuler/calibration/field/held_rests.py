"""Rests in which the unit does not turn are held: cut out of the time line, their readings compared with the Earth's.

In Earth-fixed axes nothing happens at rest. Gyroscopes that carry the attitude through it would only add their noise;
so of each block of readings the last interval stays, and its mean rate is compared with the rate of the Earth, on all
three axes. Every reading is still used once. Whether the hand sways, so that rests cannot be held, is tested first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.options import FieldOptions
from schuler.filtering.states import StateLayout
from schuler.recording.series import Increments
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

#: Length of an interval that stays: rates can be computed from it, random walk in it is negligible. [s]
MOMENT_S = 1e-6


#: Largest variance of swaying at which rests are held, over that of the gyroscopes' random walk in a turn.
LARGEST_SWAY = 0.1
_SIGNIFICANT = 3.0  # standard errors from which swaying counts
_FEWEST = 5  # rests from which a standard error is estimated


def hold_rests(increments: Increments, blocks: Blocks, spans: FloatArray) -> tuple[Increments, Blocks]:
    """Take the rests out of a log but for the last interval of each block.

    Parameters
    ----------
    increments : Increments
        The complete log.
    blocks : Blocks
        Means over the blocks of its rests.
    spans : ndarray, shape (k, 2)
        Start and stop of each rest. [s]

    Returns
    -------
    increments : Increments
        Times are those of the log: intervals do not touch where something was cut out. An interval that stays has the
        mean rates of its block and a length of :data:`MOMENT_S`: attitude does not drift in it. The very first stays
        as it is, so that time begins where it did.
    blocks : Blocks
        At the ends of those intervals.

    Notes
    -----
    The filter integrates over the lengths of intervals, not over the time between them: attitude, covariance and
    parameters stay. Parameters that walk need :func:`scale_wander`.
    """
    middle = increments.t - 0.5 * increments.dt
    k = np.searchsorted(spans[:, 0], middle, side="right") - 1
    inside = (k >= 0) & (middle < spans[np.maximum(k, 0), 1])
    # rounding of times is less than the microsecond, a sample more
    at = np.maximum(np.searchsorted(middle, blocks.t + 0.5 * blocks.length - 1e-6) - 1, 0)
    keep = ~inside
    keep[0] = keep[at] = True
    dt, dtheta, dv = increments.dt.copy(), increments.dtheta_ib_b.copy(), increments.dv_ib_b.copy()
    dt[at], dtheta[at], dv[at] = MOMENT_S, MOMENT_S * blocks.omega, MOMENT_S * blocks.f
    kept = Increments(increments.t[keep], dt[keep], dtheta[keep], dv[keep])
    return kept, replace(blocks, t=increments.t[at])


def scale_wander(layout: StateLayout, kept: Increments, complete: Increments) -> StateLayout:
    """Models whose parameters walk and decay in the intervals that are left by as much as in the complete log."""
    ratio = float(complete.dt.sum() / kept.dt.sum())
    models = {
        name: replace(model, noise=model.noise * np.sqrt(ratio), tau=None if model.tau is None else model.tau / ratio)
        for name, model in layout.models.items()
    }
    return StateLayout(models)


def sway_variance(blocks: Blocks) -> tuple[float, float]:
    """Variance of the inclination within rests about their mean, and its standard error. [rad^2]

    Parameters
    ----------
    blocks : Blocks
        Means over the blocks of the rests; raw readings are good enough.

    Returns
    -------
    variance, error : float
        Per axis. (0, inf) from fewer than five rests of two blocks or more.

    Notes
    -----
    Mean product of two inclinations from block to block, that of the accelerometers and that of the integrated rates,
    both less their means over the rest: their noises are independent, so it is the variance of the common motion. The
    mean rate of the rest, a bias and a steady creep, is removed. The standard error is from the scatter between rests.
    """
    products, freedom = [], []
    for k in np.unique(blocks.rest[blocks.rest >= 0]):
        part = blocks.rest == k
        if np.count_nonzero(part) < 2:
            continue
        f, omega, length = blocks.f[part], blocks.omega[part], blocks.length[part, None]
        up = f.mean(axis=0) / np.linalg.norm(f.mean(axis=0))
        inclination = np.cross(up, f - f.mean(axis=0)) / np.linalg.norm(f.mean(axis=0))
        off = (omega - np.sum(length * omega, axis=0) / length.sum()) * length
        rotation = np.cumsum(off, axis=0) - 0.5 * off  # to the middle of each block
        rotation -= rotation.mean(axis=0)
        # the body turns by theta, the vertical in its axes by -theta
        products.append(-float(np.sum(inclination * rotation)))
        freedom.append(2 * (len(f) - 1))
    if len(products) < _FEWEST:
        return 0.0, float("inf")
    each, total = np.array(products), float(np.sum(freedom))
    return float(each.sum()) / total, float(np.sqrt(len(each) * each.var(ddof=1))) / total


def resolve_earth_rate(options: FieldOptions, spec: ImuSpec, blocks: Blocks, rests: StaticIntervals) -> FieldOptions:
    """Options with ``earth_rate`` "auto" replaced by "vector" or "vertical".

    Rests are held unless they sway significantly, by more than a third (in sigma) of the random walk of the gyroscopes
    in a turn: then attitude is carried through them, less certain but unbiased.
    """
    if options.earth_rate != "auto":
        return options
    variance, error = sway_variance(blocks)
    turn_s = float(np.median(rests.start[1:] - rests.stop[:-1])) if len(rests) > 1 else 0.0
    swaying = variance > _SIGNIFICANT * error and variance > LARGEST_SWAY * spec.gyro.random_walk**2 * turn_s
    return replace(options, earth_rate="vertical" if swaying else "vector")
