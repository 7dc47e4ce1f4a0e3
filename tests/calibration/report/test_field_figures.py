"""Figures and page of a field calibration: numbers are the calibration's, the page is complete, bytes repeat."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from html_pages import Page
from matplotlib.figure import Figure as MplFigure

from schuler.calibration.field.calibration import calibrate_field
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.report import field_panels
from schuler.calibration.report.field_figures import field_figure
from schuler.calibration.report.figures import save_calibration_figures
from schuler.calibration.result.parameters import in_gauge, vector
from schuler.calibration.result.sheet import sheet
from schuler.exceptions import InputError
from schuler.plotting.figure import Band, Line, Markers, Span
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.units import DEG, DEG_PER_HR, MG

LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
SPEC = catalogue.spec("yaman-automotive")


pytestmark = pytest.mark.usefixtures("small_script")


@pytest.fixture(scope="module")
def errors():
    """In axes of a fixture: all nine elements of M_a."""
    return ImuErrors.draw(SPEC, np.random.default_rng(4))


@pytest.fixture(scope="module")
def imu(errors):
    motion = RoutineMotion(thesis_routine(dwell_s=5.0, repeats=1), LLH)
    return simulate_imu(ideal_imu(motion, 50.0), errors, np.random.default_rng(5)).imu


@pytest.fixture(scope="module")
def solution(imu):
    return calibrate_field(imu, SPEC, latitude=LLH[0], height=LLH[2], heading=(0.0, DEG))


def items(panel, kind, label=None):
    return [i for i in panel.items if isinstance(i, kind) and (label is None or i.label == label)]


def panel_of(figure, title):
    return next(p for p in figure.panels if p.title == title)


def test_every_parameter_is_in_one_panel(solution):
    """Three at most in each: biases, scale factors, cross-coupling; matrices of the gyroscopes row by row."""
    groups = field_panels.groups(solution.history.names)
    assert sorted(n for g in groups for n in g) == sorted(solution.history.names)
    assert groups[:3] == [
        ("b_a_x", "b_a_y", "b_a_z"), ("M_a_xx", "M_a_yy", "M_a_zz"), ("M_a_xy", "M_a_xz", "M_a_yz"),
    ]  # fmt: skip
    assert ("M_g_yx", "M_g_yz") in groups
    assert groups[-1] == ("G_g_zx", "G_g_zy", "G_g_zz")
    assert all(1 <= len(g) <= 3 for g in groups)


def test_the_uncertainty_left_is_the_root_of_the_normalised_variance(solution):
    figure = field_panels.convergence(solution)
    history = solution.history
    panel = panel_of(figure, "M_a_xx, M_a_yy, M_a_zz")
    (curve,) = items(panel, Line, "second")
    expected = history.sigma[:, history.names.index("M_a_yy")] / SPEC.accel.scale_factor
    np.testing.assert_allclose(curve.y, expected, rtol=1e-12)  # rounding
    np.testing.assert_array_equal(curve.x, history.t)
    (tenth,) = items(panel, Line, "a tenth")
    np.testing.assert_array_equal(tenth.y, [0.1, 0.1])
    assert panel.log
    # the last value is what the result says is left
    assert curve.y[-1] == pytest.approx(solution.calibration.observability["M_a_yy"])
    low, high = panel.y_limits
    assert all(low < c.y.min() and c.y.max() < high for p in figure.panels for c in items(p, Line))


def test_estimates_stand_in_data_sheet_units_with_three_sigma(solution):
    panel = panel_of(field_panels.estimates(solution), "b_g_x, b_g_y, b_g_z")
    value, sigma = solution.calibration["b_g_z"]
    (curve,) = items(panel, Line, "third")
    assert curve.y[-1] == pytest.approx(value / DEG_PER_HR)
    (band,) = items(panel, Band, "third ±3 sigma")
    assert band.high[-1] - band.low[-1] == pytest.approx(6.0 * sigma / DEG_PER_HR)
    assert "deg/h" in panel.y_label
    assert not items(panel, Line, "true")


def test_truth_is_brought_into_the_axes_of_the_calibration(solution, errors):
    """M of a fixture differs from its upper form by 10 mrad, a hundred sigma of the estimate."""
    panel = panel_of(field_panels.estimates(solution, errors), "M_a_xy, M_a_xz, M_a_yz")
    names = ("M_a_xy", "M_a_xz", "M_a_yz")
    true = vector(in_gauge(errors, "upper"), names) / sheet("M_a_xy").factor
    drawn = [line.y[0] for line in items(panel, Line, "true")]
    np.testing.assert_allclose(drawn, true)
    assert np.abs(true - vector(errors, names) / 1e-3).max() > 1.0
    # statistical: within the bands at the end, 3 sigma and a little
    ends = [(band.low[-1], band.high[-1]) for band in items(panel, Band)]
    assert all(low - 1.0 < t < high + 1.0 for (low, high), t in zip(ends, true, strict=True))


def test_part_of_the_truth_is_drawn_where_it_is_known(solution):
    figure = field_panels.estimates(solution, {"b_a_y": 0.3})
    assert [len(items(p, Line, "true")) for p in figure.panels] == [1] + [0] * (len(figure.panels) - 1)
    (line,) = items(figure.panels[0], Line, "true")
    np.testing.assert_allclose(line.y, 0.3 / MG)


def test_rests_show_what_was_read_too_much(solution):
    figure = field_panels.rests(solution)
    r = solution.calibration.residuals["accel"]
    up, accel, gyro = figure.panels
    assert len(items(up, Span)) == len(solution.rests) == len(r.value)
    assert [s.label for s in items(up, Span)][:2] == ["at rest", ""]
    (before,), (after,) = items(accel, Markers, "before"), items(accel, Markers, "after")
    np.testing.assert_allclose(before.y, np.abs(r.before) / MG)
    np.testing.assert_allclose(after.y, np.abs(r.value) / MG)
    assert ((solution.rests.start < before.x) & (before.x < solution.rests.stop)).all()
    assert np.sqrt(np.mean(before.y**2)) > 20.0 * np.sqrt(np.mean(after.y**2))
    assert "deg/h" in gyro.y_label
    strokes = items(up, Line, "z")[0]
    # the first rest is level: z down
    assert strokes.y[0] == pytest.approx(-1.0, abs=0.01)
    assert np.isnan(strokes.y[2])


def test_perfect_data_have_a_logarithm(solution):
    r = solution.calibration.residuals["accel"]
    perfect = replace(solution.calibration, residuals={"accel": replace(r, value=np.zeros_like(r.value))})
    panel = field_panels.rests(replace(solution, calibration=perfect)).panels[1]
    assert (items(panel, Markers, "after")[0].y > 0.0).all()


def test_innovations_are_those_the_mean_square_is_of(solution):
    figure = field_panels.innovations(solution)
    assert len(figure.panels) == len(solution.nis)
    for panel, (kind, (_, count)) in zip(figure.panels, solution.nis.items(), strict=True):
        z = np.concatenate([m.y for m in items(panel, Markers)])
        assert len(z) == count
        assert f"{np.mean(z**2):.2f}" in panel.title
        # statistical: hundreds of components, 5 standard errors
        assert abs(np.mean(z**2) - 1.0) < 5.0 * np.sqrt(2.0 / count), kind
        low, high = panel.y_limits
        assert low < z.min() < z.max() < high


def test_scalar_innovations_squared_are_the_filters_own(imu):
    """For one component, z squared is the normalised innovation squared."""
    options = FieldOptions(earth_rate="vertical")
    solution = calibrate_field(imu, SPEC, latitude=LLH[0], height=LLH[2], heading=(0.0, DEG), options=options)
    z = solution.innovations["earth_rate"].z[:, 0]
    mean, count = solution.nis["earth_rate"]
    assert np.mean(z**2) == pytest.approx(mean)
    assert len(z) == count


@pytest.mark.campaign
def test_one_figure_by_name(solution, errors):
    drawn = solution.plot()
    assert isinstance(drawn, MplFigure)
    visible = [ax for ax in drawn.axes if ax.get_visible()]
    assert len(visible) == len(field_panels.groups(solution.history.names))
    assert len(field_figure(solution, "rests").axes) == 3
    field_figure(solution, "estimates", truth=errors).draw_without_rendering()
    with pytest.raises(
        InputError, match=r"which: expected one of what there is \(convergence, estimates, rests, innov"
    ):
        solution.plot(which="sphere")


@pytest.mark.campaign
def test_files_of_all_figures_and_the_same_bytes(solution, tmp_path):
    first, again = (
        save_calibration_figures(solution.calibration, tmp_path / name, ("svg",), field=solution) for name in "ab"
    )
    stems = [p.stem for p in first]
    assert stems[:4] == ["residuals", "coverage", "before_after", "parameters"]
    assert stems[-4:] == ["field_convergence", "field_estimates", "field_rests", "field_innovations"]
    for path in first:
        assert ET.parse(path).getroot().tag.endswith("svg")
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(first, again, strict=True))


def test_the_page_has_a_section_on_how_it_came_about(solution, errors, tmp_path):
    source = solution.report(tmp_path / "a.html", truth=errors).read_text(encoding="utf-8")
    heads = re.findall(r"<h2>(.*?)</h2>", source)
    assert heads[:3] == ["Parameters", "Residuals", "How it came about"]
    section = source[source.index('id="history"') : source.index('id="coverage"')]
    assert f"{len(solution.passes)} passes over the log" in section
    assert "25 intervals at rest" in section
    assert "below a tenth from" in section
    assert section.count("<tr>") == len(solution.history.names) + 1
    data = Page(source).figures
    for name in ("field_convergence", "field_estimates", "field_rests", "field_innovations"):
        assert any(v is not None for panel in data[name] for trace in panel["data"] for v in trace["y"])
    used = set(re.findall(r'"(--[a-z-]+)"', json.dumps(data))) | set(re.findall(r"var\((--[a-z-]+)\)", source))
    assert used <= set(re.findall(r"(--[a-z-]+):", source))
    assert not re.search(r"\b(nan|inf|NaN|Infinity)\b", Page(source).plain.replace("isNaN", ""))
    again = solution.report(tmp_path / "b.html", truth=errors).read_text(encoding="utf-8")
    assert again == source


def test_a_result_alone_has_no_such_section(solution, tmp_path):
    assert 'id="history"' not in solution.calibration.report(tmp_path / "a.html").read_text(encoding="utf-8")


def test_a_single_pass_is_told(imu, tmp_path):
    once = calibrate_field(
        imu, SPEC, latitude=LLH[0], height=LLH[2], heading=(0.0, DEG), options=FieldOptions.thesis(second_half_s=75.0)
    )
    assert np.isnan(once.last_move)
    source = once.report(tmp_path / "a.html").read_text(encoding="utf-8")
    assert "One pass, linearised at the estimates of its time" in source
    assert [p.title.split(":")[0] for p in field_panels.innovations(once).panels] == [
        "gravity", "gravity direction", "Earth rate",
    ]  # fmt: skip


def test_the_summary_tells_of_rests_and_passes(solution):
    text = solution.summary()
    assert solution.calibration.summary() in text
    assert (
        f"{len(solution.passes)} passes, the last moved no parameter by more than {solution.last_move:.2g} sigma"
        in text
    )
    assert solution.last_move < FieldOptions().settled
