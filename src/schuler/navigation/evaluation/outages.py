"""GNSS outages: where to put them, and how far the solution drifts in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.evaluation.errors import TrajectoryErrors


@dataclass(frozen=True)
class OutageError:
    """What happened in one outage.

    Attributes
    ----------
    start, stop : float
        [s]
    max_horizontal : float
        Largest horizontal error inside. [m]
    end_horizontal : float
        Horizontal error at the last reference epoch inside. [m]
    max_vertical : float
        [m]
    """

    start: float
    stop: float
    max_horizontal: float
    end_horizontal: float
    max_vertical: float


def outage_errors(errors: TrajectoryErrors, windows: Sequence[tuple[float, float]]) -> list[OutageError]:
    """Errors inside each outage; windows without a reference epoch are left out."""
    found = []
    horizontal, vertical = errors.horizontal, np.abs(errors.position_n[:, 2])
    for start, stop in windows:
        k = np.flatnonzero((errors.t >= start) & (errors.t <= stop))
        if len(k):
            h = horizontal[k]
            found.append(OutageError(start, stop, float(h.max()), float(h[-1]), float(vertical[k].max())))
    return found


def drift_curve(
    errors: TrajectoryErrors, windows: Sequence[tuple[float, float]], step: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Horizontal error against time since GNSS was lost, over all outages.

    Parameters
    ----------
    errors : TrajectoryErrors
    windows : sequence of (start, stop)
        [s]
    step : float
        Width of the time bins; the last one takes what is left of the longest outage. [s]

    Returns
    -------
    age : ndarray, shape (k,)
        End of each bin. [s]
    rms, largest : ndarray, shape (k,)
        Horizontal error in the bin over all outages, NaN where no reference epoch fell. [m]
    """
    longest = max((stop - start for start, stop in windows), default=0.0)
    age = np.arange(step, longest + 0.5 * step, step)
    total, count, largest = np.zeros(len(age)), np.zeros(len(age)), np.full(len(age), -np.inf)
    for start, stop in windows:
        k = (errors.t >= start) & (errors.t <= stop)
        bins = np.clip(np.ceil((errors.t[k] - start) / step).astype(int) - 1, 0, len(age) - 1)
        h = errors.horizontal[k]
        np.add.at(total, bins, h**2)
        np.add.at(count, bins, 1.0)
        np.maximum.at(largest, bins, h)
    seen = count > 0.0
    rms = np.full(len(age), np.nan)
    rms[seen] = np.sqrt(total[seen] / count[seen])
    return age, rms, np.where(seen, largest, np.nan)
