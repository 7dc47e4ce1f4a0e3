"""Noise by hand, as in the thesis: filter, standard deviation, 1/e of the autocorrelation, Allan deviation at 1 s.

The route most people take, here with what it costs: how far each number lies off, in the mean and in its scatter,
because the record is short beside the correlation time. A fit of the whole curve does better.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, log, pi, sin, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.correlation import (
    FiniteRecord,
    autocorrelation,
    finite_record,
    sigma_interval,
    tau_interval,
)
from schuler.characterisation.result import Estimate, Finding
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.sensors.noise import GaussMarkov, NoiseModel, White


@dataclass(frozen=True, repr=False)
class ManualNoise(Displayed):
    """Noise found by hand.

    Attributes
    ----------
    N : Estimate
        White noise, Allan deviation at 1 s. [x/sqrt(Hz)]
    sigma_b : Estimate
        Standard deviation of the filtered signal; its interval (90 %) is for the true one and may be open. [x]
    tau : Estimate
        Lag at which the autocorrelation of the filtered signal falls to 1/e; interval (90 %) for the true one. [s]
    tau_median : float
        The correlation time for which half of such records give a smaller and half a larger value; infinite if the
        record is too short to tell. [s]
    mean : Estimate
        Mean after the warm-up; its uncertainty is that of the wandering bias. [x]
    expected : FiniteRecord
        For a true correlation time as found.
    white_left : float
        Standard deviation of the white noise the filter leaves in ``sigma_b``. [x]
    cutoff_hz : float
    duration_s : float
        After the warm-up.
    unit : str
    findings : tuple of Finding
    """

    N: Estimate
    sigma_b: Estimate
    tau: Estimate
    tau_median: float
    mean: Estimate
    expected: FiniteRecord
    white_left: float
    cutoff_hz: float
    duration_s: float
    unit: str
    findings: tuple[Finding, ...] = ()

    @property
    def model(self) -> NoiseModel:
        """White noise and a Gauss-Markov bias with the numbers found."""
        return White(self.N.value) + GaussMarkov(self.sigma_b.value, self.tau.value)

    @property
    def K(self) -> float:
        """``sigma_b sqrt(2 / tau)``, the random walk the bias looks like well within tau. [x*sqrt(Hz)]

        Far better known than its parts where the record is short: a longer tau goes with a larger sigma.
        """
        return self.sigma_b.value * sqrt(2.0 / self.tau.value)

    def minimum(self) -> tuple[float, float]:
        """Averaging time [s] and Allan deviation [x] at the minimum of the model's curve; see :func:`allan_valley`."""
        return allan_valley(self.N.value, self.sigma_b.value, self.tau.value)

    def summary(self) -> str:
        """Every number with what it is worth, in sentences."""
        e, hours = self.expected, self.duration_s / 3600.0
        lines = [
            f"N = {self.N.value:.4g} {self.unit}/sqrt(Hz): Allan deviation at 1 s, 95 % within {self.N.low:.4g} and "
            f"{self.N.high:.4g}",
            f"sigma_b = {self.sigma_b.value:.4g} {self.unit}: of the signal below {self.cutoff_hz:g} Hz, white noise "
            f"making {self.white_left:.2g} of it; a record of {hours:.3g} h shows {sqrt(e.variance_ratio):.2f} of the "
            f"true one if tau is as found (90 % of records {e.sigma_ratio[0]:.2f} to {e.sigma_ratio[2]:.2f})",
            f"tau = {self.tau.value:.4g} s: 1/e of the autocorrelation; such records show {e.tau_ratio[1]:.2f} of the "
            f"true one in the median, 90 % {e.tau_ratio[0]:.2f} to {e.tau_ratio[2]:.2f}; the true one is "
            + (
                f"between {self.tau.low:.3g} and {self.tau.high:.3g} s (90 %), median {self.tau_median:.3g} s"
                if isfinite(self.tau.high)
                else f"above {self.tau.low:.3g} s (95 %), and this record is too short to bound it from above"
            ),
            f"c = {self.mean.value:.4g} {self.unit}: mean, at least +-{self.mean.sigma:.2g} (1 sigma), for the bias "
            "wanders",
            f"K = sigma_b sqrt(2/tau) = {self.K:.4g} {self.unit} sqrt(Hz) is better known than its parts",
        ]
        return "\n".join(lines + [f"{finding.severity}: {finding.text}" for finding in self.findings])


def identify_manually(
    x: ArrayLike,
    rate_hz: float,
    *,
    cutoff_hz: float = 0.01,
    order: int = 2,
    zero_phase: bool = True,
    warmup_s: float = 0.0,
    unit: str = "rad/s",
) -> ManualNoise:
    """Identify white noise and a Gauss-Markov bias by the manual route.

    Parameters
    ----------
    x : array_like, shape (n,)
        Rates or specific forces of one axis at rest, equally spaced. [x]
    rate_hz : float
        Sampling rate. [Hz]
    cutoff_hz : float
        Cut-off of the Butterworth low-pass filter: far above 1/(2 pi tau), to leave the bias alone, and so low that
        little white noise passes; the result holds how much did. [Hz]
    order : int
        Order of the filter.
    zero_phase : bool
        Filter forwards and backwards: no delay, the response is squared. False: once, causally, as a navigation
        computer would.
    warmup_s : float
        Left out at the start. [s]
    unit : str
        Unit of ``x``, for the sentences.

    Returns
    -------
    ManualNoise

    Raises
    ------
    InputError
        If ``x`` has gaps (NaN), the rate is below 1 Hz, or the record is shorter than ten times 1/cutoff after warm-up.

    Notes
    -----
    As the source: standard deviation of the filtered signal, first lag at which its autocorrelation is down to 1/e,
    Allan deviation of the raw signal at 1 s, mean after the warm-up. Departures: the 1/e lag is interpolated between
    samples, the filter's phase is chosen (the source does not say), and every number carries what it is worth.

    References
    ----------
    Flenniken (2005), sections 2.3 to 2.5, appendices A and D.
    """
    x = _after_warm_up(as_floats(x, "x", (None,)), rate_hz, cutoff_hz, warmup_s)
    duration = len(x) / rate_hz
    N = _at_one_second(x, rate_hz, unit)
    mean = float(x.mean())
    slow = low_passed(x - mean, rate_hz, cutoff_hz, order, zero_phase)
    stride = max(1, int(rate_hz / (50.0 * cutoff_hz)))  # the filtered signal holds nothing faster
    s = float(slow.std())
    if s == 0.0:
        raise InputError("x: expected a noisy signal, got one value throughout; the sensor is stuck or not connected")
    tau = correlation_time(slow[::stride], rate_hz / stride)
    expected = finite_record(duration, tau)
    left = N.value * sqrt(2.0 * _noise_bandwidth(cutoff_hz, order, zero_phase))
    low, median, high = tau_interval(tau, duration)
    sigma_b = Estimate(
        s, 0.304 * s * (expected.sigma_ratio[2] - expected.sigma_ratio[0]),
        *sigma_interval(s, low, high, duration), unit,
    )  # fmt: skip
    spread = 0.304 * tau * (expected.tau_ratio[2] - expected.tau_ratio[0])  # 90 % are 3.29 sigma
    error = s * expected.mean_sigma
    return ManualNoise(
        N, sigma_b, Estimate(tau, spread, low, high, "s"), median,
        Estimate(mean, error, mean - 1.96 * error, mean + 1.96 * error, unit), expected, left, cutoff_hz, duration,
        unit, tuple(_findings(s, left, tau, high, cutoff_hz, duration, unit)),
    )  # fmt: skip


def _after_warm_up(x: FloatArray, rate_hz: float, cutoff_hz: float, warmup_s: float) -> FloatArray:
    """Record without its warm-up, long enough for the filter."""
    if not (isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    if rate_hz < 1.0:
        raise InputError(f"rate_hz: expected 1 Hz or more, since N is read at 1 s of averaging; got {rate_hz!r}")
    if not (isfinite(cutoff_hz) and 0.0 < cutoff_hz < 0.5 * rate_hz):
        raise InputError(f"cutoff_hz: expected less than half the sampling rate of {rate_hz:g} Hz, got {cutoff_hz!r}")
    if not (isfinite(warmup_s) and warmup_s >= 0.0):
        raise InputError(f"warmup_s: expected seconds, not negative, got {warmup_s!r}")
    x = x[round(warmup_s * rate_hz) :]
    duration = len(x) / rate_hz
    if duration < (needed := max(10.0 / cutoff_hz, 10.0)):
        raise InputError(
            f"expected a record of at least {needed:g} s after the warm-up (ten times 1/cutoff_hz, and 10 s), got "
            f"{duration:g} s; record longer or raise cutoff_hz"
        )
    return x


def _findings(
    s: float, left: float, tau: float, high: float, cutoff_hz: float, duration: float, unit: str
) -> list[Finding]:
    """Findings on a bias buried in what is left of white noise, as fast as the filter, or slower than the record.

    ``s`` and ``left`` are 1-sigma of the filtered signal and of its white noise [x], ``high`` is the upper end of the
    interval of tau [s].
    """
    findings = []
    if s**2 < 2.0 * left**2:
        findings.append(
            Finding(
                "no_bias",
                f"of the filtered signal's {s:.3g} {unit} white noise alone makes {left:.3g}: no wandering bias is "
                "seen, sigma_b and tau describe the filter; lower cutoff_hz or record longer",
            )
        )
    elif tau < 5.0 / (2.0 * pi * cutoff_hz):
        findings.append(
            Finding(
                "filter",
                f"tau = {tau:.3g} s is hardly beyond the filter's own {0.5 / (pi * cutoff_hz):.3g} s: "
                "the bias is fast or no single Gauss-Markov process; raise cutoff_hz, and if tau follows, fit the "
                "whole curve",
            )
        )
    if not isfinite(high):
        findings.append(
            Finding(
                "too_short",
                f"{duration:.4g} s are too short for tau: a bias that never settles looks the same; record at least "
                f"{20.0 * tau:.2g} s",
            )
        )
    return findings


def low_passed(x: ArrayLike, rate_hz: float, cutoff_hz: float, order: int = 2, zero_phase: bool = True) -> FloatArray:
    """Butterworth low-pass filter, without a transient at the start.

    Parameters
    ----------
    x : array_like, shape (n,)
    rate_hz, cutoff_hz : float
        [Hz]
    order : int
        1 to 10.
    zero_phase : bool
        Forwards and backwards, or once and causally.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    InputError
        If ``x`` has gaps, the cut-off is not below half the rate, or the order is none.
    """
    from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

    x = as_floats(x, "x", (None,))
    for name, value in (("rate_hz", rate_hz), ("cutoff_hz", cutoff_hz)):
        if not (isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive number, got {value!r}")
    if not cutoff_hz < 0.5 * rate_hz:
        raise InputError(f"cutoff_hz: expected less than half the sampling rate of {rate_hz:g} Hz, got {cutoff_hz!r}")
    if not (isinstance(order, int) and 1 <= order <= 10):
        raise InputError(f"order: expected a whole number from 1 to 10, got {order!r}")
    sos = butter(order, cutoff_hz, fs=rate_hz, output="sos")
    if zero_phase:
        return np.asarray(sosfiltfilt(sos, x, padlen=min(len(x) - 1, int(rate_hz / cutoff_hz))))
    filtered, _ = sosfilt(sos, x, zi=sosfilt_zi(sos) * x[0])
    return np.asarray(filtered)


def correlation_time(x: ArrayLike, rate_hz: float) -> float:
    """First lag at which the autocorrelation is down to 1/e, between samples; see :func:`autocorrelation`. [s]"""
    x = as_floats(x, "x", (None,))
    solution = autocorrelation(x, rate_hz, longest_s=(len(x) - 1) / rate_hz).crossing()
    assert solution is not None  # without their mean the lags of a record sum to minus half the variance
    return solution


def allan_valley(N: float, sigma_b: float, tau: float) -> tuple[float, float]:
    """Minimum of the Allan deviation of white noise with a Gauss-Markov bias, left of the bias's hump.

    Parameters
    ----------
    N, sigma_b, tau : float
        [x/sqrt(Hz)], [x], [s]

    Returns
    -------
    (float, float)
        Averaging time [s], near ``sqrt(3) N / K`` with ``K = sigma_b sqrt(2 / tau)`` if that is far below tau, and
        deviation [x].

    Raises
    ------
    InputError
        If the white noise covers the bias, so that the curve has no minimum.
    """
    from scipy.optimize import minimize_scalar

    model = White(N) + GaussMarkov(sigma_b, tau)
    top = 1.893 * tau
    solution = minimize_scalar(
        lambda u: float(np.log(model.allan_variance(exp(u)))), bounds=(log(1e-9 * tau), log(top)), method="bounded",
        options={"xatol": 1e-7},
    )  # fmt: skip
    at = exp(float(solution.x))
    if at > 0.999 * top:
        raise InputError(f"the white noise N = {N:g} covers the bias of {sigma_b:g} with tau = {tau:g} s: no minimum")
    return at, sqrt(float(model.allan_variance(at)))


def _at_one_second(x: FloatArray, rate: float, unit: str) -> Estimate:
    """Overlapping Allan deviation at 1 s, with the uncertainty it has for white noise."""
    curve = allan_deviation(x, rate, taus=[1.0], noise=0.0)
    # at a whole number of samples, brought to 1 s by the slope of white noise where the rate is none
    N, low, high = (float(v[0]) * sqrt(float(curve.tau[0])) for v in (curve.deviation, curve.low, curve.high))
    return Estimate(N, 0.5 * N * float(curve.relative_sigma[0]), low, high, f"{unit}/sqrt(Hz)")


def _noise_bandwidth(cutoff: float, order: int, zero_phase: bool) -> float:
    """One-sided bandwidth of the ideal filter that passes as much white noise as the Butterworth filter does. [Hz]"""
    half = pi / (2.0 * order)
    return cutoff * half / sin(half) * ((1.0 - 0.5 / order) if zero_phase else 1.0)
