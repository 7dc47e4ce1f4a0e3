"""Every kind of measurement and every block of parameters that aids bring is shown, in units people read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import units
from schuler.filtering import kinds
from schuler.filtering.measurements import ACCEPTED, DIMENSIONS, GATED, KINDS, REJECTED, RESET_POSITION
from schuler.filtering.states import BLOCKS
from schuler.navigation.report import build, estimates, innovations, verdict
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Band, Line, Markers


def subject_of(run, **over):
    how = {
        "smoothed": run.smoothed, "reference": run.truth, "truth_parameters": run.parameters, "origin": 0.0,
        "ranges": run.ranges, **over,
    }  # fmt: skip
    return Subject(run.result, **how)


def of(panel, kind, role=None):
    return [i for i in panel.items if isinstance(i, kind) and (role is None or i.role == role)]


def test_every_kind_has_a_name_a_unit_and_its_axes():
    assert set(kinds.DISPLAY) == set(KINDS)
    for code, what in kinds.DISPLAY.items():
        assert len(what.axes) == DIMENSIONS[code], what.text
    assert len({w.text for w in kinds.DISPLAY.values()}) == len(KINDS)


FACTORS = {"m": 1.0, "m/s": 1.0, "deg": units.DEG, "deg/s": units.DEG}
UNITS = {
    "position": "m", "velocity": "m/s", "zero_velocity": "m/s", "lateral": "m/s", "vertical": "m/s", "speed": "m/s",
    "zero_rate": "deg/s", "pseudorange": "m", "range_rate": "m/s", "heading": "deg", "height": "m", "fix": "m",
    "gnss_heading": "deg",
}  # fmt: skip


@pytest.mark.parametrize("kind", UNITS)
def test_innovations_of_every_kind(everything, kind):
    subject = subject_of(everything, ranges=None)
    assert set(innovations.kinds(subject)) == set(UNITS)
    figure = innovations.by_component(subject, kind)
    inn = everything.result.innovations.of(kind)
    inn = inn.where(np.isfinite(inn.nis))
    size = int(inn.freedom[0])
    assert len(figure.panels) == size + 1
    factor = FACTORS[UNITS[kind]]
    for i, panel in enumerate(figure.panels[:-1]):
        assert panel.y_label.endswith(f"[{UNITS[kind]}]")
        values = np.concatenate([m.y for m in of(panel, Markers) if m.label not in ("condition not met",)])
        assert np.allclose(np.sort(values), np.sort(inn.innovation[:, i] / factor))
        (band,) = of(panel, Band)
        if kind not in ("pseudorange", "range_rate"):
            finite = np.isfinite(band.high)
            assert np.allclose(band.high[finite], 3.0 * inn.sigma[:, i] / factor)
    last = figure.panels[-1]
    assert last.y_label == ("NIS per axis [-]" if size == 3 else "NIS [-]")
    assert f"mean {np.mean(inn.nis / size):.2f}" in last.title
    assert len(figure.caption) > 40


def test_band_of_satellites_is_the_mean_one_of_each_epoch(everything):
    inn = everything.result.innovations.of("pseudorange")
    (band,) = of(innovations.by_component(subject_of(everything), "pseudorange").panels[0], Band)
    finite = np.isfinite(band.high)
    times = np.unique(inn.t)
    assert np.allclose(band.x[finite], times)
    expected = [3.0 * np.sqrt(np.mean(inn.sigma[inn.t == t, 0] ** 2)) for t in times]
    assert np.allclose(band.high[finite], expected)


def test_gated_measurements_are_drawn_and_counted(everything):
    inn = everything.result.innovations.of("lateral")
    gated = inn.t[inn.status == GATED]
    assert len(gated) > 50
    figure = innovations.by_component(subject_of(everything), "lateral")
    assert f"{len(gated)} more were not used because their condition was not met" in figure.caption
    (rings,) = of(figure.panels[0], Markers, "gated")
    assert len(rings.x) == len(gated)
    assert set(rings.x) <= set(gated)
    assert f"{len(gated)} without their condition" in verdict.verdict(subject_of(everything))[3]
    rows = {r[0]: r for r in verdict.measurement_rows(subject_of(everything))}
    assert rows["no sideways slip"][4] == str(len(gated))


def test_resets_are_drawn_as_steps(full):
    inn = full.result.innovations
    k = inn.kind == 1
    nothing = np.full((int(k.sum()), 3), np.nan)
    resets = replace(
        inn.where(k), kind=np.full(k.sum(), RESET_POSITION), nis=np.full(k.sum(), np.nan), sigma=nothing,
        status=np.full(k.sum(), ACCEPTED),
    )  # fmt: skip
    subject = Subject(replace(full.result, innovations=resets, outages=()))
    assert innovations.kinds(subject) == ["reset_position"]
    figure = innovations.by_component(subject, "reset_position")
    assert len(figure.panels) == 3
    assert np.allclose(of(figure.panels[0], Markers)[0].y, resets.innovation[:, 0])
    assert "no test" in figure.caption
    sentences = verdict.verdict(subject)
    assert "never withheld" in sentences[2]
    assert sentences[3] == f"Aids: position reset ({k.sum()} used)."


def test_rare_faults_do_not_count_against_consistency(everything):
    subject = subject_of(everything)
    sentences = verdict.verdict(subject)
    assert "can be believed" in sentences[1]
    assert "pseudorange (817 used, 5 rejected)" in sentences[3]
    assert sentences[3].endswith("NIS is right for each.")
    inn = everything.result.innovations.of("pseudorange")
    mean, right = innovations.mean_nis(inn)
    assert right
    assert mean == pytest.approx(np.mean(inn.nis[inn.status != REJECTED]))
    many = np.where(np.arange(len(inn)) % 10 == 0, REJECTED, inn.status)
    worse = replace(inn, status=many, nis=np.where(many == REJECTED, 100.0, inn.nis))
    mean, right = innovations.mean_nis(worse)
    assert not right
    assert mean > 9.0


@pytest.mark.parametrize(("factor", "word"), [(5.0, "too sure"), (0.2, "too cautious")])
def test_a_kind_with_wrong_sizes_is_named(everything, factor, word):
    inn = everything.result.innovations
    wrong = replace(inn, nis=np.where(inn.kind == 11, factor * inn.nis, inn.nis))
    text = verdict.verdict(subject_of(replace(everything, result=replace(everything.result, innovations=wrong))))[3]
    assert f"NIS is off for barometric height ({word}" in text


def test_blocks_of_aids_in_units_people_read(everything):
    shown = {b: estimates.parameter(everything.result, b) for b in everything.result.layout.models}
    assert {b: p.unit for b, p in shown.items() if b not in ("b_a", "b_g")} == {
        "lever": "m", "lever_v": "m", "mount": "deg", "odometer": "%", "clock": "m", "clock_drift": "m/s",
        "clock_2": "m", "b_heading": "deg", "baro": "m", "b_r": "m", "b_v": "m/s", "delay": "ms",
    }  # fmt: skip
    for block, p in shown.items():
        assert len(p.elements) == len(BLOCKS[block]), block
        assert "," not in p.name
    rows = {r[0]: r for r in estimates.parameter_rows(subject_of(everything))}
    assert list(rows)[3:] == [
        "gyroscope bias x [deg/s]", "gyroscope bias y [deg/s]", "gyroscope bias z [deg/s]",
        "lever arm IMU to antenna forward [m]", "lever arm IMU to antenna right [m]",
        "lever arm IMU to antenna down [m]",
        "lever arm IMU to axle forward [m]", "lever arm IMU to axle right [m]", "lever arm IMU to axle down [m]",
        "mounting angle pitch [deg]", "mounting angle yaw [deg]", "odometer scale [%]", "receiver clock offset [m]",
        "receiver clock drift [m/s]", "receiver clock E against G [m]", "bias of the heading sensor [deg]",
        "bias of the barometric height [m]", "correlated GNSS position error north [m]",
        "correlated GNSS position error east [m]", "correlated GNSS position error down [m]",
        "correlated GNSS velocity error north [m/s]", "correlated GNSS velocity error east [m/s]",
        "correlated GNSS velocity error down [m/s]", "delay of GNSS [ms]",
    ]  # fmt: skip
    value = float(rows["delay of GNSS [ms]"][1].split(" ± ")[0])
    assert value == pytest.approx(1e3 * everything.result.parameter("delay")[-1, 0], abs=1.0)


def test_clocks_share_a_figure_and_are_seen_without_their_run(everything):
    subject = subject_of(everything)
    by_name = {f.name: f for f in build.parameter_figures(subject)}
    clocks = by_name["parameters_clock"]
    assert [p.y_label for p in clocks.panels] == ["offset [m]", "drift [m/s]", "E against G [m]"]
    assert "parameters_clock_drift" not in by_name
    (line,) = of(clocks.panels[0], Line, "smoothed")
    t = everything.smoothed.t
    value = everything.smoothed.parameter("clock")[:, 0]
    slope, start = np.polyfit(t, value, 1)
    assert np.allclose(line.y, value - start - slope * t, atol=1e-6)
    assert clocks.panels[0].title == f"less {start:.0f} m {'+' if slope > 0 else '-'} {abs(slope):.2f} m/s × time"
    without = build.parameter_figures(subject_of(everything, ranges=None))
    assert [p.y_label for f in without if f.name == "parameters_clock" for p in f.panels][2] == "second system [m]"
