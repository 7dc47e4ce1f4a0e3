"""Choice of the next move: the one that reduces most uncertainty for its time, by predicted covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from schuler import rotation
from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.field.advice import Advice, move_sentence, waiting_sentence
from schuler.calibration.field.covariance_prediction import CovarianceState, PredictedCovariance, predict_covariance
from schuler.calibration.field.options import CoachOptions
from schuler.simulation.steps import Axis, Rest, Routine, Step, Turn, Vector
from schuler.units import DEG

#: Share of the target at which a parameter counts as calibrated: the calibration's own sigma may be 5 % larger.
TARGET_MARGIN = 0.95
_AXES: tuple[Axis, ...] = ("x", "y", "z")
_SMALL = 100.0 * DEG  # turns by less are compared several times in a row
_FACTOR = 1.01  # factor by which a move must be better than a simpler one
_PROGRAMME_S = 10.0  # spacing at which the long programme is evaluated
_HELPED = 0.8  # share of its uncertainty below which a parameter gains by a move


def advise(
    state: CovarianceState,
    names: Sequence[str],
    coaching: CoachOptions,
    *,
    t: float = 0.0,
    elapsed: float = 0.0,
    rests: int = 1,
    moving: bool = False,
) -> Advice:
    """The next move after a log.

    Parameters
    ----------
    state : CovarianceState
        Attitude and covariance after the log.
    names : sequence of str
        Names of the parameters.
    coaching : CoachOptions
    t, elapsed : float
        Time of the log and since its beginning, for the advice. [s]
    rests : int
    moving : bool
        The sensor has left the pose of the last rest: the advice is to rest.

    Returns
    -------
    Advice

    Notes
    -----
    Moves are compared by the reduction per second of the sum of ``ln(share / target)`` over the parameters above the
    target; share is 1-sigma over that before the log. Turns of up to 90 deg are compared several times in a row, since
    one turn of an axis that has to become horizontal first gives no information. A parameter is out of reach, and not
    counted, if the prediction that serves it best would need more than ``coaching.patience_s`` to the target;
    information (1 / share^2) grows in proportion to time.
    """
    share, target = state.share, TARGET_MARGIN * coaching.target
    above = share >= target
    plans = _candidates(coaching) if above.any() else []
    predictions = [predict_covariance(state, steps, _period(steps)) for steps in plans]
    far = above.copy()
    if plans:
        programme = predict_covariance(state, _programme(state.C_nb, coaching), _PROGRAMME_S)
        far &= _time_needed(share, (*predictions, programme), target) > coaching.patience_s
    remaining = above & ~far
    progress = _progress(share[~far], target)
    advice = Advice(
        t=t, elapsed=elapsed, share=dict(zip(names, share.tolist(), strict=True)),
        remaining={n: float(s) for n, s, k in zip(names, share, remaining, strict=True) if k},
        out_of_reach={n: float(s) for n, s, k in zip(names, share, far, strict=True) if k},
        progress=progress, turn=None, rest_s=0.0, next=waiting_sentence("done", coaching), gain=0.0,
        done=not remaining.any(), rests=rests, moving=moving,
    )  # fmt: skip
    if advice.done:
        return advice
    if moving:
        return replace(advice, rest_s=coaching.rest_s, next=waiting_sentence("moving", coaching))
    best = _best(share, predictions, remaining, target)
    first, after = plans[best][0], predictions[best].share[0]
    turn = first if isinstance(first, Turn) else None
    rest_s = coaching.rest_s if turn is not None else first.duration_s
    helped = [n for n, a, b, k in zip(names, share, after, remaining, strict=True) if k and b < _HELPED * a]
    words = move_sentence(turn, rest_s, state.C_nb, helped)
    return replace(advice, turn=turn, rest_s=rest_s, next=words, gain=_progress(after[~far], target) - progress)


def planned_routine(
    before: CovarianceState, names: Sequence[str], coaching: CoachOptions | None = None, *, limit_s: float = 900.0
) -> Routine:
    """Routine of the advice of a coach, computed in advance.

    Parameters
    ----------
    before : CovarianceState
        From :func:`schuler.calibration.field.covariance_prediction.initial_covariance`.
    names : sequence of str
        Names of the parameters, see :func:`schuler.calibration.field.problem.parameter_names`.
    coaching : CoachOptions, optional
    limit_s : float
        Largest duration. [s]

    Returns
    -------
    Routine
        Rests of the advised length plus the time of reaction.
    """
    coaching = coaching or CoachOptions()
    steps: list[Step] = [Rest(coaching.first_rest_s)]
    state, t = predict_covariance(before, steps).state, coaching.first_rest_s
    while t < limit_s:
        advice = advise(state, names, coaching)
        if advice.done:
            break
        rest = Rest(advice.rest_s + (coaching.reaction_s if advice.turn is not None else 0.0))
        move: list[Step] = [rest] if advice.turn is None else [advice.turn, rest]
        state, t = predict_covariance(state, move).state, t + sum(step.duration_s for step in move)
        steps += move
    return Routine(tuple(steps), tuple(rotation.rpy_from_dcm(before.C_nb).tolist()))


def _time_needed(share: FloatArray, predictions: Sequence[PredictedCovariance], target: float) -> FloatArray:
    """Time to the target of each parameter at the best rate of the predictions, shape (p,). [s]

    Information, 1 / share^2, grows in proportion to time.
    """
    rate, information = np.full(len(share), 1e-300), _information(share)
    for prediction in predictions:
        rate = np.maximum(rate, np.max((_information(prediction.share) - information) / prediction.t[:, None], axis=0))
    return np.asarray(np.maximum(1.0 / target**2 - information, 0.0) / rate)


def _information(share: FloatArray) -> FloatArray:
    return np.asarray(1.0 / np.maximum(share, 1e-12) ** 2)


def _best(share: FloatArray, predictions: Sequence[PredictedCovariance], remaining: BoolArray, target: float) -> int:
    """Index of the prediction of the largest reduction per second, at the best of its rests; of equals the first."""
    before = log_excess(share[remaining], target)
    best, highest = 0, -np.inf
    for k, prediction in enumerate(predictions):
        rate = float(np.max((before - log_excess(prediction.share[:, remaining], target)) / prediction.t))
        if rate > _FACTOR * max(highest, 0.0):
            best, highest = k, rate
    return best


def _candidates(coaching: CoachOptions) -> list[tuple[Step, ...]]:
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
    """Turns about every axis while it is horizontal, from any attitude: 8 rests 45 deg apart, and a full turn."""
    rest = Rest(coaching.rest_s + coaching.reaction_s)

    def turn(axis: Axis | Vector, angle: float) -> tuple[Step, ...]:
        return (Turn(axis, angle, abs(angle) / coaching.turn_rate), rest)

    down = C_nb[2]
    angle = float(np.arccos(np.clip(down[2], -1.0, 1.0)))
    steps: tuple[Step, ...] = ()
    if angle > 0.1:  # level: turn z down
        x, y = -down[1], down[0]
        steps = turn((float(x), float(y), 0.0) if np.hypot(x, y) > 1e-6 else "x", angle)
    x_circle, y_circle, z_circle = (turn(axis, 45.0 * DEG) * 8 + turn(axis, 360.0 * DEG) for axis in _AXES)
    return steps + x_circle + y_circle + turn("y", 90.0 * DEG) + z_circle


def _progress(share: FloatArray, target: float) -> float:
    """Mean share of the way to the target, 0 to 1, in the logarithm."""
    done = np.log(np.clip(share, target, 1.0)) / np.log(target)
    return float(done.mean()) if len(share) else 1.0


def log_excess(share: FloatArray, target: float) -> FloatArray:
    """Sum of ln(share / target) over the parameters above the target, the last axis."""
    return np.asarray(np.sum(np.log(np.maximum(share / target, 1.0)), axis=-1))
