"""Test vector of an exported filter: inputs of a run, and what the filter here makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from schuler.exceptions import InputError
from schuler.export.design import FilterDesign
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    KINDS,
    LATERAL,
    POSITION,
    SPEED,
    STATUS,
    VELOCITY,
    VERTICAL,
    ZERO_VELOCITY,
    MeasurementSchedule,
)
from schuler.navigation.navigator import Navigator, Outcome
from schuler.recording.series import Increments

_KIND = {name: code for code, name in KINDS.items()}
_STATUS = {name: code for code, name in STATUS.items()}


def most_at_once(increments: Increments, schedule: MeasurementSchedule) -> int:
    """Largest number of measurements that fall between two samples."""
    if not len(schedule):
        return 0
    sample = np.searchsorted(increments.t, schedule.t - 1e-9)
    return int(np.bincount(sample).max())


def replay_lines(
    design: FilterDesign,
    increments: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
    every_s: float = 1.0,
) -> Iterator[str]:
    """Lines of ``vector.csv``: start, inputs in the order of calls, outcomes, expected states.

    The numbers expected are those of :class:`~schuler.navigation.navigator.Navigator`.

    Parameters
    ----------
    design : FilterDesign
    increments : Increments
        From the start on.
    schedule : MeasurementSchedule
        Sorted by time; those outside the samples are left out.
    initial : InitialState
    every_s : float
        Spacing of the expected states; one more follows the last sample. [s]
    """
    options = design.options
    if options.gap_s is None:  # samples are taken as they are: the exported filter fills nothing in
        options = replace(options, gap_s=np.inf)
    outcomes: list[Outcome] = []
    psd = design.state.model.psd
    live = Navigator(
        initial, design.layout, psd[:3], psd[3:], interval_s=design.interval_s, options=options,
        max_gap_s=design.max_gap_s, keep=1, on_outcome=outcomes.append,
    )  # fmt: skip
    n = design.layout.size
    nav, packed = initial.nav, initial.P[np.tril_indices(n)]
    yield _line("initial", [nav.t, *nav.r_eb_e, *nav.v_eb_e, *nav.q_eb, *initial.parameters, *packed])
    schedule = schedule.where(schedule.t > nav.t)
    j, due, last = 0, nav.t + every_s, len(increments) - 1
    for k in range(len(increments)):
        t = float(increments.t[k])
        first = j
        while j < len(schedule) and schedule.t[j] <= t + 1e-9:
            j += 1
        if j > first:
            part = schedule.where(np.arange(first, j))
            live.aid(part)
            yield from _measurement_lines(part)
        live.imu(t, increments.dtheta_ib_b[k], increments.dv_ib_b[k])
        yield _line("imu", [t, *increments.dtheta_ib_b[k], *increments.dv_ib_b[k]])
        for o in outcomes:
            nis = float(np.nan_to_num(o.nis))
            yield _line("outcome", [o.t], (str(_KIND[o.kind]), str(_STATUS[o.status]), repr(nis)))
        outcomes.clear()
        if t >= due - 1e-9 or k == last:
            due += every_s
            state, sigma = live.state, np.sqrt(np.diag(live.covariance))
            yield _line("expected", [t, *state.r_eb_e, *state.v_eb_e, *state.q_eb, *live.parameters, *sigma])


def _measurement_lines(part: MeasurementSchedule) -> Iterator[str]:
    """The calls that announce some measurements."""
    for i in range(len(part)):
        t, kind, R = part.t[i], int(part.kind[i]), part.R[i]
        if kind in (POSITION, VELOCITY):
            yield _line("position" if kind == POSITION else "velocity", [t, *part.z[i, :3], *R.ravel()])
        elif kind == ZERO_VELOCITY:
            yield _line("zupt", [t, np.sqrt(R[0, 0])])
        elif kind == SPEED:
            yield _line("odometer", [t, part.z[i, 0], np.sqrt(R[0, 0])])
        elif kind == LATERAL:  # its vertical twin follows at the same time
            yield _line("non_holonomic", [t], tuple(str(int(part.gate[i + a] >= 0.0)) for a in (0, 1)))
        elif kind != VERTICAL:
            raise InputError(f"the exported filter knows no {KINDS[kind]}: leave it out of the run")


def _line(tag: str, numbers: Iterable[float], texts: tuple[str, ...] = ()) -> str:
    return ",".join((tag, *(repr(float(x)) for x in numbers), *texts)) + "\n"
