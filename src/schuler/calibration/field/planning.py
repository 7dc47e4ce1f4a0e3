"""Which move of a person takes off most uncertainty for its time: covariance of the calibration filter, run ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from schuler import rotation
from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.field.advice import Advice, CoachOptions, words_of_move, words_of_waiting
from schuler.calibration.field.foresight import Ahead, Standing, foresee
from schuler.calibration.field.steps import Axis, Rest, Routine, Step, Turn, Vector
from schuler.units import DEG

#: Share of the target at which a parameter counts as found: the calibration's own sigma may be 5 % larger.
SURE = 0.95
_AXES: tuple[Axis, ...] = ("x", "y", "z")
_SMALL = 100.0 * DEG  # turns by less are tried several times in a row
_FACTOR = 1.01  # a move that is not better than a simpler one by this is not advised in its place
_PROGRAMME_S = 10.0  # spacing at which the long programme is looked at
_HELPED = 0.8  # a parameter gains by a move that leaves less than this of its uncertainty


def advise(
    now: Standing,
    names: Sequence[str],
    coaching: CoachOptions,
    *,
    t: float = 0.0,
    elapsed: float = 0.0,
    rests: int = 1,
    moving: bool = False,
) -> Advice:
    """The next move from where the log stands.

    Parameters
    ----------
    now : Standing
    names : sequence of str
        Of the parameters.
    coaching : CoachOptions
    t, elapsed : float
        Time of the log and since its beginning, for the advice. [s]
    rests : int
    moving : bool
        The sensor does not stand as it stood in the last rest: it is told to rest.

    Returns
    -------
    Advice

    Notes
    -----
    Moves are compared by the sum over the parameters of ``ln(share / target)``, those at the target left out, that they
    take off in a second; share is 1-sigma over that before the log. It counts how many parameters are missing and how
    far off they are. Turns of up to 90 deg are looked at several times in a row, since one turn of an axis that has to
    become horizontal first tells nothing. A parameter is out of reach, and not counted, if the future that serves it
    best would need more than ``coaching.patience_s`` to the target; information (1 / share^2) grows in proportion to
    work.
    """
    share, target = now.share, SURE * coaching.target
    above = share >= target
    plans = _plans(coaching) if above.any() else []
    futures = [foresee(now, steps, _period(steps)) for steps in plans]
    far = above.copy()
    if plans:
        programme = foresee(now, _programme(now.C_nb, coaching), _PROGRAMME_S)
        far &= _time_needed(share, (*futures, programme), target) > coaching.patience_s
    left = above & ~far
    progress = _progress(share[~far], target)
    advice = Advice(
        t=t, elapsed=elapsed, share=dict(zip(names, share.tolist(), strict=True)),
        remaining={n: float(s) for n, s, k in zip(names, share, left, strict=True) if k},
        out_of_reach={n: float(s) for n, s, k in zip(names, share, far, strict=True) if k},
        progress=progress, turn=None, rest_s=0.0, next=words_of_waiting("done", coaching), gain=0.0,
        done=not left.any(), rests=rests, moving=moving,
    )  # fmt: skip
    if advice.done:
        return advice
    if moving:
        return replace(advice, rest_s=coaching.rest_s, next=words_of_waiting("moving", coaching))
    best = _best(share, futures, left, target)
    first, after = plans[best][0], futures[best].share[0]
    turn = first if isinstance(first, Turn) else None
    rest_s = coaching.rest_s if turn is not None else first.duration_s
    helped = [n for n, a, b, k in zip(names, share, after, left, strict=True) if k and b < _HELPED * a]
    words = words_of_move(turn, rest_s, now.C_nb, helped)
    return replace(advice, turn=turn, rest_s=rest_s, next=words, gain=_progress(after[~far], target) - progress)


def planned_routine(
    before: Standing, names: Sequence[str], coaching: CoachOptions | None = None, *, limit_s: float = 900.0
) -> Routine:
    """The routine that a coach would lead to, made in advance: for whoever cannot be coached live.

    Parameters
    ----------
    before : Standing
        Of :func:`schuler.calibration.field.foresight.standing_before`.
    names : sequence of str
        Of the parameters, see :func:`schuler.calibration.field.setup.parameter_names`.
    coaching : CoachOptions, optional
    limit_s : float
        It ends here at the latest. [s]

    Returns
    -------
    Routine
        Rests as long as asked for plus the time of reaction.
    """
    coaching = coaching or CoachOptions()
    steps: list[Step] = [Rest(coaching.first_rest_s)]
    now, t = foresee(before, steps).standing, coaching.first_rest_s
    while t < limit_s:
        advice = advise(now, names, coaching)
        if advice.done:
            break
        rest = Rest(advice.rest_s + (coaching.reaction_s if advice.turn is not None else 0.0))
        more: list[Step] = [rest] if advice.turn is None else [advice.turn, rest]
        now, t = foresee(now, more).standing, t + sum(step.duration_s for step in more)
        steps += more
    return Routine(tuple(steps), tuple(rotation.rpy_from_dcm(before.C_nb).tolist()))


def _time_needed(share: FloatArray, futures: Sequence[Ahead], target: float) -> FloatArray:
    """Time that each parameter would take to the target if all work were for it, shape (p,). [s]

    Information, 1 / share^2, grows in proportion to the work, at the rate of the future that serves it best.
    """
    rate, known = np.full(len(share), 1e-300), _information(share)
    for ahead in futures:
        rate = np.maximum(rate, np.max((_information(ahead.share) - known) / ahead.t[:, None], axis=0))
    return np.asarray(np.maximum(1.0 / target**2 - known, 0.0) / rate)


def _information(share: FloatArray) -> FloatArray:
    return np.asarray(1.0 / np.maximum(share, 1e-12) ** 2)


def _best(share: FloatArray, futures: Sequence[Ahead], left: BoolArray, target: float) -> int:
    """Number of the future that takes off most for its time, at the best of its rests; of equals the first."""
    before = missing(share[left], target)
    best, highest = 0, -np.inf
    for k, ahead in enumerate(futures):
        rate = float(np.max((before - missing(ahead.share[:, left], target)) / ahead.t))
        if rate > _FACTOR * max(highest, 0.0):
            best, highest = k, rate
    return best


def _plans(coaching: CoachOptions) -> list[tuple[Step, ...]]:
    """Sequences of equal moves to choose from, the simplest first."""
    rest = Rest(coaching.rest_s + coaching.reaction_s)
    plans: list[tuple[Step, ...]] = [(Rest(coaching.first_rest_s),)]
    for angle, axis, way in product(sorted(coaching.angles), _AXES, (1.0, -1.0)):
        turn = Turn(axis, way * angle, angle / coaching.turn_rate)
        plans.append((turn, rest) * (coaching.ahead if angle < _SMALL else 1))
    return plans


def _period(steps: tuple[Step, ...]) -> float:
    """Time from rest to rest in equal moves."""
    return sum(step.duration_s for step in steps[:2])


def _programme(C_nb: FloatArray, coaching: CoachOptions) -> tuple[Step, ...]:
    """Every axis turned while it is horizontal, from any attitude: 8 rests 45 deg apart, and a full turn."""
    rest = Rest(coaching.rest_s + coaching.reaction_s)

    def turn(axis: Axis | Vector, angle: float) -> tuple[Step, ...]:
        return (Turn(axis, angle, abs(angle) / coaching.turn_rate), rest)

    down = C_nb[2]
    angle = float(np.arccos(np.clip(down[2], -1.0, 1.0)))
    steps: tuple[Step, ...] = ()
    if angle > 0.1:  # to level: turn z to where down is
        x, y = -down[1], down[0]
        steps = turn((float(x), float(y), 0.0) if np.hypot(x, y) > 1e-6 else "x", angle)
    x_circle, y_circle, z_circle = (turn(axis, 45.0 * DEG) * 8 + turn(axis, 360.0 * DEG) for axis in _AXES)
    return steps + x_circle + y_circle + turn("y", 90.0 * DEG) + z_circle


def _progress(share: FloatArray, target: float) -> float:
    """Mean share of the way to the target that is gone, 0 to 1, in the logarithm."""
    gone = np.log(np.clip(share, target, 1.0)) / np.log(target)
    return float(gone.mean()) if len(share) else 1.0


def missing(share: FloatArray, target: float) -> FloatArray:
    """Sum of ln(share / target) over what is above the target, the last axis."""
    return np.asarray(np.sum(np.log(np.maximum(share / target, 1.0)), axis=-1))
