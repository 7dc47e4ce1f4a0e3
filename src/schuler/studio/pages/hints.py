"""How a log is read, on a page: menus of columns, units and axes, a field for each hint, the file that keeps them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import ui

from schuler.exceptions import InputError, SchulerError
from schuler.proposal import Decision, UndecidedError
from schuler.recording.io.hints import ReadHints
from schuler.studio import layout, reading
from schuler.studio.pages.frame import block, button, command_box, fold, heading, hint, html, place, problem
from schuler.studio.signals import View, Views
from schuler.studio.workspace import Workspace, configurations

Again = Callable[[dict[str, Any]], Awaitable[None]]


class LogReading:
    """State of an open page: a log, how it is read, what came of it."""

    def __init__(self, workspace: Workspace, views: Views, log: str) -> None:
        self.workspace, self.views = workspace, views
        self.log, self.hints = log, dict[str, Any]()
        self.view: View | None = None
        self.decisions: list[Decision] = []
        self.question: UndecidedError | None = None
        self.target = "drive.toml"

    @property
    def path(self) -> Path:
        """File or folder of the log."""
        return self.workspace.inside(self.log)

    @property
    def signals(self) -> str:
        """Source of the chart, empty without signals."""
        return f"/studio/views/{self.view.key}/signals" if self.view is not None and self.view.channels else ""

    def choose(self, log: str) -> None:
        """Another log, of which nothing is given."""
        self.log, self.hints, self.decisions, self.question, self.view = log, {}, [], None, None

    async def open(self) -> None:
        """Read and check the log with the hints; propose them where it cannot be read without."""
        self.question, self.view = None, None
        try:
            path = self.path
            self.view = await asyncio.to_thread(self.views.open, path, self.hints)
            if not self.hints and (not self.view.channels or path.is_dir()):
                self.hints, self.decisions = await asyncio.to_thread(reading.completed, path, self.hints)
                self.view = await asyncio.to_thread(self.views.open, path, self.hints)
        except UndecidedError as question:
            self.question = question
        except (SchulerError, OSError) as error:
            if self.view is None:  # else its findings say why it cannot be read
                problem(error)

    async def answer(self, entries: dict[str, Any]) -> bool:
        """Take the answer to a question; whether there is no further one."""
        self.hints = reading.answered(self.hints, entries)
        try:
            self.hints, more = await asyncio.to_thread(reading.completed, self.path, self.hints)
            self.decisions += more
        except UndecidedError as question:
            self.question = question
            return False
        except SchulerError as error:
            problem(error)
        return True

    def save(self) -> None:
        """Write the hints into a configuration."""
        try:
            if not self.target.endswith(".toml"):
                raise InputError(f"{self.target}: expected the name of a .toml file")
            assert self.view is not None
            path = reading.save(self.workspace.inside(self.target), self.hints, self.view.diagnosis)
            ui.notify(f"written: {path.name}")
        except SchulerError as error:
            problem(error)


def how_it_is_read(state: LogReading, again: Again) -> None:
    """Hints of a log, and what they are kept in.

    Parameters
    ----------
    state : LogReading
    again : callable
        Reads the log with other hints.
    """

    async def load(name: str) -> None:
        try:
            await again(reading.hints_of(state.workspace.inside(name) if name else None))
        except SchulerError as error:
            problem(error)

    heading("How it is read")
    files = ["", *configurations(state.workspace)]
    ui.select(files, value="", label="take from a configuration", on_change=lambda e: load(e.value)).props(
        "outlined dense"
    )
    _menus(state, again)
    _fields(state, again)
    for decision in state.decisions:
        hint(f"{decision.entry} = {decision.value}: {decision.evidence}")
    if state.view is not None:
        _keep(state)


def _menus(state: LogReading, again: Again) -> None:
    """Menus of each text file of the log: columns, units, axes, stamps."""
    opened = state.question is not None or state.view is None or not state.view.channels
    for part, hints, path in _files(state):
        columns = layout.text_columns(path, hints)
        if columns:
            with fold(f"columns, units and axes{f' of {part}' if part else ''}", opened=opened):
                _file_menus(columns, hints, partial(_put, state, again, part))


def _put(state: LogReading, again: Again, part: str, changed: dict[str, Any]) -> Awaitable[None]:
    """Read the log with other hints of one of its files."""
    return again({**state.hints, part: changed} if part else changed)


def _file_menus(columns: tuple[layout.TextColumn, ...], hints: dict[str, Any], put: Again) -> None:
    for k, column in enumerate(columns):
        with block("line pick"):
            words = f"{escape(column.header)} " if column.header else ""
            numbers = escape(", ".join(column.values))
            html(f'<span class="name">{k + 1}. {words}</span><span class="hint">{numbers}</span>')
            choices = tuple(dict.fromkeys((*layout.NAMES, column.name)))
            chosen = partial(layout.with_column, hints, columns, k)
            _menu(f"column {k + 1}", choices, column.name, chosen, put)
    with block("line"):
        for group, (stated, choices) in layout.unit_choices(hints, columns).items():
            _menu(f"unit of {group}", ("", *choices), stated, partial(layout.with_unit, hints, group), put)
        if {column.name.removeprefix("-") for column in columns} & {"ax", "gx"}:
            axes = ("", *layout.axes_choices())
            _menu("axes", axes, str(hints.get("axes", "")), partial(reading.edited, hints, "axes"), put)
        stamp = str(hints.get("time", ""))
        times = tuple(dict.fromkeys(("", *layout.TIMES, stamp)))
        _menu("time stamps", times, stamp, partial(reading.edited, hints, "time"), put)


def _menu(
    label: str, choices: tuple[str, ...], value: str, changed: Callable[[str], dict[str, Any]], put: Again
) -> None:
    """A menu whose choice makes other hints, with which the log is read at once."""
    options = {choice: {"": "as it says itself", layout.SKIPPED: "not read"}.get(choice, choice) for choice in choices}
    menu = ui.select(options, value=value, label=label, on_change=lambda e: put(changed(e.value)))
    menu.props(f'outlined dense aria-label="{escape(label)}"').style("width: 9.5rem")


def _files(state: LogReading) -> list[tuple[str, dict[str, Any], Path]]:
    """Part, its hints and its file, of the files that are read; the part of a log in one file is empty."""
    if not state.log:
        return []
    path = state.path
    if path.is_file():
        return [("", state.hints, path)]
    return [
        (part, hints, path / str(hints["file"]))
        for part, hints in state.hints.items()
        if isinstance(hints, dict) and "file" in hints and (path / str(hints["file"])).is_file()
    ]


def _fields(state: LogReading, again: Again) -> None:
    """Each hint in a field, and one more."""

    async def edit(name: str, text: str) -> None:
        try:
            hints = reading.edited(state.hints, name, text)
        except InputError as error:
            problem(error)
            return
        await again(hints)

    if not state.hints and state.signals:
        hint("The file says itself how it is read.")
    for name, value in reading.listed(state.hints):
        field = ui.input(name, value=str(value)).props("outlined dense").classes("q-mt-sm")
        field.on("keydown.enter", lambda _, f=field, n=name: edit(n, f.value))
        field.on("blur", lambda _, f=field, n=name, v=str(value): edit(n, f.value) if f.value != v else None)
    parts = [name for name, value in state.hints.items() if isinstance(value, dict)]
    keys = list(ReadHints.__dataclass_fields__)
    all_names = [f"{part}.{key}" for part in parts for key in keys] if parts else keys
    with block("line"):
        other = ui.select(all_names, label="another hint", with_input=True).props("outlined dense").classes("grow")
        text = ui.input("value").props("outlined dense").classes("grow")
        button("set", lambda: edit(other.value, text.value) if other.value else None)


def _keep(state: LogReading) -> None:
    """The file that keeps the hints, and where to go on with it."""
    heading("Keep it")
    with block("line"):
        target = ui.input("configuration").props("outlined dense").classes("grow")
        target.bind_value(state, "target")
        button("save", state.save, "main")
    shown = place()

    def command() -> None:
        shown.clear()
        with shown:
            command_box(reading.check_command(state.log, state.hints, state.target))
            link = f"/navigate?log={quote(state.log)}&config={quote(state.target)}"
            html(f'<p><a href="{escape(link)}">navigate this log</a></p>')

    target.on_value_change(command)
    command()
