"""The figures of a navigation solution, in the order in which a report shows them."""

from __future__ import annotations

from schuler.report import accuracy, estimates, residuals, track
from schuler.report.content import Figure
from schuler.report.subject import Subject


def track_figures(subject: Subject) -> list[Figure]:
    """Track and motion."""
    return [track.track(subject), track.motion(subject)]


def error_figures(subject: Subject) -> list[Figure]:
    """Errors against the reference and NEES; the claimed uncertainty where there is no reference."""
    if not subject.errors:
        return [accuracy.sigmas(subject)] if len(subject.result.t) else []
    figures = [
        accuracy.horizontal(subject),
        *(accuracy.errors(subject, block) for block in ("dr", "dv", "dpsi")),
        accuracy.normalised_errors(subject),
    ]
    return [f for f in figures if f is not None]


def outage_figures(subject: Subject) -> list[Figure]:
    """Drift without GNSS, if there were outages and a reference."""
    figure = accuracy.outage_figure(subject)
    return [] if figure is None else [figure]


def parameter_figures(subject: Subject) -> list[Figure]:
    """One figure for each block of parameters."""
    return (
        [estimates.parameters(subject, block) for block in subject.result.layout.models]
        if len(subject.result.t)
        else []
    )


def innovation_figures(subject: Subject) -> list[Figure]:
    """One figure for each kind of measurement that was tested."""
    return [residuals.innovations(subject, kind) for kind in residuals.kinds(subject)]


def all_figures(subject: Subject) -> list[Figure]:
    """Every figure there is something to show in."""
    return [
        *track_figures(subject),
        *error_figures(subject),
        *outage_figures(subject),
        *parameter_figures(subject),
        *innovation_figures(subject),
    ]
