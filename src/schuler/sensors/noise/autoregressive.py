"""Autoregressive noise, as fitted to a log at its own rate."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, array, frequencies, magnitude, positive, shape_of, times
from schuler.sensors.noise.process import Process
from schuler.sensors.noise.state_space import SampledStateSpace, StateSpace


@dataclass(frozen=True, slots=True)
class AutoRegressive(Process):
    """AR(p) process: ``x[k] = a_1 x[k-1] + ... + a_p x[k-p] + w[k]``, in its steady state.

    Attributes
    ----------
    coefficients : tuple of float
        ``a_1, ..., a_p`` with the signs above; MATLAB and SciPy polynomials hold ``1, -a_1, ..., -a_p``.
    sigma_w : float
        Standard deviation of w, white, per sample. [x]
    rate_hz : float
        The one rate at which the process is defined. [Hz]

    Raises
    ------
    InputError
        If the process is not stationary (a root of its polynomial on or outside the unit circle).

    Notes
    -----
    Between its samples an AR process says nothing, and most have no continuous counterpart (a_1 < 0 in AR(1) has none),
    so other rates are refused instead of guessed. Resample the log and fit again.
    """

    coefficients: tuple[float, ...]
    sigma_w: float
    rate_hz: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", tuple(as_floats(self.coefficients, "coefficients", (None,)).tolist()))
        if not self.coefficients:
            raise InputError("coefficients: expected at least one, got none; use White for noise without memory")
        magnitude(self.sigma_w, "sigma_w")
        positive(self.rate_hz, "rate_hz")
        largest = float(np.abs(np.linalg.eigvals(self._companion())).max())
        if not largest < 1.0:
            raise InputError(
                "coefficients: expected a stationary process, all roots inside the unit circle, got one of "
                f"magnitude {largest:.6g}; check the signs (x[k] = a_1 x[k-1] + ... + w[k]) or difference the log first"
            )

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Samples with the exact covariance of the steady state from the first on. [x]

        Raises
        ------
        InputError
            If ``dt`` is not ``1 / rate_hz``.
        """
        from scipy.signal import lfilter

        shape, p = shape_of(n), len(self.coefficients)
        system = self.sampled(dt)
        start = np.linalg.cholesky(system.P0) if self.sigma_w else np.zeros((p, p))
        past = np.tensordot(start, rng.standard_normal((p, *shape[1:])), axes=1)  # x[-1], x[-2], ...
        hankel = np.array([[*self.coefficients[i:], *[0.0] * i] for i in range(p)])  # memory of the transposed filter
        drive = self.sigma_w * rng.standard_normal(shape)
        polynomial = [1.0, *(-a for a in self.coefficients)]
        memory = np.tensordot(hankel, past, axes=1)
        out: FloatArray = lfilter([1.0], polynomial, drive, axis=0, zi=memory)[0]
        return out

    def autocovariance(self, lag: ArrayLike) -> FloatArray:
        """Covariance at lags that are whole numbers of samples, given in seconds. [x^2]

        Raises
        ------
        InputError
            If a lag is none.
        """
        k = self._whole(np.abs(array(lag)), "lag")
        system = self.sampled(1.0 / self.rate_hz)
        row, values = system.P0[0].copy(), []
        for _ in range(int(k.max(initial=0)) + 1):
            values.append(row[0])
            row = system.Phi @ row
        return np.asarray(np.array(values)[k])

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the series at averaging times [s] that are whole numbers of samples. [x^2]

        Raises
        ------
        InputError
            If an averaging time is none.
        """
        return self.sampled(1.0 / self.rate_hz).allan_variance(self._whole(times(tau), "tau"))

    def psd(self, f: ArrayLike) -> FloatArray:
        """``sigma_w^2 dt / |1 - sum a_k exp(-2 pi j f k dt)|^2`` up to half the rate. [x^2/Hz]

        Raises
        ------
        InputError
            If a frequency is above half the rate.
        """
        f = frequencies(f)
        if (np.abs(f) > 0.5 * self.rate_hz * (1.0 + 1e-12)).any():
            raise InputError(
                f"f: expected at most {0.5 * self.rate_hz:g} Hz, half the rate at which the process is defined, got "
                f"{float(np.abs(f).max()):g} Hz"
            )
        return self.discrete_psd(f, 1.0 / self.rate_hz)

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """The same, periodic in the rate. [x^2/Hz]"""
        self._check(dt)
        k = np.arange(1, len(self.coefficients) + 1)
        response = 1.0 - np.exp(-2j * np.pi * np.multiply.outer(frequencies(f) * dt, k)) @ np.array(self.coefficients)
        return np.asarray(self.sigma_w**2 * dt / np.abs(response) ** 2)

    def state_space(self) -> StateSpace:
        """Refused: see the class.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            f"an AutoRegressive process is defined at its samples only; use sampled(1 / {self.rate_hz:g}) for its "
            "discrete state space, or a Gauss-Markov process"
        )

    def sampled(self, dt: float) -> SampledStateSpace:
        """States ``x[k], ..., x[k-p+1]`` with the companion matrix; P0 solves the Lyapunov equation.

        Raises
        ------
        InputError
            If ``dt`` is not ``1 / rate_hz``.
        """
        from scipy.linalg import solve_discrete_lyapunov

        self._check(dt)
        Phi = self._companion()
        unit = np.zeros_like(Phi)
        unit[0, 0] = 1.0
        P0 = self.sigma_w**2 * solve_discrete_lyapunov(Phi, unit)
        return SampledStateSpace(Phi, self.sigma_w**2 * unit, unit[0], 0.5 * (P0 + P0.T), 0.0, dt)

    def _companion(self) -> FloatArray:
        Phi = np.eye(len(self.coefficients), k=-1)
        Phi[0] = self.coefficients
        return Phi

    def _check(self, dt: float) -> None:
        if not (isfinite(dt) and abs(dt * self.rate_hz - 1.0) < 1e-6):
            raise InputError(
                f"dt: expected {1.0 / self.rate_hz:g} s, since this AutoRegressive process was fitted at "
                f"{self.rate_hz:g} Hz, got {dt!r} s; fit the log again at the rate wanted, or take a GaussMarkov"
            )

    def _whole(self, t: FloatArray, name: str) -> np.ndarray:
        k = np.round(t * self.rate_hz)
        if not (np.abs(t * self.rate_hz - k) <= 1e-6 * np.maximum(k, 1.0)).all():
            raise InputError(f"{name}: expected whole multiples of 1 / {self.rate_hz:g} Hz, got {t.tolist()}")
        return k.astype(np.int64)
