"""Numbers and dates in fixed columns, against Python's own conversion of each text."""

import datetime as dt

import numpy as np
import pytest

from schuler.recording.formats.rinex_columns import leap_seconds_at, numbers, observed, satellites, whole_seconds
from schuler.timebase import LeapSecondWarning, gps_from_calendar

SYSTEMS = "GRECJIS"


def chars(texts, width):
    return np.array([list(t.ljust(width).encode()) for t in texts], dtype=np.uint8)


def test_numbers_of_any_form():
    texts = ["1", " -2.5 ", ".5D-03", "-.25d+01", "1.0E2", "+7", "", "   ", "-0.0"]
    values, wrong = numbers(chars(texts, 8))
    np.testing.assert_array_equal(values, [1, -2.5, 0.5e-3, -2.5, 100, 7, np.nan, np.nan, -0.0])
    assert not wrong.any()


@pytest.mark.parametrize("bad", ["x", "1 2", "1..2", "1.0F2", "-", "nan", "inf", "1e999", "\x00\x00"])
def test_what_is_no_number_is_marked_and_the_others_are_read(bad):
    values, wrong = numbers(chars(["1.5", bad, "", "2D1"], 8))
    np.testing.assert_array_equal(values, [1.5, np.nan, np.nan, 20.0])
    np.testing.assert_array_equal(wrong, [False, True, False, False])


def test_numbers_of_nothing():
    values, wrong = numbers(np.zeros((0, 4, 19), dtype=np.uint8))
    assert values.shape == wrong.shape == (0, 4)


def test_observations_are_the_doubles_python_makes_of_them(rng):
    # exactly: both are the double nearest to the text
    thousandths = np.concatenate((rng.integers(-(10**12), 10**13, 4000), rng.integers(-9999, 9999, 2000), [1, -1, 999]))
    texts = [f"{'-' if k < 0 else ''}{abs(k) // 1000}.{abs(k) % 1000:03d}".rjust(14) for k in thousandths.tolist()]
    values, wrong = observed(chars([t + "19" for t in texts], 16).reshape(1, -1, 16))
    expected = np.array([float(t) for t in texts])
    expected[expected == 0.0] = np.nan
    np.testing.assert_array_equal(values[0], expected)
    assert not wrong.any()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("          .500", 0.5),
        ("         -.500", -0.5),
        ("         0.000", np.nan),
        ("        -0.000", np.nan),
        ("              ", np.nan),
        ("               4", np.nan),
        ("-999999999.999", -999999999.999),
        ("9999999999.999", 9999999999.999),
    ],
)
def test_unusual_observations(text, value):
    values, wrong = observed(chars([text], 16).reshape(1, 1, 16))
    assert not wrong.any()
    np.testing.assert_array_equal(values, [[value]])


@pytest.mark.parametrize(
    "text",
    ["  20576396.77", " 20576396.771", "   20576396.771", "  2057 396.771", "  2057639x.771", "  20576396.7 1",
     "  20576396.77x", "  --576396.771", "  20-76396.771", "         1    ", "  20576396,771", " +20576396.771",
     "  20576396.   ", "1E6       .771"],
)  # fmt: skip
def test_observations_in_other_columns_are_refused(text):
    values, wrong = observed(chars(["         1.000", text], 16).reshape(2, 1, 16))
    np.testing.assert_array_equal(wrong, [[False], [True]])
    np.testing.assert_array_equal(values, [[1.0], [np.nan]])


def test_names_of_satellites():
    sat, wrong = satellites(chars(["G05", "G 5", "R24", "S33", "e01", " 7 ", "  7"], 3), "G", SYSTEMS)
    np.testing.assert_array_equal(sat, [5, 5, 124, 633, 201, 0, 7])
    np.testing.assert_array_equal(wrong, [False, False, False, False, False, True, False])
    _, wrong = satellites(chars(["   ", "G00", "X01", " 05", "G1 ", "GAB", "G-1"], 3), "", SYSTEMS)
    assert wrong.all()


def test_dates_are_those_of_the_calendar(rng):
    moments = [dt.datetime(1980, 1, 6) + dt.timedelta(microseconds=int(us)) for us in rng.integers(0, int(3e15), 300)]
    moments += [dt.datetime(2024, 2, 29, 23, 59, 59), dt.datetime(1999, 12, 31, 0, 0), dt.datetime(2000, 1, 1)]
    rows = np.array([[m.year, m.month, m.day, m.hour, m.minute, m.second + m.microsecond / 1e6] for m in moments])
    whole, part, wrong = whole_seconds(rows)
    assert not wrong.any()
    expected = np.array([gps_from_calendar(m) for m in moments])
    np.testing.assert_allclose(whole + part, expected, rtol=0, atol=5e-7)  # rounding of seconds since 1980
    rows[:, 0] %= 100  # two digits stand for 1980 to 2079
    two_digits, _, wrong = whole_seconds(rows)
    recent = np.array([m.year < 2080 for m in moments])
    assert not wrong[recent].any()
    np.testing.assert_array_equal(two_digits[recent], whole[recent])


@pytest.mark.parametrize(
    "date",
    [(2024, 13, 1, 0, 0, 0), (2024, 0, 1, 0, 0, 0), (2024, 1, 32, 0, 0, 0), (2024, 1, 1, 24, 0, 0),
     (2024, 1, 1, 0, 60, 0), (2024, 1, 1, 0, 0, 61), (1979, 1, 1, 0, 0, 0), (np.nan, 1, 1, 0, 0, 0),
     (2024, 1.5, 1, 0, 0, 0), (2024, 1, 1, 0, 0, -1), (2024, 1, 1, 0, 0, np.nan), (123, 1, 1, 0, 0, 0)],
)  # fmt: skip
def test_impossible_dates_are_marked(date):
    np.testing.assert_array_equal(whole_seconds(np.array([date, (2024, 1, 1, 0, 0, 0)], dtype=float))[2], [True, False])


def test_leap_seconds_of_the_table_of_the_file_and_of_none():
    at = np.array([int(gps_from_calendar(dt.datetime(*d))) for d in ((2016, 12, 31), (2017, 1, 1), (2023, 6, 29))])
    np.testing.assert_array_equal(leap_seconds_at(at, 99), [17.0, 18.0, 18.0])
    late = np.array([int(gps_from_calendar(dt.datetime(2040, 1, 1)))])
    np.testing.assert_array_equal(leap_seconds_at(late, 19), [19.0])
    with pytest.warns(LeapSecondWarning, match="18 s are taken"):
        np.testing.assert_array_equal(leap_seconds_at(late, None), [18.0])
