"""Autoregressive models of a slow bias, and whether they predict it better than a Gauss-Markov process does."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.manual import correlation_time, low_passed
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged, Displayed


@dataclass(frozen=True, repr=False)
class Autoregression(Abridged):
    """AR(p) model ``x_k = a_1 x_(k-1) + ... + a_p x_(k-p) + e_k`` of a signal without its mean.

    Attributes
    ----------
    coefficients : ndarray, shape (p,)
        a_1 ... a_p.
    variance : float
        Variance of e. [x^2]
    aic, bic : float
        Akaike's and Schwarz's criterion, per model of the same data; smaller is better.
    """

    coefficients: FloatArray
    variance: float
    aic: float
    bic: float

    @property
    def order(self) -> int:
        """Number of past values, p."""
        return len(self.coefficients)

    def predict(self, x: ArrayLike, steps: int = 1) -> FloatArray:
        """Predictions a number of steps ahead.

        Parameters
        ----------
        x : array_like, shape (n,)
            Signal without its mean. [x]
        steps : int

        Returns
        -------
        ndarray, shape (n - p - steps + 1,)
            Element k predicts ``x[p + steps - 1 + k]`` from ``x[k : k + p]``. [x]
        """
        x = as_floats(x, "x", (None,))
        if not (isinstance(steps, int) and steps >= 1):
            raise InputError(f"steps: expected a whole number of 1 or more, got {steps!r}")
        # the weights of the last p values after so many steps: the companion matrix to that power
        weights = np.zeros((steps + 1, self.order))
        weights[0, 0] = 1.0  # of x_k itself, before any step
        for j in range(1, steps + 1):
            weights[j] = weights[j - 1, 0] * self.coefficients
            weights[j, :-1] += weights[j - 1, 1:]
        return np.convolve(x, weights[steps], mode="valid")[: len(x) - self.order - steps + 1]


def fit_ar(x: ArrayLike, max_order: int = 20, criterion: Literal["aic", "bic"] = "bic") -> Autoregression:
    """Fit autoregressive models by Burg's method and choose the order.

    Parameters
    ----------
    x : array_like, shape (n,)
        Equally spaced; its mean is removed. [x]
    max_order : int
        Orders 1 to this one are tried.
    criterion : {"aic", "bic"}

    Returns
    -------
    Autoregression
        Always stable: all reflection coefficients are below 1.

    Raises
    ------
    InputError
        If there are fewer than ten samples for each order, gaps, or nothing varies.

    Notes
    -----
    Burg minimises forward and backward prediction errors together, order by order; AR(1) of it is the exact discrete
    Gauss-Markov process with ``a_1 = exp(-dt/tau)``.

    References
    ----------
    Hayal (2010), section 2.4.3; Burg (1975); Kay and Marple, Proc. IEEE 69 (1981).
    """
    signal = as_floats(x, "x", (None,))
    if criterion not in ("aic", "bic"):
        raise InputError(f"criterion: expected 'aic' or 'bic', got {criterion!r}")
    if not (isinstance(max_order, int) and max_order >= 1 and len(signal) >= 10 * max_order):
        raise InputError(f"max_order: expected 1 to {len(signal) // 10} for {len(signal)} samples, got {max_order!r}")
    signal = np.asarray(signal - signal.mean())
    n, power = len(signal), float(np.mean(signal**2))
    variance = power
    if variance == 0.0:
        raise InputError("x: expected a signal that varies, got one value throughout")
    forward, backward = signal[1:], signal[:-1]
    a = np.zeros(0)
    best: Autoregression | None = None
    for order in range(1, max_order + 1):
        k = 2.0 * float(forward @ backward) / float(forward @ forward + backward @ backward)
        a = np.concatenate((a - k * a[::-1], [k]))
        variance *= 1.0 - k * k
        forward, backward = (forward - k * backward)[1:], (backward - k * forward)[:-1]
        fit = n * log(max(variance, 1e-300))
        model = Autoregression(a, variance, fit + 2.0 * order, fit + order * log(n))
        if best is None or getattr(model, criterion) < getattr(best, criterion):
            best = model
        if variance < 1e-14 * power:
            break  # predicted to rounding; more orders fit rounding
    assert best is not None
    return best


@dataclass(frozen=True, repr=False)
class Prediction(Displayed):
    """AR model against Gauss-Markov process on data neither has seen.

    Attributes
    ----------
    ar : Autoregression
    sigma, tau : float
        The Gauss-Markov process: standard deviation [x] and correlation time [s].
    horizon_s : ndarray, shape (k,)
        How far ahead. [s]
    ar_rms, gm_rms, held_rms : ndarray, shape (k,)
        Root mean square prediction errors of AR, Gauss-Markov, and of holding the last value. [x]
    """

    ar: Autoregression
    sigma: float
    tau: float
    horizon_s: FloatArray
    ar_rms: FloatArray
    gm_rms: FloatArray
    held_rms: FloatArray

    @property
    def gain(self) -> FloatArray:
        """Share by which the AR model's errors are smaller than the Gauss-Markov process's, per horizon."""
        return np.asarray(1.0 - self.ar_rms / self.gm_rms)

    def summary(self) -> str:
        """One line for each horizon."""
        lines = [f"AR({self.ar.order}) against Gauss-Markov with tau = {self.tau:.4g} s, second half of the record:"]
        lines += [
            f"  {h:.4g} s ahead: {a:.3g} and {g:.3g} (holding: {b:.3g}), AR {100.0 * gain:+.0f} %"
            for h, a, g, b, gain in zip(self.horizon_s, self.ar_rms, self.gm_rms, self.held_rms, self.gain, strict=True)
        ]
        return "\n".join(lines)


def compare_predictions(
    x: ArrayLike,
    rate_hz: float,
    *,
    cutoff_hz: float = 0.01,
    oversampling: float = 5.0,
    max_order: int = 20,
    horizons_s: tuple[float, ...] | None = None,
) -> Prediction:
    """Fit both models to the low-passed first half of a log and let them predict the second half.

    Parameters
    ----------
    x : array_like, shape (n,)
        Log at rest. [x]
    rate_hz : float
        [Hz]
    cutoff_hz : float
        Cut-off of the causal second-order Butterworth filter that makes the bias visible. [Hz]
    oversampling : float
        Rate of the filtered series that is modelled, over ``2 cutoff_hz``.
    max_order : int
        Largest order of the AR model, which BIC chooses.
    horizons_s : tuple of float, optional
        How far ahead; default one step, 1/cutoff and ten times that. [s]

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        If the record is too short for the order or a horizon.

    Notes
    -----
    The filter is causal, else predictions would use the future. The Gauss-Markov process has the 1/e correlation time
    of the filtered series, as by hand (:mod:`schuler.characterisation.manual`).

    The literature that Hayal quotes finds AR models better by some 30 % and more. Measured here
    (tests/characterisation/test_autoregression.py), for a Gauss-Markov bias plus white noise: 40 % better one step
    ahead, 3 % at one filter period, nothing at ten. The first step is a tenth of the filter's own memory; what the AR
    model predicts better is the filter. For a real gyroscope (ADIS16405 y, 2.8 h): 20 % better, then 7 % and 16 %
    worse. A bias that oscillates, with a heater or a servo loop, is another matter: no Gauss-Markov process predicts
    that, an AR model does.

    References
    ----------
    Hayal (2010), section 2.4.3.
    """
    x = as_floats(x, "x", (None,))
    for name, value in (("rate_hz", rate_hz), ("cutoff_hz", cutoff_hz), ("oversampling", oversampling)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive number, got {value!r}")
    stride = max(1, round(rate_hz / (2.0 * oversampling * cutoff_hz)))
    dt = stride / rate_hz
    settled = round(1.0 / cutoff_hz * rate_hz)  # the filter's start
    slow = low_passed(x - x.mean(), rate_hz, cutoff_hz, zero_phase=False)[settled::stride]
    half = len(slow) // 2
    if half < 10 * max_order:
        raise InputError(
            f"x: expected {20 * max_order * dt + 1.0 / cutoff_hz:g} s or more for orders up to {max_order}, got "
            f"{len(x) / rate_hz:g} s; record longer, lower max_order or raise cutoff_hz"
        )
    horizons = (dt, 1.0 / cutoff_hz, 10.0 / cutoff_hz) if horizons_s is None else horizons_s
    steps = [max(1, round(h / dt)) for h in horizons]
    if max(steps) > half // 4:
        raise InputError(f"horizons_s: expected at most an eighth of the record, got {max(horizons):g} s")
    level = slow[:half].mean()
    train, test = slow[:half] - level, slow[half:] - level
    ar = fit_ar(train, max_order)
    tau = correlation_time(train, 1.0 / dt)
    errors = []
    for k in steps:
        # all three are judged on the same samples
        first = max(ar.order - 1, 0)
        last, truth = test[first : len(test) - k], test[first + k :]
        predicted = (ar.predict(test, k), exp(-k * dt / tau) * last, last)
        errors.append([sqrt(float(np.mean((p - truth) ** 2))) for p in predicted])
    rms = np.array(errors)
    return Prediction(ar, float(train.std()), tau, np.array(steps) * dt, rms[:, 0], rms[:, 1], rms[:, 2])
