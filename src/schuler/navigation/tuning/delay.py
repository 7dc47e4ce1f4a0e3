"""Time offset of GNSS stamps that nobody stated: estimated where the fixes of a log show it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

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


def with_delay(config: NavigationConfig) -> NavigationConfig:
    """The configuration with a time offset of GNSS stamps that is estimated."""
    return config.model_copy(update={"gnss": config.gnss.model_copy(update={"delay_sigma_s": _SIGMA_S})})


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


def evidences(runs: Sequence[PreparedRun]) -> list[Evidence]:
    """Evidence of several models of one log.

    Parameters
    ----------
    runs : sequence of PreparedRun
        Of the same measurements; fixes may be taken later than their stamps.

    Notes
    -----
    Fixes thinned to 1, 4 and 15 s and predicted one after the other: that is the evidence of a model, what its further
    states cost included. Each counts at the noise that is likeliest for it, of a few.
    """
    runs = _alike([_on_stamps(with_smoothed_start(first_part(run))) for run in runs])
    judge = residuals_of(trials(runs[0], fixes_of(runs[0]), phases=1))
    return [
        min((Evidence(judge(with_factors(run, f)), f) for f in _NOISES), key=lambda evidence: evidence.loss)
        for run in runs
    ]


def _on_stamps(run: PreparedRun) -> PreparedRun:
    """The run on the clock of its fixes, with these alone."""
    later, nav = run.fixes_later_s, run.initial.nav
    fixes = run.schedule.where(np.isin(run.schedule.kind, TUNING_KINDS))
    return replace(
        run,
        increments=replace(run.increments, t=run.increments.t - later),
        schedule=replace(fixes, t=fixes.t - later),
        initial=replace(run.initial, nav=replace(nav, t=nav.t - later)),
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
    delay, sigma = _delay_of(run)
    return (delay / sigma) ** 2


def _delay_of(run: PreparedRun) -> tuple[float, float]:
    """Time offset at the end of a run that keeps nothing to smooth over, and its 1-sigma. [s]"""
    options = replace(run.options, smoother=False)
    return delay_at_end(replace(run, options=options).run(), run)


def is_same(run: PreparedRun, other: PreparedRun) -> bool:
    """Whether a run ends with the time offset by which the fixes of another one were moved."""
    return abs(_delay_of(other)[0] - run.fixes_later_s) < _SAME_S


def is_borne_out(run: PreparedRun) -> bool:
    """Whether positions alone favour the time offset that a run estimates.

    Velocities that a receiver filtered are late by themselves, and would take positions with them.
    """
    velocities = run.schedule.kind == VELOCITY
    if not velocities.any():
        return True
    alone = replace(run, schedule=run.schedule.where(~velocities))
    (delay, _), (other, sigma) = (_delay_of(model) for model in (run, alone))
    favoured = (other**2 - (other - delay) ** 2) / (2.0 * sigma**2)
    return bool(favoured > _BORNE_OUT and abs(other - delay) < max(4.0 * sigma, 0.25 * abs(delay)))


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
        delay, _ = _delay_of(noisy)
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
