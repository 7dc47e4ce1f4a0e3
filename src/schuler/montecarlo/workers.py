"""Batches of runs on the processors of this machine: in this process, in threads, or in processes."""

from __future__ import annotations

import os
import pickle
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeAlias

from schuler.exceptions import InputError, SchulerError
from schuler.montecarlo.functions import RunFunction, execute, traits_of
from schuler.montecarlo.rows import Rows, joined
from schuler.montecarlo.store import Span

_LARGEST = 256  # runs of a batch, if nothing else is said
_BATCH_S = 4.0  # what a batch should take: all that an interruption costs each worker


class Batches:
    """Runs that are to be done, cut into batches as they are asked for.

    Parameters
    ----------
    spans : sequence of Span
        Runs to do, ascending.
    workers : int
        The last batches are made small enough for all of them to have work.
    size : int, optional
        Runs of a batch. Default: one at first, then as many as take some seconds.
    preferred : int
        Without ``size``: number of runs that a function does best together.
    """

    def __init__(self, spans: Sequence[Span], workers: int, size: int | None = None, preferred: int = 1) -> None:
        self._spans = list(spans)
        self._fixed, self._preferred, self.workers = size, max(preferred, 1), max(workers, 1)
        self._size = self._preferred
        self._left = sum(s.runs for s in self._spans)

    def take(self) -> Span | None:
        """The next batch; None if there is nothing left to hand out."""
        if not self._spans:
            return None
        span = self._spans[0]
        size = self._fixed
        if size is None:
            share = self._left // (2 * self.workers)
            size = max(min(self._size, share - share % self._preferred), self._preferred)
        taken = Span(span.first, min(span.first + size - 1, span.last))
        self._left -= taken.runs
        if taken.last == span.last:
            self._spans.pop(0)
        else:
            self._spans[0] = Span(taken.last + 1, span.last)
        return taken

    def give_back(self, spans: Sequence[Span]) -> None:
        """Batches that were taken and not done."""
        self._spans = sorted([*self._spans, *spans])
        self._left += sum(s.runs for s in spans)

    def took(self, span: Span, seconds: float) -> None:
        """Say how long a batch took, so that the next ones are of good length."""
        fitting = int(span.runs * _BATCH_S / max(seconds, 1e-6))
        rounded = fitting - fitting % self._preferred if fitting > self._preferred else max(fitting, 1)
        # not more than four times as large: the first run of a process takes longer than those that follow
        self._size = min(rounded, 4 * max(span.runs, self._preferred), max(_LARGEST, self._preferred))


#: What is done, as the arguments of :func:`execute` before the numbers of the runs.
Work: TypeAlias = tuple[RunFunction, Any, int]
Finished: TypeAlias = Generator[tuple[Span, Rows], None, None]
#: Rows of a batch and how long it took. [s]
Timed: TypeAlias = tuple[Rows, float]

_AHEAD = 2  # batches handed out for each worker, so that none waits for the collector
_LOSSES = 3  # times that processes may die without finishing anything in between
# what linear algebra reads its number of threads from when it is loaded
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def timed(work: Work, span: Span) -> Timed:
    """Do a batch."""
    began = time.perf_counter()
    rows = execute(*work, *span)
    return rows, time.perf_counter() - began


def in_this_process(work: Work, batches: Batches) -> Finished:
    """One batch after the other."""
    while (span := batches.take()) is not None:
        rows, seconds = timed(work, span)
        batches.took(span, seconds)
        yield span, rows


def in_threads(work: Work, batches: Batches) -> Finished:
    """Batches as they finish, in threads of this process. Whoever stops listening waits for the runs under way."""
    stop = threading.Event()
    batched = traits_of(work[0]).batched

    def do(span: Span) -> Timed:
        if batched:
            return timed(work, span)
        began = time.perf_counter()
        done = []
        for k in range(span.first, span.last + 1):
            if stop.is_set():
                break  # nobody listens any more
            done.append(execute(*work, k, k))
        return joined(done), time.perf_counter() - began

    with ThreadPoolExecutor(batches.workers) as pool:
        try:
            yield from _as_they_finish(lambda span: pool.submit(do, span), batches, {})
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def in_processes(work: Work, batches: Batches) -> Finished:
    """Batches as they finish, in processes that start afresh; a process that dies is replaced, its batches repeated.

    Raises
    ------
    InputError
        If the function or the scenario cannot be sent to another process.
    SchulerError
        If processes die again and again.
    """
    try:
        packed = pickle.dumps(work)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"the function and the scenario must be such that they can be sent to another process: {error}. Define the "
            'function in a module, or use workers=1 or pool="threads"'
        ) from None
    losses = 0
    while True:
        given: dict[Future[Timed], Span] = {}
        try:
            for span, rows in _pool(packed, batches, given):
                losses = 0
                yield span, rows
        except BrokenProcessPool:
            losses += 1
            if losses >= _LOSSES:
                raise SchulerError(
                    f"processes ended {losses} times over the runs from {min(given.values()).first} on without an "
                    "error of their own: out of memory? Use fewer workers or a smaller batch"
                ) from None
            batches.give_back(list(given.values()))
            continue
        return


def _pool(packed: bytes, batches: Batches, given: dict[Future[Timed], Span]) -> Finished:
    from multiprocessing import get_context

    pool = ProcessPoolExecutor(batches.workers, get_context("spawn"), initializer=_begin, initargs=(packed,))
    done = False
    try:
        with _one_thread_each():
            yield from _as_they_finish(lambda span: pool.submit(_do, span), batches, given)
        done = True
    finally:
        if not done:  # nobody will take what they are at
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


def _as_they_finish(
    submit: Callable[[Span], Future[Timed]], batches: Batches, given: dict[Future[Timed], Span]
) -> Finished:
    """Hand out a few batches ahead and yield them as they finish; ``given`` holds those that are not finished."""
    while True:
        while len(given) < _AHEAD * batches.workers and (span := batches.take()) is not None:
            try:
                given[submit(span)] = span
            except BrokenProcessPool:
                batches.give_back([span])
                raise
        if not given:
            return
        finished, _ = wait(given, return_when=FIRST_COMPLETED)
        for future in sorted(finished, key=lambda f: given[f].first):
            rows, seconds = future.result()
            span = given.pop(future)
            batches.took(span, seconds)
            yield span, rows


_work: Work | None = None


def _begin(packed: bytes) -> None:
    """Start a worker process: ignore Ctrl-C, which all of a terminal get, and end with the process that collects."""
    import signal
    from multiprocessing import parent_process

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    global _work
    _work = pickle.loads(packed)  # noqa: S301 - from the process that started this one
    parent = parent_process()

    def follow() -> None:
        assert parent is not None
        parent.join()
        os._exit(1)  # killed: nobody would ever ask for the results

    if parent is not None:
        threading.Thread(target=follow, daemon=True).start()


def _do(span: Span) -> Timed:
    assert _work is not None
    return timed(_work, span)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started meanwhile multiply matrices in one thread: they share the processors as it is."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
