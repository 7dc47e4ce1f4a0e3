"""Noise of an IMU: a span at rest chosen on the log, Allan curves with their bounds, the terms of a model."""

from __future__ import annotations

import asyncio
from html import escape
from urllib.parse import quote

from nicegui import events, ui

from schuler.exceptions import InputError, SchulerError
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
        return runner.allan_arguments(state.log, state.config, out, state.span)

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
        place = f"/studio/files/{quote(job.out)}/noise.html"
        result.clear()
        with result:
            html(
                f'<p><a href="{place}" target="_blank">open the report</a>, in {escape(job.out)} with imu.toml</p>'
                f'<iframe class="report" title="noise report" src="{place}"></iframe>'
            )

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
    panel: JobPanel = JobPanel(
        workspace,
        place(),
        lambda: jobs.latest(workspace, "allan", state.log),
        identified,
    )
    result = place()
    ui.timer(0.05, opened, once=True)
    ui.timer(POLL_S, panel.look)
