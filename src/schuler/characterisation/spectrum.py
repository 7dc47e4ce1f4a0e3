"""Power spectrum of a log, two-sided like the densities of :mod:`schuler.sensors.noise`, with confidence bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged

_LONGEST = 16384  # samples of a segment: resolution against scatter
_AROUND = 61  # frequencies whose median is the level
_FALSE_ALARM = 1e-3  # that noise alone shows any line in a log
_LEAST = 1.5  # a line stands out by that factor of the level at least
_MOST = 30


@dataclass(frozen=True, repr=False)
class Spectrum(Abridged):
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
        Probability of the bounds.
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


@dataclass(frozen=True, slots=True)
class Line:
    """One line.

    Attributes
    ----------
    frequency : float
        [Hz]
    amplitude : float
        Amplitude of a sine of the same power. [x]
    """

    frequency: float
    amplitude: float

    def allan_variance(self, m: IntArray, dt: float) -> FloatArray:
        """``A^2 sin^4(pi f m dt) / (m sin(pi f dt))^2`` over m samples of interval dt. [x^2]"""
        phase = np.pi * self.frequency * dt
        return np.asarray(self.amplitude**2 * np.sin(m * phase) ** 4 / np.square(m * np.sin(phase)))


@dataclass(frozen=True, repr=False)
class CleanSpectrum(Abridged):
    """Spectrum of a log and its lines.

    Attributes
    ----------
    f, density : ndarray, shape (k,)
        Frequencies from zero to half the rate [Hz]; two-sided density with the lines taken out. [x^2/Hz]
    lines : tuple of Line
        Strongest first, at most 30.
    """

    f: FloatArray
    density: FloatArray
    lines: tuple[Line, ...]


def clean_spectrum(x: ArrayLike, rate_hz: float) -> CleanSpectrum | None:
    """Spectrum of a log without the lines that stand out of it.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rate-like signal; missing samples (NaN) count as the mean.
    rate_hz : float
        Sampling rate. [Hz]

    Returns
    -------
    CleanSpectrum or None
        None for a log too short to tell (fewer than 16 segments of 256 samples).

    Notes
    -----
    Welch spectrum with a Hann window; a frequency belongs to a line if its power exceeds the median of the 61
    frequencies around it beyond what the chi-square distribution allows. The power of a line is the excess of adjoining
    such frequencies and one more on either side, so a resonance counts with all of its width.
    """
    from scipy.ndimage import median_filter
    from scipy.signal import welch
    from scipy.stats import chi2

    signal: FloatArray = np.asarray(x, dtype=np.float64)
    present = np.isfinite(signal)
    if not present.all():
        signal = np.where(present, signal, np.nanmean(signal))
    segment = int(min(_LONGEST, 2 ** int(np.log2(max(len(signal) / 16.0, 1.0)))))
    if segment < 256:
        return None
    f, S = welch(signal, rate_hz, "hann", segment, detrend="constant", return_onesided=True)
    # half-overlapping Hann segments: 18/11 as many degrees of freedom as segments without overlap
    freedom = 2.0 * (18.0 / 11.0) * np.count_nonzero(present) / segment
    level = median_filter(S, _AROUND, mode="nearest")
    ratio = max(_LEAST, float(chi2.ppf(1.0 - _FALSE_ALARM / len(f), freedom) / chi2.median(freedom)))
    low = 2 * _AROUND  # the spectrum of drift is too steep for a median below
    out = ratio * level < S
    out[:low] = False
    wide = out | np.roll(out, 1) | np.roll(out, -1)
    wide[:low] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], wide, [False])).astype(np.int8)))
    peaks = []
    for first, stop in edges.reshape(-1, 2):
        excess = np.maximum(S[first:stop] - level[first:stop], 0.0)
        power = float(excess.sum() * (f[1] - f[0]))
        line = Line(float(np.sum(excess * f[first:stop]) / excess.sum()), float(np.sqrt(2.0 * power)))
        peaks.append((line, first, stop))
    peaks = sorted(peaks, key=lambda item: -item[0].amplitude)[:_MOST]
    density = S.copy()
    for _, first, stop in peaks:
        density[first:stop] = np.minimum(S[first:stop], level[first:stop])
    # one-sided doubles all but the ends; those are as their neighbours, the mean having been taken away
    density = 0.5 * density / (np.mean(present) if not present.all() else 1.0)
    density[0], density[-1] = density[1], density[-2]
    return CleanSpectrum(f, density, tuple(line for line, _, _ in peaks))
