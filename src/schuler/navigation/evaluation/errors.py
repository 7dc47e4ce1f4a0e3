"""Errors of a trajectory against a reference, and the numbers people quote of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.trajectory import Trajectory


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

    @property
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
        """The usual numbers, with units in the names."""
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
        Of the same point of the body; see :meth:`Trajectory.moved_by` for another.

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


def attitude_difference(q_hat_eb: FloatArray, q_eb: FloatArray) -> FloatArray:
    """Rotation vector ``dpsi`` with ``C_hat = exp([dpsi x]) C``, Earth-fixed axes. Shapes (n, 4) to (n, 3). [rad]"""
    return rotation.rotvec_from_quat(rotation.quat_multiply(q_hat_eb, rotation.quat_conjugate(q_eb)))


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2)))
