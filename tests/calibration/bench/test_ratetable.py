"""Rate table: closed forms, perfect data, Monte Carlo, plateaus in a log, real recordings."""

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.bench.faces import FACES, earth_rate_on_faces, faces_of
from schuler.calibration.bench.gyro_readings import GyroReadings, gyro_design
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.ratetable import calibrate_angle_rate, calibrate_ratetable
from schuler.calibration.bench.sixposition import calibrate_sixposition
from schuler.calibration.bench.turns import Turns, joined, readings_of_turns, turns_of
from schuler.calibration.bench.turns_in_log import rate_plateaus
from schuler.calibration.result.parameters import BIAS_G, LINEAR, MATRIX_G, SENSITIVITY, imu_errors, vector
from schuler.earth import earth_rate_ned
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import dcm_from_rotvec
from schuler.units import DEG

G = 9.79
LAT = 40.0 * DEG
EYE = np.eye(3)
UP = np.vstack([np.array([e, -e]) for e in EYE])
RATE = 60.0 * DEG
BOTH_WAYS = RATE * np.vstack([np.array([e, -e]) for e in EYE])  # each axis up, both ways
ENDS = np.repeat(EYE, 2, axis=0)  # direction up in each of them
T = 60.0  # ten whole turns


def unit(seed=4, size=0.01, families=("b_a", "M_a", "b_g", "M_g", "G_g")):
    rng = np.random.default_rng(seed)
    size_of = {"G_g": 1e-3 * size}
    values = {n: size_of.get(n[:3], size) * rng.standard_normal() for n in LINEAR}
    return imu_errors({n: v for n, v in values.items() if n[:3] in families})


def read(errors, omega, f):
    """Sensor model."""
    return (
        omega @ (EYE + errors.M_g).T + f @ errors.G_g.T + errors.b_g,
        f @ (EYE + errors.M_a).T + errors.b_a,
    )


def poses_from(errors, lat=LAT, rng=None, sigma=(1e-3, 1e-7), headings=None):
    t = 10.0 * np.arange(6)
    faces = faces_of(Poses(UP, UP, abs(UP) + 1, abs(UP) + 1, t, t + 1))
    earth = earth_rate_on_faces(faces, lat, np.zeros(6) if headings is None else headings)
    om, f = read(errors, earth, G * UP)
    if rng is not None:
        om, f = om + sigma[1] * rng.standard_normal((6, 3)), f + sigma[0] * rng.standard_normal((6, 3))
    return Poses(f, om, np.full((6, 3), sigma[0]), np.full((6, 3), sigma[1]), t, t + 9.0)


def turns_from(errors, rate=BOTH_WAYS, up=ENDS, lat=LAT, rng=None, sigma=1e-7):
    """Axes vertical, whole turns: horizontal Earth rate averages out."""
    n = len(rate)
    vertical = -earth_rate_ned(lat)[2]
    om, f = read(errors, rate + vertical * up, G * up)
    if rng is not None:
        om = om + sigma * rng.standard_normal((n, 3))
    t = 100.0 * np.arange(n)
    return Turns(rate, om, np.full((n, 3), sigma), f, t, t + T)


# ------------------------------------------------------------------------------------------------- closed forms


def test_both_ways_is_the_closed_form(rng):
    """Columns of I + M are half differences over the rate, biases half sums; rounding."""
    turns = turns_from(unit(), rng=rng, lat=0.0)
    result = calibrate_ratetable(turns, gravity=G, g_sensitivity=False, latitude=0.0)
    cw, ccw = turns.omega[::2], turns.omega[1::2]
    np.testing.assert_allclose(result.errors.M_g + EYE, ((cw - ccw) / (2.0 * RATE)).T, atol=1e-14)
    np.testing.assert_allclose(result.errors.b_g, ((cw + ccw) / 2.0).mean(axis=0), atol=1e-14)


def test_angle_rate_is_the_closed_form(rng):
    """b = (cw + ccw)/2 less Earth rate along the axis, S = (cw - ccw)/(2 K) - 1; rounding."""
    turns = turns_from(unit(), rng=rng)
    result = calibrate_angle_rate(turns, gravity=G, latitude=LAT)
    vertical = -earth_rate_ned(LAT)[2]
    for i, a in enumerate("xyz"):
        cw, ccw = turns.omega[2 * i, i], turns.omega[2 * i + 1, i]
        S = (cw - ccw) / (2.0 * RATE) - 1.0
        assert result[f"M_g_{a}{a}"][0] == pytest.approx(S, abs=1e-14)
        assert result[f"b_g_{a}"][0] == pytest.approx((cw + ccw) / 2.0 - (1.0 + S) * vertical, abs=1e-12)
        assert result[f"b_g_{a}"][1] == pytest.approx(1e-7 / np.sqrt(2.0), rel=1e-5)
        assert result[f"M_g_{a}{a}"][1] == pytest.approx(1e-7 / np.sqrt(2.0) / RATE, rel=1e-5)
    assert set(result.names) == {*BIAS_G, "M_g_xx", "M_g_yy", "M_g_zz"}
    assert result.status == "ok"


def test_design_against_numerical_differentiation():
    """Of the sensor model itself; rounding of central differences."""
    rng = np.random.default_rng(2)
    n = 4
    omega, f = rng.standard_normal((n, 3)), 10.0 * rng.standard_normal((n, 3))
    readings = GyroReadings(("",) * n, omega, omega, f, np.ones((n, 3)), np.zeros((n, 3)), np.zeros((1, n, 3)))
    A, names = gyro_design(readings, response=True, g_sensitivity=True)
    assert set(names) == {*BIAS_G, *MATRIX_G, *SENSITIVITY}
    at = dict(zip(LINEAR, vector(unit()), strict=True))
    for j, name in enumerate(names):
        h = 1e-4
        high, low = (read(imu_errors({**at, name: at[name] + s * h}), omega, f)[0] for s in (1.0, -1.0))
        np.testing.assert_allclose(A[:, j], ((high - low) / (2.0 * h)).ravel(), atol=1e-10)


def test_horizontal_earth_rate_averages_as_stated():
    """Integrated numerically over parts of turns about the vertical: within sin(a/2)/(a/2) of the horizontal part."""
    north = earth_rate_ned(LAT)[0]
    for angle in (0.5 * np.pi, np.pi, 2.0 * np.pi, 7.3, 4.0 * np.pi):
        a = (np.arange(20_000) + 0.5) / 20_000 * angle
        mean = np.hypot(np.cos(a).mean(), np.sin(a).mean()) * north
        turns = Turns(angle / T * EYE[:1], np.zeros((1, 3)), np.full((1, 3), 1e-12), G * EYE[:1], [0.0], [T])
        readings, _ = readings_of_turns(turns, turns.f, gravity=G, latitude=LAT)
        assert readings.sigma[0, 1] * np.sqrt(2.0) == pytest.approx(mean, abs=1e-3 * north)  # midpoint rule
        assert readings.sigma[0, 0] == pytest.approx(1e-12)


# ------------------------------------------------------------------------------------------------- perfect data


def assert_same(result, errors, atol=1e-13):
    np.testing.assert_allclose(result.values, vector(errors, result.names), atol=atol)


def test_perfect_data_come_back(rng):
    """All 33 parameters with poses at rest; rounding."""
    errors = unit()
    headings = rng.uniform(0.0, 6.0, 6)
    result = calibrate_ratetable(
        turns_from(errors), poses_from(errors, headings=headings), gravity=G, latitude=LAT, headings=headings
    )
    assert result.names == LINEAR
    assert_same(result, errors)
    assert (result.status, result.verdicts) == ("ok", ())
    assert result.condition < 1e3
    np.testing.assert_allclose(result.residuals["gyro"].value, 0.0, atol=1e-13)
    assert np.triu(result.in_gauge("lower").errors.M_a, 1) == pytest.approx(0.0)


def test_turns_with_both_ends_up_show_g_sensitivity():
    """Each axis up and down, both ways: no pose at rest is needed; rounding."""
    errors = unit(families=("b_g", "M_g", "G_g"))
    rate, up = np.vstack((BOTH_WAYS, BOTH_WAYS)), np.vstack((ENDS, -ENDS))
    result = calibrate_ratetable(turns_from(errors, rate, up), gravity=G, latitude=LAT)
    assert result.names == BIAS_G + MATRIX_G + SENSITIVITY
    assert_same(result, errors)


def test_a_calibrated_accelerometer_helps_out():
    """Its calibration comes from another day; without it the raw specific force is what G refers to."""
    errors = unit()
    accel = calibrate_sixposition(poses_from(errors), gravity=G, gyro="none")
    rate, up = np.vstack((BOTH_WAYS, BOTH_WAYS)), np.vstack((ENDS, -ENDS))
    turns = turns_from(errors, rate, up)
    assert_same(calibrate_ratetable(turns, gravity=G, latitude=LAT, accel=accel), errors)
    raw = calibrate_ratetable(turns, gravity=G, latitude=LAT)
    assert 1e-8 < np.abs(raw.errors.G_g - errors.G_g).max() < 1e-6


def test_axis_not_vertical(rng):
    """A horizontal axis: Earth rate along it by its azimuth, no gravity in the mean; rounding."""
    errors = unit(families=("b_g", "M_g"))
    axis_n = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    toward = np.sign(BOTH_WAYS.sum(axis=1))[:, None] * axis_n
    along = (toward @ earth_rate_ned(LAT))[:, None] * BOTH_WAYS / RATE
    om, f = read(errors, BOTH_WAYS + along, np.zeros((6, 3)))
    t = 100.0 * np.arange(6)
    turns = Turns(BOTH_WAYS, om, np.full((6, 3), 1e-7), f, t, t + T)
    result = calibrate_ratetable(turns, gravity=G, latitude=LAT, axis_n=toward, g_sensitivity=False)
    assert_same(result, errors)
    lost = calibrate_ratetable(turns, gravity=G, latitude=LAT, g_sensitivity=False)
    assert lost.status == "warning"
    assert any("not about the vertical" in v and "give axis_n" in v for v in lost.verdicts)
    assert lost["M_g_xx"][1] > 10.0 * result["M_g_xx"][1]


def test_turns_of_several_logs_are_one():
    turns = turns_from(unit())
    parts = [Turns(turns.rate[k], turns.omega[k], turns.sigma_omega[k], turns.f[k], turns.start[k], turns.stop[k])
             for k in (slice(0, 2), slice(2, 6))]  # fmt: skip
    again = joined(parts)
    for name in ("rate", "omega", "sigma_omega", "f", "start", "stop", "left"):
        np.testing.assert_array_equal(getattr(again, name), getattr(turns, name))
    assert joined([replace(parts[0], f=None), parts[1]]).f is None
    assert turns.labels[1] == "turn about -x at 60 deg/s (100.0..160.0 s)"
    with pytest.raises(InputError, match="turns of one log or more"):
        joined([])


# ---------------------------------------------------------------------------------------------------- Monte Carlo


def assert_covariance(results, truth):
    """Statistical: chi-square sum within 4 sigma; mean square and mean of each parameter over sigma within 4.5."""
    at = dict(zip(LINEAR, truth, strict=True))
    d = np.array([r.values - [at[n] for n in r.names] for r in results])
    total = sum(x @ np.linalg.solve(r.covariance, x) for x, r in zip(d, results, strict=True))
    assert abs(total - d.size) < 4.0 * np.sqrt(2.0 * d.size)
    z = d / np.array([r.sigma for r in results])
    assert np.abs((z**2).mean(axis=0) - 1.0).max() < 4.5 * np.sqrt(2.0 / len(results))
    assert np.abs(z.mean(axis=0)).max() < 4.5 / np.sqrt(len(results))


@pytest.mark.parametrize("runs", [50, pytest.param(150, marks=pytest.mark.campaign)])
@pytest.mark.thinned(4)
@pytest.mark.parametrize(
    "options",
    [
        {"latitude": LAT},
        {"latitude": None},
        {"latitude": LAT, "axis_sigma": 3e-6, "rate_sigma": 5e-6},
        {"latitude": LAT, "instability": (4e-6, 2e-3)},
    ],
    ids=lambda o: " ".join(f"{k}={v}" for k, v in o.items()),
)
def test_predicted_covariance_is_the_scatter(options, rng, runs):
    errors = unit(size=0.001)
    results = []
    for _ in range(runs):
        lat = LAT if options["latitude"] is not None else np.arcsin(rng.uniform(-1.0, 1.0))
        headings = rng.uniform(-np.pi, np.pi, 6)
        tilt = options.get("axis_sigma", 0.0) * rng.standard_normal((3, 3))  # the same for both ways about an axis
        speed = 1.0 + options.get("rate_sigma", 0.0) * rng.standard_normal((6, 1))
        true_rate = speed * (BOTH_WAYS + np.cross(np.repeat(tilt, 2, axis=0), BOTH_WAYS))
        turns = replace(turns_from(errors, true_rate, ENDS, lat, rng), rate=BOTH_WAYS)
        poses = poses_from(errors, lat, rng, headings=headings)
        w_g, w_a = options.get("instability", (0.0, 0.0))
        turns = replace(turns, omega=turns.omega + w_g * rng.standard_normal((6, 3)))
        poses = replace(
            poses, omega=poses.omega + w_g * rng.standard_normal((6, 3)), f=poses.f + w_a * rng.standard_normal((6, 3))
        )
        h = headings if options["latitude"] is not None else None
        results.append(calibrate_ratetable(turns, poses, gravity=G, headings=h, level_sigma=0.0, **options))
    assert results[0].names == LINEAR
    assert_covariance(results, vector(errors))


def test_angle_rate_covariance(rng):
    errors = imu_errors({"b_g_x": 1e-3, "b_g_y": -2e-3, "M_g_xx": 0.01, "M_g_zz": -0.02})
    results = [calibrate_angle_rate(turns_from(errors, rng=rng), gravity=G, latitude=LAT) for _ in range(150)]
    assert_covariance(results, vector(errors))


# ------------------------------------------------------------------------------------------------ what goes wrong


def test_what_is_missing_is_said():
    errors = unit()
    up_only = calibrate_ratetable(turns_from(errors), gravity=G, latitude=LAT)
    assert up_only.status == "refused"
    assert "b_g_x, G_g_xx, G_g_xy and G_g_xz are not determined one by one, only a combination is" in up_only.verdicts
    assert any("add poses at rest on all six faces" in v for v in up_only.verdicts)
    assert np.isinf(up_only["G_g_xx"][1])
    np.testing.assert_allclose(
        [up_only[n][0] for n in MATRIX_G], vector(errors, MATRIX_G), atol=1e-13
    )  # the response is there all the same
    no_z = calibrate_ratetable(turns_from(errors, BOTH_WAYS[:4], ENDS[:4]), poses_from(errors), gravity=G, latitude=0.0)
    assert no_z.status == "refused"
    assert np.isinf(no_z["M_g_yz"][1])
    assert np.isfinite(no_z["M_g_yx"][1])
    assert "turn about each of the three axes" in no_z.next_pose
    few = calibrate_ratetable(turns_from(errors), poses_from(errors).of([0, 2, 4]), gravity=G, g_sensitivity=False)
    assert few.names == BIAS_G + MATRIX_G
    assert any("accelerometers are not calibrated: not at rest on x down, y down, z down" in v for v in few.verdicts)


def test_what_makes_no_sense():
    turns = turns_from(unit())
    with pytest.raises(InputError, match="record it or say g_sensitivity=False"):
        calibrate_ratetable(replace(turns, f=None))
    with pytest.raises(InputError, match="gravity: expected a positive"):
        calibrate_ratetable(turns, gravity=0.0)
    with pytest.raises(InputError, match="multiply degrees with DEG"):
        calibrate_ratetable(turns, latitude=45.0)
    with pytest.raises(InputError, match="what is at rest belongs to the poses"):
        replace(turns, rate=0.0 * turns.rate)
    slanted = replace(turns, rate=turns.rate @ dcm_from_rotvec(np.array([0.2, 0.0, 0.0])))
    with pytest.raises(InputError, match="11 deg off; use calibrate_ratetable"):
        calibrate_angle_rate(slanted)
    imu = ImuSeries(np.arange(100) / 50.0, np.zeros((100, 3)), np.ones((100, 3)))
    with pytest.raises(InputError, match="expected one of them"):
        turns_of(imu, [(0.0, 1.0)])
    with pytest.raises(InputError, match="N of the gyroscopes"):
        turns_of(imu, [(0.0, 1.0)], angle=EYE[:1])
    with pytest.raises(InputError, match=r"20 samples or more in 0\.00\.\.0\.10 s, got 6"):
        turns_of(imu, [(0.0, 0.1)], rate=EYE[:1])
    with pytest.raises(InputError, match="found no plateau of 5 s or longer at 60 deg/s"):
        rate_plateaus(imu, [RATE])


# ------------------------------------------------------------------------------------------------ plateaus in a log


def table_log(errors, rng, rate_hz=50.0, noise=1e-3):
    """Rest, then both ways about each axis with ramps, rest between; axis of the turn up."""
    omega, up = [np.zeros((500, 3))], [np.tile(EYE[0], (500, 1))]
    starts = []
    at = 500
    for u in EYE:
        for s in (1.0, -1.0):
            profile = (
                s
                * RATE
                * np.concatenate((np.linspace(0, 1, 100), np.ones(1500), np.linspace(1, 0, 100), np.zeros(100)))
            )
            starts.append((at + 100) / rate_hz)
            omega.append(profile[:, None] * u)
            up.append(np.tile(u, (len(profile), 1)))
            at += len(profile)
    omega, up = np.concatenate(omega), np.concatenate(up)
    omega = omega - earth_rate_ned(LAT)[2] * up
    om, f = read(errors, omega, G * up)
    t = np.arange(len(om)) / rate_hz
    om = om + noise * rng.standard_normal(om.shape)
    return ImuSeries(t, om, f + 1e-2 * rng.standard_normal(f.shape)), np.array(starts)


def test_plateaus_are_found(rng):
    """Whole turns within the 30 s at full rate; parameters within 5 sigma, which are those of 24 s of noise."""
    errors = unit(size=0.003, families=("b_g", "M_g"))
    imu, starts = table_log(errors, rng)
    turns = rate_plateaus(imu, [30.0 * DEG, RATE])
    np.testing.assert_array_equal(turns.rate, BOTH_WAYS)
    np.testing.assert_allclose(turns.start, starts + 1.0, atol=0.6)  # a window
    np.testing.assert_allclose(turns.duration, 24.0, atol=0.05)
    result = calibrate_ratetable(turns, gravity=G, g_sensitivity=False, latitude=LAT)
    assert result.status == "ok"
    z = (result.values - vector(errors, result.names)) / result.sigma
    assert np.abs(z).max() < 5.0
    white = 1e-3 / np.sqrt(50.0 * 24.0) / np.sqrt(2.0) / RATE
    assert 0.5 * white < result["M_g_xy"][1] < 2.0 * white


# ------------------------------------------------------------------------------------------------- real recordings


def vn200_turns(folder, which, rate_deg):
    from scipy.io import loadmat

    data = loadmat(folder / which / f"{which}_gyro{rate_deg}_test.mat")
    parts = [data[name.replace(" ", "_") + "_gyro"] for name in FACES]
    t = 1000.0 * np.arange(6.0)
    return Turns(
        rate_deg * DEG * UP, np.array([p.mean(axis=0) for p in parts]), np.full((6, 3), 1e-5), None, t, t + 120.0
    )


@pytest.mark.realdata
@pytest.mark.parametrize("which", ["IMU0", "IMU1"])
@pytest.mark.parametrize("rate_deg", [30, 60])
def test_vn200(shared_data, which, rate_deg):
    """Response and bias of two VN-200 at two rates, without Earth rate as there; printed digits."""
    folder = shared_data / "vn200_ratetable"
    expected = json.loads((folder / "expected.json").read_text())[which]
    turns = vn200_turns(folder, which, rate_deg)
    options = {"gravity": G, "g_sensitivity": False, "latitude": 0.0, "axis_n": np.tile([0.0, 0.0, -1.0], (6, 1))}
    result = calibrate_ratetable(turns, **options)
    np.testing.assert_allclose(result.errors.M_g + EYE, expected[f"gyro{rate_deg}_C"], atol=1e-12)
    np.testing.assert_allclose(result.errors.b_g, expected[f"gyro{rate_deg}_bias"], atol=1e-12)
    if rate_deg == 60 and which == "IMU0":  # the author's bias comes from the axis that turns
        single = calibrate_angle_rate(turns, gravity=G, latitude=0.0, axis_n=options["axis_n"])
        np.testing.assert_allclose(single.errors.b_g, np.ravel(expected["repo_cal"]["b_g_FB"]), atol=1e-12)
        np.testing.assert_allclose(np.diag(single.errors.M_g), np.diag(expected["repo_cal"]["M_g"]), atol=1e-12)


@pytest.mark.realdata
@pytest.mark.parametrize("which", ["IMU0", "IMU1"])
@pytest.mark.parametrize("rate_deg", [30, 60])
def test_vn200_uncut(shared_data, which, rate_deg):
    """The plateaus of the uncut records are found and give the response of the hand-cut ones within 20 ppm."""
    from scipy.io import loadmat

    folder = shared_data / "vn200_ratetable"
    expected = json.loads((folder / "expected.json").read_text())[which]
    omega = loadmat(folder / which / f"{which}.mat")[f"gyro{rate_deg}zzxxyy{which}"]
    imu = ImuSeries(np.arange(len(omega)) / 50.0, omega, np.zeros_like(omega))
    turns = replace(rate_plateaus(imu, [rate_deg * DEG], min_s=20.0, settle_s=2.0), f=None)
    assert len(turns) == 6
    result = calibrate_ratetable(turns, gravity=G, g_sensitivity=False, latitude=39.0 * DEG)
    np.testing.assert_allclose(result.errors.M_g + EYE, expected[f"gyro{rate_deg}_C"], atol=2e-5)
    assert any("without specific force" in v for v in result.verdicts)
