"""Time scales against SOFA (pyerfa) and calendars worked out by hand."""

import datetime as dt
import re

import erfa
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schuler import timebase
from schuler.exceptions import InputError
from schuler.recording import Recording
from schuler.recording.io import read, write
from schuler.recording.series import GnssSeries
from schuler.timebase import WEEK_S, TimeBase

LAW = settings(max_examples=300, deadline=None, derandomize=True, database=None)
TAI_MINUS_GPS = 19.0  # [s], fixed since 1980-01-06
FIRST_DAY, SOFA_DAY = dt.date(1980, 1, 6), dt.date(2026, 12, 31)


def unix(moment: dt.datetime) -> float:
    return (moment - dt.datetime(1970, 1, 1)).total_seconds()


def test_leap_seconds_of_every_day_agree_with_sofa():
    """``iauDat`` gives TAI - UTC; GPS time is 19 s behind TAI."""
    days = [FIRST_DAY + dt.timedelta(days=k) for k in range((SOFA_DAY - FIRST_DAY).days + 1)]
    theirs = erfa.dat([d.year for d in days], [d.month for d in days], [d.day for d in days], 0.0) - TAI_MINUS_GPS
    ours = [timebase.leap_seconds(d) for d in days]
    np.testing.assert_array_equal(ours, theirs)
    assert (ours[0], ours[-1]) == (0, 18)


def test_leap_days_are_in_order_and_first_of_january_or_july():
    assert list(timebase.LEAP_DAYS) == sorted(timebase.LEAP_DAYS)
    assert all((month, day) in ((1, 1), (7, 1)) for _, month, day in timebase.LEAP_DAYS)
    assert len(timebase.LEAP_DAYS) == 18


def test_the_leap_second_of_2017_by_the_day():
    assert timebase.leap_seconds(dt.date(2016, 12, 31)) == 17
    assert timebase.leap_seconds(dt.date(2017, 1, 1)) == 18


LATER = dt.date(2035, 7, 1)


@pytest.fixture
def system_list(tmp_path, monkeypatch):
    """A list as IERS publishes it: leap days, and when it expires."""
    path = tmp_path / "leap-seconds.list"
    monkeypatch.setattr(timebase, "_SYSTEM_LIST", path)

    def write(days, expires):
        ntp = [(dt.date(*day) - dt.date(1900, 1, 1)).days * 86_400 for day in ((1972, 1, 1), *days)]
        counts = (10, *(20 + k for k in range(len(days))))
        rows = [f"{t}      {count}      # comment" for t, count in zip(ntp, counts, strict=True)]
        expiry = (expires - dt.date(1900, 1, 1)).days * 86_400
        path.write_text("\n".join(["#", f"#@ {expiry}  # expires", *rows, "#h 1 2 3"]) + "\n")
        timebase._system_leap_days.cache_clear()

    timebase._system_leap_days.cache_clear()
    yield write
    timebase._system_leap_days.cache_clear()


def test_days_beyond_every_table_are_warned_of(system_list):
    """No list, an expired one, one that contradicts ours or is no list: the last count, with a warning."""
    valid_to = timebase.LEAP_TABLE_VALID_TO
    assert timebase.leap_seconds(valid_to) == 18
    own = (*timebase.LEAP_DAYS, (2030, 7, 1)), dt.date(2036, 6, 28)
    system_list(*own)
    assert timebase.leap_seconds(own[1]) == 19  # the last day of a list is one of it
    timebase._SYSTEM_LIST.unlink()
    timebase._system_leap_days.cache_clear()
    with pytest.warns(timebase.LeapSecondWarning, match=rf"known to {valid_to}, got .*: 18 s are taken; update"):
        assert timebase.leap_seconds(valid_to + dt.timedelta(days=1)) == 18
    for days, expires in (
        (timebase.LEAP_DAYS, dt.date(2026, 6, 28)),
        (((1981, 1, 1), *timebase.LEAP_DAYS[1:]), dt.date(2040, 6, 28)),
        (timebase.LEAP_DAYS[:-1], dt.date(2040, 6, 28)),
    ):
        system_list(days, expires)
        with pytest.warns(timebase.LeapSecondWarning, match=f"known to {valid_to}"):
            assert timebase.leap_seconds(LATER) == 18
    timebase._SYSTEM_LIST.write_text("#@ soon\n1 2 3\n")
    timebase._system_leap_days.cache_clear()
    with pytest.warns(timebase.LeapSecondWarning):
        assert timebase.gps_from_unix(np.array([2.1e9]))[0] == 2.1e9 - timebase.UNIX_TO_GPS_S + 18
    with pytest.raises(InputError, match="GPS time starts on 1980-01-06, got 1980-01-05"):
        timebase.leap_seconds(dt.date(1980, 1, 5))


def test_a_newer_list_of_the_system_is_read(system_list):
    """A leap second announced after our table: counted from its day on, in both directions, without a warning."""
    from schuler.recording.io.clock import leaps_at

    system_list((*timebase.LEAP_DAYS, (2030, 7, 1)), dt.date(2036, 6, 28))
    assert timebase.leap_seconds(dt.date(2030, 6, 30)) == 18
    assert timebase.leap_seconds(LATER) == 19
    moment = unix(dt.datetime(2030, 7, 1))
    np.testing.assert_array_equal(
        timebase.gps_from_unix(np.array([moment - 1.0, moment])) - np.array([moment - 1.0, moment]),
        np.array([18.0, 19.0]) - timebase.UNIX_TO_GPS_S,
    )
    gps = timebase.gps_from_calendar(dt.datetime(2030, 7, 1), utc=True)
    assert (leaps_at(gps - 1.5), leaps_at(gps)) == (18, 19)
    with pytest.warns(timebase.LeapSecondWarning, match="known to 2036-06-28"):
        timebase.leap_seconds(dt.date(2036, 7, 1))


def test_week_and_time_of_week_of_a_known_moment():
    """2025-07-08 is the Tuesday of week 2374: 2 days and 19:34:18.499 after Sunday midnight."""
    moment = dt.datetime(2025, 7, 8, 19, 34, 18, 499_000)
    week, tow = timebase.week_tow(timebase.gps_from_calendar(moment))
    assert week == 2374
    assert tow == pytest.approx(243_258.499, abs=1e-6)  # rounding of 1.4e9 s
    # the same reading of a UTC clock is 18 s later
    week, tow = timebase.week_tow(timebase.gps_from_calendar(moment, utc=True))
    assert (week, round(tow, 3)) == (2374, 243_276.499)


@pytest.mark.parametrize(
    ("moment", "week", "tow"),
    [
        ((1980, 1, 6), 0, 0.0),
        ((1980, 1, 12, 23, 59, 59), 0, 604_799.0),
        ((1980, 1, 13), 1, 0.0),
        ((1999, 8, 22), 1024, 0.0),  # first rollover of the ten-bit week number
        ((2019, 4, 7), 2048, 0.0),  # second rollover
        ((2000, 1, 1), 1042, 518_400.0),  # a Saturday
    ],
)
def test_weeks_by_hand(moment, week, tow):
    gps = timebase.gps_from_calendar(dt.datetime(*moment))
    assert timebase.week_tow(gps) == (week, tow)
    assert timebase.gps_seconds(week, tow) == gps
    assert timebase.calendar(gps) == dt.datetime(*moment)


def test_utc_to_gps_agrees_with_sofa(rng):
    """Through ``dtf2d`` and ``utctai``, a hundred random moments between 1980 and 2026."""
    for days in rng.uniform(0.0, (SOFA_DAY - FIRST_DAY).days, 100):
        moment = dt.datetime(1980, 1, 6) + dt.timedelta(seconds=int(days * 86_400))
        utc = erfa.dtf2d("UTC", moment.year, moment.month, moment.day, moment.hour, moment.minute, moment.second)
        tai = erfa.utctai(*utc)
        epoch = erfa.dtf2d("TAI", 1980, 1, 6, 0, 0, 0.0)
        theirs = ((tai[0] - epoch[0]) + (tai[1] - epoch[1])) * 86_400.0 - TAI_MINUS_GPS
        # rounding of a Julian date, split in two
        assert timebase.gps_from_calendar(moment, utc=True) == pytest.approx(theirs, abs=1e-5)


def test_reading_utc_beyond_the_table_is_warned_of_and_gps_time_is_not(system_list):
    late = dt.datetime(2027, 6, 29)
    assert timebase.week_tow(timebase.gps_from_calendar(late))[0] == 2477
    with pytest.warns(timebase.LeapSecondWarning, match="leap seconds are known to"):
        timebase.gps_from_calendar(late, utc=True)


@LAW
@given(st.integers(0, 5000), st.floats(0.0, WEEK_S, exclude_max=True))
def test_weeks_survive_the_round_trip(week, tow):
    gps = timebase.gps_seconds(week, tow)
    back, rest = timebase.week_tow(gps)
    assert 0.0 <= rest < WEEK_S
    assert timebase.gps_seconds(back, rest) == gps
    assert abs((back - week) * WEEK_S + rest - tow) <= 5e-7  # rounding of 3e9 s


@LAW
@given(st.datetimes(dt.datetime(1980, 1, 6), dt.datetime(2050, 1, 1)))
def test_calendars_survive_the_round_trip(moment):
    # rounding of 2e9 s
    assert abs(timebase.calendar(timebase.gps_from_calendar(moment)) - moment) <= dt.timedelta(microseconds=1)


def test_unix_time_of_known_moments():
    assert unix(dt.datetime(1980, 1, 6)) == timebase.UNIX_TO_GPS_S
    for moment in (dt.datetime(1980, 1, 6), dt.datetime(1999, 12, 31, 23), dt.datetime(2025, 7, 8, 19, 34, 18)):
        stamp = np.array([unix(moment)])
        np.testing.assert_array_equal(timebase.gps_from_unix(stamp), [timebase.gps_from_calendar(moment, utc=True)])


def test_unix_time_around_a_leap_second():
    """Unix time takes the stamp of 2017-01-01 00:00:00 right after 23:59:59; two seconds passed."""
    midnight = unix(dt.datetime(2017, 1, 1))
    gps = timebase.gps_from_unix(midnight + np.array([-2.0, -1.0, -0.001, 0.0, 1.0]))
    np.testing.assert_allclose(np.diff(gps), [1.0, 0.999, 1.001, 1.0], rtol=0, atol=1e-6)  # rounding of 1.2e9 s
    assert gps[3] - gps[1] == 2.0
    assert timebase.week_tow(gps[3]) == (1930, 18.0)  # a Sunday, 18 leap seconds


def test_every_leap_second_steps_the_unix_conversion_by_one():
    for leap in timebase.LEAP_DAYS:
        midnight = unix(dt.datetime(*leap))
        before, after = timebase.gps_from_unix(np.array([midnight - 1.0, midnight]))
        assert after - before == 2.0


@pytest.mark.parametrize("shape", [(), (0,), (1,), (2, 3)])
def test_unix_shapes_follow_the_input(shape):
    stamps = np.full(shape, 1.6e9)
    gps = timebase.gps_from_unix(stamps)
    assert np.shape(gps) == shape
    np.testing.assert_array_equal(gps, np.full(shape, 1.6e9 - 315_964_800.0 + 18.0))
    np.testing.assert_array_equal(stamps, np.full(shape, 1.6e9))


def test_unix_times_beyond_the_table_are_warned_of(system_list):
    late = unix(dt.datetime(2027, 6, 29))
    np.testing.assert_array_equal(timebase.gps_from_unix(np.array([late - 1.0])), late - 1.0 - 315_964_800.0 + 18.0)
    with pytest.warns(timebase.LeapSecondWarning, match="leap seconds are known to 2027-06-28, got 2027-06-29"):
        gps = timebase.gps_from_unix(np.array([1.6e9, late, 1.6e9]))
    np.testing.assert_array_equal(gps, np.array([1.6e9, late, 1.6e9]) - 315_964_800.0 + 18.0)


@pytest.mark.parametrize(
    "stamps",
    [[0.0], [0.0, 1.6e9], [1.6e12], [1.6e18], [np.nan], [1.6e9, np.inf]],
    ids=["before GPS time", "one before GPS time", "milliseconds", "nanoseconds", "no number", "infinity"],
)
def test_unix_times_without_a_gps_time_are_refused(stamps):
    """Whatever stands in a log, the answer is an :class:`InputError`, and it does not depend on the other stamps."""
    with pytest.raises(InputError):
        timebase.gps_from_unix(np.array(stamps))


def test_the_clock_of_a_log_is_described_as_such():
    assert TimeBase() == TimeBase("local", 0.0)
    assert TimeBase().describe() == "seconds of the log's own clock"


def test_a_gps_time_base_is_described_by_calendar_and_week():
    epoch = timebase.gps_from_calendar(dt.datetime(2025, 7, 8, 19, 34, 18, 499_000))
    message = "seconds since 2025-07-08T19:34:18.499 GPS (week 2374, 243258.499 s)"
    assert TimeBase("gps", epoch).describe() == message


@pytest.mark.parametrize("fraction", [0.0, 0.499, 0.0006, 0.9994, 0.9996, 0.99999])
def test_both_forms_of_one_epoch_are_the_same_time(fraction):
    """The date and the time of week in one phrase agree to the printed millisecond."""
    epoch = timebase.gps_seconds(2374, 243_258.0) + fraction
    match = re.fullmatch(r"seconds since (\S+) GPS \(week (\d+), (\d+\.\d{3}) s\)", TimeBase("gps", epoch).describe())
    assert match is not None
    from_date = timebase.gps_from_calendar(dt.datetime.fromisoformat(match[1]))
    from_week = timebase.gps_seconds(int(match[2]), float(match[3]))
    assert from_date == pytest.approx(from_week, abs=1e-6)  # rounding of 1.4e9 s
    assert from_week == pytest.approx(epoch, abs=0.0005001)  # printed digits


def test_time_bases_are_values():
    assert TimeBase("gps", 5.0) == TimeBase("gps", 5.0)
    assert hash(TimeBase("gps", 5.0)) == hash(TimeBase("gps", 5.0))
    with pytest.raises(AttributeError):
        TimeBase().scale = "gps"


def test_weeks_before_the_epoch_and_a_moment_that_rounds_to_the_next_week():
    """Weeks are counted down; a time of week is never a whole week."""
    assert timebase.week_tow(-1.0) == (-1, WEEK_S - 1.0)
    assert timebase.week_tow(-1e-12) == (0, 0.0)


def test_the_warning_of_an_unknown_leap_second_points_at_the_caller(system_list):
    with pytest.warns(timebase.LeapSecondWarning) as caught:
        timebase.leap_seconds(timebase.LEAP_TABLE_VALID_TO + dt.timedelta(days=1))
    assert caught[0].filename == __file__


def test_where_notes_are_collected_one_says_it_and_nothing_warns(system_list):
    late = timebase.LEAP_TABLE_VALID_TO + dt.timedelta(days=1)
    with timebase.leap_second_notes() as notes:
        assert timebase.leap_seconds(timebase.LEAP_TABLE_VALID_TO) == 18
        assert not notes
        assert timebase.leap_seconds(late) == timebase.leap_seconds(late + dt.timedelta(days=1)) == 18
    assert len(notes) == 1
    assert notes[0].startswith(f"Leap seconds are known to {timebase.LEAP_TABLE_VALID_TO}, got {late}: 18 s are taken")
    with pytest.warns(timebase.LeapSecondWarning):
        timebase.leap_seconds(late)


@pytest.mark.filterwarnings("error")
def test_a_log_of_utc_beyond_the_table_says_so_in_its_notes_and_files(system_list, tmp_path):
    first = unix(dt.datetime(2028, 3, 1, 12))
    rows = [f"{first + 0.01 * k:.2f},0.0,0.01,-9.81,0.0,0.0,0.0" for k in range(200)]
    path = tmp_path / "imu.csv"
    path.write_text("\n".join(["t,ax,ay,az,gx,gy,gz", *rows]))
    log = read(path, units="m/s^2,rad/s", time="unix")
    assert sum("leap seconds are known to" in note.lower() for note in log.metadata.notes) == 1
    t, llh = log.imu.t, np.tile([0.8, 0.2, 300.0], (200, 1))
    fixes = GnssSeries(t, llh, np.tile(np.eye(3), (200, 1, 1)))
    for suffix in ("kml", "geojson"):
        out = write(Recording(gnss=fixes, metadata=log.metadata), tmp_path / f"track.{suffix}")[0]
        assert out.read_text().count("Leap seconds are known to") == 1


@pytest.mark.parametrize("fault", ["a count left out", "days out of order"])
def test_a_list_of_the_system_that_contradicts_itself_is_not_believed(system_list, fault):
    later = ((2030, 7, 1), (2029, 1, 1)) if fault == "days out of order" else ((2029, 1, 1), (2030, 7, 1))
    system_list((*timebase.LEAP_DAYS, *later), dt.date(2036, 6, 28))
    if fault == "a count left out":
        path = timebase._SYSTEM_LIST
        path.write_text("".join(line for line in path.read_text().splitlines(True) if "      38      " not in line))
        timebase._system_leap_days.cache_clear()
    with pytest.warns(timebase.LeapSecondWarning, match=f"known to {timebase.LEAP_TABLE_VALID_TO}"):
        assert timebase.leap_seconds(dt.date(2031, 1, 1)) == 18


def test_unix_stamps_reach_to_the_first_second_of_2100(system_list):
    last = unix(dt.datetime(2100, 1, 1))
    with pytest.warns(timebase.LeapSecondWarning):
        timebase.gps_from_unix(np.array([last]))
    with pytest.raises(InputError, match="are they milliseconds"):
        timebase.gps_from_unix(np.array([np.nextafter(last, np.inf)]))


def test_times_increase_and_the_first_that_does_not_is_named():
    """Intervals down to a picosecond; a repeated time is not an increase. Samples of a fast log are not one time."""
    np.testing.assert_array_equal(timebase.check_times([0.0, 1e-9, 0.5], "t"), [0.0, 1e-9, 0.5])
    assert timebase.SAME_TIME < 1e-4
    for t, message in (
        ([0.0, 1.0, 0.5, 2.0, 1.9], "sample 2 goes back: 0.500000 s after 1.000000 s"),
        ([0.0, 1.0, 1.0, 0.0], "sample 2 repeats: 1.000000 s after 1.000000 s"),
        ([0.0, 1e-320, 1.0], "sample 1 repeats: 0.000000 s after 0.000000 s"),
    ):
        with pytest.raises(InputError, match=f"t: expected increasing times, but {message}"):
            timebase.check_times(t, "t")
    with pytest.raises(InputError, match="expected at least one sample, got none"):
        timebase.check_times([], "t")


@pytest.mark.parametrize("n", [9, 10, 11, 12])
def test_stamps_of_long_logs_are_compared_a_block_at_a_time_and_none_is_missed(n, monkeypatch):
    monkeypatch.setattr(timebase, "_BLOCK", 5)
    timebase.check_times(np.arange(n), "t")
    for k in range(1, n):
        t = np.arange(n, dtype=np.float64)
        t[k] = t[k - 1]
        with pytest.raises(InputError, match=f"but sample {k} repeats"):
            timebase.check_times(t, "t")
