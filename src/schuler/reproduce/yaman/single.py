"""Sections 5 and 5.1: the simulated grades, the routine, and one automotive-grade unit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, digits, shown, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.reproduce.yaman.campaigns import AUTOMOTIVE, GRADES, TACTICAL, SingleRun, single_run

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure
    from schuler.sensors.spec import ImuSpec

ACCEL_BIAS, GYRO_BIAS = ("b_a_x", "b_a_y", "b_a_z"), ("b_g_x", "b_g_y", "b_g_z")
ACCEL_SCALE, GYRO_SCALE = ("M_a_xx", "M_a_yy", "M_a_zz"), ("M_g_xx", "M_g_yy", "M_g_zz")
ACCEL_CROSS = ("M_a_xy", "M_a_xz", "M_a_yz")
GYRO_CROSS = ("M_g_xy", "M_g_xz", "M_g_yx", "M_g_yz", "M_g_zx", "M_g_zy")
G_SENSITIVITY = tuple(f"G_g_{i}{j}" for i in "xyz" for j in "xyz")
#: Starts of the second turns about x, y, z. [s]
_SECOND = (270.0, 360.0, 450.0)
#: Largest of a few normal errors in sigmas: exceeded once in some hundred units, over all figures. [sigma]
_LARGEST = 4.5

_FIRST = (
    "The source does not state rests and turns, the first tilt, P0, Q and R; times belong to a profile of 8 turns of "
    "45 deg an axis."
)


# ------------------------------------------------------------------------------------------- what is simulated


def _table_5_2(effort: Effort) -> Outcome:
    from schuler.reproduce.yaman.study.tables import PRINTED_CAMPAIGNS
    from schuler.sensors import catalogue
    from schuler.units import DEG_PER_HR, DEG_PER_HR_PER_G, DEG_PER_RTHR, MG, PPM

    printed = {
        AUTOMOTIVE: ("50", "10000", "10", "0.0083", "200", "10000", "10", "0.500"),
        TACTICAL: ("1", "300", "0.5", "0.0003302", "1", "150", "0.5", "0.125"),
    }
    cells: list[Cell] = []
    for grade, numbers in printed.items():
        s: ImuSpec = catalogue.spec(grade)
        ours = (
            ("accelerometer bias", s.accel.turn_on_bias / MG, "mg"),
            ("accelerometer scale factor", s.accel.scale_factor / PPM, "ppm"),
            ("accelerometer misalignment", s.accel.misalignment / 1e-3, "mrad"),
            ("velocity random walk", s.accel.random_walk, "m/s^2/sqrt(Hz)"),
            ("gyroscope bias", s.gyro.turn_on_bias / DEG_PER_HR, "deg/h"),
            ("gyroscope scale factor", s.gyro.scale_factor / PPM, "ppm"),
            ("gyroscope misalignment", s.gyro.misalignment / 1e-3, "mrad"),
            ("angle random walk", s.gyro.random_walk / DEG_PER_RTHR, "deg/sqrt(h)"),
        )
        cells += [
            digits(f"{_short(grade)}: {name}", text, value, unit=unit)
            for text, (name, value, unit) in zip(numbers, ours, strict=True)
        ]
    G = catalogue.spec(AUTOMOTIVE).gyro.g_sensitivity / DEG_PER_HR_PER_G
    drawn = float(np.mean([PRINTED_CAMPAIGNS[AUTOMOTIVE][name][1] for name in G_SENSITIVITY]))
    cells += [
        digits("automotive: g-sensitivity", "100", G, unit="deg/h/g"),
        # nine samples of 1000 draws: two standard errors of their mean deviation
        against(
            "automotive: g-sensitivity that was drawn (Table 5.4)", drawn, G, relative=2.0 / np.sqrt(2.0 * 9000.0),
            unit="deg/h/g", reference="corrected",
        ),
    ]  # fmt: skip
    return Outcome(
        transcribed(*cells),
        "Source error (FIX 19): g-sensitivity is printed as 100 deg/h/g, but the nine deviations of Table 5.4 are "
        "those of draws with 90.",
    )


def _fig_5_2(effort: Effort) -> Outcome:
    from schuler import earth
    from schuler.recording.series import ImuSeries
    from schuler.reproduce.yaman.study.runs import PLACE, FieldJob
    from schuler.sensors import catalogue
    from schuler.simulation.routine import thesis_routine
    from schuler.units import DEG

    job = FieldJob(catalogue.spec(AUTOMOTIVE), rate_hz=50.0)
    ideal = job.ideal
    imu = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment")
    rates = imu.rates()
    g = float(np.linalg.norm(earth.gravity_ned(PLACE[0], PLACE[2])))
    # sculling: a mean over a sample is shorter than gravity while it turns, (w dt)^2 / 24
    fastest = float(np.abs(rates.gyro).max())
    short = (fastest * imu.interval) ** 2 / 24.0
    off = float(np.abs(np.linalg.norm(rates.accel, axis=1) / g - 1.0).max())
    turned = np.abs(ideal.gyro).sum(axis=0) / DEG  # Earth rate at rest adds two degrees at most
    cells = [
        *transcribed(
            digits("three axes", "270", thesis_routine(repeats=1).duration, unit="s"),
            digits("and again", "540", float(ideal.t[-1] - ideal.t[0]), unit="s"),
        ),
        claimed(
            "specific force is gravity, largest deviation", "rotation in place", off, high=2.0 * short + 1e-9, unit="-"
        ),
        *(
            claimed(f"turned about {axis}", "a simple rotation, twice", float(angle), low=700.0, unit="deg")
            for axis, angle in zip("xyz", turned, strict=True)
        ),
        shown("largest rate", fastest / DEG, unit="deg/s"),
    ]

    def readings() -> Figure:
        from schuler.reproduce.yaman.study.figures import readings_figure

        return readings_figure(imu)

    return Outcome(tuple(cells), _FIRST, (readings,))


# ------------------------------------------------------------------------------------------- one unit


def _family(effort: Effort, names: tuple[str, ...], title: str) -> tuple[Callable[[], Figure], ...]:
    def of(form: str, heading: str) -> Callable[[], Figure]:
        def make() -> Figure:
            from schuler.reproduce.yaman.study.campaign_figures import family_figure

            run = single_run(effort, "thesis" if form == "thesis" else "ours")
            return family_figure(run.fit, names, run.truth, f"{title}, {heading}")

        return make

    return of("thesis", "in the source's form"), of("ours", "default options")


def _runs(effort: Effort) -> tuple[SingleRun, SingleRun]:
    return single_run(effort, "thesis"), single_run(effort, "ours")


def _reach(own: SingleRun, names: tuple[str, ...]) -> list[Cell]:
    """Convergence of the package's own form: estimates reach the true values."""
    return [
        shown("default options: known to a tenth after", own.reached(names), unit="s"),
        claimed(
            "default options: largest error over its sigma", "reach the modelled values", own.worst(names),
            high=_LARGEST, unit="sigma", tolerance="statistical", reference="corrected",
        ),
    ]  # fmt: skip


def _within_150(names: tuple[str, ...], title: str) -> Callable[[Effort], Outcome]:
    def run(effort: Effort) -> Outcome:
        form, own = _runs(effort)
        cells = [
            claimed("below 10 % after", "within 150 s, all axes", form.reached(names), high=150.0, unit="s"),
            claimed("left at 150 s", "< 0.10", form.share(names, 150.0), high=0.10, unit="-"),
            shown("error at the end over 1 sigma put in", form.left(names), unit="-"),
            *_reach(own, names),
        ]
        return Outcome(tuple(cells), _FIRST, _family(effort, names, title))

    return run


def _fig_5_5(effort: Effort) -> Outcome:
    form, own = _runs(effort)
    others = (*ACCEL_BIAS, *ACCEL_SCALE)
    cells = [
        claimed(
            "below 10 % after: later than bias and scale factor by", "converge last",
            form.reached(ACCEL_CROSS) - form.reached(others), low=0.0, unit="s",
        ),
        *(
            claimed(
                f"{name}: below 10 % after", f"in the {which} rotation (another filter)", form.reached((name,)),
                low=low, high=low + 90.0, unit="s", reference="corrected",
            )
            for name, which, low in (("M_a_yz", "first", 0.0), ("M_a_xz", "second", 90.0), ("M_a_xy", "third", 180.0))
        ),
        claimed("M_a_xy left at 175 s", "0.9 until then (another filter)", form.share(("M_a_xy",), 175.0), low=0.9,
             reference="corrected"),
        *_reach(own, ACCEL_CROSS),
    ]  # fmt: skip
    return Outcome(tuple(cells), _FIRST, _family(effort, ACCEL_CROSS, "Accelerometer misalignment"))


def _fig_5_6(effort: Effort) -> Outcome:
    form, own = _runs(effort)
    cells = [
        claimed("left at 540 s over left at 270 s", "estimated all along",
             form.share(GYRO_BIAS, 540.0) / form.share(GYRO_BIAS, 270.0), high=1.0, unit="-"),
        claimed("below 10 % after", "about 150 s (another filter)", form.reached(GYRO_BIAS), high=150.0, unit="s",
             reference="corrected"),
        *_reach(own, GYRO_BIAS),
    ]  # fmt: skip
    return Outcome(tuple(cells), _FIRST, _family(effort, GYRO_BIAS, "Gyroscope bias"))


def _fig_5_7(effort: Effort) -> Outcome:
    form, own = _runs(effort)
    cells: list[Cell] = []
    for name, begin in zip(GYRO_SCALE, _SECOND, strict=True):
        cells += [
            claimed(
                f"{name}: below 10 % after",
                "when turned about it, second half",
                form.reached((name,)),
                low=begin,
                high=begin + 90.0,
                unit="s",
            ),
            claimed(
                f"{name}: left before that",
                "not seen before (another filter: 1)",
                form.share((name,), begin - 5.0),
                low=0.8,
                unit="-",
                reference="corrected",
            ),
        ]
    cells += _reach(own, GYRO_SCALE)
    return Outcome(
        tuple(cells),
        f"{_FIRST} The default options use the direction of gravity from the first rest on, hence the first set of "
        "turns.",
        _family(effort, GYRO_SCALE, "Gyroscope scale factor"),
    )


def _fig_5_8(effort: Effort) -> Outcome:
    form, own = _runs(effort)
    c = form.fit.calibration
    s = np.sqrt(np.diag(c.covariance))
    correlation = np.abs(c.covariance / np.outer(s, s))
    pairs = [correlation[c.names.index(a), c.names.index(b)] for a in GYRO_SCALE for b in GYRO_CROSS]
    cells = [
        claimed("below 10 % after", "after a rotation about each axis", form.reached(GYRO_CROSS), high=540.0, unit="s"),
        claimed("left at the end", "about 0.04 (another filter)", form.share(GYRO_CROSS, 540.0), high=0.045, unit="-",
             reference="corrected"),
        claimed("largest correlation with a scale factor", "told apart from scale factors", float(max(pairs)), high=0.5,
             unit="-"),
        *_reach(own, GYRO_CROSS),
    ]  # fmt: skip
    return Outcome(tuple(cells), _FIRST, _family(effort, GYRO_CROSS, "Gyroscope misalignment"))


def _fig_5_9(effort: Effort) -> Outcome:
    form, own = _runs(effort)
    cells = [
        claimed("left at 540 s over left at 270 s", "estimated all along",
             form.share(G_SENSITIVITY, 540.0) / form.share(G_SENSITIVITY, 270.0), high=1.0, unit="-"),
        claimed("left at 270 s", "0.04 to 0.09 (another filter)", form.share(G_SENSITIVITY, 270.0), high=0.095,
             reference="corrected"),
        shown("error of the diagonal at the end over 1 sigma put in", form.left(("G_g_xx", "G_g_yy", "G_g_zz"))),
        *_reach(own, G_SENSITIVITY),
    ]  # fmt: skip
    return Outcome(
        tuple(cells),
        f"{_FIRST} In the source's form the diagonal ends beside the true values: P2 takes Earth rate for "
        "g-sensitivity.",
        _family(effort, G_SENSITIVITY, "g-sensitivity"),
    )


def _fig_5_10(effort: Effort) -> Outcome:
    from schuler.recording.series import ImuSeries
    from schuler.reproduce.yaman.study.runs import FieldJob
    from schuler.sensors import catalogue

    own = single_run(effort, "ours")
    ideal = FieldJob(catalogue.spec(AUTOMOTIVE)).ideal
    true = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment")
    after = own.fit.calibration.apply(own.imu)
    per_s = round(1.0 / true.interval)

    def rms(imu: ImuSeries) -> float:
        n = len(imu) // per_s * per_s
        e = (imu.rates().accel - true.rates().accel)[:n].reshape(-1, per_s, 3).mean(axis=1)
        return float(np.sqrt(np.mean(e**2)))

    before, left = rms(own.imu), rms(after)
    cells = [
        shown("RMS error of means over 1 s, uncalibrated", before, unit="m/s^2"),
        shown("calibrated", left, unit="m/s^2"),
        claimed(
            "calibrated over uncalibrated",
            "calibrated readings on the true profile",
            left / before,
            high=0.1,
            unit="-",
        ),
    ]

    def output() -> Figure:
        from schuler.calibration.report.output_figures import outputs

        return outputs(own.imu, after, "accel", truth=true)

    return Outcome(tuple(cells), "Claims of Figs. 5.3 to 5.5 read as: errors fall below a tenth.", (output,))


def _lessons(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue

    own = single_run(effort, "ours")
    window = {}
    for grade in GRADES:  # mean rate known to a tenth of the bias
        s = catalogue.spec(grade)
        window[grade] = (s.gyro.random_walk / (0.1 * s.gyro.turn_on_bias)) ** 2
    cells = [
        claimed(
            "misalignment left, second set over first",
            "repeating the routine improves it",
            own.share(ACCEL_CROSS, 540.0) / own.share(ACCEL_CROSS, 268.0),
            high=1.0,
            unit="-",
        ),
        shown("averaging for a tenth of the bias, automotive", window[AUTOMOTIVE], unit="s"),
        shown("averaging for a tenth of the bias, tactical", window[TACTICAL], unit="s"),
        claimed(
            "tactical over automotive",
            "better gyroscopes need longer means",
            window[TACTICAL] / window[AUTOMOTIVE],
            low=1.0,
            unit="-",
        ),
    ]
    return Outcome(tuple(cells))


def _short(grade: str) -> str:
    return grade.removeprefix("yaman-")


ITEMS = (
    Item("table-5.2", "Simulated grades", "exact", _table_5_2),
    Item("fig-5.2", "Ideal readings of the routine", "exact", _fig_5_2),
    Item("fig-5.3", "Accelerometer bias over the routine", "statistical",
         _within_150(ACCEL_BIAS, "Accelerometer bias")),
    Item("fig-5.4", "Accelerometer scale factor over the routine", "statistical",
         _within_150(ACCEL_SCALE, "Accelerometer scale factor")),
    Item("fig-5.5", "Accelerometer misalignment over the routine", "statistical", _fig_5_5),
    Item("fig-5.6", "Gyroscope bias over the routine", "statistical", _fig_5_6),
    Item("fig-5.7", "Gyroscope scale factor over the routine", "statistical", _fig_5_7),
    Item("fig-5.8", "Gyroscope misalignment over the routine", "statistical", _fig_5_8),
    Item("fig-5.9", "g-sensitivity over the routine", "statistical", _fig_5_9),
    Item("fig-5.10", "Accelerometers before and after", "statistical", _fig_5_10),
    Item("text-5.1", "Lessons of the single run", "statistical", _lessons),
)  # fmt: skip
