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
from schuler.studio.pages.frame import block, button, command_box, heading, hint, html, place, problem, table
from schuler.studio.pages.job import POLL_S, JobPanel
from schuler.studio.pages.studies import studies_part
from schuler.studio.workspace import Workspace, identified_imus, missions, new_run_name, write_mission

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

    def changes(self) -> dict[str, Any]:
        """Entries of the form that the file has otherwise."""
        return form.changes(self.data, self.texts, BudgetScenario)

    def arguments(self) -> list[str]:
        """Command of the budget."""
        if not self.mission:
            raise InputError("choose a mission first")
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
        state.mission = name
        panel.forget()
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
        imus.run_method("hidePopup")  # a menu of several stays open otherwise, over the button below
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

    def worked_out(job: jobs.Job) -> None:
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
            imus = ui.select(
                [*identified_imus(workspace), *catalogue.names()], value=[], multiple=True, with_input=True,
                label="IMU, of the catalogue or identified", on_change=lambda e: choose_imus(e.value),
            ).props('outlined dense use-chips aria-label="IMU"')  # fmt: skip
            hint("Without one, the whole catalogue is ranked by the requirements.")
            command = place()
            with block("line"):
                button("work out the budget", lambda: panel.start(state.arguments), "main")
            panel: JobPanel = JobPanel(
                workspace, place(),
                lambda: jobs.latest(workspace, "budget", state.mission) if state.mission else None, worked_out,
            )  # fmt: skip
            result = place()
    heading("Many runs, and IMUs that turn")
    studies_part(workspace)
    ui.timer(0.05, loaded, once=True)
    ui.timer(POLL_S, panel.look)


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
