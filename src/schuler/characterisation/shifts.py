"""Shifts of level in a log: abrupt ones within seconds, and small ones that show in the means of many blocks only."""

from __future__ import annotations

from functools import lru_cache
from math import ceil

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.likelihood import SETTLING, block_means, fit_shapes, whitening_factors
from schuler.characterisation.result import FALSE_ALARM, MOST_PLACES, Finding, finding_at

# a hundred places and the proportions of noise are chosen from the same data; by simulation, as in trends
_PLACES_TRIED = 500.0
_MOST = 3
_STAY_S = 5.0  # a shift of level lasts at least this long


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
    smooth = np.stack([s - 0.5, *(np.exp(-s / tau) for tau in SETTLING)], axis=1)
    findings: list[Finding] = []
    while len(findings) < _MOST and np.ptp(y) > 0.0:
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
        findings.append(Finding("step", text, (first - 1) * block, (first + 1) * block))
    return tuple(findings)


def _likeliest(y: FloatArray) -> tuple[int, float, float]:
    """First block behind the likeliest shift, its height and the logarithm of its likelihood, as in trends."""
    J = len(y)
    whiten, logdet, _ = whitening_factors(J)
    cross, information, total = _information(J)
    z = (y - y.mean()) / y.std()
    white = whiten @ z
    g = (white[:, None, :] @ whiten)[:, 0]
    mean = g.sum(axis=1) / total  # the constant that is estimated besides
    behind = g[:, ::-1].cumsum(axis=1)[:, ::-1] - cross * mean[:, None]
    residual = np.sum(white**2, axis=1) - mean**2 * total
    inside = slice(3, J - 3)
    squares = np.maximum(residual[:, None] - behind[:, inside] ** 2 / information[:, inside], 1e-20 * residual[:, None])
    likelihood = -0.5 * (J * np.log(squares / J) + logdet[:, None])
    p, k = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    first = int(k) + 3
    return first, float(behind[p, first] / information[p, first] * y.std()), float(likelihood[p, k])


@lru_cache(maxsize=4)
def _information(J: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information on shifts before each of J blocks: with a constant (p, J), beyond it (p, J); on the constant (p,)."""
    whiten = whitening_factors(J)[0]
    P = whiten.transpose(0, 2, 1) @ whiten
    total = P.sum(axis=(1, 2))
    cross = P.sum(axis=2)[:, ::-1].cumsum(axis=1)[:, ::-1]
    corner = P[:, ::-1, ::-1].cumsum(axis=1).cumsum(axis=2)[:, ::-1, ::-1]
    information = np.diagonal(corner, axis1=1, axis2=2) - cross**2 / total[:, None]
    return cross, np.asarray(information), total


def abrupt_shifts(x: FloatArray, time: FloatArray, axis: str, step: float | None) -> list[Finding]:
    """Shifts of level, the largest first."""
    from scipy.stats import t as student

    base = max(4, len(x) // 32768)
    if len(x) // base < 4 * 40:
        return []
    y = x[: len(x) // base * base].reshape(-1, base).mean(axis=1)
    interval = float(np.median(np.diff(time)))
    total = np.concatenate(([0.0], np.cumsum(y - y.mean())))
    candidates, scales, m = [], 0, 4
    rounding = 1e-300 if step is None else step  # means of pulses are good to a pulse in the window
    while len(y) >= 40 * m:
        starts = np.arange(0, len(y) - 4 * m + 1, m // 4)  # windows of m base blocks
        w = [(total[starts + (j + 1) * m] - total[starts + j * m]) / m for j in range(4)]
        # change between the middle windows less what a smooth drift makes of it
        e = 1.5 * (w[2] - w[1]) - 0.5 * (w[3] - w[0])
        e -= np.median(e)
        z = e / max(1.4826 * float(np.median(np.abs(e))), rounding / (m * base))
        # the median absolute deviation of k values is as good as the deviation of 0.37 k, if independent
        freedom = 0.37 * 0.375 * len(e)
        scales += 1
        # every scale has the same share of the false alarms: the long ones have few windows and show the small shifts
        p = len(e) * 2.0 * student.sf(np.abs(z), freedom)
        score = 0.5 * (freedom + 1.0) * np.log1p(z**2 / freedom)  # orders what underflows in p
        candidates += [(-score[i], p[i], starts[i] + m, m) for i in np.flatnonzero(p < FALSE_ALARM)]
        m *= 2
    findings: list[tuple[float, Finding]] = []
    taken: list[int] = []
    for _, p, a, m in sorted(candidates):
        if p * scales > FALSE_ALARM:
            continue
        if len(taken) >= 20 * MOST_PLACES:
            break
        if any(a - m <= other <= a + 3 * m for other in taken):
            continue  # a window holds a shift found already
        part = y[a : a + 2 * m]
        split = a + 1 + int(np.argmax(np.abs(np.cumsum(part - part.mean())[:-1])))
        taken.append(split)
        before, after = (y[max(split - m, 0) : split].mean(), y[split : split + m].mean())
        # a bump comes back, a shift stays: for four windows and five seconds
        stay = max(4 * m, ceil(_STAY_S / (base * interval)))
        change = y[split + 1 : split + stay].mean() - y[max(split - stay, 0) : split].mean()
        if change * np.sign(after - before) <= 0.5 * abs(after - before):
            continue
        at = time[split * base]
        text = (
            f"{axis}: the level shifts by {after - before:+.3g} at {at:.1f} s, more abruptly than the drift of the "
            "rest of the log; cut there, or long averaging times show the shift and not the sensor"
        )
        findings.append((abs(after - before), finding_at("step", text, at, at)))
    findings.sort(key=lambda pair: -pair[0])
    out = [finding for _, finding in findings[:MOST_PLACES]]
    if len(findings) > MOST_PLACES:
        out.append(
            Finding("step", f"{axis}: {len(findings) - MOST_PLACES} smaller shifts of level; perhaps popcorn noise")
        )
    return out
