"""Carrier phases of a tightly coupled run: arcs, slips, what the filter rejected, integers held; protection levels."""

from __future__ import annotations

import numpy as np

from schuler import rotation
from schuler.arrays import BoolArray, FloatArray
from schuler.filtering.measurements import ACCEPTED, CARRIER_PHASE, FORCED, KINDS, POSITION, REJECTED
from schuler.gnss.carrier import LONGEST_PAUSE_S
from schuler.gnss.protection_errors import Direction, stanford
from schuler.gnss.ranges import Ranges
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite_name
from schuler.navigation.evaluation.consistency import SAME_TIME, nearest
from schuler.navigation.report.innovations import system_role, systems_of
from schuler.navigation.report.satellites import spread_out, stretches, usual_step
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import outages
from schuler.plotting.figure import TIME, Figure, Item, Line, Markers, Panel, line

ALERT_LIMIT_M = 40.0  # of the diagrams [m]


def carriers(subject: Subject) -> Figure | None:
    """A row for each satellite: its carrier phases, where arcs end, phases rejected; numbers and integers below.

    None where the run used no carriers.
    """
    ranges, tested = subject.ranges, subject.result.innovations.of(KINDS[CARRIER_PHASE])
    if ranges is None or not len(tested):
        return None
    phased = ranges.used & np.isfinite(ranges.carrier_range)
    numbers = np.unique(ranges.sat[phased])[::-1]
    row = {int(s): k for k, s in enumerate(numbers)}
    t, step = subject.seconds(ranges.t), usual_step(ranges.t)
    shade = outages(subject)
    items: list[Item] = [*shade]
    for letter in systems_of(numbers):
        own = [s for s in numbers.tolist() if s // 100 == SYSTEMS.index(letter)]
        parts = [stretches(t, phased & (ranges.sat == s), float(row[s]), step) for s in own]
        x, y = (np.concatenate([p[i] for p in parts]) for i in range(2))
        items.append(Line(x, y, system_role(letter), f"{SYSTEM_NAMES[letter]}, carrier in use"))
    ended = ended_arcs(ranges)
    sat = subject.satellite_of(KINDS[CARRIER_PHASE])
    rejected = (tested.status == REJECTED) & np.isin(sat, numbers)
    for x, s, role, label in (
        (t[ended], ranges.sat[ended], "rejected", "arc ended: slip, or lock lost"),
        (subject.seconds(tested.t[rejected]), sat[rejected], "filter_range", "phase rejected by the filter"),
    ):
        y = np.array([row[int(k)] for k in s], dtype=np.float64)
        k = spread_out(x, y, np.arange(len(x)), subject.span)
        if len(k):
            items.append(Markers(x[k], y[k], role, label))
    epochs = np.unique(ranges.t[phased])
    count = np.bincount(np.searchsorted(epochs, ranges.t[phased]), minlength=len(epochs)).astype(np.float64)
    below: list[Item] = [*shade, line(subject.seconds(epochs), count, "mean", "carriers in use")]
    held = held_epochs(subject, epochs)
    if held.any():
        below.append(Markers(subject.seconds(epochs[held]), count[held], "filtered", "integers held"))
    used = int(np.sum(np.isin(tested.status, (ACCEPTED, FORCED))))
    caption = (
        f"Carrier phases of each satellite: a line while they are used, marks where an ambiguity began anew "
        f"({int(ended.sum())} times, of {int(phased.sum())} phases) and where the filter rejected a phase "
        f"({int(np.sum(tested.status == REJECTED))}, {used} used)."
    )
    if held.any():
        caption += f" Integers are held at {int(held.sum())} of {len(epochs)} epochs ({100.0 * held.mean():.0f} %)."
    panels = (
        Panel(
            TIME, "satellite", tuple(items), x_limits=subject.span, y_limits=(-0.8, len(numbers) - 0.2), grid=False,
            y_ticks=tuple((float(k), satellite_name(int(s))) for k, s in enumerate(numbers)),
            height=float(np.clip(0.11 * len(numbers), 1.0, 4.0)),
        ),
        Panel(TIME, "carriers [-]", tuple(below), x_limits=subject.span, y_limits=(0.0, float(count.max()) + 1.0)),
    )  # fmt: skip
    return Figure("carriers", "Carrier phases and slips", caption, panels)


def ended_arcs(ranges: Ranges) -> BoolArray:
    """Rows at which a carrier phase goes on, within ten seconds, with another ambiguity than before. Shape (n,)."""
    rows = np.flatnonzero(ranges.used & np.isfinite(ranges.carrier_range))
    rows = rows[np.lexsort((ranges.t[rows], ranges.sat[rows]))]
    a, b = rows[:-1], rows[1:]
    ended = np.zeros(len(ranges), dtype=np.bool_)
    ended[b] = (
        (ranges.sat[a] == ranges.sat[b])
        & (ranges.arc[a] != ranges.arc[b])
        & (ranges.t[b] - ranges.t[a] <= LONGEST_PAUSE_S)
    )
    return ended


def held_epochs(subject: Subject, epochs: FloatArray) -> BoolArray:
    """Epochs at which carriers with integers gave a position that the filter used. Shape (k,)."""
    fixes = subject.result.innovations.of(KINDS[POSITION])
    fixes = fixes.where(np.isin(fixes.status, (ACCEPTED, FORCED)))
    if not len(fixes) or not len(epochs):
        return np.zeros(len(epochs), dtype=np.bool_)
    return np.asarray(nearest(epochs, fixes.t)[1] < SAME_TIME)


def protection(subject: Subject) -> list[Figure]:
    """Stanford diagrams of the run's single points, horizontal and vertical; none without levels or a reference."""
    points, reference = subject.points, subject.reference
    if points is None or reference is None or subject.reference_is_fixes:
        return []
    inside = (points.t >= reference.t[0]) & (points.t <= reference.t[-1])
    if not (inside & points.ok & np.isfinite(points.hpl)).any():
        return []
    true, at = np.full((len(points), 3), np.nan), reference.at(points.t[inside])
    true[inside] = at.r_eb_e
    if not subject.at_antenna and at.q_eb is not None:
        arm = np.broadcast_to(subject.result.lever_arm_b, at.r_eb_e.shape)
        true[inside] += rotation.rotate(at.q_eb, arm)
    directions: tuple[Direction, ...] = ("horizontal", "vertical")
    return [stanford(points, true, alert_limit=ALERT_LIMIT_M, direction=d).figure() for d in directions]
