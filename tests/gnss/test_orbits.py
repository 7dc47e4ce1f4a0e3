"""Keplerian orbits: closed forms, laws of the two-body problem, derivatives, and precise orbits of the same day."""

import itertools

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.ephemerides import KeplerRecords
from schuler.gnss.orbits import CONSTANTS, eccentric_anomaly, is_geostationary, kepler_states
from schuler.gnss.satellites import satellite_states
from schuler.gnss.signals import SPEED_OF_LIGHT, satellite
from schuler.timebase import WEEK_S
from schuler.units import DEG

ONE = np.array([0])


def record(sat="G01", **elements):
    """One message with everything zero but what is given; toe at the start of the system's week."""
    values = dict.fromkeys(KeplerRecords.__dataclass_fields__, 0.0)
    values |= {"sat": satellite(sat), "sqrt_a": np.sqrt(26_560e3), "toe": 14.0 if sat[0] == "C" else 0.0}
    values |= {"group_delay": (0.0, 0.0)} | elements
    return KeplerRecords(**{name: np.array([value]) for name, value in values.items()})


def general(sat="G07", **changes):
    """A message with every element different from zero, of realistic size (harmonics ten times too large)."""
    elements = {
        "toe": 2244 * WEEK_S + 36_000.0, "sqrt_a": 5153.6, "e": 0.02, "i0": 0.96, "omega0": -1.5, "omega": 0.7,
        "m0": 2.1, "delta_n": 4.5e-9, "idot": 3e-10, "omega_dot": -8e-9, "cuc": 2e-5, "cus": -1e-5, "crc": 3e3,
        "crs": -2e3, "cic": 1e-6, "cis": -2e-6,
    }  # fmt: skip
    return record(sat, **(elements | changes))


def test_keplers_equation_holds_to_rounding(rng):
    M = rng.uniform(-50.0, 50.0, 20_000)
    e = rng.uniform(0.0, 0.99, M.size)
    E = eccentric_anomaly(M, e)
    # rounding: a few units in the last place of an angle of up to 50 rad
    assert np.max(np.abs(E - e * np.sin(E) - M)) < 4e-14


def test_symmetric_anomalies():
    """At perigee and apogee the anomalies are equal; both signs mirror each other; a circle has only one anomaly."""
    e = np.array([0.0, 0.01, 0.5, 0.999])
    assert np.array_equal(eccentric_anomaly(0.0, e), np.zeros(4))
    assert np.allclose(eccentric_anomaly(np.pi, e), np.pi, rtol=0.0, atol=4e-16)  # rounding
    M = np.linspace(0.0, 3.0, 31)[:, None]
    assert np.array_equal(eccentric_anomaly(-M, e), -eccentric_anomaly(M, e))
    assert np.array_equal(eccentric_anomaly(M[:, 0], 0.0), M[:, 0])


@pytest.mark.parametrize("e", [1.0, -0.1, np.nan])
def test_impossible_eccentricities_are_refused(e):
    with pytest.raises(InputError, match="eccentricity"):
        eccentric_anomaly(0.3, e)


@pytest.mark.parametrize("sat", ["G01", "E01", "J01", "C20"])
def test_a_circular_orbit_in_the_equator(sat):
    """Angle in inertial axes ``sqrt(GM/a^3) t``, seen from the turning Earth."""
    GM, omega_e = CONSTANTS[sat[0]]
    a = 26_560e3
    t = np.linspace(0.0, 7200.0, 25)
    k = record(sat)
    s = kepler_states(k, np.zeros(25, dtype=int), t + k.toe[0])
    angle = (np.sqrt(GM / a**3) - omega_e) * t
    expected = a * np.stack((np.cos(angle), np.sin(angle), 0.0 * t), axis=-1)
    assert np.allclose(s.r_e, expected, rtol=0.0, atol=1e-6)  # rounding of 2.7e7 m
    speed = np.linalg.norm(s.v_e, axis=1)
    assert np.allclose(speed, a * (np.sqrt(GM / a**3) - omega_e), rtol=1e-12)
    assert np.array_equal(s.clock, np.zeros(25))


def test_the_node_is_counted_from_the_start_of_the_systems_own_week():
    """The same elements a quarter of a week later: the Earth has turned on; BeiDou's week starts 14 s later."""
    later = WEEK_S / 4.0
    for sat, omega_e in (("G01", 7.2921151467e-5), ("C20", 7.292115e-5)):
        first = kepler_states(record(sat), ONE, record(sat).toe).r_e[0]
        k = record(sat, toe=record(sat).toe[0] + later + 5.0 * WEEK_S)
        s, c = np.sin(-omega_e * later), np.cos(-omega_e * later)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ first
        assert np.allclose(kepler_states(k, ONE, k.toe).r_e[0], turned, rtol=0.0, atol=1e-6)  # rounding


def test_vis_viva_and_the_constant_angular_momentum():
    """``v^2 = GM (2/r - 1/a)`` and ``|r x v|`` of the undisturbed ellipse in axes that do not turn."""
    GM, omega_e = CONSTANTS["G"]
    k = record(e=0.3, i0=0.9, omega=0.4, omega0=1.0, m0=0.2)
    t = np.linspace(-7200.0, 7200.0, 49)
    s = kepler_states(k, np.zeros(49, dtype=int), t)
    v = s.v_e + np.cross([0.0, 0.0, omega_e], s.r_e)
    r, a = np.linalg.norm(s.r_e, axis=1), k.sqrt_a[0] ** 2
    assert np.allclose(np.sum(v * v, axis=1), GM * (2.0 / r - 1.0 / a), rtol=1e-13)  # rounding
    assert np.allclose(np.linalg.norm(np.cross(s.r_e, v), axis=1), np.sqrt(GM * a * (1.0 - 0.09)), rtol=1e-13)
    # the relativistic term is -2 r . v / c^2, and r . v is the same in turning axes
    assert np.allclose(s.clock, -2.0 * np.sum(s.r_e * s.v_e, axis=1) / SPEED_OF_LIGHT**2, rtol=0.0, atol=1e-20)


def test_rates_of_newer_messages():
    """A circle whose radius grows by ``a_dot t``, on which the angle grows by ``(n + delta_n_dot t / 2) t``."""
    GM, omega_e = CONSTANTS["G"]
    a, a_dot, n_dot = 26_560e3, 5.0, 3e-12
    t = np.linspace(-7200.0, 7200.0, 25)
    s = kepler_states(record(a_dot=a_dot, delta_n_dot=n_dot), np.zeros(25, dtype=int), t)
    angle = (np.sqrt(GM / a**3) - omega_e + 0.5 * n_dot * t) * t
    expected = (a + a_dot * t)[:, None] * np.stack((np.cos(angle), np.sin(angle), 0.0 * t), axis=-1)
    assert np.allclose(s.r_e, expected, rtol=0.0, atol=1e-6)  # rounding of 2.7e7 m


@pytest.mark.parametrize("newer", [{}, {"a_dot": 8.0, "delta_n_dot": 9e-11}], ids=["", "newer"])
@pytest.mark.parametrize("sat", ["G07", "E11", "C20", "C03", "C60", "J02"])
def test_velocity_and_clock_rate_are_derivatives(sat, newer):
    """Every term counts: the harmonics here are ten times nature's, C03 and C60 are in tilted axes."""
    k = general(sat, **newer)
    epoch = k.toe[0]
    h = 0.5
    for t in (-3000.0, 0.0, 1234.5):
        t = np.array([t - 2 * h, t - h, t, t + h, t + 2 * h])
        s = kepler_states(k, np.zeros(5, dtype=int), t, epoch_gps_s=epoch)
        weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
        # discretisation h^4 omega^5 a / 30 = 1e-14 m/s, rounding 3e-8 m/s
        assert np.allclose(weights @ s.r_e, s.v_e[2], rtol=0.0, atol=1e-7)
        assert np.isclose(weights @ s.clock, s.clock_rate[2], rtol=0.0, atol=1e-21 / h * 10.0 + 1e-19)


def test_a_geostationary_satellite_stays_over_its_place():
    """Elements in the tilted axes that describe the equator: inclined by 5 deg, the node opposite to the x axis."""
    GM, omega_e = CONSTANTS["C"]
    a = (GM / omega_e**2) ** (1.0 / 3.0)
    k = record("C03", sqrt_a=np.sqrt(a), i0=5.0 * DEG, omega0=np.pi, m0=1.4)
    t = np.linspace(-3600.0, 3600.0, 13)
    s = kepler_states(k, np.zeros(13, dtype=int), t + 14.0)
    place = -a * np.array([np.cos(1.4), np.sin(1.4), 0.0])
    assert np.allclose(s.r_e, place, rtol=0.0, atol=1e-5)  # rounding of 4.2e7 m, times the week's seconds
    assert np.allclose(s.v_e, 0.0, rtol=0.0, atol=1e-9)


def test_which_satellites_are_geostationary():
    names = ["C01", "C05", "C06", "C58", "C59", "C63", "G01", "E05"]
    assert is_geostationary([satellite(x) for x in names]).tolist() == [
        True,
        True,
        False,
        False,
        True,
        True,
        False,
        False,
    ]


def test_an_epoch_changes_nothing_but_rounding():
    k = general()
    a = kepler_states(k, ONE, k.toe + 1234.25)
    b = kepler_states(k, ONE, np.array([234.25]), epoch_gps_s=k.toe[0] + 1000.0)
    assert np.allclose(a.r_e, b.r_e, rtol=0.0, atol=1e-6)


def test_a_damaged_message_is_refused():
    with pytest.raises(InputError, match="semi-major axis"):
        kepler_states(record(sqrt_a=0.0), ONE, np.zeros(1))


@pytest.mark.realdata
def test_broadcast_orbits_against_precise_ones(shared_data):
    """Six hours of all GPS satellites. What remains is the broadcast's own error and the antenna's offset.

    Precise orbits are of the centre of mass, broadcast ones of the antenna, about 1 to 2.5 m nearer to the Earth.
    """
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation
    from schuler.recording.formats.sp3 import read_sp3

    folder = shared_data / "gnss_nav_files"
    ephemerides = read_rinex_navigation(folder / "brdc1180.21n")
    p = read_sp3(folder / "COD0MGXFIN_20211180000_01D_05M_ORB.SP3")
    t, sat = np.repeat(p.t, np.sum(p.sat < 100)), np.tile(p.sat[p.sat < 100], len(p.t))
    r_e, clock = p.r_e[:, p.sat < 100].reshape(-1, 3), p.clock[:, p.sat < 100].ravel()
    s = satellite_states(ephemerides, sat, t)
    ok = s.has_message & s.healthy
    assert np.mean(ok) > 0.99
    d = (s.r_e - r_e)[ok]
    up = s.r_e[ok] / np.linalg.norm(s.r_e[ok], axis=1)[:, None]
    radial = np.sum(d * up, axis=1)
    assert -1.5 < np.mean(radial) < -0.8  # the antenna; seen -1.16
    assert np.std(radial) < 0.5  # seen 0.34
    assert np.sqrt(np.mean(np.sum(d**2, axis=1))) < 2.0  # seen 1.72
    # precise clocks are without the periodic relativistic term
    relativity = -2.0 * np.sum(s.r_e * s.v_e, axis=1) / SPEED_OF_LIGHT**2
    off = np.where(ok, s.clock - relativity - clock, np.nan)
    off = np.concatenate([off[t == one] - np.nanmedian(off[t == one]) for one in np.unique(t)[:-1]])
    assert np.nanstd(off) < 2.5e-9  # seen 1.7e-9
    assert np.nanmax(np.abs(off)) < 10e-9
    # without relativity in ours the scatter would be ten times that
    assert np.nanstd(relativity) > 15e-9


@pytest.mark.realdata
def test_neighbouring_messages_agree_between_their_times(shared_data):
    """GPS, Galileo, QZSS and BeiDou inclined and geostationary: two fits to one orbit, a metre apart at most."""
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation

    k = read_rinex_navigation(shared_data / "gnss_nav_files" / "BRDC00WRD_S_20230730000_01D_MN.rnx").kepler
    seen = set()
    for one in np.unique(k.sat):
        rows = np.flatnonzero(k.sat == one)
        rows = rows[np.argsort(k.toe[rows], kind="stable")]
        for a, b in itertools.pairwise(rows):
            middle = 0.5 * (k.toe[a] + k.toe[b])
            s = kepler_states(k, np.array([a, b]), np.array([middle, middle]))
            assert np.linalg.norm(s.r_e[0] - s.r_e[1]) < 1.0  # seen 0.73 (GPS), 0.60 (C05), 0.24 (Galileo)
            assert np.linalg.norm(s.v_e[0] - s.v_e[1]) < 1e-3
            seen.add("GRECJIS"[one // 100] + ("geo" if is_geostationary(one) else ""))
    assert seen == {"G", "E", "C", "Cgeo", "J"}
