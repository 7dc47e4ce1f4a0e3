"""Figures and HTML page of navigation campaigns: scatter of the runs against the filter's own sigmas."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.files import write_text
from schuler.montecarlo.error_scatter import COMPONENTS, Scatter
from schuler.montecarlo.job import NavigationJob
from schuler.montecarlo.result import Campaign
from schuler.plotting import parts
from schuler.plotting.figure import Band, Figure, Item, Line, Panel, Span, level, view
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import ResultTable, shown


def all_figures(scatter: Scatter) -> list[Figure]:
    """Horizontal error, the nine errors, and normalised errors."""
    return [horizontal_figure(scatter), scatter_figure(scatter), nees_figure(scatter)]


def scatter_figure(s: Scatter) -> Figure:
    """Sigma of the runs with its 95 % interval, the filter's sigma, and the mean error."""
    panels = []
    # position first: it is what people ask for
    for i in (6, 7, 8, 3, 4, 5, 0, 1, 2):
        name, unit, size = COMPONENTS[i]
        items: tuple[Item, ...] = (
            *_outages(s),
            Band(s.t, s.low[:, i] / size, s.high[:, i] / size, "sigma", "95 % interval of the runs' sigma"),
            Line(s.t, s.sigma[:, i] / size, "filtered", "sigma of the runs"),
            Line(s.t, s.claimed[:, i] / size, "model", "sigma of the filter"),
            Line(s.t, s.mean[:, i] / size, "mean", "mean error"),
        )
        panels.append(Panel("time [s]", f"{name} [{unit}]", items))
    caption = (
        f"{s.runs} runs. Where the filter is honest, its sigma lies in the interval of the runs' sigma 95 % of the "
        "time, and the mean error is near zero."
    )
    return Figure("scatter", "Scatter of the runs against the filter's sigma", caption, tuple(panels), columns=3)


def horizontal_figure(s: Scatter) -> Figure:
    """Distance to the truth: 50, 68 and 95 % of the runs, and what the filter claims."""
    claimed = np.hypot(s.claimed[:, 6], s.claimed[:, 7])
    rms = np.hypot(s.rms[:, 6], s.rms[:, 7])
    items: tuple[Item, ...] = (
        *_outages(s),
        Band(s.t, np.zeros_like(s.t), s.horizontal[:, 2], "sigma", "95 % of the runs"),
        Line(s.t, s.horizontal[:, 0], "term", "50 % of the runs"),
        Line(s.t, rms, "filtered", "RMS of the runs"),
        Line(s.t, claimed, "model", "RMS as claimed by the filter"),
    )
    panel = Panel("time [s]", "horizontal error [m]", items)
    caption = f"Horizontal error of {s.runs} runs. Shaded times are without GNSS."
    return Figure("horizontal", "Horizontal error", caption, (panel,))


def nees_figure(s: Scatter) -> Figure:
    """Mean normalised error squared with its band."""
    n = s.nees
    ends = (float(s.t[0]), float(s.t[-1]))
    low, high = np.full_like(s.t, n.low), np.full_like(s.t, n.high)
    items: tuple[Item, ...] = (
        *_outages(s),
        Band(s.t, low, high, "expected", f"{100.0 * n.probability:.0f} % band of an honest filter"),
        Line(s.t, n.mean, "filtered", "mean over the runs"),
        level(ends, 1.0, "level", "honest"),
    )
    panel = Panel("time [s]", "NEES per degree of freedom [-]", items, y_limits=view([n.mean, low, high]))
    caption = "Above the band the filter claims to be better than it is, below it is better than it claims."
    return Figure("nees", "Normalised errors", caption, (panel,))


def _outages(s: Scatter) -> list[Item]:
    return [Span(a, b, "outage", "no GNSS" if k == 0 else "") for k, (a, b) in enumerate(s.outages)]


_CONVENTIONS = (
    "Conventions: errors are estimate minus truth, axes north, east, down; attitude errors are rotations about them. "
    "Sigmas are about the mean of the runs, intervals 95 % for normal errors."
)
_FEW = 20  # failures that are listed


def montecarlo_report(scatter: Scatter, campaign: Campaign, job: NavigationJob, path: Path | str) -> Path:
    """Write the report of a campaign.

    Parameters
    ----------
    scatter : Scatter
    campaign : Campaign
    job : NavigationJob
    path : Path or str
        The HTML file.

    Returns
    -------
    Path
        The file; the same bytes for the same runs, however they were done.
    """
    horizontal, scattered, nees = all_figures(scatter)
    last = scatter.horizontal[-1]
    sentences = [
        f"At the end, {scatter.t[-1]:.0f} s, half of the runs are within {last[0]:.3g} m horizontally, 95 % within "
        f"{last[2]:.3g} m.",
        scatter.verdict,
    ]
    if campaign.failures:
        sentences.append(f"{len(campaign.failures)} of {campaign.done} runs could not be done; see below.")
    failures = [(f"run {k}", why) for k, why in list(campaign.failures.items())[:_FEW]]
    provenance = {"function": campaign.function, "seed": campaign.seed, "runs": campaign.done, **job.fingerprint()}
    sections = [
        Section("horizontal", "Horizontal error", (horizontal, _html(scatter.tenths()))),
        Section("errors", "All errors", (scattered, _html(scatter.table()))),
        Section("nees", "Is the filter as good as it says?", (nees,)),
        Section(
            "failures",
            "Runs that could not be done",
            (parts.table("The first ones", ("run", "why"), failures, numbers=False) if failures else "",),
        ),
        Section(
            "provenance",
            "Provenance",
            (
                parts.table(
                    "What the runs are made from", ("entry", "value"), parts.provenance_rows(provenance), numbers=False
                ),
            ),
        ),
    ]
    text = whole_page(
        scatter.name, "Monte Carlo report", f"Monte Carlo report of {scatter.runs} runs", sentences, _CONVENTIONS,
        sections, plotly_script(),
    )  # fmt: skip
    return write_text(path, text)


def _html(table: ResultTable) -> str:
    rows = [[shown(v) for v in row] for row in table.rows]
    return parts.table(". ".join((table.title, *table.notes)), table.columns, rows)
