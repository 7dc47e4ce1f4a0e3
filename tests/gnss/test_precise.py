"""Precise orbits and clocks: circular orbits are closed forms, broadcast and precise states agree, days are joined."""

from dataclasses import replace

import numpy as np
import pytest
from precise_files import clock_of
from sky import EPOCH as SKY_EPOCH
from sky import HOME, ephemerides, observe

from schuler.exceptions import InputError
from schuler.gnss import nominal_orbits, prepare_ranges, satellite_states, solve_points
from schuler.gnss.antennas import Antenna
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.gnss.precise import POINTS, PreciseClocks, PreciseOrbits, neville, precise_clocks, precise_positions
from schuler.gnss.satellites import group_delays
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.gnss.sun_and_moon import solid_tide

EPOCH = 1_300_000_000.0 - 1_300_000_000.0 % 604_800.0
ORBITS = nominal_orbits("GEC", epoch_gps_s=EPOCH)
ORDER = np.argsort(ORBITS.sat)
SATS = ORBITS.sat[ORDER]


def table(t):
    r, _ = ORBITS.states(t, epoch_gps_s=EPOCH)
    clock = np.stack([clock_of(int(s), t) for s in SATS], axis=1)
    return PreciseOrbits(EPOCH + t, SATS, r[:, ORDER], clock, np.full(len(SATS), 0.02))


DAY = table(np.arange(0.0, 6.0 * 3600.0 + 1.0, 900.0))


def asked(t):
    """Every satellite at every time, with the truth. (n,), (n,), (n, 3), (n, 3)"""
    r, v = ORBITS.states(t, epoch_gps_s=EPOCH)
    r, v = (np.swapaxes(x[:, ORDER], 0, 1).reshape(-1, 3) for x in (r, v))
    return np.repeat(SATS, len(t)), np.tile(t, len(SATS)), r, v


def test_polynomials_are_met_exactly():
    x = np.array([[-2.0, -0.5, 1.0, 2.5]])
    y = (3.0 + 2.0 * x - x**3)[..., None]
    value, slope = neville(x, y)
    np.testing.assert_allclose([value[0, 0], slope[0, 0]], [3.0, 2.0], rtol=1e-14)  # rounding


@pytest.mark.parametrize(("step", "position", "velocity"), [(300.0, 1e-6, 1e-8), (900.0, 5e-6, 5e-8)])
def test_circular_orbits(step, position, velocity):
    """Interpolation error, seen 4e-8 and 6e-7 m in the middle of the file."""
    t = np.arange(0.0, 4.0 * 3600.0 + 1.0, step)
    sat, times, r, v = asked(np.linspace(7000.0, 8300.0, 14))
    r_e, v_e = precise_positions(table(t), sat, times, epoch_gps_s=EPOCH)
    np.testing.assert_allclose(r_e, r, atol=position)
    np.testing.assert_allclose(v_e, v, atol=velocity)


def test_error_falls_with_the_step_as_degree_ten_does():
    sat, times, r, _ = asked(np.array([6.0 * 1800.0 + 700.0]))
    error = []
    for step in (1800.0, 900.0):
        r_e, _ = precise_positions(table(np.arange(0.0, 21_601.0, step)), sat, times, epoch_gps_s=EPOCH)
        error.append(np.abs(r_e - r).max())
    assert 2.0 ** (POINTS - 2) < error[0] / error[1] < 2.0 ** (POINTS + 3)  # discretisation: 2^11, places differ


def test_nothing_outside_and_over_gaps():
    sat, times = np.array([SATS[0]] * 4), np.array([-1.0, 0.0, 21_600.0, 21_601.0])
    r_e, _ = precise_positions(DAY, sat, times, epoch_gps_s=EPOCH)
    assert np.isfinite(r_e[:, 0]).tolist() == [False, True, True, False]
    holes = DAY.r_e.copy()
    holes[11:13, 0] = np.nan
    r_e, _ = precise_positions(
        replace(DAY, r_e=holes), np.array([SATS[0], SATS[1]]), np.full(2, 11_000.0), epoch_gps_s=EPOCH
    )
    assert np.isfinite(r_e[:, 0]).tolist() == [False, True]
    assert np.isnan(precise_positions(DAY, np.array([99]), np.zeros(1), epoch_gps_s=EPOCH)[0]).all()
    short = table(np.arange(POINTS - 1) * 900.0)
    assert np.isnan(precise_positions(short, SATS, np.full(len(SATS), 900.0), epoch_gps_s=EPOCH)[0]).all()


def test_clocks_are_straight_between_epochs_and_denser_ones_count():
    sat, times, _, _ = asked(np.array([450.0, 12_345.0]))
    clock, rate = precise_clocks(DAY, None, sat, times, epoch_gps_s=EPOCH)
    expected = np.array([clock_of(int(s), t) for s, t in zip(sat, times, strict=True)])
    np.testing.assert_allclose(clock, expected, atol=1e-17)  # rounding
    np.testing.assert_allclose(rate, 1e-11 * (sat % 5 - 2.0), atol=1e-18)
    t = np.arange(12_300.0, 12_400.0, 30.0)
    denser = PreciseClocks(EPOCH + t, SATS[:1], (clock_of(int(SATS[0]), t) + 1e-9)[:, None])
    clock, _ = precise_clocks(DAY, denser, SATS[:2], np.full(2, 12_345.0), epoch_gps_s=EPOCH)
    np.testing.assert_allclose(clock[0], clock_of(int(SATS[0]), 12_345.0) + 1e-9, atol=1e-17)
    assert np.isnan(clock[1])


def test_two_days_are_one():
    first, second = table(np.arange(0.0, 10_801.0, 900.0)), table(np.arange(11_700.0, 21_601.0, 900.0))
    both = second.merged_with(first)
    np.testing.assert_array_equal(both.t, DAY.t)
    np.testing.assert_array_equal(both.r_e, DAY.r_e)
    e = Ephemerides(no_kepler(), no_glonass(), precise_orbits=first)
    joined = e.merged_with(Ephemerides(no_kepler(), no_glonass(), precise_orbits=second)).precise_orbits
    np.testing.assert_array_equal(joined.clock, DAY.clock)
    with pytest.raises(InputError, match="increasing"):
        replace(DAY, t=DAY.t[::-1])


def test_states_are_those_of_broadcast_messages():
    """Messages of the same circular orbits without clocks; of precise ones only health and delays are the messages'."""
    quiet = replace(DAY, clock=np.zeros_like(DAY.clock))
    broadcast = ORBITS.ephemerides(EPOCH + 9000.0, EPOCH + 12_000.0)
    sat, times, _, _ = asked(np.array([10_100.0, 10_700.5]))
    a = satellite_states(broadcast, sat, times, epoch_gps_s=EPOCH)
    b = satellite_states(replace(broadcast, precise_orbits=quiet), sat, times, epoch_gps_s=EPOCH)
    np.testing.assert_allclose(b.r_e, a.r_e, atol=2e-5)  # seen 1e-6; BeiDou's Earth turns 1 in 1e7 slower
    np.testing.assert_allclose(b.v_e, a.v_e, atol=1e-6)
    np.testing.assert_allclose(b.clock, a.clock, atol=1e-13)
    np.testing.assert_allclose(b.clock_rate, a.clock_rate, atol=1e-15)
    assert (b.has_message & b.healthy & (b.accuracy == 0.02)).all()
    alone = satellite_states(Ephemerides(no_kepler(), no_glonass(), precise_orbits=DAY), sat, times, epoch_gps_s=EPOCH)
    assert alone.healthy.all()
    sick = replace(broadcast, kepler=replace(broadcast.kepler, health=np.ones(len(broadcast.kepler), dtype=np.int64)))
    assert not satellite_states(replace(sick, precise_orbits=DAY), sat, times, epoch_gps_s=EPOCH).healthy.any()


def test_antennas_are_below_the_centres_of_mass():
    e = Ephemerides(no_kepler(), no_glonass(), precise_orbits=DAY)
    flat = {code: np.array([0.0, 0.0, 1.5]) for code in ("G01", "G02")}
    antenna = Antenna("BLOCK IIF", 1, -np.inf, np.inf, flat, np.zeros(0), np.zeros(0), {})
    sat, t = np.array([1, 2]), np.full(2, 10_000.0)
    a, b = (satellite_states(x, sat, t, epoch_gps_s=EPOCH) for x in (e, replace(e, antennas=(antenna,))))
    np.testing.assert_allclose(np.linalg.norm(a.r_e, axis=1) - np.linalg.norm(b.r_e, axis=1), [1.5, 0.0], atol=1e-6)


def test_group_delays_vanish_in_the_pair_of_the_clock():
    """B1I and B3I without ionosphere see the precise clock itself, whatever the message's delay."""
    broadcast = ORBITS.ephemerides(EPOCH + 9000.0, EPOCH + 12_000.0)
    delay = np.full((len(broadcast.kepler), 2), 7e-9)
    broadcast = replace(broadcast, kepler=replace(broadcast.kepler, group_delay=delay), precise_orbits=DAY)
    sat = SATS[np.unique(SATS // 100, return_index=True)[1]]  # one of each system
    s = satellite_states(broadcast, sat, np.full(len(sat), 10_000.0), epoch_gps_s=EPOCH)
    bands = {0: (1, 2), 2: (1, 5), 3: (2, 6)}
    hertz = {0: (1575.42, 1227.60), 2: (1575.42, 1176.45), 3: (1561.098, 1268.52)}
    for k, one in enumerate(sat.tolist()):
        system = one // 100
        seen = [s.clock[k] - group_delays(s, sat, np.full(len(sat), band))[0][k] for band in bands[system]]
        f1, f2 = np.square(hertz[system])
        free = (f1 * seen[0] - f2 * seen[1]) / (f1 - f2)
        periodic = -2.0 * s.r_e[k] @ s.v_e[k] / SPEED_OF_LIGHT**2
        assert abs(free - periodic - clock_of(one, 10_000.0)) < 1e-16  # rounding


@pytest.mark.realdata
def test_fifteen_minutes_of_five(shared_data):
    """Two of three epochs of CODE's orbits are left out and interpolated."""
    from schuler.recording.formats.sp3 import read_sp3

    p = read_sp3(shared_data / "gnss_nav_files" / "COD0MGXFIN_20211180000_01D_05M_ORB.SP3")
    every = replace(p, t=p.t[::3], r_e=p.r_e[::3], clock=p.clock[::3])
    k = np.array([i for i in range(18, len(p.t) - 18) if i % 3])
    sat, t = np.tile(p.sat, len(k)), np.repeat(p.t[k], len(p.sat))
    off = precise_positions(every, sat, t)[0] - p.r_e[k].reshape(-1, 3)
    assert np.sqrt(np.nanmean(np.sum(off**2, axis=1))) < 0.003  # seen 1.5 mm
    assert np.nanmax(np.abs(off)) < 0.02  # seen 15 mm
    assert np.nanstd(precise_clocks(every, None, sat, t)[0] - p.clock[k].ravel()) < 2e-10  # seen 1.0e-10


def test_ranges_are_those_of_the_messages_the_orbits_were_made_of():
    """Eccentric orbits, drifting clocks, group delays: times of transmission and clocks of every system's pair."""
    messages = ephemerides(np.random.default_rng(2), "GEC")
    t = SKY_EPOCH + np.arange(-1800.0, 1801.0, 300.0)
    sats = np.unique(messages.kepler.sat)
    times, every = np.repeat(t, len(sats)), np.tile(sats, len(t))
    s = satellite_states(messages, every, times)
    first, second = s.group_delay.T
    pair_clock = s.clock - np.select(
        [every // 100 == 2, every // 100 == 3], [second - first, first / (1.0 - (1268.52 / 1561.098) ** 2)], 0.0
    )
    clock = pair_clock + 2.0 * np.sum(s.r_e * s.v_e, axis=1) / SPEED_OF_LIGHT**2
    shape = (len(t), len(sats))
    orbits = PreciseOrbits(t, sats, s.r_e.reshape(*shape, 3), clock.reshape(shape), np.full(len(sats), 0.02))
    seen = observe(messages, np.array([0.0, 100.0]), lambda _: HOME, lambda _: 2e-4, bands=("1C",))
    plain = {"ionosphere": "none", "troposphere": "none"}
    a = prepare_ranges(seen, messages, **plain)
    b = prepare_ranges(seen, replace(messages, precise_orbits=orbits), **plain)
    assert a.used.sum() > 10
    np.testing.assert_array_equal(a.used, b.used)
    np.testing.assert_allclose(b.r_sat_e, a.r_sat_e, atol=1e-3)  # 1 mm of time of the epochs
    place = np.tile(HOME, (len(a), 1))
    tide = solid_tide(place, seen.epoch_gps_s + a.t)  # taken out beside precise orbits only
    u = (a.r_sat_e - HOME) / np.linalg.norm(a.r_sat_e - HOME, axis=1)[:, None]
    assert np.linalg.norm(tide[0]) > 0.02
    np.testing.assert_allclose(b.pseudorange - np.sum(u * tide, axis=1), a.pseudorange, atol=2e-3)
    np.testing.assert_allclose(b.range_rate, a.range_rate, atol=2e-5)
    p, q = (solve_points(x).r_e for x in (a, b))
    np.testing.assert_allclose(p, q + tide[:1], atol=3e-3)
    assert any("precise" in note for note in b.notes)
    clocks_alone = replace(messages, precise_clocks=PreciseClocks(t, sats, clock.reshape(shape)))
    assert any("give the SP3 file" in note for note in prepare_ranges(seen, clocks_alone, **plain).notes)
