"""Page and figures on a noise model: complete, self-contained, the same bytes, right on logarithmic axes."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import html_pages
import noise_cases as cases
import numpy as np
import pytest
from html_pages import Page
from matplotlib.figure import Figure as MplFigure

from schuler.characterisation.report import document as noise_document
from schuler.characterisation.report import figures as noise_figures
from schuler.characterisation.report import panels as noise_panels
from schuler.characterisation.report import spectra as noise_spectra
from schuler.characterisation.report.document import noise_report
from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting import parts
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Band, Figure, Line, Markers, Panel, Span, Text
from schuler.plotting.interactive import panel_data
from schuler.plotting.page import Section, whole_page
from schuler.sensors.noise import white
from schuler.units import DEG, DEG_PER_HR, UG


@pytest.fixture(scope="module", autouse=True)
def small_script():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(noise_document, "plotly_script", lambda: "/* plotly */")
        yield


@pytest.fixture(scope="module")
def identified():
    return cases.identification()


@pytest.fixture(scope="module")
def shown():
    imu = cases.recording()
    lag = np.linspace(0.0, 100.0, 50)
    return {
        "imu": imu,
        "spectra": noise_spectra.log_spectra(imu),
        "correlations": {"accel_x": (lag, 1e-8 * np.exp(-lag / 5.0))},
    }


@pytest.fixture(scope="module")
def source(identified, shown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("noise")
    path = noise_report(identified, folder / "deep" / "noise.html", recording_summary="log: 3 h <at> rest", **shown)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source):
    return Page(source)


def panels_of(figure):
    return {p.title: p for p in figure.panels}


def items(panel, kind, label=None):
    return [i for i in panel.items if isinstance(i, kind) and (label is None or i.label == label)]


def test_the_page_is_well_formed_and_complete_and_loads_nothing(page):
    sections = [
        "Findings", "Numbers", "Allan curves", "Spectrum and log", "Read off and fitted", "Models tried", "Budget",
        "Notes", "Provenance",
    ]  # fmt: skip
    html_pages.check_page(page, "an <IMU> & more: noise report", sections)
    figures = ["allan", "allan_axes", "allan_ratio", "spectrum", "autocorrelation", "signals"]
    html_pages.check_figures(page, figures)


def test_the_verdict_stands_first_and_the_findings_before_the_numbers(source):
    assert source.index('id="verdict"') < source.index('id="findings"') < source.index('id="numbers"')
    assert source.index("gyro_z repeats one value") < source.index("angle random walk N")


def test_texts_of_the_user_are_escaped(page, source):
    assert "<IMU>" not in source
    assert "<b>raises</b>" not in source
    assert "<i>warm-up</i>" not in source
    assert any("<b>raises</b>" in t for t in page.text["td"])
    assert any("<i>warm-up</i>" in t for t in page.text["li"])
    assert "log: 3 h <at> rest" in page.text["pre"][0]


def test_every_number_has_both_units_an_interval_and_a_sentence(page):
    cells = page.text["td"]
    assert "0.300 deg/sqrt(h)0.288 to 0.312" in cells
    assert "8.73e-05 (rad/s)/sqrt(Hz)8.39e-05 to 9.08e-05" in cells
    assert any(c.startswith("White noise: after one hour the angle") for c in cells)
    assert any("600 s" in c for c in cells)
    notices = [a for a in page.all("tr") if a.get("class") == "told"]
    sentences = [c for c, a in zip(cells, page.all("td"), strict=True) if "colspan" in a]
    assert len(notices) == len(sentences)
    assert all(s.endswith(".") for s in sentences)


def test_the_budget_has_its_uncertainty(page):
    rows = page.text["tr"]
    assert any(r.startswith("angle random walk N") and r.endswith("1.2 %") for r in rows)
    assert any(r.startswith("in-run bias") and "90 ug" in r and r.endswith("11 %") for r in rows)


def test_same_input_same_bytes_and_no_clock(identified, shown, source, tmp_path):
    again = replace(identified, provenance={**identified.provenance, "elapsed_s": 99.0})
    path = noise_report(again, tmp_path / "n.html", recording_summary="log: 3 h <at> rest", **shown)
    assert path.read_text(encoding="utf-8") == source
    assert "12.345678" not in source
    assert "NaN" not in Page(source).plain
    assert not re.search(r"\bnan\b", Page(source).plain)


def test_little_to_show(identified, tmp_path):
    """No budget, no recording, no readings; then no axis at all: the page says so and stands."""
    bare = replace(identified, spec=None, spec_sigma={}, findings=(), refused={}, notes=(), provenance={})
    bare = replace(bare, axes={"gyro_x": replace(identified.axes["gyro_x"], findings=(), read_off={}, candidates=())})
    page = Page(noise_report(bare, tmp_path / "a.html").read_text())
    assert page.text["h2"] == ["Numbers", "Allan curves", "Budget", "Notes", "Provenance"]
    assert any("There is no budget" in p for p in page.text["p"])
    empty = replace(identified, axes={}, spec=None)
    page = Page(noise_report(empty, tmp_path / "b.html", title="gone").read_text())
    assert page.open == []
    assert page.text["h2"] == ["Findings", "Notes", "Provenance"]
    assert page.text["h1"] == ["gone"]


def test_the_result_writes_its_own_report_and_figure(identified, tmp_path):
    assert identified.report(tmp_path / "own.html").exists()
    assert len(identified.plot().axes) == 3


def test_the_allan_figure_shows_curve_band_model_terms_and_readings(identified):
    figure = noise_panels.allan(identified)
    assert list(panels_of(figure)) == ["gyro_x", "gyro_y", "accel_x"]
    panel, axis = panels_of(figure)["gyro_x"], identified.axes["gyro_x"]
    assert panel.log
    assert panel.log_x
    (curve,) = items(panel, Line, "measured")
    np.testing.assert_allclose(curve.y, axis.curve.deviation / DEG_PER_HR, rtol=1e-15)  # rounding
    (band,) = items(panel, Band)
    assert np.all((band.low <= curve.y) & (curve.y <= band.high))
    assert len(items(panel, Line, "fitted terms")) == 3
    (points,) = items(panel, Markers)
    read = axis.read_off
    expected = {(1.0, read["N_at_1s"]), (3.0, read["K_at_3s"]), (read["minimum_tau_s"], read["minimum"])}
    assert {(x, round(y, 9)) for x, y in zip(points.x, points.y, strict=True)} == {
        (x, round(y / DEG_PER_HR, 9)) for x, y in expected
    }
    assert {t.text for t in items(panel, Text)} == {"N", "0.664 B", "K"}
    low, high = panel.y_limits
    assert all(low < t.y < high for t in items(panel, Text))


def test_letters_stand_on_their_lines(identified):
    for name, panel in panels_of(noise_panels.allan(identified)).items():
        factor = DEG_PER_HR if name.startswith("gyro") else UG
        curves = noise_panels.term_variances(identified.axes[name], np.array([t.x for t in items(panel, Text)]))
        for k, text in enumerate(items(panel, Text)):
            label = "B" if text.text == "0.664 B" else text.text
            assert text.y == pytest.approx(math.sqrt(curves[label][k]) / factor, rel=1e-9)  # rounding


def test_units_of_figures(identified):
    si = panels_of(noise_panels.allan(identified, "accel_x", "si"))["accel_x"]
    sheet = panels_of(noise_panels.allan(identified, "accel_x"))["accel_x"]
    assert "[m/s^2]" in si.y_label
    assert "[ug]" in sheet.y_label
    np.testing.assert_allclose(items(si, Line, "measured")[0].y / UG, items(sheet, Line, "measured")[0].y, rtol=1e-12)
    with pytest.raises(InputError, match="unit: expected 'datasheet' or 'si', got 'SI'"):
        noise_figures.allan_figure(identified, unit="SI")


def test_gyroscopes_left_accelerometers_right(identified):
    six = {}
    for k, name in enumerate(["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]):
        six[name] = cases.axis_noise(name, cases.GYRO if name.startswith("gyro") else cases.ACCEL, seed=k)
    figure = noise_panels.allan(replace(identified, axes=six, refused={}))
    assert [p.title for p in figure.panels] == ["gyro_x", "accel_x", "gyro_y", "accel_y", "gyro_z", "accel_z"]
    assert len(noise_panels.comparison(replace(identified, axes=six)).panels) == 2


def test_a_reading_far_below_the_curve_does_not_flatten_it(identified):
    axis = identified.axes["gyro_x"]
    low = replace(axis, read_off={**axis.read_off, "K_at_3s": 1e-6 * axis.read_off["minimum"]})
    panel = noise_panels.allan(replace(identified, axes={"gyro_x": low})).panels[0]
    assert panel.y_limits[1] / panel.y_limits[0] < 1e5
    assert len(items(panel, Markers)[0].x) == 2


def test_the_ratio_is_one_where_the_model_is_the_truth(identified):
    exact = identified.axes["gyro_y"]
    curve = replace(exact.curve, deviation=exact.fitted(exact.curve.tau))
    figure = noise_panels.ratio(replace(identified, axes={"gyro_y": replace(exact, curve=curve)}))
    (line,) = items(figure.panels[0], Line, "curve over model")
    np.testing.assert_allclose(line.y, 1.0, rtol=1e-14)  # rounding


def test_the_model_of_the_autocorrelation_knows_the_length_of_the_log(identified):
    """Two Gauss-Markov terms in 3 h: near the textbook form, lower by the variance of the mean, 2 sigma^2 tau / T."""
    lag = np.linspace(0.0, 3000.0, 301)
    figure = noise_spectra.autocorrelation(identified, {"accel_x": (lag, np.zeros(301))})
    (line,) = items(figure.panels[0], Line, "expected of the Gauss-Markov terms")
    assert line.x[0] == 10.0
    pairs = [(s.value / UG, t.value) for s, t in identified.axes["accel_x"].gauss_markov]
    textbook = sum(s**2 * np.exp(-lag[1:] / t) for s, t in pairs)
    lower = sum(2.0 * s**2 * t / cases.LENGTH for s, t in pairs)
    assert line.y[0] == pytest.approx(textbook[0] - lower, rel=0.02)  # terms of the order (tau / T)^2 and lag / T


def test_findings_are_shaded_where_they_are(identified, shown):
    panels = panels_of(noise_spectra.signals(identified, shown["imu"]))
    assert list(panels) == ["gyro_x", "accel_x", "gyro_y", "accel_y", "gyro_z, refused", "accel_z"]
    spans = [(s.start, s.stop) for s in items(panels["gyro_z, refused"], Span)]
    assert (100.0, 6500.0) in spans
    moment = next(s for s in items(panels["gyro_x"], Span) if s.stop != 1800.0)
    assert moment.start < 4000.0 < moment.stop
    line = items(panels["gyro_x"], Line)[0]
    x = shown["imu"].gyro[:, 0]
    assert line.y.max() == pytest.approx((x.max() - x.mean()) / DEG, rel=1e-12)  # no spike is lost
    assert len(line.x) <= content.LIMIT


def test_spectrum_of_white_noise_is_a_level_at_its_density():
    """Mean over 600 s at 100 Hz: statistical, four standard errors of 30000 independent frequencies; two-sided."""
    imu = cases.recording(600.0)
    rng = np.random.default_rng(5)
    imu = replace(imu, gyro=white(1e-4, (len(imu), 3), 0.01, rng))
    for name in ("gyro_x", "gyro_z"):
        f, S = noise_spectra.log_spectra(imu)[name]
        weight = np.diff(f, prepend=0.0)
        assert np.average(S, weights=weight) == pytest.approx(1e-8, rel=4.0 / math.sqrt(30000.0))
        assert np.all(np.diff(f) > 0.0)


def test_spectra_use_the_longest_part_without_a_gap():
    imu = cases.recording(60.0)
    keep = np.r_[0:1000, 2000:6000]
    broken = replace(imu, t=imu.t[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])
    whole = replace(imu, t=imu.t[2000:], gyro=imu.gyro[2000:], accel=imu.accel[2000:])
    np.testing.assert_array_equal(
        noise_spectra.log_spectra(broken)["accel_y"][1], noise_spectra.log_spectra(whole)["accel_y"][1]
    )
    assert noise_spectra.log_spectra(imu.between(50.0, 50.4)) == {}


@pytest.mark.campaign
def test_files_of_all_figures(identified, shown, tmp_path):
    paths = noise_figures.save_noise_figures(identified, tmp_path / "f", ("png", "svg"), **shown)
    assert {p.stem for p in paths} == {"allan", "allan_axes", "allan_ratio", "spectrum", "autocorrelation", "signals"}
    for path in paths:
        assert path.stat().st_size > 8000, path.name
        if path.suffix == ".svg":
            assert ET.parse(path).getroot().tag.endswith("svg")
    again = noise_figures.save_noise_figures(identified, tmp_path / "g", ("svg",), **shown)
    assert all(p.read_bytes() == (tmp_path / "f" / p.name).read_bytes() for p in again)
    nothing = noise_figures.save_noise_figures(replace(identified, axes={}), tmp_path / "h", ("svg",), imu=shown["imu"])
    assert [p.stem for p in nothing] == ["signals"]
    with pytest.raises(InputError, match="expected png, svg or pdf, got 'gif'"):
        noise_figures.save_noise_figures(identified, tmp_path, ("gif",))


def test_own_axes_for_one_axis(identified):
    ax = MplFigure().subplots()
    noise_figures.allan_figure(identified, "gyro_x", ax=ax)
    assert ax.get_xscale() == ax.get_yscale() == "log"
    with pytest.raises(InputError, match="3 panels"):
        noise_figures.allan_figure(identified, ax=MplFigure().subplots())


@pytest.fixture(scope="module")
def logarithmic():
    x = np.array([0.01, 1.0, 100.0])
    inside = (Span(0.1, 1.0, "finding", "f"), Line(x, x, "allan", "a"), Text(10.0, 100.0, "N"))
    return Panel("tau [s]", "y [-]", inside, x_limits=(0.01, 100.0), y_limits=(0.1, 1000.0), log=True, log_x=True)


def test_plotly_gets_exponents_for_ranges_and_words_and_values_for_lines_and_spans(logarithmic):
    drawn = panel_data(Figure("f", "F", "", (logarithmic,)), logarithmic)
    layout = drawn["layout"]
    assert layout["xaxis"]["type"] == layout["yaxis"]["type"] == "log"
    assert layout["xaxis"]["range"] == [-2.0, 2.0]
    assert layout["yaxis"]["range"] == [-1.0, 3.0]
    (word,) = layout["annotations"]
    assert (word["x"], word["y"]) == (1.0, 2.0)
    assert (layout["shapes"][0]["x0"], layout["shapes"][0]["x1"]) == (0.1, 1.0)
    assert drawn["data"][0]["x"] == [0.01, 1.0, 100.0]


def test_matplotlib_draws_them_at_the_same_place(logarithmic):
    (ax,) = draw(Figure("f", "F", "", (logarithmic,))).axes
    assert ax.get_xscale() == "log"
    assert ax.get_xlim() == (0.01, 100.0)
    assert ax.texts[0].xy == (10.0, 100.0)


def test_small_averaging_times_keep_their_digits():
    x = np.geomspace(1e-4, 1e4, 50)
    panel = Panel("x", "y", (Line(x, x, "allan", "a"),), log=True, log_x=True)
    (trace,) = panel_data(Figure("f", "F", "", (panel,)), panel)["data"]
    np.testing.assert_allclose(trace["x"], x, rtol=1e-4)  # printed digits


def test_linear_panels_are_as_they_were():
    panel = Panel("x", "y", (Text(10.0, 100.0, "w"), Line(np.arange(3.0), np.arange(3.0), "allan", "a")))
    layout = panel_data(Figure("f", "F", "", (panel,)), panel)["layout"]
    assert "type" not in layout["xaxis"]
    assert (layout["annotations"][0]["x"], layout["annotations"][0]["y"]) == (10.0, 100.0)


def test_tables_explain_rows_and_escape_cells():
    html = parts.table("c", ("a", "b"), [("x<y", "1\n0 to 2"), ("z", "3")], explained=["why & how", ""])
    page = Page(html)
    assert page.open == []
    assert page.text["th"] == ["a", "b", "x<y", "z"]
    assert page.text["td"] == ["10 to 2", "why & how", "3"]
    with pytest.raises(ValueError, match="argument 2"):
        parts.table("c", ("a",), [("x",)], explained=["one", "two"])


def test_empty_sections_are_left_out():
    sections = [Section("a", "A", ("",)), Section("b", "B", ("", "<p>text</p>"))]
    text = whole_page("t", "k", "s", ["v."], "c", sections, "")
    assert Page(text).text["h2"] == ["B"]
