"""From a log and a specification to the problem that all passes work on."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks, turning_blocks
from schuler.calibration.field.filter_pass import Problem
from schuler.calibration.field.heading import FREE, TOLD
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.schedule import FREE_ACCEL, BlockNoise, rest_schedule
from schuler.calibration.field.standstill import as_much_wander, at_standstill
from schuler.calibration.field.swaying import settled_form
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.measurements import merged
from schuler.filtering.states import BLOCKS, StateLayout, layout_for
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

_TILT = 0.1  # 1-sigma of the first levelling, wide beside any accelerometer's error [rad]
_TURN_ACCEL = 0.5  # a hand's acceleration that lets a sample of a turn pass [m/s^2]
_LETTERS = "xyz"


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
            continue  # nothing uncertain about it in the specification
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


def problem_of(
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
    """Measurements, states, noise and start of a calibration; arguments as of :func:`.calibration.calibrate_field`."""
    llh = np.array([latitude, 0.0, height])
    if not abs(latitude) <= 0.5 * np.pi:
        raise InputError(f"latitude: expected radians within a quarter turn, got {latitude!r}")
    options = settled_form(options, spec, blocks, rests)
    noise = block_noise(blocks, spec)
    begin, end = float(rests.start[0]), float(rests.stop[-1])
    increments = imu.increments().between(begin, end)
    if options.earth_rate == "vector":
        early = imu.interval if imu.kind == "increment" else 0.0
        spans = np.stack((rests.start - early, rests.stop), axis=1)
        whole = increments
        increments, blocks = at_standstill(whole, blocks, spans)
        layout = as_much_wander(layout, increments, whole)
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
        uncertain = 3.0 * spec.accel.turn_on_bias + 3.0 * g * spec.accel.scale_factor + _TURN_ACCEL
        turning = turning_blocks(imu, rests, rate_hz=10.0, gravity=g, tolerance=uncertain)
        sample = BlockNoise(np.full(3, spec.accel.random_walk), np.full(3, spec.gyro.random_walk))
        parts = rest_schedule(turning, sample, llh, primary=False, earth_rate="off", **common)  # type: ignore[arg-type]
        schedule = merged(schedule, parts)
    schedule = schedule.where((schedule.t > increments.start + 1e-6) & (schedule.t <= increments.t[-1]))
    mean = np.zeros(layout.size - 9)
    if prior is not None:
        layout, mean = informed(layout, prior)
    return Problem(
        increments, schedule, layout, mean, llh, noise, np.full(3, spec.gyro.random_walk**2), np.full(3, FREE_ACCEL**2),
        _TILT, FREE if heading is None or heading[1] > TOLD else heading[1],
        FilterOptions(record_s=options.record_s, output_rate_hz=1.0, lockout=0),
    )  # fmt: skip


def informed(layout: StateLayout, prior: CalibrationResult) -> tuple[StateLayout, FloatArray]:
    """Prior values of an earlier calibration, and its variances where they are smaller than the specification's."""
    if prior.gauge != "upper":
        prior = prior.in_gauge("upper")
    mean, models = [], {}
    for block, model in layout.models.items():
        names = parameter_names(StateLayout({block: model}))
        known = [n for n in names if n in prior.names]
        mean += [prior[n][0] if n in known else 0.0 for n in names]
        if len(known) == len(names):
            models[block] = replace(model, sigma=min(model.sigma, float(np.max([prior[n][1] for n in names]))))
        else:
            models[block] = model
    return StateLayout(models), np.array(mean)


def block_noise(blocks: Blocks, spec: ImuSpec) -> BlockNoise:
    """Noise of a mean over one second: the specification's, or what blocks of one rest differ by, if that is more."""
    f, omega = blocks.scatter()
    root = np.sqrt(np.median(blocks.length))
    # a scatter of few blocks is uncertain itself: 10 % more than stated is not believed
    f = np.where(np.nan_to_num(f) * root > 1.1 * spec.accel.random_walk, f * root, spec.accel.random_walk)
    omega = np.where(np.nan_to_num(omega) * root > 1.1 * spec.gyro.random_walk, omega * root, spec.gyro.random_walk)
    if not (np.all(f > 0.0) and np.all(omega > 0.0)):
        raise InputError(f"the specification {spec.name} has no noise and the log shows none: give the random walks")
    return BlockNoise(f, omega)
