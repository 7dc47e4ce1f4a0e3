"""SP3 and RINEX clock files: round trips of written files, other time systems, damage, and the real one of CODE."""

import gzip

import numpy as np
import pytest
from precise_files import clk_text, clock_of, sp3_text

import schuler
from schuler.exceptions import FileFormatError
from schuler.gnss import nominal_orbits
from schuler.gnss.signals import satellite
from schuler.recording.formats.rinex_clock import read_rinex_clock
from schuler.recording.formats.sp3 import read_sp3

START = 1_303_603_200.0  # 2021-04-28 00:00 GPS
T = START + np.arange(0.0, 10_801.0, 900.0)
ORBITS = nominal_orbits("GE", epoch_gps_s=START)
ORDER = np.argsort(ORBITS.sat)


@pytest.fixture
def saved(tmp_path):
    def save(text, name="orbits.sp3"):
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return tmp_path / name

    return save


TEXT = sp3_text(ORBITS, T)


def test_round_trip(saved):
    p = read_sp3(saved(TEXT))
    np.testing.assert_array_equal(p.t, T)
    np.testing.assert_array_equal(p.sat, ORBITS.sat[ORDER])
    np.testing.assert_allclose(p.r_e, ORBITS.states(T)[0][:, ORDER], atol=6e-4)  # printed digits, and 1 mm of time
    truth = np.stack([clock_of(int(s), T - START) for s in p.sat], axis=1)
    np.testing.assert_allclose(p.clock, truth, atol=6e-13)  # printed digits
    assert np.all(p.accuracy == 0.032)
    assert p.notes == ()
    packed = read_sp3(saved(gzip.compress(TEXT.encode()), "orbits.sp3.gz"))
    np.testing.assert_array_equal(packed.r_e, p.r_e)


@pytest.mark.parametrize(("scale", "shift"), [("BDT", -14.0), ("UTC", -18.0), ("TAI", 19.0), ("GAL", 0.0)])
def test_other_time_systems(saved, scale, shift):
    np.testing.assert_array_equal(read_sp3(saved(sp3_text(ORBITS, T, scale=scale, shift=shift))).t, T)


def test_missing_values_and_events(saved):
    lines = TEXT.splitlines()
    k = next(i for i, line in enumerate(lines) if line.startswith("PG01"))
    lines[k] = "PG01" + f"{0.0:14.6f}" * 3 + f"{999999.999999:14.6f}"
    lines.insert(k + 1, "EP   55   55   55     222  1234567 -1234567")
    p = read_sp3(saved("\n".join(lines) + "\n"))
    assert np.isnan(p.r_e[0, 0]).all()
    assert np.isnan(p.clock[0, 0])
    assert np.isfinite(p.r_e[1:]).all()


def test_a_file_that_is_cut_is_read_up_to_there(saved):
    cut = TEXT[: TEXT.index("*", len(TEXT) // 2) + 500]
    p = read_sp3(saved(cut))
    assert 0 < len(p.t) < len(T)
    assert f"cut: {len(p.t)} epochs of {len(T)}" in p.notes[0]
    assert any("cut" in note for note in schuler.read(saved(cut)).metadata.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (sp3_text(ORBITS, T, km=1e-6), "in kilometres"),
        (TEXT.replace("PG01 ", "PG01x", 1), "expected a number"),
        (TEXT.replace("PG01", "PG0q", 1), "expected a satellite"),
        (TEXT.replace("cc GPS", "cc XYZ"), "time system: expected one of"),
        (TEXT.replace("  2021  4 28  0 15", "  2021  4 27  0 15"), "in order of time"),
        (TEXT.replace("  2021  4 28  0 15", "  2021  4 28  0 75"), "impossible date"),
        (TEXT.replace("*  2021  4 28  0 15", "*  2021  4 28"), "expected a date"),
        (TEXT[: TEXT.index("*")], "no satellite"),
        ("t,x,y,z\n1,2,3,4\n" * 9, "expected an SP3 file"),
    ],
    ids=["unit", "number", "satellite", "scale", "order", "date", "short date", "header alone", "table"],
)
def test_damage_is_refused_with_the_reason(saved, text, message):
    with pytest.raises(FileFormatError, match=message):
        read_sp3(saved(text))


@pytest.mark.parametrize("version", ["3.00", "3.04"])
def test_clocks(saved, version):
    t = START + np.arange(0.0, 301.0, 30.0)
    text = clk_text(ORBITS.sat, t, START, version)
    c = read_rinex_clock(saved(text, "clocks.clk"))
    np.testing.assert_array_equal(c.t, t)
    truth = np.stack([clock_of(int(s), t - START) for s in c.sat], axis=1)
    np.testing.assert_allclose(c.clock, truth, rtol=1e-12)  # printed digits
    cut = read_rinex_clock(saved(text[:-30], "clocks.clk"))
    assert np.isnan(cut.clock[-1]).sum() == 1
    assert "left out" in cut.notes[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("E-05 ", "E+05 "), "clock in seconds"),
        (("AS G01", "AS G0q"), "expected AS, satellite"),
        (("END OF HEADER", ""), "the file is cut"),
        (("AS ", "AR "), "no satellite"),
        (("C   ", "N   "), "expected a RINEX clock file"),
    ],
)
def test_damaged_clocks_are_refused(saved, change, message):
    text = clk_text(ORBITS.sat, T[:2], START)
    with pytest.raises(FileFormatError, match=message):
        read_rinex_clock(saved(text.replace(*change), "clocks.clk"))


def test_read_finds_out_and_ephemerides_take_both(saved):
    orbits, clocks = schuler.read(saved(TEXT)), schuler.read(saved(clk_text(ORBITS.sat, T, START), "clocks.clk"))
    assert "precise    orbits of" in orbits.summary()
    both = orbits.ephemerides.merged_with(clocks.ephemerides)
    assert both.precise_orbits is not None
    assert both.precise_clocks is not None


@pytest.mark.realdata
def test_codes_orbits(shared_data):
    r = schuler.read(shared_data / "gnss_nav_files" / "COD0MGXFIN_20211180000_01D_05M_ORB.SP3")
    p = r.ephemerides.precise_orbits
    assert (len(p.t), len(p.sat)) == (73, 116)
    k = int(np.flatnonzero(p.sat == satellite("G01"))[0])
    np.testing.assert_allclose(p.r_e[0, k], [13287682.546, -15491926.575, 16545690.647])
    assert p.clock[0, k] == pytest.approx(703.96346e-6)
    assert any("73 epochs of 289" in note for note in r.metadata.notes)
