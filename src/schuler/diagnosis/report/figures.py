"""Figures of a diagnosis: what its findings rest on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.plotting import figure as content
from schuler.plotting.figure import Bars, Figure, Panel, Span
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.diagnosis.result import Diagnosis


def figures(diagnosis: Diagnosis) -> list[Figure]:
    """Whatever figures the diagnosis has curves for."""
    curves, figures_ = diagnosis.curves, []
    if "norm" in curves:
        t, norm = curves["norm"].T
        static = [Span(a, b, "outage", "static") for a, b, what in diagnosis.segments if what == "static"]
        line = content.line(t, norm, "filtered", "norm")
        panel = Panel("time [s]", "specific force [m/s²]", (*static, line))
        caption = "Norm of specific force after what was found about its unit; at rest it is gravity."
        figures_.append(Figure("norm", "Specific force and rests", caption, (panel,)))
    if "turn" in curves:
        panels = []
        for name, label, scale in (("turn", "turn rate [deg/s]", DEG), ("forward", "forward [m/s²]", 1.0)):
            t, gnss, imu = curves[name].T
            items = (content.line(t, gnss / scale, "measured", "GNSS"), content.line(t, imu / scale, "filtered", "IMU"))
            panels.append(Panel("time [s]", label, items))
        caption = (
            "What GNSS says of the motion, and the IMU's best linear account of it, whatever its axes and "
            "units, with its "
            "clock put right."
        )
        figures_.append(Figure("motion", "The same motion in both", caption, tuple(panels)))
    if "lag" in curves and len(curves["lag"]):
        shift, score = curves["lag"].T
        panel = Panel(
            "added to the IMU's stamps [s]", "log-likelihood per sample [-]", (content.line(shift, score, "filtered"),)
        )
        offset = diagnosis.estimates.get("time_offset_s")
        best_offset = "" if offset is None else f" Best: {offset:+.3f} s."
        figures_.append(
            Figure("lag", "Clock offset", f"How well the IMU explains the motion at each shift.{best_offset}", (panel,))
        )
    if "orientations" in curves:
        cosine = curves["orientations"]
        best = ", ".join(f"{name} {c:.2f}" for name, c in diagnosis.estimates.get("orientations", {}).items())
        bars = Bars(np.arange(1.0, len(cosine) + 1.0), np.maximum(cosine, 0.0), "filtered", "mean cosine")
        caption = f"Axes as read against each orientation, best first ({best}; * mirrored). 1 is agreement."
        figures_.append(
            Figure("orientations", "The 48 orientations", caption, (Panel("number [-]", "mean cosine [-]", (bars,)),))
        )
    return figures_
