"""Narrow lines in the spectrum of a log at rest: vibration, mains, sampling artefacts, which are no noise term."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray

_LONGEST = 16384  # samples of a segment: resolution against scatter
_AROUND = 61  # frequencies whose median is the level
_FALSE_ALARM = 1e-3  # that noise alone shows any line in a log
_LEAST = 1.5  # a line stands out by that factor of the level at least
_MOST = 30


@dataclass(frozen=True, slots=True)
class Line:
    """One line.

    Attributes
    ----------
    frequency : float
        [Hz]
    amplitude : float
        Of a sine of the same power. [x]
    """

    frequency: float
    amplitude: float

    def allan_variance(self, m: IntArray, dt: float) -> FloatArray:
        """``A^2 sin^4(pi f m dt) / (m sin(pi f dt))^2`` over m samples of interval dt. [x^2]"""
        phase = np.pi * self.frequency * dt
        return np.asarray(self.amplitude**2 * np.sin(m * phase) ** 4 / np.square(m * np.sin(phase)))


@dataclass(frozen=True)
class CleanSpectrum:
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
    there = np.isfinite(signal)
    if not there.all():
        signal = np.where(there, signal, np.nanmean(signal))
    segment = int(min(_LONGEST, 2 ** int(np.log2(max(len(signal) / 16.0, 1.0)))))
    if segment < 256:
        return None
    f, S = welch(signal, rate_hz, "hann", segment, detrend="constant", return_onesided=True)
    # half-overlapping Hann segments: 18/11 as many degrees of freedom as segments without overlap
    freedom = 2.0 * (18.0 / 11.0) * np.count_nonzero(there) / segment
    level = median_filter(S, _AROUND, mode="nearest")
    ratio = max(_LEAST, float(chi2.ppf(1.0 - _FALSE_ALARM / len(f), freedom) / chi2.median(freedom)))
    low = 2 * _AROUND  # the spectrum of drift is too steep for a median below
    out = ratio * level < S
    out[:low] = False
    wide = out | np.roll(out, 1) | np.roll(out, -1)
    wide[:low] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], wide, [False])).astype(np.int8)))
    found = []
    for first, stop in edges.reshape(-1, 2):
        excess = np.maximum(S[first:stop] - level[first:stop], 0.0)
        power = float(excess.sum() * (f[1] - f[0]))
        line = Line(float(np.sum(excess * f[first:stop]) / excess.sum()), float(np.sqrt(2.0 * power)))
        found.append((line, first, stop))
    found = sorted(found, key=lambda item: -item[0].amplitude)[:_MOST]
    rest = S.copy()
    for _, first, stop in found:
        rest[first:stop] = np.minimum(S[first:stop], level[first:stop])
    # one-sided doubles all but the ends; those are as their neighbours, the mean having been taken away
    rest = 0.5 * rest / (np.mean(there) if not there.all() else 1.0)
    rest[0], rest[-1] = rest[1], rest[-2]
    return CleanSpectrum(f, rest, tuple(line for line, _, _ in found))


def find_lines(x: ArrayLike, rate_hz: float) -> tuple[Line, ...]:
    """Lines that stand out of the spectrum around them, strongest first; see :func:`clean_spectrum`."""
    spectrum = clean_spectrum(x, rate_hz)
    return () if spectrum is None else spectrum.lines
