"""One group of parameters of a field calibration: estimates with their true values, and the uncertainty left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from schuler.calibration.report.field_panels import Truth, convergence, estimates
from schuler.exceptions import InputError
from schuler.plotting.figure import Figure

if TYPE_CHECKING:
    from schuler.calibration.field.calibration import FieldCalibration


def family_figure(found: FieldCalibration, names: Sequence[str], truth: Truth | None = None, title: str = "") -> Figure:
    """Estimates with three sigma beside the square root of the variance over that before the log.

    Parameters
    ----------
    found : FieldCalibration
    names : sequence of str
        Parameters; panels that hold one of them are taken.
    truth : ImuErrors or mapping of str to float, optional
    title : str

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If the calibration has no history, or none of the parameters.

    References
    ----------
    Yaman (2017), Figs. 5.3 to 5.9: one figure a group.
    """
    values, left = estimates(found, truth), convergence(found)
    if values is None or left is None:
        raise InputError("names: expected a calibration with its history, this one was refused")
    panels = [
        panel
        for pair in zip(values.panels, left.panels, strict=True)
        for panel in pair
        if set(pair[0].title.split(", ")) & set(names)
    ]
    if not panels:
        raise InputError(f"names: expected some of {', '.join(found.history.names)}, got {', '.join(names)}")
    return replace(
        values,
        name=f"field_family_{names[0]}",
        title=title or ", ".join(names),
        caption="Left the estimates with three standard deviations and the true values, right one sigma over what was "
        "known before the log.",
        panels=tuple(panels),
        columns=2,
    )
