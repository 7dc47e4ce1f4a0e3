"""Free-inertial tests at rest: conventional, and rotating about the vertical with two ways of compensation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.montecarlo import run_seed
from schuler.montecarlo.engine import campaign
from schuler.plotting.table import ResultTable
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.imus import Emulation, emulation
from schuler.reproduce.du.study.metrics import QUANTITIES, UNITS, Improvement, improvement, index, mean_interval
from schuler.reproduce.du.study.trial import Trial, ideal, solutions, trial_run
from schuler.rotary.free_navigation import ErrorHistory, error_history
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.reproduce.du.study.rates import RateChoice

_POSITION, _VELOCITY = index("horizontal_position"), index("horizontal_velocity")


@dataclass(frozen=True, eq=False)
class StaticTest:
    """Root mean squares over the run of many runs of one IMU.

    Attributes
    ----------
    imu : Emulation
    duration_s : float
        Length of each run. [s]
    conventional : ndarray, shape (runs, 7)
        In the order of :data:`~schuler.reproduce.du.study.metrics.QUANTITIES`, SI.
    rates : ndarray, shape (m,)
        [rad/s]
    rotary : dict of str to ndarray, shape (m, runs, 7)
        By strategy, ``I`` and ``II``.
    seed : int
    complete : bool
        False if it was interrupted: fewer rates.
    """

    imu: Emulation
    duration_s: float
    conventional: FloatArray
    rates: FloatArray
    rotary: dict[str, FloatArray]
    seed: int
    complete: bool = True

    @property
    def runs(self) -> int:
        """Runs of each case."""
        return len(self.conventional)

    def case(self, strategy: str, rate: float | None = None) -> FloatArray:
        """Runs of one case (runs, 7); of ``I`` and ``II`` without a rate [rad/s], their means over the rates."""
        if strategy == "conventional":
            return self.conventional
        if strategy not in self.rotary:
            raise InputError(f"strategy: expected 'conventional', 'I' or 'II', got {strategy!r}")
        if rate is None:
            return np.asarray(self.rotary[strategy].mean(axis=0))
        near = np.flatnonzero(np.abs(self.rates - rate) < 1e-6)
        if not len(near):
            raise InputError(f"rate: {rate / DEG:g} deg/s was not tested; there are {_rates(self.rates)}")
        return np.asarray(self.rotary[strategy][near[0]])

    def improvement(
        self, strategy: str = "II", rate: float | None = None, quantity: str = "horizontal_position"
    ) -> Improvement:
        """Ratio of the conventional IMU's error to that of the rotating one."""
        k = index(quantity)
        return improvement(self.conventional[:, k], self.case(strategy, rate)[:, k], seed=self.seed)

    def recommended_rate(self, *, tolerance: float = 0.1) -> RateChoice:
        """See :func:`schuler.reproduce.du.study.rates.recommended_rate`."""
        from schuler.reproduce.du.study.rates import recommended_rate

        return recommended_rate(self, tolerance=tolerance)

    def table(self) -> ResultTable:
        """Means over the runs by strategy and rate, with 95 % half widths of the horizontal ones."""
        rows: list[tuple[Any, ...]] = []
        for strategy, rate in self._cases():
            x = self.case(strategy, rate or None)
            row: list[Any] = [strategy, round(rate / DEG, 6)]
            for k, name in enumerate(QUANTITIES):
                mean, _, high = mean_interval(x[:, k])
                row.append(mean / UNITS[name][1])
                if k in (_POSITION, _VELOCITY):
                    row.append((high - mean) / UNITS[name][1])
            rows.append(tuple(row))
        columns = ["strategy", "rate_deg_s"]
        for k, name in enumerate(QUANTITIES):
            columns.append(f"{name}_{UNITS[name][0]}")
            if k in (_POSITION, _VELOCITY):
                columns.append(f"half_width_{UNITS[name][0]}")
        return ResultTable(
            f"{self.imu.name} at rest, {self.duration_s:g} s, RMS over each run, mean of {self.runs} runs",
            tuple(columns),
            tuple(rows),
            ("half widths are of 95 % intervals of the mean", *self.notes()),
            self.complete,
        )

    def beside_the_check(self) -> ResultTable:
        """See :func:`schuler.reproduce.du.study.static_tables.beside_the_check`."""
        from schuler.reproduce.du.study import static_tables

        return static_tables.beside_the_check(self)

    def beside_the_thesis(self) -> ResultTable:
        """See :func:`schuler.reproduce.du.study.static_tables.beside_the_thesis`."""
        from schuler.reproduce.du.study import static_tables

        return static_tables.beside_the_thesis(self)

    def improvements(self) -> ResultTable:
        """See :func:`schuler.reproduce.du.study.static_tables.improvements`."""
        from schuler.reproduce.du.study import static_tables

        return static_tables.improvements(self)

    def summary(self) -> str:
        """Means, improvement, recommended rate as text."""
        parts = [self.table().summary(), self.improvements().summary()]
        if len(self.rates) > 1:
            parts.append(self.recommended_rate().summary())
        return "\n\n".join(parts)

    def plot(self) -> Figure:
        """RMS against rate, conventional as a line (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.du.study.figures import rates_figure

        return draw(rates_figure(self))

    def histories(self, rate: float, run: int = 0) -> dict[str, ErrorHistory]:
        """Errors over time of one run: ``conventional``, ``I`` and ``II`` at a rate [rad/s]."""
        if not 0 <= run < self.runs:
            raise InputError(f"run: expected 0 to {self.runs - 1}, got {run}")
        histories: dict[str, ErrorHistory] = {}
        for w in (0.0, rate):
            trial = Trial(imu=self.imu, rate=w, duration_s=self.duration_s)
            for name, solved in solutions(trial, run_seed(self.seed, run)).items():
                histories[name] = error_history(solved, ideal(trial).vehicle)
        return histories

    def plot_run(self, rate: float) -> Figure:
        """Attitude and velocity errors of the first run over time, conventional and both strategies (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.du.study.figures import history_figure

        title = f"{self.imu.name} at rest, {rate / DEG:g} deg/s, run 0"
        return draw(history_figure(self.histories(rate, 0), title, random_walk=self.imu.gyro_random_walk))

    def _cases(self) -> list[tuple[str, float]]:
        return [("conventional", 0.0)] + [(s, float(w)) for s in self.rotary for w in self.rates]

    def notes(self) -> tuple[str, ...]:
        """Notes on the emulation for its tables."""
        if self.imu.gyro_instability:
            drift = self.imu.gyro_instability / DEG_PER_HR
            return (f"with 1/f noise of the gyroscopes of {drift:.3g} deg/h",)
        if self.imu.name in thesis.IMUS:
            return ("strategy I agrees by construction: cross-coupling was fitted to the difference of I and II",)
        return ()


def static_test(
    imu: str | Emulation,
    *,
    rates_deg_s: Sequence[float] = thesis.RATES_DEG_S,
    runs: int = 200,
    seed: int = 0,
    duration_s: float = 300.0,
    workers: int | None = None,
) -> StaticTest:
    """Many free-inertial runs at rest of a conventional and a rotating IMU.

    Parameters
    ----------
    imu : {"NAV440", "MTi-G"} or Emulation
    rates_deg_s : sequence of float
        Rates of rotation about the vertical. [deg/s]
    runs : int
        Number for each case. All cases share their noise, run by run.
    seed : int
    duration_s : float
        Length of each run. [s]
    workers : int, optional
        Threads; default one a processor.

    Returns
    -------
    StaticTest
        On Ctrl-C with the rates done up to then.

    Raises
    ------
    InputError
        If the IMU is unknown, there is no rate or one is zero, or the conventional runs were interrupted.

    Notes
    -----
    Each run: a minute at rest, whole revolutions of at least another, calibration, navigation from the true state.
    Conventional: mean of the minute, the Earth's rate taken out. Accelerometers are never compensated, as in the
    thesis.

    References
    ----------
    Du (2015), section 4.1.
    """
    unit = emulation(imu) if isinstance(imu, str) else imu
    rates = np.array(rates_deg_s, dtype=np.float64) * DEG
    if rates.ndim != 1 or not len(rates) or np.any(rates == 0.0):
        raise InputError(f"rates_deg_s: expected rates other than zero, got {rates_deg_s!r}")

    def run(rate: float) -> Any:
        trial = Trial(imu=unit, rate=rate, duration_s=duration_s)
        return campaign(trial_run, trial, runs, seed=seed, workers=workers, keep=True)

    first = run(0.0)
    if not first.complete:
        raise InputError("interrupted before the conventional runs were done: nothing to compare with")
    columns: dict[str, list[FloatArray]] = {"I": [], "II": []}
    for rate in rates:
        part = run(float(rate))
        if not part.complete:
            break
        for strategy, values in columns.items():
            values.append(part.column(strategy))
    if not columns["I"]:
        raise InputError("interrupted before the first rate was done")
    n = len(columns["I"])
    return StaticTest(
        unit, duration_s, first.column("conventional"), rates[:n], {s: np.stack(v) for s, v in columns.items()}, seed,
        n == len(rates),
    )  # fmt: skip


def _rates(rates: FloatArray) -> str:
    return ", ".join(f"{w / DEG:g}" for w in rates)
