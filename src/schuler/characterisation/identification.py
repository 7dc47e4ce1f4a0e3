"""From a log at rest to a noise model: every axis, with uncertainty, and one budget for the IMU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.counting import Lattice, counted, counted_model, pulse_lattice
from schuler.characterisation.fitting import NoFitError, Weights
from schuler.characterisation.health import FEWEST, check_static_imu
from schuler.characterisation.moments import Moments
from schuler.characterisation.nonstationarity import LevelScatter, allow_for, level_scatter, scatter_findings
from schuler.characterisation.records import (
    AxisSignal,
    axis_findings,
    axis_signal,
    half_moments,
    longest_run,
    mean_moments,
    pooled_curve,
    read_off,
    replaced_sigma,
    sampling_rate,
    shifted_by,
    with_bounds,
)
from schuler.characterisation.result import AXES, AxisNoise, Estimate, Finding, NoiseIdentification
from schuler.characterisation.selection import Selection, select
from schuler.characterisation.shifts import level_shifts
from schuler.characterisation.simulation_model import simulation_model
from schuler.characterisation.spectrum import CleanSpectrum, Line, clean_spectrum
from schuler.characterisation.trends import mean_with_sigma, temperature_trend, warm_up
from schuler.characterisation.turn_on import TurnOn, turn_on_bias
from schuler.exceptions import InputError
from schuler.files import package_version
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import (
    Counted,
    NoiseModel,
    Sinusoid,
)
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import G0

Method = Literal["gmwm", "allan"]
Progress = Callable[[float], None]

_UNITS = {"Q": "{}*s", "N": "({})/sqrt(Hz)", "B": "{}", "K": "({})*sqrt(Hz)", "R": "({})/s"}
_SWITCH_ONS = 3  # recordings from which on their means tell a spread
_LEAST = 1000  # samples below which nothing is identified
_MANY_REPLACED = 0.03  # share of samples from which on outliers replaced are a warning
_MOST_CLUSTERED = 0.03  # share from which on there is no number where most outliers have a neighbour
_MOST_REPLACED = 0.15  # and from which on there is none: so much is no sensor at rest
_FIELDS = {
    "Q": "quantisation", "N": "random_walk", "B": "bias_instability", "K": "rate_random_walk", "R": "rate_ramp",
    "sigma_1": "in_run_bias", "tau_1": "in_run_time",
}  # fmt: skip
#: Models that a TriadSpec can hold: at most one Gauss-Markov process.
_BUDGET_MODELS = ("N", "N+B", "N+K", "N+GM", "N+B+K", "N+K+GM", "N+B+GM")


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
        Several are recordings of one unit: their Allan variances are averaged by length. Gaps stay gaps.
    method : {"gmwm", "allan"}
        Weights of the fit to the Allan variances at octaves: the inverse of their covariance (generalised method
        of wavelet moments), or of its diagonal only (a weighted fit to the Allan curve).
    robust : bool
        Replace outliers before (:func:`.outliers.without_outliers`).
    models : tuple of str, optional
        Models to choose from, such as ``("N+B+K", "N+GM")``; None: see :mod:`.selection`.
    progress : callable, optional
        Called with the fraction done.
    name : str
        Name of the result.

    Returns
    -------
    NoiseIdentification

    Raises
    ------
    InputError
        If there is no IMU, sampling rates differ, or an option is unknown. An axis that cannot be identified is no
        error: ``refused`` holds its findings.

    Notes
    -----
    The bounds of the curve are recomputed for the identified model, and allow for a level that changes in the longest
    recording (:mod:`.nonstationarity`). The budget is fitted to the mean Allan variance of
    a triad's axes, with at most one Gauss-Markov term; its turn-on bias is the size of the mean that the log shows,
    which for gyroscopes includes Earth rate and for accelerometers is the departure of the mean from 9.80665 m/s^2.
    Three recordings and more are switch-ons of their own: ``turn_on`` has the mean of each axis and its spread, and
    the gyroscopes' turn-on bias is what is left when that mean is taken off (spread and uncertainty of the mean).

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), J. Am. Stat. Assoc. 108(503); IEEE Std 952, annex C;
    Flenniken (2005), chapter 2, whose manual route is :mod:`.manual`.
    """
    if method not in ("gmwm", "allan"):
        raise InputError(f"method: expected 'gmwm' or 'allan', got {method!r}")
    several = [recordings] if isinstance(recordings, (Recording, ImuSeries)) else list(recordings)
    imus, rate_hz = _imus_of_one_rate(several)
    checks = [check_static_imu(imu) for imu in imus]
    imus = [imu.rates() for imu in imus]
    axes: dict[str, AxisNoise] = {}
    refused: dict[str, tuple[Finding, ...]] = {}
    data: dict[str, Moments] = {}
    turn_on: dict[str, TurnOn] = {}
    single = any("one-axis" in str(r.metadata.options.get("allow")) for r in several if isinstance(r, Recording))
    for k, axis in enumerate(AXES):
        of_triad = [imu.gyro if k < 3 else imu.accel for imu in imus]
        if not any((x[:, k % 3] if single else x).any() for x in of_triad):
            continue  # a log without these sensors holds zeros in their place
        signals = [axis_signal(imu, k, robust) for imu in imus]
        findings = tuple(
            f for i, check in enumerate(checks) for f in axis_findings(check[axis], signals[i], i + 1, len(imus))
        )
        fatal = _fatal(axis, signals, findings)
        if not fatal:
            try:
                longest = max(signals, key=lambda s: len(s.x))
                clean = clean_spectrum(longest.x, longest.rate_hz)
                data[axis] = mean_moments(signals, () if clean is None else clean.lines)
                axes[axis] = _axis_noise(axis, signals, data[axis], clean, findings, method, models)
                if len(signals) >= _SWITCH_ONS:
                    turn_on[axis] = _turn_on(signals, axes[axis].unit)
            except NoFitError as error:
                data.pop(axis, None)
                axes.pop(axis, None)
                fatal = (Finding("no_fit", f"{axis}: {error}", severity="refused"),)
        if fatal:
            refused[axis] = (*fatal, *(f for f in findings if f not in fatal))
        if progress is not None:
            progress((k + 1) / (len(AXES) + 1))
    title = name or (several[0].metadata.name if isinstance(several[0], Recording) else "IMU")
    spec, spec_sigma = triad_budget(title, axes, data, rate_hz, method, turn_on, absent=_absent(imus))
    if progress is not None:
        progress(1.0)
    records = [r for r in several if isinstance(r, Recording)]
    # what is true of every log is said once
    notes = tuple(dict.fromkeys(n for r in records for n in r.metadata.notes)) + _budget_notes(spec, axes, turn_on)
    provenance: dict[str, Any] = {
        "schuler": package_version(),
        "method": method,
        "robust": robust,
        "models": "default" if models is None else list(models),
        "sources": {k: v for r in records for k, v in r.metadata.sources.items()},
        "recordings": [r.metadata.name for r in records],
        "recording_options": [r.metadata.options for r in records],
    }
    of_recording = tuple(f for check in checks for f in check["recording"])
    if raw := [r.metadata.name for r in records if "counts" in str(r.metadata.options.get("units", ""))]:
        text = (
            f"{', '.join(raw)}: the readings are raw counts; every number here is one of counts where it says rad/s, "
            "m/s^2 or a unit of data sheets: say the scale factors"
        )
        of_recording = (Finding("counts", text), *of_recording)
    return NoiseIdentification(title, axes, refused, spec, spec_sigma, of_recording, notes, provenance, turn_on)


def _absent(imus: list[ImuSeries]) -> tuple[str, ...]:
    """Triads that no log has: zeros hold their place."""
    return tuple(t for t in ("gyro", "accel") if not any(getattr(imu, t).any() for imu in imus))


def _turn_on(signals: list[AxisSignal], unit: str) -> TurnOn:
    """Mean of an axis over the recordings, and its spread from one to the next."""
    means = [_mean(longest_run(s), unit) for s in signals]
    return turn_on_bias([m.value for m in means], [m.sigma for m in means])


def _imus_of_one_rate(recordings: Sequence[Recording | ImuSeries]) -> tuple[list[ImuSeries], float]:
    """IMU series of all recordings and their sampling rate [Hz], which must be one."""
    if not recordings:
        raise InputError("recordings: expected at least one, got none")
    imus = [(r.need_imu() if isinstance(r, Recording) else r) for r in recordings]
    rates = np.array([sampling_rate(imu) for imu in imus])
    if np.ptp(rates) > 1e-3 * rates[0]:
        raise InputError(f"recordings: expected one sampling rate, got {', '.join(f'{r:.4g}' for r in rates)} Hz")
    return imus, float(rates[0])


def _fatal(axis: str, signals: list[AxisSignal], findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Findings with which an axis is refused."""
    fatal = tuple(f for f in findings if f.severity == "refused")
    shortest = min(len(s.x) for s in signals)
    if not fatal and (text := _too_many_replaced(signals)):
        return (Finding("outliers", f"{axis}: {text}", severity="refused"),)
    if fatal or shortest >= _LEAST:
        return fatal
    text = f"{axis}: {shortest} samples are too few to identify noise; {_LEAST} are needed"
    return (Finding("too_short", text, severity="refused"),)


def _too_many_replaced(signals: list[AxisSignal]) -> str:
    """Why what outliers leave is not enough; empty if it is."""
    replaced = sum(s.replaced for s in signals)
    share = replaced / max(sum(np.count_nonzero(np.isfinite(s.x)) for s in signals), 1)
    if share > _MOST_REPLACED:
        return (
            f"{100.0 * share:.2g} % of the samples are outliers, expected {100.0 * _MOST_REPLACED:.0f} % at most: what "
            "is left is no sensor at rest; look for their cause, or identify without replacing outliers"
        )
    if share > _MOST_CLUSTERED and sum(s.clustered for s in signals) > 0.5 * replaced:
        return (
            f"{100.0 * share:.2g} % of the samples are outliers, most of them next to one another: disturbances, which "
            "replacing single samples does not mend; take a part of the log without them, or record again"
        )
    return ""


def _budget_notes(spec: ImuSpec | None, axes: dict[str, AxisNoise], turn_on: dict[str, TurnOn]) -> tuple[str, ...]:
    """Sentences on what the budget contains besides noise, and on axes with warnings in it."""
    if spec is None:
        return ()
    notes: tuple[str, ...] = (
        "The budget's turn-on bias is the mean of this log: Earth rate is in the gyroscopes', and only what the "
        "norm of the specific force shows in the accelerometers'.",
    )
    if spread := [t for axis, t in turn_on.items() if axis.startswith("gyro")]:
        notes = (
            f"The gyroscopes' turn-on bias in the budget is their spread over {spread[0].records} recordings, for use "
            "with the mean taken off (b_g of the calibration); the mean has Earth rate in it. The accelerometers' is "
            "what the norm of the specific force shows.",
        )
    absent = [t for t in ("gyro", "accel") if not any(a.startswith(t) for a in axes)]
    notes += tuple(f"The log has no {t}: the budget states no number for it." for t in absent)
    spoiled = [name for name, axis in axes.items() if any(f.severity == "warning" for f in axis.findings)]
    if spoiled:
        notes += (f"The budget is made of all axes, also of those with warnings: {', '.join(spoiled)}.",)
    return notes


def _axis_noise(
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
    mean = _mean(steady, unit)
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
    replaced = sum(s.replaced for s in signals)
    if replaced:
        share = replaced / float(data.lengths.sum())
        text = f"{axis}: {replaced} outliers ({100.0 * share:.2g} %) were replaced"
        if share > _MANY_REPLACED:
            text += (
                ": where they and the noise meet, chance decides which samples, and the intervals allow for that; "
                "look for their cause and record again"
            )
            remarks.insert(0, Finding("outliers", text))  # leads: every number rests on it
        else:
            remarks.append(Finding("outliers", f"{text}.", severity="note"))
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


def _level_allowed(curve: AllanCurve, longest: AxisSignal, data: Moments) -> tuple[AllanCurve, LevelScatter]:
    """The curve with bounds that allow for a level that changes in the longest recording, and that change."""
    own = replace(curve, edf=curve.edf * min(1.0, len(longest.x) / float(data.lengths.sum())))
    changed = level_scatter(longest.x, own)
    return allow_for(curve, changed), changed


def _mean(steady: AxisSignal, unit: str) -> Estimate:
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


def triad_budget(
    name: str,
    noise: dict[str, AxisNoise],
    data: dict[str, Moments],
    rate_hz: float,
    method: Literal["gmwm", "allan"],
    turn_on: dict[str, TurnOn] | None = None,
    absent: tuple[str, ...] = (),
) -> tuple[ImuSpec | None, dict[str, dict[str, float]]]:
    """Budget fitted to the mean Allan variance of the axes of each triad, and its relative 1-sigma uncertainty.

    A triad that is ``absent`` from the log has a budget without numbers.
    """
    triads: dict[str, TriadSpec] = {}
    spread: dict[str, dict[str, float]] = {}
    for triad in ("gyro", "accel"):
        axes = [a for a in AXES if a.startswith(triad) and a in noise]
        if triad in absent and noise:
            triads[triad] = TriadSpec(random_walk=0.0)
            continue
        if not axes:
            return None, {}
        parts = [data[a] for a in axes]
        k = min(len(p.m) for p in parts)
        mean = Moments(
            parts[0].m[:k],
            np.mean([p.variance[:k] for p in parts], axis=0),
            parts[0].dt,
            np.concatenate([p.lengths for p in parts]),
        )
        weights: Weights = "full" if method == "gmwm" else "diagonal"
        try:
            selection = select(mean, None, weights, default=_BUDGET_MODELS, probes=_BUDGET_MODELS)
        except NoFitError:
            return None, {}
        fit = selection.fit
        means = np.array([noise[a].mean.value for a in axes])
        records = [turn_on[a] for a in axes if turn_on and a in turn_on] if triad == "gyro" else []
        if records:
            bias = float(np.sqrt(np.mean([t.sigma**2 + t.mean_sigma**2 for t in records])))
        elif triad == "gyro":
            bias = float(np.sqrt(np.mean(means**2)))
        else:
            bias = abs(float(np.linalg.norm(means)) - G0) if len(axes) == 3 else 0.0
        fitted = [i for i, n in enumerate(fit.names) if n in _FIELDS and not (n == "Q" and selection.shortest > 1)]
        fields = {_FIELDS[fit.names[i]]: float(fit.values[i]) for i in fitted}
        triads[triad] = TriadSpec(**fields, turn_on_bias=bias)
        spread[triad] = {_FIELDS[fit.names[i]]: selection.spreads[fit.names[i]].sigma for i in fitted}
        if records:  # of a standard deviation with as many degrees of freedom (chi-square)
            spread[triad]["turn_on_bias"] = float(1.0 / np.sqrt(2.0 * sum(t.records - 1 for t in records)))
    spec = ImuSpec(name, triads["gyro"], triads["accel"], rate_hz=rate_hz, source="identified by schuler")
    return spec, spread
