"""Strides of a simulated walk: every number of them is known."""

from __future__ import annotations

import numpy as np
import pytest
import walk_cases as wc

from schuler import frames
from schuler.exceptions import InputError
from schuler.navigation.foot.strides import segment
from schuler.standstill.intervals import rests_from_mask


def strides_of(motion, **options):
    t = wc.times(motion)
    state = motion.state(t)
    rests = rests_from_mask(t, motion.resting(t))
    return segment(rests, frames.ned_from_ecef(state.r_eb_e, wc.ORIGIN), state.rpy_nb[:, 2], **options)


def test_a_walk_in_a_square():
    motion = wc.square()
    s = strides_of(motion)
    assert len(s) == 12
    assert s.walking.all()
    np.testing.assert_allclose(s.length, 1.3, atol=1e-6)  # rounding of ECEF positions
    np.testing.assert_allclose(s.duration[1:-1], 1.0, atol=1.1 / wc.RATE)  # middles of rests lie on samples
    np.testing.assert_allclose(s.lift, motion.lift, atol=1.1 / wc.RATE)
    np.testing.assert_allclose(s.contact, motion.contact, atol=1.1 / wc.RATE)
    np.testing.assert_allclose(s.swing, 0.45, atol=2.1 / wc.RATE)
    np.testing.assert_allclose(s.turn, wc.TURNS, atol=1e-6)
    np.testing.assert_allclose(s.clearance, 0.12, rtol=2e-3)  # the top lies between samples
    np.testing.assert_allclose(s.speed, s.length / s.duration)
    np.testing.assert_allclose(s.frequency * s.duration, 1.0)
    assert s.distance == pytest.approx(15.6, abs=1e-5)
    assert "12 strides" in s.summary()
    assert "120 steps/min" in s.summary()


def test_stairs():
    """Clearance counts from the line between the footholds, so it does not grow with the stairs."""
    s = strides_of(wc.walk(wc.ORIGIN, strides=6, climb=0.34, length=0.6))
    np.testing.assert_allclose(s.displacement_n[:, 2], -0.34, atol=1e-6)
    assert np.all((s.clearance > 0.08) & (s.clearance < 0.2))


def test_shuffles_are_listed_and_not_counted():
    s = strides_of(wc.walk(wc.ORIGIN, strides=5, length=0.05, clearance=0.02))
    assert len(s) == 5
    assert not s.walking.any()
    assert "no stride" in s.summary()
    s = strides_of(wc.walk(wc.ORIGIN, strides=5, length=0.05), min_length_m=0.01)
    assert s.walking.all()


def test_short_rests_and_short_motions_divide_nothing():
    motion = wc.square()
    t = wc.times(motion)
    state = motion.state(t)
    mask = motion.resting(t)
    mask[(t > 5.2) & (t < 5.22)] = True  # a false rest in the first swing
    mask[(t > 5.7) & (t < 5.75)] = False  # a twitch in the first rest
    r, heading = frames.ned_from_ecef(state.r_eb_e, wc.ORIGIN), state.rpy_nb[:, 2]
    assert len(segment(rests_from_mask(t, mask), r, heading)) == 12
    assert len(segment(rests_from_mask(t, mask), r, heading, min_rest_s=0.0, min_motion_s=0.0)) == 14


def test_no_rest_no_stride():
    t = np.arange(10) / 100.0
    s = segment(rests_from_mask(t, np.zeros(10, dtype=bool)), np.zeros((10, 3)), np.zeros(10))
    assert len(s) == 0
    assert s.distance == 0.0
    one = segment(rests_from_mask(t, np.ones(10, dtype=bool)), np.zeros((10, 3)), np.zeros(10))
    assert len(one) == 0


def test_arrays_that_do_not_fit():
    rests = rests_from_mask(np.arange(10) / 100.0, np.ones(10, dtype=bool))
    with pytest.raises(InputError, match="position_n"):
        segment(rests, np.zeros((9, 3)), np.zeros(10))
    with pytest.raises(InputError, match="at least 0"):
        segment(rests, np.zeros((10, 3)), np.zeros(10), min_rest_s=-1.0)
