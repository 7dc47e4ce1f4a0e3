"""Heading of a start that fixes do not fit, found from smoothed starts of a full circle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import rotation
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.start.heading import CONVICTS, FITS, log_likelihood, noisier
from schuler.navigation.tuning.likelihood import spacing_of, thinned
from schuler.navigation.tuning.start import JUDGED_S, REFUTED, SPAN_S, expected_gain, with_smoothed_start
from schuler.navigation.tuning.tuning import first_part, fixes_of
from schuler.units import DEG

_CIRCLE = 12  # headings: smoothing twice finds one from 30 deg off, and often from 60


def fitting_turn(prepared: PreparedRun) -> tuple[float, float] | None:
    """Turn of the start's heading whose smoothed start the fixes of the first minute fit, where its own does not.

    Parameters
    ----------
    prepared : PreparedRun

    Returns
    -------
    turn, gain : float
        From the first heading of :attr:`PreparedRun.headings` [rad], and the log likelihood won over the start's own,
        smoothed as well. None where the start fits, nothing else does, or there is no choice.

    Notes
    -----
    A gyroscope biased by degrees per second and a heading that is off take a filter out of its linear range with the
    first fixes: what it makes of them is chance, at headings that are nearly right as well, and no noise fits.
    Smoothed, and smoothed again from there (an iterated filter, see :func:`with_smoothed_start`), those within some 30
    deg end up at the right one and fit; the others go nowhere. A start that is likely as it is stays: one replaced has
    to be refuted as in :func:`~schuler.navigation.tuning.start.unless_refuted`.
    """
    if prepared.headings is None or prepared.ranges is not None:
        return None
    first = first_part(prepared, SPAN_S)
    if not np.any(fixes_of(first)) or _fit(first, most=1)[1] < FITS:
        return None
    before, smoothed = _fit(first), _smoothed(first)
    after = _fit(smoothed)
    needed = REFUTED + expected_gain(first.initial.P, smoothed.initial.P)
    if max(before, after)[1] < FITS and after[0] - before[0] < needed:
        return None
    likelihood, squares, turn = -np.inf, np.inf, 0.0
    for other in np.arange(_CIRCLE) * 2.0 * np.pi / _CIRCLE:
        try:
            fit = _fit(with_turn(first, float(other)))
        except InputError:
            continue
        if fit[0] > likelihood + (CONVICTS if turn == 0.0 else 0.0):
            (likelihood, squares), turn = fit, float(other)
    gain = likelihood - before[0]
    return (turn, gain) if squares < FITS and gain > needed else None


def with_turn(prepared: PreparedRun, turn: float, before: PreparedRun | None = None) -> PreparedRun:
    """The run from the smoothed start at its heading turned by so much. [rad]

    Parameters
    ----------
    prepared : PreparedRun
    turn : float
        [rad]
    before : PreparedRun, optional
        From the same turn with other noise or fewer states: its start stays where fixes are far likelier with it.

    Notes
    -----
    Smoothing from tens of degrees off ends at the right start with one noise and, where the noise is smaller, in a
    gyro bias of tens of degrees per second that turns the body with its course.
    """
    assert prepared.headings is not None
    prior = prepared.headings(turn)
    anew = _smoothed(replace(prepared, initial=prior))
    if before is None or before.fixes_later_s != prepared.fixes_later_s:
        return anew
    initial = _carried(before.initial, before.layout, prior, prepared.layout)
    t = initial.nav.t
    kept = replace(
        prepared,
        initial=initial,
        increments=prepared.increments.between(t - 1e-9, prepared.increments.t[-1]),
        schedule=prepared.schedule.where(prepared.schedule.t > t),
    )
    both = max(t, anew.initial.nav.t)  # fixes that test both
    one, other = (_fit(replace(r, schedule=r.schedule.where(r.schedule.t > both)))[0] for r in (anew, kept))
    return kept if other > one + CONVICTS else anew


def _carried(before: InitialState, layout: StateLayout, prior: InitialState, wanted: StateLayout) -> InitialState:
    """A start with the states of another layout: what is new as in a prior start, and navigation correlated with it."""
    blocks = [name for name in wanted.models if name in layout]
    into = np.concatenate([np.arange(9), *(np.r_[wanted[name]] for name in blocks)])
    out = np.concatenate([np.arange(9), *(np.r_[layout[name]] for name in blocks)])
    new = np.setdiff1d(np.arange(wanted.size), into)
    P, parameters = prior.P.copy(), prior.parameters.copy()
    parameters[into[9:] - 9] = before.parameters[out[9:] - 9]
    own = P[np.ix_(new, new)]
    gain = P[np.ix_(into, new)] @ np.linalg.pinv(own, hermitian=True)
    turned = rotation.dcm_from_rpy(before.nav.rpy_nb) @ rotation.dcm_from_rpy(prior.nav.rpy_nb).T
    gain[:9] = np.einsum("ij,bjk->bik", turned, gain[:9].reshape(3, 3, len(new))).reshape(9, len(new))
    P[np.ix_(into, new)] = gain @ own
    P[np.ix_(new, into)] = own @ gain.T
    P[np.ix_(into, into)] = before.P[np.ix_(out, out)] + gain @ own @ gain.T
    return InitialState(before.nav, P, parameters)


def turn_note(turn: float, gain: float) -> str:
    """Sentence on a start whose heading was turned. [rad], log likelihood"""
    off = abs(np.angle(np.exp(1j * turn))) / DEG
    other = f"from a heading some {off:.0f} deg off it" if off > 1.0 else "once it is smoothed"
    return (
        f"fixes of the first {JUDGED_S:.0f} s do not fit the start with any noise, and do {other} (log likelihood "
        f"{gain:+.0f}): the run begins with attitude, velocity and sensor errors that the first {SPAN_S:.0f} s "
        "support, smoothed from there"
    )


def _smoothed(prepared: PreparedRun) -> PreparedRun:
    """The run smoothed twice, as uncertain as once: the second time nothing new is learnt."""
    once = with_smoothed_start(prepared)
    twice = with_smoothed_start(once)
    return replace(twice, initial=replace(twice.initial, P=once.initial.P))


def _fit(prepared: PreparedRun, most: int | None = None) -> tuple[float, float]:
    """Log likelihood of fixes of the first minute, a second apart, at the likeliest of noises; their mean square."""
    fixes = fixes_of(prepared)
    kept = thinned(prepared.schedule, fixes, prepared.initial.nav.t, 1.0, 0.0, spacing_of(prepared.schedule, fixes))
    runs = noisier(replace(prepared, schedule=prepared.schedule.where(~fixes | kept)))
    return max(log_likelihood(run, run.initial, JUDGED_S) for run in runs[:most])
