"""Campaigns: any function of a scenario and a seed, run many times."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

from schuler.arguments import explains_arguments
from schuler.exceptions import InputError
from schuler.montecarlo import workers as local
from schuler.montecarlo.fingerprint import fingerprint, plain
from schuler.montecarlo.functions import RunFunction, traits_of
from schuler.montecarlo.result import Campaign
from schuler.montecarlo.rows import Rows
from schuler.montecarlo.statistics import Accumulator, Statistics
from schuler.montecarlo.store import Span, Store, identity_of, opened
from schuler.montecarlo.workers import Batches, Finished, Work


@explains_arguments
def campaign(
    function: RunFunction,
    scenario: Any,
    runs: int,
    *,
    seed: int = 0,
    store: Path | str | None = None,
    resume: bool = True,
    scheduler: Any = None,
    workers: int | None = None,
    pool: Literal["threads", "processes"] | None = None,
    batch: int | None = None,
    statistics: Statistics | None = None,
    keep: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Campaign:
    """Run a function of a scenario and a seed many times.

    Run k is given ``SeedSequence(seed, spawn_key=(k,))`` and nothing else that could tell it from the others, so it is
    the same wherever and whenever it is done, and so are the statistics, to the last bit.

    Parameters
    ----------
    function : callable
        ``function(scenario, seed)`` returns a dictionary of numbers and arrays, finite, of the same names, types and
        shapes in every run. A function of a module (other processes must find it) or a ``functools.partial`` of one;
        see :func:`~schuler.montecarlo.traits` for one that takes batches or does well in threads. A run that
        raises InputError, ArithmeticError or LinAlgError is a failure, kept with its reason; other errors are raised.
    scenario : object
        Handed to the function as it is. Small: it is sent with every batch to a cluster.
    runs : int
        Runs 0 to ``runs - 1``. A store with fewer is filled up; of one with more the first are used.
    seed : int
        Seed of the campaign.
    store : Path or str, optional
        Folder for the results, written as they finish. What is there already is not done again.
    resume : bool
        False refuses a store that holds runs.
    scheduler : str or distributed.Client, optional
        Dask cluster that does the work: its address, a client, or ``"local"``.
    workers : int, optional
        Threads or processes on this machine; default one a processor.
    pool : {"threads", "processes"}, optional
        Default: as the function says of itself; one worker is this process.
    batch : int, optional
        Runs that are handed out, and stored, together; default as many as take a few seconds, 256 at most.
    statistics : Statistics, optional
        Which are kept; default all but covariances.
    keep : bool
        Keep all runs in memory, for ``.column()`` without a store.
    progress : callable, optional
        Called with the fraction done, first with what is stored already.

    Returns
    -------
    Campaign
        On Ctrl-C what was done up to then, with ``complete`` False.

    Raises
    ------
    InputError
        If an argument is out of range, runs give different columns, all runs fail, or the store is of another campaign.
    SchulerError
        If workers die again and again, or the scheduler of a cluster does.
    MissingExtraError
        Without pyarrow (a store) or Dask (a cluster).

    Examples
    --------
    >>> import numpy as np
    >>> def fall(scenario, seed):
    ...     gravity = 9.81 + scenario["bias"] * np.random.default_rng(seed).standard_normal()
    ...     return {"speed": 10.0 * gravity}
    >>> done = schuler.campaign(fall, {"bias": 0.1}, 256, seed=1, pool="threads")
    >>> print(f"{done['speed'].sigma:.3f}")
    0.962
    """
    _check(runs, seed, workers, pool, batch)
    began = time.perf_counter()
    name = _name(function)
    accumulator = Accumulator(statistics)
    kept: list[Rows] | None = [] if keep else None
    executed, complete = 0, True

    with ExitStack() as stack:
        filled: Store | None = None
        if store is not None:
            about = {"function": name, "scenario": plain(scenario)}
            identity = identity_of(fingerprint(function, "function"), fingerprint(scenario), seed, about)
            filled = stack.enter_context(opened(store, identity, resume=resume))
            for rows in filled.rows(runs):
                accumulator.add(rows)
                if kept is not None:
                    kept.append(rows)
        if progress is not None:
            progress(accumulator.done / runs)
        spans = [Span(0, runs - 1)] if filled is None else filled.missing(runs)
        suited = "threads" if traits_of(function).threads else "processes"
        place = _Place(scheduler, pool or suited, min(workers or os.cpu_count() or 1, runs), workers)
        try:
            for span, rows in _finished((function, scenario, seed), spans, place, batch, stack):
                if filled is not None:
                    filled.put(span, rows)
                accumulator.add(rows)
                if kept is not None:
                    kept.append(rows)
                executed += span.runs
                if progress is not None:
                    progress(accumulator.done / runs)
        except KeyboardInterrupt:
            complete = False
        if complete and not accumulator.shapes:
            raise InputError(f"none of the {runs} runs could be done; run 0: {accumulator.failures.get(0)}")
        # of an interrupted campaign of more runs some later ones may be there, with gaps: those stay parts
        if complete and filled is not None and not filled.missing(filled.stored):
            filled.finish()
    return Campaign(
        name, seed, runs, accumulator.done, executed, accumulator.statistics(),
        dict(sorted(accumulator.failures.items())), complete, time.perf_counter() - began,
        place.text if spans else "nobody: all were stored", None if store is None else Path(store),
        None if kept is None else tuple(kept),
    )  # fmt: skip


def _finished(
    work: Work, spans: Sequence[Span], place: _Place, batch: int | None, stack: ExitStack
) -> Finished:  # fmt: skip
    """Start whoever does the work; batches as they finish."""
    if not spans:
        return local.in_this_process(work, Batches((), 1))
    preferred = traits_of(work[0]).preferred
    if place.scheduler is not None:
        from schuler.montecarlo import cluster

        client = stack.enter_context(cluster.connected(place.scheduler, place.asked))
        finished = cluster.on_cluster(work, Batches(spans, 1, batch, preferred), client)
    else:
        batches = Batches(spans, place.workers, batch, preferred)
        if place.workers == 1:
            finished = local.in_this_process(work, batches)
        elif place.pool == "threads":
            finished = local.in_threads(work, batches)
        else:
            finished = local.in_processes(work, batches)
    stack.callback(finished.close)  # before the cluster is left
    return finished


class _Place(NamedTuple):
    """Who does the work."""

    scheduler: Any
    pool: str
    workers: int
    asked: int | None

    @property
    def text(self) -> str:
        if self.scheduler is not None:
            where = self.scheduler if isinstance(self.scheduler, str) else self.scheduler.scheduler.address
            return f"the Dask cluster {where}"
        return "this process" if self.workers == 1 else f"{self.workers} {self.pool}"


def _name(function: Any) -> str:
    while isinstance(function, partial):
        function = function.func
    return str(getattr(function, "__qualname__", type(function).__qualname__))


def _check(runs: int, seed: int, workers: int | None, pool: str | None, batch: int | None) -> None:
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0), ("workers", workers, 1), ("batch", batch, 1)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
            raise InputError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    if pool not in (None, "threads", "processes"):
        raise InputError(f"pool: expected 'threads' or 'processes', got {pool!r}")
