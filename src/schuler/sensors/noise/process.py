"""Interface of noise processes, and sums of processes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, counts, frequencies, positive, shape_of, times
from schuler.sensors.noise.state_space import SampledStateSpace, StateSpace

if TYPE_CHECKING:
    from schuler.sensors.noise.terms import White


class Process(ABC):
    """A noise term: samples, spectrum, Allan variance, states. Terms add with ``+``."""

    __slots__ = ()

    @abstractmethod
    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Draw ``n`` samples (or shape ``n``, time along axis 0) at intervals ``dt`` [s]. [x]

        White noise and quantisation are means over the interval, since as points they have no finite variance. All
        other terms are points: their statistics at the samples are exact, and every tenth of a 100 Hz series is a 10 Hz
        series. What a mean over the interval would change is the difference between :meth:`discrete_allan_variance` and
        :meth:`allan_variance`.
        """

    @abstractmethod
    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance at averaging times ``tau`` [s], clusters being means of the continuous signal. [x^2]"""

    @abstractmethod
    def psd(self, f: ArrayLike) -> FloatArray:
        """Two-sided power spectral density of the continuous signal at frequencies ``f`` [Hz]. [x^2/Hz]"""

    @abstractmethod
    def state_space(self) -> StateSpace:
        """The process as a linear system driven by white noise, with the same first two moments.

        Raises
        ------
        InputError
            If there is none in continuous time: an :class:`AutoRegressive` process has only :meth:`sampled`, a
            :class:`Coloured` one neither.
        """

    def sampled(self, dt: float) -> SampledStateSpace:
        """The linear system at its samples, every ``dt`` [s], exactly what :meth:`sample` draws."""
        return self.state_space().sampled(positive(dt, "dt"))

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """Allan variance of the samples themselves, clusters being means of ``m`` of them, exact. [x^2]

        Parameters
        ----------
        m : array_like of int
            Samples in a cluster.
        dt : float
            Sampling interval. [s]

        Returns
        -------
        ndarray, shape of m
            What an estimate from :meth:`sample` converges to; for large m :meth:`allan_variance` at ``m dt``.

        Raises
        ------
        InputError
            If an m is no whole number from 1 or dt is not positive.
        """
        return self.sampled(dt).allan_variance(m)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """Two-sided density of the series of samples every ``dt`` [s], aliases folded in, at ``f`` [Hz]. [x^2/Hz]

        What a periodogram of :meth:`sample` converges to.
        """
        return self.sampled(dt).psd(f)

    def __add__(self, other: Process) -> NoiseModel:
        if not isinstance(other, Process):
            return NotImplemented
        return NoiseModel(terms_of(self) + terms_of(other))


@dataclass(frozen=True, slots=True)
class NoiseModel(Process):
    """Sum of independent noise terms; none at all is a perfect sensor.

    Attributes
    ----------
    terms : tuple of Process
        Nested sums are flattened.

    Raises
    ------
    InputError
        If a term is none.
    """

    terms: tuple[Process, ...] = ()

    def __post_init__(self) -> None:
        for term in self.terms:
            if not isinstance(term, Process):
                raise InputError(f"terms: expected noise processes such as White(N), got {term!r}")
        flat = tuple(t for term in self.terms for t in terms_of(term))
        object.__setattr__(self, "terms", flat)

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Sum of one realisation of every term. [x]

        Each term draws from its own child of ``rng``, so a change in one leaves the others as they were.
        """
        total = np.zeros(shape_of(n))
        positive(dt, "dt")
        for term, child in zip(self.terms, rng.spawn(len(self.terms)), strict=True):
            total += term.sample(n, dt, child)
        return total

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Sum over the terms. [x^2]"""
        tau = times(tau)
        return sum((term.allan_variance(tau) for term in self.terms), np.zeros_like(tau))

    def psd(self, f: ArrayLike) -> FloatArray:
        """Sum over the terms. [x^2/Hz]"""
        f = frequencies(f)
        return sum((term.psd(f) for term in self.terms), np.zeros_like(f))

    def state_space(self) -> StateSpace:
        """The systems of the terms side by side; see :meth:`Process.state_space` for errors."""
        return StateSpace.sum([term.state_space() for term in self.terms])

    def sampled(self, dt: float) -> SampledStateSpace:
        """The sampled systems of the terms side by side."""
        return SampledStateSpace.sum([term.sampled(dt) for term in self.terms], positive(dt, "dt"))

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """Sum over the terms. [x^2]"""
        return sum((term.discrete_allan_variance(m, dt) for term in self.terms), np.zeros_like(counts(m)))

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """Sum over the terms. [x^2/Hz]"""
        return sum((term.discrete_psd(f, dt) for term in self.terms), np.zeros_like(frequencies(f)))

    @property
    def white(self) -> White:
        """The white terms as one."""
        from schuler.sensors.noise.terms import White

        return White(sqrt(sum(term.N**2 for term in self.terms if isinstance(term, White))))

    @property
    def in_run(self) -> NoiseModel:
        """The other terms: the bias that wanders during a run.

        Quantisation is among them although it is no bias; an IMU's error model makes it by rounding instead.
        """
        from schuler.sensors.noise.terms import White

        return NoiseModel(tuple(term for term in self.terms if not isinstance(term, White)))


def terms_of(process: Process) -> tuple[Process, ...]:
    """The terms of a sum, or the process alone."""
    return process.terms if isinstance(process, NoiseModel) else (process,)
