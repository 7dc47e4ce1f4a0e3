"""Autocorrelation of a log, and what a finite record does to it."""

from __future__ import annotations

from dataclasses import dataclass
from math import log10, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.structure import exp_tail
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov


@dataclass(frozen=True)
class Correlation:
    """Autocovariance of one signal.

    Attributes
    ----------
    lag : ndarray, shape (k,)
        From zero. [s]
    value : ndarray, shape (k,)
        Autocovariance; the first is the variance. [x^2]
    sigma : ndarray, shape (k,)
        1-sigma uncertainty (Bartlett), without the bias of a finite record. [x^2]
    duration_s : float
        Of the record. [s]
    """

    lag: FloatArray
    value: FloatArray
    sigma: FloatArray
    duration_s: float

    @property
    def normalised(self) -> FloatArray:
        """Divided by the variance: 1 at lag zero."""
        ratio: FloatArray = self.value / self.value[0]
        return ratio

    def crossing(self, level: float = float(np.exp(-1.0))) -> float | None:
        """First lag at which the normalised autocorrelation falls to ``level``, interpolated. [s]

        At 1/e it is the correlation time of a Gauss-Markov process, read with an error of the order of
        ``sqrt(2 tau / T)`` and too short by about ``4 tau / T`` of itself. None if it does not fall so far.
        """
        below = np.flatnonzero(self.normalised <= level)
        if len(below) == 0:
            return None
        i = int(below[0])
        a, b = self.normalised[i - 1], self.normalised[i]
        return float(self.lag[i - 1] + (self.lag[i] - self.lag[i - 1]) * (a - level) / (a - b))


def autocorrelation(x: ArrayLike, rate_hz: float, *, longest_s: float | None = None) -> Correlation:
    """Autocovariance of a record at rest, its mean removed.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate-like signal at regular intervals, without gaps.
    rate_hz : float
        [Hz]
    longest_s : float, optional
        Longest lag; a quarter of the record if not given. [s]

    Returns
    -------
    Correlation

    Raises
    ------
    InputError
        If the signal is not one-dimensional, has NaN, is constant, or the longest lag is not within the record.

    Notes
    -----
    ``R(m) = 1/n sum x_k x_(k-m)``, divided by n at every lag (the biased estimator of the source), by FFT. Since the
    mean is estimated, values of a slow process come out too small: compare with :func:`expected_autocovariance`, not
    with ``sigma^2 exp(-t/tau)``.

    ``sigma`` is ``sqrt(sum_j (R_j^2 + R_(j+m) R_(j-m)) / n)``. The sums end at twice the lag after which five values in
    a row are lost in the noise (Politis), else they would collect that noise.

    References
    ----------
    Flenniken (2005), appendix D; Bartlett, J. R. Stat. Soc. Suppl. 8 (1946) 27; Politis, J. Nonparametric Stat. 15
    (2003) 453.
    """
    from scipy.fft import irfft, next_fast_len, rfft
    from scipy.signal import fftconvolve

    x = as_floats(x, "x", (None,))
    n = len(x)
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected one positive finite number, got {rate_hz!r}")
    longest = n // 4 if longest_s is None else round(longest_s * rate_hz)
    if not 1 <= longest < n:
        raise InputError(
            f"longest_s: expected a lag of one sample ({1 / rate_hz:g} s) up to the record ({n / rate_hz:g} s), got "
            f"{longest} samples"
        )
    x = x - np.mean(x)
    size = next_fast_len(n + longest, real=True)
    spectrum = rfft(x, size)
    r = np.asarray(irfft(spectrum * np.conj(spectrum), size)[: longest + 1]) / n
    if r[0] <= 0.0:
        raise InputError("x: expected a signal that varies, got a constant one; a sensor that is stuck has no noise")

    quiet = np.abs(r) < 2.0 * sqrt(log10(n) / n) * r[0]
    runs = np.convolve(quiet, np.ones(5), mode="valid") == 5.0
    end = longest if not np.any(runs) else min(longest, 2 * int(np.argmax(runs)))
    both = np.concatenate((r[end:0:-1], r[: end + 1]))
    product = np.asarray(fftconvolve(both, both))[2 * end :]  # sum over j of R_j R_(l-j), lags l from 0 to 2 end
    squares = np.zeros(longest + 1)
    twice = product[: 2 * longest + 1 : 2]
    squares[: len(twice)] = twice
    sigma = np.sqrt(np.maximum(product[0] + squares, 0.0) / n)
    return Correlation(np.arange(longest + 1) / rate_hz, r, sigma, n / rate_hz)


def expected_variance(process: GaussMarkov, duration_s: float) -> float:
    """Expected variance of a record about its own mean. [x^2]

    ``sigma^2 (1 - (2 tau/T) (1 - (tau/T) (1 - exp(-T/tau))))``: a record of ten correlation times shows 82 % of it.

    Parameters
    ----------
    process : GaussMarkov
        In its steady state.
    duration_s : float
        Length T of the record. [s]

    References
    ----------
    Integral of the autocovariance over the record; the thesis (appendix D) leaves it out.
    """
    z = np.array([duration_s / process.tau])
    return float(-2.0 * process.sigma**2 * exp_tail(z, 3)[0] / z[0] ** 2)


def mean_sigma(process: GaussMarkov, duration_s: float) -> float:
    """Standard deviation of the mean of a record: how well it shows a constant bias. [x]

    ``sigma sqrt((2 tau/T) (1 - (tau/T) (1 - exp(-T/tau))))``; see :func:`expected_variance`.
    """
    z = np.array([duration_s / process.tau])
    return float(process.sigma * np.sqrt(2.0 * exp_tail(z, 2)[0]) / z[0])


def expected_autocovariance(process: GaussMarkov, lag: ArrayLike, duration_s: float) -> FloatArray:
    """What :func:`autocorrelation` gives in the mean for a Gauss-Markov process in a finite record. [x^2]

    Parameters
    ----------
    process : GaussMarkov
        In its steady state.
    lag : array_like
        0 to ``duration_s``. [s]
    duration_s : float
        Length T of the record. [s]

    Returns
    -------
    ndarray
        ``(1 - t/T) (R(t) + V) - (2/T) integral of E[x(u) mean] over u from 0 to T - t``, V the variance of the mean.

    Raises
    ------
    InputError
        If a lag is outside the record.
    """
    t = np.asarray(lag, dtype=np.float64)
    T, tau = float(duration_s), process.tau
    if np.any((t < 0.0) | (t > T)):
        raise InputError(f"lag: expected 0 to {T:g} s, got {t.min():g} s to {t.max():g} s")
    both = 2.0 * (T - t) + tau * np.expm1(-(T - t) / tau) - tau * (np.exp(-t / tau) - np.exp(-T / tau))
    shared = process.sigma**2 * tau / T * both
    mean_variance = mean_sigma(process, T) ** 2
    return np.asarray((1.0 - t / T) * (process.autocovariance(t) + mean_variance) - 2.0 / T * shared)
