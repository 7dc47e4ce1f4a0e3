"""White frequency noise of a receiver's clock, by what carriers of all satellites change beside their range rates."""

from __future__ import annotations

import numpy as np

from schuler.exceptions import InputError
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.coarse import epoch_medians
from schuler.gnss.ranges import Ranges

_FEWEST = 5  # satellites of an epoch: one that is wrong then does not move the median far
_EPOCHS = 30  # whose root mean square is known to an eighth


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
        Root mean square, over epochs, of the median of the satellites' changes of carrier less the mean of their range
        rates at both ends, by the root of the time between. A jerk of the antenna and what is left of the noise of
        range rates are in it: a little too large rather than too small.

    Raises
    ------
    InputError
        If fewer than thirty epochs have five satellites with both.
    """
    c = carrier_changes(ranges, sigma)
    dt = ranges.t[c.now] - ranges.t[c.before]
    beside = c.change - 0.5 * dt * (ranges.range_rate[c.now] + ranges.range_rate[c.before])
    scaled = beside / np.sqrt(dt)
    t, epoch = np.unique(ranges.t[c.now], return_inverse=True)
    enough = np.bincount(epoch[np.isfinite(scaled)], minlength=len(t)) >= _FEWEST
    if np.sum(enough) < _EPOCHS:
        raise InputError(
            f'gnss.tight.clock_noise_m = "log" needs {_EPOCHS} epochs at which {_FEWEST} satellites have carriers and '
            f"range rates, got {int(np.sum(enough))}: give a number, 0.05 for a still receiver with a good oscillator, "
            "0.3 if nothing is known"
        )
    return float(np.sqrt(np.mean(epoch_medians(epoch, scaled, len(t))[enough] ** 2)))
