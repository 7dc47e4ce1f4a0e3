"""Warm-up and temperature: what a log drifts by beyond what its own noise explains, found before noise is fitted.

A random walk looks like a trend. Every trend is therefore estimated together with the noise, see :mod:`.likelihood`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, sqrt
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.likelihood import SETTLING, ShapeFit, block_means, fit_shapes
from schuler.characterisation.result import FALSE_ALARM, Finding
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, NoiseModel, RandomWalk, White

# Seven shapes are tried, and proportions of noise come from the same data: by simulation the chance of a likelihood
# ratio is at most this many times that of one shape with known noise. The worst case is a random walk that just shows
# at the end of the log (its walk over the log three times the white noise of a block); elsewhere it is 3 to 15.
_SHAPES_TRIED = 50.0


@dataclass(frozen=True)
class Trend:
    """A deterministic part of a log, or none.

    Attributes
    ----------
    kind : {"none", "ramp", "exponential", "temperature"}
    value : float
        Slope [x/s] of a ramp, ``b1`` [x] of ``b0 + b1 exp(-t / tau_s)``, coefficient [x/K] of a temperature; zero if
        there is no trend. Time t counts from the first sample.
    sigma : float
        1-sigma uncertainty of it under the noise found, not white noise; for an exponential with ``tau_s`` as found.
        That of the shape tested first (ramp) where the kind is none.
    tau_s : float or None
        Settling time of an exponential. [s]
    p_value : float
        Probability of so much trend in noise alone.
    share : float
        Share of the variance of the block means that the trend makes up, 0 to 1.
    noise : NoiseModel
        White noise, flicker, random walk the trend was tested against; blunt, since it is not the purpose.
    duration_s : float
    findings : tuple of Finding
        One sentence if there is a trend.
    reference : float
        Mean temperature. [degC]
    """

    kind: Literal["none", "ramp", "exponential", "temperature"]
    value: float
    sigma: float
    tau_s: float | None
    p_value: float
    share: float
    noise: NoiseModel
    duration_s: float
    findings: tuple[Finding, ...] = ()
    reference: float = field(default=0.0, compare=False)

    def at(self, t: ArrayLike) -> FloatArray:
        """The trend at times ``t`` [s] after the first sample, or at temperatures ``t`` [degC]; subtract it. [x]

        A ramp is zero at the start, an exponential in the end, a temperature effect at the mean temperature.
        """
        s = np.asarray(t, dtype=np.float64)
        if self.kind == "exponential" and self.tau_s is not None:
            return np.asarray(self.value * np.exp(-s / self.tau_s))
        if self.kind == "temperature":
            return np.asarray(self.value * (s - self.reference))
        return np.asarray(self.value * s)


def warm_up(x: ArrayLike, rate_hz: float, *, axis: str = "signal", false_alarm: float = FALSE_ALARM) -> Trend:
    """Whether a log settles exponentially or drifts linearly more than its noise explains.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate or specific force at rest; NaN marks missing samples. [rad/s] or [m/s^2]
    rate_hz : float
        Sampling rate.
    axis : str
        For the sentence.
    false_alarm : float
        Probability that noise alone is called a trend.

    Returns
    -------
    Trend
        The more likely of ``b0 + b1 t`` and ``b0 + b1 exp(-t / tau)``, or of kind ``none``.

    Raises
    ------
    InputError
        If x has fewer than 200 samples or never changes.

    Notes
    -----
    The likelihood ratio of the best shape against a constant is compared with the chi-square distribution of one
    degree of freedom, its probability multiplied by 50 for shapes and noise tried. The factor was found by simulation
    for white noise, flicker, random walk and Gauss-Markov noise; with it 0.1 to 1 % of such logs have a trend at the
    stated 1 %. In a random walk K only the ends of the log tell of a ramp: it is seen beyond about
    ``5 K / sqrt(duration)``.

    References
    ----------
    Generalised least squares: Rao (1973), section 4a. The power-law covariances: those of
    :mod:`schuler.sensors.noise`.
    """
    from scipy.stats import chi2

    y, duration, _ = block_means(x, rate_hz)
    s = (np.arange(len(y)) + 0.5) / len(y)
    shapes = np.stack([s - 0.5, *(np.exp(-s / tau) for tau in SETTLING)], axis=1)
    null, fits = fit_shapes(y, shapes, duration)
    k = int(np.argmax([fit.likelihood for fit in fits]))
    ratio = 2.0 * (fits[k].likelihood - null.likelihood)
    p = min(1.0, _SHAPES_TRIED * float(chi2.sf(max(ratio, 0.0), 1)))
    if p >= false_alarm:
        return Trend("none", 0.0, fits[0].sigma / duration, None, p, 0.0, null.noise, duration)
    if k > 0:
        return _settling(y, duration, _finer(y, duration, k - 1), p, axis)
    fit = fits[0]
    slope, sigma = fit.value / duration, fit.sigma / duration
    text = (
        f"{axis}: drifts by {fit.value:+.3g} in {duration:.0f} s ({slope:.3g} +- {sigma:.2g} per second), beyond its "
        f"own noise (p = {p:.1g}); remove the ramp, or long averaging times show it and not the sensor"
    )
    finding = Finding("trend", text, 0.0, duration)
    return Trend("ramp", slope, sigma, None, p, _share(y, fit.value * s), fit.noise, duration, (finding,))


def temperature_trend(
    x: ArrayLike, temperature: ArrayLike, rate_hz: float, *, axis: str = "signal", false_alarm: float = FALSE_ALARM
) -> Trend:
    """Change of a log with temperature.

    Parameters
    ----------
    x : array_like, shape (n,)
        NaN marks missing samples. [rad/s] or [m/s^2]
    temperature : array_like, shape (n,)
        [degC]
    rate_hz : float
    axis : str
        For the sentence.
    false_alarm : float
        Probability that noise alone is called a trend, if temperature has nothing to do with it.

    Returns
    -------
    Trend
        ``kind`` is ``temperature`` or ``none``; ``value`` [x/K] is given in both cases. Its ``sigma`` is that of
        generalised least squares; ordinary least squares takes two drifts for cause and effect.

    Raises
    ------
    InputError
        If the lengths differ, there are fewer than 200 samples, or the temperature never changes.

    Notes
    -----
    A line only. Ask for a polynomial and its hysteresis where temperature is changed on purpose.
    """
    from scipy.stats import chi2

    y, duration, T = block_means(x, rate_hz, temperature)
    assert T is not None
    if np.ptp(T) == 0.0:
        raise InputError(f"temperature: expected it to change, but it is {T[0]:.3g} degC all the time")
    reference, span = float(T.mean()), float(np.ptp(T))
    column = (T - reference) / span
    null, (fit,) = fit_shapes(y, column[:, None], duration)
    p = min(1.0, 2.0 * float(chi2.sf(max(2.0 * (fit.likelihood - null.likelihood), 0.0), 1)))
    value, sigma, share = fit.value / span, fit.sigma / span, _share(y, fit.value * column)
    if p >= false_alarm:
        return Trend("none", value, sigma, None, p, share, null.noise, duration, (), reference)
    text = (
        f"{axis}: follows the temperature by {value:.3g} +- {sigma:.2g} per kelvin over {T.min():.1f} to "
        f"{T.max():.1f} degC, {100.0 * share:.0f} % of its slow changes (p = {p:.1g}); "
        "remove it, or long averaging times show the weather"
    )
    finding = Finding("temperature", text, 0.0, duration)
    return Trend("temperature", value, sigma, None, p, share, fit.noise, duration, (finding,), reference)


def settled_from(trend: Trend, tolerance: float | None = None) -> float:
    """Time after the first sample from which on the rest of a warm-up does not matter. [s]

    Parameters
    ----------
    trend : Trend
        From :func:`warm_up`.
    tolerance : float, optional
        What may be left of the exponential. None: the Allan deviation of the noise at the settling time (but at most
        a quarter of the log), so that the rest is below what the sensor does anyway. [x]

    Returns
    -------
    float
        0 if nothing settles; infinity for a ramp, which never ends, and where it is beyond the end of the log.

    Raises
    ------
    InputError
        If the tolerance is not positive.
    """
    if tolerance is not None and not (isfinite(tolerance) and tolerance > 0.0):
        raise InputError(f"tolerance: expected a positive number, got {tolerance}")
    if trend.kind == "ramp":
        return float("inf")
    if trend.kind != "exponential" or trend.tau_s is None:
        return 0.0
    limit = _wander(trend.noise, trend.tau_s, trend.duration_s) if tolerance is None else tolerance
    start = max(0.0, trend.tau_s * float(np.log(abs(trend.value) / limit)))
    return start if start < trend.duration_s else float("inf")


def mean_with_sigma(x: ArrayLike, rate_hz: float) -> tuple[float, float]:
    """Mean of a log and its uncertainty under the noise found in it.

    Parameters
    ----------
    x : array_like, shape (n,)
        NaN marks missing samples. [x]
    rate_hz : float

    Returns
    -------
    mean, sigma : float
        ``sigma`` is what this noise makes of the mean over T seconds: ``N / sqrt(T)`` for white noise,
        ``K sqrt(T / 3)`` for a random walk that starts at zero, and the deviation of the mean of those Gauss-Markov
        terms of the flicker that are faster than T; slower ones cannot be told from the bias. [x]

    Raises
    ------
    InputError
        If x has fewer than 200 samples or never changes.
    """
    y, duration, _ = block_means(x, rate_hz)
    noise = fit_shapes(y, np.empty((len(y), 0)), duration)[0].noise
    variance = 0.0
    for term in noise.terms:
        if isinstance(term, GaussMarkov) and term.tau < duration:
            a = duration / term.tau
            variance += term.sigma**2 * 2.0 * (a - 1.0 + np.exp(-a)) / a**2
        elif isinstance(term, RandomWalk):
            variance += term.K**2 * duration / 3.0
        elif isinstance(term, White):
            variance += term.N**2 / duration
    return float(np.mean(y)), sqrt(variance)


def _finer(y: FloatArray, duration: float, k: int) -> tuple[float, ShapeFit]:
    """Settling time between the neighbours of the best one tried, relative to the duration, and its fit."""
    s = (np.arange(len(y)) + 0.5) / len(y)
    low, high = SETTLING[max(k - 1, 0)], SETTLING[min(k + 1, len(SETTLING) - 1)]
    tau = np.geomspace(low, high, 13)
    fits = fit_shapes(y, np.exp(-s[:, None] / tau), duration)[1]
    best = int(np.argmax([fit.likelihood for fit in fits]))
    return float(tau[best]), fits[best]


def _settling(y: FloatArray, duration: float, best: tuple[float, ShapeFit], p: float, axis: str) -> Trend:
    tau, fit = best
    s = (np.arange(len(y)) + 0.5) / len(y)
    trend = Trend(
        "exponential",
        fit.value,
        fit.sigma,
        tau * duration,
        p,
        _share(y, fit.value * np.exp(-s / tau)),
        fit.noise,
        duration,
    )
    start = settled_from(trend)
    advice = (
        f"start at {start:.0f} s"
        if start < 0.7 * duration
        else "most of the log is warm-up: remove the exponential, or record again when warm"
    )
    text = (
        f"{axis}: settles by {-fit.value:+.3g} with a time constant of {tau * duration:.0f} s, beyond its own noise "
        f"(p = {p:.1g}); {advice}"
    )
    finding = Finding("trend", text, 0.0, min(start, duration))
    return Trend(trend.kind, trend.value, trend.sigma, trend.tau_s, p, trend.share, trend.noise, duration, (finding,))


def _wander(noise: NoiseModel, tau: float, duration: float) -> float:
    return float(np.sqrt(noise.allan_variance(min(tau, 0.25 * duration))))


def _share(y: FloatArray, trend: FloatArray) -> float:
    """Reduction of the variance of the block means, not below zero."""
    return float(np.clip(1.0 - np.var(y - trend) / np.var(y), 0.0, 1.0))
