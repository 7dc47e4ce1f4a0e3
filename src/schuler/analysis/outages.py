"""GNSS outages: where to put them, and how far the solution drifts in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler.analysis.errors import TrajectoryErrors
from schuler.arrays import FloatArray


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
    for start, stop in windows:
        e = errors.between(start, stop)
        if len(e.t):
            h = e.horizontal
            found.append(
                OutageError(start, stop, float(h.max()), float(h[-1]), float(np.abs(e.position_n[:, 2]).max()))
            )
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
        Width of the time bins. [s]

    Returns
    -------
    age : ndarray, shape (k,)
        End of each bin. [s]
    rms, largest : ndarray, shape (k,)
        Horizontal error in the bin over all outages, NaN where no reference epoch fell. [m]
    """
    longest = max((stop - start for start, stop in windows), default=0.0)
    age = np.arange(step, longest + 0.5 * step, step)
    squares: list[list[float]] = [[] for _ in age]
    for start, stop in windows:
        e = errors.between(start, stop)
        bins = np.ceil((e.t - start) / step).astype(int) - 1
        for b, h in zip(np.clip(bins, 0, len(age) - 1), e.horizontal, strict=True):
            squares[b].append(h**2)
    rms = np.array([np.sqrt(np.mean(s)) if s else np.nan for s in squares])
    largest = np.array([np.sqrt(np.max(s)) if s else np.nan for s in squares])
    return age, rms, largest
