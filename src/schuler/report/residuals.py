"""Innovations: what each measurement said beyond what the filter expected, and whether their sizes are as predicted."""

from __future__ import annotations

import numpy as np

from schuler.analysis.consistency import chi_square_band
from schuler.arrays import FloatArray
from schuler.filtering.measurements import ACCEPTED, FORCED, KINDS, REJECTED, UNUSED, VELOCITY, ZERO_VELOCITY
from schuler.filtering.result import Innovations
from schuler.report.accuracy import AXES
from schuler.report.content import Band, Figure, Item, Panel, band, level, line, markers
from schuler.report.subject import Subject
from schuler.report.track import TIME, outages

_SHOWN = {
    ACCEPTED: ("measured", "accepted"),
    FORCED: ("forced", "accepted after lock-out"),
    REJECTED: ("rejected", "rejected"),
}


def kinds(subject: Subject) -> list[str]:
    """Kinds of measurements of which at least one was tested."""
    inn = subject.result.innovations
    return [name for code, name in KINDS.items() if np.any((inn.kind == code) & (inn.status != UNUSED))]


def innovations(subject: Subject, kind: str) -> Figure:
    """Innovations north, east, down of one kind with their predicted 3-sigma, and their normalised squares."""
    inn = subject.result.innovations.of(kind)
    inn = inn.where(inn.status != UNUSED)
    t = subject.seconds(inn.t)
    code = next(c for c, name in KINDS.items() if name == kind)
    unit = "m/s" if code in (VELOCITY, ZERO_VELOCITY) else "m"
    panels = []
    for i, axis in enumerate(AXES):
        three = 3.0 * inn.sigma[:, i]
        items: list[Item] = [*outages(subject), band(t, -three, three, "sigma", "±3 sigma predicted")]
        items.append(level(subject.span, 0.0, "level"))
        for status, (role, label) in _SHOWN.items():
            k = inn.status == status
            if k.any():
                items.append(markers(t[k], inn.innovation[k, i], role, label))
        limit, beyond = reach(inn.innovation[:, i], three)
        title = f"inside ±3 sigma: {100.0 * np.mean(np.abs(inn.innovation[:, i]) <= three):.1f} %"
        if beyond:
            title += f"; {beyond} beyond the axis"
        panels.append(
            Panel(TIME, f"{axis} [{unit}]", tuple(items), title=title, x_limits=subject.span, y_limits=(-limit, limit))
        )
    panels.append(_normalised(subject, inn, t))
    name = kind.replace("_", " ")
    caption = (
        f"Measured minus predicted {name}: scatter about zero inside the band is right, a drift or a run of one sign "
        "means that something is not modelled; the last panel is the squared size against its prediction, about 1 for "
        "an honest filter."
    )
    return Figure(f"innovations_{kind}", f"Innovations: {name}", caption, tuple(panels))


def running_mean(values: FloatArray) -> tuple[FloatArray, int]:
    """Centred mean over a thirtieth of the values, at least ten; NaN where the window is not full.

    Returns
    -------
    mean : ndarray, shape (n,)
    width : int
        Values in the window; more than n if there are too few for one.
    """
    n = len(values)
    width = max(11, 2 * (n // 60) + 1)
    mean = np.full(n, np.nan)
    if n >= width:
        sums = np.cumsum(np.insert(values, 0, 0.0))
        half = width // 2
        mean[half : n - half] = (sums[width:] - sums[:-width]) / width
    return mean, width


def reach(innovation: FloatArray, three: FloatArray) -> tuple[float, int]:
    """Symmetric limit of the axis, and how many innovations lie beyond: a few wild fixes must not flatten the rest."""
    size = np.abs(innovation[np.isfinite(innovation)])
    if not len(size):
        return 1.0, 0
    limit = 1.3 * max(float(np.quantile(size, 0.95)), float(np.nanquantile(three, 0.9)))
    limit = min(limit, 1.1 * max(float(size.max()), float(np.nanmax(three))))
    return limit, int(np.sum(size > limit))


def _normalised(subject: Subject, inn: Innovations, t: FloatArray) -> Panel:
    nis = inn.nis / 3.0
    finite = np.isfinite(nis) & (nis > 0.0)
    low, high = chi_square_band(3)
    x = np.array(subject.span)
    items: list[Item] = [
        *outages(subject),
        Band(x, np.full(2, low), np.full(2, high), "expected", "95 % band"),
        level(subject.span, 1.0, "level"),
    ]
    for status, (role, label) in _SHOWN.items():
        k = finite & (inn.status == status)
        if k.any():
            items.append(markers(t[k], nis[k], role, label))
    mean, width = running_mean(nis[finite])
    if np.isfinite(mean).any():
        items.append(line(t[finite], mean, "mean", f"running mean of {width}"))
    within = np.mean((nis >= low) & (nis <= high))
    title = f"mean {np.mean(nis[finite]):.2f}, {100.0 * within:.1f} % inside the 95 % band"
    top = max(10.0, 1.5 * float(nis[finite].max())) if finite.any() else 10.0
    return Panel(
        TIME, "NIS per axis [-]", tuple(items), title=title, x_limits=subject.span, y_limits=(0.02, top), log=True
    )
