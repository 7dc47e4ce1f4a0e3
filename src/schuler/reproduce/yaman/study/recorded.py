"""Yaman's nine modes on a recorded drive: calibrated from its own start at rest, GNSS as truth, outages withheld.

A start at rest is one pose: it tells the gyroscopes' biases, less what the Earth's rate hides, and one combination of
the accelerometers' parameters, their reading along gravity. The rest keeps the uncertainty of the data sheet. That is
what CIMU means here; nothing is taken from the drive itself but the course in which it begins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import rotation
from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.field.calibration import FieldCalibration, calibrate_field
from schuler.calibration.field.options import FieldOptions
from schuler.exceptions import InputError
from schuler.mechanization.alignment import heading_from_course
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.architectures import compare_architectures
from schuler.navigation.evaluation.errors import TrajectoryErrors, outage_errors
from schuler.navigation.states import imu_spec
from schuler.plotting.table import Cell, ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.reproduce.yaman.study.tables import MODES, PRINTED_MODES, QUANTITIES, agreed_order, mode_name
from schuler.reproduce.yaman.study.unit import reading_sigma
from schuler.sensors.spec import ImuSpec
from schuler.standstill.rests import given_rests
from schuler.units import DEG, MG, UG

Progress = Callable[[float], None]
Windows = tuple[tuple[float, float], ...]

#: Columns of the table; the last is of partial GPS only.
COLUMNS = ("position_horizontal_m", "position_vertical_m", "mean_outage_max_horizontal_m")
#: Modes of :mod:`schuler.navigation.evaluation.modes` by GPS and NG.
_NAMES = {("None", False): "ins", ("None", True): "ins+zupt+nhc", ("Full", False): "loose",
          ("Partial", False): "loose", ("Partial", True): "loose+zupt+nhc"}  # fmt: skip


@dataclass(frozen=True)
class RecordedModes(TabularResult):
    """The nine modes on a recorded drive.

    Attributes
    ----------
    name : str
        Name of the recording.
    states : int or tuple of str
        ``filter.states`` of all modes.
    fit : FieldCalibration
        From the start at rest, in the vehicle's axes.
    stated_errors : ndarray, shape (2, 2)
        1-sigma of the errors of accelerometers [m/s^2] and gyroscopes [rad/s], raw and calibrated.
    rms : ndarray, shape (9, 3)
        Rows as :data:`MODES`, columns as :data:`COLUMNS`; NaN where there is nothing.
    windows : tuple of (start, stop)
        Outages that a solution reaches, one set after the other; seconds from the start of the recording.
    complete : bool
    """

    name: str
    states: int | tuple[str, ...]
    fit: FieldCalibration
    stated_errors: FloatArray
    rms: FloatArray
    windows: Windows
    complete: bool = True

    def value(self, mode: str, column: str = COLUMNS[0]) -> float:
        """One number, such as ``value("Partial, INS+NG")``."""
        names = [mode_name(*m) for m in MODES]
        if mode not in names or column not in COLUMNS:
            raise InputError(
                f"expected a mode of {'; '.join(names)} and a column of {', '.join(COLUMNS)}, got {mode!r}, {column!r}"
            )
        return float(self.rms[names.index(mode), COLUMNS.index(column)])

    def order(self, column: str = COLUMNS[0]) -> ResultTable:
        """Pairs of modes on whose order both tables of the source agree, and the ratio here."""
        k = COLUMNS.index(column)
        rows: list[tuple[Cell, ...]] = []
        for better, worse in agreed_order(column):
            ratio = float(self.rms[worse, k] / self.rms[better, k])
            rows.append((mode_name(*MODES[better]), mode_name(*MODES[worse]), ratio))
        held = sum(float(str(r[2])) > 1.0 for r in rows)
        return ResultTable(
            f"{self.name}, {column}: orders on which both drives of the source agree", ("better", "worse", "ratio"),
            tuple(rows), (f"{held} of {len(rows)} hold",), self.complete,
        )  # fmt: skip

    def table(self) -> ResultTable:
        """The nine modes, and beside them the source's two drives, which were other drives."""
        h, v = (QUANTITIES.index(name) for name in COLUMNS[:2])
        rows: list[tuple[Cell, ...]] = []
        for i, mode in enumerate(MODES):
            if np.isfinite(self.rms[i, 0]):
                cells = [float(x) if np.isfinite(x) else None for x in self.rms[i]]
                source = [PRINTED_MODES[n][i][k] for n in (1, 2) for k in (h, v)]
                rows.append((mode_name(*mode), *cells, *source))
        states = self.states if isinstance(self.states, int) else len(self.states)
        return ResultTable(
            f"{self.name}, states {states}: RMS against GNSS",
            ("mode", *COLUMNS, "source_1_horizontal_m", "source_1_vertical_m", "source_2_horizontal_m",
             "source_2_vertical_m"),
            tuple(rows),
            (
                f"RMS over the run, of partial GPS over {len(self.windows)} outages, "
                f"{sum(b - a for a, b in self.windows):.0f} s in all; the source's drives are others",
                "with full GPS the solution is compared with what it is fed: agreement, not accuracy",
                *(
                    f"{name}: sensor errors of {a / MG:.2g} mg and {w / DEG:.2g} deg/s"
                    for name, (a, w) in zip(("raw", "calibrated"), self.stated_errors, strict=True)
                ),
            ),
            self.complete,
        )  # fmt: skip


def recorded_modes(
    recording: Recording,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    states: int | None = 9,
    first_s: Sequence[float] = (40.0,),
    every_s: float = 45.0,
    length_s: float = 15.0,
    progress: Progress | None = None,
) -> RecordedModes:
    """Calibrate from the start at rest and navigate in the nine modes.

    Parameters
    ----------
    recording : Recording
        That begins at rest, with GNSS that knows when it ends; errors are against its reference or its fixes.
    config : NavigationConfig, dict, or path of a TOML file
        Configuration of this recording, with zero velocity and the wheels' constraint as they suit it.
    states : int, optional
        9 as in the source: no sensor states, and errors that no state takes are told as noise (``N = b sqrt(T)`` with T
        between two fixes, as in :mod:`schuler.reproduce.yaman.study.modes`), raw as the configuration says,
        calibrated as the
        covariance of the calibration says. None: the configuration as it is, raw and calibrated alike.
    first_s : sequence of float
        Start of the first outage, one for each set. [s]
    every_s, length_s : float
        Period and length of outages. [s]
    progress : callable, optional

    Returns
    -------
    RecordedModes
        On Ctrl-C with the modes that were finished.

    Raises
    ------
    InputError
        If the recording does not begin with ten seconds at rest, or a mode cannot run.

    References
    ----------
    Yaman (2017), section 6.2.2.
    """
    config = NavigationConfig.checked(config)
    recording, config = _in_vehicle_axes(recording, config)
    imu, spec = recording.need_imu(), imu_spec(config)
    fit = calibrate_at_rest(recording, config)
    result = fit.calibration
    moving = imu.between(float(fit.rests.stop[-1]), float(imu.t[-1]))
    prior = np.diag([result.prior_sigma[n] ** 2 for n in result.names])
    sigma = np.array([reading_sigma(result.names, P, moving) for P in (prior, result.covariance)])
    logs = (recording, replace(recording, imu=result.apply(imu)))
    stop = float(recording.need_gnss().t[-1]) - recording.start
    sets = [_windows(first, every_s, length_s, stop) for first in first_s]
    rms = np.full((len(MODES), len(COLUMNS)), np.nan)
    reached: Windows = ()
    complete = True
    try:
        for k, (gps, calibrated, aided) in enumerate(MODES):
            used = _configured(config, spec, recording, sigma[int(calibrated)], states)
            windows: list[Windows] = sets if gps == "Partial" else [()]
            errors = [_errors(logs[int(calibrated)], used, _NAMES[gps, aided], w) for w in windows]
            rms[k] = _numbers(errors, windows, recording.start)
            if gps == "Partial":
                reached = tuple(
                    (a, b)
                    for e, some in zip(errors, windows, strict=True)
                    for a, b in some
                    if _inside(e, recording.start, ((a, b),)).any()
                )
            if progress is not None:
                progress((k + 1) / len(MODES))
    except KeyboardInterrupt:
        complete = False
    shown = config.filter.states if states is None else states
    return RecordedModes(recording.metadata.name, shown, fit, sigma, rms, reached, complete)


def _in_vehicle_axes(recording: Recording, config: NavigationConfig) -> tuple[Recording, NavigationConfig]:
    C_bs = rotation.dcm_from_rpy(np.array(config.imu.mount_rpy_deg) * DEG)
    turned = replace(recording, imu=recording.need_imu().rotated(C_bs))
    return turned, config.model_copy(
        update={"imu": config.imu.model_copy(update={"mount_rpy_deg": (0.0, 0.0, 0.0)})}
    )  # fmt: skip


def _configured(
    config: NavigationConfig, spec: ImuSpec, recording: Recording, sigma: FloatArray, states: int | None
) -> NavigationConfig:
    section = config.filter.model_copy(update={"smooth": False})
    if states is None:
        return config.model_copy(update={"filter": section})
    root = float(np.sqrt(np.median(np.diff(recording.need_gnss().t))))
    accel, gyro = (float(x) for x in sigma)
    imu = config.imu.model_copy(
        update={
            "catalogue": None,
            "spec": None,
            "gyro": {
                "noise_deg_s_rthz": float(np.hypot(spec.gyro.random_walk, gyro * root)) / DEG, "density": "two-sided",
                "bias_deg_s": gyro / DEG,
            },
            "accel": {
                "noise_ug_rthz": float(np.hypot(spec.accel.random_walk, accel * root)) / UG, "density": "two-sided",
                "bias_mg": accel / MG,
            },
        }
    )  # fmt: skip
    return config.model_copy(update={"imu": imu, "filter": section.model_copy(update={"states": states})})


def _windows(first: float, every: float, length: float, stop: float) -> Windows:
    starts = np.arange(first, stop - length, every)
    return tuple((float(a), float(a + length)) for a in starts)


def _errors(recording: Recording, config: NavigationConfig, mode: str, windows: Windows) -> TrajectoryErrors:
    comparison = compare_architectures(recording, config, modes=[mode], outages={"one": windows}, smooth=False)
    if not comparison.complete:
        raise KeyboardInterrupt
    row = comparison.rows[0]
    if row.errors is None:
        raise InputError(f"{mode}: {row.failed}")
    return row.errors


def _numbers(errors: Sequence[TrajectoryErrors], windows: Sequence[Windows], origin: float) -> FloatArray:
    """The three numbers of a mode; windows that a solution does not reach are left out."""
    horizontal, vertical, largest = [], [], []
    for e, some in zip(errors, windows, strict=True):
        inside = _inside(e, origin, some) if some else np.ones(len(e.t), dtype=bool)
        horizontal.append(e.horizontal[inside])
        vertical.append(e.position_n[inside, 2])
        largest += [o.max_horizontal for o in outage_errors(e, [(origin + a, origin + b) for a, b in some])]
    H, V = (float(np.sqrt(np.mean(np.concatenate(x) ** 2))) for x in (horizontal, vertical))
    return np.array([H, V, np.mean(largest) if largest else np.nan])


def _inside(e: TrajectoryErrors, origin: float, windows: Windows) -> BoolArray:
    inside = np.zeros(len(e.t), dtype=bool)
    for a, b in windows:
        inside |= (e.t >= origin + a) & (e.t <= origin + b)
    return inside


_MOVING, _BEFORE_S = 0.3, 2.0  # a speed that is no rest [m/s]; how long before it the rest is taken to end [s]
_SHORTEST_S = 10.0
_COURSE_SIGMA = 10.0 * DEG  # a car that drives off turns its wheels


def calibrate_at_rest(recording: Recording, config: NavigationConfig) -> FieldCalibration:
    """Calibrate a vehicle's IMU from the rest before its first motion.

    Parameters
    ----------
    recording : Recording
        IMU in the vehicle's axes.
    config : NavigationConfig
        Its IMU's error budget; noise is that of the log at rest (an engine that idles), and ``alignment.min_speed_m_s``
        says from which speed on the course is the heading.

    Returns
    -------
    FieldCalibration
        Refused, as every calibration in one pose; its values and covariance hold all the same.

    Raises
    ------
    InputError
        If there are less than ten seconds at rest.
    """
    imu, gnss = recording.need_imu(), recording.need_gnss()
    if gnss.v_n is None or gnss.cov_v_n is None:
        raise InputError("the start at rest is found by the speed of GNSS; this series has no velocities")
    t = gnss.t - config.imu.clock_shift_s  # on the clock of the IMU
    speed = np.linalg.norm(gnss.v_n, axis=1)
    moving = (speed > _MOVING) & (t > imu.t[0])
    driving = (speed > config.alignment.min_speed_m_s) & (t > imu.t[0])
    end = float(t[np.argmax(moving)]) - _BEFORE_S if moving.any() else float(imu.t[-1])
    if end - imu.t[0] < _SHORTEST_S or not driving.any():
        raise InputError(
            f"expected at least {_SHORTEST_S:g} s at rest and then a drive, got {max(end - imu.t[0], 0.0):.1f} s until "
            "GNSS moves; give a recording that begins earlier, or calibrate elsewhere"
        )
    k = int(np.argmax(driving))
    sigma_v = float(np.sqrt(max(gnss.cov_v_n[k, 0, 0], gnss.cov_v_n[k, 1, 1])))
    heading, sigma = heading_from_course(gnss.v_n[k], sigma_v, sigma_sideslip=_COURSE_SIGMA)
    start = imu.between(float(imu.t[0]), end)
    # all of it, untested: a car in which people move tilts by a tenth of a degree, and the gyroscopes carry that on
    return calibrate_field(
        start, _standing(imu_spec(config), start), latitude=float(gnss.llh[0, 0]), height=float(gnss.llh[0, 2]),
        heading=(heading, sigma), rests=given_rests(start, [(float(start.t[0]), end)]),
        options=FieldOptions(earth_rate="vertical"),
    )  # fmt: skip


def _standing(spec: ImuSpec, imu: ImuSeries) -> ImuSpec:
    """The budget with the noise of a log at rest: RMS over axes of the scatter of means over a second.

    What shakes on the road is not there at rest; what an idling engine folds into the signal is not on the sheet.
    """
    rates = imu.rates()
    m = round(rates.rate_hz)
    n = len(rates) // m * m
    scatter = [
        float(np.sqrt(np.mean(np.diff(x[:n].reshape(-1, m, 3).mean(axis=1), axis=0) ** 2) / 2.0))
        for x in (rates.accel, rates.gyro)
    ]
    return replace(
        spec, accel=replace(spec.accel, random_walk=scatter[0]), gyro=replace(spec.gyro, random_walk=scatter[1])
    )
