"""From a log at rest to a noise model: every axis, with uncertainty, and one budget for the IMU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation import moments
from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.counted_model import counted_model
from schuler.characterisation.counting import Lattice, counted, pulse_lattice
from schuler.characterisation.curve import AllanCurve
from schuler.characterisation.findings import Finding
from schuler.characterisation.fitting import Fit, Moments, NoFitError
from schuler.characterisation.grid import on_grid
from schuler.characterisation.health import FEWEST, check_static_imu
from schuler.characterisation.identify_findings import fit_findings, line_findings
from schuler.characterisation.lines import CleanSpectrum, Line, clean_spectrum
from schuler.characterisation.outliers import without_outliers
from schuler.characterisation.result import AXES, AxisNoise, Estimate, NoiseIdentification
from schuler.characterisation.selection import select
from schuler.characterisation.shifts import level_shifts
from schuler.characterisation.simulation_model import simulation_model
from schuler.characterisation.trends import mean_with_sigma, temperature_trend, warm_up
from schuler.characterisation.triad_budget import triad_budget
from schuler.exceptions import InputError
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import (
    Counted,
    NoiseModel,
    Ramp,
    Sinusoid,
)

Method = Literal["gmwm", "allan"]
Progress = Callable[[float], None]

_UNITS = {"Q": "{}*s", "N": "({})/sqrt(Hz)", "B": "{}", "K": "({})*sqrt(Hz)", "R": "({})/s"}
_LEAST = 1000  # samples below which nothing is identified


@dataclass(frozen=True)
class _Signal:
    """One axis of one recording."""

    x: FloatArray
    rate_hz: float
    replaced: int
    temperature: FloatArray | None = None
    start_s: float = 0.0


def identify_noise(
    recordings: Recording | ImuSeries | Sequence[Recording | ImuSeries],
    *,
    method: Method = "gmwm",
    robust: bool = False,
    models: tuple[str, ...] | None = None,
    progress: Progress | None = None,
    name: str = "",
) -> NoiseIdentification:
    """Identify the noise of every axis of an IMU from one or several recordings at rest.

    Parameters
    ----------
    recordings : Recording, ImuSeries, or a sequence of them
        Several are recordings of one unit: their Allan variances are averaged by length. Gaps are kept as gaps.
    method : {"gmwm", "allan"}
        Weights of the fit to the Allan variances at octaves: the inverse of their whole covariance (generalised method
        of wavelet moments), or of its diagonal only (a weighted fit to the Allan curve).
    robust : bool
        Replace outliers before (:func:`.outliers.without_outliers`).
    models : tuple of str, optional
        Models to choose from, such as ``("N+B+K", "N+GM")``; None: see :mod:`.selection`.
    progress : callable, optional
        Called with the fraction done.
    name : str
        Of the result.

    Returns
    -------
    NoiseIdentification

    Raises
    ------
    InputError
        If there is no IMU, sampling rates differ, or an option is unknown. An axis that cannot be identified is no
        error: it stands in ``refused`` with its findings.

    Notes
    -----
    The bounds of the curve shown are recomputed for the model found. The budget is fitted to the mean Allan variance of
    a triad's axes, with at most one Gauss-Markov term; its turn-on bias is the size of the mean that the log shows,
    which for gyroscopes includes Earth rate and for accelerometers is the departure of the mean from 9.80665 m/s^2.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), J. Am. Stat. Assoc. 108(503); IEEE Std 952, annex C;
    Flenniken (2005), chapter 2, whose manual route is :mod:`.manual`.
    """
    if method not in ("gmwm", "allan"):
        raise InputError(f"method: expected 'gmwm' or 'allan', got {method!r}")
    several = [recordings] if isinstance(recordings, (Recording, ImuSeries)) else list(recordings)
    if not several:
        raise InputError("recordings: expected at least one, got none")
    imus = [(r.need_imu() if isinstance(r, Recording) else r) for r in several]
    rates = np.array([_rate(imu) for imu in imus])
    if np.ptp(rates) > 1e-3 * rates[0]:
        raise InputError(f"recordings: expected one sampling rate, got {', '.join(f'{r:.4g}' for r in rates)} Hz")
    checks = [check_static_imu(imu) for imu in imus]
    imus = [imu.rates() for imu in imus]
    findings = tuple(f for check in checks for f in check["recording"])
    found: dict[str, AxisNoise] = {}
    refused: dict[str, tuple[Finding, ...]] = {}
    data: dict[str, Moments] = {}
    for k, axis in enumerate(AXES):
        signals = [_signal(imu, k, robust) for imu in imus]
        seen = tuple(f for i, check in enumerate(checks) for f in _seen(check[axis], signals[i], i + 1, len(imus)))
        fatal = tuple(f for f in seen if f.severity == "refused")
        if not fatal and min(len(s.x) for s in signals) < _LEAST:
            text = (
                f"{axis}: {min(len(s.x) for s in signals)} samples are too few to identify noise; {_LEAST} are needed"
            )
            fatal = (Finding("too_short", text, severity="refused"),)
        if not fatal:
            try:
                longest = max(signals, key=lambda s: len(s.x))
                clean = clean_spectrum(longest.x, longest.rate_hz)
                data[axis] = _moments(signals, () if clean is None else clean.lines)
                found[axis] = _identified(axis, signals, data[axis], clean, seen, method, models)
            except NoFitError as error:
                data.pop(axis, None)
                fatal = (Finding("no_fit", f"{axis}: {error}", severity="refused"),)
        if fatal:
            refused[axis] = (*fatal, *(f for f in seen if f not in fatal))
        if progress is not None:
            progress((k + 1) / (len(AXES) + 1))
    title = name or (several[0].metadata.name if isinstance(several[0], Recording) else "IMU")
    spec, spec_sigma = triad_budget(title, found, data, float(rates[0]), method)
    if progress is not None:
        progress(1.0)
    notes = tuple(n for r in several if isinstance(r, Recording) for n in r.metadata.notes)
    if spec is not None:
        notes += (
            "The budget's turn-on bias is the mean of this log: Earth rate is in the gyroscopes', and only what the "
            "norm of the specific force shows in the accelerometers'.",
        )
    spoiled = [name for name, axis in found.items() if any(f.severity == "warning" for f in axis.findings)]
    if spec is not None and spoiled:
        notes += (f"The budget is made of all axes, also of those with warnings: {', '.join(spoiled)}.",)
    provenance: dict[str, Any] = {
        "schuler": metadata.version("schuler"),
        "method": method,
        "robust": robust,
        "models": "default" if models is None else list(models),
        "sources": {k: v for r in several if isinstance(r, Recording) for k, v in r.metadata.sources.items()},
        "recordings": [r.metadata.name for r in several if isinstance(r, Recording)],
        "recording_options": [r.metadata.options for r in several if isinstance(r, Recording)],
    }
    return NoiseIdentification(title, found, refused, spec, spec_sigma, findings, notes, provenance)


def _rate(imu: ImuSeries) -> float:
    """Sampling rate [Hz]: the median spacing is off by a part of the jitter where samples are missing, too."""
    if len(imu.t) < 2:
        return imu.rate_hz
    step = np.diff(imu.t)
    single = step[np.round(step * imu.rate_hz) == 1.0]
    rate_hz = 1.0 / float(single.mean())
    samples = float(np.round(step * rate_hz).sum())
    return samples / float(imu.t[-1] - imu.t[0])


def _signal(imu: ImuSeries, k: int, robust: bool) -> _Signal:
    """One axis of rates, on a regular grid."""
    rate_hz = _rate(imu)
    x: FloatArray = np.ascontiguousarray((imu.gyro if k < 3 else imu.accel)[:, k % 3])
    temperature = imu.temperature
    if not np.all(np.abs(np.diff(imu.t) * rate_hz - 1.0) < 0.5):
        x = on_grid(imu.t, x, rate_hz)
        temperature = None if temperature is None else on_grid(imu.t, temperature, rate_hz)
    replaced = 0
    if robust:
        x, outlier = without_outliers(x)
        replaced = int(outlier.sum())
    return _Signal(x, rate_hz, replaced, temperature)


def _seen(findings: list[Finding], signal: _Signal, number: int, of: int) -> list[Finding]:
    """Findings about one axis of one recording, with its number if there are several; outliers replaced are a note."""
    seen = []
    for f in findings:
        if signal.replaced and f.code == "too_short" and f.severity == "note":
            continue  # made of the outliers
        severity = "note" if signal.replaced and f.code == "outliers" else f.severity
        seen.append(replace(f, severity=severity, text=f.text if of == 1 else f"{f.text} (recording {number})"))
    return seen


def _unbroken(signal: _Signal) -> _Signal:
    """The longest part without a pause that the tests for trends cannot bridge."""
    there = np.flatnonzero(np.isfinite(signal.x))
    pause = np.flatnonzero(np.diff(there) > max(1, len(signal.x) // 300))
    edges = np.concatenate(([-1], pause, [len(there) - 1]))
    k = int(np.argmax(np.diff(edges)))
    part = slice(int(there[edges[k] + 1]), int(there[edges[k + 1]]) + 1)
    temperature = None if signal.temperature is None else signal.temperature[part]
    return replace(signal, x=signal.x[part], temperature=temperature, start_s=part.start / signal.rate_hz)


def _moments(signals: list[_Signal], lines: tuple[Line, ...]) -> Moments:
    """Allan variances at octaves without those of lines, averaged over recordings by their number of differences."""
    dt = 1.0 / signals[0].rate_hz
    longest = max(int(np.log2(len(s.x) / 4)) for s in signals)
    m = 2 ** np.arange(longest + 1)
    total, count = np.zeros(len(m)), np.zeros(len(m))
    for s in signals:
        curve = allan_deviation(s.x, s.rate_hz, taus="octave", noise=0.0)
        # gaps leave no difference at some averaging times
        place = np.searchsorted(m, np.round(curve.tau / dt).astype(np.int64))
        there = place[(place < len(m)) & (np.round(curve.tau / dt) <= len(s.x) // 4)]
        total[there] += (curve.count * curve.variance)[: len(there)]
        count[there] += curve.count[: len(there)]
    m, total, count = m[count > 0], total[count > 0], count[count > 0]
    if not np.all(total > 0.0):
        raise NoFitError("the signal does not change at all")
    variance = total / count
    # a tenth stays: the power of a line is not known better, and a variance is positive
    noise = np.maximum(variance - sum((line.allan_variance(m, dt) for line in lines), np.zeros(len(m))), 0.1 * variance)
    return Moments(m, noise, dt, np.array([np.count_nonzero(np.isfinite(s.x)) for s in signals]))


def _identified(
    axis: str,
    signals: list[_Signal],
    data: Moments,
    clean: CleanSpectrum | None,
    findings: tuple[Finding, ...],
    method: Method,
    models: tuple[str, ...] | None,
) -> AxisNoise:
    chosen = select(data, models, "full" if method == "gmwm" else "diagonal")
    fit = chosen.fit
    lines = () if clean is None else clean.lines
    pooled = _pooled_curve(signals)
    pulses = _pulses(signals, pooled, data.dt, findings)
    if pulses is None:
        model = simulation_model(chosen, clean, pooled, data.dt)
        model = NoiseModel((*model.terms, *(Sinusoid(line.amplitude, line.frequency) for line in lines)))
    else:
        model = NoiseModel((pulses,))  # what looks like lines is the pulses
    unit = "rad/s" if axis.startswith("gyro") else "m/s^2"
    main = max(signals, key=lambda s: len(s.x))
    duration = float(data.lengths.sum() * data.dt)
    curve = _with_bounds(pooled, data, model)
    estimates = _estimates(fit, unit)
    steady = _unbroken(main)
    if len(steady.x) < FEWEST:
        raise NoFitError(f"the longest part without a pause has {len(steady.x)} samples, {FEWEST} are needed")
    try:
        mean, sigma = mean_with_sigma(steady.x, steady.rate_hz)
    except InputError as error:  # a coarse sensor whose block means are all equal
        raise NoFitError(f"its mean has no scatter to judge it by: {error}") from None
    told = list(findings)
    if pulses is None:
        told += line_findings(axis, lines, unit)
    else:
        told.append(counted(axis, Lattice(pulses.quantum, pulses.read_rate_hz), main.rate_hz, unit))
    told += fit_findings(
        axis, chosen, data.dt, duration, "the measured spectrum" if pulses is None else "of counted pulses"
    )
    told += _trends(axis, steady, findings)
    replaced = sum(s.replaced for s in signals)
    if replaced:
        share = 100.0 * replaced / float(data.lengths.sum())
        told.append(Finding("outliers", f"{axis}: {replaced} outliers ({share:.2g} %) were replaced.", severity="note"))
    return AxisNoise(
        axis=axis,
        unit=unit,
        rate_hz=main.rate_hz,
        duration_s=duration,
        mean=Estimate(mean, sigma, mean - 1.96 * sigma, mean + 1.96 * sigma, unit),
        curve=curve,
        # what looks like rounding from many samples on is the rest of a vibration; as Q it is absurd at one sample
        terms={n: estimates[n] for n in fit.names if n in _UNITS and not (n == "Q" and chosen.shortest > 1)},
        gauss_markov=tuple((estimates[n], estimates["tau" + n[5:]]) for n in fit.names if n.startswith("sigma")),
        model=model,
        names=tuple("V" if name == "Q" and chosen.shortest > 1 else name for name in fit.names),
        covariance=fit.covariance,
        candidates=chosen.candidates,
        read_off=_read_off(curve),
        method={"gmwm": "generalised method of wavelet moments", "allan": "weighted fit to the Allan curve"}[method],
        findings=tuple(told),
    )


def _estimates(fit: Fit, unit: str) -> dict[str, Estimate]:
    """Parameters with their uncertainty; intervals are symmetric in the logarithm."""
    found = {}
    for name, value, s in zip(fit.names, fit.values, fit.sigma, strict=True):
        text = "s" if name.startswith("tau") else unit if name.startswith("sigma") else _UNITS[name].format(unit)
        low, high = value * np.exp(-1.96 * s), value * np.exp(min(1.96 * s, 700.0))
        found[name] = Estimate(float(value), float(value * s), float(low), float(high), text)
    return found


def _pooled_curve(signals: list[_Signal]) -> AllanCurve:
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


def _with_bounds(curve: AllanCurve, data: Moments, model: NoiseModel) -> AllanCurve:
    """The curve with bounds for the noise that was found."""
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


def _read_off(curve: AllanCurve) -> dict[str, float]:
    """What the eye reads, where the curve reaches there."""
    log_tau, log_dev = np.log(curve.tau), np.log(curve.deviation)
    lowest = int(np.argmin(curve.deviation))
    read = {"minimum": float(curve.deviation[lowest]), "minimum_tau_s": float(curve.tau[lowest])}
    for key, at in (("N_at_1s", 1.0), ("K_at_3s", 3.0)):
        if curve.tau[0] <= at <= curve.tau[-1]:
            read[key] = float(np.exp(np.interp(np.log(at), log_tau, log_dev)))
    return read


def _pulses(signals: list[_Signal], curve: AllanCurve, dt: float, findings: tuple[Finding, ...]) -> Counted | None:
    """The model of a counter, where one recording is coarse because its readings are counted pulses."""
    x = signals[0].x
    if len(signals) > 1 or all(f.code != "coarse" for f in findings) or not np.isfinite(x).all():
        return None
    lattice = pulse_lattice(x, signals[0].rate_hz)
    return None if lattice is None else counted_model(curve, lattice, float(x.mean()), dt, len(x))


def _trends(axis: str, signal: _Signal, findings: tuple[Finding, ...]) -> list[Finding]:
    """Warm-up, small shifts of level and temperature, which a noise model cannot stand for."""
    told = list(warm_up(signal.x, signal.rate_hz, axis=axis).findings)
    if not told and all(f.code != "step" for f in findings):
        told += level_shifts(signal.x, signal.rate_hz, axis=axis)
    T = signal.temperature
    if T is not None and np.ptp(there := T[np.isfinite(T)]) > 0.0:
        filled = np.interp(np.arange(len(T)), np.flatnonzero(np.isfinite(T)), there)
        told += temperature_trend(signal.x, filled, signal.rate_hz, axis=axis).findings
    return [_later(f, signal.start_s) for f in told]


def _later(f: Finding, by: float) -> Finding:
    """A finding about a part of a recording that begins ``by`` seconds after its start."""
    if by == 0.0:
        return f
    start, stop = (None if at is None else at + by for at in (f.start_s, f.stop_s))
    return replace(f, text=f"{f.text} (seconds from {by:.0f} s on, after a pause)", start_s=start, stop_s=stop)
