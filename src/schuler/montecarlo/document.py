"""One self-contained HTML page on a navigation campaign."""

from __future__ import annotations

from pathlib import Path

from schuler.files import write_text
from schuler.montecarlo import figures as montecarlo_figures
from schuler.montecarlo.error_scatter import Scatter
from schuler.montecarlo.job import NavigationJob
from schuler.montecarlo.result import Campaign
from schuler.plotting import parts
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import ResultTable, shown

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

    Raises
    ------
    MissingExtraError
        If plotly is not installed (extra ``report``).
    """
    horizontal, scattered, nees = montecarlo_figures.all_figures(scatter)
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
