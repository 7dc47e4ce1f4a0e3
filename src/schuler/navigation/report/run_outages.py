"""The outages of one run laid over each other: a fan of their errors with what the filter claimed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Figure

if TYPE_CHECKING:
    from schuler.navigation.evaluation.outage_statistics import OutageStatistics

_FEWEST = 3  # outages that make a fan, and records in each


def statistics(subject: Subject) -> OutageStatistics | None:
    """Errors of the first solution by the age of the outage; None without a reference or with too few outages.

    Of outages of several lengths the shortest says how far it goes; shorter than half of the longest ones are left out.
    Only the claimed variances are taken along, not their correlation.
    """
    from schuler.navigation.evaluation.outage_statistics import OutageStatistics

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


def outage_fan(subject: Subject) -> Figure | None:
    """Fan of the errors of a run's outages; None where there are too few."""
    from schuler.navigation.evaluation.figures import fan

    found = statistics(subject)
    return None if found is None else fan(found)


def _at(t: FloatArray, nodes: FloatArray, values: FloatArray) -> FloatArray:
    return np.stack([np.interp(t, nodes, v) for v in values.T], axis=1)
