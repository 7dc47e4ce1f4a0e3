"""Stefanisko's tuning guide as a program: P0 first, then Q, then R, judged in-sample and out-of-sample.

The thesis (section 4.6) fixes P0, then Q, and varies R "until estimates are stable", by eye. Here each of the three is
a factor on the configured variances, varied on a grid while the others stay, and judged by the log likelihood of the
innovations: it punishes a filter that claims too little (large normalised innovations) and one that claims too much
(wide ones) alike, and needs no truth. Whether the choice holds is asked of data that had no part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED
from schuler.navigation.result import Innovations
from schuler.plotting.table import ResultTable, TabularResult

_TAIL = 30.0  # degrees of freedom of Student's distribution: nearly normal, but a blunder counts by its logarithm only


@dataclass(frozen=True)
class Factors:
    """Factors on the variances of the initial state, of the process noise, and of the measurements."""

    p0: float = 1.0
    q: float = 1.0
    r: float = 1.0

    def __post_init__(self) -> None:
        if not all(np.isfinite(x) and x > 0.0 for x in (self.p0, self.q, self.r)):
            raise InputError(f"Factors: expected positive numbers, got {self.p0}, {self.q}, {self.r}")


@dataclass(frozen=True)
class Score:
    """Likelihood of a set of measurements under a filter with some factors.

    Attributes
    ----------
    likelihood : float
        Log likelihood of the innovations, without its constant; larger is better.
    freedom : int
        Components of the measurements it is made of.
    nis : float
        Normalised innovation squared per degree of freedom; 1 for an honest filter.
    nees : float or None
        Normalised estimation error squared per degree of freedom, where the truth is known.
    """

    likelihood: float
    freedom: int
    nis: float
    nees: float | None = None

    @staticmethod
    def mean(scores: Sequence[Score]) -> Score:
        """Sum over independent runs: likelihoods add, the rest is averaged by degrees of freedom."""
        if not scores:
            raise InputError("expected at least one score, got none")
        freedom = sum(s.freedom for s in scores)
        nees = [s.nees for s in scores if s.nees is not None]
        return Score(
            float(sum(s.likelihood for s in scores)),
            freedom,
            float(sum(s.nis * s.freedom for s in scores)) / max(freedom, 1),
            float(np.mean(nees)) if nees else None,
        )


def likelihood(innovations: Innovations) -> Score:
    """Score of innovations.

    Parameters
    ----------
    innovations : Innovations
        Those that were tested count, rejected ones too.

    Returns
    -------
    Score

    Notes
    -----
    ``-1/2 sum((30 + d) ln(1 + NIS / 30) + ln |S|)`` for d components: Student's distribution with 30 degrees of freedom
    for the normal one, so that blunders do not set the noise (with normal errors its R is 7 % small). The diagonal of S
    stands for its determinant: the engine keeps standard deviations only.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), section 11.6 (likelihood of innovations).
    """
    tested = np.isin(innovations.status, (ACCEPTED, FORCED, REJECTED)) & np.isfinite(innovations.nis)
    used = innovations.where(tested)
    if not len(used):
        raise InputError("no innovation to judge by: the filter had no measurement in this part")
    present = np.arange(3) < used.freedom[:, None]
    log_variance = 2.0 * np.sum(np.log(used.sigma, where=present, out=np.zeros_like(used.sigma)), axis=1)
    total = -0.5 * float(np.sum((_TAIL + used.freedom) * np.log1p(used.nis / _TAIL) + log_variance))
    freedom = int(used.freedom.sum())
    return Score(total, freedom, float(used.nis.sum()) / freedom)


#: Factors to score: what is tuned.
Runner: TypeAlias = Callable[[Factors], Score]


Progress = Callable[[float], None]
Parameter = Literal["p0", "q", "r"]
ORDER: tuple[Parameter, ...] = ("p0", "q", "r")
GRID = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)

_SIGNIFICANT = 1.92  # log likelihood ratio at 95 % with one degree of freedom: less is no reason to change anything


@dataclass(frozen=True)
class TuningStep:
    """One factor varied while the others stay.

    Attributes
    ----------
    parameter : {"p0", "q", "r"}
    factors : tuple of float
    scores : tuple of Score
    chosen : float
    """

    parameter: Parameter
    factors: tuple[float, ...]
    scores: tuple[Score, ...]
    chosen: float

    @property
    def at_edge(self) -> bool:
        """The factor chosen is the smallest or largest tried: the grid is too short."""
        return self.chosen in (min(self.factors), max(self.factors))


@dataclass(frozen=True)
class TuningResult(TabularResult):
    """Result of a tuning, and its score on other data.

    Attributes
    ----------
    steps : tuple of TuningStep
    chosen : Factors
    before, after : Score
        In-sample, with the configured values and with those chosen.
    before_out, after_out : Score, optional
        Out-of-sample.
    complete : bool
    """

    steps: tuple[TuningStep, ...]
    chosen: Factors
    before: Score
    after: Score
    before_out: Score | None = None
    after_out: Score | None = None
    complete: bool = True

    @property
    def holds(self) -> bool | None:
        """The choice explains data better that had no part in it; None if there were none."""
        if self.before_out is None or self.after_out is None:
            return None
        return self.after_out.likelihood >= self.before_out.likelihood

    def table(self) -> ResultTable:
        """All factors tried, then in- and out-of-sample before and after."""
        rows: list[tuple[Any, ...]] = []
        for step in self.steps:
            for factor, score in zip(step.factors, step.scores, strict=True):
                rows.append(
                    (*_entries(step.parameter, factor, score, self.before), "x" if factor == step.chosen else "")
                )
        for name, first, second in (
            ("in-sample", self.before, self.after), ("out-of-sample", self.before_out, self.after_out),
        ):  # fmt: skip
            if first is not None and second is not None:
                rows.append((*_entries(f"{name}, configured", None, first, first), ""))
                rows.append((*_entries(f"{name}, tuned", None, second, first), ""))
        notes = [
            f"tuned: P0 x {self.chosen.p0:g}, Q x {self.chosen.q:g}, R x {self.chosen.r:g} (variances)",
            "gain is the log likelihood over that of the configured values, per component measured",
        ]
        notes += [f"{s.parameter}: best at the edge of the grid; try farther" for s in self.steps if s.at_edge]
        if self.holds is False:
            notes.append("out-of-sample the tuned values explain less than the configured ones: do not use them")
        return ResultTable(
            "tuning P0, Q, R", ("what", "factor", "gain", "nis", "nees", "chosen"), tuple(rows), tuple(notes),
            self.complete,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**self.table().to_dict(), "chosen": vars(self.chosen), "holds": self.holds}


def _entries(what: str, factor: float | None, score: Score, against: Score) -> tuple[Any, ...]:
    gain = score.likelihood / score.freedom - against.likelihood / against.freedom
    return what, factor, gain, score.nis, score.nees


def tune(
    in_sample: Runner,
    out_of_sample: Runner | None = None,
    *,
    grid: Sequence[float] = GRID,
    order: Sequence[Parameter] = ORDER,
    passes: int = 2,
    progress: Progress | None = None,
) -> TuningResult:
    """Choose the factors one after the other.

    Parameters
    ----------
    in_sample : callable
        Factors to score, on the data to tune with: see :mod:`schuler.reproduce.stefanisko.study.tuning_runners`.
    out_of_sample : callable, optional
        The same on other data; it decides nothing.
    grid : sequence of float
        Factors tried; 1 is added. Multiplied with what an earlier pass chose. A factor is changed only if the data
        prefer another significantly (log likelihood ratio above 1.92).
    order : sequence of {"p0", "q", "r"}
        The source's: P0, Q, R.
    passes : int
        Once through, as the source, finds the wrong Q if R is wrong, because Q is judged with that R; with a second
        pass the order does not matter.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    TuningResult
        On Ctrl-C the steps that were finished.

    References
    ----------
    Stefanisko (2015), section 4.6.
    """
    if not grid or not all(x > 0.0 for x in grid) or passes < 1:
        raise InputError(f"expected positive factors and at least one pass, got {list(grid)}, {passes}")
    unknown = [p for p in order if p not in ORDER]
    if unknown or not order:
        raise InputError(f"order: expected p0, q, r, got {list(order)}")
    factors = tuple(sorted({*map(float, grid), 1.0}))
    chosen = Factors()
    before = after = in_sample(chosen)
    steps: list[TuningStep] = []
    complete = True
    total = passes * len(order) * len(factors)
    try:
        for n in range(passes * len(order)):
            name = order[n % len(order)]
            # without the dust of products, so that 1 is 1 again after 10 and 0.1
            tried = tuple(float(f"{getattr(chosen, name) * factor:.12g}") for factor in factors)
            scores = []
            for k, factor in enumerate(tried):
                scores.append(in_sample(replace(chosen, **{name: factor})))
                if progress is not None:
                    progress((n * len(factors) + k + 1) / total)
            best, now = int(np.argmax([s.likelihood for s in scores])), factors.index(1.0)
            if scores[best].likelihood < scores[now].likelihood + _SIGNIFICANT:
                best = now
            chosen, after = replace(chosen, **{name: tried[best]}), scores[best]
            steps.append(TuningStep(name, tried, tuple(scores), tried[best]))
    except KeyboardInterrupt:
        complete = False
    before_out = after_out = None
    if out_of_sample is not None and complete:
        before_out, after_out = out_of_sample(Factors()), out_of_sample(chosen)
    return TuningResult(tuple(steps), chosen, before, after, before_out, after_out, complete)
