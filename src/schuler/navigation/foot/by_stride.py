"""A walk filtered and smoothed stride by stride: with the delay of a stride, as it can be had from a stream."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.engine import FilterOptions, Progress, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.navigation.result import NavigationResult
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory
from schuler.standstill.intervals import Rests

_LONG_REST_S = 20.0  # longer ones are cut every half of that: a stream cannot wait for their end


def by_stride(
    increments: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
    layout: StateLayout,
    psd: tuple[FloatArray, FloatArray],
    options: FilterOptions,
    rests: Rests,
    progress: Progress | None,
) -> tuple[NavigationResult, NavigationResult]:
    """Filter from the middle of one rest to the middle of the next, smooth that piece, go on from the filtered state.

    The solution at any time uses all zero velocities up to the middle of the next rest and no later ones.

    Parameters
    ----------
    increments : Increments
        Of the walk, from its start.
    schedule : MeasurementSchedule
        Zero velocities.
    initial : InitialState
    layout : StateLayout
    psd : (ndarray, ndarray), shapes (3,)
        White noise of gyroscopes and accelerometers. [rad^2/s], [m^2/s^3]
    options : FilterOptions
        With the smoother's memory.
    rests : Rests
    progress : callable, optional

    Returns
    -------
    filtered, smoothed : NavigationResult
        Not complete if it was interrupted.
    """
    cuts = _cuts(rests, increments)
    filtered: list[NavigationResult] = []
    smoothed: list[NavigationResult] = []
    try:
        for first, last in pairwise(cuts.tolist()):
            result = filter_stride(slice_of(increments, first, last), schedule, initial, layout, psd, options)
            smooth = result.smooth()
            filtered.append(result)
            smoothed.append(smooth)
            initial = result.state_at(-1)
            if progress is not None:
                progress(last / len(increments))
    except KeyboardInterrupt:
        if not smoothed:
            raise
        del filtered[len(smoothed) :]
    complete = len(filtered) == len(cuts) - 1
    return _joined(filtered, complete), _joined(smoothed, complete)


def filter_stride(
    part: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
    layout: StateLayout,
    psd: tuple[FloatArray, FloatArray],
    options: FilterOptions,
) -> NavigationResult:
    """Filter one piece of a walk.

    Parameters
    ----------
    part : Increments
    schedule : MeasurementSchedule
        Zero velocities, those before and after the piece, too.
    initial : InitialState
        At the beginning of the piece.
    layout, psd, options
        See :func:`by_stride`.
    """
    due = schedule.where((schedule.t > part.start + 1e-9) & (schedule.t <= part.t[-1] + 1e-9))
    return NavigationResult.from_run(run(part, due, initial, layout, *psd, options), due.t, due.kind, layout)


def slice_of(increments: Increments, first: int, last: int) -> Increments:
    """Intervals from one to before another."""
    rows = slice(first, last)
    return Increments(
        increments.t[rows], increments.dt[rows], increments.dtheta_ib_b[rows], increments.dv_ib_b[rows]
    )  # fmt: skip


def rest_cuts(t: FloatArray, first: int, last: int) -> Iterator[int]:
    """Samples of a rest at which a piece of a walk ends: its middle, and before that every ten seconds of a long one.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    first, last : int
        First and last sample of the rest.
    """
    while (cut := long_rest_cut(t, first, last)) is not None:
        yield cut
        first = cut
    yield (first + last) // 2


def long_rest_cut(t: FloatArray, first: int, last: int) -> int | None:
    """Sample ten seconds into a rest that lasts for twenty at least, whatever follows; None of a shorter one."""
    if t[last] - t[first] <= _LONG_REST_S:
        return None
    return int(np.searchsorted(t, t[first] + 0.5 * _LONG_REST_S - 1e-9))


def _cuts(rests: Rests, increments: Increments) -> IntArray:
    """First interval of each piece, and the number of intervals: pieces end within a rest."""
    samples = [k for first, stop in rests.index.tolist() for k in rest_cuts(rests.t, first, stop - 1)]
    at = np.searchsorted(increments.t, rests.t[samples] - 1e-9) + 1
    inner = at[(at > 1) & (at < len(increments))]
    return np.unique(np.concatenate(([0], inner, [len(increments)])))


def _joined(parts: list[NavigationResult], complete: bool) -> NavigationResult:
    """Pieces of one run as one result."""

    def together(name: str) -> Any:
        return np.concatenate([getattr(p, name) for p in parts])

    def path(name: str) -> FullTrajectory:
        def column(which: str) -> FloatArray:
            return np.concatenate([getattr(getattr(p, name), which) for p in parts])

        return FullTrajectory(column("t"), column("r_eb_e"), column("v_eb_e"), column("q_eb"))

    innovations = [p.innovations for p in parts]
    fields = ("t", "kind", "status", "nis", "innovation", "sigma")
    joined = {f: np.concatenate([getattr(i, f) for i in innovations]) for f in fields}
    return replace(
        parts[0], trajectory=path("trajectory"), states=path("states"), t=together("t"),
        parameters=together("parameters"), covariance_e=together("covariance_e"),
        innovations=replace(innovations[0], **joined), epochs=sum(p.epochs for p in parts),
        propagations=sum(p.propagations for p in parts), complete=complete, _nodes=None,
    )  # fmt: skip
