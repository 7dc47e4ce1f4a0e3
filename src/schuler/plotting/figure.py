"""What is plotted, said once: both the matplotlib figures and the interactive page draw these.

A :class:`Figure` has panels, a :class:`Panel` has items. Items name a *role* ("filtered", "outage", ...) and no colour;
what a role looks like stands in :mod:`schuler.plotting.style`. They hold arrays and are compared by identity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.plotting.notebook import Abridged

#: Points a line keeps: the largest and the smallest value of a thousand stretches, as many as a plot has dots across.
LIMIT = 2000

#: Points of a band, and of an estimate: they move slowly, and a page of three megabytes travels better than one of six.
SLOW_LIMIT = 500
_BLOCK = 1 << 18  # samples that are thinned at a time: of a day at 200 Hz a column takes 140 MB

#: Label of an axis of time.
TIME = "time [s]"

Limits: TypeAlias = tuple[float, float]
#: Numbers or words.
Along: TypeAlias = FloatArray | npt.NDArray[np.str_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Samples:
    """Every sample of a curve, for a page to draw from where it is zoomed in: times [s], finite values when asked for.

    All samples of a day at 200 Hz are 140 MB a curve, so they are made when a page is written and not before.
    """

    t: FloatArray
    values: Callable[[], FloatArray]


@dataclass(frozen=True, eq=False, repr=False)
class Line(Abridged):
    """A curve; NaN breaks it. Without a label it is left out of the legend.

    ``along`` names what else is known at its points, for the mouse: of a track the time [s], under the name ``TIME``,
    by which it follows the zoom of all time axes of its page. ``samples`` are those that x and y were thinned from.
    """

    x: FloatArray
    y: FloatArray
    role: str
    label: str = ""
    along: tuple[tuple[str, Along], ...] = ()
    samples: Samples | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Band(Abridged):
    """The area between two curves; NaN breaks it."""

    x: FloatArray
    low: FloatArray
    high: FloatArray
    role: str
    label: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Markers(Abridged):
    """Single points."""

    x: FloatArray
    y: FloatArray
    role: str
    label: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Bars(Abridged):
    """Columns standing on zero; several in a panel stand beside each other."""

    x: FloatArray
    height: FloatArray
    role: str
    label: str = ""


@dataclass(frozen=True, eq=False)
class Span:
    """A stretch of the x axis, shaded over the whole height of the panel."""

    start: float
    stop: float
    role: str
    label: str = ""


@dataclass(frozen=True, eq=False)
class Text:
    """A word at a point of the panel: centred above it, or ``place`` = ``right`` of it."""

    x: float
    y: float
    text: str
    place: str = "above"


@dataclass(frozen=True, eq=False, repr=False)
class Picture(Abridged):
    """An image behind everything else: ``pixels`` (h, w, 4) of bytes, the first row at the top."""

    left: float
    right: float
    bottom: float
    top: float
    pixels: ByteArray


Item: TypeAlias = Line | Band | Markers | Bars | Span | Text | Picture


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    x_label, y_label : str
        With the unit in square brackets.
    items : tuple of Item
        Drawn in this order, spans always behind the rest.
    title : str
        A phrase above the panel.
    x_limits, y_limits : (low, high), optional
        Range shown at first; all of it if left out.
    equal : bool
        A metre is as long on both axes.
    log : bool
        Logarithmic y axis; ``y_limits`` are values, not exponents.
    log_x : bool
        Logarithmic x axis, likewise.
    grid : bool
        Lines at the ticks.
    bare : bool
        Neither axes nor ticks: what is drawn has its own.
    y_ticks : tuple of (value, text)
        Words along the y axis in place of numbers.
    height : float
        In heights of a usual panel.
    """

    x_label: str
    y_label: str
    items: tuple[Item, ...]
    title: str = ""
    x_limits: Limits | None = None
    y_limits: Limits | None = None
    equal: bool = False
    log: bool = False
    log_x: bool = False
    grid: bool = True
    bare: bool = False
    y_ticks: tuple[tuple[float, str], ...] = ()
    height: float = 1.0


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels that belong together.

    Attributes
    ----------
    name : str
        For file names and links: letters, digits, underscores.
    title : str
    caption : str
        One sentence that says how to read it.
    panels : tuple of Panel
    columns : int
        Panels side by side on a page, where there is room.
    paper_columns : int
        Panels side by side in a printed figure; 0: chosen by their number.
    linked : bool
        Panels have the same x axis, and zooming one zooms all. Panels over ``TIME`` are linked on all of the page.
    """

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 1
    linked: bool = True
    paper_columns: int = 0

    def legend(self) -> dict[str, tuple[str, str]]:
        """Label to (kind of item, role), every label once, in the order of appearance."""
        entries: dict[str, tuple[str, str]] = {}
        for panel in self.panels:
            for item in panel.items:
                if not isinstance(item, Text | Picture) and item.label:
                    entries.setdefault(item.label, (type(item).__name__.lower(), item.role))
        return entries


def line(x: ArrayLike, y: ArrayLike, role: str, label: str = "", *, limit: int = LIMIT) -> Line:
    """A curve over increasing x, broken where x pauses, thinned to what can be seen."""
    x, y = _broken(x, y)
    k = thin([y], limit)
    return Line(x[k], y[k], role, label)


def sampled(t: FloatArray, values: Callable[[], FloatArray], role: str, label: str = "") -> Line:
    """A curve over increasing times that a page can draw sample by sample where it is zoomed in."""
    return replace(line(t, values(), role, label), samples=Samples(t, values) if len(t) > LIMIT else None)


def path(
    x: ArrayLike,
    y: ArrayLike,
    role: str,
    label: str = "",
    along: Sequence[tuple[str, Callable[[IntArray], Along]]] = (),
) -> Line:
    """A curve in the plane, thinned by the extremes of both coordinates; ``along`` are functions of the rows drawn."""
    x, y = (np.asarray(c, dtype=np.float64) for c in (x, y))
    k = thin([x, y])
    return Line(x[k], y[k], role, label, tuple((name, values(k)) for name, values in along))


def band(x: ArrayLike, low: ArrayLike, high: ArrayLike, role: str, label: str = "", *, limit: int = SLOW_LIMIT) -> Band:
    """A band over increasing x, broken where x pauses, thinned so that it never gets narrower."""
    x, low, high = _broken(x, low, high)
    k = thin([low, high], limit)
    return Band(x[k], low[k], high[k], role, label)


def markers(x: ArrayLike, y: ArrayLike, role: str, label: str = "", *, limit: int = LIMIT) -> Markers:
    """Points over increasing x, thinned by their extremes."""
    x, y = (np.asarray(c, dtype=np.float64) for c in (x, y))
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    k = thin([y], limit)
    return Markers(x[k], y[k], role, label)


def level(limits: Limits, y: float, role: str, label: str = "") -> Line:
    """A horizontal line."""
    return Line(np.array(limits), np.array([y, y]), role, label)


def thin(columns: Sequence[FloatArray], limit: int = LIMIT) -> IntArray:
    """Indices of the samples to draw: the extremes of every column in each of many equal stretches.

    Parameters
    ----------
    columns : sequence of ndarray, shape (n,)
        Drawn against a common sequence; NaN where there is a gap.
    limit : int
        No more indices than this; all of them if n is not larger.

    Returns
    -------
    ndarray of int, increasing
        The first and the last sample are among them, and a gap wherever one lies between two others.
    """
    n = len(columns[0])
    if n <= limit:
        return np.arange(n)
    gap = np.isnan(columns[0])
    for column in columns[1:]:
        gap |= np.isnan(column)
    holes = np.flatnonzero(gap)
    # where there are gaps, one may have to stand between any two of the extremes
    stretches = max((limit - 2) // (2 * len(columns) * (2 if len(holes) else 1)), 1)
    edges = np.linspace(0, n, stretches + 1).astype(np.int64)
    together = max(stretches * _BLOCK // n, 1)
    keep: BoolArray = np.zeros(n, dtype=bool)
    keep[[0, n - 1]] = True
    for column in columns:
        for extreme, beyond in ((np.minimum, np.inf), (np.maximum, -np.inf)):
            for k in range(0, stretches, together):
                ends = edges[k : k + together + 1]
                rows, starts = slice(ends[0], ends[-1]), ends[:-1] - ends[0]
                filled = np.where(gap[rows], beyond, column[rows]) if len(holes) else column[rows]
                same = filled == np.repeat(extreme.reduceat(filled, starts), np.diff(ends))
                at = np.flatnonzero(same)
                keep[ends[0] + at[np.searchsorted(at, starts)]] = True  # the first of those equal in a stretch
    if len(holes):
        keep[gap] = False
        kept = np.flatnonzero(keep)
        passed = np.searchsorted(holes, kept)  # gaps before each kept sample
        keep[holes[passed[:-1][np.diff(passed) > 0]]] = True
    return np.flatnonzero(keep)


def view(lines: Sequence[ArrayLike], bands: Sequence[ArrayLike] = (), *, least: float = 0.0) -> Limits | None:
    """Limits of a y axis that shows all of the lines and most of the bands.

    Parameters
    ----------
    lines : sequence of array_like
        Shown completely.
    bands : sequence of array_like
        Edges of bands: shown but for their outermost 5 %, so that a wide start does not flatten all the rest.
    least : float
        Smallest distance of the limits.
    """
    ends = [v[np.isfinite(v)] for v in (np.asarray(a, dtype=np.float64).ravel() for a in lines)]
    ends += [np.quantile(v[np.isfinite(v)], [0.05, 0.95]) for v in map(np.asarray, bands) if np.isfinite(v).any()]
    values = np.concatenate([*ends, np.empty(0)])
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    margin = max(0.06 * (high - low), 0.5 * (least - (high - low)), 1e-12 * max(abs(low), abs(high)), 1e-30)
    return low - margin, high + margin


def _is_even(x: FloatArray) -> bool:
    """Whether no step of x is five times another: then none is a pause, and no array of steps is needed."""
    least, most = np.inf, 0.0
    for k in range(0, len(x) - 1, _BLOCK):
        step = np.diff(x[k : k + _BLOCK + 1])
        least, most = min(least, float(step.min())), max(most, float(step.max()))
        if not step.min() > 0.0:
            return False
    return most <= 5.0 * least


def _broken(x: ArrayLike, *columns: ArrayLike) -> tuple[FloatArray, ...]:
    """Columns with a NaN put in where x pauses for more than five of its usual steps: nothing is drawn across."""
    x = np.asarray(x, dtype=np.float64)
    arrays = [np.asarray(c, dtype=np.float64) for c in columns]
    if len(x) < 3 or _is_even(x):
        return (x, *arrays)
    forward = np.diff(x)
    if not forward.min() > 0.0:
        forward = forward[forward > 0.0]  # several values at one time are no step
    usual = float(np.median(forward, overwrite_input=True)) if len(forward) else np.inf
    del forward
    after = np.flatnonzero(np.diff(x) > 5.0 * usual) + 1
    if not len(after):
        return (x, *arrays)
    middle = 0.5 * (x[after - 1] + x[after])
    return (np.insert(x, after, middle), *(np.insert(a, after, np.nan) for a in arrays))
