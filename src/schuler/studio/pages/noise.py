"""Noise of an IMU: a span at rest chosen on the log, Allan curves with their bounds, the terms of a model."""

from __future__ import annotations

import asyncio
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
    command_box,
    heading,
    hint,
    html,
    name_menu,
    place,
    problem,
    show,
)
from schuler.studio.pages.job import POLL_S, JobPanel
from schuler.studio.signals import Views
from schuler.studio.workspace import Workspace, configurations, logs, new_run_name


class _Noise:
    """State of one open page."""

    def __init__(self, log: str, config: str) -> None:
        self.log, self.config = log, config
        self.span: tuple[float, float] | None = None
        self.exports: list[str] = []


def noise_page(workspace: Workspace, views: Views, log: str, config: str) -> None:
    """Log and span on top, the command, and the report below."""
    state = _Noise(log, config)

    async def opened() -> None:
        """Read the log as the configuration says, for its signals."""
        state.span = None
        show(signals, source="", windows=[])
        if state.log:
            try:
                hints = reading.hints_of(workspace.inside(state.config) if state.config else None)
                seen = await asyncio.to_thread(views.open, workspace.inside(state.log), hints)
                if seen.channels:
                    show(signals, source=f"/studio/views/{seen.key}/signals")
                else:
                    hint_of_reading.set_content(
                        '<p class="hint bad">This log does not say how it is read: do so under Look, save it as a '
                        "configuration, and choose that here.</p>"
                    )
            except (SchulerError, OSError) as error:
                problem(error)
        commanded()

    async def choose_log(name: str) -> None:
        state.log = name
        hint_of_reading.set_content("")
        panel.forget()
        result.clear()
        await opened()

    async def choose_config(name: str) -> None:
        state.config = name
        hint_of_reading.set_content("")
        await opened()

    def arguments() -> list[str]:
        if not state.log:
            raise InputError("choose a log first")
        out = new_run_name(workspace, state.log, "noise")
        return runner.allan_arguments(state.log, state.config, out, state.span, state.exports)

    def commanded() -> None:
        command.clear()
        with command:
            if state.log:
                command_box(runner.shell(arguments()))
            else:
                hint("Choose a log of an IMU at rest.")

    def dragged(event: events.GenericEventArguments) -> None:
        start, stop = (round(float(x), 1) for x in event.args[-2:])  # of one that is moved its number comes first
        chosen((max(start, 0.0), stop) if stop > max(start, 0.0) else None)

    def chosen(span: tuple[float, float] | None) -> None:
        state.span = span
        show(signals, windows=[] if span is None else [(*span, "outage")])
        commanded()

    def identified(job: jobs.Job) -> None:
        commanded()  # with the next free name
        result.clear()
        with result:
            _curves(job, jobs.answer(workspace, job.key))

    def export(names: list[str]) -> None:
        state.exports = list(names)
        exports.run_method("hidePopup")
        commanded()

    files = ["", *configurations(workspace)]
    heading("Log at rest")
    with block("line"):
        name_menu("log", logs(workspace), log, choose_log).classes("grow")
        ui.select(
            files, value=config if config in files else "", label="read as this configuration says",
            on_change=lambda e: choose_config(e.value or ""),
        ).props('outlined dense aria-label="configuration"').classes("grow")  # fmt: skip
    hint_of_reading = html("")
    signals = chart("timeline", without="Choose a log.", label="signals over time, the chosen span shaded")
    for kind in ("span", "moved"):
        signals.on(kind, dragged, js_handler="(e) => emit(e.detail)")
    with block("line"):
        hint("Drag over the span that is to be used; without one it is all of the log.").style("width: auto")
        button("all of it", lambda: chosen(None))
    heading("Identification")
    command = place()
    with block("line"):
        button("identify", lambda: panel.start(arguments), "main")
        exports = ui.select(
            {name: f"{name}: {one.description}" for name, one in EXPORTS.items() if name != "schuler"}, value=[],
            multiple=True, label="and write files for", on_change=lambda e: export(e.value),
        )  # fmt: skip
        exports.props("outlined dense use-chips").classes("grow")
    panel: JobPanel = JobPanel(
        workspace,
        place(),
        lambda: jobs.latest(workspace, "allan", state.log),
        identified,
    )
    result = place()
    ui.timer(0.05, opened, once=True)
    ui.timer(POLL_S, panel.look)


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
