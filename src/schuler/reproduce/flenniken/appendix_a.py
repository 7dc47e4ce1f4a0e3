"""Appendix A: what Allan charts look like."""

from __future__ import annotations

from functools import cache
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits
from schuler.reproduce.flenniken.bands import ERRORS
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.noise import (
    Flicker,
    GaussMarkov,
    Process,
    Quantisation,
    Ramp,
    RandomWalk,
    Sinusoid,
    White,
)

if TYPE_CHECKING:
    from schuler.characterisation import AllanCurve
    from schuler.plotting.figure import Figure

_RATE_HZ = 100.0
_VARIANCES = tuple(10.0**k for k in range(-6, 7, 2))
_TIMES = tuple(10.0**k for k in range(-2, 5))


@cache
def _white_curves(effort: Effort) -> dict[str, AllanCurve]:
    from schuler.characterisation import allan_deviation

    n = effort.runs(200_000, 1_000_000)
    curves = {}
    for variance, child in zip(_VARIANCES, np.random.default_rng([effort.seed, 1]).spawn(len(_VARIANCES)), strict=True):
        x = White(sqrt(variance / _RATE_HZ)).sample(n, 1.0 / _RATE_HZ, child)
        curves[f"{variance:g}"] = allan_deviation(
            x, _RATE_HZ, taus=np.geomspace(1.0, n / _RATE_HZ / 10.0, 13), noise=0.0
        )
    return curves


def white_charts(effort: Effort) -> Outcome:
    """Figure A.1."""
    cells = tuple(
        against(f"variance {name}: Allan deviation at 1 s", sqrt(float(name) / _RATE_HZ), float(c.deviation[0]),
                relative=ERRORS * 0.5 * float(c.relative_sigma[0]), source="sigma / sqrt(100 Hz)")
        for name, c in _white_curves(effort).items()
    )  # fmt: skip
    reason = "(A.6) names the deviation a variance; the chart shows deviations."
    return Outcome(cells, reason, (lambda: _white_figure(effort),))


@cache
def _markov_curves(effort: Effort) -> dict[float, AllanCurve]:
    from schuler.characterisation import allan_deviation

    n = effort.runs(200_000, 1_000_000)
    curves = {}
    for tau, child in zip(_TIMES, np.random.default_rng([effort.seed, 2]).spawn(len(_TIMES)), strict=True):
        process = GaussMarkov(1.0, tau)
        x = process.sample(n, 1.0 / _RATE_HZ, child)
        curves[tau] = allan_deviation(x, _RATE_HZ, taus=np.geomspace(0.04, n / _RATE_HZ / 10.0, 14), noise=process)
    return curves


def markov_charts(effort: Effort) -> Outcome:
    """Figure A.2."""
    cells: list[Cell] = []
    for tau, c in _markov_curves(effort).items():
        expected = np.sqrt(GaussMarkov(1.0, tau).discrete_allan_variance(np.round(c.tau * _RATE_HZ), 1.0 / _RATE_HZ))
        certain = c.relative_sigma < 0.3  # from some twenty degrees of freedom on
        k = int(np.argmin(np.abs(np.log(c.tau[certain] / (1.893 * tau)))))  # nearest to its maximum
        cells.append(
            against(f"time constant {tau:g} s: Allan deviation at {c.tau[k]:.3g} s", float(expected[k]),
                    float(c.deviation[k]), relative=ERRORS * 0.5 * float(c.relative_sigma[k]), reference="corrected",
                    source="curve")
        )  # fmt: skip
    slow, fast = GaussMarkov(1.0, _TIMES[-1]), GaussMarkov(1.0, _TIMES[0])
    t = np.linspace(1.5, 2.5, 10_001)
    peak = np.sqrt(GaussMarkov(1.0, 1.0).allan_variance(t))
    cells += [
        # nearer to the slope stated than to its neighbours in Table A.1
        claimed("slope at 1 s, time constant 1e4 s", "+1/2", _slope(slow, 1.0), low=0.25, high=0.75),
        claimed("slope at 1 s, time constant 0.01 s", "downwards, as white noise", _slope(fast, 1.0), low=-0.75,
             high=-0.25),
        digits("maximum over sigma", "0.6174", float(peak.max()), reference="corrected"),
        digits("averaging time of the maximum over the time constant", "1.893", float(t[peak.argmax()]),
               reference="corrected"),
    ]  # fmt: skip
    return Outcome(tuple(cells), "", (lambda: _markov_figure(effort),))


def slopes(effort: Effort) -> Outcome:
    """Table A.1."""
    rows: tuple[tuple[str, Process, float, float], ...] = (
        ("wide-band noise", White(1.0), 1.0, -0.5),
        ("Gauss-Markov, well below its time constant", GaussMarkov(1.0, 1e6), 1.0, 0.5),
        ("rate random walk", RandomWalk(1.0), 1.0, 0.5),
        ("linear ramp", Ramp(1.0), 1.0, 1.0),
        ("quantisation", Quantisation(1.0), 1.0, -1.0),
        ("sinusoid, well below its period", Sinusoid(1.0, 1e-4), 1.0, 1.0),
        ("flicker", Flicker(1.0), 1.0, 0.0),
    )
    cells = [
        against(name, printed, _slope(process, at), absolute=1e-4, tolerance="discretisation", source=f"{printed:g}")
        for name, process, at, printed in rows
    ]
    cells += [
        against("Gauss-Markov, well above its time constant", -0.5, _slope(GaussMarkov(1.0, 1e-6), 1.0), absolute=1e-4,
                tolerance="discretisation", reference="corrected", source="0.5"),
        # peaks of the lobes at odd halves of a period
        against("sinusoid, its lobes", -1.0, _lobes(), absolute=1e-4, tolerance="discretisation",
                reference="corrected", source="1"),
    ]  # fmt: skip
    reason = "Gauss-Markov and sinusoid have the printed slope only left of their maximum; beyond it they fall."
    return Outcome(tuple(cells), reason)


def _slope(process: Process, at: float) -> float:
    """Slope of the logarithm of the Allan deviation."""
    t = at * np.array([1.0 - 1e-3, 1.0 + 1e-3])
    low, high = 0.5 * np.log(process.allan_variance(t))
    return float((high - low) / np.log(t[1] / t[0]))


def _lobes() -> float:
    first, later = Sinusoid(1.0, 1.0).allan_variance(np.array([10.5, 20.5]))
    return float(0.5 * np.log(later / first) / np.log(20.5 / 10.5))


def _white_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import allan_figure

    curves = _white_curves(effort)
    models = [(c.tau, sqrt(float(name) / _RATE_HZ) / np.sqrt(c.tau)) for name, c in curves.items()]
    named = {f"variance {name}": c for name, c in curves.items()}
    return allan_figure(named, models, "-", model="sigma / sqrt(100 Hz tau)")


def _markov_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.figures import allan_figure

    curves = _markov_curves(effort)
    models = [(c.tau, np.sqrt(GaussMarkov(1.0, tau).allan_variance(c.tau))) for tau, c in curves.items()]
    return allan_figure({f"time constant {tau:g} s": c for tau, c in curves.items()}, models, "-", model="formula")


ITEMS = (
    Item("fig-A.1", "Allan charts of seven white series", "statistical", white_charts),
    Item("fig-A.2", "Allan charts of Gauss-Markov processes", "statistical", markov_charts),
    Item("table-A.1", "Slopes of the Allan chart by kind of error", "exact", slopes),
)
