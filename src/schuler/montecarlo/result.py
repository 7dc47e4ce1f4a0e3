"""What a campaign returns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.exceptions import InputError
from schuler.montecarlo.column import ColumnStatistics
from schuler.montecarlo.rows import Rows, joined
from schuler.montecarlo.store import read_rows
from schuler.plotting.notebook import Displayed


@dataclass(frozen=True, repr=False)
class Campaign(Displayed):
    """Statistics of a campaign, and where its runs are.

    Attributes
    ----------
    function : str
    seed : int
    wanted, done : int
        Runs asked for, and runs that are there, failed ones among them.
    executed : int
        Runs done by this call; the others came from the store.
    statistics : dict of str to ColumnStatistics
        By column.
    failures : dict of int to str
        Runs that could not be done, and why; in no statistic.
    complete : bool
        False if it was interrupted.
    elapsed_s : float
    where : str
        Place of the work, such as ``2 processes``.
    store : Path, optional
    """

    function: str
    seed: int
    wanted: int
    done: int
    executed: int
    statistics: Mapping[str, ColumnStatistics]
    failures: Mapping[int, str]
    complete: bool
    elapsed_s: float
    where: str
    store: Path | None = None
    _kept: tuple[Rows, ...] | None = field(default=None, repr=False, compare=False)

    def __getitem__(self, name: str) -> ColumnStatistics:
        """Statistics of one column."""
        if name not in self.statistics:
            raise InputError(f"there is no column {name!r}; the runs give {', '.join(self.statistics) or 'nothing'}")
        return self.statistics[name]

    @property
    def rate(self) -> float:
        """Runs a second of this call. [1/s]"""
        return self.executed / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    def rows(self) -> Rows:
        """All runs, ascending: needs a store or ``keep=True``, and memory for all of them."""
        if self._kept is not None:
            return joined(self._kept)
        if self.store is None:
            raise InputError("the runs were not kept, only their statistics; give the campaign a store or keep=True")
        return joined(piece.where(0, self.wanted - 1) for piece in read_rows(self.store))

    def column(self, name: str) -> NDArray[Any]:
        """What the runs gave, one row a run, ascending; see :meth:`rows`. Shape (n, ...)."""
        _ = self[name]
        return self.rows().columns[name]

    def summary(self, digits: int = 4) -> str:
        """Some lines: runs, failures, and every column that is one number."""
        state = "" if self.complete else " (INTERRUPTED)"
        lines = [
            f"{self.function}, seed {self.seed}: {self.done} of {self.wanted} runs{state}, {self.executed} of them now "
            f"in {self.elapsed_s:.1f} s ({self.rate:.3g} runs/s) by {self.where}"
        ]
        for name, s in self.statistics.items():
            if s.shape or s.n < 2:
                continue
            low, high = s.sigma_interval(0.95, normal=False)
            text = (
                f"  {name}: mean {_g(s.mean, digits)} +- {_g(s.standard_error, digits)}, sigma {_g(s.sigma, digits)} "
                f"({_g(low, digits)} to {_g(high, digits)}), {_g(s.minimum, digits)} to {_g(s.maximum, digits)}"
            )
            if s.accuracy is not None:
                text += f", 5/50/95 % {'/'.join(_g(s.quantile(q), digits) for q in (0.05, 0.5, 0.95))}"
            lines.append(text)
        longer = [f"{name} {s.shape}" for name, s in self.statistics.items() if s.shape]
        if longer:
            lines.append(f"  arrays: {', '.join(longer)}")
        if self.failures:
            first = min(self.failures)
            lines.append(f"  {len(self.failures)} runs could not be done; run {first}: {self.failures[first]}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: statistics of every column, arrays nested."""
        return {
            "function": self.function, "seed": self.seed, "runs": self.done, "wanted": self.wanted,
            "computed": self.executed, "resumed": self.done - self.executed, "failed": len(self.failures),
            "complete": self.complete, "elapsed_s": self.elapsed_s, "runs_per_s": self.rate, "where": self.where,
            "failures": {str(k): why for k, why in self.failures.items()},
            "statistics": {name: _column(s) for name, s in self.statistics.items()},
        }  # fmt: skip


def _column(s: ColumnStatistics) -> dict[str, Any]:
    data: dict[str, Any] = {
        "n": s.n, "mean": s.mean.tolist(), "rms": s.rms.tolist(), "min": s.minimum.tolist(), "max": s.maximum.tolist(),
    }  # fmt: skip
    if s.n > 1:
        low, high = s.sigma_interval(0.95, normal=False)
        data |= {"sigma": s.sigma.tolist(), "sigma_low_95": low.tolist(), "sigma_high_95": high.tolist()}
    if s.accuracy is not None:
        data |= {f"q{round(100 * q):02d}": s.quantile(q).tolist() for q in (0.05, 0.5, 0.95)}
    return data


def _g(x: Any, digits: int) -> str:
    value = float(np.asarray(x))
    return f"{value:.{digits}g}" if math.isfinite(value) else str(value)
