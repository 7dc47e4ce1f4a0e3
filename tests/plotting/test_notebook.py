"""Results in a notebook: one short line as text, a table and a picture as HTML."""

import dataclasses
import importlib
import inspect
import pickle
import pkgutil
import re

import figure_cases as cases
import noise_cases
import numpy as np
import pytest
import result_cases

import schuler
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Panel, line
from schuler.plotting.notebook import Abridged, card
from schuler.plotting.table import ResultTable
from schuler.sensors.catalogue import spec


@dataclasses.dataclass(repr=False)
class Sample(Abridged):
    bias: np.ndarray
    rows: np.ndarray
    name: str


def kinds():
    log = cases.short_log()
    noise = noise_cases.identification()
    table = ResultTable("a table", ("x_m",), tuple((float(k),) for k in range(40)))
    return [log, log.imu, log.gnss, spec("VN-100"), noise, noise.axes["gyro_x"], result_cases.full(), table]


@pytest.fixture(scope="module")
def results(full):
    return [*kinds(), full.truth, full.result, full.smoothed, full.result.innovations]


def test_every_result_is_one_short_line(results):
    for result in results:
        line_of = repr(result)
        assert line_of.startswith(f"<{type(result).__name__}: ")
        assert len(line_of) < 250
        assert "\n" not in line_of
        assert "array(" not in line_of


def test_data_of_arrays_are_one_line_with_their_shapes():
    assert repr(Sample(np.zeros(3), np.zeros((1000, 3)), "x" * 500)) == (
        "Sample(bias=[0., 0., 0.], rows=<float64, shape (1000, 3)>, name='" + "x" * 76 + "...)"
    )


def test_no_public_class_of_arrays_prints_them():
    for package in pkgutil.iter_modules(schuler.__path__):
        if not package.ispkg or package.name in {"reproduce", "cli"}:
            continue
        room = importlib.import_module(f"schuler.{package.name}")
        for name in room.__all__:
            kind = getattr(room, name)
            if inspect.isclass(kind) and dataclasses.is_dataclass(kind):
                arrays = [f.name for f in dataclasses.fields(kind) if "Array" in str(f.type)]
                code = getattr(inspect.unwrap(kind.__repr__), "__code__", None)
                made_by_dataclass = code is not None and code.co_filename == "<string>"
                assert not (arrays and made_by_dataclass), f"{package.name}.{name}: {arrays}"


@pytest.mark.campaign
def test_results_show_a_table_and_a_picture(results):
    for result in results:
        html = result._repr_html_()
        text = re.sub(r"<[^>]*>", " ", html)
        assert len(text) < 4000
        if hasattr(result, "plot"):
            assert html.count('src="data:image/png;base64,iVBOR') == 1
            assert len(html) < 300_000
        rows = html.count("<tr>")
        assert rows <= 16  # heads, fourteen rows, and how many more there are


def test_a_card_escapes_what_it_is_given():
    html = card("<b>", ("<i>",), (("</table>",),))
    assert html.count("<b>") == 1  # its own
    assert "&lt;/table&gt;" in html


def test_a_figure_shows_itself_without_a_magic_command_and_can_be_pickled():
    x = np.arange(10.0)
    figure = draw(Figure("f", "F", "f", (Panel("x [m]", "y [m]", (line(x, x, "filtered"),)),)))
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(figure))._repr_png_().startswith(b"\x89PNG")


def test_a_result_with_nothing_to_draw_shows_its_table(full, monkeypatch):
    from schuler.exceptions import MissingExtraError

    def missing(*_, **__):
        raise MissingExtraError("matplotlib", "plot", "drawing figures")

    monkeypatch.setattr("schuler.navigation.report.figures.draw", missing)
    html = full.result._repr_html_()
    assert "<img" not in html
    assert "verdict: " in html
