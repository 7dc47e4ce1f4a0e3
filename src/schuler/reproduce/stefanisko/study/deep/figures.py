"""Figures of the deep-coupling study, which is SIMULATION ONLY: each says so in its title."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Line, Markers, Panel, Span
from schuler.reproduce.stefanisko.study.deep import discriminators as ts
from schuler.reproduce.stefanisko.study.deep.correlator import GPS_CA
from schuler.reproduce.stefanisko.study.deep.study import ARCHITECTURES, DeepStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

_ROLES = {"deep": ("filtered", "sigma"), "tight": ("smoothed", "sigma_smoothed")}


def position_errors(study: DeepStudy, level_dbhz: float | None = None) -> Panel:
    """Horizontal error of the first run at a level, both architectures, with the 1-sigma each claims."""
    level = _level(study, level_dbhz)
    items: list[content.Item] = [Span(*study.window, "outage", "fade")]
    shown = []
    for name in ARCHITECTURES:
        role, band = _ROLES[name]
        one = study.runs[level, name][0]
        sigma = np.hypot(one.sigma_n[:, 0], one.sigma_n[:, 1])
        items.append(content.band(one.t, 0.0 * sigma, sigma, band, f"{name}, 1-sigma"))
        items.append(content.line(one.t, one.horizontal, role, name))
        shown += [one.horizontal, sigma[one.t > one.t[0] + 1.0]]
    title = f"SIMULATION: {level:g} dB-Hz in the fade"
    return Panel("time [s]", "horizontal error [m]", tuple(items), title, y_limits=content.view(shown))


def replica_errors(study: DeepStudy, level_dbhz: float | None = None) -> Panel:
    """Largest range-rate error of any replica in the first run at a level: beyond 4.8 m/s the discriminator turns."""
    level = _level(study, level_dbhz)
    items: list[content.Item] = [Span(*study.window, "outage", "fade")]
    for name in reversed(ARCHITECTURES):
        one = study.runs[level, name][0]
        worst = np.maximum(np.abs(one.rate_error[:, : study.fading]).max(axis=1), 1e-3)
        items.append(content.line(one.channel_t, worst, _ROLES[name][0], name))
    turn = 0.5 * GPS_CA.wavelength / GPS_CA.bit
    items.append(content.level((0.0, study.seconds), turn, "level", "1 / (4 tau)"))
    return Panel("time [s]", "worst replica's rate error [m/s]", tuple(items), "SIMULATION: replicas", log=True)


def shares(study: DeepStudy) -> Panel:
    """Part of the fading channels that track all through the fade, by level."""
    return _by_level(study, "tracked", "share of channels [-]", "SIMULATION: tracked all through")


def largest(study: DeepStudy) -> Panel:
    """Largest horizontal error in the fade, by level."""
    return _by_level(study, "largest", "largest error in the fade [m]", "SIMULATION: root mean square over runs")


def overview(study: DeepStudy, level_dbhz: float | None = None) -> MplFigure:
    """Four panels on one page: position errors, replicas, shares tracked, largest errors.

    Parameters
    ----------
    study : DeepStudy
    level_dbhz : float, optional
        Whose first run is shown; left out, the weakest at which one conventional channel in ten still tracks.
    """
    return draw(overview_content(study, level_dbhz))


def overview_content(study: DeepStudy, level_dbhz: float | None = None) -> Figure:
    """Description of :func:`overview`."""
    panels = (position_errors(study, level_dbhz), replica_errors(study, level_dbhz), shares(study), largest(study))
    caption = "Simulation only: errors and replicas of one run through a fade, and how many channels survive fades."
    return Figure(
        "overview", "Deep coupling, simulation only", caption, panels, columns=2, linked=False, paper_columns=2
    )


def discriminators(spacing: float = 0.5) -> MplFigure:
    """S-curves of the code discriminators and of the frequency discriminator, each with unit slope at zero."""
    return draw(discriminators_content(spacing))


def discriminators_content(spacing: float = 0.5) -> Figure:
    """Description of :func:`discriminators`."""
    x, f = np.linspace(-1.5, 1.5, 301), np.linspace(-60.0, 60.0, 301)
    half = 0.5 * GPS_CA.bit
    power, dot = (ts.code_curve(kind, x, spacing) / ts.code_slope(kind, spacing) for kind in ("power", "dot"))
    code = (
        Line(x, x, "level", "ideal"), Line(x, power, "filtered", "early minus late power"),
        Line(x, dot, "smoothed", "dot product"),
    )  # fmt: skip
    frequency = (
        Line(f, f, "level", "ideal"),
        Line(f, ts.frequency_curve(f, half) / ts.frequency_slope(half), "filtered", "cross product"),
    )
    panels = (
        Panel("code error [chips]", "output [chips]", code, "SIMULATION: code", y_limits=(-0.6, 0.6)),
        Panel("frequency error [Hz]", "output [Hz]", frequency, "SIMULATION: frequency", y_limits=(-25.0, 25.0)),
    )
    caption = "Simulation only: outside its straight part a discriminator pulls the wrong way."
    return Figure("discriminators", "Discriminators, simulation only", caption, panels, linked=False)


def _by_level(study: DeepStudy, field: str, label: str, title: str) -> Panel:
    items: list[content.Item] = []
    for name in ARCHITECTURES:
        rows = [r for r in study.rows() if r.architecture == name]
        levels, values = np.array([r.level_dbhz for r in rows])[::-1], np.array([getattr(r, field) for r in rows])[::-1]
        items += [Line(levels, values, _ROLES[name][0], name), Markers(levels, values, _ROLES[name][0])]
    return Panel("C/N0 in the fade [dB-Hz]", label, tuple(items), title)


def _level(study: DeepStudy, level_dbhz: float | None) -> float:
    if level_dbhz is None:
        tracked_levels = [r.level_dbhz for r in study.rows() if r.architecture == "tight" and r.tracked >= 0.1]
        return min(tracked_levels, default=study.levels[-1])
    if level_dbhz not in study.levels:
        raise InputError(f"level_dbhz: expected one of {', '.join(f'{x:g}' for x in study.levels)}, got {level_dbhz!r}")
    return level_dbhz
