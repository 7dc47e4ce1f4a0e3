"""Many units at once: free-pose calibration of a list of logs, and a table of what came out."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.calibration.freepose.calibrate import calibrate_freepose, check_options
from schuler.calibration.result.result import CalibrationResult, Status
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.series import ImuSeries

#: Work that is worth one more process, which takes a second to start. [s]
WORTH_S = 10.0
#: A calibration, or why there is none.
Outcome: TypeAlias = CalibrationResult | str
_TIMED = 8  # logs that say how long one takes
_CHUNK = 4  # logs that are sent together: sending costs a hundredth of calibrating


@dataclass(frozen=True, eq=False, repr=False)
class FleetTable(Displayed):
    """Calibrations of many units, one a row.

    Attributes
    ----------
    label : tuple of str
        Of the units.
    names : tuple of str
        Parameters, see :mod:`schuler.calibration.result.parameters`.
    values, sigma : ndarray, shape (n, p)
        SI, of inputs multiplied with ``nominal``; infinite sigma: not determined.
    nominal : ndarray, shape (n, 2)
        Factors of accelerometers and gyroscopes, see :class:`~schuler.calibration.result.result.CalibrationResult`.
    status : tuple of str
        ``ok``, ``warning`` or ``refused``; ``error`` for a log that is no input at all.
    verdict : tuple of str
        Verdicts of each unit, one string; the message for ``error``.
    variance_of_unit_weight : ndarray, shape (n,)
    results : tuple of CalibrationResult or None
    """

    label: tuple[str, ...]
    names: tuple[str, ...]
    values: FloatArray
    sigma: FloatArray
    nominal: FloatArray
    status: tuple[str, ...]
    verdict: tuple[str, ...]
    variance_of_unit_weight: FloatArray
    results: tuple[CalibrationResult | None, ...]

    def __len__(self) -> int:
        return len(self.label)

    def column(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Values and 1-sigma uncertainties of one parameter over the fleet, shape (n,) each; SI.

        Raises
        ------
        InputError
            If it was not estimated.
        """
        if name not in self.names:
            raise InputError(f"name: expected one of {', '.join(self.names)}, got {name!r}")
        j = self.names.index(name)
        return self.values[:, j], self.sigma[:, j]

    def count(self, status: Status | str) -> int:
        """How many units ended with a status."""
        return self.status.count(status)

    def spread(self) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation over the units that were determined, by parameter; NaN with fewer than two."""
        out = {}
        for j, name in enumerate(self.names):
            good = np.isfinite(self.sigma[:, j])
            x = self.values[good, j]
            enough = len(x) > 1
            out[name] = (float(x.mean()), float(x.std(ddof=1))) if enough else (float("nan"), float("nan"))
        return out

    def summary(self) -> str:
        """A few lines: how many of each status, and the units that need attention (ten at most)."""
        lines = [
            f"{len(self)} units: "
            + ", ".join(f"{self.count(s)} {s}" for s in ("ok", "warning", "refused", "error") if self.count(s))
        ]
        bad = [k for k in range(len(self)) if self.status[k] != "ok"]
        lines += [f"{self.label[k]}: {self.status[k]}. {self.verdict[k]}" for k in bad[:10]]
        if len(bad) > 10:
            lines.append(f"and {len(bad) - 10} more")
        return "\n".join(lines)


@explains_arguments
def calibrate_fleet(
    logs: Sequence[ImuSeries],
    *,
    workers: int | None = None,
    labels: Sequence[str] | None = None,
    halves: bool = False,
    **options: Any,
) -> FleetTable:
    """Calibrate many units with :func:`~schuler.calibration.freepose.calibrate.calibrate_freepose`.

    Parameters
    ----------
    logs : sequence of ImuSeries
        One of each unit.
    workers : int, optional
        How many run at once, this process among them; None: one for each processor, fewer where the work is done
        before they have started. The result does not depend on it.
    labels : sequence of str, optional
        Serial numbers; default ``unit 1`` ...
    halves : bool
        Hold the claims of each unit against halves of its log, as a single calibration does by default; it takes more
        than twice the time. Without it sigmas are as claimed, and ``extra["halves"]`` of each result says so.
    **options
        As for ``calibrate_freepose``, the same for all.

    Returns
    -------
    FleetTable
        In the order of the logs. A log that is refused or cannot be used is a row with infinite sigma and its
        reason; it does not stop the others.

    Raises
    ------
    InputError
        If there is no log, labels do not fit, an option makes no sense or ``workers`` is less than one.

    Notes
    -----
    A calibration is Python for the most part, so threads do not share it. Without ``workers`` the first eight logs are
    timed in this process, which is joined by another one for every ten seconds of work that are left. Those start
    afresh ("spawn"), which takes each a second while this one goes on; as always with such processes, a script that
    calls this needs ``if __name__ == "__main__":``. Each log is worked on by itself, hence the same numbers with any
    number of workers; logs of a process that dies are done in this one.
    """
    if len(logs) == 0:
        raise InputError("logs: expected one log or more, got none")
    if labels is not None and len(labels) != len(logs):
        raise InputError(f"labels: expected {len(logs)}, one for each log, got {len(labels)}")
    if workers is not None and workers < 1:
        raise InputError(f"workers: expected one or more, got {workers}")
    check_options(**options)
    from schuler.calibration.freepose import _kernels as kernels

    kernels.prepare_freepose()

    one = partial(_one, options=options | {"halves": halves})
    n, results = min(workers or 1, len(logs)), []
    if workers is None:
        took = []
        for log in logs[:_TIMED]:
            began = time.perf_counter()
            results.append(one(log))
            took.append(time.perf_counter() - began)
        left_s = float(np.median(took)) * (len(logs) - len(results))
        n = min(os.cpu_count() or 1, 1 + int(left_s / WORTH_S))
    left = logs[len(results) :]
    if n == 1:
        results += [one(log) for log in left]
    else:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        with ProcessPoolExecutor(n - 1, get_context("spawn")) as pool:
            results += _shared(one, left, pool, n - 1)
    return _table(results, tuple(labels) if labels is not None else tuple(f"unit {k + 1}" for k in range(len(logs))))


def _shared(
    one: Callable[[ImuSeries], Outcome], logs: Sequence[ImuSeries], pool: Executor, others: int
) -> list[Outcome]:
    """Results in the order of the logs: from the front in this process, from the back in the others of a pool."""
    size = max(1, min(_CHUNK, len(logs) // (4 * (others + 1))))
    chunks = deque(range(k, min(k + size, len(logs))) for k in range(0, len(logs), size))
    results: dict[int, Outcome] = {}
    given: dict[Future[list[Outcome]], range] = {}
    while chunks or given:
        try:
            # two ahead, so that none waits for this process; the last one is for this process
            while len(chunks) > 1 and len(given) < 2 * others:
                given[pool.submit(_several, one, [logs[k] for k in chunks[-1]])] = chunks[-1]
                chunks.pop()
            if chunks:
                results |= {k: one(logs[k]) for k in chunks.popleft()}
                finished = {f for f in given if f.done()}
            else:
                finished, _ = wait(given, return_when=FIRST_COMPLETED)
            for future in finished:
                results |= zip(given[future], future.result(), strict=True)
                del given[future]
        except BrokenProcessPool:
            chunks.extend(given.values())
            given, others = {}, 0
    return [results[k] for k in range(len(logs))]


def _several(one: Callable[[ImuSeries], Outcome], logs: Sequence[ImuSeries]) -> list[Outcome]:
    return [one(log) for log in logs]


def _one(log: ImuSeries, options: dict[str, Any]) -> Outcome:
    try:
        result = calibrate_freepose(log, **options)
    except InputError as error:
        return str(error)
    if options["halves"] or result.status == "refused":
        return result
    note = {"splits": {}, "widened": {}, "note": "not compared: fleets leave it out unless halves=True"}
    return replace(result, extra=result.extra | {"halves": note})


def _table(results: list[Outcome], label: tuple[str, ...]) -> FleetTable:
    names = next((r.names for r in results if not isinstance(r, str)), ())
    n = len(results)
    values, sigma = np.zeros((n, len(names))), np.full((n, len(names)), np.inf)
    nominal, unit = np.ones((n, 2)), np.full(n, np.nan)
    for k, r in enumerate(results):
        if not isinstance(r, str):
            values[k], sigma[k], nominal[k], unit[k] = r.values, r.sigma, r.nominal, r.variance_of_unit_weight
    return FleetTable(
        label, names, values, sigma, nominal, tuple("error" if isinstance(r, str) else r.status for r in results),
        tuple(r if isinstance(r, str) else " ".join(r.verdicts) for r in results), unit,
        tuple(None if isinstance(r, str) else r for r in results),
    )  # fmt: skip
