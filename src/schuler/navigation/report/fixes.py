"""GNSS fixes as their receiver stated them: type, satellites, uncertainty."""

from __future__ import annotations

import numpy as np

from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import TIME, Figure, Item, Markers, Panel, line, view
from schuler.recording.series import QUALITY

# best first, upwards in the figure
_BEST = ("fixed", "float", "ppp", "dgps", "sbas", "single", "dead reckoning")


def stated(subject: Subject) -> Figure | None:
    """Type, number of satellites and 1-sigma of the fixes; None without fixes."""
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
    variance = np.einsum("nii->ni", gnss.cov_r_n)
    sigmas = {"horizontal": np.sqrt(variance[:, 0] + variance[:, 1]), "vertical": np.sqrt(variance[:, 2])}
    curves: list[Item] = [
        line(t, s, role, name) for (name, s), role in zip(sigmas.items(), ("case_1", "case_2"), strict=True)
    ]
    values = np.concatenate(list(sigmas.values()))
    wide = float(values.max()) > 50.0 * float(np.median(values))
    panels.append(
        Panel(
            TIME, "stated 1-sigma [m]", tuple(curves), x_limits=subject.span, log=wide,
            y_limits=None if wide else view([values]),
        )
    )  # fmt: skip
    caption = (
        "Fixes as the receiver stated them, before the filter judged them: see the innovations for what they are worth."
    )
    return Figure("fixes", "GNSS fixes", caption, tuple(panels))
