"""One angle of a platform as a function of time: quadratic piece by piece, so that its rate is exactly its derivative.

Between rates the platform accelerates evenly (trapezoids of rate); without a limit of acceleration the rate jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError


class Piece(NamedTuple):
    """Evenly accelerated turn: duration [s], rate at its start [rad/s], acceleration [rad/s^2]."""

    duration: float
    rate: float
    acceleration: float


@dataclass(frozen=True, eq=False)
class AngleProfile:
    """An angle for all times.

    Attributes
    ----------
    start : ndarray, shape (k,)
        Start of each piece; the first is zero. [s]
    angle, rate, acceleration : ndarray, shape (k,)
        At the start of each piece; the acceleration holds through it. [rad], [rad/s], [rad/s^2]
    cycle : tuple of float, optional
        Start and stop of what repeats for ever from ``cycle[0]`` on; the angle goes on from where it is. Without it
        the last piece goes on. [s]

    Notes
    -----
    Before zero the angle changes at its first rate, so that readings interpolated at zero have a sample before them.
    """

    start: FloatArray
    angle: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    cycle: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        start = as_floats(self.start, "AngleProfile.start", (None,))
        if len(start) == 0 or start[0] != 0.0 or np.any(np.diff(start) <= 0.0):
            raise InputError("AngleProfile.start: expected increasing times from zero; drop pieces of no duration")
        object.__setattr__(self, "start", readonly(start.copy()))
        for name in ("angle", "rate", "acceleration"):
            values = as_floats(getattr(self, name), f"AngleProfile.{name}", start.shape)
            object.__setattr__(self, name, readonly(values.copy()))
        if self.cycle is not None and not 0.0 <= self.cycle[0] < self.cycle[1] < np.inf:
            raise InputError(f"AngleProfile.cycle: expected 0 <= start < stop, got {self.cycle}")

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Angle [rad], rate [rad/s] and acceleration [rad/s^2] at times (n,); at a jump, the values after it."""
        t = np.asarray(t, dtype=np.float64)
        advance: FloatArray | float = 0.0
        if self.cycle is not None:
            first, stop = self.cycle
            turns = np.maximum(np.floor((t - first) / (stop - first)), 0.0)
            ends, _, _ = self._piece(np.array([first, stop]))
            t, advance = t - turns * (stop - first), turns * (ends[1] - ends[0])
        angle, rate, acceleration = self._piece(t)
        return angle + advance, rate, acceleration

    def _piece(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        k = np.maximum(np.searchsorted(self.start, t, side="right") - 1, 0)
        # no acceleration before zero
        x, a = t - self.start[k], np.where(t < 0.0, 0.0, self.acceleration[k])
        return self.angle[k] + x * (self.rate[k] + 0.5 * a * x), self.rate[k] + a * x, a

    def breakpoints(self, start: float, stop: float) -> FloatArray:
        """Times within ``(start, stop)`` at which rate or acceleration change. Shape (b,). [s]"""
        times = self.start
        if self.cycle is not None:
            first, last = self.cycle
            inner = self.start[(self.start >= first) & (self.start < last)]
            inner = np.concatenate(([first], inner))
            count = max(int(np.ceil((stop - first) / (last - first))), 0) + 1
            again = (inner + (last - first) * np.arange(count)[:, None]).ravel()
            times = np.concatenate((self.start[self.start < first], again))
        times = np.unique(times[(times > start) & (times < stop)])
        return times[np.concatenate(([True], np.diff(times) > 1e-9))] if len(times) else times

    def delayed(self, delay: float) -> AngleProfile:
        """The same after standing for ``delay`` seconds at the first angle."""
        if not delay >= 0.0:
            raise InputError(f"delay: expected a time of zero or more seconds, got {delay!r}")
        if delay == 0.0:
            return self
        return AngleProfile(
            np.concatenate(([0.0], self.start + delay)),
            np.concatenate((self.angle[:1], self.angle)),
            np.concatenate(([0.0], self.rate)),
            np.concatenate(([0.0], self.acceleration)),
            None if self.cycle is None else (self.cycle[0] + delay, self.cycle[1] + delay),
        )


def profile_of(pieces: Sequence[Piece], *, angle: float = 0.0, repeat: bool = False) -> AngleProfile:
    """Profile of pieces one after the other.

    Parameters
    ----------
    pieces : sequence of Piece
        Those of no duration are dropped. The last may last for ever (infinite duration).
    angle : float
        At the start. [rad]
    repeat : bool
        All over again after the last; without it the platform stands still then.

    Raises
    ------
    InputError
        If there is no piece, or a duration is negative.
    """
    if any(not p.duration >= 0.0 for p in pieces):
        raise InputError(f"expected durations of zero or more seconds, got {[p.duration for p in pieces]}")
    kept = [p for p in pieces if p.duration > 0.0]
    if not kept:
        raise InputError("expected at least one piece of some duration")
    endless = np.isinf(kept[-1].duration)
    if endless and repeat:
        raise InputError("a piece that lasts for ever cannot be repeated")
    start, angles = [0.0], [angle]
    for p in kept:
        start.append(start[-1] + p.duration)
        angles.append(angles[-1] + p.duration * (p.rate + 0.5 * p.acceleration * p.duration))
        if np.isinf(p.duration):
            break
    rate, acceleration = [p.rate for p in kept], [p.acceleration for p in kept]
    if repeat or endless:
        cycle = (0.0, start[-1]) if repeat else None
        return AngleProfile(np.array(start[:-1]), np.array(angles[:-1]), np.array(rate), np.array(acceleration), cycle)
    return AngleProfile(np.array(start), np.array(angles), np.array([*rate, 0.0]), np.array([*acceleration, 0.0]))


def turn_pieces(turn: float, rate: float, acceleration: float | None = None) -> list[Piece]:
    """A turn from rest to rest: a trapezoid of rate, or a triangle if it is too short for the full rate.

    Parameters
    ----------
    turn : float
        Signed angle. [rad]
    rate : float
        Largest rate, positive. [rad/s]
    acceleration : float, optional
        Largest acceleration, positive; without it the rate jumps. [rad/s^2]

    Raises
    ------
    InputError
        If rate or acceleration are not positive.
    """
    check_positive(rate, "rate")
    size, sign = abs(turn), 1.0 if turn >= 0.0 else -1.0
    if acceleration is None:
        return [Piece(size / rate, sign * rate, 0.0)]
    check_positive(acceleration, "acceleration")
    peak = min(rate, float(np.sqrt(size * acceleration)))
    ramp = peak / acceleration
    flat = 0.0 if peak < rate else max(size / rate - ramp, 0.0)
    return [
        Piece(ramp, 0.0, sign * acceleration),
        Piece(flat, sign * peak, 0.0),
        Piece(ramp, sign * peak, -sign * acceleration),
    ]


def profile_of_rates(t: ArrayLike, rate: ArrayLike, *, angle: float = 0.0, repeat: bool = False) -> AngleProfile:
    """Profile of a rate that is linear between nodes.

    Parameters
    ----------
    t : array_like, shape (k + 1,)
        From zero; two equal times make a jump. [s]
    rate : array_like, shape (k + 1,)
        [rad/s]
    angle : float
        At zero. [rad]
    repeat : bool
        All over again after the last node; without it the last rate goes on.

    Raises
    ------
    InputError
        If times decrease or do not begin at zero.
    """
    t, rate = as_floats(t, "t", (None,)), as_floats(rate, "rate", (None,))
    if len(t) < 2 or len(t) != len(rate) or t[0] != 0.0 or np.any(np.diff(t) < 0.0):
        raise InputError("t, rate: expected as many rates as times, at least two, with times that begin at zero")
    pieces = [
        Piece(float(h), float(a), float((b - a) / h))
        for h, a, b in zip(np.diff(t), rate[:-1], rate[1:], strict=True)
        if h > 0.0
    ]
    if not repeat:
        pieces.append(Piece(np.inf, float(rate[-1]), 0.0))
    return profile_of(pieces, angle=angle, repeat=repeat)


def check_positive(value: float, name: str) -> None:
    """Refuse what is not a positive finite number."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name}: expected a positive number, got {value!r}; the sign of a turn is that of its angle")
