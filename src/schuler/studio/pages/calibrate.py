"""Calibrate from a log of poses: rests found, accepted, rejected or moved by hand, refitted at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError, SchulerError
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
    table,
)
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
from schuler.studio.pages.outcome import show_calibration
from schuler.studio.rests import Rest, placed, read_rests, toggled, write_rests
from schuler.studio.signals import View, Views
from schuler.studio.workspace import Workspace, configurations, logs, new_run_name

_METHOD = "freepose"
_ROLES = {True: "finding", False: "unused"}


class _Calibrate:
    """State of one open page; what is worth keeping is a file."""

    def __init__(self, workspace: Workspace, views: Views, log: str, config: str) -> None:
        self.workspace, self.views, self.log, self.config = workspace, views, log, config
        self.redraw: Callable[[], None] = lambda: None  # of the chart
        self.gravity: float | None = None
        self.latitude: float | None = None
        self.initial_rest: float | None = None
        self.serial = ""
        self.out = ""
        self.by_hand = False
        self.stale = False  # changed while a fit was running
        self.rests: list[Rest] = []
        self.chosen: int | None = None
        self.view: View | None = None
        self.opened = False  # whether the log was read, or could not be

    @property
    def rests_name(self) -> str:
        """File with the rests of the folder that is written."""
        return f"{self.out}-rests.csv"

    @property
    def shift(self) -> float:
        """Time of the first sample of the IMU on the axis of the chart. [s]"""
        recording = None if self.view is None else self.view.recording
        return 0.0 if recording is None or recording.imu is None else float(recording.imu.t[0]) - recording.start

    def arguments(self, **more: Any) -> list[str]:
        """Command of the calibration; with more options one that writes a report too."""
        if not self.log:
            raise InputError("choose a log first")
        options = {
            "gravity": self.gravity, "latitude": self.latitude, "initial-rest": self.initial_rest,
            "intervals": self.rests_name if self.by_hand else None, **more,
        }  # fmt: skip
        return runner.calibrate_arguments(_METHOD, self.log, self.config, self.out, options, report=bool(more))

    def resume(self, job: jobs.Job) -> None:
        """Take folder, options and rests from a command of this page."""
        numbers = {name: runner.option_of(job.command, name) for name in ("gravity", "latitude", "initial-rest")}
        self.gravity, self.latitude, self.initial_rest = (float(text) if text else None for text in numbers.values())
        self.config = runner.option_of(job.command, "config")
        self.out, self.serial = job.out, runner.option_of(job.command, "serial")
        rests = runner.option_of(job.command, "intervals")
        self.by_hand = bool(rests)
        self.rests = read_rests(self.workspace.inside(rests)) if rests else []


def calibrate_page(workspace: Workspace, views: Views, log: str, config: str) -> None:
    """Log and rests on the left; signals with the rests, command and result on the right."""
    jobs.prepare(workspace)
    state = _Calibrate(workspace, views, log, config)
    if (last := jobs.latest(workspace, "calibrate", _METHOD, log)) is not None and config in (
        "",
        runner.option_of(last.command, "config"),
    ):
        state.log = last.command[2]
        state.resume(last)

    async def opened() -> None:
        await rests.open()
        drawn()

    async def choose_log(name: str) -> None:
        state.log, state.out, state.rests, state.by_hand, state.chosen = name, "", [], False, None
        fit.forget()
        if name and (last := jobs.latest(workspace, "calibrate", _METHOD, name)) is not None:
            state.resume(last)
            configs.set_value(state.config)
        await opened()

    async def choose_config(name: str) -> None:
        state.config = name
        await opened()

    def drawn() -> None:
        """Rests on the chart and in the fields, and the command."""
        rests.draw()
        fields.draw()
        fit.commanded()

    def changed(changed_rests: list[Rest], chosen: int | None) -> None:
        """Fit with these rests."""
        try:
            write_rests(workspace.inside(state.rests_name), changed_rests)
        except (SchulerError, OSError) as error:
            problem(error)
            drawn()  # a rest that was dragged goes back
            return
        state.rests, state.chosen, state.by_hand, state.stale = changed_rests, chosen, True, True
        drawn()
        fit.again()

    with block("cols"):
        with block("col"):
            heading("Log of poses")
            name_menu("log", logs(workspace), state.log, choose_log)
            configs: ui.select = name_menu(
                "configuration", ["", *configurations(workspace)], state.config, choose_config
            )
            configs.classes("q-mt-sm")
            with block("line"):
                for label, name in (("gravity [m/s²]", "gravity"), ("latitude [deg]", "latitude"),
                                    ("initial rest [s]", "initial_rest")):  # fmt: skip
                    field = ui.number(label, on_change=lambda: drawn()).props("outlined dense clearable debounce=400")
                    field.bind_value(state, name).classes("grow")
            with block("line"):
                button("calibrate", lambda: fit.anew(), "main")
            hint("Finds the rests and fits. Every change of a rest then fits again, into the same folder.")
            fields: _RestFields = _RestFields(state, changed)
            heading("Certificate")
            with block("line"):
                ui.input("serial number").props("outlined dense").classes("grow").bind_value(state, "serial")
                button("report and certificate", lambda: fit.certify())
            hint("Without a serial number it is the report alone.")
            html('<p><a href="/coach">coach: turn the unit while the log grows</a></p>')
        with block("col"):
            rests: _RestChart = _RestChart(state, fields)
            fit: _Fit = _Fit(state, drawn)
    ui.timer(0.05, opened, once=True)
    ui.timer(POLL_S, fit.look)


class _RestFields:
    """The rest that is chosen: its number, edges, accepted or rejected; changes without a mouse.

    Parameters
    ----------
    state : _Calibrate
    changed : callable
        Called with all rests and the one that is chosen.
    """

    def __init__(self, state: _Calibrate, changed: Callable[[list[Rest], int | None], None]) -> None:
        self._state, self._changed = state, changed
        heading("Rests")
        with block("line"):
            self._number = ui.select({}, label="rest", on_change=lambda e: self._choose(e.value))
            self._number.props("outlined dense").style("width: 6rem")
            self._accept = button("reject", lambda: self.toggle(state.chosen))
        with block("line"):
            self._from = ui.number("from [s]").props('outlined dense aria-label="rest from"').style("width: 8rem")
            self._to = ui.number("to [s]").props('outlined dense aria-label="rest to"').style("width: 8rem")
            button("set", lambda: self.place(state.chosen, self._from.value, self._to.value))
            button("add", lambda: self.place(None, self._from.value, self._to.value))

    def draw(self) -> None:
        """The chosen rest in the fields."""
        state = self._state
        rest = None if state.chosen is None else state.rests[state.chosen]
        self._number.set_options({i: str(i + 1) for i in range(len(state.rests))}, value=state.chosen)
        self._from.set_value(None if rest is None else round(rest.start, 3))
        self._to.set_value(None if rest is None else round(rest.stop, 3))
        self._accept.set_text("reject" if rest is None or rest.accepted else "accept")

    def toggle(self, k: int | None) -> None:
        """Accept or reject a rest."""
        if k is not None:
            self._changed(toggled(self._state.rests, k), k)

    def place(self, k: int | None, start: float | None, stop: float | None) -> None:
        """Move a rest, or add one."""
        state = self._state
        try:
            if start is None or stop is None:
                raise InputError("a rest: expected its start and stop in seconds")
            rests = placed(state.rests, k, start, stop)
        except InputError as error:
            problem(error)
            state.redraw()
            return
        self._changed(rests, next(i for i, rest in enumerate(rests) if rest.start == start))

    def _choose(self, k: int | None) -> None:
        self._state.chosen = k
        self.draw()


class _RestChart:
    """Signals with the rests on them: clicked, dragged, added.

    Parameters
    ----------
    state : _Calibrate
    fields : _RestFields
        Which carries changes out.
    """

    def __init__(self, state: _Calibrate, fields: _RestFields) -> None:
        self._state, self._fields = state, fields
        heading("Signals and rests")
        self._chart = chart("timeline", without="Choose a log on the left.", label="signals over time, rests shaded")
        for kind, act in (("point", self._pointed), ("moved", self._moved), ("span", self._added)):
            self._chart.on(kind, act, js_handler="(e) => emit(e.detail)")
        hint(
            "Yellow: used, grey: rejected. Click a rest to reject or accept it, drag it or its edges to move them, "
            "drag elsewhere to add one."
        )
        state.redraw = self.draw

    async def open(self) -> None:
        """Read the log as the configuration says, for its signals."""
        state = self._state
        show(self._chart, source="", windows=[])
        state.view, state.opened = None, False
        if state.log:
            try:
                hints = reading.hints_of(state.workspace.inside(state.config) if state.config else None)
                state.view = await asyncio.to_thread(state.views.open, state.workspace.inside(state.log), hints)
                if state.view.channels:
                    show(self._chart, source=f"/studio/views/{state.view.key}/signals")
            except (SchulerError, OSError) as error:
                problem(error)
        if not state.out and state.log:
            state.out = new_run_name(state.workspace, state.log, "calibration")
        state.opened = True

    def draw(self) -> None:
        """The rests as they are; one that was dragged to where it cannot be goes back."""
        shift = self._state.shift
        windows = [(r.start + shift, r.stop + shift, _ROLES[r.accepted]) for r in self._state.rests]
        show(self._chart, windows=windows)

    def _pointed(self, event: events.GenericEventArguments) -> None:
        t = float(event.args) - self._state.shift
        self._fields.toggle(next((i for i, r in enumerate(self._state.rests) if r.start <= t <= r.stop), None))

    def _moved(self, event: events.GenericEventArguments) -> None:
        k, start, stop = event.args
        before = self._state.rests[int(k)]
        bounds = [round(float(t) - self._state.shift, 3) for t in (start, stop)]
        # an edge that was not dragged stays at its sample
        edges = [
            old if abs(new - old) < 2e-3 else new for old, new in zip((before.start, before.stop), bounds, strict=True)
        ]
        self._fields.place(int(k), max(edges[0], 0.0), edges[1])

    def _added(self, event: events.GenericEventArguments) -> None:
        start, stop = (round(float(t) - self._state.shift, 3) for t in event.args)
        self._fields.place(None, max(start, 0.0), stop)


class _Fit:
    """The command, its job, and what came out.

    Parameters
    ----------
    state : _Calibrate
    drawn : callable
        Shows other rests.
    """

    def __init__(self, state: _Calibrate, drawn: Callable[[], None]) -> None:
        self._state, self._drawn = state, drawn
        heading("Calibration")
        self._command = place()
        self._panel: JobPanel = JobPanel(state.workspace, place(), self._latest, self._ended)
        self._result = place()

    def forget(self) -> None:
        """Show nothing; the page is about another log."""
        self._panel.forget()
        self._result.clear()

    def commanded(self) -> None:
        """Show the command."""
        missing = "" if self._state.log else "Choose a log of an IMU that was put down in many poses."
        show_command(self._command, self._state.arguments, missing)

    def anew(self) -> None:
        """Find the rests anew; what was fitted before stays in its folder."""
        state = self._state
        if state.log and (state.workspace.root / state.out).exists():
            state.out = new_run_name(state.workspace, state.log, "calibration")
        state.by_hand, state.rests, state.chosen = False, [], None
        self._panel.start(state.arguments)
        self._drawn()

    def again(self) -> None:
        """Start the fit that was asked for last, as soon as the one before has ended."""
        state = self._state
        if not state.stale:
            return
        current = jobs.job(state.workspace, self._panel.key)
        if current is not None and current.state == "running":
            jobs.cancel(state.workspace, current.key)
            return
        state.stale = False
        self._panel.start(state.arguments)

    def certify(self) -> None:
        """Run again with the report and, given a serial number, the certificate."""
        state = self._state
        serial = (
            {"serial": state.serial, "certificate": f"{state.out}/certificate.html"} if state.serial.strip() else {}
        )
        self._panel.start(lambda: state.arguments(**serial) if serial else state.arguments(report=True))

    def look(self) -> None:
        """Follow the job."""
        if self._state.log and not self._state.opened:
            return  # the rests that were found are drawn on it
        job = self._panel.look()
        if job is not None and job.state == "refused":
            self._ended(job)
        self.again()

    def _latest(self) -> jobs.Job | None:
        state = self._state
        return jobs.latest(state.workspace, "calibrate", _METHOD, state.log) if state.log else None

    def _ended(self, job: jobs.Job) -> None:
        """Show what came out; of a log that was refused, its rests."""
        state = self._state
        self._result.clear()
        try:
            answer = jobs.answer(state.workspace, job.key)
        except (OSError, ValueError):
            return
        if not state.by_hand and state.view is not None and state.view.recording is not None:
            zero = float(state.view.recording.need_imu().t[0])
            state.rests = [Rest(start - zero, stop - zero) for start, stop in answer["extra"]["intervals"]]
        self._drawn()
        with self._result:
            show_calibration(state.workspace, job, lambda fit: _rest_table(state.rests, fit))


def _rest_table(rests: list[Rest], fit: CalibrationResult) -> None:
    """Every rest with what the fit leaves of it; a rejected one has no residual."""
    residuals = fit.residuals["accel"]
    left = iter(zip(residuals.value.tolist(), residuals.sigma.tolist(), strict=True))
    rows = []
    for k, rest in enumerate(rests, 1):
        value, sigma = next(left, (None, None)) if rest.accepted else (None, None)
        sigmas = None if not value or not sigma else value / sigma
        rows.append((str(k), rest.start, rest.stop, value, sigma, sigmas, "" if rest.accepted else "rejected"))
    with block("ranking"):
        heads = ("rest", "from [s]", "to [s]", f"residual [{residuals.unit}]", "1 sigma", "sigmas", "")
        table(heads, rows, "magnitude of specific force less gravity")
