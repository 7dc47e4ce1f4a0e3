"""Shot noise: a damped oscillation that is set off at random, as knocks do to a vehicle or a test table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import inf, pi, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, array, frequencies, magnitude, positive, shape_of, times
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import StateSpace

_FORGOTTEN = 16.0  # decay times after which a shot is no longer seen


@dataclass(frozen=True, slots=True)
class ShotNoise(Process):
    """Shots at random times, each setting off a damped oscillation of random size and phase.

    Attributes
    ----------
    sigma : float
        Standard deviation, over all time. [x]
    frequency : float
        Frequency of the oscillation; zero for a plain decay. [Hz]
    decay : float
        Time to 1/e. [s]
    shots_hz : float
        Mean number of shots per second; infinite for the Gaussian limit. [1/s]

    Raises
    ------
    InputError
        If sigma or frequency is negative, or decay or shots_hz not positive.

    Notes
    -----
    ``x(t) = Re sum a_k exp((i w - 1/decay) (t - t_k))`` over the shots before t, a_k circular normal, each part of
    standard deviation ``A = sigma sqrt(2 / (shots_hz decay))``. Spectrum and Allan variance do not depend on the number
    of shots; few of them make a log that is quiet most of the time.

    References
    ----------
    Papoulis and Pillai (2002), Probability, Random Variables and Stochastic Processes, 4th ed., section 10-2 (shot
    noise, Campbell's theorem).
    """

    sigma: float
    frequency: float
    decay: float
    shots_hz: float = inf

    def __post_init__(self) -> None:
        magnitude(self.sigma, "sigma")
        magnitude(self.frequency, "frequency")
        positive(self.decay, "decay")
        if not (np.ndim(self.shots_hz) == 0 and self.shots_hz > 0.0):
            raise InputError(f"shots_hz: expected a positive number of shots per second, or inf, got {self.shots_hz!r}")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Exact at the samples; in the steady state from the first one on. [x]"""
        from scipy.signal import lfilter

        shape, dt = shape_of(n), positive(dt, "dt")
        out = np.zeros((shape[0], int(np.prod(shape[1:]))))
        step = np.exp((2j * pi * self.frequency - 1.0 / self.decay) * dt)
        if not out.size:
            return out.reshape(shape)
        for column in out.T:
            drive = self._drive(shape[0], dt, rng)
            column[:] = lfilter([1.0], [1.0, -step], drive).real
        return out.reshape(shape)

    def _drive(self, n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
        """Contribution of the shots since the last sample to each sample; to the first one, of all shots before."""
        if self.shots_hz == inf:
            normal = rng.standard_normal((n, 2)) @ np.array([1.0, 1.0j])
            normal[1:] *= sqrt(-np.expm1(-2.0 * dt / self.decay))
            return np.asarray(self.sigma * normal)
        size = self.sigma * sqrt(2.0 / (self.shots_hz * self.decay))
        drive = np.zeros(n, dtype=np.complex128)
        for first, stop, span in ((0, 1, _FORGOTTEN * self.decay), (1, n, (n - 1) * dt)):
            ago = span * rng.random(rng.poisson(self.shots_hz * span))
            a = size * (rng.standard_normal((len(ago), 2)) @ np.array([1.0, 1.0j]))
            if first:
                place = np.minimum((ago / dt).astype(np.int64), n - 2) + 1
                ago = place * dt - ago
            else:
                place = np.zeros(len(ago), dtype=np.int64)
            np.add.at(drive[:stop], place, a * np.exp((2j * pi * self.frequency - 1.0 / self.decay) * ago))
        return drive

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """``sigma^2 exp(-|lag| / decay) cos(2 pi f lag)``, lags in seconds. [x^2]"""
        lag = np.abs(array(lag))
        return np.asarray(self.sigma**2 * np.exp(-lag / self.decay) * np.cos(2.0 * pi * self.frequency * lag))

    def log_characteristic(self, scale: ArrayLike, lag: ArrayLike) -> FloatArray:
        """Logarithm of the characteristic function of ``x(t + lag) - x(t)``, which is real.

        Parameters
        ----------
        scale : array_like
            Argument. [1/x]
        lag : array_like
            [s]

        Returns
        -------
        ndarray
            Never positive; the common shape of both.

        Notes
        -----
        Campbell's theorem with normal amplitudes: ``-(shots decay / 2) (E(c |z - 1|^2) + E(c) - E(c |z|^2))``, with
        ``c = (scale A)^2 / 2``, ``z = exp((i w - 1/decay) lag)`` and the entire exponential integral
        ``E(a) = integral from 0 to a of (1 - exp(-u)) / u du``. In the Gaussian limit ``-scale^2 (r(0) - r(lag))``.
        """
        scale, lag = array(scale), np.abs(array(lag))
        if self.shots_hz == inf:
            return np.asarray(-(scale**2) * (self.sigma**2 - self.autocovariance(lag)))
        number = self.shots_hz * self.decay
        c = scale**2 * self.sigma**2 / number
        z = np.exp((2j * pi * self.frequency - 1.0 / self.decay) * lag)
        return -0.5 * number * (_entire(c * np.abs(z - 1.0) ** 2) + _entire(c) - _entire(c * np.abs(z) ** 2))

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the continuous signal. [x^2]"""
        return self.state_space().allan_variance(times(tau))

    def psd(self, f: ArrayLike) -> FloatArray:
        """``sigma^2 decay (1 / (1 + (2 pi (f - f_0) decay)^2) + 1 / (1 + (2 pi (f + f_0) decay)^2))``. [x^2/Hz]"""
        f = frequencies(f)
        below, above = (1.0 + (2.0 * pi * (f + s * self.frequency) * self.decay) ** 2 for s in (-1.0, 1.0))
        return np.asarray(self.sigma**2 * self.decay * (1.0 / below + 1.0 / above))

    def state_space(self) -> StateSpace:
        """Two states, driven by white noise of the same first two moments."""
        w, d = 2.0 * pi * self.frequency, 1.0 / self.decay
        F = np.array([[-d, -w], [w, -d]])
        return StateSpace(F, 2.0 * d * self.sigma**2 * np.eye(2), np.array([1.0, 0.0]), self.sigma**2 * np.eye(2))


@cache
def _table() -> tuple[FloatArray, FloatArray]:
    from scipy.special import exp1

    z = np.linspace(np.log(1e-4), np.log(40.0), 4000)
    return z, exp1(np.exp(z)) + z + np.euler_gamma


def _entire(a: ArrayLike) -> FloatArray:
    """``integral from 0 to a of (1 - exp(-u)) / u du``, from a table: relative error below 1e-5."""
    a = array(a)
    z, table = _table()
    at = np.log(np.maximum(a, 1e-300))
    return np.where(a < 1e-4, a - 0.25 * a**2, np.where(a > 40.0, at + np.euler_gamma, np.interp(at, z, table)))
