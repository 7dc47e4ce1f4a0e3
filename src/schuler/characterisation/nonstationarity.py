"""Noise whose level changes in the course of a log, and what that leaves of the bounds of its Allan curve.

Bounds of an Allan curve count sampling error of stationary noise. Vibration, people and temperature make the
level itself change, and then another log of the same length has another curve. A log is cut into eight
parts; halves, quarters and eighths that are neighbours are compared at every averaging time. Where they differ beyond
chance, the difference is taken alike at all three lengths (the level wanders like flicker noise), and the next log of
this length differs from this one by as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.result import FALSE_ALARM, Finding, finding_at
from schuler.characterisation.variance import Signal, allan_variances, integrate_signal

_PARTS = 8
_SCALES = (4, 2, 1)  # parts in one of the two that are compared: halves, quarters, eighths
_FREEDOM = len(_SCALES) ** 2 / (1.0 + 1.0 / 2.0 + 1.0 / 4.0)  # of their mean: one, two and four squares (Satterthwaite)
_AVERAGES = 6  # averaging times that an eighth must hold
_SURE = 1e-3  # chance of one averaging time below which a change is worth a word: ten of them in a curve are apart
_LARGE = 1.25  # ratio of deviations from which on it is a warning


@dataclass(frozen=True, slots=True)
class LevelScatter:
    """Change of a log's Allan deviation between its parts, beyond sampling error.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times. [s]
    sigma : ndarray, shape (k,)
        Standard deviation of the logarithm of the Allan deviation from one log of this length to the next. Zero where
        parts do not differ beyond chance (1 %); beyond the longest averaging time that an eighth of the log tells of,
        the last value.
    probability : ndarray, shape (k,)
        Chance of such differences in stationary noise; NaN where an eighth is too short.
    ratio : ndarray, shape (k,)
        Largest over smallest Allan deviation of the eighths; NaN where they are too short.
    largest : ndarray of int, shape (k,)
        Which eighth has the largest, from 0; -1 where they are too short.
    """

    tau: FloatArray
    sigma: FloatArray
    probability: FloatArray
    ratio: FloatArray
    largest: np.ndarray


def level_scatter(x: ArrayLike, curve: AllanCurve) -> LevelScatter:
    """Compare the Allan deviations of parts of a log with one another.

    Parameters
    ----------
    x : array_like, shape (n,)
        The samples; NaN marks a missing one. [x]
    curve : AllanCurve
        Their overlapping Allan deviation; its degrees of freedom are those of the whole log.

    Returns
    -------
    LevelScatter

    Notes
    -----
    With v the Allan variances of two neighbouring parts, ``d = ln(v1 / v2)`` has the variance ``2 psi'(edf / 2)`` of
    log chi-square in stationary noise, edf that of one of the two. The sum of the seven squares (one pair of halves,
    two of quarters, four of eighths) over their variances is compared with chi-square. The excess of the mean square,
    averaged over the three lengths and over averaging times within an octave, is that of the next pair, of logs as long
    as this one; each has half of it.

    References
    ----------
    Percival and Walden (2000), Wavelet Methods for Time Series Analysis, section 9.6 (tests for a change of variance).
    """
    from scipy.special import polygamma
    from scipy.stats import chi2

    m = np.round(curve.tau * curve.rate_hz).astype(np.int64)
    signal = integrate_signal(x, "rate", 1.0 / curve.rate_hz)
    judged = np.flatnonzero(_AVERAGES * m <= signal.n // _PARTS)
    sigma, nothing = np.zeros(len(m)), np.full(len(m), np.nan)
    v = _of_parts(signal, m[judged])
    good = np.all(np.isfinite(v) & (v > 0.0), axis=0)
    judged, v = judged[good], v[:, good]
    scatter = LevelScatter(curve.tau, sigma, nothing.copy(), nothing.copy(), np.full(len(m), -1))
    if not len(judged):
        return scatter
    edf = np.maximum(curve.edf[judged] / _PARTS, 1.0)
    squares, excess = np.zeros(len(judged)), np.zeros(len(judged))
    for width in _SCALES:
        of_scale = np.log(v.reshape(_PARTS // width, width, -1).mean(axis=1))
        d = of_scale[0::2] - of_scale[1::2]
        chance = 2.0 * polygamma(1, 0.5 * width * edf)
        squares += np.sum(d**2, axis=0) / chance
        excess += (np.mean(d**2, axis=0) - chance) / len(_SCALES)
    p = chi2.sf(squares, _PARTS - 1)
    excess = np.where(p < FALSE_ALARM, np.maximum(excess, 0.0), 0.0)
    octave = np.log2(curve.tau[judged])
    near = np.abs(octave[:, None] - octave) < 1.01
    smooth = np.where(excess > 0.0, near @ excess / near.sum(axis=1), 0.0)
    sigma[judged] = 0.5 * np.sqrt(0.5 * smooth)
    sigma[judged[-1] + 1 :] = sigma[judged[-1]]
    scatter.probability[judged] = p
    scatter.ratio[judged] = np.sqrt(v.max(axis=0) / v.min(axis=0))
    scatter.largest[judged] = np.argmax(v, axis=0)
    return scatter


def _of_parts(s: Signal, m: np.ndarray) -> FloatArray:
    """Overlapping Allan variances of equal parts, shape (8, k); NaN where gaps leave none."""
    edges = np.linspace(0, s.n, _PARTS + 1).astype(np.int64)
    parts = [
        Signal(s.X[a : b + 1], None if s.present is None else s.present[a : b + 1], s.missing, s.unit)
        for a, b in pairwise(edges)
    ]
    return np.array([allan_variances(part, "overlapping", m)[0] for part in parts])


def allow_for(curve: AllanCurve, scatter: LevelScatter) -> AllanCurve:
    """The curve with bounds widened by the scatter of the level.

    Sampling error and scatter of the level add as squares of logarithms; the scatter is known from seven differences
    only, so that its quantile is Student's, with 5.1 degrees of freedom.
    """
    from scipy.special import stdtrit

    more = float(stdtrit(_FREEDOM, 0.5 * (1.0 + curve.confidence))) * scatter.sigma
    low = curve.deviation * np.exp(-np.hypot(np.log(curve.deviation / curve.low), more))
    high = curve.deviation * np.exp(np.hypot(np.log(curve.high / curve.deviation), more))
    return replace(curve, low=np.where(more > 0.0, low, curve.low), high=np.where(more > 0.0, high, curve.high))


def scatter_findings(axis: str, scatter: LevelScatter, duration_s: float) -> list[Finding]:
    """A finding that names averaging times, size and place of the change; none where chance explains it.

    Parameters
    ----------
    axis : str
        For the sentence.
    scatter : LevelScatter
    duration_s : float
        Length of the log. [s]
    """
    sure = np.flatnonzero(scatter.probability < _SURE)  # NaN is not below
    if not len(sure):
        return []
    worst = sure[int(np.argmax(scatter.sigma[sure]))]
    first, last, ratio = scatter.tau[sure[0]], scatter.tau[sure[-1]], float(scatter.ratio[worst])
    start, stop = (float(duration_s * (scatter.largest[worst] + end) / _PARTS) for end in (0, 1))
    at = f"at {first:.3g} s" if first == last else f"at averaging times from {first:.3g} s to {last:.3g} s"
    text = (
        f"{axis}: the level of the noise is not the same throughout, {at}: at {scatter.tau[worst]:.3g} s the Allan "
        f"deviations of eighths of the log differ by up to a factor of {ratio:.3g}, most from {start:.0f} s to "
        f"{stop:.0f} s; the bounds of the curve allow for another log to differ by a factor of "
        f"{np.exp(np.sqrt(2.0) * float(scatter.sigma[worst])):.3g} (1 sigma)"
    )
    large = ratio > _LARGE and float(scatter.sigma[worst]) > 0.5 * np.log(_LARGE)
    return [finding_at("level", text, start, stop, "warning" if large else "note")]
