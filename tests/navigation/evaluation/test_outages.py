"""Errors in outages and their growth with time."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.navigation.evaluation.errors import TrajectoryErrors, drift_curve, outage_errors

WINDOWS = [(10.0, 20.0), (30.0, 40.0)]


@pytest.fixture
def errors():
    """Two outages with errors of 0.01 s^2 and 0.03 s^2 after their start, 0.5 m otherwise; samples every 0.25 s."""
    t = np.arange(0.0, 50.0, 0.25)
    north = np.full(len(t), 0.5)
    for (start, stop), growth in zip(WINDOWS, (0.01, 0.03), strict=True):
        k = (t >= start) & (t <= stop)
        north[k] = growth * (t[k] - start) ** 2
    return TrajectoryErrors(t, np.stack((north, 0.0 * t, -2.0 * north), axis=-1))


def test_largest_and_last_error_of_each_outage(errors):
    first, second = outage_errors(errors, WINDOWS)
    assert first.max_horizontal == pytest.approx(1.0)
    assert second.max_horizontal == second.end_horizontal == pytest.approx(3.0)
    assert second.max_vertical == pytest.approx(6.0)


def test_windows_the_reference_does_not_reach_are_left_out(errors):
    assert len(outage_errors(errors, [*WINDOWS, (60.0, 70.0)])) == 2


def test_drift_curve_follows_the_growth(errors):
    age, rms, largest = drift_curve(errors, WINDOWS)
    np.testing.assert_array_equal(age, np.arange(1.0, 11.0))
    np.testing.assert_allclose(largest, 0.03 * age**2)
    # four samples a bin, at its end and 0.25, 0.5, 0.75 s before; the sample at the start falls into the first
    offsets = age[:, None] - np.array([0.0, 0.25, 0.5, 0.75])
    expected = np.sqrt(np.mean(offsets**4, axis=1) * (0.01**2 + 0.03**2) / 2.0)
    np.testing.assert_allclose(rms[1:], expected[1:])
    np.testing.assert_allclose(rms[0], expected[0] * np.sqrt(4.0 / 5.0))


def test_bins_without_a_reference_epoch_are_unknown():
    e = TrajectoryErrors(np.array([0.0, 4.0]), np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    age, rms, largest = drift_curve(e, [(0.0, 4.0)])
    np.testing.assert_array_equal(age, [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(rms, [1.0, np.nan, np.nan, 2.0])
    np.testing.assert_array_equal(largest, rms)


def test_no_outage_no_curve(errors):
    age, rms, largest = drift_curve(errors, [])
    assert len(age) == len(rms) == len(largest) == 0
