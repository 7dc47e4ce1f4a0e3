"""Navigate a log: configuration as a form, outages on the timeline, a run in its own process, what came out."""

from __future__ import annotations

import asyncio
from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from schuler.exceptions import InputError, SchulerError, printable
from schuler.files import write_text
from schuler.proposal import UndecidedError, propose
from schuler.studio import form, jobs, reading, runner
from schuler.studio.pages.entries import entry_fields
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
    question_box,
    show,
)
from schuler.studio.pages.job import POLL_S, JobPanel
from schuler.studio.pages.outcome import show_outcome
from schuler.studio.signals import View, Views
from schuler.studio.workspace import Workspace, configurations, logs, new_configuration_name, new_run_name, run_entry


class _Navigate:
    """State of one open page; what is worth keeping is a file."""

    def __init__(self, workspace: Workspace, views: Views, log: str, config: str) -> None:
        self.workspace, self.views = workspace, views
        self.log, self.config, self.imu = log, config, ""
        self.data: dict[str, Any] = {}
        self.checksum = ""
        self.texts: dict[str, str] = {}
        self.outages: list[tuple[float, float]] = []
        self.view: View | None = None
        self.answers: dict[str, Any] = {}
        self.out = ""

    def changes(self) -> dict[str, Any]:
        """Entries of the form that the file has otherwise."""
        return form.changes(self.data, self.texts)

    def arguments(self) -> list[str]:
        """Command of the run, its entries checked."""
        if not (self.log and self.config):
            raise InputError("choose a log and a configuration first")
        runner.checked(self.workspace, self.config, self.changes())
        out = new_run_name(self.workspace, self.log)
        return runner.navigate_arguments(self.log, self.config, out, self.changes(), self.outages)


def navigate_page(workspace: Workspace, views: Views, log: str, config: str) -> None:
    """Log, configuration and form on the left; timeline, run and result on the right."""
    state = _Navigate(workspace, views, log, config)
    if not log and not config and (last := jobs.latest(workspace, "navigate")) is not None:
        state.log, state.config, state.outages = runner.origin_of(last.command)  # a page that was closed, say
        log, config = state.log, state.config

    async def opened() -> None:
        """Read the log as the configuration says, for the timeline and the map."""
        show(timeline, source="")
        show(plan, source="")
        state.view = None
        if state.log:
            try:
                path = workspace.inside(state.log)
                hints = {**state.data.get(reading.SECTION, {})}
                state.view = await asyncio.to_thread(views.open, path, hints)
            except (SchulerError, OSError) as error:
                problem(error)
        if state.view is not None and state.view.channels:
            show(timeline, source=f"/studio/views/{state.view.key}/signals?only=speed", windows=shaded())
        drawn_plan()
        commanded()

    async def loaded() -> None:
        """Read the configuration; entries that were changed in the form and not saved are dropped."""
        state.data, state.checksum, state.texts = {}, "", {}
        if state.config:
            try:
                state.data, state.checksum = runner.data_of(workspace, state.config)
            except SchulerError as error:
                problem(error)
        entries.refresh()
        await opened()
        outaged()

    async def choose_log(name: str) -> None:
        state.log, state.answers, state.out = name, {}, ""
        panel.forget()
        result.clear()
        await opened()

    async def choose_config(name: str) -> None:
        state.config = name
        await loaded()

    async def proposed() -> None:
        """Propose a configuration, as ``schuler init`` does, and write it."""
        if not state.log:
            ui.notify("choose a log first")
            return
        asked.clear()
        note.set_content('<p class="hint">trying what the log shows: clock, mount, aids ...</p>')
        given, imu = runner.proposal_of(state.data.get(reading.SECTION, {}), state.imu)
        try:
            made = await asyncio.to_thread(propose, workspace.inside(state.log), imu=imu, given=given | state.answers)
            name = new_configuration_name(workspace)
            write_text(workspace.inside(name), made.toml(), at_once=True)
        except UndecidedError as question:
            note.set_content("")
            with asked:
                question_box(question, answer)
            return
        except (SchulerError, OSError) as error:
            note.set_content("")
            problem(error)
            return
        note.set_content(f'<p class="hint">proposed and written: {escape(name)}, each entry with its evidence</p>')
        configs.set_options(configurations(workspace))
        configs.set_value(name)

    async def answer(answers: dict[str, Any]) -> None:
        state.answers |= answers
        await proposed()

    def save() -> None:
        try:
            state.checksum = runner.saved(workspace, state.config, state.changes(), state.checksum)
            state.data, state.checksum = runner.data_of(workspace, state.config)
        except (SchulerError, OSError) as error:
            problem(error)
            return
        state.texts = {}
        entries.refresh()
        commanded()
        ui.notify(f"written: {state.config}")

    def commanded() -> None:
        """Show the command, or what is wrong with the form."""
        command.clear()
        with command:
            if not (state.log and state.config):
                hint("Choose a log and a configuration, or let one be proposed.")
                return
            try:
                command_box(runner.shell(state.arguments()))
            except (SchulerError, OSError) as error:
                hint(printable(str(error)), bad=True)

    def navigated(job: jobs.Job) -> None:
        state.out = job.out
        drawn_plan()
        show_outcome(result, run_entry(workspace, job.out))
        commanded()  # with the next free name

    def drawn_plan() -> None:
        view = "" if state.view is None else f"view={state.view.key}"
        out = f"run={quote(state.out)}" if state.out else ""
        source = "&".join(part for part in (view, out) if part)
        show(plan, source=f"/studio/track?{source}" if source else "", windows=shaded())

    def outaged() -> None:
        """Show outages everywhere, in order."""
        state.outages.sort()
        windows.clear()
        with windows:
            for window in state.outages:
                with block("line"):
                    html(f"{runner.seconds(window[0])} to {runner.seconds(window[1])} s").style("width: auto")
                    button("remove", lambda w=window: removed(w)).props(
                        f'aria-label="remove the outage from {window[0]:g} s on"'
                    )
        show(timeline, windows=shaded())
        show(plan, windows=shaded())
        commanded()

    def shaded() -> list[tuple[float, float, str]]:
        return [(*window, "outage") for window in state.outages]

    def moved(event: events.GenericEventArguments) -> None:
        k, start, stop = event.args
        state.outages[int(k)] = max(round(float(start), 1), 0.0), round(float(stop), 1)
        outaged()

    def removed(window: tuple[float, float]) -> None:
        state.outages.remove(window)
        outaged()

    def dragged(event: events.GenericEventArguments) -> None:
        add(*(round(float(x), 1) for x in event.args))

    def add(begin_s: float | None, end_s: float | None) -> None:
        if begin_s is None or end_s is None or not end_s > begin_s:
            ui.notify("an outage stops after it starts: give both, in seconds from the start", type="negative")
            return
        state.outages.append((float(begin_s), float(end_s)))
        outaged()

    @ui.refreshable
    def entries() -> None:
        entry_fields(state.data, state.texts, search.value or "", only_stated=only.value, changed=commanded)

    with block("cols"):
        with block("col"):
            heading("Log and configuration")
            name_menu("log", logs(workspace), log, choose_log)
            configs = name_menu("configuration", configurations(workspace), config, choose_config).classes("q-mt-sm")
            with block("line"):
                imu = ui.input("IMU, of the catalogue").props("outlined dense").classes("grow")
                imu.bind_value(state, "imu")
                button("propose", proposed)
            note = html("")
            asked = place()
            heading("Entries")
            with block("line"):
                search = ui.input("search", on_change=entries.refresh).props("outlined dense clearable").classes("grow")
                only = ui.checkbox("only what is stated", on_change=entries.refresh)
            with block("form"):
                entries()
            with block("line"):
                button("save into the configuration", save)
                button("load again", loaded)
        with block("col"):
            heading("Timeline")
            timeline = chart("timeline", without="Choose a log on the left.", label="speed over time, outages shaded")
            timeline.on("span", dragged, js_handler="(e) => emit(e.detail)")
            timeline.on("moved", moved, js_handler="(e) => emit(e.detail)")
            hint(
                "Drag over a stretch to withhold GNSS there, drag an outage or its edges to move them; arrows, + and - "
                "move the window. The marker on the track is where the vehicle was at the cursor."
            )
            windows = place()
            with block("line"):
                from_s = ui.number("outage from [s]").props("outlined dense").style("width: 9rem")
                to_s = ui.number("to [s]").props("outlined dense").style("width: 9rem")
                button("add outage", lambda: add(from_s.value, to_s.value))
            heading("Run")
            command = place()
            with block("line"):
                button("navigate", lambda: panel.start(state.arguments), "main")
            panel: JobPanel = JobPanel(
                workspace, place(),
                lambda: jobs.latest(workspace, "navigate", state.log), navigated,
            )  # fmt: skip
            result = place()
            heading("Track")
            plan = chart("plan", without="The track of GNSS and solution.", label="track, north over east")
    ui.timer(0.05, loaded, once=True)
    ui.timer(POLL_S, panel.look)
