"""The Sun, the Moon and the tides they raise: values printed by the IERS, laws, use in ranges."""

import datetime as dt

import numpy as np
import pytest

from schuler.gnss.sun_and_moon import _sidereal, moon_position, solid_tide, sun_direction, sun_position, tide_of
from schuler.units import DEG

# test cases printed with the IERS's routine DEHANTTIDEINEL: date, station, Sun, Moon, displacement [m]; what is called
# Earth-fixed there are places of Sun and Moon against the equinox
PRINTED = [
    (
        (2009, 4, 13), (4075578.385, 931852.890, 4801570.154), (137859926952.015, 54228127881.4350, 23509422341.6960),
        (-179996231.920342, -312468450.131567, -169288918.592160), (0.07700420357, 0.06304056322, 0.05516568153),
    ),
    (
        (2012, 7, 13), (1112189.660, -4842955.026, 3985352.284),
        (-54537460436.2357, 130244288385.279, 56463429031.5996), (300396716.912, 243238281.451, 120548075.939),
        (-0.02036831480, 0.05658254776, -0.07597679677),
    ),
]  # fmt: skip


def gps(*date):
    """GPS time of a date of UTC in this decade. [s]"""
    return (dt.datetime(*date) - dt.datetime(1980, 1, 6)).total_seconds() + 18.0


def test_the_sun():
    """Solstice and equinox of 2021: 23.44 and 0 degrees north; over Greenwich when the equation of time says so."""
    t = np.array([gps(2021, 6, 21, 3, 32), gps(2021, 3, 20, 9, 37), gps(2021, 3, 20, 12, 7, 26)])
    s = sun_direction(t)
    np.testing.assert_allclose(np.linalg.norm(s, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(np.arcsin(s[:2, 2]) / DEG, [23.436, 0.0], atol=0.02)  # the formulas' own 0.01
    assert abs(np.arctan2(s[2, 1], s[2, 0])) / DEG < 0.1


@pytest.mark.parametrize("case", PRINTED)
def test_places_are_the_printed_ones(case):
    """The formulas' own 0.3 degrees of the Moon and 0.05 of the Sun, and precession since 2000 (0.17 degrees)."""
    date, _, sun, moon, _ = case
    t = np.array([gps(*date)])
    c, s = np.cos(_sidereal(t[0])), np.sin(_sidereal(t[0]))
    to_equinox = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for got, expected, angle, length in (
        (sun_position(t)[0], np.array(sun), 0.25, 1e-3),
        (moon_position(t)[0], np.array(moon), 0.6, 4e-3),
    ):
        got = to_equinox @ got
        d, e = np.linalg.norm(got), np.linalg.norm(expected)
        assert np.arccos(got @ expected / d / e) / DEG < angle
        assert d == pytest.approx(e, rel=length)


@pytest.mark.parametrize("case", PRINTED)
def test_tides_are_the_printed_ones(case):
    """Of 0.1 m; what is left out, waves but K1 and parts out of phase, is 5 mm."""
    date, place, sun, moon, expected = case
    got = tide_of(*(np.array([x]) for x in (place, sun, moon)), np.array([gps(*date)]))[0]
    np.testing.assert_allclose(got, expected, atol=5e-3)


def test_tides_at_the_equator_follow_sun_and_moon():
    """Below a body the ground rises by h2 m / M R^4 / d^3, a quarter turn away it sinks by half of that."""
    far = np.array([[1e15, 0.0, 0.0]])
    place = 6_378_136.6 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    moon = np.array([[3.844e8, 0.0, 0.0]])
    d = tide_of(place, far, moon, np.zeros(2))
    height = 0.0123000371 * 6_378_136.6**4 / 3.844e8**3
    h = 0.6078 + 0.0003
    np.testing.assert_allclose([d[0, 0], d[1, 1]], [h * height, -0.5 * h * height], rtol=0.02)
    np.testing.assert_allclose(d[0, 1:], 0.0, atol=1e-12)


def test_a_day_of_tides_has_the_usual_size():
    t = gps(2021, 3, 20) + np.arange(0.0, 86_400.0, 600.0)
    d = solid_tide(np.tile([4.2e6, 0.67e6, 4.74e6], (len(t), 1)), t)
    up = d @ (np.array([4.2, 0.67, 4.74]) / np.linalg.norm([4.2, 0.67, 4.74]))
    assert 0.1 < up.max() - up.min() < 0.5
    assert np.abs(np.diff(up)).max() < 0.02
