"""Noise of one axis at rest: fitted terms, model for simulation, curve with bounds, mean, findings."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.counting import Lattice, counted, counted_model, pulse_lattice
from schuler.characterisation.fitting import NoFitError
from schuler.characterisation.health import FEWEST
from schuler.characterisation.moments import Moments
from schuler.characterisation.nonstationarity import LevelScatter, allow_for, level_scatter, scatter_findings
from schuler.characterisation.records import (
    AxisSignal,
    half_moments,
    longest_run,
    pooled_curve,
    read_off,
    replaced_sigma,
    shifted_by,
    with_bounds,
)
from schuler.characterisation.result import AxisNoise, Estimate, Finding
from schuler.characterisation.selection import Selection, select
from schuler.characterisation.shifts import level_shifts
from schuler.characterisation.simulation_model import simulation_model
from schuler.characterisation.spectrum import CleanSpectrum, Line
from schuler.characterisation.trends import mean_with_sigma, temperature_trend, warm_up
from schuler.exceptions import InputError
from schuler.sensors.noise import (
    Counted,
    NoiseModel,
    Sinusoid,
)

Method = Literal["gmwm", "allan"]

_UNITS = {"Q": "{}*s", "N": "({})/sqrt(Hz)", "B": "{}", "K": "({})*sqrt(Hz)", "R": "({})/s"}
_MANY_REPLACED = 0.03  # share of samples from which on outliers replaced are a warning


def axis_noise(
    axis: str,
    signals: list[AxisSignal],
    data: Moments,
    clean: CleanSpectrum | None,
    findings: tuple[Finding, ...],
    method: Method,
    models: tuple[str, ...] | None,
) -> AxisNoise:
    """Noise of one axis: fitted terms, model for simulation, curve with bounds, mean, findings."""
    lines = () if clean is None else clean.lines
    selection = select(
        data, models, "full" if method == "gmwm" else "diagonal",
        halves=half_moments(signals, lines), white_sigma=replaced_sigma(signals),
    )  # fmt: skip
    fit = selection.fit
    pooled = pooled_curve(signals)
    pulses = _pulses(signals, pooled, data.dt, findings)
    if pulses is None:
        model = simulation_model(selection, clean, pooled, data.dt)
        model = NoiseModel((*model.terms, *(Sinusoid(line.amplitude, line.frequency) for line in lines)))
    else:
        model = NoiseModel((pulses,))  # what looks like lines is the pulses
    unit = "rad/s" if axis.startswith("gyro") else "m/s^2"
    main = max(signals, key=lambda s: len(s.x))
    duration = float(data.lengths.sum() * data.dt)
    curve, changed = _level_allowed(with_bounds(pooled, data, model), main, data)
    estimates = estimates_of(selection, unit)
    wider = np.array([selection.spreads[name].sigma for name in fit.names]) / fit.sigma
    steady = longest_run(main)
    mean = mean_of(steady, unit)
    remarks = list(findings)
    if pulses is None:
        remarks += line_findings(axis, lines, unit)
    else:
        remarks.append(counted(axis, Lattice(pulses.quantum, pulses.read_rate_hz), main.rate_hz, unit))
    remarks += fit_findings(
        axis, selection, data.dt, duration, "the measured spectrum" if pulses is None else "of counted pulses"
    )
    remarks += scatter_findings(axis, changed, len(main.x) / main.rate_hz)
    remarks += _trends(axis, steady, findings)
    if (outliers := _replaced_finding(axis, signals, data)) is not None:
        # a warning leads: every number rests on it
        remarks = [outliers, *remarks] if outliers.severity == "warning" else [*remarks, outliers]
    return AxisNoise(
        axis=axis,
        unit=unit,
        rate_hz=main.rate_hz,
        duration_s=duration,
        mean=mean,
        curve=curve,
        # a Q fitted from many samples on is the remainder of a vibration; as rounding of one sample it is absurd
        terms={n: estimates[n] for n in fit.names if n in _UNITS and not (n == "Q" and selection.shortest > 1)},
        gauss_markov=tuple((estimates[n], estimates["tau" + n[5:]]) for n in fit.names if n.startswith("sigma")),
        model=model,
        names=tuple("V" if name == "Q" and selection.shortest > 1 else name for name in fit.names),
        covariance=fit.covariance * np.outer(wider, wider),
        limits={n: s.high for n, s in selection.spreads.items() if n not in fit.names},
        candidates=selection.candidates,
        read_off=read_off(curve),
        method={"gmwm": "generalised method of wavelet moments", "allan": "weighted fit to the Allan curve"}[method],
        findings=tuple(remarks),
    )


def _replaced_finding(axis: str, signals: list[AxisSignal], data: Moments) -> Finding | None:
    """Finding on the outliers that were replaced, a warning where they are many; None if there were none."""
    replaced = sum(s.replaced for s in signals)
    if not replaced:
        return None
    share = replaced / float(data.lengths.sum())
    text = f"{axis}: {replaced} outliers ({100.0 * share:.2g} %) were replaced"
    if share <= _MANY_REPLACED:
        return Finding("outliers", f"{text}.", severity="note")
    text += (
        ": where they and the noise meet, chance decides which samples, and the intervals allow for that; look for "
        "their cause and record again"
    )
    return Finding("outliers", text)


def _level_allowed(curve: AllanCurve, longest: AxisSignal, data: Moments) -> tuple[AllanCurve, LevelScatter]:
    """The curve with bounds that allow for a level that changes in the longest recording, and that change."""
    own = replace(curve, edf=curve.edf * min(1.0, len(longest.x) / float(data.lengths.sum())))
    changed = level_scatter(longest.x, own)
    return allow_for(curve, changed), changed


def mean_of(steady: AxisSignal, unit: str) -> Estimate:
    """Mean of the longest part without a pause, with its uncertainty under the noise of that part."""
    if len(steady.x) < FEWEST:
        raise NoFitError(f"the longest part without a pause has {len(steady.x)} samples, {FEWEST} are needed")
    try:
        mean, sigma = mean_with_sigma(steady.x, steady.rate_hz)
    except InputError as error:  # a coarse sensor whose block means are all equal
        raise NoFitError(f"its mean has no scatter to judge it by: {error}") from None
    return Estimate(mean, sigma, mean - 1.96 * sigma, mean + 1.96 * sigma, unit)


def estimates_of(selection: Selection, unit: str) -> dict[str, Estimate]:
    """Parameters of the model kept, with their uncertainty over all models that the data do not tell apart."""
    estimates = {}
    for name, value in zip(selection.fit.names, map(float, selection.fit.values), strict=True):
        text = "s" if name.startswith("tau") else unit if name.startswith("sigma") else _UNITS[name].format(unit)
        s = selection.spreads[name]
        estimates[name] = Estimate(value, value * s.sigma, s.low, s.high, text)
    return estimates


def _pulses(signals: list[AxisSignal], curve: AllanCurve, dt: float, findings: tuple[Finding, ...]) -> Counted | None:
    """The model of a counter, where one recording is coarse because its readings are counted pulses."""
    x = signals[0].x
    if len(signals) > 1 or all(f.code != "coarse" for f in findings) or not np.isfinite(x).all():
        return None
    lattice = pulse_lattice(x, signals[0].rate_hz)
    return None if lattice is None else counted_model(curve, lattice, float(x.mean()), dt, len(x))


def _trends(axis: str, signal: AxisSignal, earlier: tuple[Finding, ...]) -> list[Finding]:
    """Warm-up, small shifts of level, temperature: drift that no noise model can describe."""
    findings = list(warm_up(signal.x, signal.rate_hz, axis=axis).findings)
    if not findings and all(f.code != "step" for f in earlier):
        findings += level_shifts(signal.x, signal.rate_hz, axis=axis)
    T = signal.temperature
    if T is not None and np.ptp(finite := T[np.isfinite(T)]) > 0.0:
        filled = np.interp(np.arange(len(T)), np.flatnonzero(np.isfinite(T)), finite)
        findings += temperature_trend(signal.x, filled, signal.rate_hz, axis=axis).findings
    return [shifted_by(f, signal.start_s) for f in findings]


def line_findings(axis: str, lines: tuple[Line, ...], unit: str) -> list[Finding]:
    """Finding on narrow lines in the spectrum, with the three strongest."""
    if not lines:
        return []
    strongest = ", ".join(f"{line.frequency:.4g} Hz ({line.amplitude:.2g} {unit})" for line in lines[:3])
    text = (
        f"{axis}: {len(lines)} narrow lines in the spectrum, the strongest at {strongest}: vibration or interference; "
        "they are in the model as sines and not in its noise terms"
    )
    return [Finding("lines", text, severity="note")]


def fit_findings(axis: str, selection: Selection, dt: float, duration: float, substitute: str) -> list[Finding]:
    """Findings on the fit; ``substitute`` names what the model for simulation is where no sum of terms fits."""
    findings, departure = [], selection.departure
    if not selection.fits:
        by = f" by more than {100 * departure:.0f} % in variance" if departure > 0.0 else ""
        of = "all of them" if departure > 0.0 else "all of them whose terms this log determines"
        text = (
            f"{axis}: no model fits: the curve departs from {of}{by}; look at the figure for vibration or disturbances "
            "and do not use the numbers before"
        )
        findings.append(Finding("no_model", text))
    elif departure > 0.0:
        text = (
            f"{axis}: the curve departs from every sum of terms by about {100 * departure:.2g} % in variance, "
            "more than chance does (vibration, temperature, disturbances); the uncertainties allow for it, "
            f"and the model for simulation is {substitute}"
        )
        findings.append(Finding("departure", text, severity="note" if departure < 0.1 else "warning"))
    if selection.shortest > 1:
        text = (
            f"{axis}: below {selection.shortest * dt:.3g} s the noise is no sum of terms (sensor filter, vibration); "
            f"the numbers hold from there on, and the model is {substitute} at shorter times"
        )
        findings.append(Finding("shape", text, severity="note"))
    if selection.changes:
        factors = (
            f"{_label(n, selection)} changes by a factor of {np.exp(c):.3g}" for n, c in selection.changes.items()
        )
        text = (
            f"{axis}: between the halves of the log {', '.join(factors)}, more than chance does: the noise is not the "
            "same throughout, and the intervals allow for that"
        )
        findings.append(Finding("halves", text, severity="note"))
    for name, value, sigma in zip(selection.fit.names, selection.fit.values, selection.fit.sigma, strict=True):
        if name.startswith("tau") and name != "tau_N" and (value > duration / 10.0 or sigma > 0.7):
            text = (
                f"{axis}: a correlation time of {value:.3g} s from a log of {duration:.3g} s is good to a factor of "
                f"{np.exp(1.96 * min(sigma, 3.0)):.2g}; a longer log would tell it from a random walk"
            )
            findings.append(Finding("short_for_tau", text, severity="note"))
    return findings


def _label(name: str, selection: Selection) -> str:
    return "the vibration" if name == "Q" and selection.shortest > 1 else name
