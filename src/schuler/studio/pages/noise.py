"""Noise of an IMU: a span at rest chosen on the log, Allan curves with their bounds, the terms of a model."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from schuler.characterisation.exports.programs import EXPORTS
from schuler.exceptions import InputError, SchulerError
from schuler.sensors import catalogue
from schuler.studio import jobs, reading, runner
from schuler.studio.pages.frame import (
    block,
    button,
    chart,
    heading,
    hint,
    html,
    name_menu,
    place,
    problem,
    show,
)
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
from schuler.studio.signals import Views
from schuler.studio.workspace import Workspace, configurations, logs, new_run_name


class _Noise:
    """State of one open page."""

    def __init__(self, workspace: Workspace, views: Views, log: str, config: str) -> None:
        self.workspace, self.views, self.log, self.config = workspace, views, log, config
        self.span: tuple[float, float] | None = None
        self.exports: list[str] = []

    def arguments(self) -> list[str]:
        """Command of the identification."""
        if not self.log:
            raise InputError("choose a log first")
        out = new_run_name(self.workspace, self.log, "noise")
        return runner.allan_arguments(self.log, self.config, out, self.span, self.exports)


def noise_page(workspace: Workspace, views: Views, log: str, config: str) -> None:
    """Log and span on top, the command, and the report below."""
    state = _Noise(workspace, views, log, config)
    rest = _Rest(state, lambda: identification.forget(), lambda: identification.commanded())
    identification: _Identification = _Identification(state)
    ui.timer(0.05, rest.open, once=True)
    ui.timer(POLL_S, identification.panel.look)


class _Rest:
    """Log at rest, how it is read, and the span of it that is used.

    Parameters
    ----------
    state : _Noise
    left : callable
        Called when another log is chosen.
    changed : callable
        Called when the span or the reading has changed.
    """

    def __init__(self, state: _Noise, left: Callable[[], None], changed: Callable[[], None]) -> None:
        self._state, self._left, self._changed = state, left, changed
        files = ["", *configurations(state.workspace)]
        heading("Log at rest")
        with block("line"):
            name_menu("log", logs(state.workspace), state.log, self._choose_log).classes("grow")
            ui.select(
                files, value=state.config if state.config in files else "", label="read as this configuration says",
                on_change=lambda e: self._choose_config(e.value or ""),
            ).props('outlined dense aria-label="configuration"').classes("grow")  # fmt: skip
        self._hint = html("")
        self._signals = chart("timeline", without="Choose a log.", label="signals over time, the chosen span shaded")
        for kind in ("span", "moved"):
            self._signals.on(kind, self._dragged, js_handler="(e) => emit(e.detail)")
        with block("line"):
            hint("Drag over the span that is to be used; without one it is all of the log.").style("width: auto")
            button("all of it", lambda: self._choose_span(None))

    async def open(self) -> None:
        """Read the log as the configuration says, for its signals."""
        state = self._state
        state.span = None
        show(self._signals, source="", windows=[])
        if state.log:
            try:
                hints = reading.hints_of(state.workspace.inside(state.config) if state.config else None)
                seen = await asyncio.to_thread(state.views.open, state.workspace.inside(state.log), hints)
                if seen.channels:
                    show(self._signals, source=f"/studio/views/{seen.key}/signals")
                else:
                    self._hint.set_content(
                        '<p class="hint bad">This log does not say how it is read: do so under Look, save it as a '
                        "configuration, and choose that here.</p>"
                    )
            except (SchulerError, OSError) as error:
                problem(error)
        self._changed()

    async def _choose_log(self, name: str) -> None:
        self._state.log = name
        self._hint.set_content("")
        self._left()
        await self.open()

    async def _choose_config(self, name: str) -> None:
        self._state.config = name
        self._hint.set_content("")
        await self.open()

    def _choose_span(self, span: tuple[float, float] | None) -> None:
        self._state.span = span
        show(self._signals, windows=[] if span is None else [(*span, "outage")])
        self._changed()

    def _dragged(self, event: events.GenericEventArguments) -> None:
        start, stop = (round(float(x), 1) for x in event.args[-2:])  # of one that is moved its number comes first
        self._choose_span((max(start, 0.0), stop) if stop > max(start, 0.0) else None)


class _Identification:
    """The command, its job, and what came out.

    Parameters
    ----------
    state : _Noise
    """

    def __init__(self, state: _Noise) -> None:
        self._state = state
        heading("Identification")
        self._command = place()
        with block("line"):
            button("identify", lambda: self.panel.start(state.arguments), "main")
            self._exports = ui.select(
                {name: f"{name}: {one.description}" for name, one in EXPORTS.items() if name != "schuler"}, value=[],
                multiple=True, label="and write files for", on_change=lambda e: self._export(e.value),
            )  # fmt: skip
            self._exports.props("outlined dense use-chips").classes("grow")
        self.panel: JobPanel = JobPanel(
            state.workspace, place(), lambda: jobs.latest(state.workspace, "allan", state.log), self._ended
        )
        self._result = place()

    def commanded(self) -> None:
        """Show the command."""
        missing = "" if self._state.log else "Choose a log of an IMU at rest."
        show_command(self._command, self._state.arguments, missing)

    def forget(self) -> None:
        """Show nothing; the page is about another log."""
        self.panel.forget()
        self._result.clear()

    def _export(self, names: list[str]) -> None:
        self._state.exports = list(names)
        self._exports.run_method("hidePopup")
        self.commanded()

    def _ended(self, job: jobs.Job) -> None:
        self.commanded()  # with the next free name
        self._result.clear()
        with self._result:
            _curves(job, jobs.answer(self._state.workspace, job.key))


def _curves(job: jobs.Job, answer: dict[str, Any]) -> None:
    """Allan curve of an axis, with terms, lines and a data sheet; files; the report."""
    axes = [name for name, entry in answer["axes"].items() if not entry["refused"]]

    def draw() -> None:
        sheet_name = f"&sheet={quote(sheet.value)}" if sheet.value else ""
        show(curve, source=f"/studio/noise?key={quote(job.key)}&axis={quote(axis.value)}{sheet_name}")

    heading("Allan curve")
    with block("line"):
        axis = ui.select(axes, value=axes[0], label="axis", on_change=draw).props('outlined dense aria-label="axis"')
        axis.style("width: 9rem")
        sheet = ui.select(
            {"": "none", **{name: name for name in catalogue.names()}}, value="", label="beside the data sheet of",
            with_input=True, on_change=draw,
        )  # fmt: skip
        sheet.props('outlined dense aria-label="data sheet"').classes("grow")
    curve = chart("allan", label="Allan deviation over averaging time")
    hint("Switch terms of the model off and on; a line of a slope is dragged up and down, or its coefficient typed.")
    draw()
    folder = f"/studio/files/{quote(job.out)}"
    names = [Path(path).name for what, path in answer["files"].items() if what == "budget" or what in EXPORTS]
    links = ", ".join(f'<a href="{folder}/{quote(name)}" download>{escape(name)}</a>' for name in names)
    html(
        f'<p>{links}; <a href="{folder}/noise.html" target="_blank">open the report</a>, all in {escape(job.out)}</p>'
        f'<iframe class="report" title="noise report" src="{folder}/noise.html"></iframe>'
    )
