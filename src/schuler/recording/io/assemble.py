"""From raw columns to a recording: units, time scale, axes, heights and the checks, for every table-like format."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files, units
from schuler.arrays import FloatArray
from schuler.files import hashed
from schuler.recording.io import checks, columns, missing_values, over_ground, own
from schuler.recording.io.bursts import spread_bursts
from schuler.recording.io.clock import stamps
from schuler.recording.io.gnss_table import gnss_series, reference_path
from schuler.recording.io.hint_texts import (
    COUNTS,
    COUNTS_NOTE,
    axes_matrix,
    factor,
    parse_columns,
    parse_scale,
    parse_units,
)
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.local_frame import place_local
from schuler.recording.io.polled import samples_once
from schuler.recording.io.raw import COUNTER, HUGE, Raw, check_increasing
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries, OdometerSeries, ScalarSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase

CONVERTED = "Converted to SI"  # how a note on units begins
# a 32-bit counter that begins again: not more often than in two weeks of microseconds, within a pause of this
_MOST_WRAPS, _LONGEST_STEP_S, _STEPS = 300, 1.0, 20.0
SHORTEST_S = 1e-7  # a sample interval below is a wrong unit of time [s]
# size of the Earth's field, 22 to 67 uT; a unit is taken for right up to a factor of four
_EARTH_FIELD = {"T": 45e-6, "gauss": 0.45, "uT": 45.0, "mgauss": 450.0, "nT": 45e3}
_SI = ("s", "m/s^2", "rad/s", "rad", "m", "m/s", "degC", "T", COUNTS)


def recording_from(raw: Raw, hints: ReadHints, *, trusted: bool = False, time: TimeBase | None = None) -> Recording:
    """Recording of one table.

    Parameters
    ----------
    raw : Raw
    hints : ReadHints
    trusted : bool
        The table was written by this package: units and axes are known, gravity is not checked.
    time : TimeBase, optional
        Known meaning of the stamps; otherwise the hint ``time`` says.

    Raises
    ------
    FileFormatError, InputError
        If something is missing, contradictory or impossible; with file and line where there is one.
    """
    with hashed([raw.path]) as sources:
        made, base = series_from(raw, hints, trusted=trusted, time=time)
        metadata = metadata_of(raw.path, hints, base, raw.notes, sources())
    return Recording(**made, metadata=metadata)


def series_from(
    raw: Raw, hints: ReadHints, *, trusted: bool = False, time: TimeBase | None = None
) -> tuple[dict[str, Any], TimeBase]:
    """Series of one table by its name, and the time base; see :func:`recording_from`. Notes go to ``raw.notes``."""
    series = _series(raw, hints)
    headed = series == "gnss" and raw.has(("heading", "speed")) and "course" not in raw.values
    if headed:
        raw.values["course"] = raw.values.pop("heading")
    if others := [name for name in raw.values if name not in columns.BELONGS[series]]:
        raw.notes.append(f"Columns of no use to the {series} series: {', '.join(others)}.")
        raw.values = {name: values for name, values in raw.values.items() if name not in others}
    if series == "imu" or not trusted:
        missing_values.settle(raw, series)
    _check_finite(raw)
    _to_si(raw, hints, series)
    if headed and not (raw.has(columns.GEODETIC) and over_ground.is_course(raw.values)):
        del raw.values["course"]
        raw.notes.append("The heading is not the direction of motion, or nothing moves: it was not used.")
    if raw.has(columns.LOCAL) and "lat" not in raw.values:
        place_local(raw.values, hints, raw.path)
        raw.ellipsoidal = True
    delay = raw.values["received"] - raw.values["t"] if raw.has(("received", "t")) else None
    time = raw.time if time is None else time
    measured = not trusted and hints.kind == "rate" and raw.has((*columns.ACCEL, *columns.GYRO))
    t, base = _time(raw, hints, time, measured)
    if delay is not None and time is None:
        raw.values["received"] = t + delay  # on the time base of t
    made: ImuSeries | GnssSeries | OdometerSeries | ScalarSeries | Trajectory
    if series == "imu":
        made = _imu(raw, hints, t, trusted)
    elif series == "gnss":
        made = gnss_series(raw, hints, t)
    elif series == "odometer":
        made = _odometer(raw, hints, t)
    elif series == "heading":
        made = _heading(raw, hints, t)
    elif series == "height":
        made = _height(raw, hints, t, trusted)
    else:
        made = reference_path(raw, hints, t)
    return {series: made}, base


def metadata_of(
    path: Path, hints: ReadHints, time: TimeBase, notes: Iterable[str], sources: dict[str, str] | None = None
) -> Metadata:
    """Metadata of a file that was read: its name, hash (``sources``, if it is known), hints used, what was done."""
    return Metadata(
        name=hints.name or path.stem,
        time=time,
        sources={path.name: files.sha256(path)} if sources is None else sources,
        axes=(hints.axes or "FRD").upper(),
        notes=tuple(notes),
        options=hints.given(),
    )


def _series(raw: Raw, hints: ReadHints) -> str:
    recognised = columns.series_of(raw.values)
    if hints.series is not None:
        if hints.series == "reference" and "gnss" in recognised:
            return "reference"
        if hints.series == "gnss" and raw.has(columns.LOCAL):
            return "gnss"
        if hints.series == "odometer" and "speed" in raw.values:
            return "odometer"  # of wheels, although it stands beside a position
        if hints.series not in recognised and columns.NUMBER_OF.get(hints.series) not in raw.values:
            raise raw.fault(f"series={hints.series!r}, but the columns are {', '.join(raw.values)}")
        return hints.series
    if len(recognised) != 1:
        what = (
            f"columns of {' and '.join(recognised)}"
            if recognised
            else f"no series in the columns {', '.join(raw.values)}"
        )
        raise raw.fault(
            f"expected one series per table, got {what}; say which with series='imu', or skip columns with -"
        )
    return recognised[0]


def _check_finite(raw: Raw) -> None:
    faults = []
    for name, values in raw.values.items():
        if name in columns.DILUTION:
            continue  # not known at every epoch
        bad = np.flatnonzero(~(np.abs(values) <= HUGE))
        if len(bad):
            faults.append((int(bad[0]), name))
    if faults:
        row, name = min(faults)
        value = raw.values[name][row]
        what = "an impossibly large number" if np.isfinite(value) else "no number"
        raise raw.fault(f"{name} is {value:g}, {what}: correct, fill or delete this row", row)


def _to_si(raw: Raw, hints: ReadHints, series: str) -> None:
    """Scale every column to SI in place and remember its unit."""
    stated, scale = parse_units(hints.units, hints.kind), parse_scale(hints.scale)
    if isinstance(scale, str):
        raise raw.fault(f"scale={scale!r} names an array, which only .mat and .npz files hold; give numbers")
    if "temp" in raw.values and "temp" not in {*stated, *raw.stated, *(scale or {})}:
        missing_values.leave_out_counted_temperature(raw)
    negated = raw.negated | {
        spec.name for spec in (parse_columns(hints.columns) or ([], False))[0] if spec and spec.negated
    }
    if turned := [name for name in raw.values if name in negated]:
        raw.notes.append(f"Signs were changed: {', '.join(turned)}.")
    # the time is seen to by _time; other columns become series, and a view would keep all of the file in memory
    stacked = {"t", *own.JOINED, *columns.EULER} if series in ("imu", "gnss", "reference") else {"t"}
    for name in raw.values:
        group = columns.GROUP[name]
        number = (scale or {}).get(name, (scale or {}).get(group or "", 1.0)) * (-1.0 if name in negated else 1.0)
        if group is None:
            raw.values[name] = _times(raw.values[name], number, name in stacked)
            continue
        unit, in_file = stated.get(group), raw.stated.get(name)
        if (
            unit is not None
            and in_file is not None
            and factor(unit, group, hints.kind) != factor(in_file, group, hints.kind)
        ):
            raise raw.fault(
                f"the file says {name} is in {in_file}, the hint units says {unit}: leave one out (skip the header "
                "with skip=... if it is wrong)"
            )
        unit = unit or in_file
        if unit is None:
            unit = _default_unit(raw, group, name)
        raw.unit[group] = raw.unit.get(group) or unit
        raw.values[name] = _times(raw.values[name], number * factor(unit, group, hints.kind), name in stacked)
    if scale:
        given = ", ".join(f"{n} by {v:g}" for n, v in scale.items())
        raw.notes.append(f"Numbers were multiplied before their units: {given}.")
    used = {g: u for g, u in raw.unit.items() if u not in _SI}
    if used:
        raw.notes.append(f"{CONVERTED}: {', '.join(f'{g} from {u}' for g, u in used.items())}.")


def _times(values: FloatArray, number: float, passing: bool) -> FloatArray:
    """A column times a number; for 1 itself, if it is only passing through or all there is of its memory."""
    return values if number == 1.0 and (passing or values.base is None) else values * number


def _default_unit(raw: Raw, group: str, name: str) -> str:
    if group == "mag":
        return _magnetic_unit(raw)
    if group in ("accel", "gyro"):
        raise raw.fault(
            f"the unit of {name} is not known: say units='g,deg/s' (accelerometer, gyro) or whatever they are; "
            "for raw converter counts units='counts,counts'"
        )
    default = {"t": "s", "temp": "degC", "length": "m", "velocity": "m/s", "angle": "deg"}[group]
    if group == "angle" and name in ("lat", "lon") and raw.has(("lat", "lon")) and group not in raw.unit:
        largest = max(float(np.abs(raw.values[n]).max()) for n in ("lat", "lon"))
        if largest <= np.pi:
            raise raw.fault("latitude and longitude may be degrees or radians: say units='angle=deg' or 'angle=rad'")
    if name == "heading" and group not in raw.unit and float(np.abs(raw.values[name]).max()) <= 2.0 * np.pi:
        raise raw.fault("the heading may be degrees or radians: say units='angle=deg' or 'angle=rad'")
    if name == "sheading" and group in raw.unit:
        return raw.unit[group]  # an accuracy without a unit has that of the heading
    if group not in raw.unit:
        raw.notes.append(f"The unit of {group} is not stated; taken as {default}.")
    return default


def _time(raw: Raw, hints: ReadHints, base: TimeBase | None, measured: bool) -> tuple[FloatArray, TimeBase]:
    """Times of the rows, even where bursts or an IMU read too often show an even rate, and what they count from."""
    n = len(next(iter(raw.values.values())))
    if "t" not in raw.values:
        if hints.rate is None:
            raise raw.fault("there is no time column: name one with columns='t,...', or say its rate, such as rate=100")
        first = 1 if hints.kind == "increment" else 0
        raw.notes.append(f"No time column: stamps are counted at {hints.rate:g} Hz from {first / hints.rate:g} s.")
        raw.values["t"] = (np.arange(n) + first) / hints.rate
        base = base or (TimeBase("local") if hints.time is None else None)
    elif hints.rate is not None:
        raise raw.fault("there is a time column and rate is given: leave rate out, or skip the column with -")
    if base is None:
        _count_on(raw)
    t = raw.values["t"]
    if base is None:
        t, base = stamps(t, hints.time, raw.fault, raw.notes, hints.offset or 0.0)
    if "ax" in raw.values and (evenly := spread_bursts(t)) is not None:
        t, sentence = evenly
        raw.notes.append(sentence)
    check_increasing(raw, t)
    if measured and (once := samples_once(t, [raw.values[name] for name in (*columns.ACCEL, *columns.GYRO)])):
        rows, t, sentence = once
        raw.keep(rows)
        raw.notes.append(sentence)
    step = np.diff(t)
    raw.interval = float(np.median(step)) if len(t) > 1 else 1.0 / (hints.rate or np.nan)
    if len(t) > 1 and raw.interval < SHORTEST_S:
        raise raw.fault(f"the sample interval is {raw.interval:.3g} s: is the unit of time right (units='t=s')?")
    if hints.offset:
        raw.notes.append(f"{hints.offset:g} s was added to every time stamp.")
        t = t + hints.offset
        check_increasing(raw, t)  # a very large offset leaves no digits for the interval
        step = np.diff(t)
    raw.notes += checks.timing_notes(t, step, raw.interval)
    return t if t.base is None else t.copy(), base  # a view would keep all columns of the file in memory


def _count_on(raw: Raw) -> None:
    """Count stamps on where a counter of 32 bits began again at zero."""
    t = raw.values["t"]
    step = np.diff(t)
    back = np.flatnonzero(step < 0.0)
    unit = raw.unit.get("t")
    if not len(back) or unit is None or len(back) > _MOST_WRAPS:
        return
    period = COUNTER * units.factor_for(unit, "time")
    usual = float(np.median(step))
    over = step[back] + period
    if usual > 0.0 and np.all((over > 0.0) & (over < _LONGEST_STEP_S + _STEPS * usual)):
        raw.values["t"] = t + period * np.concatenate(([0.0], np.cumsum(step < 0.0)))
        raw.notes.append(
            f"The counter of 32 bits began again {len(back)} times, first after {t[back[0]]:.6f} s: counted on."
        )


def _imu(raw: Raw, hints: ReadHints, t: FloatArray, trusted: bool) -> ImuSeries:
    triads = {}
    axes = np.eye(3) if trusted else axes_matrix(hints.axes)
    for group, names in (("accel", columns.ACCEL), ("gyro", columns.GYRO)):
        missing = [name for name in names if name not in raw.values]
        if len(missing) == 3 and hints.allows(f"no-{group}"):
            raw.notes.append(f"The log has no {group}: its values are zero and mean nothing.")
            triads[group] = np.zeros((len(t), 3))
        elif missing and hints.allows("one-axis"):
            raw.notes.append(f"The log has no {', '.join(missing)}: their values are zero and mean nothing.")
            for name in missing:
                raw.values[name] = np.zeros(len(t))
            triads[group] = turned(raw, names, axes)
        elif missing:
            raise raw.fault(
                f"expected ax, ay, az, gx, gy and gz, but {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} "
                f"missing: name the columns; if the log has no {group}, pass allow='no-{group}'; if it is in another "
                "file, read the folder with accel= and gyro="
            )
        else:
            triads[group] = turned(raw, names, axes)
    if not trusted:
        if hints.axes is None:
            raw.notes.append("Axes are not stated; taken as forward, right, down.")
        elif not np.array_equal(axes, np.eye(3)):
            raw.notes.append(f"Axes were turned from {hints.axes.upper()} to forward, right, down.")
        _check_imu(raw, hints, t, triads["accel"], triads["gyro"])
    magnetometer = turned(raw, columns.MAG, axes) if raw.has(columns.MAG) else None
    return ImuSeries(t, triads["gyro"], triads["accel"], hints.kind, raw.values.get("temp"), magnetometer)


def _magnetic_unit(raw: Raw) -> str:
    """Unit of a magnetometer that states none, by the size of the Earth's field; counts if there is no such unit."""
    if "mag" in raw.unit or not raw.has(columns.MAG):
        return raw.unit.get("mag", "T")
    size = float(np.median(np.sqrt(sum(raw.values[name] ** 2 for name in columns.MAG))))
    for unit, field in _EARTH_FIELD.items():
        if field / 4.0 <= size <= 4.0 * field:
            sentence = f"The unit of the magnetometer is not stated; by its size, {size:.4g}, it is {unit}."
            break
    else:
        unit, sentence = COUNTS, f"mag: {COUNTS_NOTE}"
    raw.notes.append(sentence)
    return unit


def turned(raw: Raw, names: tuple[str, ...], C_bs: FloatArray) -> FloatArray:
    """Three columns in axes turned by quarter turns, as a matrix product with ``C_bs`` would. Shape (n, 3)."""
    if np.array_equal(C_bs, np.eye(3)):
        return raw.stack(names)
    turned = np.empty((len(raw.values[names[0]]), 3))
    for k, row in enumerate(C_bs):
        j = int(np.argmax(np.abs(row)))
        if row[j] > 0.0:
            turned[:, k] = raw.values[names[j]]
        else:
            np.subtract(0.0, raw.values[names[j]], out=turned[:, k])  # no minus zero
    return turned


def _check_imu(raw: Raw, hints: ReadHints, t: FloatArray, accel: FloatArray, gyro: FloatArray) -> None:
    interval = raw.interval
    if hints.kind == "increment":
        raw.notes.append("The log holds increments over the interval that ends at each stamp.")
        accel, gyro = accel / interval, gyro / interval
    counts = [g for g in ("accel", "gyro") if raw.unit.get(g) == COUNTS]
    if counts:
        raw.notes.append(f"{' and '.join(counts)}: {COUNTS_NOTE}; calibrate before any other use.")
    for group, values, limit, si in (
        ("gyro", gyro, checks.MAX_RATE, "rad/s"),
        ("accel", accel, checks.MAX_FORCE, "m/s^2"),
    ):
        row = None if group in counts else checks.too_large(values, limit)
        if row is None:
            continue
        unit = raw.unit.get(group, si)
        message = (
            f"{group} reaches {np.abs(values[row]).max():.4g} {si} (limit {limit:.4g}): is its unit really {unit}? "
            + _magnitude_advice(group, unit)
        )
        if not hints.allows("magnitude"):
            raise raw.fault(message + "; pass allow='magnitude' if it is right", row)
        raw.notes.append(f"Passed over: {message}")
    if "accel" in counts or hints.allows("one-axis") or (hints.allows("no-accel") and not accel.any()):
        return
    fault, note, row = checks.gravity_fault(
        t, accel, gyro, raw.unit.get("accel", "m/s^2"), interval, hints.kind, hints.rest
    )
    if fault and not hints.allows("norm"):
        raise raw.fault(fault + "; pass allow='norm' if it is right", row)
    if fault:
        raw.notes.append(f"Passed over: {fault}.")
    if note:
        raw.notes.append(note)


def _magnitude_advice(group: str, unit: str) -> str:
    if group == "gyro":
        return "did you mean deg/s?" if unit.startswith("rad") else "counts need scale='gyro=...'"
    return "did you mean mg or m/s^2?" if unit == "g" else "counts need scale='accel=...'"


def _odometer(raw: Raw, hints: ReadHints, t: FloatArray) -> OdometerSeries:
    if "sspeed" in raw.values:
        sigma = raw.values["sspeed"]
    elif hints.sigma_speed is None:
        raise raw.fault(
            "an odometer needs the 1-sigma of its speed: say sigma_speed=... [m/s], or name a column sspeed"
        )
    else:
        sigma = np.full(len(t), hints.sigma_speed)
        raw.notes.append(f"1-sigma of the odometer is taken as {hints.sigma_speed:g} m/s.")
    return OdometerSeries(t, raw.values["speed"], sigma)


def _heading(raw: Raw, hints: ReadHints, t: FloatArray) -> ScalarSeries:
    stated = None if hints.sigma_heading_deg is None else hints.sigma_heading_deg * units.DEG
    sigma = _sigma_of(raw, "sheading", stated, "sigma_heading_deg=... [deg]")
    return ScalarSeries(t, raw.values["heading"], sigma)


def _height(raw: Raw, hints: ReadHints, t: FloatArray, trusted: bool) -> ScalarSeries:
    sigma = _sigma_of(raw, "sh", hints.sigma_height, "sigma_height=... [m]")
    value = raw.values["h"]
    if hints.height == "msl":
        value = value + float(hints.geoid_separation or 0.0)
        raw.notes.append(
            f"Heights above mean sea level were made ellipsoidal with a geoid separation {hints.geoid_separation:g} m."
        )
    elif hints.height is None and not trusted:
        raw.notes.append("Heights are taken as they stand, whatever level they count from: a bias of the barometer.")
    return ScalarSeries(t, value, sigma)


def _sigma_of(raw: Raw, column: str, stated: float | None, hint: str) -> FloatArray:
    """1-sigma of a column, or the stated one for every row; an error with the first row that is not positive."""
    if column in raw.values:
        sigma = raw.values[column]
    elif stated is not None:
        sigma = np.full(len(next(iter(raw.values.values()))), stated)
        raw.notes.append(f"The log has no accuracy: {hint.partition('=')[0]} is used.")
    else:
        raise raw.fault(f"a 1-sigma is needed: say {hint}, or name a column {column}")
    bad = np.flatnonzero(sigma <= 0.0)
    if len(bad):
        raise raw.fault(f"{column}: expected a positive 1-sigma, got {sigma[bad[0]]:g}", int(bad[0]))
    return sigma
