"""What a filter with some factors on its variances is worth: the likelihood of its innovations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED
from schuler.navigation.result import Innovations

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
    """How well a filter with some factors explains a set of measurements.

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
        """Of independent runs: likelihoods add, the rest is averaged by degrees of freedom."""
        if not scores:
            raise InputError("expected at least one score, got none")
        freedom = sum(s.freedom for s in scores)
        known = [s.nees for s in scores if s.nees is not None]
        return Score(
            float(sum(s.likelihood for s in scores)),
            freedom,
            float(sum(s.nis * s.freedom for s in scores)) / max(freedom, 1),
            float(np.mean(known)) if known else None,
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
