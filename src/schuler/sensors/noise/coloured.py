"""Noise of any spectrum, as measured in a log at its own rate."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import isfinite

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.sensors.noise._checks import Shape, array, positive, shape_of
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import SampledStateSpace, StateSpace

_LONGEST = 2**18  # samples of the period of a short series
_NODES = 16  # of the quadrature in a piece
_STEP = 1.5  # ratio of the ends of a piece at most: 1/f^2 is a polynomial there, to 1e-16
_TURN = 2.0 / np.pi  # half width of a piece times averaging time to which the nodes see all turns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Coloured(Process, Abridged):
    """Stationary Gaussian noise of a tabulated density: what a sensor's filter and vibration make of white noise.

    Attributes
    ----------
    frequency : ndarray, shape (k,)
        Increasing from zero to half the rate. [Hz]
    density : ndarray, shape (k,)
        Two-sided, linear between the frequencies. [x^2/Hz]
    rate_hz : float
        The one rate at which the process is defined. [Hz]

    Raises
    ------
    InputError
        If lengths differ, frequencies are others or a density is negative.

    Notes
    -----
    For simulation and for comparison with a log. A filter needs finitely many states: give it the terms that hold at
    longer times, white noise N first of all.
    """

    frequency: FloatArray
    density: FloatArray
    rate_hz: float

    def __post_init__(self) -> None:
        f = as_floats(self.frequency, "frequency", (None,))
        S = as_floats(self.density, "density", (len(f),))
        half = 0.5 * positive(self.rate_hz, "rate_hz")
        if len(f) < 2 or f[0] != 0.0 or not (np.diff(f) > 0.0).all() or abs(f[-1] / half - 1.0) > 1e-9:
            raise InputError(f"frequency: expected increasing numbers from 0 to half the rate, {half:g} Hz, got {f}")
        if (S < 0.0).any():
            raise InputError(f"density: expected no negative numbers, got {S.min():g}")
        object.__setattr__(self, "frequency", readonly(f.copy()))
        object.__setattr__(self, "density", readonly(S.copy()))

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """A piece of a periodic series of twice the length or more, drawn in the frequency domain. [x]

        Raises
        ------
        InputError
            If ``dt`` is not ``1 / rate_hz``.
        """
        from scipy.fft import irfft, next_fast_len, rfftfreq

        self._check(dt)
        shape = shape_of(n)
        # long enough for the covariance to have decayed, or a short series would not have the variance
        decayed = int(2.0 * self.rate_hz / np.diff(self.frequency).min())
        length = next_fast_len(max(2 * shape[0], min(decayed, _LONGEST)), real=True)
        f = rfftfreq(length, dt)
        amplitude = np.sqrt(0.5 * length / dt * self.psd(f))
        amplitude[0] *= np.sqrt(2.0)  # real, with all of the power
        if length % 2 == 0:
            amplitude[-1] *= np.sqrt(2.0)
        rest = shape[1:]
        z = rng.standard_normal((2, len(f), *rest))
        z[1, 0] = 0.0
        if length % 2 == 0:
            z[1, -1] = 0.0
        spectrum = amplitude.reshape(-1, *[1] * len(rest)) * (z[0] + 1j * z[1])
        return np.asarray(irfft(spectrum, length, axis=0)[: shape[0]])

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """Covariance at lags that are whole numbers of samples, given in seconds. [x^2]"""
        k = np.round(np.abs(array(lag)) * self.rate_hz).astype(np.int64)
        r = self._covariance(int(k.max(initial=0)))
        return np.where(k < len(r), r[np.minimum(k, len(r) - 1)], 0.0)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the series at averaging times of one sample or more. [x^2]

        The integral of the density times ``2 sin^4(pi f m dt) / (m sin(pi f dt))^2``; linear between whole m.
        """
        m = np.maximum(array(tau) * self.rate_hz, 1.0)
        below = np.floor(m + 1e-6)
        part = np.where(m - below > 1e-6, m - below, 0.0)
        whole, place = np.unique(np.stack((below, below + (part > 0.0))), return_inverse=True)
        low, high = self._whole_samples(whole)[place.reshape(2, *m.shape)]
        return np.asarray((1.0 - part) * low + part * high)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """The same at m samples. [x^2]"""
        self._check(dt)
        return self.allan_variance(array(m) * dt)

    def psd(self, f: ArrayLike) -> FloatArray:
        """The density, zero above half the rate. [x^2/Hz]"""
        return np.interp(np.abs(array(f)), self.frequency, self.density, right=0.0)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """The same, periodic in the rate. [x^2/Hz]"""
        self._check(dt)
        f = np.abs(array(f)) % self.rate_hz
        return np.interp(np.minimum(f, self.rate_hz - f), self.frequency, self.density)

    def state_space(self) -> StateSpace:
        """Refused: a tabulated density has no finite number of states.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "a Coloured process has no finite state space; give a filter the terms that hold at longer times "
            "(White(N), ...), or fit an AutoRegressive process"
        )

    def sampled(self, dt: float) -> SampledStateSpace:
        """Refused, as :meth:`state_space`.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "a Coloured process has no finite state space; give a filter the terms that hold at longer times "
            "(White(N), ...), or fit an AutoRegressive process"
        )

    def _whole_samples(self, numbers: FloatArray) -> FloatArray:
        """Allan variance over whole numbers of samples, shape (k,), increasing. [x^2]

        Gauss-Legendre quadrature between the frequencies, of pieces so narrow that the density over the square of the
        sine is a polynomial to rounding; where the averaging time turns within a piece more than once, that of Filon
        (Abramowitz and Stegun, 25.4.47, here in Legendre polynomials): ``sin^4 x = 3/8 - cos(2 x) / 2 + cos(4 x) / 8``.
        """
        edge = _edges(np.minimum(self.frequency / self.rate_hz, 0.5), 1.0 / numbers[-1])
        half, middle = 0.5 * np.diff(edge), 0.5 * (edge[1:] + edge[:-1])
        order = np.argsort(half)
        half, middle = half[order], middle[order]
        x, weight = np.polynomial.legendre.leggauss(_NODES)
        u = middle[:, None] + half[:, None] * x
        g = np.interp(u, self.frequency / self.rate_hz, self.density) / np.sin(np.pi * u) ** 2
        degree = np.arange(_NODES)
        # by the orthogonality of Legendre polynomials, integrals of their products taken at the nodes
        c = (g * weight) @ np.polynomial.legendre.legvander(x, _NODES - 1) * (degree + 0.5)
        c *= 2.0 * half[:, None] * np.array((1.0, 1.0, -1.0, -1.0))[degree % 4]  # the real part of i^n to turn
        out = np.empty(len(numbers))
        for i, m in enumerate(numbers):
            wide = int(np.searchsorted(half, _TURN / m))
            square = np.sin(np.pi * m * u[:wide]) ** 2
            near = square * square * g[:wide] @ weight @ half[:wide]
            far = 0.375 * c[wide:, 0].sum()
            for share, turning in ((-0.5, 2.0 * np.pi * m), (0.125, 4.0 * np.pi * m)):
                far += share * _turning(c[wide:], turning * half[wide:], turning * middle[wide:])
            out[i] = 4.0 * self.rate_hz * (near + far) / m**2
        return out

    def _covariance(self, lags: int) -> FloatArray:
        """Autocovariance up to where lines between the frequencies have let it decay, or to four times ``lags``."""
        narrow = float(np.diff(self.frequency).min())
        length = 2 * min(int(np.ceil(8.0 * self.rate_hz / narrow)), max(4 * lags, _LONGEST))
        f = np.arange(length // 2 + 1) * (self.rate_hz / length)
        r: FloatArray = np.fft.irfft(self.psd(np.minimum(f, self.frequency[-1])) * self.rate_hz)
        return r[: length // 2]

    def _check(self, dt: float) -> None:
        if not (isfinite(dt) and abs(dt * self.rate_hz - 1.0) < 1e-6):
            raise InputError(
                f"dt: expected {1.0 / self.rate_hz:g} s, since this Coloured process was measured at "
                f"{self.rate_hz:g} Hz, got {dt!r} s; identify a log of the rate wanted, or take its White(N) instead"
            )


def _edges(u: FloatArray, lowest: float) -> FloatArray:
    """Frequencies, and others between those that are far apart for their size, from ``lowest`` on. [cycles/sample]"""
    first = u[1]
    more = first * _STEP ** -np.arange(1, max(int(np.ceil(np.log(first / lowest) / np.log(_STEP))), 0) + 1)
    pieces = [u, more]
    for low, high in pairwise(u[1:]):
        if high > _STEP * low:
            pieces.append(np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(_STEP))) + 1)[1:-1])
    return np.unique(np.concatenate(pieces))


def _turning(c: FloatArray, z: FloatArray, phase: FloatArray) -> float:
    """Sum of integrals of Legendre series times ``cos(z x + phase)`` over -1 to 1, of z from 4 on.

    ``c``, shape (k, n), are the coefficients times 2 and the sign that i^n gives; spherical Bessel functions of z are
    the integrals of the polynomials times exp(i z x).
    """
    before, j = np.cos(z) / z, np.sin(z) / z
    even = c[:, 0] * j
    odd = np.zeros_like(j)
    for n in range(1, c.shape[1]):
        before, j = j, (2 * n - 1) / z * j - before
        if n % 2:
            odd += c[:, n] * j
        else:
            even += c[:, n] * j
    return float(np.cos(phase) @ even - np.sin(phase) @ odd)
