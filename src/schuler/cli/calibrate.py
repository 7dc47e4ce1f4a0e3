"""``schuler calibrate``: one command for each method, the same files and the same JSON from all of them."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from schuler import units as u
from schuler.cli.calibrate_options import CalibrationOptions, Output, Site, numbers_of, sections_of, spans_of
from schuler.cli.calibrate_output import finish
from schuler.cli.output import Flag
from schuler.exceptions import InputError
from schuler.recording.recording import Recording

_OPTIONS = CalibrationOptions()
_SITE, _OUTPUT = Site(), Output()


def sixposition(
    log: Path,
    /,
    *more: Path,
    standard: Flag = False,
    headings: str | None = None,
    min_rest: float = 1.0,
    intervals: Path | None = None,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Six faces up in turn: bias, scale factors and cross-coupling of the accelerometers, bias of the gyroscopes.

    Parameters
    ----------
    log
        File or folder with the unit at rest on its six faces; of one accelerometer, up and down.
    more
        More logs, if each face has its own.
    standard
        Bias and scale factor of each axis by itself instead of all twelve parameters.
    headings
        Heading of each pose in degrees, such as 0,90,...: with --latitude the gyroscopes' response to Earth rate.
    min_rest
        Shortest rest in seconds.
    intervals
        CSV file with the rests: START,STOP in seconds from the start of the log. Default: found.
    """
    from schuler.calibration.bench.one_axis import calibrate_axis_upright, in_all_axes, only_axis
    from schuler.calibration.bench.sixposition import calibrate_sixposition

    began = clock.perf_counter()
    recordings = options.recordings(log, *more, one_axis="accel")
    if (axis := only_axis([recording.need_imu() for recording in recordings])) is not None:
        filled = [replace(recording, imu=in_all_axes(recording.need_imu(), axis)) for recording in recordings]
        result = calibrate_axis_upright(options.poses(filled, min_rest, intervals), axis, gravity=options.site.g)
        return finish(result, log, recordings, options.output, began, site=options.site)
    poses = options.poses(recordings, min_rest, intervals)
    angles = None if headings is None else np.array(numbers_of("--headings", headings)) * u.DEG
    result = calibrate_sixposition(
        poses, gravity=options.site.g, improved=not standard, latitude=options.site.lat, headings=angles,
        gyro=None if _has(recordings, "gyro") else "none",
        field_strength=options.site.field,
    )  # fmt: skip
    return finish(result, log, recordings, options.output, began, site=options.site)


def multiposition(
    log: Path,
    /,
    *more: Path,
    accel_order: Literal[9, 6, 3, 0] = 9,
    gyro_order: Literal["auto", "9", "6", "3", "0"] = "auto",
    table_rate: str | None = None,
    prior: Flag = False,
    fixed: Path | None = None,
    between_triads: Flag = False,
    min_rest: float = 1.0,
    intervals: Path | None = None,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Many poses, no fixture: only the magnitude of gravity and Earth rate (or of a table's rate) is used.

    Parameters
    ----------
    log
        File or folder with the unit at rest in many poses.
    more
        More logs, if poses are in files of their own.
    accel_order
        9: bias, scale factors, non-orthogonality; 6: without non-orthogonality; 3: bias; 0: nothing.
    gyro_order
        The same for the gyroscopes; auto takes as many as the readings justify.
    table_rate
        Rate of a table about the vertical in deg/s for each pose, such as 0,0,30,-30,..., positive counter-clockwise.
    prior
        Add the data sheet of --imu as a prior.
    fixed
        An earlier calibration.yaml whose non-orthogonality is held.
    between_triads
        Estimate the rotation between the triads from the angle between gravity and Earth rate; needs --latitude.
    min_rest
        Shortest rest in seconds.
    intervals
        CSV file with the rests: START,STOP in seconds from the start of the log. Default: found.
    """
    from schuler.calibration.bench.multiposition import calibrate_multiposition
    from schuler.calibration.result.result import CalibrationResult

    began = clock.perf_counter()
    recordings = options.recordings(log, *more)
    poses = options.poses(recordings, min_rest, intervals)
    if not _has(recordings, "gyro"):
        gyro_order = "0"
    table = None if table_rate is None else np.array(numbers_of("--table-rate", table_rate)) * u.DEG
    if table is not None and len(table) != len(poses):
        raise InputError(f"--table-rate: expected {len(poses)} numbers, one for each pose, got {len(table)}")
    result = calibrate_multiposition(
        poses, gravity=options.site.g, latitude=options.site.lat, table_rate=table, accel_order=accel_order,
        gyro_order="auto" if gyro_order == "auto" else int(gyro_order),  # type: ignore[arg-type]
        prior_spec=options.sensor.spec, use_prior=prior, between_triads=between_triads,
        fixed=None if fixed is None else CalibrationResult.from_yaml(fixed),
        field_strength=options.site.field,
    )  # fmt: skip
    return finish(result, log, recordings, options.output, began, site=options.site)


def freepose(
    log: Path,
    /,
    *,
    initial_rest: float | None = None,
    estimate_gyro_bias: Flag = False,
    g_sensitivity: bool | None = None,
    size_effect: Flag = False,
    delay: Flag = False,
    robust: bool = True,
    rests: Literal["auto", "tedaldi"] = "auto",
    min_rest: float = 1.0,
    intervals: Path | None = None,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Put down by hand in many poses: accelerometers from gravity, gyroscopes from the turns between the poses.

    Parameters
    ----------
    log
        File or folder, raw counts too (--units counts,counts).
    initial_rest
        The log begins with so many seconds at rest.
    estimate_gyro_bias
        From the turns, instead of measured at rest.
    g_sensitivity
        Estimate the gyroscopes' sensitivity to specific force too. Default: if the log proves it.
    size_effect
        Estimate the places of the accelerometers too.
    delay
        Estimate the delay of the gyroscopes behind the accelerometers too.
    robust
        Less weight for disturbed poses and turns.
    rests
        tedaldi: found as in the paper and by imu_tk, which needs --initial-rest.
    min_rest
        Shortest rest in seconds; with --rests tedaldi also what is used of each.
    intervals
        CSV file with the rests: START,STOP in seconds from the start of the log. Default: found.
    """
    from schuler.calibration.freepose.calibrate import calibrate_freepose
    from schuler.calibration.freepose.result import OFF, ON

    if rests == "tedaldi" and initial_rest is None:
        raise InputError("--initial-rest: expected the seconds at rest that the log begins with, for --rests tedaldi")
    began = clock.perf_counter()
    (recording,) = options.recordings(log)
    imu = recording.need_imu()
    result = calibrate_freepose(
        imu, gravity=options.site.g, noise=options.sensor.noise, initial_rest_s=initial_rest, robust=robust,
        min_s=min_rest, gyro_bias="estimate" if estimate_gyro_bias else "rest", g_sensitivity=g_sensitivity,
        size_effect=size_effect, delay=delay, rests=rests,
        intervals=None if intervals is None else spans_of(intervals, imu),
        field_strength=options.site.field,
    )  # fmt: skip
    spelt = tuple(v.replace(ON, "--g-sensitivity").replace(OFF, "--no-g-sensitivity") for v in result.verdicts)
    return finish(replace(result, verdicts=spelt), log, [recording], options.output, began, site=options.site)


def ratetable(
    log: Path,
    /,
    *more: Path,
    rates: str,
    min_turn: float = 5.0,
    settle: float = 1.0,
    g_sensitivity: bool = True,
    rate_sigma: float = 0.0,
    min_rest: float = 1.0,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Turned at known rates about its axes: response, bias and g-sensitivity of the gyroscopes.

    Parameters
    ----------
    log
        File or folder with plateaus of constant rate, and rests on the faces for accelerometers and g-sensitivity; of
        one gyroscope, turned both ways.
    more
        More logs of the same session.
    rates
        Rates the table was set to in deg/s, magnitudes, such as 30,60.
    min_turn
        Shortest plateau in seconds.
    settle
        Seconds left out at both ends of a plateau.
    g_sensitivity
        Estimate the sensitivity to specific force.
    rate_sigma
        1-sigma error of the table's rate, relative.
    min_rest
        Shortest rest in seconds.
    """
    from schuler.calibration.bench.one_axis import calibrate_axis_turned, only_axis
    from schuler.calibration.bench.ratetable import calibrate_ratetable
    from schuler.calibration.bench.turns import joined
    from schuler.calibration.bench.turns_in_log import rate_plateaus

    began = clock.perf_counter()
    recordings = options.recordings(log, *more, one_axis="gyro")
    speeds = np.array(numbers_of("--rates", rates)) * u.DEG
    turns, failures = [], []
    for recording in recordings:
        try:
            turns.append(rate_plateaus(recording.need_imu(), speeds, min_s=min_turn, settle_s=settle))
        except InputError as error:
            failures.append(f"{recording.metadata.name}: {error}")
    if not turns:
        raise InputError("; ".join(failures))
    if (axis := only_axis([recording.need_imu() for recording in recordings])) is not None:
        result = calibrate_axis_turned(joined(turns), axis, rate_sigma=rate_sigma)
        return finish(result, log, recordings, options.output, began, site=options.site)
    try:
        poses = options.poses(recordings, min_rest) if _has(recordings, "accel") else None
    except InputError:
        poses = None  # plateaus alone are a calibration of the gyroscopes
    forces = _has(recordings, "accel")  # without them nothing says which way is up
    result = calibrate_ratetable(
        joined(turns), poses, gravity=options.site.g, g_sensitivity=g_sensitivity and forces, latitude=options.site.lat,
        rate_sigma=rate_sigma,
    )  # fmt: skip
    return finish(result, log, recordings, options.output, began, site=options.site)


def ferraris(
    log: Path,
    /,
    *,
    sections: Path | None = None,
    turn_angle: float = 360.0,
    g_sensitivity: bool = True,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Six faces and one turn about each axis by hand: both triads and the g-sensitivity.

    Parameters
    ----------
    log
        File or folder with the session.
    sections
        CSV file with NAME,START,STOP in seconds from the start of the log; names x_p, x_a, x_rot, ... Default: found.
    turn_angle
        Angle of each turn in degrees.
    g_sensitivity
        Estimate the gyroscopes' sensitivity to specific force.
    """
    from schuler.calibration.bench.ferraris import calibrate_ferraris

    began = clock.perf_counter()
    (recording,) = options.recordings(log)
    imu = recording.need_imu()
    named = None if sections is None else sections_of(sections, imu)
    result = calibrate_ferraris(
        imu, named, turn_angle=turn_angle * u.DEG, gravity=options.site.g, g_sensitivity=g_sensitivity,
        latitude=options.site.lat, noise=options.sensor.noise, field_strength=options.site.field,
    )  # fmt: skip
    return finish(result, log, [recording], options.output, began, site=options.site)


def thermal(
    log: Path,
    /,
    *more: Path,
    degree: Literal["auto", "0", "1", "2", "3", "4", "5", "6"] = "3",
    reference_temperature: float | None = None,
    table_step: float | None = None,
    soak: Flag = False,
    min_rest: float = 1.0,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Heated and cooled: biases (from soaks also scale factors) against temperature, with hysteresis.

    Parameters
    ----------
    log
        File or folder with temperature.
    more
        With --soak one log for each temperature.
    degree
        Of the polynomials, or auto.
    reference_temperature
        Where the values hold, in degrees Celsius.
    table_step
        Between knots of the table, in kelvins.
    soak
        Poses at rest at several temperatures instead of one ramp.
    min_rest
        Shortest rest in seconds.
    """
    from schuler.calibration.thermal.calibrate import calibrate_thermal

    began = clock.perf_counter()
    recordings = options.recordings(log, *more)
    if more and not soak:
        raise InputError(f"--soak: expected it with {len(recordings)} logs, a ramp is one; got several logs without it")
    source: Any = (
        [options.poses([recording], min_rest) for recording in recordings] if soak else recordings[0].need_imu()
    )
    result = calibrate_thermal(
        source, degree="auto" if degree == "auto" else int(degree), reference_temperature=reference_temperature,
        table_step=table_step, gravity=options.site.g,
    )  # fmt: skip
    return finish(result, log, recordings, options.output, began, site=options.site)


def _has(recordings: Sequence[Recording], triad: Literal["accel", "gyro"]) -> bool:
    """Whether any log has this triad; zeros hold the place of one that is missing."""
    return any(getattr(recording.need_imu(), triad).any() for recording in recordings)


def poses(
    table: Path,
    /,
    *,
    table_columns: str | None = None,
    table_units: str | None = None,
    site: Site = _SITE,
    output: Output = _OUTPUT,
) -> int:
    """A table of mean readings, one row a pose: both triads, one of them, or one axis beside its reference.

    Parameters
    ----------
    table
        CSV file. Nine poses of any direction or six faces for accelerometers; gyroscopes at rest for their bias; one
        axis and a column reference for bias and scale factor; a magnetometer beside accelerometers.
    table_columns
        Such as ax,ay,az,gx,gy,gz or ax,reference; - skips one. Default: the first line, named as in logs.
    table_units
        Of accelerometers and gyroscopes, such as g,deg/s or gyro=deg/h. Default: those of the first line, as in
        "ax [mg]", else m/s2,rad/s.
    """
    from schuler.calibration.bench.pose_table import calibrate_poses, read_pose_table

    began = clock.perf_counter()
    output.check()
    means = read_pose_table(table, table_columns, table_units)
    result = calibrate_poses(means, gravity=site.g, field_strength=site.field)
    return finish(result, table, [], output, began, site=site)
