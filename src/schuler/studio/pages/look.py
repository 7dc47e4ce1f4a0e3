"""Look at a log: what is in it, its signals at full rate, what is wrong with it, and how that is mended."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import events, ui

from schuler.exceptions import printable
from schuler.studio import reading
from schuler.studio.pages.frame import (
    block,
    button,
    chart,
    fold,
    heading,
    hint,
    html,
    name_menu,
    place,
    question_box,
    show,
    table,
)
from schuler.studio.pages.hints import LogReading, how_it_is_read
from schuler.studio.signals import View, Views
from schuler.studio.statistics import span_statistics
from schuler.studio.workspace import Workspace, logs

_SPECTRA = ("spectrum", "spectrogram")


def look_page(workspace: Workspace, views: Views, log: str) -> None:
    """Files on the left with how they are read; signals and findings on the right."""
    state = LogReading(workspace, views, log)

    async def opened() -> None:
        """Read and check the log with the hints, propose them where it cannot be read without."""
        if state.log:
            busy.set_content('<p class="hint">reading and checking ...</p>')
            await state.open()
            busy.set_content("")
            drawn()

    async def again(hints: dict[str, Any]) -> None:
        state.hints = hints
        await opened()

    async def choose(name: str) -> None:
        state.choose(name)
        await opened()

    async def answer(entries: dict[str, Any]) -> None:
        if await state.answer(entries):
            await opened()
        else:
            drawn()

    def drawn() -> None:
        left.clear()
        right.clear()
        with left:
            how_it_is_read(state, again)
        with right:
            if state.question is not None:
                heading("A question")
                question_box(state.question, answer)
            if state.view is not None:
                _findings(state, again)
        spans.forget()
        show(signals, source=state.signals)

    def received(name: str) -> None:
        names.set_options(logs(workspace))
        if not state.log:
            names.set_value(name)

    with block("cols"):
        with block("col"):
            heading("Log")
            names = name_menu("file or folder", logs(workspace), log, choose)
            busy = drop_area(received)
            left = place()
        with block("col"):
            heading("Signals")
            signals = chart("signals", without="Choose a log on the left.", label="signals over time")
            hint("Drag to zoom, double-click for all; keys: arrows, + and -, 0. Every stretch shows its extremes.")
            spans = VisibleSpan(lambda: state.view)
            signals.on("window", spans.windowed, js_handler="(e) => emit(e.detail)")
            right = place()
    if log:
        ui.timer(0.05, opened, once=True)


def drop_area(received: Callable[[str], None]) -> ui.html:
    """Where files are dropped or chosen; the line below it, which says what is being done.

    Parameters
    ----------
    received : callable
        Called with the name of each file that has arrived.
    """

    def sending(event: events.GenericEventArguments) -> None:
        busy.set_content(f'<p class="hint">receiving {escape(str(event.args))} ...</p>')

    def sent(event: events.GenericEventArguments) -> None:
        name, refused = (str(part) for part in event.args)
        busy.set_content("")
        if refused:
            ui.notify(printable(refused), type="negative", multi_line=True, timeout=12000, close_button="close")
            return
        received(name)

    label = '<label class="drop">drop files here, or choose<input type="file" multiple></label>'
    drop = ui.html(label, sanitize=False).style("width: 100%").classes("q-mt-sm")
    # the events come from the label within: they are sent on by its parent
    drop.on("sending", sending, js_handler="(e) => emit(e.detail)")
    drop.on("sent", sent, js_handler="(e) => emit(e.detail)")
    busy = html("")
    return busy


class VisibleSpan:
    """What follows the window of the chart: statistics, spectrum and spectrogram, each folded.

    Parameters
    ----------
    view : callable
        The log that is open, None without.
    """

    def __init__(self, view: Callable[[], View | None]) -> None:
        self._view = view
        self._window = (0.0, 0.0)
        with fold("statistics of the visible span"):
            self._statistics = ui.element("div").classes("ranking")
        self._spectra: dict[str, ui.element] = {}
        for name in _SPECTRA:
            with fold(f"{name} of the visible span"):
                without = "An IMU with 64 samples or more in the span has one."
                self._spectra[name] = chart("figure", without=without, label=f"{name} of the visible span")

    async def windowed(self, event: events.GenericEventArguments) -> None:
        """Statistics of what is visible; of several windows in a row, of the last."""
        seen, (start, stop) = self._view(), (float(x) for x in event.args)
        self._window = start, stop
        if seen is None:
            return
        if seen.recording is not None and seen.recording.imu is not None:
            for name, element in self._spectra.items():
                show(element, source=f"/studio/views/{seen.key}/{name}?start={start}&stop={stop}")
        rows = await asyncio.to_thread(span_statistics, seen, start, stop)
        if self._window != (start, stop) or self._view() is not seen:
            return
        self._statistics.clear()
        with self._statistics:
            table(
                ("", "samples", "mean", "standard deviation", "smallest", "largest"),
                [(f"{r.panel}: {r.name}", r.samples, r.mean, r.standard_deviation, r.minimum, r.maximum) for r in rows],
                f"from {start:.3f} to {stop:.3f} s",
            )

    def forget(self) -> None:
        """Show nothing until a window comes."""
        self._statistics.clear()
        for element in self._spectra.values():
            show(element, source="")


def _findings(state: LogReading, again: Any) -> None:
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
            cure = reading.cure_of(state.path, finding, state.hints)
            if cure is not None:
                with block("line"):
                    button(f"mend: {cure.words}", lambda h=cure.hints: again(h), "main")
            elif finding.fix:
                html(f'<p class="hint">{escape(printable(finding.fix))}</p>')
    if state.view.recording is not None:
        heading("What is in it")
        html(f"<pre>{escape(printable(state.view.recording.summary()))}</pre>")
