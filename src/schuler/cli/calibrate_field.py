"""``schuler calibrate field``: turned by hand between rests, calibrated by the filter that also navigates."""

from __future__ import annotations

import time as clock
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from cyclopts import Parameter

from schuler import units as u
from schuler.arrays import FloatArray
from schuler.cli.calibrate_options import CalibrationOptions, Output, Sensor, Site, numbers_of, spans_of
from schuler.cli.calibrate_output import finish
from schuler.cli.output import Flag, progress
from schuler.exceptions import InputError
from schuler.recording.io.hint_texts import triads_in_counts
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from schuler.calibration.bench.counts import CountFactors
    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.calibration.field.options import FieldOptions
    from schuler.calibration.result.result import CalibrationResult
    from schuler.sensors.spec import ImuSpec

_OPTIONS = CalibrationOptions()
# a specific force at rest further from gravity is no sensor error but another unit
_SANE = (0.7, 1.4)


def field(
    log: Annotated[Path, Parameter(allow_leading_hyphen=True)],  # - is stdin
    /,
    *,
    heading: str | None = None,
    coach: Flag = False,
    bell: Flag = False,
    thesis: Flag = False,
    states: str | None = None,
    during_turns: Flag = False,
    prior: Path | None = None,
    min_rest: float = 2.0,
    intervals: Path | None = None,
    history: Literal["csv", "parquet"] = "csv",
    halves: bool = True,
    options: CalibrationOptions = _OPTIONS,
) -> int:
    """Turned by hand between rests, no fixture: everything from gravity and the Earth's rate, by a 39-state filter.

    Parameters
    ----------
    log
        File or folder of a log of rests and turns, see docs/field-routine.md, raw counts too (--units counts,counts);
        with --coach also one that is still being written, - for lines on stdin, or the address of a source of schuler
        live, such as serial:/dev/ttyUSB0?baud=115200.
    heading
        Of the first rest and its 1-sigma in degrees, such as 90,2. Default: found from the Earth's rate.
    coach
        Say while the log grows what to do next, and when to stop.
    bell
        Ring with each advice of the coach.
    thesis
        As in the source, for comparison: one pass, Earth rate by magnitude.
    states
        What is estimated, out of b_a,b_g,S_a,S_g,M_a,M_g,G_g. Default: all that --imu has an uncertainty for. Without
        b_g the gyroscopes are not used: accelerometers by the size of gravity.
    during_turns
        Use gravity's direction in turns too, not only at rest: for a unit that turns about itself.
    prior
        An earlier calibration.yaml of the unit in the place of --imu's uncertainties.
    min_rest
        Shortest rest in seconds.
    intervals
        CSV file with the rests: START,STOP in seconds from the start of the log. Default: found.
    history
        Format of the file with estimates and uncertainties over the log.
    halves
        Calibrate both halves of sixteen rests and more too, and widen what they contradict.
    """
    began = clock.perf_counter()
    options.output.check()
    spec = _spec(options.sensor)
    field_options = _field_options(thesis, states, during_turns)
    start = _heading(heading)
    if start is None and field_options.secondary == field_options.earth_rate == "off":
        start = (0.0, 1.0)  # nothing depends on it, so it is not looked for
    earlier = None
    if prior is not None:
        from schuler.calibration.result.result import CalibrationResult

        earlier = CalibrationResult.from_yaml(prior)
        if coach and earlier.nominal != (1.0, 1.0):
            raise InputError("--prior: expected a calibration of a log in SI with --coach, got one of a log in counts")
    gravity = None if options.site.gravity is None else options.site.g
    if coach:
        from schuler.cli.calibrate_field_coach import is_stream, run_coach

        if options.site.lat is None:
            raise InputError("--latitude: expected degrees with --coach, gravity and the Earth's rate depend on it")
        recording = run_coach(
            log, spec, latitude=options.site.lat, height=options.site.height, gravity=gravity, heading=start,
            reading=options.reading, bell=bell,
            keep=None if options.output.out is None else options.output.out / "field-log.txt",
            options=field_options, prior=earlier, inspect=options.checking.stop,
        )  # fmt: skip
        recording = options.checking.passed(recording)
        log = Path(recording.metadata.name) if is_stream(log) else log
    elif str(log) == "-":
        raise InputError("-: lines on stdin are for the coach, add --coach; otherwise expected a file or folder")
    else:
        recording = options.checking.passed(options.reading.read(log, uncalibrated=True))
    from schuler.calibration.field.calibration import calibrate_field
    from schuler.standstill.rests import field_rests, given_rests

    imu = recording.need_imu()
    latitude, height, recording = place(options.site, recording)
    spans = None if intervals is None else spans_of(intervals, imu)
    factors = _factors(recording, earlier, gravity_at(options.site, latitude, height), spans)
    if factors is not None:
        imu = factors.to_si(imu)
        earlier, spec = (None, factors.widened(spec)) if earlier is None else (factors.in_si(earlier), spec)
    rests = field_rests(imu, min_s=min_rest) if spans is None else given_rests(imu, spans)
    if len(rests) and (earlier is None or factors is not None):
        _check_units(rests.means(imu)[1])
    with progress("calibrating") as bar:
        calibration = calibrate_field(
            imu, spec, latitude=latitude, height=height, gravity=gravity, heading=start, options=field_options,
            prior=earlier, rests=rests, progress=bar, halves=halves, field_strength=options.site.field,
        )  # fmt: skip
    if factors is not None:
        calibration = _in_counts(calibration, factors)
    return conclude(calibration, log, recording, options.output, began, history, imu, options.site)


def conclude(
    calibration: FieldCalibration,
    log: Path,
    recording: Recording,
    output: Output,
    began: float,
    history: str = "csv",
    before: ImuSeries | None = None,
    site: Site | None = None,
) -> int:
    """Write the files of a field calibration, print it, return the exit code: 2 for a log that is refused.

    ``before`` is the log in SI, for figures of it before and after.
    """
    return finish(
        calibration.calibration, log, [recording], output, began, field=calibration, truth=_truth(recording),
        history=history, before=recording.need_imu() if before is None else before, site=site,
    )  # fmt: skip


def place(site: Site, recording: Recording) -> tuple[float, float, Recording]:
    """Latitude [rad], height [m], and the recording with a note if they are its own."""
    if site.lat is not None:
        return site.lat, site.height, recording
    for what, series in (("GNSS solution", recording.gnss), ("reference", recording.reference)):
        if series is not None and len(series.t):
            lat, _, height = (float(v) for v in np.asarray(series.llh)[0])
            note = f"latitude {lat / u.DEG:.3f} deg and height {height:.0f} m are those of the log's {what}"
            return lat, height, replace(recording, metadata=recording.metadata.noting(note))
    raise InputError(
        "--latitude: expected degrees, gravity and the Earth's rate depend on it, and the log has no position"
    )


def gravity_at(site: Site, latitude: float, height: float) -> float:
    """Gravity as stated, or that of the ellipsoid. [m/s^2]"""
    from schuler.earth import gravity_somigliana

    return float(gravity_somigliana(latitude, height)) if site.gravity is None else site.g


def _factors(
    recording: Recording, earlier: CalibrationResult | None, gravity: float, spans: list[tuple[float, float]] | None
) -> CountFactors | None:
    """What makes a log in counts SI: of the earlier calibration, or found; None for a log in SI."""
    from schuler.calibration.bench.counts import count_factors, factors_of

    triads = triads_in_counts(recording.metadata.notes)
    if earlier is not None and earlier.nominal != (1.0, 1.0):
        return factors_of(earlier)
    if not triads:
        return None
    if earlier is not None:
        raise InputError(
            f"--prior: expected a calibration of a log in counts, as this one is ({' and '.join(triads)}), got one of "
            "a log in SI; give units and factors with --units and --scale, or leave --prior out"
        )
    return count_factors(recording.need_imu(), triads, gravity=gravity, intervals=spans)


def _in_counts(calibration: FieldCalibration, factors: CountFactors) -> FieldCalibration:
    """Result and history of a log that was brought to SI, as those of the log."""
    shift = np.array([factors.shift.get(name, 0.0) for name in calibration.history.names])
    return replace(
        calibration,
        calibration=factors.in_counts(calibration.calibration),
        history=replace(calibration.history, values=calibration.history.values + shift),
        passes=calibration.passes + shift,
    )


def _spec(sensor: Sensor) -> ImuSpec:
    spec = sensor.spec
    if spec is None:
        raise InputError(
            "--imu: expected what is known of the IMU before, 1-sigma of its biases, scale factors and misalignments: "
            "a catalogue name (MPU-6000 fits consumer MEMS, yaman-automotive and yaman-tactical better units) or an "
            "imu.toml that has them"
        )
    return spec


def _field_options(thesis: bool, states: str | None, during_turns: bool) -> FieldOptions:
    from schuler.calibration.field.options import BLOCKS, FieldOptions

    options = FieldOptions.thesis() if thesis else FieldOptions()
    if during_turns:
        options = replace(options, during_turns=True)
    if states is None:
        return options
    blocks = tuple(part.strip() for part in states.split(","))
    unknown = [name for name in blocks if name not in BLOCKS]
    if unknown or len(set(blocks)) != len(blocks):
        raise InputError(f"--states: expected some of {','.join(BLOCKS)}, each once, got {states!r}")
    # the order of the filter, whatever that of the words
    options = replace(options, blocks=tuple(name for name in BLOCKS if name in blocks))
    if "b_g" not in blocks:  # gyroscopes that are off tell nothing of attitudes: gravity by its size only
        options = replace(options, secondary="off", earth_rate="off")
    return options


def _heading(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    values = numbers_of("--heading", text)
    if len(values) != 2 or not values[1] > 0.0 or not np.isfinite(values).all():
        raise InputError(f"--heading: expected DEG,SIGMA in degrees, such as 90,2, got {text!r}")
    return values[0] * u.DEG, values[1] * u.DEG


def _check_units(f: FloatArray) -> None:
    """A log in counts would be calibrated to nonsense: its scale factors are no small errors."""
    ratio = float(np.median(np.linalg.norm(f, axis=1))) / u.G0
    if not _SANE[0] < ratio < _SANE[1]:
        raise InputError(
            f"expected a specific force of about 9.8 m/s^2 at rest, got {ratio * u.G0:.4g}: give units with --units, "
            "for raw counts counts,counts (factors are then found from the log), or what a count is with --scale, such "
            "as accel=0.0006,gyro=0.001 of the units stated"
        )


def _truth(recording: Recording) -> dict[str, float] | None:
    """True biases of a simulated log; they do not depend on the body axes."""
    true = recording.metadata.options.get("truth") or {}
    biases = {f"{name}_{'xyz'[i]}": float(true[name][i]) for name in ("b_a", "b_g") if name in true for i in range(3)}
    return biases or None
