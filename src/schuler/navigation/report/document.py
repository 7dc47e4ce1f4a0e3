"""One self-contained HTML page on a navigation solution: opens from a disk, without a network, on a phone, on paper."""

from __future__ import annotations

from html import escape
from pathlib import Path

from schuler.arrays import ArrayLike
from schuler.files import write_text
from schuler.filtering.states import BLOCK_TEXT
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import Ranges
from schuler.navigation.report import build, estimates, innovations, verdict
from schuler.navigation.report.backdrop import Backdrop
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import track
from schuler.navigation.result import NavigationResult
from schuler.plotting import parts
from schuler.plotting.page import Section, whole_page
from schuler.plotting.page import plotly_script as _plotly
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.recording.trajectory import Trajectory


def navigation_report(
    result: NavigationResult,
    path: Path | str,
    *,
    smoothed: NavigationResult | None = None,
    reference: Trajectory | None = None,
    at_antenna: bool = False,
    truth_parameters: ArrayLike | None = None,
    title: str | None = None,
    recording_summary: str | None = None,
    origin: float | None = None,
    gnss: GnssSeries | None = None,
    ranges: Ranges | None = None,
    points: PointSolution | None = None,
    background: Backdrop | Path | str | None = None,
    imu: ImuSeries | None = None,
    still: list[tuple[float, float]] | None = None,
) -> Path:
    """Write the report of a navigation solution.

    Parameters
    ----------
    result : NavigationResult
        Filtered, or smoothed if that is all there is.
    path : Path or str
        The HTML file.
    smoothed : NavigationResult, optional
        Smoothed solution of the same run.
    reference : Trajectory, optional
        Truth or a better solution; without it the claimed uncertainty is shown instead of errors.
    at_antenna : bool
        The reference is the antenna's, not the IMU's.
    truth_parameters : array_like, shape (m,) or (k, m), optional
        True parameters in the order of the layout, constant or at each record, SI.
    title : str, optional
        Default: the name of the recording.
    recording_summary : str, optional
        What was in the log, see :meth:`~schuler.recording.recording.Recording.summary`.
    origin : float, optional
        Time that is called zero; default the first time of the solution. [s]
    gnss : GnssSeries, optional
        The fixes, so that those withheld in outages are shown too.
    ranges : Ranges, optional
        What a tightly coupled run was given, with what was left out and why: satellites are then shown one by one.
    points : PointSolution, optional
        Single-point solutions of these ranges, for their dilutions and to draw them.
    background : Backdrop, Path or str, optional
        Map behind the track, see :func:`schuler.navigation.report.backdrop.read_backdrop`.
    imu : ImuSeries, optional
        The IMU's log, to show it sample by sample, its rests and its spectrogram.
    still : list of (start, stop), optional
        Stretches in which it is still, where they are known already:
        :func:`schuler.navigation.report.subject.still_stretches`. [s]

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.

    Raises
    ------
    InputError
        If the background is not usable, or does not show the track.
    """
    script = _plotly()
    subject = Subject(
        result,
        smoothed,
        reference,
        at_antenna,
        truth_parameters,
        origin,
        gnss,
        ranges,
        points,
        background,
        imu,
        still,
    )
    text = _page(
        subject, script, title or str(result.provenance.get("recording", "Navigation solution")), recording_summary
    )
    return write_text(path, text)


def _page(subject: Subject, script: str, title: str, recording_summary: str | None) -> str:
    sections = [
        Section("numbers", "Key numbers", (_numbers(subject),)),
        Section("motion", "Motion", (*build.motion_figures(subject),)),
        Section("errors", "Errors" if subject.errors else "Uncertainty", (*build.error_figures(subject),)),
        # figures stand before the table that lists every single one of the same numbers
        Section("outages", "Outages", (*build.outage_figures(subject), _outage_table(subject))),
        Section("separation", "Filtered against smoothed", (*build.separation_figures(subject),)),
        Section("satellites", "Satellites", (*build.satellite_figures(subject),)),
        Section("parameters", "Parameters", (_parameter_table(subject), *build.parameter_figures(subject))),
        Section("innovations", "Innovations", (*build.innovation_figures(subject), _satellite_table(subject))),
        Section("log", "The log", (*build.log_figures(subject),)),
        Section("notes", "Notes", (parts.notes(subject.result.notes),)),
        Section("provenance", "Provenance", (_provenance(subject, recording_summary),), folded=True),
    ]
    return whole_page(
        title,
        "navigation report",
        _subtitle(subject),
        (*verdict.judgement(subject), *verdict.verdict(subject)),
        _conventions(subject),
        sections,
        script,
        tone="" if (status := subject.result.verdict.status) == "ok" else status,
        leading=track(subject),
    )


def _subtitle(subject: Subject) -> str:
    r = subject.result
    start, stop = subject.span
    kind = " and ".join(role for role, _ in subject.solutions)
    text = f"Navigation report: {kind} solution, {stop - start:.0f} s, {r.epochs} IMU samples, {r.layout.size} states"
    return text if r.complete else text + "; the run was INTERRUPTED and ends early"


def _conventions(subject: Subject) -> str:
    zero = "the solution's first sample" if subject.origin is None else "the start of the recording"
    against = "reference" if subject.reference is not None else "truth"
    return (
        f"Conventions: errors are estimate minus {against}, along north, east and down (attitude: rotations about "
        "them); body axes are forward, right, down; heights are above the ellipsoid; times are seconds since "
        f"{zero}; sigma is one standard deviation as the filter states it."
    )


def _numbers(subject: Subject) -> str:
    heads, rows = verdict.key_numbers(subject)
    against = f" against {subject.reference_name}" if subject.errors else ""
    text = parts.table(
        f"Accuracy{against}, and what the filter claims", ("quantity", *heads), [(r.name, *r.values) for r in rows]
    )
    counts = verdict.measurement_rows(subject)
    if counts:
        heads = ("measurement", "used", "rejected", "after lock-out", "condition not met", "outside the run")
        text += "\n" + parts.table(
            "Measurements offered to the filter; those taken after lock-out are among the used", heads, counts
        )
    return text


def _satellite_table(subject: Subject) -> str:
    rows = innovations.satellite_rows(subject)
    if not rows:
        return ""
    heads = ("satellite", "used", "rejected", "mean [m]", "RMS [m]", "NIS of ranges", "NIS of range rates")
    return parts.table(
        "Innovations of pseudoranges by satellite, and their sizes against what was predicted", heads, rows
    )


def _outage_table(subject: Subject) -> str:
    rows = verdict.outage_rows(subject)
    if not rows:
        return ""
    heads = ["no.", "from [s]", "to [s]"]
    heads += [f"{role} [m]" for role in subject.errors]
    table = parts.table("Largest horizontal error in each outage, in brackets that at its end", heads, rows)
    return table if len(rows) <= 30 else parts.folded(f"All {len(rows)} outages", table)


def _parameter_table(subject: Subject) -> str:
    rows = estimates.parameter_rows(subject)
    if not rows:
        return ""
    true = subject.truth is not None
    heads = ["parameter", "estimate ± 1 sigma", *(["true"] if true else []), "sigma left"]
    caption = "Estimates at the end of the run; the last column is what is left of the uncertainty stated beforehand"
    return parts.table(caption, heads, [r if true else (r[0], r[1], r[3]) for r in rows])


def _provenance(subject: Subject, recording_summary: str | None) -> str:
    r = subject.result
    rows = parts.provenance_rows(r.provenance)
    rows.append(("states", f"{r.layout.size}: {', '.join(r.layout.blocks)}"))
    rows += [
        (f"model of {b}", f"{BLOCK_TEXT[b][0]} [{BLOCK_TEXT[b][1]}]: {m.describe()}")
        for b, m in r.layout.models.items()
    ]
    arm = ", ".join(f"{v:g}" for v in r.lever_arm_b)
    rows.append(("lever arm [m]", arm if r.point == "imu" else "not stated: positions are those of the antenna"))
    rows.append(("covariance propagations", str(r.propagations)))
    text = parts.table("What this result was made from", ("item", "value"), rows, numbers=False)
    if recording_summary:
        # its notes are among those of the result, and stand above
        note_lines = {f"- {note}" for note in r.notes}
        lines = [line for line in recording_summary.splitlines() if line.strip() not in note_lines]
        text += "\n<h3>The recording</h3>\n<pre>" + escape("\n".join(lines)) + "</pre>"
    return text
