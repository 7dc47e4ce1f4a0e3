"""Rests and turns, the routine they make, and its description for a person who holds the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from schuler import rotation
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.units import DEG

Axis: TypeAlias = Literal["x", "y", "z"]
Vector: TypeAlias = tuple[float, float, float]

_AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
#: No displacement.
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Rest:
    """Leave the sensor where it is.

    Attributes
    ----------
    duration_s : float
        [s]
    """

    duration_s: float

    def __post_init__(self) -> None:
        check_duration(self.duration_s, "Rest")


@dataclass(frozen=True)
class Turn:
    """Turn the sensor about an axis of its own, from standstill to standstill.

    Attributes
    ----------
    axis : {"x", "y", "z"} or (float, float, float)
        Unit vector in body axes; any length is accepted and divided out.
    angle : float
        Positive clockwise for one who looks along the axis (right-hand rule). [rad]
    duration_s : float
        [s]
    ramp : float
        Share of the duration in which the rate grows, and again in which it falls: 0.5 never turns uniformly, nearly 0
        turns nearly uniformly all the time.
    skew : float
        In (-1, 1): positive is fast at first and slow at the end, negative the other way.
    wobble : float
        Largest angle about a second axis, square to the first, that is taken up on the way and given back. [rad]
    shift_m : (float, float, float)
        Displacement of the hand during the turn: north, east, down. [m]
    """

    axis: Axis | Vector
    angle: float
    duration_s: float
    ramp: float = 0.25
    skew: float = 0.0
    wobble: float = 0.0
    shift_m: Vector = ZERO

    def __post_init__(self) -> None:
        check_duration(self.duration_s, "Turn")
        if isinstance(self.axis, str):
            if self.axis not in _AXES:
                raise InputError(f"Turn.axis: expected 'x', 'y', 'z' or a vector, got {self.axis!r}")
        else:
            u = as_vector3(self.axis, "Turn.axis")
            if not np.linalg.norm(u) > 0.0:
                raise InputError("Turn.axis: expected a direction, got a vector of zero length")
            object.__setattr__(self, "axis", tuple((u / np.linalg.norm(u)).tolist()))
        object.__setattr__(self, "shift_m", tuple(as_vector3(self.shift_m, "Turn.shift_m").tolist()))
        if not (np.isfinite(self.angle) and np.isfinite(self.wobble)):
            raise InputError(f"Turn: expected finite angles, got {self.angle} and wobble {self.wobble} rad")
        if not 0.0 < self.ramp <= 0.5:
            raise InputError(f"Turn.ramp: expected a share of the duration in (0, 0.5], got {self.ramp}")
        if not -1.0 < self.skew < 1.0:
            raise InputError(f"Turn.skew: expected a number between -1 and 1, got {self.skew}")

    @property
    def unit(self) -> FloatArray:
        """Unit vector of the axis in body axes. Shape (3,)."""
        return np.array(_AXES[self.axis] if isinstance(self.axis, str) else self.axis)


Step: TypeAlias = Rest | Turn


@dataclass(frozen=True)
class Routine:
    """Rests and turns, one after the other.

    Attributes
    ----------
    steps : tuple of Rest and Turn
        Rests that follow each other become one.
    rpy_nb : (float, float, float)
        Roll, pitch, yaw at the start. [rad]

    Raises
    ------
    InputError
        If there is no step.
    """

    steps: tuple[Step, ...]
    rpy_nb: Vector = ZERO

    def __post_init__(self) -> None:
        if not self.steps:
            raise InputError("Routine.steps: expected at least one Rest or Turn, got none")
        merged: list[Step] = []
        for step in self.steps:
            if isinstance(step, Rest) and merged and isinstance(merged[-1], Rest):
                merged[-1] = Rest(merged[-1].duration_s + step.duration_s)
            else:
                merged.append(step)
        object.__setattr__(self, "steps", tuple(merged))
        object.__setattr__(self, "rpy_nb", tuple(as_vector3(self.rpy_nb, "Routine.rpy_nb").tolist()))

    @cached_property
    def limits(self) -> FloatArray:
        """Start of each step, and the end of the last. Shape (steps + 1,). [s]"""
        return np.concatenate(([0.0], np.cumsum([step.duration_s for step in self.steps])))

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.limits[-1])

    @cached_property
    def attitudes(self) -> FloatArray:
        """``C_nb`` at the start of each step, and at the end. Shape (steps + 1, 3, 3)."""
        C = [rotation.dcm_from_rpy(self.rpy_nb)]
        for step in self.steps:
            turn = step.angle * step.unit if isinstance(step, Turn) else np.zeros(3)
            C.append(C[-1] @ rotation.dcm_from_rotvec(turn))
        return np.array(C)

    @property
    def rests(self) -> FloatArray:
        """Start and end of each rest. Shape (k, 2). [s]"""
        return self._spans(Rest)

    @property
    def turns(self) -> FloatArray:
        """Start and end of each turn. Shape (m, 2). [s]"""
        return self._spans(Turn)

    @property
    def poses(self) -> FloatArray:
        """``C_nb`` in each rest. Shape (k, 3, 3)."""
        return self.attitudes[:-1][[isinstance(step, Rest) for step in self.steps]]

    def _spans(self, kind: type) -> FloatArray:
        spans = [span for span, step in zip(pairwise(self.limits), self.steps, strict=True) if isinstance(step, kind)]
        return np.array(spans).reshape(-1, 2)

    def describe(self) -> str:
        """The routine in words for a person who holds the sensor, one line a step.

        ``x`` points forward (the nose), ``y`` to the right, ``z`` down, as printed on the sensor.
        """
        lines = []
        for k, (step, start) in enumerate(zip(self.steps, self.limits[:-1], strict=True)):
            words = (
                f"rest {step.duration_s:.3g} s: {pose_in_words(self.attitudes[k, 2])}"
                if isinstance(step, Rest)
                else turn_in_words(step)
            )
            lines.append(f"{k + 1:3d}. {start:6.1f} s  {words}")
        return "\n".join(lines)


_DOWN = ("nose down (x down)", "right side down (y down)", "level (z down)")
_UP = ("nose up (x up)", "left side down (y up)", "upside down (z up)")


def pose_in_words(down_b: ArrayLike) -> str:
    """Which side of the sensor is down.

    Parameters
    ----------
    down_b : array_like, shape (3,)
        Direction of the vertical, down, in body axes: the last row of ``C_nb``, or minus the specific force at rest.

    Returns
    -------
    str
        Such as "level (z down)"; "halfway between level (z down) and nose up (x up)"; to about 10 deg.
    """
    d = as_vector3(down_b, "down_b")
    length = float(np.linalg.norm(d))
    if not length > 0.0:
        raise InputError("down_b: expected a direction, got a vector of zero length")
    d = d / length
    order = np.argsort(-np.abs(d))
    names = [(_DOWN if d[j] > 0.0 else _UP)[j] for j in order]
    if abs(d[order[0]]) > np.cos(10.0 * DEG):
        return names[0]
    if abs(d[order[2]]) < np.sin(10.0 * DEG):
        if abs(d[order[1]]) > np.sin(35.0 * DEG):
            first, second = sorted(names[:2], key=(_DOWN + _UP).index)
            return f"halfway between {first} and {second}"
        return f"{names[0]}, leaning towards {names[1]}"
    return f"oblique, towards {names[0]}, {names[1]} and {names[2]}"


def turn_in_words(turn: Turn) -> str:
    """Instruction for the hand, such as "turn 45 deg about x in 1.2 s, clockwise seen along x"."""
    axis = turn.axis if isinstance(turn.axis, str) else f"the axis ({', '.join(f'{c:.2f}' for c in turn.axis)})"
    view_axis = axis if isinstance(turn.axis, str) else "it"
    way = "clockwise" if turn.angle > 0.0 else "anticlockwise"
    return f"turn {abs(turn.angle) / DEG:.0f} deg about {axis} in {turn.duration_s:.3g} s, {way} seen along {view_axis}"


def check_duration(duration_s: float, words: str) -> None:
    """Raise InputError for a time that is not positive. [s]"""
    if not (np.isfinite(duration_s) and duration_s > 0.0):
        raise InputError(f"{words} needs a positive time, got {duration_s} s")
