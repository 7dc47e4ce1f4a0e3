"""Runs of the folder: verdict and numbers, report, comparison of two, removal."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from functools import partial
from html import escape
from urllib.parse import quote

from nicegui import ui

from schuler.exceptions import InputError
from schuler.studio import jobs
from schuler.studio.pages.frame import block, button, command_box, heading, hint, html, place, problem
from schuler.studio.workspace import RunEntry, Workspace, delete_run, runs

_POLL_S = 0.5
_NUMBERS = (
    ("rms_horizontal_m", "horizontal RMS [m]"), ("max_horizontal_m", "largest [m]"), ("nis_mean", "mean NIS"),
    ("nees_mean", "mean NEES"),
)  # fmt: skip


def runs_page(workspace: Workspace) -> None:
    """Table of runs, and what can be done with one or two of them."""
    chosen: list[str] = []
    heading("Runs in this folder, the latest first")
    with block("line"):
        words = ui.input("filter: words of name, log, verdict", on_change=lambda: refresh())
        words.props('outlined dense clearable debounce=200 aria-label="filter"').classes("grow")
    listing = place()
    heading("Two runs against each other")
    comparison = place()

    def refresh() -> None:
        listing.clear()
        listed = runs(workspace)
        chosen[:] = [name for name in chosen if any(run.name == name for run in listed)]
        with listing:
            if not listed:
                hint("None yet: Navigate makes one, and so does schuler navigate --out FOLDER in this folder.")
            matching = [run for run in listed if matches(run, words.value or "")]
            if listed and not matching:
                hint(f"None of the {len(listed)} runs has all of these words.")
            for run in matching:
                _row(run, chosen, compared, partial(_ask, workspace, run.name, refresh))
        compared()

    def compared() -> None:
        comparison.clear()
        with comparison:
            if len(chosen) == 2:
                _compare(workspace, chosen, compared)
            else:
                hint("Choose two of the list: the second is compared with the first.")

    refresh()


def matches(run: RunEntry, words: str) -> bool:
    """Whether a run has all of these words in its name, the name of its log or its verdict."""
    text = f"{run.name} {run.document.get('log', '')} {run.status}".lower()
    return all(word in text for word in words.lower().split())


def _row(run: RunEntry, chosen: list[str], compared: Callable[[], None], ask: Callable[[], None]) -> None:
    """A run with its verdict and files; it can be chosen for a comparison, and deleted."""

    def choose(on: bool) -> None:
        if on and run.name not in chosen:
            chosen.append(run.name)
        elif not on and run.name in chosen:
            chosen.remove(run.name)
        compared()

    with block("finding " + {"failed": "error", "doubtful": "warning"}.get(run.status, "")):
        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(run.changed))
        log, name, status = str(run.document.get("log", "")).rpartition("/")[2], escape(run.name), escape(run.status)
        html(
            f'<p><b>{name}</b> <span class="status-{status}">{status}</span> '
            f'<span class="hint">{escape(log)}, {when}</span></p><p>{_sentence(run)}</p>'
        )
        with block("line"):
            ui.checkbox("compare", value=run.name in chosen, on_change=lambda e: choose(e.value)).props(
                f'aria-label="compare {name}"'
            )
            files = {"report": "report.html"} if "report.html" in run.files else {}
            for text, file in {**files, "metrics.json": "metrics.json"}.items():
                html(f'<a href="/studio/files/{quote(run.name)}/{file}" target="_blank">{text}</a>').style(
                    "width: auto"
                )
            button("delete", ask, "grave").props(f'aria-label="delete {name}"')


def _ask(workspace: Workspace, name: str, deleted: Callable[[], None]) -> None:
    """Ask whether a run is to be deleted, and delete it."""

    def delete() -> None:
        dialog.close()
        try:
            delete_run(workspace, name)
        except InputError as error:
            problem(error)
        deleted()

    with ui.dialog() as dialog, ui.card():
        html(f"<p>Delete <b>{escape(name)}</b> and all its files? This cannot be undone.</p>")
        with block("line"):
            button("keep", dialog.close)
            button("delete", delete, "grave")
    dialog.open()


def _compare(workspace: Workspace, names: list[str], compared: Callable[[], None]) -> None:
    """Command that compares two runs, its page if there is one, else a button that starts it."""
    out = f"{'-'.join(name.replace('/', '_') for name in names)}-comparison"
    arguments = ["compare", *names, "--out", out]
    command_box(shlex.join(["schuler", *arguments]))
    if (workspace.root / out / "runs.html").is_file():
        html(f'<p><a href="/studio/files/{quote(out)}/runs.html" target="_blank">open the comparison</a></p>')
        html(f'<iframe class="report" title="comparison" src="/studio/files/{quote(out)}/runs.html"></iframe>')
        return
    state = hint("")

    def begin() -> None:
        try:
            job = jobs.start(workspace, [*arguments, "--json"], out)
        except InputError as error:
            problem(error)
            return

        def look() -> None:
            current = jobs.job(workspace, job.key)
            if current is None or current.state == "running":
                state.set_content('<p class="hint">comparing ...</p>')
                return
            timer.cancel()
            if current.state == "done":
                compared()
            else:
                state.set_content(f'<p class="hint bad">{escape(current.state)}: {escape(current.message)}</p>')

        timer = ui.timer(_POLL_S, look)

    button("compare", begin, "main")


def _sentence(run: RunEntry) -> str:
    """The numbers that people ask for first."""
    parts = [
        f"{label} {run.metrics[key]:.4g}" for key, label in _NUMBERS if isinstance(run.metrics.get(key), (int, float))
    ]
    outages = run.metrics.get("outages") or []
    worst = [o.get("max_horizontal_m") for o in outages if isinstance(o, dict)]
    if any(isinstance(w, (int, float)) for w in worst):
        parts.append(f"{len(worst)} without GNSS, worst {max(w for w in worst if w is not None):.4g} m")
    return escape(", ".join(parts) or "no reference to compare with")
