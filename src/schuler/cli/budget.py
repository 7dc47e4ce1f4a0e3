"""``schuler budget``."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from schuler.cli.configuration import entries
from schuler.cli.output import Flag, Folder, Texts, drawable, named, print_json, progress, writable
from schuler.exceptions import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from schuler.budget.choice import ImuChoice
    from schuler.budget.contributions import ErrorBudget
    from schuler.budget.covariance import LinearCovariance
    from schuler.budget.scenario import BudgetAccelerometer, BudgetMission
    from schuler.sensors.spec import ImuSpec


def budget(
    scenario: Path,
    /,
    *,
    imu: Texts = (),
    require: Texts = (),
    quantity: Literal["horizontal", "vertical", "position", "velocity", "heading", "tilt"] | None = None,
    time: float | None = None,
    states: Literal[9, 15, 21, 33, 42] | None = None,
    set: Texts = (),
    asymmetry_ppm: float | None = None,
    quadratic_ppm_g: float | None = None,
    angles: Literal["elements", "triad"] = "elements",
    single: Flag = False,
    out: Folder = None,
    figures: bool = True,
    report: bool = True,
    json: Flag = False,
) -> int:
    """How uncertain a mission will be with an IMU, which error is to blame, and which IMU is good enough.

    Parameters
    ----------
    scenario
        TOML file with motion, aids and start, see docs/budget.md. No data, no Monte Carlo: linear covariance.
    imu
        Name in the catalogue or an identified budget in TOML; may be given several times. With --require and none
        given, the whole catalogue.
    require
        Such as "horizontal < 10 m @ 60 s outage"; may be given several times. Default: those of the scenario.
    quantity
        Of the error budget. Default: that of the first requirement, else horizontal.
    time
        Of the error budget, in seconds. Default: where the first requirement is hardest to meet, such as the end of
        the outage it names; else the end.
    states
        Of the filter, instead of the scenario's.
    set
        Any entry of the scenario: SECTION.KEY=VALUE or KEY=VALUE in TOML's spelling, such as
        gnss.outages_s=[[60,90]]; may be given several times.
    asymmetry_ppm
        1-sigma of the accelerometers' error with the magnitude of specific force, instead of the scenario's.
    quadratic_ppm_g
        1-sigma of their error with its square, ppm of what is sensed for each g, instead of the scenario's.
    angles
        Misalignments as elements xy, xz, ... or as a triad that is turned and axes that lean to each other.
    single
        Print every parameter by itself, not groups. Tables, figures and report have them all.
    out
        Folder for tables, figures and report. Default: the scenario's name with -budget.
    figures
        Draw figures too.
    report
        Write report.html.
    json
        Print one JSON object instead of text.
    """
    from schuler.budget import (
        BudgetScenario,
        budget_of,
        catalogue_specs,
        choose_imu,
        linear_covariance,
        prepare_budget,
        requirement,
    )

    began = clock.perf_counter()
    figures = drawable(figures)
    loaded = BudgetScenario.load(scenario, entries(set, sections=False))
    if states is not None:
        loaded = loaded.model_copy(update={"states": states})
    given = {"asymmetry_ppm": asymmetry_ppm, "quadratic_ppm_g": quadratic_ppm_g}
    loaded = loaded.model_copy(update={"accelerometer": _changed(loaded.accelerometer, given)})
    bounds = [requirement(text) for text in (require or loaded.require)]
    specs = [_spec(name) for name in imu]
    if not specs and not bounds:
        raise InputError("--imu: expected at least one IMU, or a requirement to rank the catalogue by (--require)")
    folder = writable(Path(f"{scenario.resolve().stem}-budget")) if out is None else out
    mission = prepare_budget(loaded)
    files: dict[str, Path] = {}
    budgets, choices, texts = [], [], []
    for spec in specs:
        covariance = linear_covariance(mission, spec, by_axis=True, angles=angles)
        # of what is asked about: where the first requirement is hardest to meet
        asked = bounds[0] if bounds and quantity is None else None
        at = asked.worst(mission, covariance.P)[1] if asked is not None and time is None else time
        one = budget_of(covariance, quantity or (asked.quantity if asked is not None else "horizontal"), at)
        budgets.append((covariance, one))
        texts += [covariance.summary(), one.table(single=single).summary()]
        files |= _write_budget(covariance, one, mission, folder, figures=figures)
    ranked, left_out = (specs, {}) if specs else catalogue_specs()
    for k, bound in enumerate(bounds, 1):
        with progress(bound.text) as bar:
            explain = [s.name for s in specs]
            choice = choose_imu(mission, bound, ranked, explain=explain, left_out=left_out, progress=bar)
        choices.append(choice)
        texts.append(choice.summary())
        files[f"requirement_{k}"] = choice.table().to_csv(folder / f"requirement-{k}.csv")
        if figures:
            files |= _saved(choice.plot(), folder / f"requirement-{k}")
    from schuler.budget.report import budget_report, sentences

    if report:
        made_from = {"scenario": loaded.model_dump(mode="json", exclude_none=True)}
        made_from |= {"imu": {spec.name: spec.to_dict() for spec in specs}} if specs else {}
        files["report"] = budget_report(folder / "report.html", mission, budgets, choices, made_from)
    passed = all(v.certain is True for c in choices for v in c.verdicts) if specs else True
    if json:
        print_json(
            {
                "command": "budget", "mission": mission.name, **_firsts(budgets, choices),
                "budgets": [{"covariance": c.to_dict(), "budget": one.to_dict()} for c, one in budgets],
                "choices": [choice.to_dict() for choice in choices],
                "sentences": sentences(budgets, choices),
                "passes": passed, "elapsed_s": clock.perf_counter() - began, "files": files,
            }
        )  # fmt: skip
    else:
        print("\n\n".join(texts))
        print("\n".join(f"{what}: {path}" for what, path in files.items() if path.suffix in (".csv", ".html")))
    return 0


def _write_budget(
    covariance: LinearCovariance, one: ErrorBudget, mission: BudgetMission, folder: Path, *, figures: bool
) -> dict[str, Path]:
    """Contributions of an IMU as CSV, and the figures of its budget; their paths by name."""
    label = _label(one.imu)
    files = {f"budget_{label}": one.table(single=True).to_csv(folder / f"budget-{label}.csv")}
    if figures:
        from schuler.budget.report import covariance_figure

        files |= _saved(one.plot(), folder / f"budget-{label}")
        files |= _saved(one.plot(single=True), folder / f"parameters-{label}")
        files |= _saved(covariance_figure(covariance, mission), folder / f"covariance-{label}")
    return files


def _firsts(budgets: Sequence[tuple[LinearCovariance, ErrorBudget]], choices: Sequence[ImuChoice]) -> dict[str, object]:
    """Total, contributions and ranking at the top of the JSON: those of the first IMU and the first requirement."""
    data: dict[str, object] = {"total": None, "contributions": [], "ranking": []}
    for _, one in budgets[:1]:
        data["total"] = one.total
        data["contributions"] = [
            {"parameter": name, "value": value, "share": value**2 / one.total**2}
            for name, value in one.by_source().items()
        ]
    for choice in choices[:1]:
        document = choice.to_dict()
        limits, rows = document["bottlenecks"], document["ranking"]
        data["ranking"] = [{**row, "bottleneck": limits.get(row["imu"], {}).get("field")} for row in rows]
    return data


def _spec(name: str) -> ImuSpec:
    """An IMU by its name in the catalogue, or by the file of an identified budget."""
    from schuler.sensors import catalogue
    from schuler.sensors.spec_file import configured_spec

    return configured_spec(name) if name.endswith(".toml") else catalogue.spec(name)


def _changed(section: BudgetAccelerometer, given: dict[str, float | None]) -> BudgetAccelerometer:
    """The scenario's values but for those given on the command line."""
    for name, value in given.items():
        if value is not None and not 0.0 <= value < float("inf"):
            raise InputError(f"--{name.replace('_', '-')}: expected a 1-sigma value, zero or more, got {value!r}")
    return section.model_copy(update={k: v for k, v in given.items() if v is not None})


def _label(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)


def _saved(figure: Figure, path: Path) -> dict[str, Path]:
    from schuler.plotting.drawing import save

    return named(save(figure, path, ("png", "svg")))
