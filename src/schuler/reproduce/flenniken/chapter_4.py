"""Chapter 4: heading filters with fixes and without."""

from __future__ import annotations

from functools import cache
from math import exp, sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits, shown
from schuler.reproduce.flenniken.bands import ERRORS, deviation
from schuler.reproduce.flenniken.study.heading import (
    BiasTruth,
    gauss_markov_bias,
    heading_bound,
    heading_nees,
    heading_outages,
    position_filter,
    recorded_outage,
    split_bias,
)
from schuler.reproduce.flenniken.study.heading.outages import CONSTANT_SIGMA, FIX_SIGMA, PositionOutage, position_outage
from schuler.reproduce.flenniken.study.tables import AFTER_S, BOUND_DEG, OUTAGE_DEG, SIGMA_240_DEG
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.catalogue import spec
from schuler.units import DEG, G0

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.plotting.figure import Figure
    from schuler.reproduce.flenniken.study.heading import FilterRuns, HeadingBound, HeadingOutages

    Recorded = dict[str, tuple[FloatArray, FilterRuns]]

_FIXES = "The thesis prints neither deviation nor rate of its fixes: 0.2 deg each second meet both bounds it quotes."
#: Settled: within this of the final value.
_SETTLED = 0.05
_CONSUMER_OUTAGE_S, _CONSUMER_START_S = 240.0, 180.0


@cache
def _bound(grade: str, kind: str = "two") -> HeadingBound:
    g = spec(f"flenniken-{grade}").gyro
    N, sigma, tau = g.random_walk, g.in_run_bias, g.in_run_time
    if kind == "three":
        model = split_bias(N, sigma, tau, sigma_heading=FIX_SIGMA, sigma_constant=CONSTANT_SIGMA)
    else:
        wide = CONSTANT_SIGMA if kind == "wide" else None
        model = gauss_markov_bias(N, sigma, tau, sigma_heading=FIX_SIGMA, sigma_bias=wide)
    return heading_bound(model, FIX_SIGMA)


def _off(b: HeadingBound, seconds: float) -> float:
    """Relative distance of the bound from its final value."""
    return float(b.aided[int(np.argmin(np.abs(b.t - seconds)))] / b.steady_posterior - 1.0)


def bound(grade: str, seconds: float, effort: Effort) -> Outcome:
    """Figures 4.1 and 4.2."""
    (low, high), after, before = BOUND_DEG[grade]
    b = _bound(grade)
    claim = f"{low:g} to {high:g}"
    # the deviation of the fixes was chosen to meet both grades: with one number free, one of the two is a comparison
    free = grade == "consumer"
    cells = [
        shown(
            f"steady, {when} an update",
            value / DEG,
            unit="deg",
            printed=claim,
            why="the deviation of the fixes was chosen by it",
        )
        if free
        else claimed(f"steady, {when} an update", claim, value / DEG, low=low, high=high, unit="deg")
        for when, value in (("after", b.steady_posterior), ("before", b.steady_prior))
    ]
    cells += [
        claimed(f"off its final value at {seconds:g} s", f"steady at about {seconds:g} s", _off(b, seconds),
             low=-_SETTLED, high=_SETTLED),
        claimed(f"off its final value at {seconds / 2.0:g} s", f"steady at about {seconds:g} s", _off(b, seconds / 2.0),
             low=_SETTLED),
        claimed("free integration over filter at the end", "filter bounds the error", float(b.free[-1] / b.aided[-1]),
             low=1.0),
        digits("steady, after an update, to the check's digits", f"{after:g}", b.steady_posterior / DEG, unit="deg",
               reference="corrected"),
    ]  # fmt: skip
    if before is not None:
        cells.append(
            digits("steady, before an update, to the check's digits", f"{before:g}", b.steady_prior / DEG, unit="deg",
                   reference="corrected")
        )  # fmt: skip
    cells += [
        shown(
            "settled, bias known to its deviation",
            b.settled_s,
            unit="s",
            printed=f"about {seconds:g}",
            why="the two lines above compare it",
        ),
        shown("settled, bias known to 1 deg/s", _bound(grade, "wide").settled_s, unit="s"),
    ]
    reason = f"{_FIXES} They were chosen for that, so that the consumer bound is shown only. Settled is within 5 %." + (
        " The 700 s are not reproduced by any start of the bias: 143 to 311 s." if grade == "tactical" else ""
    )
    return Outcome(tuple(cells), reason, (lambda: _bound_figure(grade),))


def process_noise(effort: Effort) -> Outcome:
    """Equations (4.8) and (4.17)."""
    gyro, runs = spec("flenniken-consumer").gyro, effort.runs(500, 2000)
    error = ERRORS * sqrt(1.0 / runs)
    cells = [
        against("NEES over states, process noise corrected", 1.0,
                heading_nees(gyro, rate_hz=10.0, runs=runs, seed=effort.seed), absolute=error, reference="corrected",
                source="")
    ]  # fmt: skip
    for rate_hz, reading in ((10.0, "continuous"), (10.0, "sampled"), (100.0, "sampled")):
        nees = heading_nees(gyro, rate_hz=rate_hz, reading=reading, runs=runs, seed=effort.seed)
        cells.append(
            against(f"NEES over states, as printed and read as {reading}, {rate_hz:g} Hz", 1.0, nees, absolute=error,
                    source="(4.17)")
        )  # fmt: skip
    reason = (
        "The printed noise entry is divided by the root of the rate and the bias entry is that of samples: no reading "
        f"is consistent. diag(N^2, 2 sigma^2 / tau) as density is. {_FIXES}"
    )
    return Outcome(tuple(cells), reason)


@cache
def _consumer_log(effort: Effort) -> Recorded:
    g = spec("flenniken-consumer").gyro
    truth = BiasTruth(g.random_walk, g.in_run_bias, g.in_run_time)
    return recorded_outage(
        seed=effort.seed, truth=truth, start_s=_CONSUMER_START_S, outage_s=_CONSUMER_OUTAGE_S, rate_hz=10.0
    )


def _kept(run: FilterRuns, start_s: float, states: slice | int = 1) -> float:
    """Bias estimate at the end of an outage over that at its start, for the first log."""
    k = int(np.argmin(np.abs(run.t - start_s)))
    x = run.estimate[:, states, 0]
    return float(x[-1] / x[k])


def states(name: str, effort: Effort) -> Outcome:
    """Figures 4.3 and 4.4."""
    error, run = _consumer_log(effort)[name]
    tau = spec("flenniken-consumer").gyro.in_run_time
    left, claim = (1.0, "constant") if name == "constant, walking" else (
        exp(-_CONSUMER_OUTAGE_S / tau), "converges to zero"
    )  # fmt: skip
    k = int(np.argmin(np.abs(run.t - _CONSUMER_START_S)))
    cells = (
        against("bias estimate after 240 s of outage over that at its start", left, _kept(run, _CONSUMER_START_S),
                relative=1e-9, tolerance="rounding", source=claim),
        shown("1-sigma of heading at the start of the outage", float(run.sigma[k, 0]) / DEG, unit="deg"),
        shown("and at its end", float(run.sigma[-1, 0]) / DEG, unit="deg"),
        shown("heading error of this log at the end", float(error[-1]) / DEG, unit="deg"),
    )  # fmt: skip
    return Outcome(cells, _FIXES, (lambda: _log_figure(_consumer_log(effort), (name,), _CONSUMER_START_S),))


@cache
def _outages(effort: Effort) -> HeadingOutages:
    return heading_outages(spec("flenniken-consumer"), runs=effort.runs(800, 4000), seed=effort.seed)


def outage(truth: str, effort: Effort) -> Outcome:
    """Figures 4.5 and 4.6."""
    outages = _outages(effort)
    i = outages.truths.index(truth)
    worse, better = ("constant, asleep", "Gauss-Markov")[:: 1 if truth == "wandering" else -1]
    j, k = outages.filters.index(worse), outages.filters.index(better)
    error = ERRORS / sqrt(outages.runs)
    cells: list[Cell] = [
        claimed(f"{seconds:g} s: error of {worse} over {better}", "grows much faster",
             float(outages.at(seconds)[i, j] / outages.at(seconds)[i, k]), low=1.0 + error, tolerance="statistical")
        for seconds in (60.0, 120.0)
    ]  # fmt: skip
    matching = better
    m = outages.filters.index(matching)
    cells.append(
        deviation(f"240 s: error of {matching} over its own 1-sigma", 1.0,
                  float(outages.at(240.0)[i, m] / outages.sigma[m, -1]), outages.runs, source="differ, for 60 runs")
    )  # fmt: skip
    for name in outages.filters:
        n = outages.filters.index(name)
        for seconds in (60.0, 240.0):
            expected = OUTAGE_DEG[truth, name][AFTER_S.index(seconds)]
            half = 0.5 * 10.0 ** -len(f"{expected:g}".partition(".")[2]) / expected
            cells.append(
                deviation(f"{seconds:g} s: {name}", expected, float(outages.at(seconds)[i, n]) / DEG, outages.runs,
                          theirs=4000, unit="deg", also=half, source="curve")
            )  # fmt: skip
    cells += [
        digits(f"1-sigma that the filter claims at 240 s: {name}", f"{expected:g}",
               float(outages.sigma[outages.filters.index(name), -1]) / DEG, unit="deg", reference="corrected")
        for name, expected in SIGMA_240_DEG.items()
    ]  # fmt: skip
    wandering = (
        "The gap needs a constant bias without process noise, as the equation has it and the text warns of; with a "
        "walking bias it nearly vanishes. "
    )
    reason = (wandering if truth == "wandering" else "") + (
        "The thesis blames 60 runs for filter and runs disagreeing; these explain 9 %. With the process noise "
        "corrected they agree."
    )
    return Outcome(tuple(cells), reason, (lambda: _outage_figure(effort, truth),))


def three_states(effort: Effort) -> Outcome:
    """Figure 4.7."""
    two, three = _bound("consumer"), _bound("consumer", "three")

    def at(seconds: float) -> float:
        return float(three.aided[int(np.argmin(np.abs(three.t - seconds)))]) / DEG

    cells = (
        claimed("900 s: three states over two", "same threshold", float(three.aided[-1] / two.aided[-1]),
             low=1.0 - _SETTLED, high=1.0 + _SETTLED),
        claimed("1 s: three states over two", "extreme uncertainty at first", at(1.0) / (float(two.aided[0]) / DEG),
             low=1.0),
        claimed("900 s: free integration over three states", "keeps growing", float(three.free[-1] / three.aided[-1]),
             low=1.0),
        digits("two states, steady", "0.112", two.steady_posterior / DEG, unit="deg", reference="corrected"),
        digits("three states, 900 s", "0.112", at(900.0), unit="deg", reference="corrected"),
        digits("three states, 1 s", "0.196", at(1.0), unit="deg", reference="corrected"),
        digits("three states, 5 s", "0.148", at(5.0), unit="deg", reference="corrected"),
        digits("three states, 15 s", "0.115", at(15.0), unit="deg", reference="corrected"),
    )  # fmt: skip
    reason = f"{_FIXES} What is believed of the constant bias at first is not printed either: 1 deg/s."
    return Outcome(cells, reason, (lambda: _bound_figure("consumer", three=True),))


@cache
def _aqrs(effort: Effort) -> Recorded:
    return recorded_outage(seed=effort.seed, runs=effort.runs(200, 400), rate_hz=2.0)


def recorded(effort: Effort) -> Outcome:
    """Figures 4.8 to 4.10."""
    solutions = _aqrs(effort)
    rms = {name: float(np.sqrt(np.mean(run.estimate[-1, 0] ** 2))) / DEG for name, (_, run) in solutions.items()}
    runs = solutions["both"][1].estimate.shape[2]
    asleep, walking, markov, both = "constant, asleep", "constant, walking", "Gauss-Markov", "both"
    cells = (
        against(
            "constant bias: estimate at the end over that at the start",
            1.0,
            _kept(solutions[walking][1], 1800.0),
            relative=1e-9,
            tolerance="rounding",
            source="remains constant",
        ),
        against(
            "Gauss-Markov bias: the same",
            exp(-600.0 / 1171.0),
            _kept(solutions[markov][1], 1800.0),
            relative=1e-9,
            tolerance="rounding",
            source="converges to zero",
        ),
        against(
            "three states, moving part: the same",
            exp(-600.0 / 1171.0),
            _kept(solutions[both][1], 1800.0),
            relative=1e-9,
            tolerance="rounding",
            source="converges to zero",
        ),
        against(
            "three states, constant part: the same",
            1.0,
            _kept(solutions[both][1], 1800.0, 2),
            relative=1e-9,
            tolerance="rounding",
            source="remains constant",
        ),
        claimed(
            "600 s into the outage: error of Gauss-Markov over three states",
            "large errors",
            rms[markov] / rms[both],
            low=1.0 + ERRORS / sqrt(runs),
            tolerance="statistical",
        ),
        claimed(
            "error of constant bias, (4.8) as printed, over three states",
            "three states minimise the error",
            rms[asleep] / rms[both],
            low=1.0 + ERRORS / sqrt(runs),
            tolerance="statistical",
        ),
        claimed(
            "error of constant bias with process noise over three states",
            "three states minimise the error",
            rms[walking] / rms[both],
            low=1.0 - ERRORS / sqrt(runs),
            tolerance="statistical",
        ),
        *(shown(f"600 s: RMS of {name}", value, unit="deg") for name, value in rms.items()),
    )
    reason = (
        "The log is not public: these are of the noise found in it, about a mean of -0.15 deg/s, as the thesis only "
        "says that it is negative. A constant bias with process noise does nearly as well as three states, within the "
        f"scatter of the runs. {_FIXES}"
    )
    shown_ = (walking, markov, both)
    return Outcome(cells, reason, (lambda: _log_figure(solutions, shown_, 1800.0),))


@cache
def _position(effort: Effort) -> PositionOutage:
    truth = BiasTruth(0.003 * G0, 2.4e-3 * G0, 100.0, 0.01 * G0)
    return position_outage(truth, runs=effort.runs(300, 1000), seed=effort.seed)


def six_states(effort: Effort) -> Outcome:
    """Section 4.6."""
    position = _position(effort)
    runs = position.error.shape[2]
    last = int(np.searchsorted(position.run.t, position.start_s - 1e-6))
    model = position_filter(
        0.003 * G0, 2.4e-3 * G0, 100.0, 0.6, sigma_constant=0.2, sigma_velocity=0.05, sigma_position=1.0
    )
    rms = position.rms
    numbers = {
        "with fixes: velocity north": (0.029, rms[last, 0], "m/s", 0.0005),
        "with fixes: position north": (0.19, rms[last, 2], "m", 0.005),
        "with fixes: sum of the biases": (1.02e-3, rms[last, 4] / G0, "g", 0.005e-3),
        "60 s into the outage: velocity north": (0.78, rms[-1, 0], "m/s", 0.005),
        "60 s into the outage: position north": (21.3, rms[-1, 2], "m", 0.05),
    }
    cells = [
        claimed("states", "six (five in sections 4.7 and 8.1)", float(len(model.names)), low=6.0, high=6.0),
        claimed("rank of observability", "all estimated", float(model.observability_rank()), low=6.0),
        *(
            deviation(name, expected, float(ours), runs, theirs=500, unit=unit, also=half / expected)
            for name, (expected, ours, unit, half) in numbers.items()
        ),
        deviation("60 s: error over the filter's own 1-sigma, position", 1.0,
                  float(rms[-1, 2] / position.run.sigma[-1, 2]), runs),
    ]  # fmt: skip
    reason = (
        "The thesis prints no result for this filter: the numbers are those of an independent check (0.003 g/sqrt(Hz), "
        "2.4 mg over 100 s, constant 10 mg, heading 0.6 rad, fixes of 0.05 m/s and 1 m each second), its runs taken "
        "for 500."
    )
    return Outcome(tuple(cells), reason, (lambda: _position_figure(effort),))


def _bound_figure(grade: str, *, three: bool = False) -> Figure:
    from schuler.reproduce.flenniken.study.heading.figures import bound_figure

    return bound_figure(_bound(grade), {"three states": _bound(grade, "three")} if three else None)


def _log_figure(recorded: Recorded, names: tuple[str, ...], start_s: float) -> Figure:
    from schuler.reproduce.flenniken.study.heading.figures import recorded_figure

    return recorded_figure({name: recorded[name] for name in names}, start_s)


def _outage_figure(effort: Effort, truth: str) -> Figure:
    from dataclasses import replace

    from schuler.reproduce.flenniken.study.heading.figures import outage_figure

    outages = _outages(effort)
    i = outages.truths.index(truth)
    one = replace(outages, truths=(truth,), rms=outages.rms[i : i + 1])
    return outage_figure(one, ("Gauss-Markov", "constant, asleep"))


def _position_figure(effort: Effort) -> Figure:
    from schuler.reproduce.flenniken.study.heading.figures import position_figure

    return position_figure(_position(effort))


ITEMS = (
    Item("fig-4.1", "Consumer grade: heading with fixes and without", "exact", lambda e: bound("consumer", 15.0, e)),
    Item("fig-4.2", "Tactical grade: heading with fixes and without", "exact", lambda e: bound("tactical", 700.0, e)),
    Item("text-4.2", "Process noise as printed and as it is to be", "statistical", process_noise),
    Item("fig-4.3", "States in an outage, bias as Gauss-Markov", "statistical", lambda e: states("Gauss-Markov", e)),
    Item("fig-4.4", "States in an outage, bias as constant", "statistical", lambda e: states("constant, walking", e)),
    Item("fig-4.5", "Outage, true bias wandering: both bias models", "statistical", lambda e: outage("wandering", e)),
    Item("fig-4.6", "Outage, true bias 1 deg/s: both bias models", "statistical", lambda e: outage("constant", e)),
    Item("fig-4.7", "Three states beside two and free integration", "exact", three_states),
    Item("fig-4.8", "AQRS-104 in an outage: three filters", "hardware", recorded, ("fig-4.9", "fig-4.10")),
    Item("text-4.6", "Position with six states", "statistical", six_states),
)  # fmt: skip
