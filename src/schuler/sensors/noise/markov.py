"""Gauss-Markov processes of first and second order."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, expm1, factorial, pi, sinh, sqrt

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
    positive,
    since_start,
    times,
)
from schuler.sensors.noise.generators import gauss_markov
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import StateSpace


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
        magnitude(self.sigma, "sigma")
        positive(self.tau, "tau")
        if self.start not in ("stationary", "zero"):
            raise InputError(f"start: expected 'stationary' or 'zero', got {self.start!r}")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """See :func:`gauss_markov`."""
        return gauss_markov(self.sigma, self.tau, n, dt, rng, self.start)

    def variance(self, t: ArrayLike) -> FloatArray:
        """``sigma^2``, or ``sigma^2 (1 - exp(-2 t / tau))`` at ``t`` [s] after a zero start. [x^2]"""
        t = since_start(t)
        return self.sigma**2 * (np.ones_like(t) if self.start == "stationary" else -np.expm1(-2.0 * t / self.tau))

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """``sigma^2 exp(-|lag| / tau)`` in the steady state, lags in seconds. [x^2]"""
        return self.sigma**2 * np.exp(-np.abs(array(lag)) / self.tau)

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
        samples lies above it at short averaging times: :meth:`discrete_allan_variance`.

        References
        ----------
        Flenniken (2005), appendix A; IEEE Std 952, annex C (exponentially correlated noise).
        """
        x = times(tau) / self.tau
        return self.sigma**2 * _continuous(x)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """Allan variance of point samples in the steady state. [x^2]

        Parameters
        ----------
        m : array_like of int
            Samples in a cluster.
        dt : float
            Sampling interval. [s]

        Notes
        -----
        With ``h = dt / tau_c``, ``u = 1 - exp(-m h)``: ``sigma^2 (2 m sinh h - 2 u - u^2) / (2 m sinh(h / 2))^2``; at
        m = 1 it is ``sigma^2 (1 - exp(-h))``, whose root is 22 % above that of the continuous formula for small h, and
        less than 2 % above from m = 4. Summed as the continuous formula plus what ``sinh h`` exceeds h by, both over
        h^2, which keeps its digits for any small h.
        """
        m, h = counts(m), positive(dt, "dt") / self.tau
        x = m * h
        if h > 1.0:
            e, u = exp(-h), -np.expm1(-x)
            return np.asarray(self.sigma**2 * (m * (1.0 + e) / (1.0 - e) - e * u * (2.0 + u) / (1.0 - e) ** 2) / m**2)
        excess = sum(h ** (k - 2) / factorial(k) for k in range(3, 20, 2))  # (sinh(h) - h) / h^2
        return np.asarray(self.sigma**2 * (_continuous(x) + 2.0 * excess / m) / (2.0 * sinh(0.5 * h) / h) ** 2)

    def psd(self, f: ArrayLike) -> FloatArray:
        """``2 sigma^2 tau / (1 + (2 pi f tau)^2)``. [x^2/Hz]"""
        return 2.0 * self.sigma**2 * self.tau / (1.0 + (2.0 * pi * frequencies(f) * self.tau) ** 2)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """``sigma^2 dt (1 - e^2) / (1 - 2 e cos(2 pi f dt) + e^2)``, ``e = exp(-dt / tau)``. [x^2/Hz]"""
        h = positive(dt, "dt") / self.tau
        e = exp(-h)
        # (1 - e)^2 + 4 e sin^2: the same without the cancellation
        return np.asarray(
            -(self.sigma**2) * dt * expm1(-2.0 * h) / (expm1(-h) ** 2 + 4.0 * e * np.sin(pi * frequencies(f) * dt) ** 2)
        )

    def state_space(self) -> StateSpace:
        """One state, ``b' = -b / tau + w``, drive ``2 sigma^2 / tau``."""
        P0 = self.sigma**2 if self.start == "stationary" else 0.0
        F, Q = np.full((1, 1), -1.0 / self.tau), np.full((1, 1), 2.0 * self.sigma**2 / self.tau)
        return StateSpace(F, Q, np.ones(1), np.full((1, 1), P0))


@dataclass(frozen=True, slots=True)
class GaussMarkov2(Process):
    """Second-order Gauss-Markov process: white noise through a damped oscillator, in its steady state.

    ``x'' + 2 zeta omega_0 x' + omega_0^2 x = w``. With zeta = 1 it is the second-order process of Brown and Hwang,
    whose beta is omega_0; a small zeta makes a narrow band, a vibration of wandering phase.

    Attributes
    ----------
    sigma : float
        Standard deviation. [x]
    omega_0 : float
        Natural frequency. [rad/s]
    zeta : float
        Damping ratio, positive; critical at 1.

    Notes
    -----
    Samples are points, exact for any dt and zeta.

    References
    ----------
    Brown and Hwang (2012), section 3.5 (for zeta = 1); Gelb (1974), section 2.2.
    """

    sigma: float
    omega_0: float
    zeta: float = 1.0

    def __post_init__(self) -> None:
        magnitude(self.sigma, "sigma")
        positive(self.omega_0, "omega_0")
        positive(self.zeta, "zeta")

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Draw from the exactly sampled state space. [x]"""
        return self.sampled(dt).sample(n, rng)

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """Covariance at lags in seconds. [x^2]

        ``sigma^2 exp(-zeta w |t|) (cos(w_d t) + zeta w / w_d sin(w_d |t|))`` with ``w_d = w sqrt(1 - zeta^2)``,
        ``sigma^2 (1 + w |t|) exp(-w |t|)`` at zeta = 1, and hyperbolic functions above.
        """
        t = self.omega_0 * np.abs(array(lag))
        d = sqrt(abs(1.0 - self.zeta**2))
        if self.zeta < 1.0:
            shape = np.exp(-self.zeta * t) * (np.cos(d * t) + self.zeta * t * np.sinc(d * t / pi))
        elif self.zeta == 1.0:
            shape = np.exp(-t) * (1.0 + t)
        else:
            # the slow decay as 1 / (zeta + d): the difference zeta - d loses its digits for strong damping
            slow = 1.0 / (self.zeta + d)
            shape = np.exp(-slow * t) * (1.0 - slow * np.expm1(-2.0 * d * t) / (2.0 * d))
        return np.asarray(self.sigma**2 * shape)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """From the exactly integrated state space. [x^2]"""
        return self.state_space().allan_variance(tau)

    def psd(self, f: ArrayLike) -> FloatArray:
        """``4 zeta omega_0^3 sigma^2 / ((omega_0^2 - w^2)^2 + (2 zeta omega_0 w)^2)``, ``w = 2 pi f``. [x^2/Hz]"""
        w = 2.0 * pi * frequencies(f) / self.omega_0
        return 4.0 * self.zeta * self.sigma**2 / self.omega_0 / ((1.0 - w**2) ** 2 + (2.0 * self.zeta * w) ** 2)

    def state_space(self) -> StateSpace:
        """States ``x`` and ``x' / omega_0``, uncorrelated and of the same variance in the steady state."""
        w = self.omega_0
        F = np.array([[0.0, w], [-w, -2.0 * self.zeta * w]])
        Q = np.diag([0.0, 4.0 * self.zeta * w * self.sigma**2])
        return StateSpace(F, Q, np.array([1.0, 0.0]), self.sigma**2 * np.eye(2))


def _continuous(x: FloatArray) -> FloatArray:
    """Allan variance of a first-order process of unit variance over x correlation times."""
    small = np.minimum(x, 0.1)  # powers of a large x would overflow
    series = sum(((-1) ** k * (4 - 2**k) / factorial(k) * small ** (k - 2) for k in range(3, 13)), np.zeros_like(x))
    u = -np.expm1(-x)
    large = np.maximum(x, 0.1)
    closed = (2.0 * x - 2.0 * u - u * u) / large / large
    return np.asarray(np.where(x < 0.1, series, closed))
