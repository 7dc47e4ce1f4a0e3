"""Heading of a start judged by what follows: several headings are tried, and the likelihood of the fixes decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    DIMENSIONS,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    VELOCITY,
)
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.start.alignment import Start

_JUDGED = (POSITION, VELOCITY, PSEUDORANGE, RANGE_RATE)
_SPANS_S = (60.0, 120.0, 240.0)  # as much of the log is tried at first, and more while nothing is decided [s]
_CIRCLE = 24  # headings of a full circle
#: 1-sigma of each. [rad]
WIDTH = np.pi / _CIRCLE
_UNSURE = 30.0 * units.DEG  # a given heading less sure than this is one of a circle
_LOOSE = 45.0 * units.DEG  # 1-sigma with which a doubtful course counts among the headings of a circle [rad]
_WIDER = (2.0 * WIDTH, _LOOSE)  # 1-sigma that a sure course may have instead [rad]
_DECIDED = 20.0 * units.DEG  # spread of the headings that remain likely
#: Difference of log-likelihoods that overrules a course: chi-square of 20, one degree of freedom.
CONVICTS = 10.0
_CLEARLY = 0.4  # with mean squares so much smaller as well: errors of scale no state has turn headings by less
_CARRIED = 2.0  # difference of log-likelihoods by which a start has to be likelier than one that a rest gave
_ELSEWHERE = 45.0 * units.DEG  # a course this far off is looked for
# Factors on the 1-sigma of the IMU's white noise and of fixes that headings are also tried with, where none fits the
# noise as stated: errors too large for it break the filter down at headings that are right as well, and the likeliest
# is then a matter of chance.
_NOISIER = ((4.0, 1.0), (16.0, 1.0), (4.0, 4.0), (16.0, 4.0))
#: Mean normalised innovation squared of a heading that fits.
FITS = 1.5
# Headings beside one that is given.
_BESIDE = np.array([0.0, 20.0, -20.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0]) * units.DEG

#: Opening of the note on a given heading that the log contradicts, by which the verdict knows it.
HEADING_CONTRADICTED = "the log contradicts the heading given at the start"


def log_likelihood(
    prepared: PreparedRun, initial: InitialState, span_s: float, gated: bool = False
) -> tuple[float, float]:
    """Log-likelihood of GNSS innovations after a start, and their mean square, normalised.

    Parameters
    ----------
    prepared : PreparedRun
        Of its measurements those of GNSS count: what a vehicle can and cannot do presupposes a heading.
    initial : InitialState
    span_s : float
        Length of the run. [s]
    gated : bool
        Whether fixes are gated as in a run, and none weighs more than one at the gate: wrong ones decide nothing then.

    Returns
    -------
    log_likelihood, mean_nis : float
        -inf and inf for a start so wrong that its run breaks down: variances below zero, or no numbers.
    """
    t, schedule = initial.nav.t, prepared.schedule
    schedule = schedule.where(np.isin(schedule.kind, _JUDGED) & (schedule.t <= t + span_s))
    forward = replace(
        prepared,
        initial=initial,
        increments=prepared.increments.between(t - 1e-9, t + span_s),
        schedule=schedule if gated else replace(schedule, gate=np.where(schedule.gate < 0.0, schedule.gate, np.inf)),
        options=replace(prepared.options, smoother=False, record_s=span_s, output_rate_hz=1.0),
    ).run()
    size = np.array([DIMENSIONS[int(k)] for k in schedule.kind])
    used = np.isfinite(forward.nis) & (forward.variance[:, 0] != 0.0)
    own = np.arange(3) < size[used][:, None]
    # what a run made of the fixes before it broke down is no evidence for it
    broken = not np.isfinite(forward.r[-1]).all() or bool(np.any(own & (forward.variance[used] <= 0.0)))
    if broken or not used.any():
        return -np.inf, np.inf
    nis = forward.nis[used]
    squares = float((np.minimum(nis, np.abs(schedule.gate[used])) if gated else nis).sum())
    likelihood = -0.5 * (squares + float(np.log(np.where(own, forward.variance[used], 1.0)).sum()))
    return (likelihood if np.isfinite(likelihood) else -np.inf), squares / float(size[used].sum())


def judged_start(
    start: Start, prepared: PreparedRun, finish: Callable[[InitialState], InitialState]
) -> tuple[InitialState, str, list[str]]:
    """Initial state with the heading that the first minutes support.

    Parameters
    ----------
    start : Start
    prepared : PreparedRun
        Of this start.
    finish : callable
        What is still to be done to an initial state before a run.

    Returns
    -------
    initial : InitialState
    method : str
        How it was found, a phrase.
    notes : list of str
        A sentence on a heading that was judged, or that could not be.

    Raises
    ------
    InputError
        If there is no other source of the heading, and the log does not show it within four minutes either.

    Notes
    -----
    A heading from the course is tried against others: a vehicle that started backwards, sideways, or an IMU mounted
    across is found by its accelerations, which fixes show in north and east. Headings of a circle are compared at the
    IMU noise that is likeliest for each (profile likelihood) where none fits the noise as stated. A sure course has to
    be less likely both with all fixes and with those that pass the gates: two wrong fixes in a row wreck every run
    without gates, and which heading comes off best is chance. Log-likelihoods are
    divided by the mean normalised innovation squared of the best run where that is above one, so that noise stated too
    small does not convict. A given heading stays, with a note where another is as much likelier. Where nothing is
    known, headings of a full circle are tried over one, two and four minutes; those that remain likely make the heading
    and its uncertainty, as a Gaussian sum would.
    """
    method = start.method
    runs = [lambda state, span, run=run: log_likelihood(run, finish(state), span) for run in noisier(prepared)]
    tried, stated = partial(_relative, start, runs), partial(_relative, start, runs[:1])
    if start.source == "gyrocompass" or not np.isin(prepared.schedule.kind, _JUDGED).any():
        return _as_it_is(start), method, []
    if start.source == "course" and start.sigma < WIDTH:
        apart = np.arange(0.0, 2.0 * np.pi - 1e-9, _ELSEWHERE)
        relative, squares = stated(apart, [start.sigma, *[WIDTH * 2.0] * (len(apart) - 1)], _SPANS_S[0])
        best = int(np.argmax(relative))
        if relative[0] > relative[best] - CONVICTS or squares[best] > _CLEARLY * squares[0]:
            return start.initial, method, []
        gated = [lambda state, span: log_likelihood(prepared, finish(state), span, gated=True)]
        relative, _ = _relative(start, gated, apart[[0, best]], [start.sigma, WIDTH * 2.0], _SPANS_S[0])
        if relative[0] > -CONVICTS:
            return start.initial, method, []
    elif start.source == "given" and start.sigma < _UNSURE:
        relative, _ = tried(_BESIDE, [start.sigma, *[WIDTH * 2.0] * (len(_BESIDE) - 1)], _SPANS_S[0])
        best = int(np.argmax(relative))
        return start.initial, method, [_contradiction(_BESIDE[best])] if relative[0] < -CONVICTS else []
    apart = np.arange(_CIRCLE) * 2.0 * np.pi / _CIRCLE
    prior = np.zeros(_CIRCLE)
    if start.source != "none":
        prior = -0.5 * (np.asarray(frames.wrap_angle(apart)) / max(start.sigma, _LOOSE)) ** 2
    for span in _SPANS_S:
        relative = prior + tried(apart, [WIDTH] * _CIRCLE, span)[0]
        weight = np.exp(relative - relative.max())
        weight /= weight.sum()
        mean = float(np.angle(weight @ np.exp(1j * apart)))
        spread = float(np.sqrt(weight @ np.asarray(frames.wrap_angle(apart - mean)) ** 2))
        if spread < _DECIDED or prepared.increments.t[-1] - start.initial.nav.t < span:
            break
    if spread >= _DECIDED:
        return _undecided(start, span)
    heading, sigma = start.heading + mean, float(np.hypot(spread, WIDTH))
    off = abs(float(frames.wrap_angle(mean))) / units.DEG
    if start.source == "course" and off * units.DEG < 2.0 * start.sigma and sigma > 0.8 * start.sigma:
        return start.initial, method, []
    sentence = (
        f"heading {frames.wrap_angle(heading) / units.DEG:.0f} +- {sigma / units.DEG:.0f} deg at the start is what the "
        f"accelerations of the first {span:.0f} s support among {_CIRCLE} headings tried"
    )
    if start.source == "course" and off * units.DEG > 3.0 * start.sigma:
        sentence += f"; the course is {off:.0f} deg off it: the vehicle moved backwards or sideways, or check the mount"
    elif start.source != "none":
        sentence += f"; the {'course' if start.source == 'course' else 'one given'} is {off:.0f} deg off it"
    return start.at_heading(heading, sigma), f"{method.split(', heading')[0]}, heading from accelerations", [sentence]


def as_sure_as_shown(
    start: Start, prepared: PreparedRun, finish: Callable[[InitialState], InitialState]
) -> tuple[Start, list[str]]:
    """The start with its course as sure a heading as the fixes of the first minute bear out, and a sentence if less.

    Parameters
    ----------
    start, prepared, finish
        As for :func:`judged_start`, which left the course as it is.

    Notes
    -----
    The course of a body that need not go where it points (a multicopter, a vehicle whose IMU is not along it) is a
    heading to tens of degrees only. A run that begins with it as a sure one learns better within seconds, so that no
    other heading is much likelier over a minute; a larger 1-sigma at the same heading is, since nothing has to be
    unlearnt. It has to be likelier by as much as another heading, with all fixes and with those that pass the gates.
    Ranges say nothing here: their errors stay on a satellite, and look like the heading's.
    """
    fixes = prepared.ranges is None and np.isin(prepared.schedule.kind, _JUDGED).any()
    if start.source != "course" or start.sigma >= WIDTH or not fixes:
        return start, []
    sigmas = [start.sigma, *_WIDER]
    for gated in (False, True):
        trial = [lambda state, span, gated=gated: log_likelihood(prepared, finish(state), span, gated=gated)]
        relative, _ = _relative(start, trial, np.zeros(len(sigmas)), sigmas, _SPANS_S[0])
        if relative[0] > -CONVICTS:
            return start, []
        sigmas = [start.sigma, sigmas[int(np.argmax(relative))]]
    sentence = (
        f"the course is taken for the heading at the start to {sigmas[1] / units.DEG:.0f} deg, not to "
        f"{start.sigma / units.DEG:.1g}: fixes of the first {_SPANS_S[0]:.0f} s bear out no more (a body that does not "
        "go where it points, or check the mount)"
    )
    return replace(start, initial=start.at_heading(start.heading, sigmas[1]), sigma=sigmas[1]), [sentence]


def likeliest_start(
    start: Start,
    carried: Sequence[InitialState],
    prepared: PreparedRun,
    finish: Callable[[InitialState], InitialState],
) -> tuple[InitialState, str]:
    """The likeliest by the first minute of a start at its fix and those carried from a rest, and its method.

    One that a rest gave has more in it, and stays where the fixes do not tell the two apart.

    Parameters
    ----------
    start : Start
    carried : sequence of InitialState
        See :func:`~schuler.navigation.start.carried.carried_starts`.
    prepared, finish
        As for :func:`judged_start`.
    """
    if not carried:
        return start.initial, start.method
    states = [start.initial, *carried]
    likelihood = np.array([log_likelihood(prepared, finish(state), _SPANS_S[0])[0] for state in states])
    best = int(np.argmax(likelihood + _CARRIED * (np.arange(len(states)) > 0)))
    if best == 0:
        return start.initial, start.method
    heading = start.method.partition(", heading")
    return states[best], f"attitude and velocity carried from a rest{heading[1]}{heading[2]}"


def _contradiction(apart: float) -> str:
    """Sentence on a given heading, where one so far from it is likelier."""
    return (
        f"{HEADING_CONTRADICTED}: accelerations of the first {_SPANS_S[0]:.0f} s are those of one some "
        f"{abs(apart) / units.DEG:.0f} deg to the {'right' if apart > 0.0 else 'left'}; it was taken all the same"
    )


def no_heading(obstacle: str) -> str:
    """Sentence of the error that a start without a heading is."""
    return f"{obstacle}; lower alignment.min_speed_m_s, give the attitude, or gyrocompass"


def _as_it_is(start: Start) -> InitialState:
    if start.obstacle:
        raise InputError(no_heading(start.obstacle))
    return start.initial


def _undecided(start: Start, span: float) -> tuple[InitialState, str, list[str]]:
    if start.obstacle:
        raise InputError(no_heading(f"{start.obstacle}, nor do its accelerations within {span:.0f} s"))
    if start.source == "course":
        return start.initial, start.method, []
    sentence = (
        f"the heading at the start is in doubt: accelerations of the first {span:.0f} s do not tell headings of a full "
        "circle apart; the one given was taken"
    )
    return start.initial, start.method, [sentence]


def _relative(
    start: Start,
    trials: Sequence[Callable[[InitialState, float], tuple[float, float]]],
    apart: FloatArray,
    sigmas: list[float],
    span: float,
) -> tuple[FloatArray, FloatArray]:
    """Log-likelihoods of headings so far from the start's, less the largest, where noise is as large as it shows.

    And the mean squares of their innovations. Shapes (n,). Each of the later trials only where no heading fits before.
    """
    likelihood, squares = np.full(len(apart), -np.inf), np.full(len(apart), np.inf)
    for trial in trials:
        for i, (angle, sigma) in enumerate(zip(apart, sigmas, strict=True)):
            as_it_is = angle == 0.0 and sigma == start.sigma
            try:
                initial = start.initial if as_it_is else start.at_heading(start.heading + float(angle), sigma)
                result = trial(initial, span)
            except InputError:
                continue
            if result[0] > likelihood[i]:
                likelihood[i], squares[i] = result
        best = int(np.argmax(likelihood))
        if squares[best] < FITS:
            break
    if not np.isfinite(likelihood).any():
        return np.zeros(len(apart)), squares
    return (likelihood - likelihood[best]) / max(squares[best], 1.0), squares


def noisier(prepared: PreparedRun) -> list[PreparedRun]:
    """The run as it is, and with noise of its IMU and fixes multiplied."""
    (gyro, accel), schedule = prepared.psd, prepared.schedule
    fix = np.isin(schedule.kind, _JUDGED)[:, None, None]
    return [
        prepared,
        *(
            replace(
                prepared,
                psd=(gyro * imu**2, accel * imu**2),
                schedule=replace(schedule, R=np.where(fix, schedule.R * gnss**2, schedule.R)),
            )
            for imu, gnss in _NOISIER
        ),
    ]
