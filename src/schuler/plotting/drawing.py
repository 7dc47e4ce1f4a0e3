"""Figures for print and slides, drawn with matplotlib: PNG and SVG files, or axes of your own.

Nothing here touches ``pyplot`` or the backend in use; no display is needed. Sizes are chosen so that a figure is
legible when printed 100 mm wide.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import InputError, MissingExtraError
from schuler.files import replacing
from schuler.plotting import figure as content
from schuler.plotting.figure import Band, Bars, Line, Markers, Panel, Picture, Span, Text
from schuler.plotting.notebook import png
from schuler.plotting.style import PRINT_GRID, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH = 4.5  # one column of panels; 8 pt letters here are 7 pt in a figure 100 mm wide [in]
_WIDE = 6.8  # several columns [in]
_FONT = 8.0  # [pt]
_DPI = 220
#: What figures are written in.
FORMATS = ("png", "svg", "pdf")
_SYMBOLS = {"dot": "o", "cross": "x", "triangle": "^", "ring": "o", "square": "s"}


def save_all(figures: Iterable[content.Figure], folder: Path | str, formats: Sequence[str]) -> list[Path]:
    """Draw figures and write each under its name to a folder, in each format.

    Raises
    ------
    InputError
        If a format is unknown.
    """
    check_formats(formats)
    return [path for figure in figures for path in save(draw(figure), Path(folder) / figure.name, formats)]


def check_formats(formats: Sequence[str]) -> None:
    """Refuse formats that figures are not written in, before any is drawn."""
    if unknown := [f for f in formats if f not in FORMATS]:
        raise InputError(f"formats: expected png, svg or pdf, got {unknown[0]!r}")


def save(figure: Figure, stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write a matplotlib figure as ``stem.<format>`` for each format, without date or random names in the files."""
    import matplotlib as mpl

    # the layout is found once, not anew for each format, and without a drawing for it
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")
    written = []
    for suffix in formats:
        target = stem.with_name(f"{stem.name}.{suffix}")
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}[suffix]
        with mpl.rc_context({"svg.hashsalt": stem.name}), replacing(target) as temporary:
            figure.savefig(temporary, format=suffix, dpi=_DPI, metadata=metadata)
        written.append(target)
    return written


def draw(figure: content.Figure, ax: Axes | Sequence[Axes] | np.ndarray[Any, Any] | None = None) -> Figure:
    """Draw a figure's description.

    Parameters
    ----------
    figure : schuler.plotting.figure.Figure
    ax : matplotlib axes, or a sequence or array of them, optional
        To draw into: as many as the figure has panels.

    Returns
    -------
    matplotlib.figure.Figure
        A new one, or that of ``ax``.

    Raises
    ------
    InputError
        If there are not as many axes as panels.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as MplFigure
    except ImportError:
        raise MissingExtraError("matplotlib", "plot", "drawing figures") from None
    if ax is not None:
        given: list[Axes] = np.asarray(ax, dtype=object).ravel().tolist()
        if len(figure.panels) != len(given):
            n, m = len(figure.panels), len(given)
            one = "one pair of axes" if m == 1 else f"{m} pairs of axes"
            raise InputError(f"{figure.name} has {n} panel{'s' * (n > 1)} and cannot be drawn into {one}: give {n}")
        for panel, own in zip(figure.panels, given, strict=True):
            _paint(panel, own)
        handles = _handles(given)
        if handles:
            given[0].legend(handles.values(), handles.keys(), fontsize=_FONT - 1.0, frameon=False)
        host = given[0].get_figure(root=True)
        assert isinstance(host, MplFigure)
        return host
    rows, columns, size = _arrangement(figure)
    canvas = MplFigure(figsize=size, layout="constrained")
    FigureCanvasAgg(canvas)
    # Jupyter shows it without a magic command; figures of pyplot, which it knows by itself, are not made here
    setattr(canvas, "_repr_png_", functools.partial(png, canvas))  # noqa: B010
    heights = [max(p.height for p in figure.panels[i * columns : (i + 1) * columns]) for i in range(rows)]
    axes = canvas.subplots(rows, columns, squeeze=False, height_ratios=heights)
    for panel, axis in zip(figure.panels, axes.flat, strict=False):
        _paint(panel, axis)
    for axis in axes.flat[len(figure.panels) :]:
        axis.set_visible(False)
    if columns == 1 and figure.linked:
        for axis in axes[:-1, 0]:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
    _legend(canvas, figure, columns)
    return canvas


def _arrangement(figure: content.Figure) -> tuple[int, int, tuple[float, float]]:
    n = len(figure.panels)
    if figure.panels[0].equal and n == 1:
        return 1, 1, (_WIDTH, _WIDTH * 1.05)
    if n > 1 and all(panel.equal for panel in figure.panels):
        columns = max(figure.columns, 1)
        rows = -(-n // columns)
        return rows, columns, (_WIDE, 0.6 + rows * 1.02 * _WIDE / columns)
    if figure.paper_columns:
        rows = -(-n // figure.paper_columns)
        return rows, figure.paper_columns, (_WIDE, 0.5 + 2.6 * rows)
    columns = 1 if n <= 5 else 2 if n <= 6 else 3
    rows = -(-n // columns)
    # slopes of a log-log plot are read by eye: it needs height
    steep = figure.panels[0].log_x and figure.panels[0].log
    height = 2.5 if steep and n == 1 else 2.0 if steep else 1.9 if n == 1 else 1.3
    total = height * rows if columns > 1 else height * sum(p.height for p in figure.panels)
    return rows, columns, (_WIDTH if columns == 1 else _WIDE, 0.6 + total)


def _paint(panel: Panel, ax: Axes) -> None:
    bars = [item for item in panel.items if isinstance(item, Bars)]
    for item in panel.items:
        look = None if isinstance(item, Text | Picture) else style(item.role)
        match item, look:
            case Text(), _:
                right = item.place == "right"
                ax.annotate(
                    item.text, (item.x, item.y), (2 if right else 0, 1 if right else 3), textcoords="offset points",
                    ha="left" if right else "center", va="bottom", fontsize=_FONT - (2.0 if right else 1.0),
                )  # fmt: skip
            case Picture(), _:
                ax.imshow(item.pixels, extent=(item.left, item.right, item.bottom, item.top), zorder=0.1, aspect="auto")
            case Span(), s if s is not None:
                ax.axvspan(item.start, item.stop, color=s.light, alpha=s.alpha, lw=0, zorder=0.5, label=item.label)
            case Band(), s if s is not None:
                ax.fill_between(
                    item.x, item.low, item.high, color=s.light, alpha=s.alpha, lw=0, zorder=1, label=item.label
                )
            case Bars(), s if s is not None:
                width = 0.8 / len(bars)
                ax.bar(
                    item.x + width * (bars.index(item) - 0.5 * (len(bars) - 1)), item.height, width, color=s.light,
                    label=item.label,
                )  # fmt: skip
            case Line(), s if s is not None:
                ax.plot(
                    item.x, item.y, color=s.light, lw=s.width, ls=(0, s.dash) if s.dash else "-", alpha=s.alpha,
                    label=item.label, solid_capstyle="butt", zorder=1.5 if s.alpha < 1.0 else 3,
                )  # fmt: skip
            case Markers(), s if s is not None:
                hollow = s.symbol == "ring"
                ax.plot(
                    item.x, item.y, ls="none", marker=_SYMBOLS[s.symbol], ms=s.size,
                    mew=s.width if s.symbol not in ("dot", "square") else 0.0, color=s.light,
                    mfc="none" if hollow else s.light, label=item.label,
                    zorder=2 if s.symbol in ("dot", "ring") else 4,
                )  # fmt: skip
    _dress(panel, ax)


def _dress(panel: Panel, ax: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    if panel.log:
        ax.set_yscale("log")
    if panel.log_x:
        ax.set_xscale("log")
    if panel.x_limits is not None and panel.x_limits[1] > panel.x_limits[0]:
        ax.set_xlim(*panel.x_limits)
    if panel.y_limits is not None:
        ax.set_ylim(*panel.y_limits)
    if panel.equal:
        ax.set_aspect("equal", adjustable="datalim" if panel.x_limits is None else "box")
    if any(isinstance(item, Bars) for item in panel.items):
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=12, min_n_ticks=1))
    ax.set_xlabel(panel.x_label, fontsize=_FONT)
    ax.set_ylabel(panel.y_label, fontsize=_FONT)
    if panel.title:
        ax.set_title(panel.title, fontsize=_FONT - 1.0, loc="left", pad=3)
    ax.tick_params(labelsize=_FONT - 1.0, length=2.5)
    ax.tick_params(which="minor", labelsize=_FONT - 2.0)
    ax.grid(True, color=PRINT_GRID, lw=0.5)
    if not panel.grid:
        ax.grid(False)
    if panel.y_ticks:
        ax.set_yticks([v for v, _ in panel.y_ticks], [w for _, w in panel.y_ticks])
    elif not panel.log:
        ax.ticklabel_format(axis="y", useOffset=False)  # whole numbers, not what to add to them
    if panel.bare:
        ax.set_axis_off()
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def _legend(canvas: Figure, figure: content.Figure, columns: int) -> None:
    handles = _handles(canvas.axes)
    if len(handles) > 1 or any(isinstance(i, Span) for p in figure.panels for i in p.items):
        # as many beside each other as fit, by the length of the labels
        room = (64 if columns == 1 else 100) / (6.0 + float(np.mean([len(label) for label in handles])))
        canvas.legend(
            handles.values(), handles.keys(), loc="outside upper center", ncols=int(np.clip(room, 1, 6)),
            fontsize=_FONT - 1.0, frameon=False, columnspacing=1.2, handlelength=1.6, markerscale=1.3,
        )  # fmt: skip


def _handles(axes: Sequence[Axes]) -> dict[str, Any]:
    """What stands for each label in a legend, every label once."""
    handles: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    return handles
