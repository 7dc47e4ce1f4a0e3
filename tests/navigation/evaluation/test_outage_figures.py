"""Figures of comparisons: what is drawn, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation.evaluation.architectures import Comparison, ComparisonRow
from schuler.navigation.evaluation.consistency import Separation
from schuler.navigation.evaluation.errors import TrajectoryErrors
from schuler.navigation.evaluation.figures import architectures, fan, separation
from schuler.navigation.evaluation.modes import Mode
from schuler.navigation.evaluation.outages import OutageStatistics
from schuler.plotting.drawing import save
from schuler.plotting.figure import Band, Line, Span


@pytest.fixture
def statistics():
    rng = np.random.default_rng(1)
    age = np.arange(31.0)
    error = rng.standard_normal((100, 1, 3)) * (0.1 + age[None, :, None] ** 2 / 100.0)
    cov = np.einsum("k,ij->kij", (0.1 + age**2 / 100.0) ** 2, np.eye(3))
    return OutageStatistics(np.array([30.0]), np.arange(100.0), age, error, np.tile(cov, (100, 1, 1, 1)), "drive")


@pytest.fixture
def comparison():
    t = 1000.0 + np.arange(0.0, 100.0, 0.1)

    def row(coupling, size):
        e = np.zeros((len(t), 3))
        e[:, 0] = size * (1.0 + np.sin(t))
        return ComparisonRow(Mode(coupling), "one", {}, errors=TrajectoryErrors(t, e))

    rows = (row("ins", 100.0), row("loose", 1.0), ComparisonRow(Mode("tight"), "one", {}, "no ranges"))
    return Comparison("drive", "truth", rows, {"one": ((20.0, 40.0),)}, start=1000.0)


@pytest.mark.campaign
def test_fan_has_the_claim_the_mean_and_not_too_many_lines(statistics, tmp_path):
    figure = fan(statistics)
    assert len(figure.panels) == 4
    north = figure.panels[0].items
    band = next(i for i in north if isinstance(i, Band))
    np.testing.assert_allclose(band.high, 3.0 * (0.1 + statistics.age**2 / 100.0))
    single = [i for i in north if isinstance(i, Line) and i.role == "term"]
    assert 30 <= len(single) <= 40
    assert [s.label for s in single if s.label] == ["single outages"]
    rms, claimed = figure.panels[3].items[-2:]
    np.testing.assert_allclose(claimed.y, np.sqrt(2.0) * (0.1 + statistics.age**2 / 100.0))
    assert 0.8 < rms.y[-1] / claimed.y[-1] < 1.2
    assert all(p.stat().st_size > 1000 for p in save(statistics.plot(), tmp_path / "fan", ["png", "svg"]))


def test_architectures_share_one_scale(comparison, tmp_path):
    figure = architectures(comparison)
    assert [p.title for p in figure.panels] == ["ins", "loose"]  # none for the one that failed
    assert len({p.y_limits for p in figure.panels}) == 1
    span = next(i for i in figure.panels[0].items if isinstance(i, Span))
    assert (span.start, span.stop) == (20.0, 40.0)
    curve = figure.panels[1].items[-1]
    assert curve.x.min() == pytest.approx(0.0)
    assert save(comparison.plot("one"), tmp_path / "c", ["png"])[0].stat().st_size > 1000


def test_separation_counts_what_is_inside(tmp_path):
    t = 5.0 + np.arange(200.0)
    d = np.zeros((200, 9))
    d[:, 6:] = np.random.default_rng(1).uniform(-2.9, 2.9, (200, 3))
    d[:20, 6] = 10.0
    apart = Separation(t, d, np.tile(np.eye(9), (200, 1, 1)), ((50.0, 60.0),))
    figure = separation(apart)
    assert figure.panels[0].title == "inside ±3 sigma: 90.0 %"
    assert figure.panels[2].title == "inside ±3 sigma: 100.0 %"
    span = next(i for i in figure.panels[0].items if isinstance(i, Span))
    assert (span.start, span.stop) == (45.0, 55.0)
    assert save(apart.plot(), tmp_path / "s", ["svg"])[0].stat().st_size > 1000


def test_empty_figures_are_refused(statistics, comparison):
    with pytest.raises(InputError, match="no outage"):
        fan(replace(statistics, starts=np.empty(0), error_n=np.empty((0, 31, 3)), cov_n=np.empty((0, 31, 3, 3))))
    with pytest.raises(InputError, match="expected one of one, got 'two'"):
        architectures(comparison, "two")
    with pytest.raises(InputError, match="no architecture has a solution"):
        architectures(replace(comparison, rows=comparison.rows[2:]))
