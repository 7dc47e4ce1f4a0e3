"""Thermal ramps and soaks: exact on perfect data, coverage, hysteresis found and not invented, bad sensors."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

from schuler.calibration.bench.poses import Poses
from schuler.calibration.design.plans import attitude_plan
from schuler.calibration.result.parameters import BIAS_A, BIAS_G
from schuler.calibration.thermal import log as thermal_log
from schuler.calibration.thermal import soak as thermal_soak
from schuler.calibration.thermal.calibrate import (
    calibrate_thermal,
    compensate_thermal,
    thermal_correction,
    thermal_value,
)
from schuler.calibration.thermal.noise import mixtures
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.units import G0

F = np.array([0.3, -0.2, -9.8])
CUBIC = np.array([2e-3, 1e-5, -3e-7, 4e-9])


def there_and_back(n: int, low: float = -20.0, high: float = 70.0) -> np.ndarray:
    up = 1.0 - np.abs(2.0 * np.arange(n) / (n - 1) - 1.0)
    return low + (high - low) * up / up.max()


def three_ways(n: int) -> np.ndarray:
    """Cooling, heating, cooling, as the real log."""
    s = np.arange(n) / n
    return np.interp(s, [0.0, 0.3, 0.75, 1.0], [50.0, -20.0, 70.0, 30.0])


def curve(T, c=CUBIC, T0=25.0):
    return ((np.asarray(T) - T0)[..., None] ** np.arange(len(c))) @ np.asarray(c)


def log(T, gyro, accel=None, dt=1.0) -> ImuSeries:
    n = len(T)
    accel = np.zeros((n, 3)) if accel is None else accel
    return ImuSeries(dt * np.arange(n), gyro, accel, temperature=T)


def thermal(result):
    return result.extra["thermal"]


# ------------------------------------------------------------------------------------------ perfect data


@pytest.mark.thinned(3)
@pytest.mark.parametrize("shape", [there_and_back, three_ways])
@pytest.mark.parametrize("n", [400, 4321])
def test_perfect_ramp_is_exact(shape, n):
    """Cubic sensors without noise: every coefficient to rounding (1e-9 of its effect over the range)."""
    T = shape(n)
    c = np.array([CUBIC * k for k in (1.0, -2.0, 0.5, 30.0, -40.0, 100.0)])
    Y = np.stack([curve(T, k) for k in c], axis=1)
    result = calibrate_thermal(log(T, Y[:, :3], Y[:, 3:] + F), f_ib_b=F)
    assert result.status == "ok", result.verdicts
    assert result.gauge == "full"
    for name, k in zip((*BIAS_G, *BIAS_A), c, strict=True):
        coefficients = np.array(thermal(result)["coefficients"][name])
        np.testing.assert_allclose((coefficients - k) * 45.0 ** np.arange(4), 0.0, atol=1e-9 * abs(k[0]) + 2e-14)
        assert result[name][0] == pytest.approx(k[0], abs=1e-9 * abs(k[0]) + 2e-14)
        assert not thermal(result)["hysteresis"][name]["found"]
    out = compensate_thermal(result, log(T, Y[:, :3], Y[:, 3:] + F))
    np.testing.assert_allclose(out.gyro, 0.0, atol=1e-12)
    np.testing.assert_allclose(out.accel, np.tile(F, (n, 1)), atol=1e-11)


def test_one_pose_gives_the_change_of_the_accelerometers_only():
    T = there_and_back(1000)
    b = curve(T, 30.0 * CUBIC)
    result = calibrate_thermal(log(T, np.zeros((1000, 3)), F + np.outer(b, [1.0, 2.0, -1.0])))
    assert result.status == "warning"
    assert any("one pose of unknown tilt" in v for v in result.verdicts)
    assert np.isinf([result[n][1] for n in BIAS_A]).all()
    _, b_a = thermal_correction(result, T)
    np.testing.assert_allclose(b_a[:, 1], 2.0 * (b - 30.0 * CUBIC[0]), atol=1e-10)  # rounding
    value, sigma = thermal_value(result, "b_a_x", 25.0)
    assert value == sigma == 0.0
    at_25 = thermal_value(result, "b_a_x", 25.0, method="table")
    assert abs(at_25[0]) < 1e-9
    assert at_25[1] < 1e-9


def soak_of(
    levels, plan=26, *, scatter=0.0, noise=0.0, rng=None, gap=0.0, b=None, s=None, theta=(0.002, -0.001, 0.003)
):
    """Poses at several temperatures of a sensor whose biases are cubic and scale factors linear in temperature."""
    directions = attitude_plan(plan).directions
    b = np.array([[0.05, 1e-3, 1e-5, -1e-7], [-0.03, 2e-3, 0.0, 0.0], [0.02, 0.0, -2e-5, 2e-7]]) if b is None else b
    s = np.array([[2e-3, 3e-5], [-1e-3, -2e-5], [1e-3, 0.0]]) if s is None else s
    out = []
    rng = np.random.default_rng(0) if rng is None else rng
    way = np.sign(np.diff(levels, prepend=levels[0]))
    for k, level in enumerate(levels):
        n = len(directions)
        T = level + scatter * rng.standard_normal(n)
        M = np.zeros((n, 3, 3))
        M[:, [0, 1, 2], [0, 1, 2]] = np.stack([curve(T, c) for c in s], axis=1)
        M[:, [1, 2, 2], [0, 0, 1]] = theta
        f = np.einsum("nij,nj->ni", np.eye(3) + M, G0 * directions)
        f += np.stack([curve(T, c) for c in b], axis=1) + 0.5 * gap * way[k] * np.array([1.0, 0.0, 0.0])
        omega = np.stack([curve(T, CUBIC * k) for k in (1.0, 2.0, -1.0)], axis=1) + 0.5 * gap * way[k]
        sigma = max(noise, 1e-6)
        f, omega = f + noise * rng.standard_normal(f.shape), omega + noise * rng.standard_normal(f.shape)
        start = 100.0 * (np.arange(n) + 100 * k)
        one = np.full((n, 3), sigma)
        out.append(Poses(f, omega, one, one, start, start + 50.0, T))
    return out


def test_perfect_soak_is_exact():
    """Bias, scale factor and angles jointly, temperature wandering within each soak; rounding of the iteration."""
    result = calibrate_thermal(soak_of([-20.0, 0.0, 25.0, 50.0, 70.0], scatter=0.5))
    assert result.gauge == "lower"
    assert any("hysteresis cannot be checked" in v for v in result.verdicts)
    truth = {
        "b_a_x": 0.05,
        "b_a_y": -0.03,
        "M_a_xx": 2e-3,
        "M_a_yy": -1e-3,
        "M_a_zy": 0.003,
        "M_a_zx": -0.001,
        "b_g_y": 4e-3,
    }
    for name, value in truth.items():
        assert result[name][0] == pytest.approx(value, abs=1e-11)
    np.testing.assert_allclose(thermal(result)["coefficients"]["b_a_x"], [0.05, 1e-3, 1e-5, -1e-7], atol=1e-11)
    np.testing.assert_allclose(thermal(result)["coefficients"]["M_a_yy"], [-1e-3, -2e-5, 0.0, 0.0], atol=1e-11)
    assert np.abs(result.residuals["accel"].value).max() < 1e-11
    # the table of single soaks says the same, within the wander of temperature in each
    at = np.array(thermal(result)["table"]["temperature"])
    table = np.array(thermal(result)["table"]["b_a_x"]["value"])
    np.testing.assert_allclose(table, curve(at, [0.05, 1e-3, 1e-5, -1e-7]), atol=1e-4)


def test_faces_only_leave_angles_out_but_not_scale_factors():
    result = calibrate_thermal(soak_of([0.0, 20.0, 40.0, 60.0], plan=6, theta=(0.0, 0.0, 0.0)), degree=3)
    assert "M_a_yx" not in result.names
    assert result["M_a_xx"][0] == pytest.approx(2e-3, abs=1e-10)
    assert result["b_a_z"][0] == pytest.approx(0.02, abs=1e-10)
    only_bias = calibrate_thermal(
        soak_of([0.0, 20.0, 40.0, 60.0], plan=6, theta=(0.0, 0.0, 0.0), s=np.zeros((3, 2))), scale=False
    )
    assert not any(n.startswith("M_a") for n in only_bias.names)
    assert only_bias["b_a_x"][0] == pytest.approx(0.05, abs=1e-10)


def test_compensation_of_a_log_over_temperature_with_scale():
    result = calibrate_thermal(soak_of([-20.0, 0.0, 25.0, 50.0, 70.0]))
    T = np.linspace(-20.0, 70.0, 200)
    M = np.zeros((200, 3, 3))
    M[:, 0, 0], M[:, 1, 1], M[:, 2, 2] = curve(T, [2e-3, 3e-5]), curve(T, [-1e-3, -2e-5]), 1e-3
    M[:, 1, 0], M[:, 2, 0], M[:, 2, 1] = 0.002, -0.001, 0.003
    b = np.stack(
        [curve(T, [0.05, 1e-3, 1e-5, -1e-7]), curve(T, [-0.03, 2e-3]), curve(T, [0.02, 0, -2e-5, 2e-7])], axis=1
    )
    f = (np.eye(3) + M) @ F + b
    out = compensate_thermal(result, log(T, np.zeros((200, 3)), f))
    np.testing.assert_allclose(out.accel, np.tile(F, (200, 1)), atol=1e-9)
    # increments over 0.5 s
    half = ImuSeries(0.5 * np.arange(1, 201), np.zeros((200, 3)), 0.5 * f, "increment", T)
    np.testing.assert_allclose(compensate_thermal(result, half).accel, np.tile(0.5 * F, (200, 1)), atol=1e-9)


def test_jacobian_of_the_soak_against_numerical_differentiation():
    soak = thermal_soak.gathered(soak_of([0.0, 20.0, 40.0, 20.0, 0.0], scatter=0.3))
    Bb, Bs = thermal_soak.bases(soak, 25.0, 40.0, 2, 2)
    rng = np.random.default_rng(1)
    for mode, p in (("all", 3 * 5 + 3 * 3 + 3), ("scale", 24), ("bias", 15)):
        x = 0.02 * rng.standard_normal(p)
        _, J, w = thermal_soak.model(x, soak.f, G0, Bb, Bs, mode)
        h = 1e-6
        number = np.stack(
            [(thermal_soak.model(x + h * e, soak.f, G0, Bb, Bs, mode)[0]
              - thermal_soak.model(x - h * e, soak.f, G0, Bb, Bs, mode)[0]) / (2 * h) for e in np.eye(p)], axis=1,
        )  # fmt: skip
        np.testing.assert_allclose(J, number, atol=1e-7)  # discretisation
        by_f = [(thermal_soak.model(x, soak.f + h * e, G0, Bb, Bs, mode)[0]
                 - thermal_soak.model(x, soak.f - h * e, G0, Bb, Bs, mode)[0]) / (2 * h)
                for e in np.eye(3)]  # fmt: skip
        np.testing.assert_allclose(w, np.stack(by_f, axis=1), atol=1e-7)


# ---------------------------------------------------------------------------------------------- coverage


def chi_square(result, name, c):
    d = np.array(thermal(result)["coefficients"][name]) - c
    C = np.array(thermal(result)["covariance"][name])
    scale = np.sqrt(np.diag(C))
    return float(d / scale @ np.linalg.solve(C / np.outer(scale, scale), d / scale))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("shape", [there_and_back, three_ways])
def test_ramp_with_known_noise_has_the_stated_covariance(shape):
    """Mean of 240 chi-squares of 4: within 4 standard errors (statistical). No hysteresis: 0.1 % false alarms, so at
    most 4 of 240."""
    n, runs, sigma = 1500, 40, 1e-4
    T, rng = shape(n), np.random.default_rng(11)
    total, alarms = [], 0
    for _ in range(runs):
        Y = curve(T)[:, None] + sigma * rng.standard_normal((n, 6))
        result = calibrate_thermal(log(T, Y[:, :3], Y[:, 3:]), f_ib_b=np.zeros(3), noise=(sigma, sigma))
        total += [chi_square(result, name, CUBIC) for name in (*BIAS_G, *BIAS_A)]
        alarms += sum(h["found"] for h in thermal(result)["hysteresis"].values())
    k = len(total)
    assert abs(np.mean(total) - 4.0) < 4.0 * np.sqrt(8.0 / k)
    assert alarms <= 4


def ramps_with_unknown_noise(T, process, runs, rng):
    """RMS of the normalised errors of so many logs, and the number of hystereses found that are not there."""
    n, sigma = len(T), 1e-4
    at = np.array([-10.0, 10.0, 25.0, 40.0, 60.0])
    z, alarms = [], 0
    for _ in range(runs):
        drift = np.zeros((n, 6)) if process is None else process.sample((n, 6), 1.0, rng)
        Y = curve(T)[:, None] + drift + sigma * rng.standard_normal((n, 6))
        result = calibrate_thermal(log(T, Y[:, :3], Y[:, 3:]), f_ib_b=np.zeros(3))
        for name, mean in zip((*BIAS_G, *BIAS_A), drift.mean(axis=0), strict=True):
            value, one = thermal_value(result, name, at)
            z.append((value - curve(at) - mean) / one)
            alarms += thermal(result)["hysteresis"][name]["found"]
    return float(np.sqrt(np.mean(np.square(z)))), alarms


@pytest.mark.parametrize(
    ("slow", "runs"),
    [
        ("correlated", 2),
        *(pytest.param(s, 20, marks=pytest.mark.campaign) for s in ("none", "correlated", "random walk")),
    ],
)
def test_ramp_with_unknown_noise_covers(slow, runs):
    """RMS of the normalised error of the curve is 1; the noise is estimated, so 0.45 to 1.5 is accepted, and 5 % false
    alarms of hysteresis (nominal 0.1 %, documented as up to 3 %)."""
    from schuler.sensors.noise import GaussMarkov, RandomWalk

    T, rng = three_ways(1500), np.random.default_rng(12)
    process = {"none": None, "correlated": GaussMarkov(2e-5, 60.0), "random walk": RandomWalk(1e-6)}[slow]
    rms, alarms = ramps_with_unknown_noise(T, process, runs, rng)
    assert 0.45 < rms < 1.5
    assert alarms <= max(0.05 * 6 * runs, 1.0)


def test_each_noise_tried_is_whitened_by_its_own_whitener():
    """``W R W^T = I`` and the determinant, for white noise and every mixture. Rounding, times a condition of 1e4."""
    for mixture in mixtures(40):
        R = np.zeros((40, 40))
        mixture.add_to(R, 2.0)
        np.testing.assert_allclose(mixture.W @ R @ mixture.W.T, 2.0 * np.eye(40), atol=1e-10)
        assert np.linalg.slogdet(R / 2.0)[1] == pytest.approx(mixture.logdet, abs=1e-9)
        assert np.trace(R) == pytest.approx(80.0, rel=1e-12)


@pytest.mark.parametrize("runs", [20, pytest.param(60, marks=pytest.mark.campaign)])
def test_soak_has_the_stated_covariance(runs):
    """Chi-square of all accelerometer parameters at the reference temperature over 60 runs, 4 standard errors."""
    rng, noise = np.random.default_rng(13), 2e-3
    levels = [-20.0, 5.0, 30.0, 55.0, 30.0, 5.0, -20.0]
    truth = {"b_a_x": 0.05, "b_a_y": -0.03, "b_a_z": 0.02, "M_a_xx": 2e-3, "M_a_yy": -1e-3, "M_a_zz": 1e-3,
             "M_a_yx": 0.002, "M_a_zx": -0.001, "M_a_zy": 0.003,
             "b_g_x": 2e-3, "b_g_y": 4e-3, "b_g_z": -2e-3}  # fmt: skip
    total, alarms = [], 0
    for _ in range(runs):
        result = calibrate_thermal(soak_of(levels, plan=18, noise=noise, rng=rng))
        d = np.array([result[n][0] - truth[n] for n in result.names])
        scale = result.sigma
        total.append(d / scale @ np.linalg.solve(result.correlation, d / scale))
        alarms += sum(h["found"] for h in thermal(result)["hysteresis"].values())
    assert len(result.names) == 12
    # the biases are correlated with a false hysteresis in a few runs only
    assert abs(np.mean(total) - 12.0) < 4.0 * np.sqrt(24.0 / runs)
    assert alarms <= 0.04 * 6 * runs
    assert result.variance_of_unit_weight == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / result.freedom))


# -------------------------------------------------------------------------------------------- hysteresis


@pytest.mark.parametrize("size", [3e-4, -3e-4])
def test_inserted_hysteresis_of_a_ramp_is_found(size):
    """A lens that closes at both ends, largest in the middle; within 4 sigma and 10 % (a parabola describes it)."""
    n, sigma = 3000, 1e-4
    T, rng = there_and_back(n), np.random.default_rng(14)
    way = np.sign(np.gradient(T))
    lens = 0.5 * size * way * (1.0 - ((T - 25.0) / 45.0) ** 2)
    Y = curve(T)[:, None] + sigma * rng.standard_normal((n, 3))
    Y[:, 1] += lens
    result = calibrate_thermal(log(T, Y))
    coefficients = {n: thermal(result)["hysteresis"][n] for n in BIAS_G}
    assert [h["found"] for h in coefficients.values()] == [False, True, False]
    h = coefficients["b_g_y"]
    assert abs(h["largest"] - size) < 4.0 * h["sigma"]
    assert h["largest"] == pytest.approx(size, rel=0.1)
    assert h["temperature"] == pytest.approx(25.0, abs=8.0)
    assert any(v.startswith("b_g_y: heating and cooling differ") for v in result.verdicts)
    # the table shows it too, and the middle of both branches is the truth
    table = thermal(result)["table"]["b_g_y"]
    k = int(np.argmax(np.abs(table["gap"])))
    assert abs(table["gap"][k] - size) < 4.0 * table["gap_sigma"][k]
    value, one = thermal_value(result, "b_g_y", np.array([0.0, 25.0, 50.0]))
    assert np.all(np.abs(value - curve(np.array([0.0, 25.0, 50.0]))) < 4.0 * one)
    assert len(thermal(result)["branches"]) == 2


def test_drift_with_time_is_told_from_hysteresis_by_a_third_branch():
    n = 3000
    T, rng = three_ways(n), np.random.default_rng(15)
    Y = curve(T)[:, None] + 1e-4 * rng.standard_normal((n, 3))
    Y[:, 2] += 2e-3 * np.arange(n) / n
    result = calibrate_thermal(log(T, Y))
    again = thermal(result)["hysteresis"]["b_g_z"]["repeatability"]
    # cooling ends at 30 degC: means over 30..50 degC of the first and last branch, 0.83 of the drift apart
    assert again["difference"] == pytest.approx(2e-3 * 0.83, rel=0.1)
    assert again["direction"] == "cooling"
    assert any(v.startswith("b_g_z: two branches of cooling") for v in result.verdicts)
    assert not any(v.startswith("b_g_x: two") for v in result.verdicts)


def test_hysteresis_of_soaks():
    levels = [-20.0, 5.0, 30.0, 55.0, 30.0, 5.0, -20.0]
    result = calibrate_thermal(soak_of(levels, plan=18, noise=5e-4, gap=0.005))
    h = thermal(result)["hysteresis"]
    assert {n for n, v in h.items() if v["found"]} == {"b_a_x", *BIAS_G}
    for name in ("b_a_x", *BIAS_G):
        assert abs(h[name]["largest"] - 0.005) < 4.0 * h[name]["sigma"]
    assert abs(result["b_a_x"][0] - 0.05) < 4.0 * result["b_a_x"][1]


# ------------------------------------------------------------------------------------------------ degree


def test_degree_by_criterion():
    """BIC of whitened residuals finds the degree that was put in, and says when the chosen one is too low."""
    n = 2000
    T, rng = there_and_back(n), np.random.default_rng(16)
    x = (T - 25.0) / 45.0
    Y = 1e-3 * np.stack([x, x**3, x**5], axis=1) + 2e-5 * rng.standard_normal((n, 3))
    coefficients = thermal(calibrate_thermal(log(T, Y), degree="auto"))["degree"]
    assert [coefficients[n] for n in BIAS_G] == [1, 3, 5]
    result = calibrate_thermal(log(T, Y))
    assert [v for v in result.verdicts if "leaves structure" in v] == [
        "b_g_z: degree 3 leaves structure; degree 5 describes it (BIC)"
    ]
    assert min(thermal(result)["criterion"]["b_g_x"].values()) == 0.0


def test_soak_degree_is_limited_by_the_temperatures():
    result = calibrate_thermal(soak_of([0.0, 30.0, 60.0], b=np.zeros((3, 2))), degree=3)
    assert any("3 different temperatures allow degree 2" in v for v in result.verdicts)
    auto = calibrate_thermal(soak_of([-20.0, 0.0, 20.0, 40.0, 60.0], noise=1e-3), degree="auto")
    assert 1 <= thermal(auto)["degree"]["b_a_x"] <= 3


# ------------------------------------------------------------------------------------- temperature sensor


def test_stuck_sensor_is_left_out_and_reported():
    n = 4000
    T, rng = there_and_back(n), np.random.default_rng(17)
    Y = curve(T)[:, None] + 1e-5 * rng.standard_normal((n, 3))
    seen = T + 0.01 * rng.standard_normal(n)
    seen[1000:1200] = seen[1000]
    result = calibrate_thermal(log(seen, Y))
    assert thermal(result)["sensor"]["stuck_samples"] == 200
    assert any("stuck during 200 samples" in v for v in result.verdicts)
    at = np.array([0.0, 25.0, 50.0])
    np.testing.assert_allclose(thermal_value(result, "b_g_x", at)[0], curve(at), atol=3e-6)
    dead = calibrate_thermal(log(np.full(n, 30.0), Y))
    assert dead.status == "refused"
    assert "never changes" in dead.verdicts[-1]
    assert np.isinf(dead.sigma).all()
    with pytest.raises(InputError, match="that was not refused"):
        thermal_correction(dead, 30.0)


@pytest.mark.parametrize("step", [0.25, 1.0])
def test_quantised_sensor_is_bridged(step):
    n = 6000
    T, rng = there_and_back(n), np.random.default_rng(18)
    Y = curve(T)[:, None] + 1e-5 * rng.standard_normal((n, 3))
    result = calibrate_thermal(log(step * np.round(T / step), Y))
    assert thermal(result)["sensor"]["step"] == pytest.approx(step)
    assert any(f"steps of {step:.2g} K" in v for v in result.verdicts)
    at = np.array([-15.0, 0.0, 25.0, 50.0, 65.0])
    # without bridging the error at 65 degC is about the slope times half a step
    np.testing.assert_allclose(thermal_value(result, "b_g_x", at)[0], curve(at), atol=3e-6)
    bridged = thermal_log.repaired(step * np.round(T / step)).T
    assert np.abs(bridged - T).max() <= 0.5 * step
    away = np.abs(T - 70.0) > 2.0 * step
    assert np.abs(bridged - T)[away & (-20.0 + step < T)].max() < 90.0 / 3000.0  # a sample of ramp


def test_small_span():
    n = 1000
    T = there_and_back(n, 20.0, 23.0)
    result = calibrate_thermal(log(T, np.zeros((n, 3))))
    assert result.status == "refused"
    assert "changes by 3 K only" in result.verdicts[-1]
    T = there_and_back(n, 20.0, 32.0)
    result = calibrate_thermal(log(T, curve(T)[:, None] * np.ones(3)))
    assert any("spans 12.0 K only" in v for v in result.verdicts)
    assert calibrate_thermal(soak_of([20.0, 22.0])).status == "refused"


def test_ramp_one_way_cannot_show_hysteresis():
    T = np.linspace(-10.0, 60.0, 1000)
    result = calibrate_thermal(log(T, curve(T)[:, None] * np.ones(3)))
    assert any("hysteresis cannot be checked: the temperature only rises" in v for v in result.verdicts)
    assert not thermal(result)["hysteresis"]["b_g_x"]["checked"]
    assert thermal(result)["hysteresis"]["b_g_x"]["largest"] is None
    assert thermal(result)["table"]["b_g_x"]["gap"][3] is None


def test_branches_of_a_wiggly_ramp():
    T = three_ways(3000) + 0.8 * np.sin(np.arange(3000) / 30.0)
    coefficients = thermal_log.branches(T, 4.0)
    assert [b.direction for b in coefficients] == [-1, 1, -1]
    assert coefficients[0].first == 0
    assert coefficients[-1].last == 3000
    assert abs(coefficients[1].first - 900) < 60
    assert abs(coefficients[1].last - 2250) < 60
    assert thermal_log.branches(np.full(100, 3.0), 1.0) == []


def test_unbelievable_stamps_and_spikes_are_reported():
    n = 2000
    T, rng = there_and_back(n), np.random.default_rng(19)
    Y = curve(T)[:, None] + 1e-5 * rng.standard_normal((n, 3))
    Y[700, 0] += 0.05
    result = calibrate_thermal(log(T, Y, dt=5e-4))
    assert any("not credible" in v for v in result.verdicts)
    assert thermal(result)["sensor"]["spikes"] == 1
    assert abs(result["b_g_x"][0] - CUBIC[0]) < 4.0 * result["b_g_x"][1]


# ------------------------------------------------------------------------------------------------- use


def test_no_extrapolation_unless_asked():
    T = there_and_back(1000)
    result = calibrate_thermal(log(T, curve(T)[:, None] * np.ones(3)))
    b_g, b_a = thermal_correction(result, 30.0)
    assert b_g.shape == b_a.shape == (3,)
    with pytest.raises(InputError, match=r"from -20.0 to 70.0 degC, got 75.0"):
        thermal_correction(result, [30.0, 75.0])
    b_g, _ = thermal_correction(result, [30.0, 75.0], extrapolate=True)
    np.testing.assert_allclose(b_g[:, 0], curve(np.array([30.0, 75.0])), atol=1e-10)
    b_g, _ = thermal_correction(result, [70.0, 75.0], extrapolate=True, method="table")
    assert b_g[0, 0] == b_g[1, 0]
    for bad in ({"name": "b_x"}, {"method": "spline"}):
        with pytest.raises(InputError, match="expected"):
            thermal_value(result, **({"name": "b_g_x", "temperature": 0.0} | bad))


def test_table_follows_the_curve():
    """Linear interpolation of a cubic between knots 5 K apart: error of the second derivative, h^2/8 f''."""
    T = there_and_back(4000)
    result = calibrate_thermal(log(T, curve(T)[:, None] * np.ones(3)), table_step=5.0)
    at = np.linspace(-20.0, 70.0, 50)
    value, _ = thermal_value(result, "b_g_x", at, method="table")
    bend = np.abs(-6e-7 + 24e-9 * (at - 25.0)).max()
    assert np.abs(value - curve(at)).max() < bend * 25.0 / 8.0
    assert thermal(result)["table"]["temperature"][1:3] == [-15.0, -10.0]


def test_everything_in_extra_is_plain():
    for result in (
        calibrate_thermal(log(there_and_back(500), np.zeros((500, 3)))),
        calibrate_thermal(soak_of([0, 30, 60])),
    ):
        assert json.loads(json.dumps(result.extra, allow_nan=False)) == result.extra
        assert result.provenance["method"] == "thermal"


def test_reference_temperature():
    T = there_and_back(1000, 40.0, 90.0)
    imu = log(T, curve(T)[:, None] * np.ones(3))
    assert calibrate_thermal(imu).temperature == 65.0
    result = calibrate_thermal(imu, reference_temperature=50.0)
    assert result["b_g_x"][0] == pytest.approx(float(curve(50.0)), abs=1e-12)
    with pytest.raises(InputError, match=r"40\.0 to 90\.0 degC, got 20"):
        calibrate_thermal(imu, reference_temperature=20.0)


def test_what_cannot_be():
    imu = log(there_and_back(500), np.zeros((500, 3)))
    with pytest.raises(InputError, match="log with temperature"):
        calibrate_thermal(replace(imu, temperature=None))
    with pytest.raises(InputError, match="0 to 9 or 'auto'"):
        calibrate_thermal(imu, degree=-1)
    with pytest.raises(InputError, match="table_step"):
        calibrate_thermal(imu, table_step=0.0)
    with pytest.raises(InputError, match="cannot tell scale from bias"):
        calibrate_thermal(imu, scale=True)
    with pytest.raises(InputError, match="60 samples"):
        calibrate_thermal(log(there_and_back(20), np.zeros((20, 3))))
    with pytest.raises(InputError, match="noise: expected positive"):
        calibrate_thermal(imu, noise=(0.0, 1.0))
    with pytest.raises(InputError, match="expected poses"):
        calibrate_thermal([])
    poses = soak_of([0.0, 30.0])
    with pytest.raises(InputError, match="number 1 has none"):
        calibrate_thermal([poses[0], replace(poses[1], temperature=None)])


def test_poses_in_one_plane_are_refused_with_advice():
    flat = [p.of([4, 5]) for p in soak_of([0.0, 20.0, 40.0, 60.0])]
    result = calibrate_thermal(flat)
    assert result.status == "refused"
    assert "each axis points up once and down once" in result.verdicts[-1]


# --------------------------------------------------------------------------------------------- real data


@pytest.mark.realdata
def test_real_chamber_log(shared_data):
    """A unit cooled, heated, cooled between -17.6 and 74 degC. Residuals of the cubics as its README prints them
    (printed digits); where hysteresis is found, the cubic is the middle of the branches and leaves at most 3 % more."""
    d = np.genfromtxt(shared_data / "imu_thermal" / "imu_raw_data.csv", delimiter="\t", skip_header=1)
    imu = ImuSeries((d[:, 0] - d[0, 0]) * 1e-9, d[:, 1:4], d[:, 4:7], temperature=d[:, 8])
    result = calibrate_thermal(imu)
    th = thermal(result)
    assert result.status == "warning"
    assert set(th["degree"].values()) == {3}
    assert [b["direction"] for b in th["branches"]] == ["cooling", "heating", "cooling"]
    np.testing.assert_allclose(th["range"], [-17.60, 73.97], atol=0.01)
    left = compensate_thermal(result, imu)
    np.testing.assert_allclose(left.gyro.std(axis=0)[1:], [0.00095, 0.0014], atol=6e-6)
    printed = np.array([0.00415, 0.0064, 0.0173, 0.0443])
    coefficients = np.array([left.gyro[:, 0].std(), *left.accel.std(axis=0)])
    assert np.all((coefficients > 0.99 * printed) & (coefficients < 1.03 * printed))
    h = th["hysteresis"]
    assert all(h[n]["found"] for n in ("b_g_x", "b_a_y", "b_a_z"))
    assert not h["b_g_y"]["found"]
    # heating lies above cooling by 0.13 m/s^2 at 30 degC in z: read off the plot of the log
    assert h["b_a_z"]["largest"] == pytest.approx(0.13, abs=0.02)
    assert h["b_a_z"]["temperature"] == pytest.approx(30.0, abs=10.0)
    message = " ".join(result.verdicts)
    assert "92 K within 4.24 s is not credible" in message
    assert "b_g_x: two branches of cooling differ" in message


@pytest.mark.parametrize("page", ["calibration-thermal.md", "calibration-plans.md"])
def test_documented_examples_run(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert examples
    for example in examples:
        exec(example, {})


@pytest.mark.campaign
def test_figure_has_every_parameter(tmp_path):
    from schuler.calibration.report.thermal_figure import thermal_figure

    T, rng = there_and_back(1000), np.random.default_rng(20)
    ramp = calibrate_thermal(log(T, curve(T)[:, None] + 1e-5 * rng.standard_normal((1000, 3))))
    soak = calibrate_thermal(soak_of([-20.0, 5.0, 30.0, 55.0, 30.0, 5.0], noise=1e-3, gap=0.005))
    for result, n in ((ramp, 6), (soak, 9)):
        figure = thermal_figure(result)
        assert len([ax for ax in figure.axes if ax.get_visible()]) == n
        labels = {label for ax in figure.axes for label in ax.get_legend_handles_labels()[1]}
        assert {"polynomial, 3 sigma", "heating", "cooling"} <= labels
        figure.savefig(tmp_path / "thermal.png", dpi=60)
    with pytest.raises(InputError, match="not refused"):
        thermal_figure(calibrate_thermal(log(np.full(100, 3.0), np.zeros((100, 3)))))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [there_and_back, three_ways])
@pytest.mark.parametrize("slow", [0.0, 5e-7, 5e-6])
def test_full_campaign_of_ramps_with_unknown_noise(shape, slow):
    """200 logs: RMS of the normalised error between 0.5 and 1.4, false hysteresis in 8 % at most (statistical)."""
    from schuler.sensors.noise import RandomWalk

    process = RandomWalk(slow) if slow else None
    rms, alarms = ramps_with_unknown_noise(shape(3000), process, 200, np.random.default_rng(21))
    assert 0.5 < rms < 1.4
    assert alarms < 0.08 * 6 * 200
