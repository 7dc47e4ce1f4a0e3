"""Look at a log: what is in it, its signals at full rate, what is wrong with it, and how that is mended."""

from __future__ import annotations

import asyncio
from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from schuler.exceptions import InputError, SchulerError, printable
from schuler.proposal import Decision, UndecidedError
from schuler.recording.io.hints import ReadHints
from schuler.studio import reading
from schuler.studio.pages.frame import (
    block,
    button,
    chart,
    command_box,
    fold,
    heading,
    hint,
    html,
    name_menu,
    place,
    problem,
    question_box,
    show,
    table,
)
from schuler.studio.signals import View, Views
from schuler.studio.statistics import span_statistics
from schuler.studio.workspace import Workspace, configurations, logs


class _Look:
    """State of one open page: log, hints, what came of them."""

    def __init__(self, workspace: Workspace, views: Views, log: str) -> None:
        self.workspace, self.views = workspace, views
        self.log, self.hints = log, dict[str, Any]()
        self.view: View | None = None
        self.decisions: list[Decision] = []
        self.question: UndecidedError | None = None
        self.target = "drive.toml"
        self.window = (0.0, 0.0)


def look_page(workspace: Workspace, views: Views, log: str) -> None:
    """Files on the left with how they are read; signals and findings on the right."""
    state = _Look(workspace, views, log)

    async def opened() -> None:
        """Read and check the log with the hints, propose them where it cannot be read without."""
        if not state.log:
            return
        busy.set_content('<p class="hint">reading and checking ...</p>')
        state.question, state.view = None, None
        try:
            path = workspace.inside(state.log)
            state.view = await asyncio.to_thread(views.open, path, state.hints)
            if not state.hints and (not state.view.channels or path.is_dir()):
                state.hints, state.decisions = await asyncio.to_thread(reading.completed, path, state.hints)
                state.view = await asyncio.to_thread(views.open, path, state.hints)
        except UndecidedError as question:
            state.question = question
        except (SchulerError, OSError) as error:
            if state.view is None:  # else its findings say why it cannot be read
                problem(error)
        busy.set_content("")
        drawn()

    async def again(hints: dict[str, Any]) -> None:
        state.hints = hints
        await opened()

    async def choose(name: str) -> None:
        state.log, state.hints, state.decisions = name, {}, []
        await opened()

    async def answer(entries: dict[str, Any]) -> None:
        state.hints = reading.answered(state.hints, entries)
        try:
            path = workspace.inside(state.log)
            state.hints, more = await asyncio.to_thread(reading.completed, path, state.hints)
            state.decisions += more
        except UndecidedError as question:
            state.question = question
            drawn()
            return
        except SchulerError as error:
            problem(error)
        await opened()

    async def load(name: str) -> None:
        try:
            await again(reading.hints_of(workspace.inside(name) if name else None))
        except SchulerError as error:
            problem(error)

    async def edit(name: str, text: str) -> None:
        try:
            hints = reading.edited(state.hints, name, text)
        except InputError as error:
            problem(error)
            return
        await again(hints)

    def save() -> None:
        try:
            if not state.target.endswith(".toml"):
                raise InputError(f"{state.target}: expected the name of a .toml file")
            assert state.view is not None
            path = reading.save(workspace.inside(state.target), state.hints, state.view.diagnosis)
            ui.notify(f"written: {path.name}")
        except SchulerError as error:
            problem(error)

    def sending(event: events.GenericEventArguments) -> None:
        busy.set_content(f'<p class="hint">receiving {escape(str(event.args))} ...</p>')

    async def sent(event: events.GenericEventArguments) -> None:
        name, refused = (str(part) for part in event.args)
        busy.set_content("")
        if refused:
            ui.notify(printable(refused), type="negative", multi_line=True, timeout=12000, close_button="close")
            return
        names.set_options(logs(workspace))
        if not state.log:
            names.set_value(name)

    async def windowed(event: events.GenericEventArguments) -> None:
        """Statistics of what is visible; of several windows in a row, of the last."""
        seen, (start, stop) = state.view, (float(x) for x in event.args)
        state.window = start, stop
        if seen is None:
            return
        if seen.recording is not None and seen.recording.imu is not None:
            for name, element in spectra.items():
                show(element, source=f"/studio/views/{seen.key}/{name}?start={start}&stop={stop}")
        rows = await asyncio.to_thread(span_statistics, seen, start, stop)
        if state.window != (start, stop) or state.view is not seen:
            return
        statistics.clear()
        with statistics:
            table(
                ("", "samples", "mean", "standard deviation", "smallest", "largest"),
                [(f"{r.panel}: {r.name}", r.samples, r.mean, r.standard_deviation, r.minimum, r.maximum) for r in rows],
                f"from {start:.3f} to {stop:.3f} s",
            )

    def drawn() -> None:
        left.clear()
        statistics.clear()
        right.clear()
        with left:
            _how(state, again=load, edit=edit, save=save)
        with right:
            if state.question is not None:
                heading("A question")
                question_box(state.question, answer)
            if state.view is not None:
                _findings(state, again)
        source = f"/studio/views/{state.view.key}/signals" if state.view is not None and state.view.channels else ""
        show(signals, source=source)
        for element in spectra.values():
            show(element, source="")

    with block("cols"):
        with block("col"):
            heading("Log")
            names = name_menu("file or folder", logs(workspace), log, choose)
            drop = (
                ui.html(
                    '<label class="drop">drop files here, or choose<input type="file" multiple></label>', sanitize=False
                )
                .style("width: 100%")
                .classes("q-mt-sm")
            )
            # the events come from the label within: they are sent on by its parent
            drop.on("sending", sending, js_handler="(e) => emit(e.detail)")
            drop.on("sent", sent, js_handler="(e) => emit(e.detail)")
            busy = html("")
            left = place()
        with block("col"):
            heading("Signals")
            signals = chart("signals", without="Choose a log on the left.", label="signals over time")
            hint("Drag to zoom, double-click for all; keys: arrows, + and -, 0. Every stretch shows its extremes.")
            signals.on("window", windowed, js_handler="(e) => emit(e.detail)")
            with fold("statistics of the visible span"):
                statistics = ui.element("div").classes("ranking")
            spectra = {}
            for name in ("spectrum", "spectrogram"):
                with fold(f"{name} of the visible span"):
                    without = "An IMU with 64 samples or more in the span has one."
                    spectra[name] = chart("figure", without=without, label=f"{name} of the visible span")
            right = place()
    if log:
        ui.timer(0.05, opened, once=True)


def _how(state: _Look, *, again: Any, edit: Any, save: Any) -> None:
    """How the log is read, each hint in a field."""
    heading("How it is read")
    files = ["", *configurations(state.workspace)]
    ui.select(files, value="", label="take from a configuration", on_change=lambda e: again(e.value)).props(
        "outlined dense"
    )
    if not state.hints:
        hint("The file says itself how it is read.")
    for name, value in reading.listed(state.hints):
        field = ui.input(name, value=str(value)).props("outlined dense").classes("q-mt-sm")
        field.on("keydown.enter", lambda _, f=field, n=name: edit(n, f.value))
        field.on("blur", lambda _, f=field, n=name, v=str(value): edit(n, f.value) if f.value != v else None)
    parts = [name for name, value in state.hints.items() if isinstance(value, dict)]
    all_names = (
        [f"{part}.{key}" for part in parts for key in ReadHints.__dataclass_fields__]
        if parts
        else list(ReadHints.__dataclass_fields__)
    )
    with block("line"):
        other = ui.select(all_names, label="another hint", with_input=True).props("outlined dense").classes("grow")
        value = ui.input("value").props("outlined dense").classes("grow")
        button("set", lambda: edit(other.value, value.value) if other.value else None)
    for decision in state.decisions:
        hint(f"{decision.entry} = {decision.value}: {decision.evidence}")
    if state.view is not None:
        heading("Keep it")
        with block("line"):
            target = ui.input("configuration").props("outlined dense").classes("grow")
            target.bind_value(state, "target")
            button("save", save, "main")
        command_box(reading.check_command(state.log, state.hints, state.target))
        place = f"/navigate?log={quote(state.log)}&config={quote(state.target)}"
        html(f'<p><a href="{escape(place)}">navigate this log</a></p>')


def _findings(state: _Look, again: Any) -> None:
    """What is in the log, and what is wrong with it."""
    assert state.view is not None
    diagnosis = state.view.diagnosis
    heading("Findings")
    if not diagnosis.findings:
        hint("Units, axes, signs and clocks agree with what can be checked.")
    for finding in diagnosis.findings:
        with block(f"finding {finding.severity}"):
            html(
                f"<p><b>{finding.severity} {escape(finding.code)}</b> ({escape(finding.part)}, "
                f"{100.0 * finding.confidence:.0f} %)</p><p>{escape(printable(finding.text))}</p>"
            )
            cure = reading.cure_of(state.workspace.inside(state.log), finding, state.hints)
            if cure is not None:
                with block("line"):
                    button(f"mend: {cure.words}", lambda h=cure.hints: again(h), "main")
            elif finding.fix:
                html(f'<p class="hint">{escape(printable(finding.fix))}</p>')
    if state.view.recording is not None:
        heading("What is in it")
        html(f"<pre>{escape(printable(state.view.recording.summary()))}</pre>")
