"""Many noisy runs of the zero-velocity filter on the table, with the biases that Du's filters found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.montecarlo.lanes.aiding import LaneAiding, true_rests
from schuler.montecarlo.lanes.errors import LaneErrors
from schuler.montecarlo.lanes.records import LaneRecords
from schuler.montecarlo.lanes.run import run_lanes
from schuler.montecarlo.lanes.scenario import LaneScenario
from schuler.plotting.table import Cell, ResultTable
from schuler.reproduce.du.study.imus import FILTER_IMUS, TAU_S, FilterImu
from schuler.reproduce.du.study.tables import MEASURED, Measured
from schuler.reproduce.du.study.zupt import SIGMA_ZUPT, TABLE_RATE, TableCase, table_start
from schuler.rotary.du_axes import swap_matrix, swap_vector
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import GaussMarkov, NoiseModel, White
from schuler.units import DEG, DEG_PER_HR

Test = Literal["Y", "Z"]
_SETTLE_S = 150.0  # the second half of a run is looked at


def table_unit(imu: FilterImu, test: Test) -> ImuErrors:
    """One unit as the thesis's results describe it, Du's tables 5.3 to 5.14 read backwards.

    Parameters
    ----------
    imu : FilterImu
    test : {"Y", "Z"}
        Axes were defined anew between the two.

    Returns
    -------
    ImuErrors
        Accelerometer biases are those that the tilted rotating filter found; gyroscope biases x and y those that the
        conventional one found, z that of the tilted rotation about Y. What the rotating filter finds otherwise is a
        response to the platform's own rate: ``K = difference / 10 deg/s``, so agreement there is by construction.
    """
    still, turning = MEASURED[imu.name, test, None], MEASURED[imu.name, test, 30.0]
    d = np.array([*still.d_deg_hr[:2], MEASURED[imu.name, "Y", 30.0].d_deg_hr[2]])
    K = np.zeros((3, 3))
    K[:, 1 if test == "Y" else 2] = (np.array(turning.d_deg_hr) - d) * DEG_PER_HR / TABLE_RATE
    gyro, accel = imu.spec.gyro, imu.spec.accel
    return ImuErrors(
        b_a=swap_vector(turning.b_m_s2),
        b_g=swap_vector(d * DEG_PER_HR),
        M_g=swap_matrix(K),
        gyro_noise=NoiseModel((White(gyro.random_walk), GaussMarkov(gyro.in_run_bias, TAU_S))),
        accel_noise=NoiseModel((White(accel.random_walk), GaussMarkov(accel.in_run_bias, TAU_S))),
    )


def zupt_scenario(
    imu: FilterImu,
    case: TableCase,
    errors: LaneErrors | None = None,
    *,
    noisy: bool = False,
) -> LaneScenario:
    """Runs of the filter of a case.

    Parameters
    ----------
    imu : FilterImu
    case : TableCase
    errors : LaneErrors, optional
        Default: what the filter believes, drawn anew in every run.
    noisy : bool
        Add to the zero velocities what the filter believes of them, for tests of consistency; a table is truly at rest.
    """
    ideal, layout = case.ideal(), imu.layout
    if errors is None:
        gyro, accel = (np.full(3, triad.random_walk) for triad in (imu.spec.gyro, imu.spec.accel))
        errors = LaneErrors.of_layout(layout, gyro, accel, ideal.rate_hz)
    rests = true_rests(np.arange(1.0, case.duration_s + 0.5), SIGMA_ZUPT)
    if noisy:
        rests = LaneAiding(rests.schedule, np.full((len(rests), 3), SIGMA_ZUPT))
    return LaneScenario(
        ideal, errors, rests, layout, table_start(ideal, layout), *imu.psd, FilterOptions(record_s=1.0), ("all",),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ZuptRun:
    """Runs of one IMU in one case, beside the thesis's.

    Attributes
    ----------
    imu : str
    test : {"Y", "Z"}
    case : TableCase
    t : ndarray, shape (k,)
        [s]
    b_a, b_g : ndarray, shape (n, k, 3)
        Estimates of the biases by run, Du's x, y, z. [m/s^2], [rad/s]
    attitude : ndarray, shape (n, k, 3)
        Errors of roll, pitch, azimuth. [rad]
    measured : Measured, optional
    """

    imu: str
    test: Test
    case: TableCase
    t: FloatArray
    b_a: FloatArray
    b_g: FloatArray
    attitude: FloatArray
    measured: Measured | None

    def __len__(self) -> int:
        return len(self.b_a)

    @property
    def late(self) -> slice:
        """Records of the second half."""
        return slice(int(np.searchsorted(self.t, _SETTLE_S)), None)

    def by_run(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Estimates of every run over the second half: mean accelerometer biases, RMS attitude errors, mean gyroscope
        biases.

        Returns
        -------
        b_m_s2, attitude_deg, d_deg_hr : ndarray, shape (n, 3)
            As the fields of :class:`~schuler.reproduce.du.study.tables.Measured`.
        """
        b, d = (np.mean(x[:, self.late], axis=1) for x in (self.b_a, self.b_g))
        rms = np.sqrt(np.mean(self.attitude[:, self.late] ** 2, axis=1))
        return b, rms / DEG, d / DEG_PER_HR

    def emulated(self) -> Measured:
        """Means over the second half and the runs, as the thesis quotes one run."""
        b, d = (np.mean(x[:, self.late], axis=(0, 1)) for x in (self.b_a, self.b_g))
        rms = np.sqrt(np.mean(self.attitude[:, self.late] ** 2, axis=(0, 1)))
        return Measured(_triple(b), _triple(rms / DEG), _triple(d / DEG_PER_HR))

    def spread(self) -> Measured:
        """Standard deviation over the runs of a run's mean biases, and of its RMS attitude errors."""
        b, rms, d = (np.std(x, axis=0) for x in self.by_run())
        return Measured(_triple(b), _triple(rms), _triple(d))


def zupt_runs(
    imu: str,
    test: Test,
    tilt_deg: float | None,
    runs: int = 48,
    *,
    seed: int = 0,
) -> ZuptRun:
    """Runs of one row of tables 5.3 to 5.14.

    Parameters
    ----------
    imu : {"NAV440", "MTi-G"}
    test : {"Y", "Z"}
    tilt_deg : float or None
        None for the conventional IMU.
    runs, seed
        See :func:`schuler.montecarlo.lanes.run.run_lanes`.

    Raises
    ------
    InputError
        If there is no such row.
    """
    if (imu, test, tilt_deg) not in MEASURED:
        raise InputError(f"the thesis has no row {imu!r}, {test!r}, {tilt_deg!r}; it has {sorted(map(str, MEASURED))}")
    unit = FILTER_IMUS[imu]
    case = TableCase() if tilt_deg is None else TableCase(test, tilt_deg)
    errors = table_unit(unit, test)
    ideal = case.ideal()
    lanes = LaneErrors.of_imu(errors, ideal.rate_hz, len(ideal.gyro))
    records = run_lanes(zupt_scenario(unit, case, lanes), runs, seed=seed)
    good = ~records.diverged
    if not good.any():
        raise InputError(f"all {runs} runs of {imu}, {case.name} diverged")
    return ZuptRun(
        imu, test, case, records.t, *_estimates(records, errors, good),
        _roll_pitch_azimuth(records.error[good, :, :3], case.tilt_deg * DEG), MEASURED[imu, test, tilt_deg],
    )  # fmt: skip


def _estimates(records: LaneRecords, errors: ImuErrors, good: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Estimated biases: error plus the constant part of the truth, the wandering one being small. Du's axes."""
    layout = records.layout
    return (
        swap_vector(records.error[good][:, :, layout["b_a"]] + errors.b_a),
        swap_vector(records.error[good][:, :, layout["b_g"]] + errors.b_g),
    )


def _roll_pitch_azimuth(psi_n: FloatArray, pitch: float) -> FloatArray:
    """Errors of roll, pitch, azimuth of a vehicle that points north, from those about north, east, down."""
    roll = psi_n[..., 0] / np.cos(pitch)
    return np.stack((roll, psi_n[..., 1], psi_n[..., 2] + np.tan(pitch) * psi_n[..., 0]), axis=-1)


def _triple(v: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in v)
    return x, y, z


@dataclass(frozen=True, eq=False)
class ZuptEmulation:
    """Rows of tables 5.3 to 5.14, emulated.

    Attributes
    ----------
    runs : tuple of ZuptRun
    complete : bool
        False if interrupted.
    """

    runs: tuple[ZuptRun, ...]
    complete: bool = True

    def table(self) -> ResultTable:
        """Measured and emulated side by side, two rows a case; then the scatter of single runs."""
        columns = (
            "imu", "test", "case", "who", "b_x_m_s2", "b_y_m_s2", "b_z_m_s2", "roll_deg", "pitch_deg", "azimuth_deg",
            "d_x_deg_hr", "d_y_deg_hr", "d_z_deg_hr",
        )  # fmt: skip
        rows: list[tuple[Cell, ...]] = []
        for r in self.runs:
            for who, m in (("Du", r.measured), ("ours", r.emulated()), ("scatter", r.spread())):
                if m is not None:
                    rows.append((r.imu, r.test, r.case.name, who, *m.b_m_s2, *m.attitude_deg, *m.d_deg_hr))
        return ResultTable(
            "Zero-velocity filter on the turntable: one run of the thesis, and many of ours", columns, tuple(rows),
            (
                "Du: one run, mean biases and RMS attitude errors. ours: mean over runs and the second half of 300 s; "
                "scatter: 1-sigma of single runs",
                "true biases and responses are read from the thesis's own tilted runs, so agreement of biases there is "
                "by construction; what they do in the other cases, and the attitude errors, are not",
            ),
            self.complete,
        )  # fmt: skip

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()


def zupt_emulation(
    rows: Sequence[tuple[str, Test, float | None]] | None = None,
    *,
    runs: int = 48,
    seed: int = 0,
) -> ZuptEmulation:
    """All rows of tables 5.3 to 5.14, or some; on Ctrl-C those that were finished.

    Parameters
    ----------
    rows : sequence of (imu, test, tilt), optional
    runs, seed
        See :func:`zupt_runs`.
    """
    wanted: list[Any] = list(MEASURED) if rows is None else list(rows)
    done: list[ZuptRun] = []
    try:
        for imu, test, tilt in wanted:
            done.append(zupt_runs(imu, test, tilt, runs, seed=seed))
    except KeyboardInterrupt:
        return ZuptEmulation(tuple(done), complete=False)
    return ZuptEmulation(tuple(done))
