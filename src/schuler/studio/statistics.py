"""Mean, scatter and extremes of signals over a span of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.studio.signals import View


@dataclass(frozen=True)
class SpanStatistics:
    """One signal over a span.

    Attributes
    ----------
    panel, name : str
        As the signal is drawn; the panel has the unit of all values.
    samples : int
        Finite ones in the span.
    mean, minimum, maximum : float or None
        None without a sample.
    standard_deviation : float or None
        About the mean, divided by n - 1; None of fewer than two samples.
    """

    panel: str
    name: str
    samples: int
    mean: float | None
    standard_deviation: float | None
    minimum: float | None
    maximum: float | None


def span_statistics(seen: View, start: float, stop: float) -> list[SpanStatistics]:
    """Statistics of every signal from one time to another, of the samples at full rate, both ends included.

    Parameters
    ----------
    seen : View
    start, stop : float
        From the start of the recording. [s]
    """
    rows: list[SpanStatistics] = []
    for c in seen.channels:
        first, last = np.searchsorted(c.t, start, side="left"), np.searchsorted(c.t, stop, side="right")
        y = c.samples.y[first:last]
        y = y[np.isfinite(y)]
        if not len(y):
            rows.append(SpanStatistics(c.panel, c.name, 0, None, None, None, None))
            continue
        scatter = float(np.std(y, ddof=1)) if len(y) > 1 else None
        extremes = float(np.min(y)), float(np.max(y))
        rows.append(SpanStatistics(c.panel, c.name, len(y), float(np.mean(y)), scatter, *extremes))
    return rows
