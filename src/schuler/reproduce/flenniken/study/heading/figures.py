"""Figures of the heading filters."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np

from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Panel, Span
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.reproduce.flenniken.study.heading.growth import HeadingBound
    from schuler.reproduce.flenniken.study.heading.outages import HeadingOutages, PositionOutage
    from schuler.reproduce.flenniken.study.heading.runs import FilterRuns

_BANDS = {
    "constant, asleep": "sigma", "constant, walking": "expected", "Gauss-Markov": "sigma_smoothed",
    "both": "reference_band",
}  # fmt: skip
_ROLES = {
    "constant, asleep": "filtered", "constant, walking": "case_3", "Gauss-Markov": "smoothed", "both": "reference",
}  # fmt: skip


def bound_figure(bound: HeadingBound, others: Mapping[str, HeadingBound] | None = None) -> Figure:
    """1-sigma of heading with fixes and without (figures 4.1, 4.2 and, with another filter, 4.7 of the source)."""
    roles = ("case_3", "case_4", "case_5")
    items = (
        content.line(bound.t, bound.aided / DEG, "filtered", "with fixes"),
        *(
            content.line(other.t, other.aided / DEG, role, name)
            for (name, other), role in zip((others or {}).items(), roles, strict=False)
        ),
        content.line(bound.t, bound.free / DEG, "smoothed", "free integration"),
        content.level((bound.t[0], bound.t[-1]), bound.steady_posterior / DEG, "level", "steady"),
    )
    panel = Panel("time [s]", "1-sigma of heading [deg]", items, log=True)
    return Figure("heading_bound", "Heading with fixes and without", "", (panel,))


def outage_figure(outages: HeadingOutages, claimed: Collection[str] = ()) -> Figure:
    """RMS heading errors in the outage with two standard errors, a panel for each truth (figures 4.5 and 4.6).

    Parameters
    ----------
    outages : HeadingOutages
    claimed : collection of str
        Filters whose own 1-sigma is shown too.
    """
    panels, spread = [], 2.0 / np.sqrt(2.0 * outages.runs)
    for i, truth in enumerate(outages.truths):
        items: list[content.Item] = []
        for j, name in enumerate(outages.filters):
            rms = outages.rms[i, j] / DEG
            items.append(content.band(outages.t, rms * (1.0 - spread), rms * (1.0 + spread), _BANDS[name]))
            items.append(content.line(outages.t, rms, _ROLES[name], name))
            if name in claimed:
                items.append(content.line(outages.t, outages.sigma[j] / DEG, "level", f"{name}: 1-sigma it claims"))
        panels.append(Panel("time into the outage [s]", "RMS of heading [deg]", tuple(items), f"true bias: {truth}"))
    return Figure(
        "heading_outages", "Bias models in an outage", "Bands: two standard errors of an RMS.", tuple(panels), columns=3
    )


def recorded_figure(recorded: dict[str, tuple[FloatArray, FilterRuns]], start_s: float = 1800.0) -> Figure:
    """One log, several filters: heading error with its 1-sigma, bias estimate (figures 4.3, 4.4, 4.8 to 4.10)."""
    errors: list[content.Item] = []
    biases: list[content.Item] = []
    for name, (error, run) in recorded.items():
        claimed = run.sigma[:, 0] / DEG
        errors.append(content.band(run.t, -claimed, claimed, _BANDS[name]))
        errors.append(content.line(run.t, error / DEG, _ROLES[name], name))
        total = np.sum(run.estimate[:, 1:, 0], axis=1)
        biases.append(content.line(run.t, total / DEG, _ROLES[name], name))
    last = float(next(iter(recorded.values()))[1].t[-1])
    span = Span(start_s, last, "outage", "no fixes")
    panels = (
        Panel("time [s]", "heading error [deg]", (span, *errors)),
        Panel("time [s]", "bias estimate [deg/s]", (span, *biases)),
    )
    return Figure("heading_recorded", "One gyroscope in an outage", "", panels)


def position_figure(outage: PositionOutage) -> Figure:
    """RMS errors of the six-state filter with two standard errors, and what it claims."""
    t, spread = outage.run.t, 2.0 / np.sqrt(2.0 * outage.error.shape[2])
    span = Span(outage.start_s, float(t[-1]), "outage", "no fixes")
    panels = []
    for i, label in ((0, "velocity north [m/s]"), (2, "position north [m]")):
        rms = outage.rms[:, i]
        items = (
            span,
            content.band(t, rms * (1.0 - spread), rms * (1.0 + spread), "sigma", "RMS, two standard errors"),
            content.line(t, rms, "filtered", "RMS of runs"),
            content.line(t, outage.run.sigma[:, i], "reference", "1-sigma of the filter"),
        )
        panels.append(Panel("time [s]", label, items, log=True))
    return Figure("position_outage", "Six states in an outage", "", tuple(panels), columns=2)
