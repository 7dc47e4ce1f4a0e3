"""Code biases: files read back, taken out of ranges beside precise clocks only, damage refused."""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from sky import EPOCH, HOME, ephemerides, observe

import schuler
from schuler.exceptions import FileFormatError
from schuler.gnss import prepare_ranges, satellite_states
from schuler.gnss.code_biases import biases_at, relative_biases_at
from schuler.gnss.precise import PreciseOrbits, relativistic_clock
from schuler.gnss.signals import SPEED_OF_LIGHT, satellite_name
from schuler.recording.formats.sinex_bias import read_code_differences, read_sinex_bias

OPEN = ("0000:000:00000", "0000:000:00000")


def line(sat, signal, bias, kind="OSB", unit="ns", times=OPEN, station="", against=""):
    text = f" {kind:<4} {'G000':<4} {sat:<3} {station:<9} {signal:<4} {against:<4} {times[0]} {times[1]} {unit:<4}"
    return f"{text} {bias:21.4f} {0.01:11.4f}"


def bias_text(rows, scale="G"):
    head = ["%=BIA 1.00 SCH 2021:001:00000 SCH 2021:001:00000 2021:002:00000 A 00000000", "+BIAS/DESCRIPTION"]
    head += [f" TIME_SYSTEM                             {scale}", "-BIAS/DESCRIPTION", "+BIAS/SOLUTION"]
    head.append(
        "*BIAS SVN_ PRN STATION__ OBS1 OBS2 BIAS_START____ BIAS_END______ UNIT __ESTIMATED_VALUE____ _STD_DEV___"
    )
    return "\n".join([*head, *rows, "-BIAS/SOLUTION", "%=ENDBIA", ""])


def read(tmp_path, text):
    (tmp_path / "own.bia").write_text(text)
    return read_sinex_bias(tmp_path / "own.bia")


def test_what_is_read(tmp_path):
    day = ("2021:118:00000", "2021:119:00000")
    rows = [line("G01", "C1C", -7.5, times=day), line("G01", "C2W", 3.25), line("E11", "C5Q", 1.0)]
    others = [line("G01", "L1C", 0.1), line("G01", "C1C", 9.0, station="ZIMM"), line("G01", "C1C", 2.0, kind="ISB")]
    table = read(tmp_path, bias_text([*rows, *others]))
    assert table.signal == ("1C", "2W", "5Q")
    assert table.begin[0] == 1_303_603_200.0 - 1_303_603_200.0 % 86_400.0  # 2021-04-28
    t = table.begin[0] + np.array([43_200.0, 129_600.0, 43_200.0, 43_200.0, 43_200.0])
    got = biases_at(table, np.array([1, 1, 1, 211, 2]), np.array(["1C", "1C", "2W", "5Q", "1C"]), t)
    np.testing.assert_allclose(got, 1e-9 * np.array([-7.5, np.nan, 3.25, 1.0, np.nan]), rtol=1e-12)


@pytest.mark.parametrize("ionosphere", ["none", "free"])
def test_ranges_are_those_without_biases(tmp_path, ionosphere):
    """Measurements with the biases of a file, and the file: those of measurements and a file of zeros. Rounding."""
    rng = np.random.default_rng(4)
    messages = ephemerides(rng, "G", 14)
    t, sats = EPOCH + np.arange(-1800.0, 1801.0, 300.0), np.unique(messages.kepler.sat)
    s = satellite_states(messages, np.tile(sats, len(t)), np.repeat(t, len(sats)))
    clock, r_e = s.clock.reshape(len(t), -1), s.r_e.reshape(len(t), -1, 3)
    precise = replace(messages, precise_orbits=PreciseOrbits(t, sats, r_e, clock, np.full(len(sats), 0.02)))
    seen = observe(messages, np.array([0.0, 60.0]), lambda _: HOME, lambda _: 2e-4, bands=("1C", "2W"))
    value = {(sat, name): round(rng.normal(0.0, 5.0), 4) for sat in sats.tolist() for name in seen.signals}
    late = np.array([value[(sat, seen.signals[k])] for sat, k in zip(seen.sat.tolist(), seen.signal, strict=True)])
    biased = replace(seen, pseudorange=seen.pseudorange + 1e-9 * SPEED_OF_LIGHT * late)
    tables = []
    for scale in (1.0, 0.0):
        rows = [line(satellite_name(sat), f"C{name}", scale * v) for (sat, name), v in value.items()]
        (tmp_path / "own.bia").write_text(bias_text(rows))
        tables.append(schuler.read(tmp_path / "own.bia").ephemerides)
    options = {"ionosphere": ionosphere, "troposphere": "none", "elevation_mask": 0.0}
    a = prepare_ranges(biased, precise.merged_with(tables[0]), **options)
    b = prepare_ranges(seen, precise.merged_with(tables[1]), **options)
    assert a.used.sum() > 8
    np.testing.assert_allclose(a.pseudorange[a.used], b.pseudorange[b.used], atol=1e-4)
    assert np.abs(prepare_ranges(biased, precise, **options).pseudorange - b.pseudorange)[b.used].max() > 0.5
    assert any("code biases are those of the file for" in note for note in a.notes)
    beside_messages = prepare_ranges(seen, messages.merged_with(tables[0]), **options)
    np.testing.assert_array_equal(beside_messages.pseudorange, prepare_ranges(seen, messages, **options).pseudorange)
    assert any("they belong to precise clocks" in note for note in beside_messages.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x\n", "expected a SINEX BIAS file"),
        (bias_text([line("G01", "C1C", 1.0, kind="ISB", against="C1W")]), r"expected biases \(OSB\) .* got ISB"),
        (bias_text([line("G01", "C1C", 1.0, kind="DSB", against="C1C")]), "a difference of two codes"),
        (bias_text([line("G01", "C1C", 1.0, unit="cyc")]), "in ns"),
        (bias_text([line("G01", "C1C", 5000.0)]), "below 1000"),
        (bias_text([line("G0x", "C1C", 1.0)]), "expected a satellite"),
        (bias_text([line("G01", "C1C", 1.0)], "UTC"), "TIME_SYSTEM"),
        (bias_text([line("G01", "C1C", 1.0)]).split("-BIAS/SOL")[0], "cut before"),
    ],
    ids=["other", "between systems", "itself", "unit", "size", "satellite", "scale", "cut"],
)
def test_damage_is_refused_with_the_reason(tmp_path, text, message):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, text)


PLACE = {"1C": "1C", "2L": "2W", "5Q": "5Q", "2I": "1C", "6I": "2W"}  # by which the sky of the tests calls them
SHARE = 1575.42**2 / (1575.42**2 - 1227.60**2)  # of L1 in what has no ionosphere


def code_text(pair, rows, title="YEAR 2021, MONTH 03"):
    """A monthly file of CODE; a station's line, too."""
    head = [
        f"CODE'S MONTHLY GNSS {pair} DCB SOLUTION, {title}      04-APR-21 08:47", 80 * "-", "",
        f"DIFFERENTIAL ({pair}) CODE BIASES FOR SATELLITES AND RECEIVERS:", "",
        "PRN / STATION NAME        VALUE (NS)  RMS (NS)", "***   ****************    *****.***   *****.***",
    ]  # fmt: skip
    body = [f"{sat:<3}   {'':<16}    {value:9.3f}   {0.01:9.3f}" for sat, value in rows]
    return "\n".join([*head, *body, f"G     {'ZIMM 14001M004':<16}    {12.345:9.3f}   {0.1:9.3f}", ""])


def own_clocks(messages, t, sats):
    """The messages' places and clocks as precise ones; those of BeiDou without ionosphere of B1I and B3I."""
    s = satellite_states(messages, np.tile(sats, len(t)), np.repeat(t, len(sats)))
    beidou, share = s.group_delay[:, 0] * (np.tile(sats, len(t)) // 100 == 3), 1561.098**2 / (1561.098**2 - 1268.52**2)
    clock = (s.clock - relativistic_clock(s.r_e, s.v_e)[0] - share * beidou).reshape(len(t), -1)
    orbits = PreciseOrbits(t, sats, s.r_e.reshape(len(t), -1, 3), clock, np.full(len(sats), 0.02))
    return replace(messages, precise_orbits=orbits)


def with_biases(seen, late):
    """The same measurements, late by nanoseconds ``late[sat, signal]``."""
    rows = zip(seen.sat.tolist(), seen.signal, strict=True)
    ns = np.array([late[(sat, seen.signals[k])] for sat, k in rows])
    return replace(seen, pseudorange=seen.pseudorange + 1e-9 * SPEED_OF_LIGHT * ns)


def test_differences_are_followed_to_the_pair_of_the_clocks(tmp_path):
    """By hand: B_1W - B_2W = -8 makes B_1W = (1 - a) (-8); 1C is 1.5 less, 5Q 4 more than 1C. A circle is adjusted."""
    rows = [
        line("G01", "C1C", -1.5, "DSB", against="C1W"), line("G01", "C1W", -8.0, "DSB", against="C2W"),
        line("G01", "C1C", -4.0, "DSB", against="C5Q"), line("G02", "C1C", -1.5, "DSB", against="C1W"),
        line("E11", "C1C", 3.0, "DSB", against="C5Q"), line("E11", "C5Q", 2.0, "DSB", against="C7Q"),
        line("E11", "C1C", 5.6, "DSB", against="C7Q"), line("E12", "C1X", 3.0, "DSB", against="C7X"),
        line("G01", "C1W", 9.0, "DSB", against="C1C"),  # the first one counts, either way round
    ]  # fmt: skip
    table = read(tmp_path, bias_text(rows))
    sat = np.array([1, 1, 1, 1, 2, 211, 211, 212])
    signal = np.array(["1W", "2W", "1C", "5Q", "1C", "1C", "7Q", "1X"])
    got = relative_biases_at(table, sat, signal, np.full(8, 1.3e9))
    w = (1.0 - SHARE) * -8.0
    e = 1.0 - 1575.42**2 / (1575.42**2 - 1176.45**2)
    # 0.6 ns by which the circle of E11 does not close go to its three differences alike
    expected = [w, w + 8.0, w - 1.5, w + 2.5, np.nan, 3.2 * e, 3.2 * e - 5.4, np.nan]
    np.testing.assert_allclose(1e9 * got.to_clock, expected, atol=1e-9)
    np.testing.assert_allclose(1e9 * got.to_band[:5, 1], [0.0, 8.0, -1.5, 2.5, -1.5], atol=1e-9)
    np.testing.assert_allclose(1e9 * got.to_band[5:, 7], [5.4, 0.0, 3.0], atol=1e-9)
    stated = " SATELLITE_CLOCK_REFERENCE_OBSERVABLES   E  C1X  C7X\n-BIAS/DESCRIPTION"
    other = read(tmp_path, bias_text(rows).replace("-BIAS/DESCRIPTION", stated))
    assert other.pairs == (("E", "1X", "7X"),)
    last = relative_biases_at(other, sat, signal, np.full(8, 1.3e9)).to_clock[-1]
    np.testing.assert_allclose(last, 3e-9 * (1.0 - 1575.42**2 / (1575.42**2 - 1207.14**2)), rtol=1e-9)


@pytest.mark.parametrize("ionosphere", ["none", "free"])
@pytest.mark.parametrize("form", ["SINEX", "CODE"])
def test_ranges_beside_precise_clocks_are_those_without_biases(tmp_path, form, ionosphere):
    """Differences 1W to 1C and to 2W; clocks are without ionosphere of 1W and 2W. Rounding of the files."""
    rng = np.random.default_rng(5)
    messages = ephemerides(rng, "G", 14)
    sats = np.unique(messages.kepler.sat)
    precise = own_clocks(messages, EPOCH + np.arange(-1800.0, 1801.0, 300.0), sats)
    c1, p2 = np.round(rng.normal(0.0, 5.0, (2, len(sats))), 3)
    names = [satellite_name(x) for x in sats.tolist()]
    month = "YEAR 2021, MONTH 03"  # EPOCH is 2021-03-18
    if form == "CODE":
        for pair, values in (("P1-C1", c1), ("P1-P2", p2)):
            text = code_text(pair, zip(names, values.tolist(), strict=True), month).encode()
            (tmp_path / f"{pair}.DCB.gz").write_bytes(gzip.compress(text))
        table = schuler.read(tmp_path / "P1-C1.DCB.gz").ephemerides
        table = table.merged_with(schuler.read(tmp_path / "P1-P2.DCB.gz").ephemerides)
    else:
        rows = [line(n, "C1W", v, "DSB", against="C1C") for n, v in zip(names, c1.tolist(), strict=True)]
        rows += [line(n, "C1W", v, "DSB", against="C2W") for n, v in zip(names, p2.tolist(), strict=True)]
        (tmp_path / "own.BSX").write_text(bias_text(rows))
        table = schuler.read(tmp_path / "own.BSX").ephemerides
    seen = observe(messages, np.array([0.0, 60.0]), lambda _: HOME, lambda _: 2e-4, bands=("1C", "2W"))
    w = dict(zip(sats.tolist(), (1.0 - SHARE) * p2, strict=True))
    less = {x: {"1C": a, "2W": b} for x, a, b in zip(sats.tolist(), c1, p2, strict=True)}
    biased = with_biases(seen, {(x, k): w[x] - less[x][k] for x in less for k in less[x]})
    options = {"ionosphere": ionosphere, "troposphere": "none", "elevation_mask": 0.0}
    a = prepare_ranges(biased, precise.merged_with(table), **options)
    (tmp_path / "zero.bia").write_text(bias_text([line(n, f"C{k}", 0.0) for n in names for k in ("1C", "2W")]))
    zeros = precise.merged_with(schuler.read(tmp_path / "zero.bia").ephemerides)
    b = prepare_ranges(seen, zeros, **options)
    assert a.used.sum() > 8
    np.testing.assert_allclose(a.pseudorange[a.used], b.pseudorange[b.used], atol=1e-4)
    np.testing.assert_allclose(a.sigma_range, b.sigma_range)
    assert np.abs(prepare_ranges(biased, zeros, **options).pseudorange - b.pseudorange)[b.used].max() > 0.5


@pytest.mark.parametrize("wanted", ["1C", "2L", "5Q"])
def test_ranges_beside_messages_are_relative_to_group_delays(tmp_path, wanted):
    """TGD is 1W's: 1C by one difference, 2L by another to 2W, 5Q, whose delay is not broadcast, by 1C to 1W."""
    rng = np.random.default_rng(6)
    messages = ephemerides(rng, "G", 14)
    sats = np.unique(messages.kepler.sat).tolist()
    c, two, five = np.round(rng.normal(0.0, 5.0, (3, len(sats))), 4)
    rows = [line(satellite_name(x), "C1C", v, "DSB", against="C1W") for x, v in zip(sats, c.tolist(), strict=True)]
    rows += [line(satellite_name(x), "C2W", v, "DSB", against="C2L") for x, v in zip(sats, two.tolist(), strict=True)]
    rows += [line(satellite_name(x), "C5Q", v, "DSB", against="C1C") for x, v in zip(sats, five.tolist(), strict=True)]
    (tmp_path / "own.bia").write_text(bias_text(rows))
    both = messages.merged_with(schuler.read(tmp_path / "own.bia").ephemerides)
    seen = observe(messages, np.array([0.0, 60.0]), lambda _: HOME, lambda _: 2e-4, bands=(PLACE[wanted],))
    seen = replace(seen, signals=(wanted,))
    late = {"1C": c, "2L": -two, "5Q": c + five}[wanted]  # the made sky has L5 as late as L1
    biased = with_biases(seen, {(x, wanted): v for x, v in zip(sats, late, strict=True)})
    options = {"ionosphere": "none", "troposphere": "none", "elevation_mask": 0.0, "signals": {"G": (wanted,)}}
    a, b = prepare_ranges(biased, both, **options), prepare_ranges(seen, messages, **options)
    assert a.used.sum() > 8
    np.testing.assert_allclose(a.pseudorange[a.used], b.pseudorange[b.used], atol=1e-4)
    assert np.abs(prepare_ranges(biased, messages, **options).pseudorange - b.pseudorange)[b.used].max() > 0.5
    less = b.sigma_range[b.used] ** 2 - a.sigma_range[a.used] ** 2
    np.testing.assert_allclose(less, 1.0 if wanted == "5Q" else 0.0, atol=1e-6)
    assert any("of them relative to group delays" in note for note in a.notes)
    alone = prepare_ranges(replace(seen, signals=("1X",)), both, **(options | {"signals": {"G": ("1X",)}}))
    assert any("for 0 pseudoranges, " in note and note.endswith("have none in it") for note in alone.notes)


@pytest.mark.parametrize("signal", ["2I", "6I"])
def test_beidous_biases_are_against_its_precise_clocks(tmp_path, signal):
    """Clocks are those of B1I and B3I without ionosphere, not of B3I, which the messages have. Rounding."""
    rng = np.random.default_rng(7)
    messages = ephemerides(rng, "C", 14)
    sats = np.unique(messages.kepler.sat)
    precise = own_clocks(messages, EPOCH + np.arange(-1800.0, 1801.0, 300.0), sats)
    share = 1561.098**2 / (1561.098**2 - 1268.52**2)
    delay = 1e9 * messages.kepler.group_delay[:, 0]
    bias = {"2I": (1.0 - share) * delay, "6I": -share * delay}
    seen = observe(messages, np.array([0.0, 60.0]), lambda _: HOME, lambda _: 2e-4, bands=(PLACE[signal],))
    options = {"ionosphere": "none", "troposphere": "none", "elevation_mask": 0.0, "signals": {"C": (signal,)}}
    expected = prepare_ranges(seen, precise, **options)  # by the messages' TGD1
    tides = expected.pseudorange - prepare_ranges(seen, messages, **options).pseudorange
    assert np.abs(tides[expected.used]).max() < 0.3
    names = [satellite_name(x) for x in sats.tolist()]
    absolute = [line(n, f"C{k}", bias[k][i]) for i, n in enumerate(names) for k in bias]
    relative = [line(n, "C2I", delay[i], "DSB", against="C6I") for i, n in enumerate(names)]
    for rows in (absolute, relative):
        (tmp_path / "own.bia").write_text(bias_text(rows))
        got = prepare_ranges(seen, precise.merged_with(schuler.read(tmp_path / "own.bia").ephemerides), **options)
        assert got.used.sum() > 8
        np.testing.assert_allclose(got.pseudorange[got.used], expected.pseudorange[expected.used], atol=1e-4)


def test_a_month_of_code(tmp_path):
    (tmp_path / "a.dcb").write_text(code_text("P1-C1", [("G01", -0.811), ("R02", 0.1)], "YEAR-MONTH: 20-12"))
    table = read_code_differences(tmp_path / "a.dcb")
    assert (table.signal, table.against) == (("1W", "1P"), ("1C", "1C"))
    np.testing.assert_allclose(table.bias, [-0.811e-9, 0.1e-9])
    assert (table.end - table.begin).tolist() == [31 * 86_400.0] * 2
    t = table.begin[0] + 86_400.0 * np.array([-0.5, 0.5, 31.5])
    got = relative_biases_at(table, np.ones(3, dtype=int), np.full(3, "1C"), t)
    np.testing.assert_allclose(1e9 * got.to_band[:, 1], [np.nan, 0.811, np.nan])
    assert np.isnan(got.to_clock).all()
    (tmp_path / "b.dcb").write_text(code_text("P1-C1", [("G01", 2.0)], "YEAR 2021, MONTH 02"))
    two = table.merged_with(read_code_differences(tmp_path / "b.dcb"))  # nothing in January
    got = relative_biases_at(
        two, np.ones(3, dtype=int), np.full(3, "1C"), table.begin[0] + 86_400.0 * np.array([9, 45, 70])
    )
    np.testing.assert_allclose(1e9 * got.to_band[:, 1], [0.811, np.nan, -2.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (code_text("P2-C2", [("G01", 1.0)]), "P1-C1 or P1-P2"),
        (code_text("P1-C1", [("G01", 1.0)], "ENDING DAY 019, 2021"), "monthly"),
        (code_text("P1-C1", [("G01", 1.0)], "YEAR 2021, MONTH 13"), "from 01 to 12"),
        (code_text("P1-C1", [("E01", 1.0)]), "GPS or GLONASS"),
        (code_text("P1-C1", [("G01", 4e3)]), "difference in ns"),
        (code_text("P1-C1", []), "got none"),
    ],
    ids=["pair", "thirty days", "month", "system", "size", "empty"],
)
def test_other_differences_of_code_are_refused(tmp_path, text, message):
    (tmp_path / "a.dcb").write_text(text)
    with pytest.raises(FileFormatError, match=message):
        schuler.read(tmp_path / "a.dcb")
