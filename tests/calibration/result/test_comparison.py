"""Two calibrations of one unit: closed forms, gauges brought together, calibrated chi-square."""

from dataclasses import replace

import numpy as np
import pytest
import result_cases as cases
from scipy.stats import chi2, kstest

from schuler.calibration.result.comparison import compare, with_nominal
from schuler.calibration.result.parameters import LINEAR, vector
from schuler.calibration.result.result import CalibrationResult, result_from
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries


def test_closed_form():
    """Differences 3 and -4 with sigma 5 each: z 0.6 and -0.8, chi-square 1. Rounding."""
    a = result_from("m", {"b_a_x": (1.0, 3.0), "b_a_y": (2.0, 4.0)}, "full", temperature=20.0)
    b = result_from("m", {"b_a_x": (4.0, 4.0), "b_a_y": (-2.0, 3.0)}, "full", temperature=26.5)
    d = a.compare(b)
    np.testing.assert_allclose(d.difference, [3.0, -4.0])
    np.testing.assert_allclose(d.sigma, [5.0, 5.0])
    np.testing.assert_allclose(d.z, [0.6, -0.8])
    assert (d.chi2, d.freedom) == (pytest.approx(1.0), 2)
    assert d.p_value == pytest.approx(np.exp(-0.5))
    assert d.changed == ()
    assert d["b_a_y"] == (-4.0, 5.0)
    assert d.temperature_change == 6.5
    assert "No parameter changed" in d.summary()
    assert "The second was 6.5 K warmer" in d.summary()
    with pytest.raises(InputError, match="expected one of b_a_x, b_a_y"):
        d["b_a_z"]


def test_full_covariance_counts():
    """Both biases up by 1 sigma with correlation 0.99: chi-square 2/1.99, not 2."""
    C = np.array([[1.0, 0.99], [0.99, 1.0]]) / 2.0
    a = CalibrationResult("m", ("b_a_x", "b_a_y"), np.zeros(2), C, "full")
    b = CalibrationResult("m", ("b_a_y", "b_a_x"), np.ones(2), C, "full")
    assert compare(a, b).chi2 == pytest.approx(2.0 / 1.99)
    assert compare(a, replace(b, values=np.array([1.0, -1.0]))).chi2 == pytest.approx(2.0 / 0.01)


def test_what_changed_is_named_largest_first():
    a = result_from("m", {"b_a_x": (0.0, 1e-3), "b_a_y": (0.0, 1e-3), "b_g_z": (0.0, 1e-5)}, "full")
    b = result_from("m", {"b_a_x": (0.1, 1e-3), "b_a_y": (0.001, 1e-3), "b_g_z": (-1e-2, 1e-5)}, "full")
    d = compare(a, b)
    assert d.changed == ("b_g_z", "b_a_x")
    assert "bias of the z gyroscope (b_g_z), bias of the x accelerometer (b_a_x)" in d.summary()
    assert "they do not agree" in d.summary()
    assert compare(a, b, beyond=0.5).changed == ("b_g_z", "b_a_x", "b_a_y")
    np.testing.assert_allclose(compare(b, a).difference, -d.difference)


def test_undetermined_and_held_parameters():
    a = result_from("m", {"b_a_x": (0.0, np.inf), "b_a_y": (0.0, 1e-3), "M_a_xx": (1e-3, 1e-4)}, "full",
                    fixed={"b_g_x": 0.1, "b_g_y": 0.2})  # fmt: skip
    b = result_from("m", {"b_a_x": (9.0, 1e-3), "b_a_z": (0.0, 1e-3), "b_a_y": (0.0, 1e-3)}, "full",
                    fixed={"M_a_xx": 0.0, "b_g_x": 0.1, "b_g_y": 0.3})  # fmt: skip
    d = compare(a, b)
    assert d.undetermined == ("b_a_x",)
    assert d["M_a_xx"] == (-1e-3, 1e-4)
    assert d.names == ("b_a_x", "b_a_y", "M_a_xx", "b_g_y")
    assert d.changed == ("b_g_y", "M_a_xx")  # both held and different: beyond any uncertainty
    assert d.only_second == ("b_a_z",)
    assert d.only_first == ()
    assert d.freedom == 2
    assert "Not determined in one of the two: b_a_x." in d.summary()
    assert "Only in the second: b_a_z." in d.summary()


def test_nothing_determined_is_said_and_nothing_in_common_is_refused():
    a = result_from("m", {"b_a_x": (0.0, np.inf)}, "full")
    d = compare(a, a)
    assert d.freedom == 0
    assert np.isnan(d.p_value)
    assert "nothing can be said" in d.summary()
    with pytest.raises(InputError, match="expected two calibrations with parameters in common, got b_a_x and b_g_x"):
        compare(a, result_from("m", {"b_g_x": (0.0, 1.0)}, "full"))
    with pytest.raises(InputError, match="expected a positive number of sigma"):
        compare(a, a, beyond=0.0)


@pytest.mark.parametrize(("first", "second", "used"), [
    ("full", "lower", "lower"), ("lower", "full", "lower"), ("full", "full", "full"), ("lower", "upper", "lower"),
    ("symmetric", "lower", "symmetric"), ("full", "symmetric", "symmetric"),
])  # fmt: skip
def test_one_unit_in_two_gauges_has_not_changed(first, second, used):
    """Rounding: the same errors, said in two ways."""
    full = cases.calibration()
    a, b = (full if g == "full" else full.in_gauge(g) for g in (first, second))
    d = compare(a, b)
    assert d.gauge == used
    np.testing.assert_allclose(d.difference, 0.0, atol=1e-14)
    assert d.freedom == (len(LINEAR) if used == "full" else len(LINEAR) - 3)
    assert d.chi2 < 1e-12


def test_a_difference_of_gauge_alone_would_have_passed_for_a_change():
    """The reason for bringing them together: taken as they are, the elements differ by hundreds of sigma."""
    a = cases.calibration(sigma=1e-4)
    b = replace(a.in_gauge("lower"), gauge="full")
    assert len(compare(a, b).changed) > 10
    assert compare(a, a.in_gauge("lower")).changed == ()


@pytest.mark.thinned(3)
@pytest.mark.parametrize("gauges", [("full", "full"), ("full", "lower"), ("symmetric", "lower")])
def test_chi_square_has_its_distribution(gauges):
    """100 pairs of calibrations drawn from their covariances: p-values uniform (Kolmogorov-Smirnov, statistical)."""
    truth = cases.calibration(sigma=0.003)
    rng = np.random.default_rng(6)
    draws = rng.multivariate_normal(truth.values, truth.covariance, size=(100, 2))
    p = []
    for pair in draws:
        a, b = (replace(truth, values=v) for v in pair)
        a, b = (r if g == "full" else r.in_gauge(g) for r, g in zip((a, b), gauges, strict=True))
        d = compare(a, b)
        p.append(d.p_value)
        assert d.p_value == pytest.approx(chi2.sf(d.chi2, d.freedom))
    assert kstest(p, "uniform").pvalue > 1e-3


def test_a_real_change_is_found():
    a = cases.calibration(sigma=0.01)
    values = a.values.copy()
    values[a.names.index("b_a_z")] += 0.1 * 0.01 * 12.0  # 12 sigma of one, 8.5 of the difference
    d = compare(a, replace(a, values=values))
    assert d.changed == ("b_a_z",)
    assert d["b_a_z"][0] == pytest.approx(0.012)
    assert d.p_value < 1e-3


def test_other_nominal_factors_are_the_same_calibration():
    """Applied to one log of counts both give the same: rounding."""
    a = replace(cases.calibration(), nominal=(1.0 / 400.0, 1.0 / 4800.0))
    b = with_nominal(a, (1.0 / 415.0, 1.0 / 4778.0))
    rng = np.random.default_rng(7)
    log = ImuSeries(0.01 * np.arange(5), 5000.0 * rng.standard_normal((5, 3)), 4000.0 * rng.standard_normal((5, 3)))
    np.testing.assert_allclose(b.apply(log).accel, a.apply(log).accel, rtol=1e-12)
    np.testing.assert_allclose(b.apply(log).gyro, a.apply(log).gyro, rtol=1e-12, atol=1e-14)
    d = compare(a, b)
    np.testing.assert_allclose(d.difference, 0.0, atol=1e-15)
    np.testing.assert_allclose(d.sigma, np.sqrt(2.0) * a.sigma)
    assert with_nominal(a, a.nominal) is a


def test_nominal_factors_with_held_elements():
    """M_a_zz held at 0 or not named is a scale of 1, and must become 400/415 - 1. Rounding."""
    a = result_from("m", {"M_a_xx": (0.01, 1e-3)}, "full", fixed={"M_a_yy": 0.0}, nominal=(1.0 / 400.0, 1.0))
    b = with_nominal(a, (1.0 / 415.0, 1.0))
    k = 400.0 / 415.0
    np.testing.assert_allclose(np.diag(b.errors.M_a), [k * 1.01 - 1.0, k - 1.0, k - 1.0], atol=1e-15)
    np.testing.assert_allclose(vector(b.errors, ("M_g_xx",)), 0.0)
