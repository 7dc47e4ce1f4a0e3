"""Thinning keeps what the eye would see, gaps stay gaps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from schuler.plotting import figure as content
from schuler.plotting.figure import (
    Band,
    Figure,
    Line,
    Markers,
    Panel,
    Span,
    Text,
    band,
    line,
    markers,
    path,
    thin,
    view,
)


def test_short_lines_are_left_as_they_are():
    y = np.random.default_rng(1).standard_normal(content.LIMIT)
    assert np.array_equal(thin([y]), np.arange(content.LIMIT))


def test_spikes_survive_thinning(rng):
    n = 300_000
    y = rng.standard_normal(n)
    spikes = {7: 50.0, 123_456: -60.0, 299_998: 70.0}
    for k, v in spikes.items():
        y[k] = v
    drawn = line(np.arange(n, dtype=float), y, "filtered")
    assert len(drawn.x) <= content.LIMIT
    assert set(spikes) <= set(drawn.x.astype(int))
    assert (drawn.x[0], drawn.x[-1]) == (0.0, n - 1.0)
    assert np.array_equal(drawn.y, y[drawn.x.astype(int)])
    assert np.all(np.diff(drawn.x) > 0)


@settings(deadline=None)  # a busy machine is no fault
@given(
    hnp.arrays(np.float64, st.integers(3, 400), elements=st.floats(-1e6, 1e6) | st.just(np.nan)), st.integers(20, 60)
)
def test_thinned_lines_have_the_extremes_and_cross_no_gap(y, limit):
    k = thin([y], limit)
    assert len(k) <= max(limit, 0) or len(y) <= limit
    assert np.all(np.diff(k) > 0)
    if np.isfinite(y).any():
        assert np.nanmin(y[k]) == np.nanmin(y)
        assert np.nanmax(y[k]) == np.nanmax(y)
    for a, b in pairwise(k):
        if np.isfinite(y[a]) and np.isfinite(y[b]):
            assert not np.isnan(y[a:b]).any()


def test_band_never_gets_narrower_at_its_widest(rng):
    half = 1.0 + rng.random(50_000)
    half[31_234] = 9.0
    b = band(np.arange(50_000.0), -half, half, "sigma")
    assert b.high.max() == 9.0
    assert b.low.min() == -9.0
    assert len(b.x) <= content.LIMIT


def test_pauses_break_lines_and_bands():
    x = np.r_[np.arange(10.0), np.arange(30.0, 40.0)]
    drawn = line(x, np.ones(20), "filtered")
    assert np.isnan(drawn.y).sum() == 1
    assert 9.0 < drawn.x[np.isnan(drawn.y)][0] < 30.0
    assert np.isnan(band(x, -np.ones(20), np.ones(20), "sigma").high).sum() == 1


def test_paths_keep_their_corners():
    corner = np.arange(10_000)
    x, y = np.minimum(corner, 5000.0), np.maximum(corner - 5000.0, 0.0)
    drawn = path(x, y, "filtered")
    assert len(drawn.x) <= content.LIMIT
    distance = np.hypot(drawn.x - 5000.0, drawn.y)
    assert distance.min() < 2.0 * 10_000 / content.LIMIT


def test_markers_leave_out_what_is_not_a_number():
    m = markers([0.0, 1.0, 2.0], [1.0, np.nan, 3.0], "rejected")
    assert m.x.tolist() == [0.0, 2.0]


def test_view_shows_all_of_the_lines_and_most_of_the_bands():
    edge = np.r_[np.full(2, 1000.0), np.full(98, 3.0)]
    low, high = view([np.array([-5.0, 1.0])], [edge, -edge])
    assert low < -5.0
    assert 3.0 < high < 100.0
    assert view([], []) is None
    assert view([np.full(3, np.nan)]) is None
    low, high = view([np.zeros(3)])
    assert low < 0.0 < high


def test_legend_names_each_label_once():
    x = np.zeros(2)
    items = (
        Span(0.0, 1.0, "outage", "lost"),
        Line(x, x, "filtered", "a"),
        Line(x, x, "level"),
        Text(0.0, 0.0, "200 m"),
    )
    more = (Line(x, x, "filtered", "a"), Markers(x, x, "rejected", "r"), Band(x, x, x, "sigma", "b"))
    figure = Figure("f", "F", "", (Panel("x", "y", items), Panel("x", "y", more)))
    expected = {
        "lost": ("span", "outage"),
        "a": ("line", "filtered"),
        "r": ("markers", "rejected"),
        "b": ("band", "sigma"),
    }
    assert figure.legend() == expected


@pytest.mark.parametrize("limit", [1, 2, 5])
def test_absurd_limits_do_not_fail(limit):
    assert len(thin([np.arange(100.0)], limit)) >= 2


def test_a_long_line_is_thinned_in_parts(monkeypatch):
    rng = np.random.default_rng(3)
    columns = [rng.standard_normal(50_000).round(1) for _ in range(2)]
    whole = thin(columns)
    monkeypatch.setattr(content, "_BLOCK", 1000)
    np.testing.assert_array_equal(thin(columns), whole)
    columns[0][[5, 20_000, 20_001, 49_990]] = np.nan
    in_parts = thin(columns)
    monkeypatch.undo()
    np.testing.assert_array_equal(thin(columns), in_parts)


@pytest.mark.parametrize("pause", [4.0, 6.0])
def test_a_line_breaks_where_its_steps_are_of_several_sizes(pause, monkeypatch):
    monkeypatch.setattr(content, "_BLOCK", 7)
    x = np.cumsum([1.0] * 14 + [pause] + [1.0] * 5)
    drawn = line(x, np.zeros(20), "mean")
    assert np.isnan(drawn.y).sum() == (pause > 5.0)
    assert len(line(np.zeros(4), np.zeros(4), "mean").x) == 4
