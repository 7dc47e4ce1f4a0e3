"""Noise, lever arm and time offset that a log supports, where its configuration does not state them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from schuler.filtering.measurements import VELOCITY
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.delay import (
    Offset,
    delay_of,
    evidences,
    is_apart,
    is_borne_out,
    is_not_contradicted,
    is_same,
    is_suspected,
    likeliest_offset,
    may_have_delay,
    offset_left,
    offset_near,
    on_clock_of_fixes,
    placed,
    shift_note,
    with_delay,
)
from schuler.navigation.tuning.entries import tuned_configuration
from schuler.navigation.tuning.headings import fitting_turn, turn_note, with_turn
from schuler.navigation.tuning.lever import LEVER_ESTIMATED, has_lever, with_lever
from schuler.navigation.tuning.rough import rough_factor, rough_note, with_rough_noise
from schuler.navigation.tuning.search import proven
from schuler.navigation.tuning.start import unless_refuted
from schuler.navigation.tuning.tuning import contradicted, slow_error_beside_stated, too_few, tune
from schuler.navigation.tuning.unaided import as_sure_as_withheld

#: Note on a run whose noise is its user's word although innovations speak against it.
STATED_NOISE = (
    "innovations contradict the noise as configured, which stays because it is stated by hand; filter.tune = true "
    "finds noise that fits them"
)

#: Makes a run of a configuration ready, with fixes so much later than their stamps [s].
Prepare: TypeAlias = Callable[[NavigationConfig, float], PreparedRun]


class Supported(NamedTuple):
    """A run, its configuration, and sentences on what was chosen."""

    config: NavigationConfig
    run: PreparedRun
    notes: list[str]


def supported_run(config: NavigationConfig, prepare: Prepare, *, aligned: bool) -> Supported:
    """The run of a configuration with what its log supports where that is not stated, also in minutes without fixes.

    Parameters
    ----------
    config, prepare, aligned
        See :func:`tuned_run`.
    """
    tuned = tuned_run(config, prepare, aligned=aligned)
    if config.filter.tune is False or (config.filter.tune == "auto" and config.noise_is_stated):
        return tuned
    chosen, run, notes = as_sure_as_withheld(tuned.config, tuned.run)
    return Supported(chosen, run, [*tuned.notes, *notes])


def tuned_run(config: NavigationConfig, prepare: Prepare, *, aligned: bool) -> Supported:
    """The run of a configuration with what its log supports where that is not stated.

    Parameters
    ----------
    config : NavigationConfig
        ``filter.tune`` says whether anything is chosen.
    prepare : callable
        Makes a run of a configuration ready, with fixes so much later than their stamps. [s]
    aligned : bool
        Whether it starts from one of its fixes.

    Notes
    -----
    A time offset of fixes is tried first: noise tuned without it takes it in. It stays if it is far from zero beside
    the noise tuned with it. Noise that is stated stays; an offset is estimated beside it where innovations contradict
    the noise without the offset and no longer do with it: then it was the offset that did. A start whose heading no
    noise explains begins at another that does, if there is one, before any of this,
    unless noise is stated.
    """
    plain = Supported(config, prepare(config, 0.0), [])
    if config.filter.tune is False:
        return plain
    own_start = aligned and config.alignment.method != "given"
    stated = config.filter.tune == "auto" and config.noise_is_stated
    if own_start and not stated and (other := fitting_turn(plain.run)) is not None:
        before = with_turn(plain.run, other[0])
        prepare = partial(_prepared_at, prepare, other[0], before)
        plain = Supported(config, before, [turn_note(*other)])
    doubted = noise_is_open(config, plain.run)
    if stated and not doubted:
        return plain
    if aligned and (late := _with_delay(plain, prepare, doubted, own_start)) is not None:
        return late
    if stated:
        return plain._replace(notes=[*plain.notes, STATED_NOISE, *slow_error_beside_stated(plain.run)])
    tuned = _tuned(plain, prepare, aligned) if doubted else plain
    if own_start and (doubted or too_few(tuned.run)):
        tuned = _from_supported_start(tuned)
    return _with_rough_noise(plain, tuned, prepare, own_start) if tuned.config is config else tuned


def noise_is_open(config: NavigationConfig, run: PreparedRun) -> bool:
    """Whether a run's noise is asked for, that of a grade, which nobody claims of this unit, or contradicted."""
    if config.filter.tune is True:
        return True
    of_grade = config.is_named_by_grade and not config.noise_is_stated and run.ranges is None
    return (of_grade and not too_few(run)) or contradicted(run)


def _prepared_at(
    prepare: Prepare, turn: float, before: PreparedRun, config: NavigationConfig, fixes_later_s: float
) -> PreparedRun:
    """A run made ready, from the smoothed start at its heading turned, or from the one found first. [rad]"""
    return with_turn(prepare(config, fixes_later_s), turn, before)


def _with_delay(plain: Supported, prepare: Prepare, doubted: bool, own_start: bool) -> Supported | None:
    """The run with a time offset of fixes and the noise beside it; None where the log shows none."""
    config = plain.config
    if too_few(plain.run) or not may_have_delay(config, plain.run):
        return None
    late = with_delay(config)
    free = Supported(late, prepare(late, 0.0), [])
    if not (doubted or is_suspected(free.run)):
        return None
    likeliest = _likeliest_with_delay(plain, free, prepare)
    if likeliest is None:
        return None
    chosen = likeliest
    if noise_is_open(config, likeliest.run):
        if config.filter.tune == "auto" and config.noise_is_stated:
            return None
        chosen = _tuned(likeliest, prepare, aligned=True)
    beside = not config.lever_is_stated and chosen.config.gnss.lever_sigma_m > 0.0
    chosen = _placed_beside_lever(chosen, prepare) if beside else _placed(chosen, prepare)
    if own_start:
        chosen = _from_supported_start(chosen)
    return chosen if is_same(likeliest.run, chosen.run) and is_apart(chosen.run) and is_borne_out(chosen.run) else None


def _likeliest_with_delay(plain: Supported, free: Supported, prepare: Prepare) -> Supported | None:
    """The run with a time offset, and with a lever arm too where that is likelier; None where neither is likelier.

    A lever arm ahead looks like an offset at constant speed: where none is stated, both are tried with one and without.
    """
    free = _placed(free, prepare, evidences([free.run])[0].factors)
    if not is_apart(free.run):
        return None
    if plain.config.lever_is_stated:
        before, after = evidences([plain.run, free.run])
        return free if proven(before.innovations, after.innovations) else None
    arm = with_lever(plain.config)
    offset = likeliest_offset(partial(prepare, arm))
    other = _beside_lever(Supported(arm, plain.run, [LEVER_ESTIMATED]), prepare, offset)
    without, with_arm, one, two = evidences([plain.run, prepare(arm, 0.0), free.run, other.run])
    before = min(without, with_arm, key=lambda evidence: evidence.loss)
    if proven(one.innovations, two.innovations):
        free, one = other, two
    return free if proven(before.innovations, one.innovations) else None


def _beside_lever(given: Supported, prepare: Prepare, offset: Offset) -> Supported:
    """The run with a time offset beside a lever arm, begun at the likeliest offset and as sure of it as its fixes."""
    config = with_delay(given.config, offset.sigma_s)
    return given._replace(config=config, run=prepare(config, offset.later_s))


def _placed_beside_lever(given: Supported, prepare: Prepare) -> Supported:
    """The run at the offset that is likeliest with its noise, beside a lever arm."""
    fixed = given.config.model_copy(update={"gnss": given.config.gnss.model_copy(update={"delay_sigma_s": 0.0})})
    offset = offset_near(given.run.fixes_later_s, partial(prepare, fixed))
    return _beside_lever(given._replace(config=fixed), prepare, offset)


def _from_supported_start(given: Supported) -> Supported:
    """The run from another start where its fixes refute the one it has."""
    run, refuted = unless_refuted(given.run)
    return given._replace(run=run, notes=[*given.notes, *refuted])


def _with_rough_noise(plain: Supported, given: Supported, prepare: Prepare, own_start: bool) -> Supported:
    """The run with noise several times as large, where few fixes do not fit it as it is and do then.

    Where they fit, what was said of noise that could not be tuned (from another start) is no longer so.
    """

    def begun(factor: float) -> Supported:
        other = with_rough_noise(given.config, factor)
        run = Supported(other, prepare(other, given.run.fixes_later_s), [])
        return _from_supported_start(run) if own_start else run

    chosen = rough_factor(given.run, lambda factor: begun(factor).run)
    if chosen is None:
        return given
    other = begun(chosen.factor)
    before = plain.notes if chosen.fits else given.notes
    return other._replace(notes=[*before, rough_note(chosen), *other.notes])


def _placed(given: Supported, prepare: Prepare, factors: dict[str, float] | None = None) -> Supported:
    """The run with fixes later than their stamps by its time offset."""
    return given._replace(run=placed(given.run, partial(prepare, given.config), factors))


def _tuned(given: Supported, prepare: Prepare, aligned: bool) -> Supported:
    """The run with noise tuned, and with a lever arm if its fixes show one that nobody stated.

    An antenna behind and late stamps look alike: where fixes have no velocities that tell them apart, an offset that
    is likely beside the lever arm is estimated with it.
    """
    tuned = _with_noise(given, prepare, aligned)
    if not aligned or tuned.config.gnss.coupling != "loose" or tuned.config.lever_is_stated:
        return tuned
    other = with_lever(tuned.config)
    free = prepare(other, tuned.run.fixes_later_s)
    if not has_lever(tuned.run, free):
        return tuned
    with_arm = Supported(other, free, [*given.notes, LEVER_ESTIMATED])
    if may_have_delay(other, free) and not np.any(free.schedule.kind == VELOCITY):
        offset = likeliest_offset(partial(prepare, other))
        if offset.is_apart:
            with_both = _with_noise(_beside_lever(with_arm, prepare, offset), prepare, aligned)
            return _placed_beside_lever(with_both, prepare)
        with_arm.notes.append(offset_left(offset))
    if other.imu.clock_shift_sigma_s > 0.0 and "delay_sigma_s" not in other.gnss.model_fields_set:
        return _beside_uncertain_shift(with_arm, prepare, aligned)
    return _with_noise(with_arm, prepare, aligned)


def _beside_uncertain_shift(given: Supported, prepare: Prepare, aligned: bool) -> Supported:
    """The run beside a lever arm with what its clock shift is off, at the shift where nothing of that is left.

    A lever arm ahead and a shift look alike: the one is as uncertain as the other. Velocities that a receiver filtered
    are late by themselves: what positions alone contradict is left.
    """
    before = given.config.imu
    if np.any(given.run.schedule.kind == VELOCITY):
        free = with_delay(given.config, before.clock_shift_sigma_s)
        both = given._replace(config=free, run=prepare(free, given.run.fixes_later_s))
        both = _placed(_with_noise(both, prepare, aligned), prepare)
        if not is_not_contradicted(both.run):
            return _with_noise(given, prepare, aligned)
    else:
        offset = likeliest_offset(partial(prepare, given.config)).beside(before.clock_shift_sigma_s)
        both = _with_noise(_beside_lever(given, prepare, offset), prepare, aligned)
        both = _placed_beside_lever(both, prepare)
    delay, sigma = delay_of(both.run)
    imu = before.model_copy(update={"clock_shift_s": before.clock_shift_s - both.run.fixes_later_s})
    notes = [*both.notes, shift_note(before.clock_shift_s, before.clock_shift_s - delay, sigma)]
    return Supported(both.config.model_copy(update={"imu": imu}), on_clock_of_fixes(both.run), notes)


def _with_noise(given: Supported, prepare: Prepare, aligned: bool) -> Supported:
    """The run with tuned noise, and sentences on it; as it is if that is no better."""
    tuning = tune(given.run, aligned=aligned)
    notes = [*given.notes, *tuning.sentences()]
    if not tuning.better:
        return given._replace(notes=notes)
    config = tuned_configuration(given.config, tuning)
    return Supported(config, prepare(config, given.run.fixes_later_s), notes)
