"""Coach while the unit is turned: what to do next in letters that are read from a distance, from a log that grows."""

from __future__ import annotations

import re
from html import escape
from typing import Any

from nicegui import ui

from schuler.exceptions import InputError, printable
from schuler.live.sources import SCHEMES, parse_source
from schuler.sensors import catalogue
from schuler.studio import jobs, runner
from schuler.studio.coaching import CoachState, coach_state
from schuler.studio.pages.frame import block, button, command_box, heading, hint, html, name_menu, place
from schuler.studio.pages.job import POLL_S, JobPanel
from schuler.studio.pages.outcome import show_calibration
from schuler.studio.workspace import Workspace, configurations, identified_imus, logs, new_run_name


class _Coach:
    """State of one open page."""

    def __init__(self, workspace: Workspace, log: str, config: str) -> None:
        self.workspace, self.log, self.config = workspace, log, config
        self.imu = ""
        self.latitude: float | None = None

    def arguments(self) -> list[str]:
        """Command of the coach."""
        if not self.log or not self.imu or self.latitude is None:
            raise InputError("choose the log that grows or a serial port, the IMU and the latitude first")
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
    shown: list[CoachState | None] = [None]

    def commanded() -> None:
        command.clear()
        with command:
            try:
                command_box(runner.shell(state.arguments()))
            except InputError as error:
                hint(printable(str(error)))

    def chosen(name: str, value: Any) -> None:
        setattr(state, name, value or None if name == "latitude" else value or "")
        if name == "log":
            other = log_menu if is_source(state.log) else port
            if state.log and other.value:
                other.set_value(None)  # one of the two
                state.log = value
            panel.forget()
            advice.clear()
            result.clear()
            shown[0] = None
        commanded()

    def ended(job: jobs.Job) -> None:
        result.clear()
        with result:
            show_calibration(workspace, job)
        commanded()  # with the next free name

    def look() -> None:
        panel.look()
        job = jobs.job(workspace, panel.key) if panel.key else None
        now = None if job is None else coach_state(jobs.messages(workspace, job.key))
        if job is None or now is None or now == shown[0]:
            return
        shown[0] = now
        advice.clear()
        small = re.sub(r"\([^()]*\)", r"<small>\g<0></small>", escape(now.move))
        words = " · ".join([*([now.motion] if now.motion else []), f"{now.percent} %", f"{now.elapsed_s:.0f} s"])
        with advice:
            html(
                f'<section class="coach {now.motion}" aria-live="polite" aria-label="Advice">'
                f'<p class="next">{small}</p><p>{words}</p>'
                f'<progress max="100" value="{now.percent}" aria-label="progress of the calibration"></progress>'
                f'<p class="hint">{escape(now.reason)}</p></section>'
            )

    heading("Coach")
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
    command = place()
    with block("line"):
        button("coach me", lambda: panel.start(state.arguments), "main")
        button("enough: calibrate", lambda: jobs.interrupt(workspace, panel.key))
    hint(
        "The log: a text file that is being written, or a port: serial:, udp://, tcp://, ws:// and mqtt://, as of "
        "schuler live. format=text: lines t gx gy gz ax ay az in rad/s and m/s², or columns=... and units=...; "
        "without, the binary formats of receivers and IMUs. Advice goes on until nothing is left to do."
    )
    advice = place()
    panel: JobPanel = JobPanel(
        workspace, place(),
        lambda: jobs.latest(workspace, "calibrate", "field", state.log) if state.log else None, ended,
    )  # fmt: skip
    result = place()
    ui.timer(0.05, commanded, once=True)
    ui.timer(POLL_S, look)
