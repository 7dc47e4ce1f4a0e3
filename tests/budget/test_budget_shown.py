"""Figures and the page of a budget: everything is there, nothing is lost, nothing is fetched."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.budget import budget_of, choose_imu, error_budget, linear_covariance, requirement
from schuler.budget.report import budget_report, role_of, whose
from schuler.sensors.catalogue import spec

#: Seconds to compile the replays by axis; tests/cli/test_budget.py opens a page and its figures in every run.
pytestmark = pytest.mark.campaign

IMU = "MTi-G-710"


@pytest.fixture(scope="module")
def both(mission):
    """Covariance and budget of an IMU with every kind of error the catalogue has, asymmetry and nonlinearity."""
    result = linear_covariance(replace(mission, asymmetry=1e-4, quadratic=1e-6), spec(IMU), by_axis=True)
    return result, budget_of(result, "horizontal", 149.0)


def bars(figure):
    """Names and lengths of the bars of a figure."""
    axes = figure.axes[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    return dict(zip(names, [line.get_xdata()[1] for line in axes.lines if len(line.get_xdata()) == 2], strict=True))


def test_replays_run_as_they_were_prepared(both):
    """One version of each kernel: of types that were not prepared, a first budget would compile them twice."""
    from schuler.budget import _replay_kernels as k

    for kernel in (k.replay_filter, k.replay_covariance, k.replay_columns):
        assert len(kernel.signatures) == 1, kernel.__name__


def test_every_parameter_has_a_bar(both):
    """With the total; squares of the bars add up to it: rounding."""
    budget = both[1]
    shown = bars(budget.plot(single=True))
    total = shown.pop("all")
    assert len(shown) > 48
    assert set(shown) <= set(budget.names)
    assert {"gyro_noise_x", "gyro_noise_y", "gyro_noise_z", "accel_asymmetry_x", "accel_quadratic_z"} <= set(shown)
    assert_allclose(np.sqrt(sum(v**2 for v in shown.values())), total, rtol=1e-9)
    by_group = bars(budget.plot())
    assert_allclose(np.sqrt(sum(v**2 for v in by_group.values()) - total**2), total, rtol=1e-9)


def test_what_is_too_small_is_one_bar(both):
    """Of twice as many sources the smallest share one bar, and squares still add up."""
    budget = both[1]
    twice = replace(
        budget, names=(*budget.names, *(f"{n}_again" for n in budget.names)), groups=budget.groups * 2,
        contribution=np.tile(budget.contribution, 2), total=budget.total * np.sqrt(2.0),
    )  # fmt: skip
    shown = bars(twice.plot(single=True))
    total = shown.pop("all")
    assert len(shown) == 61
    assert any(name.endswith("smaller ones") for name in shown)
    assert_allclose(np.sqrt(sum(v**2 for v in shown.values())), total, rtol=1e-9)


def test_whose_errors_groups_are(both):
    assert {whose(g) for g in both[1].groups} == {"gyroscope", "accelerometer", "start", "measurements"}
    assert role_of("accelerometer noise") == role_of("accelerometer asymmetry") != role_of("gyroscope noise")


def test_page(mission, both, tmp_path):
    wanted = requirement("horizontal < 10 m @ 60 s outage")
    choice = choose_imu(mission, wanted, [spec(IMU), spec("LN-200")], explain=(IMU,))
    made_from = {"imu": {IMU: spec(IMU).to_dict()}}
    path = budget_report(tmp_path / "a.html", mission, [both], [choice], made_from)
    text = path.read_text(encoding="utf-8")
    assert "0 of 2 IMUs pass, 1 unknown" in text
    assert "limited by gyroscope noise" in text
    assert all(f'<th scope="row">{name}</th>' in text for name in both[1].by_source())
    assert f'<th scope="row">all</th><td class="n">{both[1].total:.3g}' in text
    assert not re.search(r'(src|href)="(?!#|data:)', text.split("<script>")[0])
    again = budget_report(tmp_path / "b.html", mission, [both], [choice], made_from)
    assert again.read_bytes() == path.read_bytes()
    # the ranking is drawn
    small = budget_report(tmp_path / "c.html", mission, [], [choice])
    assert "Which IMU is good enough" in small.read_text(encoding="utf-8")
    assert small.stat().st_size < 700_000


def test_page_says_what_the_filter_believes(mission, tmp_path):
    """33 states know all of this IMU but g-sensitivity; 9 states nothing."""
    for states, stated in ((33, "knows it"), (9, "believes")):
        result = linear_covariance(mission, spec("yaman-automotive"), states=states, by_axis=True)
        path = budget_report(tmp_path / "p.html", mission, [(result, budget_of(result))])
        assert re.search(rf"filter of {result.states} states {stated}", path.read_text(encoding="utf-8"))


def test_a_budget_has_every_parameter(mission):
    """``error_budget`` splits noise by axis; table, JSON and CSV have them all."""
    budget = error_budget(mission, spec(IMU), time=149.0, angles="triad")
    assert "gyro_misalignment_x" in budget.names
    assert "gyro_noise_x" in budget.by_source()
    assert set(budget.to_dict()["by_source"]) == set(budget.names)
    assert budget.table(single=True).column("source") == [*budget.by_source(), "all"]
    assert_allclose(np.linalg.norm(list(budget.by_source().values())), budget.total, rtol=1e-12)
