"""Figures and page of an observability study: heat map of what is known over time, and the singular values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.plotting import figure as content
from schuler.plotting.figure import ByteArray, Figure, Panel, Picture
from schuler.plotting.heat import colours, frame, key

if TYPE_CHECKING:
    from schuler.observability.study import Observability

_LOW, _HIGH = -4.0, 1.0  # decades of sigma over prior that the colours span
_COLUMNS = 600
# decade of sigma over prior to red, green, blue: dark is well determined, pale is not; red has grown beyond the
# prior; lightness rises all the way, for grey prints
_KNOWLEDGE = (
    (-4.0, (13, 8, 75)), (-3.0, (26, 70, 135)), (-2.0, (28, 128, 145)), (-1.0, (86, 182, 130)), (-0.3, (200, 220, 120)),
    (0.0, (250, 246, 205)), (0.05, (252, 205, 190)), (1.0, (235, 140, 120)),
)  # fmt: skip


def observability_figure(study: Observability) -> Figure:
    """1-sigma of every state in units of its prior over time, and the singular values of what was measured so far."""
    d = study.degree
    n = len(d.names)
    x0, x1 = float(d.t[0]), float(d.t[-1])
    picture = Picture(x0, x1, 0.0, float(n), heat_map(d.t, d.ratio))
    heat = Panel(
        "time [s]", "", (picture, frame(picture)), "1-sigma in units of the prior", x_limits=(x0, x1),
        y_limits=(0.0, float(n)), grid=False, y_ticks=tuple((n - 0.5 - i, name) for i, name in enumerate(d.names)),
        height=max(1.5, 0.13 * n),
    )  # fmt: skip
    limit = float(np.max(d.values[-1]))
    lines: list[content.Item] = [
        content.line(d.t, np.maximum(d.values[:, i], 1e-8), "filtered" if d.values[-1, i] > 1.0 else "rejected")
        for i in range(n)
    ]
    lines.append(content.level((x0, x1), 1.0, "level"))
    values = Panel(
        "time [s]", "singular value [-]", tuple(lines),
        "of the scaled observability matrix; below 1 the prior knows more",
        x_limits=(x0, x1), y_limits=(1e-7, 3.0 * limit), log=True, height=1.5,
    )  # fmt: skip
    caption = (
        "Each state's 1-sigma divided by its prior one: dark is known, pale has learnt nothing, red has grown. Below, "
        "how well each direction of the state at the start is seen by the measurements so far."
    )
    scale = key("log10 of sigma over prior [-]", (_LOW, _HIGH), _KNOWLEDGE)
    title = f"{study.system.name}: what is known over time"
    return Figure("observability", title, caption, (heat, scale, values), linked=False)


def heat_map(t: FloatArray, ratio: FloatArray) -> ByteArray:
    """Pixels of a heat map, states downwards. Shapes (r,), (r, n) to (h, w, 4)."""
    width = min(_COLUMNS, max(len(t), 2))
    at = np.searchsorted(t, np.linspace(t[0], t[-1], width) - 1e-9).clip(0, len(t) - 1)
    with np.errstate(divide="ignore"):
        rows = colours(np.log10(ratio[at].T), _KNOWLEDGE)
    return np.ascontiguousarray(np.repeat(rows, 12, axis=0))


def observability_report(study: Observability, path: Path | str, formulas: tuple[str, ...] = ()) -> Path:
    """Write one self-contained HTML page.

    Parameters
    ----------
    study : Observability
    path : Path or str
    formulas : tuple of str
        Symbolic combinations, if they were asked for.
    """
    from schuler.files import write_text
    from schuler.plotting import parts
    from schuler.plotting.page import Section, plotly_script, whole_page
    from schuler.plotting.table import ResultTable, shown

    def html(table: ResultTable) -> str:
        rows = [[shown(v) for v in row] for row in table.rows]
        return parts.table(". ".join((table.title, *table.notes)), table.columns, rows)

    def listed(title: str, texts: list[str] | tuple[str, ...]) -> str:
        return parts.table(title, ("combination",), [(text,) for text in texts], numbers=False) if texts else ""

    spectrum = study.spectrum
    hidden = [c.text for c in study.unseen()]
    sentences = [
        f"Of {study.system.n} states the measurements determine {spectrum.useful} independent combinations better than "
        f"the prior; formally {spectrum.formal}, by the rank of the Gramian in double precision {spectrum.rank}.",
        f"Not determined: {'; '.join(hidden)}." if hidden else "Everything is determined.",
    ]
    sections = [
        Section("time", "Over time", (observability_figure(study), html(study.table()))),
        Section(
            "combinations",
            "Combinations",
            (
                listed("Determined", [c.text for c in study.seen()]),
                listed("Not determined: these errors together leave no trace", hidden),
                listed("As formulas", formulas),
            ),
        ),
        Section("ranks", "Ranks", (html(study.ranks()),)),
        Section("notes", "Notes", (listed("Notes", study.system.notes),)),
    ]
    conventions = (
        "Conventions: errors are estimate minus truth, north, east, down, biases in the IMU's axes."
        if study.system.axes == "ned"
        else "Conventions: axes and names of Du (2015): east, north, up; right, forward, up; biases d and b are errors "
        "of the sensors, the others estimate minus truth."
    )
    text = whole_page(
        study.system.name, "Observability", f"Observability of {study.system.n} states", sentences, conventions,
        sections, plotly_script(),
    )  # fmt: skip
    return write_text(path, text)
