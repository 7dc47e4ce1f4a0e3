"""Chapter 4: the simulated calibrations, Tables 4.1 to 4.5, Figs. 4.2 and 4.3, and what the text says of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import PPM

if TYPE_CHECKING:
    from schuler.reproduce.hayal.study.multiposition import StudyResult

_NO_ATTITUDES = (
    "The thesis has one draw and does not say which attitudes it chose or how they are offset, so its uncertainties "
    "are held to the factor of 1.7 that an independent check gave for it."
)


#: Section 4.4: uncertainties of an independent program's runs. Bias in rad/s or m/s^2; ppm and urad.
_PROTOTYPE = {
    ("4.2", 1): (3.35e-9, 4.23e-9, 3.72e-9), ("4.2", 2): (0.85e-6, 1.06e-6, 0.94e-6),
    ("4.2", 3): (3.35e-5, 4.23e-5, 3.72e-5), ("4.3", 2): (1.18e-6, 1.11e-6, 0.97e-6, 1.99e4, 2.17e4, 1.74e4),
    ("4.3", 3): (1.48e-5, 1.39e-5, 1.22e-5, 25.0, 27.2, 21.8),
    ("4.4", 2): (1.30e-6, 1.41e-6, 1.34e-6, 2.17e4, 2.22e4, 1.89e4, 3.61e4, 4.08e4, 3.61e4),
    ("4.4", 3): (1.29e-6, 1.40e-6, 1.33e-6, 2.15, 2.20, 1.87, 3.60, 4.09, 3.60),
    ("4.5", 2): (0.92e-4,) * 3 + (14.1,) * 3 + (20.1,) * 3,
}  # fmt: skip


_BAND = 1.7


_RUNS = (40, 400)


@cache
def _study(effort: Effort, table: str, case: int) -> StudyResult:
    from schuler.reproduce.hayal.study.multiposition import run_case
    from schuler.reproduce.hayal.study.tables import table_case

    key = (effort.seed, int(table.replace(".", "")), case)
    return run_case(table_case(table, case), effort.runs(*_RUNS), np.random.default_rng(key))


def _inserted(effort: Effort) -> Outcome:
    from schuler.reproduce.hayal.study.multiposition import TRUTH
    from schuler.sensors import catalogue

    cells = []
    for sensor, bias, scale in (("gyro", "4.848e-6", "150"), ("accel", "0.01", "300")):
        unit = "rad/s" if sensor == "gyro" else "m/s^2"
        for k, axis in enumerate("xyz"):
            cells += [
                digits(f"{sensor}: b_{axis}", bias, TRUTH[sensor][k], unit=unit),
                digits(f"{sensor}: s_{axis}", scale, TRUTH[sensor][3 + k] / PPM, unit="ppm"),
            ]
        cells += [
            digits(f"{sensor}: theta_{a}", "100", TRUTH[sensor][6 + k] / 1e-6, unit="urad")
            for k, a in enumerate(("yz", "zx", "zy"))
        ]
    one_degree = catalogue.spec("HG1700").gyro.turn_on_bias
    cells.append(digits("1 deg/h of the data sheet", "4.848e-6", one_degree, unit="rad/s"))
    return Outcome(transcribed(*cells))


def _table(table: str, effort: Effort) -> Outcome:
    """One of Tables 4.2 to 4.5: uncertainties and errors of the single draw beside the distribution of ours."""
    from schuler.reproduce.hayal.study.figures import sigma_figure
    from schuler.reproduce.hayal.study.tables import printed_rows

    cells: list[Cell] = []
    sensor = "accel" if table == "4.5" else "gyro"
    unit = "m/s^2" if sensor == "accel" else "rad/s"
    printed, ours = {}, {}
    for case, (sigma, error) in printed_rows(table).items():
        study = _study(effort, table, case)
        noise = (len(sigma) == 9 and case != 1) or (sensor == "gyro" and case == 2)
        prototype = _PROTOTYPE.get((table, case))
        exact = len(sigma) == 9 and case == 1  # nothing but rounding on both sides
        for i, name in enumerate(_names(len(sigma))):
            what, words = f"case {case}, {name}", unit if i < 3 else "ppm" if i < 6 else "urad"
            stated = sigma[i], error[i]
            cells += (
                _exact_cells(study, i, what, words, stated)
                if exact
                else _noisy_cells(study, i, what, words, stated, noise, None if prototype is None else prototype[i])
            )
        scaled = (study.sigma * np.sqrt(study.unit_weight)[:, None])[study.converged]
        printed[f"case {case}"] = np.array(sigma) * np.repeat((1.0, 1e-6, 1e-6), 3)[: len(sigma)]
        ours[f"case {case}"] = np.quantile(scaled, (0.05, 0.5, 0.95), axis=0)[:, : len(sigma)]
    reason = _NO_ATTITUDES
    if table == "4.4":
        reason += (
            "theta_zx lies just outside: it depends most on the attitudes, and the independent program from which "
            "the factor was derived has 1.74 for it."
        )
    if table == "4.2":
        reason += " With three parameters the unmodelled scale factors dominate cases 1 and 3."
    draw = partial(sigma_figure, f"Table {table}: printed uncertainties and ours", printed, ours)
    return Outcome(tuple(cells), reason, (draw,))


def _sizes(study: StudyResult, i: int) -> tuple[float, float, float]:
    """Unit of a parameter, its predicted sigma and its rms error in that unit."""
    size = 1.0 if i < 3 else 1e-6
    return size, study.mean_sigma[i] / size, study.rms_error[i] / size


def _exact_cells(study: StudyResult, i: int, what: str, unit: str, stated: tuple[float, float]) -> list[Cell]:
    """Sigma and rms error of a parameter without noise: as small as rounding makes them."""
    size, predicted, rms = _sizes(study, i)
    high = 1e-13 * float(np.linalg.norm(study.case.reference_n)) if i < 3 else 1e-13 / size
    return [
        claimed(f"{what}: sigma", f"{stated[0]:.3g}", predicted, high=high, unit=unit, tolerance="rounding"),
        claimed(f"{what}: rms error", f"{stated[1]:.3g}", rms, high=high, unit=unit, tolerance="rounding"),
    ]


def _noisy_cells(
    study: StudyResult, i: int, what: str, unit: str, stated: tuple[float, float], noise: bool, prototype: float | None
) -> list[Cell]:
    """Sigma and error of a parameter beside the printed ones and, where there is one, another program's sigma."""
    _, predicted, rms = _sizes(study, i)
    sigma, error = stated
    cells = [
        claimed(f"{what}: sigma", f"{sigma:.5g}", predicted, low=sigma / _BAND, high=sigma * _BAND, unit=unit),
        # one draw of an error: beyond three of ours in one of 370
        claimed(
            f"{what}: rms error or sigma", f"|error| {error:.4g}", max(rms, predicted), low=error / 3.0, unit=unit,
            tolerance="statistical",
        ),
    ]  # fmt: skip
    if noise:
        bound = 0.10 + 3.0 / np.sqrt(2.0 * int(study.converged.sum()))
        over = f"{what}: rms error over sigma"
        cells.append(against(over, 1.0, rms / predicted, reference="corrected", source="", absolute=bound))
    if prototype is not None:
        relative = 3.0 * spread(study)[i] * np.sqrt(1.0 / len(study.values) + 1.0 / 400.0) + 0.02
        other = f"{what}: sigma, other program"
        cells.append(against(other, prototype, predicted, unit=unit, reference="corrected", relative=relative))
    return cells


def _names(order: int) -> tuple[str, ...]:
    """Names of the first parameters."""
    from schuler.calibration.bench.sensor_geometry import PARAMETERS

    return PARAMETERS[:order]


def spread(study: StudyResult) -> np.ndarray:
    """Standard deviation of one run's sigma over the mean: draws of attitude and residuals."""
    scaled = (study.sigma * np.sqrt(study.unit_weight)[:, None])[study.converged]
    return np.asarray(scaled.std(axis=0)[: study.case.order] / scaled.mean(axis=0)[: study.case.order])


@cache
def _sweep(effort: Effort, name: str) -> tuple[StudyResult, ...]:
    from schuler.reproduce.hayal.study.multiposition import StudyCase, sweep

    factors = (1.0, 10.0, 1e2, 1e3, 1e4, 1e5) if name == "rate_factor" else (0.01, 0.1, 1.0, 2.0, 3.0, 4.0, 7.0)
    rng = np.random.default_rng((effort.seed, len(name)))
    return tuple(sweep(StudyCase(plain=True), name, factors, effort.runs(30, 400), rng))  # type: ignore[arg-type]


def _groups(name: str, expected: dict[float, tuple[float | None, float, float]], effort: Effort) -> list[Cell]:
    """Ours against an independent program: rms of three parameters over the runs of both."""
    cells = []
    for study in _sweep(effort, name):
        k = getattr(study.case, name)
        if k not in expected:
            continue
        n = 3.0 * float(study.converged.sum())
        # errors of three axes with tails heavier than normal ones where noise is not small
        relative = 3.0 * np.sqrt(0.5 / n + 0.5 / 1200.0) * (1.0 if k < 1.0 or name == "rate_factor" else 1.5) + 0.025
        for value, printed, what, size, unit in zip(
            study.groups(),
            expected[k],
            ("bias", "scale factors", "angles"),
            (1.0, PPM, 1e-6),
            ("rad/s", "ppm", "urad"),
            strict=True,
        ):
            if printed is None:
                continue
            label = f"{'rate' if name == 'rate_factor' else 'noise'} x {k:g}: {what}"
            cells.append(against(label, printed, value / size, relative=relative, unit=unit, reference="corrected"))
    return cells


def _over_rate(effort: Effort) -> Outcome:
    from schuler.reproduce.hayal.study.figures import sweep_figure

    expected: dict[float, tuple[float | None, float, float]] = {
        1.0: (1.4e-6, 2.1e4, 3.9e4), 10.0: (1.4e-6, 2.1e3, 3.9e3), 1e2: (None, 206.0, 387.0), 1e3: (None, 20.6, 38.7),
        1e4: (None, 2.06, 3.87), 1e5: (None, 0.206, 0.387),
    }  # fmt: skip
    cells = _groups("rate_factor", expected, effort)
    studies = _sweep(effort, "rate_factor")
    first, fast = studies[0].groups(), studies[4].groups()
    n = 3.0 * len(studies[0].values)
    cells += [
        claimed("scale factors, rate x 1 over x 1e4", "improves with the rate", first[1] / fast[1], low=10.0),
        claimed("angles, rate x 1 over x 1e4", "improves with the rate", first[2] / fast[2], low=10.0),
        claimed(
            "bias, rate x 1e4 over x 1",
            "does not change very much",
            fast[0] / first[0],
            low=0.5,
            high=1.0 + 3.0 / np.sqrt(n),
            tolerance="statistical",
        ),
    ]
    return Outcome(
        tuple(cells),
        "The thesis shows curves without numbers; numbers are those of an independent program.",
        (partial(sweep_figure, studies, "rate_factor"),),
    )


def _over_noise(effort: Effort) -> Outcome:
    from schuler.reproduce.hayal.study.figures import sweep_figure

    expected: dict[float, tuple[float | None, float, float]] = {
        0.01: (1.4e-8, 206.0, 387.0), 0.1: (1.4e-7, 2.06e3, 3.9e3), 1.0: (1.43e-6, 2.1e4, 3.9e4),
        2.0: (3.0e-6, 4.7e4, 8.2e4), 3.0: (5.1e-6, 8.3e4, 1.3e5),
    }  # fmt: skip
    cells = _groups("noise_factor", expected, effort)
    studies = {s.case.noise_factor: s for s in _sweep(effort, "noise_factor")}
    for k, what in enumerate(("bias", "scale factors", "angles")):
        ratio = studies[2.0].groups()[k] / studies[0.1].groups()[k]
        cells.append(claimed(f"{what}, noise x 2 over x 0.1", "significantly worse with noise", ratio, low=10.0))
    for factor, share in ((3.0, 1.0), (4.0, 1.0), (7.0, 0.40)):
        n = len(studies[factor].values)
        half = 3.0 * np.sqrt(max(share * (1.0 - share), 1.0 / n) * (1.0 / n + 1.0 / 400.0)) + 0.005
        cells.append(
            against(
                f"noise x {factor:g}: share of runs that converge",
                share,
                studies[factor].success,
                absolute=half,
                reference="corrected",
            )
        )
    return Outcome(
        tuple(cells),
        "The thesis shows curves without numbers; numbers are those of an independent program. Which runs converge "
        "when noise approaches the reference depends on start and step limit, which are not given.",
        (partial(sweep_figure, _sweep(effort, "noise_factor"), "noise_factor"),),
    )


def _of(table: str) -> Callable[[Effort], Outcome]:
    return partial(_table, table)


ITEMS: tuple[Item, ...] = (
    Item("table-4.1", "errors put into the simulation", "exact", _inserted),
    Item("table-4.2", "gyroscopes, three parameters", "statistical", _of("4.2")),
    Item("table-4.3", "gyroscopes, six parameters", "statistical", _of("4.3")),
    Item("table-4.4", "gyroscopes, nine parameters", "statistical", _of("4.4")),
    Item("fig-4.2", "errors over the reference rate", "statistical", _over_rate),
    Item("fig-4.3", "errors over the noise", "statistical", _over_noise),
    Item("table-4.5", "accelerometers, nine parameters", "statistical", _of("4.5")),
)
