"""Is this the noise of that log? The model simulated often, and the log's Allan curve and autocorrelation among it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.characterisation.result import AxisNoise
from schuler.characterisation.variance import allan_variances, integrate_signal
from schuler.exceptions import InputError
from schuler.sensors.noise import Process

#: Fewest realisations: with 39 the smallest and largest bound 95 % of what the model does.
FEWEST = 39


@dataclass(frozen=True)
class Comparison:
    """A measured curve among simulated ones.

    Attributes
    ----------
    at : ndarray, shape (k,)
        Averaging times, or lags. [s]
    measured, median : ndarray, shape (k,)
        Curve of the log, and the median of the realisations.
    low, high : ndarray, shape (k,)
        Between which a realisation lies with 95 %, point by point.
    share : float
        Share of the points at which the measured curve lies within; 0.95 is expected.
    p : float
        Share of all curves, the measured one among them, that stray from the others at least as far at their worst
        point: uniform if the model is right, small if the log is odd. Never below 1 / (runs + 1).
    worst : int
        Index of the point at which the measured curve strays furthest, in standard deviations.
    """

    at: FloatArray
    measured: FloatArray
    median: FloatArray
    low: FloatArray
    high: FloatArray
    share: float
    p: float
    worst: int


@dataclass(frozen=True)
class Overlay:
    """A log and its noise model, laid over each other.

    Attributes
    ----------
    allan : Comparison
        Overlapping Allan deviations. [x]
    correlation : Comparison
        Autocorrelation coefficients of means over ``average_s``. [-]
    runs : int
    average_s : float
    """

    allan: Comparison
    correlation: Comparison
    runs: int
    average_s: float

    @property
    def agrees(self) -> bool:
        """Whether the log could be a realisation of the model; a right model is rejected in 5 % of cases."""
        return min(self.allan.p, self.correlation.p) > 0.025

    def summary(self) -> str:
        """Verdict in sentences."""
        a, c = self.allan, self.correlation
        ratio = a.measured[a.worst] / a.median[a.worst]
        return "\n".join(
            [
                f"the model {'reproduces' if self.agrees else 'does not reproduce'} the log ({self.runs} realisations)",
                f"Allan deviation: {100.0 * a.share:.0f} % of {len(a.at)} averaging times inside the 95 % band, p = "
                f"{a.p:.3f}; furthest at {a.at[a.worst]:.3g} s, {ratio:.3g} times the simulated median",
                f"autocorrelation of {self.average_s:.3g} s means: {100.0 * c.share:.0f} % of {len(c.at)} lags inside, "
                f"p = {c.p:.3f}; furthest at {c.at[c.worst]:.3g} s, {c.measured[c.worst]:.2f} instead of "
                f"{c.median[c.worst]:.2f}",
            ]
        )


def overlay(
    model: AxisNoise | Process,
    x: ArrayLike,
    rate_hz: float,
    rng: np.random.Generator,
    runs: int = FEWEST,
    points: int = 24,
) -> Overlay:
    """Lay a noise model over the log it is said to describe.

    Parameters
    ----------
    model : AxisNoise or Process
        An identified axis, or any noise model.
    x : array_like, shape (n,)
        The log at rest, equally spaced. [x]
    rate_hz : float
        [Hz]
    rng : numpy.random.Generator
    runs : int
        Realisations as long as the log, 39 or more.
    points : int
        Averaging times, spaced logarithmically from one sample to a quarter of the log.

    Returns
    -------
    Overlay

    Raises
    ------
    InputError
        If the log has gaps or fewer than 200 samples, or numbers are impossible.

    Notes
    -----
    The source compares log and simulation by eye, one realisation. One realisation scatters as much as the log does; at
    long averaging times by tens of percent. Here the log is one curve among ``runs + 1``, which are interchangeable if
    the model is right; so the rank of its largest deviation from the others is a test without any assumption.

    References
    ----------
    Flenniken (2005), figures 2.6 to 2.12.
    """
    x = as_floats(x, "x", (None,))
    process = model.model if isinstance(model, AxisNoise) else model
    if not isinstance(process, Process):
        raise InputError(f"model: expected an AxisNoise or a noise model, got {type(model).__name__}")
    if len(x) < 200:
        raise InputError(f"x: expected 200 samples or more, got {len(x)}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    if runs < FEWEST:
        raise InputError(f"runs: expected {FEWEST} or more, fewer cannot bound 95 %, got {runs}")
    if x.std() == 0.0:
        raise InputError("x: expected a noisy signal, got one value throughout; the sensor is stuck or not connected")
    n, dt = len(x), 1.0 / rate_hz
    ms = np.unique(np.geomspace(1, n // 4, points).astype(np.int64))
    block = max(1, n // 500)
    lags = np.unique(np.geomspace(1, n // block // 4, points).astype(np.int64))
    deviations, correlations = [_deviations(x, dt, ms)], [_correlations(x, block, lags)]
    for child in rng.spawn(runs):  # as many as asked for leave the first ones as they were
        y = process.sample(n, dt, child)
        if y.std() == 0.0:
            raise InputError("model: expected noise, got one without any; give it at least one term")
        deviations.append(_deviations(y, dt, ms))
        correlations.append(_correlations(y, block, lags))
    return Overlay(
        _compared(as_floats(ms * dt, "tau"), np.array(deviations), logarithmic=True),
        _compared(as_floats(lags * block * dt, "lag"), np.array(correlations), logarithmic=False),
        runs,
        block * dt,
    )


def _compared(at: FloatArray, curves: FloatArray, logarithmic: bool) -> Comparison:
    """The first of the curves among the others."""
    simulated, measured = np.sort(curves[1:], axis=0), curves[0]
    k = max(1, round(0.025 * len(curves)))  # one in forty below, one above
    low, high = simulated[k - 1], simulated[-k]
    strays = _strays(np.log(curves) if logarithmic else curves)
    furthest = strays.max(axis=1)
    inside = (measured >= low) & (measured <= high)
    return Comparison(
        at, measured, np.median(simulated, axis=0), low, high, float(inside.mean()),
        float(np.mean(furthest >= furthest[0])), int(np.argmax(strays[0])),
    )  # fmt: skip


def _strays(curves: FloatArray) -> FloatArray:
    """Distance of each curve from the mean of the others, in their standard deviations, point by point."""
    n = len(curves)
    total, square = curves.sum(axis=0), (curves**2).sum(axis=0)
    mean = (total - curves) / (n - 1)
    variance = (square - curves**2) / (n - 1) - mean**2
    return np.asarray(np.abs(curves - mean) / np.sqrt(np.maximum(variance, 1e-300)))


def _deviations(x: FloatArray, dt: float, ms: IntArray) -> FloatArray:
    """Overlapping Allan deviations at averaging times of ms samples."""
    variance, _ = allan_variances(integrate_signal(x, "rate", dt), "overlapping", ms)
    return np.asarray(np.sqrt(variance))


def _correlations(x: FloatArray, block: int, lags: IntArray) -> FloatArray:
    """Autocorrelation coefficients of block means, biased estimator, mean removed."""
    means = x[: len(x) // block * block].reshape(-1, block).mean(axis=1)
    means = means - means.mean()
    power = float(means @ means)
    return np.array([means[lag:] @ means[:-lag] for lag in lags]) / power
