"""RINEX observations: small files of every version by hand, a writer that shares nothing with the reader, faults."""

import bz2
import datetime as dt
import gzip
import re
import sys
import zipfile

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEMS, satellite, satellite_name
from schuler.recording.formats import rinex_observation
from schuler.recording.formats.rinex_navigation import glonass_channels, read_rinex_navigation
from schuler.recording.formats.rinex_observation import read_rinex_observation
from schuler.timebase import gps_from_calendar

L1 = SPEED_OF_LIGHT / 1575.42e6


def head(*lines: str) -> str:
    """Header lines given as content and label with a stroke between them."""
    return "".join(f"{content:<60}{label}\n" for content, label in (line.split("|") for line in lines))


def wide(*values: str) -> str:
    """A line of observations, each with two digits behind it that may be left out."""
    return "".join(f"{v if v[-2:-1] == ' ' else v + '  ':>16}" for v in values).rstrip() + "\n"


V3 = (
    head(
        "     3.04           OBSERVATION DATA    M: MIXED|RINEX VERSION / TYPE",
        "by hand|PGM / RUN BY / DATE",
        "Gr\xf6\xdfe, in no stated encoding|COMMENT",
        "  4157161.1260   671329.1980  4774767.0310|APPROX POSITION XYZ",
        "1441031193          TRM59800.00     SCIT|ANT # / TYPE",
        "        1.5200        0.0010       -0.0020|ANTENNA: DELTA H/E/N",
        "G   14 C1C L1C D1C S1C C2W L2W D2W S2W C5Q L5Q D5Q S5Q X1  |SYS / # / OBS TYPES".replace("X1 ", "C1W"),
        "       L1W|SYS / # / OBS TYPES",
        "R    4 C1C L1C D1C S1C|SYS / # / OBS TYPES",
        "E    2 C1C S1C|SYS / # / OBS TYPES",
        "  2023     1     8    10     0    0.0000000     GPS|TIME OF FIRST OBS",
        "  2 R05  1 R24 -7|GLONASS SLOT / FRQ #",
        "|END OF HEADER",
    )
    + "> 2023 01 08 10 00  0.1234567  0  3       0.000123456789\n"
    + "G05  21735785.983 9 114222326.278 9     -2437.386 9        55.473 9  21735783.81518\n"
    + "R 5  19500000.125   104200000.500        1000.000          44.000\n"
    + "E24  24088550.170                          \n"
    + "> 2023 01 08 10 00  1.0000000  4  2\n"
    + f"{'a remark in the middle':<60}COMMENT\n"
    + f"{'G > another':<60}COMMENT\n"
    + "> 2023 01 08 10 00  1.5000000  6  1\n"
    + "G05                         1.000\n"
    + "> 2023 01 08 10 00  2.0000000  1  2\n"
    + "G05" + " " * 64 + "  21735790.001\n"
    + "E24         0.000          30.000\n"
)  # fmt: skip

V2 = (
    head(
        "     2.11           OBSERVATION DATA    M (MIXED)|RINEX VERSION / TYPE",
        "     7    C1    P1    L1    D1    P2    L2    S1|# / TYPES OF OBSERV",
        "        0.0000        0.0000        0.0000|APPROX POSITION XYZ",
        "  2001     3    24    13    10   36.0000000     GPS|TIME OF FIRST OBS",
        "|END OF HEADER",
    )
    + " 01  3 24 13 10 36.0000000  0 13G12G09G06R21G01G02G03G04G05G07G08G10 -.123456789\n"
    + " " * 32 + "E11\n"
    + wide("23629347.915", "", ".300 8", "-123.500  ", "23629364.158") + wide(".400", "45.000")
    + wide("20891534.648", "", ".120 9") + "\n"
    + "".join(wide(f"{20607600 + k}.189", "20607600.250") + "\n" for k in range(10))
    + wide("30000000.500") + "\n"
    + " 01  3 24 13 10 54.0000000  5  0\n"
    + "                            4  1\n"
    + f"{'blank date above':<60}COMMENT\n"
    + " 01  3 24 13 11  0.0000000  0  1 12\n"
    + wide("23629347.000") + "\n"
)  # fmt: skip

V4 = (
    head(
        "     4.02           OBSERVATION DATA    C: BEIDOU|RINEX VERSION / TYPE",
        "C    4 C2I L2I D2I S2I|SYS / # / OBS TYPES",
        "C   10  1 L2I|SYS / SCALE FACTOR",
        "  2023     1     8    10     0   30.0000000     BDT|TIME OF FIRST OBS",
        "|END OF HEADER",
    )
    + "> 2023 01 08 10 00 30.0000000  0  1      -0.000000000000 12345\n"
    + "C21  21534103.024   112000000.000         100.000          48.000\n"
)


def put(tmp_path, text, name="site.obs"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return path


@pytest.fixture
def read(tmp_path):
    return lambda text, name="site.obs", **options: read_rinex_observation(put(tmp_path, text, name), **options)


def rows(obs):
    """Rows as tuples, NaN as None."""
    table = zip(obs.t, obs.sat, obs.signal, obs.pseudorange, obs.carrier, obs.range_rate, obs.cn0, strict=True)
    clean = lambda x: None if np.isnan(x) else float(x)  # noqa: E731
    return [(float(t), satellite_name(s), obs.signals[k], *map(clean, v)) for t, s, k, *v in table]


def same(a, b):
    assert (a.signals, a.epoch_gps_s, a.position_e) == (b.signals, b.epoch_gps_s, b.position_e)
    for name in ("t", "sat", "signal", "pseudorange", "carrier", "range_rate", "cn0"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


# ------------------------------------------------------------------------------- versions, read by eye


def test_version_3(read):
    obs = read(V3)
    t = 10 * 3600.0  # Sunday
    f5 = 1602e6 + 562.5e3
    expected = [
        (t + 0.1234567, "G05", "1C", 21735785.983, 114222326.278, 2437.386 * L1, 55.473),
        (t + 0.1234567, "G05", "2W", 21735783.815, None, None, None),
        (t + 0.1234567, "R05", "1C", 19500000.125, 104200000.5, -1000.0 * SPEED_OF_LIGHT / f5, 44.0),
        (t + 0.1234567, "E24", "1C", 24088550.170, None, None, None),
        (t + 2.0, "G05", "2W", 21735790.001, None, None, None),
        (t + 2.0, "E24", "1C", None, None, None, 30.0),
    ]
    entries = rows(obs)
    assert [r[1:5] + r[6:] for r in entries] == [r[1:5] + r[6:] for r in expected]  # exactly what is printed
    np.testing.assert_allclose([r[0] for r in entries], [r[0] for r in expected], rtol=0, atol=1e-10)  # rounding
    rates = [[np.nan if r[5] is None else r[5] for r in table] for table in (entries, expected)]
    np.testing.assert_allclose(*rates, rtol=1e-14)
    assert obs.signals == ("1C", "2W")  # and not 5Q, of which there is nothing
    assert obs.epoch_gps_s == gps_from_calendar(dt.datetime(2023, 1, 8))
    assert obs.position_e == (4157161.126, 671329.198, 4774767.031)
    assert (obs.antenna, obs.eccentricity_n) == ("TRM59800.00 SCIT", (-0.002, 0.001, -1.52))
    assert obs.glonass_channels == {satellite("R05"): 1, satellite("R24"): -7}
    notes = " ".join(obs.notes)
    assert "1 power failures" in notes
    assert "1 blocks of header lines" in notes
    assert "1 records of cycle slips" in notes
    assert "0.000123 s are in the file and were not applied" in notes


def test_version_2(read):
    obs = read(V2)
    table = rows(obs)
    t = 6 * 86_400.0 + 13 * 3600.0 + 10 * 60.0 + 36.0
    assert table[:4] == [
        (t, "G12", "1C", 23629347.915, 0.3, pytest.approx(123.5 * L1, rel=1e-15), 45.0),
        (t, "G12", "2W", 23629364.158, 0.4, None, None),
        (t, "G09", "1C", 20891534.648, 0.12, None, None),
        (t, "G06", "1C", 20607600.189, None, None, None),
    ]
    assert table[4] == (t, "G06", "1W", 20607600.25, None, None, None)
    assert table[5:7] == [
        (t, "R21", "1C", 20607601.189, None, None, None),
        (t, "R21", "1P", 20607600.25, None, None, None),
    ]
    assert table[-2:] == [
        (t, "E11", "1X", 30000000.5, None, None, None),
        (t + 24.0, "G12", "1C", 23629347.0, None, None, None),
    ]
    assert len({name for _, name, *_ in table}) == 13
    assert (obs.position_e, obs.antenna, obs.eccentricity_n) == (None, "", None)
    notes = " ".join(obs.notes)
    assert "1 blocks of header lines" in notes
    assert "1 external events" in notes
    assert "0.123 s" in notes


def test_version_4_on_beidou_time_with_scale_factors(read):
    obs = read(V4)
    assert rows(obs) == [
        (36_044.0, "C21", "2I", 21534103.024, 11200000.0, pytest.approx(-100.0 * SPEED_OF_LIGHT / 1561.098e6), 48.0)
    ]
    assert any("14 s were added" in n for n in obs.notes)
    assert any("scale factors" in n for n in obs.notes)


@pytest.mark.parametrize("text", [V2, V3, V4], ids=["2", "3", "4"])
def test_line_ends_marks_and_blanks_make_no_difference(read, text):
    expected = read(text)
    same(read(text.replace("\n", "\r\n")), expected)
    same(read(text.replace("\n", "\r")), expected)
    same(read("\xef\xbb\xbf" + text), expected)
    same(read(text + "\n\n"), expected)
    same(read(re.sub(r"(?m)^(.{1,79})$", lambda m: m[1].ljust(100), text)), expected)  # trailing blanks
    if text is not V2:  # there blank lines are satellites without observations
        same(read(text.replace("\n>", "\n\n>")), expected)


@pytest.mark.parametrize("text", [V2, V3], ids=["2", "3"])
def test_blocks_make_no_difference(read, text, monkeypatch):
    expected = read(text)
    monkeypatch.setattr(rinex_observation, "_BLOCK", 2)
    same(read(text), expected)


# -------------------------------------------------------------------------- a writer, and what it wrote


def random_values(rng, n_epochs, names, types):
    """Observations [epoch][satellite][type] in thousandths, a third of them missing, some satellites too."""
    table = rng.integers(1, 3 * 10**10, (n_epochs, len(names), types))
    table[rng.random(table.shape) < 0.33] = 0
    return table


def field(thousandths, digits):
    return (f"{thousandths / 1000:14.3f}{digits}" if thousandths else "").ljust(16)


def write_3(table, names, codes, start, version="3.04"):
    text = head(f"     {version}           OBSERVATION DATA    M|RINEX VERSION / TYPE")
    for system in sorted({n[0] for n in names}):
        for k in range(0, len(codes), 13):
            lead = f"{system}  {len(codes):3d}" if k == 0 else " " * 6
            text += head(lead + "".join(f" {c}" for c in codes[k : k + 13]) + "|SYS / # / OBS TYPES")
    text += head(
        start.strftime("  %Y    %m    %d    %H    %M   %S.0000000     GPS|TIME OF FIRST OBS"), "|END OF HEADER"
    )
    for k, epoch in enumerate(table):
        moment = start + dt.timedelta(seconds=k)
        text += moment.strftime(f"> %Y %m %d %H %M %S.2500000  0{len(names):3d}\n")
        for name, values in zip(names, epoch, strict=True):
            text += (name + "".join(field(v, " 7") for v in values)).rstrip() + "\n"
    return text


def write_2(table, names, codes, start, version="2.11"):
    text = head(f"     {version}           OBSERVATION DATA    M|RINEX VERSION / TYPE")
    for k in range(0, len(codes), 9):
        lead = f"{len(codes):6d}" if k == 0 else " " * 6
        text += head(lead + "".join(f"    {c}" for c in codes[k : k + 9]) + "|# / TYPES OF OBSERV")
    text += head("|END OF HEADER")
    for k, epoch in enumerate(table):
        moment = start + dt.timedelta(seconds=k)
        line = moment.strftime(f" %y %m %d %H %M %S.2500000  0{len(names):3d}")
        for j in range(0, len(names), 12):
            text += (line if j == 0 else " " * 32) + "".join(names[j : j + 12]) + "\n"
        for values in epoch:
            for j in range(0, len(codes), 5):
                text += "".join(field(v, "4 ") for v in values[j : j + 5]).rstrip() + "\n"
    return text


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("version", [2, 3])
def test_everything_written_is_read_and_nothing_else(read, seed, version):
    rng = np.random.default_rng([seed, version])
    names = [f"G{p:02d}" for p in rng.choice(32, 9, replace=False) + 1] + ["E07", "J01", "E36", "G32"][: seed + 1]
    names = list(dict.fromkeys(names))
    n_types = int(rng.integers(1, 16))
    if version == 3:
        codes = [k + b + a for b, a in (("1", "C"), ("5", "Q"), ("5", "I"), ("1", "X")) for k in "CLDS"][:n_types]
    else:
        codes = [k + b for b in "1567" for k in "CLDS"][:n_types]
    start = dt.datetime(2021, 5, 8, 23, 59, 55)  # Saturday: into the next week
    table = random_values(rng, 12, names, n_types)
    obs = read((write_2 if version == 2 else write_3)(table, names, codes, start))
    value = {"C": obs.pseudorange, "L": obs.carrier, "S": obs.cn0, "D": obs.range_rate}
    place = {
        (round(t, 3), s, obs.signals[k]): i for i, (t, s, k) in enumerate(zip(obs.t, obs.sat, obs.signal, strict=True))
    }
    assert len(place) == len(obs)
    base = (start - dt.datetime(2021, 5, 2)).total_seconds() + 0.25
    entries = 0
    old = {("G", "1"): "1C", ("J", "1"): "1C", ("E", "1"): "1X"}
    for k, j, m in np.argwhere(table):
        code, name = codes[m], names[j]
        signal = code[1:] if version == 3 else old.get((name[0], code[1]), code[1] + "X")
        if (row := place.get((base + float(k), satellite(name), signal))) is None:
            pytest.fail(f"{name} {code} of epoch {k} is missing")
        stated = float(f"{table[k, j, m] / 1000:.3f}")
        if code[0] == "D" and np.isnan(value["D"][row]):
            assert any("frequency is not known" in n for n in obs.notes)  # no band 7 of GPS
        elif code[0] == "D":
            band = {"1": 1575.42e6, "5": 1176.45e6, "6": 1278.75e6, "7": 1207.14e6}[signal[0]]
            assert value["D"][row] == pytest.approx(-stated * SPEED_OF_LIGHT / band, rel=1e-14)  # rounding
        else:
            assert value[code[0]][row] == stated  # exactly
        entries += 1
    assert entries == sum(int(np.isfinite(v).sum()) for v in value.values()) + sum(
        int(
            table[k, j, m] > 0
            and codes[m] in ("D6", "D7")
            and names[j][0] in "GJ"
            and (names[j][0], codes[m][1]) != ("J", "6")
        )
        for k, j, m in np.ndindex(table.shape)
    )
    assert obs.epoch_gps_s == gps_from_calendar(dt.datetime(2021, 5, 2))


# ------------------------------------------------------------------------------------------ time scales


@pytest.mark.parametrize(
    ("scale", "system", "shift"),
    [("GPS", "M", 0), ("GAL", "M", 0), ("QZS", "M", 0), ("BDT", "M", 14), ("GLO", "M", 18),
     ("   ", "G", 0), ("   ", "R", 18), ("   ", "C", 14), ("   ", "E", 0), ("   ", "M", 0)],
)  # fmt: skip
def test_every_time_scale_becomes_gps_time(read, scale, system, shift):
    text = write_3(np.full((1, 1, 1), 20_000_000_000), ["G01"], ["C1C"], dt.datetime(2023, 1, 8, 10))
    text = text.replace("     GPS ", f"     {scale} ").replace("DATA    M", f"DATA    {system}")
    obs = read(text)
    assert obs.t[0] + obs.epoch_gps_s == gps_from_calendar(dt.datetime(2023, 1, 8, 10)) + 0.25 + shift
    assert bool(obs.notes) == (bool(shift) or not scale.strip())


def test_an_unknown_time_scale_is_refused(read):
    text = write_3(np.full((1, 1, 1), 2 * 10**10), ["G01"], ["C1C"], dt.datetime(2023, 1, 8, 10))
    with pytest.raises(FileFormatError, match=r"expected a time scale of GPS.*got 'XYZ'"):
        read(text.replace("     GPS ", "     XYZ "))


def test_old_glonass_files_are_utc_of_their_year(read):
    text = write_2(np.full((1, 1, 1), 2 * 10**10), ["R01"], ["C1"], dt.datetime(1999, 3, 1)).replace(
        "DATA    M", "DATA    R"
    )
    obs = read(text)
    assert obs.t[0] + obs.epoch_gps_s == gps_from_calendar(dt.datetime(1999, 3, 1)) + 0.25 + 13


# ---------------------------------------------------------------------------------------------- signals


@pytest.mark.parametrize(
    ("codes", "name", "expected"),
    [
        ("C1 L1 D1 S1", "G01", {"1C": "CLDS"}),
        ("P1 L1 D1 S1", "G01", {"1W": "CLDS"}),
        ("C1 P1 L1 P2 L2", "G01", {"1C": "CL", "1W": "C", "2W": "CL"}),
        ("C1 P1 L1 P2 C2 L2", "R01", {"1C": "CL", "1P": "C", "2P": "CL", "2C": "C"}),
        ("C2 L2 S2", "G01", {"2X": "CLS"}),
        ("C2 L2", "R01", {"2C": "CL"}),
        ("C5 L5", "G01", {"5X": "CL"}),
        ("C1 L1 C5 L5 C7 L7 C8", "E01", {"1X": "CL", "5X": "CL", "7X": "CL", "8X": "C"}),
        ("C2 L2 C7 C6", "C06", {"2I": "CL", "7I": "C", "6I": "C"}),
        ("C1 L1", "C06", {"2I": "CL"}),
        ("C1 S1", "S20", {"1C": "CS"}),
        ("C1 L2", "S20", {"1C": "C"}),
        ("P1 L1", "E01", {"1X": "L"}),
        ("CA LA SA CC LC P2", "G01", {"1C": "CLS", "2X": "CL", "2W": "C"}),
        ("CB LB", "G01", {"1X": "CL"}),
        ("CD LD", "R01", {"2C": "CL"}),
    ],
)
def test_types_of_version_2_become_signals(read, codes, name, expected):
    codes = codes.split()
    table = np.full((1, 1, len(codes)), 2 * 10**10)
    obs = read(write_2(table, [name], codes, dt.datetime(2010, 1, 1)), glonass_channels={satellite("R01"): 0})
    entries = {}
    for k, signal in enumerate(obs.signal):
        kinds = zip("CLDS", (obs.pseudorange, obs.carrier, obs.range_rate, obs.cn0), strict=True)
        entries[obs.signals[signal]] = "".join(kind for kind, v in kinds if np.isfinite(v[k]))
    assert entries == expected


@pytest.mark.parametrize(("version", "signal"), [("3.02", "2I"), ("3.04", "1I")])
def test_b1_of_version_3_02_has_another_name(read, version, signal):
    obs = read(write_3(np.full((1, 1, 1), 2 * 10**10), ["C06"], ["C1I"], dt.datetime(2020, 1, 1), version))
    assert obs.signals == (signal,)
    assert any("3.02" in n for n in obs.notes) == (version == "3.02")


def test_glonass_needs_channels_for_range_rates(read):
    text = write_3(np.full((1, 2, 2), 10**6), ["R01", "G01"], ["D1C", "S1C"], dt.datetime(2020, 1, 1))
    obs = read(text)
    np.testing.assert_array_equal(np.isfinite(obs.range_rate), [False, True])
    assert any("No range rates of R01:" in n and "glonass_channels" in n for n in obs.notes)
    obs = read(text, glonass_channels={satellite("R01"): -3})
    assert obs.range_rate[0] == pytest.approx(-1000.0 * SPEED_OF_LIGHT / (1602e6 - 3 * 562.5e3), rel=1e-14)
    assert obs.notes == ()


def test_satellites_without_types_are_passed_over_and_noted(read):
    text = V3.replace("E    2 C1C S1C".ljust(60) + "SYS / # / OBS TYPES\n", "")
    obs = read(text)
    assert "E24" not in {r[1] for r in rows(obs)}
    assert any("no types of these lines" in n and "2 of Galileo" in n for n in obs.notes)


# ------------------------------------------------------------------------------------- order, repetition


def epochs_of(text):
    """Header and epochs of a version 3 file."""
    header, _, body = text.partition("END OF HEADER\n")
    return header + "END OF HEADER\n", [">" + e for e in body.split(">")[1:]]


def test_epochs_out_of_order_are_put_in_order(read, rng):
    header, epochs = epochs_of(
        write_3(
            random_values(rng, 6, ["G01", "G02"], 3), ["G01", "G02"], ["C1C", "L1C", "C5Q"], dt.datetime(2020, 1, 1)
        )
    )
    mixed = read(header + "".join(epochs[k] for k in (3, 0, 1, 5, 2, 4)))
    same(mixed, read(header + "".join(epochs)))
    assert any("Time goes back at 2 epochs" in n for n in mixed.notes)


def test_repeated_epochs_and_satellites_count_once(read, rng):
    table = rng.integers(10**9, 3 * 10**10, (3, 2, 2))
    header, epochs = epochs_of(write_3(table, ["G01", "G02"], ["C1C", "C5Q"], dt.datetime(2020, 1, 1)))
    again = epochs[1].replace("G02", "G03")
    obs = read(header + epochs[0] + epochs[1] + again + epochs[2])
    assert len(obs.epochs) == 3
    assert [satellite_name(s) for s in obs.sat[obs.t == obs.epochs[1]]] == ["G01", "G01", "G02", "G02", "G03", "G03"]
    assert any("1 epochs have the time of the one before" in n for n in obs.notes)
    assert any("1 lines name a satellite again" in n for n in obs.notes)
    twice = read(header + epochs[0].replace("G02", "G01") + epochs[1])
    np.testing.assert_array_equal(twice.pseudorange[:2], table[0, 0] / 1000)
    assert len(twice) == 6


def test_an_epoch_with_fewer_lines_than_it_says_is_noted(read, rng):
    # so in a file of the INSTINCT project, from which satellites were deleted by hand
    header, epochs = epochs_of(
        write_3(
            random_values(rng, 4, ["G01", "G02"], 3), ["G01", "G02"], ["C1C", "L1C", "C5Q"], dt.datetime(2020, 1, 1)
        )
    )
    shorter = epochs[1].rpartition("G02")[0]
    obs = read(header + epochs[0] + shorter + epochs[2] + epochs[3])
    whole = read(header + "".join(epochs))
    keep = ~((whole.t == whole.epochs[1]) & (whole.sat == satellite("G02")))
    same(obs, whole.where(keep))
    assert any(re.search(r"1 epochs have fewer lines than they say, the first in line \d+", n) for n in obs.notes)


# ------------------------------------------------------------------------------------------ packed files


def test_packed_files(tmp_path, read):
    expected = read(V3)
    raw = V3.encode("latin-1")
    same(read(gzip.compress(raw), "site.obs.gz"), expected)
    same(read(gzip.compress(raw[:700]) + gzip.compress(raw[700:]), "two.gz"), expected)
    same(read(bz2.compress(raw), "site.bz2"), expected)
    with zipfile.ZipFile(tmp_path / "site.zip", "w") as archive:
        archive.writestr("site.obs", raw)
    same(read_rinex_observation(tmp_path / "site.zip"), expected)


def test_a_gzip_cut_off_is_read_as_far_as_it_goes(read):
    table = np.random.default_rng(5).integers(10**9, 3 * 10**10, (40, 3, 4))
    text = write_3(table, ["G01", "G02", "G03"], ["C1C", "L1C", "D1C", "S1C"], dt.datetime(2020, 1, 1))
    packed = gzip.compress(text.encode())
    obs = read(packed[: len(packed) * 3 // 4], "cut.gz")
    whole = read(text)
    assert 10 < len(obs.epochs) < 40
    same(obs, whole.where(whole.t <= obs.epochs[-1]))
    assert any("gzip file is cut off" in n for n in obs.notes)
    assert any("ends within" in n for n in obs.notes)


@pytest.mark.parametrize("text", [V2, V3], ids=["2", "3"])
def test_hatanakas_scheme_and_compress(read, text):
    hatanaka = pytest.importorskip("hatanaka", reason="Hatanaka's scheme needs the library hatanaka")
    import ncompress

    expected = read(text)
    raw = text.encode("ascii", "replace")
    plain = re.sub(rb"(?m)^(?=> .{29}[46]| .{27}[56]).*\n.*\n", b"", raw) if text is V3 else raw
    same(read(ncompress.compress(raw), "site.obs.Z"), expected)
    table = np.random.default_rng(7).integers(10**9, 3 * 10**10, (20, 3, 4))
    writer, codes = (write_2, "C1 L1 D1 S1") if text is V2 else (write_3, "C1C L1C D1C S1C")
    written = writer(table, ["G01", "G02", "E03"], codes.split(), dt.datetime(2020, 1, 1))
    written = written.replace("END OF HEADER", "MARKER NAME".ljust(20) + "\n" + " " * 60 + "END OF HEADER")
    assert plain
    packed = hatanaka.rnx2crx(written.encode())
    assert b"CRINEX" in packed[:100]
    same(read(packed, "site.crx"), read(written))
    same(read(gzip.compress(packed), "site.crx.gz"), read(written))
    damaged = read(packed[: len(packed) // 2] + b"\x01\x02 nonsense\n" * 5, "bad.crx")
    assert 0 < len(damaged.epochs) < 20
    assert any("On unpacking (Hatanaka's scheme)" in n for n in damaged.notes)


@pytest.mark.parametrize(
    "start", [b"\x1f\x9d\x90abc", b"3.0                 COMPACT RINEX FORMAT".ljust(60) + b"CRINEX VERS   / TYPE\n"]
)
def test_a_missing_library_is_named(read, monkeypatch, start):
    monkeypatch.setitem(sys.modules, "hatanaka", None)
    monkeypatch.setitem(sys.modules, "ncompress", None)  # comes with it
    with pytest.raises(InputError, match="pip install hatanaka"):
        read(start)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (gzip.compress(V3.encode("latin-1"))[:-8] + bytes(8), "gzip file is damaged"),
        (b"BZh9rubbish", "bzip2 file is damaged"),
        (b"PK\x03\x04rubbish", "zip file cannot be read"),
        (gzip.compress(b"", mtime=0), "packed file is empty"),
    ],
)
def test_damaged_packed_files(read, data, message):
    with pytest.raises(FileFormatError, match=message):
        read(data)


# ---------------------------------------------------------------------------------------------- faults


def changed(old, new, text=V3):
    assert text.count(old) >= 1, old
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("t,x,y\n1,2,3\n", "first line has 'RINEX VERSION / TYPE' from column 61"),
        (b"\xb5b\x02\x15" + bytes(2000), "got a binary file"),
        (("\ufeff" + V3).encode("utf-16-le"), "UTF-16"),
        (changed("3.04", "5.01"), "expected RINEX version 2, 3 or 4, got '5.01'"),
        (changed("3.04", "1.00"), "got '1.00'"),
        (changed("3.04", "    "), "got ''"),
        (changed("OBSERVATION DATA", "NAVIGATION DATA "), "read it with read_rinex_navigation"),
        (changed("OBSERVATION DATA", "METEOROLOGICAL  "), "got one of meteorological data"),
        (changed("OBSERVATION DATA", "XBSERVATION DATA"), "kind of file in column 21"),
        (changed("END OF HEADER", "END OF NOTHING"), "has no 'END OF HEADER'"),
        (V3[: V3.index("END OF HEADER") + 14], "no complete epoch"),
        (changed("G   14", "G   13"), "expected 13 types such as C1C of system G, got C1C L1C"),
        (changed("G   14", "G    x"), "one list with a count for each system"),
        (re.sub(r"OBS TYPES", "OBS TYPE ", V3), "header has no 'SYS / # / OBS TYPES'"),
        (changed("     7    C1", "     8    C1", V2), "expected 8 types such as C1"),
        (re.sub(r"# / TYPES", "# / TIPES", V2), "header has no '# / TYPES OF OBSERV'"),
        (changed("C   10", "C   17", V4), "expected 1, 10, 100 or 1000"),
    ],
)
def test_faults_of_the_header(read, text, message):
    with pytest.raises(FileFormatError, match=re.escape(message)):
        read(text)


def line_of(text, part):
    return text[: text.index(part)].count("\n") + 1


EPOCH = "expected the line of an epoch"
TYPES_3, TYPES_2 = "G    1 C1C".ljust(60) + "SYS / # / OBS TYPES", "     1    C1".ljust(60) + "# / TYPES OF OBSERV"


@pytest.mark.parametrize(
    ("text", "part", "message"),
    [
        (changed("21735785.983 9", " 21735785.983 "), "G05  ", "C1C: expected a number with three decimals"),
        (changed(" 21735783.815", "2x735783.815 "), "G05  ", "C2W"),
        (changed("E24  24088550", "X24  24088550"), "X24", "expected a satellite such as G05"),
        (changed("2023 01 08 10 00  0.12", "2023 01 38 10 00  0.12"), "> 2023 01 38", "date of an epoch"),
        (changed("2023 01 08 10 00  0.12", "2023 01 08 10 00  0,12"), "> 2023", "date of an epoch"),
        (changed("0.1234567  0  3", "0.1234567  0  x"), "> 2023", "an event flag and a number"),
        (changed("0.1234567  0  3", "0.1234567  8  3"), "> 2023", "an event flag and a number"),
        (changed("0.1234567  0  3", "0.1234567  0  2"), "E24  2408", EPOCH),
        (changed("0.000123456789", "0.00x123456789"), "> 2023", "a receiver clock offset"),
        (changed("> 2023 01 08 10 00  0.1", "  2023 01 08 10 00  0.1"), "  2023 01 08 10 00", EPOCH),
        (V3 + V3, V3 + V3[:1], "a second header begins here"),
        (changed("G > another".ljust(60) + "COMMENT", TYPES_3), "G    1 C1C", "changes here, within the file"),
        (changed("G09", "X09", V2), " 01  3 24", "expected a satellite such as G05"),
        (changed("  0 13G12", "  0 1xG12", V2), " 01  3 24", EPOCH),
        (changed("0  1 12", "0  2 12", V2), " 01  3 24 13 11", "expected a satellite such as G05"),
        (changed("  20891534.648", "  20891534,648", V2), "  20891534,648", "C1: expected a number"),
        (changed("         .400", "     x   .400", V2), "     x   .400", "L2: expected a number"),
        (changed("01  3 24 13 11", "01  3 24 13 61", V2), " 01  3 24 13 61", "date of an epoch"),
        (V2 + V2, V2 + V2[:1], "a second header begins here"),
        (changed("blank date above".ljust(60) + "COMMENT", TYPES_2, V2), "     1    C1", "changes here"),
    ],
)  # fmt: skip
def test_faults_of_the_body_name_the_line(read, text, part, message):
    if "0  2 12" in text:
        text += "\n\n"  # lines enough for a second satellite
    with pytest.raises(FileFormatError, match=re.escape(message)) as fault:
        read(text)
    line = (
        text.count("\n", 0, len(part)) + (0 if part.endswith("\n") else 1) if len(part) > 200 else line_of(text, part)
    )
    assert fault.value.line == line


def test_no_such_file(tmp_path):
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_rinex_observation(tmp_path / "none.obs")


@pytest.mark.thinned(2)
@pytest.mark.parametrize("version", [2, 3])
def test_a_file_cut_off_anywhere_is_read_up_to_the_last_complete_epoch(read, version):
    """Whatever the place of the cut, no value is there that the whole file does not have."""
    table = np.random.default_rng(11).integers(10**9, 3 * 10**10, (3, 2, 6))
    table[:, 0, 3:] = 0
    writer, codes = (write_2, "C1 L1 S1 C5 L5 S5") if version == 2 else (write_3, "C1C L1C S1C C5Q L5Q S5Q")
    text = writer(table, ["G01", "G02"], codes.split(), dt.datetime(2020, 1, 1))
    whole = read(text)
    first = text.index("END OF HEADER") + 14
    given = {r[:3]: r[3:] for r in rows(whole)}
    complete = 0
    refusals = []
    for cut in range(first, len(text)):
        try:
            obs = read(text[:cut])
        except FileFormatError as error:
            refusals.append(str(error))
            continue
        for key, values in ((r[:3], r[3:]) for r in rows(obs)):
            assert all(v is None or v == given[key][k] for k, v in enumerate(values)), cut
        assert len(obs.epochs) >= complete
        complete = max(complete, len(obs.epochs) - 1)  # the last one may lose fields, not digits
        for t in obs.epochs[:-1]:
            assert sum(obs.t == t) == sum(whole.t == t)
    assert complete == 2
    assert all("no complete epoch" in message for message in refusals)


# -------------------------------------------------------------------------------------- real recordings


@pytest.mark.realdata
def test_rtkexp_walk(shared_data):
    obs = read_rinex_observation(shared_data / "rtkexp_walk" / "gnss_1730.obs")
    assert len(obs.epochs) == 536
    assert obs.notes == ()
    assert obs.epoch_gps_s / 604_800.0 == 2381.0
    np.testing.assert_allclose(obs.epochs[[0, -1]], [408_639.748, 408_773.498], rtol=0, atol=1e-9)
    table = rows(obs.where(obs.t == obs.t[0]))
    # read by eye: G10, G18 (whose second phase is blank) and C21
    assert table[0][1:5] == ("G10", "1C", 20576396.770, 108129693.934)
    assert table[0][5] == pytest.approx(-1064.326 * L1, rel=1e-14)
    assert table[0][6] == 51.0
    assert table[1][1:5] == ("G10", "2X", 20576399.569, 84256913.850)
    (g18,) = (r for r in table if r[1:3] == ("G18", "2X"))
    assert g18[3:] == (21875371.688, None, pytest.approx(2078.995 * SPEED_OF_LIGHT / 1227.6e6, rel=1e-14), 30.0)
    (c21,) = (r for r in table if r[1:3] == ("C21", "5X"))
    assert c21[3:5] == (21534103.024, 84504436.889)


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("variant", "code", "doppler"), [("", 0, True), ("_noDoppler", 0, False), ("_psrGaps", 1, True)]
)
def test_instinct_tckf(shared_data, variant, code, doppler):
    folder = shared_data / "instinct_tckf"
    channels = glonass_channels(read_rinex_navigation(folder / "reach-m2-01_raw_202306291111.nav"))
    obs = read_rinex_observation(folder / f"reach-m2-01_raw_202306291111{variant}.23O", glonass_channels=channels)
    assert len(obs.epochs) == 610
    np.testing.assert_allclose(np.diff(obs.epochs), 0.1, rtol=0, atol=1.1e-3)  # stamps are in milliseconds
    assert np.mean([len(np.unique(obs.sat[obs.t == t])) for t in obs.epochs[::50]]) == pytest.approx(33, abs=2)
    has_rate = np.isfinite(obs.range_rate)
    assert has_rate.mean() > 0.95 if doppler else not has_rate.any()
    assert np.isnan(obs.pseudorange).any() == bool(code)
    assert obs.signals == ("1C", "2X", "2C", "1X", "7X", "2I")  # 7I is in the header only
    if variant == "_noDoppler":
        assert any("25 epochs have fewer lines" in n for n in obs.notes)
    # range rates agree with the differences of ranges: centimetres a second against 2 * 3 m / 60 s
    ends = [obs.where((obs.t == t) & (obs.signal == 0)) for t in (obs.epochs[0], obs.epochs[-1])]
    if doppler and not code:
        both = np.intersect1d(ends[0].sat, ends[1].sat)
        a, b = (e.where(np.isin(e.sat, both)) for e in ends)
        mean = (b.pseudorange - a.pseudorange) / (obs.epochs[-1] - obs.epochs[0])
        np.testing.assert_allclose(mean, (a.range_rate + b.range_rate) / 2.0, rtol=0, atol=1.0)


@pytest.mark.realdata
@pytest.mark.parametrize("folder", ["iono-none_tropo-none", "iono-Klob_tropo-Saast"])
def test_instinct_spirent(shared_data, folder):
    obs = read_rinex_observation(shared_data / "instinct_spirent" / folder / "Rover-dynamic_MO_Spirent.obs")
    np.testing.assert_allclose(obs.epochs, 36_000.0 + np.arange(601.0), rtol=0, atol=0)
    assert obs.epoch_gps_s / 604_800.0 == 2244.0
    assert obs.notes == ()
    if folder == "iono-none_tropo-none":
        (row,) = (r for r in rows(obs.where(obs.t == 36_001.0)) if r[1:3] == ("G08", "1C"))
        assert row[3:] == (25065433.863, 131719743.984, pytest.approx(1453.620 * L1, rel=1e-14), 54.233)


@pytest.mark.campaign
@pytest.mark.realdata
@pytest.mark.filterwarnings("ignore")
def test_georinex_reads_the_same_values(shared_data, tmp_path):
    """Every value of 30 epochs; exactly, but for Doppler, which we turn to range rates."""
    georinex = pytest.importorskip("georinex", reason="the comparison needs georinex")
    source = shared_data / "instinct_tckf" / "reach-m2-01_raw_202306291111_psrGaps.23O"
    header, epochs = epochs_of(source.read_text())
    path = put(tmp_path, header + "".join(epochs[200:230]), "cut.23o")
    theirs = georinex.load(path)
    obs = read_rinex_observation(path, glonass_channels={100 + k: 0 for k in range(1, 25)})
    columns = {str(s): k for k, s in enumerate(theirs.sv.values)}
    epoch, sv = np.searchsorted(obs.epochs, obs.t), np.array([columns[satellite_name(s)] for s in obs.sat])
    compared = 0
    for k, signal in enumerate(obs.signals):
        m = obs.signal == k
        for kind, ours in (("C", obs.pseudorange), ("L", obs.carrier), ("S", obs.cn0)):
            expected = theirs[kind + signal].values
            entries = np.full(expected.shape, np.nan)
            entries[epoch[m], sv[m]] = ours[m]
            np.testing.assert_array_equal(entries, np.where(expected == 0.0, np.nan, expected))
            compared += np.isfinite(entries).sum()
        np.testing.assert_array_equal(
            np.isfinite(obs.range_rate[m]), np.isfinite(theirs["D" + signal].values[epoch[m], sv[m]])
        )
    assert compared > 4000


def test_systems_are_in_the_order_this_file_takes():
    assert SYSTEMS == "GRECJIS"
