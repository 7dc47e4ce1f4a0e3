"""What came out of a run or a calibration: verdict first, then the numbers, then where everything lies."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import ui

from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.result.summary import headline, rows, verdicts
from schuler.exceptions import printable
from schuler.studio import jobs
from schuler.studio.pages.frame import chart, fold, hint, html, show, table
from schuler.studio.workspace import RunEntry, Workspace

_NUMBERS = (
    "rms_horizontal_m", "max_horizontal_m", "rms_horizontal_aided_m", "mean_outage_max_horizontal_m", "rms_vertical_m",
    "rms_velocity_horizontal_m_s", "rms_heading_deg", "rms_tilt_deg", "nees_mean", "nis_mean",
)  # fmt: skip
_STATUS = {"ok": "ok", "warning": "doubtful", "refused": "failed"}
_FILES = ("calibration", "report", "certificate")
_FIGURES = {"residuals": "residuals", "correlations": "correlations of the parameters"}


def show_calibration(
    workspace: Workspace, job: jobs.Job, rests: Callable[[CalibrationResult], None] | None = None
) -> None:
    """Verdict and advice of a calibration, its rests, figures and parameters, links to its files.

    Parameters
    ----------
    workspace : Workspace
    job : Job
        One that has ended; of a log that was refused there is the verdict alone.
    rests : callable, optional
        Draws the table of the rests.
    """
    answer = jobs.answer(workspace, job.key)
    files = [Path(answer["files"][what]).name for what in _FILES if what in answer["files"]]
    link = f"/studio/files/{quote(job.out)}"
    links = " · ".join(f'<a href="{link}/{quote(name)}" target="_blank">{escape(name)}</a>' for name in files)
    refused = answer["status"] == "refused"  # then what lies in the folder is of an earlier fit
    result = None if refused else CalibrationResult.from_yaml(workspace.inside(job.out) / "calibration.yaml")
    title = f"{answer['method']} calibration: refused" if result is None else headline(result)
    sentences = answer["verdicts"] if result is None else verdicts(result)
    words = "".join(f"<p>{escape(printable(text))}</p>" for text in sentences)
    html(
        f'<section class="verdict {_STATUS[answer["status"]]}" aria-label="Verdict"><p><b>{escape(job.out)}: '
        f"{escape(title)}</b></p>{words or '<p>Nothing speaks against it.</p>'}</section><p>{links}</p>"
    )
    if result is None:
        return
    if rests is not None:
        with fold("rests", opened=True):
            rests(result)
    source = f"?run={quote(job.out)}&key={quote(job.key)}"
    with fold("directions", opened=True):
        label = "directions of rests and turns in body axes, on a sphere"
        show(chart("sphere", without="nothing to show", label=label), source=f"/studio/calibrations/sphere{source}")
        hint(
            "Dots: which way was up in each rest; rings: at the end of each turn. Drag the sphere or use the arrow "
            "keys; point at one for what the fit leaves of it."
        )
    for name, label in _FIGURES.items():
        with fold(label, opened=True):
            element = chart("figure", without="nothing to show", label=label)
            show(element, source=f"/studio/calibrations/{name}{source}")
    with fold("parameters"):
        cells = [(name, value, spread, unit) for name, value, spread, unit, *_ in rows(result)]
        table(("", "value", "1 sigma", "unit"), cells, "data-sheet units")


def show_outcome(place: ui.element, entry: RunEntry | None, other: RunEntry | None = None) -> None:
    """Verdict first, then numbers, the report and where everything lies; beside them the numbers of another run."""
    place.clear()
    with place:
        if entry is None:
            hint("the folder of this run was removed")
            return
        verdict = entry.metrics.get("verdict", {})
        reasons = [*verdict.get("reasons", []), *(f"likely: {c}" for c in verdict.get("causes", [])[:1])]
        sentences = "".join(f"<p>{escape(str(r))}</p>" for r in reasons) or "<p>Nothing contradicts the claims.</p>"
        html(
            f'<section class="verdict {escape(entry.status)}" aria-label="Verdict"><p><b>{escape(entry.name)}: '
            f"{escape(entry.status)}</b></p>{sentences}</section>"
        )
        smoothed = entry.metrics.get("smoothed") or {}
        rows: list[tuple[Any, ...]] = [
            (name, entry.metrics.get(name), smoothed.get(name))
            for name in _NUMBERS
            if entry.metrics.get(name) is not None or smoothed.get(name) is not None
        ]
        heads: tuple[str, ...] = ("", "filtered", "smoothed")
        if other is not None:
            beside = other.metrics.get("smoothed") or {}
            rows = [(*row, other.metrics.get(row[0]), beside.get(row[0])) for row in rows]
            heads += (f"{other.name}: filtered", f"{other.name}: smoothed")
        table(heads, rows, f"against {entry.metrics.get('reference')}")
        after = {o.get("start_s"): o for o in smoothed.get("outages") or []}
        keys = ("start_s", "stop_s", "max_horizontal_m", "end_horizontal_m")
        outages = [
            (*(outage.get(key) for key in keys), after.get(outage.get("start_s"), {}).get("max_horizontal_m"))
            for outage in entry.metrics.get("outages") or []
        ]
        if outages:
            table((*keys, "smoothed: max_horizontal_m"), outages, "without GNSS")
        link = f"/studio/files/{quote(entry.name)}"
        names = [name for name in ("report.html", "metrics.json", "resolved.toml") if name in entry.files]
        links = " · ".join(f'<a href="{link}/{name}" target="_blank">{name}</a>' for name in names)
        notes = "".join(f'<p class="hint">{escape(str(note))}</p>' for note in entry.metrics.get("notes") or [])
        html(f"<p>{links}</p><details><summary>notes of the run</summary>{notes}</details>")
        if "report.html" in entry.files:
            with fold("errors, innovations, parameters with their sigmas: the report"):
                html(f'<iframe class="report" title="report" loading="lazy" src="{link}/report.html"></iframe>')
