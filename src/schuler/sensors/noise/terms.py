"""White noise, quantisation, random walk."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import (
    Shape,
    counts,
    frequencies,
    magnitude,
    over,
    positive,
    shape_of,
    since_start,
    times,
)
from schuler.sensors.noise.generators import random_walk, white
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import StateSpace

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
        Of the increments; pulses of size q give ``Q = q / sqrt(12)``. [x*s]

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
