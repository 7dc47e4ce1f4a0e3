"""A run of the filter made ready: series, schedule, start and states, so that it can be run again with other noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.engine import FilterOptions, ForwardRun, Progress, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.gnss.ranges import Ranges
from schuler.navigation.aids.vehicle import times_of_fixes
from schuler.navigation.inputs.satellites import Points
from schuler.navigation.start.calibration import CalibrationStart
from schuler.recording.series import ImuSeries, Increments
from schuler.sensors.spec import ImuSpec

LONG_S = 30.0  # without fixes: noise is tuned by fixes up to half as far apart [s]


@dataclass(frozen=True)
class PreparedRun:
    """What the engine is given, and what was learned on the way to it.

    Attributes
    ----------
    imu : ImuSeries
        Vehicle axes, GNSS clock.
    increments : Increments
        From the start of the run.
    schedule : MeasurementSchedule
        Outages taken out.
    initial : InitialState
    layout : StateLayout
    spec : ImuSpec
        Error budget.
    psd : (ndarray, ndarray), shapes (3,)
        White noise that drives the filter, gyroscopes and accelerometers. [rad^2/s], [m^2/s^3]
    options : FilterOptions
    windows : tuple of (start, stop)
        Outages. [s]
    notes : tuple of str
    calibrated : CalibrationStart, optional
    ranges, points : Ranges, Points, optional
        Of a tightly coupled run.
    axes_covariance_b : ndarray, shape (3, 3)
        What is not known of the sensors' axes, see :func:`schuler.navigation.inputs.imu_axes.axes_covariance`. [rad^2]
    headings : callable, optional
        Start with the first heading found turned by an angle [rad], fairly unsure of it; None where the start has no
        choice of headings.
    fixes_later_s : float
        Time by which GNSS fixes are taken later than their stamps; ``delay`` is what is left. [s]
    """

    imu: ImuSeries
    increments: Increments
    schedule: MeasurementSchedule
    initial: InitialState
    layout: StateLayout
    spec: ImuSpec
    psd: tuple[FloatArray, FloatArray]
    options: FilterOptions
    windows: tuple[tuple[float, float], ...] = ()
    notes: tuple[str, ...] = ()
    calibrated: CalibrationStart | None = field(default=None, repr=False)
    ranges: Ranges | None = field(default=None, repr=False)
    points: Points | None = field(default=None, repr=False)
    axes_covariance_b: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), repr=False)
    headings: Callable[[float], InitialState] | None = field(default=None, repr=False)
    fixes_later_s: float = 0.0

    def run(self, progress: Progress | None = None, *, keep_part: bool = False) -> ForwardRun:
        """Run the filter forward; see :func:`schuler.filtering.engine.run`."""
        return run(
            self.increments, self.schedule, self.initial, self.layout, *self.psd, self.options, progress,
            keep_part=keep_part,
        )  # fmt: skip


def longest_without_fixes(prepared: PreparedRun) -> float:
    """Longest time without a measurement of GNSS in a run, its start and end included. [s]"""
    fixes = times_of_fixes(prepared.schedule, prepared.initial.nav.t)
    return float(np.diff(np.append(fixes, prepared.increments.t[-1])).max())
