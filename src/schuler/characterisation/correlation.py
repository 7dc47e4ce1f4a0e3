"""Autocorrelation of a log, and what a finite record does to it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, log10, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.differences import exp_tail
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.sensors.noise import GaussMarkov

#: 20 000 (from T/tau = 200 on 6000) simulated records each of a Gauss-Markov process, mean removed, biased estimator of
#: the autocorrelation: T/tau; 5, 50 and 95 % of tau found over T; 5, 50 and 95 % of the standard deviation found over
#: sigma. Below the first row the process is a random walk, tau found / T does not depend on tau any more.
_RECORDS = np.array(
    [
        [0.1, 0.05111, 0.1249, 0.2166, 0.08499, 0.1529, 0.2984],
        [0.3, 0.04998, 0.1234, 0.2155, 0.1453, 0.2590, 0.5034],
        [1.0, 0.04835, 0.1166, 0.2106, 0.2612, 0.4493, 0.8172],
        [2.0, 0.04583, 0.1072, 0.2036, 0.3553, 0.5870, 1.0180],
        [3.0, 0.04286, 0.09886, 0.1954, 0.4214, 0.6715, 1.1090],
        [5.0, 0.03845, 0.0841, 0.1770, 0.5072, 0.7670, 1.1970],
        [7.0, 0.03548, 0.07342, 0.1597, 0.5660, 0.8202, 1.2130],
        [10.0, 0.03071, 0.06043, 0.1320, 0.6246, 0.8665, 1.2220],
        [15.0, 0.02547, 0.0467, 0.09983, 0.6850, 0.9068, 1.2050],
        [20.0, 0.02174, 0.03785, 0.07928, 0.7269, 0.9280, 1.1950],
        [30.0, 0.01696, 0.02776, 0.05225, 0.7754, 0.9520, 1.1720],
        [50.0, 0.01199, 0.01796, 0.0302, 0.8278, 0.9713, 1.1440],
        [100.0, 0.006972, 0.009435, 0.01379, 0.8780, 0.9846, 1.1060],
        [200.0, 0.003866, 0.004845, 0.006313, 0.9148, 0.9919, 1.0760],
        [500.0, 0.00171, 0.001977, 0.002319, 0.9463, 0.9967, 1.0490],
        [1000.0, 0.0008944, 0.0009936, 0.001115, 0.9618, 0.9981, 1.0360],
    ]
)
Triple = tuple[float, float, float]


@dataclass(frozen=True, repr=False)
class Correlation(Abridged):
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
        Length of the record. [s]
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
    """Expectation of :func:`autocorrelation` for a Gauss-Markov process in a finite record. [x^2]

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


@dataclass(frozen=True, slots=True)
class FiniteRecord:
    """Statistics of a Gauss-Markov bias in a record of finite length, relative to the truth.

    Attributes
    ----------
    variance_ratio : float
        Expected sample variance over sigma^2.
    mean_sigma : float
        Standard deviation of the record's mean over sigma.
    sigma_ratio : (float, float, float)
        5, 50 and 95 % of the sample standard deviation over sigma.
    tau_ratio : (float, float, float)
        5, 50 and 95 % of the correlation time found over tau.
    """

    variance_ratio: float
    mean_sigma: float
    sigma_ratio: Triple
    tau_ratio: Triple


def finite_record(duration: float, tau: float) -> FiniteRecord:
    """Bias and spread of sample variance, mean and 1/e correlation time of a Gauss-Markov process.

    Parameters
    ----------
    duration : float
        Length of the record T. [s]
    tau : float
        True correlation time. [s]

    Returns
    -------
    FiniteRecord

    Raises
    ------
    InputError
        If one is not positive and finite.

    Notes
    -----
    With z = T/tau the mean has variance ``sigma^2 (2/z) (1 - (1 - exp(-z)) / z)``, and the sample variance about that
    mean is short of sigma^2 by as much. Both are exact. The percentiles have no closed form: they were simulated, good
    to 2 % between the simulated points, and are continued beyond them by the random-walk limit and by 1/sqrt(z).

    References
    ----------
    Flenniken (2005), sections 2.3 to 2.5 and appendix D, where neither is mentioned.
    """
    for name, value in (("duration", duration), ("tau", tau)):
        if not (isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive time in seconds, got {value!r}")
    process, z = GaussMarkov(1.0, tau), duration / tau
    return FiniteRecord(
        expected_variance(process, duration),
        mean_sigma(process, duration),
        _percentiles(z, "sigma"),
        _percentiles(z, "tau"),
    )


def tau_interval(tau: float, duration: float) -> Triple:
    """True correlation times that go with a found one.

    Parameters
    ----------
    tau : float
        1/e of the autocorrelation. [s]
    duration : float
        Length of the record. [s]

    Returns
    -------
    (float, float, float)
        Those for which what was found is the 95, 50 and 5 % point: lower end of a 90 % interval, median, upper end.
        The latter two are infinite where a bias that never settles would give such a number too. [s]
    """
    z = np.geomspace(_RECORDS[0, 0], 1e6, 600)
    percentiles = np.array([_percentiles(value, "tau") for value in z]) / z[:, None]  # over T; falls with z
    limits = []
    for share in percentiles.T[::-1]:
        unbounded = tau / duration >= share[0]
        at = inf if unbounded else np.exp(np.interp(log(tau / duration), np.log(share[::-1]), np.log(z[::-1])))
        limits.append(inf if unbounded else duration / float(at))
    low, median, high = limits
    return min(low, duration), median, high


def sigma_interval(s: float, tau_low: float, tau_high: float, duration: float) -> tuple[float, float]:
    """True standard deviations that go with a found one, for every correlation time that is still possible.

    Parameters
    ----------
    s : float
        Standard deviation of the record. [x]
    tau_low, tau_high, duration : float
        [s]

    Returns
    -------
    (float, float)
        90 %, conservative; infinite above if tau_high is. [x]
    """
    # the 95 % point of the ratio is largest at T/tau = 10, the 5 % point grows throughout
    longest, shortest = duration / tau_high, duration / tau_low
    low = s / _percentiles(min(max(10.0, longest), shortest), "sigma")[2]
    return low, inf if longest == 0.0 else s / _percentiles(longest, "sigma")[0]


def _percentiles(z: float, quantity: str) -> Triple:
    """5, 50 and 95 % of the number found over the true one, at T/tau = z."""
    columns = slice(1, 4) if quantity == "tau" else slice(4, 7)
    grid, table = _RECORDS[:, 0], _RECORDS[:, columns]
    if quantity == "tau":
        table = table * grid[:, None]  # over tau instead of over T
    if z > grid[-1]:
        percentiles = 1.0 + (table[-1] - 1.0) * sqrt(grid[-1] / z)
    elif z < grid[0]:
        percentiles = table[0] * (z / grid[0] if quantity == "tau" else sqrt(z / grid[0]))
    else:
        percentiles = np.exp([np.interp(log(z), np.log(grid), np.log(column)) for column in table.T])
    return float(percentiles[0]), float(percentiles[1]), float(percentiles[2])
