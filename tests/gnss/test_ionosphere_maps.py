"""Maps of the ionosphere: files read back, closed forms of delay and pierce point, the Sun, use in ranges."""

from dataclasses import replace

import numpy as np
import pytest
from ionex_text import ionex_text
from receiver_pairs import HOME_LLH, pair
from sky import EPOCH

import schuler
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss import prepare_ranges, solve_points
from schuler.gnss.ionosphere_maps import map_delays
from schuler.recording.formats.ionex import read_ionex
from schuler.units import DEG

T0 = EPOCH - EPOCH % 86_400.0
TIMES = T0 + np.arange(0.0, 90_000.0, 7200.0)
F_L1, UP = 1575.42e6, 0.5 * np.pi
ONE = 40.308e16 / F_L1**2  # delay of one TECU on L1 [m]
GEOCENTRIC = 0.19242 * DEG  # geodetic less geocentric latitude at 45 degrees


def below_the_sun(lat, lon, t):
    """Content that stays below the Sun: of latitude and of longitude less the Sun's, straight between nodes."""
    hour = (lon + (t - T0) / 240.0) % 360.0
    return 20.0 + 0.2 * lat + 0.1 * min(hour, 360.0 - hour)


def read(tmp_path, text, name="igsg.22i"):
    (tmp_path / name).write_text(text)
    return read_ionex(tmp_path / name)


def test_contents_come_back_and_turn_with_the_sun(tmp_path):
    """At nodes the printed digit, 0.05 TECU; between two maps those that both have turned there, which are the same."""
    maps = read(tmp_path, ionex_text(TIMES, below_the_sun, rms=lambda lat, lon, t: 1.0 + 0.01 * lat))
    assert (len(maps.t), len(maps.lat), len(maps.lon), maps.height) == (13, 71, 73, 450e3)
    np.testing.assert_allclose(maps.t, TIMES, atol=1e-6)
    for lon, t in ((15.0, TIMES[3]), (-170.0, TIMES[3] + 2400.0), (90.0, TIMES[7] + 6000.0), (175.0, TIMES[-1])):
        delay, sigma = map_delays(maps, [45.0 * DEG, lon * DEG, 0.0], [UP], [0.0], t)
        lat = 45.0 - GEOCENTRIC / DEG
        assert delay[0] / ONE == pytest.approx(below_the_sun(lat, lon, t), abs=0.06)
        assert sigma[0] / ONE == pytest.approx(1.0 + 0.01 * lat, abs=0.06)


@pytest.mark.parametrize("mapping", ["COSZ", "MSLM"])
def test_delays_are_those_of_the_formulas(tmp_path, mapping):
    """Content that grows with latitude: the pierce point's, over the cosine at the shell and the frequency squared."""
    maps = read(tmp_path, ionex_text(TIMES[:2], lambda lat, lon, t: 40.0 + 0.4 * lat, mapping=mapping))
    elevation = np.array([90.0, 40.0, 40.0, 10.0, -3.0]) * DEG
    azimuth = np.array([0.0, 0.0, 180.0, 90.0, 0.0]) * DEG
    z = UP - np.maximum(elevation, 0.0)
    shell = np.arcsin(6371.0 / 6821.0 * np.sin(z))
    lat_0, angle = 45.0 * DEG - GEOCENTRIC, z - shell
    lat = np.arcsin(np.sin(lat_0) * np.cos(angle) + np.cos(lat_0) * np.sin(angle) * np.cos(azimuth))
    slant = shell if mapping == "COSZ" else np.arcsin(6371.0 / 6877.7 * np.sin(0.9782 * z))
    got, sigma = map_delays(maps, [45.0 * DEG, 8.0 * DEG, 400.0], elevation, azimuth, TIMES[0] + 600.0, 1.2276e9)
    expected = 40.308e16 / 1.2276e9**2 * (40.0 + 0.4 * lat / DEG) / np.cos(slant)
    np.testing.assert_allclose(got, expected, rtol=2e-3)  # printed digits: 0.05 of 30 TECU
    np.testing.assert_allclose(sigma, 40.308e16 / 1.2276e9**2 * 3.0 / np.cos(slant), rtol=1e-12)  # none stated


def test_outside_there_is_nothing(tmp_path):
    holed = ionex_text(TIMES[:4], lambda lat, lon, t: np.nan if lat < 0.0 else 10.0)
    maps = read(tmp_path, holed)
    late = map_delays(maps, [0.5, 0.0, 0.0], [UP, UP], [0.0, 0.0], [TIMES[3] + 1.0, TIMES[0] - 1.0])[0]
    assert np.isnan(late).all()
    assert np.isnan(map_delays(maps, [-0.5, 0.0, 0.0], [UP], [0.0], TIMES[1])[0]).all()
    gap = replace(maps, t=maps.t + np.array([0.0, 0.0, 0.0, 7200.0]))
    assert np.isnan(map_delays(gap, [0.5, 0.0, 0.0], [UP], [0.0], TIMES[2] + 60.0)[0]).all()


def test_days_are_joined_and_open_longitudes_closed(tmp_path):
    first, second = (read(tmp_path, ionex_text(t, below_the_sun)) for t in (TIMES[:7], TIMES[6:]))
    both, whole = first.merged_with(second), read(tmp_path, ionex_text(TIMES, below_the_sun))
    np.testing.assert_array_equal(both.t, whole.t)
    np.testing.assert_array_equal(both.content, whole.content)
    opened = read(tmp_path, ionex_text(TIMES, below_the_sun, lon=(-180.0, 175.0, 5.0)))
    np.testing.assert_array_equal(opened.content, whole.content)
    other = read(tmp_path, ionex_text(TIMES, below_the_sun, mapping="MSLM"))
    with pytest.raises(InputError, match="of different grids or shells"):
        first.merged_with(other)


@pytest.fixture(scope="module")
def delayed():
    """A receiver below 25 TECU everywhere, its ranges as long as the formula says."""
    p = pair(np.random.default_rng(4), lambda _: (0.0, 0.0, 0.0), np.arange(4.0), systems="G", bands=("1C",))
    ranges = prepare_ranges(p.base, p.ephemerides, ionosphere="none", elevation_mask=0.0)
    delay = ONE * 25.0 / np.cos(np.arcsin(6371.0 / 6821.0 * np.cos(ranges.elevation)))
    place = dict(zip(zip(ranges.t.round(1), ranges.sat, strict=True), delay, strict=True))
    longer = np.array([place[key] for key in zip(p.base.t.round(1), p.base.sat, strict=True)])
    return replace(p, base=replace(p.base, pseudorange=p.base.pseudorange + longer))


def test_ranges_by_maps_of_a_file_are_those_without_an_ionosphere(delayed, tmp_path):
    """25 TECU are 4 m overhead; through the file and the reader they leave 1 mm, the digits of the shell's angle."""
    (tmp_path / "igsg.22i").write_text(ionex_text(TIMES, lambda lat, lon, t: 25.0, rms=lambda lat, lon, t: 1.5))
    e = delayed.ephemerides.merged_with(schuler.read(tmp_path / "igsg.22i").ephemerides)
    points = solve_points(prepare_ranges(delayed.base, e, ionosphere="maps"))
    np.testing.assert_allclose(points.llh[:, 2], HOME_LLH[2], atol=0.02)
    plain = solve_points(prepare_ranges(delayed.base, e, ionosphere="none"))
    assert np.all(plain.llh[:, 2] > HOME_LLH[2] + 2.0)
    by_maps, by_model = (prepare_ranges(delayed.base, e, ionosphere=x) for x in ("maps", "klobuchar"))
    high = by_maps.elevation > 60.0 * DEG
    assert np.all(by_maps.sigma_range[high] < by_model.sigma_range[high])


def test_ranges_outside_of_the_maps_say_so(delayed, tmp_path):
    few = read(tmp_path, ionex_text(TIMES, lambda lat, lon, t: 25.0 if lat > 48.0 else np.nan))
    ranges = prepare_ranges(delayed.base, replace(delayed.ephemerides, ionosphere_maps=few), ionosphere="maps")
    assert any("ranges are outside of the ionosphere's maps: Klobuchar's model" in note for note in ranges.notes)
    with pytest.raises(InputError, match="needs an IONEX file among the ephemerides"):
        prepare_ranges(delayed.base, delayed.ephemerides, ionosphere="maps")
    yesterday = replace(few, t=few.t - 3 * 86_400.0)
    with pytest.raises(InputError, match=r"the maps are of .* give the IONEX file of that day"):
        prepare_ranges(delayed.base, replace(delayed.ephemerides, ionosphere_maps=yesterday), ionosphere="maps")


SMALL = ionex_text(TIMES[:2], lambda lat, lon, t: 25.0, lat=(60.0, -60.0, -60.0), lon=(-180.0, 180.0, 90.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x\n", "expected an IONEX file of version 1"),
        (SMALL.replace("     2    ", "     3    ", 1), "maps of one height"),
        (SMALL.replace("  250  250", "  250", 1), "expected 3 latitudes of 5 values"),
        (SMALL.replace("  250", "  25x", 1), "numbers, got"),
        (SMALL.replace("    -1     ", "     2     ", 1), "is EXPONENT right"),
        (SMALL.replace("60.0 -60.0 -60.0", "60.0 -60.0 -50.0"), "in whole steps"),
        (SMALL.replace("EPOCH OF CURRENT MAP", "EPOCH OF ANOTHER MAP"), "expected a latitude before values|EPOCH OF"),
        (SMALL[: SMALL.index("END OF HEADER")], "no END OF HEADER"),
        (SMALL[: SMALL.index("END OF TEC MAP")], "no map of electron content is complete"),
        (SMALL.replace("-180.0 180.0  90.0", "-180.0   0.0  90.0"), "5 values|whole turn|3 values"),
    ],
    ids=["other", "heights", "short", "number", "exponent", "grid", "epoch", "header", "cut", "half"],
)
def test_damage_is_refused_with_the_reason(tmp_path, text, message):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, text)


def test_a_cut_file_gives_the_maps_before(tmp_path):
    whole = ionex_text(TIMES[:3], below_the_sun)
    maps = read(tmp_path, whole[: whole.rindex("START OF TEC MAP") + 4000])
    assert len(maps.t) == 2
    assert "cut within a map" in maps.notes[0]
