"""``schuler navigate``."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from schuler.cli.configuration import configuration, entries, with_outages
from schuler.cli.output import (
    Flag,
    Folder,
    Texts,
    drawable,
    named,
    print_json,
    print_verdict,
    progress,
    say,
    tabled,
    writable,
)
from schuler.cli.proposal import proposed
from schuler.cli.reading import Part, is_trial
from schuler.cli.rerun import write_run
from schuler.diagnosis.result import as_entries
from schuler.exceptions import InputError
from schuler.files import write_text
from schuler.navigation.evaluation.evaluated import EvaluatedRun, evaluate_run
from schuler.recording.recording import Recording

_ALL = Part()


def navigate(
    *logs: Path,
    config: Path | None = None,
    imu: str | None = None,
    calibration: Path | None = None,
    out: Folder = None,
    outage: Texts = (),
    outage_every: str | None = None,
    smooth: bool | None = None,
    coupling: Literal["loose", "tight", "reset", "off"] | None = None,
    aid: Texts = (),
    without: Texts = (),
    background: Path | None = None,
    set: Texts = (),
    unchecked: Flag = False,
    accept: Flag = False,
    report: bool = True,
    figures: Flag = False,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Navigate a log and write solution, smoothed solution, report and track.

    The verdict on the run stands first: ok, doubtful, or failed, for which the exit code is 1.

    Parameters
    ----------
    logs
        File or folder; how it is read stands in the [recording] section of the configuration. Without a configuration
        also the files of one run, or its folder and files that lie elsewhere, which come before those in it.
    config
        TOML file, see docs/navigation.md. Without one it is proposed from what the log shows, printed with its
        evidence, and written beside the result as drive.toml; see docs/howto/from-a-folder-to-a-track.md.
    imu
        Without a configuration: the IMU by its name in the catalogue, or a file of schuler allan.
    calibration
        File of a calibration of this unit: sensor states start from its values and covariance, the rest is taken out
        of the log. Instead of imu.calibration of the configuration.
    out
        Folder for the files. Default: the log's name with -solution.
    outage
        Withhold GNSS from START:STOP, seconds from the start of the recording; may be given several times.
    outage_every
        Withhold GNSS every PERIOD seconds for LENGTH: PERIOD:LENGTH, or PERIOD:LENGTH:FIRST.
    smooth
        Also the smoothed solution; as configured if left out.
    coupling
        How GNSS is used: solutions (loose), satellite by satellite (tight), as resets, or not at all (off).
    aid
        Switch an aid on, as configured or with its defaults: zero_velocity or gravity, zero_rate or earth_rate,
        non_holonomic, odometer, heading, barometer; may be given several times.
    without
        Switch a configured aid off; may be given several times.
    background
        Map under the track: GeoJSON, GeoTIFF, MBTiles, or a picture with a world file; see docs/reports.md.
    set
        Any entry of the configuration: SECTION.KEY=VALUE in TOML's spelling, such as filter.states=21; may be given
        several times.
    unchecked
        Go on where the checks of units, axes, signs and clocks (schuler check) find an error; the result notes it.
    accept
        Exit code 0 also where the verdict is failed.
    report
        Write report.html.
    figures
        Write each figure as PNG and SVG, for print; they take longer than all the rest.
    json
        Print one JSON object instead of text.
    """
    from schuler.cli.reading import read_log
    from schuler.diagnosis.admission import checked
    from schuler.filtering.kernels.run import compile_filter_beside
    from schuler.navigation.run import navigate as run

    began = time.perf_counter()
    if not logs:
        raise InputError("navigate: expected a file or folder, got none")
    if out is None:
        writable(Path())
    compile_filter_beside()
    figures, tables = drawable(figures), tabled()
    changes = entries(set)
    if calibration is not None:
        changes.append(("imu.calibration", str(calibration.resolve())))
    if coupling is not None:
        changes.append(("gnss.coupling", coupling))
    if smooth is not None:
        changes.append(("filter.smooth", smooth))
    changes += [(f"aiding.{name}", {}) for name in aid]
    proposal = None
    if config is None:
        if any(is_trial(log, {}) for log in logs):
            raise InputError(f"{logs[0]} is a walk of an IMU on a shoe: schuler foot {logs[0]}")
        proposal = proposed(logs, imu, changes, without, part=part)
        log, changes = proposal.log, []
        loaded = with_outages(proposal.config, outage, outage_every)
        recording = proposal.recording
    else:
        if len(logs) > 1 or imu is not None:
            raise InputError(
                "--config says which files are read and what the IMU is: give one LOG and no --imu with it"
            )
        log = logs[0]
        changes += [(f"aiding.{name}", None) for name in without]
        loaded = configuration(config, changes, outage, outage_every)
        recording = part.of(read_log(log, config))
    recording = checked(recording, unchecked=unchecked, clock_shift_s=loaded.imu.clock_shift_s)
    backdrop = None
    if background is not None:
        from schuler.navigation.report.backdrop import read_backdrop

        backdrop = read_backdrop(background)
    still = None
    if (
        report or figures
    ) and recording.imu is not None:  # now: with the solution beside it a day takes too much memory
        from schuler.navigation.report.subject import still_stretches

        still = still_stretches(recording.imu)
    with progress("navigating") as bar:
        result = run(recording, loaded, progress=bar)
    folder = Path(f"{log.resolve().stem}-solution") if out is None else out
    outcome = evaluate_run(recording, result, loaded.filter.smooth)
    outcome.numbers["elapsed_s"] = time.perf_counter() - began
    files = write_outputs(
        folder, recording, outcome, report=report, figures=figures, tables=tables, background=backdrop, still=still
    )
    if proposal is not None:
        files["configuration"] = write_text(folder / "drive.toml", proposal.toml())
    printed = "\n".join((recording.summary(), result.verdict.summary(), result.summary(), sentences(outcome.numbers)))
    files |= write_run(folder, log, recording, loaded, outcome.numbers, part=part, unchecked=unchecked, text=printed)
    if json:
        more = {} if proposal is None else {"decisions": [asdict(d) for d in proposal.decisions]}
        print_json({"command": "navigate", **outcome.numbers, **more, "files": files})
    else:
        say(recording.summary(notes=False))  # the result has them
        print_verdict(result.verdict)
        print(as_entries(result.summary()))
        print(sentences(outcome.numbers))
        print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")))
    return 0 if result.complete and (accept or result.verdict.status != "failed") else 1


def write_outputs(
    folder: Path,
    recording: Recording,
    outcome: EvaluatedRun,
    *,
    report: bool,
    figures: bool,
    tables: bool,
    background: Any = None,
    still: list[tuple[float, float]] | None = None,
) -> dict[str, Path]:
    """Write all files of a run; return their paths by name."""
    from schuler.recording.formats.track import write_kml

    result, smoothed = outcome.result, outcome.smoothed
    files: dict[str, Path] = {}
    best = result if smoothed is None else smoothed
    if tables:
        files["solution"] = result.to_parquet(folder / "solution.parquet")
        if smoothed is not None:
            files["smoothed"] = smoothed.to_parquet(folder / "smoothed.parquet")
    files["track"] = write_kml(
        folder / "track.kml", best.antenna() if outcome.at_antenna else best.trajectory,
        name=recording.metadata.name, outages=result.outages, time=recording.metadata.time,
    )  # fmt: skip
    shown = {
        "smoothed": smoothed, "reference": outcome.reference, "at_antenna": outcome.at_antenna,
        "truth_parameters": outcome.truth_parameters, "origin": recording.start, "gnss": recording.gnss,
        "ranges": result.ranges, "points": result.points, "background": background,
        "imu": recording.imu, "still": still,
    }  # fmt: skip
    if report:
        from schuler.navigation.report.document import navigation_report

        files["report"] = navigation_report(
            result,
            folder / "report.html",
            title=recording.metadata.name,
            recording_summary=recording.summary(),
            **shown,
        )
    if figures:
        from schuler.navigation.report.figures import save_figures

        files |= named(save_figures(result, folder / "figures", **shown))
    return files


def sentences(numbers: dict[str, Any]) -> str:
    """The numbers people ask for first, in a few lines."""
    lines = []
    if numbers["rms_horizontal_m"] is not None:
        lines.append(
            f"horizontal error against {numbers['reference']}: {numbers['rms_horizontal_m']:.3f} m RMS, "
            f"{numbers['max_horizontal_m']:.3f} m largest"
        )
    for key, what in ((numbers, "filtered"), (numbers.get("smoothed", {}), "smoothed")):
        outages = key.get("outages")
        if outages:
            worst = max(o["max_horizontal_m"] for o in outages)
            among = "one outage" if len(outages) == 1 else f"{len(outages)} outages"
            mean = "" if len(outages) == 1 else f"{key['mean_outage_max_horizontal_m']:.3f} m on average, "
            lines.append(
                f"{what}, {among}: largest horizontal error {mean}{worst:.3f} m{' at worst' if mean else ''}; "
                f"{key['rms_horizontal_aided_m']:.3f} m RMS with GNSS"
            )
    if "smoothed" in numbers and numbers["smoothed"]["rms_horizontal_m"] is not None:
        lines.append(f"smoothed: {numbers['smoothed']['rms_horizontal_m']:.3f} m RMS horizontal")
    if numbers["nees_mean"] is not None:
        lines.append(
            f"normalised estimation error squared per degree of freedom: {numbers['nees_mean']:.2f} (honest: 1)"
        )
    return "\n".join(lines)
