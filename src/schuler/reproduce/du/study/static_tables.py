"""Tables of tests at rest beside the thesis's measurements and an independent emulation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.plotting.table import ResultTable
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.metrics import QUANTITIES, UNITS, index, mean_interval, share_below
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.reproduce.du.study.static import StaticTest

_BAND = 0.10  # for agreement with the independent emulation
_POSITION, _VELOCITY = index("horizontal_position"), index("horizontal_velocity")


def beside_the_check(test: StaticTest) -> ResultTable:
    """Means beside those of an independent emulation, which ours must meet within 10 %."""
    rows: list[tuple[Any, ...]] = []
    for (imu, strategy, rate), (position, velocity) in thesis.EMULATED.items():
        if imu != test.imu.name or (rate and not np.any(np.abs(test.rates / DEG - rate) < 1e-6)):
            continue
        x = test.case(strategy, rate * DEG if rate else None)
        row: list[Any] = [strategy, rate]
        for k, printed in ((_POSITION, position), (_VELOCITY, velocity)):
            ours = float(x[:, k].mean())
            row += [0.5 * sum(printed), ours, ours / (0.5 * sum(printed)), in_band(ours, printed)]
        rows.append(tuple(row))
    return ResultTable(
        f"{test.imu.name} at rest: independent emulation and ours",
        (
            "strategy", "rate_deg_s", "check_position_m", "position_m", "position_ratio", "position_in_band",
            "check_velocity_m_s", "velocity_m_s", "velocity_ratio", "velocity_in_band",
        ),
        tuple(rows),
        ("band: 10 % beyond the check's mean, or beyond the ends of its range", *test.notes()),
        test.complete,
    )  # fmt: skip


def beside_the_thesis(test: StaticTest) -> ResultTable:
    """Means beside what was measured, and how usual the measured value is among ours."""
    rows: list[tuple[Any, ...]] = []
    name = thesis.check_imu(test.imu.name)
    printed = thesis.STATIC_CONVENTIONAL[name]
    for k, quantity in enumerate(QUANTITIES):
        x = test.conventional[:, k] / UNITS[quantity][1]
        rows.append(_beside("conventional", quantity, printed[k], x[None], reason(name, "conventional", quantity)))
    for strategy in ("I", "II"):
        values = thesis.STATIC_ROTARY[name, strategy]
        for k, quantity in enumerate(QUANTITIES[:2]):
            x = test.rotary[strategy][:, :, k]
            rows.append(_beside(strategy, quantity, values[k], x, reason(name, strategy, quantity)))
    return ResultTable(
        f"{name} at rest: measured in the thesis and ours",
        ("strategy", "quantity", "thesis", "ours", "low_95", "high_95", "ratio", "share_below_percent", "why"),
        tuple(rows),
        (
            "measured: one run, or the mean over ten rates of one run each; ours: mean over runs and rates",
            "share_below: how often the mean of as many single runs of ours, drawn again and again, is no larger",
            *test.notes(),
        ),
        test.complete,
    )  # fmt: skip


def improvements(test: StaticTest) -> ResultTable:
    """Ratios of errors, conventional over rotary, with 95 % intervals, beside the thesis's if it has any."""
    rows: list[tuple[Any, ...]] = []
    name = test.imu.name
    measured = name in thesis.IMUS
    for strategy in ("I", "II"):
        for k, quantity in ((_POSITION, "horizontal_position"), (_VELOCITY, "horizontal_velocity")):
            gain = test.improvement(strategy, quantity=quantity)
            printed, verdict = None, "better" if gain.certain else "not certain"
            if measured:
                printed = thesis.STATIC_CONVENTIONAL[name][k] / thesis.STATIC_ROTARY[name, strategy][k]
                inside = gain.low <= printed <= gain.high
                single = gain.single_low <= printed <= gain.single_high
                verdict = "agrees" if inside else "single runs scatter so far" if single else "outside"
            rows.append(
                (strategy, quantity, printed, gain.ratio, gain.low, gain.high, gain.single_low,
                 gain.single_high, 100.0 * gain.wins, verdict)
            )  # fmt: skip
    return ResultTable(
        f"{name} at rest: how many times smaller rotation makes errors",
        (
            "strategy", "quantity", "thesis", "ours", "low_95", "high_95", "single_low", "single_high",
            "wins_percent", "verdict",
        ),
        tuple(rows),
        ("means over all rates; single: 95 % of the ratios of one conventional to one rotary run", *test.notes()),
        test.complete,
    )  # fmt: skip


def in_band(ours: float, printed: tuple[float, float]) -> bool:
    """Whether a mean lies within the check's range widened by 10 %."""
    return printed[0] * (1.0 - _BAND) <= ours <= printed[1] * (1.0 + _BAND)


def reason(imu: str, strategy: str, quantity: str) -> str:
    """Reason why a measured value and ours differ, where there is one."""
    if strategy != "conventional":
        if imu == "MTi-G":
            return "below the floor of the sheet's 3 deg/sqrt(h): 2 would fit here, but the drives fit 3"
        return "-"
    if quantity.startswith("vertical"):
        return "the accelerometer bias is that of another day, from chapter 5"
    if quantity in ("roll", "pitch", "azimuth") and imu == "NAV440":
        return "in-run drift of 12 to 15 deg/h, within the sheet's 20, which the emulation leaves out"
    return "one run, and in-run drift, which the emulation leaves out"


def _beside(strategy: str, quantity: str, printed: float, values: FloatArray, why: str) -> tuple[Any, ...]:
    """A row; values (cases, runs) in the unit of the printed one."""
    mean, low, high = mean_interval(values.mean(axis=0))
    share = 100.0 * share_below(values, printed)
    close = 0.9 <= mean / printed <= 1.1
    unit = UNITS[quantity][0]
    return (strategy, f"{quantity}_{unit}", printed, mean, low, high, mean / printed, share, "-" if close else why)
