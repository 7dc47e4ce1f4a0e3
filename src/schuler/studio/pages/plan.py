"""Plan a mission: its entries as a form, outages, requirements, an IMU; what is reached and which error is to blame."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import ui

from schuler.budget import QUANTITIES, requirement
from schuler.budget.scenario import BudgetScenario
from schuler.exceptions import InputError, SchulerError, printable
from schuler.sensors import catalogue
from schuler.studio import form, jobs, runner
from schuler.studio.pages.entries import entry_fields
from schuler.studio.pages.frame import (
    block,
    button,
    heading,
    hint,
    html,
    place,
    problem,
    report_frame,
    table,
)
from schuler.studio.pages.job import POLL_S, JobPanel, show_command
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
    with block("cols"):
        with block("col"):
            form_part = _Form(state, lambda: budget.forget(), lambda: budget.commanded())
        with block("col"):
            budget: _Budget = _Budget(state)
    heading("Many runs, and IMUs that turn")
    studies_part(workspace)
    ui.timer(0.05, form_part.load, once=True)
    ui.timer(POLL_S, budget.panel.look)


class _Form:
    """Mission: chosen or begun, its entries as fields, saved.

    Parameters
    ----------
    state : _Plan
    left : callable
        Called when another mission is chosen.
    changed : callable
        Called when an entry has changed.
    """

    def __init__(self, state: _Plan, left: Callable[[], None], changed: Callable[[], None]) -> None:
        self._state, self._left, self._changed = state, left, changed
        names = missions(state.workspace)
        heading("Mission")
        with block("line"):
            self._menu = ui.select(
                names, value=state.mission if state.mission in names else None, label="mission",
                on_change=lambda e: self._choose(e.value or ""),
            ).props('outlined dense aria-label="mission"').classes("grow")  # fmt: skip
            button("new mission", self._begin)
        hint(
            f"{_OUTAGES}: start and stop of each, such as [[90, 150]]. {_REQUIRE}: such as "
            '["horizontal < 10 m @ 60 s outage"].'
        )
        with block("line"):
            self._search = ui.input("search", on_change=lambda: self._entries.refresh())
            self._search.props("outlined dense clearable").classes("grow")
            self._every = ui.checkbox("every entry", on_change=lambda: self._entries.refresh())
        with block("form"):
            self._entries()
        with block("line"):
            button("save into the mission", self._save)
            button("load again", self.load)

    @ui.refreshable_method
    def _entries(self) -> None:
        state, sought = self._state, self._search.value or ""
        entry_fields(
            state.data, state.texts, sought, only_stated=not (sought or self._every.value), changed=self._changed,
            model=BudgetScenario,
        )  # fmt: skip

    def load(self) -> None:
        """Read the mission; entries that were changed in the form and not saved are dropped."""
        state = self._state
        state.data, state.checksum, state.texts = {}, "", {}
        if state.mission:
            try:
                state.data, state.checksum = runner.data_of(state.workspace, state.mission)
            except SchulerError as error:
                problem(error)
        self._entries.refresh()
        self._changed()

    def _choose(self, name: str) -> None:
        self._state.mission = name
        self._left()
        self.load()

    def _begin(self) -> None:
        """Write a new mission and choose it."""
        try:
            name = write_mission(self._state.workspace)
        except OSError as error:
            problem(error)
            return
        self._menu.set_options(missions(self._state.workspace))
        self._menu.set_value(name)

    def _save(self) -> None:
        state = self._state
        try:
            state.checksum = runner.saved(
                state.workspace, state.mission, state.changes(), state.checksum, BudgetScenario
            )
        except (SchulerError, OSError) as error:
            problem(error)
            return
        self.load()
        ui.notify(f"written: {state.mission}")


class _Budget:
    """IMU, the command, its job, and what came out.

    Parameters
    ----------
    state : _Plan
    """

    def __init__(self, state: _Plan) -> None:
        self._state = state
        heading("IMU")
        self._imus = ui.select(
            [*identified_imus(state.workspace), *catalogue.names()], value=[], multiple=True, with_input=True,
            label="IMU, of the catalogue or identified", on_change=lambda e: self._choose(e.value),
        ).props('outlined dense use-chips aria-label="IMU"')  # fmt: skip
        hint("Without one, the whole catalogue is ranked by the requirements.")
        self._command = place()
        with block("line"):
            button("work out the budget", lambda: self.panel.start(state.arguments), "main")
        self.panel: JobPanel = JobPanel(state.workspace, place(), self._latest, self._ended)
        self._result = place()

    def commanded(self) -> None:
        """Show the command, or what is wrong with the form."""
        missing = "" if self._state.mission else "Choose a mission, or begin with a new one."
        show_command(self._command, self._state.arguments, missing)

    def forget(self) -> None:
        """Show nothing; the page is about another mission."""
        self.panel.forget()
        self._result.clear()

    def _choose(self, chosen: list[str]) -> None:
        self._state.imus = list(chosen)
        self._imus.run_method("hidePopup")  # a menu of several stays open otherwise, over the button below
        self.commanded()

    def _latest(self) -> jobs.Job | None:
        mission = self._state.mission
        return jobs.latest(self._state.workspace, "budget", mission) if mission else None

    def _ended(self, job: jobs.Job) -> None:
        self.commanded()  # with the next free name
        _outcome(self._result, job, jobs.answer(self._state.workspace, job.key))


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
        report_frame(job.out, "report of the budget")


def _unit(quantity: str) -> str:
    """SI unit of a quantity: as it is shown, or radians where that is in degrees."""
    _, unit, scale = QUANTITIES[quantity]
    return unit if scale == 1.0 else "rad"
