"""The figures of a navigation solution, in the order in which a report shows them."""

from __future__ import annotations

from schuler.navigation.report import accuracy, carriers, estimates, fixes, innovations, outages, satellites, track
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Figure
from schuler.recording.figures import log_content, spectrogram_content
from schuler.recording.recording import Recording


def motion_figures(subject: Subject) -> list[Figure]:
    """Motion and height profile."""
    figures = [track.motion(subject), track.profile(subject)]
    return [f for f in figures if f is not None]


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
    """Drift without GNSS, if there were outages and a reference, and all of them laid over each other."""
    figures = [outages.outage_figure(subject), outages.outage_fan(subject)]
    return [f for f in figures if f is not None]


def parameter_figures(subject: Subject) -> list[Figure]:
    """One figure for each block of parameters."""
    return (
        [estimates.parameters(subject, *blocks) for blocks in estimates.groups(subject.result)]
        if len(subject.result.t)
        else []
    )


def innovation_figures(subject: Subject) -> list[Figure]:
    """One figure for each kind of measurement that was tested, and one of its satellites where they are known."""
    figures: list[Figure | None] = []
    for kind in innovations.kinds(subject):
        figures.append(innovations.by_component(subject, kind))
        if kind in innovations.BY_SATELLITE:
            figures.append(innovations.by_satellite(subject, kind))
    return [f for f in figures if f is not None]


def separation_figures(subject: Subject) -> list[Figure]:
    """Filtered against smoothed solution, if there are both."""
    figure = accuracy.separation(subject)
    return [] if figure is None else [figure]


def satellite_figures(subject: Subject) -> list[Figure]:
    """Sky, satellites over time, numbers and dilutions, signal strengths, carriers, protection levels; if known."""
    if subject.ranges is None or not len(subject.ranges):
        return []
    carrier = carriers.carriers(subject)
    return [
        *satellites.satellite_figures(subject.ranges, subject.points, subject),
        *([] if carrier is None else [carrier]),
        *carriers.protection(subject),
    ]


def log_figures(subject: Subject) -> list[Figure]:
    """What the log itself says: fixes as the receiver stated them, every sample of the IMU, its spectrogram."""
    figures = [fixes.stated(subject)]
    if subject.imu is not None and len(subject.imu):
        recording = Recording(imu=subject.imu)
        figures.append(log_content(recording, rests=subject.rests, start=subject.start))
        figures.append(spectrogram_content(subject.imu, subject.start))
    return [f for f in figures if f is not None]


def all_figures(subject: Subject) -> list[Figure]:
    """Every figure there is something to show in."""
    return [
        track.track(subject),
        *motion_figures(subject),
        *error_figures(subject),
        *outage_figures(subject),
        *separation_figures(subject),
        *satellite_figures(subject),
        *parameter_figures(subject),
        *innovation_figures(subject),
        *log_figures(subject),
    ]
