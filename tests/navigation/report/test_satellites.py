"""Satellites: places, counts, reasons, dilutions, and innovations satellite by satellite."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler.filtering.measurements import REJECTED
from schuler.gnss.point import solve_points
from schuler.gnss.ranges import REASONS
from schuler.gnss.signals import satellite_name
from schuler.navigation.report import figures, innovations, satellites
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Line, Markers, Text
from schuler.plotting.interactive import panel_data


def subject_of(run, **over):
    how = {"smoothed": run.smoothed, "reference": run.truth, "origin": 0.0, "ranges": run.ranges, **over}
    return Subject(run.result, **how)


def of(panel, kind, role=None):
    return [i for i in panel.items if isinstance(i, kind) and (role is None or i.role == role)]


def test_sky_is_zenith_in_the_middle_and_north_up(everything):
    r = everything.ranges
    (panel,) = satellites.sky(r).panels
    assert panel.bare
    assert panel.equal
    words = {t.text: (t.x, t.y) for t in of(panel, Text)}
    for s in np.unique(r.sat):
        k = np.flatnonzero(r.sat == s)[-1]
        x, y = words[satellite_name(s)]
        radius = 1.0 - np.degrees(r.elevation[k]) / 90.0
        assert (x, y) == pytest.approx((radius * np.sin(r.azimuth[k]), radius * np.cos(r.azimuth[k])), abs=0.01)
    assert words["N"][1] > 1.0
    assert words["E"][0] > 1.0
    marks = {i.label: len(i.x) for i in of(panel, Markers) if i.label in REASONS.values()}
    assert marks == {REASONS[k]: int(np.sum(r.reason == k)) for k in (3, 4, 6)}


def test_timeline_marks_used_left_out_and_rejected(everything):
    subject = subject_of(everything)
    (panel,) = satellites.timeline(everything.ranges, subject).panels
    r = everything.ranges
    rows = {name: value for value, name in panel.y_ticks}
    assert list(rows) == [satellite_name(s) for s in np.unique(r.sat)[::-1]]
    faulty = np.unique(r.sat)[2]
    (rejected,) = of(panel, Markers, "filter_range")
    assert np.all(rejected.y == rows[satellite_name(faulty)])
    assert np.all((rejected.x > 50.0) & (rejected.x < 55.0))
    first = np.unique(r.sat)[0]  # below the mask for the first thirty seconds
    (masked,) = of(panel, Line, "masked")
    x = masked.x[np.isfinite(masked.x)]
    assert np.all(masked.y[np.isfinite(masked.x)] == rows[satellite_name(first)])
    assert 29.0 < x.max() < 31.0
    used = of(panel, Line, "system_g")[0]
    own = used.x[used.y == rows[satellite_name(first)]]
    assert own.min() == pytest.approx(29.5, abs=1.5)


def test_numbers_and_dilutions_agree_with_the_point_solutions(everything):
    r = everything.ranges
    epochs = np.unique(r.t)
    figure = satellites.geometry(r)
    total = next(i for i in figure.panels[0].items if isinstance(i, Line) and i.label == "all")
    assert np.array_equal(total.y, [np.sum(r.used & (r.t == t)) for t in epochs])
    by_system = [i for i in figure.panels[0].items if isinstance(i, Line) and i.label in ("GPS", "Galileo")]
    assert np.array_equal(sum(i.y for i in by_system), total.y)
    points = solve_points(r, integrity=None)
    theirs = satellites.geometry(r, points)
    for role in ("axis_x", "axis_y", "axis_z"):
        mine, other = (of(f.panels[1], Line, role)[0] for f in (figure, theirs))
        assert np.allclose(mine.y, other.y, rtol=2e-3)  # theirs are at the solved place, mine at the approximate one


def test_signal_strength_without_values_is_left_out(everything):
    r = everything.ranges
    figure = satellites.strengths(r)
    over_time = of(figure.panels[0], Line)
    assert {i.label for i in over_time} == {"GPS", "Galileo"}
    assert 30.0 < np.nanmedian(over_time[0].y) < 50.0
    assert satellites.strengths(replace(r, cn0=np.full(len(r), np.nan))) is None


def test_few_and_no_ranges(everything):
    r = everything.ranges
    nowhere = replace(r, elevation=np.full(len(r), np.nan), azimuth=np.full(len(r), np.nan))
    assert "sky" not in [f.name for f in satellites.satellite_figures(nowhere)]
    assert satellites.satellite_figures(r.where(np.zeros(len(r), dtype=bool))) == []
    one = r.where(np.arange(3))
    for figure in satellites.satellite_figures(one):
        figures.draw(figure)
    unused = replace(r, reason=np.full(len(r), 2))
    for figure in satellites.satellite_figures(unused):
        figures.draw(figure)
    assert "no epoch has enough" in satellites.geometry(unused).panels[1].title


def test_innovations_find_their_satellites(everything):
    subject = subject_of(everything)
    inn = everything.result.innovations.of("pseudorange")
    sat = subject.satellite_of("pseudorange")
    assert np.all(sat > 0)
    faulty = np.unique(everything.ranges.sat)[2]
    assert np.all(sat[inn.status == REJECTED] == faulty)
    used = everything.ranges.used
    for s in np.unique(sat):
        assert np.array_equal(inn.t[sat == s], everything.ranges.t[used & (everything.ranges.sat == s)])


def test_ranges_that_are_not_those_of_the_run_are_not_guessed(everything):
    r = everything.ranges
    other = r.where(~(r.used & (r.sat == np.unique(r.sat)[4]) & (r.t < 20.0)))
    sat = subject_of(everything, ranges=other).satellite_of("pseudorange")
    t = everything.result.innovations.of("pseudorange").t
    assert np.all(sat[t < 19.5] == 0)
    assert np.all(sat[t > 20.5] > 0)
    figure = innovations.by_satellite(subject_of(everything, ranges=other), "pseudorange")
    assert "the ranges given here do not fit the run's" in figure.caption
    assert not np.any(subject_of(everything, ranges=None).satellite_of("range_rate"))


@pytest.mark.parametrize("kind", ["pseudorange", "range_rate"])
def test_a_panel_for_each_satellite(everything, kind):
    subject = subject_of(everything)
    figure = innovations.by_satellite(subject, kind)
    names = [satellite_name(s) for s in np.unique(everything.ranges.sat)]
    assert [p.y_label.split()[0] for p in figure.panels] == names
    _, sat = innovations._tested(subject, kind)
    for s, panel in zip(np.unique(sat), figure.panels, strict=True):
        assert sum(len(i.x) for i in of(panel, Markers)) == np.sum(sat == s)
    colours = {i.role for p in innovations.by_component(subject, kind).panels[:1] for i in of(p, Markers)}
    assert {"system_g", "system_e"} <= colours
    assert innovations.by_satellite(subject_of(everything, ranges=None), kind) is None


def test_table_of_satellites(everything):
    rows = innovations.satellite_rows(subject_of(everything))
    faulty = satellite_name(np.unique(everything.ranges.sat)[2])
    assert {r[0]: r[2] for r in rows if r[2] != "0"} == {faulty: "5"}
    inn, sat = innovations._tested(subject_of(everything), "pseudorange")
    first = inn.innovation[sat == np.unique(sat)[0], 0]
    assert rows[0][3] == f"{first.mean():+.2f}"
    assert sum(int(r[1]) + int(r[2]) for r in rows) == len(inn)


def test_data_of_long_logs_are_thinned(everything):
    """Sixteen times as many epochs make the data of the satellite figures less than twice as large."""
    r = everything.ranges

    def size(times: int) -> int:
        parts = [replace(r, t=r.t + 90.0 * k, azimuth=r.azimuth + 0.01 * k) for k in range(times)]
        many = replace(
            r, **{n: np.concatenate([getattr(p, n) for p in parts]) for n in vars(r) if n not in ("groups", "notes")}
        )
        data = [[panel_data(f, p) for p in f.panels] for f in satellites.satellite_figures(many)]
        return len(json.dumps(data))

    one, many = size(2), size(32)
    assert many < 5.0 * one
    assert many < 600_000


def test_report_and_files_show_satellites(everything, tmp_path):
    how = {"smoothed": everything.smoothed, "ranges": everything.ranges, "origin": 0.0}
    text = everything.result.report(tmp_path / "r.html", **how).read_text(encoding="utf-8")
    for words in ("Satellites in the sky", "Satellites over time", "Signal strength", "Innovations by satellite",
                  "excluded by fault detection", "pseudorange rejected by the filter"):  # fmt: skip
        assert words in text
    drawn = figures.plot_satellites(everything.ranges)
    assert list(drawn) == ["sky", "satellites", "dilution", "strength"]
    assert [t.get_text() for t in drawn["satellites"].axes[0].get_yticklabels()][-1] == "G03"
