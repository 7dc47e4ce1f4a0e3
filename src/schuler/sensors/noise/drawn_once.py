"""Errors that are random once per run: a constant, a ramp, a vibration."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.sensors.noise._checks import Shape, array, counts, frequencies, magnitude, over, positive, shape_of, times
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import StateSpace


@dataclass(frozen=True, slots=True)
class RandomConstant(Process):
    """A constant, drawn once per run and axis from N(0, sigma^2): a turn-on bias.

    Attributes
    ----------
    sigma : float
        [x]
    """

    sigma: float

    def __post_init__(self) -> None:
        magnitude(self.sigma, "sigma")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """The same value at all times, another one for each of the other axes. [x]"""
        shape = shape_of(n)
        positive(dt, "dt")
        return np.array(np.broadcast_to(self.sigma * rng.standard_normal(shape[1:]), shape))

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Zero: differences do not see a constant. [x^2]"""
        return np.zeros_like(times(tau))

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """Zero. [x^2]"""
        return np.zeros_like(counts(m)) * positive(dt, "dt")

    def psd(self, f: ArrayLike) -> FloatArray:
        """Infinite at f = 0, zero elsewhere. [x^2/Hz]"""
        return _line(f, 0.0, self.sigma)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """The same, and at multiples of the rate. [x^2/Hz]"""
        return _line(np.remainder(frequencies(f), 1.0 / positive(dt, "dt")), 0.0, self.sigma)

    def state_space(self) -> StateSpace:
        """One state without a drive."""
        return StateSpace(np.zeros((1, 1)), np.zeros((1, 1)), np.ones(1), np.full((1, 1), self.sigma**2))


@dataclass(frozen=True, slots=True)
class Ramp(Process):
    """Linear drift from zero.

    Attributes
    ----------
    R : float
        Slope. [x/s]
    fixed : bool
        False: R is the standard deviation of a slope drawn once per run and axis. True: every slope is R, of either
        sign, as identified from one log.
    """

    R: float
    fixed: bool = False

    def __post_init__(self) -> None:
        magnitude(abs(self.R) if self.fixed else self.R, "R")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Time along axis 0, one slope for each of the other axes. [x]"""
        shape = shape_of(n)
        t = positive(dt, "dt") * np.arange(shape[0])
        slopes = np.ones(shape[1:]) if self.fixed else rng.standard_normal(shape[1:])
        return np.asarray(np.multiply.outer(t, self.R * slopes))

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``R^2 tau^2 / 2``, in the mean over slopes. [x^2]"""
        return 0.5 * (self.R * times(tau)) ** 2

    def psd(self, f: ArrayLike) -> FloatArray:
        """``R^2 / (2 pi f)^3``, the apparent density that IEEE Std 952 assigns to a ramp. [x^2/Hz]"""
        return over(self.R**2, (2.0 * pi * np.abs(frequencies(f))) ** 3)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """``R^2 (m dt)^2 / 2``, the same. [x^2]"""
        return self.allan_variance(counts(m) * positive(dt, "dt"))

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """The apparent density of :meth:`psd`: no aliases are folded into what is no spectrum. [x^2/Hz]"""
        positive(dt, "dt")
        return self.psd(f)

    def state_space(self) -> StateSpace:
        """Drift and slope, without a drive; a fixed slope enters by its square."""
        F = np.array([[0.0, 1.0], [0.0, 0.0]])
        return StateSpace(F, np.zeros((2, 2)), np.array([1.0, 0.0]), np.diag([0.0, self.R**2]))


@dataclass(frozen=True, slots=True)
class Sinusoid(Process):
    """A vibration or a beat: ``A sin(2 pi f t + phase)``, the phase drawn once per run and axis, uniform.

    Attributes
    ----------
    amplitude : float
        A. [x]
    frequency : float
        f. [Hz]

    Notes
    -----
    Samples are points: a frequency above half the rate shows up as its alias. The state space has the same covariance
    but a normal, thus varying, amplitude.
    """

    amplitude: float
    frequency: float

    def __post_init__(self) -> None:
        magnitude(self.amplitude, "amplitude")
        positive(self.frequency, "frequency")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Time along axis 0, one phase for each of the other axes. [x]"""
        shape = shape_of(n)
        angle = 2.0 * pi * self.frequency * positive(dt, "dt") * np.arange(shape[0])
        return np.asarray(self.amplitude * np.sin(np.add.outer(angle, rng.uniform(0.0, 2.0 * pi, shape[1:]))))

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """``A^2 / 2 cos(2 pi f lag)``, lags in seconds. [x^2]"""
        return np.asarray(0.5 * self.amplitude**2 * np.cos(2.0 * pi * self.frequency * array(lag)))

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``(A sin^2(pi f tau) / (pi f tau))^2``, IEEE Std 952, annex C. [x^2]"""
        u = pi * self.frequency * times(tau)
        return np.asarray((self.amplitude * np.sin(u) ** 2 / u) ** 2)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """``(A sin^2(pi f m dt) / (m sin(pi f dt)))^2``; zero where f is a multiple of the rate. [x^2]"""
        m, u = counts(m), pi * self.frequency * positive(dt, "dt")
        # u less its nearest multiple of pi has the same squares and keeps 0/0 at one place
        u -= pi * round(u / pi)
        if u == 0.0:
            return np.zeros_like(m)
        return np.asarray((self.amplitude * np.sin(m * u) ** 2 / (m * np.sin(u))) ** 2)

    def psd(self, f: ArrayLike) -> FloatArray:
        """Two lines: infinite at plus and minus the frequency, power A^2 / 4 each, zero elsewhere. [x^2/Hz]"""
        return _line(f, self.frequency, self.amplitude)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """Lines at the frequency and its aliases. [x^2/Hz]"""
        rate = 1.0 / positive(dt, "dt")
        first = np.remainder(self.frequency, rate)
        f = np.remainder(frequencies(f), rate)
        return np.maximum(_line(f, first, self.amplitude), _line(f, np.remainder(-first, rate), self.amplitude))

    def state_space(self) -> StateSpace:
        """An undamped oscillator of random start."""
        w = 2.0 * pi * self.frequency
        P0 = 0.5 * self.amplitude**2 * np.eye(2)
        return StateSpace(np.array([[0.0, w], [-w, 0.0]]), np.zeros((2, 2)), np.array([1.0, 0.0]), P0)


def _line(f: ArrayLike, at: float, size: float) -> FloatArray:
    return np.where((np.abs(frequencies(f)) == at) & (size > 0.0), np.inf, 0.0)
