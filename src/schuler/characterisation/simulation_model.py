"""The noise of a log as something to simulate: fitted terms, and the measured spectrum where no terms describe it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.characterisation.allan import AllanCurve
from schuler.characterisation.fitting import Fit, filtered_sigma, spectrum
from schuler.characterisation.moments import transfer
from schuler.characterisation.selection import Selection
from schuler.characterisation.spectrum import CleanSpectrum, Line
from schuler.sensors.noise import (
    Coloured,
    Flicker,
    GaussMarkov,
    NoiseModel,
    Process,
    Quantisation,
    Ramp,
    RandomWalk,
    White,
)

_PROCESSES: dict[str, Callable[[float], Process]] = {
    "Q": Quantisation, "N": White, "B": Flicker, "K": RandomWalk, "R": Ramp
}  # fmt: skip
_SHORT = ("Q", "N", "tau_N")  # terms of the shortest averaging times
_LOWEST, _HIGHEST = 0.03, 0.15  # frequency times averaging time between which terms pass over into measurement
_PEAK = 0.37  # the same product where the Allan variance of white noise is most sensitive
_ROUNDS = 20


def simulation_model(selection: Selection, clean: CleanSpectrum | None, curve: AllanCurve, dt: float) -> NoiseModel:
    """Noise model of one axis, without its lines.

    Parameters
    ----------
    chosen : Selection
    clean : CleanSpectrum or None
        None for a log too short for a spectrum: terms only.
    curve : AllanCurve
        Curve of the log, at averaging times from one sample on.
    dt : float
        Sampling interval. [s]

    Returns
    -------
    NoiseModel
        The terms where they describe every averaging time. Where the shortest were left out, a :class:`Coloured` term
        stands for Q, N and F: the measured density less that of the other terms above the frequency of the shortest
        averaging time fitted, the density of Q, N and F below. If there is a departure it stands for everything, and
        its density is brought to the measured Allan variances.
    """
    if clean is None or (selection.shortest == 1 and selection.departure == 0.0):
        return terms_of_fit(selection.fit, dt)
    if selection.departure > 0.0:
        return NoiseModel((_measured_noise(selection, clean, curve, dt),))
    f = _positive(clean.f)
    short = np.array([name in _SHORT for name in selection.fit.names])
    remainder = _density(selection.fit, ~short, dt, f)
    measured = np.maximum(clean.density - remainder, 0.05 * clean.density)
    density = _blend(f, measured, _density(selection.fit, short, dt, f), selection.shortest * dt)
    others = [term for name, term in _named_terms(selection.fit, dt) if name not in _SHORT]
    return NoiseModel((Coloured(clean.f, density, 1.0 / dt), *others))


def terms_of_fit(fit: Fit, dt: float) -> NoiseModel:
    """The terms of a fit as processes; N behind a filter as what it is at the sampling interval ``dt`` [s]."""
    return NoiseModel(tuple(term for _, term in _named_terms(fit, dt)))


def _named_terms(fit: Fit, dt: float) -> list[tuple[str, Process]]:
    value = dict(zip(fit.names, (float(v) for v in fit.values), strict=True))
    terms: list[tuple[str, Process]] = []
    for name, v in value.items():
        if name == "N" and "tau_N" in value:
            terms.append((name, GaussMarkov(filtered_sigma(v, value["tau_N"], dt), value["tau_N"])))
        elif name.startswith("sigma"):
            terms.append((name, GaussMarkov(v, value["tau" + name[5:]])))
        elif not name.startswith("tau"):
            terms.append((name, _PROCESSES[name](v)))
    return terms


def _density(fit: Fit, mask: np.ndarray, dt: float, f: FloatArray) -> FloatArray:
    names = tuple(name for name, yes in zip(fit.names, mask, strict=True) if yes)
    return spectrum(names, fit.values[mask], dt, f)


def _positive(f: FloatArray) -> FloatArray:
    """Frequencies at which every density exists: not zero, not half the rate."""
    f = np.maximum(f, 1e-3 * f[1])
    f[-1] *= 1.0 - 1e-9
    return f


def _blend(f: FloatArray, measured: FloatArray, terms: FloatArray, shortest: float) -> FloatArray:
    share = np.clip(np.log(f * shortest / _LOWEST) / np.log(_HIGHEST / _LOWEST), 0.0, 1.0)
    return np.asarray(share * measured + (1.0 - share) * terms)


def _measured_noise(selection: Selection, clean: CleanSpectrum, curve: AllanCurve, dt: float) -> Coloured:
    """The spectrum down to frequencies that the longest averaging time sees, by its Allan variances."""
    lowest = 0.1 / float(curve.tau[-1])
    below = np.geomspace(lowest, clean.f[1], 24 + int(12.0 * np.log2(max(clean.f[1] / lowest, 1.0))))
    f = np.concatenate(([0.0], below, clean.f[2:]))
    at = _positive(f)
    measured = np.interp(at, clean.f, clean.density)
    every = np.ones(len(selection.fit.names), dtype=bool)
    density = _blend(at, measured, _density(selection.fit, every, dt, at), selection.shortest * dt)
    density[0] = density[1]
    m = np.round(curve.tau / dt).astype(np.int64)
    target = np.maximum(curve.variance - _of_lines(clean.lines, m, dt), 0.05 * curve.variance)
    # integrals over a grid fine enough for every averaging time
    fine = np.unique(np.concatenate((np.geomspace(0.1 * lowest, 0.5 / dt * (1.0 - 1e-9), 4000), at)))
    weight = 2.0 * transfer(fine, m, dt) * np.gradient(fine)
    for _ in range(_ROUNDS):
        ratio = target / (weight @ np.interp(fine, f, density))
        place = np.log(_PEAK / curve.tau[::-1])
        density = density * np.exp(np.interp(np.log(at), place, np.log(ratio[::-1])))
    return Coloured(f, density, 1.0 / dt)


def _of_lines(lines: tuple[Line, ...], m: IntArray, dt: float) -> FloatArray:
    return sum((line.allan_variance(m, dt) for line in lines), np.zeros(len(m)))
