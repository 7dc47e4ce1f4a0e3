"""Code biases: files read back, taken out of ranges beside precise clocks only, damage refused."""

from dataclasses import replace

import numpy as np
import pytest
from sky import EPOCH, HOME, ephemerides, observe

import schuler
from schuler.exceptions import FileFormatError
from schuler.gnss import prepare_ranges, satellite_states
from schuler.gnss.code_biases import biases_at
from schuler.gnss.precise import PreciseOrbits
from schuler.gnss.signals import SPEED_OF_LIGHT, satellite_name
from schuler.recording.formats.sinex_bias import read_sinex_bias

OPEN = ("0000:000:00000", "0000:000:00000")


def line(sat, signal, bias, kind="OSB", unit="ns", times=OPEN, station=""):
    text = f" {kind:<4} {'G000':<4} {sat:<3} {station:<9} {signal:<4} {'':<4} {times[0]} {times[1]} {unit:<4}"
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
    others = [line("G01", "L1C", 0.1), line("G01", "C1C", 9.0, station="ZIMM"), line("G01", "C1C", 2.0, kind="DSB")]
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
        (bias_text([line("G01", "C1C", 1.0, kind="DSB")]), r"expected absolute biases .* got DSB"),
        (bias_text([line("G01", "C1C", 1.0, unit="cyc")]), "in ns"),
        (bias_text([line("G01", "C1C", 5000.0)]), "below 1000"),
        (bias_text([line("G0x", "C1C", 1.0)]), "expected a satellite"),
        (bias_text([line("G01", "C1C", 1.0)], "UTC"), "TIME_SYSTEM"),
        (bias_text([line("G01", "C1C", 1.0)]).split("-BIAS/SOL")[0], "cut before"),
    ],
    ids=["other", "differences", "unit", "size", "satellite", "scale", "cut"],
)
def test_damage_is_refused_with_the_reason(tmp_path, text, message):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, text)
