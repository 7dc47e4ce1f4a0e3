"""Section 4.1: tests at rest, conventional and rotating about the vertical, emulated."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, over_settings, shown
from schuler.reproduce.du.bands import ERRORS, against_rms, below, emulated, interruptible, period
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.plotting.figure import Figure
    from schuler.reproduce.du.study.static import StaticTest

#: Rates of the runs that the thesis shows over time. [deg/s]
SHOWN_DEG_S = {"NAV440": 30.0, "MTi-G": 10.0}
#: Latitude, longitude [m]; north, east [m/s]: components that the thesis prints.
_COMPONENTS = {"MTi-G": ("2412.3, 1526.8", "33.2, 20.5"), "NAV440": ("829.1, 2820.1", "4.8, 26.7")}
_LABELS = ("horizontal position", "horizontal velocity", "height", "vertical velocity", "roll", "pitch", "azimuth")
_UNITS = (("m", 1.0), ("m/s", 1.0), ("m", 1.0), ("m/s", 1.0), ("deg", DEG), ("deg", DEG), ("deg", DEG))
_DIGITS = (0.1, 0.1, 0.1, 0.1, 0.01, 0.01, 0.01)
_EMULATED = "Recorded by the thesis's own units, one run each: emulated with parameters that give its results. "
_ORDER = " The thesis's text names figures 4.4 and 4.5 in the wrong order."
_NO_DRIFT = (
    "The rotating emulation has no drift in the run, as the independent one it is compared with; that of table 4.4 has."
)
_DRIFT = (
    "The drift in the run is not stated: {:g} deg/h of 1/f noise are taken, those of the filters of chapters 5 and 6, "
    "and bands are wider by what 0 to {:g} deg/h change. "
)


@cache
def campaign_at_rest(imu: str, effort: Effort) -> StaticTest:
    """The campaign that all items of an IMU share."""
    from schuler.reproduce.du.study.imus import emulation
    from schuler.reproduce.du.study.static import static_test

    # white noise does not care for the sampling
    unit = emulation(imu, rate_hz=10.0 if effort.quick else None)
    with interruptible():
        test = static_test(unit, runs=effort.runs(30, 200), seed=effort.seed, workers=1 if effort.quick else None)
    if not test.complete:
        raise KeyboardInterrupt
    return test


@cache
def conventional_at_rest(imu: str, effort: Effort) -> tuple[FloatArray, ...]:
    """The conventional runs, one array for every drift of :data:`DRIFT_DEG_HR`."""
    from schuler.montecarlo.engine import campaign
    from schuler.reproduce.du.study.imus import DRIFT_DEG_HR, emulation
    from schuler.reproduce.du.study.trial import Trial, trial_run

    tests = []
    for drift in DRIFT_DEG_HR[imu]:
        trial = Trial(imu=emulation(imu, rate_hz=5.0, instability_deg_hr=drift))
        done = campaign(trial_run, trial, effort.runs(30, 200), seed=effort.seed, workers=1, keep=True)
        if not done.complete:
            raise KeyboardInterrupt
        tests.append(done.column("conventional"))
    return tuple(tests)


def _of(test: StaticTest, values: FloatArray, k: int) -> FloatArray:
    return np.asarray(values[..., k] / _UNITS[k][1])


def _conventional(imu: str, effort: Effort) -> Outcome:
    from schuler.reproduce.du.study.imus import DRIFT_DEG_HR
    from schuler.reproduce.du.study.tables import EMULATED, STATIC_CONVENTIONAL

    test, (runs, *others) = campaign_at_rest(imu, effort), conventional_at_rest(imu, effort)
    taken, *_ = DRIFT_DEG_HR[imu]
    settings = f"drift of 0 to {max(DRIFT_DEG_HR[imu]):g} deg/h"

    def over(cell: Cell, value: Callable[[FloatArray], float]) -> Cell:
        return over_settings(cell, [value(x) for x in others], settings)

    cells: list[Cell] = []
    for k, printed in enumerate(STATIC_CONVENTIONAL[imu]):
        source = f"{printed:g} of {_COMPONENTS[imu][k]}" if k < 2 else None
        cell = against_rms(
            _LABELS[k], printed, _of(test, runs, k), unit=_UNITS[k][0], digit=_DIGITS[k], source=source
        )  # fmt: skip
        cells.append(over(cell, lambda x, k=k: float(_of(test, x, k).mean())))  # type: ignore[misc]
    # one run is a weak witness of an angle, but of three together
    together = float(np.sqrt(np.mean(np.square(STATIC_CONVENTIONAL[imu][4:]))))
    cell = against_rms("roll, pitch and azimuth together, RMS", together, _together(runs), unit="deg", digit=0.01,
                       source=f"{together:.2f} of three")  # fmt: skip
    cells.append(over(cell, lambda x: float(_together(x).mean())))
    for k, ends in enumerate(EMULATED[imu, "conventional", 0.0]):
        cells.append(
            emulated(
                f"{_LABELS[k]}, emulation without drift", *ends, _of(test, test.conventional, k), unit=_UNITS[k][0]
            )
        )
    reason = _EMULATED + _DRIFT.format(taken, max(DRIFT_DEG_HR[imu])) + (
        "Height and vertical velocity follow the accelerometer bias along the vertical, which is that of another test "
        "(chapter 5). "
    )  # fmt: skip
    return Outcome(tuple(cells), reason, (lambda: _run_figure(imu, "conventional", effort),))


def _together(runs: FloatArray) -> FloatArray:
    """Roll, pitch and azimuth of every run as one RMS. [deg]"""
    return np.asarray(np.sqrt(np.mean((runs[:, 4:] / DEG) ** 2, axis=1)))


def _run_figure(imu: str, strategy: str, effort: Effort) -> Figure:
    from schuler.reproduce.du.study.figures import history_figure

    test, rate = campaign_at_rest(imu, effort), SHOWN_DEG_S[imu]
    runs = test.histories(rate * DEG)
    wanted = ("conventional",) if strategy == "conventional" else ("conventional", strategy)
    return history_figure(
        {name: runs[name] for name in wanted},
        f"{imu} at rest" + ("" if strategy == "conventional" else f", {rate:g} deg/s, strategy {strategy}"),
        random_walk=test.imu.gyro_random_walk,
    )


def _series(imu: str, strategy: str, effort: Effort) -> Outcome:
    """One run over time: swings have the period of the rotation, and strategy II takes most of them off."""
    from schuler.reproduce.du.study.metrics import swing_period, swing_size

    rate = SHOWN_DEG_S[imu]
    turn = 360.0 / rate
    test = campaign_at_rest(imu, effort)
    cells: list[Cell] = []
    ratios = []
    for run in range(effort.runs(4, 20)):
        h = test.histories(rate * DEG, run)
        if run == 0:
            swinging = h[strategy]
            if strategy == "I":
                cells += [period(f"{name}: period", turn, swinging.t, swinging.attitude[:, k])
                          for k, name in enumerate(("pitch", "roll"))]  # fmt: skip
            else:
                cells += [shown(f"{name}: strongest period", swing_period(swinging.t, swinging.attitude[:, k]),
                                unit="s", printed="the period of the rotation")
                          for k, name in enumerate(("pitch", "roll"))]  # fmt: skip
            if imu == "NAV440":
                cells += [period(f"velocity {name}: period", turn, swinging.t, swinging.velocity[:, k])
                          for k, name in enumerate(("east", "north"))]  # fmt: skip
        first, second = (
            float(np.linalg.norm([swing_size(h[s].t, h[s].attitude[:, k], turn) for k in range(2)]))
            for s in ("I", "II")
        )
        ratios.append(second / first)
    reason = _EMULATED + "One run, so no size of the curves is compared."
    if strategy == "II":
        reason += (
            " What the calibration leaves of the biases swings less than the noise of the gyroscopes wanders in the "
            "emulation, which has no drift in the run."
        )
        cells.append(below("swing of roll and pitch, strategy II over I", "greatly reduced", ratios, 0.5))
    return Outcome(
        tuple(cells),
        reason + (_ORDER if (imu, strategy) == ("NAV440", "I") else ""),
        (lambda: _run_figure(imu, strategy, effort),),
    )


def _rates_figure(imu: str, strategy: str, effort: Effort) -> Figure:
    from schuler.reproduce.du.study.figures import rates_figure

    return rates_figure(campaign_at_rest(imu, effort), (strategy,))


def _sweep_one(imu: str, effort: Effort) -> Outcome:
    """Strategy I against the rate."""
    from schuler.reproduce.du.study.tables import EMULATED, STATIC_ROTARY

    test = campaign_at_rest(imu, effort)
    cells: list[Cell] = []
    for k, printed in enumerate(STATIC_ROTARY[imu, "I"]):
        mean = float(_of(test, test.case("I"), k).mean())
        cells.append(
            shown(
                f"mean over the rates: {_LABELS[k]}",
                mean,
                unit=_UNITS[k][0],
                printed=f"{printed:g}",
                why="cross-couplings were fitted to it",
            )
        )
    for rate in (10.0, 100.0):
        for k, ends in enumerate(EMULATED[imu, "I", rate]):
            cells.append(
                emulated(f"{_LABELS[k]}, {rate:g} deg/s", *ends, _of(test, test.case("I", rate * DEG), k),
                         unit=_UNITS[k][0])
            )  # fmt: skip
    cells += _reduced(test, "I", (0, 1, 4, 5))
    x = test.rates / DEG
    azimuth = np.array([_of(test, values, 6).mean() for values in test.rotary["I"]])
    line = np.polyval(np.polyfit(x, azimuth, 1), x)
    straight = 1.0 - float(np.sum((azimuth - line) ** 2) / np.sum((azimuth - azimuth.mean()) ** 2))
    cells.append(claimed("azimuth against the rate: R squared of a line", "almost linear", straight, low=0.95))
    return Outcome(
        tuple(cells),
        _EMULATED + "Cross-couplings were fitted to the difference of strategies I and II, so the means "
        "agree by construction and are not compared. " + (_NO_DRIFT if imu == "NAV440" else ""),
        (lambda: _rates_figure(imu, "I", effort),),
    )


def _reduced(test: StaticTest, strategy: str, which: tuple[int, ...]) -> list[Cell]:
    """Ratios of means, rotating over conventional, with their bootstrap error."""
    from schuler.reproduce.du.study.metrics import QUANTITIES

    cells = []
    for k in which:
        gain = test.improvement(strategy, quantity=QUANTITIES[k])
        error = (1.0 / gain.low - 1.0 / gain.high) / 3.92
        cells.append(
            claimed(f"{_LABELS[k]}, rotating over conventional", "reduced", 1.0 / gain.ratio, high=1.0 + ERRORS * error,
                 tolerance="statistical")
        )  # fmt: skip
    return cells


def _sweep_two(imu: str, effort: Effort) -> Outcome:
    """Strategy II against the rate."""
    from schuler.reproduce.du.study.tables import EMULATED, RATES_DEG_S, STATIC_ROTARY

    test = campaign_at_rest(imu, effort)
    cells: list[Cell] = []
    for k, printed in enumerate(STATIC_ROTARY[imu, "II"]):
        # one run of the thesis at each rate; ours share their noise between the rates, so theirs scatter is a run's
        single = np.concatenate([_of(test, v, k) - _of(test, v, k).mean() for v in test.rotary["II"]])
        mean = _of(test, test.case("II"), k)
        half = ERRORS * float(np.sqrt(np.var(single) / len(RATES_DEG_S) + np.var(mean, ddof=1) / len(mean)))
        cells.append(
            against(f"mean over the rates: {_LABELS[k]}", printed, float(mean.mean()), absolute=half, unit=_UNITS[k][0])
        )
    for rate in (10.0, 20.0, 50.0, 100.0):
        for k, ends in enumerate(EMULATED[imu, "II", rate]):
            cells.append(
                emulated(f"{_LABELS[k]}, {rate:g} deg/s", *ends, _of(test, test.case("II", rate * DEG), k),
                         unit=_UNITS[k][0])
            )  # fmt: skip
    cells += _reduced(test, "II", (0, 1, 4, 5))
    azimuth = _of(test, test.rotary["II"], 6).mean(axis=0) / _of(test, test.rotary["I"], 6).mean(axis=0)
    cells.append(below("azimuth, strategy II over I", "significantly reduced", azimuth, 0.5))
    cells += _by_rate(test, imu)
    return Outcome(tuple(cells), _reason_two(imu), (lambda: _rates_figure(imu, "II", effort),))


def _reason_two(imu: str) -> str:
    if imu == "NAV440":
        return _EMULATED + _NO_DRIFT
    return _EMULATED + (
        "What strategy II leaves of MTi-G is the white noise of 3 deg/sqrt(h), 1722 m and 18 m/s root mean square, "
        "which no rotation lowers; the thesis's ten runs lie below it."
    )


def _by_rate(test: StaticTest, imu: str) -> list[Cell]:
    """Whether the rate matters: slowest over fastest."""
    slow, fast = (_of(test, test.case("II", rate * DEG), 0) for rate in (10.0, 100.0))
    ratio = slow / fast
    error = ERRORS * float(np.std(ratio, ddof=1)) / float(np.sqrt(len(ratio)))
    slow_over_fast, name = float(slow.mean() / fast.mean()), "horizontal position, 10 over 100 deg/s"
    if imu == "NAV440":
        return [claimed(name, "higher rates make errors smaller", slow_over_fast, low=1.0, tolerance="band")]
    return [claimed(name, "not strongly related to the rate", slow_over_fast, low=0.9 - error, high=1.1 + error,
                 tolerance="statistical")]  # fmt: skip


def _more(imu: str, effort: Effort) -> Outcome:
    """Two more series with strategy II: other seeds, and the rate that is recommended."""
    from schuler.reproduce.du.study.tables import RECOMMENDED_DEG_S, STATIC_ROTARY

    test = campaign_at_rest(imu, effort)
    choice = test.recommended_rate()
    cells = [
        against("recommended rate", RECOMMENDED_DEG_S[imu], choice.rate / DEG, absolute=0.5, unit="deg/s",
                tolerance="printed digits"),
        shown("share of resampled campaigns with the same rate", choice.confidence),
        *_by_rate(test, imu),
    ]  # fmt: skip
    half = len(test.conventional) // 2
    for number, part in enumerate((slice(0, half), slice(half, None)), start=1):
        for k in (0, 1):
            mean = float(_of(test, test.rotary["II"][:, part], k).mean())
            cells.append(shown(f"series {number}, mean over the rates: {_LABELS[k]}", mean, unit=_UNITS[k][0],
                               printed=f"first series: {STATIC_ROTARY[imu, 'II'][k]:g}",
                               why="the numbers of these series are not printed"))  # fmt: skip
    return Outcome(
        tuple(cells),
        _EMULATED
        + "Curves of two more series without numbers; here the runs in two halves. Ours recommends the slowest "
        "rate whose mean is at most 10 % above that of all faster ones; the thesis chose by eye.",
        (lambda: _rates_figure(imu, "II", effort),),
    )


def _item(what: str, first: str, title: str, run: Callable[[str, Effort], Outcome], imu: str, *also: str) -> Item:
    return Item(f"{what}-{first}", f"{imu} at rest: {title}", "hardware", lambda e: run(imu, e),
                tuple(f"fig-{a}" for a in also))  # fmt: skip


def _one(imu: str, effort: Effort) -> Outcome:
    return _series(imu, "I", effort)


def _two(imu: str, effort: Effort) -> Outcome:
    return _series(imu, "II", effort)


ITEMS = (
    _item("table", "4.3", "conventional", _conventional, "MTi-G"),
    _item("table", "4.4", "conventional", _conventional, "NAV440"),
    _item("fig", "4.4", "one run at 30 deg/s, strategy I", _one, "NAV440", "4.5"),
    _item("fig", "4.6", "against the rate, strategy I", _sweep_one, "NAV440", "4.7"),
    _item("fig", "4.8", "one run at 30 deg/s, strategy II", _two, "NAV440", "4.9"),
    _item("fig", "4.10", "against the rate, strategy II", _sweep_two, "NAV440", "4.11"),
    _item("fig", "4.12", "one run at 10 deg/s, strategy I", _one, "MTi-G", "4.13"),
    _item("fig", "4.14", "against the rate, strategy I", _sweep_one, "MTi-G", "4.15"),
    _item("fig", "4.16", "one run at 10 deg/s, strategy II", _two, "MTi-G", "4.17"),
    _item("fig", "4.18", "against the rate, strategy II", _sweep_two, "MTi-G", "4.19"),
    _item("fig", "4.20", "more series, recommended rate", _more, "MTi-G", "4.21"),
    _item("fig", "4.22", "more series, recommended rate", _more, "NAV440", "4.23"),
)
