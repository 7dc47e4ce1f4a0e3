"""Predicted uncertainty against Monte Carlo, the next pose, how long to dwell, the picture."""

import numpy as np
import pytest

from schuler.calibration.design.dwell import dwell_time
from schuler.calibration.design.plans import ATTITUDES, attitude_plan, design_matrix
from schuler.calibration.design.pose_design import (
    next_pose,
    parameter_names,
    predicted_sigma,
    prior_of,
    relative_uncertainty,
    sigma_of_mean,
)
from schuler.calibration.result.parameters import imu_errors
from schuler.exceptions import InputError
from schuler.sensors import catalogue
from schuler.sensors.spec import TriadSpec
from schuler.units import G0

TRIAD = TriadSpec(random_walk=2e-3, turn_on_bias=0.05, scale_factor=3e-3, misalignment=3e-3)


def test_table_scales_with_noise_dwell_and_gravity():
    """Closed form for the edges: sd b = sigma/2, sd s = 0.866 sigma/g, sd theta = sigma/g; rounding."""
    sigma = 2e-3 / np.sqrt(50.0)
    sigmas = predicted_sigma(attitude_plan("edges").directions, TRIAD, 50.0, reference=9.81)
    assert tuple(sigmas) == parameter_names(9)
    expected = [0.5 * sigma] * 3 + [np.sqrt(0.75) * sigma / 9.81] * 3 + [sigma / 9.81] * 3
    np.testing.assert_allclose(list(sigmas.values()), expected, rtol=1e-12)
    # twice the dwell in every pose is the plan twice
    twice = np.concatenate((ATTITUDES, ATTITUDES))
    a = predicted_sigma(ATTITUDES, TRIAD, 60.0)
    b = predicted_sigma(twice, TRIAD, np.full(52, 30.0))
    np.testing.assert_allclose(list(a.values()), list(b.values()), rtol=1e-12)


def test_what_is_not_determined_has_no_finite_sigma():
    faces = predicted_sigma(attitude_plan(6).directions, TRIAD, 10.0)
    assert [n for n, s in faces.items() if np.isinf(s)] == ["M_a_yx", "M_a_zx", "M_a_zy"]
    assert faces["b_a_x"] == pytest.approx(2e-3 / np.sqrt(10.0) / np.sqrt(2.0))
    corners = predicted_sigma(attitude_plan("corners").directions, TRIAD, 10.0)
    assert [n for n, s in corners.items() if np.isinf(s)] == ["M_a_xx", "M_a_yy", "M_a_zz"]
    assert np.isinf(list(predicted_sigma(np.empty((0, 3)), TRIAD, 10.0).values())).all()
    # six faces with known directions determine all twelve: sd b = sigma/sqrt(6), sd M = sigma/(g sqrt(2))
    given = predicted_sigma(attitude_plan(6).directions, TRIAD, 10.0, 12)
    sigma = 2e-3 / np.sqrt(10.0)
    assert given["b_a_y"] == pytest.approx(sigma / np.sqrt(6.0))
    assert given["M_a_zx"] == pytest.approx(sigma / G0 / np.sqrt(2.0))


def fit_magnitude(f, p, g=G0):
    """Least squares of |(I + M)^-1 (f - b)| = g in the lower gauge by Gauss and Newton, numerical derivatives."""
    x = np.zeros(p)

    def left(x):
        b, rest = x[:3], np.concatenate((x[3:], np.zeros(9 - p)))
        M = np.diag(rest[:3])
        M[1, 0], M[2, 0], M[2, 1] = rest[3:]
        return np.linalg.norm(np.linalg.solve(np.eye(3) + M, (f - b).T), axis=0) - g

    for _ in range(6):
        J = np.stack([(left(x + 1e-6 * e) - left(x - 1e-6 * e)) / 2e-6 for e in np.eye(p)], axis=1)
        x = x - np.linalg.lstsq(J, left(x), rcond=None)[0]
    return x


@pytest.mark.campaign
@pytest.mark.thinned(2)
@pytest.mark.parametrize(("plan", "p"), [(6, 6), (10, 9), (18, 9), (26, 9)])
def test_predicted_covariance_agrees_with_monte_carlo(plan, p):
    """Real fits of a sensor with errors; variances over 300 runs within 4.5 standard errors of their scatter, plus 2 %
    because prediction is for a perfect sensor (statistical)."""
    directions = attitude_plan(plan).directions
    names = parameter_names(p)
    truth = dict(zip(names, [0.05, -0.03, 0.02, 3e-3, -2e-3, 1e-3, 2e-3, -1e-3, 3e-3][:p], strict=True))
    e = imu_errors(truth)
    sigma = predicted_sigma(directions, TRIAD, 4.0, p)
    rng = np.random.default_rng(plan)
    runs = 300
    x = np.empty((runs, p))
    for k in range(runs):
        f = e.b_a + G0 * directions @ (np.eye(3) + e.M_a).T + 1e-3 * rng.standard_normal(directions.shape)
        x[k] = fit_magnitude(f, p)
    z = (x - np.array(list(truth.values()))) / np.array([sigma[n] for n in names])
    assert np.abs(z.mean(axis=0)).max() < 4.5 / np.sqrt(runs)
    assert np.abs(z.var(axis=0) - 1.0).max() < 4.5 * np.sqrt(2.0 / runs) + 0.02


def test_predictions_agree_with_the_sources_simulation():
    """Hayal (2010) digest, section 5.2, T4.5 case 2: 26 poses of 180 s at sigma_a = 3.667e-3 at 1 Hz.

    sd b 0.92e-4, s 14.1 ppm, theta 20.1 urad with 2 deg scatter, here without: 2 %.
    """
    sigmas = predicted_sigma(ATTITUDES, TriadSpec(random_walk=3.667e-3), 180.0, reference=9.801)
    assert sigmas["b_a_x"] == pytest.approx(0.92e-4, rel=0.02)
    assert sigmas["M_a_yy"] == pytest.approx(14.1e-6, rel=0.02)
    assert sigmas["M_a_zx"] == pytest.approx(20.1e-6, rel=0.02)


def test_mean_with_bias_instability_is_its_allan_deviation():
    triad = TriadSpec(random_walk=1e-3, bias_instability=1e-4)
    T = np.array([1.0, 100.0, 1e4])
    np.testing.assert_allclose(sigma_of_mean(triad, T) ** 2, 1e-6 / T + 2.0 * np.log(2.0) / np.pi * 1e-8, rtol=1e-12)
    assert predicted_sigma(ATTITUDES, triad, 1e5)["b_a_x"] > 0.33 * 0.66e-4


def brute_force(directions, sigma, prior):
    out = []
    for v in ATTITUDES:
        r = relative_uncertainty(np.concatenate((directions, v[None])), sigma, prior)
        out.append((round(max(r.values()), 9), round(float(np.mean(np.square(list(r.values())))), 9)))
    return out


@pytest.mark.parametrize("n", [0, 3, 9, 15])
def test_next_pose_is_the_best_of_all(n):
    """Against inverting the normal matrix of every candidate; gain to rounding."""
    rng = np.random.default_rng(n)
    directions = rng.standard_normal((n, 3))
    prior = prior_of(TRIAD)
    pose, words, gain = next_pose(directions, 1e-3, prior)
    every = brute_force(directions, 1e-3, prior)
    k = int(np.argmin(np.linalg.norm(ATTITUDES - pose, axis=1)))
    assert k == every.index(min(every))
    before = max(relative_uncertainty(directions, 1e-3, prior).values())
    assert gain == pytest.approx(before / every[k][0], rel=1e-6)
    assert "worst" in words or "no single pose" in words


def test_following_the_advice_is_as_good_as_a_designed_plan():
    """From nothing, one pose ahead at a time: within 15 % of the worst parameter of the designed plan."""
    prior = prior_of(TRIAD)
    directions = np.empty((0, 3))
    for _ in range(14):
        directions = np.vstack((directions, next_pose(directions, 1e-3, prior).direction))
    ours = max(relative_uncertainty(directions, 1e-3, prior).values())
    designed = max(relative_uncertainty(attitude_plan(14).directions, 1e-3, prior).values())
    assert ours < 1.15 * designed


def test_after_the_faces_the_advice_is_an_edge_or_corner():
    pose, words, _ = next_pose(attitude_plan(6).directions, 1e-3, prior_of(TRIAD))
    assert (np.abs(pose) > 0.1).sum() >= 2
    assert "M_a_" in words
    assert words.startswith(("corner", "x ", "y "))


def test_relative_uncertainty_without_poses_is_one():
    r = relative_uncertainty(np.empty((0, 3)), 1.0, prior_of(TRIAD))
    np.testing.assert_allclose(list(r.values()), 1.0, rtol=1e-12)
    six = {n: s for n, s in prior_of(TRIAD).items() if n in parameter_names(6)}
    assert len(relative_uncertainty(ATTITUDES, np.full(26, 1e-3), six)) == 6


def test_dwell_for_white_noise_is_closed_form():
    """N/sqrt(T) = target: T = (N/target)^2; bisection to 1e-9."""
    sigmas = dwell_time(TriadSpec(random_walk=1e-3), 1e-4)
    assert sigmas.seconds == pytest.approx(100.0, rel=1e-9)
    assert sigmas.best_s == np.inf
    assert sigmas.repeats == 1
    directions = attitude_plan("edges").directions
    sigmas = dwell_time(TriadSpec(random_walk=1e-3), {"b_a_y": 0.5e-4, "M_a_zy": 1.0}, directions)
    assert sigmas.seconds == pytest.approx(100.0, rel=1e-9)


def test_dwell_knows_when_staying_does_not_help():
    triad = TriadSpec(random_walk=1e-3, bias_instability=1e-4, rate_random_walk=1e-6)
    sigmas = dwell_time(triad)
    # sigma^2 = N^2/T + 0.44 B^2 + K^2 T/3 is least at T = sqrt(3) N/K; grid of 0.6 %
    assert sigmas.best_s == pytest.approx(np.sqrt(3.0) * 1e3, rel=0.006)
    best = float(sigma_of_mean(triad, sigmas.best_s))
    assert sigma_of_mean(triad, sigmas.enough_s) <= 1.1 * best
    assert sigma_of_mean(triad, 0.95 * sigmas.enough_s) > 1.1 * best
    lost = dwell_time(triad, 0.3 * best)
    assert lost.seconds == np.inf
    assert lost.repeats == int(np.ceil((sigma_of_mean(triad, lost.enough_s) / (0.3 * best)) ** 2))
    assert "whole plan" in lost.words


def test_catalogue_imu_has_advice():
    spec = catalogue.spec("HG1700")
    assert set(prior_of(spec)) == set(parameter_names(9))
    assert dwell_time(spec).seconds > 0.0


def test_picture_has_every_pose(tmp_path):
    from schuler.calibration.report.pose_figure import plan_figure

    plan = attitude_plan(26)
    figure = plan_figure(plan, done=7, following=plan.directions[9])
    texts = [t.get_text() for ax in figure.axes for t in ax.texts]
    assert {str(k) for k in range(1, 27)} <= set(texts)
    assert any("x down and y up" in ax.get_title(loc="left") for ax in figure.axes)
    figure.savefig(tmp_path / "plan.png", dpi=60)
    assert (tmp_path / "plan.png").stat().st_size > 5000
    assert plan_figure(plan.directions, done=[0, 3]).axes
    with pytest.raises(InputError, match="done"):
        plan_figure(plan, done=[30])


def test_what_cannot_be():
    with pytest.raises(InputError, match="expected 3, 6, 9"):
        predicted_sigma(ATTITUDES, TRIAD, 1.0, 7)
    with pytest.raises(InputError, match="positive times"):
        predicted_sigma(ATTITUDES, TRIAD, 0.0)
    with pytest.raises(InputError, match="perfect sensor"):
        predicted_sigma(ATTITUDES, TriadSpec(random_walk=0.0), 1.0)
    with pytest.raises(InputError, match="no prior"):
        prior_of(TriadSpec(random_walk=1.0))
    with pytest.raises(InputError, match="prior_sigma: expected b_a_x"):
        next_pose(ATTITUDES, 1.0, {"b_a_x": 1.0})
    with pytest.raises(InputError, match="do not determine M_a_zy"):
        dwell_time(TRIAD, {"M_a_zy": 1e-3}, attitude_plan(6).directions)
    with pytest.raises(InputError, match="directions: expected the poses"):
        dwell_time(TRIAD, {"M_a_zy": 1e-3})
    with pytest.raises(InputError, match="next_sigma"):
        next_pose(np.empty((0, 3)), [], prior_of(TRIAD))


def test_rows_are_independent_of_length():
    np.testing.assert_allclose(design_matrix([[0.0, 0.0, 7.0]]), design_matrix([[0.0, 0.0, 1.0]]), atol=1e-15)
