"""Innovations with their predicted sizes, by component and by satellite."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.kinds import Kind, kind_display
from schuler.filtering.measurements import (
    ACCEPTED,
    CARRIER_PHASE,
    FORCED,
    GATED,
    KINDS,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    RESET_KINDS,
)
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite_name
from schuler.navigation.evaluation.consistency import chi_square_band, judged, mean_nis
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import outages
from schuler.navigation.result import Innovations
from schuler.plotting.figure import TIME, Band, Figure, Item, Markers, Panel, band, level, line, markers

_SHOWN = {
    ACCEPTED: ("measured", "accepted"),
    FORCED: ("forced", "accepted after lock-out"),
    REJECTED: ("rejected", "rejected"),
}
_GATED_SHOWN = 400

#: Kinds of one number a satellite, and kinds that are put into the state and not weighed.
SATELLITE_KINDS = (KINDS[PSEUDORANGE], KINDS[RANGE_RATE])
BY_SATELLITE = (*SATELLITE_KINDS, KINDS[CARRIER_PHASE])
RESET_NAMES = tuple(KINDS[k] for k in RESET_KINDS)


def systems_of(sat: IntArray) -> list[str]:
    """Letters of the systems among satellites' numbers, in the order of :data:`~schuler.gnss.signals.SYSTEMS`."""
    return [SYSTEMS[i] for i in np.unique(sat // 100).tolist()]


def system_role(letter: str) -> str:
    """Role of a system in figures."""
    return f"system_{letter.lower()}"


def kinds(subject: Subject) -> list[str]:
    """Kinds of measurements of which at least one was tested, or put into the state."""
    inn = subject.result.innovations
    offered = np.isfinite(inn.nis) | np.isfinite(inn.innovation[:, 0])
    return [name for code, name in KINDS.items() if np.any((inn.kind == code) & offered)]


def by_component(subject: Subject, kind: str) -> Figure:
    """Innovations of one kind, component by component, with their predicted 3-sigma, and their normalised squares.

    Resets are shown as the steps they made; pseudoranges and range rates have the colours of their systems.
    """
    every, display = subject.result.innovations.of(kind), kind_display(kind)
    gated = subject.seconds(every.t[every.status == GATED])
    if kind in RESET_NAMES:
        return _steps(subject, every, kind, display)
    keep = np.isfinite(every.nis)
    inn = every.where(keep)
    t = subject.seconds(inn.t)
    sat = subject.satellite_of(kind)[keep] if kind in BY_SATELLITE else np.zeros(len(inn), dtype=np.int64)
    panels = []
    for i, axis in enumerate(display.axes):
        three = 3.0 * inn.sigma[:, i] / display.factor
        difference = inn.innovation[:, i] / display.factor
        limit, beyond = reach(difference, three)
        items: list[Item] = [*outages(subject), _predicted(t, three), level(subject.span, 0.0, "level")]
        items += _points(t, difference, inn.status, sat)
        items += _not_met(gated, -0.97 * limit)
        title = f"inside ±3 sigma: {100.0 * np.mean(np.abs(difference) <= three):.1f} %"
        if beyond:
            title += f"; {beyond} beyond the axis"
        panels.append(
            Panel(
                TIME, f"{axis} [{display.unit}]", tuple(items), title=title, x_limits=subject.span,
                y_limits=(-limit, limit),
            )
        )  # fmt: skip
    panels.append(_normalised(subject, inn, t))
    caption = (
        f"Measured minus predicted, {display.text}: scatter about zero inside the band is right, a drift or a run of "
        "one sign means that something is not modelled; the last panel is the squared size against its prediction, "
        "about 1 for an honest filter."
    )
    if kind in BY_SATELLITE:
        caption += " The band is the mean one of the satellites of each epoch; the share counts each with its own."
    if len(gated):
        caption += (
            f" {len(gated)} more were not used because their condition was not met (rings at the bottom): not tested, "
            "so without an innovation."
        )
    return Figure(f"innovations_{kind}", f"Innovations: {display.text}", caption, tuple(panels))


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
                own = k & (sat > 0) & (sat // 100 == SYSTEMS.index(letter))
                items.append(markers(t[own], y[own], system_role(letter), SYSTEM_NAMES[letter]))
            k = k & (sat == 0)
        if k.any():
            items.append(markers(t[k], y[k], role, label))
    return items


def _not_met(t: FloatArray, y: float) -> list[Item]:
    if not len(t):
        return []
    k = np.arange(0, len(t), -(-len(t) // _GATED_SHOWN))
    return [Markers(t[k], np.full(len(k), y), "gated", "condition not met")]


def _steps(subject: Subject, inn: Innovations, kind: str, display: Kind) -> Figure:
    inn = inn.where(np.isfinite(inn.innovation[:, 0]))
    t = subject.seconds(inn.t)
    panels = []
    for i, axis in enumerate(display.axes):
        items: tuple[Item, ...] = (
            *outages(subject),
            level(subject.span, 0.0, "level"),
            markers(t, inn.innovation[:, i], "measured", "step"),
        )
        title = f"RMS {np.sqrt(np.mean(inn.innovation[:, i] ** 2)):.3g} {display.unit}"
        panels.append(Panel(TIME, f"{axis} [{display.unit}]", items, title=title, x_limits=subject.span))
    caption = (
        f"By how much each {display.text} moved the solution: the error the INS had gathered since the one before, and "
        "that of the fix. Nothing is weighed here, so there is no test."
    )
    return Figure(f"innovations_{kind}", f"Steps: {display.text}", caption, tuple(panels))


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


_MOST_SATELLITES = 24  # panels; the others have the fewest measurements
_POINTS = 400  # kept of each satellite
_FEWEST_POINTS = 3  # of a satellite that is shown


def _tested(subject: Subject, kind: str) -> tuple[Innovations, IntArray]:
    """Innovations of a kind that were tested, and the satellite of each, 0 if unknown."""
    inn = subject.result.innovations.of(kind)
    keep = np.isfinite(inn.nis)
    return inn.where(keep), subject.satellite_of(kind)[keep]


def by_satellite(subject: Subject, kind: str) -> Figure | None:
    """A panel for each satellite: its innovations with their 3-sigma; None where the satellites are not known."""
    inn, sat = _tested(subject, kind)
    numbers, count = np.unique(sat[sat > 0], return_counts=True)
    identified, count = len(numbers), count[enough := count >= _FEWEST_POINTS]
    numbers = numbers[enough]
    if not len(numbers):
        return None
    display = kind_display(kind)
    kept = np.sort(numbers[np.argsort(-count, kind="stable")[:_MOST_SATELLITES]])
    limit, _ = reach(inn.innovation[:, 0], 3.0 * inn.sigma[:, 0])
    panels = []
    for s in kept.tolist():
        own = inn.where(sat == s)
        t = subject.seconds(own.t)
        three = 3.0 * own.sigma[:, 0]
        items: list[Item] = [
            *outages(subject), band(t, -three, three, "sigma", "±3 sigma predicted", limit=_POINTS),
            level(subject.span, 0.0, "level"), *_satellite_points(t, own, s),
        ]  # fmt: skip
        panels.append(
            Panel(
                TIME, f"{satellite_name(s)} [{display.unit}]", tuple(items), title=_title(own), x_limits=subject.span,
                y_limits=(-limit, limit),
            )
        )  # fmt: skip
    caption = (
        f"The same innovations ({display.text}), each satellite for itself on one scale: one that stays away from zero "
        "while the others do not is reflected, blocked or sick; all of them together point to the clock or the motion."
    )
    left = identified - len(kept)
    if left:
        caption += f" Not shown: {left} satellites with fewer measurements."
    unknown = int(np.sum(sat == 0))
    if unknown:
        caption += (
            f" Of {unknown} of {len(sat)} the satellite is not known: the ranges given here do not fit the run's."
        )
    return Figure(
        f"innovations_{kind}_satellites", f"Innovations by satellite: {display.text}", caption, tuple(panels), columns=3
    )


def satellite_rows(subject: Subject) -> list[tuple[str, ...]]:
    """Rows of a table: satellite, used and rejected ranges, their mean and RMS, NIS of ranges and of range rates."""
    ranges, rates = (_tested(subject, kind) for kind in SATELLITE_KINDS)
    rows = []
    for s in np.unique(np.concatenate((ranges[1], rates[1]))).tolist():
        if s == 0:
            continue
        own, rate = ranges[0].where(ranges[1] == s), rates[0].where(rates[1] == s)
        used, rejected = _counts(own)
        rows.append(
            (
                satellite_name(s), str(used), str(rejected), *_mean_and_rms(own.innovation[:, 0]),
                *(f"{mean_nis(i)[0]:.2f}" if len(i) else "-" for i in (own, rate)),
            )
        )  # fmt: skip
    return rows


def _satellite_points(t: FloatArray, inn: Innovations, sat: int) -> list[Item]:
    items: list[Item] = []
    (letter,) = systems_of(np.array([sat]))
    for status, role, label in (
        (ACCEPTED, system_role(letter), SYSTEM_NAMES[letter]),
        (FORCED, "forced", "accepted after lock-out"),
        (REJECTED, "rejected", "rejected"),
    ):
        k = inn.status == status
        if k.any():
            items.append(markers(t[k], inn.innovation[k, 0], role, label, limit=_POINTS))
    return items


def _title(inn: Innovations) -> str:
    used, rejected = _counts(inn)
    return f"NIS {mean_nis(inn)[0]:.2f}, {used} used, {rejected} rejected"


def _counts(inn: Innovations) -> tuple[int, int]:
    rejected = int(np.sum(inn.status == REJECTED))
    return len(inn) - rejected, rejected


def _mean_and_rms(values: FloatArray) -> tuple[str, str]:
    if not len(values):
        return "-", "-"
    return f"{np.mean(values):+.2f}", f"{np.sqrt(np.mean(values**2)):.2f}"
