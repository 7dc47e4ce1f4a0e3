"""Power spectrum of a log, two-sided like the densities of :mod:`schuler.sensors.noise`, with confidence bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError


@dataclass(frozen=True)
class Spectrum:
    """Averaged periodograms of one signal.

    Attributes
    ----------
    f : ndarray, shape (k,)
        Frequencies, without zero and half the sampling rate. [Hz]
    psd : ndarray, shape (k,)
        Two-sided density S(f): white noise of root density N shows N^2, the variance is the sum of ``2 psd df``.
        [x^2/Hz]
    low, high : ndarray, shape (k,)
        Bounds of the true (smoothed) density at each frequency by itself. [x^2/Hz]
    edf : float
        Degrees of freedom of each value.
    segments : int
        How many periodograms were averaged.
    confidence : float
        Of the bounds.
    """

    f: FloatArray
    psd: FloatArray
    low: FloatArray
    high: FloatArray
    edf: float
    segments: int
    confidence: float


def power_spectrum(
    x: ArrayLike, rate_hz: float, *, segment_s: float | None = None, confidence: float = 0.95
) -> Spectrum:
    """Power spectrum by Welch's method: Hann windows that overlap by half, mean of each segment removed.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate-like signal at regular intervals, without gaps.
    rate_hz : float
        [Hz]
    segment_s : float, optional
        Length of a segment: the spectrum begins at its inverse. An eighth of the record if not given (15 segments).
        [s]
    confidence : float
        Probability that the bounds at a frequency contain the true density there.

    Returns
    -------
    Spectrum

    Raises
    ------
    InputError
        If the signal is not one-dimensional or has NaN, or a segment is shorter than 8 samples or longer than the
        record.

    Notes
    -----
    With K segments and the correlation rho = 1/36 of the powers of two neighbours under half-overlapping Hann windows,
    ``edf = 2 K / (1 + 2 rho (1 - 1/K))``; bounds are chi-square. The lowest two frequencies feel the window and the
    removed mean most.

    References
    ----------
    Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70; Percival and Walden, "Spectral Analysis for Physical
    Applications", section 6.17.
    """
    from scipy.signal import welch
    from scipy.special import chdtri

    x = as_floats(x, "x", (None,))
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected one positive finite number, got {rate_hz!r}")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence: expected a probability between 0 and 1 such as 0.95, got {confidence!r}")
    n = len(x)
    length = n // 8 if segment_s is None else round(segment_s * rate_hz)
    if not 8 <= length <= n:
        raise InputError(
            f"segment_s: expected a segment of 8 samples ({8 / rate_hz:g} s) up to the record ({n / rate_hz:g} s), got "
            f"{length} samples; give a longer record or another segment_s"
        )
    half = length // 2
    f, one_sided = welch(x, fs=rate_hz, window="hann", nperseg=length, noverlap=length - half, detrend="constant")
    segments = (n - length) // half + 1
    edf = 2.0 * segments / (1.0 + 2.0 / 36.0 * (1.0 - 1.0 / segments))
    inner = slice(1, len(f) - 1 if length % 2 == 0 else len(f))
    psd = 0.5 * np.asarray(one_sided[inner], dtype=np.float64)
    tail = 0.5 * (1.0 - confidence)
    return Spectrum(
        f=np.asarray(f[inner], dtype=np.float64),
        psd=psd,
        low=psd * (edf / float(chdtri(edf, tail))),
        high=psd * (edf / float(chdtri(edf, 1.0 - tail))),
        edf=edf,
        segments=segments,
        confidence=confidence,
    )
