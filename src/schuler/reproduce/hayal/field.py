"""Section 5.3 and appendices A, B: calibrations of the field units, emulated with white noise of their data sheets."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.hayal.printed import IMUS, MINUTES, TABLES, field_table, field_words
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import MIN

if TYPE_CHECKING:
    from schuler.reproduce.hayal.study.multiposition import StudyResult

_PATTERN = 1.7
#: Independent emulation with all 26 attitudes: 2 to 5 and 1.2 to 4.5, as far as these digits go.
_UNIT_WEIGHT = {("accel", 9): (1.5, 5.5), ("gyro", 3): (1.15, 4.55)}

_SCALE = "its scale is that of the field's unit weight; the pattern over the parameters is compared"


@cache
def calibrations(effort: Effort, imu: str, sensor: str, order: int, subset: int, minutes: float) -> StudyResult:
    """The unit of the data sheet in an attitude subset, adjusted as in the source, many times."""
    from schuler.reproduce.hayal.study.attitudes import scenario
    from schuler.reproduce.hayal.study.multiposition import NOISE, StudyCase, run_case
    from schuler.sensors import catalogue

    triad = getattr(catalogue.spec(imu), sensor)
    case = StudyCase(
        sensor=sensor,  # type: ignore[arg-type]
        order=order,  # type: ignore[arg-type]
        noise_factor=triad.random_walk / NOISE[sensor],
        plain=True,
        directions=scenario(subset),
        duration_s=MIN * minutes,
    )
    key = (effort.seed, IMUS.index(imu), len(sensor), order, subset, int(minutes))
    return run_case(case, effort.runs(12, 200), np.random.default_rng(key))


def _shape(sigma: np.ndarray) -> np.ndarray:
    """Relative to the geometric mean: what the attitudes alone determine, whatever the unit weight."""
    return np.asarray(sigma / np.exp(np.mean(np.log(sigma))))


def _table(table: str, effort: Effort) -> Outcome:
    from schuler.reproduce.hayal.study.figures import sigma_figure

    sensor, order, subset = TABLES[table]
    printed, words = field_table(sensor, order, subset), field_words(sensor, order, subset)
    units = np.repeat((1e-6 if sensor == "gyro" else 1e-3, 1e-6, 1e-6), 3)[:order]
    labels = np.repeat(("1e-6 rad/s" if sensor == "gyro" else "1e-3 m/s^2", "ppm", "urad"), 3)
    cells: list[Cell] = []
    shown_printed, shown_ours = {}, {}
    for j, imu in enumerate(IMUS):
        for k, minutes in enumerate(MINUTES):
            study = calibrations(effort, imu, sensor, order, subset, minutes)
            where = f"{imu}, {minutes:g} min"
            share = study.success
            # the printed ones converged, so a unit that hardly ever does has no counterpart
            if not study.converged.any():
                cells.append(claimed(f"{where}: share of runs that converge", "converged", share, low=0.05))
                continue
            ours = study.sigma[study.converged][:, :order]
            median = np.median(ours, axis=0)
            theirs = printed[:, j, k, 1]
            for i, name in enumerate(_names(order)):
                cells.append(
                    shown(
                        f"{where}, {name}: sigma",
                        median[i] / units[i],
                        unit=str(labels[i]),
                        printed=words[i, j, k],
                        why=_SCALE,
                    )
                )
            factor = np.exp(np.abs(np.log(_shape(theirs) / _shape(median))).max())
            cells.append(
                claimed(
                    f"{where}: largest factor between the patterns of sigma",
                    "the nine printed sigmas",
                    float(factor),
                    high=_PATTERN,
                )
            )
            implied = float(np.exp(np.mean(np.log(theirs / median))))
            what = f"{where}: printed over ours, the field's root of unit weight"
            if subset == 1 and (sensor, order) in _UNIT_WEIGHT:
                low, high = _UNIT_WEIGHT[sensor, order]
                cells.append(claimed(what, "", implied, low=low, high=high, tolerance="band", reference="corrected"))
            else:
                cells.append(shown(what, implied))
            case = f"{imu}, {minutes:g} min"
            shown_printed[case] = theirs
            shown_ours[case] = np.quantile(ours, (0.05, 0.5, 0.95), axis=0)
    cells += _over_time(effort, sensor, order, subset, printed)
    figure = partial(sigma_figure, f"Table {table}: printed uncertainties and ours", shown_printed, shown_ours)
    return Outcome(tuple(cells), _reason(sensor, order, subset), (figure,))


def _over_time(effort: Effort, sensor: str, order: int, subset: int, printed: np.ndarray) -> list[Cell]:
    """White noise falls with the root of time; the field's does not."""
    cells = []
    for j, imu in enumerate(IMUS):
        first, last = (calibrations(effort, imu, sensor, order, subset, t) for t in (MINUTES[0], MINUTES[-1]))
        if not (first.converged.any() and last.converged.any()):
            continue
        ours = np.exp(np.mean(np.log(_medians(first, order)[:3] / _medians(last, order)[:3])))
        theirs = np.exp(np.mean(np.log(printed[:3, j, 0, 1] / printed[:3, j, 2, 1])))
        what = f"{imu}: sigma of bias, 1 min over 5 min"
        cells.append(
            shown(
                what,
                float(ours),
                printed=f"{theirs:.2f}",
                why="drift and settling of the field are in it, white noise alone in ours",
            )
        )
        if order == 3 or (sensor == "accel" and subset < 3):  # elsewhere sigma depends on the draw
            cells.append(
                against(
                    f"{what}, white noise",
                    np.sqrt(5.0),
                    float(ours),
                    relative=0.25,
                    reference="corrected",
                    tolerance="statistical",
                )
            )
    return cells


def _medians(study: StudyResult, order: int) -> np.ndarray:
    return np.asarray(np.median(study.sigma[study.converged][:, :order], axis=0))


def _names(order: int) -> tuple[str, ...]:
    from schuler.calibration.bench.sensor_geometry import PARAMETERS

    return PARAMETERS[:order]


def _reason(sensor: str, order: int, subset: int) -> str:
    common = (
        "Recorded by hardware; ours is white noise of the data sheet. The field's uncertainties are larger by the "
        "root of its unit weight and do not fall with the root of time: drift, warm-up and settling. "
    )
    if subset < 3:
        return common + "Patterns differ as far as the attitudes, which are not stated, differ from ours."
    if sensor == "gyro" and order == 9:
        return common + (
            "Nine parameters from ten attitudes and Earth rate leave one degree of freedom and determine eight; "
            "sigmas of single draws then scatter by more than the printed patterns can be compared."
        )
    if order == 9:
        return common + (
            "Ten attitudes determine eight of nine parameters, so the weak one is known by how badly the box was set "
            "up, which is chance."
        )
    return common + "The order of the attitudes is not stated."


def _failed(effort: Effort) -> float:
    """Share of runs of the last ten attitudes that end nowhere, as the HG1900 did with one minute."""
    from schuler.reproduce.hayal.study.attitudes import scenario
    from schuler.reproduce.hayal.study.multiposition import NOISE, StudyCase, run_case
    from schuler.sensors import catalogue

    noise = catalogue.spec("HG1900").gyro.random_walk / NOISE["gyro"]
    case = StudyCase(noise_factor=noise, plain=True, start="zeros", directions=scenario(4), duration_s=MIN)
    return 1.0 - run_case(case, effort.runs(60, 400), np.random.default_rng((effort.seed, 53))).success


def _failures(effort: Effort) -> Outcome:
    """Section 5.3: failures in an independent emulation, and the field's own evidence."""
    third = calibrations(effort, "HG1700", "accel", 9, 3, 3.0)
    theta = _medians(third, 9)[6:] / 1e-6
    fourth = _medians(calibrations(effort, "HG1700", "accel", 9, 4, 3.0), 9)[3:6] / 1e-6
    printed3, printed4 = (field_table("accel", 9, k)[:, 0, 1, 1] / 1e-6 for k in (3, 4))
    failed = _failed(effort)
    half = 3.0 * np.sqrt(0.2 * 0.8 / effort.runs(60, 400)) + 0.065
    spread = 3.0 * float((third.sigma[:, 7].std() / third.sigma[:, 7].mean()) / np.sqrt(len(third.values)))
    cells = (
        claimed(
            "subset 3, accelerometers: theta_zx over the other angles",
            f"{printed3[7] / printed3[[6, 8]].max():.1f}",
            float(theta[1] / theta[[0, 2]].max()),
            low=printed3[7] / printed3[[6, 8]].max() / _PATTERN,
            high=printed3[7] / printed3[[6, 8]].max() * _PATTERN,
        ),
        against(
            "subset 3, accelerometers: sigma of theta_zx",
            808.0,
            float(theta[1]),
            relative=spread,
            unit="urad",
            reference="corrected",
            source="346 (HG1700)",
        ),
        claimed(
            "subset 4, accelerometers: s_y over s_x",
            f"{printed4[4] / printed4[3]:.1f}",
            float(fourth[1] / fourth[0]),
            low=printed4[4] / printed4[3] / _PATTERN,
            high=printed4[4] / printed4[3] * _PATTERN,
        ),
        against(
            "subset 4, HG1900 gyroscopes, 1 min: share that fails",
            0.175,
            failed,
            absolute=half,
            reference="corrected",
            source="s_x = 2.2e6 +- 11e6 ppm",
        ),
    )
    return Outcome(
        cells,
        "The thesis finds ten attitudes and three minutes enough, from uncertainties with one degree of freedom; its "
        "own theta_zx of 6638 +- 346 urad with ten attitudes and 90 +- 38 with 26 shows that they are not. More of "
        "our runs with the last ten attitudes fail than of the independent program: which ten they are is not stated.",
    )


ITEMS: tuple[Item, ...] = (
    *(
        Item(
            f"table-{table}",
            f"{'gyroscopes' if sensor == 'gyro' else 'accelerometers'}, {order} parameters, attitude subset {subset}",
            "hardware",
            partial(_table, table),
        )
        for table, (sensor, order, subset) in TABLES.items()
    ),
    Item("text-5.3", "which attitude subsets determine what", "hardware", _failures),
)  # fmt: skip
