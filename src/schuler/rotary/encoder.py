"""Encoder of a platform: readings of its angles, the angles between them, and errors of angle and rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.rotary import gimbals
from schuler.rotary.schedule import Schedule
from schuler.timebase import check_times

Between = Literal["linear", "cubic"]


class Platform(Protocol):
    """What a mechanization needs of a platform: a :class:`Schedule` knows it exactly, :class:`EncoderReadings` not."""

    @property
    def axes(self) -> FloatArray:
        """Unit vectors, outermost first. Shape (m, 3)."""
        ...

    @property
    def C_mount(self) -> FloatArray:
        """IMU axes to the innermost frame. Shape (3, 3)."""
        ...

    def angles(self, t: ArrayLike) -> FloatArray:
        """Shape (n, m). [rad]"""
        ...

    def rates(self, t: ArrayLike) -> FloatArray:
        """Shape (n, m). [rad/s]"""
        ...


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """Errors of an encoder; the default reads 50 times a second and is perfect otherwise.

    Attributes
    ----------
    interval : float
        Between readings. [s]
    resolution : float
        Angle of one count; zero for none. [rad]
    noise : float
        1-sigma of a reading. [rad]
    time_offset : float
        Time by which readings belong to a later moment than their stamp; at a rate omega the angle error is
        ``+ omega time_offset``. [s]
    zero_offset : float
        Error of the zero of every axis, reading minus truth. [rad]
    """

    interval: float = 0.02
    resolution: float = 0.0
    noise: float = 0.0
    time_offset: float = 0.0
    zero_offset: float = 0.0

    def __post_init__(self) -> None:
        if not (self.interval > 0.0 and self.resolution >= 0.0 and self.noise >= 0.0):
            raise InputError(
                f"an encoder needs interval > 0, resolution >= 0 and noise >= 0, got {self.interval}, "
                f"{self.resolution}, {self.noise}"
            )


@dataclass(frozen=True, eq=False, repr=False)
class EncoderReadings(Abridged):
    """Angles of a platform as read, with what is needed to make attitudes of them.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Stamps. [s]
    angle : ndarray, shape (n, m)
        Readings, not wrapped to a turn (:func:`numpy.unwrap` a log that is). [rad]
    axes : ndarray, shape (m, 3)
        Outermost first.
    C_mount : ndarray, shape (3, 3)
    between : {"linear", "cubic"}
        How angles change between readings. Cubic is better for a platform that moves smoothly and read finely; linear
        does not overshoot at jumps of the rate.
    """

    t: FloatArray
    angle: FloatArray
    axes: FloatArray
    C_mount: FloatArray = field(default_factory=lambda: np.eye(3))
    between: Between = "linear"

    def __post_init__(self) -> None:
        t = check_times(self.t, "EncoderReadings.t")
        axes = as_floats(self.axes, "EncoderReadings.axes", (None, 3))
        angle = as_floats(self.angle, "EncoderReadings.angle", (len(t), len(axes)))
        if len(t) < 2:
            raise InputError("an encoder log needs at least two readings")
        if self.between not in ("linear", "cubic"):
            raise InputError(f"between: expected 'linear' or 'cubic', got {self.between!r}")
        object.__setattr__(self, "t", readonly(t.copy()))
        object.__setattr__(self, "axes", readonly(np.stack([gimbals.axis_vector(u) for u in axes])))
        object.__setattr__(self, "angle", readonly(angle.copy()))
        object.__setattr__(self, "C_mount", readonly(as_floats(self.C_mount, "EncoderReadings.C_mount", (3, 3)).copy()))

    def angles(self, t: ArrayLike) -> FloatArray:
        """Angles at times (n,), interpolated. Shape (n, m). [rad]

        Raises
        ------
        InputError
            If a time is more than one reading outside the log: angles are not guessed.
        """
        return self._between(t)[0]

    def rates(self, t: ArrayLike) -> FloatArray:
        """Derivative of :meth:`angles`. Shape (n, m). [rad/s]"""
        return self._between(t)[1]

    def C_bs(self, t: ArrayLike) -> FloatArray:
        """Attitude of the IMU in the body at times (n,). Shape (n, 3, 3)."""
        return gimbals.C_bs(self.axes, self.angles(t), self.C_mount)

    def omega_bs_s(self, t: ArrayLike) -> FloatArray:
        """Angular rate of the IMU relative to the body, IMU axes. Shape (n, 3). [rad/s]"""
        return gimbals.omega_bs_s(self.axes, *self._between(t), self.C_mount)

    def _between(self, t: ArrayLike) -> tuple[FloatArray, FloatArray]:
        t = as_floats(t, "t", (None,))
        step = float(np.median(np.diff(self.t)))
        if len(t) and (t.min() < self.t[0] - 1.01 * step or t.max() > self.t[-1] + 1.01 * step):
            raise InputError(
                f"the encoder log covers {self.t[0]:.3f}..{self.t[-1]:.3f} s, angles are needed for "
                f"{t.min():.3f}..{t.max():.3f} s; cut the IMU log"
            )
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        x = (t - self.t[k])[:, None] / h
        a, b = self.angle[k], self.angle[k + 1]
        slope = (b - a) / h
        if self.between == "linear" or len(self.t) < 4:
            return a + x * (b - a), slope
        # cubic Hermite with the derivative of the parabola through three readings at each
        nodes = np.gradient(self.angle, self.t, axis=0, edge_order=2)
        p, q = nodes[k], nodes[k + 1]
        angle = a + x * (b - a) + h * x * (1.0 - x) * ((1.0 - x) * (p - slope) - x * (q - slope))
        rate = slope + (1.0 - x) * (1.0 - 3.0 * x) * (p - slope) - x * (2.0 - 3.0 * x) * (q - slope)
        return angle, rate


def read_encoder(
    schedule: Schedule,
    encoder: Encoder,
    duration: float,
    rng: np.random.Generator | None = None,
    *,
    between: Between = "linear",
) -> EncoderReadings:
    """What an encoder reports of a schedule.

    Parameters
    ----------
    schedule : Schedule
    encoder : Encoder
    duration : float
        Readings go from one interval before zero to at least one after this time. [s]
    rng : numpy.random.Generator, optional
        For the noise; needed if there is any.
    between : {"linear", "cubic"}
        See :class:`EncoderReadings`.

    Returns
    -------
    EncoderReadings
        ``round((angle(t + time_offset) + zero_offset + noise) / resolution) resolution``, stamped t.
    """
    if encoder.noise > 0.0 and rng is None:
        raise InputError("an encoder with noise needs a generator: pass numpy.random.default_rng(seed)")
    if not duration > 0.0:
        raise InputError(f"duration: expected a positive number of seconds, got {duration!r}")
    count = int(np.ceil(duration / encoder.interval - 1e-9)) + 1
    t: FloatArray = np.arange(-1.0, count + 1) * encoder.interval
    angle = schedule.angles(t + encoder.time_offset) + encoder.zero_offset
    if rng is not None and encoder.noise > 0.0:
        angle = angle + encoder.noise * rng.standard_normal(angle.shape)
    if encoder.resolution > 0.0:
        angle = np.round(angle / encoder.resolution) * encoder.resolution
    return EncoderReadings(t, angle, schedule.axes, schedule.C_mount, between)


def platform_error(
    platform: Platform,
    t: ArrayLike,
    C_nb: ArrayLike,
    omega_is_s: ArrayLike,
    f_is_s: ArrayLike,
    angle_error: ArrayLike,
    rate_error: ArrayLike = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """First-order errors of the turned IMU output in navigation axes, body route.

    Parameters
    ----------
    platform : Platform
        True angles and rates, m axes.
    t : array_like, shape (n,)
        [s]
    C_nb : array_like, shape (n, 3, 3) or (3, 3)
        Attitude of the vehicle.
    omega_is_s, f_is_s : array_like, shape (n, 3)
        Output of the IMU. [rad/s], [m/s^2]
    angle_error, rate_error : array_like, shape (n, m) or broadcast to it
        Estimate minus truth of the platform's angles and rates. Rates that are differences of the angles have the
        derivative of the angles' error and nothing else. [rad], [rad/s]

    Returns
    -------
    d_omega_n, d_f_n : ndarray, shape (n, 3)
        [rad/s], [m/s^2]

    Notes
    -----
    With ``C_hat_bs = (I + [dphi x]) C_bs``, ``dphi = sum of angle errors times axes``::

        d_f_n     = C_nb (dphi x C_bs f)
        d_omega_n = C_nb (dphi x C_bs omega_is - d omega_bs_b)

    A level vehicle at rest that is turned about the vertical has its force along the axis: an error of the angle then
    makes no error of velocity. An offset tau between the clocks of encoder and IMU is an angle error of ``rate tau``.

    References
    ----------
    Du (2015), eqs. (2.19)-(2.21), generalised to several axes; its ``phi`` is minus ours, so the signs its prose drops
    stand here as they must.
    """
    t = as_floats(t, "t", (None,))
    angles, rates = platform.angles(t), platform.rates(t)
    d_angle = np.broadcast_to(np.asarray(angle_error, dtype=np.float64), angles.shape)
    d_rate = np.broadcast_to(np.asarray(rate_error, dtype=np.float64), angles.shape)
    C_bs = gimbals.C_bs(platform.axes, angles, platform.C_mount)
    axes_b = np.einsum("nij,nmj->nmi", C_bs, gimbals.axes_in_s(platform.axes, angles, platform.C_mount))
    dphi = np.zeros((len(t), 3))
    d_bs_b = np.zeros((len(t), 3))
    for k in range(len(platform.axes)):
        # an axis is itself turned by the errors of those outside it
        d_bs_b += d_rate[:, k, None] * axes_b[:, k] + rates[:, k, None] * np.cross(dphi, axes_b[:, k])
        dphi += d_angle[:, k, None] * axes_b[:, k]
    omega_b = np.einsum("nij,nj->ni", C_bs, as_floats(omega_is_s, "omega_is_s", (len(t), 3)))
    f_b = np.einsum("nij,nj->ni", C_bs, as_floats(f_is_s, "f_is_s", (len(t), 3)))
    C = np.broadcast_to(np.asarray(C_nb, dtype=np.float64), (len(t), 3, 3))
    return (
        np.einsum("nij,nj->ni", C, np.cross(dphi, omega_b) - d_bs_b),
        np.einsum("nij,nj->ni", C, np.cross(dphi, f_b)),
    )
