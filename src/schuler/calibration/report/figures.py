"""Figures of a calibration for print and slides (matplotlib); the same descriptions as in the HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.design.plans import ATTITUDES, words_of
from schuler.calibration.report.panels import all_figures
from schuler.calibration.report.pose_figure import plan_figure
from schuler.calibration.report.thermal_figure import thermal_figure
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting.drawing import check_formats, draw, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.calibration.report.field_panels import Truth


def calibration_figure(result: CalibrationResult, which: str | None = None, *, ax: Axes | None = None) -> Figure:
    """Residuals per pose, directions covered, before and after, parameters with one sigma.

    Parameters
    ----------
    result : CalibrationResult
    which : {"residuals", "coverage", "before_after", "parameters"}, optional
        One of them by itself; default all on one page, as far as the result has them.
    ax : matplotlib axes, optional
        To draw into, for one that has a single panel.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the result has nothing for what was asked.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    return draw(calibration_content(result, which), ax)


def calibration_content(result: CalibrationResult, which: str | None = None) -> content.Figure:
    """Description of :func:`calibration_figure`."""
    figures = {f.name: f for f in all_figures(result)}
    if which is not None:
        if which not in figures:
            there = ", ".join(figures) or "nothing"
            raise InputError(f"which: expected one of what this result has ({there}), got {which!r}")
        return figures[which]
    if not figures:
        raise InputError("result: expected parameters or residuals to draw, got none")
    panels = [panel for figure in figures.values() for panel in figure.panels]
    # half the width: no room for where the gap is
    panels = [p if not p.equal else replace(p, title=p.title.partition(" around")[0]) for p in panels]
    caption = "What is left of each pose, where the poses were, how large residuals were before, and the parameters."
    return content.Figure("overview", "Calibration", caption, tuple(panels), columns=2, linked=False, paper_columns=2)


def save_calibration_figures(
    result: CalibrationResult,
    folder: Path | str,
    formats: Sequence[str] = ("png", "svg"),
    *,
    field: FieldCalibration | None = None,
    truth: Truth | None = None,
) -> list[Path]:
    """Write every figure of a calibration.

    Parameters
    ----------
    result : CalibrationResult
    folder : Path or str
        Made if missing; files of the same name are replaced.
    formats : sequence of str
        ``png``, ``svg``, ``pdf``.
    field, truth
        See :func:`schuler.calibration.report.document.calibration_report`.

    Returns
    -------
    list of Path
        ``residuals``, ``coverage``, ``before_after``, ``parameters``, with a thermal calibration ``temperature``, with
        advice ``next_pose`` (how the unit lies in it), in each format; with ``field`` also those of
        :func:`schuler.calibration.report.field_panels.field_panels`; the same bytes for the same input.

    Raises
    ------
    InputError
        If a format is unknown.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    check_formats(formats)
    drawn = {f.name: draw(f) for f in all_figures(result)}
    if "thermal" in result.extra:
        drawn["temperature"] = thermal_figure(result)
    following = next_direction(result)
    if following is not None:
        done = result.residuals["accel"].direction if "accel" in result.residuals else None
        poses = following[None] if done is None else np.concatenate((done, following[None]))
        drawn["next_pose"] = plan_figure(poses, len(poses) - 1, following)
    if field is not None:
        from schuler.calibration.report.field_panels import field_panels

        drawn |= {f.name: draw(f) for f in field_panels(field, truth)}
    return [path for name, figure in drawn.items() for path in save(figure, Path(folder) / name, formats)]


def next_direction(result: CalibrationResult) -> FloatArray | None:
    """Up in body axes in the pose that ``next_pose`` advises, shape (3,); None without such advice."""
    # "z up" is also the end of "+x and -z up alike"
    text = [d for d in ATTITUDES if words_of(d) in result.next_pose]
    return np.asarray(max(text, key=lambda d: len(words_of(d))), dtype=np.float64) if text else None
