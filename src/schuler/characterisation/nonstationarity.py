"""Noise whose level changes in the course of a log, and what that leaves of the bounds of its Allan curve.

Bounds of an Allan curve count sampling error of stationary noise. Vibration, people and temperature make the
level itself change, and then another log of the same length has another curve. A log is cut into eight
parts; halves, quarters and eighths that are neighbours are compared at every averaging time, at long ones only those
that hold six of them. Where they differ more than nine logs of ten would by chance, the difference is taken alike at
all lengths (the level wanders like flicker noise), and the next log of this length differs from this one by as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.result import Finding, finding_at
from schuler.characterisation.variance import Signal, allan_variances, integrate_signal
from schuler.plotting.notebook import Abridged

_PARTS = 8
_SPLITS = (2, 4, 8)  # halves, quarters, eighths
_AVERAGES = 6  # averaging times that a part must hold
# a bound is for the log at hand: one chance in ten of widening it in vain costs less than a change passed over
_BELIEVED = 0.1
_SURE = 1e-3  # chance of one averaging time below which a change is worth a word: ten of them in a curve are apart
_LARGE = 1.25  # ratio of deviations from which on it is a warning


@dataclass(frozen=True, slots=True, repr=False)
class LevelScatter(Abridged):
    """Change of a log's Allan deviation between its parts, beyond sampling error.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times. [s]
    sigma : ndarray, shape (k,)
        Standard deviation of the logarithm of the Allan deviation from one log of this length to the next. Zero where
        parts do not differ beyond chance (10 %); beyond the longest averaging time that a half of the log tells of, the
        last value.
    freedom : ndarray, shape (k,)
        Degrees of freedom of its square: 5.1 where eighths tell of it, 2.7 where quarters, 1 where only halves do.
    probability : ndarray, shape (k,)
        Chance of such differences in stationary noise; NaN where an eighth is too short.
    ratio : ndarray, shape (k,)
        Largest over smallest Allan deviation of the eighths; NaN where they are too short.
    largest : ndarray of int, shape (k,)
        Which eighth has the largest, from 0; -1 where they are too short.
    """

    tau: FloatArray
    sigma: FloatArray
    freedom: FloatArray
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
    log chi-square in stationary noise, edf that of one of the two. The sum of the squares (one pair of halves, two of
    quarters, four of eighths, as far as they hold six averaging times) over their variances is compared with
    chi-square. The excess of the mean square, averaged over the lengths and over averaging times within an octave, is
    that of the next pair, of logs as long as this one; each has half of it. The freedom is that of a mean over lengths
    of means of one, two and four squares (Satterthwaite).

    References
    ----------
    Percival and Walden (2000), Wavelet Methods for Time Series Analysis, section 9.6 (tests for a change of variance).
    """
    from scipy.special import polygamma
    from scipy.stats import chi2

    m = np.round(curve.tau * curve.rate_hz).astype(np.int64)
    signal = integrate_signal(x, "rate", 1.0 / curve.rate_hz)
    k, nothing = len(m), np.full(len(m), np.nan)
    squares, excess, lengths, pairs, variance = np.zeros((5, k))
    probability, ratio, largest = nothing, nothing.copy(), np.full(k, -1)
    for parts in _SPLITS:
        at = np.flatnonzero(_AVERAGES * m <= signal.n // parts)
        v = _of_parts(signal, m[at], parts)
        good = np.all(np.isfinite(v) & (v > 0.0), axis=0)
        at, v = at[good], v[:, good]
        chance = 2.0 * polygamma(1, 0.5 * np.maximum(curve.edf[at] / parts, 1.0))
        d = np.log(v[0::2] / v[1::2])
        squares[at] += np.sum(d**2, axis=0) / chance
        excess[at] += np.mean(d**2, axis=0) - chance
        lengths[at] += 1.0
        pairs[at] += len(d)
        variance[at] += 1.0 / len(d)
        if parts == _PARTS:
            ratio[at], largest[at] = np.sqrt(v.max(axis=0) / v.min(axis=0)), np.argmax(v, axis=0)
    judged = np.flatnonzero(lengths)
    sigma, freedom = np.zeros(k), np.ones(k)
    if len(judged):
        p = chi2.sf(squares[judged], pairs[judged])
        believed = np.where(p < _BELIEVED, np.maximum(excess[judged] / lengths[judged], 0.0), 0.0)
        octave = np.log2(curve.tau[judged])
        near = np.abs(octave[:, None] - octave) < 1.01
        smooth = np.where(believed > 0.0, near @ believed / near.sum(axis=1), 0.0)
        sigma[judged] = 0.5 * np.sqrt(0.5 * smooth)
        freedom[judged] = lengths[judged] ** 2 / variance[judged]
        sigma[judged[-1] + 1 :], freedom[judged[-1] + 1 :] = sigma[judged[-1]], freedom[judged[-1]]
        probability[judged] = np.where(largest[judged] < 0, np.nan, p)
    return LevelScatter(curve.tau, sigma, freedom, probability, ratio, largest)


def _of_parts(s: Signal, m: np.ndarray, parts: int) -> FloatArray:
    """Overlapping Allan variances of equal parts, shape (parts, k); NaN where gaps leave none."""
    edges = np.linspace(0, s.n, parts + 1).astype(np.int64)
    several = [
        Signal(s.X[a : b + 1], None if s.present is None else s.present[a : b + 1], s.missing, s.unit)
        for a, b in pairwise(edges)
    ]
    return np.array([allan_variances(part, "overlapping", m)[0] for part in several])


def allow_for(curve: AllanCurve, scatter: LevelScatter) -> AllanCurve:
    """The curve with bounds widened by the scatter of the level.

    Sampling error and scatter of the level add as squares of logarithms; the scatter is known from seven differences at
    most, so that its quantile is Student's.
    """
    from scipy.special import stdtrit

    more = stdtrit(scatter.freedom, 0.5 * (1.0 + curve.confidence)) * scatter.sigma
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
