"""Do rests stand still, or does the hand that holds the sensor sway: what both triads see of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.options import FieldOptions
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

#: Variance of swaying that is borne, in that of the gyroscopes' random walk over a turn.
BEARABLE = 0.1
_SURE = 3.0  # standard errors from which swaying is believed
_FEWEST = 5  # rests that tell a standard error


def sway(blocks: Blocks) -> tuple[float, float]:
    """Variance of the inclination within rests about their mean, and its standard error. [rad^2]

    Parameters
    ----------
    blocks : Blocks
        Of the rests; raw readings are good enough.

    Returns
    -------
    variance, error : float
        Per axis. Nothing is known (0, inf) from fewer than five rests of two blocks or more.

    Notes
    -----
    The product of the inclination that the accelerometers see change from block to block and of the one that the
    integral of the rates does, both less their means over the rest: their noises are independent, so the mean of it is
    the variance of what is common, however large they are. The mean rate of the rest, a bias and a steady creep, is
    taken out. The standard error is that of the scatter from rest to rest.
    """
    products, freedom = [], []
    for k in np.unique(blocks.rest[blocks.rest >= 0]):
        part = blocks.rest == k
        if np.count_nonzero(part) < 2:
            continue
        f, omega, length = blocks.f[part], blocks.omega[part], blocks.length[part, None]
        up = f.mean(axis=0) / np.linalg.norm(f.mean(axis=0))
        seen = np.cross(up, f - f.mean(axis=0)) / np.linalg.norm(f.mean(axis=0))
        off = (omega - np.sum(length * omega, axis=0) / length.sum()) * length
        turned = np.cumsum(off, axis=0) - 0.5 * off  # to the middle of each block
        turned -= turned.mean(axis=0)
        # the body turns by theta, what is up in its axes by -theta
        products.append(-float(np.sum(seen * turned)))
        freedom.append(2 * (len(f) - 1))
    if len(products) < _FEWEST:
        return 0.0, float("inf")
    each, total = np.array(products), float(np.sum(freedom))
    return float(each.sum()) / total, float(np.sqrt(len(each) * each.var(ddof=1))) / total


def settled_form(options: FieldOptions, spec: ImuSpec, blocks: Blocks, rests: StaticIntervals) -> FieldOptions:
    """Options with the form of the Earth rate decided that is left to the log.

    Rests are held unless they surely sway by more than a third (in sigma) of what the gyroscopes lose in a turn: then
    attitude is carried on through them, which is less certain and true.
    """
    if options.earth_rate != "auto":
        return options
    variance, error = sway(blocks)
    turn_s = float(np.median(rests.start[1:] - rests.stop[:-1])) if len(rests) > 1 else 0.0
    swaying = variance > _SURE * error and variance > BEARABLE * spec.gyro.random_walk**2 * turn_s
    return replace(options, earth_rate="vertical" if swaying else "vector")
