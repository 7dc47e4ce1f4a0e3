"""Random errors of a sensor: exact discrete generators with their spectra and Allan variances.

Everything here is a *rate-like* signal x (angular rate in rad/s or specific force in m/s^2) sampled every ``dt``. Over
an interval ``dt`` it adds ``x * dt`` to an increment, so white noise of root density N has standard deviation
``N / sqrt(dt)`` on a rate sample and ``N * sqrt(dt)`` on an increment. Spectra are two-sided: ``S(f)`` is defined for
negative and positive f and integrates to the variance over both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import exp, expm1, factorial, isfinite, log, log10, pi, sqrt
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

if TYPE_CHECKING:
    from schuler.sensors.spec import TriadSpec

Shape: TypeAlias = int | tuple[int, ...]
Start: TypeAlias = Literal["stationary", "zero"]


def white(N: float, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
    """White noise of root density N, as the mean over each sampling interval.

    Parameters
    ----------
    N : float
        Two-sided root power spectral density. [x/sqrt(Hz)]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0; the other axes are independent.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape n
        Independent normal samples of standard deviation ``N / sqrt(dt)``. [x]

    Raises
    ------
    InputError
        If N is negative, dt not positive, or n no shape.

    Notes
    -----
    The mean of m consecutive samples is a sample of the same process at ``m * dt``: the statistics do not depend on the
    rate. Flenniken (2005) divides by the rate instead of multiplying in chapters 5 and 6; his chapter 2 has it right.

    References
    ----------
    Flenniken (2005), eqs. (2.2), (2.8).
    """
    shape, dt = _shape(n), _positive(dt, "dt")
    return _magnitude(N, "N") / sqrt(dt) * rng.standard_normal(shape)


def random_walk(K: float, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
    """Random walk (rate random walk of a sensor) that starts at zero.

    Parameters
    ----------
    K : float
        Root density of the driving white noise. [x*sqrt(Hz)]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape n
        Sample k has variance ``K**2 * k * dt``, exactly and at any rate; sample 0 is zero. [x]

    Raises
    ------
    InputError
        If K is negative, dt not positive, or n no shape.
    """
    shape, dt = _shape(n), _positive(dt, "dt")
    steps = _magnitude(K, "K") * sqrt(dt) * rng.standard_normal(shape)
    steps[:1] = 0.0
    walk: FloatArray = np.cumsum(steps, axis=0)
    return walk


def gauss_markov(
    sigma: float, tau: float, n: Shape, dt: float, rng: np.random.Generator, start: Start = "stationary"
) -> FloatArray:
    """First-order Gauss-Markov process, exact at the samples for any rate.

    Parameters
    ----------
    sigma : float
        Standard deviation in the steady state. [x]
    tau : float
        Correlation time. [s]
    n : int or tuple of int
        Number of samples, or the shape with time along axis 0.
    dt : float
        Sampling interval. [s]
    rng : numpy.random.Generator
    start : {"stationary", "zero"}
        First sample from N(0, sigma^2), or exactly zero (a bias just calibrated out).

    Returns
    -------
    ndarray, shape n
        ``b[k+1] = e b[k] + sigma sqrt(1 - e^2) v[k]``, ``e = exp(-dt / tau)``. [x]

    Raises
    ------
    InputError
        If sigma is negative, tau or dt not positive, n no shape or start unknown.

    Notes
    -----
    The source integrates ``b' = -b / tau + w`` by Euler's rule, which is unstable for ``dt > 2 tau`` and needs a drive
    of its own for every rate; its sizing (B.9) moreover has a plus where (B.8) leads to a minus. The recursion above
    has neither defect. The source leaves the start open although it changes short runs most; hence the argument.

    References
    ----------
    Flenniken (2005), eqs. (2.4), (2.5) and appendix B.
    """
    from scipy.signal import lfilter

    shape, dt = _shape(n), _positive(dt, "dt")
    step = dt / _positive(tau, "tau")
    drive = _magnitude(sigma, "sigma") * sqrt(-expm1(-2.0 * step)) * rng.standard_normal(shape)
    if start == "stationary":
        drive[:1] = sigma * rng.standard_normal(drive[:1].shape)
    elif start == "zero":
        drive[:1] = 0.0
    else:
        raise InputError(f"start: expected 'stationary' or 'zero', got {start!r}")
    out: FloatArray = lfilter([1.0], [1.0, -exp(-step)], drive, axis=0)
    return out


def quantise(x: ArrayLike, lsb: float) -> FloatArray:
    """Round to the nearest multiple of ``lsb``; no memory from sample to sample.

    Parameters
    ----------
    x : array_like
        [x]
    lsb : float
        Value of the least significant bit. [x]

    Returns
    -------
    ndarray of the same shape

    Raises
    ------
    InputError
        If lsb is not positive.
    """
    lsb = _positive(lsb, "lsb")
    return np.asarray(np.round(as_floats(x, "x") / lsb) * lsb)


def quantise_increments(x: ArrayLike, lsb: float) -> FloatArray:
    """Round increments to whole pulses and carry the remainder into the next interval.

    What a pulse-output sensor does: the sum of its pulses never differs by more than half a pulse from the sum of the
    true increments, so quantisation makes noise but no drift.

    Parameters
    ----------
    x : array_like, shape (n, ...)
        Increments, time along axis 0.
    lsb : float
        Size of a pulse, in the unit of ``x``.

    Returns
    -------
    ndarray of the same shape

    Raises
    ------
    InputError
        If lsb is not positive.
    """
    lsb = _positive(lsb, "lsb")
    pulses = np.round(np.cumsum(as_floats(x, "x"), axis=0) / lsb)
    return np.asarray(np.diff(pulses, axis=0, prepend=np.zeros_like(pulses[:1])) * lsb)


class Process(ABC):
    """What a noise term knows: how to be drawn, its spectrum, its Allan variance. Terms add up with ``+``."""

    __slots__ = ()

    @abstractmethod
    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Draw ``n`` samples (or shape ``n``, time along axis 0) at intervals ``dt`` [s]. [x]"""

    @abstractmethod
    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the process at averaging times ``tau`` [s]. [x^2]"""

    @abstractmethod
    def psd(self, f: ArrayLike) -> FloatArray:
        """Two-sided power spectral density at frequencies ``f`` [Hz]. [x^2/Hz]"""

    def __add__(self, other: Process) -> NoiseModel:
        if not isinstance(other, Process):
            return NotImplemented
        return NoiseModel(terms_of(self) + terms_of(other))


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
        _magnitude(self.N, "N")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`white`."""
        return white(self.N, n, dt, rng)

    def variance(self, dt: float) -> float:
        """Variance of a sample that is the mean over ``dt`` [s]. [x^2]"""
        return self.N**2 / dt

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``N^2 / tau``. [x^2]"""
        return self.N**2 / _array(tau)

    def psd(self, f: ArrayLike) -> FloatArray:
        """``N^2`` at every frequency. [x^2/Hz]"""
        return np.full_like(_array(f), self.N**2)


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
        _magnitude(self.K, "K")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`random_walk`."""
        return random_walk(self.K, n, dt, rng)

    def variance(self, t: ArrayLike) -> FloatArray:
        """``K^2 t`` at times ``t`` [s] after the start. [x^2]"""
        return self.K**2 * _array(t)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``K^2 tau / 3``. [x^2]"""
        return self.K**2 * _array(tau) / 3.0

    def psd(self, f: ArrayLike) -> FloatArray:
        """``K^2 / (2 pi f)^2``, of the increments over any finite time. [x^2/Hz]"""
        return (self.K / (2.0 * pi * _array(f))) ** 2


@dataclass(frozen=True, slots=True)
class GaussMarkov(Process):
    """First-order Gauss-Markov process; see :func:`gauss_markov`.

    Attributes
    ----------
    sigma : float
        Steady-state standard deviation. [x]
    tau : float
        Correlation time. [s]
    start : {"stationary", "zero"}
    """

    sigma: float
    tau: float
    start: Start = "stationary"

    def __post_init__(self) -> None:
        _magnitude(self.sigma, "sigma")
        _positive(self.tau, "tau")
        if self.start not in ("stationary", "zero"):
            raise InputError(f"start: expected 'stationary' or 'zero', got {self.start!r}")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`gauss_markov`."""
        return gauss_markov(self.sigma, self.tau, n, dt, rng, self.start)

    def variance(self, t: ArrayLike) -> FloatArray:
        """``sigma^2``, or ``sigma^2 (1 - exp(-2 t / tau))`` at ``t`` [s] after a zero start. [x^2]"""
        t = _array(t)
        return self.sigma**2 * (np.ones_like(t) if self.start == "stationary" else -np.expm1(-2.0 * t / self.tau))

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """``sigma^2 exp(-|lag| / tau)`` in the steady state, lags in seconds. [x^2]"""
        return self.sigma**2 * np.exp(-np.abs(_array(lag)) / self.tau)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the continuous process in the steady state. [x^2]

        Parameters
        ----------
        tau : array_like
            Averaging times. [s]

        Notes
        -----
        With ``x = tau / tau_c``: ``sigma^2 (2 x - 3 + 4 exp(-x) - exp(-2 x)) / x^2``; maximum 0.6174^2 sigma^2 at
        x = 1.893. Below x = 0.1 the closed form loses digits and its power series is summed instead. A series of point
        samples lies above this formula at averaging times of one to three samples.

        References
        ----------
        Flenniken (2005), appendix A; IEEE Std 952, annex C (exponentially correlated noise).
        """
        x = _array(tau) / self.tau
        series = sum(((-1) ** k * (4 - 2**k) / factorial(k) * x ** (k - 2) for k in range(3, 13)), np.zeros_like(x))
        u = -np.expm1(-x)
        closed = (2.0 * x - 2.0 * u - u * u) / np.maximum(x, 0.1) ** 2
        return self.sigma**2 * np.where(x < 0.1, series, closed)

    def psd(self, f: ArrayLike) -> FloatArray:
        """``2 sigma^2 tau / (1 + (2 pi f tau)^2)``. [x^2/Hz]"""
        return 2.0 * self.sigma**2 * self.tau / (1.0 + (2.0 * pi * _array(f) * self.tau) ** 2)


@dataclass(frozen=True, slots=True)
class Ramp(Process):
    """Linear drift from zero whose slope is drawn once per run and axis from N(0, R^2).

    Attributes
    ----------
    R : float
        [x/s]
    """

    R: float

    def __post_init__(self) -> None:
        _magnitude(self.R, "R")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Time along axis 0, one slope for each of the other axes. [x]"""
        shape = _shape(n)
        t = _positive(dt, "dt") * np.arange(shape[0])
        return np.asarray(np.multiply.outer(t, self.R * rng.standard_normal(shape[1:])))

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """``R^2 tau^2 / 2``, in the mean over slopes. [x^2]"""
        return 0.5 * (self.R * _array(tau)) ** 2

    def psd(self, f: ArrayLike) -> FloatArray:
        """``R^2 / (2 pi f)^3``, the apparent density that IEEE Std 952 assigns to a ramp. [x^2/Hz]"""
        return np.asarray(self.R**2 / (2.0 * pi * np.abs(_array(f))) ** 3)


@dataclass(frozen=True, slots=True)
class NoiseModel(Process):
    """Sum of independent noise terms; none at all is a perfect sensor.

    Attributes
    ----------
    terms : tuple of Process
        Nested sums are flattened.
    """

    terms: tuple[Process, ...] = ()

    def __post_init__(self) -> None:
        flat = tuple(t for term in self.terms for t in terms_of(term))
        object.__setattr__(self, "terms", flat)

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Sum of one realisation of every term. [x]

        Each term draws from its own child of ``rng``, so a change in one leaves the others as they were.
        """
        total = np.zeros(_shape(n))
        for term, child in zip(self.terms, rng.spawn(len(self.terms)), strict=True):
            total += term.sample(n, dt, child)
        return total

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Sum over the terms. [x^2]"""
        tau = _array(tau)
        return sum((term.allan_variance(tau) for term in self.terms), np.zeros_like(tau))

    def psd(self, f: ArrayLike) -> FloatArray:
        """Sum over the terms. [x^2/Hz]"""
        f = _array(f)
        return sum((term.psd(f) for term in self.terms), np.zeros_like(f))

    @property
    def white(self) -> White:
        """The white terms as one."""
        return White(sqrt(sum(term.N**2 for term in self.terms if isinstance(term, White))))

    @property
    def in_run(self) -> NoiseModel:
        """The other terms: the bias that wanders during a run."""
        return NoiseModel(tuple(term for term in self.terms if not isinstance(term, White)))


def terms_of(process: Process) -> tuple[Process, ...]:
    """The terms of a sum, or the process alone."""
    return process.terms if isinstance(process, NoiseModel) else (process,)


def flicker(B: float, shortest: float = 1.0, longest: float = 1e4) -> NoiseModel:
    """Bias instability (1/f noise) as a sum of Gauss-Markov processes, one per decade of correlation time.

    Parameters
    ----------
    B : float
        Bias instability of IEEE Std 952, ``S(f) = B^2 / (2 pi |f|)``; the flat part of the Allan deviation lies at
        ``0.664 B``. [x]
    shortest, longest : float
        Correlation times of the first and last process. [s]

    Returns
    -------
    NoiseModel
        Its Allan deviation is within 3 % of ``0.664 B`` from ``10 shortest`` to ``0.4 longest``, 7 % below at
        ``longest`` and 18 % below at ``shortest``; its standard deviation is ``0.86 B`` times the square root of the
        number of decades plus one, 1.9 B by default.

    Raises
    ------
    InputError
        If B is negative or the band empty.

    Notes
    -----
    Equal variances ``B^2 ln(r) / pi`` at correlation times in the ratio r add up to ``B^2 / (2 pi f)``, since
    ``integral 2 tau / (1 + (w tau)^2) d ln(tau) = pi / w``. Unlike true 1/f noise the sum has a finite variance and an
    exact state-space form, and it is stationary from the first sample.
    """
    _magnitude(B, "B")
    shortest = _positive(shortest, "shortest")
    if not shortest < _positive(longest, "longest"):
        raise InputError(f"longest: expected more than shortest = {shortest} s, got {longest} s")
    taus = np.geomspace(shortest, longest, max(2, round(log10(longest / shortest)) + 1))
    sigma = B * sqrt(log(taus[1] / taus[0]) / pi)
    return NoiseModel(tuple(GaussMarkov(sigma, float(tau)) for tau in taus))


def noise_model(triad: TriadSpec, start: Start = "stationary") -> NoiseModel:
    """The noise terms of an error budget: N, in-run Gauss-Markov, K, R and B, as far as they are not zero.

    Parameters
    ----------
    triad : TriadSpec
    start : {"stationary", "zero"}
        Of the in-run Gauss-Markov bias.

    Returns
    -------
    NoiseModel
        B is represented by :func:`flicker` over correlation times of 1 s to 10^4 s. Q is not a term here: it comes from
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
        terms.append(flicker(triad.bias_instability))
    return NoiseModel(tuple(terms))


def _array(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)  # unlike as_floats keeps a scalar a scalar


def _shape(n: Shape) -> tuple[int, ...]:
    shape = n if isinstance(n, tuple) else (n,)
    if not shape or not all(isinstance(k, (int, np.integer)) and k >= 0 for k in shape):
        raise InputError(f"n: expected a number of samples or a shape (n, axes), got {n!r}")
    return shape


def _positive(value: float, name: str) -> float:
    if not (np.ndim(value) == 0 and isfinite(value) and value > 0.0):
        raise InputError(f"{name}: expected one positive finite number, got {value!r}")
    return float(value)


def _magnitude(value: float, name: str) -> float:
    if not (np.ndim(value) == 0 and isfinite(value) and value >= 0.0):
        raise InputError(f"{name}: expected one finite number, not negative, got {value!r}")
    return float(value)
