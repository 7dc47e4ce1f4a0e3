"""``schuler montecarlo``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from schuler.cli.output import Flag, Folder, drawable, named, print_json, progress, say, writable
from schuler.exceptions import InputError

if TYPE_CHECKING:
    from schuler.montecarlo.error_scatter import Scatter


def montecarlo(
    scenario: Path,
    /,
    *,
    config: Path | None = None,
    runs: int | None = None,
    seed: int | None = None,
    store: Folder = None,
    resume: Flag = False,
    scheduler: str | None = None,
    workers: int | None = None,
    batch: int | None = None,
    engine: Literal["auto", "filter", "lanes"] | None = None,
    out: Folder = None,
    report: bool = True,
    json: Flag = False,
) -> int:
    """Simulate and navigate a mission many times, each with other errors, and compare the runs with the truth.

    Parameters
    ----------
    scenario
        TOML file of a campaign, see docs/monte-carlo.md, or of a scenario as for schuler simulate.
    config
        Configuration of the filter as for schuler navigate, instead of the campaign's.
    runs
        How many; default as in the file, else 100.
    seed
        Of the campaign, instead of the file's.
    store
        Folder to which runs are written as they finish; nothing in it is done again.
    resume
        Go on with a store that holds runs.
    scheduler
        Address of a Dask cluster that does the work, such as tcp://192.168.1.5:8786.
    workers
        Threads or processes on this machine. Default: one a processor.
    batch
        Runs that are handed out and stored together. Default: as many as take a few seconds.
    engine
        filter: every run through all of simulation and navigation; lanes: in lock-step, rounding of readings left out;
        auto: lanes where they leave nothing out.
    out
        Folder for the tables and the report. Default: the scenario's name with -montecarlo.
    report
        Write report.html and figures.
    json
        Print one JSON object instead of text.
    """
    from schuler.montecarlo import Statistics
    from schuler.montecarlo.engine import campaign
    from schuler.montecarlo.error_scatter import SHOWN, scatter
    from schuler.montecarlo.job import read_job
    from schuler.montecarlo.navigation import runner

    began = time.perf_counter()
    if resume and store is None:
        raise InputError("--resume: say which store is to be gone on with (--store)")
    figures = drawable(report)
    folder = writable(Path(f"{scenario.resolve().stem}-montecarlo")) if out is None else out
    job, file = read_job(scenario, config, engine)
    function, why = runner(job, file.engine)
    count = file.runs if runs is None else runs
    say(f"{job.name}: {count} runs; {why}")
    with progress("running", total=count, unit="runs") as bar:
        done = campaign(
            function, job, count, seed=file.seed if seed is None else seed, store=store, resume=resume,
            scheduler=scheduler, workers=workers, batch=batch, statistics=Statistics(quantiles=SHOWN), progress=bar,
        )  # fmt: skip
    if not done.complete:
        kept = f"what is done stays in {store}: add --resume to go on" if store else "give --store to keep what is done"
        say(f"interrupted after {done.done} of {count} runs; {kept}")
    if not done.statistics or done["position"].n < 2:
        say("two runs or more are needed for statistics")
        return 1
    errors = scatter(done, job)
    files = _write(errors, folder)
    if report:
        from schuler.montecarlo.report import all_figures
        from schuler.plotting.drawing import save_all

        files["report"] = errors.report(folder / "report.html", done, job)
        if figures:
            files |= named(save_all(all_figures(errors), folder / "figures", ("png", "svg")))
    if json:
        print_json(
            {
                "command": "montecarlo", "engine": function.__name__, "why": why,
                **done.to_dict(), **errors.to_dict(),
                "table": errors.table().to_dict(), "tenths": errors.tenths().to_dict(),
                "elapsed_s": time.perf_counter() - began, "store": store, "files": files,
            }
        )  # fmt: skip
    else:
        print(done.summary().splitlines()[0])
        print(errors.summary())
        if done.failures:
            print(done.summary().splitlines()[-1].strip())
        print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")))
    return 0 if done.complete else 1


def _write(errors: Scatter, folder: Path) -> dict[str, Path]:
    return {
        "errors": errors.table().to_csv(folder / "errors.csv"),
        "tenths": errors.tenths().to_csv(folder / "tenths.csv"),
    }
