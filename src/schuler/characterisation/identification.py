"""From a log at rest to a noise model: every axis, with uncertainty, and one budget for the IMU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from schuler.arguments import explains_arguments
from schuler.characterisation.axis_noise import Method, axis_noise, mean_of
from schuler.characterisation.fitting import NoFitError, Weights
from schuler.characterisation.health import check_static_imu
from schuler.characterisation.moments import Moments
from schuler.characterisation.records import (
    AxisSignal,
    axis_findings,
    axis_signal,
    longest_run,
    mean_moments,
    sampling_rate,
)
from schuler.characterisation.result import AXES, AxisNoise, Finding, NoiseIdentification
from schuler.characterisation.selection import select
from schuler.characterisation.spectrum import clean_spectrum
from schuler.characterisation.turn_on import TurnOn, turn_on_bias
from schuler.exceptions import InputError
from schuler.files import package_version
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import G0

Progress = Callable[[float], None]

_SWITCH_ONS = 3  # recordings from which on their means tell a spread
_LEAST = 1000  # samples below which nothing is identified
_MOST_CLUSTERED = 0.03  # share from which on there is no number where most outliers have a neighbour
_MOST_REPLACED = 0.15  # and from which on there is none: so much is no sensor at rest
_FIELDS = {
    "Q": "quantisation", "N": "random_walk", "B": "bias_instability", "K": "rate_random_walk", "R": "rate_ramp",
    "sigma_1": "in_run_bias", "tau_1": "in_run_time",
}  # fmt: skip
#: Models that a TriadSpec can hold: at most one Gauss-Markov process.
_BUDGET_MODELS = ("N", "N+B", "N+K", "N+GM", "N+B+K", "N+K+GM", "N+B+GM")


@explains_arguments
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

    Examples
    --------
    >>> rest = {"type": "static", "lat_deg": 48.0, "lon_deg": 11.0, "duration_s": 1200.0}
    >>> log = schuler.simulate({"motion": rest, "imu": {"catalogue": "MTi-G-710", "rate_hz": 50.0}, "seed": 1})
    >>> noise = schuler.identify_noise(log)
    >>> arw = noise.spec.gyro.random_walk / schuler.units.DEG * 60.0
    >>> print(f"{arw:.2f} deg/sqrt(h)")  # 0.60 was simulated
    0.60 deg/sqrt(h)
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
                axes[axis] = axis_noise(axis, signals, data[axis], clean, findings, method, models)
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
    provenance = _provenance(records, method, robust, models)
    of_recording = (*_in_counts(records), *(f for check in checks for f in check["recording"]))
    return NoiseIdentification(title, axes, refused, spec, spec_sigma, of_recording, notes, provenance, turn_on)


def _provenance(
    records: list[Recording], method: Method, robust: bool, models: tuple[str, ...] | None
) -> dict[str, Any]:
    """Options and recordings that a result is made from."""
    return {
        "schuler": package_version(),
        "method": method,
        "robust": robust,
        "models": "default" if models is None else list(models),
        "sources": {k: v for r in records for k, v in r.metadata.sources.items()},
        "recordings": [r.metadata.name for r in records],
        "recording_options": [r.metadata.options for r in records],
    }


def _in_counts(records: list[Recording]) -> tuple[Finding, ...]:
    """Finding on recordings in raw counts; empty if there are none."""
    raw = [r.metadata.name for r in records if "counts" in str(r.metadata.options.get("units", ""))]
    if not raw:
        return ()
    text = (
        f"{', '.join(raw)}: the readings are raw counts; every number here is one of counts where it says rad/s, "
        "m/s^2 or a unit of data sheets: say the scale factors"
    )
    return (Finding("counts", text),)


def _absent(imus: list[ImuSeries]) -> tuple[str, ...]:
    """Triads that no log has: zeros hold their place."""
    return tuple(t for t in ("gyro", "accel") if not any(getattr(imu, t).any() for imu in imus))


def _turn_on(signals: list[AxisSignal], unit: str) -> TurnOn:
    """Mean of an axis over the recordings, and its spread from one to the next."""
    means = [mean_of(longest_run(s), unit) for s in signals]
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
    white = [t for t in ("gyro", "accel") if t not in absent and getattr(spec, t).random_walk == 0.0]
    notes += tuple(f"The log shows no white noise of the {t} beside other noise: the budget has none." for t in white)
    spoiled = [name for name, axis in axes.items() if any(f.severity == "warning" for f in axis.findings)]
    if spoiled:
        notes += (f"The budget is made of all axes, also of those with warnings: {', '.join(spoiled)}.",)
    return notes


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
        # a log that quantisation or a slow wander fills shows no white noise
        triads[triad] = TriadSpec(**{"random_walk": 0.0, **fields}, turn_on_bias=bias)
        spread[triad] = {_FIELDS[fit.names[i]]: selection.spreads[fit.names[i]].sigma for i in fitted}
        if records:  # of a standard deviation with as many degrees of freedom (chi-square)
            spread[triad]["turn_on_bias"] = float(1.0 / np.sqrt(2.0 * sum(t.records - 1 for t in records)))
    spec = ImuSpec(name, triads["gyro"], triads["accel"], rate_hz=rate_hz, source="identified by schuler")
    return spec, spread
