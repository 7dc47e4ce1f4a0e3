"""What Monte Carlo runs in lanes return: errors and claimed sigmas of every run, or their sums alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.states import BLOCK_TEXT, StateLayout


@dataclass(frozen=True)
class LaneRecords:
    """Errors of many runs at the same times; navigation north, east, down of the true position.

    Attributes
    ----------
    t : ndarray, shape (r,)
        Times of the records. [s]
    runs : ndarray of int, shape (k,)
        Numbers of the runs.
    error, sigma : ndarray, shape (k, r, n)
        Estimate minus truth of every state, and the filter's own 1-sigma. [unit of the state]
    nees : dict of str to ndarray, shape (k, r)
        Normalised errors squared, per degree of freedom, by name of what they are taken of.
    nis : ndarray, shape (k, 2) or (k, 3)
        Mean normalised innovation squared per degree of freedom of positions and of velocities, or of codes, range
        rates and carrier phases of single satellites; NaN where there are none.
    accepted, rejected : ndarray of int, shape (k, 2) or (k, 3)
        Measurements of the same kinds.
    diverged : ndarray of bool, shape (k,)
        Runs whose numbers are not finite, or whose estimates made the IMU turn by more than half a radian in a sample,
        for which lanes are not made.
    layout : StateLayout
        Without ambiguities of carrier phases. Errors of a receiver's clock between two epochs count its true drift.
    """

    t: FloatArray
    runs: IntArray
    error: FloatArray
    sigma: FloatArray
    nees: dict[str, FloatArray]
    nis: FloatArray
    accepted: IntArray
    rejected: IntArray
    diverged: BoolArray
    layout: StateLayout

    def __len__(self) -> int:
        return len(self.runs)

    def statistics(self) -> LaneStatistics:
        """Sums over the runs that did not diverge, added in their order."""
        good = ~self.diverged
        seen = np.isfinite(self.nis[good])
        return LaneStatistics(
            t=self.t, count=int(good.sum()), diverged=int(self.diverged.sum()), sum_error=_sum(self.error[good]),
            sum_square=_sum(self.error[good] ** 2), sum_variance=_sum(self.sigma[good] ** 2),
            sum_nees={name: _sum(values[good]) for name, values in self.nees.items()},
            sum_nis=_sum(np.where(seen, self.nis[good], 0.0)), layout=self.layout,
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: list[LaneRecords]) -> LaneRecords:
        """Records of several batches of the same scenario as one."""
        first = parts[0]
        join = {
            name: np.concatenate([getattr(p, name) for p in parts])
            for name in ("runs", "error", "sigma", "nis", "accepted", "rejected", "diverged")
        }
        nees = {name: np.concatenate([p.nees[name] for p in parts]) for name in first.nees}
        return cls(t=first.t, nees=nees, layout=first.layout, **join)

    def summary(self) -> str:
        """:meth:`LaneStatistics.summary`, and how many measurements were rejected."""
        rejected, taken = int(self.rejected.sum()), int(self.accepted.sum() + self.rejected.sum())
        return f"{self.statistics().summary()}\nmeasurements rejected: {rejected} of {taken}"

    def to_dict(self) -> dict[str, Any]:
        """Arrays by name, for files."""
        names = ("t", "runs", "error", "sigma", "nis", "accepted", "rejected", "diverged")
        return {name: getattr(self, name) for name in names} | {f"nees_{k}": v for k, v in self.nees.items()}


@dataclass(frozen=True)
class LaneStatistics:
    """Sums over runs, whose size does not depend on their number; those of other runs are added with ``+``.

    Attributes
    ----------
    t : ndarray, shape (r,)
        [s]
    count, diverged : int
        Runs in the sums, and runs left out since they diverged.
    sum_error, sum_square, sum_variance : ndarray, shape (r, n)
        Of errors, their squares, and the filter's own variances.
    sum_nees : dict of str to ndarray, shape (r,)
    sum_nis : ndarray, shape (2,) or (3,)
    layout : StateLayout
    """

    t: FloatArray
    count: int
    diverged: int
    sum_error: FloatArray
    sum_square: FloatArray
    sum_variance: FloatArray
    sum_nees: dict[str, FloatArray]
    sum_nis: FloatArray
    layout: StateLayout

    def __add__(self, other: LaneStatistics) -> LaneStatistics:
        if self.t.shape != other.t.shape or np.any(self.t != other.t) or self.layout.names != other.layout.names:
            raise InputError("statistics of different scenarios cannot be added: their times or states differ")
        return LaneStatistics(
            t=self.t, count=self.count + other.count, diverged=self.diverged + other.diverged,
            sum_error=self.sum_error + other.sum_error, sum_square=self.sum_square + other.sum_square,
            sum_variance=self.sum_variance + other.sum_variance,
            sum_nees={name: value + other.sum_nees[name] for name, value in self.sum_nees.items()},
            sum_nis=self.sum_nis + other.sum_nis, layout=self.layout,
        )  # fmt: skip

    @property
    def mean(self) -> FloatArray:
        """Mean error. Shape (r, n)."""
        return self.sum_error / self.count

    @property
    def scatter(self) -> FloatArray:
        """Root mean square error. Shape (r, n)."""
        root: FloatArray = np.sqrt(self.sum_square / self.count)
        return root

    @property
    def claimed(self) -> FloatArray:
        """Root mean of the filter's own variances. Shape (r, n)."""
        root: FloatArray = np.sqrt(self.sum_variance / self.count)
        return root

    @property
    def nees(self) -> dict[str, FloatArray]:
        """Mean normalised errors squared per degree of freedom: 1 for an honest filter. Shape (r,) each."""
        return {name: value / self.count for name, value in self.sum_nees.items()}

    def at(self, name: str, values: ArrayLike) -> FloatArray:
        """The columns of a state block, such as ``statistics.at("dr", statistics.scatter)``."""
        columns: FloatArray = np.asarray(values)[:, self.layout[name]]
        return columns

    def summary(self) -> str:
        """Table at the last record: scatter of the runs beside the filter's own sigma."""
        lines = [
            f"{self.count} runs, {len(self.t)} records, last at {self.t[-1]:g} s"
            + (f"; {self.diverged} runs diverged and are left out" if self.diverged else "")
        ]
        if self.count == 0:
            return lines[0]
        lines.append(f"  {'':<36}{'rms error':>12}{'claimed':>12}{'ratio':>8}")
        for block in self.layout.blocks:
            text, unit = BLOCK_TEXT[block]
            part = self.layout[block]
            rms = float(np.sqrt(np.mean(self.scatter[-1, part] ** 2)))
            claimed = float(np.sqrt(np.mean(self.claimed[-1, part] ** 2)))
            ratio = f"{rms / claimed:8.3f}" if claimed > 0.0 else f"{'':>8}"
            lines.append(f"  {block + ' [' + unit + ']':<36}{rms:12.4g}{claimed:12.4g}{ratio}  {text}")
        for name, values in self.nees.items():
            lines.append(
                f"  NEES of {name} per degree of freedom: {values[-1]:.3f} at the end, {values.mean():.3f} on average"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Numbers and lists, for files."""
        return {
            "t": self.t.tolist(), "count": self.count, "diverged": self.diverged, "states": self.layout.names,
            "mean": self.mean.tolist(), "scatter": self.scatter.tolist(), "claimed": self.claimed.tolist(),
            "nees": {name: value.tolist() for name, value in self.nees.items()},
            "nis": (self.sum_nis / self.count).tolist(),
        }  # fmt: skip


def _sum(values: FloatArray) -> FloatArray:
    """Sum along the first axis one after another, whatever the memory layout would suggest."""
    total = np.zeros(values.shape[1:])
    for value in values:
        total += value
    return total
