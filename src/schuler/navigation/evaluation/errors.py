"""Errors of a trajectory against a reference: statistics, outages, drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import frames, units
from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import attitude_difference, nees
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


@dataclass(frozen=True)
class TrajectoryErrors:
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
        k = (self.t >= start) & (self.t <= stop)
        if not k.any():
            raise InputError(
                f"no reference epoch lies within {start:.3f}..{stop:.3f} s; "
                f"there are errors from {self.t[0]:.3f} to {self.t[-1]:.3f} s"
            )
        return TrajectoryErrors(
            self.t[k],
            self.position_n[k],
            None if self.velocity_n is None else self.velocity_n[k],
            None if self.attitude_n is None else self.attitude_n[k],
        )

    def statistics(self) -> dict[str, float]:
        """RMS, maxima and CEP, with units in the names."""
        numbers = {
            "rms_horizontal_m": self.rms_horizontal,
            "max_horizontal_m": self.max_horizontal,
            "cep50_m": self.cep(0.5),
            "cep95_m": self.cep(0.95),
            "rms_vertical_m": self.rms_vertical,
            "max_vertical_m": float(np.abs(self.position_n[:, 2]).max()),
        }
        if self.velocity_n is not None:
            numbers["rms_velocity_horizontal_m_s"] = _rms(np.hypot(self.velocity_n[:, 0], self.velocity_n[:, 1]))
            numbers["rms_velocity_vertical_m_s"] = _rms(self.velocity_n[:, 2])
        if self.attitude_n is not None:
            numbers["rms_tilt_deg"] = _rms(np.hypot(self.attitude_n[:, 0], self.attitude_n[:, 1])) / units.DEG
            numbers["rms_heading_deg"] = _rms(self.attitude_n[:, 2]) / units.DEG
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
    inside = (reference.t >= estimate.t[0]) & (reference.t <= estimate.t[-1])
    if not inside.any():
        raise InputError(
            f"the reference ({reference.t[0]:.3f}..{reference.t[-1]:.3f} s) and the solution "
            f"({estimate.t[0]:.3f}..{estimate.t[-1]:.3f} s) do not overlap; are they on the same clock?"
        )
    t = reference.t[inside]
    e = estimate.at(t)
    C = frames.C_en(reference.llh[inside])
    position = np.einsum("nji,nj->ni", C, e.r_eb_e - reference.r_eb_e[inside])
    velocity = attitude = None
    if (v := estimate.v_eb_e) is not None and reference.v_eb_e is not None:
        # not the derivative of the curve through the positions: a filter's correction is a step in it
        v_e = np.column_stack([np.interp(t, estimate.t, v[:, i]) for i in range(3)])
        velocity = np.einsum("nji,nj->ni", C, v_e - reference.v_eb_e[inside])
    if e.q_eb is not None and reference.q_eb is not None:
        attitude = np.einsum("nji,nj->ni", C, attitude_difference(e.q_eb, reference.q_eb[inside]))
    return TrajectoryErrors(t, position, velocity, attitude)


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
