"""Phase centres: files read back, closed forms of offsets and variations, satellites' axes, baselines."""

import numpy as np
import pytest
from antex_text import antex_text
from receiver_pairs import HOME_LLH, pair

import schuler
from schuler.exceptions import FileFormatError, InputError
from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.gnss import prepare_ranges, solve_baseline
from schuler.gnss.antennas import (
    antenna_of,
    antenna_pair,
    phase_correction,
    phase_delays,
    receiver_antenna,
    satellite_offsets,
)
from schuler.gnss.differences import single_differences
from schuler.gnss.sun_and_moon import sun_direction
from schuler.recording.formats.antex import read_antex
from schuler.units import DEG

TILTED = {"G01": ((1.0, -2.0, 80.0), lambda z, a: 0.1 * z + 0.02 * a), "G02": ((0.0, 0.0, 100.0), lambda z, a: 0.0)}
FLAT = {"G01": ((0.0, 0.0, 50.0), lambda z, a: 0.1 * z)}
GPS = {"G01": ((400.0, 10.0, 1500.0), lambda z, a: 0.0), "G02": ((400.0, 10.0, 1500.0), lambda z, a: 0.0)}
TEXT = antex_text(
    [("TILTED         NONE", "", 5.0, TILTED), ("FLAT           DOME", "", 0.0, FLAT), ("BLOCK IIF", "G01", 0.0, GPS)]
)


@pytest.fixture(scope="module")
def antennas(tmp_path_factory):
    path = tmp_path_factory.mktemp("antex") / "own.atx"
    path.write_text(TEXT)
    return read_antex(path)


def test_what_is_read(antennas):
    tilted, flat, satellite = antennas
    assert [a.sat for a in antennas] == [0, 0, 1]
    np.testing.assert_allclose(tilted.offset["G01"], [0.001, -0.002, 0.08])
    assert (tilted.variation["G01"].shape, flat.variation["G01"].shape) == ((73, 19), (19,))
    assert satellite.begin == 1_261_872_000.0  # 2020-01-01
    assert receiver_antenna(antennas, "tilted") is tilted
    assert receiver_antenna(antennas, "FLAT  DOME") is flat
    with pytest.raises(InputError, match=r"expected one of the 2 receivers' antennas .* FLAT DOME"):
        receiver_antenna(antennas, "FLAT RADM")


def test_read_finds_out(antennas, tmp_path):
    (tmp_path / "own.atx").write_text(TEXT)
    assert [a.name for a in schuler.read(tmp_path / "own.atx").ephemerides.antennas] == [a.name for a in antennas]


def test_corrections_are_those_of_the_formulas(antennas):
    elevation, azimuth = np.array([90.0, 0.0, 33.3, 47.0]) * DEG, np.array([0.0, 90.0, 200.2, -1.0]) * DEG
    got, own = phase_correction(antennas[0], "G", "1", elevation, azimuth)
    u = np.stack((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)), axis=-1)
    expected = 0.1 * (90.0 - elevation / DEG) + 0.02 * np.mod(azimuth / DEG, 360.0) - u @ [1.0, -2.0, 80.0]
    assert own
    np.testing.assert_allclose(got, 1e-3 * expected, atol=1e-5)  # printed digits: 0.01 mm
    other, own = phase_correction(antennas[0], "E", "5", elevation, azimuth)
    assert not own
    np.testing.assert_allclose(other, -0.1 * np.sin(elevation), atol=1e-12)
    with pytest.raises(InputError, match="neither E05 nor G02"):
        phase_correction(antennas[1], "E", "5", elevation, azimuth)


def test_satellites_look_at_the_earth(antennas):
    r = np.array([[26.5e6, 0.0, 0.0], [26.5e6, 0.0, 0.0]])
    t = np.full(2, 1_303_603_200.0)
    d = satellite_offsets(antennas, np.array([1, 2]), t, r)
    assert np.linalg.norm(d[0]) == pytest.approx(np.linalg.norm([0.4, 0.01, 1.5]))
    assert d[0, 0] == pytest.approx(-1.5)
    sun = sun_direction(t[:1])[0]
    across = sun - sun[0] * np.array([1.0, 0.0, 0.0])
    assert d[0] @ across / np.linalg.norm(across) == pytest.approx(0.4)  # x is on the side of the Sun
    assert not d[1].any()
    assert not satellite_offsets(antennas, np.array([1]), np.array([antennas[2].begin - 1.0]), r[:1]).any()


def test_a_baseline_is_that_of_the_reference_points(antennas):
    p = pair(np.random.default_rng(4), lambda _: (40.0, 30.0, -2.0), np.arange(2.0), systems="G", bands=("1C", "2W"))
    options = {
        "systems": "G",
        "elevation_mask": 15.0 * DEG,
        "cn0_mask": 30.0,
        "sigma_code": 0.3,
        "sigma_carrier": 0.003,
    }
    plain = single_differences(p.rover, p.base, p.ephemerides, HOME_LLH, static=False, **options)
    both = single_differences(
        p.rover, p.base, p.ephemerides, HOME_LLH, static=False, antennas=(antennas[0], None), **options
    )
    second = np.array([band == "2" for band in plain.band])
    np.testing.assert_allclose(  # a metre higher is as much as sin(elevation) less
        (both.carrier - plain.carrier)[:, second], 0.1 * np.sin(plain.elevation[:, second]), atol=1e-9
    )
    s = solve_baseline(p.rover, p.base, p.ephemerides, HOME_LLH, systems="G", antennas=(antennas[0], antennas[0]))
    np.testing.assert_allclose(s.baseline_n, p.baseline_n, atol=3e-4)  # two of one kind, 50 m apart


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TEXT[: len(TEXT) // 2], "cut within this antenna"),
        (TEXT.replace("     80.00", "  80000.00"), "in millimetres"),
        (TEXT.replace("     80.00", "     8x.00"), "expected 3 numbers"),
        (TEXT.replace("     0.0  90.0   5.0", "     0.0  90.0   1.0"), "expected 91 numbers"),
        (TEXT.replace("  2020     1", "  2020    13"), "impossible date"),
        (TEXT[: TEXT.index("END OF HEADER") + 14], "no antenna"),
        ("x\n", "expected an ANTEX file"),
    ],
    ids=["cut", "unit", "number", "grid", "date", "header", "other"],
)
def test_damage_is_refused_with_the_reason(tmp_path, text, message):
    path = tmp_path / "own.atx"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=message):
        read_antex(path)


def test_antennas_are_those_that_logs_state_unless_told(antennas):
    notes = []
    assert antenna_of(antennas, "tilted", None, "rover", notes) is antennas[0]
    assert antenna_of(antennas, "tilted", "none", "rover", notes) is None
    assert antenna_of((), "tilted", None, "rover", notes) is None
    assert not notes
    assert antenna_of(antennas, "TILTED NONE", "FLAT DOME", "rover", notes) is antennas[1]
    assert antenna_of(antennas, "LEIAR25", None, "base", notes) is None
    assert "antenna FLAT DOME is used, although its log states TILTED NONE" in notes[0]
    assert "base: antenna LEIAR25 of its log is not in the ANTEX file" in notes[1]
    with pytest.raises(InputError, match="none like it"):
        antenna_of(antennas, "", "XXXXXXXX", "rover", notes)


def test_one_end_alone_is_not_corrected_unasked(antennas):
    notes = []
    assert antenna_pair(antennas, ("TILTED", "FLAT DOME"), (None, None), notes) == antennas[:2]
    assert not notes
    assert antenna_pair(antennas, ("TILTED", ""), (None, None), notes) == (None, None)
    assert "taken out of neither receiver" in notes[0]
    assert antenna_pair(antennas, ("TILTED", ""), ("FLAT DOME", None), notes) == (antennas[1], None)
    assert "base's phase centre is not taken out" in notes[-1]
    notes.clear()
    assert antenna_pair((), ("TILTED NONE", "TILTED"), (None, None), notes) == (None, None)
    assert not notes  # no radome is NONE
    antenna_pair((), ("TILTED", "FLAT DOME"), (None, None), notes)
    assert "antennas differ, TILTED and FLAT DOME" in notes[0]


@pytest.mark.parametrize("ionosphere", ["none", "free"])
def test_points_are_those_of_the_reference_point(antennas, ionosphere):
    """Ranges lengthened by the antenna's formula, and taken back; 1 mm: the coarse place is some metres off."""
    p = pair(np.random.default_rng(4), lambda _: (0.0, 0.0, 0.0), np.arange(2.0), systems="G", bands=("1C", "2W"))
    options = {"ionosphere": ionosphere, "troposphere": "none", "systems": "G", "elevation_mask": 0.0}
    plain = prepare_ranges(p.base, p.ephemerides, **options)
    behind = prepare_ranges(p.base, p.ephemerides, antenna=antennas[0], **options)
    first, second = (phase_correction(antennas[0], "G", band, plain.elevation, plain.azimuth)[0] for band in ("1", "2"))
    a, b = 1575.42**2, 1227.60**2
    expected = first if ionosphere == "none" else (a * first - b * second) / (a - b)
    np.testing.assert_allclose(plain.pseudorange - behind.pseudorange, expected, atol=1e-8)  # rounding of 2e7 m
    np.testing.assert_allclose(plain.carrier_range - behind.carrier_range, first, atol=1e-8)


def test_glonass_has_its_own_frequencies_or_those_next_to_them(antennas):
    notes = []
    sat, band, up = np.array([101, 101]), np.array([1, 2]), np.full(2, 0.5 * np.pi)
    got = phase_delays(antennas[0], sat, band, up, np.zeros(2), notes)
    np.testing.assert_allclose(got, [-0.08, -0.1], atol=1e-12)
    assert notes == ["antenna TILTED         NONE: GPS L1 or L2 stands in for R01, R02"]


def test_a_baseline_from_mark_to_mark():
    """Antennas over marks at both ends: the marks' baseline is that of the antennas less what is above them."""
    p = pair(np.random.default_rng(4), lambda _: (40.0, 30.0, -2.0), np.arange(2.0), systems="GE", each=14)
    over = np.array([[0.3, -0.2, -1.5], [0.0, 0.1, -2.0]])
    mark_e = ecef_from_llh(HOME_LLH) - C_en(HOME_LLH) @ over[1]
    s = solve_baseline(p.rover, p.base, p.ephemerides, llh_from_ecef(mark_e), systems="GE", eccentricities_n=over)
    np.testing.assert_allclose(s.baseline_n, p.baseline_n - over[0] + over[1], atol=3e-4)  # see test_baseline
    antenna_e = ecef_from_llh(HOME_LLH) + C_en(HOME_LLH) @ p.baseline_n[-1]
    np.testing.assert_allclose(s.r_e[-1], antenna_e - C_en(HOME_LLH) @ over[0], atol=4e-4)
