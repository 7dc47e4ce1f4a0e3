"""Fixes as their receiver stated them: a panel for what is there, and none for what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.navigation.report import fixes
from schuler.navigation.report.subject import Subject


def panels(run, **over):
    gnss = replace(run.gnss, **over)
    figure = fixes.stated(Subject(run.result, gnss=gnss, origin=0.0))
    return {panel.y_label: panel for panel in figure.panels}


def test_dilutions_have_a_panel_only_where_a_receiver_states_them(full):
    n = len(full.gnss)
    rest = {"quality": np.full(n, 1), "n_satellites": np.full(n, 9)}
    without = list(panels(full, **rest, dop=None))
    assert without == ["fix type", "satellites [-]", "stated 1-sigma [m]"]
    both = np.column_stack((np.linspace(0.8, 2.0, n), np.linspace(1.4, 3.0, n)))
    shown = panels(full, **rest, dop=both)
    assert list(shown) == ["fix type", "satellites [-]", "DOP [-]", "stated 1-sigma [m]"]
    for line, name, values in zip(shown["DOP [-]"].items, ("horizontal", "vertical"), both.T, strict=True):
        assert line.label == name
        np.testing.assert_array_equal(line.y, values)  # few enough to be drawn as they are
    low, high = shown["DOP [-]"].y_limits
    assert low < 0.8 < 3.0 < high
    one = panels(full, dop=np.column_stack((both[:, 0], np.full(n, np.nan))))["DOP [-]"]
    assert [line.label for line in one.items] == ["horizontal"]


@pytest.mark.parametrize(("peak", "log"), [(20.0, False), (90.0, True)])
def test_one_bad_epoch_does_not_flatten_the_others(full, peak, log):
    """Beyond fifty medians the axis is logarithmic, as that of the 1-sigmas is."""
    dop = np.ones((len(full.gnss), 2))
    dop[1] = peak, np.nan
    assert panels(full, dop=dop)["DOP [-]"].log is log
