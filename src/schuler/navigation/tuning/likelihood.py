"""Likelihood of noise from the innovations of fixes, predicted over one, a few and many seconds."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.filtering.measurements import DIMENSIONS, MeasurementSchedule
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.noise import TUNING_KINDS

#: Times between the fixes that the filter is given [s], and how many interleaved sets of each are run.
HORIZONS = ((1.0, 1), (4.0, 2), (15.0, 4))
_WARM = 20.0, 0.15  # what the start has spoiled is not judged: seconds, and largest share of the log
_COVARIANCE_HZ = 2.0  # enough for likelihoods: between 10 and 2 Hz they differ by less than 1 of several hundred
_CAP = 4.0  # innovations beyond so many sigmas weigh no more than these
#: Expectation of the capped square of a standard normal number.
_CAPPED = (
    math.erf(_CAP / math.sqrt(2.0))
    - _CAP * math.sqrt(2.0 / math.pi) * math.exp(-0.5 * _CAP**2)
    + _CAP**2 * math.erfc(_CAP / math.sqrt(2.0))
)
#: A gate that nothing passes: predicted and compared, not used.
NEVER = 1e-300


@dataclass(frozen=True)
class Trial:
    """One run over the log: which fixes it is given and which judge it.

    Attributes
    ----------
    horizon : float
        Time between fixes after the start. [s]
    weight : float
        Of each judging fix.
    use : ndarray of int
        Rows of the prepared schedule.
    held : ndarray of bool
        Which of them are predicted only.
    judge : ndarray of bool
        Which of them judge.
    """

    horizon: float
    weight: float
    use: IntArray
    held: BoolArray
    judge: BoolArray


@dataclass(frozen=True)
class Residuals:
    """Innovations of the judging fixes, component by component, of all trials one after another.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    kind : ndarray of int, shape (k,)
    horizon : ndarray, shape (k,)
        [s]
    innovation, variance : ndarray, shape (k, 3)
        Zero and one where a component is not judged.
    weight : ndarray, shape (k, 3)
    """

    t: FloatArray
    kind: IntArray
    horizon: FloatArray
    innovation: FloatArray
    variance: FloatArray
    weight: FloatArray

    @property
    def normalised(self) -> FloatArray:
        """Innovations in units of their sigma. Shape (k, 3)."""
        z: FloatArray = self.innovation / np.sqrt(self.variance)
        return z

    def scores(self) -> FloatArray:
        """Negative log likelihood of each judging fix, outliers capped. Shape (k,).

        Notes
        -----
        The components' marginal densities are multiplied, as is the case for all horizons: a composite likelihood,
        whose maximum is consistent and whose curvature is not its information (:func:`.search.fit` takes the scatter of
        its gradient). Squares grow as a logarithm beyond four sigmas; their expectation is divided out, so that normal
        innovations have unit variance at the optimum (Huber (1981), section 8.4, of scale).
        """
        z2 = np.maximum(self.normalised**2, 1e-300)
        capped = np.where(z2 < _CAP**2, 0.5 * z2, 0.5 * _CAP**2 * (1.0 + np.log(z2 / _CAP**2))) / _CAPPED
        total: FloatArray = np.sum(self.weight * (capped + 0.5 * np.log(self.variance)), axis=1)
        return total

    def influence(self) -> FloatArray:
        """Share with which each squared normalised innovation counts: 1 in the middle, less beyond the cap."""
        z2 = np.maximum(self.normalised**2, 1e-300)
        share: FloatArray = np.minimum(1.0, _CAP**2 / z2) / _CAPPED
        return share

    def nis(self) -> dict[int, float]:
        """Mean normalised innovation squared by kind, per degree of freedom, all horizons alike."""
        z2, counted = self.normalised**2, self.weight > 0.0
        return {
            int(k): float(z2[self.kind == k][counted[self.kind == k]].mean())
            for k in np.unique(self.kind)
            if counted[self.kind == k].any()
        }


def epochs(schedule: MeasurementSchedule) -> tuple[IntArray, IntArray]:
    """Number of the epoch of each tuning measurement within its kind, -1 for others; and how many epochs there are.

    Positions and velocities are counted apart: velocities may be valid earlier than the positions they came with.
    """
    number = np.full(len(schedule), -1)
    count = np.zeros(max(DIMENSIONS) + 1, dtype=np.int64)
    for kind in TUNING_KINDS:
        rows = np.flatnonzero(schedule.kind == kind)
        if len(rows):
            number[rows] = np.unique(schedule.t[rows], return_inverse=True)[1]
            count[kind] = number[rows].max() + 1
    return number, count


def trials(
    prepared: PreparedRun, given: BoolArray, judging: BoolArray | None = None, phases: int | None = None
) -> tuple[Trial, ...]:
    """Runs that judge noise: of each horizon, fixes thinned to it.

    Parameters
    ----------
    prepared : PreparedRun
    given : ndarray of bool, shape (m,)
        Fixes that the filter may be given.
    judging : ndarray of bool, shape (m,), optional
        Fixes that are predicted only and judge; default: those given, before they are used.
    phases : int, optional
        At most so many interleaved sets of a horizon.
    """
    schedule, start = prepared.schedule, prepared.initial.nav.t
    number, _ = epochs(schedule)
    fix = number >= 0
    warm = start + min(_WARM[0], _WARM[1] * (prepared.increments.t[-1] - start))
    spacing = spacing_of(schedule, given)
    runs: list[Trial] = []
    for i, (horizon, sets) in enumerate(HORIZONS):
        if i and horizon < 1.5 * spacing:
            continue
        sets = sets if phases is None else min(sets, phases)
        for phase in range(sets):
            chosen = given & ((schedule.t <= warm) | thinned(schedule, given, warm, horizon, phase / sets, spacing))
            held = np.zeros(len(schedule), dtype=bool)
            if judging is not None:
                held = judging & (schedule.t > warm) & thinned(schedule, judging, warm, 1.0, 0.0, spacing)
            use = np.flatnonzero(~fix | chosen | held)
            judge = (held if judging is not None else chosen & (schedule.t > warm))[use]
            runs.append(Trial(horizon, 1.0 / sets, use, held[use], judge))
    # a horizon weighs as the root of its fixes: neither as one each, nor as if it alone were asked for
    counts = [int(np.sum(trial.judge)) for trial in runs]
    fewest = min((n for trial, n in zip(runs, counts, strict=True) if trial.horizon <= 4.0), default=0)
    return tuple(
        replace(trial, weight=trial.weight * fewest / n * max(n / fewest, 1.0) ** 0.5)
        for trial, n in zip(runs, counts, strict=True)
        if n
    )


def spacing_of(schedule: MeasurementSchedule, given: BoolArray) -> float:
    """Median time between the epochs of fixes. [s]"""
    t = np.unique(schedule.t[given])
    return float(np.median(np.diff(t))) if len(t) > 1 else np.inf


def thinned(
    schedule: MeasurementSchedule, given: BoolArray, start: float, span: float, phase: float, spacing: float
) -> BoolArray:
    """The first epoch of each kind in every cell of ``span`` seconds; all if they are no closer."""
    if span <= 1.01 * spacing:
        return given.copy()
    cell = np.floor((schedule.t - start) / span + phase + 1e-6).astype(np.int64)
    keep = np.zeros(len(schedule), dtype=bool)
    for kind in TUNING_KINDS:
        rows = np.flatnonzero(given & (schedule.kind == kind))
        if len(rows):
            first = np.append(True, np.diff(cell[rows]) > 0)
            times = schedule.t[rows][first][np.cumsum(first) - 1]
            keep[rows[schedule.t[rows] == times]] = True
    return keep


def residuals_of(tests: tuple[Trial, ...]) -> Callable[[PreparedRun], Residuals]:
    """Function from a prepared run to the innovations of the judging fixes; trials run in threads."""

    def of(prepared: PreparedRun) -> Residuals:
        options = replace(
            prepared.options,
            record_s=1e9,
            output_rate_hz=0.01,
            lockout=0,
            adaptive=False,
            smoother=False,
            covariance_rate_hz=_COVARIANCE_HZ,
        )
        fix = np.isin(prepared.schedule.kind, TUNING_KINDS)

        def one(trial: Trial) -> tuple[Any, ...]:
            schedule = prepared.schedule.where(trial.use)
            open_ = np.where(fix[trial.use] & (schedule.gate > 0.0), np.inf, schedule.gate)
            schedule = replace(schedule, gate=np.where(trial.held, NEVER, open_))
            forward = replace(prepared, schedule=schedule, options=options).run()
            k = trial.judge
            size = np.array([DIMENSIONS[int(kind)] for kind in schedule.kind[k]], dtype=np.int64)
            y, v = forward.innovation[k], forward.variance[k]
            good = np.isfinite(y) & (v > 0.0) & (np.arange(3) < size[:, None]) & (v < 1e10)
            return (
                schedule.t[k], schedule.kind[k], np.full(len(y), trial.horizon), np.where(good, y, 0.0),
                np.where(good, v, 1.0), trial.weight * good,
            )  # fmt: skip

        with ThreadPoolExecutor(min(len(tests), os.cpu_count() or 1)) as pool:
            parts = list(pool.map(one, tests))
        t, kind, horizon, y, v, w = (np.concatenate(part) for part in zip(*parts, strict=True))
        return Residuals(t, kind, horizon, y, v, w)

    return of


def halves(schedule: MeasurementSchedule, usable: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Every other epoch of each kind, and those between."""
    number, _ = epochs(schedule)
    fix = usable & (number >= 0)
    return fix & (number % 2 == 0), fix & (number % 2 == 1)
