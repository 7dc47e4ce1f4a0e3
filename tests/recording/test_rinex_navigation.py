"""RINEX navigation messages: small files of every version written by hand, units and times, faults, real files."""

import datetime as dt
import gzip
import re

import numpy as np
import pytest

from schuler.exceptions import FileFormatError
from schuler.gnss.ephemerides import B2B_SOURCE, NEWER_SOURCE
from schuler.gnss.signals import satellite, satellite_name
from schuler.recording.formats.rinex_navigation import glonass_channels, read_rinex_navigation
from schuler.timebase import LeapSecondWarning, gps_from_calendar, leap_seconds

KEPLER = [
    "af0", "af1", "af2", "issue", "crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "toe", "cic", "omega0", "cis",
    "i0", "crc", "omega", "omega_dot", "idot", "source", "week", "flag", "accuracy", "health", "delay_1", "delay_2",
    "sent", "fit",
]  # fmt: skip


def head(*lines: str) -> str:
    return "".join(f"{content:<60}{label}\n" for content, label in (line.split("|") for line in lines))


HEAD_2 = head(
    "     2.11           N: GPS NAV DATA|RINEX VERSION / TYPE",
    "    0.1118D-07   .2235D-07 -0.1192D-06 -0.1192D-06|ION ALPHA",
    "    0.1147D+06   .1638D+06 -0.6554D+05 -0.4588D+06|ION BETA",
    "    18|LEAP SECONDS",
    "|END OF HEADER",
)
HEAD_3 = head(
    "     3.04           N: GNSS NAV DATA    M: MIXED|RINEX VERSION / TYPE",
    "GPSA   4.6566D-09  1.4901D-08 -5.9605D-08 -5.9605D-08 K 01|IONOSPHERIC CORR",
    "GPSA   9.0000D-09  9.0000D-08 -9.0000D-08 -9.0000D-08 L 01|IONOSPHERIC CORR",
    "GPSB   7.9872D+04  6.5536D+04 -6.5536D+04 -3.9322D+05 K 01|IONOSPHERIC CORR",
    "GAL     .1592D+03  -.4688D-01   .1895D-01|IONOSPHERIC CORR",
    "BDSA   1.0000D-08  0.0000D+00  0.0000D+00  0.0000D+00 A 21|IONOSPHERIC CORR",
    "     4    18  1929     7BDS|LEAP SECONDS",
    "|END OF HEADER",
)
HEAD_4 = head(
    "     4.01           NAVIGATION DATA     M: MIXED|RINEX VERSION / TYPE", "    18|LEAP SECONDS", "|END OF HEADER"
)


def number(value, exponent="D"):
    return " " * 19 if value is None else f"{value:19.12E}".replace("E", exponent)


def message(name, date, values, *, exponent="D", margin=4):
    """A message as RINEX has it: satellite, date, three numbers, and lines of four."""
    text = name + date + "".join(number(v, exponent) for v in values[:3]) + "\n"
    for k in range(3, len(values), 4):
        text += " " * margin + "".join(number(v, exponent) for v in values[k : k + 4]).rstrip() + "\n"
    return text


def orbit(toe=36_000.0, sent=34_818.0, **changes):
    """Numbers of a Keplerian message in the order of RINEX; no two are equal."""
    values = {
        "af0": 2.270820550621e-4, "af1": -4.774847184308e-12, "af2": 1e-20, "issue": 57.0, "crs": 34.375,
        "delta_n": 4.174459597284e-9, "m0": -0.9548742209727, "cuc": 2.007931470871e-6, "e": 1.217735337559e-2,
        "cus": 1.018866896629e-6, "sqrt_a": 5153.650791168, "toe": toe, "cic": 1.154839992523e-7,
        "omega0": -1.509334398430, "cis": 2.663582563400e-7, "i0": 0.9889889512452, "crc": 374.28125,
        "omega": 0.9377467184234, "omega_dot": -8.216413675181e-9, "idot": 9.750406143553e-11, "source": 258.0,
        "week": 2244.0, "flag": 0.0, "accuracy": 2.8, "health": 0.0, "delay_1": 4.656612873077e-9,
        "delay_2": 5.122274160385e-9, "sent": sent, "fit": 4.0,
    }  # fmt: skip
    return [(values | changes)[name] for name in KEPLER]


GLONASS = [-2.238017179072e-4, -9.094947017729e-13, 35_790.0,
           7413.11083984, 0.291175842285, 3.72529029846e-9, 0.0,
           -15356.8950195, 2.60711288452, -9.31322574615e-10, -3.0,
           18965.5869141, 2.0980854034, 1.86264514923e-9, 1.0]  # fmt: skip
DATE_3 = " 2023 01 08 10 00 00"
SUNDAY = gps_from_calendar(dt.datetime(2023, 1, 8))
TEN = SUNDAY + 36_000.0


@pytest.fixture
def read(tmp_path):
    def write_and_read(text, name="brdc.nav"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
        return read_rinex_navigation(path)

    return write_and_read


def check_orbit(records, row=0, **changes):
    """Elements are the printed numbers, exactly."""
    expected = dict(zip(KEPLER, orbit(**changes), strict=True))
    for name in KEPLER[:3] + KEPLER[4:11] + KEPLER[12:20]:
        assert getattr(records, name)[row] == float(number(expected[name]).replace("D", "E")), name
    assert records.issue[row] == 57


# ---------------------------------------------------------------------------------------------- versions


def test_version_2_of_gps(read):
    text = HEAD_2 + message(" 6", " 23  1  8 10  0  0.0", orbit(week=2244.0), margin=3)
    text += message("32", " 23  1  8  9 59 44.0", orbit(toe=35_984.0, sent=None, delay_2=None), margin=3)
    nav = read(text)
    k = nav.kepler
    assert [satellite_name(s) for s in k.sat] == ["G06", "G32"]
    check_orbit(k)
    np.testing.assert_array_equal(k.toe, [TEN, TEN - 16.0])
    np.testing.assert_array_equal(k.toc, k.toe)
    np.testing.assert_array_equal(k.sent, [SUNDAY + 34_818.0, np.nan])
    np.testing.assert_array_equal(k.group_delay, [[4.656612873077e-9, np.nan]] * 2)
    np.testing.assert_array_equal(k.accuracy, [2.8, 2.8])
    np.testing.assert_array_equal(k.source, [0, 0])
    assert nav.klobuchar_alpha == (0.1118e-7, 0.2235e-7, -0.1192e-6, -0.1192e-6)
    assert nav.klobuchar_beta == (0.1147e6, 0.1638e6, -0.6554e5, -0.4588e6)
    assert nav.leap_seconds == 18
    assert nav.notes == ()
    assert len(nav.glonass) == 0


@pytest.mark.parametrize(
    ("version", "sent"), [(2, 35_790.0), (2, 35_790.0 + 3 * 86_400.0), (3, 35_790.0 + 3 * 86_400.0)]
)
def test_glonass_is_on_utc_and_in_kilometres(read, version, sent):
    values = [*GLONASS[:2], sent, *GLONASS[3:]]
    if version == 2:
        start = "     2.11           GLONASS NAV DATA|RINEX VERSION / TYPE"
        text = head(start, "|END OF HEADER") + message(" 9", " 16 12 28 10  0  0.0", values, margin=3)
    else:
        text = HEAD_3 + message("R09", " 2016 12 28 10 00 00", values)
    g = read(text).glonass
    toe = gps_from_calendar(dt.datetime(2016, 12, 28, 10), utc=True)
    assert leap_seconds(dt.date(2016, 12, 28)) == 17
    assert (g.sat[0], g.toe[0], g.channel[0], g.health[0]) == (satellite("R09"), toe, -3, 0)
    assert g.sent[0] == toe - 210.0
    np.testing.assert_allclose(g.r_e[0], [7413110.83984, -15356895.0195, 18965586.9141], rtol=1e-15)
    np.testing.assert_allclose(g.v_e[0], [291.175842285, 2607.11288452, 2098.0854034], rtol=1e-15)
    np.testing.assert_allclose(g.a_e[0], [3.72529029846e-6, -9.31322574615e-7, 1.86264514923e-6], rtol=1e-15)
    assert (g.clock[0], g.rate[0]) == (-2.238017179072e-4, -9.094947017729e-13)


def test_version_3_of_all_systems(read):
    text = HEAD_3
    text += message("G01", DATE_3, orbit())
    text += message("E11", DATE_3, orbit(source=517.0, accuracy=-1.0, health=455.0))
    text += message("E11", DATE_3, orbit(source=258.0, af0=2.3e-4))
    text += message("C21", DATE_3, orbit(week=888.0, source=None, flag=None))
    text += message("J02", DATE_3, orbit(delay_1=None, health=1.0))
    text += message("R09", DATE_3, GLONASS)
    text += message("R10", DATE_3, [*GLONASS, 1.0, 2.0, 3.0, 4.0])  # of version 3.05
    text += message("S33", DATE_3, GLONASS)
    text += message("I02", DATE_3, orbit())
    nav = read(text)
    k = nav.kepler
    assert [satellite_name(s) for s in k.sat] == ["G01", "E11", "E11", "C21", "J02"]
    for row, changes in enumerate(({}, {}, {"af0": 2.3e-4}, {}, {})):
        check_orbit(k, row, **changes)
    np.testing.assert_array_equal(k.toe - TEN, [0, 0, 0, 14, 0])
    np.testing.assert_array_equal(k.toc - TEN, [0, 0, 0, 14, 0])
    np.testing.assert_array_equal(k.sent - SUNDAY, [34_818, 34_818, 34_818, 34_832, 34_818])
    np.testing.assert_array_equal(k.source, [0, 517, 258, 0, 0])
    np.testing.assert_array_equal(k.health, [0, 455, 0, 0, 1])
    np.testing.assert_array_equal(k.accuracy, [2.8, np.nan, 2.8, 2.8, 2.8])
    both = [4.656612873077e-9, 5.122274160385e-9]
    np.testing.assert_array_equal(k.group_delay, [[both[0], np.nan], both, both, both, [np.nan, np.nan]])
    assert [satellite_name(s) for s in nav.glonass.sat] == ["R09", "R10"]
    assert glonass_channels(nav) == {satellite("R09"): -3, satellite("R10"): -3}
    assert nav.klobuchar_alpha == (4.6566e-9, 1.4901e-8, -5.9605e-8, -5.9605e-8)
    assert nav.klobuchar_beta == (7.9872e4, 6.5536e4, -6.5536e4, -3.9322e5)
    assert nav.galileo_ai == (159.2, -0.04688, 0.01895)
    assert nav.leap_seconds == 18
    assert nav.beidou_alpha == (1e-8, 0.0, 0.0, 0.0)
    assert nav.beidou_beta is None
    assert nav.notes == ("Messages that are not used: 1 NavIC, 1 SBAS.",)


def newer(beidou=False, tall=False, **changes):
    """Numbers of a message of modernised signals: rates, accuracies and delays in places of their own."""
    old = dict(zip(KEPLER, orbit(), strict=True)) | {"toe": 36_000.0 if beidou else 30_600.0} | changes
    first = [old[name] for name in KEPLER[:3]] + [changes.get("a_dot", -3.7e-3)] + [old[name] for name in KEPLER[4:20]]
    n_dot, health = changes.get("delta_n_dot", 7e-14), changes.get("health", 0.0)
    if beidou:  # type of satellite, top; SISAI; ISC, spare, TGD of B1C and B2a; SISMAI, health, flags, IODC; sent, IODE
        rest = [1.0, 2.0, 3.0, 4.0, 1e-9, None, 3e-9, -2e-9, 5.0, health, 0.0, 57.0, 34_818.0, None, None, 57.0]
        return [*first, n_dot, 3.0, 30_600.0, *rest]
    rest = [*first, n_dot, -2.0, 1.0, changes.get("ura", 2.0), health, 5e-9, 3.0, 1e-10, 2e-10, 3e-10, 4e-10]
    return [*rest, *([6e-10, 7e-10, None, None] if tall else []), 34_818.0, 2244.0]


def test_messages_of_modernised_signals(read):
    """CNAV, CNAV-2, B-CNAV1 and 2: elements, rates, delays of L5, B1C and B2a, accuracy by its index."""
    blocks = [
        ("G01 CNAV", newer()), ("G03 CNV2", newer(tall=True)), ("J02 CNAV", newer(ura=15.0)),
        ("C21 CNV1", newer(beidou=True)), ("C21 CNV2", newer(beidou=True, health=1.0)),
        ("C23 CNV3", newer(beidou=True)[:27]), ("G04 LNAV", orbit()),  # the first of them a line too short
        ("C22 CNV3", [*newer(beidou=True)[:27], 5.0, 2.0, 0.0, -7e-9, 34_812.0, None]),
    ]  # fmt: skip
    nav = read(HEAD_4 + "".join(f"> EPH {name}\n{message(name[:3], DATE_3, body)}" for name, body in blocks))
    k = nav.kepler
    assert [satellite_name(s) for s in k.sat] == ["G04", "G01", "G03", "C21", "C21", "C22", "J02"]
    assert k.source.tolist() == [0, *[NEWER_SOURCE] * 4, B2B_SOURCE, NEWER_SOURCE]
    expected = dict(zip(KEPLER, orbit(), strict=True))
    for name in KEPLER[:3] + KEPLER[4:11] + KEPLER[12:20]:
        assert (getattr(k, name) == float(number(expected[name]).replace("D", "E"))).all(), name
    np.testing.assert_array_equal(k.a_dot, [0.0, *[-3.7e-3] * 6])
    np.testing.assert_array_equal(k.delta_n_dot, [0.0, *[7e-14] * 6])
    behind = np.array([0.0, 0.0, 0.0, 14.0, 14.0, 14.0, 0.0])
    np.testing.assert_array_equal(k.toe, TEN + behind)
    np.testing.assert_array_equal(k.toc, k.toe)
    np.testing.assert_array_equal(k.sent, SUNDAY + 34_818.0 + behind - 6.0 * (k.source == B2B_SOURCE))
    np.testing.assert_allclose(k.group_delay[1:3], [[5e-9, 4.6e-9]] * 2, rtol=1e-12)
    np.testing.assert_array_equal(k.group_delay[3:5], [[3e-9, -2e-9]] * 2)
    np.testing.assert_allclose(k.accuracy[1:3], np.hypot(4.0, 1.0), rtol=1e-12)  # of the indices 2 and -2
    np.testing.assert_array_equal(k.group_delay[5], [np.nan, -7e-9])
    assert np.isnan(k.accuracy[3:]).all()
    assert k.health.tolist() == [0, 0, 0, 0, 1, 2, 0]
    assert k.issue[3:6].tolist() == [57, 57, -1]
    assert nav.notes == ("Messages that are not used: 1 BeiDou CNV3.",)


def test_a_newer_message_that_is_cut_off_or_lacks_an_element(read):
    body = message("G01", DATE_3, newer()) + "> EPH G03 CNAV\n" + message("G03", DATE_3, newer(a_dot=None))
    nav = read(HEAD_4 + "> EPH G01 CNAV\n" + body + "> EPH G05 CNAV\n" + message("G05", DATE_3, newer())[:500])
    assert [satellite_name(s) for s in nav.kepler.sat] == ["G01"]
    assert any("1 messages of GPS lack elements" in note for note in nav.notes)
    assert any("ends within the message" in note for note in nav.notes)


def test_version_4(read):
    later = " 2023 01 08 11 00 00"
    blocks = [
        ("EPH G01 LNAV", message("G01", DATE_3, orbit(), exponent="e")),
        ("EPH G01 CNAV", message("G01", DATE_3, [*orbit(), 0.0, 0.0])),  # a line too few
        ("EPH E11 INAV", message("E11", DATE_3, orbit(source=517.0))),
        ("EPH E11 FNAV", message("E11", DATE_3, orbit(source=258.0))),
        ("EPH C21 D1", message("C21", DATE_3, orbit())),
        ("EPH C05 D2", message("C05", DATE_3, orbit())),
        ("EPH C21 CNV1", message("C21", DATE_3, [*orbit(), 0.0, 0.0])),
        ("EPH J02 LNAV", message("J02", DATE_3, orbit())),
        ("EPH R09 FDMA", message("R09", DATE_3, [*GLONASS[:2], 0.999999999999e9, *GLONASS[3:], None, 1e-9, 1.0, 0.0])),
        ("EPH S33 SBAS", message("S33", DATE_3, GLONASS)),
        ("STO G01 LNAV", f"    {DATE_3[1:]} GPUT               \n    {number(1.0)}\n"),
        ("EOP G01 CNAV", message("   ", DATE_3, [1e-1] * 11)),
        ("ION G01 LNAV", message("   ", DATE_3, [1e-8, 2e-8, -3e-8, -4e-8, 1e5, 2e5, -3e5, -4e5, 0.0])),
        ("ION G01 LNAV", message("   ", later, [9e-8, 2e-8, -3e-8, -4e-8, 1e5, 2e5, -3e5, -4e5, 0.0])),
        ("ION E11 IFNV", message("   ", DATE_3, [159.2, -0.04688, 0.01895, 0.0])),
        ("ION C21 D1D2", message("   ", DATE_3, [3e-8, 2e-8, -3e-8, 5e-8, 4e5, 2e5, -3e5, -6e5])),
        ("ION C21 CNVX", message("   ", DATE_3, [1e1, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])),
    ]
    nav = read(HEAD_4 + "".join(f"> {name}\n{body}" for name, body in blocks))
    k = nav.kepler
    assert [satellite_name(s) for s in k.sat] == ["G01", "E11", "E11", "C21", "C05", "J02"]
    for row in range(6):
        check_orbit(k, row)
    np.testing.assert_array_equal(k.source, [0, 517, 258, 0, 0, 0])
    assert satellite_name(nav.glonass.sat[0]) == "R09"
    assert nav.glonass.toe[0] == TEN + 18.0
    assert np.isnan(nav.glonass.sent[0])
    assert nav.klobuchar_alpha == (1e-8, 2e-8, -3e-8, -4e-8)
    assert nav.klobuchar_beta == (1e5, 2e5, -3e5, -4e5)
    assert nav.beidou_alpha == (3e-8, 2e-8, -3e-8, 5e-8)
    assert nav.beidou_beta == (4e5, 2e5, -3e5, -6e5)
    assert nav.galileo_ai == (159.2, -0.04688, 0.01895)
    assert nav.notes == (
        "Records that are not used: 1 EOP.",
        "Records that are not used: 1 STO.",
        "Messages that are not used: 1 BeiDou CNV1, 1 GPS CNAV, 1 SBAS SBAS.",
        "Ionosphere coefficients that are not used: C CNVX.",
    )


@pytest.mark.parametrize("margin", ["\r\n", "\n\n"])
def test_line_ends_and_blank_lines_make_no_difference(read, margin):
    text = HEAD_3 + message("G01", DATE_3, orbit()) + message("R09", DATE_3, GLONASS)
    if margin == "\r\n":
        nav = read("\xef\xbb\xbf" + text.replace("\n", "\r\n"))
    else:
        nav = read(HEAD_3 + message("G01", DATE_3, orbit()) + "\n" + message("R09", DATE_3, GLONASS) + " \n\n")
    check_orbit(nav.kepler)
    assert len(nav.glonass) == 1


def test_packed_files_are_read(read):
    nav = read(gzip.compress((HEAD_3 + message("G01", DATE_3, orbit())).encode()), "brdc.nav.gz")
    check_orbit(nav.kepler)


# ------------------------------------------------------------------------------------------------- times


@pytest.mark.parametrize(
    ("date", "toe", "sent", "expected_toe", "expected_sent"),
    [
        (" 2023 01 08 00 00 00", 0.0, 604_000.0, 0.0, -800.0),  # sent in the week before
        (" 2023 01 07 23 59 44", 0.0, 0.0, 0.0, 0.0),  # toe in the week after toc
        (" 2023 01 08 00 00 00", 604_784.0, -18.0, -16.0, -18.0),
        (" 2023 01 08 00 00 00", 0.0, 604_800.0 + 6.0, 0.0, 6.0),
        (" 2023 01 08 00 00 00", 0.0, 0.9999e9, 0.0, np.nan),
        (" 2023 01 08 00 00 00", 0.0, None, 0.0, np.nan),
    ],
)
def test_weeks_are_those_next_to_the_clock(read, date, toe, sent, expected_toe, expected_sent):
    """Whatever week number stands there: at the turn of a week writers differ."""
    k = read(HEAD_3 + message("G01", date, orbit(toe=toe, sent=sent, week=1.0))).kepler
    np.testing.assert_array_equal([k.toe[0] - SUNDAY, k.sent[0] - SUNDAY], [expected_toe, expected_sent])


@pytest.mark.parametrize(("text", "seconds"), [("    18", 18), ("     4    18  1929     7BDS", 18), ("      ", None)])
def test_leap_seconds_of_gps_or_beidou(read, text, seconds):
    header = head(
        "     3.04           N: GNSS NAV DATA    M|RINEX VERSION / TYPE", f"{text}|LEAP SECONDS", "|END OF HEADER"
    )
    assert read(header + message("G01", DATE_3, orbit())).leap_seconds == seconds


def test_glonass_beyond_the_leap_second_table_takes_the_header(read):
    late = message("R09", " 2040 01 08 10 00 00", GLONASS)
    assert read(HEAD_3 + late).glonass.toe[0] == gps_from_calendar(dt.datetime(2040, 1, 8, 10)) + 18.0
    with pytest.warns(LeapSecondWarning, match="leap seconds are known to"):
        read(HEAD_3.replace("LEAP SECONDS", "LEAF SECONDS") + late)


# ------------------------------------------------------------------------------- what is left out or noted


def test_repeated_messages_count_once(read):
    text = HEAD_3 + message("E11", DATE_3, orbit())
    text += message("E11", DATE_3, orbit(sent=35_000.0, af0=1e-4))  # the same again: the first counts
    text += message("E11", DATE_3, orbit(health=1.0))  # not the same: it was switched off
    text += message("R09", DATE_3, GLONASS) * 3
    nav = read(text)
    np.testing.assert_array_equal(nav.kepler.health, [0, 1])
    check_orbit(nav.kepler)
    assert len(nav.glonass) == 1
    assert nav.notes[:2] == (
        "2 messages of GLONASS are there again and were left out.",
        "1 messages of Galileo are there again and were left out.",
    )


@pytest.mark.parametrize(
    "changes", [{"sqrt_a": None}, {"cis": None}, {"toe": None}, {"af2": None}, {"sqrt_a": 0.0}, {"e": 1.5}]
)
def test_messages_without_all_elements_are_left_out(read, changes):
    nav = read(HEAD_3 + message("G01", DATE_3, orbit(**changes)) + message("G02", DATE_3, orbit()))
    assert [satellite_name(s) for s in nav.kepler.sat] == ["G02"]
    assert any("1 messages of GPS lack elements" in n for n in nav.notes)


@pytest.mark.parametrize(("place", "value"), [(4, None), (10, None), (10, 40.0), (0, None)])
def test_glonass_messages_without_all_numbers_are_left_out(read, place, value):
    values = list(GLONASS)
    values[place] = value
    nav = read(HEAD_3 + message("R09", DATE_3, values) + message("R10", DATE_3, GLONASS))
    assert [satellite_name(s) for s in nav.glonass.sat] == ["R10"]
    assert any("1 messages of GLONASS lack" in n for n in nav.notes)


def test_a_channel_written_without_its_sign(read):
    values = list(GLONASS)
    values[10] = 253.0
    assert read(HEAD_3 + message("R09", DATE_3, values)).glonass.channel[0] == -3


def test_what_is_not_stated(read):
    nav = read(HEAD_3 + message("G01", DATE_3, orbit(health=None, accuracy=0.0, issue=None, delay_1=None)))
    k = nav.kepler
    assert (k.health[0], k.issue[0]) == (0, -1)
    assert np.isnan([k.accuracy[0], k.group_delay[0, 0]]).all()
    assert any("1 messages of GPS state no health and were taken as usable" in n for n in nav.notes)


def test_zero_coefficients_are_none(read):
    zeros = "   0.0000D+00" * 4
    header = re.sub(r"(?m)^(GPSB|GAL ) .*(?=IONO)", lambda m: (m[1] + zeros).ljust(60), HEAD_3)
    nav = read(header + message("G01", DATE_3, orbit()))
    assert nav.klobuchar_alpha is not None
    assert nav.klobuchar_beta is None
    assert nav.galileo_ai is None
    assert any("all zero or cannot be read: beta, galileo" in n for n in nav.notes)


@pytest.mark.campaign
def test_a_file_cut_off_anywhere_is_read_up_to_the_last_complete_message(read):
    body = message("G01", DATE_3, orbit()) + message("R09", DATE_3, GLONASS) + message("G02", DATE_3, orbit())
    ends = [body.index("R09") - 1, body.index("G02") - 1, len(body) - 1]
    counts, refusals = [], []
    for cut in (*range(0, len(body), 7), len(body) - 1, len(body)):
        try:
            nav = read(HEAD_3 + body[:cut])
        except FileFormatError as error:
            refusals.append(str(error))
            continue
        for row in range(len(nav.kepler)):
            check_orbit(nav.kepler, row)
        # a message whose last field alone is missing is complete: nobody reads the fit interval
        complete = sum(cut >= end for end in ends)
        assert complete <= len(nav.kepler) + len(nav.glonass) <= complete + 1
        counts.append(complete)
    assert set(counts) == {1, 2, 3}
    assert all("no complete message" in sentence for sentence in refusals)


# ----------------------------------------------------------------------------------------------- faults


GOOD = HEAD_3 + message("G01", DATE_3, orbit()) + message("E11", DATE_3, orbit())


def changed(old, new, text=GOOD):
    assert old in text, old
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("text", "line", "sentence"),
    [
        ("", None, "the file is empty"),
        (changed("N: GNSS NAV DATA", "OBSERVATION DATA"), None, "read it with read_rinex_observation"),
        (changed("3.04", "7.04"), 1, "expected RINEX version 2, 3 or 4"),
        (HEAD_3, None, "there is no complete message"),
        (changed("G01 2023", "X01 2023"), 9, "expected a satellite such as G05"),
        (changed("G01 2023 01", "G01 2023 21"), 9, "expected date and time of a message"),
        (changed("G01 2023 01", "G01 2023 x1"), 9, "expected date and time of a message"),
        (changed(" 5.153650791168D+03", " 5.15365x791168D+03"), 11, "columns 62 to 80, got ' 5.15365x791168D+03'"),
        (changed(" 5.153650791168D+03\n", " 5.153650791168D+03\n" + " " * 5 + "1.0\n"), 9, "message of 8 lines, got 9"),
        (changed(message("G01", DATE_3, orbit()).splitlines(True)[3], ""), 9, "message of 8 lines, got 7"),
        (changed("G01 2023", "    2023"), 9, "expected the start of a message"),
        (GOOD + GOOD, 25, "a second header begins here"),
        (HEAD_4 + message("G01", DATE_3, orbit()), 4, "expected the start of a message, '> EPH G01 LNAV'"),
        (HEAD_4 + "> XYZ G01 LNAV\n" + message("G01", DATE_3, orbit()), 4, "expected '> EPH', STO, EOP or ION"),
    ],
)
def test_faults_name_the_line(read, text, line, sentence):
    with pytest.raises(FileFormatError, match=re.escape(sentence)) as fault:
        read(text)
    assert fault.value.line == line


# ---------------------------------------------------------------------------------------- real recordings


@pytest.mark.realdata
def test_version_2_of_the_igs(shared_data):
    nav = read_rinex_navigation(shared_data / "gnss_nav_files" / "brdc1180.21n")
    k = nav.kepler
    assert len(k) == 105
    assert set(k.sat) <= set(range(1, 33))
    # the first message, read by eye
    assert k.toc[0] == gps_from_calendar(dt.datetime(2021, 4, 28, 17, 59, 44)) == k.toe[0]
    assert (k.sat[0], k.sqrt_a[0], k.e[0], k.i0[0]) == (6, 5153.75527, 0.00225707876962, 0.983895632254)
    assert (k.af0[0], k.idot[0], k.issue[0], k.accuracy[0]) == (0.10933727026e-4, -0.732173355102e-10, 31, 2.0)
    assert k.sent[0] == k.toe[0] - 323_984.0 + 322_932.0
    assert k.group_delay[0, 0] == 0.419095158577e-8
    assert nav.klobuchar_beta == (0.8806e5, 0.4915e5, -0.1311e6, -0.3277e6)
    assert nav.leap_seconds == 18
    assert nav.notes == ()


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "kepler", "glonass"),
    [
        ("rtkexp_walk/gnss_1730.nav", 28, 0),
        ("instinct_spirent/RINEX_GN_Spirent.23N", 31, 0),
        ("instinct_spirent/RINEX_EN_Spirent.23L", 26, 0),
        ("instinct_tckf/reach-m2-01_raw_202306291111.nav", 34, 10),
        ("gnss_nav_files/BRDC00WRD_S_20230730000_01D_MN.rnx", 50, 6),
    ],
)
def test_real_files(shared_data, name, kepler, glonass):
    """Numbers of messages counted with grep; orbits where satellites are."""
    nav = read_rinex_navigation(shared_data / name)
    assert (len(nav.kepler), len(nav.glonass)) == (kepler, glonass)
    k, g = nav.kepler, nav.glonass
    assert ((k.sqrt_a > 5150) & (k.sqrt_a < 6600)).all()
    assert (np.abs(k.toe - k.toc) <= 7200).all()
    assert not (np.abs(k.sent - k.toe) > 7300).any()
    assert np.isnan(k.sent).any() == ("BRDC" in name)  # there it is 0.9999E9 for most
    radius = np.linalg.norm(g.r_e, axis=1)
    assert ((radius > 25.3e6) & (radius < 25.7e6)).all()
    assert (np.abs(np.linalg.norm(g.v_e, axis=1) - 3600.0) < 600.0).all()  # Earth-fixed, half a day's orbit
    assert set(g.channel) <= set(range(-7, 7))
    if "walk" in name:
        assert nav.galileo_ai == (159.2, -0.04688, 0.01895)
        (c21,) = np.flatnonzero(k.sat == satellite("C21"))
        assert (k.toe[c21] - 2381 * 604_800.0, k.group_delay[c21, 0]) == (406_814.0, 1.33e-8)
        assert (k.omega0[c21], k.health[c21]) == (1.75064384011, 0)
    if "tckf" in name:
        assert g.toe[0] == gps_from_calendar(dt.datetime(2023, 6, 29, 11, 15)) + 18.0
        assert g.sent[0] == g.toe[0] - 210.0


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.filterwarnings("ignore")
def test_georinex_reads_the_same_numbers(shared_data):
    georinex = pytest.importorskip("georinex", reason="the comparison needs georinex")
    path = shared_data / "instinct_spirent" / "RINEX_EN_Spirent.23L"
    theirs, k = georinex.load(path), read_rinex_navigation(path).kepler
    names = {"sqrt_a": "sqrtA", "m0": "M0", "i0": "Io", "omega_dot": "OmegaDot", "af1": "SVclockDrift", "cis": "Cis",
             "crc": "Crc", "e": "Eccentricity", "delta_n": "DeltaN", "idot": "IDOT"}  # fmt: skip
    for row, sat in enumerate(k.sat):
        values = theirs.sel(sv=satellite_name(sat)).dropna("time", how="all").isel(time=0)
        for ours, other in names.items():
            assert getattr(k, ours)[row] == float(values[other])
