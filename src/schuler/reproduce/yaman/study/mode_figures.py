"""Figures of the modes on a drive: where each solution goes, how fast it is, which way it looks, its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.exceptions import InputError
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.plotting.drawing import draw
from schuler.plotting.figure import TIME, Figure, Item, Line, Markers, Panel, Span, line, path
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, mode_name
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.navigation.result import NavigationResult
    from schuler.recording.trajectory import Trajectory
    from schuler.reproduce.yaman.study.unit_drives import FieldDrives


_ROLES = ("case_1", "case_2", "case_3", "case_4", "case_5", "case_6", "case_7")
_MARGIN = 0.5  # of the way's extent, around it: pure inertial solutions leave the picture
_SMALLEST = 1e-2  # error that a logarithmic axis still shows [m]

Solutions = Mapping[str, "NavigationResult"]
Window = tuple[float, float]


def position_figure(solutions: Solutions, reference: Trajectory, outage: Window | None = None) -> Figure:
    """Way in plan and height over time.

    Parameters
    ----------
    solutions : mapping of str to NavigationResult
        By label, seven at most.
    reference : Trajectory
    outage : (float, float), optional
        Shaded. [s]

    Returns
    -------
    Figure

    References
    ----------
    Yaman (2017), Figs. 6.16, 6.19, 6.21, 6.24.
    """
    _check(solutions)
    origin = reference.llh[0]
    ways = {label: frames.ned_from_ecef(s.trajectory.r_eb_e, origin) for label, s in solutions.items()}
    true = frames.ned_from_ecef(reference.r_eb_e, origin)
    plan: list[Item] = [path(true[:, 1], true[:, 0], "reference", "reference")]
    height: list[Item] = [*_shade(outage), line(reference.t, -true[:, 2], "reference", "reference")]
    for role, (label, way) in zip(_ROLES, ways.items(), strict=False):
        plan.append(path(way[:, 1], way[:, 0], role, label))
        height.append(line(solutions[label].trajectory.t, -way[:, 2], role, label))
    panels = (
        Panel(
            "east [m]", "north [m]", tuple(plan), x_limits=_around(true[:, 1]), y_limits=_around(true[:, 0]),
            equal=True, height=1.6,
        ),
        Panel(TIME, "height over the start [m]", tuple(height), y_limits=_around(-true[:, 2], 100.0)),
    )  # fmt: skip
    return Figure(
        "drive_positions", "Way and height by mode", "Solutions that drift leave the picture.", panels, linked=False
    )


def velocity_figure(solutions: Solutions, reference: Trajectory) -> Figure:
    """Velocity north, east, down over time; parameters as of :func:`position_figure`.

    References
    ----------
    Yaman (2017), Figs. 6.17, 6.22.
    """
    _check(solutions)
    panels = []
    for i, axis in enumerate(("north", "east", "down")):
        items: list[Item] = [line(reference.t, reference.v_eb_n[:, i], "reference", "reference")]
        for role, (label, s) in zip(_ROLES, solutions.items(), strict=False):
            items.append(line(s.trajectory.t, s.trajectory.v_eb_n[:, i], role, label))
        panels.append(Panel(TIME, f"{axis} [m/s]", tuple(items), y_limits=_around(reference.v_eb_n[:, i], 5.0)))
    return Figure("drive_velocities", "Velocity by mode", "Solutions that drift leave the picture.", tuple(panels))


def attitude_figure(solutions: Solutions, reference: Trajectory) -> Figure:
    """Attitude errors over time with three sigma of the first; parameters as of :func:`position_figure`.

    References
    ----------
    Yaman (2017), Figs. 6.18, 6.23. Departure: errors about north, east, down; Euler angles lie on each other.
    """
    _check(solutions)
    panels = []
    first = next(iter(solutions.values()))
    sigma = 3.0 * first.sigma("dpsi") / DEG
    errors = {label: trajectory_errors(s.trajectory, reference) for label, s in solutions.items()}
    for i, axis in enumerate(("north", "east", "down")):
        items: list[Item] = [
            line(first.t, s * sigma[:, i], "level", "±3 sigma of the first" if s > 0 else "") for s in (1.0, -1.0)
        ]
        for role, (label, e) in zip(_ROLES, errors.items(), strict=False):
            if e.attitude_n is not None:
                items.append(line(e.t, e.attitude_n[:, i] / DEG, role, label))
        panels.append(Panel(TIME, f"about {axis} [deg]", tuple(items)))
    return Figure("drive_attitudes", "Errors of attitude by mode", "Against the reference.", tuple(panels))


def outage_figure(solutions: Solutions, reference: Trajectory, outage: Window) -> Figure:
    """Horizontal and vertical error over time around an outage, each with the sigma its filter claims.

    Parameters as of :func:`position_figure`.

    References
    ----------
    Yaman (2017), Figs. 6.20, 6.25.
    """
    _check(solutions)
    panels = []
    for part in ("horizontal", "vertical"):
        items: list[Item] = [*_shade(outage)]
        for role, (label, s) in zip(_ROLES, solutions.items(), strict=False):
            e = trajectory_errors(s.trajectory, reference)
            size = e.horizontal if part == "horizontal" else np.abs(e.position_n[:, 2])
            sigma = s.sigma("dr")
            claimed = np.hypot(sigma[:, 0], sigma[:, 1]) if part == "horizontal" else sigma[:, 2]
            near = (s.t >= outage[0] - 20.0) & (s.t <= outage[1] + 20.0)
            keep = (e.t >= outage[0] - 20.0) & (e.t <= outage[1] + 20.0)
            items.append(line(e.t[keep], np.maximum(size[keep], _SMALLEST), role, label))
            items.append(Line(s.t[near], claimed[near], "term", "1 sigma as claimed" if role == _ROLES[0] else ""))
        panels.append(Panel(TIME, f"{part} error [m]", tuple(items), log=True))
    return Figure("drive_outage", "Errors through the outage by mode", "Thin: what each filter claims.", tuple(panels))


def _check(solutions: Solutions) -> None:
    if not 1 <= len(solutions) <= len(_ROLES):
        raise InputError(f"solutions: expected one to {len(_ROLES)}, got {len(solutions)}")


def _shade(outage: Window | None) -> list[Span]:
    return [] if outage is None else [Span(*outage, "outage", "GNSS withheld")]


def _around(x: np.ndarray, least: float = 50.0) -> tuple[float, float]:
    margin = max(_MARGIN * float(np.ptp(x)), least)
    return float(x.min()) - margin, float(x.max()) + margin


_STEP = 0.2  # of a row: the source's mark stands below ours
_UNITS = {"m": "m", "s": "m/s", "deg": "deg"}  # by the last word of a quantity


def modes_figure(drives: FieldDrives, quantities: Sequence[str] = QUANTITIES[:2]) -> MplFigure:
    """Errors by mode, a panel for each quantity.

    Parameters
    ----------
    drives : FieldDrives
    quantities : sequence of str
        Out of :data:`schuler.reproduce.yaman.study.tables.QUANTITIES`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If a quantity is not known.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), tables 6.2 and 6.3.
    """
    return draw(modes(drives, quantities))


def modes(drives: FieldDrives, quantities: Sequence[str] = QUANTITIES[:2]) -> Figure:
    """Description of the figure: median and 16 to 84 % of the units, and the source's. Parameters as above."""
    unknown = [name for name in quantities if name not in QUANTITIES]
    if unknown or not quantities:
        raise InputError(f"quantities: expected some of {', '.join(QUANTITIES)}, got {list(quantities)}")
    low, high = drives.between()
    published = np.array(PRINTED_MODES[drives.number])
    rows = np.arange(len(MODES), dtype=np.float64)[::-1]  # the first mode on top
    panels = []
    for name in quantities:
        k = QUANTITIES.index(name)
        spread: list[Item] = [
            Line(np.array([low[i, k], high[i, k]]), np.array([y, y]), "filtered") for i, y in enumerate(rows)
        ]
        items = (
            *spread,
            Markers(drives.median[:, k], rows, "filtered", f"{len(drives)} units, median and 16 to 84 %"),
            Markers(published[:, k], rows - _STEP, "rejected", "Yaman (2017)"),
        )
        words = name.split("_")
        label = f"{' '.join(w for w in words if w not in _UNITS)} [{_UNITS[words[-1]]}]"
        ticks = tuple((float(y), mode_name(*mode)) for y, mode in zip(rows, MODES, strict=True))
        panels.append(Panel(label, "", items, log_x=True, y_ticks=ticks, y_limits=(-0.7, len(MODES) - 0.4), height=1.3))
    against = "the calibrated solution with full GPS" if drives.against == "full" else "the truth"
    return Figure(
        "field_drive",
        f"Drive {drives.number}, nine modes",
        f"RMS against {against}, of partial GPS over the outage.",
        tuple(panels),
        linked=False,
    )
