"""Every figure function: units on the axes, drawn into given axes, JSON for the page, roles kept apart in grey.

What each figure shows is tested beside it; here all of them are held to one style.
"""

# ruff: noqa: E501 (a table of dotted names)

import ast
import json
import re
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import figure_cases as cases
import numpy as np
import pytest
from matplotlib.figure import Figure as MplFigure

import schuler
from schuler.exceptions import InputError
from schuler.plotting import figure as content
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Bars, Figure, Line, Markers, Panel, Span, Text
from schuler.plotting.interactive import panel_data
from schuler.plotting.style import STYLES

#: What a function returns that makes figures.
FIGURE = re.compile(r"(content\.|Mpl)?Figure( \| None)?|(list\[|dict\[str, )(content\.|Mpl)?Figure\]")
PACKAGE = Path(schuler.__file__).parent


NAMES = sorted(cases.cases(lambda name: None))


@pytest.fixture(scope="session")
def made(request):
    """Figures by function, made once."""
    functions, done = cases.cases(request.getfixturevalue), {}

    def of(name: str) -> list[Figure]:
        if name not in done:
            figures = functions[name]()
            done[name] = figures if isinstance(figures, list) else [figures]
        return done[name]

    return of


@cache
def annotated(returns: str) -> set[str]:
    """Public functions of the package whose annotation of what they return says so."""
    result = set()
    for path in PACKAGE.rglob("*.py"):
        if "Figure" not in path.read_text(encoding="utf-8"):
            continue
        name = path.relative_to(PACKAGE).with_suffix("").as_posix().replace("/", ".")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        mpl = "from matplotlib.figure import Figure\n" in path.read_text(encoding="utf-8")
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.returns is not None and not node.name.startswith("_"):
                stated = ast.unparse(node.returns)
                kind = "mpl" if "MplFigure" in stated or (mpl and "content." not in stated) else "content"
                if FIGURE.fullmatch(stated) and kind == returns:
                    result.add(f"{name}.{node.name}")
    return result


def test_no_figure_function_is_left_out():
    """A new one needs a line in figure_cases.py."""
    # what is here, of one run
    gathered = {name for name in annotated("content") if name.startswith("navigation.report.build.")}
    assert annotated("content") - set(NAMES) - gathered == set()
    assert set(NAMES) - annotated("content") == set()
    assert len(NAMES) > 100


#: They give what others do; looked at, but not drawn once more.
_GATHER = (
    "all_figures", "field_panels", "satellite_figures", "overview_content", "calibration_content", "field_content",
)  # fmt: skip
_DRAWN_PANELS = 4  # into given axes


@pytest.mark.thinned(6)
@pytest.mark.parametrize("name", NAMES)
def test_figure(made, name):
    for figure in made(name):
        assert isinstance(figure, Figure)
        assert figure.title
        assert figure.panels
        for panel in figure.panels:
            check_labels(panel, figure.name)
            check_roles(panel, figure.name)
            check_data(figure, panel)
        for entry in figure.legend().values():
            assert entry[1] in STYLES


@pytest.mark.thinned(6)
@pytest.mark.parametrize("name", [name for name in NAMES if not name.endswith(_GATHER)])
def test_figure_in_given_axes(made, name):
    for figure in made(name):
        check_drawn(replace(figure, panels=figure.panels[:_DRAWN_PANELS]))


def check_labels(panel: Panel, name: str) -> None:
    """A unit or [-] on each axis, but where words stand at the ticks, or there is no axis at all."""
    if panel.bare:
        return
    assert "[" in panel.x_label, (name, panel.x_label, panel.title)
    assert "[" in panel.y_label or panel.y_ticks, (name, panel.y_label, panel.title)


def check_roles(panel: Panel, name: str) -> None:
    """Roles with labels of their own can be told apart without colour: by dash, width or symbol."""
    lines = {i.role: i.label for i in panel.items if isinstance(i, Line) and i.label}
    symbols = {i.role: i.label for i in panel.items if isinstance(i, Markers) and i.label}
    if not panel.y_ticks:  # rows have a name each
        for a, b in combinations(lines, 2):
            one, two = STYLES[a], STYLES[b]
            wide = max(one.width, two.width) / min(one.width, two.width)
            assert one.dash != two.dash or wide > 1.15, f"{name}: lines {a} and {b}"
    for a, b in combinations(symbols, 2):
        one, two = STYLES[a], STYLES[b]
        large = max(one.size, two.size) / min(one.size, two.size)
        assert one.symbol != two.symbol or large > 1.15, f"{name}: symbols {a} and {b}"
    # one role stands for one thing, unless a label repeats it from panel to panel
    by_role: dict[tuple[type, str], set[str]] = {}
    for item in panel.items:
        if isinstance(item, Line | Markers | Bars | Span) and item.label:
            by_role.setdefault((type(item), item.role), set()).add(item.label)
    assert all(len(labels) == 1 for labels in by_role.values()), (name, by_role)


def check_data(figure: Figure, panel: Panel) -> None:
    """Valid JSON, without NaN, and something in it."""
    expected_runs = panel_data(figure, panel)
    text = json.dumps(expected_runs, allow_nan=False)
    assert json.loads(text)["layout"]
    assert expected_runs["data"] or panel.bare or any(isinstance(i, Span | Text) for i in panel.items)


def check_drawn(figure: Figure) -> None:
    """Into the axes of the user's own figure, as many as there are panels."""
    own = MplFigure(figsize=(4.0, 2.0 * len(figure.panels)))
    axes = own.subplots(len(figure.panels), 1)
    assert draw(figure, axes) is own
    for ax, panel in zip(np.ravel(axes), figure.panels, strict=True):
        drawn = ax.lines or ax.collections or ax.patches or ax.images or ax.texts
        assert drawn or panel.bare
        assert ax.get_xlabel() == panel.x_label
        assert ax.get_yscale() == ("log" if panel.log else "linear")


@pytest.mark.thinned(6)
@pytest.mark.parametrize("name", NAMES)
def test_figure_of_its_own(made, name):
    """All is laid out on one page, without a warning."""
    for figure in made(name):
        drawn = draw(figure)
        shown = [ax for ax in drawn.axes if ax.get_visible()]
        assert len(shown) == len(figure.panels)


def test_axes_must_be_as_many_as_panels():
    one = Panel("x [-]", "y [-]", (content.line(np.arange(3.0), np.arange(3.0), "filtered"),))
    figure = Figure("two", "Two", "", (one, one))
    own = MplFigure()
    with pytest.raises(InputError, match="two has 2 panels and cannot be drawn into one pair of axes"):
        draw(figure, own.add_subplot())
    with pytest.raises(InputError, match="into 3 pairs of axes"):
        draw(figure, own.subplots(3))
    assert draw(replace(figure, panels=(one,)), own.add_subplot()) is own


#: Functions that draw at once, and the description that they draw: the same for the page.
DRAWN = {
    "recording.figures.log_figure": "recording.figures.log_content",
    "budget.report.budget_figure": "budget.report.budget_content",
    "budget.report.covariance_figure": "budget.report.covariance_content",
    "budget.report.choice_figure": "budget.report.choice_content",
    "calibration.report.figures.calibration_figure": "calibration.report.figures.calibration_content",
    "reproduce.stefanisko.study.deep.figures.overview": "reproduce.stefanisko.study.deep.figures.overview_content",
    "reproduce.stefanisko.study.deep.figures.discriminators": "reproduce.stefanisko.study.deep.figures.discriminators_content",
    "reproduce.yaman.study.campaign_figures.campaign_figure": "reproduce.yaman.study.campaign_figures.campaign_content",
    "reproduce.yaman.study.mode_figures.modes_figure": "reproduce.yaman.study.mode_figures.modes",
    "calibration.report.field_figures.field_figure": "calibration.report.field_figures.field_content",
    "calibration.report.output_figures.output_figure": "calibration.report.output_figures.outputs",
    "reproduce.yaman.study.figures.static_figure": "reproduce.yaman.study.figures.drift",
    "navigation.report.figures.overview": "navigation.report.figures.overview_content",
    "navigation.report.figures.plot_track": "navigation.report.track.track",
    "navigation.report.figures.plot_motion": "navigation.report.track.motion",
    "navigation.report.figures.plot_horizontal_error": "navigation.report.accuracy.horizontal",
    "navigation.report.figures.plot_errors": "navigation.report.accuracy.errors",
    "navigation.report.figures.plot_uncertainty": "navigation.report.accuracy.sigmas",
    "navigation.report.figures.plot_nees": "navigation.report.accuracy.normalised_errors",
    "navigation.report.figures.plot_outages": "navigation.report.outages.outage_figure",
    "navigation.report.figures.plot_parameters": "navigation.report.estimates.parameters",
    "navigation.report.figures.plot_innovations": "navigation.report.innovations.by_component",
    "navigation.report.figures.plot_separation": "navigation.report.accuracy.separation",
    "navigation.report.figures.plot_profile": "navigation.report.track.profile",
    "navigation.report.figures.plot_satellites": "navigation.report.satellites.satellite_figures",
    "navigation.foot.figures.overview": "navigation.foot.figures.overview_content",
    "characterisation.report.figures.allan_figure": "characterisation.report.panels.allan",
    "navigation.evaluation.figures.plot_fan": "navigation.evaluation.figures.fan",
    "navigation.evaluation.figures.plot_comparison": "navigation.evaluation.figures.architectures",
    "navigation.evaluation.figures.plot_separation": "navigation.evaluation.figures.separation",
    "calibration.report.pose_figure.plan_figure": "calibration.report.pose_figure.plan_content",
    "calibration.report.thermal_figure.thermal_figure": "calibration.report.thermal_figure.thermal_content",
}


def test_what_is_drawn_is_described():
    """Nothing is drawn with matplotlib alone: each such function draws one of the descriptions above."""
    assert annotated("mpl") - set(DRAWN) == {"plotting.drawing.draw"}
    assert set(DRAWN) - annotated("mpl") == set()
    assert set(DRAWN.values()) <= set(NAMES)
    for name, described in DRAWN.items():
        module, _, function = name.rpartition(".")
        tree = ast.parse((PACKAGE / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
        (node,) = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function]
        called = {ast.unparse(c.func).rpartition(".")[2] for c in ast.walk(node) if isinstance(c, ast.Call)}
        assert {"draw", described.rpartition(".")[2]} <= called, name


def test_colours_stand_in_one_file():
    """No colour but in style.py: neither codes nor names nor greys; KML and GeoJSON viewers have their own."""
    literal = re.compile(r"""["']\#[0-9a-fA-F]{3,8}["']|\b(?:color|fc|mfc|ec|facecolor|edgecolor)=["'](?!none["'])""")
    apart = {PACKAGE / "plotting" / "style.py", PACKAGE / "recording" / "formats" / "track.py"}
    for path in PACKAGE.rglob("*.py"):
        if path not in apart:
            result = literal.findall(path.read_text(encoding="utf-8"))
            assert not result, f"{path.relative_to(PACKAGE)}: {result[0]}"


def test_colours_are_told_apart_by_the_colour_blind():
    """Roles of lines: those of one colour differ in dash or width; colours are Okabe and Ito's, darkened or greys."""
    families = {look.light for look in STYLES.values()}
    assert len(families) < 40
    for role, look in STYLES.items():
        assert len(look.light) == len(look.dark) == 7, role
        assert 0.0 < look.alpha <= 1.0
