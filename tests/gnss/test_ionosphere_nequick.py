"""NeQuick-G: what the library is asked and what becomes of it, with a stand-in; published values where it is there."""

from __future__ import annotations

import datetime as dt
import sys
from dataclasses import replace
from importlib.machinery import ModuleSpec
from types import ModuleType

import numpy as np
import pytest
from sky import HOME, ephemerides, observe

from schuler.exceptions import InputError
from schuler.frames import ecef_from_llh, ecef_from_ned, ned_from_ecef
from schuler.gnss.ionosphere import F_B1I, F_L1
from schuler.gnss.ionosphere_galileo import ntcm_g
from schuler.gnss.ionosphere_nequick import nequick_g
from schuler.gnss.preparation import prepare_ranges
from schuler.timebase import gps_from_calendar
from schuler.units import DEG

TECU = 40.3e16 / F_L1**2  # delay on L1 [m]
HIGH = (236.831641, -0.39362878, 0.00402826613)
MEDIUM = (121.129893, 0.351254133, 0.0134635348)
LOW = (2.580271, 0.127628236, 0.0252748384)

# Annex of the algorithm's description, April: coefficients, hour UT, receiver's longitude, latitude [deg], height [m],
# satellite's, slant content [TECU]
PUBLISHED = [
    (HIGH, 0, -62.34, 82.49, 78.11, -158.03, 24.05, 20275295.43, 53.44495),
    (HIGH, 4, -62.34, 82.49, 78.11, 140.68, 35.85, 19953735.00, 37.81277),
    (HIGH, 12, -62.34, 82.49, 78.11, 81.09, 35.20, 20278071.03, 49.30952),
    (HIGH, 16, -62.34, 82.49, 78.11, -70.26, 50.63, 20043030.82, 23.92627),
    (HIGH, 20, -62.34, 82.49, 78.11, 168.73, 52.58, 20288372.95, 27.78811),
    (HIGH, 4, -52.81, 5.25, -25.76, -46.61, 54.84, 20258938.89, 124.38948),
    (HIGH, 8, -52.81, 5.25, -25.76, -48.38, -31.04, 20069586.93, 21.34027),
    (HIGH, 12, -52.81, 5.25, -25.76, -120.35, 11.00, 20283503.35, 146.93414),
    (HIGH, 20, -52.81, 5.25, -25.76, -1.57, -7.90, 20373709.74, 255.31401),
    (MEDIUM, 0, 40.19, -3.00, -23.32, -13.11, -4.67, 20194168.22, 35.83117),
    (MEDIUM, 4, 40.19, -3.00, -23.32, 56.35, 47.54, 20322471.38, 38.00238),
    (MEDIUM, 12, 40.19, -3.00, -23.32, 90.78, -28.26, 20081398.25, 127.80724),
    (MEDIUM, 16, 40.19, -3.00, -23.32, 2.04, 11.23, 20394926.95, 96.70317),
    (MEDIUM, 20, 40.19, -3.00, -23.32, -1.81, -52.00, 20332764.38, 50.07894),
    (MEDIUM, 4, 115.89, -31.80, 12.78, 107.19, -10.65, 19943685.24, 46.25104),
    (MEDIUM, 8, 115.89, -31.80, 12.78, 89.22, -40.56, 20055109.56, 40.61743),
    (MEDIUM, 12, 115.89, -31.80, 12.78, 166.97, -3.87, 20196778.56, 27.69214),
    (MEDIUM, 20, 115.89, -31.80, 12.78, 131.65, -31.56, 20066111.12, 4.36083),
    (LOW, 0, 141.13, 39.14, 117.00, 85.59, 36.64, 20015444.79, 14.24276),
    (LOW, 4, 141.13, 39.14, 117.00, -130.77, 54.40, 20121312.41, 23.01810),
    (LOW, 12, 141.13, 39.14, 117.00, 62.65, 54.77, 20370905.24, 16.32883),
    (LOW, 16, 141.13, 39.14, 117.00, -130.60, 49.21, 20288020.98, 6.44768),
    (LOW, 20, 141.13, 39.14, 117.00, -136.92, 46.53, 20309713.36, 10.78212),
    (LOW, 4, -155.46, 19.80, 3754.69, -130.77, 54.40, 20121312.45, 30.77070),
    (LOW, 8, -155.46, 19.80, 3754.69, -125.97, 2.30, 20251559.90, 0.11650),
    (LOW, 12, -155.46, 19.80, 3754.69, -153.30, -39.75, 20672066.87, 2.98620),
    (LOW, 20, -155.46, 19.80, 3754.69, -172.71, -20.37, 20225145.06, 24.52827),
]


def at(hour, day=1):
    """GPS time of an hour UTC of a day in April 2022. [s]"""
    return gps_from_calendar(dt.datetime(2022, 4, day) + dt.timedelta(hours=hour), utc=True)


def place(lon, lat, height):
    return ecef_from_llh(np.array([lat * DEG, lon * DEG, height]))


@pytest.fixture
def rays(monkeypatch):
    """The library's interface, with 20 TECU plus 0.1 a minute after midnight; gives what it was asked."""
    asked = []

    class Model:
        def __init__(self, *ai):
            self.ai = ai

        def compute_stec(self, when, *places):
            asked.append((self.ai, when, places))
            return 20.0 + 0.1 * (when.hour * 60.0 + when.minute + when.second / 60.0)

    module = ModuleType("nequick")
    module.NeQuick, module.__spec__ = Model, ModuleSpec("nequick", None)
    monkeypatch.setitem(sys.modules, "nequick", module)
    return asked


@pytest.mark.usefixtures("rays")
def test_delays_serve_on_request():
    """They are subtracted, half of them is 1-sigma, and they grow with the inverse square of the frequency."""
    sky = replace(ephemerides(np.random.default_rng(7), "GEC", 14), galileo_ai=(180.0, 0.1, 0.01))
    plain = observe(sky, np.arange(0.0, 60.0, 5.0), lambda t: HOME + 0.0 * t, lambda t: 1e-4 + 0.0 * t)
    asked, none = (prepare_ranges(plain, sky, ionosphere=model) for model in ("nequick-g", "none"))
    delay = none.pseudorange - asked.pseudorange
    frequency = np.where(none.sat // 100 == 3, F_B1I, F_L1)
    contents = delay * frequency**2 / 40.3e16
    assert np.isfinite(delay[none.used]).all()
    assert np.nanmin(contents) >= 20.0 - 1e-6
    assert np.nanmax(contents) - np.nanmin(contents) < 0.11  # within a minute, whatever the frequency
    assert len(np.unique(frequency[none.used])) == 2
    np.testing.assert_allclose(asked.sigma_range**2 - none.sigma_range**2, (0.5 * delay) ** 2, atol=1e-6)  # rounding
    with pytest.raises(InputError, match=r'"nequick-g" needs Galileo\'s coefficients .*RINEX: GAL'):
        prepare_ranges(plain, replace(sky, galileo_ai=None), ionosphere="nequick-g")


def test_what_the_library_is_asked(rays):
    """Degrees, longitudes first, UTC; a satellite below the horizon counts as at 1 deg."""
    sat = np.stack([place(45.0, -2.0, 2e7), place(170.0, -2.0, 2e7)])
    nequick_g(HIGH, place(40.0, -3.0, 50.0), sat, np.array([101, 102]), [at(12.0), at(12.0)])
    (ai, when, places), (_, _, low) = rays
    assert ai == HIGH
    assert when == dt.datetime(2022, 4, 1, 12)
    np.testing.assert_allclose(places, [40.0, -3.0, 50.0, 45.0, -2.0, 2e7], atol=1e-6)
    north, east, down = ned_from_ecef(place(*low[3:]), np.array([-3.0 * DEG, 40.0 * DEG, 50.0]))
    assert np.arctan2(-down, np.hypot(north, east)) == pytest.approx(1.0 * DEG, abs=1e-9)
    assert np.arctan2(east, north) == pytest.approx(
        np.arctan2(*ned_from_ecef(sat[1], np.array([-3.0 * DEG, 40.0 * DEG, 50.0]))[[1, 0]]), abs=1e-9
    )


def test_two_rays_a_minute_and_straight_lines_between(rays):
    """Two satellites in turn, one of them away for ten minutes; a row without a satellite's place stays without."""
    seconds = np.repeat(np.arange(0.0, 1200.0), 2)
    sat = np.tile([101, 205], 1200)
    keep = ~((sat == 205) & (seconds > 130.5) & (seconds < 730.5))
    seconds, sat = seconds[keep], sat[keep]
    r_sat = np.where(sat[:, None] == 101, place(45.0, -2.0, 2e7), place(30.0, 12.0, 2e7))
    r_sat[7] = np.nan
    delay = nequick_g(HIGH, place(40.0, -3.0, 50.0), r_sat, sat, at(3.0) + seconds, F_L1 / 2.0)
    expected = 4.0 * TECU * (20.0 + 0.1 * (180.0 + seconds / 60.0))
    np.testing.assert_allclose(np.delete(delay, 7), np.delete(expected, 7), rtol=1e-12)
    assert np.isnan(delay[7])
    assert len(rays) <= 2 * (21 + 12)


def test_without_the_library_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "nequick", None)
    sky = ephemerides(np.random.default_rng(7), "GE", 14)
    plain = observe(sky, np.arange(0.0, 10.0, 5.0), lambda t: HOME + 0.0 * t, lambda t: 1e-4 + 0.0 * t)
    with pytest.raises(InputError, match=r"pip install --no-deps nequick.*\"galileo\""):
        prepare_ranges(plain, sky, ionosphere="nequick-g")


@pytest.mark.parametrize("case", PUBLISHED)
def test_published_contents(case):
    """Within 0.01 TECU, as near as the library's adaptive integration comes to the printed digits."""
    pytest.importorskip("nequick", reason="the library nequick is not installed: pip install --no-deps nequick")
    ai, hour, lon, lat, height, sat_lon, sat_lat, sat_height, content = case
    sat = place(sat_lon, sat_lat, sat_height)
    delay = nequick_g(ai, place(lon, lat, height), [sat], np.array([201]), [at(hour)])
    assert delay[0] / TECU == pytest.approx(content, abs=0.01)


def test_a_day_beside_ntcm_g():
    """Every half hour in eight directions, 47 deg north: 0.56 to 1.63 times, in the median 1.00, correlated by 0.96."""
    pytest.importorskip("nequick", reason="the library nequick is not installed: pip install --no-deps nequick")
    llh = np.array([47.0 * DEG, 8.0 * DEG, 400.0])
    E, A = np.array([20.0, 50.0] * 4) * DEG, np.repeat([0.0, 90.0, 180.0, 270.0], 2) * DEG
    away = 2.2e7 * np.stack([np.cos(E) * np.cos(A), np.cos(E) * np.sin(A), -np.sin(E)], axis=1)
    sat, own, other = ecef_from_ned(away, llh), [], []
    for hour in np.arange(0.0, 24.0, 0.5):
        when = np.full(8, at(hour, 15))
        own.append(nequick_g(MEDIUM, ecef_from_llh(llh), sat, np.arange(201, 209), when) / TECU)
        other.append(ntcm_g(MEDIUM, llh, E, A, when) / TECU)
    quotient = np.array(own) / np.array(other)
    assert quotient.min() > 0.5
    assert quotient.max() < 1.8
    assert np.median(quotient) == pytest.approx(1.0, abs=0.2)
    assert np.corrcoef(np.ravel(own), np.ravel(other))[0, 1] > 0.9
