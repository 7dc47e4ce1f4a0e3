"""Heat maps: numbers as colours, with a key that says which colour is which number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.plotting.figure import TIME, ByteArray, Limits, Line, Panel, Picture

#: Places on a scale, and red, green and blue there; between them colours are interpolated.
Scale: TypeAlias = Sequence[tuple[float, tuple[int, int, int]]]

#: From nothing (dark) to much (pale); lightness rises all the way, for grey prints.
RISING: Scale = (
    (0.0, (13, 8, 75)), (0.25, (26, 70, 135)), (0.5, (28, 128, 145)), (0.75, (86, 182, 130)), (1.0, (250, 246, 205)),
)  # fmt: skip
#: From -1 (blue) over 0 (white) to 1 (orange).
SIGNED: Scale = ((-1.0, (0, 74, 134)), (-0.5, (120, 170, 210)), (0.0, (250, 250, 250)), (0.5, (240, 170, 110)),
                 (1.0, (190, 70, 0)))  # fmt: skip
_STEPS = 200  # colours of a picture: it then fits a palette


def colours(values: FloatArray, scale: Scale) -> ByteArray:
    """Colours of numbers, opaque; NaN is transparent. Shape (...) to (..., 4)."""
    place = [p for p, _ in scale]
    values = np.asarray(values, dtype=np.float64)
    steps = np.rint((np.clip(values, place[0], place[-1]) - place[0]) / (place[-1] - place[0]) * _STEPS)
    on_scale = place[0] + steps / _STEPS * (place[-1] - place[0])
    parts = [np.interp(on_scale, place, [float(c[k]) for _, c in scale]) for k in range(3)]
    parts.append(np.full_like(parts[0], 255.0))
    pixels = np.stack(parts, axis=-1)
    pixels[~np.isfinite(values)] = 0.0
    return np.asarray(np.rint(pixels), dtype=np.uint8)


def frame(picture: Picture) -> Line:
    """An invisible line along the lower edge: a picture alone has no extent of its own."""
    return Line(np.array([picture.left, picture.right]), np.array([picture.bottom, picture.bottom]), "graticule")


def key(label: str, limits: Limits, scale: Scale) -> Panel:
    """What the colours stand for: a strip from the lowest to the highest number, which are called ``limits``."""
    place = np.linspace(scale[0][0], scale[-1][0], 128)
    picture = Picture(*limits, 0.0, 1.0, colours(place, scale)[None])
    return Panel(
        label, "", (picture, frame(picture)), x_limits=limits, y_limits=(0.0, 1.0), grid=False,
        y_ticks=((0.5, "colour"),), height=0.35,
    )  # fmt: skip


def time_map(
    label: str, values: FloatArray, scale: Scale, x: Limits, y: Limits, *, title: str = "", height: float = 1.0
) -> Panel:
    """Numbers over time and something else.

    Parameters
    ----------
    label : str
        Of the y axis.
    values : ndarray, shape (h, w)
        First row at the top.
    scale : Scale
    x, y : (low, high)
        What the picture spans: seconds, and the unit of the label.
    title : str
    height : float
        In heights of a usual panel.
    """
    picture = Picture(*x, *y, colours(values, scale))
    return Panel(TIME, label, (picture, frame(picture)), title, x_limits=x, y_limits=y, grid=False, height=height)
