"""Terms of an error budget with closed forms: white noise, quantisation, random walk; constant, ramp, vibration."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import (
    Shape,
    Start,
    array,
    counts,
    frequencies,
    magnitude,
    over,
    positive,
    shape_of,
    since_start,
    times,
)
from schuler.sensors.noise.bias_instability import Flicker
from schuler.sensors.noise.generators import random_walk, white
from schuler.sensors.noise.markov import GaussMarkov
from schuler.sensors.noise.process import NoiseModel, Process
from schuler.sensors.noise.state_space import StateSpace

if TYPE_CHECKING:
    from schuler.sensors.spec import TriadSpec

NO_STATES: FloatArray = np.zeros((0, 0))


@dataclass(frozen=True, slots=True)
class White(Process):
    """White noise: angle or velocity random walk after integration; see :func:`white`.

    Attributes
    ----------
    N : float
        Two-sided root power spectral density. [x/sqrt(Hz)]
    """

    N: float

    def __post_init__(self) -> None:
        magnitude(self.N, "N")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`white`."""
        return white(self.N, n, dt, rng)

    def variance(self, dt: float) -> float:
        """Variance of a sample that is the mean over ``dt`` [s]. [x^2]"""
        return self.N**2 / positive(dt, "dt")

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``N^2 / tau``. [x^2]"""
        return self.N**2 / times(tau)

    def psd(self, f: ArrayLike) -> FloatArray:
        """``N^2`` at every frequency. [x^2/Hz]"""
        return np.full_like(frequencies(f), self.N**2)

    def state_space(self) -> StateSpace:
        """No state, density ``N^2`` straight to the output."""
        return StateSpace(NO_STATES, NO_STATES, np.empty(0), NO_STATES, white=self.N**2)


@dataclass(frozen=True, slots=True)
class Quantisation(Process):
    """Rounding of the integral: each sample is ``(e[k] - e[k-1]) / dt`` with white e of standard deviation Q.

    Attributes
    ----------
    Q : float
        Standard deviation of the remainders; pulses of size q give ``Q = q / sqrt(12)``. [x*s]

    Notes
    -----
    Samples are means over the interval: the mean of m of them is one sample at ``m dt``, at any rate. The e are
    uniform, as remainders of rounding are. :func:`quantise_increments` rounds an actual signal instead; at rest, where
    that is no longer random, the two differ.

    References
    ----------
    IEEE Std 952, annex C (quantisation noise).
    """

    Q: float

    def __post_init__(self) -> None:
        magnitude(self.Q, "Q")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Differences of independent uniform remainders of standard deviation Q, over ``dt``. [x]"""
        shape = shape_of(n)
        half_pulse = sqrt(3.0) * self.Q
        e = rng.uniform(-half_pulse, half_pulse, (shape[0] + 1, *shape[1:]))
        return np.asarray(np.diff(e, axis=0) / positive(dt, "dt"))

    def variance(self, dt: float) -> float:
        """``2 Q^2 / dt^2``, of a sample that is the mean over ``dt`` [s]. [x^2]"""
        return 2.0 * (self.Q / positive(dt, "dt")) ** 2

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``3 Q^2 / tau^2``. [x^2]"""
        return 3.0 * (self.Q / times(tau)) ** 2

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """``3 Q^2 / (m dt)^2``, the same. [x^2]"""
        return self.allan_variance(counts(m) * positive(dt, "dt"))

    def psd(self, f: ArrayLike) -> FloatArray:
        """Refused: the density depends on the rate at which it is rounded.

        Raises
        ------
        InputError
            Always. :meth:`discrete_psd` at interval dt is ``4 Q^2 sin^2(pi f dt) / dt``, at low frequencies
            ``Q^2 dt (2 pi f)^2``.
        """
        raise InputError(
            "Quantisation has no spectrum without a sampling interval: the same Q spreads over a band that grows with "
            "the rate; use discrete_psd(f, dt)"
        )

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """``4 Q^2 sin^2(pi f dt) / dt``. [x^2/Hz]"""
        dt = positive(dt, "dt")
        return 4.0 * self.Q**2 * np.sin(pi * frequencies(f) * dt) ** 2 / dt

    def state_space(self) -> StateSpace:
        """No state; the delay of one sample appears in :meth:`Process.sampled`."""
        return StateSpace(NO_STATES, NO_STATES, np.empty(0), NO_STATES, rounding=self.Q**2)


@dataclass(frozen=True, slots=True)
class RandomWalk(Process):
    """Rate random walk that starts at zero; see :func:`random_walk`.

    Attributes
    ----------
    K : float
        [x*sqrt(Hz)]
    """

    K: float

    def __post_init__(self) -> None:
        magnitude(self.K, "K")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`random_walk`."""
        return random_walk(self.K, n, dt, rng)

    def variance(self, t: ArrayLike) -> FloatArray:
        """``K^2 t`` at times ``t`` [s] after the start. [x^2]"""
        return self.K**2 * since_start(t)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``K^2 tau / 3``. [x^2]"""
        return self.K**2 * times(tau) / 3.0

    def psd(self, f: ArrayLike) -> FloatArray:
        """``K^2 / (2 pi f)^2``, of the increments over any finite time. [x^2/Hz]"""
        return over(self.K**2, (2.0 * pi * frequencies(f)) ** 2)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """``K^2 dt (2 m^2 + 1) / (6 m)``: half as much again as the continuous formula at m = 1. [x^2]"""
        m = counts(m)
        return self.K**2 * positive(dt, "dt") * (2.0 * m**2 + 1.0) / (6.0 * m)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """``K^2 dt^2 / (4 sin^2(pi f dt))``. [x^2/Hz]"""
        dt = positive(dt, "dt")
        return over((0.5 * self.K * dt) ** 2, np.sin(pi * frequencies(f) * dt) ** 2)

    def state_space(self) -> StateSpace:
        """One state, known to be zero at the first sample."""
        return StateSpace(np.zeros((1, 1)), np.full((1, 1), self.K**2), np.ones(1), np.zeros((1, 1)))


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


def noise_model(triad: TriadSpec, start: Start = "stationary") -> NoiseModel:
    """The noise terms of an error budget: N, in-run Gauss-Markov, K, R and B, as far as they are not zero.

    Parameters
    ----------
    triad : TriadSpec
    start : {"stationary", "zero"}
        Start of the in-run Gauss-Markov bias.

    Returns
    -------
    NoiseModel
        B is :class:`Flicker`, drawn over a band that fits rate and duration. Q is not a term here: it comes from
        rounding (:func:`quantise_increments`).
    """
    terms: list[Process] = [White(triad.random_walk)]
    if triad.in_run_bias:
        terms.append(GaussMarkov(triad.in_run_bias, triad.in_run_time, start))
    if triad.rate_random_walk:
        terms.append(RandomWalk(triad.rate_random_walk))
    if triad.rate_ramp:
        terms.append(Ramp(triad.rate_ramp))
    if triad.bias_instability:
        terms.append(Flicker(triad.bias_instability))
    return NoiseModel(tuple(terms))
