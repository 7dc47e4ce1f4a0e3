"""Counting of pulses: what a sensor shows whose integral is counted in whole pulses and read at its own rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from math import pi

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.sensors.noise._checks import Shape, array, counts, frequencies, positive, shape_of, times
from schuler.sensors.noise.process import NoiseModel, Process, terms_of
from schuler.sensors.noise.shot import ShotNoise
from schuler.sensors.noise.state_space import SampledStateSpace, StateSpace
from schuler.sensors.noise.terms import White

_MOST_PHASES = 64
_MOST_HARMONICS = 200
_LONGEST = 2**16  # samples of the autocovariance behind the spectrum


@dataclass(frozen=True, slots=True)
class Counted(Process):
    """Noise and mean rate, integrated, counted in whole pulses, read at a steady rate and interpolated to samples.

    Attributes
    ----------
    inner : Process
        Noise of the rate, before counting. [x]
    jitter : Process
        Noise of the integral itself: vibration, which goes to and fro. Terms with an autocovariance, such as
        :class:`ShotNoise` or :class:`GaussMarkov`; their numbers are in [x*s].
    quantum : float
        A pulse: the step of the integral. [x*s]
    mean : float
        What the sensor feels, with bias; it makes the pulses come regularly. It is not part of the samples. [x]
    read_rate_hz : float
        Rate at which the counter is read. Samples between two readings lie on the line between them. [Hz]
    span : float
        Length of the record that the closed forms are for: how far inner noise takes the rate away from the mean and
        so spreads the pulses. :meth:`sample` does not use it. [s]

    Raises
    ------
    InputError
        If a number is not positive, the mean not finite, or a term of the jitter has no autocovariance.

    Notes
    -----
    A sample is ``(V(t) - V(t - dt)) / dt - mean``, V the counter interpolated. The phase of the counter is uniform at
    the start, and with the mean not zero at any time; then for a difference d of the integral, in pulses, that of the
    counter has the mean square

        E d^2 + 1/6 - sum over k of Re E exp(2 pi i k d) / (pi k)^2,

    and every Allan variance is a weighted sum of these over pairs of readings. Exact for jitter (Gaussian or shot
    noise), mean rate and white inner noise. Approximate for other inner noise: its own Allan variance is that of the
    continuous signal, and in the sum its integral counts as Gaussian with the variance ``tau^2 sum A(2^j tau) / 2``, A
    its Allan variance, over ``2^j tau`` up to half the span. Where pulses would lock to a mean of zero, nothing of this
    holds; :meth:`sample` does.

    References
    ----------
    Widrow and Kollar (2008), Quantization Noise, chapters 3 to 5 (moments of rounded values by the characteristic
    function); the rest by elementary steps.
    """

    inner: Process
    jitter: Process
    quantum: float
    mean: float
    read_rate_hz: float
    span: float = field(default=3600.0, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("quantum", "read_rate_hz", "span"):
            positive(getattr(self, name), name)
        if not (np.ndim(self.mean) == 0 and np.isfinite(self.mean)):
            raise InputError(f"mean: expected one finite number, got {self.mean!r}")
        for name in ("inner", "jitter"):
            if not isinstance(getattr(self, name), Process):
                raise InputError(
                    f"{name}: expected a noise process, NoiseModel() for none, got {getattr(self, name)!r}"
                )
        for term in terms_of(self.jitter):
            if not hasattr(term, "autocovariance"):
                raise InputError(
                    f"jitter: expected terms with an autocovariance, such as ShotNoise, got {type(term).__name__}; "
                    "noise of the rate belongs to inner"
                )

    def sample(self, n: Shape, dt: float, rng: np.random.Generator) -> FloatArray:
        """Draw, count, read, interpolate, difference; columns are independent. [x]"""
        shape, dt = shape_of(n), positive(dt, "dt")
        at = np.arange(shape[0] + 1) * (self.read_rate_hz * dt)
        before = np.floor(at + 1e-9).astype(np.int64)
        part = (at - before).reshape(-1, *[1] * len(shape[1:]))
        reads = (int(before[-1]) + 2, *shape[1:])
        a, b, c = rng.spawn(3)
        interval = 1.0 / self.read_rate_hz
        rate = self.inner.sample(reads, interval, a) + self.mean
        v = np.cumsum(rate, axis=0) * (interval / self.quantum) + self.jitter.sample(reads, interval, b) / self.quantum
        pulses = np.round(v + c.random(shape[1:]))
        V = pulses[before] + part * (pulses[before + 1] - pulses[before])
        return np.asarray(np.diff(V, axis=0) * (self.quantum / dt) - self.mean)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of samples at averaging times that are any whole number of any sampling interval. [x^2]"""
        tau = times(tau)
        flat = [float(self._allan(np.ones(1), float(t))[0]) for t in tau.ravel()]
        return np.array(flat).reshape(tau.shape)

    def discrete_allan_variance(self, m: ArrayLike, dt: float) -> FloatArray:
        """See the class. [x^2]"""
        m = counts(m)
        return self._allan(m.ravel(), positive(dt, "dt")).reshape(m.shape)

    def _allan(self, m: FloatArray, dt: float) -> FloatArray:
        lag, weight = second_differences(m.astype(np.int64), self.read_rate_hz * dt)
        own = weight @ self.mean_square(lag) * (self.quantum / (m * dt)) ** 2 / 2.0
        rest = _without_white(self.inner)
        return np.asarray(own + rest.allan_variance(m * dt))

    def mean_square(self, lag: IntArray) -> FloatArray:
        """Mean square of the counter's change over ``lag`` readings, without those of slow terms and mean. [pulse^2]"""
        t, q = array(lag) / self.read_rate_hz, self.quantum
        own = np.zeros_like(t)
        jitter = terms_of(self.jitter)
        for term in jitter:
            r = getattr(term, "autocovariance")  # noqa: B009 - checked above
            own += 2.0 * (r(np.zeros(1)) - r(t)) / q**2
        own += sum(term.N**2 for term in terms_of(self.inner) if isinstance(term, White)) * t / q**2
        # in pulses; a slow rate is as good as constant over the lag
        steady = own + self._slow(t) / q**2
        k_most = int(np.clip(2.5 / np.sqrt(max(float(steady[t > 0.0].min(initial=1.0)), 1e-6)), 8, _MOST_HARMONICS))
        k = np.arange(1.0, k_most + 1.0)[:, None]
        shots = [term for term in jitter if isinstance(term, ShotNoise)]
        normal = steady - sum(
            (2.0 * (term.sigma**2 - term.autocovariance(t)) / q**2 for term in shots), np.zeros_like(t)
        )
        log = -2.0 * (pi * k) ** 2 * np.maximum(normal, 0.0)
        for term in shots:
            log = log + term.log_characteristic(2.0 * pi * k / q, t)
        wave = np.cos(2.0 * pi * k * ((self.mean / q * t) % 1.0)) * np.exp(log) / (pi * k) ** 2
        return np.where(t > 0.0, own + 1.0 / 6.0 - wave.sum(axis=0), 0.0)

    def _slow(self, t: FloatArray) -> FloatArray:
        """Variance of the integral of the slow terms over times t, about the mean of the span. [(x s)^2]"""
        rest = _without_white(self.inner)
        total = np.zeros_like(t)
        if not rest.terms:
            return total
        tau = np.maximum(t, 0.5 / self.read_rate_hz)
        while (tau <= 0.5 * self.span).any():
            there = tau <= 0.5 * self.span
            total[there] += 0.5 * rest.allan_variance(tau[there])
            tau = 2.0 * tau
        return total * t**2

    def psd(self, f: ArrayLike) -> FloatArray:
        """Refused: there is no spectrum without a sampling interval.

        Raises
        ------
        InputError
            Always; use :meth:`discrete_psd`.
        """
        raise InputError("Counted has no spectrum without a sampling interval; use discrete_psd(f, dt)")

    def discrete_psd(self, f: ArrayLike, dt: float) -> FloatArray:
        """By Fourier transform of the autocovariance of the counter over 65536 samples. [x^2/Hz]

        Pulses that come regularly make lines; here they are as wide as that length allows.
        """
        f, dt = frequencies(f), positive(dt, "dt")
        lag, phases = _pairs(self.read_rate_hz * dt)
        unique = np.arange(int(lag.max()) + 2)
        square = self.mean_square(unique)
        white = sum(term.N**2 for term in terms_of(self.inner) if isinstance(term, White)) / self.quantum**2
        square = square - white * unique / self.read_rate_hz  # that grows without end; it is added below
        V = (square[lag] * phases).sum(axis=(1, 2, 3))
        window = 0.5 + 0.5 * np.cos(pi * np.arange(len(V)) / len(V))
        covariance = 0.5 * (V[len(V) // 2 :].mean() - V) * window
        S = np.fft.rfft(np.concatenate((covariance, covariance[:0:-1]))).real * dt
        grid = np.arange(len(S)) / (dt * (2 * len(V) - 1))
        folded = np.abs(f) % (1.0 / dt)
        folded = np.minimum(folded, 1.0 / dt - folded)
        own = np.interp(folded, grid, np.maximum(S, 0.0)) * (2.0 * np.sin(pi * f * dt) * self.quantum / dt) ** 2
        return np.asarray(own + self.inner.discrete_psd(f, dt))

    def state_space(self) -> StateSpace:
        """Refused: counting is not linear.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "a Counted process has no state space, counting is not linear; give a filter its inner noise and "
            f"Quantisation({self.quantum / np.sqrt(12.0):.3g}) instead"
        )

    def sampled(self, dt: float) -> SampledStateSpace:
        """Refused, as :meth:`state_space`.

        Raises
        ------
        InputError
            Always.
        """
        self.state_space()
        raise AssertionError  # not reached


def second_differences(m: IntArray, reads_per_sample: float) -> tuple[IntArray, FloatArray]:
    """Weights of the mean squares of the counter's changes in its mean squared second differences.

    Parameters
    ----------
    m : ndarray of int, shape (k,)
        Samples between the values.
    reads_per_sample : float
        Taken as a fraction; samples meet the readings in as many phases as its denominator, 64 at most.

    Returns
    -------
    lag : ndarray of int, shape (j,)
        Numbers of readings.
    weight : ndarray, shape (k, j)
        ``mean over phases E[(V(2m) - 2 V(m) + V(0))^2] = weight @ mean_square(lag)``.
    """
    i, w = zip(
        *(_reading(step * m[:, None], reads_per_sample, f) for step, f in ((0, 1), (1, -2), (2, 1))), strict=True
    )
    place = np.concatenate([np.broadcast_arrays(p, i[-1])[0] for p in i], axis=2)
    value = np.concatenate([np.broadcast_arrays(p, i[-1])[0] for p in w], axis=2)
    difference = np.abs(place[..., :, None] - place[..., None, :])
    product = -0.5 * value[..., :, None] * value[..., None, :] / place.shape[1]
    lag, inverse = np.unique(difference, return_inverse=True)
    weight = np.zeros((len(m), len(lag)))
    row = np.broadcast_to(np.arange(len(m))[:, None, None, None], difference.shape)
    np.add.at(weight, (row.ravel(), inverse.ravel()), product.ravel())
    return lag, weight


def _reading(m: IntArray, reads_per_sample: float, factor: float) -> tuple[IntArray, FloatArray]:
    """Readings before and after samples m in every phase, and their weights. Shapes (k, phases, 2)"""
    ratio = Fraction(reads_per_sample).limit_denominator(_MOST_PHASES)
    p, r = ratio.denominator, ratio.numerator
    number = r * (np.arange(p) + np.broadcast_to(m, (len(m), 1)))
    before, part = number // p, (number % p) / p
    return np.stack((before, before + 1), axis=-1), factor * np.stack((1.0 - part, part), axis=-1)


def _pairs(reads_per_sample: float) -> tuple[IntArray, FloatArray]:
    """Lags in readings between a sample and those after it, and weights of their mean squares."""
    k, u = _reading(np.arange(_LONGEST // 2)[:, None], reads_per_sample, 1.0)
    lag = np.abs(k[:, :, :, None] - k[:1, :, None, :])
    weight = u[:, :, :, None] * u[:1, :, None, :] / k.shape[1]
    return lag, weight


def _without_white(process: Process) -> NoiseModel:
    return NoiseModel(tuple(term for term in terms_of(process) if not isinstance(term, White)))
