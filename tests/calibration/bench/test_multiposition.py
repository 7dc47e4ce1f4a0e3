"""Both triads from many poses: exactness, covariance in the gauge of the result, orders, verdicts."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.calibration.bench.model_order import order_tests, recommended
from schuler.calibration.bench.multiposition import OWN_AXES, calibrate_multiposition
from schuler.calibration.bench.poses import Poses, poses_of
from schuler.calibration.bench.sensor_geometry import triad_derivative, triad_matrix
from schuler.calibration.bench.triad import to_model, triad_names
from schuler.calibration.bench.triad_pair import pair_conditions
from schuler.calibration.design.plans import ATTITUDES
from schuler.calibration.design.pose_advice import next_directions, reasons
from schuler.calibration.result.parameters import MATRIX_G, imu_errors
from schuler.earth import earth_rate_ned
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.reproduce.hayal.study.attitudes import study_attitudes
from schuler.rotation import dcm_from_rotvec
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.standstill.stationarity import static_intervals
from schuler.units import DEG

G, LAT = 9.801, 40.0 * DEG
SIGMA_F, SIGMA_W = 2.733e-4, 2.71e-6
B_A, S_A, TH_A = np.array((0.010, -0.02, 0.03)), np.array((3e-4, -2e-4, 5e-4)), np.array((1e-4, -3e-4, 2e-4))
B_G, S_G, TH_G = np.array((4.8e-6, -9e-6, 2e-6)), np.array((1.5e-4, -1e-4, 2e-4)), np.array((-1e-4, 2e-4, 3e-4))
M_A, M_G = triad_matrix(S_A, TH_A), triad_matrix(S_G, TH_G)
TRUTH = {
    **dict(zip(triad_names("a"), np.concatenate((B_A, (M_A - np.eye(3))[np.tril_indices(3)])), strict=True)),
    **dict(zip(triad_names("g"), np.concatenate((B_G, (M_G - np.eye(3))[np.tril_indices(3)])), strict=True)),
}


def simulated(
    rng, noise=1.0, *, directions=ATTITUDES, rate=0.0, sigma_w=SIGMA_W, b_g=B_G, disturbance=2.0 * DEG
) -> Poses:
    """Poses as the sensors see them; ``rate`` is that of a table about its vertical, averaged over whole turns."""
    n = len(directions)
    C = study_attitudes(directions, 20.0 * DEG, disturbance, rng)
    rate = np.broadcast_to(rate, (n,))
    up = rate + earth_rate_ned(LAT)[2] * -1.0
    omega_n = np.column_stack((np.where(rate == 0.0, earth_rate_ned(LAT)[0], 0.0), np.zeros(n), -up))
    f = C @ (0.0, 0.0, -G) @ M_A.T + B_A + noise * SIGMA_F * rng.standard_normal((n, 3))
    w = np.einsum("ijk,ik->ij", C, omega_n) @ M_G.T + b_g + noise * sigma_w * rng.standard_normal((n, 3))
    start = 200.0 * np.arange(n)
    return Poses(f, w, np.full((n, 3), SIGMA_F), np.full((n, 3), sigma_w), start, start + 180.0)


def words(result) -> str:
    return "\n".join(result.verdicts)


# ---------------------------------------------------------------------------------------------- perfect data


def test_perfect_data_returns_what_was_put_in(rng):
    result = calibrate_multiposition(simulated(rng, 0.0), gravity=G, gyro_order=9)
    assert result.gauge == "lower"
    assert result.names == triad_names("a") + triad_names("g")
    for name, value in TRUTH.items():
        assert result[name][0] == pytest.approx(value, abs=1e-12), name  # rounding
    np.testing.assert_allclose(result.history[-1], result.values, rtol=0, atol=0)
    np.testing.assert_allclose(result.residuals["accel"].value, 0.0, atol=1e-12)
    assert np.abs(result.residuals["accel"].before).max() > 0.01
    assert len(result.residuals["gyro"].label) == 26


@pytest.mark.parametrize("gauge", ["upper", "symmetric"])
def test_perfect_data_in_other_gauges(rng, gauge):
    """The accelerometers alone: M symmetric or upper triangular describes the same readings in turned axes."""
    poses = simulated(rng, 0.0)
    result = calibrate_multiposition(poses, gravity=G, gyro_order=0).in_gauge(gauge)
    truth = calibrate_multiposition(poses, gravity=G, gyro_order=0).errors
    f = np.linalg.solve(np.eye(3) + result.errors.M_a, (poses.f - result.errors.b_a).T).T
    np.testing.assert_allclose(np.linalg.norm(f, axis=1), G, rtol=1e-13)
    assert result.gauge == gauge
    np.testing.assert_allclose(result.errors.b_a, truth.b_a, atol=1e-14)


def test_gyroscopes_in_axes_of_their_own_are_not_turned(rng):
    result = calibrate_multiposition(simulated(rng, 0.0), gravity=G, gyro_order=9)
    with pytest.raises(InputError, match="M_g of this calibration is in the gyroscopes' own axes"):
        result.in_gauge("upper")


def test_the_result_takes_the_errors_out_of_a_log(rng):
    result = calibrate_multiposition(simulated(rng, 0.0), gravity=G, gyro_order=9)
    f, w = rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    log = ImuSeries(np.arange(50) * 0.01, w @ M_G.T + B_G, f @ M_A.T + B_A)
    clean = result.apply(log)
    np.testing.assert_allclose(clean.accel, f, atol=1e-11)
    np.testing.assert_allclose(clean.gyro, w, atol=1e-11)


@pytest.mark.parametrize("order", [3, 6])
def test_fewer_parameters_hold_the_others(rng, order):
    result = calibrate_multiposition(simulated(rng), gravity=G, accel_order=order, gyro_order=0)
    held = {n for n in triad_names("a")[3:] if order == 3 or n[-1] != n[-2]}
    assert set(result.fixed) == held
    assert not any(result.fixed.values())
    assert len(result.names) == order


# ------------------------------------------------------------------------------------------------- covariance


def test_derivative_of_the_sensor_model_is_the_numerical_one():
    x = np.concatenate((B_A, [0.1, -0.05, 0.2], [0.3, -0.2, 0.1]))
    values, J = to_model(x)
    np.testing.assert_array_equal(values[:3], B_A)
    for i in range(9):
        h = 1e-6 * np.eye(9)[i]
        np.testing.assert_allclose(J[:, i], (to_model(x + h)[0] - to_model(x - h)[0]) / 2e-6, atol=1e-9)
    assert J[3:, 3:].any()
    np.testing.assert_array_equal(J[3, 3:], triad_derivative(x[3:6], x[6:])[0, 0])


@pytest.mark.thinned(3)
@pytest.mark.parametrize("runs", [12, 24, 60])
def test_predicted_covariance_is_the_scatter(rng, runs):
    """Statistical: normalised errors squared of both triads, gyroscopes on a fast table; chi-square of 18."""
    rate = np.tile((0.73, -0.73), 13)
    nees, outside = [], 0
    for _ in range(runs):
        moving = simulated(rng, rate=rate)
        poses = Poses(simulated(rng).f, moving.omega, moving.sigma_f, moving.sigma_omega, moving.start, moving.stop)
        result = calibrate_multiposition(poses, gravity=G, latitude=LAT, table_rate=rate, gyro_order=9)
        error = result.values - np.array([TRUTH[n] for n in result.names])
        inflation = np.repeat([result.extra[k]["inflation"] for k in ("accel", "gyro")], 9)
        nees.append(error @ np.linalg.solve(result.covariance / np.sqrt(np.outer(inflation, inflation)), error))
        outside += result.status != "ok"
    low, high = chi2.ppf((0.001, 0.999), 18 * runs)
    assert low < np.sum(nees) < high
    assert outside <= 8  # two global tests and two outlier tests at 1 % each


def test_too_small_a_noise_is_noticed_and_made_up_for(rng):
    result = calibrate_multiposition(simulated(rng, 5.0), gravity=G, gyro_order=0, halves=False)
    assert result.status == "warning"
    assert "times as large as the noise explains" in words(result)
    normal = calibrate_multiposition(simulated(rng, 1.0), gravity=G, gyro_order=0, halves=False)
    ratio = result.sigma / normal.sigma
    np.testing.assert_allclose(ratio, np.sqrt(result.variance_of_unit_weight), rtol=0.1)  # other tilts
    generous = calibrate_multiposition(simulated(rng, 0.1), gravity=G, gyro_order=0)
    assert "less than stated" in words(generous)


# ----------------------------------------------------------------------------------------- gyroscopes: reference


def test_earth_rate_tells_the_bias_and_no_more(rng):
    result = calibrate_multiposition(simulated(rng), gravity=G)
    assert result.extra["gyro"]["order"] == 3
    assert set(result.fixed) == set(triad_names("g")[3:])
    assert "3 parameters are enough" in words(result)
    assert "rotation between the triads" in words(result)
    np.testing.assert_array_less(np.abs(result.errors.b_g - B_G), 5e-6)


def test_what_the_data_sheet_knows_better_is_refused(rng):
    spec = catalogue.spec("HG1700")
    for order in ("auto", 9, 6):
        result = calibrate_multiposition(simulated(rng), gravity=G, gyro_order=order, prior_spec=spec)
        assert "refused: the data sheet knows them better" in words(result)
        left = result.observability
        assert left["M_g_xx"] == pytest.approx(1.0, abs=1e-3)
        assert left["b_g_x"] < 0.5
        assert left["M_a_xx"] < 0.1
        assert abs(result["M_g_zz"][0]) < 0.1 * spec.gyro.scale_factor
        assert result.status == "ok"
        assert result["b_g_y"][1] < 1.5e-6
    calibration = calibrate_multiposition(
        simulated(rng, rate=0.73), gravity=G, latitude=LAT, table_rate=0.73, prior_spec=spec, gyro_order=9
    )
    assert "refused" not in words(calibration)


def test_a_data_sheet_does_not_hide_what_poses_do_not_determine(rng):
    """Six faces: the accelerometers' angles stay undetermined, the gyroscopes' on a table go back with the reason."""
    spec = catalogue.spec("HG1700")
    faces = simulated(rng, directions=ATTITUDES[:6], disturbance=0.0, rate=0.73)
    options = {"gravity": G, "latitude": LAT, "table_rate": 0.73, "prior_spec": spec}
    result = calibrate_multiposition(faces, accel_order=9, gyro_order=0, **options)
    assert result.status == "refused"
    assert "theta_zx not determined" in words(result)
    result = calibrate_multiposition(faces, accel_order=0, gyro_order=9, **options)
    assert result.observability["M_g_zy"] == pytest.approx(1.0, abs=1e-3)
    assert result.observability["M_g_zz"] < 0.1
    assert "gyroscopes: theta_zx not determined: no pose with y and z both inclined" in words(result)


def test_a_data_sheet_as_prior(rng):
    spec = catalogue.spec("HG1700")
    result = calibrate_multiposition(simulated(rng), gravity=G, gyro_order=9, prior_spec=spec, use_prior=True)
    assert max(result.observability.values()) <= 1.0 + 1e-6
    assert result["b_g_x"][1] < 1.2e-6


def test_noise_that_buries_earth_rate(rng):
    b = np.array((0.01, -0.02, 0.005))
    result = calibrate_multiposition(simulated(rng, sigma_w=1e-4, b_g=b), gravity=G)
    assert "buries" in words(result)
    assert result.status == "warning"
    assert np.all(np.abs(result.errors.b_g - b) < 4 * result.sigma[-3:])
    assert result["b_g_x"][1] < 7.3e-5


def test_a_table_both_ways(rng):
    rate = np.tile((0.73, -0.73), 26)
    poses = simulated(rng, 0.0, directions=np.repeat(ATTITUDES, 2, axis=0), rate=rate)
    result = calibrate_multiposition(poses, gravity=G, latitude=LAT, table_rate=rate, gyro_order=9)
    for name in triad_names("g"):
        assert result[name][0] == pytest.approx(TRUTH[name], abs=1e-12), name


def test_forgetting_earth_rate_on_a_table(rng):
    """One way only, the scale factors are off by omega_ie sin(latitude) over the rate: 64 ppm (digest 5.2)."""
    poses = simulated(rng, 0.0, rate=0.729)
    result = calibrate_multiposition(poses, gravity=G, latitude=0.0, table_rate=0.729, gyro_order=9)
    off = np.diag(result.errors.M_g) - np.diag(M_G) + 1.0
    np.testing.assert_allclose(off, 7.292115e-5 * np.sin(LAT) / 0.729, rtol=1e-3)


def test_poses_on_a_turning_table_are_left_out_for_the_accelerometers(rng):
    rate = np.concatenate((np.zeros(26), np.full(26, 0.73)))
    poses = simulated(rng, 0.0, directions=np.vstack((ATTITUDES, ATTITUDES)), rate=rate)
    poses.f[26:] += 0.05  # centripetal
    result = calibrate_multiposition(poses, gravity=G, latitude=LAT, table_rate=rate)
    assert len(result.residuals["accel"].value) == 26
    assert len(result.residuals["gyro"].value) == 52
    assert result["b_a_x"][0] == pytest.approx(B_A[0], abs=1e-11)


# ----------------------------------------------------------------------------------- rotation between the triads


def turned(rng, C_bs, noise, sigma_w=3e-9, n=None) -> Poses:
    """Poses of a unit whose gyroscopes' own axes are turned, with gyroscopes of navigation grade."""
    C = study_attitudes(ATTITUDES[:n], 20.0 * DEG, 2.0 * DEG, rng)
    f = C @ (0.0, 0.0, -G) @ M_A.T + B_A + noise * SIGMA_F * rng.standard_normal((len(C), 3))
    w = C @ earth_rate_ned(LAT) @ (M_G @ C_bs.T).T + B_G + noise * sigma_w * rng.standard_normal((len(C), 3))
    start = 200.0 * np.arange(len(C))
    return Poses(f, w, np.full((len(C), 3), SIGMA_F), np.full((len(C), 3), sigma_w), start, start + 180.0)


TURN = np.array((1e-3, -2e-3, 3e-3))


def full_truth() -> np.ndarray:
    M = M_G @ dcm_from_rotvec(TURN).T - np.eye(3)
    return np.concatenate(([TRUTH[n] for n in triad_names("a")], B_G, M.ravel()))


def test_inner_product_ties_the_triads_together(rng):
    """f . omega = + g omega_ie sin(lat): both point against down. Perfect data, to rounding."""
    poses = turned(rng, dcm_from_rotvec(TURN), 0.0)
    result = calibrate_multiposition(poses, gravity=G, latitude=LAT, gyro_order=9, between_triads=True)
    assert result.names[-9:] == MATRIX_G
    np.testing.assert_allclose(result.values, full_truth(), atol=1e-12)
    np.testing.assert_allclose(result.extra["turn"]["value"], TURN, atol=1e-12)
    assert "turned against the accelerometers by 0.001" in words(result)
    assert OWN_AXES not in result.verdicts
    np.testing.assert_allclose(result.residuals["inner product"].value, 0.0, atol=1e-16)


@pytest.mark.campaign
@pytest.mark.thinned(3)
@pytest.mark.parametrize("runs", [8, 16, 40])
def test_covariance_with_the_rotation(rng, runs):
    """Statistical: chi-square of 21."""
    nees = []
    for _ in range(runs):
        poses = turned(rng, dcm_from_rotvec(TURN), 1.0)
        result = calibrate_multiposition(poses, gravity=G, latitude=LAT, gyro_order=9, between_triads=True)
        error = result.values - full_truth()
        factor = result.variance_of_unit_weight if "both triads together" in words(result) else 1.0
        nees.append(factor * error @ np.linalg.solve(result.covariance, error))
    low, high = chi2.ppf((0.001, 0.999), 21 * runs)
    assert low < np.sum(nees) < high


def test_derivatives_of_three_conditions_are_the_numerical_ones(rng):
    """With numbers of size one, so that one step suits all."""
    Y, x, C = rng.normal(size=(4, 6)), 0.2 * rng.standard_normal(18), dcm_from_rotvec((0.3, -0.2, 0.4))
    zero, h = np.zeros((4, 3)), 1e-6
    _, A, B = pair_conditions(Y, x, C, zero)
    for i in range(21):
        d = h * np.eye(21)[i]
        up, down = (pair_conditions(Y, x + s * d[:18], dcm_from_rotvec(s * d[18:]) @ C, zero)[0] for s in (1.0, -1.0))
        np.testing.assert_allclose(A[:, :, i], (up - down) / (2 * h), atol=2e-8)
    for i in range(6):
        d = h * np.eye(6)[i]
        up, down = (pair_conditions(Y + s * d, x, C, zero)[0] for s in (1.0, -1.0))
        np.testing.assert_allclose(B[:, :, i], (up - down) / (2 * h), atol=2e-8)


def test_tactical_gyroscopes_cannot_tell_the_rotation_better_than_their_sheet(rng):
    poses = turned(rng, np.eye(3), 1.0, sigma_w=SIGMA_W)
    spec = catalogue.spec("HG1700")
    result = calibrate_multiposition(poses, gravity=G, latitude=LAT, between_triads=True, prior_spec=spec)
    assert "misalignment is smaller than this uncertainty" in words(result)
    assert result.observability["M_g_xy"] > 1.0
    poses = turned(rng, np.eye(3), 1.0, sigma_w=1e-4)
    refused = calibrate_multiposition(poses, gravity=G, latitude=LAT, between_triads=True)
    assert refused.status == "refused"
    assert "rotation between the triads not determined" in words(refused)
    with pytest.raises(InputError, match="latitude"):
        calibrate_multiposition(poses, gravity=G, between_triads=True)


# ----------------------------------------------------------------------------------------------- two-stage use


def test_angles_of_an_earlier_calibration(rng):
    earlier = calibrate_multiposition(simulated(rng, 0.0), gravity=G, gyro_order=0)
    faces = simulated(rng, 0.0, directions=ATTITUDES[:6])
    for fixed in (earlier, {f"theta_a_{n}": v for n, v in zip(("yz", "zx", "zy"), TH_A, strict=True)}):
        result = calibrate_multiposition(faces, gravity=G, accel_order=6, gyro_order=0, fixed=fixed)
        for name in triad_names("a"):
            assert result[name][0] == pytest.approx(TRUTH[name], abs=1e-12), name
        assert np.isfinite(result.sigma).all()
    assert "collect" in words(result)  # redundancy 0


def test_fixed_needs_known_names_and_a_determined_calibration(rng):
    with pytest.raises(InputError, match="theta_a_yz"):
        calibrate_multiposition(simulated(rng), gravity=G, fixed={"M_a_yx": 0.0})
    bad = calibrate_multiposition(simulated(rng, directions=ATTITUDES[:6]), gravity=G, gyro_order=0)
    exact = calibrate_multiposition(simulated(rng, directions=ATTITUDES[:6], disturbance=0.0), gravity=G, gyro_order=0)
    for result in (bad, exact):
        with pytest.raises(InputError, match="determined"):
            calibrate_multiposition(simulated(rng), gravity=G, accel_order=6, fixed=result)


# ---------------------------------------------------------------------------------------------------- verdicts


def test_faces_only(rng):
    result = calibrate_multiposition(simulated(rng, directions=ATTITUDES[:6], disturbance=0.0), gravity=G, gyro_order=0)
    assert result.status == "refused"
    assert "theta_zx not determined: no pose with y and z both inclined" in words(result)
    assert "6 poses cannot determine 9" in words(result)
    assert np.isinf([result[n][1] for n in ("M_a_yx", "M_a_zx", "M_a_zy")]).all()
    assert np.isfinite([result[n][1] for n in ("b_a_x", "M_a_xx", "M_a_yy", "M_a_zz")]).all()
    assert abs(result["M_a_yx"][0]) < 1e-12
    assert "at 45 deg" in result.next_pose or "corner" in result.next_pose


def test_corners_only(rng):
    result = calibrate_multiposition(
        simulated(rng, directions=ATTITUDES[18:], disturbance=0.0), gravity=G, gyro_order=0
    )
    assert result.status == "refused"
    assert "s_x not determined: no pose with x along the reference" in words(result)
    assert result.next_pose.split(": ")[1].split(";")[0] in {f"{i} {w}" for i in "xyz" for w in ("up", "down")}


def test_the_poses_advised_determine_everything(rng):
    """Collect what it says, once, and nothing is undetermined any more."""
    u = ATTITUDES[:6]
    more = next_directions(u, np.ones(9, dtype=bool), 8)
    result = calibrate_multiposition(simulated(rng, directions=np.vstack((u, more))), gravity=G, gyro_order=0)
    assert result.status == "ok"
    assert np.isfinite(result.sigma).all()


def test_a_weak_design_says_which_pose_is_missing(rng):
    """The source's third scenario: 346 microradian for theta_zx beside 15 and 26, and no word of it."""
    poses = np.vstack((ATTITUDES[:8], ATTITUDES[10:12], ATTITUDES[8:10], ATTITUDES[12:14]))
    result = calibrate_multiposition(simulated(rng, directions=poses), gravity=G, gyro_order=0)
    assert result.status == "warning"
    assert "theta_zx is weak" in words(result)
    assert "no pose with y and z both inclined" in words(result)


def test_a_kicked_box_is_found(rng):
    poses = simulated(rng)
    poses.f[11] *= 1.0003
    result = calibrate_multiposition(poses, gravity=G, gyro_order=0)
    assert "pose 12 (2200.0..2380.0 s) is off by" in words(result)


def test_nothing_to_go_on(rng):
    one = simulated(rng, directions=np.tile(ATTITUDES[:1], (12, 1)), disturbance=0.0)
    result = calibrate_multiposition(one, gravity=G, gyro_order=0)
    assert result.status == "refused"
    assert np.isinf(result.sigma).any()
    assert result.next_pose


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.thinned(2)
def test_few_poses_much_alike_are_refused_without_nonsense(rng, n):
    """No NaN, no warning of numpy, no infinite value; what is determined has a finite variance, the rest says so."""
    for spread in (0.0, 1e-4, 0.1):
        u = np.array((0.0, 0.0, -1.0)) + spread * rng.standard_normal((n, 3))
        poses = simulated(rng, directions=-u, disturbance=0.0)
        for fixed in (None, {"theta_a_yz": 1e-3}):
            result = calibrate_multiposition(poses, gravity=G, gyro_order="auto", fixed=fixed)
            assert result.status == "refused"
            assert np.isfinite(result.values).all()
            assert np.abs(result.errors.b_a).max() < 2.0 * G
            assert result.next_pose
    still = Poses(np.zeros((n, 3)), poses.omega, poses.sigma_f, poses.sigma_omega, poses.start, poses.stop)
    assert calibrate_multiposition(still, gravity=G, gyro_order=0).status == "refused"


def test_automatic_order_with_angles_held(rng):
    """Angles of an earlier calibration do not make it estimate scale factors from Earth rate."""
    fixed = {f"theta_g_{n}": v for n, v in zip(("yz", "zx", "zy"), TH_G, strict=True)}
    result = calibrate_multiposition(simulated(rng), gravity=G, fixed=fixed)
    assert result.extra["gyro"]["order"] == 3
    assert result.fixed["M_g_yx"] == pytest.approx(-np.sin(TH_G[0]))
    earlier = calibrate_multiposition(simulated(rng), gravity=G)  # gyroscopes: 3 parameters, no angles
    again = calibrate_multiposition(simulated(rng, rate=0.7), gravity=G, latitude=LAT, table_rate=0.7, fixed=earlier)
    assert again.extra["gyro"]["order"] == 9


def test_reasons_name_what_is_missing():
    u = np.array([(0.0, 1.0, 0.0), (0.8, 0.0, 0.6), (-0.5, 0.0, 0.8)])
    message = reasons(["b_x", "b_y", "s_x", "s_z", "theta_yz", "theta_zy"], u)
    assert message == [
        "b_y not determined: no poses with y along the reference and against it",
        "s_x not determined: no pose with x along the reference, which tells its scale from the others'",
        "s_z not determined: no pose with z along the reference, which tells its scale from the others'",
        "theta_yz not determined: no pose with x and y both inclined",
        "b_x, theta_zy not determined: these poses do not tell them apart",
    ]


# ------------------------------------------------------------------------------------------------ model order


def test_orders_side_by_side(rng):
    """The source's accelerometer: both smaller models are rejected; a perfect triad needs 3 parameters."""
    poses = simulated(rng)
    tests = order_tests(poses.f, SIGMA_F, G)
    assert [t.order for t in tests] == [3, 6, 9]
    assert recommended(tests).order == 9
    assert tests[0].p_global < 1e-6
    assert tests[2].p_global > 1e-3
    assert tests[2].aic < tests[1].aic < tests[0].aic
    assert tests[2].bic < tests[0].bic


@pytest.mark.campaign
def test_order_is_chosen_with_the_stated_error_rate(rng):
    """Statistical: two tests at 1 % each on data that need 3 parameters; and rejecting by F where noise is wrong."""
    chosen = []
    for k in range(100):
        u = study_attitudes(ATTITUDES, 0.3, 0.03, rng) @ (0.0, 0.0, -G) + B_A
        noise = 1.0 if k % 2 else 7.0
        chosen.append(recommended(order_tests(u + noise * SIGMA_F * rng.standard_normal((26, 3)), SIGMA_F, G)).order)
    assert chosen.count(3) >= 94


# --------------------------------------------------------------------------------------------------- real data


@pytest.mark.realdata
def test_hand_held_poses_agree_with_another_program(shared_data):
    """Xsens MTi in counts; imu_tk's result, within 3 of our sigma (its own are below ours, it takes samples for poses).

    imu_tk has ``a = T K (counts - B)`` with an upper triangular T, which is the gauge "upper". Noise of the means does
    not explain the residuals, which a hand-held fixture makes: that must be said.
    """
    log, gyro = (np.loadtxt(shared_data / "imu_tk_xsens" / f"xsens_{x}.mat") for x in ("acc", "gyro"))
    theirs = json.loads((shared_data / "imu_tk_xsens" / "expected.json").read_text())["acc"]
    per_count = 1.0 / 414.5
    imu = ImuSeries(log[:, 0], (gyro[:, 1:] - 32768.0) / 4770.0, (log[:, 1:] - 32768.0) * per_count)
    poses = poses_of(imu, static_intervals(imu, gravity=9.81744))
    assert 35 <= len(poses) <= 40
    result = calibrate_multiposition(poses, gravity=9.81744, gyro_order=0)
    assert np.isfinite(result.sigma).all()
    upper = result.in_gauge("upper")
    R = np.eye(3) + upper.errors.M_a
    T, K, B = np.array(theirs["T"]), np.array(theirs["K"]), np.array(theirs["B"])
    expected = np.linalg.inv(T @ np.diag(K)) * per_count
    for name in ("xx", "xy", "xz", "yy", "yz", "zz"):
        i, j = "xyz".index(name[0]), "xyz".index(name[1])
        assert abs(R[i, j] - expected[i, j]) < 3.0 * upper[f"M_a_{name}"][1], name
    for i, axis in enumerate("xyz"):
        assert abs(upper.errors.b_a[i] - (B[i] - 32768.0) * per_count) < 3.0 * upper[f"b_a_{axis}"][1]
    assert result.residuals["accel"].rms < 0.01
    assert np.abs(result.residuals["accel"].before).max() > 1.0


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("k", "margin", "refused"), [(3, 10.0, False), (2, 10.0, True), (1, 3.0, True)], ids=["good", "bad", "too few"]
)
def test_hand_logs_that_must_solve_or_refuse(shared_data, k, margin, refused):
    """Three logs of one unit: 14 poses, 12 that hardly differ, and too few."""
    x = np.loadtxt(shared_data / "snu_staticposes" / f"imu_good{k}.txt")
    imu = ImuSeries(x[:, 0] - x[0, 0], x[:, 4:7], x[:, 1:4])
    spans = static_intervals(imu, margin=margin, window_s=0.5, gravity=9.79871)
    result = calibrate_multiposition(poses_of(imu, spans), gravity=9.79871, gyro_order=0)
    assert (result.status == "refused") == refused
    if refused:
        assert np.isinf(result.sigma).any()
        assert result.next_pose
        return
    theirs = json.loads((shared_data / "snu_staticposes" / "expected.json").read_text())["imu_good3"]["acc"]
    upper = result.in_gauge("upper")
    for i, axis in enumerate("xyz"):
        value, sigma = upper[f"M_a_{axis}{axis}"]
        assert abs(value + 1.0 - 1.0 / theirs["K"][i]) < 4.0 * sigma
        value, sigma = upper[f"b_a_{axis}"]
        assert abs(value - theirs["B"][i]) < 4.0 * sigma


# ------------------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        ({"gravity": 1.0}, "9.81"),
        ({"accel_order": 0, "gyro_order": 0}, "not both 0"),
        ({"table_rate": 0.5}, "latitude"),
        ({"use_prior": True}, "prior_spec"),
        ({"accel_order": 5}, "accel_order"),
    ],
)
def test_input_that_makes_no_sense(rng, arguments, wanted):
    with pytest.raises(InputError, match=wanted):
        calibrate_multiposition(simulated(rng), **({"gravity": G} | arguments))


def test_no_poses(rng):
    with pytest.raises(InputError, match="got none"):
        calibrate_multiposition(simulated(rng).of(np.zeros(26, dtype=bool)), gravity=G)


def test_provenance_and_prior(rng):
    spec = ImuSpec("x", TriadSpec(random_walk=1e-5), TriadSpec(random_walk=1e-3, turn_on_bias=0.05))
    result = calibrate_multiposition(simulated(rng), gravity=G, prior_spec=spec)
    assert result.provenance["options"]["gravity"] == G
    assert set(result.prior_sigma) == {"b_a_x", "b_a_y", "b_a_z"}
    assert imu_errors(result.parameters).b_a == pytest.approx(result.errors.b_a)
