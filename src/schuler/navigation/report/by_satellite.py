"""Innovations of pseudoranges and range rates, satellite by satellite."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.kinds import shown
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED
from schuler.gnss.signals import satellite_name
from schuler.navigation.report.residuals import OF_SATELLITES, mean_nis, reach
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.systems import system_label, system_role, systems_of
from schuler.navigation.report.track import outages
from schuler.navigation.result import Innovations
from schuler.plotting.figure import TIME, Figure, Item, Panel, band, level, markers

MOST = 24  # panels; the others have the fewest measurements
_POINTS = 400  # kept of each satellite


def tested(subject: Subject, kind: str) -> tuple[Innovations, IntArray]:
    """Innovations of a kind that were tested, and the satellite of each, 0 where it is not known."""
    inn = subject.result.innovations.of(kind)
    keep = np.isfinite(inn.nis)
    return inn.where(keep), subject.satellite_of(kind)[keep]


def innovations(subject: Subject, kind: str) -> Figure | None:
    """A panel for each satellite: its innovations with their 3-sigma; None where the satellites are not known."""
    inn, sat = tested(subject, kind)
    numbers, count = np.unique(sat[sat > 0], return_counts=True)
    if not len(numbers):
        return None
    what = shown(kind)
    kept = np.sort(numbers[np.argsort(-count, kind="stable")[:MOST]])
    limit, _ = reach(inn.innovation[:, 0], 3.0 * inn.sigma[:, 0])
    panels = []
    for s in kept.tolist():
        own = inn.where(sat == s)
        t = subject.seconds(own.t)
        three = 3.0 * own.sigma[:, 0]
        items: list[Item] = [
            *outages(subject), band(t, -three, three, "sigma", "±3 sigma predicted", limit=_POINTS),
            level(subject.span, 0.0, "level"), *_points(t, own, s),
        ]  # fmt: skip
        panels.append(
            Panel(
                TIME, f"{satellite_name(s)} [{what.unit}]", tuple(items), title=_title(own), x_limits=subject.span,
                y_limits=(-limit, limit),
            )
        )  # fmt: skip
    caption = (
        f"The same innovations ({what.text}), each satellite for itself on one scale: one that stays away from zero "
        "while the others do not is reflected, blocked or sick; all of them together point to the clock or the motion."
    )
    left = len(numbers) - len(kept)
    if left:
        caption += f" Not shown: {left} satellites with fewer measurements."
    unknown = int(np.sum(sat == 0))
    if unknown:
        caption += (
            f" Of {unknown} of {len(sat)} the satellite is not known: the ranges given here do not fit the run's."
        )
    return Figure(
        f"innovations_{kind}_satellites", f"Innovations by satellite: {what.text}", caption, tuple(panels), columns=3
    )


def satellite_rows(subject: Subject) -> list[tuple[str, ...]]:
    """Rows of a table: satellite, used and rejected ranges, their mean and RMS, NIS of ranges and of range rates."""
    ranges, rates = (tested(subject, kind) for kind in OF_SATELLITES)
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


def _points(t: FloatArray, inn: Innovations, sat: int) -> list[Item]:
    items: list[Item] = []
    (letter,) = systems_of(np.array([sat]))
    for status, role, label in (
        (ACCEPTED, system_role(letter), system_label(letter)),
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
