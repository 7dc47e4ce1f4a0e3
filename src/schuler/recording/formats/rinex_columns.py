"""Numbers and dates in fixed columns of many lines at once."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.timebase import GPS_EPOCH, LEAP_TABLE_VALID_TO, UNIX_TO_GPS_S, calendar, gps_from_unix

#: GPS time minus BeiDou time. [s]
BDT_TO_GPS_S = 14.0

_DAY_S, _HOUR_S, _MINUTE_S = 86_400, 3_600, 60
_BLANK, _MINUS, _POINT = 32, 45, 46
_SIGN = 1
_DIGIT = np.zeros(256, dtype=np.uint8)  # blanks and signs count as zero
_DIGIT[48:58] = np.arange(10)
_CLASS = np.full(256, 9, dtype=np.uint8)  # in a number, classes only grow: blanks, a sign, digits
_CLASS[_BLANK], _CLASS[_MINUS], _CLASS[48:58] = 0, _SIGN, 2
_AS_FLOAT = np.arange(256, dtype=np.uint8)  # Fortran's exponents; and zero bytes, which NumPy takes for an end
_AS_FLOAT[[ord("D"), ord("d"), 0]] = ord("E"), ord("E"), ord("?")
_WHOLE, _AT, _DECIMALS = 10, 10, 3  # F14.3: ten columns, the point, three decimals


def numbers(chars: np.ndarray) -> tuple[FloatArray, BoolArray]:
    """Numbers of any form, D exponents too, one a row; NaN for blanks.

    Parameters
    ----------
    chars : ndarray of uint8, shape (..., w)

    Returns
    -------
    values : ndarray, shape (...)
    wrong : ndarray of bool, shape (...)
        Rows that hold something but no finite number; their value is NaN.
    """
    shape, width = chars.shape[:-1], chars.shape[-1]
    flat = np.ascontiguousarray(chars).reshape(-1, width)
    flat = _AS_FLOAT[flat]
    text = np.char.strip(flat.view(f"S{width}")[:, 0]) if len(flat) else np.zeros(0, dtype=f"S{width}")
    blank = text == b""
    values = np.full(len(flat), np.nan)
    try:
        values[~blank] = text[~blank].astype(np.float64)
    except ValueError:
        for k in np.flatnonzero(~blank):
            try:
                values[k] = float(text[k])
            except ValueError:
                continue
    wrong = ~np.isfinite(values) & ~blank
    values[wrong] = np.nan
    return values.reshape(shape), wrong.reshape(shape)


def observed(chars: np.ndarray) -> tuple[FloatArray, BoolArray]:
    """Observations: F14.3 and two digits of quality, which are passed over.

    Parameters
    ----------
    chars : ndarray of uint8, shape (n, m, 16)

    Returns
    -------
    values : ndarray, shape (n, m)
        NaN for blanks and zeros, which both stand for a missing observation.
    wrong : ndarray of bool, shape (n, m)
        Rows that hold something but no number with its point in the eleventh column. A line shifted by a column
        would read as plausible and wrong numbers, so the form is insisted on.

    Notes
    -----
    Digits are put together as a whole number of thousandths and divided once, which gives the same double as a correct
    conversion of the text does.
    """
    n, m = chars.shape[:2]
    # one contiguous row for each column of the text: sums and tests then run along memory
    text = np.ascontiguousarray(chars.reshape(-1, chars.shape[-1])[:, : _AT + 1 + _DECIMALS].T)
    kind, digits = _CLASS[text], _DIGIT[text]
    thousandths = np.zeros(n * m, dtype=np.int64)
    for column in (*range(_WHOLE), *range(_AT + 1, _AT + 1 + _DECIMALS)):
        thousandths *= 10
        thousandths += digits[column]
    signs = kind[:_WHOLE] == _SIGN
    values = thousandths / 10.0**_DECIMALS
    values[signs.any(axis=0)] *= -1.0
    wrong = (text[_AT] != _POINT) | (kind[:_WHOLE] > 2).any(axis=0) | (kind[_AT + 1 :] != 2).any(axis=0)
    # nothing follows a digit but digits, and a sign stands once
    wrong |= (kind[1:_WHOLE] < kind[: _WHOLE - 1]).any(axis=0) | (signs.sum(axis=0, dtype=np.uint8) > 1)
    wrong &= (text != _BLANK).any(axis=0)
    values[(thousandths == 0) | wrong] = np.nan
    return values.reshape(n, m), wrong.reshape(n, m)


def satellites(chars: np.ndarray, default: str, systems: str) -> tuple[IntArray, BoolArray]:
    """Numbers of satellites of names such as ``G05``, ``G 5``, `` 5``. Shapes (n, 3) to (n,).

    Parameters
    ----------
    chars : ndarray of uint8, shape (n, 3)
    default : str
        System of a name without a letter; empty if there must be one.
    systems : str
        Letters in the order of their numbers.

    Returns
    -------
    sat : ndarray of int, shape (n,)
    wrong : ndarray of bool, shape (n,)
    """
    place = np.full(256, -1)
    for k, letter in enumerate(systems):
        place[ord(letter)] = place[ord(letter.lower())] = k
    if default:
        place[_BLANK] = systems.find(default)  # of an unknown system no name is right
    system = place[chars[:, 0]]
    number = 10 * _DIGIT[chars[:, 1]].astype(np.int64) + _DIGIT[chars[:, 2]]
    wrong = (system < 0) | (number == 0) | (_CLASS[chars[:, 2]] != 2) | ~np.isin(_CLASS[chars[:, 1]], (0, 2))
    return np.where(wrong, 0, 100 * system + number), wrong


def whole_seconds(date: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
    """Calendar dates and times to seconds since 1980-01-06 of the same scale.

    Parameters
    ----------
    date : ndarray, shape (n, 6)
        Year (two digits: 1980 to 2079), month, day, hour, minute, second.

    Returns
    -------
    whole : ndarray of int, shape (n,)
        Whole seconds. [s]
    part : ndarray, shape (n,)
        The rest, with all its digits. [s]
    wrong : ndarray of bool, shape (n,)
        Impossible dates.
    """
    year, month, day, hour, minute, second = np.nan_to_num(date, nan=-1.0).T
    two_digits = (year >= 0) & (year < 100)
    year = np.where(two_digits, year + np.where(year < 80, 2000, 1900), year)
    wrong = (year < 1980) | (year > 2200) | (month < 1) | (month > 12) | (day < 1) | (day > 31)
    wrong |= (hour < 0) | (hour > 23) | (minute < 0) | (minute > 59) | (second < 0.0) | (second >= 61.0)
    wrong |= (date[:, :5] != np.round(date[:, :5])).any(axis=1)
    year, month, day = (np.where(wrong, v, x) for v, x in ((1980, year), (1, month), (6, day)))
    months = ((year - 1970) * 12 + month - 1).astype(np.int64).astype("M8[M]")
    days = (months.astype("M8[D]") - np.datetime64(GPS_EPOCH.date())).astype(np.int64) + day.astype(np.int64) - 1
    whole_second = np.floor(np.where(wrong, 0.0, second))
    whole = days * _DAY_S + (hour * _HOUR_S + minute * _MINUTE_S + whole_second).astype(np.int64)
    return np.where(wrong, 0, whole), np.where(wrong, 0.0, second - whole_second), wrong


def leap_seconds_at(whole: IntArray, stated: int | None) -> FloatArray:
    """GPS time minus UTC at UTC seconds since 1980-01-06. Shape (n,). [s]

    Parameters
    ----------
    whole : ndarray of int, shape (n,)
        [s]
    stated : int, optional
        Leap seconds of the file, used for dates beyond the table of :mod:`schuler.timebase`.

    Raises
    ------
    InputError
        Before GPS time began, or after 2100.

    Warns
    -----
    LeapSecondWarning
        Beyond the table, if the file does not say.
    """
    utc = np.asarray(whole, dtype=np.float64)
    if stated is not None and utc.size and abs(utc.max()) < 1e11 and calendar(utc.max()).date() > LEAP_TABLE_VALID_TO:
        return np.full(utc.shape, float(stated))
    return np.round(gps_from_unix(utc + UNIX_TO_GPS_S) - utc)
