"""Page and figures on a calibration: complete, self-contained, the same bytes, and the numbers are the result's."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import html_pages
import numpy as np
import pytest
import result_cases as cases
from html_pages import Page
from matplotlib.figure import Figure as MplFigure

from schuler.calibration.design.plans import ATTITUDES, words_of
from schuler.calibration.report import panels as calibration_panels
from schuler.calibration.report.document import calibration_report
from schuler.calibration.report.figures import calibration_figure, next_direction, save_calibration_figures
from schuler.calibration.result.result import CalibrationResult, Residuals, result_from
from schuler.exceptions import InputError
from schuler.plotting.figure import Band, Bars, Line, Markers, Text

pytestmark = pytest.mark.usefixtures("small_script")


@pytest.fixture(scope="module")
def result():
    """Everything there can be, the z scale factor of the accelerometers not determined, poses near the level."""
    full = cases.full()
    C = full.covariance.copy()
    i = full.names.index("M_a_zz")
    C[i, :] = C[:, i] = 0.0
    C[i, i] = np.inf
    residuals = {"accel": cases.residuals(reach=0.1), "gyro": full.residuals["gyro"]}
    return replace(full, covariance=C, residuals=residuals)


@pytest.fixture(scope="module")
def source(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "deep" / "unit.html"
    shown = calibration_report(result, path, title="unit <7>", previous=cases.full(9), recording_summary="a <log>")
    assert shown == path
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source):
    return Page(source)


def test_the_page_is_well_formed_and_complete_and_loads_nothing(page):
    sections = [
        "Parameters", "Residuals", "Directions covered", "Before and after", "Correlations",
        "Change since the previous calibration", "Further results", "Provenance",
    ]  # fmt: skip
    html_pages.check_page(page, "unit <7>: calibration report", sections)
    html_pages.check_figures(page, ["parameters", "residuals", "coverage", "before_after", "correlations"])


def test_texts_of_the_user_are_escaped(source):
    assert "unit <7>" not in source
    assert "<1 rev>" not in source
    assert "a <log>" not in source


def test_the_verdict_stands_first_in_plain_words(page, source):
    assert source.index('id="verdict"') < source.index('id="parameters"')
    message = page.text["p"]
    assert any(
        re.fullmatch(
            r"M_a_zz, scale factor of the z accelerometer, not determined: no pose with z beyond \d+ degrees .*", s
        )
        for s in message
    )
    assert "Next: Put x down, tilted by 30 degrees." in message
    assert "Multiposition calibration: warning, can be used with care." in message


def test_every_parameter_has_both_units_and_one_sigma(result, page):
    cells, heads = page.text["td"], page.text["th"]
    for name in (*result.names, *result.fixed):
        assert any(h.startswith(f"{name}: ") for h in heads), name
    value, sigma = result["b_a_x"]
    mg = 9.80665e-3
    assert f"{value / mg:+.2f} mg± {sigma / mg:.2f}" in cells
    assert f"{value:+.6g} m/s^2± {sigma:.2g}" in cells
    assert "not determined" in cells
    assert "+1.25 msheld" in cells
    assert "2 %" in cells  # 0.001 of 0.05


def test_every_residual_is_in_a_table(result, page):
    heads = page.text["th"]
    for r in result.residuals.values():
        assert all(label in heads for label in r.label)
    assert page.text["summary"] == ["accel: 24 residuals"]
    assert "+0.001" in page.text["td"]


def test_the_change_is_told_in_numbers_and_words(page, result):
    difference = cases.full(9).compare(result)
    assert any(difference.sentences()[0] == s for s in page.text["p"])
    assert difference.changed
    z = difference.z[difference.names.index("b_a_x")]
    assert f"{z:+.1f}" in page.text["td"]


def test_same_input_same_bytes(result, source, tmp_path):
    again = replace(result, provenance={**result.provenance, "elapsed_s": 12.345678})
    path = calibration_report(
        again, tmp_path / "r.html", title="unit <7>", previous=cases.full(9), recording_summary="a <log>"
    )
    assert path.read_text(encoding="utf-8") == source
    assert not re.search(r"\b(nan|inf|NaN|Infinity)\b", Page(source).plain.replace("isNaN", ""))


def test_little_to_show(tmp_path):
    bare = result_from("sixposition", {"b_a_x": (0.0, 0.0), "b_a_y": (1.0, np.inf)}, "lower")
    page = Page(bare.report(tmp_path / "a.html").read_text())
    assert page.open == []
    assert page.text["h2"] == ["Parameters", "Provenance"]
    assert "b_a_y, bias of the y accelerometer, not determined." in page.text["p"]
    good = result_from("sixposition", {"b_a_x": (0.0, 1.0)}, "lower")
    assert "Nothing speaks against this calibration." in Page(good.report(tmp_path / "b.html").read_text()).text["p"]


def test_refused_calibrations_have_a_page(tmp_path):
    names = ("b_a_x", "M_a_zz")
    refused = CalibrationResult("freepose", names, np.zeros(2), np.diag([np.inf, np.inf]), "lower", status="refused",
                                verdicts=("3 poses of at least 9", "b_a_x, M_a_zz not determined"))  # fmt: skip
    page = Page(refused.report(tmp_path / "a.html").read_text())
    assert "Freepose calibration: refused, cannot be used." in page.text["p"]
    assert page.text["p"].count("b_a_x, M_a_zz not determined.") == 1
    assert not any("scale factor of the z" in p for p in page.text["p"])  # said by the method already


def items(panel, kind, label=None):
    return [i for i in panel.items if isinstance(i, kind) and (label is None or i.label == label)]


def test_residuals_stand_on_bars_of_one_and_two_sigma(result):
    panel = calibration_panels.residuals(result).panels[0]
    r = result.residuals["accel"]
    for k in (1.0, 2.0):
        (box,) = items(panel, Band, f"{k:.0f} sigma")
        np.testing.assert_allclose(box.high[::3], k * r.sigma)
        np.testing.assert_allclose(box.low[1::3], -k * r.sigma)
        assert np.isnan(box.low[2::3]).all()
    far = np.abs(r.value) > 3.0 * r.sigma
    (usual,) = items(panel, Markers, "residual")
    np.testing.assert_array_equal(usual.y, r.value[~far])
    assert len(items(panel, Markers, "beyond 3 sigma")) == int(far.any())


def test_parameters_have_their_sigma(result):
    panel = next(
        p for p in calibration_panels.parameters(result).panels if p.title == "scale factors of the accelerometers"
    )
    assert [t.text for t in items(panel, Text)] == ["M_a_xx", "M_a_yy", "M_a_zz"]
    (dots,) = items(panel, Markers, "estimate, 1 sigma")
    np.testing.assert_allclose(dots.y, [1e6 * result[n][0] for n in ("M_a_xx", "M_a_yy")])
    bars = items(panel, Line)[1]
    np.testing.assert_allclose(bars.y[1::3] - bars.y[0::3], [2e6 * result[n][1] for n in ("M_a_xx", "M_a_yy")])
    (lost,) = items(panel, Markers, "not determined")
    np.testing.assert_array_equal((lost.x, lost.y), [[3.0], [0.0]])
    assert len(items(panel, Bars)) == 1


def test_the_map_is_of_equal_area():
    """Closed forms: poles, middle and rim; a strip of latitudes covers sin(lat) of the map, by counting points."""
    x, y = calibration_panels._mollweide(np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 1e-16, 0], [0, 1, 0]]))
    np.testing.assert_allclose(x, [0.0, 0.0, 0.0, np.sqrt(8.0), np.sqrt(2.0)], atol=1e-6)
    np.testing.assert_allclose(y, [np.sqrt(2.0), -np.sqrt(2.0), 0.0, 0.0, 0.0], atol=1e-7)
    v = cases.directions(40_000)
    x, y = calibration_panels._mollweide(v)
    assert ((x / np.sqrt(8.0)) ** 2 + (y / np.sqrt(2.0)) ** 2 <= 1.0 + 1e-12).all()
    # the ellipse inside half of both axes is a quarter of the area: 4 standard errors of counting
    share = np.mean((x / np.sqrt(8.0)) ** 2 + (y / np.sqrt(2.0)) ** 2 < 0.25)
    assert share == pytest.approx(0.25, abs=4.0 * np.sqrt(0.25 * 0.75 / len(v)))


@pytest.mark.parametrize(
    ("poses", "angle"),
    [
        (np.vstack([np.eye(3), -np.eye(3)]), np.arccos(1.0 / np.sqrt(3.0))),  # six faces: the corners of the cube
        (np.array([[0.0, 0.0, 1.0]]), np.pi),
        (np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), np.pi / 2.0),
    ],
)
def test_largest_gap(poses, angle):
    """Closed forms; discretisation: the grid has a point in every 2.5 degrees."""
    gap, where = calibration_panels.largest_gap(poses)
    assert gap == pytest.approx(angle, abs=np.radians(2.5))
    assert np.linalg.norm(where) == pytest.approx(1.0)
    assert np.arccos(np.clip(poses @ where, -1.0, 1.0)).min() == pytest.approx(gap)


def test_histograms_count_every_pose(result):
    (panel,) = calibration_panels.before_after(result).panels  # the gyroscopes have no "before"
    for label in ("before", "after"):
        (steps,) = items(panel, Band, label)
        assert steps.high[::2].sum() == 24.0
    middle = [
        np.average(np.log10(s.x), weights=s.high) for s in (items(panel, Band, n)[0] for n in ("after", "before"))
    ]
    assert middle[1] - middle[0] > 1.0  # 2e-3 against 0.1


def test_perfect_data_can_be_drawn():
    """Residuals that are zero have no logarithm."""
    r = Residuals(("a", "b"), np.zeros(2), np.zeros(2), "m/s^2", np.zeros(2), np.eye(3)[:2])
    perfect = result_from("m", {"b_a_x": (0.0, 0.0)}, "full", residuals={"accel": r})
    (panel,) = calibration_panels.before_after(perfect).panels
    assert items(panel, Band, "after")[0].high[::2].sum() == 2.0
    calibration_figure(perfect).draw_without_rendering()
    assert "rms 0 m/s^2" in perfect.summary()


def test_one_figure_or_all(result):
    whole = result.plot()
    assert len([ax for ax in whole.axes if ax.get_visible()]) == sum(
        len(f.panels) for f in calibration_panels.all_figures(result)
    )
    ax = MplFigure().subplots()
    calibration_figure(result, "coverage", ax=ax)
    assert ax.get_aspect() == 1.0
    with pytest.raises(InputError, match=r"expected one of what this result has \(parameters\), got 'coverage'"):
        result_from("m", {"b_a_x": (0.0, 1.0)}, "full").plot(which="coverage")
    nothing = CalibrationResult("m", (), np.empty(0), np.empty((0, 0)), "full")
    with pytest.raises(InputError, match="expected parameters or residuals to draw"):
        nothing.plot()


@pytest.mark.parametrize("direction", ATTITUDES, ids=words_of)
def test_the_next_pose_is_drawn_as_it_is_said(direction):
    """ "z up" is in the words of an edge, too."""
    message = result_from("m", {"b_a_x": (0.0, 1.0)}, "full", next_pose=f"put the unit with {words_of(direction)}")
    np.testing.assert_array_equal(next_direction(message), direction)


def test_advice_on_other_things_is_not_drawn():
    assert next_direction(result_from("m", {"b_a_x": (0.0, 1.0)}, "full", next_pose="heat it")) is None


@pytest.mark.campaign
def test_files_of_all_figures(result, tmp_path):
    paths = save_calibration_figures(result, tmp_path / "f", ("svg",))
    assert [p.stem for p in paths] == ["residuals", "coverage", "before_after", "parameters", "next_pose"]
    for path in paths:
        assert ET.parse(path).getroot().tag.endswith("svg")
    again = save_calibration_figures(result, tmp_path / "g", ("svg",))
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(paths, again, strict=True))
    with pytest.raises(InputError, match="expected png, svg or pdf, got 'gif'"):
        save_calibration_figures(result, tmp_path, ("gif",))
