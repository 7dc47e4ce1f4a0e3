"""What a free-pose calibration refuses, warns of and puts up with."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.freepose.verdicts import listed, missing_directions
from schuler.calibration.freepose.weights import (
    excess_spread,
    largest_reduced_chi2,
    median,
    outlier_weights,
    residual_factor,
)
from schuler.calibration.result.parameters import vector
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.standstill.variance_ratio import intervals_below
from schuler.units import G0

N_G, N_A = 3e-4, 2e-3
ERRORS = ImuErrors(
    b_g=[0.01, -0.02, 0.005], b_a=[0.2, 0.1, -0.3], M_g=0.01 * np.arange(-4, 5).reshape(3, 3),
    M_a=[[0.01, 0.02, -0.01], [0.0, -0.01, 0.03], [0.0, 0.0, 0.02]],
    gyro_noise=NoiseModel((White(N_G),)), accel_noise=NoiseModel((White(N_A),)),
)  # fmt: skip
SIX = 0.5 * np.pi * np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]])


def log_of(n=20, seed=1, errors=ERRORS, **options):
    rng = np.random.default_rng(seed)
    return hand_log(errors, rng, rotvecs=options.pop("rotvecs", spread_turns(n, rng)), **options)


@pytest.mark.parametrize("poses", [2, 5, 8])
def test_too_few_poses_are_refused_with_what_to_collect(poses):
    result = calibrate_freepose(log_of(poses))
    assert result.status == "refused"
    assert np.isinf(result.sigma).all()
    assert f"{poses} poses at rest found; nine accelerometer parameters need nine" in result.verdicts[0]
    assert "put up next:" in result.next_pose
    assert result.extra["poses"] == poses
    assert result.provenance["method"] == "freepose"


def test_a_still_log_is_refused():
    result = calibrate_freepose(log_of(2).between(0.0, 18.0))
    assert result.status == "refused"
    assert "1 pose at rest" in result.verdicts[0]
    # level: up is -z, so that face is the only one not asked for... with one pose no direction is believed
    assert "x up" in result.next_pose


def test_a_log_without_rest_is_refused():
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(4000)
    imu = ImuSeries(
        t,
        np.cumsum(rng.standard_normal((4000, 3)), axis=0) * 0.1,
        5.0 * np.cumsum(rng.standard_normal((4000, 3)), axis=0),
    )
    result = calibrate_freepose(imu)
    assert result.status == "refused"


def test_many_poses_of_six_kinds_are_refused():
    """Faces only, again and again: off-diagonal elements are not seen."""
    result = calibrate_freepose(log_of(rotvecs=np.tile(SIX, (3, 1)) * 1.0))
    assert result.status in ("refused", "warning")
    named = " ".join(result.verdicts)
    for name in ("M_a_xy", "M_a_xz", "M_a_yz"):
        assert name in named
    assert "45 deg" in result.next_pose  # an edge, not a face


def test_refused_says_which_faces_are_missing():
    text = missing_directions(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]), 3)
    assert text == "x down; y down; z down"


def test_turns_about_one_axis_leave_gyroscopes_undetermined():
    """All turns about body x: nothing but the x column of M_g is seen."""
    rotvecs = np.zeros((14, 3))
    rotvecs[:, 0] = 0.9
    rotvecs[6:8] = [0.0, 1.4, 0.0]
    result = calibrate_freepose(log_of(rotvecs=rotvecs))
    assert result.status in ("warning", "refused")


def test_gyroscopes_with_other_axes_are_not_believed():
    imu = log_of()
    swapped = replace(imu, gyro=np.ascontiguousarray(imu.gyro[:, [1, 0, 2]]))
    result = calibrate_freepose(swapped)
    assert result.status == "warning"
    assert "same axes and signs" in result.verdicts[0]
    assert np.isinf(result.sigma[12:21]).all()
    np.testing.assert_array_less(result.sigma[:9], 0.02)
    np.testing.assert_allclose(result.values[:9], calibrate_freepose(imu).values[:9], atol=1e-12)


def test_a_gap_drops_its_turn_only():
    imu = log_of()
    intervals = calibrate_freepose(imu).extra["intervals"]
    middle = 0.5 * (intervals[4][1] + intervals[5][0])
    keep = np.abs(imu.t - middle) > 0.2
    rates = imu.rates()
    cut = ImuSeries(rates.t[keep], rates.gyro[keep], rates.accel[keep])
    result = calibrate_freepose(cut)
    assert result.extra["poses"] == 20
    assert result.extra["turns"] == 18
    assert result.status == "ok"


def test_excess_scatter_is_said_and_counted():
    """Each pose off by 20 mm/s^2 (a table that gives way): sigma grows, and errors are as large as it says."""
    imu = log_of(24).rates()
    rng = np.random.default_rng(6)
    accel = imu.accel.copy()
    spans = calibrate_freepose(imu).extra["intervals"]
    for a, b in spans:
        part = (imu.t > a - 0.3) & (imu.t < b + 0.3)
        accel[part] *= 1.0 + 0.02 / G0 * rng.standard_normal()
    result = calibrate_freepose(replace(imu, accel=accel))
    clean = calibrate_freepose(imu)
    assert any("beyond noise" in v for v in result.verdicts)
    assert not any("beyond noise" in v for v in clean.verdicts)
    assert result.variance_of_unit_weight > 10.0
    assert (result.sigma[:9] > 4.0 * clean.sigma[:9]).all()
    z = ((result.values - vector(ERRORS, result.names)) / result.sigma)[:9]
    assert (z**2).mean() < 4.0  # statistical, nine numbers


def test_one_disturbed_pose_counts_for_little():
    """A pose that reads 0.5 m/s^2 too much moves a least-squares fit by many sigma, a robust one hardly."""
    imu = log_of(24).rates()
    a, b = calibrate_freepose(imu).extra["intervals"][7]
    accel = imu.accel.copy()
    accel[(imu.t > a - 0.3) & (imu.t < b + 0.3)] *= 1.05
    disturbed = replace(imu, accel=accel)
    clean, robust = calibrate_freepose(imu), calibrate_freepose(disturbed)
    plain = calibrate_freepose(disturbed, robust=False)
    assert "Pose 8 does not fit the others" in " ".join(robust.verdicts)
    moved = np.abs(robust.values - clean.values)[:9] / clean.sigma[:9]
    moved_plain = np.abs(plain.values - clean.values)[:9] / clean.sigma[:9]
    assert moved.max() < 3.0
    assert moved_plain.max() > 5.0 * moved.max()


def test_one_disturbed_turn_counts_for_little():
    imu = log_of(24).rates()
    intervals = calibrate_freepose(imu).extra["intervals"]
    middle = 0.5 * (intervals[9][1] + intervals[10][0])
    gyro = imu.gyro.copy()
    gyro[np.abs(imu.t - middle) < 0.1] += [1.0, -1.0, 1.0]
    disturbed = replace(imu, gyro=gyro)
    clean, robust = calibrate_freepose(imu), calibrate_freepose(disturbed)
    plain = calibrate_freepose(disturbed, robust=False)
    assert "Turn 10 does not fit the others" in " ".join(robust.verdicts)
    moved = np.abs(robust.values - clean.values)[12:] / clean.sigma[12:]
    moved_plain = np.abs(plain.values - clean.values)[12:] / clean.sigma[12:]
    assert moved.max() < 4.0
    assert moved_plain.max() > 3.0 * moved.max()


def test_given_intervals_are_used():
    imu = log_of()
    calibration = calibrate_freepose(imu)
    spans = [tuple(s) for s in calibration.extra["intervals"]]
    again = calibrate_freepose(imu, intervals=spans)
    np.testing.assert_allclose(again.values, calibration.values, atol=1e-12)
    assert np.isnan(again.extra["margin"])
    fewer = calibrate_freepose(imu, intervals=spans[:15])
    assert fewer.extra["poses"] == 15


def test_rests_are_found_where_they_are():
    """20 s, then 2 s turns and 3 s rests: every rest, and no sample of a turn but its slow beginning."""
    result = calibrate_freepose(log_of())
    spans = np.array(result.extra["intervals"])
    k = np.arange(1, 20)
    begin = 20.0 + 5.0 * k - 3.0
    assert len(spans) == 20
    assert (spans[1:, 0] > begin - 0.3).all()
    assert (spans[1:, 1] < begin + 3.0 + 0.3).all()
    assert (spans[1:, 1] - spans[1:, 0] > 1.5).all()


def test_intervals_are_cut_at_gaps():
    t = np.concatenate((0.01 * np.arange(300), 5.0 + 0.01 * np.arange(300)))
    index = intervals_below(t, 0.01, np.array([299]), np.zeros(600), 3.0, 1.0)
    np.testing.assert_array_equal(index, [[0, 300], [300, 600]])


def test_initial_rest_gives_the_bias():
    """The bias moves after the first 20 s; the initial rest is asked for, or all rests when it is short."""
    imu = log_of().rates()
    gyro = imu.gyro + np.where(imu.t[:, None] > 20.0, 0.02, 0.0)
    moved = replace(imu, gyro=gyro)
    asked = calibrate_freepose(moved, initial_rest_s=15.0)
    n = np.searchsorted(imu.t, imu.t[0] + 15.0)
    np.testing.assert_allclose(asked.values[9:12], gyro[:n].mean(axis=0), atol=1e-15)
    assert asked.extra["seconds_of_bias"] == pytest.approx(15.0, abs=0.011)
    free = calibrate_freepose(moved, gyro_bias="estimate")
    np.testing.assert_allclose(free.values[9:12], ERRORS.b_g + 0.02, atol=5.0 * free.sigma[9:12].max())
    short = calibrate_freepose(log_of(initial_rest_s=4.0))
    assert short.extra["seconds_of_bias"] > 40.0


def test_stated_noise_that_is_too_large_is_said():
    result = calibrate_freepose(log_of(), noise=(10 * N_G, 10 * N_A))
    assert any("smaller than the noise stated" in v for v in result.verdicts)
    assert result.variance_of_unit_weight < 0.1


def test_noise_from_the_log_is_the_noise(rng):
    """Sigma without and with stated noise: statistical, 15 % of noise from 20 poses of 3 s.

    A quarter for the bias at rest, whose sigma has the scatter between 20 rests of an axis in it.
    """
    imu = log_of()
    ratio = calibrate_freepose(imu).sigma / calibrate_freepose(imu, noise=(N_G, N_A)).sigma
    np.testing.assert_allclose(np.delete(ratio, [9, 10, 11]), 1.0, atol=0.15)
    np.testing.assert_allclose(ratio[9:12], 1.0, atol=0.25)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gravity": 0.0}, "gravity: expected"),
        ({"gyro_bias": "known"}, "gyro_bias: expected 'rest' or 'estimate'"),
        ({"nominal": (1.0, -1.0)}, "nominal: expected two positive"),
        ({"initial_rest_s": 0.1}, "initial_rest_s: expected a second"),
        ({"min_s": 0.0}, "min_s: expected a positive time"),
        ({"intervals": [(0.0, 0.1)]}, "intervals: expected rests one after another"),
        ({"intervals": [(0.0, 5.0), (4.0, 9.0)]}, "intervals: expected rests one after another"),
    ],
)
def test_what_makes_no_sense(options, message):
    with pytest.raises(InputError, match=message):
        calibrate_freepose(log_of(3), **options)


def test_a_short_log():
    imu = ImuSeries(0.01 * np.arange(50), np.zeros((50, 3)), np.ones((50, 3)))
    with pytest.raises(InputError, match="ten windows"):
        calibrate_freepose(imu)


def test_words():
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"


def test_weights():
    np.testing.assert_allclose(outlier_weights(np.array([0.0, 3.0, 6.0]), 1), [1.0, 1.0, 0.25])
    np.testing.assert_allclose(residual_factor(np.array([0.0, 0.75, 1.0])), [1.0, 0.5, 0.2])
    assert median(np.array([[3.0], [1.0], [2.0], [9.0]]))[0] == 2.5
    # chi-square with 10 degrees of freedom: 29.59 once in a thousand; the approximation is good to 1 %
    assert largest_reduced_chi2(10) == pytest.approx(2.959, rel=0.01)


@pytest.mark.parametrize("components", [1, 2, 3])
@pytest.mark.parametrize("robust", [True, False])
def test_spread_beyond_noise(components, robust):
    """Statistical: 4000 residuals of noise 1 and spread 2."""
    rng = np.random.default_rng(9)
    sigma = rng.uniform(0.5, 1.5, 4000)
    e = rng.standard_normal((4000, components)) * np.sqrt(sigma**2 + 4.0)[:, None]
    assert excess_spread(np.linalg.norm(e, axis=1), sigma, components, robust) == pytest.approx(2.0, rel=0.07)
    e = rng.standard_normal((4000, components)) * sigma[:, None]
    assert excess_spread(np.linalg.norm(e, axis=1), sigma, components, robust) == 0.0


def test_many_outliers_are_none():
    """A third of the poses off: no majority to believe, so all count alike and the scatter is stated."""
    imu = log_of(24).rates()
    accel = imu.accel.copy()
    for a, b in calibrate_freepose(imu).extra["intervals"][::3]:
        accel[(imu.t > a - 0.3) & (imu.t < b + 0.3)] *= 1.02
    result = calibrate_freepose(replace(imu, accel=accel))
    assert not any("does not fit the others" in v and v.startswith("Pose") for v in result.verdicts)
    assert result.extra["spread_accel"] > 0.02


def test_g_sensitivity_is_estimated_where_the_log_proves_it():
    """Without being asked for; switched off it is offered; a log without it has none, and no word of it."""
    G = 2e-4 * np.array([[1.0, -0.5, 0.2], [0.3, -1.0, 0.6], [-0.4, 0.8, 0.7]])
    imu = log_of(errors=replace(ERRORS, G_g=G))
    calibration = calibrate_freepose(imu)
    values = np.array([calibration[f"G_g_{i}{j}"] for i in "xyz" for j in "xyz"])
    assert (np.abs(values[:, 0] - G.ravel()) < 4.0 * values[:, 1]).all()  # statistical
    assert any("g_sensitivity=False switches it off" in v for v in calibration.verdicts)
    off = calibrate_freepose(imu, g_sensitivity=False)
    assert any("g_sensitivity=True estimates it" in v for v in off.verdicts)
    assert "G_g_xx" not in off.names
    plain = calibrate_freepose(log_of())
    assert "G_g_xx" not in plain.names
    assert not any("g_sensitivity" in v for v in plain.verdicts)
