"""Figures of a field calibration for print and slides (matplotlib); the same descriptions as in the HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from schuler.calibration.field.calibration import FieldCalibration
from schuler.calibration.report.field_panels import Truth, field_panels
from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting.drawing import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PREFIX = "field_"


def field_figure(result: FieldCalibration, which: str = "convergence", *, truth: Truth | None = None) -> Figure:
    """One figure of a field calibration.

    Parameters
    ----------
    found : FieldCalibration
    which : {"convergence", "estimates", "rests", "innovations"}
        Square root of the variance over that before the log; estimates with three sigma; rests and what is read too
        much there, before and after; innovations.
    truth : ImuErrors or mapping of str to float, optional
        True errors, for ``estimates``; see :func:`schuler.calibration.report.field_panels.field_panels`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the calibration has nothing for what was asked.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), Figs. 5.3 to 5.10.
    """
    return draw(field_content(result, which, truth=truth))


def field_content(
    result: FieldCalibration, which: str = "convergence", *, truth: Truth | None = None
) -> content.Figure:
    """Description of :func:`field_figure`."""
    figures = {f.name.removeprefix(_PREFIX): f for f in field_panels(result, truth)}
    if which not in figures:
        raise InputError(f"which: expected one of what there is ({', '.join(figures) or 'nothing'}), got {which!r}")
    return figures[which]
