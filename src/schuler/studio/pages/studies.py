"""Studies of a mission: many runs with other errors each (Monte Carlo), and an IMU on a platform that turns."""

from __future__ import annotations

from html import escape
from typing import Any, Literal
from urllib.parse import quote

from nicegui import ui

from schuler.exceptions import InputError, printable
from schuler.studio import jobs, runner
from schuler.studio.pages.frame import (
    block,
    button,
    chart,
    html,
    place,
    problem,
    report_frame,
    show,
    table,
)
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
from schuler.studio.workspace import Workspace, new_run_name, studies, write_mission

_LEFT = {
    "montecarlo": "runs that were finished are kept, and starting again goes on with them",
    "rotary": "nothing half-written is left",
}
_COLUMNS = ("quantity", "simulated_conventional", "simulated_rotary", "simulated_ratio")


def studies_part(workspace: Workspace) -> None:
    """Menu of scenarios, number of runs, command, progress and result."""
    kinds = studies(workspace)
    last = next((job for job in jobs.jobs(workspace) if job.command[0] in _LEFT and job.command[1] in kinds), None)
    chosen = last.command[1] if last is not None else next(iter(kinds), "")

    def arguments() -> list[str]:
        name = menu.value
        if not name:
            raise InputError("choose a scenario first")
        runs = None if number.value is None else int(number.value)
        out = new_run_name(workspace, name, "runs")
        return runner.study_arguments(kinds[name], name, out, runs, search=bool(search.value))

    def commanded() -> None:
        """Show the command, or what is wrong with it."""
        kind = kinds.get(menu.value or "", "montecarlo")
        search.set_visibility(kind == "rotary")
        turning.set_visibility(kind == "rotary")
        show(turning, source=f"/studio/platform?name={quote(menu.value)}" if kind == "rotary" else "")
        panel.left = _LEFT[kind]
        show_command(command, arguments, "" if menu.value else "Choose a scenario, or begin with a new one.")

    def choose() -> None:
        panel.forget()
        result.clear()
        commanded()

    def written(kind: Literal["campaign", "rotary"]) -> None:
        try:
            name = write_mission(workspace, kind)
        except OSError as error:
            problem(error)
            return
        kinds.update(studies(workspace))
        menu.set_options(list(kinds), value=name)

    def ended(job: jobs.Job) -> None:
        commanded()  # with the next free name
        result.clear()
        with result:
            _outcome(job, jobs.answer(workspace, job.key))

    def latest() -> jobs.Job | None:
        return jobs.latest(workspace, kinds[menu.value], menu.value) if menu.value else None

    with block("line"):
        menu = ui.select(list(kinds), value=chosen or None, label="scenario", on_change=choose)
        menu.props('outlined dense aria-label="scenario"').classes("grow")
        number = ui.number("runs, else the file's", min=1, precision=0, on_change=commanded)
        number.props('outlined dense clearable aria-label="runs"').style("width: 15rem")
        search = ui.checkbox("look for the best schedule", on_change=commanded)
    with block("line"):
        button("new campaign", lambda: written("campaign"))
        button("new platform", lambda: written("rotary"))
    turning = chart("platform", label="the IMU on its platform")
    command = place()
    with block("line"):
        button("simulate", lambda: panel.start(arguments), "main")
    panel: JobPanel = JobPanel(workspace, place(), latest, ended)
    result = place()
    ui.timer(0.05, commanded, once=True)
    ui.timer(POLL_S, panel.look)


def _outcome(job: jobs.Job, answer: dict[str, Any]) -> None:
    """Verdict or comparison, then the report."""
    if "verdict" in answer:
        sentences = [answer["verdict"], f"{answer['runs']} runs, mean NIS {answer['nis']:.3g}"]
    else:
        sentences = [f"{answer['scenario']}: {answer['runs']} runs of {answer['imu']}, fixed and turning"]
    words = "".join(f"<p>{escape(printable(text))}</p>" for text in sentences)
    html(f'<section class="verdict" aria-label="Verdict"><p><b>{escape(job.out)}</b></p>{words}</section>')
    if "rms" in answer and "verdict" not in answer:
        rows = [tuple(row[name] for name in _COLUMNS) for row in answer["rms"]]
        table(("RMS", "fixed", "turning", "ratio"), rows)
    report_frame(job.out, "report of the study")
