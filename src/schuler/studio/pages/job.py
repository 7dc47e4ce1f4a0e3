"""The job of a page: started, watched with progress and cancel, started again where there is nothing of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

from nicegui import ui

from schuler.exceptions import SchulerError, printable
from schuler.studio import jobs, runner
from schuler.studio.pages.frame import button, command_box, hint, html, problem
from schuler.studio.workspace import Workspace

POLL_S = 0.4
_ENDED = {"killed": "its process was ended from outside", "cancelled": "cancelled"}


@dataclass
class JobPanel:
    """What an open page shows of its job.

    Attributes
    ----------
    workspace : Workspace
    place : element
        Where progress, or why there is no result, is shown.
    latest : callable
        The job that a page that was just opened finds, None if there is none.
    ended : callable
        Called with the job when it is done.
    key : str
        Of the job that is watched; empty: the latest.
    left : str
        What there is of a job that did not end by itself.
    """

    workspace: Workspace
    place: ui.element
    latest: Callable[[], jobs.Job | None]
    ended: Callable[[jobs.Job], None]
    key: str = ""
    left: str = "nothing half-written is left"
    _shown: jobs.Job | None = None

    def start(self, arguments: Callable[[], Sequence[str]]) -> None:
        """Run a command that writes the folder behind ``--out``; say why if it cannot be put together."""
        try:
            words = arguments()
            self.key = jobs.start(self.workspace, [*words, "--json"], words[words.index("--out") + 1]).key
        except (SchulerError, OSError) as error:
            problem(error)
        self.look()

    def look(self) -> jobs.Job | None:
        """Show how the job stands, and return it, if that has changed; one of a page that was closed is found too."""
        job = jobs.job(self.workspace, self.key) if self.key else self.latest()
        if job is None or job == self._shown:
            return None
        self._shown, self.key = job, job.key
        self._draw(job)
        if job.state == "done":
            self.ended(job)
        return job

    def forget(self) -> None:
        """Watch the latest job from now on; the page is about something else."""
        self.key, self._shown = "", None
        self.place.clear()

    def _again(self, job: jobs.Job) -> None:
        try:
            self.key = jobs.start(self.workspace, job.command, job.out).key
        except SchulerError as error:
            problem(error)
        self.look()

    def _draw(self, job: jobs.Job) -> None:
        self.place.clear()
        with self.place:
            if job.state == "running":
                word = f"working, {remaining(job, time.time())}" if job.fraction > 0.0 else "reading and checking"
                html(
                    f'<p class="hint">{escape(job.out)}: {word}</p><progress max="1" value="{job.fraction:.3f}" '
                    f'aria-label="progress of the run"></progress>'
                )
                button("cancel", lambda: jobs.cancel(self.workspace, job.key))
            elif job.state != "done":
                words = f"{_ENDED[job.state]}; {self.left}" if job.state in _ENDED else printable(job.message)
                html(f'<p class="hint bad">{escape(job.out)}: {escape(job.state)}: {escape(words)}</p>')
                button("start again", lambda: self._again(job))


def show_command(place: ui.element, arguments: Callable[[], Sequence[str]], missing: str = "") -> None:
    """Show the command that does what a page does; else what is missing, or what is wrong with its form."""
    place.clear()
    with place:
        if missing:
            hint(missing)
            return
        try:
            command_box(runner.shell(arguments()))
        except (SchulerError, OSError) as error:
            hint(printable(str(error)), bad=True)


def remaining(job: jobs.Job, now: float) -> str:
    """Time until a job ends at the pace so far, in words.

    Parameters
    ----------
    job : Job
        One that runs, a part of its work done.
    now : float
        Unix time. [s]
    """
    seconds = max(now - job.started, 0.0) * (1.0 - job.fraction) / job.fraction
    return f"about {seconds:.0f} s to go" if seconds < 90.0 else f"about {seconds / 60.0:.0f} min to go"
