"""Navigate a log: configuration as a form, outages on the timeline, a run in its own process, what came out."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from schuler.exceptions import InputError, SchulerError
from schuler.files import write_text
from schuler.proposal import UndecidedError, propose
from schuler.studio import form, jobs, reading, runner
from schuler.studio.maps import NETWORK
from schuler.studio.pages.entries import entry_fields
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
    question_box,
    show,
)
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
from schuler.studio.pages.outcome import show_outcome
from schuler.studio.signals import View, Views
from schuler.studio.workspace import (
    Workspace,
    configurations,
    logs,
    maps,
    new_configuration_name,
    new_run_name,
    run_entry,
    runs,
)


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
        self.out = self.other = ""

    def shaded(self) -> list[tuple[float, float, str]]:
        """Outages as charts shade them."""
        return [(*window, "outage") for window in self.outages]

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
    jobs.prepare(workspace)
    state = _Navigate(workspace, views, log, config)
    if not log and not config and (last := jobs.latest(workspace, "navigate")) is not None:
        state.log, state.config, state.outages = runner.origin_of(last.command)  # a page that was closed, say

    async def opened() -> None:
        """Read the log as the configuration says, for the timeline and the map."""
        track.draw()
        await timeline.open()
        track.draw()
        run.commanded()

    async def choose_log(name: str) -> None:
        state.log, state.answers, state.out = name, {}, ""
        run.forget()
        await opened()

    def changed() -> None:
        """Outages or entries have changed."""
        track.shade()
        run.commanded()

    def navigated() -> None:
        track.draw()

    with block("cols"):
        with block("col"):
            heading("Log and configuration")
            name_menu("log", logs(workspace), state.log, choose_log)
            form_part = _Form(state, opened, changed)
        with block("col"):
            timeline = _Timeline(state, changed)
            run = _Run(state, navigated)
            track = _Track(state, run.show)

    async def first() -> None:
        await form_part.load()
        timeline.draw()

    ui.timer(0.05, first, once=True)
    ui.timer(POLL_S, run.panel.look)


class _Form:
    """Configuration: chosen or proposed, its entries as fields, saved.

    Parameters
    ----------
    state : _Navigate
    opened : callable
        Reads the log as another configuration says.
    changed : callable
        Called when an entry has changed.
    """

    def __init__(self, state: _Navigate, opened: Callable[[], Awaitable[None]], changed: Callable[[], None]) -> None:
        self._state, self._opened, self._changed = state, opened, changed
        self._configs = name_menu("configuration", configurations(state.workspace), state.config, self._choose)
        self._configs.classes("q-mt-sm")
        with block("line"):
            imu = ui.input("IMU, of the catalogue").props("outlined dense").classes("grow")
            imu.bind_value(state, "imu")
            button("propose", self._propose)
        self._note = html("")
        self._asked = place()
        heading("Entries")
        with block("line"):
            self._search = ui.input("search", on_change=lambda: self._entries.refresh())
            self._search.props("outlined dense clearable").classes("grow")
            self._only = ui.checkbox("only what is stated", on_change=lambda: self._entries.refresh())
        with block("form"):
            self._entries()
        with block("line"):
            button("save into the configuration", self._save)
            button("load again", self.load)

    @ui.refreshable_method
    def _entries(self) -> None:
        state = self._state
        entry_fields(
            state.data, state.texts, self._search.value or "", only_stated=self._only.value, changed=self._changed
        )

    async def load(self) -> None:
        """Read the configuration; entries that were changed in the form and not saved are dropped."""
        state = self._state
        state.data, state.checksum, state.texts = {}, "", {}
        if state.config:
            try:
                state.data, state.checksum = runner.data_of(state.workspace, state.config)
            except SchulerError as error:
                problem(error)
        self._entries.refresh()
        await self._opened()

    async def _choose(self, name: str) -> None:
        self._state.config = name
        await self.load()

    async def _propose(self) -> None:
        """Propose a configuration, as ``schuler init`` does, and write it."""
        state = self._state
        if not state.log:
            ui.notify("choose a log first")
            return
        self._asked.clear()
        self._note.set_content('<p class="hint">trying what the log shows: clock, mount, aids ...</p>')
        given, imu = runner.proposal_of(state.data.get(reading.SECTION, {}), state.imu)
        name, question = "", None
        try:
            path = state.workspace.inside(state.log)
            made = await asyncio.to_thread(propose, path, imu=imu, given=given | state.answers)
            name = new_configuration_name(state.workspace)
            write_text(state.workspace.inside(name), made.toml(), at_once=True)
        except UndecidedError as open_question:
            question = open_question
        except (SchulerError, OSError) as error:
            problem(error)
        done = f"proposed and written: {escape(name)}, each entry with its evidence"
        self._note.set_content(f'<p class="hint">{done}</p>' if name else "")
        if question is not None:
            with self._asked:
                question_box(question, self._answer)
        elif name:
            self._configs.set_options(configurations(state.workspace))
            self._configs.set_value(name)

    async def _answer(self, answers: dict[str, Any]) -> None:
        self._state.answers |= answers
        await self._propose()

    def _save(self) -> None:
        state = self._state
        try:
            state.checksum = runner.saved(state.workspace, state.config, state.changes(), state.checksum)
            state.data, state.checksum = runner.data_of(state.workspace, state.config)
        except (SchulerError, OSError) as error:
            problem(error)
            return
        state.texts = {}
        self._entries.refresh()
        self._changed()
        ui.notify(f"written: {state.config}")


class _Timeline:
    """Speed over time with the outages: drawn, dragged, typed, removed.

    Parameters
    ----------
    state : _Navigate
    changed : callable
        Called when an outage has changed.
    """

    def __init__(self, state: _Navigate, changed: Callable[[], None]) -> None:
        self._state, self._changed = state, changed
        heading("Timeline")
        self._chart = chart("timeline", without="Choose a log on the left.", label="speed over time, outages shaded")
        self._chart.on("span", self._dragged, js_handler="(e) => emit(e.detail)")
        self._chart.on("moved", self._moved, js_handler="(e) => emit(e.detail)")
        hint(
            "Drag over a stretch to withhold GNSS there, drag an outage or its edges to move them; arrows, + and - "
            "move the window. The marker on the track is where the vehicle was at the cursor."
        )
        self._windows = place()
        with block("line"):
            from_s = ui.number("outage from [s]").props("outlined dense").style("width: 9rem")
            to_s = ui.number("to [s]").props("outlined dense").style("width: 9rem")
            button("add outage", lambda: self._add(from_s.value, to_s.value))

    async def open(self) -> None:
        """Read the log as the configuration says."""
        state = self._state
        show(self._chart, source="")
        state.view = None
        if state.log:
            try:
                path = state.workspace.inside(state.log)
                hints = {**state.data.get(reading.SECTION, {})}
                state.view = await asyncio.to_thread(state.views.open, path, hints)
            except (SchulerError, OSError) as error:
                problem(error)
        if state.view is not None and state.view.channels:
            source = f"/studio/views/{state.view.key}/signals?only=speed"
            show(self._chart, source=source, windows=state.shaded())

    def draw(self) -> None:
        """Show outages everywhere, in order."""
        self._state.outages.sort()
        self._windows.clear()
        with self._windows:
            for window in self._state.outages:
                with block("line"):
                    html(f"{runner.seconds(window[0])} to {runner.seconds(window[1])} s").style("width: auto")
                    button("remove", lambda w=window: self._remove(w)).props(
                        f'aria-label="remove the outage from {window[0]:g} s on"'
                    )
        show(self._chart, windows=self._state.shaded())
        self._changed()

    def _moved(self, event: events.GenericEventArguments) -> None:
        k, start, stop = event.args
        self._state.outages[int(k)] = max(round(float(start), 1), 0.0), round(float(stop), 1)
        self.draw()

    def _remove(self, window: tuple[float, float]) -> None:
        self._state.outages.remove(window)
        self.draw()

    def _dragged(self, event: events.GenericEventArguments) -> None:
        self._add(*(round(float(x), 1) for x in event.args))

    def _add(self, begin_s: float | None, end_s: float | None) -> None:
        if begin_s is None or end_s is None or not end_s > begin_s:
            ui.notify("an outage stops after it starts: give both, in seconds from the start", type="negative")
            return
        self._state.outages.append((float(begin_s), float(end_s)))
        self.draw()


class _Run:
    """The command, its job, and what came out, beside another run.

    Parameters
    ----------
    state : _Navigate
    navigated : callable
        Called when a run has ended.
    """

    def __init__(self, state: _Navigate, navigated: Callable[[], None]) -> None:
        self._state, self._navigated = state, navigated
        heading("Run")
        self._command = place()
        with block("line"):
            button("navigate", lambda: self.panel.start(state.arguments), "main")
        self.panel: JobPanel = JobPanel(
            state.workspace, place(), lambda: jobs.latest(state.workspace, "navigate", state.log), self._ended
        )
        self._result = place()

    def commanded(self) -> None:
        """Show the command, or what is wrong with the form."""
        ready = self._state.log and self._state.config
        missing = "" if ready else "Choose a log and a configuration, or let one be proposed."
        show_command(self._command, self._state.arguments, missing)

    def forget(self) -> None:
        """Show nothing; the page is about another log."""
        self.panel.forget()
        self._result.clear()

    def show(self) -> None:
        """Numbers of the run, beside those of the one it is compared with."""
        state = self._state
        if state.out:
            other = run_entry(state.workspace, state.other) if state.other else None
            show_outcome(self._result, run_entry(state.workspace, state.out), other)

    def _ended(self, job: jobs.Job) -> None:
        self._state.out = job.out
        self.show()
        self._navigated()
        self.commanded()  # with the next free name


class _Track:
    """Track over a map, of one run or of two.

    Parameters
    ----------
    state : _Navigate
    compared : callable
        Called when another run is to be compared with.
    """

    def __init__(self, state: _Navigate, compared: Callable[[], None]) -> None:
        self._state, self._compared = state, compared
        heading("Track")
        with block("line"):
            names = {"": "none, a grid in metres", **{name: name for name in maps(state.workspace)}, NETWORK: NETWORK}
            ui.select(names, value="", label="map", on_change=lambda e: show(self._chart, map_name=e.value)).props(
                'outlined dense aria-label="map"'
            ).classes("grow")
            self._others = ui.select({"": "none"}, value="", label="against run", on_change=self._against)
            self._others.props('outlined dense aria-label="against run"').classes("grow")
        self._chart: ui.element = chart(
            "plan", without="The track of GNSS and solution.", label="track, north over east"
        )
        self._chart.on("refused", lambda e: problem(InputError(str(e.args))), js_handler="(e) => emit(e.detail)")

    def draw(self) -> None:
        """Curves of the log, its run and the other one."""
        state = self._state
        others = [run.name for run in runs(state.workspace) if run.name != state.out]
        state.other = state.other if state.other in others else ""
        self._others.set_options({"": "none", **{name: name for name in others}}, value=state.other)
        parts = (
            *([f"view={state.view.key}"] if state.view is not None else []),
            *([f"run={quote(state.out)}"] if state.out else []),
            *([f"other={quote(state.other)}"] if state.other else []),
        )
        show(self._chart, source=f"/studio/track?{'&'.join(parts)}" if parts else "", windows=state.shaded())

    def shade(self) -> None:
        """Outages on the track."""
        show(self._chart, windows=self._state.shaded())

    def _against(self, event: events.ValueChangeEventArguments[str]) -> None:
        if (event.value or "") != self._state.other:
            self._state.other = event.value or ""
            self._compared()
            self.draw()
