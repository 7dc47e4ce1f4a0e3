"""Time offset of GNSS stamps that nobody stated: estimated where the fixes of a log show it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.engine import ForwardRun, unpack_symmetric
from schuler.filtering.measurements import POSITION, VELOCITY
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.likelihood import Residuals, residuals_of, trials
from schuler.navigation.tuning.noise import TUNING_KINDS, WHITE, with_factors
from schuler.navigation.tuning.start import with_smoothed_start
from schuler.navigation.tuning.tuning import first_part, fixes_of
from schuler.timebase import SAME_TIME

_SIGMA_S = 0.3
_STARTS_S = (-0.4, -0.2, 0.0, 0.2, 0.4)  # offsets that the search begins at
_LIKELY = 3.0  # 1-sigma by which one beside a lever arm is estimated with it
_CLOSE_S = 0.06  # between those of its second set
# Factors on the IMU's white noise and on sigmas of fixes that an offset is judged beside, since noise as stated may be
# too small, and noise tuned without the offset has taken it in.
_NOISES = [
    {**dict.fromkeys(WHITE, white), **dict.fromkeys(("position", "height", "velocity", "climb"), fixes)}
    for white in (1.0, 4.0, 16.0, 0.3)
    for fixes in (1.0, 4.0)
]
_APART = 25.0  # normalised square of an estimate that is not zero: chi-square of one degree of freedom, 5 sigma
_LEFT_S = 0.01  # offset that the filter's linear model carries to a millimetre [s]
_MOST_S = 2.0  # that fixes are moved by
_ROUNDS = 4
_SAME_S = 0.1  # change of an offset that tuned noise makes; a larger one is that of a run that went astray [s]

_SUSPECTED = 9.0  # the same of one that is looked at although innovations fit the noise
_BORNE_OUT = 3.0  # log likelihood by which positions alone favour the offset over none

#: Opening of the note on a run that estimates it.
DELAY_ESTIMATED = "GNSS stamps"


def with_delay(config: NavigationConfig, sigma_s: float = _SIGMA_S) -> NavigationConfig:
    """The configuration with a time offset of GNSS stamps that is estimated."""
    return config.model_copy(update={"gnss": config.gnss.model_copy(update={"delay_sigma_s": sigma_s})})


def may_have_delay(config: NavigationConfig, prepared: PreparedRun) -> bool:
    """Whether a time offset is neither stated nor estimated, and positions could show it."""
    stated = "delay_sigma_s" in config.gnss.model_fields_set or "clock_shift_s" in config.imu.model_fields_set
    return bool(not stated and config.gnss.coupling == "loose" and np.any(prepared.schedule.kind == POSITION))


class Evidence(NamedTuple):
    """Innovations of all fixes under a model, and factors on the noise beside which they are likeliest."""

    innovations: Residuals
    factors: dict[str, float]

    @property
    def loss(self) -> float:
        """Negative log likelihood; differences count."""
        return _loss(self.innovations)


def evidences(runs: Sequence[PreparedRun], noises: Sequence[Mapping[str, float]] = tuple(_NOISES)) -> list[Evidence]:
    """Evidence of several models of one log.

    Parameters
    ----------
    runs : sequence of PreparedRun
        Of the same measurements; fixes may be taken later than their stamps.
    noises : sequence of mapping
        Factors on the noise of each, of which the likeliest counts.

    Notes
    -----
    Fixes thinned to 1, 4 and 15 s and predicted one after the other: that is the evidence of a model, what its further
    states cost included. Each counts at the noise that is likeliest for it, of a few.
    """
    runs = _alike([_on_stamps(with_smoothed_start(first_part(run))) for run in runs])
    judge = residuals_of(trials(runs[0], fixes_of(runs[0]), phases=1))
    return [
        min((Evidence(judge(with_factors(run, f)), dict(f)) for f in noises), key=lambda evidence: evidence.loss)
        for run in runs
    ]


class Offset(NamedTuple):
    """Time by which fixes are likeliest to be later than their stamps, and its 1-sigma. [s]"""

    later_s: float
    sigma_s: float

    @property
    def is_apart(self) -> bool:
        """Whether it is far from zero."""
        return abs(self.later_s) > _LIKELY * self.sigma_s

    def beside(self, sigma_s: float) -> Offset:
        """With the statement that there is none, of so much 1-sigma. [s]"""
        share = sigma_s**2 / (sigma_s**2 + self.sigma_s**2)
        return Offset(share * self.later_s, share**0.5 * self.sigma_s)


def likeliest_offset(prepare: Callable[[float], PreparedRun]) -> Offset:
    """Time offset of fixes at which they are likeliest, searched from several places.

    Parameters
    ----------
    prepare : callable
        Makes the run ready with fixes so much later, without an offset that is estimated. [s]

    Notes
    -----
    A filter that estimates the offset, above all beside a lever arm, stays near where it began: what its first seconds
    make of attitude and velocity it takes for known. Runs with fixes moved by a few offsets have a likelihood each;
    a parabola through the best of them begins a second, closer set. The 1-sigma has the curvature of the likelihood
    and the offsets of the first set that it does not exclude.
    """
    coarse = np.array(_STARTS_S)
    losses = _losses(coarse, prepare, _NOISES)
    best = int(np.argmin(losses))
    while best in (0, len(coarse) - 1) and abs(coarse[best]) < _MOST_S:
        coarse = coarse[best] + np.array(_STARTS_S)
        losses = _losses(coarse, prepare, _NOISES)
        best = int(np.argmin(losses))
    best = int(np.clip(best, 1, len(coarse) - 2))
    weight = np.exp(-np.minimum(losses - losses[best], 700.0))
    weight[[best - 1, best + 1]] = 0.0  # the parabola has those beside it
    apart = float(np.sum(weight * (coarse - coarse[best]) ** 2) / np.sum(weight))
    near = offset_near(_vertex(coarse, losses)[0], prepare, _NOISES)
    return Offset(near.later_s, float(np.hypot(near.sigma_s, np.sqrt(apart))))


def offset_near(
    later_s: float, prepare: Callable[[float], PreparedRun], noises: Sequence[Mapping[str, float]] = ({},)
) -> Offset:
    """Time offset of fixes at which they are likeliest, near another; see :func:`likeliest_offset`. [s]"""
    close = later_s + _CLOSE_S * np.array([-1.0, 0.0, 1.0])
    later, curvature = _vertex(close, _losses(close, prepare, noises))
    return Offset(later, float(np.hypot(_LEFT_S, curvature**-0.5)))


def _losses(
    laters: FloatArray, prepare: Callable[[float], PreparedRun], noises: Sequence[Mapping[str, float]]
) -> FloatArray:
    """Negative log likelihood of fixes that are later by so much; differences count."""
    return np.array([evidence.loss for evidence in evidences([prepare(float(later)) for later in laters], noises)])


def _vertex(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Minimum of the parabola through the smallest of equidistant points and its neighbours, and its curvature."""
    k = int(np.clip(np.argmin(y), 1, len(x) - 2))
    step = x[k + 1] - x[k]
    slope, curvature = (y[k + 1] - y[k - 1]) / (2.0 * step), (y[k + 1] - 2.0 * y[k] + y[k - 1]) / step**2
    if not (np.isfinite(slope) and curvature > 0.0):
        return float(x[int(np.argmin(y))]), float(step**-2)
    return float(x[k] - np.clip(slope / curvature, -step, step)), float(curvature)


def _on_stamps(run: PreparedRun) -> PreparedRun:
    """The run on the clock of its fixes, with these alone."""
    run = on_clock_of_fixes(run)
    return replace(run, schedule=run.schedule.where(np.isin(run.schedule.kind, TUNING_KINDS)))


def on_clock_of_fixes(run: PreparedRun) -> PreparedRun:
    """The run with its IMU earlier by the time by which its fixes are taken later than their stamps."""
    later, nav = run.fixes_later_s, run.initial.nav
    return replace(
        run,
        imu=run.imu.shifted(-later),
        increments=run.increments.shifted(-later),
        schedule=replace(run.schedule, t=run.schedule.t - later),
        initial=replace(run.initial, nav=replace(nav, t=nav.t - later)),
        fixes_later_s=0.0,
    )


def _alike(runs: Sequence[PreparedRun]) -> list[PreparedRun]:
    """The runs with the fixes that all of them have, after the start and before the end of all."""
    first, last = max(run.initial.nav.t for run in runs), min(run.increments.t[-1] for run in runs)
    keys = [
        np.rint(run.schedule.t / SAME_TIME).astype(np.int64) * (TUNING_KINDS[-1] + 1) + run.schedule.kind
        for run in runs
    ]
    within = [(run.schedule.t > first + SAME_TIME) & (run.schedule.t < last - SAME_TIME) for run in runs]
    common = functools.reduce(np.intersect1d, [key[inside] for key, inside in zip(keys, within, strict=True)])
    return [
        replace(run, schedule=run.schedule.where(np.isin(key, common))) for run, key in zip(runs, keys, strict=True)
    ]


def _loss(innovations: Residuals) -> float:
    loss = float(innovations.scores().sum())
    return loss if np.isfinite(loss) else np.inf


def is_suspected(run: PreparedRun) -> bool:
    """Whether the first part of a run that estimates a time offset ends with one that may not be zero."""
    return _square(first_part(run)) > _SUSPECTED


def is_apart(run: PreparedRun) -> bool:
    """Whether a run that estimates a time offset ends with one far from zero."""
    return _square(run) > _APART


def _square(run: PreparedRun) -> float:
    """Square of the time offset that a run estimates, over its variance."""
    delay, sigma = delay_of(run)
    return (delay / sigma) ** 2


def delay_of(run: PreparedRun) -> tuple[float, float]:
    """Time offset at the end of a run that keeps nothing to smooth over, and its 1-sigma. [s]"""
    options = replace(run.options, smoother=False)
    return delay_at_end(replace(run, options=options).run(), run)


def is_same(run: PreparedRun, other: PreparedRun) -> bool:
    """Whether a run ends with the time offset by which the fixes of another one were moved."""
    return abs(delay_of(other)[0] - run.fixes_later_s) < _SAME_S


def is_borne_out(run: PreparedRun) -> bool:
    """Whether positions alone favour the time offset that a run estimates.

    Velocities that a receiver filtered are late by themselves, and would take positions with them.
    """
    if not np.any(run.schedule.kind == VELOCITY):
        return True
    delay, other, sigma = _beside_positions(run)
    return bool((other**2 - (other - delay) ** 2) / (2.0 * sigma**2) > _BORNE_OUT and _agree(delay, other, sigma))


def is_not_contradicted(run: PreparedRun) -> bool:
    """Whether positions alone tell no other time offset than the one that a run estimates."""
    return not np.any(run.schedule.kind == VELOCITY) or _agree(*_beside_positions(run))


def _beside_positions(run: PreparedRun) -> tuple[float, float, float]:
    """Time offset that a run estimates, the one by its positions alone, and the 1-sigma of that. [s]"""
    alone = replace(run, schedule=run.schedule.where(run.schedule.kind != VELOCITY))
    return delay_of(run)[0], *delay_of(alone)


def _agree(delay: float, other: float, sigma: float) -> bool:
    return bool(abs(other - delay) < max(4.0 * sigma, 0.25 * abs(delay)))


def placed(
    run: PreparedRun, prepare: Callable[[float], PreparedRun], factors: Mapping[str, float] | None = None
) -> PreparedRun:
    """The run with fixes taken later than their stamps by the offset that it estimates, so that little is left.

    Parameters
    ----------
    run : PreparedRun
        Estimates a time offset.
    prepare : callable
        Makes the run ready with fixes so much later. [s]
    factors : mapping of str to float, optional
        On the noise beside which it is estimated.

    Notes
    -----
    Fixes are those of a motion of constant velocity over the offset in the filter, which is wrong by half the
    acceleration times its square: 0.2 m after 0.5 s.
    """
    for _ in range(_ROUNDS):
        noisy = with_smoothed_start(with_factors(run, factors or {}))
        delay, _ = delay_of(noisy)
        later = float(np.clip(delay, -_MOST_S, _MOST_S))
        if abs(later - run.fixes_later_s) < _LEFT_S:
            break
        run = prepare(later)
    return run


def delay_at_end(forward: ForwardRun, run: PreparedRun) -> tuple[float, float]:
    """Time by which fixes are later than their stamps at the end of a run that estimates it, and its 1-sigma. [s]"""
    at = run.layout["delay"].start
    P = unpack_symmetric(forward.rec_P[-1:], run.layout.size)[0]
    return run.fixes_later_s + float(forward.rec_est[-1, at - 9]), float(np.sqrt(P[at, at]))


def delay_note(delay: float, sigma: float) -> str:
    """Note on a time offset that is estimated, and how to state it. [s]"""
    side = "late" if delay < 0.0 else "early"
    return (
        f"{DELAY_ESTIMATED} are {abs(delay):.3f} +- {sigma:.3f} s {side} against the IMU's, which nobody stated: the "
        f"offset is estimated, and the solution has the IMU's times; imu.clock_shift_s = {-delay:.3f} states it and "
        "gives those of GNSS"
    )


def shift_note(before: float, shift: float, sigma: float) -> str:
    """Note on a clock shift that was uncertain, and is estimated beside a lever arm. [s]"""
    return (
        f"the IMU's stamps are shifted by {shift:+.3f} +- {sigma:.3f} s (stated: {before:+.3f} s, "
        "imu.clock_shift_sigma_s): estimated beside the lever arm, which looks like a shift at constant speed"
    )


def offset_left(offset: Offset) -> str:
    """Sentence on what an offset of stamps that is not estimated may make of a lever arm that is."""
    return (
        "positions hardly tell that lever arm from an offset of their stamps, which is taken for zero: they allow "
        f"{offset.later_s:+.2f} +- {offset.sigma_s:.2f} s, and the lever arm is off by the way travelled in that time"
    )
