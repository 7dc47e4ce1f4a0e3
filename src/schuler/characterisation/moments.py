"""Allan variances of a record and their uncertainty: degrees of freedom and correlation between them.

The overlapping Allan variance is a mean of squares of a Gaussian signal d, the difference of adjacent cluster means.
Its variance and its correlation with the variance at another averaging time follow from the spectrum of the noise::

    AVAR(tau) = 1/2 E[d^2] = integral S(f) |H|^2 df,      |H|^2 = 2 sin^4(pi f tau) / (m sin(pi f dt))^2,   tau = m dt
    Var(AVAR) = 1/L^2 integral (L - |s|) C(s)^2 ds / 2,   C(s) = E[d(t) d(t + s)],   L = T - 2 tau
    Cov(AVAR_i, AVAR_j) = 2/T integral S(f)^2 |H_i|^2 |H_j|^2 df          (long records; used for the correlation only)

so a fit can be weighted for whatever noise it finds, and the uncertainty of its parameters follows.

References
----------
Greenhall (1983), Proc. PTTI 15; Percival and Walden (2000), Wavelet Methods for Time Series Analysis, section 8.3;
Guerrier, Skaloud, Stebler and Victoria-Feser (2013), J. Am. Stat. Assoc. 108(503), 1021-1030.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray

Spectrum = Callable[[FloatArray], FloatArray]

_PER_TAU = 32  # lags within one averaging time; also half the averaging times that C(s) is followed over
_PER_OCTAVE = 48  # frequencies of the integrals between two averaging times


def transfer(f: FloatArray, m: IntArray, dt: float) -> FloatArray:
    """``|H|^2`` of the Allan variance over ``m`` samples, so that ``AVAR = integral S |H|^2`` over both signs of f.

    Parameters
    ----------
    f : ndarray, shape (k,)
        Frequencies above zero, up to half the sampling rate. [Hz]
    m : ndarray of int, shape (j,)
        Averaging times in samples.
    dt : float
        Sampling interval. [s]

    Returns
    -------
    ndarray, shape (j, k)
        Where a period of the square of the sine falls between two frequencies its mean stands instead.
    """
    phase = np.pi * dt * np.multiply.outer(m, f)
    step = np.abs(np.gradient(f)) / f if len(f) > 2 else np.zeros_like(f)
    square: FloatArray = np.where(phase * step > 1.0, 0.375, np.sin(phase) ** 4)
    return 2.0 * square / np.square(m[:, None] * np.sin(np.pi * f * dt))


def degrees_of_freedom(m: IntArray, n: IntArray, dt: float, psd: Spectrum) -> FloatArray:
    """Equivalent degrees of freedom of overlapping Allan variances of Gaussian noise of any spectrum.

    Parameters
    ----------
    m : ndarray of int, shape (j,)
        Averaging times in samples.
    n : ndarray of int, shape (r,)
        Lengths of the records that are averaged over, in samples; those shorter than ``2 m`` do not count.
    dt : float
        Sampling interval. [s]
    psd : callable
        Two-sided density of the rate-like signal at frequencies above zero. [x^2/Hz]

    Returns
    -------
    ndarray, shape (j,)
        ``2 AVAR^2 / Var(AVAR)``, 1 for a single difference.
    """
    edf = np.empty(len(m))
    pers = np.minimum(m, _PER_TAU)
    for per in np.unique(pers):  # all with the same number of lags at once
        at = np.flatnonzero(pers == per)
        f, h, step = _lags(tuple(int(k) for k in m[at]), int(per), dt)
        C = np.fft.irfft(psd(f) * h, axis=1)[:, : h.shape[1] - 1]
        square = np.square(C / C[:, :1])
        s = step[:, None] * np.arange(C.shape[1])
        information = np.zeros(len(at))
        for length in n:
            L = (length - 2 * m[at]) * dt + step  # one difference is one step of length
            w = np.maximum(L[:, None] - s, 0.0)
            # mean of the squared covariance over all pairs of differences
            pairs = step * (2.0 * np.sum(w * square, axis=1) - w[:, 0])
            information += np.where(0.5 * step < L, L**2 / np.where(pairs > 0.0, pairs, 1.0), 0.0)
        edf[at] = information
    return np.maximum(edf, 1e-9)


@lru_cache(maxsize=256)
def _lags(m: tuple[int, ...], per: int, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies (j, k), weights of the spectrum there (j, k) and lag steps (j,) for the covariance of differences."""
    numbers = np.array(m, dtype=np.float64)
    step = numbers * dt / per  # a whole number of samples or close to it
    size = 2 * _PER_TAU * per
    f = np.fft.rfftfreq(size) / step[:, None]
    f[:, 0] = 1e-3 * f[:, 1]  # the limit at zero is finite for everything up to a random walk
    f[:, -1] *= 1.0 - 1e-9
    tau = (numbers * dt)[:, None]
    h = 4.0 * np.sin(np.pi * f * tau) ** 4 / np.square(per * np.sin(np.pi * f * step[:, None]))
    return f, h, step


def correlation(m: IntArray, dt: float, duration: float, psd: Spectrum) -> FloatArray:
    """Correlation of Allan variances with one another, in the limit of long records.

    Parameters
    ----------
    m : ndarray of int, shape (j,)
        Averaging times in samples.
    dt, duration : float
        Sampling interval and length of the record. [s]
    psd : callable
        As for :func:`degrees_of_freedom`.

    Returns
    -------
    ndarray, shape (j, j)
    """
    f, h, extra = _shared(tuple(int(k) for k in m), dt, duration)
    weight = psd(f) ** 2 * f
    products: FloatArray = (h * weight) @ h.T
    products[np.diag_indices(len(m))] += extra @ weight
    scale = np.sqrt(np.diag(products))
    return np.asarray(products / np.outer(scale, scale))


@lru_cache(maxsize=64)
def _shared(m: tuple[int, ...], dt: float, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies (k,), ``|H|^2`` there (j, k), and what its square lacks where the sine is averaged (j, k)."""
    numbers = np.array(m)
    octaves = np.log2(0.5 * duration / dt) + 4.0
    f = 0.5 / dt * 2.0 ** -(np.arange(int(octaves * _PER_OCTAVE))[::-1] / _PER_OCTAVE)
    f[-1] *= 1.0 - 1e-9
    h = transfer(f, numbers, dt)
    # the mean of sin^8 is 35/128, not (3/8)^2: matters where the highest frequencies do, for quantisation
    fast = np.pi * dt * np.multiply.outer(numbers, f) * np.log(2.0) / _PER_OCTAVE > 1.0
    return f, h, np.where(fast, (35.0 / 18.0 - 1.0) * h**2, 0.0)


class Moments(NamedTuple):
    """Overlapping Allan variances of one axis and what they are made of.

    Attributes
    ----------
    m : ndarray of int, shape (k,)
        Averaging times in samples.
    variance : ndarray, shape (k,)
        [x^2]
    dt : float
        Sampling interval. [s]
    lengths : ndarray of int
        Length of each record, in samples.
    """

    m: IntArray
    variance: FloatArray
    dt: float
    lengths: IntArray

    @property
    def tau(self) -> FloatArray:
        """Averaging times. [s]"""
        return np.asarray(self.m * self.dt)
