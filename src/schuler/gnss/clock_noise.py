"""White frequency noise of a receiver's clock, by what carriers of all satellites change beside their range rates."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.coarse import epoch_medians
from schuler.gnss.ranges import Ranges

_FEWEST = 5  # satellites of an epoch: one that is wrong then does not move the median far
_EPOCHS = 30  # whose root mean square is known to an eighth
_STEP = 10.0  # times what is usual: no noise, but the receiver set its clock


def clock_frequency_noise(ranges: Ranges, sigma: float) -> float:
    """Root density of a receiver clock's white frequency noise. [m/sqrt(s)]

    Parameters
    ----------
    ranges : Ranges
        With carrier phases, arcs free of slips, and range rates.
    sigma : float
        1-sigma of a phase of a strong satellite overhead, as for :func:`~schuler.gnss.carrier.carrier_changes`. [m]

    Returns
    -------
    float
        Root mean square of :func:`common_changes` by the root of the time between, without steps of ten times what is
        usual. A jerk of the antenna and what is left of the noise of range rates are in it: a little too large rather
        than too small.

    Raises
    ------
    InputError
        If fewer than thirty epochs have five satellites with both.
    """
    _, dt, common = common_changes(ranges, sigma)
    scaled = (common / np.sqrt(dt))[np.isfinite(common)]
    if len(scaled) < _EPOCHS:
        raise InputError(
            f'gnss.tight.clock_noise_m = "log" needs {_EPOCHS} epochs at which {_FEWEST} satellites have carriers and '
            f"range rates, got {len(scaled)}: give a number, 0.05 for a still receiver with a good oscillator, "
            "0.3 if nothing is known"
        )
    usual = 1.4826 * float(np.median(np.abs(scaled)))
    return float(np.sqrt(np.mean(scaled[np.abs(scaled) <= _STEP * usual] ** 2)))


def common_changes(ranges: Ranges, sigma: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the carriers of all satellites change from epoch to epoch beside their range rates: the clock's part.

    Parameters
    ----------
    ranges : Ranges
        With carrier phases, arcs free of slips, and range rates.
    sigma : float
        1-sigma of a phase of a strong satellite overhead, as for :func:`~schuler.gnss.carrier.carrier_changes`. [m]

    Returns
    -------
    t, dt : ndarray, shape (k,)
        Epochs that carriers go on to, and the time since the epoch before. [s]
    common : ndarray, shape (k,)
        Median of the satellites' changes of carrier less the mean of their range rates at both ends; NaN where fewer
        than five satellites have both. [m]
    """
    c = carrier_changes(ranges, sigma)
    dt = ranges.t[c.now] - ranges.t[c.before]
    beside = c.change - 0.5 * dt * (ranges.range_rate[c.now] + ranges.range_rate[c.before])
    t, first, epoch = np.unique(ranges.t[c.now], return_index=True, return_inverse=True)
    enough = np.bincount(epoch[np.isfinite(beside)], minlength=len(t)) >= _FEWEST
    return t, dt[first], np.where(enough, epoch_medians(epoch, beside, len(t)), np.nan)
