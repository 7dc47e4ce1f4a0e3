"""Nominal constellations: circular motion, coverage, the same orbits as broadcast messages."""

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss.constellation import nominal_orbits, walker
from schuler.gnss.dop import dilution
from schuler.gnss.orbits import CONSTANTS
from schuler.gnss.satellites import satellite_states
from schuler.gnss.signals import SYSTEMS, satellite_name
from schuler.units import DEG

EPOCH = 1_400_000_000.0  # a time of our days; doubles resolve 0.24 us there


def test_velocity_is_the_derivative_of_position():
    """Central difference over 1 s: truncation a n^3 / 6 = 1e-5 m/s (printed a n^3 of the lowest orbit)."""
    orbits = nominal_orbits("GERC")
    t = np.array([0.0, 5000.0, 60_000.0])
    r, v = orbits.states(t)
    numerical = 0.5 * (orbits.states(t + 1.0)[0] - orbits.states(t - 1.0)[0])
    assert np.abs(numerical - v).max() < 2e-5
    assert r.shape == v.shape == (3, len(orbits), 3)


def test_times_may_differ_between_satellites():
    orbits = nominal_orbits("G")
    t = np.linspace(0.0, 1000.0, 2 * len(orbits)).reshape(2, -1)
    r, _ = orbits.states(t)
    one, _ = orbits.states(t[:, 5])
    assert np.array_equal(r[:, 5], one[:, 5])


def test_radius_inclination_and_inertial_speed():
    orbits = nominal_orbits("GERC")
    r, v = orbits.states(np.array([1234.0]))
    r, v = r[0], v[0]
    mu, omega = np.array([CONSTANTS[SYSTEMS[s // 100]] for s in orbits.sat]).T
    inertial = v + omega[:, None] * np.stack((-r[:, 1], r[:, 0], 0.0 * r[:, 0]), axis=-1)
    normal = np.cross(r, inertial)
    assert np.linalg.norm(r, axis=1) == pytest.approx(orbits.a, rel=1e-14)
    assert np.linalg.norm(inertial, axis=1) == pytest.approx(np.sqrt(mu / orbits.a), rel=1e-13)  # rounding
    assert normal[:, 2] / np.linalg.norm(normal, axis=1) == pytest.approx(np.cos(orbits.inclination), rel=1e-13)


def test_gps_repeats_its_ground_track_after_a_sidereal_day():
    """Two turns a sidereal day, as nearly as the nominal radius gives it: 26 559.7 km misses by 0.1 degree a day."""
    orbits = nominal_orbits("G")
    r, _ = orbits.states(np.array([0.0, 86_164.1]))
    angle = np.arccos(np.sum(r[0] * r[1], axis=1) / orbits.a**2)
    assert angle.max() < 0.2 * DEG


@pytest.mark.parametrize(("systems", "number"), [("G", 24), ("E", 24), ("R", 24), ("C", 24), ("GERC", 96)])
def test_numbers(systems, number):
    orbits = nominal_orbits(systems)
    assert len(orbits) == number
    assert len(set(orbits.sat)) == number
    assert {satellite_name(s)[0] for s in orbits.sat} == set(systems)


def test_27_gps_satellites_and_no_geostationary_beidou_numbers():
    orbits = nominal_orbits("G", gps_expanded=True)
    assert len(orbits) == 27
    # of the 24, three are gone and six are new, in pairs within 30 degrees of each other
    plain = set(nominal_orbits("G").latitude_argument)
    new = [k for k in range(27) if orbits.latitude_argument[k] not in plain]
    assert len(new) == 6
    gap = np.mod(orbits.latitude_argument[new[::2]] - orbits.latitude_argument[new[1::2]], 2.0 * np.pi)
    assert np.all(gap < 30.0 * DEG)
    assert satellite_name(nominal_orbits("C").sat[0]) == "C19"


def test_a_walker_pattern_is_even():
    orbits = walker("E", 29.6e6, 1.0, 3, 4, 0.1)
    r, _ = orbits.states(np.array([777.0]))
    assert np.abs(r[0].reshape(3, 4, 3).sum(axis=1)).max() < 1e-6  # satellites of a plane balance; rounding
    assert np.diff(orbits.node.reshape(3, 4)[:, 0]) == pytest.approx(2.0 * np.pi / 3.0)


def test_everywhere_and_always_enough_gps_satellites():
    """The design aim of the 24 slots: four satellites above 5 degrees with a usable geometry, practically always."""
    orbits = nominal_orbits("G")
    t = np.arange(0.0, 86_400.0, 1800.0)
    r, _ = orbits.states(t)
    pdop, number = [], []
    for lat in np.arange(-90.0, 91.0, 30.0) * DEG:
        for lon in np.arange(0.0, 360.0, 60.0) * DEG:
            here = np.array([lat, lon, 0.0])
            u = r - frames.ecef_from_llh(here)
            u = (u / np.linalg.norm(u, axis=-1, keepdims=True)) @ frames.C_en(here)
            used = -u[..., 2] > np.sin(5.0 * DEG)
            number.append(used.sum(axis=1))
            pdop.append(dilution(u, used).pdop)
    number, pdop = np.concatenate(number), np.concatenate(pdop)
    assert number.min() >= 4
    assert 7.0 < number.mean() < 9.0
    assert np.mean(pdop < 6.0) > 0.99  # the standard's global availability of PDOP 6 is 98 % (a 24 h average)


@pytest.mark.parametrize("system", ["G", "E", "C"])
def test_kepler_records_are_the_same_orbits(system):
    """Through the package's orbit code, an hour to either side of reference times; rounding of angles times radius."""
    orbits = nominal_orbits(system, epoch_gps_s=EPOCH)
    ephemerides = orbits.ephemerides(EPOCH, EPOCH + 7200.0)
    t = np.linspace(0.0, 7000.0, 9)
    r, v = orbits.states(t, epoch_gps_s=EPOCH)
    for k, when in enumerate(t):
        places = satellite_states(ephemerides, orbits.sat, np.full(len(orbits), when), epoch_gps_s=EPOCH)
        assert places.has_message.all()
        assert places.healthy.all()
        assert np.abs(places.r_e - r[k]).max() < 1e-6
        assert np.abs(places.v_e - v[k]).max() < 1e-9
        assert np.abs(places.clock).max() < 1e-18  # a circular orbit has no periodic relativity


def test_glonass_records_hold_at_their_reference_times():
    orbits = nominal_orbits("R", epoch_gps_s=EPOCH)
    ephemerides = orbits.ephemerides(EPOCH, EPOCH + 3600.0)
    toe = ephemerides.glonass.toe[24] - EPOCH
    r, _ = orbits.states(np.array([toe]), epoch_gps_s=EPOCH)
    places = satellite_states(ephemerides, orbits.sat, np.full(24, toe), epoch_gps_s=EPOCH)
    assert np.abs(places.r_e - r[0]).max() < 1e-6
    # antipodal satellites share a frequency channel, and no others
    channels = ephemerides.glonass.channel[:24]
    assert channels.min() >= -7
    assert channels.max() <= 6
    assert all(np.sum(channels == c) == 2 for c in set(channels))
    same = [np.flatnonzero(channels == c) for c in set(channels)]
    assert all(np.linalg.norm(r[0][a] + r[0][b]) < 1.0 for a, b in same)


def test_errors_say_what_is_possible():
    with pytest.raises(InputError, match="GPS"):
        nominal_orbits("GX")
    with pytest.raises(InputError, match="at least one"):
        nominal_orbits("")
    with pytest.raises(InputError, match="shape"):
        nominal_orbits("G").states(np.zeros((2, 3)))
    with pytest.raises(InputError, match="1 to 99"):
        walker("G", 2.6e7, 1.0, 10, 10, 0.0)
    with pytest.raises(InputError, match="start"):
        nominal_orbits("G").ephemerides(10.0, 0.0)
