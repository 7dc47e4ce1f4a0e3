"""GNSS fixes as their receiver stated them: type, satellites, dilution of precision, uncertainty."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import TIME, Figure, Markers, Panel, line, view
from schuler.recording.series import QUALITY

# best first, upwards in the figure
_BEST = ("fixed", "float", "ppp", "dgps", "sbas", "single", "dead reckoning")


def stated(subject: Subject) -> Figure | None:
    """Type, number of satellites, dilutions of precision and 1-sigma of the fixes; None without fixes."""
    gnss = subject.gnss
    if gnss is None or not len(gnss):
        return None
    t = subject.seconds(gnss.t)
    panels = []
    if gnss.quality is not None:
        names = np.array([QUALITY.get(int(q), f"type {q}") for q in gnss.quality])
        rows = sorted(set(names.tolist()), key=lambda n: -_BEST.index(n) if n in _BEST else -len(_BEST))
        level = np.array([float(rows.index(name)) for name in names])
        panels.append(
            Panel(
                TIME, "fix type", (Markers(t, level, "measured"),), x_limits=subject.span,
                y_limits=(-0.6, len(rows) - 0.4),
                y_ticks=tuple((float(y), name) for y, name in enumerate(rows)), height=0.4 + 0.15 * len(rows),
            )
        )  # fmt: skip
    if gnss.n_satellites is not None:
        n = gnss.n_satellites.astype(np.float64)
        panels.append(
            Panel(
                TIME, "satellites [-]", (line(t, n, "filtered"),), x_limits=subject.span, y_limits=view([n], least=2.0)
            )
        )
    if gnss.dop is not None:
        panels.append(_horizontal_and_vertical(subject, "DOP [-]", gnss.dop, least=1.0))
    variance = np.einsum("nii->ni", gnss.cov_r_n)
    sigma = np.sqrt(np.stack((variance[:, 0] + variance[:, 1], variance[:, 2]), axis=-1))
    panels.append(_horizontal_and_vertical(subject, "stated 1-sigma [m]", sigma))
    caption = (
        "Fixes as the receiver stated them, before the filter judged them: see the innovations for what they are worth."
    )
    return Figure("fixes", "GNSS fixes", caption, tuple(panels))


def _horizontal_and_vertical(subject: Subject, title: str, values: FloatArray, least: float = 0.0) -> Panel:
    """Two curves over the fixes, NaN left out; a logarithmic axis where one peak would flatten all the rest. (n, 2)"""
    assert subject.gnss is not None
    finite = values[np.isfinite(values)]
    wide = float(finite.max()) > 50.0 * float(np.median(finite))
    t = subject.seconds(subject.gnss.t)
    parts = zip(values.T, ("case_1", "case_2"), ("horizontal", "vertical"), strict=True)
    curves = tuple(line(t, x, role, name) for x, role, name in parts if np.isfinite(x).any())
    limits = None if wide else view([finite], least=least)
    return Panel(TIME, title, curves, x_limits=subject.span, log=wide, y_limits=limits)
