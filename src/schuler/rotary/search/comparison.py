"""A rotating IMU beside the same one fixed to the vehicle: simulated, navigated, and as linear covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import BoolArray, FloatArray
from schuler.budget.covariance import QUANTITIES, quantity_sigma
from schuler.filtering.measurements import in_windows
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import Cell, ResultTable
from schuler.rotary.free_navigation import ErrorHistory
from schuler.rotary.modulated_errors import Modulation, modulation
from schuler.rotary.rotating_imu import ideal_rotating_imu
from schuler.rotary.schedule import Schedule
from schuler.rotary.schemes import fixed
from schuler.rotary.search.scenario import RotaryScenario, load_rotary
from schuler.rotary.search.scheme_run import one_run
from schuler.units import DEG

_SHOWN = 2000  # times of the modulated bias


@dataclass(frozen=True, eq=False)
class Way:
    """One way to carry the IMU.

    Attributes
    ----------
    name : str
    schedule : Schedule
    histories : tuple of ErrorHistory
        One a run, Du's axes (east, north, up).
    t : ndarray, shape (r,)
        [s]
    P : ndarray, shape (r, 9, 9)
        Linear covariance of attitude, velocity, position errors, north, east, down.
    gyro, accel : Modulation
        Modulated biases of their 1-sigma on all three axes, north, east, down.
    """

    name: str
    schedule: Schedule
    histories: tuple[ErrorHistory, ...]
    t: FloatArray
    P: FloatArray
    gyro: Modulation
    accel: Modulation


@dataclass(frozen=True, eq=False, repr=False)
class ScenarioComparison(Displayed):
    """A rotating IMU and a conventional one.

    Attributes
    ----------
    scenario : RotaryScenario
    conventional, rotary : Way
    rates : ndarray, shape (k,)
        At which the schedule was looked at; empty if it has no rate. [rad/s]
    sigma : dict of str to ndarray, shape (k,)
        RMS of the predicted 1-sigma for each rate, SI.
    complete : bool
        False if it was interrupted: fewer runs.
    """

    scenario: RotaryScenario
    conventional: Way
    rotary: Way
    rates: FloatArray
    sigma: dict[str, FloatArray]
    complete: bool = True

    @property
    def ways(self) -> tuple[Way, Way]:
        """Both."""
        return self.conventional, self.rotary

    def counted(self, t: FloatArray) -> BoolArray:
        """Times that count: outages, or all."""
        if not self.scenario.in_outages:
            return np.ones(len(t), dtype=bool)
        return in_windows(t, self.scenario.outages)

    def predicted(self, way: Way, quantity: str) -> float:
        """RMS of a 1-sigma, SI."""
        return float(np.sqrt(np.mean(quantity_sigma(way.P, quantity)[self.counted(way.t)] ** 2)))

    def simulated(self, way: Way, quantity: str) -> float:
        """RMS over times and runs, SI."""
        squares = [_square(h, quantity)[self.counted(h.t)] for h in way.histories]
        return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float("nan")

    def table(self) -> ResultTable:
        """RMS of both ways, simulated and predicted, and their ratio."""
        rows: list[tuple[Cell, ...]] = []
        for quantity, (_, unit, scale) in QUANTITIES.items():
            row: list[Cell] = [f"{quantity} [{unit}]"]
            for value in (self.simulated, self.predicted):
                a, b = (value(way, quantity) / scale for way in self.ways)
                row += [a, b, a / b if b > 0.0 else None]
            rows.append(tuple(row))
        n = len(self.rotary.histories)
        when = "in the outages" if self.scenario.in_outages else "over the mission"
        return ResultTable(
            f"{self.scenario.name}: RMS errors {when}",
            (
                "quantity", "simulated_conventional", "simulated_rotary", "simulated_ratio", "predicted_conventional",
                "predicted_rotary", "predicted_ratio",
            ),
            tuple(rows),
            (
                f"simulated: {n} run{'' if n == 1 else 's'} of each, the same errors for both; predicted: 1-sigma of "
                "linear covariance, all runs that could be",
            ),
            self.complete,
        )  # fmt: skip

    def rates_table(self) -> ResultTable:
        """Predicted RMS against the rate of the schedule."""
        names = tuple(self.sigma)
        rows = tuple(
            (float(rate / DEG), *(float(self.sigma[q][k] / QUANTITIES[q][2]) for q in names))
            for k, rate in enumerate(self.rates)
        )
        suffix = tuple(f"{q}_{QUANTITIES[q][1].replace('/', '_')}" for q in names)
        return ResultTable(f"{self.scenario.name}: predicted RMS against the rate", ("rate_deg_s", *suffix), rows)

    def summary(self) -> str:
        """Both tables as text."""
        parts = [self.table().summary()]
        if len(self.rates):
            parts.append(self.rates_table().summary())
        return "\n\n".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "scenario": self.scenario.name, "imu": self.scenario.imu.name, "runs": len(self.rotary.histories),
            "rms": self.table().to_dict()["rows"], "rates": self.rates_table().to_dict()["rows"],
            "complete": self.complete,
        }  # fmt: skip


@explains_arguments
def compare_rotary(
    scenario: RotaryScenario | dict[str, Any] | Path | str,
    *,
    runs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> ScenarioComparison:
    """Simulate and navigate a scenario with its IMU turning and not turning.

    Parameters
    ----------
    scenario : RotaryScenario, dict, or path of a TOML file
    runs : int, optional
        Instead of the scenario's.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    ScenarioComparison
        Interrupted (Ctrl-C) after the first run, it keeps the runs so far.

    Notes
    -----
    Without aids the IMU navigates alone from a start with errors drawn from ``[start]``; with them the one filter runs,
    :func:`schuler.rotary.navigation.navigate_rotary`, with the same start. Sensor errors of a run are the same for both
    ways, in the axes of the IMU.

    Examples
    --------
    >>> print(schuler.compare_rotary("examples/rotary_static.toml", runs=1).summary())
    five minutes at rest, alone: RMS errors over the mission
    ...
    """
    scenario = load_rotary(scenario)
    objective = scenario.scheme_objective()
    made = scenario.rotary.build(scenario.motion.build())
    count = scenario.runs if runs is None else runs
    ways = {"conventional": fixed(), "rotary": made.schedule}
    histories: dict[str, list[ErrorHistory]] = {name: [] for name in ways}
    complete = True
    try:
        ideals = {
            name: ideal_rotating_imu(
                replace(made, schedule=schedule), scenario.imu.rate_hz, earth_rotation=scenario.motion.earth_rotation
            )
            for name, schedule in ways.items()
        }
        for k in range(count):
            pair = {n: one_run(scenario, replace(made, schedule=s), ideals[n], k) for n, s in ways.items()}
            for name, history in pair.items():
                histories[name].append(history)
            if progress is not None:
                progress((k + 1) / count)
    except KeyboardInterrupt:
        if not histories["rotary"]:
            raise
        complete = False
    spec = scenario.imu.spec()
    both = []
    for name, schedule in ways.items():
        t, P = objective.over_time(schedule)
        motion = replace(made, schedule=schedule)
        at = np.linspace(0.0, motion.duration, min(_SHOWN, int(20.0 * motion.duration) + 2))
        biases = [np.full(3, triad.turn_on_bias or triad.bias_instability) for triad in (spec.gyro, spec.accel)]
        gyro, accel = (modulation(motion, b, at) for b in biases)
        both.append(Way(name, schedule, tuple(histories[name]), t, P, gyro, accel))
    draft = ScenarioComparison(scenario, both[0], both[1], np.zeros(0), {}, complete)
    rates, sigma = _rate_sweep(draft, objective.over_time)
    return replace(draft, rates=rates, sigma=sigma)


def _rate_sweep(
    comparison: ScenarioComparison, over_time: Callable[[Schedule], tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """The scenario's schedule at other rates, within its limits."""
    section = comparison.scenario.rotary.schedule
    if section.rate_deg_s is None:
        return np.zeros(0), {}
    sign = float(np.sign(section.rate_deg_s))
    rates = [r for r in comparison.scenario.rates_deg_s if r <= comparison.scenario.limits.rate_deg_s]
    quantities = ("horizontal", "velocity", "tilt", "heading")
    values: dict[str, list[float]] = {q: [] for q in quantities}
    for rate in rates:
        schedule = section.model_copy(update={"rate_deg_s": sign * rate}).build()
        t, P = over_time(schedule)
        way = replace(comparison.rotary, t=t, P=P)
        for q in quantities:
            values[q].append(comparison.predicted(way, q))
    return np.array(rates) * DEG, {q: np.array(v) for q, v in values.items()}


def _square(h: ErrorHistory, quantity: str) -> FloatArray:
    """Squared size of an error over time, as :data:`~schuler.budget.covariance.QUANTITIES` has it."""
    part = {
        "horizontal": h.position[:, :2], "vertical": h.position[:, 2:], "position": h.position, "velocity": h.velocity,
        "heading": h.attitude[:, 2:], "tilt": h.attitude[:, :2],
    }[quantity]  # fmt: skip
    return np.asarray(np.sum(part**2, axis=1))
