"""Yaman's nine modes with a unit that really is calibrated in the field: routine, calibration, drive, all simulated.

Unlike :mod:`schuler.reproduce.yaman.study.modes`, which takes what is left of the sensor errors from the
source's table, the
calibrated rows here are the raw log of a drawn unit through :meth:`CalibrationResult.apply`, and what the filter is
told of the errors comes from the covariance of the calibration. Many units: median and spread of every number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.plotting.table import Cell, ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.reproduce.yaman.study.drive import ACCEL_NOISE, DRIVES, GNSS_RATE_HZ, GYRO_NOISE, Drive
from schuler.reproduce.yaman.study.modes import levelled_start, mode_config, rms_errors
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, Gps, agreed_order, mode_name
from schuler.reproduce.yaman.study.unit import (
    DriveScene,
    FieldUnit,
    TurnOn,
    calibrate_unit,
    drive_logs,
    remaining,
    routine_scene,
)
from schuler.simulation.routine import thesis_routine
from schuler.units import DEG, MG, UG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float], None]


@dataclass(frozen=True)
class FieldDrives(TabularResult):
    """Nine modes on one drive with many units.

    Attributes
    ----------
    number : {1, 2}
    turn_on : {"repeatability", "none"}
    against : {"truth", "full"}
    rms : ndarray, shape (units, 9, 7)
        Rows as :data:`MODES`, columns as :data:`QUANTITIES`.
    stated_errors : ndarray, shape (units, 2, 2)
        What the filter was told of the errors of accelerometers [m/s^2] and gyroscopes [rad/s], raw and calibrated.
    complete : bool
    """

    number: int
    turn_on: TurnOn
    against: str
    rms: FloatArray
    stated_errors: FloatArray
    complete: bool = True

    def __len__(self) -> int:
        return len(self.rms)

    @property
    def median(self) -> FloatArray:
        """Over units. Shape (9, 7)."""
        return np.asarray(np.median(self.rms, axis=0))

    def between(self, low: float = 0.16, high: float = 0.84) -> tuple[FloatArray, FloatArray]:
        """Quantiles over units. Shapes (9, 7)."""
        return np.quantile(self.rms, low, axis=0), np.quantile(self.rms, high, axis=0)

    def order(self, column: str = "position_horizontal_m") -> ResultTable:
        """Pairs of modes on whose order both tables of the source agree: do the medians, and in how many units?

        Parameters
        ----------
        column : str
            One of :data:`QUANTITIES`.
        """
        k = QUANTITIES.index(column)
        rows: list[tuple[Cell, ...]] = []
        for better, worse in agreed_order(column):
            share = float(np.mean(self.rms[:, better, k] < self.rms[:, worse, k]))
            ratio = float(self.median[worse, k] / self.median[better, k])
            rows.append((mode_name(*MODES[better]), mode_name(*MODES[worse]), ratio, share))
        return ResultTable(
            f"drive {self.number}, {column}: orders on which both drives of the source agree",
            ("better", "worse", "ratio_of_medians", "share_of_units"), tuple(rows),
            (f"{sum(r[2] > 1.0 for r in rows)} of {len(rows)} hold for the medians",), self.complete,  # type: ignore[operator]
        )  # fmt: skip

    def table(self, quantities: Sequence[str] = QUANTITIES) -> ResultTable:
        """Median, 16 % and 84 % quantiles, and the source's."""
        columns = ["mode"]
        for name in quantities:
            columns += [name, f"low_{name}", f"high_{name}", f"source_{name}"]
        low, high = self.between()
        published = np.array(PRINTED_MODES[self.number])
        rows: list[tuple[Cell, ...]] = []
        for i, mode in enumerate(MODES):
            cells: list[Cell] = [mode_name(*mode)]
            for name in quantities:
                k = QUANTITIES.index(name)
                cells += [float(x[i, k]) for x in (self.median, low, high, published)]
            rows.append(tuple(cells))
        length, lost = DRIVES[self.number]
        what = "the calibrated full solution" if self.against == "full" else "truth"
        again = "new switch-on before the drive" if self.turn_on == "repeatability" else "same switch-on"
        residual = np.median(self.stated_errors, axis=0)
        return ResultTable(
            f"Field-calibrated MPU-6000, drive {self.number}, {len(self)} units, {again}: RMS against {what}",
            tuple(columns),
            tuple(rows),
            (
                f"{length:g} s, outage {lost:g} s; RMS over the run, of partial GPS over the outage; median of the "
                "units, low and high: 16 and 84 % of them",
                *(
                    f"{name}: the filter is told {a / MG:.2g} mg and {w / DEG:.2g} deg/s (medians)"
                    for name, (a, w) in zip(("raw", "calibrated"), residual, strict=True)
                ),
            ),
            self.complete,
        )

    def plot(self, **options: Any) -> Figure:
        """Errors by mode beside the source's (matplotlib), see
        :mod:`schuler.reproduce.yaman.study.mode_figures`.
        """
        from schuler.reproduce.yaman.study.mode_figures import modes_figure

        return modes_figure(self, **options)

    def summary(self, quantities: Sequence[str] = QUANTITIES[:2]) -> str:
        """The table of some quantities as text."""
        return self.table(quantities).summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict() | {"rms": self.rms.tolist(), "told": self.stated_errors.tolist()}


def field_drives(
    drive: int | DriveScene,
    units: int = 20,
    *,
    turn_on: TurnOn = "repeatability",
    against: Literal["full", "truth"] = "full",
    seed: int = 1,
    share: float = 1.0,
) -> FieldDrives:
    """Draw units, calibrate each with its routine, drive it, and navigate in the nine modes.

    Parameters
    ----------
    drive : {1, 2} or DriveScene
        The latter where one is at hand: simulating a drive takes some seconds.
    units : int
    turn_on : {"repeatability", "none"}
        Between routine and drive: switched off and on, biases move by a documented repeatability; or it stayed on.
    against : {"full", "truth"}
        What errors are measured against; ``full`` is the source's: the calibrated IMU with full GPS.
    seed : int
        Units, their noise and the drives' GNSS are the same whatever the other arguments.
    share : float
        How bad the units are, see :meth:`FieldUnit.draw`; what is told of raw ones does not depend on it.

    Returns
    -------
    FieldDrives
        On Ctrl-C the units that were finished.

    References
    ----------
    Yaman (2017), chapter 6, tables 6.2 and 6.3.
    """
    if against not in ("full", "truth"):
        raise InputError(f"against: expected 'full' or 'truth', got {against!r}")
    if units < 1:
        raise InputError(f"units: expected one or more, got {units!r}")
    scene = drive if isinstance(drive, DriveScene) else DriveScene.of(drive, 100.0)
    turned = routine_scene(thesis_routine(), scene.ideal.rate_hz)
    rms: list[FloatArray] = []
    residual: list[FloatArray] = []
    complete = True
    try:
        for child in np.random.SeedSequence(seed).spawn(units):
            of_unit, of_routine, of_drive = (np.random.default_rng(s) for s in child.spawn(3))
            calibrated = calibrate_unit(FieldUnit.draw(of_unit, turn_on, share=share), turned, of_routine)
            logs = drive_logs(scene, calibrated, of_drive)
            levels = np.array([remaining(calibrated, logs.raw.need_imu(), raw=raw) for raw in (True, False)])
            rms.append(nine_modes(logs, levels, against=against))
            residual.append(levels)
    except KeyboardInterrupt:
        complete = False
    return FieldDrives(
        scene.number, turn_on, against, np.array(rms).reshape(-1, len(MODES), len(QUANTITIES)),
        np.array(residual).reshape(-1, 2, 2), complete,
    )  # fmt: skip


def nine_modes(drive: Drive, residual: FloatArray, *, against: Literal["full", "truth"] = "full") -> FloatArray:
    """RMS errors of the nine modes on a drive.

    Parameters
    ----------
    drive : Drive
    residual : ndarray, shape (2, 2)
        What the filter is told of the errors of accelerometers [m/s^2] and gyroscopes [rad/s], raw and calibrated.
    against : {"full", "truth"}

    Returns
    -------
    ndarray, shape (9, 7)
    """
    if against == "full":
        reference = _run(drive, "Full", True, False, residual).trajectory
    else:
        reference = drive.raw.need_reference().full()
    rms = []
    for gps, calibrated, aided in MODES:
        estimate = _run(drive, gps, calibrated, aided, residual).trajectory
        rms.append(rms_errors(estimate, reference, drive.outage if gps == "Partial" else None))
    return np.array(rms)


def config_with_errors_as_noise(config: NavigationConfig, accel: float, gyro: float) -> NavigationConfig:
    """A mode's configuration with errors that no state takes told as noise, ``N = b sqrt(T)`` as in drive_modes.

    Parameters
    ----------
    config : NavigationConfig
    accel, gyro : float
        b. [m/s^2], [rad/s]
    """
    root = float(np.sqrt(1.0 / GNSS_RATE_HZ))
    imu = config.imu.model_copy(
        update={
            "gyro": {
                "noise_deg_s_rthz": float(np.hypot(GYRO_NOISE, gyro * root)) / DEG, "density": "two-sided",
                "bias_deg_s": gyro / DEG,
            },
            "accel": {
                "noise_ug_rthz": float(np.hypot(ACCEL_NOISE, accel * root)) / UG, "density": "two-sided",
                "bias_mg": accel / MG,
            },
        }
    )  # fmt: skip
    return config.model_copy(update={"imu": imu})


def _run(drive: Drive, gps: Gps, calibrated: bool, aided: bool, residual: FloatArray) -> NavigationResult:
    recording = drive.calibrated if calibrated else drive.raw
    accel, gyro = residual[int(calibrated)]
    config = config_with_errors_as_noise(mode_config(gps, calibrated, aided, drive.outage), float(accel), float(gyro))
    start = _start(recording, calibrated, float(accel))
    if gps == "None":
        recording = replace(recording, gnss=None)  # it must not help to find rest either
    result = navigate(recording, config.untuned(), initial=start)
    if not result.complete:
        raise KeyboardInterrupt
    return result


def _start(recording: Recording, calibrated: bool, accel: float) -> InitialState:
    """The levelled start of drive_modes, its tilt as uncertain as these accelerometers make it."""
    levelled = levelled_start(recording, calibrated)
    tilt = float(np.arctan(accel / 9.8))
    return InitialState.from_sigmas(
        levelled.nav, StateLayout({}), attitude=np.array([tilt, tilt, 2.0 * DEG]), velocity=np.full(3, 0.02),
        position=np.array([1.9, 1.9, 5.1]),
    )  # fmt: skip
