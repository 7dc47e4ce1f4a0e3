"""Filtered against smoothed solution: a test of a filter's honesty that needs no reference.

References
----------
McReynolds (1984), Editing data using sequential smoothing techniques for discrete systems, AIAA/AAS Astrodynamics
Conference: the filter-smoother consistency test.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.navigation.evaluation.separation import Separation
from schuler.navigation.report.accuracy import AXES
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import outages
from schuler.plotting.figure import TIME, Figure, Item, Panel, band, level, line, view
from schuler.units import DEG

#: Records where smoothing takes away less of a variance than this tell nothing: rounding decides there.
LEAST_GAIN = 1e-3
#: Name, unit and its factor, first column of a Separation.
_BLOCKS = {"dr": ("position", "m", 1.0, 6), "dv": ("velocity", "m/s", 1.0, 3), "dpsi": ("attitude", "deg", DEG, 0)}


def told(subject: Subject, apart: Separation, block: str) -> tuple[FloatArray, FloatArray]:
    """Difference of a block and its 1-sigma, NaN where smoothing gained next to nothing. Shapes (k, 3), (k, 3)."""
    first = _BLOCKS[block][3]
    part = slice(first, first + 3)
    gain = np.einsum("kii->ki", apart.covariance)[:, part]
    before = Subject.sigma(subject.result, block) ** 2
    with np.errstate(invalid="ignore"):
        return apart.difference[:, part], np.sqrt(np.where(gain > LEAST_GAIN * before, gain, np.nan))


def share(subject: Subject, apart: Separation, block: str, times: float = 3.0) -> float:
    """Share of a block's components inside so many sigmas; NaN if none can be told."""
    d, sigma = told(subject, apart, block)
    known = np.isfinite(sigma)
    return float(np.mean(np.abs(d[known]) <= times * sigma[known])) if known.any() else float("nan")


def separation(subject: Subject) -> Figure | None:
    """Filtered minus smoothed position, velocity and attitude with the sigma of that difference; None without both."""
    apart = subject.apart
    if apart is None:
        return None
    t = subject.seconds(apart.t)
    panels = []
    for block, (name, unit, factor, _) in _BLOCKS.items():
        difference, sigma = told(subject, apart, block)
        for i, axis in enumerate(AXES):
            d, three = difference[:, i] / factor, 3.0 * sigma[:, i] / factor
            known = np.isfinite(three)
            items: tuple[Item, ...] = (
                *outages(subject),
                band(t, -three, three, "expected", "±3 sigma of the difference"),
                level(subject.span, 0.0, "level"),
                line(t, d, "filtered", "filtered minus smoothed"),
            )
            within = f"{100.0 * np.mean(np.abs(d[known]) <= three[known]):.1f} %" if known.any() else "not known"
            label = f"{'about ' if block == 'dpsi' else ''}{axis} [{unit}]"
            panels.append(
                Panel(
                    TIME, label, items, title=f"{name}, inside: {within}", x_limits=subject.span,
                    y_limits=view([d], [three, -three]),
                )
            )  # fmt: skip
    caption = (
        "What later measurements changed: the difference of the two solutions should stay inside three times the sigma "
        "that their covariances give it (root of filtered less smoothed variance; 99.7 % are right), and no reference "
        "is needed. It leaves the band where models are wrong; errors that both solutions share are not seen."
    )
    return Figure("separation", "Filtered minus smoothed", caption, tuple(panels), columns=3)
