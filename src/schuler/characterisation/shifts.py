"""Shifts of level too small for any window of a few seconds, but not for the end of an Allan curve."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.findings import Finding
from schuler.characterisation.trends import FALSE_ALARM, block_means, fit_shapes, whiteners

_SETTLING = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6)  # relative to the length of the log
# a hundred places and the proportions of noise are chosen from the same data; by simulation, as in trends
_PLACES_TRIED = 500.0
_MOST = 3


def level_shifts(
    x: ArrayLike, rate_hz: float, *, axis: str = "signal", false_alarm: float = FALSE_ALARM
) -> tuple[Finding, ...]:
    """Shifts of level in the means of some hundred blocks of a log, beyond what its noise explains.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate or specific force at rest; NaN marks missing samples. [rad/s] or [m/s^2]
    rate_hz : float
        Sampling rate.
    axis : str
        For the sentence.
    false_alarm : float
        Probability that noise alone is called a shift.

    Returns
    -------
    tuple of Finding
        Code ``step``, at most three, the largest first, each with the time of two blocks around it.

    Raises
    ------
    InputError
        If x has fewer than 200 samples or never changes.

    Notes
    -----
    A shift is a shape estimated together with white noise, flicker and random walk, as :func:`.trends.warm_up` does it,
    with a place at every end of a block; one that a ramp or an exponential explains better is none. The likelihood
    ratio is that of one known shape, its probability multiplied by 500 for the places and noise tried. What happens
    within seconds is found better by :func:`.health.check_static_log`.
    """
    from scipy.stats import chi2

    y, duration, _ = block_means(x, rate_hz)
    J = len(y)
    s = (np.arange(J) + 0.5) / J
    smooth = np.stack([s - 0.5, *(np.exp(-s / tau) for tau in _SETTLING)], axis=1)
    found: list[Finding] = []
    while len(found) < _MOST and np.ptp(y) > 0.0:
        null, fits = fit_shapes(y, smooth, duration)
        first, height, likelihood = _likeliest(y)
        p = _PLACES_TRIED * float(chi2.sf(max(2.0 * (likelihood - null.likelihood), 0.0), 1))
        if likelihood <= max(fit.likelihood for fit in fits) or p >= false_alarm:
            break
        y = y - height * (np.arange(J) >= first)
        block = duration / J
        text = (
            f"{axis}: the level shifts by {height:+.3g} at about {first * block:.0f} s, beyond the log's own noise "
            f"(p = {p:.1g}); cut there, or long averaging times show the shift and not the sensor"
        )
        found.append(Finding("step", text, (first - 1) * block, (first + 1) * block))
    return tuple(found)


def _likeliest(y: FloatArray) -> tuple[int, float, float]:
    """First block behind the likeliest shift, its height and the logarithm of its likelihood, as in trends."""
    J = len(y)
    whiten, logdet, _ = whiteners(J)
    cross, own, total = _information(J)
    z = (y - y.mean()) / y.std()
    white = whiten @ z
    g = (white[:, None, :] @ whiten)[:, 0]
    mean = g.sum(axis=1) / total  # the constant that is estimated besides
    behind = g[:, ::-1].cumsum(axis=1)[:, ::-1] - cross * mean[:, None]
    rest = np.sum(white**2, axis=1) - mean**2 * total
    inside = slice(3, J - 3)
    squares = np.maximum(rest[:, None] - behind[:, inside] ** 2 / own[:, inside], 1e-20 * rest[:, None])
    likelihood = -0.5 * (J * np.log(squares / J) + logdet[:, None])
    p, k = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    first = int(k) + 3
    return first, float(behind[p, first] / own[p, first] * y.std()), float(likelihood[p, k])


@lru_cache(maxsize=4)
def _information(J: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of shifts before each of J blocks with a constant (p, J), their own beyond it (p, J), the constant's (p,)."""
    whiten = whiteners(J)[0]
    P = whiten.transpose(0, 2, 1) @ whiten
    total = P.sum(axis=(1, 2))
    cross = P.sum(axis=2)[:, ::-1].cumsum(axis=1)[:, ::-1]
    corner = P[:, ::-1, ::-1].cumsum(axis=1).cumsum(axis=2)[:, ::-1, ::-1]
    own = np.diagonal(corner, axis1=1, axis2=2) - cross**2 / total[:, None]
    return cross, np.asarray(own), total
