"""How a job stands: progress and cancel, or why there is nothing of it."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from nicegui import ui

from schuler.exceptions import printable
from schuler.studio import jobs
from schuler.studio.pages.frame import button, html
from schuler.studio.workspace import Workspace

_ENDED = {
    "killed": "its process was ended from outside; nothing half-written is left",
    "cancelled": "cancelled; nothing is left of it",
}


def job_box(workspace: Workspace, place: ui.element, job: jobs.Job, again: Callable[[jobs.Job], None]) -> None:
    """Show a job in a place; nothing of one that is done.

    Parameters
    ----------
    workspace : Workspace
    place : element
        Emptied first.
    job : Job
    again : callable
        Called with the job by the button that starts it again.
    """
    place.clear()
    with place:
        if job.state == "running":
            word = "working" if job.fraction > 0.0 else "reading and checking"
            html(
                f'<p class="hint">{escape(job.out)}: {word}</p><progress max="1" value="{job.fraction:.3f}" '
                f'aria-label="progress of the run"></progress>'
            )
            button("cancel", lambda: jobs.cancel(workspace, job.key))
        elif job.state != "done":
            words = printable(_ENDED.get(job.state, job.message))
            html(f'<p class="hint bad">{escape(job.out)}: {escape(job.state)}: {escape(words)}</p>')
            button("start again", lambda: again(job))
