"""Innovations: what each measurement said beyond what the filter expected, and whether their sizes are as predicted."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.filtering.kinds import Kind, shown
from schuler.filtering.measurements import (
    ACCEPTED,
    FORCED,
    GATED,
    KINDS,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    RESET_KINDS,
)
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.systems import system_index, system_label, system_role, systems_of
from schuler.navigation.report.track import outages
from schuler.navigation.result import Innovations
from schuler.plotting.figure import TIME, Band, Figure, Item, Markers, Panel, band, level, line, markers

_SHOWN = {
    ACCEPTED: ("measured", "accepted"),
    FORCED: ("forced", "accepted after lock-out"),
    REJECTED: ("rejected", "rejected"),
}
_GATED_SHOWN = 400
_FEW = 0.02  # share of rejections that says nothing against a filter

#: Kinds of one number a satellite, and kinds that are put into the state and not weighed.
OF_SATELLITES = (KINDS[PSEUDORANGE], KINDS[RANGE_RATE])
RESETS = tuple(KINDS[k] for k in RESET_KINDS)


def kinds(subject: Subject) -> list[str]:
    """Kinds of measurements of which at least one was tested, or put into the state."""
    inn = subject.result.innovations
    known = np.isfinite(inn.nis) | np.isfinite(inn.innovation[:, 0])
    return [name for code, name in KINDS.items() if np.any((inn.kind == code) & known)]


def innovations(subject: Subject, kind: str) -> Figure:
    """Innovations of one kind, component by component, with their predicted 3-sigma, and their normalised squares.

    Of resets, the steps they made. Pseudoranges and range rates are coloured by system where the ranges are known.
    """
    every, what = subject.result.innovations.of(kind), shown(kind)
    gated = subject.seconds(every.t[every.status == GATED])
    if kind in RESETS:
        return _steps(subject, every, kind, what)
    keep = np.isfinite(every.nis)
    inn = every.where(keep)
    t = subject.seconds(inn.t)
    sat = subject.satellite_of(kind)[keep] if kind in OF_SATELLITES else np.zeros(len(inn), dtype=np.int64)
    panels = []
    for i, axis in enumerate(what.axes):
        three = 3.0 * inn.sigma[:, i] / what.factor
        difference = inn.innovation[:, i] / what.factor
        limit, beyond = reach(difference, three)
        items: list[Item] = [*outages(subject), _predicted(t, three), level(subject.span, 0.0, "level")]
        items += _points(t, difference, inn.status, sat)
        items += _not_met(gated, -0.97 * limit)
        title = f"inside ±3 sigma: {100.0 * np.mean(np.abs(difference) <= three):.1f} %"
        if beyond:
            title += f"; {beyond} beyond the axis"
        panels.append(
            Panel(
                TIME, f"{axis} [{what.unit}]", tuple(items), title=title, x_limits=subject.span,
                y_limits=(-limit, limit),
            )
        )  # fmt: skip
    panels.append(_normalised(subject, inn, t))
    caption = (
        f"Measured minus predicted, {what.text}: scatter about zero inside the band is right, a drift or a run of one "
        "sign means that something is not modelled; the last panel is the squared size against its prediction, about 1 "
        "for an honest filter."
    )
    if kind in OF_SATELLITES:
        caption += " The band is the mean one of the satellites of each epoch; the share counts each with its own."
    if len(gated):
        caption += (
            f" {len(gated)} more were not used because their condition was not met (rings at the bottom): not tested, "
            "so without an innovation."
        )
    return Figure(f"innovations_{kind}", f"Innovations: {what.text}", caption, tuple(panels))


def _predicted(t: FloatArray, three: FloatArray) -> Band:
    """The 3-sigma band; of measurements at the same time, such as satellites, the root mean square."""
    times, first, count = np.unique(t, return_index=True, return_counts=True)
    mean = np.sqrt(np.add.reduceat(three**2, first) / count) if len(t) else three
    return band(times, -mean, mean, "sigma", "±3 sigma predicted")


def _points(t: FloatArray, y: FloatArray, status: IntArray, sat: IntArray) -> list[Item]:
    """Symbols by what became of the measurement; accepted ones by system where the satellite is known."""
    items: list[Item] = []
    for code, (role, label) in _SHOWN.items():
        k = status == code
        if code == ACCEPTED:
            for letter in systems_of(sat[k & (sat > 0)]):
                own = k & (sat > 0) & (sat // 100 == system_index(letter))
                items.append(markers(t[own], y[own], system_role(letter), system_label(letter)))
            k = k & (sat == 0)
        if k.any():
            items.append(markers(t[k], y[k], role, label))
    return items


def _not_met(t: FloatArray, y: float) -> list[Item]:
    if not len(t):
        return []
    k = np.arange(0, len(t), -(-len(t) // _GATED_SHOWN))
    return [Markers(t[k], np.full(len(k), y), "gated", "condition not met")]


def _steps(subject: Subject, inn: Innovations, kind: str, what: Kind) -> Figure:
    inn = inn.where(np.isfinite(inn.innovation[:, 0]))
    t = subject.seconds(inn.t)
    panels = []
    for i, axis in enumerate(what.axes):
        items: tuple[Item, ...] = (
            *outages(subject),
            level(subject.span, 0.0, "level"),
            markers(t, inn.innovation[:, i], "measured", "step"),
        )
        title = f"RMS {np.sqrt(np.mean(inn.innovation[:, i] ** 2)):.3g} {what.unit}"
        panels.append(Panel(TIME, f"{axis} [{what.unit}]", items, title=title, x_limits=subject.span))
    caption = (
        f"By how much each {what.text} moved the solution: the error the INS had gathered since the one before, and "
        "that of the fix. Nothing is weighed here, so there is no test."
    )
    return Figure(f"innovations_{kind}", f"Steps: {what.text}", caption, tuple(panels))


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


def mean_nis(inn: Innovations) -> tuple[float, bool]:
    """Mean normalised square per component, and whether it is as predicted.

    Predicted means between 0.64 and 1.56 (sizes wrong by a quarter), or inside the 99.9 % band of so many values. The
    rejected are left out as long as they are few (2 %): single faults are for the gate. If they are many, it is the
    filter that is wrong.
    """
    inn = inn.where(judged(inn))
    if not len(inn):
        return float("nan"), True
    mean = inn.mean_nis()
    low, high = chi_square_band(1, int(inn.freedom.sum()), 0.999)
    return mean, bool(min(low, 0.64) <= mean <= max(high, 1.5625))


def judged(inn: Innovations) -> BoolArray:
    """Which innovations tell of the filter: those tested, without the rejected of a kind if these are few."""
    tested = np.isfinite(inn.nis)
    keep = tested.copy()
    for kind in np.unique(inn.kind[tested]):
        rejected = tested & (inn.kind == kind) & (inn.status == REJECTED)
        if rejected.sum() <= _FEW * np.sum(tested & (inn.kind == kind)):
            keep &= ~rejected
    return keep


def _normalised(subject: Subject, inn: Innovations, t: FloatArray) -> Panel:
    nis = inn.nis / inn.freedom
    finite = np.isfinite(nis) & (nis > 0.0)
    low, high = chi_square_band(int(inn.freedom[0]))
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
    used = inn.where(judged(inn))
    if len(used) < len(inn):
        title = f"{title}; mean {used.mean_nis():.2f} without the rejected"
    top = max(10.0, 1.5 * float(nis[finite].max())) if finite.any() else 10.0
    per = "NIS per axis [-]" if inn.freedom[0] > 1 else "NIS [-]"
    return Panel(TIME, per, tuple(items), title=title, x_limits=subject.span, y_limits=(0.02, top), log=True)
