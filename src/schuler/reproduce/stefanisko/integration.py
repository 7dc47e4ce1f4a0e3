"""Sections 3.3, 4.6 to 4.8, 5 and appendix A: the fused solution, outages, tuning, scheduling, signs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, G0

if TYPE_CHECKING:
    from collections.abc import Callable

    from schuler.plotting.figure import Figure
    from schuler.reproduce.stefanisko.study.campaign import FigureEightResult
    from schuler.reproduce.stefanisko.study.experiment import FigureEight
    from schuler.reproduce.stefanisko.study.sign_sets import SignStudy

#: Of 40 runs of an independent simulation of section 4.6.
_BAND = 0.30
_SIMULATED = (
    "His curves have no numbers and his recordings no reference; numbers are those of an independent check, 40 runs "
    "of the filter with the signs mended, and its band of 30 percent. "
)
_CASES: dict[str, dict[str, Any]] = {
    "outage": {}, "no outage": {"outage_s": None, "duration_s": 92.0}, "at rest": {"moving": False},
    "at rest, no outage": {"moving": False, "outage_s": None, "duration_s": 92.0},
    "Q x 167": {"q_factor": 1.0 / 0.006, "duration_s": 92.0}, "Q / 100": {"q_factor": 0.01, "duration_s": 92.0},
    "biases wander": {"walk_b_a": 2e-4, "walk_b_g": 1e-3 * DEG, "duration_s": 92.0},
    "INS alone": {"gnss": False, "outage_s": None, "duration_s": 42.0},
    "every fix": {"update_s": 0.1, "duration_s": 92.0},
    "P0 / 100": {"p0_factor": 0.01, "duration_s": 92.0}, "R / 100": {"r_factor": 0.01, "duration_s": 92.0},
}  # fmt: skip
_POSITION, _VELOCITY = slice(6, 9), slice(3, 6)


def _case(name: str) -> FigureEight:
    from schuler.reproduce.stefanisko.study.experiment import FigureEight

    return replace(FigureEight(), **_CASES[name])


@cache
def _runs(effort: Effort, name: str) -> FigureEightResult:
    from schuler.reproduce.stefanisko.study.campaign import figure_eight

    return figure_eight(_case(name), effort.runs(40, 400), effort.seed)


def _against(name: str, printed: float, ours: float, unit: str) -> Cell:
    return against(name, printed, ours, relative=_BAND, unit=unit, reference="corrected", tolerance="band")


def _fused(effort: Effort) -> Outcome:
    """Figs. 4.12 to 4.15: with all fixes, moving and at rest."""
    from schuler.reproduce.stefanisko.study.experiment import SIGMA_POSITION, SIGMA_VELOCITY
    from schuler.reproduce.stefanisko.study.figures import fused_figure

    moving, rest = _runs(effort, "no outage"), _runs(effort, "at rest, no outage")
    cells: list[Cell] = []
    for what, result in (("moving", moving), ("at rest", rest)):
        late = np.arange(10.0, 91.0)
        position = max(result.position(t) for t in late) / float(np.linalg.norm(SIGMA_POSITION))
        velocity = max(result.velocity(t) for t in late) / float(np.linalg.norm(SIGMA_VELOCITY))
        peak = float(np.abs(result.errors[:, 10:, 6:9]).max(axis=(0, 1)).max() / (4.0 * SIGMA_POSITION.max()))
        cells += [
            claimed(
                f"{what}: position error over that of a fix, 10 to 90 s", "does not exceed GNSS", position, high=1.0
            ),
            claimed(
                f"{what}: velocity error over that of a fix",
                "does not exceed GNSS",
                velocity,
                high=1.05,
                tolerance="statistical",
            ),
            claimed(f"{what}: largest error over four sigma of a fix", "GNSS peaks are smoothed", peak, high=1.0),
        ]
    each = rest.rms(slice(9, 11), 50.0) / np.sqrt(2.0)
    case = rest.case
    tilted = G0 * case.sigma_tilt  # the sum of bias and tilt is seen at rest, nothing else
    parted = case.sigma_b_a * tilted / np.hypot(case.sigma_b_a, tilted)
    cells += [
        _against("moving: position, 50 s", 0.50, moving.position(50.0), "m"),
        _against("moving: position, 90 s", 0.39, moving.position(90.0), "m"),
        _against("moving: velocity, 90 s", 0.006, moving.velocity(90.0), "m/s"),
        _against("moving: heading, 90 s", 0.04, moving.heading(90.0) / DEG, "deg"),
        _against("at rest: position, 50 s", 0.50, rest.position(50.0), "m"),
        _against("at rest: heading, 50 s", 6.0, rest.heading(50.0) / DEG, "deg"),
        _against("moving: accelerometer bias, 50 s", 7e-4 * np.sqrt(3.0), moving.rms(slice(9, 12), 50.0), "m/s^2"),
        _against("at rest: accelerometer bias x, y, 50 s", 0.03, each, "m/s^2"),
        against(
            "the same, of what levelling leaves of bias and tilt",
            parted,
            each,
            unit="m/s^2",
            reference="corrected",
            relative=4.0 / np.sqrt(4.0 * len(rest.nis)),
            source="",
        ),
    ]
    figures: tuple[Callable[[], Figure], ...] = (
        partial(fused_figure, rest, "position", "Position error at rest", SIGMA_POSITION),
        *_fused_figures(moving, ", moving"),
    )
    return Outcome(
        tuple(cells),
        _SIMULATED
        + "Its 0.03 m/s^2 for what is left of the horizontal biases at rest is less than bias and tilt of its own "
        "initial sigmas leave, 0.043; ours is that.",
        figures,
    )


def _fused_figures(runs: FigureEightResult, when: str) -> tuple[Callable[[], Figure], ...]:
    """Errors of position, velocity, rotation and biases of one case."""
    from schuler.reproduce.stefanisko.study.experiment import SIGMA_POSITION, SIGMA_VELOCITY
    from schuler.reproduce.stefanisko.study.figures import fused_figure

    return (
        partial(fused_figure, runs, "position", f"Position error{when}", SIGMA_POSITION),
        partial(fused_figure, runs, "velocity", f"Velocity error{when}", SIGMA_VELOCITY),
        partial(fused_figure, runs, "rotation", f"Rotation error{when}"),
        partial(fused_figure, runs, "biases", f"Errors of the biases{when}"),
    )


def _outage(effort: Effort) -> Outcome:
    """Figs. 4.16 to 4.19: no GNSS from 50 to 90 s."""
    moving, rest, alone = _runs(effort, "outage"), _runs(effort, "at rest"), _runs(effort, "INS alone")
    cells: list[Cell] = [
        claimed(
            "position after 40 s without GNSS over INS alone",
            "less error than INS alone",
            moving.position(90.0) / alone.position(40.0),
            high=1.0,
        ),
        claimed(
            "position 3 s after the outage over its end",
            "GNSS corrects it",
            moving.position(93.0) / moving.position(90.0),
            high=1.0,
        ),
        _against("INS alone, 40 s", 120.0, alone.position(40.0), "m"),
    ]
    times = (50.0, 90.0, 93.0, 120.0)
    for t, p_moving, p_rest, v, h in zip(
        times,
        (0.50, 4.1, 1.1, 0.59),
        (0.50, 4.2, 0.98, 0.59),
        (0.006, 0.22, 0.006, 0.006),
        (0.05, 0.12, 0.09, 0.04),
        strict=True,
    ):
        cells += [
            _against(f"moving: position, {t:g} s", p_moving, moving.position(t), "m"),
            _against(f"at rest: position, {t:g} s", p_rest, rest.position(t), "m"),
            _against(f"moving: velocity, {t:g} s", v, moving.velocity(t), "m/s"),
            _against(f"moving: heading, {t:g} s", h, moving.heading(t) / DEG, "deg"),
        ]
    cells += [
        _against(f"at rest: heading, {t:g} s", h, rest.heading(t) / DEG, "deg")
        for t, h in zip(times, (6.0, 10.0, 10.0, 14.0), strict=True)
    ]
    cells += [_against(f"moving: error over claim, {t:g} s", 1.0, moving.ratio(t), "") for t in times]
    nees = float(np.mean(rest.nees[:, int(np.argmin(np.abs(rest.t - 90.0)))]))
    cells.append(shown("at rest: NEES, 90 s", nees))
    figures = _fused_figures(moving, " with an outage")
    return Outcome(
        tuple(cells),
        _SIMULATED
        + "At rest the heading is not observed and drifts by ten degrees, which makes the error at the end of "
        "the outage scatter more than a band of 30 percent for 40 runs allows.",
        figures,
    )


def _tuning(effort: Effort) -> Outcome:
    """Section 4.6: what too small and too large assumptions do."""
    true, small, large = _runs(effort, "outage"), _runs(effort, "Q / 100"), _runs(effort, "Q x 167")
    wander, start = _runs(effort, "biases wander"), _runs(effort, "P0 / 100")
    trusting = _runs(effort, "R / 100")
    k = int(np.argmin(np.abs(start.t - 5.0)))
    cells = (
        claimed(
            "P0 / 100, 5 s: error over claim of the biases",
            "true errors much larger than claimed",
            float(np.sqrt(np.mean(start.errors[:, k, 9:] ** 2 / start.variances[:, k, 9:]))),
            low=1.5,
        ),
        claimed("Q / 100: error over claim, 90 s", "true errors much larger than claimed", small.ratio(90.0), low=1.5),
        claimed("Q x 167: claim over error, 90 s", "uncertainties too large", 1.0 / large.ratio(90.0), low=1.5),
        claimed(
            "R / 100: error over claim, 50 s", "biased by the noise of the measurements", trusting.ratio(50.0), low=1.5
        ),
        claimed(
            "R / 100: error over that with the true R, 50 s",
            "biased by the noise of the measurements",
            trusting.position(50.0) / true.position(50.0),
            low=1.0,
        ),
        _against("Q x 167: error, 90 s", 8.6, large.position(90.0), "m"),
        _against("Q x 167: claim, 90 s", 52.0, large.claimed(_POSITION, 90.0), "m"),
        _against("Q / 100: error, 90 s", 4.6, small.position(90.0), "m"),
        _against("Q / 100: claim, 90 s", 0.8, small.claimed(_POSITION, 90.0), "m"),
        _against("biases wander in truth and filter: error, 90 s", 6.5, wander.position(90.0), "m"),
    )
    return Outcome(
        cells,
        _SIMULATED
        + "Q x 167 is the variance of a sample of 6 ms taken for a density (3.14). An R that is too small makes "
        "the filter over-confident, but with so little process noise its gain, and so its error, hardly depends on it.",
    )


def _scheduling(effort: Effort) -> Outcome:
    """Conclusion: updates where both samples coincide, every 0.3 s."""
    from schuler.reproduce.stefanisko.study.coincidence import common_interval

    few, every = _runs(effort, "outage"), _runs(effort, "every fix")
    runs = len(few.nis)
    cells = (
        against(
            "common interval of 6 ms and 0.1 s",
            0.3,
            common_interval(0.006, 0.1),
            absolute=1e-9,
            unit="s",
            tolerance="rounding",
        ),
        _against("every fix: position, 50 s", 0.31, every.position(50.0), "m"),
        _against("every fix: position, 90 s", 3.6, every.position(90.0), "m"),
        against(
            "position at 50 s, every third fix over every fix",
            np.sqrt(3.0),
            few.position(50.0) / every.position(50.0),
            relative=4.0 / np.sqrt(6.0 * runs),
            reference="corrected",
            source="",
        ),
    )
    return Outcome(cells, _SIMULATED + "Two of three fixes are thrown away; white errors average with a root of three.")


@cache
def _signs(effort: Effort) -> SignStudy:
    from schuler.reproduce.stefanisko.study.sign_sets import sign_study

    return sign_study(runs=effort.runs(2, 20), seed=effort.seed)


def _sign_sets(effort: Effort) -> Outcome:
    """(3.4) to (3.8) and (3.20) with the signs as printed, and with three sets that agree in themselves."""
    from schuler.reproduce.stefanisko.study.figures import sign_figure

    study, engine = _signs(effort), _runs(effort, "outage")
    a, printed, other = "A", "printed, biases added", "printed, biases subtracted"
    aided = (study.t >= 5.0) & (study.t <= 50.0)
    velocity = float(np.sqrt(np.mean(np.sum(study.errors[printed][:, aided, 3:6] ** 2, axis=2))))
    turned = study.errors[printed][:, aided, 6:9]
    apart = [float(np.abs(study.errors[a] - study.errors[name]).max()) for name in ("B", "C")]
    runs = len(study.errors[a])
    k = int(np.argmin(np.abs(engine.t - 90.0)))
    same = float(np.sqrt(np.mean(np.sum(engine.errors[:runs, k, 6:9] ** 2, axis=1))))
    cells = (
        claimed(
            "as printed: error over claim after the outage", "the filter works", study.ratio(printed, 90.0), high=1.3
        ),
        claimed(
            "A and B: largest difference",
            "the same filter",
            apart[0],
            high=1e-3,
            tolerance="rounding",
            reference="corrected",
        ),
        claimed(
            "A and C: largest difference",
            "the same filter",
            apart[1],
            high=1e-3,
            tolerance="rounding",
            reference="corrected",
        ),
        against(
            "A against our engine, same draws, 90 s",
            same,
            study.rms(a, slice(0, 3), 90.0),
            relative=0.01,
            unit="m",
            reference="corrected",
            tolerance="discretisation",
            source="",
        ),
        _against("as printed, biases added: aided velocity error", 9.0, velocity, "m/s"),
        _against(
            "as printed, biases added: attitude error",
            20.0,
            float(np.sqrt(np.mean(np.sum(turned**2, axis=2)))) / DEG,
            "deg",
        ),
        _against(
            "as printed, biases added: position after the outage", 8000.0, study.rms(printed, slice(0, 3), 90.0), "m"
        ),
        claimed(
            "biases subtracted over added, after the outage",
            "worse",
            study.rms(other, slice(0, 3), 90.0) / study.rms(printed, slice(0, 3), 90.0),
            low=1.0,
            reference="corrected",
        ),
    )
    return Outcome(
        cells,
        "F is of errors INS minus truth, the correction step of truth minus INS: tilt is fed back with the wrong "
        "sign and the filter diverges. The attitude error of ours grows to more than the check's 20 deg; once it "
        "has diverged its size is chance.",
        (partial(sign_figure, study),),
    )


ITEMS: tuple[Item, ...] = (
    Item("text-3.3", "signs of the filter as printed and mended", "statistical", _sign_sets),
    Item("text-4.6", "tuning: P0, Q, R too small and too large", "statistical", _tuning),
    Item("fig-4.12", "fused solution: position, velocity, rotation, biases", "hardware", _fused,
         ("fig-4.13", "fig-4.14", "fig-4.15", "fig-A.1", "fig-A.2")),
    Item("fig-4.16", "the same with GNSS lost from 50 to 90 s", "hardware", _outage,
         ("fig-4.17", "fig-4.18", "fig-4.19", "fig-A.3", "text-4.8")),
    Item("text-5", "updates where samples coincide", "statistical", _scheduling),
)  # fmt: skip
