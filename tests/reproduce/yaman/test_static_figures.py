"""Figure of the static test: curves are those of the table, a unit can be shown by itself."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.plotting.figure import Band, Line
from schuler.reproduce.yaman.study.figures import drift
from schuler.reproduce.yaman.study.runs import FieldJob
from schuler.reproduce.yaman.study.static import StaticDrift
from schuler.reproduce.yaman.study.static_unit import VARIANTS, StaticJob
from schuler.sensors import catalogue

LABELS = {"raw": "raw", "gyro": "gyroscopes calibrated", "full": "calibrated"}
T = np.arange(0.0, 61.0)


@pytest.fixture(scope="module")
def drift_test() -> StaticDrift:
    """Made up: units drift as t squared, each variant a hundredth of the one before; numbers 0, 2 and 5 of five."""
    size = np.array([1.0, 2.0, 4.0])[:, None] * np.array([1.0, 1e-2, 1e-4])
    way = np.array([3.0, 4.0, 12.0])
    error = size[:, :, None, None] * (T**2)[:, None] * way
    covariance = np.einsum("k,ij->kij", T**4, np.diag([9e-8, 16e-8, 144e-8])) * np.ones((3, 1, 1, 1))
    job = StaticJob(FieldJob(catalogue.spec("MPU-6000")))
    return StaticDrift(job, np.array([0, 2, 5]), T, error, covariance)


def only(panel, kind, label):
    (item,) = [i for i in panel.items if isinstance(i, kind) and i.label == label]
    return item


def test_medians_and_quartiles_are_those_of_the_table(drift_test):
    figure = drift(drift_test)
    for panel, part in zip(figure.panels, ("horizontal", "vertical"), strict=True):
        table = drift_test.curves(part)
        columns = {name: np.array([row[i] for row in table.rows])[1:] for i, name in enumerate(table.columns)}
        bands = [i for i in panel.items if isinstance(i, Band)]
        for variant, band in zip(VARIANTS, bands, strict=True):
            curve = only(panel, Line, LABELS[variant])
            np.testing.assert_array_equal(curve.x, T[1:])  # zero has no logarithm
            np.testing.assert_allclose(curve.y, np.maximum(columns[f"{variant}_median_m"], 1e-3))
            np.testing.assert_allclose(band.low, np.maximum(columns[f"{variant}_quarter_m"], 1e-3))
            np.testing.assert_allclose(band.high, np.maximum(columns[f"{variant}_three_quarters_m"], 1e-3))
        predicted = only(panel, Line, "predicted for calibrated, RMS")
        np.testing.assert_allclose(predicted.y, np.maximum(columns["full_claimed_m"], 1e-3))
        assert panel.log


def test_closed_form_at_the_end(drift_test):
    """sqrt(3^2 + 4^2) t^2 and 12 t^2, of the unit in the middle; predictions 3e-4 and 4e-4, 12e-4 times t^2."""
    horizontal, vertical = drift(drift_test).panels
    assert only(horizontal, Line, "raw").y[-1] == pytest.approx(2.0 * 5.0 * 3600.0)
    assert only(vertical, Line, "calibrated").y[-1] == pytest.approx(2.0 * 12.0 * 0.36)
    assert only(horizontal, Line, "predicted for calibrated, RMS").y[-1] == pytest.approx(5e-4 * 3600.0)
    assert only(vertical, Line, "predicted for calibrated, RMS").y[-1] == pytest.approx(12e-4 * 3600.0)
    assert horizontal.title == "horizontal: 36000 / 360 / 3.60 m after 60 s"


def test_one_unit_by_itself(drift_test):
    figure = drift(drift_test, 5)
    assert "unit 5" in figure.title
    for panel, factor in zip(figure.panels, (5.0, 12.0), strict=True):
        assert not [i for i in panel.items if isinstance(i, Band)]
        assert only(panel, Line, "raw").y[-1] == pytest.approx(4.0 * factor * 3600.0)
    with pytest.raises(InputError, match=r"unit: expected one of 0, 2, 5, got 1"):
        drift_test.plot(unit=1)
