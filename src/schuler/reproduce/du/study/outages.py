"""Outages of a rotating and a conventional IMU, run by run with the same luck: accuracy, gain with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import run as filtered
from schuler.montecarlo.lanes.records import LaneRecords
from schuler.montecarlo.lanes.replay import replay
from schuler.montecarlo.lanes.run import run_lanes
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import Cell, ResultTable
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.du.study.imus import FilterImu
from schuler.reproduce.du.study.integrated import IntegratedDrive, rotary_schedule
from schuler.reproduce.du.study.metrics import Improvement, improvement
from schuler.reproduce.du.study.tables import CONTINUOUS, OUTAGES, Integrated
from schuler.units import DEG

#: Columns of :meth:`DriveRuns.rms`, and the size of their units.
QUANTITIES = {
    "horizontal_m": 1.0, "horizontal_m_s": 1.0, "vertical_m": 1.0, "roll_deg": DEG, "pitch_deg": DEG,
    "azimuth_deg": DEG,
}  # fmt: skip
_SETTLE_S = 60.0  # before this nothing of a drive without outages is looked at


@dataclass(frozen=True, eq=False)
class DriveRuns:
    """Many runs of one drive.

    Attributes
    ----------
    drive : IntegratedDrive
    records : LaneRecords
        Every second; runs that diverged are left out.
    yaw : ndarray, shape (k,)
        True heading at the records. [rad]
    """

    drive: IntegratedDrive
    records: LaneRecords
    yaw: FloatArray

    @classmethod
    def of(
        cls, drive: IntegratedDrive, runs: int, *, seed: int = 0, progress: Callable[[float], None] | None = None
    ) -> DriveRuns:
        """Run a drive; run k has the same errors in every drive of the same seed.

        Raises
        ------
        InputError
            If no run came through.
        """
        records = run_lanes(drive.scenario, runs, seed=seed, progress=progress)
        good = ~records.diverged
        if not good.any():
            raise InputError(f"all {runs} runs of {drive.imu.name}, {drive.name} diverged")
        return cls(drive, records, drive.yaw(records.t))

    def __len__(self) -> int:
        return len(self.records)

    @property
    def looked_at(self) -> BoolArray:
        """Records in the outages, before GNSS is back; of a drive without, all after a minute. Shape (k,)."""
        t = self.records.t
        if not self.drive.outages:
            return t > _SETTLE_S
        return np.asarray(np.any([(t > a + 1e-6) & (t < b - 1e-6) for a, b in self.drive.outages], axis=0))

    def errors(self) -> dict[str, FloatArray]:
        """Size of the errors by run and record, shape (n, k). [m], [m/s], [rad]"""
        e = self.records.error
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return {
            "horizontal_m": np.hypot(e[..., 6], e[..., 7]),
            "horizontal_m_s": np.hypot(e[..., 3], e[..., 4]),
            "vertical_m": np.abs(e[..., 8]),
            "roll_deg": np.abs(c * e[..., 0] + s * e[..., 1]),
            "pitch_deg": np.abs(c * e[..., 1] - s * e[..., 0]),
            "azimuth_deg": np.abs(e[..., 2]),
        }

    def rms(self) -> dict[str, FloatArray]:
        """Root mean squares over what is looked at, of every run, in the units of the names. Shape (n,)."""
        where = self.looked_at
        return {
            name: np.sqrt(np.mean(value[:, where] ** 2, axis=1)) / QUANTITIES[name]
            for name, value in self.errors().items()
        }

    def component_rms(self) -> dict[str, FloatArray]:
        """Root mean squares of single components over what is looked at, of every run. Shape (n,). [m], [m/s]"""
        e = np.sqrt(np.mean(self.records.error[:, self.looked_at] ** 2, axis=1))
        names = {"lat_m": 6, "lon_m": 7, "height_m": 8, "v_e_m_s": 4, "v_n_m_s": 3, "v_u_m_s": 5}
        return {name: e[:, k] for name, k in names.items()}

    def mean(self) -> Integrated:
        """Means over the runs of their RMS, as a row of the thesis's tables."""
        m = {name: float(np.mean(value)) for name, value in self.rms().items()}
        return Integrated((m["roll_deg"], m["pitch_deg"], m["azimuth_deg"]), m["horizontal_m"], m["horizontal_m_s"])

    def claimed_horizontal(self) -> float:
        """Horizontal RMS error that the filter claims over what is looked at. [m]"""
        s = self.records.sigma[:, self.looked_at]
        return float(np.sqrt(np.mean(s[..., 6] ** 2 + s[..., 7] ** 2)))

    def curve(self, quantity: str) -> tuple[FloatArray, FloatArray]:
        """RMS over runs and outages against the time since GNSS was lost.

        Parameters
        ----------
        quantity : str
            Of :data:`QUANTITIES`.

        Returns
        -------
        age, rms : ndarray, shape (m,)
            [s], unit of the name.
        """
        if quantity not in QUANTITIES or not self.drive.outages:
            raise InputError(f"expected one of {', '.join(QUANTITIES)} and a drive with outages, got {quantity!r}")
        length = round(min(b - a for a, b in self.drive.outages))
        value, t = self.errors()[quantity] / QUANTITIES[quantity], self.records.t
        age = np.arange(1.0, length - 0.5)
        parts = [value[:, np.searchsorted(t, a + age - 1e-6)] for a, _ in self.drive.outages]
        return age, np.sqrt(np.mean(np.square(parts), axis=(0, 1)))

    def sigmas(self, block: str) -> FloatArray:
        """Claimed 1-sigma of a block over time, mean over runs. Shape (k, size). [unit of the block]"""
        return np.asarray(np.mean(self.records.sigma[:, :, self.records.layout[block]], axis=0))

    def nees(self, start: float, stop: float) -> FloatArray:
        """Mean normalised squared error of all states in a stretch, per degree of freedom, of every run. Shape (n,)."""
        k = (self.records.t >= start) & (self.records.t <= stop)
        return np.asarray(self.records.nees["all"][:, k].mean(axis=1))


@dataclass(frozen=True, eq=False)
class RotaryComparison:
    """A conventional and a rotating IMU over the same drive with the same luck.

    Attributes
    ----------
    imu : FilterImu
    conventional, rotary : DriveRuns
    """

    imu: FilterImu
    conventional: DriveRuns
    rotary: DriveRuns

    def gain(self, quantity: str = "horizontal_m", *, probability: float = 0.95) -> Improvement:
        """Ratio of mean RMS errors, conventional over rotating, with its interval over the runs.

        Parameters
        ----------
        quantity : str
            Of :data:`QUANTITIES`.
        probability : float
        """
        if quantity not in QUANTITIES:
            raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
        return improvement(self.conventional.rms()[quantity], self.rotary.rms()[quantity], probability=probability)

    def table(self) -> ResultTable:
        """The thesis's row and ours, conventional and rotary, then the gains and their intervals."""
        outages = bool(self.rotary.drive.outages)
        printed = OUTAGES if outages else CONTINUOUS
        rows: list[tuple[Cell, ...]] = []
        for name, runs in (("conventional", self.conventional), ("rotary", self.rotary)):
            for who, m in (("Du", printed.get((self.imu.name, name))), ("ours", runs.mean())):
                if m is not None:
                    rows.append((self.imu.name, name, who, m.horizontal_m, m.horizontal_m_s, *m.attitude_deg))
        gains = [self.gain(q) for q in ("horizontal_m", "horizontal_m_s", "roll_deg", "pitch_deg", "azimuth_deg")]
        a, b = (printed.get((self.imu.name, name)) for name in ("conventional", "rotary"))
        if a is not None and b is not None:
            theirs = [a.horizontal_m / b.horizontal_m, a.horizontal_m_s / b.horizontal_m_s]
            theirs += [x / y for x, y in zip(a.attitude_deg, b.attitude_deg, strict=True)]
            rows.append((self.imu.name, "gain", "Du", *theirs))
        rows.append((self.imu.name, "gain", "ours", *(g.ratio for g in gains)))
        rows.append((self.imu.name, "gain", "95 % from", *(g.low for g in gains)))
        rows.append((self.imu.name, "gain", "95 % to", *(g.high for g in gains)))
        what = f"{len(self.rotary.drive.outages)} outages" if outages else "GNSS all the time, after the first minute"
        return ResultTable(
            f"{self.imu.name}: {what}, RMS",
            ("imu", "imu_is", "who", "horizontal_m", "horizontal_m_s", "roll_deg", "pitch_deg", "azimuth_deg"),
            tuple(rows),
            (
                f"ours: mean over {len(self.rotary)} runs of the RMS of each; gains are ratios of these means, their "
                "intervals from resampled runs; Du: one drive",
                f"claimed by the filters: {self.conventional.claimed_horizontal():.1f} m conventional, "
                f"{self.rotary.claimed_horizontal():.1f} m rotary",
            ),
        )

    def curves(self, step_s: int = 30) -> ResultTable:
        """RMS against the time since GNSS was lost."""
        curves = [r.curve(q) for q in ("horizontal_m", "horizontal_m_s") for r in (self.conventional, self.rotary)]
        age = curves[0][0]
        at = sorted({*range(step_s - 1, len(age), step_s), len(age) - 1})
        rows: list[tuple[Cell, ...]] = [(float(age[k]), *(float(c[k]) for _, c in curves)) for k in at]
        return ResultTable(
            f"{self.imu.name}: RMS against the length of an outage",
            (
                "age_s", "conventional_horizontal_m", "rotary_horizontal_m", "conventional_horizontal_m_s",
                "rotary_horizontal_m_s",
            ),
            tuple(rows),
        )  # fmt: skip

    def summary(self) -> str:
        """The table as text, and the verdict."""
        g = self.gain()
        verdict = "rotation helps" if g.certain else "rotation makes no certain difference"
        return f"{self.table().summary()}\n- horizontal position: {g.summary()}: {verdict}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()


def rotary_comparison(
    imu: FilterImu,
    runs: int = 200,
    *,
    drive: IntegratedDrive | None = None,
    outages: Sequence[tuple[float, float]] | None = None,
    seed: int = 0,
) -> RotaryComparison:
    """Run a drive with a conventional and with a rotating IMU.

    Parameters
    ----------
    imu : FilterImu
    runs : int
    drive : IntegratedDrive, optional
        Everything but its IMU and schedule, which are replaced: Du's is continuous about the vertical at the
        recommended rate.
    outages : sequence of (start, stop), optional
        Instead of the drive's; empty for GNSS all the time. [s]
    seed : int
        Run k of both has the same sensor errors, noise and start.

    References
    ----------
    Du (2015), section 6.3, one drive of each.
    """
    given = IntegratedDrive(imu) if drive is None else replace(drive, imu=imu)
    if outages is not None:
        given = replace(given, outages=tuple(outages))
    both = (DriveRuns.of(replace(given, schedule=turning), runs, seed=seed) for turning in (None, rotary_schedule(imu)))
    return RotaryComparison(imu, *both)


def smoothed_run(drive: IntegratedDrive, run: int = 0, *, seed: int = 0) -> tuple[NavigationResult, Trajectory]:
    """One run of a campaign once more through the engine, with what smoothing over the outages needs.

    Parameters
    ----------
    drive : IntegratedDrive
    run, seed : int
        As in the campaign.

    Returns
    -------
    result : NavigationResult
        Result of the IMU in its own axes; ``.smooth()`` is the smoothed one.
    truth : Trajectory
        True trajectory of the same.
    """
    scenario = drive.scenario
    data = replay(scenario, run, seed=seed)
    options = replace(scenario.options, smoother=True, output_rate_hz=10.0)
    forward = filtered(
        data.increments, data.schedule, data.initial, scenario.layout, scenario.gyro_psd, scenario.accel_psd, options
    )
    result = NavigationResult.from_run(
        forward, data.schedule.t, data.schedule.kind, scenario.layout, outages=drive.outages
    )
    return result, scenario.ideal.truth


def smoothing_table(drive: IntegratedDrive, runs: Sequence[int] = range(4), *, seed: int = 0) -> ResultTable:
    """Filtered and smoothed errors in the outages of some runs.

    Parameters
    ----------
    drive : IntegratedDrive
    runs : sequence of int
    seed : int
    """
    squares: dict[str, list[tuple[float, float, float]]] = {"filtered": [], "smoothed": []}
    for k in runs:
        result, truth = smoothed_run(drive, k, seed=seed)
        for name, solved in (("filtered", result), ("smoothed", result.smooth())):
            e = solved.errors(truth)
            inside = np.any([(e.t > a) & (e.t < b - 1e-6) for a, b in drive.outages], axis=0)
            assert e.attitude_n is not None
            squares[name].append((
                float(np.mean(e.horizontal[inside] ** 2)),
                float(np.mean(np.sum(e.attitude_n[inside, :2] ** 2, axis=1))),
                float(np.mean(e.attitude_n[inside, 2] ** 2)),
            ))  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, values in squares.items():
        h, tilt, heading = np.sqrt(np.mean(values, axis=0))
        rows.append((drive.imu.name, drive.name, name, float(h), float(tilt / DEG), float(heading / DEG)))
    return ResultTable(
        f"{drive.imu.name}, {drive.name}: smoothing over the outages",
        ("imu", "imu_is", "solution", "horizontal_m", "tilt_deg", "heading_deg"),
        tuple(rows),
        (f"RMS over {len(squares['filtered'])} runs and all outages",),
    )
