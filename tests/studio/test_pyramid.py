"""Envelopes: every sample's extreme is in them, at every zoom, and 10^7 samples are answered at once."""

import time

import numpy as np
import pytest

from schuler.studio.pyramid import envelope, pyramid


@pytest.mark.thinned(3)
@pytest.mark.parametrize("n", [1, 63, 64, 65, 513, 5000, 100_003])
@pytest.mark.parametrize("columns", [7, 400])
def test_every_sample_of_the_window_lies_within_the_stretch_that_shows_it(n, columns):
    rng = np.random.default_rng(n)
    t, y = np.arange(n) / 200.0, rng.standard_normal(n).cumsum()
    p = pyramid(y)
    for start, stop in [(t[0], t[-1]), *np.sort(rng.uniform(-1.0, t[-1] + 1.0, (20, 2)), axis=1)]:
        at, low, high = envelope(t, p, start, stop, columns)
        inside = np.flatnonzero((t >= start) & (t <= stop))
        assert np.all(np.diff(at) > 0.0)
        stretch = np.searchsorted(at, t[inside], side="right") - 1
        assert np.all(stretch >= 0)
        assert np.all(low[stretch] <= y[inside])  # exact: extremes are samples
        assert np.all(y[inside] <= high[stretch])
        assert np.isin(low, y).all()
        assert np.isin(high, y).all()


def test_few_samples_are_all_drawn():
    t = np.arange(1000) / 100.0
    y = np.sin(t)
    at, low, high = envelope(t, pyramid(y), 2.0, 3.0, 200)
    assert at[0] <= 2.0
    assert at[-1] >= 3.0
    assert low is high
    np.testing.assert_array_equal(low, y[200:301])


def test_a_single_spike_is_seen_at_every_zoom():
    t, y = np.arange(1_000_000) / 200.0, np.zeros(1_000_000)
    y[765_431] = 7.0
    p = pyramid(y)
    for half in (1.0, 30.0, 500.0, 3000.0):
        _, _, high = envelope(t, p, t[765_431] - half, t[765_431] + half, 1000)
        assert high.max() == 7.0


def test_missing_samples_do_not_hide_the_others():
    y = np.arange(10_000.0)
    y[::3] = np.nan
    _, low, high = envelope(np.arange(10_000.0), pyramid(y), 0.0, 9999.0, 20)
    assert low[0] == 1.0
    assert high[-1] == 9998.0


def test_ten_million_samples_are_answered_in_less_than_a_tenth_of_a_second():
    n = 10_000_000
    t, y = np.arange(n) / 200.0, np.random.default_rng(1).standard_normal(n)
    p = pyramid(y)
    for start, stop in ((0.0, t[-1]), (1000.0, 1100.0), (20_000.0, 45_000.0)):
        began = time.perf_counter()
        at, _, _ = envelope(t, p, start, stop, 1200)
        assert time.perf_counter() - began < 0.1  # a few tenths of a millisecond on a quiet machine
        assert len(at) <= 2400 + 2
