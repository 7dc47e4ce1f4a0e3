"""``schuler compare``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from schuler.cli.configuration import configuration, entries
from schuler.cli.output import Flag, Folder, Texts, drawable, named, print_json, progress, writable
from schuler.cli.reading import Part
from schuler.exceptions import InputError, SchulerError

if TYPE_CHECKING:
    from schuler.navigation.evaluation.runs import Run

_ALL = Part()


def compare(
    *logs: Path,
    config: Path | None = None,
    reference: Path | None = None,
    max_: Annotated[Texts, Parameter(name="--max")] = (),
    origin: str | None = None,
    modes: str | None = None,
    outage: Texts = (),
    outage_every: str | None = None,
    lengths: str | None = None,
    smooth: bool | None = None,
    set_: Annotated[Texts, Parameter(name="--set")] = (),
    out: Folder = None,
    unchecked: Flag = False,
    figures: bool = True,
    report: bool = True,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Compare runs, of this or other programs; or, with --config, navigate a log with several architectures.

    Runs: errors against a reference, along and across the track, one table and an overlay page; exit code 1 where a
    bound of --max is broken. Architectures: one table, with and without outages.

    Parameters
    ----------
    logs
        Runs: folders of schuler navigate, solutions, .pos, TUM, CSV, Parquet, ... With --config one log, file or
        folder; how it is read stands in the [recording] section of the configuration.
    config
        TOML file, see docs/navigation.md. The same for all architectures but for gnss.coupling and the aids.
    reference
        What runs are compared with, in any of their formats. Default: the first run.
    max_
        Largest value that every run must keep, such as horizontal_rms_m=1.0; may be given several times.
    origin
        Of runs in local coordinates: latitude,longitude in degrees, ellipsoidal height in metres.
    modes
        Architectures, such as ins,reset,loose,tight,loose+nhc,loose+zupt+nhc. Words after +: zupt, zaru, nhc,
        odometer, heading, barometer, fixes. Default: what the log and the configured aids allow.
    outage
        Withhold GNSS from START:STOP, seconds from the start of the recording; may be given several times.
    outage_every
        Withhold GNSS every PERIOD seconds for LENGTH: PERIOD:LENGTH, or PERIOD:LENGTH:FIRST.
    lengths
        Also statistics of many outages of these lengths in seconds, such as 2,10,30,60, for every architecture that
        uses GNSS.
    smooth
        Also the smoothed solutions; as configured if left out.
    set_
        Any entry of the configuration: SECTION.KEY=VALUE in TOML's spelling; may be given several times.
    out
        Folder for the tables as CSV and the figures. Default: the log's name with -comparison.
    unchecked
        Go on where the checks of units, axes, signs and clocks (schuler check) find an error; the result notes it.
    figures
        Draw figures of architectures too.
    report
        Write the overlay page of runs.
    json
        Print one JSON object instead of text.
    """
    if config is None:
        if modes or outage or outage_every or lengths or set_ or smooth is not None or unchecked or part != _ALL:
            raise InputError("--config: expected the configuration that a log is navigated with, got none")
        return _compare_runs(logs, reference, max_, origin, out, report=report, json=json)
    if len(logs) != 1 or reference is not None or max_ or origin is not None:
        raise InputError(
            "--config: expected one log with it, to be navigated; to compare runs give them without --config"
        )
    (log,) = logs
    from schuler.cli.reading import read_log
    from schuler.diagnosis.admission import checked
    from schuler.navigation.evaluation.architectures import compare_architectures
    from schuler.navigation.evaluation.outages import OutageStatistics, outage_statistics

    began = time.perf_counter()
    figures = drawable(figures)
    loaded = configuration(config, entries(set_), outage, outage_every)
    names = None if modes is None else [text for text in modes.split(",") if text.strip()]
    numbers = None if lengths is None else _lengths(lengths)
    folder = writable(Path(f"{log.resolve().stem}-comparison")) if out is None else out
    recording = checked(part.of(read_log(log, config)), unchecked=unchecked, clock_shift_s=loaded.imu.clock_shift_s)
    with progress("comparing") as bar:
        comparison = compare_architectures(recording, loaded, modes=names, smooth=smooth, progress=bar)
    statistics: list[OutageStatistics] = []
    if numbers is not None and comparison.complete:
        for mode in dict.fromkeys(row.mode for row in comparison.rows if not row.failed and row.mode.coupling != "ins"):
            with progress(f"outages, {mode.name}") as bar:
                one = outage_statistics(recording, mode.configure(loaded), lengths=numbers, progress=bar)
            statistics.append(replace(one, name=f"{recording.metadata.name}, {mode.name}"))
            if not one.complete:
                break
    complete = comparison.complete and all(s.complete for s in statistics)
    files = _write(folder, comparison, statistics, figures=figures)
    if json:
        data: dict[str, Any] = {"command": "compare", **comparison.to_dict(), "complete": complete}
        data["outage_statistics"] = [s.to_dict() for s in statistics]
        print_json({**data, "elapsed_s": time.perf_counter() - began, "files": files})
    else:
        print(comparison.summary())
        for s in statistics:
            print("\n" + s.summary())
        print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")))
    return 0 if complete else 1


def _compare_runs(
    runs: Sequence[Path], reference: Path | None, bounds: Sequence[str], origin: str | None, out: Path | None, *,
    report: bool, json: bool,
) -> int:  # fmt: skip
    """Compare runs: table, CSV, page; exit code 1 where a bound is broken."""
    from schuler.navigation.evaluation.runs import compare_runs, read_run

    limits = {}
    for text in bounds:
        key, _, value = text.partition("=")
        try:
            limits[key] = float(value)
        except ValueError:
            raise InputError(f"--max: expected NAME=VALUE such as horizontal_rms_m=1.0, got {text!r}") from None
    if not runs or (len(runs) < 2 and reference is None):
        raise InputError(
            "compare: expected two runs or more, or one and its --reference, or a log with --config; got "
            f"{', '.join(map(str, runs)) or 'none'}"
        )
    folder = writable(Path(f"{runs[0].resolve().stem}-comparison")) if out is None else out
    hints = {} if origin is None else {"origin": origin}

    def read(path: Path) -> Run:
        try:
            return read_run(path)  # a file in geodetic coordinates takes no origin
        except SchulerError:
            if not hints:
                raise
            return read_run(path, **hints)

    try:
        comparison = compare_runs(
            [read(p) for p in runs], None if reference is None else read(reference), bounds=limits
        )
    except InputError as error:
        raise InputError(str(error).replace("bounds: ", "--max: ", 1)) from None
    files = {"table": comparison.to_csv(folder / "runs.csv")}
    if report:
        files["report"] = comparison.report(folder / "runs.html")
    if json:
        print_json({"command": "compare", **comparison.to_dict(), "files": files})
    else:
        print(comparison.summary())
        print("\n".join(f"{name}: {path}" for name, path in files.items()))
    return 0 if comparison.passes else 1


def _lengths(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--lengths: expected seconds such as 2,10,30,60, got {text!r}") from None


def _write(folder: Path, comparison: Any, statistics: list[Any], *, figures: bool) -> dict[str, Path]:
    """Tables as CSV and figures; their paths by name."""
    files = {"table": comparison.to_csv(folder / "architectures.csv")}
    drawn = []
    if figures and any(row.errors is not None for row in comparison.rows):
        drawn.append(("architectures", comparison))
    for s in statistics:
        name = s.name.rpartition(", ")[2].replace("+", "_")
        files[f"outages_{name}"] = s.to_csv(folder / f"outages_{name}.csv")
        if figures and len(s):
            drawn.append((f"outages_{name}", s))
    if drawn:
        from schuler.plotting.drawing import save

        for name, what in drawn:
            files |= named(save(what.plot(), folder / name, ("png", "svg")))
    return files
