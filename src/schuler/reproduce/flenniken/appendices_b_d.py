"""Appendices B and D: what Gauss-Markov processes and autocorrelations look like."""

from __future__ import annotations

from functools import cache
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation import autocorrelation
from schuler.reproduce.cells import against, claimed, digits, shown
from schuler.reproduce.flenniken.bands import ERRORS, deviation
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.noise import (
    AutoRegressive,
    GaussMarkov,
    White,
)
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.characterisation.correlation import Correlation
    from schuler.plotting.figure import Figure


_TAU, _DT = 100.0, 0.01


def markov_example(effort: Effort) -> Outcome:
    """Figures B.1 and B.2 (the autocorrelation)."""
    keep = 1.0 - _DT / _TAU
    drive = sqrt(2.0 / (_DT * _TAU))
    as_printed, sized, exact = (
        AutoRegressive((keep,), _DT * w, 1.0 / _DT)
        for w in (1.0, drive, sqrt(2.0 / (_DT * _TAU) - 1.0 / _TAU**2))
    )  # fmt: skip
    output = [sqrt(float(p.autocovariance(0.0))) for p in (as_printed, sized, exact)]
    n, runs = 2000, effort.runs(200, 1000)
    x = GaussMarkov(1.0, _TAU).sample((n, runs), _DT, np.random.default_rng([effort.seed, 3]))
    r = as_printed.autocovariance(np.array([0.0, _TAU]))
    cells = (
        against("deviation of the input, sqrt(2 sigma^2 / (Ts tau))", 1.0, drive, absolute=1e-9, tolerance="rounding"),
        shown("deviation of the output with an input of 1", output[0], printed="1.0125 in one run",
              why="the length of the run is not stated; 1000 s would scatter by 20 %"),
        digits("the same", "0.707", output[0], reference="corrected"),
        digits("input", "1.414", drive, reference="corrected"),
        against("deviation of the output with that input", 1.0, output[1], absolute=0.5 * _DT / _TAU,
                tolerance="discretisation", source="1"),
        against("deviation of the output, (B.9) with a minus", 1.0, output[2], absolute=1e-9, tolerance="rounding",
                reference="corrected", source="plus"),
        deviation("deviation of our generator, all samples' last", 1.0, float(x[-1].std(ddof=1)), runs,
                  reference="thesis", source="1"),
        against("autocorrelation at 100 s", float(np.exp(-1.0)), float(r[1] / r[0]), absolute=_DT / _TAU,
                tolerance="discretisation", source="time constant preserved"),
    )  # fmt: skip
    reason = (
        "sqrt(2) is printed as 1, with which Euler's rule gives 0.707; the reported 1.012 cannot be of these settings "
        "but by the scatter of one run, 20 % if it lasted 1000 s. (B.9) has a plus where (B.8) leads to a minus."
    )
    return Outcome(cells, reason, (lambda: _example_figure(effort),))


@cache
def _sweep(effort: Effort) -> dict[tuple[float, float, float], float]:
    """Deviation over 100 runs by rate, time constant and wanted deviation."""
    settings = [
        *((100.0, 100.0, 10.0**k) for k in range(-2, 3)),
        *((rate, 100.0, 1.0) for rate in (1.0, 10.0)),
        *((100.0, tau, 1.0) for tau in (1.0, 10.0, 1000.0)),
    ]
    streams = np.random.default_rng([effort.seed, 4]).spawn(len(settings))
    return {
        s: float(GaussMarkov(s[2], s[1]).sample((50, _SWEEP_RUNS), 1.0 / s[0], rng)[-1].std(ddof=1))
        for s, rng in zip(settings, streams, strict=True)
    }


_SWEEP_RUNS = 100


def markov_sweep(effort: Effort) -> Outcome:
    """Figure B.3, printed as a second B.2."""
    cells = tuple(
        deviation(f"{rate:g} Hz, time constant {tau:g} s, wanted {sigma:g}", sigma, deviations, _SWEEP_RUNS,
                  reference="thesis", source=f"{sigma:g}")
        for (rate, tau, sigma), deviations in _sweep(effort).items()
    )  # fmt: skip
    return Outcome(cells, "The settings are not printed; 100 runs as there.", (lambda: _sweep_figure(effort),))


def sine(effort: Effort) -> Outcome:
    """Figures D.1 and D.2."""
    r = _sine_correlation()
    at = {m: float(r.value[m]) for m in (0, 25, 50, 75, 100)}
    short = 100.0 / _SINE_N  # the biased estimator is lower by m / n
    cells = (
        against("second moment", 0.5, at[0], absolute=1e-9, tolerance="rounding", source="0.5"),
        against("size at lag 50", 0.5, abs(at[50]), absolute=short, tolerance="discretisation", source="highest"),
        against("size at lag 100", 0.5, abs(at[100]), absolute=short, tolerance="discretisation", source="highest"),
        against("size at lag 25", 0.0, abs(at[25]), absolute=short, tolerance="discretisation", source="lowest"),
        against("size at lag 75", 0.0, abs(at[75]), absolute=short, tolerance="discretisation", source="lowest"),
        against("phase at lag 25", 180.0, float(np.arccos(at[25] / at[0])) / DEG, absolute=0.5, unit="deg",
                tolerance="printed digits", source="180"),
        against("at lag 50", -0.5, at[50], absolute=short, tolerance="discretisation", reference="corrected",
                source=""),
    )  # fmt: skip
    reason = "By size the text is right; out of phase by 180 deg the sine is at lag 50, by 90 deg at 25 and 75."
    return Outcome(cells, reason, (_sine_figure, _sine_correlation_figure))


def random_series(effort: Effort) -> Outcome:
    """Figures D.3 and D.4."""
    n = effort.runs(20_000, 200_000)
    r = _random_correlation(effort)
    inside = np.abs(r.value[1:]) < 1.96 * r.sigma[1:]
    cells = (
        against("at lag zero, the second moment", 0.5, float(r.value[0]), absolute=ERRORS * float(r.sigma[0]),
                source="0.5"),
        against("mean of lags 1 to 100", 0.0, float(r.value[1:].mean()), absolute=ERRORS * 0.5 / sqrt(100.0 * n),
                source="about zero"),
        claimed("largest of lags 1 to 100 over lag zero", "about zero", float(np.abs(r.normalised[1:]).max()),
             high=5.0 / sqrt(n), tolerance="statistical"),
        shown("lags within 1.96 standard errors of zero", float(inside.mean())),
    )  # fmt: skip
    return Outcome(cells, "", (lambda: _random_figure(effort), lambda: _random_correlation_figure(effort)))


_SINE_N = 100_000


def _sine() -> FloatArray:
    return np.asarray(np.sin(2.0 * pi / 100.0 * np.arange(_SINE_N)))


@cache
def _sine_correlation() -> Correlation:
    return autocorrelation(_sine(), 1.0, longest_s=200.0)


def _random(effort: Effort) -> FloatArray:
    return White(sqrt(0.5)).sample(effort.runs(20_000, 200_000), 1.0, np.random.default_rng([effort.seed, 5]))


@cache
def _random_correlation(effort: Effort) -> Correlation:
    return autocorrelation(_random(effort), 1.0, longest_s=100.0)


def _example_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import series_figure

    x = GaussMarkov(1.0, _TAU).sample((100_000, 3), _DT, np.random.default_rng([effort.seed, 6]))
    t = np.asarray(_DT * np.arange(len(x)), dtype=np.float64)
    return series_figure(
        t, {f"run {k + 1}": x[:, k] for k in range(3)}, "time [s]", "output [-]", "A process of 100 s at 100 Hz"
    )


def _sweep_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import sweep_figure

    chosen = {s[2]: deviations for s, deviations in _sweep(effort).items() if s[:2] == (100.0, 100.0)}
    wanted, deviations = np.array(list(chosen)), np.array(list(chosen.values()))
    error = deviations / sqrt(2.0 * (_SWEEP_RUNS - 1))
    title = "Deviation of a Gauss-Markov process, 100 Hz, 100 s"
    return sweep_figure(wanted, {"100 runs": (deviations, error)}, "wanted [-]", "found [-]", title)


def _sine_figure() -> Figure:
    from schuler.reproduce.flenniken.study.figures import series_figure

    x = _sine()[100:]
    k = np.arange(200)
    shifted = {f"shifted by {m}": np.roll(x, m)[100:300] for m in (0, 25, 50)}
    return series_figure(k.astype(np.float64), shifted, "sample [-]", "value [-]", "A sine and the same shifted")


def _sine_correlation_figure() -> Figure:
    from schuler.reproduce.flenniken.study.figures import correlation_figure

    r = _sine_correlation()
    return correlation_figure({"sine": r}, {"cosine": (r.lag, np.cos(2.0 * pi * r.lag / 100.0))}, "lag [samples]")


def _random_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import series_figure

    x = _random(effort)
    shifted = {f"shifted by {m}": np.roll(x, m)[100:200] for m in (0, 1)}
    k = np.arange(100, dtype=np.float64)
    return series_figure(k, shifted, "sample [-]", "value [-]", "White noise and the same shifted")


def _random_correlation_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import correlation_figure

    return correlation_figure({"white noise": _random_correlation(effort)}, {}, "lag [samples]")


ITEMS = (
    Item("fig-B.1", "A Gauss-Markov process and its autocorrelation", "statistical", markov_example, ("fig-B.2",)),
    Item("fig-B.3", "Output of the process over rate, time constant and size", "statistical", markov_sweep),
    Item("fig-D.1", "A sine and its autocorrelation", "exact", sine, ("fig-D.2",)),
    Item("fig-D.3", "A white series and its autocorrelation", "statistical", random_series, ("fig-D.4",)),
)
