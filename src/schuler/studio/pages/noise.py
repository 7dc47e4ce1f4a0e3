"""Noise of an IMU: a span at rest chosen on the log, Allan curves with their bounds, the terms of a model."""

from __future__ import annotations

import asyncio
from html import escape
from urllib.parse import quote

from nicegui import events, ui

from schuler.exceptions import InputError, SchulerError
from schuler.studio import jobs, reading, runner
from schuler.studio.pages.frame import block, button, chart, command_box, heading, hint, html, problem, show
from schuler.studio.pages.job import job_box
from schuler.studio.signals import Views
from schuler.studio.workspace import Workspace, configurations, logs, new_run_name

_POLL_S = 0.4


class _Noise:
    """State of one open page."""

    def __init__(self, log: str, config: str) -> None:
        self.log, self.config = log, config
        self.span: tuple[float, float] | None = None
        self.job = ""
        self.shown: jobs.Job | None = None


def noise_page(workspace: Workspace, views: Views, log: str, config: str) -> None:
    """Log and span on top, the command, and the report below."""
    state = _Noise(log, config)

    async def opened() -> None:
        """Read the log as the configuration says, for its signals."""
        state.span = None
        show(signals, source="", outages=[])
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
        state.log, state.job, state.shown = name, "", None
        hint_of_reading.set_content("")
        progress.clear()
        result.clear()
        await opened()

    async def choose_config(name: str) -> None:
        state.config = name
        hint_of_reading.set_content("")
        await opened()

    def arguments() -> list[str]:
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
        start, stop = (round(float(x), 1) for x in event.args)
        chosen((max(start, 0.0), stop) if stop > max(start, 0.0) else None)

    def chosen(span: tuple[float, float] | None) -> None:
        state.span = span
        show(signals, outages=[] if span is None else [span])
        commanded()

    def begin() -> None:
        try:
            if not state.log:
                raise InputError("choose a log first")
            words = arguments()
            state.job = jobs.start(workspace, [*words, "--json"], words[words.index("--out") + 1]).key
        except (SchulerError, OSError) as error:
            problem(error)
        look()

    def again(job: jobs.Job) -> None:
        try:
            state.job = jobs.start(workspace, job.command, job.out).key
        except InputError as error:
            problem(error)
        look()

    def look() -> None:
        """Say how the last identification of the log stands, and show its report."""
        job = jobs.job(workspace, state.job) if state.job else jobs.latest(workspace, "allan", state.log)
        if job is None or job == state.shown:
            return
        state.shown, state.job = job, job.key
        job_box(workspace, progress, job, again)
        result.clear()
        if job.state == "done":
            commanded()  # with the next free name
            place = f"/studio/files/{quote(job.out)}/noise.html"
            with result:
                html(
                    f'<p><a href="{place}" target="_blank">open the report</a>, in {escape(job.out)} with imu.toml</p>'
                    f'<iframe class="report" title="noise report" src="{place}"></iframe>'
                )

    log_names, files = logs(workspace), ["", *configurations(workspace)]
    heading("Log at rest")
    with block("line"):
        ui.select(
            log_names, value=log if log in log_names else None, label="log", with_input=True,
            on_change=lambda e: choose_log(e.value or ""),
        ).props('outlined dense aria-label="log"').classes("grow")  # fmt: skip
        ui.select(
            files, value=config if config in files else "", label="read as this configuration says",
            on_change=lambda e: choose_config(e.value or ""),
        ).props('outlined dense aria-label="configuration"').classes("grow")  # fmt: skip
    hint_of_reading = html("")
    signals = chart("timeline", without="Choose a log.", label="signals over time, the chosen span shaded")
    signals.on("span", dragged, js_handler="(e) => emit(e.detail)")
    with block("line"):
        hint("Drag over the span that is to be used; without one it is all of the log.").style("width: auto")
        button("all of it", lambda: chosen(None))
    heading("Identification")
    command = ui.element("div").style("width: 100%")
    with block("line"):
        button("identify", begin, "main")
    progress = ui.element("div").style("width: 100%")
    result = ui.element("div").style("width: 100%")
    ui.timer(0.05, opened, once=True)
    ui.timer(_POLL_S, look)
