"""CalibrationResult: access by name, correlation, apply and inverse, change of gauge with its covariance, text."""

from dataclasses import replace

import numpy as np
import pytest
import result_cases as cases
from places import ROOT

from schuler.calibration.result.parameters import LINEAR, MATRIX_A, imu_errors, in_gauge, vector
from schuler.calibration.result.result import CalibrationResult, Residuals, result_from
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries


def log(kind="rate", n=50):
    rng = np.random.default_rng(4)
    t = 0.01 * np.arange(1, n + 1)
    return ImuSeries(t, rng.standard_normal((n, 3)), 9.0 * rng.standard_normal((n, 3)), kind)


def test_values_by_name():
    result = result_from("sixposition", {"b_a_x": (0.1, 0.01), "M_a_xx": (0.002, 1e-4)}, "full", fixed={"b_g_x": 0.5})
    assert result["b_a_x"] == (0.1, 0.01)
    assert result["b_g_x"] == (0.5, 0.0)
    assert result.parameters == {"b_a_x": 0.1, "M_a_xx": 0.002, "b_g_x": 0.5}
    assert result.errors.b_a[0] == 0.1
    assert result.errors.b_g[0] == 0.5
    assert result.errors.temperature_0 == 25.0
    with pytest.raises(InputError, match="expected one of b_a_x, M_a_xx, b_g_x, got 'b_a_y'"):
        result["b_a_y"]


def test_correlation_is_one_on_the_diagonal_and_zero_where_nothing_is_known():
    C = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.inf]])
    result = CalibrationResult("m", ("b_a_x", "b_a_y", "b_a_z"), np.zeros(3), C, "full")
    np.testing.assert_allclose(result.correlation, [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(result.sigma, [2.0, 1.0, np.inf])


def test_observability_is_what_is_left_of_what_was_known():
    result = result_from("m", {"b_a_x": (0.1, 0.01), "b_a_y": (0.0, np.inf)}, "full",
                         prior_sigma={"b_a_x": 0.1, "b_a_y": 0.1, "b_a_z": 1.0})  # fmt: skip
    assert result.observability == {"b_a_x": pytest.approx(0.1), "b_a_y": np.inf}


@pytest.mark.parametrize("kind", ["rate", "increment"])
@pytest.mark.parametrize("nominal", [(1.0, 1.0), (1.0 / 415.0, 1.0 / 4778.0)])
def test_inverse_undoes_apply(kind, nominal):
    """Rounding: 1e-12 of the largest sample."""
    result = replace(cases.calibration(), nominal=nominal)
    imu = log(kind)
    raw = result.inverse(imu)
    back = result.apply(raw)
    assert back.kind == kind
    np.testing.assert_allclose(back.gyro, imu.gyro, atol=1e-12)
    np.testing.assert_allclose(back.accel, imu.accel, atol=1e-11)
    np.testing.assert_allclose(result.inverse(result.apply(raw)).accel, raw.accel, rtol=1e-11, atol=1e-9)


def test_apply_is_the_model_written_out():
    """One sample by hand: f = (I + M)^-1 (y - b), omega = (I + M_g)^-1 (y - b_g - G f). Rounding."""
    result = cases.calibration()
    e = result.errors
    f, omega = np.array([1.0, -2.0, 9.0]), np.array([0.3, -0.1, 0.2])
    y_a = e.b_a + (np.eye(3) + e.M_a) @ f
    y_g = e.b_g + (np.eye(3) + e.M_g) @ omega + e.G_g @ f
    out = result.apply(ImuSeries(np.array([0.0, 0.01]), np.tile(y_g, (2, 1)), np.tile(y_a, (2, 1))))
    np.testing.assert_allclose(out.accel[0], f, atol=1e-14)
    np.testing.assert_allclose(out.gyro[0], omega, atol=1e-15)


@pytest.mark.parametrize("gauge", ["lower", "upper", "symmetric"])
def test_gauge_keeps_what_the_sensor_reads(gauge):
    result = cases.calibration()
    turned = result.in_gauge(gauge)
    expected = in_gauge(result.errors, gauge)
    assert turned.gauge == gauge
    np.testing.assert_allclose(vector(turned.errors), vector(expected), atol=1e-15)  # rounding
    assert turned.in_gauge(gauge) is turned
    # lengths of what is measured do not know about axes: the same log, calibrated in both gauges
    a, b = result.apply(log()), turned.apply(log())
    np.testing.assert_allclose(np.linalg.norm(a.accel, axis=1), np.linalg.norm(b.accel, axis=1), rtol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(a.gyro, axis=1), np.linalg.norm(b.gyro, axis=1), rtol=1e-13)


@pytest.mark.campaign
@pytest.mark.thinned(3)
@pytest.mark.parametrize("gauge", ["lower", "upper", "symmetric"])
def test_gauge_covariance_is_the_scatter_of_turned_samples(gauge):
    """20 000 draws from the covariance, each turned: mean of d^T C^+ d is the rank, statistical (4 standard errors)."""
    result = cases.calibration(sigma=0.003)
    turned = result.in_gauge(gauge)
    n = 20_000
    draws = np.random.default_rng(5).multivariate_normal(result.values, result.covariance, size=n)
    values = np.array(
        [vector(in_gauge(imu_errors(dict(zip(LINEAR, v, strict=True))), gauge), turned.names) for v in draws[:4000]]
    )
    d = values - turned.values
    s = turned.sigma
    w, V = np.linalg.eigh(turned.covariance / np.outer(s, s))
    keep = w > 1e-9
    assert keep.sum() == len(LINEAR) - 3  # a rotation of the body axes has gone
    y2 = ((d / s) @ V[:, keep]) ** 2 / w[keep]
    total = y2.sum(axis=1)
    assert total.mean() == pytest.approx(keep.sum(), abs=4.0 * np.sqrt(2.0 * keep.sum() / len(total)))
    # and each direction by itself; 5 sigma because there are 30
    assert np.abs(y2.mean(axis=0) - 1.0).max() < 5.0 * np.sqrt(2.0 / len(total))


def test_lower_and_back():
    """lower -> upper -> lower returns values and covariance: rounding of the numerical derivative, 1e-9."""
    lower = cases.calibration().in_gauge("lower")
    back = lower.in_gauge("upper").in_gauge("lower")
    assert back.names == lower.names
    assert back.fixed == lower.fixed == {"M_a_xy": 0.0, "M_a_xz": 0.0, "M_a_yz": 0.0}
    np.testing.assert_allclose(back.values, lower.values, atol=1e-15)
    scale = np.outer(lower.sigma, lower.sigma)
    np.testing.assert_allclose(back.covariance / scale, lower.covariance / scale, atol=1e-7)


def test_the_zeros_of_a_gauge_are_held_whatever_the_covariance():
    """Even with uncertainties so large that numerical noise of the derivative would pass for one."""
    for sigma in (1.0, 1e-6):
        for gauge, zero in (("lower", {"M_a_xy", "M_a_xz", "M_a_yz"}), ("upper", {"M_a_yx", "M_a_zx", "M_a_zy"})):
            turned = cases.calibration(sigma=sigma).in_gauge(gauge)
            assert set(turned.fixed) == zero
            assert set(turned.names) == set(LINEAR) - zero


def test_held_parameters_stay_held_in_another_gauge():
    values = cases.calibration().parameters
    held = CalibrationResult("data sheet", (), np.empty(0), np.empty((0, 0)), "full", fixed=values)
    turned = held.in_gauge("lower")
    np.testing.assert_allclose(vector(turned.errors), vector(in_gauge(held.errors, "lower")), atol=1e-15)
    assert turned.sigma.sum() == 0.0


def test_what_is_not_determined_stays_so_and_spreads_to_what_it_turns():
    result = cases.calibration()
    C = result.covariance.copy()
    i = result.names.index("b_g_y")
    C[i, :] = C[:, i] = 0.0
    C[i, i] = np.inf
    turned = replace(result, covariance=C).in_gauge("lower")
    lost = [n for n in turned.names if not np.isfinite(turned[n][1])]
    assert lost == ["b_g_y"]
    j = result.names.index("M_a_xy")  # it decides how far the axes turn: everything in them is lost with it
    C = result.covariance.copy()
    C[j, :] = C[:, j] = 0.0
    C[j, j] = np.inf
    turned = replace(result, covariance=C).in_gauge("lower")
    assert not np.isfinite(turned["M_g_xy"][1])
    assert np.isfinite(turned["b_a_x"][1])


def test_only_accelerometers():
    result = cases.calibration(names=("b_a_x", "b_a_y", "b_a_z", *MATRIX_A)).in_gauge("lower")
    assert len(result.names) == 9
    assert not any(n[2] == "g" for n in (*result.names, *result.fixed))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("b_a_x", "b_a_x")}, "expected each once"),
        ({"fixed": {"b_a_x": 0.0}}, "expected each once"),
        ({"names": ("b_a_x", "b_a_w")}, "expected a name such as b_a_x"),
        ({"covariance": np.diag([1.0, -1.0])}, "negative variances"),
        ({"covariance": np.diag([1.0, np.nan])}, "without NaN"),
        ({"covariance": np.array([[1.0, 0.5], [0.4, 1.0]])}, "expected a symmetric matrix"),
        ({"covariance": np.eye(3)}, r"expected shape \(2, 2\)"),
        ({"gauge": "diagonal"}, "expected one of full, lower, upper, symmetric, got 'diagonal'"),
        ({"values": np.array([np.nan, 0.0])}, "values"),
    ],
)
def test_what_cannot_be_a_result(change, message):
    fields = {
        "method": "m",
        "names": ("b_a_x", "b_a_y"),
        "values": np.zeros(2),
        "covariance": np.eye(2),
        "gauge": "full",
    }
    with pytest.raises(InputError, match=message):
        CalibrationResult(**(fields | change))


def test_results_are_frozen():
    result = cases.calibration()
    with pytest.raises(ValueError, match="read-only"):
        result.values[0] = 1.0


def test_residuals_know_their_rms():
    assert Residuals(("a", "b"), np.array([3.0, -4.0]), np.ones(2), "m").rms == pytest.approx(np.sqrt(12.5))
    assert np.isnan(Residuals((), np.empty(0), np.empty(0), "m").rms)


def test_summary_has_everything_a_reader_needs():
    text = cases.full(prior_sigma={"b_a_x": 0.1}).summary()
    for part in (
        "multiposition calibration: warning, can be used with care", "100 % of it: go on.", "Next: Put x down",
        "condition number: 12.2", "1.05 with 50 degrees of freedom, p = 0.38", "residuals accel: rms 0.00",
        "before 0.1", "24 of them", "temperature: 24.1 degC", "body axes (gauge full)", "delay",
    ):  # fmt: skip
        assert part in text, part
    (row,) = (line for line in text.splitlines() if line.startswith("delay"))
    assert row.split() == ["delay", "+1.25", "held", "ms", "+0.00125", "held"]
    assert len(text.splitlines()) < 60


def test_rows_of_the_summary():
    """3.52395 mg = 0.0345584 / 0.00980665, to the second digit of 0.10 mg."""
    result = result_from("m", {"b_a_x": (0.0345584, 0.001)}, "full", prior_sigma={"b_a_x": 0.1})
    (row,) = (line for line in result.summary().splitlines() if line.startswith("b_a_x"))
    assert row.split() == ["b_a_x", "+3.52", "0.10", "mg", "+0.0345584", "0.001", "1", "%"]


def test_summary_says_what_is_not_determined_and_how_far_the_poses_came():
    C = np.diag([1e-4, np.inf])
    flat = cases.residuals(reach=0.1)
    result = CalibrationResult(
        "m", ("M_a_xx", "M_a_zz"), np.zeros(2), C, "full", status="warning", residuals={"accel": flat}
    )
    text = " ".join(result.summary().split())
    reach = np.degrees(np.arcsin(np.abs(flat.direction[:, 2]).max()))
    assert reach < 30.0
    assert (
        "M_a_zz, scale factor of the z accelerometer, not determined: no pose with z beyond "
        f"{reach:.0f} degrees out of the level." in text
    )
    assert "M_a_xx, scale" not in text
    doubtful = replace(result, verdicts=("M_a_zz is not determined, put z up",))
    assert doubtful.summary().count("not determined") == 2  # the verdict and the table: not said twice


@pytest.mark.parametrize(
    ("variance", "words"),
    [
        (2.5, "Residuals are 1.6 times"),
        (0.3, "Residuals are 0.55 times what the stated noise makes them: it is smaller than stated."),
        (1.1, ""),
    ],
)
def test_summary_says_when_the_noise_is_not_as_stated(variance, words):
    text = " ".join(cases.full(variance_of_unit_weight=variance, freedom=60).summary().split())
    assert (words in text) if words else ("Residuals are" not in text)


def test_summary_of_little():
    assert "variance of unit weight" not in cases.calibration().summary()
    held = CalibrationResult("m", (), np.empty(0), np.empty((0, 0)), "full", fixed={"b_a_x": 0.0})
    assert "held" in held.summary()


def test_documented_examples_run(tmp_path, monkeypatch):
    """docs/calibration.md, block after block."""
    import re

    page = (ROOT / "docs" / "calibration.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    space = {}
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block, space)
    for member in re.findall(
        r"^\| `([a-z_]+)", page.partition("## The result")[2].partition("## Gauge")[0], flags=re.MULTILINE
    ):
        if member not in ("b_a_x", "M_a_xx", "M_a_xy", "G_g_xy", "Q_a_x", "b_a", "M_a", "Q_a"):
            assert hasattr(space["result"], member), member
