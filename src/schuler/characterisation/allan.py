"""Allan deviation and its relatives, with confidence bounds at every averaging time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.characterisation import confidence as conf
from schuler.characterisation.confidence import exponents, fit_mixture, lag1_exponents
from schuler.characterisation.differences import Mixture, has_covariance
from schuler.characterisation.variance import Signal, allan_variances, integrate_signal
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.sensors.noise import Process

Kind: TypeAlias = Literal[
    "overlapping", "non-overlapping", "modified", "time", "hadamard", "overlapping hadamard", "total"
]
Noise: TypeAlias = Process | ArrayLike | Literal["lag1"] | None
Progress: TypeAlias = Callable[[float], None]

_PER_OCTAVE = 5  # of the list "log"


@explains_arguments
def allan_deviation(
    x: ArrayLike,
    rate_hz: float,
    *,
    kind: Kind = "overlapping",
    taus: str | ArrayLike = "octave",
    data: Literal["rate", "integral"] = "rate",
    confidence: float = 0.95,
    noise: Noise = None,
    progress: Progress | None = None,
) -> AllanCurve:
    """Allan deviation, or a relative, of one signal.

    Parameters
    ----------
    x : array_like, shape (n,) or (n + 1,)
        Rate-like signal (rad/s, m/s^2) at regular intervals, or its integral (rad, m/s), which has one value more. NaN
        marks a missing sample; :func:`on_grid` makes such an array of stamped samples.
    rate_hz : float
        Sampling rate. [Hz]
    kind : str
        ``overlapping`` (default), ``non-overlapping``, ``modified``, ``time`` (tau / sqrt(3) times the modified one),
        ``hadamard``, ``overlapping hadamard``, ``total``.
    taus : {"octave", "decade", "log", "all"} or array_like
        1, 2, 4, 8, ...; 1, 2, 4, 10, 20, 40, ...; 5 per octave; every number of samples; or averaging times in seconds,
        which are rounded to whole samples. The named lists end where two differences fit into the record without
        overlap (a third of it for the Allan deviation, a quarter for modified and Hadamard, a half for total); an
        array may go on to a single difference.
    data : {"rate", "integral"}
        What ``x`` is.
    confidence : float
        Probability that the bounds contain the true deviation.
    noise : None, Process, "lag1", float or array_like
        What the bounds assume. None: a mixture of noises fitted to the curve. A process of
        :mod:`schuler.sensors.noise`. ``"lag1"``: the power law found by the lag-1 autocorrelation at each averaging
        time. A number: the exponent alpha of the spectrum; an array: one for each averaging time.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    AllanCurve
        ``low``, ``high`` and ``edf`` hold for normal noise whose level stays the same; :mod:`.nonstationarity` tells
        whether it does, and widens them. Below 20 degrees of freedom the bounds come from the true
        distribution of the estimate; there they are narrower than chi-square with ``edf``.

    Raises
    ------
    InputError
        If the signal is too short, not one-dimensional or infinite; if an option is unknown; if an averaging time is
        shorter than half a sample or too long; if modified, time or total are asked of a signal with gaps.

    Notes
    -----
    **Gaps.** Of an integral, differences with all of their values there count; that is exact. Of a rate, a cluster
    counts if at least 80 % of its samples are there, and its mean is that of those. White noise makes such means
    scatter more than full ones; the excess, known from the present numbers and the variance at one sample, is taken
    off, so the result is right in the mean for white and for slow noise. What quantisation (pulses) lost in a gap
    cannot be restored: the curve is then too high at long averaging times.

    **Total** deviation is divided by its known bias for the noise found.

    References
    ----------
    Flenniken (2005), appendix A (A.5 there lacks the square, A.6 calls the deviation a variance); IEEE Std 952, annex
    C; Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065 (2008), section 5.
    """
    dt = 1.0 / _positive(rate_hz, "rate_hz")
    if kind not in conf.KINDS:
        raise InputError(f"kind: expected one of {', '.join(conf.KINDS)}, got {kind!r}")
    if data not in ("rate", "integral"):
        raise InputError(f"data: expected 'rate' or 'integral', got {data!r}")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence: expected a probability between 0 and 1 such as 0.95, got {confidence!r}")
    signal = integrate_signal(x, data, dt)
    order, _, modified = conf.KINDS[kind]
    ms = averaging_numbers(taus, signal.n, dt, order + modified, half=kind == "total")
    if signal.missing and kind in ("modified", "time", "total"):
        raise InputError(
            f"kind: {kind!r} needs a signal without gaps, got {signal.missing} missing samples; use 'overlapping' "
            "or 'overlapping hadamard', or cut the signal to a stretch without gaps"
        )
    variance, count = allan_variances(signal, kind, ms, progress)
    if isinstance(taus, str):
        ms, variance, count = ms[count > 0], variance[count > 0], count[count > 0]
    if len(ms) == 0 or np.any(count == 0):
        where = "any averaging time" if len(ms) == 0 else f"the averaging time {ms[count == 0][0] * dt:g} s"
        raise InputError(f"taus: with its gaps the signal has no difference at {where}; leave it out")

    tau: FloatArray = ms.astype(np.float64) * dt
    model, alpha = _noise(noise, signal, kind, ms, variance, count, dt)
    if kind == "total":
        variance = variance / [conf.total_bias(float(a), int(m), signal.n) for a, m in zip(alpha, ms, strict=True)]
    lengths = _gapless_lengths(kind, ms, count)
    freedom, low, high = conf.bounds(kind, ms, lengths, model, alpha, dt, confidence, fitted=noise is None)
    scale = tau / np.sqrt(3.0) if kind == "time" else 1.0
    deviation = np.sqrt(variance)
    return AllanCurve(
        tau=tau,
        deviation=deviation * scale,
        low=deviation * np.sqrt(low) * scale,
        high=deviation * np.sqrt(high) * scale,
        edf=freedom,
        count=count,
        alpha=alpha,
        kind=kind,
        confidence=confidence,
        rate_hz=float(rate_hz),
        samples=signal.n,
        missing=signal.missing,
    )


def averaging_numbers(taus: str | ArrayLike, n: int, dt: float, order: int, half: bool = False) -> IntArray:
    """Averaging times as numbers of samples, increasing and different.

    Parameters
    ----------
    taus : str or array_like
        See :func:`allan_deviation`.
    n : int
        Samples.
    dt : float
        Sampling interval. [s]
    order : int
        Clusters of one difference: 2 for Allan, 3 for modified and Hadamard.
    half : bool
        Lists go to half of the record: for the total variance, which is defined up to all of it.

    Raises
    ------
    InputError
        If a list is unknown, or a time is shorter than half a sample or has no difference.
    """
    last = n // 2 if half else max(1, n // (order + 1))
    if isinstance(taus, str):
        if taus == "octave":
            m = 2 ** np.arange(int(np.log2(last)) + 2)
        elif taus == "decade":
            m = np.multiply.outer(10 ** np.arange(int(np.log10(last)) + 2), [1, 2, 4]).ravel()
        elif taus == "log":
            m = np.round(2.0 ** np.arange(0.0, np.log2(last) + 1e-9, 1.0 / _PER_OCTAVE))
        elif taus == "all":
            m = np.arange(1, last + 1)
        else:
            raise InputError(f"taus: expected octave, decade, log, all or times in seconds, got {taus!r}")
        return np.unique(m[m <= last]).astype(np.int64)
    times = np.atleast_1d(as_floats(taus, "taus"))
    if times.ndim != 1 or len(times) == 0:
        raise InputError(f"taus: expected a list of times, got shape {times.shape}")
    longest = n - 1 if half else n // order
    numbers = np.unique(np.round(times / dt).astype(np.int64))
    if numbers[0] < 1 or numbers[-1] > longest:
        raise InputError(
            f"taus: expected times from {dt:g} s (one sample) to {longest * dt:g} s (one difference in {n} samples), "
            f"got {times.min():g} s to {times.max():g} s"
        )
    return numbers


def _noise(
    noise: Noise, s: Signal, kind: str, ms: IntArray, variance: FloatArray, count: IntArray, dt: float
) -> tuple[Mixture | FloatArray, FloatArray]:
    """Noise that the bounds assume, and its exponents at the averaging times."""
    tau: FloatArray = ms.astype(np.float64) * dt
    if noise is None:
        octaves, values, n = _octaves(s, kind, ms, variance, count)
        mixture = fit_mixture(octaves, values, n, dt)
        return mixture, exponents(mixture, tau, dt)
    if isinstance(noise, Process):
        alpha = conf.slopes(noise, tau)
        return (((1.0, noise),) if has_covariance(noise) else alpha), alpha
    if isinstance(noise, str):
        if noise != "lag1":
            raise InputError(f"noise: expected a process, 'lag1' or exponents, got {noise!r}")
        if s.missing:
            raise InputError("noise: 'lag1' needs a signal without gaps; leave noise out, or state the exponent")
        alpha = lag1_exponents(s.X, ms)
        return alpha, alpha
    alpha = as_floats(noise, "noise")
    if alpha.ndim > 1 or (alpha.ndim == 1 and len(alpha) not in (1, len(ms))):
        raise InputError(f"noise: expected one exponent or {len(ms)}, got shape {alpha.shape}")
    if np.any((alpha < -4.0) | (alpha > 2.0)):
        raise InputError(f"noise: expected exponents from -4 to 2, got {alpha.min():g} to {alpha.max():g}")
    alpha = np.array(np.broadcast_to(alpha, (len(ms),)))
    return alpha, alpha


def _octaves(
    s: Signal, kind: str, ms: IntArray, variance: FloatArray, count: IntArray
) -> tuple[IntArray, FloatArray, int]:
    """Overlapping Allan variance about once per octave, from the curve itself where it is there."""
    octave_numbers = averaging_numbers("octave", s.n, 1.0, 2)
    if kind == "overlapping" and ms[0] == 1 and ms[-1] >= octave_numbers[-1] and np.all(ms[1:] <= 2.2 * ms[:-1]):
        nearest = np.unique(np.searchsorted(ms, octave_numbers))
        octaves, values, squares = ms[nearest], variance[nearest], count[nearest]
    else:
        values, squares = allan_variances(s, "overlapping", octave_numbers)
        octaves, values, squares = octave_numbers[squares > 0], values[squares > 0], squares[squares > 0]
    return octaves, values, int(squares[-1] + 2 * octaves[-1] - 1)


def _gapless_lengths(kind: str, ms: IntArray, count: IntArray) -> IntArray:
    """Length of a record without gaps that has as many differences. [samples]"""
    order, overlapping, modified = conf.KINDS[kind]
    if kind == "total":  # its count does not depend on the averaging time
        return count + 1
    if overlapping:
        return np.asarray(count - 1 + (order + modified) * ms - modified)
    return np.asarray((count - 1 + order) * ms)


def _positive(value: float, name: str) -> float:
    if not (np.ndim(value) == 0 and isfinite(value) and value > 0.0):
        raise InputError(f"{name}: expected one positive finite number, got {value!r}")
    return float(value)


@dataclass(frozen=True, repr=False)
class AllanCurve(Abridged):
    """Deviation of one signal over averaging times, with confidence bounds at every one of them.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times, increasing. [s]
    deviation : ndarray, shape (k,)
        Allan (or modified, Hadamard, ...) deviation. [x]
    low, high : ndarray, shape (k,)
        Bounds between which the true deviation lies with probability ``confidence``: chi-square with ``edf`` degrees of
        freedom; from :func:`.allan.allan_deviation` with fewer than 20 of them the estimate's own distribution. [x]
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom of the variance estimate.
    count : ndarray of int, shape (k,)
        How many squared differences it is the mean of; they overlap, so there are fewer degrees of freedom.
    alpha : ndarray, shape (k,)
        Exponent of the power law ``S(f) ~ f**alpha`` of the rate-like signal taken for ``edf`` around tau: 2
        quantisation, 0 white, -1 flicker, -2 random walk, -3 and -4 steeper.
    kind : str
        ``overlapping``, ``non-overlapping``, ``modified``, ``hadamard``, ``overlapping hadamard``, ``total`` or
        ``time``.
    confidence : float
        Probability of the bounds, such as 0.95.
    rate_hz : float
        Sampling rate. [Hz]
    samples : int
        Length of the signal, missing ones included.
    missing : int
        Missing samples (NaN or gaps).
    """

    tau: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    edf: FloatArray
    count: IntArray
    alpha: FloatArray
    kind: str
    confidence: float
    rate_hz: float
    samples: int
    missing: int = 0

    def __len__(self) -> int:
        return len(self.tau)

    @property
    def variance(self) -> FloatArray:
        """Square of the deviation. [x^2]"""
        squared: FloatArray = np.square(self.deviation)
        return squared

    @property
    def relative_sigma(self) -> FloatArray:
        """1-sigma uncertainty of the variance relative to it, ``sqrt(2 / edf)``."""
        relative: FloatArray = np.sqrt(2.0 / self.edf)
        return relative
