"""Warm-up and temperature: what a log drifts by beyond what its own noise explains, found before noise is fitted.

A random walk looks like a trend whenever one looks for it. So every trend is estimated together with the noise: the
log is averaged to some hundred blocks, their covariance is that of white noise, flicker and random walk in
proportions from a grid, and trend and proportions are chosen by maximum likelihood (generalised least squares inside).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from math import isfinite, sqrt
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.characterisation.findings import Finding
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, NoiseModel, RandomWalk, White, flicker

#: Probability that noise alone is called a trend.
FALSE_ALARM = 0.01
_BLOCKS = 120
#: Settling times tried, relative to the length of the log.
_SETTLING = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6)
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
        Of the shape tested first (ramp) where the kind is none.
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
        Of the more likely of ``b0 + b1 t`` and ``b0 + b1 exp(-t / tau)``, or of kind ``none``.

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
    shapes = np.stack([s - 0.5, *(np.exp(-s / tau) for tau in _SETTLING)], axis=1)
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
    found = Finding("trend", text, 0.0, duration)
    return Trend("ramp", slope, sigma, None, p, _share(y, fit.value * s), fit.noise, duration, (found,))


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
    found = Finding("temperature", text, 0.0, duration)
    return Trend("temperature", value, sigma, None, p, share, fit.noise, duration, (found,), reference)


def settled_from(trend: Trend, tolerance: float | None = None) -> float:
    """Time after the first sample from which on the rest of a warm-up does not matter. [s]

    Parameters
    ----------
    trend : Trend
        Of :func:`warm_up`.
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


# ------------------------------------------------------------------------------------------------- likelihood


@dataclass(frozen=True)
class _Fit:
    """Coefficient of a shape, its uncertainty, the noise, the logarithm of the likelihood."""

    value: float
    sigma: float
    likelihood: float
    noise: NoiseModel


@lru_cache(maxsize=4)
def whiteners(J: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inverse Cholesky factors of the covariance of J block means for p proportions of noise.

    Returns the factors, shape (p, J, J), logarithms of the determinants (p,) and the proportions (p, 3).

    Each kind is scaled to unit Allan variance at sqrt(J) blocks; the proportions (white, flicker, random walk) are
    powers of ten. The random walk starts at zero, and with a constant in the model that is no restriction.
    """
    i = np.arange(J, dtype=np.float64)
    middle = sqrt(J)
    lag = np.abs(i[:, None] - i)
    # flicker as a sum of Gauss-Markov processes, averaged over blocks, from a block's to a hundred logs' time
    pink, taus = np.zeros((J, J)), np.geomspace(0.3, 100.0 * J, max(8, round(2.0 * np.log10(300.0 * J))))
    for tau in taus:
        a = np.exp(-1.0 / tau)
        across = tau**2 * (1.0 - a) ** 2 / a * np.exp(-lag / tau)
        pink += np.where(lag == 0.0, 2.0 * tau - 2.0 * tau**2 * (1.0 - a), across)
    walk = np.minimum(i[:, None], i) + 0.5
    walk[np.diag_indices(J)] = i + 1.0 / 3.0
    parts = [np.eye(J) * middle, pink * (np.pi / np.log(taus[1] / taus[0])) ** -1 / 0.664**2, walk * 3.0 / middle]
    steps = (0.0, *10.0 ** np.arange(-3.0, 3.01, 0.5))
    weights = np.array([(a, 1.0, b) for a in steps for b in steps])
    L = np.linalg.cholesky(np.einsum("pk,kij->pij", weights, np.array(parts)))
    logdet = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    return np.ascontiguousarray(np.linalg.inv(L)), logdet, weights


def fit_shapes(y: FloatArray, shapes: FloatArray, duration: float) -> tuple[_Fit, list[_Fit]]:
    """Most likely constant and noise without a shape, and with each column of ``shapes``, shape (J, k)."""
    J = len(y)
    whiten, logdet, weights = whiteners(J)
    data = np.column_stack((np.ones(J), (y - y.mean()) / y.std(), shapes))
    white = (whiten.reshape(-1, J) @ data).reshape(len(weights), J, -1)
    gram = white.transpose(0, 2, 1) @ white
    # what is left of the other columns when the constant has been taken out
    left = gram - gram[:, :, :1] * gram[:, :1, :] / gram[:, :1, :1]
    # a noiseless ramp leaves rounding only, which may be negative
    floor = 1e-20 * left[:, 1, 1]
    fits = [_best(left[:, 1, 1], np.zeros_like(logdet), np.ones_like(logdet), 1, y, duration)]
    for k in range(2, data.shape[1]):
        value = left[:, 1, k] / left[:, k, k]
        squares = np.maximum(left[:, 1, 1] - value * left[:, 1, k], floor)
        fits.append(_best(squares, value, left[:, k, k], 2, y, duration))
    return fits[0], fits[1:]


def _best(
    squares: FloatArray, value: FloatArray, information: FloatArray, parameters: int, y: FloatArray, duration: float
) -> _Fit:
    """The proportion of noise with the largest likelihood; ``squares`` sums whitened residuals of y over its spread."""
    J, scale = len(y), float(y.std())
    _, logdet, weights = whiteners(J)
    likelihood = -0.5 * (J * np.log(squares / J) + logdet)
    k = int(np.argmax(likelihood))
    variance = float(squares[k]) / (J - parameters)
    sigma = scale * sqrt(variance / float(information[k])) if parameters > 1 else 0.0
    root = scale * sqrt(variance)
    return _Fit(scale * float(value[k]), sigma, float(likelihood[k]), _noise(root, weights[k], duration / J, J))


def _noise(root: float, weights: FloatArray, dt: float, J: int) -> NoiseModel:
    """The noise that has these shares of Allan variance at sqrt(J) blocks of dt seconds."""
    w, f, r = (root * sqrt(float(share)) for share in weights)
    tau = sqrt(J) * dt
    return White(w * sqrt(tau)) + flicker(f / 0.664, dt, 100.0 * J * dt) + RandomWalk(r * sqrt(3.0 / tau))


def _finer(y: FloatArray, duration: float, k: int) -> tuple[float, _Fit]:
    """Settling time between the neighbours of the best one tried, relative to the duration, and its fit."""
    s = (np.arange(len(y)) + 0.5) / len(y)
    low, high = _SETTLING[max(k - 1, 0)], _SETTLING[min(k + 1, len(_SETTLING) - 1)]
    tau = np.geomspace(low, high, 13)
    fits = fit_shapes(y, np.exp(-s[:, None] / tau), duration)[1]
    best = int(np.argmax([fit.likelihood for fit in fits]))
    return float(tau[best]), fits[best]


def _settling(y: FloatArray, duration: float, best: tuple[float, _Fit], p: float, axis: str) -> Trend:
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
    found = Finding("trend", text, 0.0, min(start, duration))
    return Trend(trend.kind, trend.value, trend.sigma, trend.tau_s, p, trend.share, trend.noise, duration, (found,))


def _wander(noise: NoiseModel, tau: float, duration: float) -> float:
    return float(np.sqrt(noise.allan_variance(min(tau, 0.25 * duration))))


def _share(y: FloatArray, trend: FloatArray) -> float:
    """Reduction of the variance of the block means, not below zero."""
    return float(np.clip(1.0 - np.var(y - trend) / np.var(y), 0.0, 1.0))


def block_means(
    x: ArrayLike, rate_hz: float, temperature: ArrayLike | None = None
) -> tuple[FloatArray, float, FloatArray | None]:
    """Means of equal blocks of x (and temperature), and the time they cover; missing samples are left out of them."""
    values = np.asarray(x, dtype=np.float64)
    if values.ndim != 1 or len(values) < 200:
        raise InputError(f"x: expected one axis with at least 200 samples, got shape {values.shape}")
    if not (isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz}")
    J = min(_BLOCKS, len(values) // 2)
    m = len(values) // J
    parts = values[: J * m].reshape(J, m)
    good = np.isfinite(parts)
    if not good.any(axis=1).all():
        k = int(np.flatnonzero(~good.any(axis=1))[0])
        raise InputError(
            f"x: expected some samples in every {m / rate_hz:.1f} s, but all are missing from {k * m / rate_hz:.1f} s "
            "on; cut the log at the gap"
        )
    y = np.sum(np.where(good, parts, 0.0), axis=1) / good.sum(axis=1)
    if np.ptp(y) == 0.0:
        raise InputError(f"x: expected noise, but every sample reads {y[0]:.6g}")
    if temperature is None:
        return y, J * m / rate_hz, None
    T = np.asarray(temperature, dtype=np.float64)
    if T.shape != values.shape or not np.isfinite(T).all():
        raise InputError(
            f"temperature: expected {len(values)} finite numbers, one for each sample, got shape {T.shape}"
        )
    T = T[: J * m].reshape(J, m)
    return y, J * m / rate_hz, np.sum(np.where(good, T, 0.0), axis=1) / good.sum(axis=1)
