"""Section 5.4: the filter with zero velocity on the turntable, emulated, and covariances of an independent filter."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.du.bands import against_rms, against_runs
from schuler.reproduce.items import Effort, Item, Outcome

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure
    from schuler.reproduce.du.study.zupt import ZuptStudy
    from schuler.reproduce.du.study.zupt_runs import ZuptEmulation

Quantity = Literal["accel", "attitude", "gyro"]
_PLACE = {"accel": 0, "attitude": 1, "gyro": 2}
_NAMES = {"accel": ("b_x", "b_y", "b_z"), "attitude": ("roll", "pitch", "azimuth"), "gyro": ("d_x", "d_y", "d_z")}
_UNIT = {"accel": "m/s^2", "attitude": "deg", "gyro": "deg/h"}
_DIGIT = {"accel": 0.001, "attitude": 0.01, "gyro": 0.1}
#: What the emulated unit was made from: agreement there is by construction.
_GIVEN = {
    ("accel", None): (), ("accel", 0.0): (), ("accel", 30.0): (0, 1, 2),
    ("gyro", None): (0, 1), ("gyro", 0.0): (), ("gyro", 30.0): (0, 1, 2),
}  # fmt: skip
_EMULATED = (
    "One run of each case by filters whose tuning the thesis does not state, emulated with ours; the unit's "
    "biases are read from the thesis's tilted runs and conventional gyroscopes x and y, so that numbers there agree by "
    "construction and are not compared. "
)


@cache
def campaign_on_the_table(imu: str, test: Literal["Y", "Z"], effort: Effort) -> ZuptEmulation:
    """The runs that all items of an IMU and a test share."""
    from schuler.reproduce.du.study.zupt_runs import zupt_emulation

    rows = [(imu, test, tilt) for tilt in (None, 0.0, 30.0)]
    emulation = zupt_emulation(rows, runs=effort.runs(32, 96), seed=effort.seed)
    if not emulation.complete:
        raise KeyboardInterrupt
    return emulation


def _figure(imu: str, test: Literal["Y", "Z"], effort: Effort) -> Figure:
    from schuler.reproduce.du.study.filter_figures import zupt_runs

    return zupt_runs(campaign_on_the_table(imu, test, effort), imu, test)


def _table(imu: str, test: Literal["Y", "Z"], quantity: Quantity, effort: Effort) -> Outcome:
    emulation = campaign_on_the_table(imu, test, effort)
    cells: list[Cell] = []
    unit, digit = _UNIT[quantity], _DIGIT[quantity]
    for run in emulation.runs:
        assert run.measured is not None
        values = run.by_run()[_PLACE[quantity]]
        tilt = None if run.case.axis is None else run.case.tilt_deg
        given = _GIVEN.get((quantity, tilt), ())
        for k, name in enumerate(_NAMES[quantity]):
            printed, title = run.measured[_PLACE[quantity]][k], f"{run.case.name}: {name}"
            x = values[:, k]
            # z of the conventional gyroscopes comes from the tilted rotation about Y
            if k in given or (quantity, test, tilt, k) == ("gyro", "Y", 0.0, 2):
                cells.append(
                    shown(
                        title,
                        float(x.mean()),
                        unit=unit,
                        printed=f"{printed:g}",
                        why="the emulated unit was made from it",
                    )
                )
            elif quantity == "attitude":
                cells.append(against_rms(title, printed, x, unit=unit, digit=digit))
            else:
                cells.append(against_runs(title, printed, x, unit=unit, digit=digit))
    still, level, tilted = (run.by_run() for run in emulation.runs)
    cells += _claims(test, quantity, still, level, tilted)
    return Outcome(tuple(cells), _EMULATED + _why(imu, test, quantity), (lambda: _figure(imu, test, effort),))


def _claims(
    test: str, quantity: Quantity, still: tuple[np.ndarray, ...], level: tuple[np.ndarray, ...],
    tilted: tuple[np.ndarray, ...],
) -> list[Cell]:  # fmt: skip
    """Claims of the text on the three cases, in scatters and sizes."""
    a, b, c = (x[_PLACE[quantity]] for x in (still, level, tilted))
    if quantity == "accel":
        unseen = (1,) if test == "Y" else (0, 1)
        ratio = float(max(np.std(c[:, k]) / np.std(b[:, k]) for k in unseen))
        which = "b_y" if test == "Y" else "b_x, b_y"
        return [
            claimed(f"scatter of {which}, tilted over level", "converges only with a tilt", ratio, high=0.2),
            claimed("scatter of b_x, b_y, tilted over conventional", "not observable without rotation",
                 float((np.std(c, axis=0) / np.std(a, axis=0))[:2].max()), high=0.2),
        ]  # fmt: skip
    if quantity == "attitude":
        mean = [x.mean(axis=0) for x in (a, b, c)]
        cells = [
            claimed("roll and pitch, tilted over conventional", "significantly reduced",
                 float((mean[2] / mean[0])[:2].max()), high=0.5),
            claimed("azimuth, tilted over conventional", "accumulation mitigated", float(mean[2][2] / mean[0][2]),
                 high=0.5),
        ]  # fmt: skip
        if test == "Z":
            cells.append(
                claimed(
                    "azimuth, level over tilted", "grows rapidly when level", float(mean[1][2] / mean[2][2]), low=2.0
                )
            )
        else:
            cells.append(claimed("pitch, level over tilted", "pitch degraded at pitch zero",
                              float(mean[1][1] / mean[2][1]), low=1.0))  # fmt: skip
        return cells
    worse = float((np.std(b, axis=0) / np.std(c, axis=0))[:2].min())
    name = "scatter of d_x, d_y, level over tilted"
    if test == "Z":
        return [claimed(name, "do not converge when level", worse, low=5.0)]
    return [claimed(name, "no strong effect of rotation", float((np.std(b, axis=0) / np.std(c, axis=0))[:2].max()),
                 low=1.0 / 3.0, high=3.0)]  # fmt: skip


_MOVED = "Biases moved from one run of the thesis to the next; the emulated unit's are the same in all three."


def _why(imu: str, test: str, quantity: Quantity) -> str:
    if quantity == "attitude":
        return (
            "Where roll and pitch are observable the thesis's RMS hold the table's own attitude and what its filter "
            "does not model besides; ours hold neither."
        )
    slips = {("NAV440", "Y", "gyro"): "5.5", ("NAV440", "Z", "accel"): "5.9", ("NAV440", "Z", "gyro"): "5.11"}
    table = slips.get((imu, test, quantity))
    if table is None:
        return _MOVED
    unit = ", and degrees for degrees per hour" if quantity == "gyro" else ""
    return _MOVED + f" Table {table} prints roll for what is pitch{unit}."


@cache
def _study() -> ZuptStudy:
    from schuler.reproduce.du.study.zupt import zupt_study

    return zupt_study()


def _covariances(effort: Effort) -> Outcome:
    from schuler.reproduce.du.study.filter_figures import zupt_sigmas

    cells: list[Cell] = []
    units = {"deg": "deg", "s2": "m/s^2", "hr": "deg/h"}
    for imu, case, name, ours, printed in _study().cells():
        unit = units[name.rsplit("_", 1)[-1]]
        title = f"{imu}, {case}: {' '.join(name.split('_')[:2]).removesuffix(' deg')}"
        if printed is None:
            continue
        half = 5e-4 if name.startswith("b_") else 0.0
        if printed < 0.0:
            cells.append(claimed(title, f"check: below {-printed:g}", ours, high=half - printed, unit=unit,
                              tolerance="printed digits", reference="corrected"))  # fmt: skip
        else:
            cells.append(against(title, printed, ours, absolute=max(half, 0.2 * printed), unit=unit, tolerance="band",
                                 reference="corrected", source=f"check: {printed:g}"))  # fmt: skip
    return Outcome(
        tuple(cells),
        "Covariances of a filter with zero velocity after 300 s; the thesis has none, and no uncertainties to compute "
        "them with. An independent twelve-state filter, 20 %.",
        tuple(partial(zupt_sigmas, _study(), imu) for imu in ("MTi-G", "NAV440")),
    )


def _item(table: str, imu: str, test: Literal["Y", "Z"], quantity: Quantity, figures: tuple[str, ...]) -> Item:
    words = {"accel": "accelerometer biases", "attitude": "attitude errors", "gyro": "gyroscope biases"}
    return Item(
        f"table-{table}", f"{imu}, turned about {test} at zero velocity: {words[quantity]}", "hardware",
        lambda e: _table(imu, test, quantity, e), tuple(f"fig-{f}" for f in figures),
    )  # fmt: skip


ITEMS = (
    Item("text-5.4", "1-sigma of the filters on the turntable", "exact", _covariances),
    _item("5.3", "NAV440", "Y", "accel", ("5.3",)),
    _item("5.4", "NAV440", "Y", "attitude", ("5.4", "5.5")),
    _item("5.5", "NAV440", "Y", "gyro", ("5.6",)),
    _item("5.6", "MTi-G", "Y", "accel", ("5.7", "5.8", "5.9")),
    _item("5.7", "MTi-G", "Y", "attitude", ("5.10", "5.11")),
    _item("5.8", "MTi-G", "Y", "gyro", ("5.12",)),
    _item("5.9", "NAV440", "Z", "accel", ("5.15",)),
    _item("5.10", "NAV440", "Z", "attitude", ("5.16", "5.17")),
    _item("5.11", "NAV440", "Z", "gyro", ("5.18",)),
    _item("5.12", "MTi-G", "Z", "accel", ("5.19", "5.20")),
    _item("5.13", "MTi-G", "Z", "attitude", ("5.21", "5.22")),
    _item("5.14", "MTi-G", "Z", "gyro", ("5.23",)),
)
