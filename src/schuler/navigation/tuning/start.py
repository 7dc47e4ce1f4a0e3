"""Start of a run whose noise is tuned: smoothed, so that no filter has to find its attitude from a wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import DivergenceError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.mechanization.strapdown import NavState
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.result import NavigationResult
from schuler.navigation.start.heading import log_likelihood
from schuler.navigation.tuning.likelihood import residuals_of, spacing_of, thinned, trials
from schuler.navigation.tuning.noise import TUNING_KINDS, WHITE, with_factors

#: Of the log that places the start. [s]
SPAN_S = 120.0
#: Of the log that refutes one. [s]
JUDGED_S = 60.0
_WIDER = 5.0  # factor on the smoothed 1-sigma, since fixes that are judged later are in it
_SCALES = (1.0, 4.0, 16.0)  # factors on the IMU's white noise, of which the likeliest smooths
#: Log likelihood that a start loses beyond what its uncertainty costs: half a chi-square of 50, where right starts of
#: 21 states lose 10.
REFUTED = 25.0


def with_smoothed_start(prepared: PreparedRun) -> PreparedRun:
    """The run from its first record on, with the smoothed state there.

    Its covariance is that of the start combined with five times the smoothed 1-sigma.

    Parameters
    ----------
    prepared : PreparedRun

    Returns
    -------
    PreparedRun
        As it was where fixes are not likelier with the smoothed start, where the run that is smoothed diverges, and
        where ranges are the measurements, whose noise leaves errors of the start small.

    Notes
    -----
    A filter that finds its attitude from fixes of a centimetre linearises about a wrong one, and what it makes of that
    changes at random with the noise that is being judged: likelihoods jump (a car, heading off by 10 deg, positions of
    6 mm: by 60 between factors of 1.1 and 1.2), and the largest is a matter of chance. Linearised about a state that is
    nearly right they are smooth, as in an iterated Kalman filter (Bell, Cathey (1993), IEEE Trans. Autom. Control
    38(2)).
    """
    if prepared.ranges is not None or prepared.layout.size != prepared.layout.visible.size:
        return prepared
    tests = trials(prepared, _fixes(prepared.schedule), phases=1)
    if not tests:
        return prepared
    judge = residuals_of(tests)
    noisy = [with_factors(prepared, dict.fromkeys(WHITE, scale)) for scale in _SCALES]
    losses = [float(judge(run).scores().sum()) for run in noisy]
    best = int(np.argmin(np.nan_to_num(losses, nan=np.inf)))
    t = prepared.initial.nav.t
    schedule = prepared.schedule.where(prepared.schedule.t <= t + SPAN_S)
    first = replace(
        noisy[best],
        increments=prepared.increments.between(t - 1e-9, t + SPAN_S),
        schedule=replace(schedule, gate=np.where(_fixes(schedule), np.inf, schedule.gate)),
        options=replace(prepared.options, lockout=0, adaptive=False, smoother=True, record_s=0.05, output_rate_hz=1.0),
    )
    try:
        forward = NavigationResult.from_run(first.run(), schedule.t, schedule.kind, prepared.layout)
        smoothed = forward.smooth(keep=False)
    except DivergenceError:
        return prepared
    s = smoothed.states
    if not np.isfinite(s.r_eb_e[0]).all() or not np.isfinite(smoothed.covariance_e[0]).all():
        return prepared
    nav = NavState(float(s.t[0]), s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0])
    P = _combined(prepared.initial.P, _WIDER**2 * smoothed.covariance[0])
    other = replace(
        prepared,
        initial=InitialState(nav, P, smoothed.parameters[0]),
        increments=prepared.increments.between(nav.t - 1e-9, prepared.increments.t[-1]),
        schedule=prepared.schedule.where(prepared.schedule.t > nav.t),
    )
    judge = residuals_of(trials(other, _fixes(other.schedule), phases=1))
    loss = float(judge(with_factors(other, dict.fromkeys(WHITE, _SCALES[best]))).scores().sum())
    return other if loss < losses[best] else prepared


def unless_refuted(prepared: PreparedRun) -> tuple[PreparedRun, list[str]]:
    """The run, from its smoothed start if the fixes of the first minute refute the one it has.

    Parameters
    ----------
    prepared : PreparedRun
        Its noise tuned, or as configured.

    Returns
    -------
    PreparedRun
    notes : list of str
        A sentence on a start that was refuted.

    Notes
    -----
    Fixes are likelier from a smoothed start always, since it knows them: by :func:`expected_gain`, and half a
    chi-square of as many degrees of freedom as the filter has states. A start that loses far more is wrong (the course
    of a multicopter is not its heading), or too uncertain for the filter to be linear (a gyroscope biased by degrees
    per second). Noise that is too small for the log does not refute: log likelihoods are divided by the mean normalised
    innovation squared from the smoothed start where that is above one.
    """
    other = with_smoothed_start(prepared)
    if other is prepared:
        return prepared, []
    schedule, fixes = other.schedule, _fixes(other.schedule)
    # errors of fixes that come faster are alike
    kept = thinned(schedule, fixes, other.initial.nav.t, 1.0, 0.0, spacing_of(schedule, fixes))
    schedule = schedule.where(~fixes | kept)
    likelihood, squares = log_likelihood(replace(other, schedule=schedule), other.initial, JUDGED_S)
    before, _ = log_likelihood(replace(prepared, schedule=schedule), prepared.initial, JUDGED_S)
    gain = (likelihood - before) / max(squares, 1.0)
    if not gain > REFUTED + expected_gain(prepared.initial.P, other.initial.P):
        return prepared, []
    sentence = (
        f"fixes of the first {JUDGED_S:.0f} s refute the start (log likelihood {gain:+.0f} with another): the run "
        f"begins with attitude, velocity and sensor errors that the first {SPAN_S:.0f} s support, smoothed, "
        f"{_WIDER:g} times as uncertain as smoothing leaves them"
    )
    return other, [sentence]


def expected_gain(P: FloatArray, narrow: FloatArray) -> float:
    """Log likelihood that fixes gain in the mean when a right start of covariance P is replaced by the smoothed one.

    Parameters
    ----------
    P, narrow : ndarray, shape (n, n)
        Covariances of the start and of :func:`with_smoothed_start`.

    Notes
    -----
    Fixes of information ``L`` have the evidence ``-ln det(I + P L) / 2``, less the start's normalised error squared,
    beside the likelihood of the best state. ``L`` follows from ``narrow^-1 = P^-1 + (P^-1 + L) / 25``; in the axes in
    which both covariances are diagonal ``P narrow^-1`` is ``k`` and ``P L`` is ``25 (k - 1) - 1``.
    """
    import scipy.linalg

    sigma = np.sqrt(np.diag(P))
    free = sigma > 0.0
    scale = np.outer(sigma[free], sigma[free])
    k = scipy.linalg.eigh(P[np.ix_(free, free)] / scale, narrow[np.ix_(free, free)] / scale, eigvals_only=True)
    information = np.maximum(_WIDER**2 * (k - 1.0) - 1.0, 0.0)
    return float(0.5 * np.sum(np.log1p(information) - np.log1p(information / k)))


def _combined(P: FloatArray, other: FloatArray) -> FloatArray:
    """Covariance of the mean of two independent estimates; what is fixed in the first stays fixed."""
    sigma = np.sqrt(np.diag(P))
    free = sigma > 0.0
    scale = np.outer(sigma[free], sigma[free])
    A, B = P[np.ix_(free, free)] / scale, other[np.ix_(free, free)] / scale
    combined = np.zeros_like(P)
    combined[np.ix_(free, free)] = A @ np.linalg.solve(A + B, B) * scale
    return 0.5 * (combined + combined.T)


def _fixes(schedule: MeasurementSchedule) -> BoolArray:
    """Which measurements tune."""
    return np.isin(schedule.kind, TUNING_KINDS) & (schedule.gate > 0.0)
