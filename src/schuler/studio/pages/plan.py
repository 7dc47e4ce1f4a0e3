"""Plan a mission: its entries as a form, outages, requirements, an IMU; what is reached and which error is to blame."""

from __future__ import annotations

from html import escape
from typing import Any
from urllib.parse import quote

from nicegui import ui

from schuler.budget import QUANTITIES, requirement
from schuler.budget.scenario import BudgetScenario
from schuler.exceptions import InputError, SchulerError, printable
from schuler.sensors import catalogue
from schuler.studio import form, jobs, runner
from schuler.studio.pages.entries import entry_fields
from schuler.studio.pages.frame import block, button, command_box, heading, hint, html, problem, table
from schuler.studio.pages.job import job_box
from schuler.studio.workspace import Workspace, identified_imus, missions, new_run_name, write_mission

_POLL_S = 0.4
_OUTAGES, _REQUIRE = "gnss.outages_s", "require"
_PASSES = {True: "yes", False: "no", None: "unknown"}


class _Plan:
    """State of one open page; what is worth keeping is a file."""

    def __init__(self, workspace: Workspace, mission: str) -> None:
        self.workspace, self.mission = workspace, mission
        self.imus: list[str] = []
        self.data: dict[str, Any] = {}
        self.checksum = ""
        self.texts: dict[str, str] = {}
        self.job = ""
        self.shown: jobs.Job | None = None

    def changes(self) -> dict[str, Any]:
        """Entries of the form that the file has otherwise."""
        return form.changes(self.data, self.texts, BudgetScenario)

    def arguments(self) -> list[str]:
        """Command of the budget."""
        changes = self.changes()
        runner.checked(self.workspace, self.mission, changes, BudgetScenario)
        return runner.budget_arguments(
            self.mission, self.imus, new_run_name(self.workspace, self.mission, "budget"), changes
        )


def plan_page(workspace: Workspace, mission: str) -> None:
    """Mission and form on the left; IMU, command and result on the right."""
    names = missions(workspace)
    state = _Plan(workspace, mission)
    if not mission:
        last = jobs.latest(workspace, "budget")
        state.mission = last.command[1] if last is not None and last.command[1] in names else next(iter(names), "")

    def loaded() -> None:
        """Read the mission; entries that were changed in the form and not saved are dropped."""
        state.data, state.checksum, state.texts = {}, "", {}
        if state.mission:
            try:
                state.data, state.checksum = runner.data_of(workspace, state.mission)
            except SchulerError as error:
                problem(error)
        entries.refresh()
        commanded()

    def choose(name: str) -> None:
        state.mission, state.job, state.shown = name, "", None
        progress.clear()
        result.clear()
        loaded()

    def written() -> None:
        try:
            name = write_mission(workspace)
        except OSError as error:
            problem(error)
            return
        menu.set_options(missions(workspace))
        menu.set_value(name)

    def choose_imus(chosen: list[str]) -> None:
        state.imus = list(chosen)
        commanded()

    def save() -> None:
        try:
            state.checksum = runner.saved(workspace, state.mission, state.changes(), state.checksum, BudgetScenario)
        except (SchulerError, OSError) as error:
            problem(error)
            return
        loaded()
        ui.notify(f"written: {state.mission}")

    def commanded() -> None:
        """Show the command, or what is wrong with the form."""
        command.clear()
        with command:
            if not state.mission:
                hint("Choose a mission, or begin with a new one.")
                return
            try:
                command_box(runner.shell(state.arguments()))
            except (SchulerError, OSError) as error:
                hint(printable(str(error)), bad=True)

    def begin() -> None:
        try:
            if not state.mission:
                raise InputError("choose a mission first")
            words = state.arguments()
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
        """Say how the last budget of the mission stands, and show what came out."""
        if not state.mission:
            return
        job = jobs.job(workspace, state.job) if state.job else jobs.latest(workspace, "budget", state.mission)
        if job is None or job == state.shown:
            return
        state.shown, state.job = job, job.key
        job_box(workspace, progress, job, again)
        if job.state == "done":
            commanded()  # with the next free name
            _outcome(result, job, jobs.answer(workspace, job.key))

    @ui.refreshable
    def entries() -> None:
        only = not (search.value or every.value)
        entry_fields(
            state.data, state.texts, search.value or "", only_stated=only, changed=commanded, model=BudgetScenario
        )

    with block("cols"):
        with block("col"):
            heading("Mission")
            with block("line"):
                menu = ui.select(
                    names, value=state.mission if state.mission in names else None, label="mission",
                    on_change=lambda e: choose(e.value or ""),
                ).props('outlined dense aria-label="mission"').classes("grow")  # fmt: skip
                button("new mission", written)
            hint(
                f"{_OUTAGES}: start and stop of each, such as [[90, 150]]. {_REQUIRE}: such as "
                '["horizontal < 10 m @ 60 s outage"].'
            )
            with block("line"):
                search = ui.input("search", on_change=entries.refresh).props("outlined dense clearable").classes("grow")
                every = ui.checkbox("every entry", on_change=entries.refresh)
            with block("form"):
                entries()
            with block("line"):
                button("save into the mission", save)
                button("load again", loaded)
        with block("col"):
            heading("IMU")
            ui.select(
                [*identified_imus(workspace), *catalogue.names()], value=[], multiple=True, with_input=True,
                label="IMU, of the catalogue or identified", on_change=lambda e: choose_imus(e.value),
            ).props('outlined dense use-chips aria-label="IMU"')  # fmt: skip
            hint("Without one, the whole catalogue is ranked by the requirements.")
            command = ui.element("div").style("width: 100%")
            with block("line"):
                button("work out the budget", begin, "main")
            progress = ui.element("div").style("width: 100%")
            result = ui.element("div").style("width: 100%")
    ui.timer(0.05, loaded, once=True)
    ui.timer(_POLL_S, look)


def _outcome(place: ui.element, job: jobs.Job, answer: dict[str, Any]) -> None:
    """Sentences of the report first, then requirements and budgets in numbers, then the report itself."""
    place.clear()
    ranked = not answer["budgets"]
    status = "" if ranked or not answer["choices"] else "ok" if answer["passes"] else "failed"
    with place:
        sentences = "".join(f"<p>{escape(printable(text))}</p>" for text in answer["sentences"])
        html(
            f'<section class="verdict {status}" aria-label="Verdict"><p><b>{escape(job.out)}</b></p>'
            f"{sentences}</section>"
        )
        for choice in answer["choices"]:
            rows = [
                (row["imu"], row["value"], row["time_s"], _PASSES[row["passes"]], row["limited_by"], row["share"])
                for row in choice["ranking"]
            ]
            unit = _unit(requirement(choice["requirement"]).quantity)
            with block("ranking"):
                table(
                    ("IMU", f"value [{unit}]", "at [s]", "passes", "limited by", "share"), rows, choice["requirement"]
                )
        for one in answer["budgets"]:
            budget = one["budget"]
            caption = f"{budget['imu']}: {budget['quantity']} after {budget['time_s']:g} s, 1-sigma"
            with block("ranking"):
                table(
                    ("source", f"contribution [{_unit(budget['quantity'])}]"),
                    [("all", budget["total"]), *budget["by_group"].items()],
                    caption,
                )
        report = f"/studio/files/{quote(job.out)}/report.html"
        html(
            f'<p><a href="{report}" target="_blank">open the report</a></p>'
            f'<iframe class="report" title="report of the budget" src="{report}"></iframe>'
        )


def _unit(quantity: str) -> str:
    """SI unit of a quantity: as it is shown, or radians where that is in degrees."""
    _, unit, scale = QUANTITIES[quantity]
    return unit if scale == 1.0 else "rad"
