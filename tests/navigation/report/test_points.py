"""Page on single points: what its figures draw is what the points are, whole and in pieces."""

from dataclasses import replace

import numpy as np
import pytest
from figure_cases import single_points

from schuler.frames import llh_from_ecef
from schuler.gnss import PointEvaluation, solve_points
from schuler.gnss.point_result import STATUS
from schuler.navigation.report import points, points_report
from schuler.plotting.figure import TIME, Line, Markers


def of(panel, kind, role=None):
    return [i for i in panel.items if isinstance(i, kind) and (role is None or i.role == role)]


@pytest.fixture(scope="module")
def judged():
    return single_points(True)


def test_the_track_has_every_position_by_its_status_and_knows_its_time(judged):
    p = judged.points
    (panel,) = points.point_track(judged).panels
    (track,) = of(panel, Line, "filtered")
    assert dict(track.along)[TIME] == pytest.approx(p.t[p.ok] - p.t[0])
    assert dict(track.along)["status"].tolist() == [STATUS[s].partition(" (")[0] for s in p.status[p.ok]]
    drawn = {m.label: len(m.x) for m in of(panel, Markers)}
    for status, label in ((0, "solved and checked"), (1, "not checked")):
        assert drawn.get(label, 0) == int(np.sum(p.status == status)) > 0
    assert len(of(panel, Line, "reference")) == 1
    # positions in metres about their median: distances are those in space but for heights and curvature
    k = np.flatnonzero(p.ok)[[0, 20]]
    way = np.hypot(*np.diff(np.column_stack((track.x, track.y))[[0, 20]], axis=0)[0])
    apart = np.linalg.norm(np.diff(p.r_e[k], axis=0))
    up = np.diff(llh_from_ecef(p.r_e[k])[:, 2])[0]
    assert way == pytest.approx(np.sqrt(apart**2 - up**2), abs=1e-3)


def test_the_track_is_not_drawn_across_a_pause(judged):
    r = judged.ranges
    parted = r.where((r.t < 5.0) | (r.t > 25.0))
    (panel,) = points.point_track(PointEvaluation(solve_points(parted), parted)).panels
    (track,) = of(panel, Line, "filtered")
    gaps = np.isnan(track.x)
    assert gaps.sum() == 1
    assert int(np.flatnonzero(gaps)[0]) == 5
    assert all(len(values) == len(track.x) for _, values in track.along)


def test_errors_beyond_their_levels_are_marked(judged):
    far = replace(judged, true_r_e=judged.true_r_e + np.array([300.0, 0.0, 0.0]))
    numbers = far.error_numbers()
    for panel, name in zip(points.level_figure(far).panels, ("beyond_hpl", "beyond_vpl"), strict=True):
        (beyond,) = of(panel, Markers, "rejected")
        assert len(beyond.x) == numbers[name] > 0
        assert f"at {numbers[name]} of {numbers['epochs']} epochs" in panel.title
    assert not any(of(panel, Markers, "rejected") for panel in points.level_figure(judged).panels)


def test_epochs_are_counted_by_what_became_of_them(judged):
    p = judged.points
    first, second = points.status_figure(judged).panels
    assert sum(len(m.x) for m in of(first, Markers)) == len(p)
    assert len(first.y_ticks) == len(np.unique(p.status))
    (left_out,) = of(second, Line)
    assert left_out.y.sum() == p.excluded.sum() > 0
    assert len(points.status_figure(replace_without_faults(judged)).panels) == 1


def replace_without_faults(judged):
    clean = judged.ranges.where((judged.ranges.t < 10.0) | (judged.ranges.t > 40.0))
    return PointEvaluation(solve_points(clean), clean)


def test_the_same_page_twice_and_one_without_a_position(judged, tmp_path):
    a, b = (points_report(judged, tmp_path / name, provenance={"options": {"risk": 1e-3}}) for name in "ab")
    assert a.read_bytes() == b.read_bytes()
    none = replace(judged.ranges, reason=np.full(len(judged.ranges), 3))
    page = points_report(PointEvaluation(solve_points(none), none, judged.true_r_e), tmp_path / "none").read_text()
    assert "verdict: FAILED" in page
    assert "lower --elevation-mask" in page
    assert "Satellites over time" in page
