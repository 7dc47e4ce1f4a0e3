"""One unit of a static test: calibrated in the field, levelled, left to itself at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.problem import field_layout, parameter_names
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.recording.series import ImuSeries
from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, simulated_unit
from schuler.simulation.steps import Rest

#: What is navigated with: raw data, gyroscopes calibrated, everything calibrated.
VARIANTS = ("raw", "gyro", "full")


@dataclass(frozen=True)
class StaticJob:
    """Settings that all units of a static test share.

    Attributes
    ----------
    field : FieldJob
        Calibration: specification, routine, options.
    level_s : float
        Rest after the routine over which the accelerometers are averaged to level. [s]
    seconds : float
        Free navigation after that. [s]
    """

    field: FieldJob
    level_s: float = 10.0
    seconds: float = 60.0

    @property
    def with_rest(self) -> FieldJob:
        """The job with the rest behind the routine."""
        routine = self.field.routine
        rest = Rest(self.level_s + self.seconds)
        return replace(self.field, routine=replace(routine, steps=(*routine.steps, rest)))


class StaticUnit(NamedTuple):
    """One unit: times (k,) [s]; errors (3, k, 3) by variant, north, east, down [m]; covariance (k, 3, 3) of full."""

    t: FloatArray
    error: FloatArray
    covariance: FloatArray


def static_unit(job: StaticJob, child: np.random.SeedSequence) -> StaticUnit | str:
    """Calibrate one unit and let it drift three times; the reason where the calibration could not be done."""
    complete = job.with_rest
    (imu, _), _, heading = simulated_unit(complete, child)
    end = job.field.routine.duration
    try:
        calibration = calibrated(job.field, imu.between(imu.t[0], end), heading).calibration
    except (InputError, np.linalg.LinAlgError) as error:
        return f"{type(error).__name__}: {error}"
    # what somebody told is wrong by the same angle here
    C_nb = job.field.routine.attitudes[-1]
    wrong = heading - float(job.field.routine.rpy_nb[2])
    yaw = float(rotation.rpy_from_dcm(C_nb)[2]) + wrong
    llh = np.array(job.field.place)
    rest = imu.between(end + 0.5 / complete.rate_hz, np.inf)
    errors = []
    for log in (rest, gyro_calibrated(calibration, rest), calibration.apply(rest)):
        nav = levelled(log, llh, yaw, job.level_s)
        track = mechanize(log.increments().between(nav.t, np.inf), nav)
        errors.append(_ned(track.r_eb_e, llh))
    initial, layout = calibrated_start(calibration, job, nav, log)
    t, covariance = predicted(initial, layout, rest, job)
    keep = np.searchsorted(track.t, t - 1e-6)
    return StaticUnit(t - nav.t, np.array(errors)[:, keep], covariance)


def gyro_calibrated(result: CalibrationResult, imu: ImuSeries) -> ImuSeries:
    """The log with the errors of the gyroscopes taken out and the accelerometers as they came."""
    errors = replace(result.errors, b_a=np.zeros(3), M_a=np.zeros((3, 3)))
    if imu.kind == "increment":
        gyro, accel = errors.compensate_increments(imu.gyro, imu.accel, imu.interval)
    else:
        gyro, accel = errors.compensate_rates(imu.gyro, imu.accel)
    return replace(imu, gyro=gyro, accel=accel)


def levelled(imu: ImuSeries, llh: FloatArray, yaw: float, level_s: float) -> NavState:
    """State at rest at the end of the first ``level_s`` seconds, roll and pitch from their mean specific force.

    Raises
    ------
    InputError
        If x points up or down, where roll and pitch cannot be told from it.

    References
    ----------
    Yaman (2017), section 6.2.1.1: ``phi = atan2(-fy, -fz)``, ``theta = atan2(fx, sqrt(fy^2 + fz^2))``.
    """
    log = imu.increments()
    first = log.between(log.start, log.start + level_s)
    f = first.dv_ib_b.sum(axis=0) / first.dt.sum()
    if np.hypot(f[1], f[2]) < 0.3 * np.linalg.norm(f):
        raise InputError("static test: the routine ends with the nose up or down; end it level, with a turn")
    rpy = np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), yaw])
    return NavState.from_geodetic(float(first.t[-1]), llh, np.zeros(3), rpy)


def calibrated_start(
    result: CalibrationResult, job: StaticJob, nav: NavState, compensated: ImuSeries
) -> tuple[InitialState, StateLayout]:
    """State after calibration and levelling: parameters with covariance, and the tilt that goes with them.

    Parameters
    ----------
    result : CalibrationResult
    job : StaticJob
    nav : NavState
        Levelled with compensated data.
    compensated : ImuSeries
        The log it was levelled with.

    Returns
    -------
    initial : InitialState
    layout : StateLayout
    """
    spec = job.field.spec
    layout = field_layout(spec, job.field.options)
    if parameter_names(layout) != result.names:
        raise InputError(f"expected a calibration with {parameter_names(layout)}, got {result.names}")
    log = compensated.increments().between(-np.inf, nav.t)
    f = log.dv_ib_b.sum(axis=0) / log.dt.sum()
    J = np.zeros((3, len(result.names)))
    for k, name in enumerate(result.names):
        if name[2] == "a":
            J["xyz".index(name[4]), k] = 1.0 if name.startswith("b") else f["xyz".index(name[5])]
    # the levelled force has no horizontal part: dpsi x f_n = C db, f_n = (0, 0, -g)
    C_nb = rotation.dcm_from_rpy(nav.rpy_nb)
    g = float(np.linalg.norm(earth.gravity_ned(job.field.place[0], job.field.place[2])))
    tilt = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / g @ C_nb
    psi = tilt @ np.linalg.solve(np.eye(3) + result.errors.M_a, J)
    P = np.zeros((layout.size, layout.size))
    P[9:, 9:] = result.covariance
    P[:3, 9:] = psi @ result.covariance
    P[9:, :3] = P[:3, 9:].T
    P[:3, :3] = psi @ result.covariance @ psi.T + spec.accel.random_walk**2 / job.level_s * tilt @ tilt.T
    P[2, 2] += job.field.heading_sigma**2
    return InitialState(nav, P, result.values.copy()), layout


def predicted(
    initial: InitialState, layout: StateLayout, imu: ImuSeries, job: StaticJob
) -> tuple[FloatArray, FloatArray]:
    """Times [s] and position covariance north, east, down [m^2] of free navigation, every second."""
    spec = job.field.spec
    psd = (np.full(3, spec.gyro.random_walk**2), np.full(3, spec.accel.random_walk**2))
    log = imu.increments().between(initial.nav.t, np.inf)
    forward = run(log, MeasurementSchedule.empty(), initial, layout, *psd, FilterOptions(record_s=1.0))
    C_en = frames.C_en(initial.nav.llh)
    P = unpack_symmetric(forward.rec_P, layout.size)[:, 6:9, 6:9]
    return forward.rec_t, C_en.T @ P @ C_en


def _ned(r_eb_e: FloatArray, llh: FloatArray) -> FloatArray:
    return np.asarray((r_eb_e - frames.ecef_from_llh(llh)) @ frames.C_en(llh))
