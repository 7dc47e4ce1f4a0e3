"""``schuler observability``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from schuler.cli.output import Flag, Folder, Texts, drawable, named, print_json, progress, say
from schuler.exceptions import InputError

if TYPE_CHECKING:
    from schuler.filtering.engine import Progress
    from schuler.observability.study import Observability


def observability(
    scenario: Path,
    /,
    *,
    log: Path | None = None,
    axes: Literal["ned", "enu"] | None = None,
    fixed: Annotated[Texts, Parameter(name="--known")] = (),
    symbolic: Flag = False,
    out: Folder = None,
    report: Flag = False,
    json: Flag = False,
) -> None:
    """What a filter can know: ranks, observable states, combinations in words, and uncertainty over time.

    Parameters
    ----------
    scenario
        TOML file with motion, rotating platform, measurements and states, see docs/observability.md. With --log, the
        configuration of schuler navigate.
    log
        A recording: it is navigated, and what its own transitions and measurements tell is looked at.
    axes
        ned: ours. enu: axes, names and signs of Du's thesis. Default: as the scenario says.
    fixed
        State to be taken as known, such as dr; may be given several times. Default: as the scenario says.
    symbolic
        Formulas too (SymPy): for a vehicle at rest, its IMU fixed or turning at a constant rate about x, y or z.
    out
        Folder for tables, figures and report. Default, with --report: the scenario's name with -observability.
    report
        Write report.html, figures and tables.
    json
        Print one JSON object instead of text.
    """
    began = time.perf_counter()
    figures = drawable(report or out is not None)
    changes: dict[str, object] = {k: v for k, v in {"axes": axes, "known": fixed}.items() if v}
    formulas: tuple[str, ...] = ()
    if log is not None:
        if symbolic:
            raise InputError("--symbolic: formulas are of schemes at rest, not of a log; leave out one of the two")
        with progress("navigating") as bar:
            study = _of_log(log, scenario, axes or "ned", fixed, bar)
    else:
        study, formulas = _of_scenario(scenario, changes, symbolic)
    files: dict[str, Path] = {}
    if report or out is not None:
        folder = Path(f"{(log or scenario).resolve().stem}-observability") if out is None else out
        files = _write(study, formulas, folder, figures=figures)
    if json:
        print_json(
            {
                "command": "observability", **study.to_dict(), "formulas": formulas,
                "elapsed_s": time.perf_counter() - began, "files": files,
            }
        )  # fmt: skip
        return
    print(study.summary())
    if formulas:
        print("\nAs formulas (W Earth rate, c and s cosine and sine of the latitude, w rate of the platform):")
        print("\n".join(f"  {text}" for text in formulas))
    print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")), end="")
    print("\n" if files else "", end="")


def _of_scenario(path: Path, changes: dict[str, object], symbolic: bool) -> tuple[Observability, tuple[str, ...]]:
    from schuler.observability import ObservabilityScenario, scenario_observability
    from schuler.observability.symbolic import scenario_formulas

    loaded = ObservabilityScenario.load(path).model_copy(update=changes)
    formulas = scenario_formulas(loaded) if symbolic else ()
    return scenario_observability(loaded), formulas


def _of_log(log: Path, config: Path, axes: str, fixed: tuple[str, ...], bar: Progress | None) -> Observability:
    from schuler.cli.reading import read_log
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.run import navigate
    from schuler.navigation.states import imu_spec
    from schuler.observability import observability, result_system

    loaded = NavigationConfig.load(config, [("filter.smooth", True)])
    result = navigate(read_log(log, config), loaded, progress=bar)
    if not result.complete:
        raise KeyboardInterrupt
    spec = imu_spec(loaded)
    say(result.summary())
    system = result_system(
        result, without=fixed, gyro_psd=spec.gyro.random_walk**2, accel_psd=spec.accel.random_walk**2
    )
    return observability(system, axes=axes)


def _write(study: Observability, formulas: tuple[str, ...], folder: Path, *, figures: bool) -> dict[str, Path]:
    from schuler.observability.report import observability_figure, observability_report
    from schuler.plotting.drawing import save_all

    files = {
        "states": study.table().to_csv(folder / "states.csv"),
        "report": observability_report(study, folder / "report.html", formulas),
    }
    if figures:
        files |= named(save_all([observability_figure(study)], folder, ("png", "svg")))
    return files
