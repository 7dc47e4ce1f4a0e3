"""Outages of one run: largest errors, drift curve, and all of them laid over each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.evaluation.errors import drift_curve, outage_errors
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Bars, Figure, Item, Panel, line

if TYPE_CHECKING:
    from schuler.navigation.evaluation.outages import OutageStatistics

_FEWEST = 3  # outages that make a fan, and records in each


def statistics(subject: Subject) -> OutageStatistics | None:
    """Errors of the first solution by the age of the outage; None without a reference or with too few outages.

    The shortest outage limits the age; outages shorter than half of the longest are left out.
    Only the claimed variances are taken along, not their correlation.
    """
    from schuler.navigation.evaluation.outages import OutageStatistics

    windows = subject.result.outages
    role, result = subject.solutions[0]
    if role not in subject.errors or len(windows) < _FEWEST or not len(result.t):
        return None
    e, sigma = subject.errors[role], subject.position_sigma(result)
    longest = max(b - a for a, b in windows)
    kept = [
        (a, b)
        for a, b in windows
        if b - a >= 0.5 * longest and e.t[0] <= a and e.t[-1] >= b and result.t[0] <= a and result.t[-1] >= b
    ]
    if len(kept) < _FEWEST:
        return None
    step = float(np.median(np.diff(result.t))) if len(result.t) > 1 else 1.0
    # the last record inside an outage ends it: behind it the first fix has acted already
    length = min(b - a for a, b in kept) - step
    count = int(np.floor(length / step + 1e-6)) + 1
    if count < _FEWEST:
        return None
    age: FloatArray = np.asarray(step * np.arange(count), dtype=np.float64)
    errors = [_at(np.add(age, a), e.t, e.position_n) for a, _ in kept]
    variances = [_at(np.add(age, a), result.t, sigma) ** 2 for a, _ in kept]
    starts = np.array([a - subject.start for a, _ in kept])
    cov = np.stack(variances)[:, :, :, None] * np.eye(3)
    return OutageStatistics(np.array([age[-1]]), starts, age, np.stack(errors), cov, name=f"{role} solution")


def outage_figure(subject: Subject) -> Figure | None:
    """Largest horizontal error by outage and drift curve; None without outages or a reference."""
    outage_lists = {role: outage_errors(e, subject.result.outages) for role, e in subject.errors.items()}
    if not outage_lists or not next(iter(outage_lists.values())):
        return None
    bars: list[Item] = []
    drift: list[Item] = []
    n = len(next(iter(outage_lists.values())))
    several = n > 1
    for role, list_of in outage_lists.items():
        number = np.arange(1.0, len(list_of) + 1.0)
        bars.append(Bars(number, np.array([o.max_horizontal for o in list_of]), role, role))
        age, rms, largest = drift_curve(subject.errors[role], subject.result.outages)
        # a bin in which no reference epoch fell is bridged: the drift goes on meanwhile
        finite = np.isfinite(rms)
        drift.append(line(age[finite], rms[finite], role, f"{role}, RMS of all outages" if several else role))
        if several:
            dashed = "largest" if role == "filtered" else "largest_smoothed"
            drift.append(line(age[finite], largest[finite], dashed, f"{role}, largest"))
    first = subject.result.outages[0]
    panels = (
        Panel("number of the outage [-]", "largest horizontal error [m]", tuple(bars), x_limits=(0.25, n + 0.75)),
        Panel("time since GNSS was lost [s]", "horizontal error [m]", tuple(drift)),
    )
    caption = (
        "First the largest horizontal error in each outage, in order of time (number 1 begins at "
        f"{first[0] - subject.start:.0f} s), then how the error grows from the moment GNSS is lost."
    )
    return Figure("outages", "Outages", caption, panels, columns=2, linked=False, paper_columns=2)


def outage_fan(subject: Subject) -> Figure | None:
    """Fan of the errors of a run's outages; None where there are too few."""
    from schuler.navigation.evaluation.figures import fan

    outage_lists = statistics(subject)
    return None if outage_lists is None else fan(outage_lists)


def _at(t: FloatArray, nodes: FloatArray, values: FloatArray) -> FloatArray:
    return np.stack([np.interp(t, nodes, v) for v in values.T], axis=1)
