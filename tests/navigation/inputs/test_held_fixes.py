"""Fixes that a driver holds at a higher rate are used once, also at rest; a receiver that stands is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import module

from schuler.navigation.inputs.gnss_faults import held
from schuler.navigation.inputs.preparation import prepared_gnss
from schuler.navigation.run import navigate
from schuler.recording.series import GnssSeries

tn = module("navigation/test_navigate.py")


@pytest.fixture(scope="module")
def recording():
    return tn.drive()


def repeated(gnss: GnssSeries, times: int) -> GnssSeries:
    """Every fix ``times`` times, with stamps of their own."""
    row = np.repeat(np.arange(len(gnss)), times)
    interval = float(np.median(np.diff(gnss.t))) / times
    t = gnss.t[row] + interval * (np.arange(len(row)) % times)
    return rows_of(gnss, row, t)


def rows_of(gnss: GnssSeries, row, t) -> GnssSeries:
    """Rows of a series under other stamps."""
    columns = {n: getattr(gnss, n) for n in ("llh", "cov_r_n", "v_n", "cov_v_n")}
    return GnssSeries(t, **{n: None if x is None else x[row] for n, x in columns.items()})


@pytest.mark.parametrize("times", [2, 10, 50])
def test_held_fixes_are_the_first_of_equal_rows(recording, times):
    fixes = recording.gnss
    again, factor = held(repeated(fixes, times))
    assert factor == times
    first = np.zeros(len(fixes) * times, dtype=bool)
    first[::times] = True
    assert np.array_equal(~again, first)


@pytest.mark.parametrize("velocity", [True, False])
def test_at_rest_as_many_rows_are_left_as_in_motion(recording, velocity):
    fixes = recording.gnss
    if not velocity:
        fixes = replace(fixes, v_n=None, cov_v_n=None)
    row = np.concatenate((np.zeros(30, dtype=int), np.arange(len(fixes))))  # a receiver that smooths repeats itself
    both = rows_of(fixes, row, np.concatenate((fixes.t[0] - np.arange(30.0, 0.0, -1.0), fixes.t)))
    assert not held(both)[0].any()
    again, _ = held(repeated(both, 5))
    assert np.sum(~again) == len(both)


def test_fixes_of_their_own_are_left_alone(recording):
    fixes = recording.gnss
    assert not held(fixes)[0].any()
    standing = replace(fixes, llh=np.round(fixes.llh[:1] + 0.0 * fixes.llh, 9), v_n=0.0 * fixes.v_n)
    assert not held(standing)[0].any()


def test_navigation_with_held_fixes_is_that_with_each_once(recording):
    config = tn.config(filter={"smooth": False})
    once = navigate(recording, config)
    ten = navigate(replace(recording, gnss=repeated(recording.gnss, 10)), config)
    assert any("each fix about 10 times" in note for note in ten.notes)
    assert np.array_equal(once.trajectory.r_eb_e, ten.trajectory.r_eb_e)
    notes: list[str] = []
    assert len(prepared_gnss(repeated(recording.gnss, 10), tn.NavigationConfig.parse(config), notes)) == len(
        recording.gnss
    )
