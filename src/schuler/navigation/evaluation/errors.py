"""Errors of a trajectory against a reference: statistics, outages, drift."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames, units
from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import attitude_difference, nees
from schuler.plotting.notebook import Abridged
from schuler.recording.trajectory import KEPT, Trajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


@dataclass(frozen=True, repr=False)
class TrajectoryErrors(Abridged):
    """Estimate minus reference over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    position_n : ndarray, shape (n, 3)
        North, east, down at the reference. [m]
    velocity_n : ndarray, shape (n, 3), optional
        North, east, down. [m/s]
    attitude_n : ndarray, shape (n, 3), optional
        Rotation vector about north, east, down of ``C_hat C^T``: no Euler angles, no singularity. [rad]
    """

    t: FloatArray
    position_n: FloatArray
    velocity_n: FloatArray | None = None
    attitude_n: FloatArray | None = None

    @cached_property
    def horizontal(self) -> FloatArray:
        """Horizontal distance to the reference. Shape (n,). [m]"""
        return np.hypot(self.position_n[:, 0], self.position_n[:, 1])

    @property
    def rms_horizontal(self) -> float:
        """Root of the mean squared horizontal error. [m]"""
        return float(np.sqrt(np.mean(self.horizontal**2)))

    @property
    def max_horizontal(self) -> float:
        """Largest horizontal error. [m]"""
        return float(self.horizontal.max())

    @property
    def rms_vertical(self) -> float:
        """Root of the mean squared vertical error. [m]"""
        return float(np.sqrt(np.mean(self.position_n[:, 2] ** 2)))

    def cep(self, share: float = 0.5) -> float:
        """Radius of the circle about the reference that holds the given share of the horizontal errors. [m]"""
        return float(np.quantile(self.horizontal, share))

    def between(self, start: float, stop: float) -> TrajectoryErrors:
        """Errors with ``start <= t <= stop``, at least one. [s]"""
        rows = slice(int(np.searchsorted(self.t, start)), int(np.searchsorted(self.t, stop, side="right")))
        if rows.stop <= rows.start:
            raise InputError(
                f"no reference epoch lies within {start:.3f}..{stop:.3f} s; "
                f"there are errors from {self.t[0]:.3f} to {self.t[-1]:.3f} s"
            )
        return self._part(rows)

    def _part(self, rows: slice) -> TrajectoryErrors:
        return TrajectoryErrors(
            self.t[rows],
            self.position_n[rows],
            None if self.velocity_n is None else self.velocity_n[rows],
            None if self.attitude_n is None else self.attitude_n[rows],
        )

    def statistics(self) -> dict[str, float]:
        """RMS, maxima and CEP, with units in the names."""
        return dict(self._statistics)

    @cached_property
    def _statistics(self) -> dict[str, float]:
        vertical, horizontal = np.abs(self.position_n[:, 2]), self.horizontal
        numbers = {
            "rms_horizontal_m": _rms(horizontal),
            "max_horizontal_m": float(horizontal.max()),
            "cep50_m": float(np.quantile(horizontal, 0.5)),
            "cep95_m": float(np.quantile(horizontal, 0.95)),
            "rms_vertical_m": _rms(vertical),
            "max_vertical_m": float(vertical.max()),
        }
        del vertical, horizontal
        if (v := self.velocity_n) is not None:
            numbers["rms_velocity_horizontal_m_s"] = _rms(np.hypot(v[:, 0], v[:, 1]))
            numbers["rms_velocity_vertical_m_s"] = _rms(v[:, 2])
            del v
        if (psi := self.attitude_n) is not None:
            numbers["rms_tilt_deg"] = _rms(np.hypot(psi[:, 0], psi[:, 1])) / units.DEG
            numbers["rms_heading_deg"] = _rms(psi[:, 2]) / units.DEG
        return numbers


def trajectory_errors(estimate: Trajectory, reference: Trajectory) -> TrajectoryErrors:
    """Errors of one trajectory against another at the reference's times.

    Parameters
    ----------
    estimate : Trajectory
        Interpolated to the times of the reference that lie in its span (positions by cubic Hermite curves, velocities
        linearly, attitude by constant turns).
    reference : Trajectory
        Trajectory of the same point of the body; see :meth:`Trajectory.moved_by` for another.

    Returns
    -------
    TrajectoryErrors
        Velocity and attitude where both have one.

    Raises
    ------
    InputError
        If the two do not overlap in time.
    """
    rows = slice(
        int(np.searchsorted(reference.t, estimate.t[0])),
        int(np.searchsorted(reference.t, estimate.t[-1], side="right")),
    )
    if rows.stop <= rows.start:
        raise InputError(
            f"the reference ({reference.t[0]:.3f}..{reference.t[-1]:.3f} s) and the solution "
            f"({estimate.t[0]:.3f}..{estimate.t[-1]:.3f} s) do not overlap; are they on the same clock?"
        )
    errors = DerivedErrors(estimate, reference, rows)
    return errors if len(errors.t) >= KEPT else errors.kept()


class DerivedErrors(TrajectoryErrors):
    """Errors of a long trajectory, made anew when asked for: kept, those of a day at 200 Hz take 1.2 GB.

    Parameters
    ----------
    estimate, reference : Trajectory
    rows : slice
        Of the reference, in the span of the estimate.
    """

    def __init__(self, estimate: Trajectory, reference: Trajectory, rows: slice) -> None:
        compared = reference.samples(rows)
        if len(reference) < KEPT:
            compared._cache["llh"] = reference.llh[rows]
        object.__setattr__(self, "t", compared.t)
        object.__setattr__(self, "_pair", (estimate, compared))

    _pair: tuple[Trajectory, Trajectory]

    @property
    def position_n(self) -> FloatArray:
        """North, east, down at the reference. [m]"""
        return self._made(_position)

    @property
    def velocity_n(self) -> FloatArray | None:
        """North, east, down. [m/s]"""
        return self._made(_velocity) if self._both("v_eb_e") else None

    @property
    def attitude_n(self) -> FloatArray | None:
        """Rotation vector about north, east, down. [rad]"""
        return self._made(_attitude) if self._both("q_eb") else None

    @property
    def horizontal(self) -> FloatArray:
        """Horizontal distance to the reference. Shape (n,). [m]"""
        return self._made(_horizontal, ())

    def kept(self) -> TrajectoryErrors:
        """The same errors in memory."""
        return TrajectoryErrors(self.t, self.position_n, self.velocity_n, self.attitude_n)

    def _part(self, rows: slice) -> TrajectoryErrors:
        return DerivedErrors(*self._pair, rows).kept()

    def _both(self, name: str) -> bool:
        return all(getattr(T.samples(slice(1)), name) is not None for T in self._pair)

    def _made(
        self, difference: Callable[[Trajectory, Trajectory], FloatArray], shape: tuple[int, ...] = (3,)
    ) -> FloatArray:
        """A difference of estimate and reference at the times of the latter, a block at a time."""
        estimate, reference = self._pair
        if len(reference) < KEPT:
            return difference(estimate, reference)
        values = np.empty((len(reference), *shape))
        for rows in reference.blocks():
            block = reference.samples(rows)
            first = int(np.searchsorted(estimate.t, block.t[0], side="right")) - 1
            last = int(np.searchsorted(estimate.t, block.t[-1], side="right"))
            values[rows] = difference(estimate.samples(slice(max(first, 0), last + 1)), block)
        return values


def _position(estimate: Trajectory, reference: Trajectory) -> FloatArray:
    return _to_ned(reference, estimate.at(reference.t).r_eb_e - reference.r_eb_e)


def _horizontal(estimate: Trajectory, reference: Trajectory) -> FloatArray:
    d = _position(estimate, reference)
    return np.asarray(np.hypot(d[:, 0], d[:, 1]))


def _velocity(estimate: Trajectory, reference: Trajectory) -> FloatArray:
    # not the derivative of the curve through the positions: a filter's correction is a step in it
    v = estimate._velocity()
    v_e = np.column_stack([np.interp(reference.t, estimate.t, v[:, i]) for i in range(3)])
    return _to_ned(reference, v_e - reference._velocity())


def _attitude(estimate: Trajectory, reference: Trajectory) -> FloatArray:
    q_hat, q = estimate.at(reference.t)._attitude(), reference._attitude()
    return _to_ned(reference, attitude_difference(q_hat, q))


def _to_ned(reference: Trajectory, vector_e: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nji,nj->ni", frames.C_en(reference.llh), vector_e))


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@dataclass(frozen=True)
class OutageError:
    """Errors of one outage.

    Attributes
    ----------
    start, stop : float
        [s]
    max_horizontal : float
        Largest horizontal error inside. [m]
    end_horizontal : float
        Horizontal error at the last reference epoch inside. [m]
    max_vertical : float
        [m]
    """

    start: float
    stop: float
    max_horizontal: float
    end_horizontal: float
    max_vertical: float


def outage_errors(errors: TrajectoryErrors, windows: Sequence[tuple[float, float]]) -> list[OutageError]:
    """Errors inside each outage; windows without a reference epoch are left out."""
    if not windows:  # errors of a long run are made anew
        return []
    outages = []
    horizontal, vertical = errors.horizontal, np.abs(errors.position_n[:, 2])
    for start, stop in windows:
        k = np.flatnonzero((errors.t >= start) & (errors.t <= stop))
        if len(k):
            h = horizontal[k]
            outages.append(OutageError(start, stop, float(h.max()), float(h[-1]), float(vertical[k].max())))
    return outages


def drift_curve(
    errors: TrajectoryErrors, windows: Sequence[tuple[float, float]], step: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Horizontal error against time since GNSS was lost, over all outages.

    Parameters
    ----------
    errors : TrajectoryErrors
    windows : sequence of (start, stop)
        [s]
    step : float
        Width of the time bins; the last one takes what is left of the longest outage. [s]

    Returns
    -------
    age : ndarray, shape (k,)
        End of each bin. [s]
    rms, largest : ndarray, shape (k,)
        Horizontal error in the bin over all outages, NaN where no reference epoch fell. [m]
    """
    longest = max((stop - start for start, stop in windows), default=0.0)
    age = np.arange(step, longest + 0.5 * step, step)
    total, count, largest = np.zeros(len(age)), np.zeros(len(age)), np.full(len(age), -np.inf)
    for start, stop in windows:
        k = (errors.t >= start) & (errors.t <= stop)
        bins = np.clip(np.ceil((errors.t[k] - start) / step).astype(int) - 1, 0, len(age) - 1)
        h = errors.horizontal[k]
        np.add.at(total, bins, h**2)
        np.add.at(count, bins, 1.0)
        np.maximum.at(largest, bins, h)
    seen = count > 0.0
    rms = np.full(len(age), np.nan)
    rms[seen] = np.sqrt(total[seen] / count[seen])
    return age, rms, np.where(seen, largest, np.nan)


def evaluate(
    result: NavigationResult,
    reference: Trajectory | None,
    *,
    at_antenna: bool = False,
    parameters: ArrayLike | None = None,
    origin: float = 0.0,
) -> dict[str, Any]:
    """Accuracy, consistency and outage behaviour of a solution.

    Parameters
    ----------
    result : NavigationResult
    reference : Trajectory, optional
        Truth or a better solution; without it no errors are given.
    at_antenna : bool
        The reference is the antenna's.
    parameters : array_like, optional
        True parameters, for the NEES over all states; without them over the nine navigation states.
    origin : float
        Origin of the times of outages. [s]

    Returns
    -------
    dict
        Keys as documented in docs/commands.md; None where something cannot be known.
    """
    numbers: dict[str, Any] = {"rms_horizontal_m": None, "max_horizontal_m": None, "nees_mean": None}
    if reference is not None:
        errors = result.errors(reference, at_antenna=at_antenna)
        numbers.update(errors.statistics())
        if result.outages:
            numbers.update(_outages(errors, result, origin))
        if reference.q_eb is not None and reference.v_eb_e is not None and not at_antenna:
            numbers["nees_mean"] = float(np.mean(nees(result, reference, parameters)))
    numbers.setdefault("outages", [])
    numbers.setdefault("mean_outage_max_horizontal_m", None)
    return numbers


def _outages(errors: TrajectoryErrors, result: NavigationResult, origin: float) -> dict[str, Any]:
    outages = outage_errors(errors, result.outages)
    aided = np.ones(len(errors.t), dtype=bool)
    for start, stop in result.outages:
        aided &= ~((errors.t >= start) & (errors.t <= stop))
    return {
        "outages": [
            {
                "start_s": round(o.start - origin, 6),
                "stop_s": round(o.stop - origin, 6),
                "max_horizontal_m": o.max_horizontal,
                "end_horizontal_m": o.end_horizontal,
                "max_vertical_m": o.max_vertical,
            }
            for o in outages
        ],
        "mean_outage_max_horizontal_m": float(np.mean([o.max_horizontal for o in outages])) if outages else None,
        "rms_horizontal_aided_m": float(np.sqrt(np.mean(errors.horizontal[aided] ** 2))) if aided.any() else None,
    }
