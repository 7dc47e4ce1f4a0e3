"""``schuler rotary``."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from schuler.cli.output import File, Flag, Folder, drawable, named, print_json, progress, say

if TYPE_CHECKING:
    from schuler.rotary.search.comparison import ScenarioComparison
    from schuler.rotary.search.search_result import SchemeSearch


def rotary(
    scenario: Path,
    /,
    *,
    search: Flag = False,
    runs: int | None = None,
    evaluations: int | None = None,
    seed: int | None = None,
    out: Folder = None,
    report: File = None,
    json: Flag = False,
) -> int:
    """What turning an IMU on a platform brings on a mission, and with --search which schedule is best.

    Parameters
    ----------
    scenario
        TOML file with IMU, motion, schedule, limits of the platform and aids, see docs/rotary-search.md.
    search
        Look for the best schedule within the platform's limits. Ctrl-C keeps the best so far.
    runs
        Simulated runs, instead of the scenario's.
    evaluations
        Schedules to look at, instead of the scenario's.
    seed
        Of the simulation and of the search, instead of the scenario's.
    out
        Folder for tables, figures and report.
    report
        HTML file. Default, with --out: report.html there.
    json
        Print one JSON object instead of text.
    """
    from schuler.rotary.search.comparison import compare_rotary
    from schuler.rotary.search.evolution import search_schemes
    from schuler.rotary.search.scenario import RotaryScenario

    began = time.perf_counter()
    draw = drawable(out is not None)
    loaded = RotaryScenario.load(scenario)
    if seed is not None:
        loaded = loaded.model_copy(update={"seed": seed})
    with progress("simulating") as bar:
        comparison = compare_rotary(loaded, runs=runs, progress=bar)
    if not json:
        print(comparison.summary())
    best: SchemeSearch | None = None
    if search and comparison.complete:
        changes = {"evaluations": evaluations, "seed": seed}
        settings = loaded.settings(**{k: v for k, v in changes.items() if v is not None})
        own = loaded.rotary.schedule.model_dump(exclude_unset=True)
        with progress("searching", total=settings.evaluations, unit="schedules") as bar:
            best = search_schemes(
                loaded.scheme_objective(), loaded.space(), settings, extra=[("the scenario's own", own)], progress=bar
            )
        if not json:
            print(f"\n{best.summary()}\n\n{best.best().toml()}")
    files = _written(comparison, best, out, report, draw=draw)
    complete = comparison.complete and (best is None or best.complete)
    if json:
        print_json(
            {
                "command": "rotary", **comparison.to_dict(), "search": None if best is None else best.to_dict(),
                "complete": complete, "elapsed_s": time.perf_counter() - began, "files": files,
            }
        )  # fmt: skip
    else:
        print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")), end="")
        print("\n" if files else "", end="")
    if not complete:
        say("interrupted: what is shown is what was found so far")
    return 0 if complete else 1


def _written(
    comparison: ScenarioComparison,
    best: SchemeSearch | None,
    out: Path | None,
    report: Path | None,
    *,
    draw: bool,
) -> dict[str, Path]:
    """Tables, figures and report, as far as they were asked for."""
    files: dict[str, Path] = {}
    if out is not None:
        from schuler.plotting.drawing import save_all
        from schuler.rotary.report import (
            errors_figure,
            front_figure,
            modulation_figure,
            rates_figure,
            scheme_figure,
        )

        files["errors"] = comparison.table().to_csv(out / "errors.csv")
        figures = [
            scheme_figure(comparison.rotary.schedule, float(comparison.rotary.t[-1])),
            modulation_figure(comparison),
        ]
        figures.append(errors_figure(comparison))
        if (rates := rates_figure(comparison)) is not None:
            files["rates"] = comparison.rates_table().to_csv(out / "rates.csv")
            figures.append(rates)
        if best is not None:
            files["schemes"] = best.table().to_csv(out / "schemes.csv")
            files["front"] = best.front_table().to_csv(out / "front.csv")
            files["best"] = _text(out / "best.toml", best.best().toml())
            figures += [front_figure(best), replace(scheme_figure(best.best().schedule, best.duration), name="best")]
        if draw:
            files |= named(save_all(figures, out, ("png", "svg")))
        report = report or out / "report.html"
    if report is not None:
        from schuler.rotary.report import rotary_page

        made_from = {"scenario": comparison.scenario.model_dump(mode="json", exclude_none=True, exclude_unset=True)}
        files["report"] = rotary_page(report, comparison, best, made_from)
    return files


def _text(path: Path, text: str) -> Path:
    from schuler.files import write_text

    return write_text(path, text + "\n")
