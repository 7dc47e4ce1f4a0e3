"""What a scheme of rotation is worth for an IMU on a mission: a number to be made small, by linear covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.budget.covariance import QUANTITIES, linear_covariance, quantity_sigma, true_covariance
from schuler.budget.replay import records_at, replay_filter
from schuler.budget.scenario import BudgetMission
from schuler.budget.sources import FIELDS, filter_layout
from schuler.exceptions import InputError
from schuler.filtering.measurements import in_windows
from schuler.plotting.notebook import Abridged
from schuler.rotary.schedule import Schedule
from schuler.rotary.search.turning import TurningMission, turning_mission
from schuler.sensors.spec import ImuSpec
from schuler.simulation.motion import Motion

Statistic: TypeAlias = Literal["rms", "end", "largest"]
#: Besides the quantities of budgets: geometric mean of 1-sigma at the end over that at the start, attitude and sensors.
OBSERVABILITY = "observability"


@dataclass(frozen=True, eq=False, repr=False)
class SchemeObjective(Abridged):
    """What is to be made small.

    Attributes
    ----------
    turning : TurningMission
    spec : ImuSpec
    quantity : str
        One of :data:`schuler.budget.covariance.QUANTITIES`, or ``observability``.
    statistic : {"rms", "end", "largest"}
        Statistic of its 1-sigma over the mission; ``observability`` is always that of the end.
    when : ndarray of bool, shape (r,)
        Records that count.
    """

    turning: TurningMission
    spec: ImuSpec
    quantity: str
    statistic: Statistic
    when: BoolArray

    @property
    def unit(self) -> str:
        """Shown beside the number."""
        return "of the prior" if self.quantity == OBSERVABILITY else QUANTITIES[self.quantity][1]

    @property
    def scale(self) -> float:
        """SI in that unit."""
        return 1.0 if self.quantity == OBSERVABILITY else QUANTITIES[self.quantity][2]

    @property
    def name(self) -> str:
        """For tables."""
        if self.quantity == OBSERVABILITY:
            return "mean uncertainty left"
        return {"rms": "RMS of", "end": "final", "largest": "largest"}[self.statistic] + f" {self.quantity} 1-sigma"

    def of(self, schedule: Schedule) -> float:
        """The number of a schedule, in SI.

        Notes
        -----
        An error is the true one: gains are those of the filter's own model, and errors it has no states for (scale
        factors, misalignment) come in with what they are, see :func:`schuler.budget.covariance`. That is what
        sets a price on turning. ``observability`` is the filter's own claim: the less, the better observed are tilts,
        heading and sensor errors together.
        """
        mission = self.turning.with_schedule(schedule)
        if self.quantity == OBSERVABILITY:
            return self._left(mission)
        return self.value(quantity_sigma(true_covariance(mission, self.spec), self.quantity))

    def value(self, sigma: FloatArray) -> float:
        """The statistic of a 1-sigma over time."""
        counted = sigma[self.when]
        if self.statistic == "end":
            return float(counted[-1])
        return float(counted.max() if self.statistic == "largest" else np.sqrt(np.mean(counted**2)))

    def over_time(self, schedule: Schedule) -> tuple[FloatArray, FloatArray]:
        """Times (r,) [s] and true covariance (r, 9, 9) of attitude, velocity, position errors, north, east, down."""
        covariance = linear_covariance(self.turning.with_schedule(schedule), self.spec)
        return covariance.t, covariance.P

    def _left(self, mission: BudgetMission) -> float:
        layout = filter_layout(self.spec, mission.states)
        P0 = np.diag(np.concatenate((mission.start_sigma**2, layout.initial_variances())))
        node = records_at(mission.run, mission.times[-1:])
        psd = self.spec.gyro.random_walk**2, self.spec.accel.random_walk**2
        P = replay_filter(mission.run, layout, P0, *psd, node).P[-1]
        counted = np.concatenate((np.arange(3), np.arange(9, layout.size)))
        counted = counted[P0[counted, counted] > 0.0]
        ratio = P[counted, counted] / P0[counted, counted]
        return float(np.exp(0.5 * np.mean(np.log(ratio))))


def scheme_objective(
    fixed: BudgetMission,
    motion: Motion,
    spec: ImuSpec,
    *,
    quantity: str = "horizontal",
    statistic: Statistic = "rms",
    in_outages: bool = False,
    earth_rotation: bool = True,
) -> SchemeObjective:
    """Objective for an IMU on a mission.

    Parameters
    ----------
    fixed : BudgetMission
        The vehicle with the IMU fixed to it.
    motion : Motion
        Motion of the vehicle.
    spec : ImuSpec
    quantity, statistic
        See :class:`SchemeObjective`.
    in_outages : bool
        Only what is uncertain while GNSS is out counts.
    earth_rotation : bool

    Raises
    ------
    InputError
        For an unknown quantity, or outages that do not exist.
    """
    if quantity != OBSERVABILITY and quantity not in QUANTITIES:
        raise InputError(f"quantity: expected one of {', '.join((*QUANTITIES, OBSERVABILITY))}, got {quantity!r}")
    if statistic not in ("rms", "end", "largest"):
        raise InputError(f"statistic: expected 'rms', 'end' or 'largest', got {statistic!r}")
    t = fixed.run.t[np.flatnonzero(records_at(fixed.run, fixed.times) >= 0)]
    when = in_windows(t, fixed.outages) if in_outages else np.ones(len(t), dtype=bool)
    if not when.any():
        raise InputError("only outages count, but the mission has none: give [gnss] outages_s, or count all of it")
    states = filter_layout(spec, fixed.states).blocks
    blocks = [b for b, (triad, field) in FIELDS.items() if getattr(getattr(spec, triad), field) > 0.0 or b in states]
    turning = turning_mission(fixed, motion, tuple(blocks), earth_rotation=earth_rotation)
    return SchemeObjective(turning, spec, quantity, statistic, when)
