"""Search for a slow error of positions: whether innovations are likelier with it than with other white noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.arrays import BoolArray
from schuler.filtering.measurements import POSITION
from schuler.navigation.evaluation.evidence import slow_nis
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.tuning.likelihood import Residuals, Trial, residuals_of, trials
from schuler.navigation.tuning.noise import SLOW, WHITE, with_factors
from schuler.navigation.tuning.search import LEAST_GAIN, Fit, fit, gain_of, proven
from schuler.navigation.tuning.slow import CLEARLY, SlowError, candidates, with_slow_error

# ln(factor) on the IMU's white noise, which explains innovations of one sign as well, and may be tuned for that
_SHIFTS = (0.0, 1.2, 2.4, -1.2, -2.4)
_SCALES = (1.0, 3.0, 10.0)  # and factor on the sigma of positions, likewise
_LENGTHS = (10, 30, 100)  # innovations of positions in a sum
_ONE_SIDED = 1.4  # mean square of such sums from which the likelihoods are asked
_CERTAIN = 3.0  # standard errors by which fixes held back are likelier
_SLOW_S = 60.0  # correlation time below which a receiver's own filter makes fixes alike [s]
_BESIDE = 0.5  # share of the white noise of positions that remains beside a slow error
_OF_IMU = (*WHITE, "gyro_bias", "accel_bias")
#: Log likelihood by which a slow error leads white noise so that tuning may help, and so that a run without is doubted.
ASKED, SHOWS = 3.0, 5.0


def slow_lead(prepared: PreparedRun, fixes: BoolArray, seen: Residuals | None = None) -> float:
    """Log likelihood by which a slow error of positions leads white noise of any size, of IMU and positions.

    Parameters
    ----------
    prepared : PreparedRun
        With its noise as configured or tuned.
    fixes : ndarray of bool, shape (m,)
        Measurements that tune.
    seen : Residuals, optional
        Innovations of the run as it is; computed if not given.

    Returns
    -------
    float
        Zero where sums of innovations are no larger than white ones make them, and where positions are not measured or
        have a slow error already.

    Notes
    -----
    Fixes a second apart, all used: predicted one after the other, their joint likelihood, of which no test is more
    powerful (Neyman, Pearson (1933)). Innovations thinned to 4 and 15 s hardly show a slow error of one to two sigmas.
    """
    if not _possible(prepared):
        return 0.0
    judged = residuals_of(_every_second(prepared, fixes))
    seen = judged(prepared) if seen is None else seen
    z = seen.normalised[(seen.kind == POSITION) & (seen.horizon <= 1.0)]
    if all(slow_nis([z], n)[0] < _ONE_SIDED for n in _LENGTHS):
        return 0.0
    runs = [
        with_factors(prepared, {**dict.fromkeys(WHITE, float(np.exp(shift))), "position": scale, "height": scale})
        for shift in _SHIFTS
        for scale in _SCALES
    ]
    white = min(_loss(judged(run)) for run in runs)
    slow = [with_slow_error(run, error) for run in runs for error in candidates(run) if error.tau >= _SLOW_S]
    return white - min(_loss(judged(run)) for run in slow)


def likeliest_slow_error(
    prepared: PreparedRun,
    white: Fit,
    sets: tuple[BoolArray, BoolArray],
    terms: tuple[str, ...],
    floors: dict[str, float],
) -> tuple[PreparedRun | None, Fit, float]:
    """The run with a slow error of its positions, its factors, and the log likelihood by which it leads white noise.

    Parameters
    ----------
    prepared : PreparedRun
    white : Fit
        Factors of the run without.
    sets : (ndarray of bool, ndarray of bool), shapes (m,)
        Fixes that choose factors, and those between.
    terms : tuple of str
        Factors that may change.
    floors : dict of str to float
        Smallest factors.

    Returns
    -------
    run : PreparedRun or None
        None, with the factors without, unless fixes are likelier with it beyond doubt.
    factors : Fit
    lead : float

    Notes
    -----
    Judged by fixes held back, over 1, 4 and 15 s, by three standard errors; errors of a minute and more by all fixes a
    second apart, too, by two or by votes (:func:`.search.proven`); by 8 in both. White noise of the IMU, and larger
    sigmas of fixes, may have taken the slow error in: it is tried beside each of them as tuned and as stated, and all
    factors are then chosen anew. White noise of positions must remain beside it: an error of seconds that takes its
    place is the receiver's own filter, which white noise describes as well.
    """
    lead = 0.0
    if not _possible(prepared):
        return None, white, lead
    chosen = residuals_of(trials(prepared, sets[0], phases=1))
    for look in _looks(prepared, white, sets):
        best = _best(prepared, white, look)
        if best is None:
            continue
        wide = with_slow_error(prepared, best[1])
        wider = fit(wide, chosen, (*terms, SLOW), start={**best[0], SLOW: 1.0}, floors=floors, iterations=6)
        if wider.factors.get("position", 1.0) < _BESIDE * min(white.factors.get("position", 1.0), 1.0):
            continue
        judged = residuals_of(look.deciding)
        base, after = judged(with_factors(prepared, white.factors)), judged(with_factors(wide, wider.factors))
        gain, sigma = gain_of(base, after)
        if gain > max(_CERTAIN * sigma, LEAST_GAIN) or (not look.held and proven(base, after)):
            return wide, wider, gain
        lead = max(lead, 0.0 if look.held else gain)
    return None, white, lead


class _Look(NamedTuple):
    """Fixes that compare slow errors, and those that decide; factors to try them beside; the shortest; held back?"""

    comparing: tuple[Trial, ...]
    deciding: tuple[Trial, ...]
    beside: tuple[dict[str, float], ...]
    shortest: float
    held: bool


def _looks(prepared: PreparedRun, white: Fit, sets: tuple[BoolArray, BoolArray]) -> list[_Look]:
    """The two looks of :func:`likeliest_slow_error`."""
    every = _every_second(prepared, sets[0] | sets[1])
    of_gnss = {name: factor for name, factor in white.factors.items() if name not in _OF_IMU}
    of_imu = {name: factor for name, factor in white.factors.items() if name in _OF_IMU}
    held = _Look(trials(prepared, *sets, phases=1), trials(prepared, *sets), (white.factors, of_imu), 0.0, True)
    return [held, _Look(every, every, (white.factors, of_gnss, of_imu, {}), _SLOW_S, False)]


def _best(prepared: PreparedRun, white: Fit, look: _Look) -> tuple[dict[str, float], SlowError] | None:
    """Factors and the slow error beside them that are likeliest, the usual first; None if none is likelier."""
    judged = residuals_of(look.comparing)
    base = judged(with_factors(prepared, white.factors))
    best, most = None, 0.0
    for factors in look.beside:
        tuned = with_factors(prepared, factors)
        errors = [error for error in candidates(tuned) if error.tau >= look.shortest]
        gains = [gain_of(base, judged(with_slow_error(tuned, error))) for error in errors]
        largest = max(gain for gain, _ in gains)
        k = next(i for i, (gain, _) in enumerate(gains) if gain > largest - CLEARLY)
        if look.held and gains[k][0] > max(_CERTAIN * gains[k][1], LEAST_GAIN):
            return factors, errors[k]
        if not look.held and gains[k][0] > most:
            best, most = (factors, errors[k]), gains[k][0]
    return best


def _possible(prepared: PreparedRun) -> bool:
    """Whether a slow error of positions can be a state: positions are measured, and have none yet."""
    return prepared.ranges is None and "b_r" not in prepared.layout and bool(np.any(prepared.schedule.kind == POSITION))


def _every_second(prepared: PreparedRun, fixes: BoolArray) -> tuple[Trial, ...]:
    """The trial that is given all fixes a second apart."""
    return trials(prepared, fixes, phases=1)[:1]


def _loss(residuals: Residuals) -> float:
    """Negative log likelihood, infinite if it is no number."""
    loss = float(residuals.scores().sum())
    return loss if np.isfinite(loss) else np.inf
