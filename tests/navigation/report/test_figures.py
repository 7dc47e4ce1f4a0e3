"""Files that matplotlib writes: there, not empty, the same each time, and nothing global touched."""

from __future__ import annotations

import builtins
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from schuler.exceptions import InputError, MissingExtraError
from schuler.navigation.report import figures
from schuler.navigation.report.figures import overview, save_figures
from schuler.navigation.report.subject import Subject
from schuler.plotting.drawing import draw


def png_size(path) -> tuple[int, int]:
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


@pytest.fixture(scope="module")
def written(full, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    before = dict.copy(mpl.rcParams)  # asking for the backend in the usual way would choose one
    paths = save_figures(full.result, folder / "new", smoothed=full.smoothed, reference=full.truth, origin=0.0)
    assert dict(dict.items(mpl.rcParams)) == before
    return paths


@pytest.mark.campaign
def test_every_figure_in_both_formats(written):
    names = {p.stem for p in written}
    assert names == {
        "overview", "track", "profile", "motion", "horizontal_error", "position_error", "velocity_error",
        "attitude_error", "nees", "outages", "separation", "parameters_b_a", "parameters_b_g", "innovations_position",
        "innovations_velocity",
    }  # fmt: skip
    assert {(p.stem, p.suffix) for p in written} == {(n, s) for n in names for s in (".png", ".svg")}
    assert all(p.is_file() for p in written)


@pytest.mark.campaign
def test_png_is_of_a_useful_size(written):
    for path in written:
        if path.suffix == ".png":
            width, height = png_size(path)
            assert 900 <= width <= 1600, path.name
            assert 400 <= height <= 2000, path.name
            assert path.stat().st_size > 10_000, path.name


@pytest.mark.campaign
def test_svg_is_xml_with_drawing_and_without_dates(written):
    for path in written:
        if path.suffix == ".svg":
            root = ET.parse(path).getroot()
            assert root.tag == "{http://www.w3.org/2000/svg}svg"
            assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 20, path.name
            assert "<dc:date>" not in path.read_text()
            links = [v for e in root.iter() for k, v in e.attrib.items() if k.endswith("href")]
            assert all(v.startswith("#") for v in links), path.name


@pytest.mark.campaign
def test_same_input_same_bytes(full, tmp_path):
    def once(folder):
        figure = figures.plot_errors(full.result, "dr", reference=full.truth)
        return [p.read_bytes() for p in figures.save(figure, tmp_path / folder / "position", ("png", "svg", "pdf"))]

    assert once("a") == once("b")


def test_own_axes(full):
    mine = Figure()
    FigureCanvasAgg(mine)
    ax = mine.subplots()
    host = figures.plot_horizontal_error(full.result, ax=ax, reference=full.truth)
    assert host is mine
    assert len(ax.lines) == 1
    assert ax.get_xlabel() == "time [s]"
    named = [t.get_text() for t in ax.get_legend().get_texts()]
    assert named == ["GNSS withheld", "filtered, RMS as claimed", "filtered"]


def test_one_function_for_each_figure(full):
    how = {"smoothed": full.smoothed, "reference": full.truth}
    assert len(figures.plot_track(full.result, **how).axes) == 1
    assert len(figures.plot_motion(full.result).axes) == 5
    assert len(figures.plot_errors(full.result, "dpsi", **how).axes) == 3
    assert len(figures.plot_uncertainty(full.result).axes) == 3
    assert len(figures.plot_nees(full.result, **how).axes) == 1
    assert len(figures.plot_outages(full.result, **how).axes) == 2
    assert len(figures.plot_parameters(full.result, "b_g", **how).axes) == 3
    assert len(figures.plot_innovations(full.result, "velocity").axes) == 4


def test_missing_input_of_a_figure_is_an_error(full):
    with pytest.raises(InputError, match="needs a reference"):
        figures.plot_horizontal_error(full.result)
    with pytest.raises(InputError, match="measurements of the kind 'zero_velocity'"):
        figures.plot_innovations(full.result, "zero_velocity")
    with pytest.raises(InputError, match="expected png, svg or pdf"):
        save_figures(full.result, "nowhere", formats=("gif",))
    mine = Figure().subplots()
    with pytest.raises(InputError, match="5 panels"):
        draw(figures.track.motion(Subject(full.result)), mine)


def test_overview_of_the_result_itself(full, make_run):
    assert len(full.result.plot(smoothed=full.smoothed, reference=full.truth).axes) == 4
    assert len(overview(full.result).axes) == 4
    free = make_run(9, gnss=False, outages=())
    assert len(overview(free.result).axes) == 4


def test_missing_matplotlib_names_the_extra(full, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"pip install 'schuler\[plot\]'"):
        overview(full.result)


def test_importing_loads_neither_library_and_drawing_no_pyplot():
    code = (
        "import sys, schuler.navigation.report, schuler.navigation.report.document, schuler.plotting.drawing;"
        "assert 'matplotlib' not in sys.modules and 'plotly' not in sys.modules;"
        "from schuler.plotting.figure import Figure, Panel;"
        "schuler.plotting.drawing.draw(Figure('f', 'F', '', (Panel('x', 'y', ()),)));"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
