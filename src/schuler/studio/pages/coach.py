"""Coach while the unit is turned: what to do next in letters that are read from a distance, from a log that grows."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import ui

from schuler.exceptions import InputError
from schuler.live.sources import SCHEMES, parse_source
from schuler.sensors import catalogue
from schuler.studio import jobs, runner
from schuler.studio.coaching import CoachState, coach_state
from schuler.studio.pages.frame import block, button, heading, hint, html, name_menu, place
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
from schuler.studio.pages.outcome import show_calibration
from schuler.studio.workspace import Workspace, configurations, identified_imus, logs, new_run_name


class _Coach:
    """State of one open page."""

    def __init__(self, workspace: Workspace, log: str, config: str) -> None:
        self.workspace, self.log, self.config = workspace, log, config
        self.imu = ""
        self.latitude: float | None = None

    @property
    def missing(self) -> str:
        """What is to be chosen first; empty if nothing is."""
        if self.log and self.imu and self.latitude is not None:
            return ""
        return "choose the log that grows or a serial port, the IMU and the latitude first"

    def arguments(self) -> list[str]:
        """Command of the coach."""
        if self.missing:
            raise InputError(self.missing)
        if is_source(self.log):
            parse_source(self.log)
        out = new_run_name(self.workspace, "field" if is_source(self.log) else self.log, "calibration")
        options: dict[str, Any] = {"imu": self.imu, "latitude": self.latitude, "coach": True}
        return runner.calibrate_arguments("field", self.log, self.config, out, options, report=True)


def is_source(log: str) -> bool:
    """Whether a log is the address of a source of ``schuler live``, such as a serial port."""
    scheme, colon, _ = log.partition(":")
    return bool(colon) and scheme in SCHEMES


def serial_ports() -> list[str]:
    """Addresses of the serial ports of this machine, of lines of numbers; empty without pyserial (extra ``live``)."""
    try:
        from serial.tools.list_ports import comports
    except ImportError:
        return []
    return [f"serial:{port.device}?baud=115200&format=text" for port in comports()]


def coach_page(workspace: Workspace, log: str, config: str) -> None:
    """What is needed on top, advice in large letters, then the calibration."""
    state = _Coach(workspace, log, config)
    if (last := jobs.latest(workspace, "calibrate", "field", log)) is not None:
        state.log, state.config = last.command[2], config or runner.option_of(last.command, "config")
        state.imu = runner.option_of(last.command, "imu")
        state.latitude = float(text) if (text := runner.option_of(last.command, "latitude")) else None
    heading("Coach")
    _choices(state, lambda: session.forget(), lambda: session.commanded())
    session: _Session = _Session(state)
    ui.timer(0.05, session.commanded, once=True)
    ui.timer(POLL_S, session.look)


def _choices(state: _Coach, left: Callable[[], None], changed: Callable[[], None]) -> None:
    """Log or port, configuration, IMU and latitude; ``left`` is called when another log or port is chosen."""
    workspace = state.workspace

    def chosen(name: str, value: Any) -> None:
        setattr(state, name, value or None if name == "latitude" else value or "")
        if name == "log":
            other = log_menu if is_source(state.log) else port
            if state.log and other.value:
                other.set_value(None)  # one of the two
                state.log = value
            left()
        changed()

    with block("line"):
        log_menu = name_menu("log that grows", logs(workspace), state.log, lambda v: chosen("log", v) if v else None)
        log_menu.classes("grow")
        port = ui.input(
            "or a port", value=state.log if is_source(state.log) else "", autocomplete=serial_ports(),
            placeholder="serial:/dev/ttyUSB0?baud=115200&format=text",
            on_change=lambda e: chosen("log", e.value) if e.value else None,
        )  # fmt: skip
        port.props('outlined dense debounce=400 aria-label="port"').classes("grow")
        name_menu(
            "configuration", ["", *configurations(workspace)], state.config, lambda v: chosen("config", v)
        ).classes("grow")
        imus = [*identified_imus(workspace), *catalogue.names()]
        name_menu("IMU", imus, state.imu, lambda v: chosen("imu", v)).classes("grow")
        ui.number("latitude [deg]", value=state.latitude, on_change=lambda e: chosen("latitude", e.value)).props(
            'outlined dense aria-label="latitude"'
        ).style("width: 9rem")


class _Session:
    """The command, its job, the advice while it runs, and the calibration.

    Parameters
    ----------
    state : _Coach
    """

    def __init__(self, state: _Coach) -> None:
        self._state = state
        self._shown: CoachState | None = None
        self._command = place()
        with block("line"):
            button("coach me", lambda: self._panel.start(state.arguments), "main")
            button("enough: calibrate", lambda: jobs.interrupt(state.workspace, self._panel.key))
        hint(
            "The log: a text file that is being written, or a port: serial:, udp://, tcp://, ws:// and mqtt://, as of "
            "schuler live. format=text: lines t gx gy gz ax ay az in rad/s and m/s², or columns=... and units=...; "
            "without, the binary formats of receivers and IMUs. Advice goes on until nothing is left to do."
        )
        self._advice = place()
        self._panel: JobPanel = JobPanel(state.workspace, place(), self._latest, self._ended)
        self._result = place()

    def commanded(self) -> None:
        """Show the command, or what is to be chosen first."""
        show_command(self._command, self._state.arguments, self._state.missing)

    def forget(self) -> None:
        """Show nothing; the page is about another log."""
        self._panel.forget()
        self._advice.clear()
        self._result.clear()
        self._shown = None

    def look(self) -> None:
        """Follow the job, and show its advice when that changes."""
        self._panel.look()
        job = jobs.job(self._state.workspace, self._panel.key) if self._panel.key else None
        now = None if job is None else coach_state(jobs.messages(self._state.workspace, job.key))
        if now is None or now == self._shown:
            return
        self._shown = now
        self._advice.clear()
        with self._advice:
            _show_advice(now)

    def _latest(self) -> jobs.Job | None:
        log = self._state.log
        return jobs.latest(self._state.workspace, "calibrate", "field", log) if log else None

    def _ended(self, job: jobs.Job) -> None:
        self._result.clear()
        with self._result:
            show_calibration(self._state.workspace, job)
        self.commanded()  # with the next free name


def _show_advice(now: CoachState) -> None:
    """What to do next in large letters, how the unit moves, progress and the reason."""
    small = re.sub(r"\([^()]*\)", r"<small>\g<0></small>", escape(now.move))
    words = " · ".join([*([now.motion] if now.motion else []), f"{now.percent} %", f"{now.elapsed_s:.0f} s"])
    html(
        f'<section class="coach {now.motion}" aria-live="polite" aria-label="Advice">'
        f'<p class="next">{small}</p><p>{words}</p>'
        f'<progress max="100" value="{now.percent}" aria-label="progress of the calibration"></progress>'
        f'<p class="hint">{escape(now.reason)}</p></section>'
    )
