"""``schuler points``."""

from __future__ import annotations

import time as clock
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from schuler import units
from schuler.cli.baseline import ephemerides_of
from schuler.cli.output import Flag, Folder, print_json, print_verdict, progress, say, writable
from schuler.cli.reading import Part
from schuler.exceptions import FileFormatError, InputError
from schuler.files import check_log
from schuler.gnss.atmosphere import Ionosphere, Troposphere
from schuler.recording.recording import Metadata, Recording

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.gnss.point_evaluation import PointEvaluation
    from schuler.gnss.point_result import PointSolution
    from schuler.gnss.ranges import Ranges
    from schuler.navigation.evaluation.runs import Run

_ALL = Part()
_NO_EPHEMERIS, _NOT_SELECTED = 1, 7  # of schuler.gnss.ranges.REASONS
_TOO_FEW, _NOT_ASKED_FOR = 2, 7  # of schuler.gnss.point_result.STATUS
_MEASURED = "raw measurements of a receiver (RINEX observations, u-blox RXM-RAWX, RTCM 3, GnssLogger)"
_OF_ANYTHING = (".parquet", ".mat")
#: Names of options by those of the library's arguments.
_OPTIONS = {"missed_detection": "--risk", "elevation_mask": "--elevation-mask", "cn0_mask": "--cn0-mask"}


def points(
    log: Path,
    /,
    *,
    nav: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    systems: str = "GRECJ",
    elevation_mask: float = 10.0,
    cn0_mask: float = 25.0,
    ionosphere: Ionosphere = "klobuchar",
    troposphere: Troposphere = "saastamoinen",
    risk: float = 1e-3,
    reference: Path | None = None,
    alert_limit: float = 40.0,
    time: str | None = None,
    background: Path | None = None,
    out: Folder = None,
    report: bool = True,
    json: Flag = False,
    part: Part = _ALL,
) -> int:
    """Positions of a satellite receiver epoch by epoch, from its pseudoranges alone: no IMU, no base.

    Faults are found and left out, each position has protection levels. The verdict stands first; the exit code is 1
    where no epoch could be solved.

    Parameters
    ----------
    log
        Raw measurements of a receiver (RINEX, u-blox, RTCM 3, GnssLogger, any log that has them), or a folder with one
        such file and its navigation files.
    nav
        File with broadcast ephemerides, precise orbits (SP3), clocks, ionosphere maps (IONEX) or biases; several
        allowed. Messages in the log itself are used too.
    systems
        Letters out of GRECJ (GPS, GLONASS, Galileo, BeiDou, QZSS).
    elevation_mask
        Lowest elevation in degrees.
    cn0_mask
        Weakest signal in dB-Hz.
    ionosphere
        klobuchar: model with GPS's coefficients; beidou, galileo: with those of that system; nequick-g: with Galileo's,
        too, by the library nequick; maps: of an IONEX file among --nav; free: taken out by two bands; none: for
        simulators without one.
    troposphere
        saastamoinen, or none.
    risk
        Integrity risk of the protection levels: probability per epoch that one satellite is at fault by any amount,
        the test passes, and the error is beyond the level.
    reference
        Truth at the antenna, in any format that holds a track: errors, and Stanford diagrams.
    alert_limit
        Protection level in metres above which a position is not to be used, for the Stanford diagrams.
    time
        Week of an RTCM 3 log, which states the time of week only: gps-tow:WEEK.
    background
        Map under the track: GeoJSON, GeoTIFF, MBTiles, or a picture with a world file; see docs/reports.md.
    out
        Folder for points.pos, points.csv, points.kml and report.html. Default: the log's name with -points.
    report
        Write report.html.
    json
        Print one JSON object instead of text.
    """
    from schuler.gnss.integrity import Integrity
    from schuler.gnss.point import solve_points
    from schuler.gnss.point_evaluation import PointEvaluation

    began = clock.perf_counter()
    if not 0.0 < alert_limit < np.inf:
        raise InputError(f"--alert-limit: expected a positive number of metres, got {alert_limit}")
    truth = None if reference is None else _read_reference(reference)  # what is wrong with it is said before the work
    whole = _log(log, nav, time)
    recording, backdrop = part.of(whole), None
    if background is not None:
        from schuler.navigation.report.backdrop import read_backdrop

        backdrop = read_backdrop(background)
    folder = writable(Path(f"{log.resolve().stem}-points")) if out is None else out
    options: dict[str, Any] = {
        "systems": systems, "elevation_mask": elevation_mask * units.DEG, "cn0_mask": cn0_mask,
        "ionosphere": ionosphere, "troposphere": troposphere,
    }  # fmt: skip
    try:
        integrity = Integrity(missed_detection=risk)
        ranges = _ranges(recording, log, nav, options)
    except InputError as error:
        name, colon, rest = str(error).partition(":")
        name = _OPTIONS.get(name, f"--{name}" if name in options else name)
        raise InputError(name + colon + rest) from None
    with progress("solving positions") as bar:
        solution = solve_points(ranges, integrity=integrity, progress=bar)
    about = recording.metadata
    notes = [n for n in about.notes if n not in solution.notes]
    true_r_e = None if truth is None else _true_positions(truth, solution, about, notes)
    evaluation = PointEvaluation(
        replace(solution, notes=(*notes, *solution.notes)), ranges, true_r_e, alert_limit,
        about.time.epoch_gps_s if about.time.scale == "gps" else None,
    )  # fmt: skip
    made_of = {
        "log": about.name, "sources": about.sources,
        "options": {**options, "elevation_mask": f"{elevation_mask:g} deg", "risk": risk, "alert_limit": alert_limit},
    }  # fmt: skip
    evaluation, files = _write(folder, evaluation, about)
    if report:
        from schuler.navigation.report.points import points_report

        files["report"] = points_report(
            evaluation, folder / "report.html", title=about.name, provenance=made_of, background=backdrop
        )
    verdict = evaluation.verdict
    if json:
        elapsed = clock.perf_counter() - began
        print_json({"command": "points", **evaluation.to_dict(), "elapsed_s": elapsed, "files": files})
    else:
        print_verdict(verdict)
        print(evaluation.summary())
        for note in evaluation.points.notes:
            say(note)
        print("\n".join(f"{name}: {path}" for name, path in files.items()))
    return int(verdict.status == "failed")


def _log(log: Path, nav: tuple[Path, ...], time: str | None) -> Recording:
    """The log with what it has of messages; of a folder the receiver's file and all navigation files."""
    from schuler.recording.formats import registry
    from schuler.recording.io import dispatch
    from schuler.recording.io.folder import recognised
    from schuler.recording.io.hints import ReadHints
    from schuler.recording.io.satellite_files import channels_of

    check_log(log)
    hints = {} if time is None else {"time": time}
    if log.is_dir() and registry.find_folder(log) is None:
        observations, messages, note = _files(log)
        entries: dict[str, Any] = {"observations": {"file": observations, **hints}}
        if messages:
            entries["ephemerides"] = {"file": messages}
        recording = dispatch.read(log, **entries)
        return replace(recording, metadata=recording.metadata.noting(*note))
    channels: dict[int, int] = {}
    for path in nav:
        if not path.exists():
            raise InputError(f"--nav {path}: no such file")
        channels |= channels_of(dispatch.read(path))  # GLONASS's, which RINEX 2 does not state
    try:
        return dispatch.read_one(log, ReadHints.of(**hints), channels)
    except (FileFormatError, InputError):
        if "observations" in recognised(log) or log.suffix.lower() in _OF_ANYTHING:
            raise
        raise InputError(f"{log}: expected {_MEASURED}; it is none of these") from None


def _files(folder: Path) -> tuple[str, list[str], list[str]]:
    """The receiver's file of a folder, its navigation files, and a note on what is not read.

    Of files with one stem, as a receiver's own and what was made of it, RINEX is taken.
    """
    from schuler.recording.io import lines
    from schuler.recording.io.folder import recognised
    from schuler.recording.io.satellite_files import rinex_kind

    held = {p: recognised(p) for p in sorted(folder.iterdir()) if p.is_file() and not p.name.startswith(".")}
    measured = [p for p, kinds in held.items() if "observations" in kinds]
    messages = [p.name for p, kinds in held.items() if "ephemerides" in kinds and "observations" not in kinds]
    if not measured:
        inside = ", ".join(p.name for p in list(held)[:8]) or "no files"
        raise InputError(
            f"{folder}: expected one file of {_MEASURED}, got {inside}; give the file itself, with its --nav"
        )
    note: list[str] = []
    if len({p.stem for p in measured}) == 1 and len(measured) > 1:
        rinex = [p for p in measured if rinex_kind(p, lines.check_file(p)) is not None]
        if len(rinex) == 1:
            others = ", ".join(p.name for p in measured if p != rinex[0])
            note, measured = [f"Not read beside {rinex[0].name}, which has the same name: {others}."], rinex
    if len(measured) > 1:
        more = "".join(f" --nav {folder / name}" for name in messages)
        raise InputError(
            f"{folder}: expected one file of raw measurements, got {', '.join(p.name for p in measured)}; give one of "
            f"them: schuler points {measured[0]}{more}"
        )
    return measured[0].name, messages, note


def _ranges(recording: Recording, log: Path, nav: tuple[Path, ...], options: dict[str, Any]) -> Ranges:
    """Ranges of the measurements, or those of a log that has them ready for positioning."""
    from schuler.gnss.preparation import prepare_ranges

    o = recording.observations
    if o is None and recording.ranges is not None:
        note = "the log's ranges are corrected already: systems, masks and models are theirs"
        return replace(recording.ranges, notes=(*recording.ranges.notes, note))
    if o is None or not len(o):
        raise InputError(f"{log}: expected {_MEASURED}, got {recording.summary(notes=False).splitlines()[0]}")
    messages = ephemerides_of([recording], nav, f"{log} has no ephemerides{_beside(log)}")
    ranges = prepare_ranges(o, messages, **options)
    if np.isin(ranges.reason, (_NOT_SELECTED, _NO_EPHEMERIS)).all():
        from schuler.gnss.differences import date, listed_messages
        from schuler.gnss.signals import SYSTEMS

        held = "".join(SYSTEMS[k] for k in np.unique(o.sat // 100))
        if (ranges.reason == _NOT_SELECTED).all():
            raise InputError(f"--systems {options['systems']}: expected some of those in {log}: {held}")
        raise InputError(
            f"{log}: no ephemeris for any of its satellites; it begins at {date(o.epoch_gps_s + float(o.t[0]))} GPS, "
            f"{listed_messages(messages)}; give a RINEX navigation file, or precise orbits, of that day with --nav, "
            f"for systems among {held}"
        )
    return ranges


def _beside(log: Path) -> str:
    """Navigation files beside a log, in words; empty without."""
    from schuler.recording.io.folder import recognised

    folder = log if log.is_dir() else log.parent
    near = [p for f in (folder, folder.resolve().parent) for p in sorted(f.iterdir()) if p.is_file()]
    names = [str(p) for p in near if p != log and "ephemerides" in recognised(p)]
    return f" (near it: {', '.join(names[:4])})" if names else ""


def _read_reference(path: Path) -> Run:
    """A reference as a run; a table without a header by its numbers, or refused with the command that converts it."""
    from schuler.navigation.evaluation.runs import read_run
    from schuler.proposal.hints import is_plain, table_hints

    try:
        return read_run(path)
    except (InputError, FileFormatError) as error:
        hints, decisions = table_hints(path, "reference", None) if is_plain(path) else (None, [])
        if hints and "lat" in hints.get("columns", ""):
            for d in decisions:
                say(f"--reference {path.name}: {d.entry.rpartition('.')[2]} {d.value}: {d.evidence}")
            return read_run(path, **hints)
        problem = str(error).partition(": say ")[0]
        raise InputError(
            f"--reference {problem}; a table that does not say what its columns are is converted first, such as: "
            f"schuler convert {path} truth.parquet --series reference --columns t,lat,lon,h --units angle=deg "
            "--time gps-tow:WEEK"
        ) from None


def _true_positions(run: Run, points: PointSolution, about: Metadata, notes: list[str]) -> FloatArray:
    """Antenna of a reference at the points' times, NaN outside its span and in its pauses. Shape (k, 3). [m]"""
    from schuler.navigation.evaluation.runs import Run, aligned, in_gaps
    from schuler.recording.trajectory import Trajectory

    if not points.ok.any():
        return np.full((len(points), 3), np.nan)
    own = Run("points", Trajectory(points.t[points.ok], points.r_e[points.ok]), about.time, "antenna", None, "")
    track = aligned(run, run.name, own, notes)
    inside = (points.t >= track.t[0]) & (points.t <= track.t[-1]) & ~in_gaps(track.t, points.t)
    if not inside.any():
        raise InputError(
            f"--reference {run.name}: expected times that overlap, got {track.t[0]:.3f}..{track.t[-1]:.3f} s, and "
            f"points at {points.t[0]:.3f}..{points.t[-1]:.3f} s; are they on one clock?"
        )
    out = np.full((len(points), 3), np.nan)
    out[inside] = track.at(points.t[inside]).r_eb_e
    return out


def _write(folder: Path, evaluation: PointEvaluation, about: Metadata) -> tuple[PointEvaluation, dict[str, Path]]:
    """Table, positions and track of an evaluation; it comes back with notes on what is not in them."""
    from schuler.recording.formats.rtklib import write_pos
    from schuler.recording.io import write
    from schuler.recording.satellite_positions import gnss_series

    files = {"table": evaluation.table().to_csv(folder / "points.csv")}
    points = evaluation.points
    if not points.ok.any():
        return evaluation, files
    missing = int(points.ok.sum()) - int(points.velocity_ok.sum())
    still = replace(points, velocity_status=np.full(len(points), _NOT_ASKED_FOR)) if missing else points
    moving = None
    if missing and points.velocity_ok.any():
        moving = gnss_series(replace(points, status=np.where(points.velocity_ok, points.status, _TOO_FEW)))
    if missing:
        note = f"{missing} of {int(points.ok.sum())} positions have no velocity: their rows of points.pos end before it"
        evaluation = replace(evaluation, points=replace(points, notes=(*points.notes, note)))
    fixes = Recording(gnss=gnss_series(still), metadata=replace(about, notes=evaluation.points.notes))
    if about.time.scale == "gps":
        (files["points"],) = write_pos(fixes, folder / "points.pos", velocities=moving)
    (files["track"],) = write(fixes, folder / "points.kml")
    return evaluation, files
