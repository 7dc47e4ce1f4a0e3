"""Figures of a navigation solution, drawn with matplotlib: one function each, and all of them as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.exceptions import InputError
from schuler.navigation.report import accuracy, build, estimates, innovations, outages, satellites, track
from schuler.navigation.report.subject import Subject
from schuler.navigation.result import NavigationResult
from schuler.plotting import figure as content
from schuler.plotting.drawing import check_formats, draw, save, save_all

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from schuler.gnss.point_result import PointSolution
    from schuler.gnss.ranges import Ranges


def overview(
    result: NavigationResult,
    smoothed: NavigationResult | None = None,
    reference: Any = None,
    **options: Any,
) -> Figure:
    """Four panels on one page: track, horizontal error, heading error and innovations, or what there is instead.

    Parameters
    ----------
    result : NavigationResult
    smoothed : NavigationResult, optional
    reference : Trajectory, optional
    **options
        Fields of :class:`~schuler.navigation.report.subject.Subject`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return draw(overview_content(Subject(result, smoothed, reference, **options)))


def overview_content(subject: Subject) -> content.Figure:
    """Description of :func:`overview`."""
    by_name = {f.name: f for f in build.error_figures(subject)}
    chosen: list[tuple[content.Figure, int]] = [(track.track(subject), 0)]
    if "horizontal_error" in by_name:
        chosen.append((by_name["horizontal_error"], 0))
        chosen.append((by_name.get("attitude_error", by_name["position_error"]), 2))
    elif "uncertainty" in by_name:
        chosen += [(by_name["uncertainty"], 0), (by_name["uncertainty"], 2)]
    tested = [k for k in innovations.kinds(subject) if k not in innovations.RESET_NAMES]
    chosen.append((innovations.by_component(subject, tested[0]), -1) if tested else (track.motion(subject), 1))
    panels = tuple(replace(figure.panels[i], title=figure.title) for figure, i in chosen)
    caption = "Where it went, how far off it was, which way it looked, and what the measurements said about it."
    return content.Figure("overview", "Overview", caption, panels, columns=2, linked=False, paper_columns=2)


def plot_track(result: NavigationResult, *, ax: Axes | None = None, **options: Any) -> Figure:
    """Track in plan; ``options`` as in :class:`~schuler.navigation.report.subject.Subject`, ``ax`` to draw into your
    own axes.
    """
    return draw(track.track(Subject(result, **options)), ax)


def plot_motion(result: NavigationResult, **options: Any) -> Figure:
    """Height, speed, roll, pitch, heading; ``options`` as in :class:`~schuler.navigation.report.subject.Subject`."""
    return draw(track.motion(Subject(result, **options)))


def plot_horizontal_error(result: NavigationResult, *, ax: Axes | None = None, **options: Any) -> Figure:
    """Horizontal error over time; needs ``reference``."""
    return draw(_required(accuracy.horizontal(Subject(result, **options)), "a reference"), ax)


def plot_errors(result: NavigationResult, block: str = "dr", **options: Any) -> Figure:
    """Errors north, east, down of ``dr``, ``dv`` or ``dpsi`` with the 3-sigma band; needs ``reference``."""
    return draw(_required(accuracy.errors(Subject(result, **options), block), f"a reference that has {block}"))


def plot_uncertainty(result: NavigationResult, **options: Any) -> Figure:
    """1-sigma of position, velocity and attitude over time."""
    return draw(accuracy.sigmas(Subject(result, **options)))


def plot_nees(result: NavigationResult, *, ax: Axes | None = None, **options: Any) -> Figure:
    """Normalised estimation error squared; needs a ``reference`` of the IMU with velocity and attitude."""
    figure = accuracy.normalised_errors(Subject(result, **options))
    return draw(_required(figure, "a reference of the IMU with velocity and attitude"), ax)


def plot_outages(result: NavigationResult, **options: Any) -> Figure:
    """Largest error by outage, and drift curve; needs outages and ``reference``."""
    return draw(
        _required(outages.outage_figure(Subject(result, **options)), "outages and a reference that covers them")
    )


def plot_parameters(result: NavigationResult, block: str, **options: Any) -> Figure:
    """Estimates of one block of parameters with their 3-sigma band, in data-sheet units."""
    return draw(estimates.parameters(Subject(result, **options), block))


def plot_innovations(result: NavigationResult, kind: str = "position", **options: Any) -> Figure:
    """Innovations of one kind of measurement and their normalised squares."""
    subject = Subject(result, **options)
    figure = innovations.by_component(subject, kind) if kind in innovations.kinds(subject) else None
    return draw(_required(figure, f"measurements of the kind {kind!r}"))


def plot_separation(result: NavigationResult, **options: Any) -> Figure:
    """Filtered minus smoothed solution with the sigma of that difference; needs ``smoothed``."""
    return draw(_required(accuracy.separation(Subject(result, **options)), "a filtered solution and its smoothed one"))


def plot_profile(result: NavigationResult, *, ax: Axes | None = None, **options: Any) -> Figure:
    """Height over the distance travelled."""
    return draw(_required(track.profile(Subject(result, **options)), "a solution that goes somewhere"), ax)


def plot_satellites(ranges: Ranges, points: PointSolution | None = None) -> dict[str, Figure]:
    """Sky, satellites over time, numbers and dilutions, signal strengths: each drawn, by its name."""
    return {f.name: draw(f) for f in satellites.satellite_figures(ranges, points)}


def save_figures(
    result: NavigationResult, folder: Path | str, formats: Sequence[str] = ("png", "svg"), **options: Any
) -> list[Path]:
    """Write every figure of a solution.

    Parameters
    ----------
    result : NavigationResult
    folder : Path or str
        Made if missing; files of the same name are replaced.
    formats : sequence of str
        ``png``, ``svg``, ``pdf``.
    **options
        ``smoothed``, ``reference``, ``at_antenna``, ``truth_parameters``, ``origin``, ``gnss``, ``ranges``, ``points``,
        ``background`` as in :class:`~schuler.navigation.report.subject.Subject`.

    Returns
    -------
    list of Path
        ``overview``, ``track``, ``motion``, ... in each format; the same bytes for the same input.
    """
    check_formats(formats)
    subject = Subject(result, **options)
    written = save(overview(result, **{**options, "background": subject.map}), Path(folder) / "overview", formats)
    return written + save_all(build.all_figures(subject), folder, formats)


def _required(figure: content.Figure | None, needed: str) -> content.Figure:
    if figure is None:
        raise InputError(f"this figure needs {needed}")
    return figure
