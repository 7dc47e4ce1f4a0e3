"""Influence of a small sensor error at any time on the computed position at impact: linear, without runs.

Two ways of navigating are known here:

``strapdown``
    Accelerometers sense specific force, gravity is added in navigation axes, rotations are composed. Variant B.
``thesis``
    Accelerometers sense kinematic acceleration, navigation adds no gravity, attitude angles are plain sums of body
    rates in the order of (5.33). Variant A, to reproduce chapter 7.

With ``G(t)`` the integral of ``(T - s) f_n(s)`` from t to impact at T, a rate error e at t moves the impact by
``-G x (C e)``: errors of gyroscopes count only while something is still to be sensed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.rocket.errors import AXES, RocketErrors, is_random
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketTrajectory, attitude
from schuler.rotation import skew
from schuler.sensors.noise import Start
from schuler.sensors.triads import GyroTriad

Variant: TypeAlias = Literal["strapdown", "thesis"]


@dataclass(frozen=True)
class Influence:
    """Weights of errors on the position at impact, north, up, east.

    Attributes
    ----------
    trajectory : RocketTrajectory
    variant : {"strapdown", "thesis"}
    sensed : ndarray, shape (k, 3)
        What the accelerometers sense in this variant, body axes. [m/s^2]
    gyro, accel : ndarray, shape (k, 3, 3)
        ``dr = sum_k dt_k (gyro_k e_g,k + accel_k e_a,k)`` with errors in body axes. [m/rad], [s]
    attitude : ndarray, shape (3, 3)
        Influence of roll, yaw, pitch at the start. [m/rad]
    """

    trajectory: RocketTrajectory
    variant: Variant
    sensed: FloatArray
    gyro: FloatArray
    accel: FloatArray
    attitude: FloatArray

    def effect(self, errors: RocketErrors) -> FloatArray:
        """Position error at impact of what is constant in ``errors``. Shape (3,), north, up, east. [m]

        To first order in the errors, estimate minus truth. A start with a position error begins and ends there.
        """
        T = self.trajectory
        e_g = errors.gyro.respond(T.rate) - T.rate + errors.gyro.bias
        e_a = errors.accel.respond(self.sensed) - self.sensed + errors.accel.bias
        moved = np.einsum("k,kij,kj->i", T.dt, self.gyro, e_g) + np.einsum("k,kij,kj->i", T.dt, self.accel, e_a)
        return np.asarray(moved + errors.start_position + self.attitude @ errors.start_attitude)

    def white(self, triad: str) -> FloatArray:
        """Covariance of position at impact by unit white noise on each axis. Shape (3 axes, 3, 3)."""
        W = self._of(triad)
        return np.asarray(np.einsum("k,kia,kja->aij", self.trajectory.dt, W, W))

    def moving(self, triad: str, tau: FloatArray, start: Start = "stationary") -> FloatArray:
        """Covariance of position at impact by Gauss-Markov biases of unit variance. Shape (3 axes, 3, 3).

        Parameters
        ----------
        triad : {"gyro", "accel"}
        tau : ndarray, shape (3,)
            Correlation times. [s]
        start : {"stationary", "zero"}
        """
        T = self.trajectory
        w = self._of(triad) * T.dt[:, None, None]
        keep = np.exp(-np.diff(T.middle)[:, None] / tau)
        later, P = np.zeros((3, 3)), np.zeros((3, 3, 3))
        tails = np.empty_like(w)
        for k in range(len(w) - 1, -1, -1):
            tails[k] = later
            if k:
                later = keep[k - 1] * (w[k] + later)
        P = np.einsum("kia,kja->aij", w, w)
        cross = np.einsum("kia,kja->aij", w, tails)
        P += cross + np.swapaxes(cross, 1, 2)
        if start == "zero":
            h = np.einsum("ka,kia->ai", np.exp(-T.middle[:, None] / tau), w)
            P -= h[:, :, None] * h[:, None, :]
        return np.asarray(P)

    def covariance(self, errors: RocketErrors, name: str) -> FloatArray:
        """Covariance of position at impact by one parameter.

        A constant counts as 1-sigma, a density or deviation of noise as what it is, a correlation time as nothing.
        Shape (3, 3). [m^2]
        """
        if not is_random(name):
            d = self.effect(errors.only(name))
            return np.outer(d, d)
        triad, part = name.split("_", 1)
        kind, axis = part.rsplit("_", 1)
        i, sensors = AXES.index(axis), self._triad(errors, triad)
        value = float(getattr(sensors, kind)[i])
        if kind == "tau" or value == 0.0:
            return np.zeros((3, 3))
        P = self.white(triad) if kind == "N" else self.moving(triad, sensors.tau, sensors.start)
        return np.asarray(value**2 * P[i])

    def noise_covariance(self, errors: RocketErrors) -> FloatArray:
        """Covariance of position at impact by all noise. Shape (3, 3). [m^2]"""
        P = np.zeros((3, 3))
        for triad in ("gyro", "accel"):
            s = self._triad(errors, triad)
            P += np.einsum("a,aij->ij", s.N**2, self.white(triad))
            if s.sigma_b.any():
                P += np.einsum("a,aij->ij", s.sigma_b**2, self.moving(triad, s.tau, s.start))
        return P

    def _of(self, triad: str) -> FloatArray:
        if triad not in ("gyro", "accel"):
            raise InputError(f"triad: expected 'gyro' or 'accel', got {triad!r}")
        return self.gyro if triad == "gyro" else self.accel

    @staticmethod
    def _triad(errors: RocketErrors, triad: str) -> GyroTriad:
        return errors.gyro if triad == "gyro" else errors.accel


def influence(trajectory: RocketTrajectory, variant: Variant = "strapdown") -> Influence:
    """Weights of all errors along a flight.

    Parameters
    ----------
    trajectory : RocketTrajectory
    variant : {"strapdown", "thesis"}
        See the module.

    Returns
    -------
    Influence

    References
    ----------
    Groves (2013), eqs. (5.19), (5.53); adjoint form as in Zarchan, Tactical and Strategic Missile Guidance, chapter 3.
    """
    check_variant(variant)
    T = trajectory
    C, left, dt = attitude(T.pitch_middle), T.t[-1] - T.middle, T.dt
    sensed = T.specific_force if variant == "strapdown" else T.acceleration
    f_n = np.einsum("kij,kj->ki", C, sensed)
    push = (dt * left)[:, None] * f_n
    G = np.cumsum(push[::-1], axis=0)[::-1]  # from the start of each step on
    axes = C if variant == "strapdown" else np.broadcast_to(np.eye(3), C.shape)
    # a rate error within a step acts on the second half of that step, to second order in its length
    W = -np.einsum("kij,kjl->kil", skew(G - 0.5 * push), axes)
    # roll turns about the forward axis (strapdown) or about north (thesis); yaw about up, pitch about east
    turns = np.eye(3)
    if variant == "strapdown":
        turns[:, 0] = attitude(T.pitch[:1])[0, :, 0]
    return Influence(T, variant, sensed, W, left[:, None, None] * C, -skew(G[0]) @ turns)


def check_variant(variant: str) -> None:
    """Refuse an unknown way of navigating."""
    if variant not in ("strapdown", "thesis"):
        raise InputError(f"variant: expected 'strapdown' or 'thesis', got {variant!r}")
