"""Families of schemes: from a point of the unit cube to a schedule that a platform can follow.

Each family knows its variables, and what a scenario's ``[rotary.schedule]`` would say. Everything found by a search can
so be pasted into a file and run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.rotary.gimbals import axis_vector
from schuler.rotary.platform_usage import PlatformLimits
from schuler.rotary.schedule import Schedule
from schuler.rotary.sections import ScheduleSection
from schuler.units import DEG

#: What a scenario's ``[rotary.schedule]`` says.
Entries: TypeAlias = dict[str, Any]
MOVES = 4  # of a sequence about one axis
HALF_TURNS = 8  # of a sequence about two
_SLOWEST = 0.02  # of the platform's rate
_SHORTEST = 30.0  # stroke [deg]
_MOST_TURNS = 4.0  # of a stroke, where nothing limits the angle


@dataclass(frozen=True)
class SchemeSpace:
    """What may be searched.

    Attributes
    ----------
    limits : PlatformLimits
    duration : float
        Length of the mission. [s]
    axes : tuple of str
        The platform's possible axes, body axes.
    positions : tuple of int
        Numbers of even positions to dwell at.
    tilt : float
        Largest angle by which a single axis may lean from each of ``axes``. [rad]
    """

    limits: PlatformLimits
    duration: float
    axes: tuple[str, ...] = ("x", "y", "z")
    positions: tuple[int, ...] = (2, 3, 4, 6, 8, 16)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.limits.rate):
            raise InputError("a search needs the platform's largest rate: give [rotary.limits] rate_deg_s")
        if not self.axes or not self.positions or min(self.positions) < 2:
            raise InputError("a search needs at least one axis, and numbers of positions of two or more")

    @property
    def usual(self) -> Entries:
        """Entries of every schedule: the acceleration, if it is limited."""
        limit = self.limits.acceleration
        return {} if np.isinf(limit) else {"acceleration_deg_s2": limit / DEG}


@dataclass(frozen=True)
class Family:
    """Schemes of one kind.

    Attributes
    ----------
    name : str
    axes : int
        Axes of the platform that it needs.
    whole : tuple of int
        Numbers of choices of each variable, 0 for one that is continuous.
    entries : callable
        From the search space and values, continuous ones in 0..1, choices whole numbers from 0, to a schedule.
    """

    name: str
    axes: int
    whole: tuple[int, ...]
    entries: Callable[[SchemeSpace, FloatArray], Entries]


def schedule_of(entries: Entries) -> Schedule:
    """The schedule that a scenario's entries describe."""
    return ScheduleSection(**entries).build()


def families(space: SchemeSpace, axes: int, chosen: Sequence[str] = ()) -> list[Family]:
    """Families that a platform of so many axes can follow.

    Parameters
    ----------
    space : SchemeSpace
    axes : int
    chosen : sequence of str
        Names; all if none is given.

    Raises
    ------
    InputError
        For an unknown name.
    """
    lean = 2 if space.tilt > 0.0 else 0
    n, p = len(space.axes), len(space.positions)
    pairs = len(_pairs(space))
    members = [
        Family("continuous", 1, (n, 2, 0, *[0] * lean), _continuous),
        Family("reciprocating", 1, (n, 2, 0, 0, 0, 2, *[0] * lean), _reciprocating),
        Family("carousel", 1, (n, 0, 0, *[0] * lean), _carousel),
        Family("dwell", 1, (n, p, 0, 0, 2, *[0] * lean), _dwell),
        Family("sequence", 1, (n, 0, *[0] * (2 * MOVES), *[0] * lean), _sequence),
    ]
    if pairs:
        members += [
            Family("dual_axis", 2, (pairs, 3, 0, 0), _dual_axis),
            Family("dual_order", 2, (pairs, 0, 0, *[4] * HALF_TURNS), _dual_order),
        ]
    unknown = sorted(set(chosen) - {f.name for f in members})
    if unknown:
        raise InputError(f"families: expected some of {', '.join(f.name for f in members)}, got {unknown[0]!r}")
    if not np.isinf(space.limits.angle):
        # nothing turns for ever on a cable
        members = [f for f in members if f.name != "continuous"]
    return [f for f in members if f.axes <= axes and (not chosen or f.name in chosen)]


def place_of(space: SchemeSpace, entries: Entries) -> tuple[str, tuple[float, ...]] | None:
    """Family and place of a schedule that is a member of one, or nearly: values beyond its range become the nearest.

    Parameters
    ----------
    space : SchemeSpace
    entries : dict
        Such as a named scheme's.

    Returns
    -------
    (str, tuple of float) or None
        None for a schedule that belongs to no family.
    """
    kind = entries["type"]
    if kind == "dual_axis":
        axes, positions = tuple(entries["axes"]), entries["positions"]
        if axes not in _pairs(space):
            return None
        choices = (_pairs(space).index((axes[0], axes[1])), (4, 8, 16).index(positions))
        return kind, (*choices, _rate_place(space, entries["rate_deg_s"]), _time_place(space, entries["dwell_s"]))
    axis = entries.get("axis", "")
    if not isinstance(axis, str) or axis.removeprefix("-") not in space.axes or kind not in _SINGLE:
        return None
    sign, n = float(axis.startswith("-")), float(space.axes.index(axis.removeprefix("-")))
    rate = _rate_place(space, abs(entries["rate_deg_s"]))
    lean = (0.0, 0.0) if space.tilt > 0.0 else ()
    if kind == "continuous":
        return kind, (n, float((sign == 1.0) != (entries["rate_deg_s"] < 0.0)), rate, *lean)
    if kind == "reciprocating":
        turn, dwell = _stroke_place(space, entries.get("turn_deg", 360.0)), entries.get("dwell_s", 0.0)
        return kind, (n, sign, rate, turn, _time_place(space, dwell), float(entries.get("both_sides", False)), *lean)
    if kind == "carousel":
        return kind, (n, rate, _stroke_place(space, entries["limit_deg"]), *lean)
    if entries.get("positions") not in space.positions:
        return None
    positions = float(space.positions.index(entries["positions"]))
    return kind, (n, positions, rate, _time_place(space, entries["dwell_s"]), float(entries.get("back", True)), *lean)


_SINGLE = ("continuous", "reciprocating", "carousel", "dwell")


def _rate_place(space: SchemeSpace, rate_deg_s: float) -> float:
    ratio = float(np.clip(rate_deg_s * DEG / space.limits.rate, _SLOWEST, 1.0))
    return float(1.0 - np.log(ratio) / np.log(_SLOWEST))


def _time_place(space: SchemeSpace, seconds: float) -> float:
    return float(np.cbrt(min(2.0 * seconds / space.duration, 1.0)))


def _stroke_place(space: SchemeSpace, turn_deg: float) -> float:
    low, high = _stroke(space, 0.0), _stroke(space, 1.0)
    if high <= low:
        return 0.0
    return float(np.log(np.clip(abs(turn_deg), low, high) / low) / np.log(high / low))


def _rate(space: SchemeSpace, x: float) -> float:
    """Between a small part of the platform's rate and all of it, evenly in its logarithm. [deg/s]"""
    return float(space.limits.rate / DEG * _SLOWEST ** (1.0 - x))


def _time(space: SchemeSpace, x: float) -> float:
    """Length of a dwell: from nothing to half the mission, short ones more likely. [s]"""
    return float(0.5 * space.duration * x**3)


def _stroke(space: SchemeSpace, x: float) -> float:
    """[deg]"""
    most = min(space.limits.angle / DEG, 360.0 * _MOST_TURNS)
    return float(_SHORTEST * (most / _SHORTEST) ** x) if most > _SHORTEST else float(most)


def _axis(space: SchemeSpace, choice: float, lean: FloatArray, sign: float = 1.0) -> Any:
    """Name of an axis, or a direction near it."""
    name = space.axes[int(choice)]
    if len(lean) == 0:
        return name if sign > 0.0 else (name[1:] if name.startswith("-") else f"-{name}")
    u = axis_vector(name)
    side = np.cross(u, np.eye(3)[int(np.argmin(np.abs(u)))])
    angle, phase = space.tilt * lean[0], 2.0 * np.pi * lean[1]
    across = np.cos(phase) * side + np.sin(phase) * np.cross(u, side)
    return tuple(float(v) for v in sign * (np.cos(angle) * u + np.sin(angle) * across / np.linalg.norm(across)))


def _continuous(space: SchemeSpace, v: FloatArray) -> Entries:
    axis = _axis(space, v[0], v[3:])
    rate = _rate(space, v[2]) * (1.0 if v[1] == 0.0 else -1.0)
    return {"type": "continuous", "axis": axis, "rate_deg_s": rate, **space.usual}


def _reciprocating(space: SchemeSpace, v: FloatArray) -> Entries:
    return {
        "type": "reciprocating", "axis": _axis(space, v[0], v[6:], 1.0 if v[1] == 0.0 else -1.0),
        "rate_deg_s": _rate(space, v[2]), "turn_deg": _stroke(space, v[3]), "dwell_s": _time(space, v[4]),
        "both_sides": bool(v[5]), **space.usual,
    }  # fmt: skip


def _carousel(space: SchemeSpace, v: FloatArray) -> Entries:
    return {
        "type": "carousel", "axis": _axis(space, v[0], v[3:]), "rate_deg_s": _rate(space, v[1]),
        "limit_deg": _stroke(space, v[2]), **space.usual,
    }  # fmt: skip


def _dwell(space: SchemeSpace, v: FloatArray) -> Entries:
    return {
        "type": "dwell", "axis": _axis(space, v[0], v[5:]), "positions": space.positions[int(v[1])],
        "rate_deg_s": _rate(space, v[2]), "dwell_s": _time(space, v[3]), "back": bool(v[4]), **space.usual,
    }  # fmt: skip


def _sequence(space: SchemeSpace, v: FloatArray) -> Entries:
    """Turns of up to a whole one either way, and dwells; the last one goes back where the angle is limited."""
    turns = 720.0 * v[2 : 2 + MOVES] - 360.0
    if not np.isinf(space.limits.angle):
        turns[-1] = -turns[:-1].sum()
    dwells = v[2 + MOVES : 2 + 2 * MOVES]
    moves = [{"axis": 0, "turn_deg": float(a), "dwell_s": _time(space, d)} for a, d in zip(turns, dwells, strict=True)]
    return {
        "type": "sequence", "axes": (_axis(space, v[0], v[2 + 2 * MOVES :]),), "rate_deg_s": _rate(space, v[1]),
        "moves": tuple(moves), **space.usual,
    }  # fmt: skip


def _dual_axis(space: SchemeSpace, v: FloatArray) -> Entries:
    return {
        "type": "dual_axis", "axes": _pairs(space)[int(v[0])], "positions": (4, 8, 16)[int(v[1])],
        "rate_deg_s": _rate(space, v[2]), "dwell_s": _time(space, v[3]), **space.usual,
    }  # fmt: skip


def _dual_order(space: SchemeSpace, v: FloatArray) -> Entries:
    """Half turns about two axes in any order, half a dwell first."""
    dwell = _time(space, v[2])
    moves = [{"axis": 0, "turn_deg": 0.0, "dwell_s": 0.5 * dwell}]
    for k, which in enumerate(v[3:]):
        turn = 180.0 if which < 2.0 else -180.0
        last = k == HALF_TURNS - 1
        moves.append({"axis": int(which) % 2, "turn_deg": turn, "dwell_s": 0.5 * dwell if last else dwell})
    return {
        "type": "sequence", "axes": _pairs(space)[int(v[0])], "rate_deg_s": _rate(space, v[1]), "moves": tuple(moves),
        **space.usual,
    }  # fmt: skip


def _pairs(space: SchemeSpace) -> list[tuple[str, str]]:
    """Perpendicular outer and inner axes."""
    return [
        (a, b) for a, b in permutations(space.axes, 2) if abs(float(axis_vector(a) @ axis_vector(b))) < 1e-9
    ]  # fmt: skip
