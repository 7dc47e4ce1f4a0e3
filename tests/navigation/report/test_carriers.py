"""Carrier phases in a report: arcs that ended, changes by satellite, integers held, protection levels against truth."""

from __future__ import annotations

import numpy as np
import pytest
from carrier_town import LEVER, SLIPS, configuration, slipped_town

from schuler import frames, rotation
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.signals import satellite_name
from schuler.navigation.report import carriers, innovations
from schuler.navigation.report.build import satellite_figures
from schuler.navigation.report.subject import Subject
from schuler.navigation.run import navigate
from schuler.plotting.figure import Markers


@pytest.fixture(scope="module")
def subject():
    return slipped_town()[2]


def test_marks_stand_where_the_carrier_slipped_and_nowhere_else(subject):
    sat, ended = slipped_town()[1], carriers.ended_arcs(subject.ranges)
    assert np.unique(subject.ranges.sat[ended]).tolist() == [sat]
    np.testing.assert_allclose(subject.ranges.t[ended], sorted(SLIPS), atol=0.01)  # stamps corrected by the clock
    figure = carriers.carriers(subject)
    (marks,) = [i for i in figure.panels[0].items if isinstance(i, Markers) and i.role == "rejected"]
    np.testing.assert_allclose(marks.x, sorted(SLIPS), atol=0.01)
    rows = {name: y for y, name in figure.panels[0].y_ticks}
    assert np.all(marks.y == rows[satellite_name(sat)])
    assert "2 times" in figure.caption
    assert "Integers" not in figure.caption


def test_every_change_belongs_to_its_satellite(subject):
    changes = carrier_changes(subject.ranges, 0.003)
    tested = subject.result.innovations.of("carrier_phase")
    named = subject.satellite_of("carrier_phase")
    late = subject.ranges.t[changes.now] > subject.result.t[0]
    assert np.array_equal(named[tested.t > subject.result.t[0]], subject.ranges.sat[changes.now][late])
    figure = innovations.by_satellite(subject, "carrier_phase")
    assert len(figure.panels) == len(np.unique(named[named > 0]))


def test_protection_levels_are_held_against_the_antenna(subject):
    """The same error as at the antenna by hand, rounding apart; the IMU is 1.4 m away."""
    horizontal, vertical = carriers.protection(subject)
    (marks,) = [i for i in horizontal.panels[0].items if isinstance(i, Markers)]
    truth = subject.reference.at(subject.points.t)
    antenna = truth.r_eb_e + rotation.rotate(truth.q_eb, np.broadcast_to(LEVER, truth.r_eb_e.shape))
    d = np.einsum("nji,nj->ni", frames.C_en(frames.llh_from_ecef(antenna)), subject.points.r_e - antenna)
    np.testing.assert_allclose(np.sort(marks.x), np.sort(np.hypot(d[:, 0], d[:, 1])), atol=1e-6)
    assert vertical.name != horizontal.name


def test_a_run_without_carriers_or_reference_shows_neither(subject):
    both = {"carriers", "stanford_horizontal", "stanford_vertical"}
    assert both <= {f.name for f in satellite_figures(subject)}
    result = navigate(slipped_town()[0], configuration("off"))
    plain = Subject(result, ranges=result.ranges, points=result.points)
    assert not both & {f.name for f in satellite_figures(plain)}
