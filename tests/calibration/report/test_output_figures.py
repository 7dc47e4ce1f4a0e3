"""Figure of sensor output before and after: means are means, errors are against truth, what is taken out adds up."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.report.output_figures import output_figure, outputs
from schuler.exceptions import InputError
from schuler.plotting.figure import Line
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.units import DEG, MG

ERRORS = ImuErrors(
    b_a=np.array([20.0, 0.0, -50.0]) * MG,
    M_a=np.diag([0.01, -0.02, 0.0]),
    b_g=np.array([0.5, -1.0, 0.0]) * DEG,
)


def logs(kind: str = "rate") -> tuple[ImuSeries, ImuSeries]:
    """As read, and true: ten seconds level, ten with x up, at 50 Hz; the axes that matter see 0 or 1 g."""
    n = 1000
    f = np.where(np.arange(n)[:, None] < n // 2, [0.0, 0.0, -10.0], [10.0, 0.0, 0.0])
    omega = np.zeros((n, 3))
    h = 0.02 if kind == "increment" else 1.0
    t = 100.0 + 0.02 * np.arange(1, n + 1)
    truth = ImuSeries(t, omega * h, f * h, kind)
    read = replace(
        truth, accel=h * (f @ (np.eye(3) + ERRORS.M_a).T + ERRORS.b_a), gyro=h * (omega + ERRORS.b_g)
    )  # fmt: skip
    return read, truth


def only(panel, label):
    (item,) = [i for i in panel.items if isinstance(i, Line) and i.label == label]
    return item


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_errors_in_closed_form(kind):
    """x level: 20 mg; x up: 20 mg and 1 % of 10 m/s^2. Rounding."""
    before, truth = logs(kind)
    figure = outputs(before, truth, truth=truth, mean_s=2.0)
    output, errors = figure.panels[:2]
    first, last = 20.0, 20.0 + 0.1 / MG
    np.testing.assert_allclose(only(errors, "before").y, [first] * 5 + [last] * 5, rtol=1e-9)
    np.testing.assert_allclose(only(errors, "after").y, np.zeros(10), atol=1e-9)
    np.testing.assert_allclose(only(output, "true").y, [0.0] * 5 + [10.0] * 5, atol=1e-9)
    np.testing.assert_allclose(only(output, "before").x, 100.0 + 1.01 + 2.0 * np.arange(10), rtol=1e-12)
    rms = np.sqrt(0.5 * (first**2 + last**2))
    assert errors.title.startswith(f"x: rms {rms:.1f} mg before, ")  # printed digits
    low, high = errors.y_limits
    assert low < 0.0 < last < high


def test_without_truth_it_is_what_was_taken_out():
    before, truth = logs()
    figure = outputs(before, truth, "gyro", mean_s=1.0)
    assert len(figure.panels) == 6
    for i, rate in enumerate((0.5, -1.0, 0.0)):
        taken = figure.panels[2 * i + 1]
        np.testing.assert_allclose(only(taken, "before less after").y, np.full(20, rate), atol=1e-12)
        assert "taken out" in taken.title
        assert not [item for item in figure.panels[2 * i].items if item.label == "true"]
    assert figure.panels[0].y_label == "[deg/s]"


def test_noise_is_averaged():
    """Means over a second of 50 samples: a seventh of it. Statistical, 60 means of three axes, 5 standard errors."""
    before, truth = logs()
    noisy = replace(truth, accel=truth.accel + 0.1 * np.random.default_rng(2).standard_normal(truth.accel.shape))
    figure = outputs(before, noisy, truth=truth, mean_s=1.0)
    after = np.concatenate([only(panel, "after").y for panel in figure.panels[1::2]]) * MG
    assert np.sqrt(np.mean(after**2)) == pytest.approx(0.1 / np.sqrt(50.0), rel=5.0 * np.sqrt(0.5 / 60.0))


def test_logs_that_do_not_belong_together():
    before, truth = logs()
    with pytest.raises(InputError, match="after: expected the samples of the log before, 1000 of them, got 501"):
        output_figure(before, truth.between(100.0, 110.02))
    with pytest.raises(InputError, match="truth: expected the samples of the log before"):
        output_figure(before, truth, truth=truth.shifted(0.01))
    with pytest.raises(InputError, match="mean_s: expected two stretches or more"):
        output_figure(before, truth, mean_s=15.0)
    with pytest.raises(InputError, match="mean_s: expected a positive time"):
        output_figure(before, truth, mean_s=0.0)
    with pytest.raises(InputError, match="triad: expected accel or gyro, got 'baro'"):
        output_figure(before, truth, "baro")
