"""The problem of a field calibration: states, measurements, noise and start from a log and a specification."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks, turning_blocks
from schuler.calibration.field.held_rests import hold_rests, resolve_earth_rate, scale_wander
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.schedule import FREE_ACCEL, BlockNoise, rest_schedule
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.measurements import MeasurementSchedule, merged
from schuler.filtering.states import BLOCKS, StateLayout, layout_for
from schuler.recording.series import ImuSeries, Increments
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

#: 1-sigma of a heading that is not given, once the best of the starts is chosen. [rad]
FREE_HEADING = 1.0
#: A heading of this 1-sigma or less is used as given; another one is searched for, see
#: :func:`schuler.calibration.field.heading.search_heading`. [rad]
GIVEN_HEADING = 0.5
#: 1-sigma of the first levelling, wide beside any accelerometer's error. [rad]
TILT_SIGMA = 0.1
_TURN_ACCEL = 0.5  # largest acceleration by the hand in a sample of a turn that is used [m/s^2]
_LETTERS = "xyz"


@dataclass(frozen=True)
class Problem:
    """Data, model and start that all passes over one log share.

    Attributes
    ----------
    increments : Increments
        From the first rest on.
    schedule : MeasurementSchedule
    layout : StateLayout
    prior : ndarray, shape (m,)
        Parameters before the log.
    llh : ndarray, shape (3,)
        [rad, rad, m]
    noise : BlockNoise
        Noise of the measurements.
    gyro_psd : ndarray, shape (3,)
        [rad^2/s]
    accel_psd : ndarray, shape (3,)
        [m^2/s^3]
    tilt_sigma, heading_sigma : float
        1-sigma of the attitude at the start. [rad]
    options : FilterOptions
    near : bool
        The first pass is linearised near the result: no pass needs more noise for it.
    """

    increments: Increments
    schedule: MeasurementSchedule
    layout: StateLayout
    prior: FloatArray
    llh: FloatArray
    noise: BlockNoise
    gyro_psd: FloatArray
    accel_psd: FloatArray
    tilt_sigma: float
    heading_sigma: float
    options: FilterOptions
    near: bool = False


def field_layout(spec: ImuSpec, options: FieldOptions) -> StateLayout:
    """States of a field calibration: the options' blocks that the specification (or the options) has sigmas for."""
    models = {}
    for name in options.blocks:
        if name in options.models:
            models[name] = options.models[name]
            continue
        try:
            models |= layout_for(spec, (name,)).models
        except InputError:
            continue  # the specification has no sigma for it
    if not models:
        raise InputError(
            f"the specification {spec.name} says nothing on biases, scale factors or misalignments: complete it, "
            "or give models in the options"
        )
    return StateLayout(models)


def parameter_names(layout: StateLayout) -> tuple[str, ...]:
    """Names of the sensor parameters of a layout, in its order."""
    names = []
    for block in layout.models:
        for sensor, axis, source in BLOCKS[block]:
            if source == 0:
                names.append(f"{'b_g' if sensor == 0 else 'b_a'}_{_LETTERS[axis]}")
            elif sensor == 1:
                names.append(f"M_a_{_LETTERS[axis]}{_LETTERS[source - 1]}")
            elif source >= 4:
                names.append(f"M_g_{_LETTERS[axis]}{_LETTERS[source - 4]}")
            else:
                names.append(f"G_g_{_LETTERS[axis]}{_LETTERS[source - 1]}")
    return tuple(names)


def field_problem(
    imu: ImuSeries,
    spec: ImuSpec,
    blocks: Blocks,
    rests: StaticIntervals,
    layout: StateLayout,
    options: FieldOptions,
    latitude: float,
    height: float,
    gravity: float | None,
    heading: tuple[float, float] | None,
    prior: CalibrationResult | None,
) -> Problem:
    """Problem of a calibration; arguments as in :func:`schuler.calibration.field.calibration.calibrate_field`."""
    llh = np.array([latitude, 0.0, height])
    if not abs(latitude) <= 0.5 * np.pi:
        raise InputError(f"latitude: expected radians within a quarter turn, got {latitude!r}")
    options = resolve_earth_rate(options, spec, blocks, rests)
    noise = block_noise(blocks, spec)
    begin, end = float(rests.start[0]), float(rests.stop[-1])
    increments = imu.increments().between(begin, end)
    if options.earth_rate == "vector":
        early = imu.interval if imu.kind == "increment" else 0.0
        spans = np.stack((rests.start - early, rests.stop), axis=1)
        complete = increments
        increments, blocks = hold_rests(complete, blocks, spans)
        layout = scale_wander(layout, increments, complete)
    common = {
        "gravity": 0.0 if gravity is None else gravity,
        "secondary": options.secondary,
        "secondary_from": begin + options.secondary_from_s,
    }
    schedule = rest_schedule(
        blocks, noise, llh, primary=options.primary, earth_rate=options.earth_rate, **common  # type: ignore[arg-type]
    )  # fmt: skip
    if options.during_turns:
        g = float(np.linalg.norm(earth.gravity_ned(latitude, height))) if gravity is None else gravity
        tolerance = 3.0 * spec.accel.turn_on_bias + 3.0 * g * spec.accel.scale_factor + _TURN_ACCEL
        turning = turning_blocks(imu, rests, rate_hz=10.0, gravity=g, tolerance=tolerance)
        sample = BlockNoise(np.full(3, spec.accel.random_walk), np.full(3, spec.gyro.random_walk))
        parts = rest_schedule(turning, sample, llh, primary=False, earth_rate="off", **common)  # type: ignore[arg-type]
        schedule = merged(schedule, parts)
    schedule = schedule.where((schedule.t > increments.start + 1e-6) & (schedule.t <= increments.t[-1]))
    mean = np.zeros(layout.size - 9)
    if prior is not None:
        layout, mean = prior_from_calibration(layout, prior)
    return Problem(
        increments, schedule, layout, mean, llh, noise, np.full(3, spec.gyro.random_walk**2), np.full(3, FREE_ACCEL**2),
        TILT_SIGMA, FREE_HEADING if heading is None or heading[1] > GIVEN_HEADING else heading[1],
        FilterOptions(record_s=options.record_s, output_rate_hz=1.0, lockout=0),
    )  # fmt: skip


def prior_from_calibration(layout: StateLayout, prior: CalibrationResult) -> tuple[StateLayout, FloatArray]:
    """Layout and prior values of an earlier calibration, with its variances where they are smaller."""
    if prior.gauge != "upper":
        prior = prior.in_gauge("upper")
    mean, models = [], {}
    for block, model in layout.models.items():
        names = parameter_names(StateLayout({block: model}))
        calibrated = [n for n in names if n in prior.names]
        mean += [prior[n][0] if n in calibrated else 0.0 for n in names]
        if len(calibrated) == len(names):
            models[block] = replace(model, sigma=min(model.sigma, float(np.max([prior[n][1] for n in names]))))
        else:
            models[block] = model
    return StateLayout(models), np.array(mean)


def block_noise(blocks: Blocks, spec: ImuSpec) -> BlockNoise:
    """Noise of a mean over one second: the specification's, or the scatter of blocks within rests if that is larger."""
    f, omega = blocks.scatter()
    root = np.sqrt(np.median(blocks.length))
    # a scatter of a few blocks is uncertain itself: only more than 10 % above the specification counts
    f = np.where(np.nan_to_num(f) * root > 1.1 * spec.accel.random_walk, f * root, spec.accel.random_walk)
    omega = np.where(np.nan_to_num(omega) * root > 1.1 * spec.gyro.random_walk, omega * root, spec.gyro.random_walk)
    if not (np.all(f > 0.0) and np.all(omega > 0.0)):
        raise InputError(f"the specification {spec.name} has no noise and the log shows none: give the random walks")
    return BlockNoise(f, omega)


def wandering_parameters(problem: Problem) -> np.ndarray:
    """Mask of parameters that decay, or walk in the log by more than a tenth of their prior sigma. Shape (m,)."""
    rate, density = problem.layout.dynamics().T
    span = float(problem.increments.dt.sum())
    return np.asarray((rate > 0.0) | (density * span > 0.01 * problem.layout.initial_variances()))
