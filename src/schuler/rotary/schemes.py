"""Rotation schemes: continuous, reciprocating, dwelling at positions, about one axis or two, limited by a cable.

Axes are of the body (forward, right, down), see :func:`schuler.rotary.gimbals.axis_vector`; a positive angle is
right-handed about its axis. Every scheme may begin with a ``start`` at rest and obeys a limit of acceleration; without
one the rate jumps, as in the analyses of the literature.

References
----------
Du (2015), sections 1.2 and 3.2; Levinson and Majure (1987); Ishibashi et al. (2006); Sun et al. (2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from schuler.arrays import ArrayLike
from schuler.exceptions import InputError
from schuler.rotary.gimbals import axis_vector
from schuler.rotary.profiles import AngleProfile, Piece, check_positive, profile_of, profile_of_rates, turn_pieces
from schuler.rotary.schedule import Schedule, stacked

_TURN = 2.0 * np.pi
Axis = str | ArrayLike


#: Half turns about the outer and the inner axis, capital letters backwards.
_ORDERS = {4: "oiOI", 8: "oIOOioIi", 16: "oiIOioOIIOoiOIio"}


class Move(NamedTuple):
    """One step of a sequence: turn one axis, then dwell.

    Attributes
    ----------
    axis : int
        Which axis of the platform; 0 is the outermost.
    turn : float
        Signed angle. [rad]
    dwell : float
        Rest after it. [s]
    """

    axis: int
    turn: float
    dwell: float = 0.0


def fixed(axis: Axis = "z", angle: float = 0.0) -> Schedule:
    """No rotation: the conventional IMU, or a gimbal clamped at an angle. [rad]"""
    return _single(axis, profile_of([Piece(np.inf, 0.0, 0.0)], angle=angle), "conventional" if angle == 0.0 else "")


def continuous(
    axis: Axis, rate: float, *, acceleration: float | None = None, start: float = 0.0, angle: float = 0.0
) -> Schedule:
    """Rotation in one sense for ever.

    Parameters
    ----------
    axis : str or array_like, shape (3,)
        See :func:`schuler.rotary.gimbals.axis_vector`.
    rate : float
        Signed; zero does not turn. [rad/s]
    acceleration : float, optional
        Acceleration of the run-up. [rad/s^2]
    start : float
        At rest before it. [s]
    angle : float
        At the start. [rad]

    Returns
    -------
    Schedule
    """
    if not np.isfinite(rate):
        raise InputError(f"rate: expected a finite number, got {rate!r}")
    pieces = [Piece(np.inf, rate, 0.0)]
    if acceleration is not None and rate != 0.0:
        check_positive(acceleration, "acceleration")
        pieces.insert(0, Piece(abs(rate) / acceleration, 0.0, float(np.sign(rate)) * acceleration))
    return _single(axis, profile_of(pieces, angle=angle), "continuous").delayed(start)


def reciprocating(
    axis: Axis,
    rate: float,
    *,
    turn: float = _TURN,
    both_sides: bool = False,
    dwell: float = 0.0,
    acceleration: float | None = None,
    start: float = 0.0,
    angle: float = 0.0,
) -> Schedule:
    """Turn there and back, for ever: what a scale factor adds on the way is taken off on the way back.

    Parameters
    ----------
    axis, acceleration, start, angle
        See :func:`continuous`.
    rate : float
        Largest rate, positive. [rad/s]
    turn : float
        Signed angle of one stroke; a whole turn unless said. [rad]
    both_sides : bool
        To ``+turn``, back, to ``-turn``, back; else always to ``+turn``.
    dwell : float
        Rest at each reversal. [s]
    """
    moves = [Move(0, turn, dwell), Move(0, -turn, dwell)]
    if both_sides:
        moves += [Move(0, -turn, dwell), Move(0, turn, dwell)]
    return sequence(
        [axis], moves, rate=rate, acceleration=acceleration, start=start, angles=[angle], name="reciprocating"
    )


def carousel(
    axis: Axis, rate: float, *, limit: float, acceleration: float | None = None, start: float = 0.0
) -> Schedule:
    """Sweep between ``+limit`` and ``-limit`` for ever, from zero: for a cable instead of a slip ring.

    Parameters
    ----------
    axis, acceleration, start
        See :func:`continuous`.
    rate : float
        Largest rate, positive. [rad/s]
    limit : float
        Largest angle either way, positive; may be many turns. [rad]
    """
    check_positive(limit, "limit")
    moves = [Move(0, limit), Move(0, -2.0 * limit), Move(0, limit)]
    # strokes through zero are made in one go: the stop at zero of the moves is cut out
    pieces = turn_pieces(2.0 * limit, rate, acceleration)
    if acceleration is None:
        return sequence([axis], moves, rate=rate, start=start, name="carousel")
    first = profile_of(turn_pieces(limit, rate, acceleration), angle=0.0)
    back = [Piece(p.duration, -p.rate, -p.acceleration) for p in pieces]
    cyclic = profile_of([*back, *pieces], angle=limit, repeat=True)
    t_first = float(first.start[-1])
    profile = AngleProfile(
        np.concatenate((first.start[:-1], cyclic.start + t_first)),
        np.concatenate((first.angle[:-1], cyclic.angle)),
        np.concatenate((first.rate[:-1], cyclic.rate)),
        np.concatenate((first.acceleration[:-1], cyclic.acceleration)),
        (t_first, t_first + cyclic.cycle[1]) if cyclic.cycle else None,
    )
    return _single(axis, profile, "carousel").delayed(start)


def dwell(
    axis: Axis,
    positions: int | Sequence[float] = 4,
    *,
    dwell: float,
    rate: float,
    back: bool = True,
    acceleration: float | None = None,
    start: float = 0.0,
) -> Schedule:
    """Rest at positions about one axis.

    Parameters
    ----------
    axis, acceleration, start
        See :func:`continuous`.
    positions : int or sequence of float
        Number of even positions round the circle (2, 4, 8, 16, ...), or the angles themselves in the order they are
        visited, over and over. [rad]
    dwell : float
        Rest at each. [s]
    rate : float
        Largest rate between them, positive. [rad/s]
    back : bool
        For a number of positions: a whole turn forwards, position by position, then a whole turn backwards, each
        position visited twice. Else always forwards.

    Notes
    -----
    Time is the same at all even positions, so that biases across the axis cancel over a cycle; with ``back`` what a
    scale factor adds is taken off as well.
    """
    if isinstance(positions, int):
        if positions < 2:
            raise InputError(f"positions: expected at least two, got {positions}")
        moves = [Move(0, _TURN / positions, dwell)] * positions
        if back:
            moves += [Move(0, -_TURN / positions, dwell)] * positions
        first, name = 0.0, f"{positions} positions"
    else:
        angles = np.asarray(positions, dtype=np.float64)
        if angles.ndim != 1 or len(angles) < 2 or not np.isfinite(angles).all():
            raise InputError(f"positions: expected at least two angles, got {positions!r}")
        moves = [Move(0, float(b - a), dwell) for a, b in zip(angles, np.roll(angles, -1), strict=True)]
        first, name = float(angles[0]), f"{len(angles)} positions"
    return sequence([axis], moves, rate=rate, acceleration=acceleration, start=start, angles=[first], name=name)


def dual_axis(
    positions: int = 8,
    *,
    dwell: float,
    rate: float,
    outer: Axis = "x",
    inner: Axis = "z",
    acceleration: float | None = None,
    start: float = 0.0,
) -> Schedule:
    """Half turns about two axes in turn, so that every sensor points each way for the same time.

    Parameters
    ----------
    positions : {4, 8, 16}
        Half turns in a cycle.
    dwell : float
        Rest after each. [s]
    rate : float
        Largest rate, positive. [rad/s]
    outer, inner : str or array_like, shape (3,)
        Perpendicular axes.
    acceleration, start
        See :func:`continuous`.

    Raises
    ------
    InputError
        If the number is another or the axes are not perpendicular.

    Notes
    -----
    The four attitudes reached by half turns about two perpendicular axes sum to zero, and so do the turns about either
    axis: biases in the dwells and scale factors cancel over a cycle. What is left depends on the order. On the way half
    a circle may be passed twice, then biases during the moves do not cancel; and installation errors tilt the IMU at
    every half turn. Four positions, ``+o +i -o -i``, leave both. The orders of eight and sixteen were found by trying
    all closed sequences of eight half turns, and pairs of them, see :func:`schuler.rotary.modulated_errors.residue`.
    Eight leave no mean rate of error from installation (from biases that of the moves: no eight leave neither); sixteen
    leave none from either and, for 30 deg/h and 2e-3, the smallest mean tilt within half a turn of zero. All begin in
    the middle of a dwell. Literature has several orders under the same numbers (Yuan et al. 2012; Sun 2011), which
    these are not; others go into :func:`sequence`.
    """
    if positions not in (4, 8, 16):
        raise InputError(f"positions: expected 4, 8 or 16 half turns, got {positions}; use sequence for another order")
    if abs(float(axis_vector(outer) @ axis_vector(inner))) > 1e-9:
        raise InputError("expected perpendicular axes; use sequence for others")
    order = [(0 if m in "oO" else 1, 1.0 if m in "oi" else -1.0) for m in _ORDERS[positions]]
    moves = [Move(0, 0.0, 0.5 * dwell), *(Move(k, 0.5 * _TURN * s, dwell) for k, s in order[:-1])]
    moves.append(Move(order[-1][0], 0.5 * _TURN * order[-1][1], 0.5 * dwell))
    return sequence(
        [outer, inner], moves, rate=rate, acceleration=acceleration, start=start, name=f"dual axis, {positions}"
    )


def sequence(
    axes: Sequence[Axis],
    moves: Sequence[Move | tuple[int, float, float]],
    *,
    rate: float,
    acceleration: float | None = None,
    start: float = 0.0,
    angles: Sequence[float] | None = None,
    repeat: bool = True,
    name: str = "sequence",
) -> Schedule:
    """Any moves of one axis at a time.

    Parameters
    ----------
    axes : sequence of str or array_like
        Outermost first.
    moves : sequence of Move
        Or tuples of axis number, turn [rad], dwell [s].
    rate, acceleration
        Limits of every move. [rad/s], [rad/s^2]
    start : float
        At rest before the first move. [s]
    angles : sequence of float, optional
        At the start, one for each axis; default zero. [rad]
    repeat : bool
        All over again for ever; without it the platform stands still at the end.

    Raises
    ------
    InputError
        If there is no move, a move names no axis, or the whole takes no time.
    """
    first = [0.0] * len(axes) if angles is None else list(angles)
    if not moves or len(first) != len(axes):
        raise InputError(f"expected moves and one starting angle for each of {len(axes)} axes")
    pieces: list[list[Piece]] = [[] for _ in axes]
    for axis, turn, rest in (Move(*m) for m in moves):
        if not (0 <= axis < len(axes)) or not np.isfinite(turn) or not rest >= 0.0:
            raise InputError(
                f"a move needs an axis 0..{len(axes) - 1}, a finite turn and a dwell >= 0, got {axis}, {turn}, {rest}"
            )
        ramp = turn_pieces(turn, rate, acceleration)
        took = sum(p.duration for p in ramp)
        for k, own in enumerate(pieces):
            own += [*ramp, Piece(rest, 0.0, 0.0)] if k == axis else [Piece(took + rest, 0.0, 0.0)]
    profiles = tuple(profile_of(p, angle=a, repeat=repeat) for p, a in zip(pieces, first, strict=True))
    return Schedule(np.stack([axis_vector(a) for a in axes]), profiles, name=name).delayed(start)


def from_rates(
    axis: Axis, t: ArrayLike, rate: ArrayLike, *, repeat: bool = False, start: float = 0.0, angle: float = 0.0
) -> Schedule:
    """A rate that is linear between nodes (k,), see :func:`schuler.rotary.profiles.profile_of_rates`."""
    return _single(axis, profile_of_rates(t, rate, angle=angle, repeat=repeat), "rates").delayed(start)


def tilted(schedule: Schedule, axis: Axis, angle: float) -> Schedule:
    """A schedule whose axes are themselves tilted by a clamped outer gimbal, e.g. for observability of a Z rotation.

    Parameters
    ----------
    schedule : Schedule
    axis : str or array_like, shape (3,)
        Axis of the outer gimbal.
    angle : float
        [rad]
    """
    return stacked(fixed(axis, angle), schedule, name=schedule.name)


def _single(axis: Axis, profile: AngleProfile, name: str) -> Schedule:
    return Schedule(axis_vector(axis)[None], (profile,), name=name)
