"""Figures of a field campaign: columns are the runs, curves what is claimed, marks what is left."""

import numpy as np
import pytest
from matplotlib.figure import Figure as MplFigure

from schuler.exceptions import InputError
from schuler.plotting.figure import Band, Line, Markers
from schuler.reproduce.yaman.study import campaign_figures as figures
from schuler.reproduce.yaman.study.runs import FieldJob
from schuler.reproduce.yaman.study.statistics import FieldCampaign
from schuler.reproduce.yaman.study.tables import printed_unit, published
from schuler.sensors import catalogue
from schuler.units import MG

NAMES = ("b_a_x", "M_a_xx", "M_g_xy", "G_g_zz")
RUNS = 400


def campaign(grade: str = "yaman-automotive", names=NAMES, claim: float = 1.0) -> FieldCampaign:
    """Made up: normal errors of the sizes of the source's tables, covariances ``claim`` squared times the true ones.

    Runs claim different sigmas, half of them 0.8 and half 1.2 of the mean.
    """
    rng = np.random.default_rng(5)
    prior = np.array([published("yaman-automotive", n)[1] for n in names])
    wide = np.where(np.arange(RUNS) % 2, 1.2, 0.8)[:, None] * prior / 100.0
    modelled = prior * rng.standard_normal((RUNS, len(names)))
    residual = wide * rng.standard_normal((RUNS, len(names)))
    covariance = np.einsum("ki,ij->kij", (claim * wide) ** 2, np.eye(len(names)))
    return FieldCampaign(
        FieldJob(catalogue.spec(grade)), names, np.arange(RUNS), modelled, modelled + residual, covariance, prior,
        np.full(RUNS, 3), ("ok",) * RUNS, {},
    )  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return campaign()


def only(panel, kind, label=None):
    (item,) = [i for i in panel.items if isinstance(i, kind) and (label is None or i.label == label)]
    return item


@pytest.mark.parametrize("which", ["residual", "modelled", "normalised"])
def test_every_run_is_in_a_column(result, which):
    """The area of the columns is that of all runs; rounding."""
    for name, panel in zip(NAMES, figures.histograms(result, which, NAMES, 12).panels, strict=True):
        columns = only(panel, Band)
        assert np.trapezoid(columns.high, columns.x) == pytest.approx(RUNS * (columns.x[-1] - columns.x[0]) / 12.0)
        values = {"residual": result.residual, "modelled": result.modelled, "normalised": result.normalised}[which]
        factor = 1.0 if which == "normalised" else printed_unit(name)[1]
        x = values[:, result.column(name)] / factor
        assert (columns.x[0], columns.x[-1]) == pytest.approx((x.min(), x.max()))
        outline = only(panel, Line, "runs")
        np.testing.assert_array_equal(outline.y, columns.high)
        assert panel.title.startswith(f"{name}: ")


def test_columns_stand_where_the_histogram_has_them(result):
    (panel,) = figures.histograms(result, "residual", ["b_a_x"], 10).panels
    h = result.histogram("b_a_x", 10)
    columns = only(panel, Band)
    np.testing.assert_array_equal(columns.high[1:-1:2], h.residual_count)
    np.testing.assert_array_equal(columns.x[::2], h.residual_edges)
    assert panel.x_label == "[mg]"
    mean, sigma = result.residual[:, 0].mean() / MG, result.residual[:, 0].std(ddof=1) / MG
    text = panel.title.removeprefix("b_a_x: ").removesuffix(" mg").split(" ± ")
    # printed digits: three
    assert [float(v) for v in text] == pytest.approx([mean, sigma], rel=0.01, abs=5e-4)


@pytest.mark.parametrize(("which", "label"), [("residual", "as claimed"), ("modelled", "as specified")])
def test_the_curve_is_what_is_claimed(result, which, label):
    """In closed form at the middle: the mean of 1 / (sqrt(2 pi) sigma) over the runs, times runs and bin width."""
    (panel,) = figures.histograms(result, which, ["M_a_xx"], 20).panels
    curve = only(panel, Line, label)
    sigma = result.sigma[:, 1] if which == "residual" else result.prior_sigma[1:2]
    columns = only(panel, Band)
    width = (columns.x[-1] - columns.x[0]) / 20.0
    middle = len(curve.y) // 2
    assert curve.x[middle] == pytest.approx(0.0, abs=1e-9)
    density = np.mean(1.0 / (np.sqrt(2.0 * np.pi) * sigma / printed_unit("M_a_xx")[1]))
    assert curve.y[middle] == pytest.approx(RUNS * width * density)
    # discretisation and the tails beyond the largest run: under the curve are all runs
    assert np.trapezoid(curve.y, curve.x) == pytest.approx(RUNS * width, rel=0.02)


def test_a_true_claim_fits_and_a_false_one_does_not(result):
    """Statistical: chi-square of the columns about the curve, 20 bins, 5 standard deviations."""

    def misfit(one: FieldCampaign) -> float:
        (panel,) = figures.histograms(one, "normalised", ["M_g_xy"], 20).panels
        columns, curve = only(panel, Band), only(panel, Line, "standard normal")
        centre = 0.5 * (columns.x[::2][1:] + columns.x[::2][:-1])
        expected = np.interp(centre, curve.x, curve.y)
        counted = columns.high[1:-1:2]
        return float(np.sum((counted - expected) ** 2 / np.maximum(expected, 1.0)))

    assert misfit(result) < 20.0 + 5.0 * np.sqrt(40.0)
    assert misfit(campaign(claim=0.5)) > 20.0 + 5.0 * np.sqrt(40.0)


def test_what_is_left_beside_the_claim_and_the_source(result):
    (panel,) = figures.left(result, NAMES).panels
    rows = {name: y for y, name in panel.y_ticks}
    assert list(rows) == list(NAMES[::-1])  # the first name is on top
    assert rows["b_a_x"] == 3.0
    for label, expected in (
        ("400 runs", lambda i, _: result.residual[:, i].std(ddof=1) / result.modelled[:, i].std(ddof=1)),
        ("claimed", lambda i, _: np.median(result.sigma[:, i]) / result.prior_sigma[i]),
        ("Yaman (2017)", lambda _, n: published("yaman-automotive", n)[3] / published("yaman-automotive", n)[1]),
    ):
        marks = only(panel, Markers, label)
        at = {round(y): x for x, y in zip(marks.x, marks.y, strict=True)}
        for i, name in enumerate(NAMES):
            assert at[int(rows[name])] == pytest.approx(100.0 * expected(i, name)), (label, name)
    assert panel.log_x


def test_a_unit_the_source_does_not_have(result):
    (panel,) = figures.left(campaign("MPU-6000"), NAMES).panels
    assert {i.label for i in panel.items} == {"claimed", "400 runs"}


def test_figures_by_name(result):
    drawn = result.plot()
    assert isinstance(drawn, MplFigure)
    assert len([ax for ax in drawn.axes if ax.get_visible()]) == 4
    some = result.plot("modelled", names=["M_a_xx", "b_a_x"], bins=7)
    assert [ax.get_title("left").partition(":")[0] for ax in some.axes] == ["M_a_xx", "b_a_x"]
    result.plot("left").draw_without_rendering()
    result.plot("normalised").draw_without_rendering()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"which": "sigma"}, "which: expected residual, modelled, normalised or left, got 'sigma'"),
        ({"names": ["b_a_w"]}, "name: expected one of b_a_x"),
        ({"names": []}, "names: expected one parameter or more"),
        ({"bins": 0}, "bins: expected a positive number, got 0"),
    ],
)
def test_what_cannot_be_drawn(result, options, message):
    with pytest.raises(InputError, match=message):
        result.plot(**options)
