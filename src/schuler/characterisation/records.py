"""Recordings at rest as signals: regular samples of an axis, their moments, the pooled Allan curve and its bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation import moments
from schuler.characterisation.allan import AllanCurve, allan_deviation
from schuler.characterisation.fitting import NoFitError
from schuler.characterisation.moments import Moments
from schuler.characterisation.outliers import without_outliers
from schuler.characterisation.result import Finding
from schuler.characterisation.spectrum import Line
from schuler.characterisation.variance import on_grid
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import (
    NoiseModel,
    Ramp,
)

_LEAST_OF_HALF = 1000  # samples


@dataclass(frozen=True)
class AxisSignal:
    """One axis of one recording.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Regular samples, NaN where one is missing. [rad/s] or [m/s^2]
    rate_hz : float
    replaced : int
        Outliers replaced.
    clustered : int
        Those of them next to another one.
    replaced_sigma : float
        Relative 1-sigma uncertainty of white noise by what the outliers leave unknown.
    temperature : ndarray, shape (n,), or None
        [degC]
    start_s : float
        Time of the first sample after the start of the recording. [s]
    """

    x: FloatArray
    rate_hz: float
    replaced: int
    temperature: FloatArray | None = None
    start_s: float = 0.0
    clustered: int = 0
    replaced_sigma: float = 0.0


def sampling_rate(imu: ImuSeries) -> float:
    """Sampling rate [Hz]: the median spacing is off by a part of the jitter where samples are missing, too."""
    if len(imu.t) < 2:
        return imu.rate_hz
    step = np.diff(imu.t)
    single = step[np.round(step * imu.rate_hz) == 1.0]
    rate_hz = 1.0 / float(single.mean())
    samples = float(np.round(step * rate_hz).sum())
    return samples / float(imu.t[-1] - imu.t[0])


def axis_signal(imu: ImuSeries, k: int, robust: bool) -> AxisSignal:
    """One axis of rates, on a regular grid."""
    rate_hz = sampling_rate(imu)
    x: FloatArray = np.ascontiguousarray((imu.gyro if k < 3 else imu.accel)[:, k % 3])
    temperature = imu.temperature
    if not np.all(np.abs(np.diff(imu.t) * rate_hz - 1.0) < 0.5):
        x = on_grid(imu.t, x, rate_hz)
        temperature = None if temperature is None else on_grid(imu.t, temperature, rate_hz)
    if not robust:
        return AxisSignal(x, rate_hz, 0, temperature)
    repair = without_outliers(x)
    beside = np.convolve(repair.outlier, [1, 0, 1], mode="same") > 0
    replaced, clustered = (int(np.count_nonzero(which)) for which in (repair.outlier, repair.outlier & beside))
    return AxisSignal(repair.x, rate_hz, replaced, temperature, clustered=clustered, replaced_sigma=repair.sigma)


def axis_findings(findings: list[Finding], signal: AxisSignal, number: int, of: int) -> list[Finding]:
    """Findings about one axis of one recording, with its number if there are several; outliers replaced are a note."""
    of_axis = []
    for f in findings:
        if signal.replaced and f.code == "too_short" and f.severity == "note":
            continue  # made of the outliers
        severity = "note" if signal.replaced and f.code == "outliers" else f.severity
        of_axis.append(replace(f, severity=severity, text=f.text if of == 1 else f"{f.text} (recording {number})"))
    return of_axis


def longest_run(signal: AxisSignal) -> AxisSignal:
    """The longest part without a pause that the tests for trends cannot bridge."""
    finite = np.flatnonzero(np.isfinite(signal.x))
    pause = np.flatnonzero(np.diff(finite) > max(1, len(signal.x) // 300))
    edges = np.concatenate(([-1], pause, [len(finite) - 1]))
    k = int(np.argmax(np.diff(edges)))
    part = slice(int(finite[edges[k] + 1]), int(finite[edges[k + 1]]) + 1)
    temperature = None if signal.temperature is None else signal.temperature[part]
    return replace(signal, x=signal.x[part], temperature=temperature, start_s=part.start / signal.rate_hz)


def mean_moments(signals: list[AxisSignal], lines: tuple[Line, ...]) -> Moments:
    """Allan variances at octaves without those of lines, averaged over recordings by their number of differences."""
    dt = 1.0 / signals[0].rate_hz
    longest = max(int(np.log2(len(s.x) / 4)) for s in signals)
    m = 2 ** np.arange(longest + 1)
    total, count = np.zeros(len(m)), np.zeros(len(m))
    for s in signals:
        curve = allan_deviation(s.x, s.rate_hz, taus="octave", noise=0.0)
        # gaps leave no difference at some averaging times
        place = np.searchsorted(m, np.round(curve.tau / dt).astype(np.int64))
        reached = place[(place < len(m)) & (np.round(curve.tau / dt) <= len(s.x) // 4)]
        total[reached] += (curve.count * curve.variance)[: len(reached)]
        count[reached] += curve.count[: len(reached)]
    m, total, count = m[count > 0], total[count > 0], count[count > 0]
    if not np.all(total > 0.0):
        raise NoFitError("the signal does not change at all")
    variance = total / count
    # a tenth stays: the power of a line is not known better, and a variance is positive
    noise = np.maximum(variance - sum((line.allan_variance(m, dt) for line in lines), np.zeros(len(m))), 0.1 * variance)
    return Moments(m, noise, dt, np.array([np.count_nonzero(np.isfinite(s.x)) for s in signals]))


def half_moments(signals: list[AxisSignal], lines: tuple[Line, ...]) -> tuple[Moments, Moments] | None:
    """Moments of the first and of the second half of every recording; None where they have too few samples."""
    if min(len(s.x) for s in signals) < 2 * _LEAST_OF_HALF:
        return None
    halves = [s.x[: len(s.x) // 2] for s in signals], [s.x[len(s.x) // 2 :] for s in signals]
    parts = [[replace(s, x=half) for s, half in zip(signals, of, strict=True)] for of in halves]
    try:
        return mean_moments(parts[0], lines), mean_moments(parts[1], lines)
    except (NoFitError, InputError):
        return None


def replaced_sigma(signals: list[AxisSignal]) -> float:
    """Relative 1-sigma uncertainty of white noise over all recordings by what outliers replaced leave unknown."""
    length = np.array([np.count_nonzero(np.isfinite(s.x)) for s in signals])
    each = np.array([s.replaced_sigma for s in signals])
    return float(np.sqrt(np.sum(np.square(length * each))) / max(length.sum(), 1))


def pooled_curve(signals: list[AxisSignal]) -> AllanCurve:
    """Curve of the longest recording, or of all of them where there are several."""
    curves = [allan_deviation(s.x, s.rate_hz, taus="log", noise=0.0) for s in signals]
    longest = max(curves, key=len)
    if len(curves) == 1:
        return longest
    total, count = np.zeros(len(longest)), np.zeros(len(longest), dtype=np.int64)
    for curve in curves:
        at = np.searchsorted(longest.tau, curve.tau * (1.0 - 1e-9))
        total[at] += curve.count * curve.variance
        count[at] += curve.count
    return replace(
        longest,
        deviation=np.sqrt(total / count),
        count=count,
        samples=sum(c.samples for c in curves),
        missing=sum(c.missing for c in curves),
    )


def with_bounds(curve: AllanCurve, data: Moments, model: NoiseModel) -> AllanCurve:
    """Curve with the bounds of an identified noise."""
    from scipy.stats import chi2

    wandering = NoiseModel(tuple(term for term in model.terms if not isinstance(term, Ramp)))

    def psd(f: FloatArray) -> FloatArray:
        return np.maximum(wandering.discrete_psd(f, data.dt), 1e-300)

    m = np.round(curve.tau / data.dt).astype(np.int64)
    edf = moments.degrees_of_freedom(m, data.lengths, data.dt, psd)
    tail = 0.5 * (1.0 - curve.confidence)
    f = 0.5 / curve.tau
    alpha = np.log(psd(1.1 * f) / psd(f / 1.1)) / np.log(1.21)
    return replace(
        curve,
        low=curve.deviation * np.sqrt(edf / chi2.ppf(1.0 - tail, edf)),
        high=curve.deviation * np.sqrt(edf / chi2.ppf(tail, edf)),
        edf=edf,
        alpha=alpha,
    )


def read_off(curve: AllanCurve) -> dict[str, float]:
    """Values read off the curve by eye, as far as it reaches: N at 1 s, the minimum, K at 3 s."""
    log_tau, log_dev = np.log(curve.tau), np.log(curve.deviation)
    lowest = int(np.argmin(curve.deviation))
    read = {"minimum": float(curve.deviation[lowest]), "minimum_tau_s": float(curve.tau[lowest])}
    for key, at in (("N_at_1s", 1.0), ("K_at_3s", 3.0)):
        if curve.tau[0] <= at <= curve.tau[-1]:
            read[key] = float(np.exp(np.interp(np.log(at), log_tau, log_dev)))
    return read


def shifted_by(f: Finding, by: float) -> Finding:
    """Finding about a part of a recording that begins ``by`` seconds after its start."""
    if by == 0.0:
        return f
    start, stop = (None if at is None else at + by for at in (f.start_s, f.stop_s))
    return replace(f, text=f"{f.text} (seconds from {by:.0f} s on, after a pause)", start_s=start, stop_s=stop)
