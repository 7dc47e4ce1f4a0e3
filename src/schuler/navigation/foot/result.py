"""Result of a foot-mounted run: the walk with its uncertainty, the rests, and the strides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.filtering.measurements import ACCEPTED, FORCED
from schuler.navigation.foot.strides import Strides
from schuler.navigation.result import NavigationResult
from schuler.plotting.notebook import Displayed
from schuler.standstill.intervals import Rests

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.verdict import Verdict


@dataclass(frozen=True, repr=False)
class FootResult(Displayed):
    """A walk.

    Attributes
    ----------
    navigation : NavigationResult
        The filtered solution of the IMU; its block ``lever_v``, where it has one, is the point that rests.
    smoothed : NavigationResult, optional
        Smoothed over the complete walk, or with a delay of a stride.
    smoothing : str
        ``walk``, ``stride`` or ``none``.
    rests : Rests
        Zero-velocity samples, at :attr:`t`.
    strides : Strides
        Strides of the smoothed solution, or of the filtered one.
    origin_llh : ndarray, shape (3,)
        Start: latitude, longitude [rad], height [m]; assumed, as foot logs do not know where they are.
    notes : tuple of str
        What was assumed, found and left out.
    doubts : tuple of str
        What no gait would give, see :meth:`~schuler.navigation.foot.strides.Strides.doubts`, and spikes of the rates.
    """

    navigation: NavigationResult
    smoothed: NavigationResult | None
    smoothing: str
    rests: Rests
    strides: Strides
    origin_llh: FloatArray
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Whether the strides are those of a gait: ok or doubtful, from the walk alone."""
        from schuler.verdict import Verdict

        return Verdict("doubtful", self.doubts) if self.doubts else Verdict("ok")

    @property
    def best(self) -> NavigationResult:
        """The smoothed solution where there is one, else the filtered."""
        return self.navigation if self.smoothed is None else self.smoothed

    @property
    def t(self) -> FloatArray:
        """Times of the walk: the start, then every IMU sample. Shape (n,). [s]"""
        return self.rests.t

    def position_n(self, *, smoothed: bool = True) -> FloatArray:
        """Position relative to the start, north, east, down in the axes of the given heading. Shape (n, 3). [m]

        The start itself is the first row: (0, 0, 0).
        """
        solution = self.best if smoothed else self.navigation
        moved = frames.ned_from_ecef(solution.trajectory.r_eb_e, self.origin_llh)
        return np.concatenate((np.zeros((1, 3)), moved))

    def pivot_b(self) -> tuple[FloatArray, FloatArray] | None:
        """The point of the shoe that rests, from the IMU, with 1-sigma; None if it was not estimated. (3,), (3,) [m]"""
        if "lever_v" not in self.best.layout:
            return None
        return self.best.parameter("lever_v")[-1], self.best.sigma("lever_v")[-1]

    @property
    def distance(self) -> float:
        """Sum of the horizontal stride lengths. [m]"""
        return self.strides.distance

    @property
    def closure_n(self) -> FloatArray:
        """From the start to the last rest: the error if the walk returns to where it began. Shape (3,). [m]"""
        position = self.position_n()
        last = self.rests.middle[-1] if len(self.rests) else -1
        closure: FloatArray = position[last] - position[0]
        return closure

    @property
    def zero_velocities(self) -> int:
        """Number of samples the filter took for rest."""
        return int(np.isin(self.navigation.innovations.status, (ACCEPTED, FORCED)).sum())

    def summary(self) -> str:
        """The walk in a few lines of text."""
        closure, best = self.closure_n, self.best
        horizontal = float(np.hypot(closure[0], closure[1]))
        sigma = best.sigma("dr")[-1]
        of_distance = "" if self.distance <= 0.0 else f", {100.0 * horizontal / self.distance:.2f} % of the distance"
        how = {"walk": "smoothed over the walk", "stride": "smoothed with a delay of a stride", "none": "filtered"}
        lines = [
            f"{how[self.smoothing]}: {best.epochs} IMU epochs, {self.t[0]:.2f}..{self.t[-1]:.2f} s, "
            f"{best.layout.size} states ({', '.join(best.layout.blocks)})",
            f"  rests: {len(self.rests)}, {100.0 * self.rests.mask.mean():.0f} % of the time ({self.rests.method}); "
            f"{self.zero_velocities} zero velocities used of {len(self.navigation.innovations)}",
            f"  {self.strides.summary()}",
            f"  from start to end: {closure[0]:+.3f} north {closure[1]:+.3f} east {closure[2]:+.3f} down m "
            f"({horizontal:.3f} m horizontal{of_distance})",
            f"  at the end, 1-sigma: position {sigma[0]:.3f} {sigma[1]:.3f} {sigma[2]:.3f} m, "
            f"heading {best.sigma('dpsi')[-1, 2] / units.DEG:.2f} deg; position and heading are dead reckoning",
        ]
        pivot = self.pivot_b()
        if pivot is not None:
            text = "  ".join(f"{v:+.3f} +- {s:.3f}" for v, s in zip(*pivot, strict=True))
            lines.append(f"  resting point of the shoe, from the IMU, body axes: {text} m")
        lines += [f"  - {note}" for note in self.notes]
        return "\n".join(lines)

    def _headline(self) -> str:
        n, d = len(self.rests), self.distance
        return f"walk of {self.t[-1] - self.t[0]:.1f} s, {d:.1f} m, {n} rests, {self.smoothing}: {self.verdict.status}"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        ends = {"from start to end [m]": self.closure_n, "1-sigma at the end [m]": self.best.sigma("dr")[-1]}
        rows = [(name, *(f"{v:.3f}" for v in vector)) for name, vector in ends.items()]
        return ("", "north", "east", "down"), rows

    def plot(self, **options: Any) -> Figure:
        """Overview figure (matplotlib), see :func:`schuler.navigation.foot.figures.overview`."""
        from schuler.navigation.foot.figures import overview

        return overview(self, **options)
