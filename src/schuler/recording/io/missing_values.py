"""Values that rows of a table lack: slow sensors between their readings, fixes without a course, or without a place."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import columns, lines
from schuler.recording.io.raw import HUGE, Raw
from schuler.recording.io.text_head import Opening

NONE = -1.0  # speed and course of a fix without one
_CELSIUS = (-100.0, 300.0)  # temperatures of an IMU at work [degC]
_ELSEWHERE = 0.1  # usual size of latitude and longitude, in whatever unit, beside which zeros of both are no place


def load(
    opening: Opening, names: list[str], indices: list[int], *, allow_truncated: bool = False
) -> tuple[FloatArray, bool]:
    """Numbers of the used columns; NaN where a slow sensor or a fix has an empty field.

    Parameters
    ----------
    opening : Opening
    names, indices : list
        Columns wanted, short names and positions.
    allow_truncated : bool
        See :func:`schuler.recording.io.lines.load`.

    Returns
    -------
    values : ndarray, shape (n, len(names))
    truncated : bool

    Raises
    ------
    FileFormatError
        With the line of the first fault; a word is one in every column.
    """
    table, n_columns = opening.table, len(opening.fields)
    fix = "lat" in names and "ax" not in names  # which may have nothing but its time
    slow = {*columns.MAG, "temp", *columns.OVER_GROUND, *(set(names) - {"t"} if fix else ())}
    slower = [k for k, name in enumerate(names) if name in slow]
    try:
        return lines.load(table, n_columns, indices, allow_truncated=allow_truncated)
    except FileFormatError:
        if not slower:
            raise
    others = [k for k in range(len(names)) if k not in slower]
    used = [indices[k] for k in others]
    loaded, truncated = lines.load(table, n_columns, used, allow_truncated=allow_truncated)
    values = np.full((len(loaded), len(names)), np.nan)
    values[:, others] = loaded
    for row, (number, fields) in zip(values, table.rows(), strict=False):
        for k in slower:
            field = fields[indices[k]]
            if lines.is_number(field):
                row[k] = float(field)
            elif not lines.is_value(field) and names[k] not in columns.MAG:
                what = f"column {indices[k] + 1}: expected a number or nothing, got {lines.shorten(field)}"
                raise FileFormatError(f"{what}; correct the line, or skip the column with -", table.path, number)
    return values, truncated


def _leave_out_twice(raw: Raw) -> None:
    """Leave out fixes that are the same as the one before, time and all: they were written twice."""
    if "t" not in raw.values or len(raw.values["t"]) < 2:
        return
    same = np.all([values[1:] == values[:-1] for values in raw.values.values()], axis=0)
    if same.any():
        raw.keep(np.flatnonzero(np.concatenate(([True], ~same))))
        raw.notes.append(f"{int(same.sum())} rows that are the same as the one before were left out.")


def settle(raw: Raw, series: str) -> None:
    """Fill, mark or leave out what a table may lack, in place, and note it.

    Parameters
    ----------
    raw : Raw
        As in the file. Of an IMU the temperature is interpolated between its readings, the magnetometer held; a fix
        may lack its speed and course, and one without latitude, longitude or height is none.
    series : str
        What the table is read as.
    """
    if series == "imu":
        _interpolate_temperature(raw)
        _hold_magnetometer(raw)
    if series == "gnss":
        _leave_out_twice(raw)
        for name in [n for n in columns.OVER_GROUND if n in raw.values and "lat" in raw.values]:
            empty = np.isnan(raw.values[name])
            if empty.any():
                raw.values[name] = np.where(empty, NONE, raw.values[name])
                raw.notes.append(f"{int(empty.sum())} rows have no {name}: it is not known there.")
        _without_place(raw)


def _without_place(raw: Raw) -> None:
    """Leave out fixes whose place is no number, or zero in latitude and longitude where the others are elsewhere."""
    here = [name for name in (*columns.GEODETIC, *columns.LOCAL, *columns.ECEF) if name in raw.values]
    if not here:
        return
    place = np.stack([raw.values[name] for name in here], axis=1)
    nowhere: BoolArray = np.asarray(np.isnan(place).any(axis=1))
    if raw.has(("lat", "lon")):
        size = np.abs(raw.values["lat"]) + np.abs(raw.values["lon"])
        zero = size == 0.0
        if zero.any() and (~zero & ~nowhere).any() and np.median(size[~zero & ~nowhere]) > _ELSEWHERE:
            nowhere |= zero
    if not nowhere.any():
        return
    if nowhere.all():
        raise raw.fault(f"no row has a number in all of {', '.join(here)}: there is no fix in it")
    raw.keep(np.flatnonzero(~nowhere))
    count = int(nowhere.sum())
    raw.notes.append(f"{count} of {len(nowhere)} rows of fixes have no place ({', '.join(here)}) and were left out.")


def leave_out_counted_temperature(raw: Raw) -> None:
    """Leave out a temperature without a unit that cannot be degrees Celsius: counts, hundredths of a degree."""
    low, high = _CELSIUS
    if not low < (middle := float(np.median(raw.values["temp"]))) < high:
        del raw.values["temp"]
        raw.notes.append(
            f"The temperature was left out: its unit is not stated, and {middle:g} degC no IMU has (units='temp=...')."
        )


def _interpolate_temperature(raw: Raw) -> None:
    temperature = raw.values.get("temp")
    if temperature is None or not (empty := np.isnan(temperature)).any():
        return
    if empty.all():
        del raw.values["temp"]
        raw.notes.append("The temperature has no readings and is left out.")
        return
    rows = np.arange(len(temperature))
    raw.values["temp"] = np.interp(rows, rows[~empty], temperature[~empty])
    raw.notes.append(f"{int(empty.sum())} rows have no temp: it was interpolated.")


def _hold_magnetometer(raw: Raw) -> None:
    """Hold readings of a magnetometer that is sampled more slowly; leave out one without all of its axes."""
    here = [name for name in columns.MAG if name in raw.values]
    if not here:
        return
    good = np.logical_and.reduce([np.abs(raw.values[name]) <= HUGE for name in here])
    if len(here) < 3 or not good.any():
        why = "has not all three axes" if len(here) < 3 else "has no readings"
        raw.notes.append(f"The magnetometer {why} and is left out.")
        for name in here:
            del raw.values[name]
    elif not good.all():
        latest = np.maximum.accumulate(np.where(good, np.arange(len(good)), np.argmax(good)))
        raw.notes.append(f"The magnetometer has readings in {good.sum()} of {len(good)} rows, held in between.")
        for name in here:
            raw.values[name] = raw.values[name][latest]
