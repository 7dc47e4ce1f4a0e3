"""SIMULATION ONLY: what a receiver's early, prompt and late correlators put out for a satellite signal.

No signal is sampled and no receiver is driven: correlation is replaced by its closed-form mean and its noise, as in
studies of tracking. One accumulation over ``tau`` seconds, in units of its noise (I and Q of variance 1), is::

    sqrt(2 c tau) R(x) D sinc(f tau) exp(j phi) + noise        c: C/N0 [Hz], D: data bit, f: frequency error

Errors are replica minus truth, of the range and of the range rate, so that they are errors of whoever commands the
oscillators: a replica that is ``e`` metres too late has ``x = e / chip``, ``phi = 2 pi e / wavelength``,
``f = e' / wavelength``. An error that is positive makes the early correlator the stronger one.

References
----------
Groves (2013), section 9.1.4; Kaplan and Hegarty (2006), chapter 5; Stefanisko (2015), section 3.1.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.gnss.signals import BANDS, SPEED_OF_LIGHT


@dataclass(frozen=True, slots=True)
class Signal:
    """A binary phase-shift keyed ranging signal.

    Attributes
    ----------
    name : str
    chip, wavelength : float
        Length of a code chip, of a carrier wave. [m]
    bit : float
        Length of a data bit, within which the sign of the signal does not change. [s]
    """

    name: str
    chip: float
    wavelength: float
    bit: float


#: GPS L1 C/A: 1.023 million chips and 50 data bits a second.
GPS_CA = Signal("GPS L1 C/A", SPEED_OF_LIGHT / 1.023e6, SPEED_OF_LIGHT / BANDS[("G", "1")], 0.02)


@dataclass(frozen=True, slots=True)
class Correlator:
    """Three taps of one channel and how long they accumulate.

    Attributes
    ----------
    signal : Signal
    spacing : float
        From the early to the late tap, above 0, at most 1. [chips]

    Notes
    -----
    The code accumulates over a data bit, the carrier's frequency is taken between the two halves of a bit: both know
    where bits begin and neither needs to know their values.
    """

    signal: Signal = GPS_CA
    spacing: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.spacing <= 1.0:
            raise InputError(f"spacing: expected early to late of more than 0 and at most 1 chip, got {self.spacing!r}")

    @property
    def half(self) -> float:
        """Length of an accumulation, half a data bit. [s]"""
        return 0.5 * self.signal.bit


@dataclass(frozen=True, slots=True)
class Taps:
    """Accumulations ``I + j Q`` of the three taps, in units of the noise of I and of Q. Arrays of one shape."""

    early: np.ndarray
    prompt: np.ndarray
    late: np.ndarray

    def followed_by(self, later: Taps) -> Taps:
        """Accumulation over this interval and an equally long one after it, coherently, noise again of variance 1."""
        root = np.sqrt(0.5)
        return Taps(
            root * (self.early + later.early), root * (self.prompt + later.prompt), root * (self.late + later.late)
        )


def ratio_from_dbhz(cn0_dbhz: ArrayLike) -> FloatArray:
    """Carrier power to noise density as a ratio. [dB-Hz] to [Hz]"""
    return np.asarray(10.0 ** (0.1 * np.asarray(cn0_dbhz, dtype=np.float64)))


def code_correlation(x: ArrayLike) -> FloatArray:
    """Correlation of the code with itself, ``1 - |x|`` within a chip. ``x`` in chips.

    An unlimited bandwidth before the correlator; a real one rounds the peak (Groves (2013), section 9.1.4.1).
    """
    return np.maximum(1.0 - np.abs(np.asarray(x, dtype=np.float64)), 0.0)


def coherence(frequency: ArrayLike, tau: float, flip_at: ArrayLike = 1.0) -> np.ndarray:
    """Mean of ``D(t) exp(2 pi j f t)`` over an accumulation, ``t = 0`` in its middle.

    Parameters
    ----------
    frequency : array_like
        Frequency error. [Hz]
    tau : float
        [s]
    flip_at : array_like
        Part of the accumulation after which the data bit changes its sign; 1 (or 0) for one bit only.

    Returns
    -------
    ndarray of complex
        ``sinc(f tau)`` within a bit: half the power is lost at ``0.44 / tau``, all of it at ``1 / tau``. With the bit
        changing in the middle, nothing is left at zero frequency.
    """
    f, u = np.asarray(frequency, dtype=np.float64) * tau, np.asarray(flip_at, dtype=np.float64)
    before = u * np.sinc(f * u) * np.exp(1j * np.pi * f * (u - 1.0))
    after = (1.0 - u) * np.sinc(f * (1.0 - u)) * np.exp(1j * np.pi * f * u)
    return np.asarray(before - after)


def tap_covariance(spacing: float) -> FloatArray:
    """Covariance of the noise of early, prompt and late, of I and of Q alike. Shape (3, 3).

    Taps that are ``s`` chips apart see noise correlated by ``R(s)`` (Groves (2013), section 9.1.4.2).
    """
    place = np.array([-0.5, 0.0, 0.5]) * spacing
    return code_correlation(place[:, None] - place)


def expected_taps(
    correlator: Correlator,
    cn0: ArrayLike,
    range_error: ArrayLike,
    rate_error: ArrayLike = 0.0,
    *,
    tau: float,
    phase: ArrayLike = 0.0,
    data: ArrayLike = 1.0,
    flip_at: ArrayLike = 1.0,
) -> Taps:
    """Mean of an accumulation: what the taps put out without noise. Arguments are broadcast against each other.

    Parameters
    ----------
    correlator : Correlator
    cn0 : array_like
        Carrier power to noise density, a ratio. [Hz]
    range_error, rate_error : array_like
        Replica minus truth in the middle of the accumulation. [m], [m/s]
    tau : float
        Length of the accumulation. [s]
    phase : array_like
        Carrier phase of signal against replica in the middle, beside that of ``range_error`` (where the carrier's
        replica started). [rad]
    data : array_like
        Data bit, +1 or -1.
    flip_at : array_like
        See :func:`coherence`.

    Returns
    -------
    Taps

    References
    ----------
    Groves (2013), section 9.1.4, the accumulated correlator outputs; Stefanisko (2015), section 3.1.4.
    """
    if not tau > 0.0:
        raise InputError(f"tau: expected a positive time, got {tau!r}")
    s = correlator.signal
    x, f = np.asarray(range_error, dtype=np.float64) / s.chip, np.asarray(rate_error, dtype=np.float64) / s.wavelength
    angle = 2.0 * np.pi * np.asarray(range_error, dtype=np.float64) / s.wavelength + np.asarray(phase)
    level = np.sqrt(2.0 * np.asarray(cn0, dtype=np.float64) * tau) * np.asarray(data)
    common = level * coherence(f, tau, flip_at) * np.exp(1j * angle)
    half = 0.5 * correlator.spacing
    return Taps(common * code_correlation(x - half), common * code_correlation(x), common * code_correlation(x + half))


def noisy(taps: Taps, correlator: Correlator, rng: np.random.Generator, *, scale: float = 1.0) -> Taps:
    """The accumulations with noise, independent from one to the next and correlated between their taps.

    Parameters
    ----------
    taps : Taps
        Of :func:`expected_taps`.
    correlator : Correlator
    rng : numpy.random.Generator
    scale : float
        Factor on the noise; 0 for exact signals.
    """
    shape = np.shape(taps.prompt)
    white = rng.standard_normal((*shape, 3, 2)).view(np.complex128)[..., 0]
    root = np.linalg.cholesky(tap_covariance(correlator.spacing) + 1e-15 * np.eye(3))
    noise = scale * white @ root.T
    return Taps(taps.early + noise[..., 0], taps.prompt + noise[..., 1], taps.late + noise[..., 2])
