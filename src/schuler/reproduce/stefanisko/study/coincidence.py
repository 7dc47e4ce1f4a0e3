"""Fixes at the common multiple of two rates only, or every fix at its own time: what the waiting costs.

Stefanisko's filter updates where an IMU sample and a fix coincide, every 0.3 s for 6 ms and 0.1 s, and so throws two of
three fixes away. The engine here takes a fix between two IMU samples as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from math import gcd
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.architectures import Comparison, compare_architectures
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.reproduce.stefanisko.study.campaign import FigureEightResult, figure_eight
from schuler.reproduce.stefanisko.study.experiment import FigureEight

Progress = Callable[[float], None]

#: Position errors of an independent simulation at 50 s and at the end of the outage, by update interval. [s]: [m], [m]
CHECK = {0.3: (0.50, 4.1), 0.1: (0.31, 3.6)}
_RESOLUTION_S = 1e-6


def common_interval(first_s: float, second_s: float) -> float:
    """Least common multiple of two intervals: 0.3 s for 6 ms and 0.1 s. [s]

    Parameters
    ----------
    first_s, second_s : float
        Taken as multiples of a microsecond. [s]

    Raises
    ------
    InputError
        If an interval is not positive.
    """
    steps = [round(x / _RESOLUTION_S) for x in (first_s, second_s)]
    if min(steps) < 1:
        raise InputError(f"expected intervals of at least {_RESOLUTION_S} s, got {first_s} and {second_s}")
    return float(Fraction(steps[0] // gcd(*steps) * steps[1]) * Fraction(_RESOLUTION_S).limit_denominator(10**12))


def coincident_fixes(gnss: GnssSeries, imu_t: Any, *, tolerance_s: float = 1e-4) -> GnssSeries:
    """The fixes whose time is that of an IMU sample.

    Parameters
    ----------
    gnss : GnssSeries
    imu_t : array_like, shape (n,)
        Times of the IMU samples. [s]
    tolerance_s : float
        [s]

    Raises
    ------
    InputError
        If no fix coincides: such a schedule would never update.
    """
    t = np.asarray(imu_t, dtype=np.float64)
    k = np.clip(np.searchsorted(t, gnss.t), 1, len(t) - 1)
    nearest = np.minimum(np.abs(gnss.t - t[k - 1]), np.abs(gnss.t - t[k]))
    keep = nearest <= tolerance_s
    if not keep.any():
        raise InputError(
            f"no fix lies within {tolerance_s:g} s of an IMU sample (nearest {nearest.min():.6f} s): coincidence "
            "scheduling would never update; take every fix at its own time, or raise tolerance_s"
        )
    return gnss.where(keep)


def compare_scheduling(
    recording: Recording, config: NavigationConfig | dict[str, Any] | Path | str
) -> tuple[Comparison, Comparison]:
    """A recording with the fixes that coincide with IMU samples, and with all of them, loosely coupled.

    Returns
    -------
    coincidence, asynchronous : Comparison
        Of one row each.
    """
    gnss = coincident_fixes(recording.need_gnss(), recording.need_imu().t)
    name = recording.metadata.name
    parts = (
        replace(
            recording, gnss=gnss, metadata=replace(recording.metadata, name=f"{name}, {len(gnss)} coincident fixes")
        ),
        replace(
            recording, metadata=replace(recording.metadata, name=f"{name}, all {len(recording.need_gnss())} fixes")
        ),
    )
    first, second = (compare_architectures(p, config, modes=("loose",)) for p in parts)
    return first, second


@dataclass(frozen=True)
class CoincidenceStudy(TabularResult):
    """The figure-eight with both schedules, the same draws."""

    coincidence: FigureEightResult
    asynchronous: FigureEightResult

    def table(self) -> ResultTable:
        """Errors at 50 s and at the end of the outage, the independent check's beside ours."""
        rows = []
        for name, r in (("coincidence", self.coincidence), ("asynchronous", self.asynchronous)):
            reference = CHECK.get(round(r.case.update_s, 6), (None, None))
            for t, published in zip((50.0, 90.0), reference, strict=True):
                rows.append(
                    (name, r.case.update_s, t, r.position(t), r.claimed(slice(6, 9), t), published, r.velocity(t))
                )
        return ResultTable(
            f"coincidence and asynchronous updates, figure-eight, {len(self.coincidence.nis)} runs",
            ("schedule", "update_s", "t_s", "rms_position_m", "claimed_position_m", "check_m", "rms_velocity_m_s"),
            tuple(rows),
            ("white GNSS errors: with errors that are correlated over seconds the gain is smaller",),
            self.coincidence.complete and self.asynchronous.complete,
        )


def coincidence_study(runs: int = 40, *, case: FigureEight | None = None) -> CoincidenceStudy:
    """Monte Carlo of both schedules.

    Parameters
    ----------
    runs : int
        See :func:`~schuler.reproduce.stefanisko.study.campaign.figure_eight`; both schedules share IMU errors and
        the fixes they have in common.
    case : FigureEight, optional

    References
    ----------
    Stefanisko (2015), chapter 5.
    """
    base = case or FigureEight()
    return CoincidenceStudy(*(figure_eight(replace(base, update_s=interval), runs) for interval in (0.3, 0.1)))
