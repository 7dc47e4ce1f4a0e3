"""Statistics of a span: closed forms of a ramp, samples that are missing, spans without any."""

import numpy as np
import pytest

from schuler.studio.pyramid import pyramid
from schuler.studio.signals import Channel, View
from schuler.studio.statistics import span_statistics


def seen(y, rate=10.0):
    y = np.asarray(y, dtype=float)
    channel = Channel("height [m]", "GNSS", "measured", np.arange(len(y)) / rate, pyramid(y))
    return View("", None, None, (channel,))


def test_a_ramp_has_the_moments_of_integers():
    (row,) = span_statistics(seen(np.arange(1000.0)), 10.0, 19.9)
    n = 100  # 100 to 199, both ends
    assert (row.panel, row.name, row.samples) == ("height [m]", "GNSS", n)
    assert (row.minimum, row.maximum) == (100.0, 199.0)
    assert row.mean == pytest.approx(149.5, rel=1e-14)  # rounding
    assert row.standard_deviation == pytest.approx(np.sqrt(n * (n + 1) / 12.0), rel=1e-13)  # rounding


def test_samples_that_are_missing_are_left_out():
    y = np.arange(100.0)
    y[[3, 50]] = np.nan, np.inf
    (row,) = span_statistics(seen(y), 0.0, 100.0)
    assert (row.samples, row.maximum) == (98, 99.0)
    assert row.mean == pytest.approx((99.0 * 50.0 - 53.0) / 98.0, rel=1e-14)  # rounding


def test_one_sample_has_no_scatter_and_none_has_nothing():
    (row,) = span_statistics(seen([1.0, 2.0, 3.0]), 0.05, 0.15)
    assert (row.samples, row.mean, row.standard_deviation) == (1, 2.0, None)
    (row,) = span_statistics(seen([1.0, 2.0]), 5.0, 6.0)
    assert (row.samples, row.mean, row.minimum, row.maximum) == (0, None, None, None)
