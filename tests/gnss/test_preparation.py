"""From observations to ranges: a forward model of its own is undone to rounding; reasons, clocks, jumps, atmosphere."""

from dataclasses import replace

import numpy as np
import pytest
from sky import EPOCH, HOME, OMEGA, ephemerides, observe

from schuler.exceptions import InputError
from schuler.frames import C_en, ecef_from_llh, llh_from_ecef
from schuler.gnss.coarse import geometric_ranges
from schuler.gnss.ephemerides import B2B_SOURCE, NEWER_SOURCE
from schuler.gnss.ionosphere import klobuchar
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import REASONS
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.gnss.troposphere import saastamoinen
from schuler.gnss.weighting import Weighting
from schuler.units import DEG

CLEAN = {"ionosphere": "none", "troposphere": "none", "elevation_mask": 0.0, "cn0_mask": 0.0}


def moving(t):
    """Level flight to the north-east at 250 m/s."""
    return HOME + C_en(llh_from_ecef(HOME)) @ np.array([180.0, 180.0, 0.0]) * t


def steady(t):
    return 2.3e-4 + 3e-7 * t


@pytest.fixture(scope="module")
def sky():
    return ephemerides(np.random.default_rng(7), "GERC", 14)


@pytest.fixture(scope="module")
def plain(sky):
    return observe(sky, np.arange(0.0, 60.0, 5.0), moving, steady)


def test_ranges_of_four_systems_are_undone_to_rounding(sky, plain):
    r = prepare_ranges(plain, sky, **CLEAN)
    assert r.groups == ("G", "R", "E", "C")
    assert r.used.all()
    # times are those of reception by GPS time, to the microsecond asked for
    assert np.allclose(np.unique(r.t), np.arange(0.0, 60.0, 5.0), rtol=0.0, atol=1.1e-6)
    true = np.stack([moving(t) for t in r.t])
    expected = geometric_ranges(r.r_sat_e, true) + SPEED_OF_LIGHT * np.array([steady(t) for t in r.t])
    # a microsecond along 250 m/s, Sagnac of second order, BeiDou's and GLONASS's own Earth rate (1 um)
    assert np.max(np.abs(r.pseudorange - expected)) < 1.5e-3


def test_range_rates_are_undone(sky, plain):
    """``u . (v_sat - v) + sagnac rate + drift``; without the term of transmission seconds it would be 3 mm/s off."""
    r = prepare_ranges(plain, sky, **CLEAN)
    true = np.stack([moving(t) for t in r.t])
    v = moving(1.0) - moving(0.0)
    u = r.r_sat_e - true
    u /= np.linalg.norm(u, axis=1)[:, None]
    x, w = r.r_sat_e, r.v_sat_e
    sagnac_rate = (
        OMEGA / SPEED_OF_LIGHT * (w[:, 0] * true[:, 1] + x[:, 0] * v[1] - w[:, 1] * true[:, 0] - x[:, 1] * v[0])
    )
    error = r.range_rate - np.sum(u * (w - v), axis=1) - sagnac_rate - 3e-7 * SPEED_OF_LIGHT
    # finite differences of the simulated times of flight, products of second order
    assert np.max(np.abs(error)) < 4e-4


def test_two_frequencies_without_the_ionosphere(sky):
    def delay(sat, f, elevation, azimuth, t):
        return 8.0 * (1575.42e6 / f) ** 2 / (0.2 + np.sin(elevation))

    o = observe(sky, [0.0, 5.0, 10.0], moving, steady, bands=("1C", "2W", "5Q"), delay_m=delay)
    r = prepare_ranges(o, sky, **{**CLEAN, "ionosphere": "free"})
    true = np.stack([moving(t) for t in r.t])
    expected = geometric_ranges(r.r_sat_e, true) + SPEED_OF_LIGHT * np.array([steady(t) for t in r.t])
    assert np.isfinite(r.pseudorange).all()
    assert np.max(np.abs(r.pseudorange - expected)) < 1.5e-3
    single = prepare_ranges(o, sky, **CLEAN)
    assert np.max(np.abs(single.pseudorange - expected)) > 5.0
    # the noise of the pair: a sigma of noise only, elevation by elevation
    w = Weighting("equal", zenith_troposphere=0.0)
    pair, one = (prepare_ranges(o, sky, **{**CLEAN, "ionosphere": i}, weighting=w) for i in ("free", "none"))
    gps = pair.sat < 100
    noise = np.sqrt(pair.sigma_range[gps] ** 2 - 0.6**2) / np.sqrt(one.sigma_range[gps] ** 2 - 0.6**2)
    assert np.allclose(noise, 2.978, atol=1e-3)  # printed digits


def test_the_atmosphere_is_taken_out_where_it_was_put_in(sky):
    llh = llh_from_ecef(HOME)

    def delay(sat, f, elevation, azimuth, t):
        iono = klobuchar(sky.klobuchar_alpha, sky.klobuchar_beta, llh, elevation, azimuth, EPOCH + t, f)
        return iono + saastamoinen(llh, elevation, EPOCH + t)

    o = observe(sky, [0.0, 100.0], lambda t: HOME, steady, delay_m=delay)
    r = prepare_ranges(o, sky, position_e=HOME, elevation_mask=5.0 * DEG, cn0_mask=0.0)
    expected = geometric_ranges(r.r_sat_e, HOME[None]) + SPEED_OF_LIGHT * np.array([steady(t) for t in r.t])
    assert np.max(np.abs(r.pseudorange - expected)[r.used]) < 2e-3
    # a position found by itself is 30 m too high because of the atmosphere: the troposphere's height dependence
    ranges = prepare_ranges(o, sky, elevation_mask=5.0 * DEG, cn0_mask=0.0)
    assert np.max(np.abs(ranges.pseudorange - r.pseudorange)[r.used]) < 0.1
    assert np.max(np.abs(ranges.elevation - r.elevation)) < 1e-5


def test_without_coefficients_a_stand_in_is_used_and_said(sky, plain):
    without = replace(sky, klobuchar_alpha=None, klobuchar_beta=None)
    r, usual = prepare_ranges(plain, without), prepare_ranges(plain, sky)
    assert any("no Klobuchar coefficients" in note for note in r.notes)
    assert not any("Klobuchar" in note for note in usual.notes)
    assert np.all(r.sigma_range > usual.sigma_range)


def test_beidous_coefficients_serve_on_request_and_where_there_are_no_others(sky, plain):
    own = {"beidou_alpha": (3e-8, 0.0, 0.0, 0.0), "beidou_beta": (1e5, 0.0, 0.0, 0.0)}
    both, alone = replace(sky, **own), replace(sky, klobuchar_alpha=None, klobuchar_beta=None, **own)
    asked, left = prepare_ranges(plain, both, ionosphere="beidou"), prepare_ranges(plain, alone)
    usual = prepare_ranges(plain, both)
    assert np.array_equal(asked.pseudorange, left.pseudorange, equal_nan=True)
    assert np.array_equal(usual.pseudorange, prepare_ranges(plain, sky).pseudorange, equal_nan=True)
    assert np.nanmax(np.abs(asked.pseudorange - usual.pseudorange)) > 0.1
    assert any("those of BeiDou" in note for note in left.notes)
    with pytest.raises(InputError, match="BDSA and BDSB"):
        prepare_ranges(plain, sky, ionosphere="beidou")


def test_galileos_coefficients_serve_on_request(sky, plain):
    """At 1-sigma of half of the delay, as Klobuchar's; where there are no others the note offers them."""
    both = replace(sky, galileo_ai=(180.0, 0.1, 0.01))
    asked, none = (prepare_ranges(plain, both, ionosphere=model) for model in ("galileo", "none"))
    delay = none.pseudorange - asked.pseudorange
    assert np.nanmin(delay) > 1.0
    np.testing.assert_allclose(asked.sigma_range**2 - none.sigma_range**2, (0.5 * delay) ** 2, atol=1e-6)  # rounding
    usual = prepare_ranges(plain, both)
    assert np.nanmax(np.abs(usual.pseudorange - asked.pseudorange)) > 0.1
    np.testing.assert_array_equal(usual.pseudorange, prepare_ranges(plain, sky).pseudorange)
    bare = {"klobuchar_alpha": None, "klobuchar_beta": None}
    assert any(
        'which ionosphere "galileo" takes' in note for note in prepare_ranges(plain, replace(both, **bare)).notes
    )
    assert not any("galileo" in note for note in prepare_ranges(plain, replace(sky, **bare)).notes)
    with pytest.raises(InputError, match=r"RINEX: GAL"):
        prepare_ranges(plain, sky, ionosphere="galileo")


def test_every_reason(sky, plain):
    o, sat = plain, plain.sat
    gps, galileo = sat[sat < 100], sat[sat // 100 == 2]
    away, ill, wild = gps[0], gps[1], gps[2]
    low = prepare_ranges(o, sky, **CLEAN)
    kepler = sky.kepler
    kept = kepler.sat != away
    kepler = type(kepler)(**{k: getattr(kepler, k)[kept] for k in kepler.__dataclass_fields__})
    kepler = replace(kepler, health=np.where(kepler.sat == ill, 63, 0))
    p = np.where(sat == wild, o.pseudorange + 4e5, o.pseudorange)
    mask = float(np.median(low.elevation))
    r = prepare_ranges(
        replace(o, pseudorange=p), replace(sky, kepler=kepler), systems="GEC", elevation_mask=mask, cn0_mask=42.0
    )
    assert set(r.reason[r.sat == away]) == {1}
    assert set(r.reason[r.sat == ill]) == {2}
    assert set(r.reason[r.sat == wild]) == {5}
    assert set(r.reason[r.sat // 100 == 1]) == {7}
    rest = ~np.isin(r.sat, [away, ill, wild]) & (r.sat // 100 != 1)
    assert np.array_equal(r.reason[rest] == 3, r.elevation[rest] < mask)
    assert np.array_equal(r.reason[rest] == 4, (r.cn0[rest] < 42.0) & (r.elevation[rest] >= mask))
    assert set(r.reason) <= set(REASONS)
    assert r.groups == ("G", "E", "C")
    assert np.isin(galileo, r.sat).all()


def test_nonsense_is_implausible(sky, plain):
    p = plain.pseudorange.copy()
    p[::9] = np.resize([0.0, 1e9, -5.0, 9e6], len(p[::9]))
    r = prepare_ranges(replace(plain, pseudorange=p), sky, **CLEAN)
    assert np.count_nonzero(r.reason == 5) == len(p[::9])
    clean = prepare_ranges(plain, sky, **CLEAN)
    assert np.allclose(r.pseudorange[r.used], clean.pseudorange[r.used], rtol=0.0, atol=1e-3)


def test_gps_and_qzss_share_a_clock():
    eph = ephemerides(np.random.default_rng(3), "GJ", 12)
    r = prepare_ranges(observe(eph, [0.0], moving, steady), eph, **CLEAN)
    assert r.groups == ("G",)
    assert set(r.sat // 100) == {0, 4}
    assert set(r.group) == {0}


def test_only_glonass_has_a_clock_of_its_own(sky, plain):
    r = prepare_ranges(plain, sky, systems="R", **CLEAN)
    assert r.groups == ("R",)
    assert set(r.group[r.used]) == {0}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("doppler", [True, False])
@pytest.mark.parametrize("direction", [1, -1])
def test_milliseconds_are_found_and_taken_out(sky, direction, doppler):
    """A clock that drifts 8 us/s and is set back at a millisecond; ranges come out as of one that is not."""
    rate = direction * 8e-6

    def drifting(t):
        return rate * t

    def stepping(t):
        return rate * t - direction * 1e-3 * np.floor(abs(rate) * t / 1e-3 + 1e-9)

    times = np.arange(1.0, 400.0, 10.0)
    smooth, stepped = (observe(sky, times, moving, clock) for clock in (drifting, stepping))
    if not doppler:
        stepped = replace(stepped, range_rate=np.full(len(stepped), np.nan))
    a, b = prepare_ranges(smooth, sky, **CLEAN), prepare_ranges(stepped, sky, **CLEAN)
    assert any("3 times" in note and f"{-direction:+d} ms" in note for note in b.notes)
    assert not any("millisecond" in note for note in a.notes)
    assert np.allclose(a.t, b.t, rtol=0.0, atol=1.1e-6)
    # the same instants, seen by two clocks: the satellites' places differ by the microsecond's rounding
    assert np.max(np.abs(a.pseudorange - b.pseudorange)) < 2e-3


def test_a_clock_set_by_something_else_is_left_and_said(sky):
    o = observe(sky, np.arange(0.0, 50.0, 5.0), moving, lambda t: 4.3e-4 * (t >= 25.0))
    r = prepare_ranges(o, sky, **CLEAN)
    assert any("no whole milliseconds" in note for note in r.notes)
    clock = r.pseudorange - geometric_ranges(r.r_sat_e, np.stack([moving(t) for t in r.t]))
    assert np.allclose(clock, np.where(r.t >= 24.9, 4.3e-4 * SPEED_OF_LIGHT, 0.0), atol=2e-3)


def test_few_satellites_and_positions_given(sky):
    """Three satellites: no position of their own, so that of the header, or of a track; else no atmosphere."""
    o = observe(sky, [0.0, 5.0], moving, lambda t: 0.0)
    few = np.isin(o.sat, np.unique(o.sat)[:3])
    o = o.where(few)
    nothing = prepare_ranges(o, sky)
    assert np.isnan(nothing.elevation).all()
    assert any("no position is known" in note for note in nothing.notes)
    header = prepare_ranges(replace(o, position_e=tuple(HOME)), sky)
    assert any("position in the header" in note for note in header.notes)
    track = prepare_ranges(o, sky, position_e=(np.array([0.0, 5.0]), np.stack((moving(0.0), moving(5.0)))))
    point = prepare_ranges(o, sky, position_e=moving(0.0))
    assert np.allclose(header.elevation, track.elevation, atol=1e-3)
    assert np.allclose(point.elevation[point.t < 2.0], track.elevation[track.t < 2.0], atol=1e-12)
    assert np.all(track.pseudorange < nothing.pseudorange)  # the atmosphere is gone


def test_doppler_alone_is_kept(sky, plain):
    """A satellite whose pseudorange is missing still has its rate; its place is good to the flight time."""
    one = plain.sat[0]
    p = np.where(plain.sat == one, np.nan, plain.pseudorange)
    r, full = prepare_ranges(replace(plain, pseudorange=p), sky, **CLEAN), prepare_ranges(plain, sky, **CLEAN)
    m = r.sat == one
    assert np.isnan(r.pseudorange[m]).all()
    assert r.used[m].all()
    assert np.max(np.linalg.norm(r.r_sat_e[m] - full.r_sat_e[m], axis=1)) < 60.0
    assert np.allclose(r.range_rate[m], full.range_rate[m], atol=0.01)


def test_one_band_a_system(sky):
    """L1 where there is L1; a satellite heard on L2 alone must not bring another delay of the receiver."""
    o = observe(sky, [0.0], moving, steady, bands=("1C", "2W"))
    one = o.sat[o.sat < 100][0]
    gone = (o.sat == one) & (o.signal == o.signals.index("1C"))
    r = prepare_ranges(o.where(~gone), sky, **CLEAN)
    assert np.isnan(r.pseudorange[r.sat == one]).all()
    assert np.isfinite(r.pseudorange[r.sat != one]).all()
    second = prepare_ranges(o.where(~gone), sky, signals={"G": ("2W",)}, **CLEAN)
    assert np.isfinite(second.pseudorange[second.sat == one]).all()


def test_a_band_that_few_satellites_have_is_not_the_one(sky):
    o = observe(sky, [0.0], moving, steady, bands=("1C", "2W"))
    gps = o.sat < 100
    first = np.unique(o.sat[gps])[0]
    r = prepare_ranges(o.where(~(gps & (o.signal == o.signals.index("1C")) & (o.sat != first))), sky, **CLEAN)
    assert "GPS: signals 2W" in r.notes
    assert np.isfinite(r.pseudorange[r.sat < 100]).all()


def test_a_signal_chosen_among_several(sky):
    """Within a band the first preferred one, row by row."""
    o = observe(sky, [0.0], moving, steady)
    names = (*o.signals, "1X")
    gps = o.sat < 100
    two = type(o)(
        np.concatenate((o.t, o.t[gps])), np.concatenate((o.sat, o.sat[gps])),
        np.concatenate((o.signal, np.full(gps.sum(), names.index("1X")))), names,
        np.concatenate((o.pseudorange, o.pseudorange[gps] + 7.0)), np.concatenate((o.range_rate, o.range_rate[gps])),
        np.concatenate((o.carrier, o.carrier[gps])), np.concatenate((o.cn0, o.cn0[gps])), o.epoch_gps_s,
    )  # fmt: skip
    plain = prepare_ranges(two, sky, systems="G", **CLEAN)
    other = prepare_ranges(two, sky, systems="G", signals={"G": ("1X", "1C")}, **CLEAN)
    same = plain.sat < 100
    assert np.allclose(other.pseudorange[same] - plain.pseudorange[same], 7.0, atol=1e-6)


def test_l5_has_the_delay_of_newer_messages(rng):
    """Where both are broadcast, L5 takes CNAV's delay and is the surer for it; L1 stays with LNAV to the last bit."""
    eph = ephemerides(rng, "G")
    k = eph.kepler
    own = np.stack((k.group_delay[:, 0], k.group_delay[:, 0] - 3e-9), axis=1)
    newer = replace(eph, kepler=replace(k, source=np.full(len(k), NEWER_SOURCE), group_delay=own))
    for band, shift in (("1C", 0.0), ("5Q", 3e-9)):
        o = observe(eph, np.arange(3.0), lambda _: HOME, lambda t: 1e-4, bands=(band,))
        old, new = (prepare_ranges(o, e, systems="G") for e in (eph, eph.merged_with(newer)))
        assert np.allclose(new.pseudorange - old.pseudorange, SPEED_OF_LIGHT * shift, rtol=0.0, atol=1e-6)  # rounding
        assert (new.sigma_range[new.used] < old.sigma_range[old.used]).all() == (band == "5Q")


def test_b2b_has_the_delay_of_its_own_message(rng):
    """Where both are broadcast B2b takes B-CNAV3's delay; B1I and B3I stay with D1 to the last bit."""
    eph = ephemerides(rng, "C")
    k = replace(eph.kepler, sat=eph.kepler.sat + 30)
    eph = replace(eph, kepler=k)
    own = np.stack((np.full(len(k), np.nan), np.full(len(k), 7e-9)), axis=1)
    b2b = replace(eph, kepler=replace(k, source=np.full(len(k), B2B_SOURCE), group_delay=own))
    plain = observe(eph, np.arange(3.0), lambda _: HOME, lambda t: 1e-4)
    for band, shift in (("2I", 0.0), ("6I", 0.0), ("7D", -7e-9)):
        o = replace(plain, signals=(band,))
        old, new = (prepare_ranges(o, e, systems="C") for e in (eph, eph.merged_with(b2b)))
        assert np.allclose(new.pseudorange - old.pseudorange, SPEED_OF_LIGHT * shift, rtol=0.0, atol=1e-6)  # rounding
        assert (new.sigma_range[new.used] < old.sigma_range[old.used]).all() == (band == "7D")


def test_a_causal_preparation_has_no_message_from_the_future(sky, plain):
    late = replace(sky, kepler=replace(sky.kepler, sent=np.full(len(sky.kepler), EPOCH + 30.0)))
    r = prepare_ranges(plain, late, systems="GEC", causal=True, **CLEAN)
    first = r.t < 29.0
    assert set(r.reason[first & (r.sat // 100 != 1)]) == {1}
    assert r.used[~first & (r.sat // 100 != 1) & (r.t > 31.0)].all()


def test_no_observation_at_all(sky, plain):
    r = prepare_ranges(plain.where(np.zeros(len(plain), dtype=bool)), sky)
    assert len(r) == 0
    assert r.groups == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ionosphere": "nequick"}, "klobuchar, beidou, galileo, nequick-g, maps, free or none"),
        ({"troposphere": "hopfield"}, "saastamoinen or none"),
        ({"systems": "GX"}, "systems: expected letters"),
        ({"systems": ""}, "systems: expected letters"),
        ({"weighting": "sine"}, "weighting: expected"),
        ({"signals": {"G": ("7C",)}}, "signals of G: expected a band of GPS"),
        ({"signals": {"X": ("1C",)}}, "signals: expected systems"),
        ({"signals": {"G": "1C"}}, "expected a list"),
        ({"position_e": (0.85, 0.16, 300.0)}, "ecef_from_llh"),
        ({"position_e": [1.0, 2.0]}, "position_e"),
        ({"position_e": ([0.0, 0.0], [HOME, HOME])}, "times that increase"),
    ],
)
def test_wrong_options_are_refused(sky, plain, options, message):
    with pytest.raises(InputError, match=message):
        prepare_ranges(plain, sky, **options)


def test_a_track_over_an_ocean_turns_the_elevations(sky):
    """A receiver that moves 2000 km: elevations follow, since the position is found along the way."""
    far = ecef_from_llh([0.95, -0.10, 10e3])

    def jet(t):
        llh = llh_from_ecef(HOME) + (llh_from_ecef(far) - llh_from_ecef(HOME)) * t / 1000.0
        return ecef_from_llh(llh)

    o = observe(sky, np.arange(0.0, 1001.0, 50.0), jet, lambda t: 0.0)
    o = replace(o, position_e=tuple(HOME))  # as a header has it
    r = prepare_ranges(o, sky, **CLEAN)
    last = r.t > 999.0
    given = prepare_ranges(o, sky, position_e=far, **CLEAN)
    assert np.allclose(r.elevation[last], given.elevation[last], atol=1e-4)
    assert np.max(np.abs(given.elevation[r.t < 1.0] - r.elevation[r.t < 1.0])) > 5.0 * DEG


# ------------------------------------------------------------------------------------------ a real receiver


def static_position(r):
    """Weighted least squares of one place with a clock for each epoch and system; residuals after that."""
    m = r.used & np.isfinite(r.pseudorange)
    p, sat, w2 = r.pseudorange[m], r.r_sat_e[m], r.sigma_range[m] ** -2
    _, clock = np.unique(np.searchsorted(np.unique(r.t), r.t[m]) * 10 + r.group[m], return_inverse=True)

    def centred(v):
        return v - (np.bincount(clock, w2 * v) / np.bincount(clock, w2))[clock]

    x = HOME
    for _ in range(5):
        u = (sat - x) / np.linalg.norm(sat - x, axis=1)[:, None]
        A = np.stack([centred(-u[:, i]) for i in range(3)], axis=1) * np.sqrt(w2)[:, None]
        residual = centred(p - geometric_ranges(sat, x[None]))
        x = x + np.linalg.lstsq(A, residual * np.sqrt(w2), rcond=None)[0]
    return x, residual, m


@pytest.mark.realdata
def test_a_receiver_on_a_roof_with_four_systems(shared_data):
    """A minute of GPS, GLONASS, Galileo and BeiDou, against the fix of another receiver some metres away."""
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation
    from schuler.recording.formats.rinex_observation import read_rinex_observation

    folder = shared_data / "instinct_tckf"
    ephemerides = read_rinex_navigation(folder / "reach-m2-01_raw_202306291111.nav")
    o = read_rinex_observation(folder / "reach-m2-01_raw_202306291111.23O")
    place = ecef_from_llh([48.780660 * DEG, 9.171497 * DEG, 329.2])

    def off(r):
        x, residual, m = static_position(r)
        return C_en(llh_from_ecef(place)).T @ (x - place), residual, m

    r = prepare_ranges(o, ephemerides)
    ned, residual, m = off(r)
    assert r.groups == ("G", "R", "E", "C")
    assert np.linalg.norm(ned[:2]) < 3.0  # seen 1.3
    assert abs(ned[2]) < 8.0  # seen 4.3
    # each system by itself: metres, so neither a clock nor a delay is missing
    for k in range(4):
        mine = r.group[m] == k
        means = [np.mean(residual[mine & (r.sat[m] == one)]) for one in np.unique(r.sat[m][mine])]
        assert np.std(means) < (4.0 if r.groups[k] == "R" else 2.5)
    # without the atmosphere's models the height is 15 m higher
    assert -off(prepare_ranges(o, ephemerides, ionosphere="none", troposphere="none"))[0][2] > -ned[2] + 10.0
    # sigmas are of the size of what is left: a minute shows one draw of errors that last longer
    assert 0.2 < np.sqrt(np.mean((residual / r.sigma_range[m]) ** 2)) < 1.5
