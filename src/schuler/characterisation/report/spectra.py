"""The log itself in the noise report: its spectrum, its autocorrelation, the samples with what was found in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.report.panels import beside, decades
from schuler.characterisation.report.terms import Unit, chosen, quantities, signal_unit
from schuler.characterisation.result import Finding, NoiseIdentification
from schuler.characterisation.spectrum import power_spectrum
from schuler.plotting.figure import Figure, Item, Line, Panel, Span, line, thin
from schuler.recording.figures import SHOWN_UNITS
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov

#: Spectrum or autocorrelation of one axis: abscissa and values.
Curve: TypeAlias = tuple[FloatArray, FloatArray]

_SEGMENTS = 8  # of half overlapping pieces, at the lowest frequencies
_LONGEST = 1 << 17  # samples in a piece
_PER_DECADE = 60  # points drawn
_BLOCKS = 200  # means drawn through the noise of a log


def log_spectra(imu: ImuSeries) -> dict[str, Curve]:
    """Two-sided power spectral densities of all axes, for :func:`spectrum`.

    Parameters
    ----------
    imu : ImuSeries
        At rest; of a log with gaps the longest part without one is used.

    Returns
    -------
    dict of str to (ndarray, ndarray)
        Axis to frequencies [Hz] and densities [x^2/Hz]; empty for a log of fewer than 64 samples.

    Notes
    -----
    :func:`~schuler.characterisation.spectrum.power_spectrum`; values of neighbouring frequencies are then averaged so
    that each decade has the same number of points.
    """
    rates = imu.rates()
    first, last = _unbroken(rates)
    if last - first < 64:
        return {}
    length = min(1 << int(np.log2(2 * (last - first) / (_SEGMENTS + 1))), _LONGEST)
    spectra = {}
    for triad, columns in (("gyro", rates.gyro), ("accel", rates.accel)):
        for k, letter in enumerate("xyz"):
            s = power_spectrum(columns[first:last, k], rates.rate_hz, segment_s=length / rates.rate_hz)
            spectra[f"{triad}_{letter}"] = _by_decades(s.f, s.psd)
    return spectra


def log_spectrum(spectra: Mapping[str, Curve], shown: Mapping[str, tuple[str, float]] = SHOWN_UNITS) -> Figure | None:
    """Root power spectral density of a log by itself, the axes of a triad in one panel.

    Parameters
    ----------
    spectra : mapping of str to (ndarray, ndarray)
        As of :func:`log_spectra`; None comes of an empty one.
    shown : mapping
        Unit of each triad, and its value in that of the series, see :func:`~schuler.recording.figures.shown_units`.
    """
    panels = []
    for triad, words in (("accel", "specific force"), ("gyro", "angular rate")):
        unit, factor = shown[triad]
        curves = {k: spectra[f"{triad}_{k}"] for k in "xyz" if f"{triad}_{k}" in spectra}
        roots = {k: (f[S > 0.0], np.sqrt(S[S > 0.0]) / factor) for k, (f, S) in curves.items() if (S > 0.0).any()}
        if not roots:
            continue
        items = tuple(Line(f, root, f"axis_{k}", k) for k, (f, root) in roots.items())
        limits = decades(np.concatenate([root for _, root in roots.values()]))
        label = f"root density [{unit}/√Hz]"
        panels.append(Panel("frequency [Hz]", label, items, title=words, log=True, log_x=True, y_limits=limits))
    caption = "Square root of the two-sided density: white noise is a level, a spike is vibration or the mains."
    return Figure("spectrum", "Spectrum", caption, tuple(panels), linked=False) if panels else None


def spectrum(identification: NoiseIdentification, spectra: Mapping[str, Curve], unit: Unit = "datasheet") -> Figure:
    """Root power spectral density of the log and of the model.

    Parameters
    ----------
    identification : NoiseIdentification
    spectra : mapping of str to (ndarray, ndarray)
        Axis to frequencies [Hz] and **two-sided** densities [x^2/Hz].
    unit : {"datasheet", "si"}
    """
    panels = []
    panels_of = beside(chosen(identification, [name for name in identification.axes if name in spectra]))
    for axis in panels_of:
        f, S = (np.asarray(v, dtype=np.float64) for v in spectra[axis.axis])
        f, S = f[f > 0.0], S[f > 0.0]
        name, factor = signal_unit(axis, unit)
        root = np.sqrt(S) / factor
        k = thin([root])
        at = np.geomspace(f[0], f[-1], 200)
        items = (
            Line(f[k], root[k], "allan", "measured"),
            Line(at, np.sqrt(axis.model.discrete_psd(at, 1.0 / axis.rate_hz)) / factor, "model", "model"),
        )
        panels.append(
            Panel(
                "frequency [Hz]", f"root density [{name}/√Hz]", items, title=axis.axis, log=True, log_x=True,
                y_limits=decades(root),
            )
        )  # fmt: skip
    return Figure(
        "spectrum",
        "Spectrum",
        "Square root of the two-sided density: white noise is a level at N; a spike is vibration or the mains.",
        tuple(panels),
        columns=1 if len(panels_of) == 1 else 2,
    )


def autocorrelation(identification: NoiseIdentification, correlations: Mapping[str, Curve]) -> Figure:
    """Autocorrelation of the log and what the model's Gauss-Markov terms are expected to show in it.

    Parameters
    ----------
    identification : NoiseIdentification
    correlations : mapping of str to (ndarray, ndarray)
        Axis to lags [s] and autocovariances [x^2] of the log less its mean.

    Notes
    -----
    Lag zero is left out: white noise is there and nowhere else.
    """
    from schuler.characterisation.correlation import expected_autocovariance

    panels = []
    panels_of = beside(chosen(identification, [name for name in identification.axes if name in correlations]))
    for axis in panels_of:
        lag, r = (np.asarray(v, dtype=np.float64) for v in correlations[axis.axis])
        lag, r = lag[lag > 0.0], r[lag > 0.0]
        name, factor = signal_unit(axis, "datasheet")
        model = np.zeros_like(lag)
        for term in axis.model.terms:
            if isinstance(term, GaussMarkov):
                model += expected_autocovariance(term, lag, axis.duration_s)
        items = (
            line(lag, r / factor**2, "allan", "measured"),
            line(lag, model / factor**2, "model", "expected of the Gauss-Markov terms"),
        )
        panels.append(Panel("lag [s]", f"autocovariance [({name})²]", items, title=axis.axis))
    return Figure(
        "autocorrelation",
        "Autocorrelation",
        "A Gauss-Markov term falls to 37 % within its correlation time, earlier where the log is short.",
        tuple(panels),
        columns=1 if len(panels_of) == 1 else 2,
    )


def signals(identification: NoiseIdentification, imu: ImuSeries) -> Figure:
    """The log itself, less its mean: extremes of each stretch, block means, findings shaded.

    Parameters
    ----------
    identification : NoiseIdentification
    imu : ImuSeries
        The recording it was made from; all six axes are shown, refused ones too.
    """
    rates = imu.rates()
    t = rates.t - rates.t[0]
    end = float(t[-1])
    panels = []
    for k, letter in enumerate("xyz"):
        for triad, columns in (("gyro", rates.gyro), ("accel", rates.accel)):
            name, q = f"{triad}_{letter}", quantities(triad)["sample"]
            y = (columns[:, k] - np.mean(columns[:, k])) / q.factor
            items: list[Item] = [*_shaded(_about(identification, name), end), line(t, y, "allan", "log less its mean")]
            each = len(t) // _BLOCKS
            if each >= 20:
                means = [v[: each * _BLOCKS].reshape(_BLOCKS, each).mean(axis=1) for v in (t, y)]
                items.append(line(means[0], means[1], "model", f"means of {each} samples"))
            title = f"{name}, refused" if name in identification.refused else name
            panels.append(Panel("time [s]", f"{q.name} [{q.sheet}]", tuple(items), title=title, x_limits=(0.0, end)))
    return Figure(
        "signals",
        "The log",
        "A sensor at rest shows a ribbon of constant width; steps, spikes, bends are no noise. Yellow: see findings.",
        tuple(panels),
        columns=2,
    )


def _unbroken(imu: ImuSeries) -> tuple[int, int]:
    """Longest run of samples without a gap."""
    gaps = np.searchsorted(imu.t, imu.gaps()[:, 0], side="right")
    edges = np.concatenate([[0], gaps, [len(imu)]])
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])


def _by_decades(f: FloatArray, S: FloatArray) -> tuple[FloatArray, FloatArray]:
    slot = np.floor(_PER_DECADE * np.log10(f / f[0]) + 1e-9).astype(np.int64)
    starts = np.flatnonzero(np.diff(slot, prepend=-1))
    count = np.diff(np.append(starts, len(f)))
    return np.add.reduceat(f, starts) / count, np.add.reduceat(S, starts) / count


def _about(identification: NoiseIdentification, name: str) -> list[Finding]:
    """Findings about an axis or about the whole recording."""
    axis_findings = identification.axes[name].findings if name in identification.axes else ()
    return [*identification.findings, *axis_findings, *identification.refused.get(name, ())]


def _shaded(findings: Sequence[Finding], end: float) -> list[Span]:
    """Where findings have a place; a moment is made wide enough to be seen."""
    spans = {}
    for f in findings:
        if f.start_s is not None:
            stop = f.stop_s if f.stop_s is not None else f.start_s
            room = max(0.003 * end - (stop - f.start_s), 0.0)
            spans[f.start_s, stop] = Span(f.start_s - 0.5 * room, stop + 0.5 * room, "finding", "finding")
    return list(spans.values())
