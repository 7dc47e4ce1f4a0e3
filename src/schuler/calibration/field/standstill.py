"""A rest in which the unit does not turn: cut out of the time line, its readings measured where it was.

In Earth-fixed axes nothing happens at rest. Gyroscopes that carry the attitude through it add their noise to what is
known not to move; so they do not: of each block of readings the last interval stays, and what the gyroscopes read in
the block is compared with the rate of the Earth, all three axes, instead. Every reading is still used once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.filtering.states import StateLayout
from schuler.recording.series import Increments

#: Length of an interval that stays: rates can be computed from it, and random walk in it is none. [s]
MOMENT_S = 1e-6


def at_standstill(increments: Increments, blocks: Blocks, spans: FloatArray) -> tuple[Increments, Blocks]:
    """Take the rests out of a log but for the last interval of each block.

    Parameters
    ----------
    increments : Increments
        Whole log.
    blocks : Blocks
        Of its rests.
    spans : ndarray, shape (k, 2)
        Start and stop of each rest. [s]

    Returns
    -------
    increments : Increments
        Times are those of the log: intervals do not touch where something was cut out. An interval that stays has the
        mean rates of its block, so that all that is computed from them has their noise, and is a moment long: attitude
        does not drift in it. The very first stays as it is, so that time begins where it did.
    blocks : Blocks
        At the ends of those intervals.

    Notes
    -----
    The filter integrates over the lengths of intervals and knows nothing of time between them: attitude, covariance and
    parameters stay. Use :func:`as_much_wander` for parameters that do not.
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


def as_much_wander(layout: StateLayout, kept: Increments, whole: Increments) -> StateLayout:
    """Models whose parameters walk and decay in the intervals that are left by as much as in the whole log."""
    ratio = float(whole.dt.sum() / kept.dt.sum())
    models = {
        name: replace(model, noise=model.noise * np.sqrt(ratio), tau=None if model.tau is None else model.tau / ratio)
        for name, model in layout.models.items()
    }
    return StateLayout(models)
