"""Rest, heading, height and known places as measurements: times, weights, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    EARTH_RATE,
    FIX,
    GNSS_HEADING,
    GRAVITY,
    GRAVITY_VECTOR,
    HEADING,
    HEIGHT,
    ZERO_RATE,
    ZERO_VELOCITY,
    gate_threshold,
)
from schuler.navigation.aids.rest import earth_rates, gravities, rest_times, zero_rates, zero_velocities
from schuler.navigation.aids.scalar import heading_measurements, height_measurements, known_positions
from schuler.recording.series import ImuSeries, ScalarSeries
from schuler.standstill.stationarity import static_intervals

SIGMA_W, SIGMA_F, BIAS = 0.002, 0.03, np.array([0.004, -0.003, 0.002])


@pytest.fixture(scope="module")
def stop_and_go() -> ImuSeries:
    """At rest for 0..10 s and 20..26.5 s of 40 s, shaken between, 100 Hz."""
    rng = np.random.default_rng(3)
    t = np.arange(4000) / 100.0
    moving = ((t >= 10.0) & (t < 20.0)) | (t >= 26.5)
    gyro = BIAS + SIGMA_W * rng.standard_normal((4000, 3)) + 0.2 * moving[:, None] * np.sin(9.0 * t)[:, None]
    accel = (
        [0.0, 0.0, -9.81] + SIGMA_F * rng.standard_normal((4000, 3)) + 2.0 * moving[:, None] * np.cos(7.0 * t)[:, None]
    )
    return ImuSeries(t, gyro, accel)


@pytest.fixture(scope="module")
def rests(stop_and_go):
    intervals = static_intervals(stop_and_go, min_s=1.0, window_s=0.5)
    assert len(intervals) == 2
    return intervals


def test_times_lie_within_the_rests_at_the_rate(rests):
    t = rest_times(rests, 2.0)
    for a, b in zip(rests.start, rests.stop, strict=True):
        inside = t[(t >= a) & (t <= b)]
        assert inside[0] == a
        np.testing.assert_allclose(np.diff(inside), 0.5, atol=1e-12)  # rounding
        assert b - inside[-1] < 0.5 + 1e-9
    assert len(t) == sum(int((b - a) / 0.5 + 1e-9) + 1 for a, b in zip(rests.start, rests.stop, strict=True))


def test_zero_velocities(rests):
    s = zero_velocities(rests, sigma=0.03, rate_hz=4.0)
    assert np.all(s.kind == ZERO_VELOCITY)
    assert np.all(s.z == 0.0)
    np.testing.assert_allclose(s.R, np.tile(0.03**2 * np.eye(3), (len(s), 1, 1)), rtol=1e-15)  # rounding
    assert np.all(s.gate == gate_threshold(0.9999, 3))


def test_zero_rates_see_the_bias_as_well_as_they_claim(stop_and_go, rests):
    s = zero_rates(stop_and_go, rests, sigma_noise=SIGMA_W / 10.0)
    normal = (s.z[:, :3] - BIAS) / np.sqrt(s.R[:, 0, 0])[:, None]
    n = normal.size
    assert abs(np.mean(normal**2) - 1.0) < 4.0 * np.sqrt(2.0 / n)  # statistical, four standard errors


@pytest.mark.parametrize(
    ("make", "kind", "freedom"),
    [
        (lambda *a, **k: gravities(*a, **k), GRAVITY, 1),
        (lambda *a, **k: gravities(*a, vector=True, **k), GRAVITY_VECTOR, 3),
        (lambda *a, **k: earth_rates(*a, **k), EARTH_RATE, 1),
        (lambda *a, **k: zero_rates(*a, **k), ZERO_RATE, 3),
    ],
)
def test_means_of_complete_blocks(stop_and_go, rests, make, kind, freedom):
    s = make(stop_and_go, rests, sigma_noise=0.003, sigma=1e-3, block_s=0.5)
    assert np.all(s.kind == kind)
    assert np.all(s.gate == gate_threshold(0.9999, freedom))
    assert len(s) == sum((b - a) // 50 for a, b in rests.index)
    np.testing.assert_allclose(s.R[:, 0, 0], 0.003**2 / 0.5 + 1e-6, rtol=1e-12)
    for t, z in zip(s.t, s.z, strict=True):
        last = round(t * 100.0)
        block = slice(last - 49, last + 1)
        assert rests.mask[block].all()
        means = [x[block].mean(axis=0) for x in (stop_and_go.accel, stop_and_go.gyro)]
        # rounding; gravity zero is the ellipsoid's, and the accelerometers are not taken for perfect
        expected = np.concatenate((means[1], np.zeros(5)) if kind == ZERO_RATE else (*means, np.zeros(2)))
        np.testing.assert_allclose(z, expected, atol=1e-12)
    assert len(make(stop_and_go, rests, sigma_noise=0.003, block_s=20.0)) == 0


@pytest.mark.parametrize("make", [gravities, earth_rates, zero_rates])
def test_impossible_measurements_are_refused(stop_and_go, rests, make):
    with pytest.raises(
        InputError, match=r"expected block_s > 0 and a positive sigma or sigma_noise, got 1.0, 0.0, 0.0"
    ):
        make(stop_and_go, rests, sigma_noise=0.0)
    with pytest.raises(InputError, match=r"expected block_s > 0 .* got 0.0"):
        make(stop_and_go, rests, sigma_noise=1.0, block_s=0.0)
    with pytest.raises(InputError, match="expected the log of 4000 samples the intervals come from, got 3900"):
        make(stop_and_go.between(1.0, 50.0), rests, sigma_noise=1e-4)


def test_faulty_updates_at_rest_are_refused(rests):
    with pytest.raises(InputError, match="rate_hz: expected a positive number, got 0"):
        rest_times(rests, 0.0)
    with pytest.raises(InputError, match=r"sigma: expected a positive number, got -0.1"):
        zero_velocities(rests, sigma=-0.1)
    with pytest.raises(InputError, match="expected positive values"):
        ScalarSeries(np.arange(2.0), np.zeros(2), np.zeros(2))


# ------------------------------------------------------------------------------------------- single numbers, places


def test_heading_with_declination():
    series = ScalarSeries(np.arange(3.0), np.array([0.1, 3.1, -3.1]), np.array([0.01, 0.02, 0.03]))
    s = heading_measurements(series, declination=0.05)
    assert np.all(s.kind == HEADING)
    np.testing.assert_allclose(s.z[:, 0], series.value + 0.05, rtol=1e-15)  # rounding; the filter wraps the difference
    np.testing.assert_allclose(s.R[:, 0, 0], series.sigma**2, rtol=1e-15)


def test_only_two_antennas_stop_in_an_outage():
    series = ScalarSeries(np.arange(10.0), np.zeros(10), np.full(10, 0.01))
    magnetic, antennas = heading_measurements(series), heading_measurements(series, from_gnss=True)
    assert np.all(antennas.kind == GNSS_HEADING)
    assert len(magnetic.outside([(3.0, 6.0)])) == 10
    assert len(antennas.outside([(3.0, 6.0)])) == 7


def test_height():
    s = height_measurements(
        ScalarSeries(np.arange(4.0), np.arange(4.0), np.ones(4)), lever_b=(0.1, 0.2, 0.3), gate=None
    )
    assert np.all(s.kind == HEIGHT)
    assert np.all(s.lever == (0.1, 0.2, 0.3))
    assert np.all(np.isinf(s.gate))


def test_known_places_come_in_order_of_time():
    llh = np.array([[0.8, 0.1, 100.0], [0.81, 0.11, 50.0]])
    s = known_positions([20.0, 10.0], llh, (0.1, 0.2, 0.3))
    np.testing.assert_array_equal(s.t, [10.0, 20.0])
    np.testing.assert_allclose(s.z[:, :3], frames.ecef_from_llh(llh[::-1]), rtol=1e-15)  # rounding
    np.testing.assert_allclose(s.R[0], np.diag([0.01, 0.04, 0.09]), rtol=1e-14)
    assert np.all(s.kind == FIX)
    assert len(s.outside([(5.0, 15.0)])) == 2  # a surveyed mark does not go with GNSS


def test_faulty_surveyed_places_are_refused():
    with pytest.raises(InputError, match="as many times as places, got 2 and 1"):
        known_positions([1.0, 2.0], [[0.8, 0.1, 100.0]], (0.1, 0.1, 0.1))
    with pytest.raises(InputError, match="these look like degrees"):
        known_positions([1.0], [[47.0, 8.0, 100.0]], (0.1, 0.1, 0.1))
    with pytest.raises(InputError, match="sigma: expected positive values"):
        known_positions([1.0], [[0.8, 0.1, 100.0]], (0.1, 0.0, 0.1))
