"""NTCM-G: the published values to their printed digits, and closed forms."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

from schuler import frames
from schuler.gnss.ionosphere import F_L1
from schuler.gnss.ionosphere_galileo import effective_ionisation, ntcm_g
from schuler.timebase import gps_from_calendar
from schuler.units import DEG

HIGH = (236.831641, -0.39362878, 0.00402826613)
MEDIUM = (121.129893, 0.351254133, 0.0134635348)
LOW = (2.580271, 0.127628236, 0.0252748384)
TECU = 40.3e16 / F_L1**2  # delay on L1 [m]

# Annex of the model's description, day 105: coefficients, hour, receiver's longitude, latitude [deg], height [m],
# satellite's, slant content [TECU]
PUBLISHED = [
    (HIGH, 0, -62.34, 82.49, 78.11, 8.23, 54.29, 20281546.18, 33.7567),
    (HIGH, 0, -62.34, 82.49, 78.11, -158.03, 24.05, 20275295.43, 98.7476),
    (HIGH, 8, -62.34, 82.49, 78.11, 84.26, 54.68, 20305726.79, 33.8241),
    (HIGH, 12, -62.34, 82.49, 78.11, 81.09, 35.20, 20278071.03, 65.0500),
    (HIGH, 16, -52.81, 5.25, -25.76, -70.26, 50.63, 20043030.72, 216.2278),
    (HIGH, 20, -52.81, 5.25, -25.76, -1.57, -7.90, 20373709.74, 220.0012),
    (HIGH, 20, -52.81, 5.25, -25.76, 10.94, 44.72, 20450566.19, 252.0204),
    (HIGH, 4, -52.81, 5.25, -25.76, -18.13, 14.17, 20267783.18, 59.7016),
    (MEDIUM, 0, 40.19, -3.00, -23.32, 76.65, -41.43, 20157673.93, 28.3208),
    (MEDIUM, 4, 40.19, -3.00, -23.32, 107.19, -10.65, 19943686.06, 108.8940),
    (MEDIUM, 12, 40.19, -3.00, -23.32, 90.78, -28.26, 20081398.25, 153.7801),
    (MEDIUM, 20, 40.19, -3.00, -23.32, -1.81, -52.00, 20332764.38, 69.9599),
    (MEDIUM, 8, 115.89, -31.80, 12.78, 127.35, 23.46, 19837695.71, 82.6376),
    (MEDIUM, 16, 115.89, -31.80, 12.78, 124.09, -14.31, 20100697.90, 15.0902),
    (MEDIUM, 16, 115.89, -31.80, 12.78, -167.50, -43.24, 20095343.13, 25.6441),
    (MEDIUM, 20, 115.89, -31.80, 12.78, 131.65, -31.56, 20066111.12, 7.5508),
    (LOW, 0, 141.13, 39.14, 117.00, 165.14, -13.93, 20181976.50, 51.5270),
    (LOW, 4, 141.13, 39.14, 117.00, 38.39, 51.98, 20457198.52, 41.9432),
    (LOW, 12, 141.13, 39.14, 117.00, 62.65, 54.77, 20370905.24, 18.7723),
    (LOW, 20, 141.13, 39.14, 117.00, 84.18, 36.59, 19953853.27, 10.2320),
    (LOW, 0, -155.46, 19.80, 3754.69, 179.32, 9.92, 20274303.54, 41.9874),
    (LOW, 8, -155.46, 19.80, 3754.69, 179.50, 51.35, 19967934.29, 19.9825),
    (LOW, 12, -155.46, 19.80, 3754.69, -146.53, 22.03, 20069033.97, 9.7271),
    (LOW, 20, -155.46, 19.80, 3754.69, -82.52, 20.64, 19937791.48, 67.4750),
]


def at(hour, day=105, year=2022):
    """GPS time of an hour of a day of the year. [s]"""
    return gps_from_calendar(dt.datetime(year, 1, 1) + dt.timedelta(days=day - 1, hours=hour))


@pytest.mark.parametrize("case", PUBLISHED)
def test_published_contents_to_their_printed_digits(case):
    """Places are printed to 0.01 deg, contents to 0.0001 TECU."""
    ai, hour, lon, lat, height, sat_lon, sat_lat, sat_height, content = case
    llh, sat = np.array([lat * DEG, lon * DEG, height]), np.array([sat_lat * DEG, sat_lon * DEG, sat_height])
    north, east, down = frames.ned_from_ecef(frames.ecef_from_llh(sat), llh)
    elevation, azimuth = np.arctan2(-down, np.hypot(north, east)), np.arctan2(east, north)
    value = ntcm_g(ai, llh, [elevation], [azimuth], at(hour)) / TECU
    assert value[0] == pytest.approx(content, abs=1.01e-4)


def test_effective_ionisation_is_the_mean_over_the_earth():
    """Root mean square of the polynomial over dip latitudes of -70 to 70 degrees; six printed digits."""
    mu = np.linspace(-70.0, 70.0, 200_001)
    for ai in (HIGH, MEDIUM, LOW):
        even = np.mean(ai[0] ** 2 + (ai[1] * mu) ** 2 + (ai[2] * mu**2) ** 2 + 2.0 * ai[0] * ai[2] * mu**2)
        assert effective_ionisation(ai) == pytest.approx(np.sqrt(even), rel=2e-5)
    assert effective_ionisation((0.0, 0.0, 0.0)) == 0.0


def test_delays_of_many_rows_days_and_frequencies():
    """Each row as by itself; the inverse square of the frequency; the day counts, and begins anew on New Year."""
    llh, t = np.array([0.7, 0.2, 100.0]), np.array([at(3.0, 364), at(3.0, 366), at(27.0, 365), at(12.0, 80)])
    E, A = np.array([0.2, 0.9, 0.9, -0.3]), np.array([1.0, 2.0, 2.0, 4.0])
    together = ntcm_g(MEDIUM, llh, E, A, t, F_L1 / 2.0)
    alone = [ntcm_g(MEDIUM, llh, [e], [a], s)[0] for e, a, s in zip(E, A, t, strict=True)]
    np.testing.assert_allclose(together, 4.0 * np.array(alone), rtol=1e-14)
    assert together[1] == together[2]
    assert together[1] == 4.0 * ntcm_g(MEDIUM, llh, E[1:2], A[1:2], at(3.0, 1, 2023))[0]
    assert abs(together[1] / (4.0 * ntcm_g(MEDIUM, llh, E[1:2], A[1:2], at(3.0, 172))[0]) - 1.0) > 0.1
    assert alone[3] == ntcm_g(MEDIUM, llh, [0.0], [4.0], t[3])[0]
