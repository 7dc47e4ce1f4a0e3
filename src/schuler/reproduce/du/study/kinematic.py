"""Free-inertial tests on a drive: conventional and rotating IMU, what rotation is worth on a vehicle that turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.montecarlo import run_seed
from schuler.montecarlo.engine import campaign
from schuler.plotting.table import ResultTable
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.drives import DRIVE_S
from schuler.reproduce.du.study.floor import noise_floor
from schuler.reproduce.du.study.imus import Emulation, emulation
from schuler.reproduce.du.study.metrics import UNITS, Improvement, improvement, index, mean_interval, share_below
from schuler.reproduce.du.study.trial import Trial, ideal, solutions, trial_run
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What the thesis's tables of drives hold, in this order.
PRINTED = ("horizontal_position", "horizontal_velocity", "roll", "pitch", "azimuth")
_TENTH = 0.1 * DEG


@dataclass(frozen=True, eq=False)
class KinematicTest:
    """Root mean squares over the drive of many runs of one IMU.

    Attributes
    ----------
    conventional_trial, rotary_trial : Trial
    conventional, rotary : ndarray, shape (runs, 7)
        In the order of :data:`~schuler.reproduce.du.study.metrics.QUANTITIES`, SI; rotary with strategy II.
    seed : int
    """

    conventional_trial: Trial
    rotary_trial: Trial
    conventional: FloatArray
    rotary: FloatArray
    seed: int

    @property
    def imu(self) -> Emulation:
        """IMU that was driven."""
        return self.rotary_trial.imu

    @property
    def runs(self) -> int:
        """Runs each way."""
        return len(self.rotary)

    def improvement(self, quantity: str = "horizontal_position") -> Improvement:
        """Ratio of the conventional IMU's error to that of the rotating one."""
        k = index(quantity)
        return improvement(self.conventional[:, k], self.rotary[:, k], seed=self.seed)

    def table(self) -> ResultTable:
        """Means beside the thesis's, if it has any: one conventional run, six rotary ones from least to most."""
        name = self.imu.name
        first, six = thesis.KINEMATIC.get(name, ((), ()))
        rows: list[tuple[Any, ...]] = []
        for k, quantity in enumerate(PRINTED):
            unit, scale = UNITS[quantity]
            floor = self._floor(quantity)
            for way, values, printed in (
                ("conventional", self.conventional, first[k : k + 1]),
                ("rotary", self.rotary, tuple(row[k] for row in six)),
            ):
                x = values[:, index(quantity)] / scale
                mean, low, high = mean_interval(x)
                beside: tuple[float | None, ...] = (None, None, None, None, None)
                if printed:
                    middle = float(np.mean(printed))
                    usual = 100.0 * share_below(np.tile(x, (len(printed), 1)), middle)
                    beside = (middle, min(printed), max(printed), mean / middle, usual)
                rows.append(
                    (way, f"{quantity}_{unit}", *beside[:3], mean, low, high, *beside[3:], floor / scale)
                )  # fmt: skip
        return ResultTable(
            f"{name} driving {self.rotary_trial.duration_s:g} s, rotary at {self.rotary_trial.rate / DEG:g} deg/s, "
            f"mean of {self.runs} runs",
            (
                "way", "quantity", "thesis", "thesis_least", "thesis_most", "ours", "low_95", "high_95", "ratio",
                "share_below_percent", "floor",
            ),
            tuple(rows),
            self._notes(),
        )  # fmt: skip

    def verdict(self) -> str:
        """Whether the thesis's claim about the horizontal position holds, and why not."""
        name = thesis.check_imu(self.imu.name)
        claim, gain = thesis.CLAIMED[name], self.improvement()
        first, six = thesis.KINEMATIC[name]
        ratios = first[0] / np.array([row[0] for row in six])
        own = first[0] / float(np.mean([row[0] for row in six]))
        return (
            f"{name}, driving: claimed {claim[0]:g} to {claim[1]:g} times smaller; the thesis's own runs give "
            f"{ratios.min():.1f} to {ratios.max():.1f}, by means {own:.1f}; ours {gain.ratio:.2f} "
            f"({gain.low:.2f} to {gain.high:.2f}; initial attitude to "
            f"{self.rotary_trial.initial_attitude / DEG:g} deg): {gain.compared(claim)}"
        )

    def summary(self) -> str:
        """Table, improvement and verdict as text."""
        lines = [self.table().summary(), "horizontal position: " + self.improvement().summary()]
        lines.append("horizontal velocity: " + self.improvement("horizontal_velocity").summary())
        if self.imu.name in thesis.IMUS:
            lines.append(self.verdict())
        return "\n".join(lines)

    def example(self, run: int = 0) -> dict[str, Trajectory]:
        """Trajectories of one run: ``truth``, ``conventional``, ``rotary``."""
        if not 0 <= run < self.runs:
            raise InputError(f"run: expected 0 to {self.runs - 1}, got {run}")
        seed = run_seed(self.seed, run)
        return {
            "truth": ideal(self.rotary_trial).vehicle,
            "conventional": solutions(self.conventional_trial, seed)["conventional"],
            "rotary": solutions(self.rotary_trial, seed)["II"],
        }

    def plot(self, run: int = 0) -> Figure:
        """Tracks, velocity and attitude errors of one run (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.du.study.figures import kinematic_figure

        return draw(kinematic_figure(self, run))

    def _floor(self, quantity: str) -> float:
        floor = noise_floor(self.imu.gyro_random_walk, self.rotary_trial.duration_s)
        if quantity in ("horizontal_position", "horizontal_velocity"):
            return float(getattr(floor, quantity))
        return floor.attitude

    def _notes(self) -> tuple[str, ...]:
        tilt = self.rotary_trial.initial_attitude
        return (
            "thesis: one conventional run, mean of six rotary ones; drives of the same length, not the same road",
            "share_below: how often the mean of as many single runs of ours, drawn again and again, is no larger",
            "floor: root mean square that white noise of the gyroscopes alone makes, from a perfect start",
            f"initial attitude with errors of {tilt / DEG:g} deg" if tilt else "initial attitude perfect",
        )


def kinematic_test(
    imu: str | Emulation,
    *,
    rate_deg_s: float | None = None,
    runs: int = 200,
    seed: int = 0,
    initial_attitude_deg: float = _TENTH / DEG,
    workers: int | None = None,
) -> KinematicTest:
    """Many free-inertial runs of a drive with a conventional and a rotating IMU.

    Parameters
    ----------
    imu : {"NAV440", "MTi-G"} or Emulation
    rate_deg_s : float, optional
        Rate of rotation about the vertical axis of the car. Default: the thesis's, 20 and 10. [deg/s]
    runs, seed, workers
        See :func:`schuler.reproduce.du.study.static.static_test`.
    initial_attitude_deg : float
        1-sigma about each axis. The thesis takes the attitude from another INS; from its outages follows a
        tenth of a degree. No rotation takes it off, and how much rotation is worth depends on it. [deg]

    Returns
    -------
    KinematicTest

    Raises
    ------
    InputError
        If the IMU is unknown or the runs were interrupted.

    Notes
    -----
    Conventional: mean of five minutes at rest. Rotary: a minute at rest and one turning, strategy II. The drive is
    ours, see :func:`schuler.reproduce.du.study.drives.drive`; no vibration.

    References
    ----------
    Du (2015), section 4.2.
    """
    unit = emulation(imu) if isinstance(imu, str) else imu
    if rate_deg_s is None:
        if unit.name not in thesis.IMUS:
            raise InputError(f"rate_deg_s: the thesis recommends none for {unit.name}; pass one, see recommended_rate")
        rate_deg_s = thesis.RECOMMENDED_DEG_S[unit.name]
    if not rate_deg_s:
        raise InputError("rate_deg_s: expected a rate other than zero; the conventional IMU is run as well")
    common: dict[str, Any] = {
        "imu": unit, "vehicle": "drive", "duration_s": DRIVE_S, "start_s": 5.0 * units.MIN,
        "initial_attitude": initial_attitude_deg * DEG,
    }  # fmt: skip
    trials = (Trial(rest_s=5.0 * units.MIN, **common), Trial(rate=rate_deg_s * DEG, **common))
    drives = []
    for trial in trials:
        part = campaign(trial_run, trial, runs, seed=seed, workers=workers, keep=True)
        if not part.complete:
            raise InputError("interrupted before both ways were done: nothing to compare")
        drives.append(part.column("II" if trial.rate else "conventional"))
    return KinematicTest(trials[0], trials[1], drives[0], drives[1], seed)


def claims(tests: list[KinematicTest]) -> ResultTable:
    """The thesis's claims about driving, its own numbers, and ours with 95 % intervals."""
    rows: list[tuple[Any, ...]] = []
    for test in tests:
        name = thesis.check_imu(test.imu.name)
        first, six = thesis.KINEMATIC[name]
        for quantity in ("horizontal_position", "horizontal_velocity", "azimuth"):
            k = PRINTED.index(quantity)
            own = first[k] / np.array([row[k] for row in six])
            mean = first[k] / float(np.mean([row[k] for row in six]))
            gain = test.improvement(quantity)
            claim = thesis.CLAIMED[name] if quantity == "horizontal_position" else None
            verdict = "-" if claim is None else gain.compared(claim)
            claimed = "-" if claim is None else f"{claim[0]:g} to {claim[1]:g}"
            rows.append(
                (name, test.rotary_trial.initial_attitude / DEG, test.imu.gyro_instability / units.DEG_PER_HR,
                 quantity, claimed, float(own.min()), float(own.max()), mean, gain.ratio, gain.low, gain.high,
                 100.0 * gain.wins, verdict)
            )  # fmt: skip
    return ResultTable(
        "Driving: how many times smaller rotation makes errors",
        (
            "imu", "initial_attitude_deg", "instability_deg_hr", "quantity", "claimed",
            "thesis_least", "thesis_most", "thesis_mean", "ours", "low_95", "high_95",
            "wins_percent", "verdict_on_claim",
        ),
        tuple(rows),
        (
            "azimuth: rotation about the vertical does nothing for it; what differs is the calibration (five minutes "
            "of rest for the conventional IMU, the scale factor for the rotating one)",
        ),
    )  # fmt: skip
