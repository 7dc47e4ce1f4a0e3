"""A panel's description as plotly data and layout, written as plain dictionaries.

Colours are names of CSS variables (``--filtered``); the page puts in what they stand for, so that it follows the
reader's light or dark setting. plotly's Python classes are not needed: checking a hundred traces costs more
than writing them.
"""

from __future__ import annotations

import base64
import gzip
import math
import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.plotting.figure import (
    Band,
    Bars,
    ByteArray,
    Figure,
    Item,
    Line,
    Markers,
    Panel,
    Picture,
    Samples,
    Span,
    Text,
)
from schuler.plotting.style import style

_SYMBOLS = {
    "dot": "circle", "cross": "x-thin-open", "triangle": "triangle-up", "ring": "circle-open", "square": "square",
}  # fmt: skip
_PX = 4.0 / 3.0  # CSS pixels in a point
_DASH_PX = 1.5  # of a dash of one line width
_SAMPLES = 400_000  # letters that all samples of a panel may take in a page
_AREA = "-area"  # of the names of variables for transparent colours


def packed(data: bytes) -> str:
    """Bytes as text of a page, which its script unpacks: gzip, then base64. The same text for the same bytes."""
    # noise hardly packs: level 6 takes twice the time of level 4 for 2 % fewer bytes
    return base64.b64encode(gzip.compress(data, 4, mtime=0)).decode("ascii")


def css_name(role: str, *, area: bool = False) -> str:
    """Name of the CSS variable with the colour of a role; ``area`` for its transparent form."""
    return f"--{role.replace('_', '-')}{_AREA if area else ''}"


def shown_as_is(text: str) -> str:
    """Words as plotly shows them: it would take ``<b>`` for a style, ``<a>`` for a link, ``%{y}`` for a value."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("%{", "%&#123;")


def panel_data(figure: Figure, panel: Panel) -> dict[str, Any]:
    """Traces and layout of one panel.

    Returns
    -------
    dict
        ``data`` and ``layout`` for plotly; ready for JSON, numbers rounded to what can be seen. ``samples`` by the
        place of a trace are all of its points, packed, for the script of the page.
    """
    spans = [item for item in panel.items if isinstance(item, Span)]
    texts = [item for item in panel.items if isinstance(item, Text)]
    layout: dict[str, Any] = {
        # panels of one time axis above each other: its name stands under the last one
        "xaxis": _axis(
            "" if figure.linked and figure.columns == 1 and panel is not figure.panels[-1] else panel.x_label,
            panel.x_limits,
            log=panel.log_x,
        ),
        "yaxis": _axis(panel.y_label, panel.y_limits, log=panel.log),
        "hovermode": "closest" if panel.equal else "x",
        "barmode": "group",
    }
    if panel.equal:
        layout["yaxis"] |= {"scaleanchor": "x", "scaleratio": 1}
    if not panel.grid:
        layout["xaxis"]["showgrid"] = layout["yaxis"]["showgrid"] = False
    if panel.bare:
        layout["xaxis"]["visible"] = layout["yaxis"]["visible"] = False
    if panel.y_ticks:
        layout["yaxis"] |= {
            "tickmode": "array", "tickvals": [v for v, _ in panel.y_ticks],
            "ticktext": [shown_as_is(w) for _, w in panel.y_ticks],
        }  # fmt: skip
    pictures = [item for item in panel.items if isinstance(item, Picture)]
    if pictures:
        layout["images"] = [
            {
                "source": _encoded(p), "xref": "x", "yref": "y", "x": _round(p.left, 2), "y": _round(p.top, 2),
                "sizex": _round(p.right - p.left, 2), "sizey": _round(p.top - p.bottom, 2), "sizing": "stretch",
                "layer": "below",
            }
            for p in pictures
        ]  # fmt: skip
    if any(isinstance(item, Bars) for item in panel.items):
        # every outage has its number under it as long as there is room
        layout["xaxis"] |= {"dtick": 1} if panel.x_limits is not None and panel.x_limits[1] < 20.0 else {}
        layout["yaxis"]["rangemode"] = "tozero"
    if spans:
        layout["shapes"] = [
            {
                "type": "rect", "xref": "x", "yref": "paper", "x0": _round(s.start, 4), "x1": _round(s.stop, 4),
                "y0": 0, "y1": 1, "layer": "below", "line": {"width": 0}, "fillcolor": css_name(s.role, area=True),
            }
            for s in spans
        ]  # fmt: skip
    if texts:
        layout["annotations"] = [
            {
                # plotly wants exponents here, unlike for lines and shapes
                "x": _round(math.log10(w.x) if panel.log_x else w.x, 4),
                "y": _round(math.log10(w.y) if panel.log else w.y, 4),
                "text": shown_as_is(w.text), "showarrow": False, "yanchor": "bottom", "font": {"size": 12},
                **({"xanchor": "left"} if w.place == "right" else {}),
            }
            for w in texts
        ]  # fmt: skip
    drawn = [item for item in panel.items if not isinstance(item, Span | Text | Picture)]
    # areas first: plotly draws in the order of the traces
    drawn.sort(key=lambda item: not isinstance(item, Band))
    traces = [trace(item, log=panel.log, log_x=panel.log_x) for item in drawn]
    curves = {k: item.samples for k, item in enumerate(drawn) if isinstance(item, Line) and item.samples is not None}
    samples = dict(zip(curves, _samples(list(curves.values())), strict=True)) if curves else {}
    if panel.bare or panel.y_ticks:  # the coordinates say nothing there
        for one in traces:
            if "hovertemplate" in one:
                name = shown_as_is(one["name"])
                one["hovertemplate"] = f"<extra>{name}</extra>" if panel.bare else f"%{{x:.5~g}}<extra>{name}</extra>"
    return {"data": traces, "layout": layout, **({"samples": samples} if samples else {})}


def trace(item: Item, *, log: bool = False, log_x: bool = False) -> dict[str, Any]:
    """The plotly trace of a line, band, bars or markers; ``log`` and ``log_x`` if it goes onto logarithmic axes."""
    match item:
        case Band():
            x, y = _outline(item)
            return {
                "type": "scatter", "mode": "lines", "x": _numbers(x, log=log_x), "y": _numbers(y, log=log),
                "fill": "toself", "fillcolor": css_name(item.role, area=True), "line": {"width": 0},
                "hoverinfo": "skip", "name": item.label, "showlegend": False,
            }  # fmt: skip
        case Line():
            s = style(item.role)
            quiet = s.alpha < 1.0 or not item.label
            return {
                "type": "scatter", "mode": "lines", "x": _numbers(item.x, log=log_x), "y": _numbers(item.y, log=log),
                "line": {
                    "color": css_name(item.role, area=s.alpha < 1.0), "width": round(s.width * _PX, 2),
                    "dash": ",".join(f"{_DASH_PX * d:g}px" for d in s.dash) or "solid", "simplify": False,
                },
                "name": item.label, "showlegend": False,
                **({"hoverinfo": "skip"} if quiet else _along(item) if item.along else _hover(item.label)),
            }  # fmt: skip
        case Markers():
            s = style(item.role)
            return {
                "type": "scatter", "mode": "markers", "x": _numbers(item.x, log=log_x), "y": _numbers(item.y, log=log),
                "marker": {
                    "color": css_name(item.role), "symbol": _SYMBOLS[s.symbol], "size": round(s.size * _PX * 1.3, 1),
                    "line": {
                        "width": 0 if s.symbol in ("dot", "square") else round(s.width * _PX, 2),
                        "color": css_name(item.role),
                    },
                },
                "name": item.label, "showlegend": False, **_hover(item.label),
            }  # fmt: skip
        case Bars():
            return {
                "type": "bar", "x": _numbers(item.x), "y": _numbers(item.height),
                "marker": {"color": css_name(item.role)}, "name": item.label, "showlegend": False, **_hover(item.label),
            }  # fmt: skip
    raise TypeError(f"{type(item).__name__} has no trace of its own")


def _hover(label: str) -> dict[str, Any]:
    return {"hovertemplate": f"%{{y:.4~g}}<extra>{shown_as_is(label)}</extra>"}


def _along(item: Line) -> dict[str, Any]:
    """What the mouse shows on a curve that knows more than its coordinates: names end in their unit in brackets."""
    lines, columns = [], []
    for k, (name, values) in enumerate(item.along):
        words, _, unit = name.rstrip("]").partition(" [")
        text = values.dtype.kind == "U"
        lines.append(f"{shown_as_is(words)} %{{customdata[{k}]{'' if text else ':.5~g'}}} {unit}")
        columns.append(values.tolist() if text else _numbers(np.asarray(values, dtype=np.float64)))
    return {
        "customdata": [list(row) for row in zip(*columns, strict=True)],
        "hovertemplate": "<br>".join(lines) + f"<extra>{shown_as_is(item.label)}</extra>",
    }


def _samples(curves: Sequence[Samples]) -> list[dict[str, Any]]:
    """All samples of the curves of a panel, which have the same times; extremes of stretches where they are too many.

    Values are rounded to half of what they change by from one sample to the next, which cannot be seen.
    """
    t, each = curves[0].t, 1
    while True:
        stretches = t[::each]
        n = len(stretches)
        interval = float(np.median(np.diff(stretches), overwrite_input=True)) if n > 1 else 1.0
        times = _integers(stretches, interval / 16.0)
        values = []
        for curve in curves:
            y = curve.values()
            change = np.diff(y)
            np.abs(change, out=change)
            step = max(0.5 * float(np.median(change, overwrite_input=True)), float(np.ptp(y)) / 2**20, 1e-30)
            del change
            if each > 1:
                starts = np.arange(0, len(t), each)
                ends = (np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts))
                y = np.stack(ends, axis=1).ravel()
            values.append(_integers(y, step))
        size = len(times["data"]) + sum(len(v["data"]) for v in values)
        if size <= _SAMPLES or n < 2000:
            return [{"n": n, "each": each, "interval": interval, "t": times, "y": v} for v in values]
        # two values of each stretch, so that two samples take as much as one by one
        each *= 1 << math.ceil(math.log2(max((2.0 if each == 1 else 1.0) * size / _SAMPLES, 2.0)))


def _integers(values: FloatArray, step: float) -> dict[str, Any]:
    """Multiples of a step as text: differences with their sign in the last bit, lowest bytes of all first, packed."""
    whole = values - values[0]
    whole /= step
    np.rint(whole, out=whole)
    change = whole.astype(np.int64)
    del whole
    change[1:] -= change[:-1].copy()
    sign = change >> 63
    change <<= 1  # in place: of a day at 200 Hz each array is 140 MB
    change ^= sign
    del sign
    folded = change.astype("<u4")
    del change
    planes = folded.view(np.uint8).reshape(-1, 4).T
    return {"zero": float(values[0]), "step": step, "data": packed(planes.tobytes())}


def _axis(label: str, limits: tuple[float, float] | None, *, log: bool) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": shown_as_is(label)}}
    if log:
        axis |= {"type": "log", "dtick": 1}
    if limits is not None and limits[1] > limits[0]:
        axis["range"] = [math.log10(v) if log else float(v) for v in limits]
        axis["range"] = [float(f"{v:.6g}") for v in axis["range"]]
    return axis


def _outline(band: Band) -> tuple[FloatArray, FloatArray]:
    """Closed outlines of the parts of a band, with a NaN between them."""
    finite = np.isfinite(band.low) & np.isfinite(band.high)
    starts = np.flatnonzero(finite & ~np.r_[False, finite[:-1]])
    stops = np.flatnonzero(finite & ~np.r_[finite[1:], False]) + 1
    xs: list[FloatArray] = []
    ys: list[FloatArray] = []
    gap = np.array([np.nan])
    for a, b in zip(starts, stops, strict=True):
        xs += [band.x[a:b], band.x[a:b][::-1], band.x[a : a + 1], gap]
        ys += [band.low[a:b], band.high[a:b][::-1], band.low[a : a + 1], gap]
    if not xs:
        return np.empty(0), np.empty(0)
    return np.concatenate(xs)[:-1], np.concatenate(ys)[:-1]


def _numbers(values: FloatArray, *, log: bool = False) -> list[float | None]:
    """Numbers for JSON, as many digits as can be seen: a hundred-thousandth of their range, or five on a log axis."""
    if log:
        return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values.tolist()]
    finite = values[np.isfinite(values)]
    size = float(np.ptp(finite)) if len(finite) else 0.0
    size = size or (float(np.abs(finite[0])) if len(finite) else 1.0) or 1.0
    places = 5 - math.floor(math.log10(size))
    rounded = np.round(values, places) if places < 15 else values
    if len(finite) < len(values):
        return [None if not math.isfinite(v) else v for v in rounded.tolist()]
    if size < 1e15 and np.all(rounded == np.rint(rounded)) and np.abs(rounded).max(initial=0.0) < 1e15:
        return list(rounded.astype(np.int64).tolist())
    return list(rounded.tolist())


def _encoded(picture: Picture) -> str:
    """The image as a data URI, in few enough colours to stay small."""
    flat = picture.pixels.reshape(-1, 4).copy().view("<u4").ravel()
    palette, place = np.unique(flat, return_inverse=True)
    if len(palette) <= 256:  # a heat map: exact, and without the library that reads maps
        data = _palette_png(palette.view(np.uint8).reshape(-1, 4), place.reshape(picture.pixels.shape[:2]))
        return "data:image/png;base64," + base64.b64encode(data).decode("ascii")
    import io

    from PIL import Image

    # with transparency only this method of choosing colours works
    image = Image.fromarray(picture.pixels, "RGBA").quantize(192, method=Image.Quantize.FASTOCTREE)
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def _palette_png(palette: ByteArray, place: IntArray) -> bytes:
    """PNG of indices into at most 256 colours. Shapes (n, 4), (h, w)"""
    height, width = place.shape

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = np.concatenate((np.zeros((height, 1), dtype=np.uint8), place.astype(np.uint8)), axis=1)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0))
        + chunk(b"PLTE", palette[:, :3].tobytes())
        + chunk(b"tRNS", palette[:, 3].tobytes())
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9))
        + chunk(b"IEND", b"")
    )


def _round(value: float, places: int) -> float:
    return round(float(value), places)
