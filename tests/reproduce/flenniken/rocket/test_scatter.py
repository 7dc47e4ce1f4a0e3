"""Monte Carlo of the impact against the linear covariance and the source; ellipse and CEP; figures."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.reproduce.flenniken.study.rocket import (
    ImpactEllipse,
    RocketErrors,
    circular_error_probable,
    impact_budget,
    impact_scatter,
    influence,
    rocket_trajectory,
)
from schuler.reproduce.flenniken.study.rocket import figures as rocket_figures
from schuler.reproduce.flenniken.study.tables import with_angles
from schuler.sensors.catalogue import spec

T = rocket_trajectory(rate_hz=4.0)
SIMPLE = RocketErrors.simple(spec("flenniken-tactical-printed"))


@pytest.mark.parametrize("variant", ["thesis", "strapdown"])
def test_without_errors_the_truth(variant):
    """Rounding: no step holds anything that changes within it, as T1-R turns without thrust."""
    s = impact_scatter(T, RocketErrors(), runs=2, variant=variant)
    assert_allclose(s.position, 0.0, atol=1e-7)
    assert_allclose(s.velocity, 0.0, atol=1e-9)
    assert_allclose(s.point, 0.0, atol=1e-7)


@pytest.mark.parametrize("variant", ["thesis", "strapdown"])
@pytest.mark.parametrize("start", ["stationary", "zero"])
def test_scatter_is_the_linear_covariance(variant, start):
    """Chi-square of 400 runs in three dimensions, and each deviation within 4 standard errors (3.5 % each)."""
    errors = RocketErrors.simple(spec("flenniken-tactical-printed"), start=start)
    s = impact_scatter(T, errors, runs=400, seed=1, variant=variant)
    P = influence(T, variant).noise_covariance(errors)
    assert_allclose(s.position.std(axis=0, ddof=1), np.sqrt(np.diag(P)), rtol=4.0 * s.uncertainty)
    chi2 = np.einsum("ri,ij,rj->r", s.position, np.linalg.inv(P), s.position)
    assert abs(chi2.mean() - 3.0) < 4.0 * np.sqrt(6.0 / 400)
    ground = T.ground @ P @ T.ground.T
    assert_allclose(s.sigma, np.sqrt(np.diag(ground)), rtol=4.0 * s.uncertainty)


def test_scatter_and_means_of_the_thesis():
    """Section 7.3, 200 runs: within 3 standard errors, 5 % of a deviation and 3.5 m of a mean."""
    cases = {
        "simple": (SIMPLE, "thesis"),
        "(6.7) as printed": (with_angles(SIMPLE, 5e-4, printed=True), "thesis"),
        "(6.7) corrected": (with_angles(SIMPLE, 5e-4), "thesis"),
        "simple, strapdown": (SIMPLE, "strapdown"),
        "angles, strapdown": (with_angles(SIMPLE, 5e-4), "strapdown"),
    }
    scatter = {name: impact_scatter(T, e, runs=200, seed=0, variant=v) for name, (e, v) in cases.items()}
    assert_allclose(scatter["simple"].sigma, [47.3, 49.9], rtol=3.0 / np.sqrt(2.0 * 199))
    # a fixed error moves the cloud and does not widen it
    assert_allclose(scatter["(6.7) as printed"].sigma, scatter["simple"].sigma, rtol=0.01)
    east = [s.mean[1] for s in scatter.values()]
    assert_allclose(east, [0.0, 450.5, 219.0, 0.0, 148.2], atol=3.0 * 50.0 / np.sqrt(200))
    assert_allclose(scatter["simple, strapdown"].sigma, [42.3, 46.6], rtol=3.0 / np.sqrt(2.0 * 199))


def test_drawn_constants_widen_the_cloud():
    """Ellipse of constants as 1-sigmas; 4 standard errors of 400 runs."""
    errors = RocketErrors.of({"accel_misalignment_y": 5e-4, "accel_scale_factor_x": 3e-4, "gyro_bias_y": 5e-6})
    s = impact_scatter(T, errors, runs=400, seed=2, drawn=True)
    expected = impact_budget(influence(T), errors).ellipse
    assert_allclose(s.sigma, np.sqrt(np.diag(expected.P)), rtol=4.0 * s.uncertainty)
    assert np.all(np.abs(s.mean) < 4.0 * s.standard_error)
    assert_allclose(s.ellipse.cep, expected.cep, rtol=0.15)


def test_same_seed_same_runs():
    one, two, other = (impact_scatter(T, SIMPLE, runs=3, seed=k) for k in (5, 5, 6))
    assert np.array_equal(one.point, two.point)
    assert not np.array_equal(one.point, other.point)


def test_radius_of_a_circle_and_of_a_line():
    """sqrt(2 ln 2) and the quartile of a normal distribution; bisection and, for the line, the thin ellipse taken."""
    assert_allclose(circular_error_probable(9.0 * np.eye(2)), 3.0 * np.sqrt(2.0 * np.log(2.0)), rtol=1e-9)
    assert_allclose(circular_error_probable(np.diag([4.0, 0.0])), 2.0 * 0.674489750196, rtol=1e-3)
    assert_allclose(circular_error_probable(np.eye(2), 0.95), np.sqrt(-2.0 * np.log(0.05)), rtol=1e-9)
    assert circular_error_probable(np.zeros((2, 2))) == 0.0


@pytest.mark.parametrize("ratio", [0.9, 0.4, 0.1])
def test_radius_against_draws(ratio):
    """200 000 draws: share within the radius is a half within 4 standard errors (0.0045)."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((200_000, 2)) * [1.0, ratio]
    inside = np.mean(np.hypot(x[:, 0], x[:, 1]) < circular_error_probable(np.diag([1.0, ratio**2])))
    assert abs(inside - 0.5) < 4.0 * 0.5 / np.sqrt(200_000)


def test_ellipse():
    """Axes and angle of a known one, and an outline that holds its share; rounding and 4 standard errors."""
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s], [s, c]])
    e = ImpactEllipse(np.array([10.0, -20.0]), R @ np.diag([25.0, 4.0]) @ R.T)
    assert_allclose(e.axes, (5.0, 2.0))
    assert_allclose(e.angle, 0.7)
    d = e.outline(0.5) - e.center
    assert_allclose(np.einsum("ni,ij,nj->n", d, np.linalg.inv(e.P), d), 2.0 * np.log(2.0), rtol=1e-12)
    assert "5.0 x 2.0 m" in e.summary()
    assert e.to_dict()["axes"] == (pytest.approx(5.0), pytest.approx(2.0))


def test_figures():
    scatter = impact_scatter(T, SIMPLE, runs=20, name="simple")
    budget = impact_budget(influence(T), SIMPLE.replaced(accel_bias_x=1e-3))
    drawn = [T.plot(), scatter.plot(), budget.plot(), draw(rocket_figures.error_types_figure())]
    assert [len(f.axes) for f in drawn] == [4, 1, 1, 6]
    assert scatter.to_dict()["runs"] == 20
    assert "simple" in scatter.summary()
    assert T.to_dict()["impact_range"] > 80e3


def test_refusals():
    with pytest.raises(InputError, match="runs"):
        impact_scatter(T, SIMPLE, runs=1)
    with pytest.raises(InputError, match="variant"):
        impact_scatter(T, SIMPLE, variant="other")
    with pytest.raises(InputError, match="come down"):
        impact_scatter(T, RocketErrors.of({"accel_scale_factor_x": 2.0}), runs=2)
    with pytest.raises(InputError, match="probability"):
        circular_error_probable(np.eye(2), 1.0)
    with pytest.raises(InputError, match="probability"):
        ImpactEllipse(np.zeros(2), np.eye(2)).outline(0.0)
