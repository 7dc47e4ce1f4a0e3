"""What a search for schemes found: the best, all named ones beside it, and the front against the platform's motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, IntArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import Cell, ResultTable
from schuler.rotary.schedule import Schedule
from schuler.rotary.search.families import Entries, schedule_of
from schuler.units import DEG

_REVOLUTION = 2.0 * np.pi


@dataclass(frozen=True)
class Candidate:
    """A scheme that was looked at.

    Attributes
    ----------
    name : str
    family : str
        Or the type of a named one.
    source : str
        Author of a named scheme; empty for one that the search came to.
    axes : int
    entries : dict
        Entries of ``[rotary.schedule]``.
    error : float
        The objective, SI; infinite if the platform cannot follow it.
    travel : float
        Travel of all axes over the mission. [rad]
    reversals : int
    refused : tuple of str
        Limits that it breaks.
    place : tuple of float or None
        In its family.
    """

    name: str
    family: str
    source: str
    axes: int
    entries: Entries
    error: float
    travel: float
    reversals: int
    refused: tuple[str, ...] = ()
    place: tuple[float, ...] | None = None

    @property
    def schedule(self) -> Schedule:
        """The schedule itself."""
        return schedule_of(self.entries)

    def text(self) -> str:
        """In words."""
        return f"{self.name} ({entries_text(self.entries)})"

    def toml(self) -> str:
        """For a scenario's file."""
        return "\n".join(["[rotary.schedule]", *toml_lines(self.entries)])


@dataclass(frozen=True, repr=False)
class SchemeSearch(Displayed):
    """Result of a search.

    Attributes
    ----------
    what, unit : str
        The objective and the unit it is shown in.
    scale : float
        SI in that unit.
    imu, mission : str
    duration : float
        Length of the mission. [s]
    axes : int
        Number of the platform's axes.
    candidates : tuple of Candidate
        Everything that was looked at.
    evaluations : int
        Evaluations of the objective.
    complete : bool
        False if it was interrupted.
    seed : int
    """

    what: str
    unit: str
    scale: float
    imu: str
    mission: str
    duration: float
    axes: int
    candidates: tuple[Candidate, ...]
    evaluations: int
    complete: bool
    seed: int

    def best(self, axes: int | None = None) -> Candidate:
        """The best scheme of a platform with so many axes, all of them by default; one axis may do for two.

        Raises
        ------
        InputError
            If there is none.
        """
        allowed = [c for c in self.candidates if c.axes <= (axes or self.axes) and np.isfinite(c.error)]
        if not allowed:
            raise InputError(f"no scheme of {axes or self.axes} axes was evaluated")
        # of equal ones that with the least motion
        return min(allowed, key=lambda c: (c.error, c.travel))

    def named(self) -> list[Candidate]:
        """Schemes of the literature and one's own, the best first, those that break a limit last."""
        return sorted((c for c in self.candidates if c.source), key=lambda c: (c.error, c.name))

    def front(self, by: str = "travel", axes: int | None = None) -> list[Candidate]:
        """Schemes than which none has both less error and less motion, the smallest error first.

        Parameters
        ----------
        by : {"travel", "reversals", "both"}
            ``both``: none is better in error, travel and reversals together.
        axes : int, optional
            Number of the platform's axes.
        """
        columns = {"travel": ("travel",), "reversals": ("reversals",), "both": ("travel", "reversals")}
        if by not in columns:
            raise InputError(f"by: expected 'travel', 'reversals' or 'both', got {by!r}")
        mine = [c for c in self.candidates if c.axes <= (axes or self.axes) and np.isfinite(c.error)]
        return [mine[k] for k in pareto_front([[c.error, *(float(getattr(c, n)) for n in columns[by])] for c in mine])]

    def gain(self, axes: int | None = None) -> float:
        """How many times smaller the best scheme's objective is than that of an IMU that does not turn."""
        return next(c.error for c in self.candidates if c.name == "conventional") / self.best(axes).error

    def table(self) -> ResultTable:
        """The best and every named scheme."""
        best = [self.best(k) for k in range(1, self.axes + 1)]
        rows = [self._row(c, f"best of {_axes(k)}") for k, c in enumerate(best, start=1)]
        rows += [self._row(c, c.source) for c in self.named()]
        return ResultTable(
            f"{self.mission}, {self.imu}: {self.what}", self._columns, tuple(rows),
            (f"{self.evaluations} schemes evaluated, seed {self.seed}",), self.complete,
        )  # fmt: skip

    def front_table(self, worth: float = 0.01) -> ResultTable:
        """Front of error against travel: of those within one step of error the one with the least motion.

        Parameters
        ----------
        worth : float
            Relative step of error that is worth a line.
        """
        kept: list[Candidate] = []
        first = 0.0
        for c in self.front():
            if kept and c.error <= (1.0 + worth) * first:
                kept[-1] = c
            else:
                kept.append(c)
                first = c.error
        rows = tuple(self._row(c, c.source or "found") for c in kept)
        return ResultTable(
            f"{self.mission}, {self.imu}: {self.what} against the platform's motion", self._columns, rows,
            complete=self.complete,
        )  # fmt: skip

    @property
    def _columns(self) -> tuple[str, ...]:
        suffix = self.unit.replace("/", "_").replace(" ", "_")
        return ("scheme", "from", "axes", f"objective_{suffix}", "revolutions", "reversals", "details")

    def _row(self, c: Candidate, source: str) -> tuple[Cell, ...]:
        if c.refused:
            return (c.name, source, c.axes, None, None, None, "not possible: " + "; ".join(c.refused))
        return (
            c.name, source, c.axes, c.error / self.scale, c.travel / _REVOLUTION, c.reversals,
            entries_text(c.entries),
        )  # fmt: skip

    def summary(self) -> str:
        """What to do, and what it brings."""
        lines = [f"{self.mission}, {self.imu}: {self.what}" + ("" if self.complete else " (INTERRUPTED: best so far)")]
        still = next((c for c in self.candidates if c.name == "conventional"), None)
        if still is not None:
            lines.append(f"  not turning: {still.error / self.scale:.4g} {self.unit}")
        literature = [c for c in self.named() if c.source not in ("own", "no rotation") and np.isfinite(c.error)]
        for k in range(1, self.axes + 1):
            best = self.best(k)
            motion = f"{best.travel / _REVOLUTION:.3g} revolutions, {best.reversals} reversals"
            lines.append(f"  best of {_axes(k)}: {best.error / self.scale:.4g} {self.unit}, {best.text()}, {motion}")
            mine = [c for c in literature if c.axes <= k]
            if mine:
                lines.append(f"    of the literature: {mine[0].error / self.scale:.4g} {self.unit}, {mine[0].name}")
        front = len(self.front("both"))
        lines.append(f"  {self.evaluations} schemes evaluated, {front} on the front, seed {self.seed}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""

        def plain(c: Candidate) -> dict[str, Any]:
            return {
                "name": c.name, "source": c.source, "axes": c.axes, "objective": c.error / self.scale,
                "travel_deg": c.travel / DEG, "reversals": c.reversals, "refused": list(c.refused),
                "schedule": c.entries,
            }  # fmt: skip

        return {
            "what": self.what, "unit": self.unit, "imu": self.imu, "mission": self.mission, "seed": self.seed,
            "evaluations": self.evaluations, "complete": self.complete,
            "best": {str(k): plain(self.best(k)) for k in range(1, self.axes + 1)},
            "named": [plain(c) for c in self.named()], "front": [plain(c) for c in self.front("both")],
        }  # fmt: skip


def _axes(k: int) -> str:
    return "1 axis" if k == 1 else f"{k} axes"


def entries_text(entries: Entries) -> str:
    """A schedule in one line."""
    parts = []
    for key, value in entries.items():
        if key == "moves":
            turns = ", ".join(f"{m['axis']}:{m['turn_deg']:+.4g} deg {m['dwell_s']:.3g} s" for m in value)
            parts.append(f"moves {turns}")
        elif key == "axis" and not isinstance(value, str):
            parts.append("axis " + " ".join(f"{v:.3f}" for v in value))
        elif key == "axes":
            parts.append("axes " + " ".join(v if isinstance(v, str) else str(v) for v in value))
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            parts.append(text if key == "type" else f"{key} {text}")
    return ", ".join(parts)


def toml_lines(entries: Entries) -> list[str]:
    """A schedule as the lines of its section in a scenario's file."""
    return [f"{key} = {_toml(value)}" for key, value in entries.items()]


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(value)


def pareto_front(costs: ArrayLike) -> IntArray:
    """Rows that no other row beats: none is as small in every column and smaller in one.

    Parameters
    ----------
    costs : array_like, shape (n, k)
        To be made small; a row with an infinite cost is never on the front.

    Returns
    -------
    ndarray of int, shape (f,)
        In the order of the first column. Of equal rows the first one.

    Raises
    ------
    InputError
        If the costs are no table.
    """
    costs = np.asarray(costs, dtype=np.float64)
    if costs.ndim != 2:
        raise InputError(f"costs: expected one row for each candidate, got shape {costs.shape}")
    order = np.lexsort(costs.T[::-1])
    front: list[int] = []
    for k in order:
        row = costs[k]
        if not np.isfinite(row).all():
            continue
        # whatever beats a row stands before it in this order
        if not any(np.all(costs[j] <= row) for j in front):
            front.append(int(k))
    return np.array(front, dtype=np.int64)
