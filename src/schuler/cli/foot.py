"""``schuler foot``."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from schuler import units
from schuler.cli.output import Flag, Folder, drawable, named, print_json, print_verdict, progress, say, tabled, writable
from schuler.cli.reading import Reading, is_trial
from schuler.exceptions import InputError
from schuler.recording.recording import Recording

if TYPE_CHECKING:
    from schuler.navigation.foot.config import FootConfig
    from schuler.navigation.foot.errors import WalkErrors
    from schuler.navigation.foot.result import FootResult

_READING = Reading()


def foot(
    log: Path,
    /,
    *,
    detector: Literal["shoe", "ared", "amv", "magnitude"] | None = None,
    threshold: str | None = None,
    smooth: Literal["walk", "stride", "none"] | None = None,
    heading: float | None = None,
    labels: Literal["shoe", "ared", "amvd", "mbgtd", "vicon"] | None = None,
    out: Folder = None,
    report: bool = True,
    json: Flag = False,
    reading: Reading = _READING,
) -> int:
    """Navigate the log of an IMU on a shoe: rests, strides, the walk and its uncertainty.

    Parameters
    ----------
    log
        A PyShoe trial (.mat), an OpenShoe log (matrix u with --rate, or data_inert.txt), or any readable IMU log.
        The configuration of --config is that of docs/foot-mounted.md; all of it may be left out.
    detector
        Likelihood ratio, angular rate energy, acceleration variance, acceleration magnitude.
    threshold
        motion, time, noise, or a number.
    smooth
        Over the walk, with a delay of a stride, or not.
    heading
        At the start in degrees.
    labels
        Take the zero-velocity samples stored in a PyShoe trial instead of detecting any.
    out
        Folder for the files. Default: the log's name with -walk.
    report
        Write figures.
    json
        Print one JSON object instead of text.
    """
    from schuler.navigation.foot.config import FootConfig
    from schuler.navigation.foot.run import navigate_foot

    began = time.perf_counter()
    figures, tables = drawable(report), tabled()
    config = FootConfig() if reading.config is None else FootConfig.load(reading.config)
    config = _changed(config, detector=detector, threshold=threshold, smooth=smooth, heading=heading)
    folder = writable(Path(f"{log.resolve().stem}-walk")) if out is None else out
    recording, stored = read_foot_log(log, reading)
    if labels is not None and stored is None:
        raise InputError(f"--labels: {log} is not a PyShoe trial and has no labels")
    rest = None if labels is None or stored is None else stored[labels]
    with progress("walking") as bar:
        result = navigate_foot(recording, config, rest=rest, progress=bar)
    result, errors = _compared(recording, result)
    numbers = walk_numbers(result, errors)
    numbers["elapsed_s"] = time.perf_counter() - began
    files = write_walk(folder, result, errors, figures=figures, tables=tables)
    if json:
        print_json({"command": "foot", **numbers, "files": files})
    else:
        say(recording.summary(notes=False))  # the result has them
        print_verdict(result.verdict)
        print(result.summary())
        if errors is not None:
            print(
                f"against the reference: {errors.rms_horizontal:.3f} m RMS horizontal, {errors.end_horizontal:.3f} m "
                f"at the end, {errors.author_error:.3f} m by PyShoe's definition"
            )
        print("\n".join(f"{name}: {path}" for name, path in files.items() if not name.startswith("figure")))
    return 0 if result.navigation.complete else 1


def read_foot_log(log: Path, reading: Reading) -> tuple[Recording, dict[str, Any] | None]:
    """The recording, and the stored labels if it is a PyShoe trial."""
    from schuler.recording.formats.pyshoe import read_pyshoe
    from schuler.recording.part import cut

    if not is_trial(log, reading.given):
        return reading.read(log), None
    trial = read_pyshoe(log)
    complete = reading.start is None and reading.stop is None
    return cut(trial.recording, reading.start, reading.stop), trial.labels if complete else None


def walk_numbers(result: FootResult, errors: WalkErrors | None) -> dict[str, Any]:
    """The numbers of a walk, units in the names."""
    s, w, best = result.strides, result.strides.walking, result.best
    closure = result.closure_n
    pivot = result.pivot_b()

    def median(values: Any) -> float | None:
        return float(np.median(values[w])) if w.any() else None

    frequency = median(s.frequency)
    return {
        "verdict": result.verdict.to_dict(), "epochs": best.epochs, "states": best.layout.size,
        "smoothing": result.smoothing,
        "start_s": float(result.t[0]), "stop_s": float(result.t[-1]), "rests": len(result.rests),
        "resting_share": float(result.rests.mask.mean()), "zero_velocities": result.zero_velocities,
        "strides": int(w.sum()), "distance_m": result.distance, "median_length_m": median(s.length),
        "median_duration_s": median(s.duration), "median_speed_m_s": median(s.speed),
        "median_cadence_steps_min": None if frequency is None else 120.0 * frequency,
        "median_clearance_m": median(s.clearance), "end_north_m": float(closure[0]), "end_east_m": float(closure[1]),
        "end_down_m": float(closure[2]), "end_sigma_m": best.sigma("dr")[-1],
        "end_sigma_heading_deg": float(best.sigma("dpsi")[-1, 2] / units.DEG),
        "pivot_m": None if pivot is None else pivot[0], "errors": None if errors is None else errors.statistics(),
        "complete": result.navigation.complete, "notes": result.notes,
    }  # fmt: skip


def write_walk(
    folder: Path, result: FootResult, errors: WalkErrors | None, *, figures: bool, tables: bool
) -> dict[str, Path]:
    """Write solution, strides and figures; return their paths by name."""
    from schuler.files import write_text

    files: dict[str, Path] = {}
    if tables:
        files["solution"] = result.best.to_parquet(folder / "walk.parquet")
    s = result.strides
    rows = ["start_s,stop_s,lift_s,contact_s,north_m,east_m,down_m,length_m,speed_m_s,clearance_m,turn_deg,walking"]
    columns = (
        s.start, s.stop, s.lift, s.contact, *s.displacement_n.T, s.length, s.speed, s.clearance, s.turn / units.DEG
    )  # fmt: skip
    for values, walking in zip(zip(*columns, strict=True), s.walking, strict=True):
        rows.append(",".join(f"{v:.6g}" for v in values) + f",{int(walking)}")
    files["strides"] = write_text(folder / "strides.csv", "\n".join(rows) + "\n")
    if figures:
        from schuler.navigation.foot.figures import save_foot_figures

        files |= named(save_foot_figures(result, folder / "figures", errors=errors))
    return files


def _changed(
    config: FootConfig, *, detector: str | None, threshold: str | None, smooth: str | None, heading: float | None
) -> FootConfig:
    """The configuration with what the options say instead, checked again."""
    data = config.model_dump()
    if detector is not None:
        data["detector"]["kind"] = detector
    if threshold is not None:
        data["detector"]["threshold"] = threshold if threshold in ("motion", "time", "noise") else _number(threshold)
    if smooth is not None:
        data["filter"]["smooth"] = smooth
    if heading is not None:
        data["alignment"]["heading_deg"] = heading
    return type(config).parse(data, "options")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--threshold: expected motion, time, noise or a number, got {text!r}") from None


def _compared(recording: Recording, result: FootResult) -> tuple[FootResult, WalkErrors | None]:
    """Errors against the reference of a recording; where the two cannot be compared, a note on why."""
    from schuler.navigation.foot.errors import Fit, walk_errors

    if recording.reference is None:
        return result, None
    problems: list[str] = []
    for fit in get_args(Fit):
        try:
            errors = walk_errors(result, recording.reference, fit=fit)
            errors.statistics()
            if problems:
                return replace(result, notes=(*result.notes, f"compared in the mean heading: {problems[0]}")), errors
            return result, errors
        except (InputError, np.linalg.LinAlgError) as error:
            problems.append(str(error))
    return replace(result, notes=(*result.notes, f"not compared with the reference: {problems[-1]}")), None
