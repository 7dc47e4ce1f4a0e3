"""Foot-mounted recordings: PyShoe's eight motion-capture trials, and OpenShoe's square.

What the thresholds are: the author's were chosen for each trial and detector by the least error against the motion
capture. Ours is one configuration for all trials; with "labels" it is given the author's zero-velocity samples.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import loadmat

from schuler import rotation, units
from schuler.exceptions import InputError
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.foot.errors import walk_errors
from schuler.navigation.foot.rests import detect_rests
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.formats.openshoe import read_openshoe_mat
from schuler.recording.formats.pyshoe import (
    AUTHOR_GRAVITY,
    AUTHOR_SIGMA_ACCEL,
    AUTHOR_SIGMA_GYRO,
    PLACE_DEG,
    is_pyshoe,
    read_pyshoe,
)
from schuler.recording.series import ImuSeries
from schuler.standstill import detectors

pytestmark = pytest.mark.realdata

PLACE = dict(zip(("lat_deg", "lon_deg", "height_m"), PLACE_DEG, strict=True))


@pytest.fixture(scope="module")
def trials(shared_data):
    return [read_pyshoe(path) for path in sorted((shared_data / "pyshoe_vicon").glob("*.mat"))]


def errors_of(trials, config, labels=None, **options):
    """Errors of every trial; the results too."""
    results = [
        navigate_foot(
            trial.recording, {"place": PLACE, **config}, rest=None if labels is None else trial.labels[labels]
        )
        for trial in trials
    ]
    pairs = zip(results, trials, strict=True)
    return results, [walk_errors(result, trial.recording.reference, **options) for result, trial in pairs]


def textbook(trial):
    """Nine-state filter as published for these data (Open-Shoe's noise), written out: positions, third axis down."""
    imu, rest, dt = trial.recording.imu, trial.labels["shoe"], 1.0 / 200.0
    f0 = imu.accel[:20].mean(axis=0)
    C = rotation.dcm_from_rpy([np.arctan2(-f0[1], -f0[2]), np.arctan2(f0[0], np.hypot(f0[1], f0[2])), 0.0])
    r, v, P = np.zeros(3), np.zeros(3), np.diag(np.repeat([1e-10, 1e-10, (0.1 * units.DEG) ** 2], 3))
    Q = np.diag(np.repeat([0.0, (0.5 * dt) ** 2, (0.5 * units.DEG * dt) ** 2], 3))
    path, F = [r], np.eye(9)
    F[0:3, 3:6] = dt * np.eye(3)
    turns = rotation.dcm_from_rotvec(imu.gyro * dt)
    for k in range(1, len(imu)):
        F[3:6, 6:9] = -dt * rotation.skew(C @ imu.accel[k])
        C = C @ turns[k]
        a = C @ imu.accel[k] + [0.0, 0.0, AUTHOR_GRAVITY]
        v = v + dt * a
        r = r + dt * v + 0.5 * dt**2 * a
        P = F @ P @ F.T + Q  # isotropic noise turns into itself
        if rest[k]:
            K = P[:, 3:6] @ np.linalg.inv(P[3:6, 3:6] + 1e-4 * np.eye(3))
            dx = -K @ v
            r, v, C = r + dx[:3], v + dx[3:6], rotation.dcm_from_rotvec(dx[6:]) @ C
            P = P - K @ P[3:6]
            P = 0.5 * (P + P.T)
        path.append(r)
    return np.array(path)


def authors_metric(path, reference, distance=0.8):
    """Turned so that the directions of a point 0.8 m from the start agree; mean of the RMS of the x and y errors."""
    path, reference = path - path[0], reference - reference[0]
    k = int(np.argmax(np.hypot(path[:, 0], path[:, 1]) >= distance)) - 1
    angle = np.arctan2(*reference[k, 1::-1]) - np.arctan2(*path[k, 1::-1])
    C = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    e = path[:, :2] @ C.T - reference[:, :2]
    return np.sqrt((e**2).mean(axis=1)).mean()


@pytest.mark.campaign
def test_the_stored_errors_follow_the_author_s_definition(trials):
    """The published filter with the stored labels gives the stored errors, by the definition of ``author_error``."""
    ours = np.array([authors_metric(textbook(trial), trial.position_n) for trial in trials])
    stored = np.array([trial.errors["shoe"] for trial in trials])
    # stored to 1 mm; what is left (up to 2 mm) are details of the author's programs, which changed over time
    assert np.abs(ours - stored).max() < 2.5e-3, (ours, stored)
    assert abs(ours.mean() - stored.mean()) < 1e-3


def test_our_filter_set_to_the_published_one_has_the_stored_errors(trials):
    """The same walks by another definition: far off, so ``author_error`` is the right one."""
    stored = np.array([trial.errors["shoe"] for trial in trials])
    _, errors = errors_of(trials, {"zupt": {"pivot": False, "sigma_m_s": 0.01, "roll_m": 0.0},
                                   "filter": {"states": 9, "smooth": "none"}}, "shoe")  # fmt: skip
    assert abs(np.mean([e.author_error for e in errors]) - stored.mean()) < 1e-3
    assert np.mean([e.rms_horizontal for e in errors]) > 1.5 * stored.mean()


def test_the_stored_labels_are_the_author_s_threshold_on_our_statistic(trials):
    """The same statistic over blocks of five samples: ours is centred on every sample, so edges differ by a block."""
    for trial in trials:
        imu = trial.recording.imu
        value = detectors.statistic(
            imu, "glrt", 0.025, sigma_f=AUTHOR_SIGMA_ACCEL, sigma_w=AUTHOR_SIGMA_GYRO, gravity=AUTHOR_GRAVITY
        )
        blocks = np.repeat(value[2 : len(imu) // 5 * 5 : 5], 5)  # windows that are the author's blocks
        label = trial.labels["shoe"][: len(blocks)]
        assert np.mean((blocks < trial.thresholds["shoe"]) == label) > 0.999


@pytest.mark.thinned(3)
@pytest.mark.parametrize("smooth", ["walk", "stride", "none"])
def test_better_than_the_author_with_his_labels(trials, smooth):
    """Default configuration: the resting point and the biases are estimated from the data, nothing from the truth."""
    _, errors = errors_of(trials, {"filter": {"smooth": smooth}}, "shoe")
    ours, author = np.mean([e.author_error for e in errors]), np.mean([t.errors["shoe"] for t in trials])
    assert author == pytest.approx(0.031125)
    assert ours < author  # 0.0295 filtered, 0.0298 smoothed, 0.0294 by stride


def test_one_threshold_for_all_trials(trials):
    """The threshold that follows the motion, one setting for walks of 0.4 to 1.1 m/s; the author tuned each trial."""
    results, errors = errors_of(trials, {})
    assert np.mean([e.author_error for e in errors]) < 0.036
    assert max(e.author_error for e in errors) < 0.055
    # back where they came from: the error at the end, in per cent of the distance walked
    end = [100.0 * e.end_horizontal / r.distance for e, r in zip(errors, results, strict=True)]
    assert np.mean(end) < 0.3
    # strides are a little shorter than those of the motion capture (docs/foot-mounted.md), by 1 or 2 per cent
    for result, trial in zip(results, trials, strict=True):
        s = result.strides
        truth = np.linalg.norm(trial.position_n[s.index[:, 1], :2] - trial.position_n[s.index[:, 0], :2], axis=1)
        long = truth > 0.2
        assert -0.035 < np.median(s.length[long] / truth[long] - 1.0) < 0.01


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("detector", "limit"), [("ared", 0.034), ("shoe", 0.036), ("amv", 0.034), ("magnitude", 0.040)]
)
def test_detectors_on_real_feet(trials, detector, limit):
    _, errors = errors_of(trials, {"detector": {"kind": detector}})
    assert np.mean([e.author_error for e in errors]) < limit


def test_the_threshold_that_rises_with_time(trials):
    _, errors = errors_of(trials, {"detector": {"threshold": "time"}})
    assert np.mean([e.author_error for e in errors]) < 0.042


def test_is_the_claimed_uncertainty_honest(trials):
    """Horizontally it is; heights are two sigma off, which no zero velocity can see (docs/foot-mounted.md)."""
    for labels in (None, "shoe"):
        _, errors = errors_of(trials, {"filter": {"smooth": "none"}}, labels, fit="all")
        horizontal, vertical = np.mean([e.nees() for e in errors], axis=0)
        assert 0.5 < horizontal < 2.0
        assert 0.5 < vertical < 5.0


def test_the_noise_of_the_sensor_alone_is_not_honest(trials):
    """With the data sheet's noise of this IMU the filter claims far less than its errors: hence Open-Shoe's values."""
    sheet = {"accel_noise_m_s2_rthz": 2.5e-4, "gyro_noise_deg_s_rthz": 0.005}
    _, errors = errors_of(trials, {"sensor": sheet, "filter": {"smooth": "none"}}, "shoe", fit="all")
    assert np.mean([e.nees()[0] for e in errors]) > 5.0


def test_the_resting_point_is_below_and_before_the_sensor(trials):
    """On top of the shoe, the ball of the foot is forward and down of the sensor; all trials wear the same shoe."""
    results, _ = errors_of(trials, {}, "shoe")
    points = np.array([r.pivot_b()[0] for r in results])
    assert np.all(points[:, 2] > 0.01)
    assert np.all(np.linalg.norm(points, axis=1) < 0.12)
    assert np.all(points.std(axis=0) < 0.02)


# ------------------------------------------------------------------------------------------------ OpenShoe


def test_the_square_was_sampled_at_100_hz(shared_data):
    """The device's own attitude turns by its interval times the rate."""
    from scipy.io import loadmat

    contents = loadmat(str(shared_data / "openshoe" / "square2.mat"))
    q = contents["quat"].T / np.linalg.norm(contents["quat"].T, axis=1, keepdims=True)
    turned = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q[:-1]), q[1:]))
    rate = contents["u"][3:].T[1:]
    fast = np.linalg.norm(rate, axis=1) > 0.8
    interval = np.sum(turned[fast] * rate[fast]) / np.sum(rate[fast] ** 2)
    assert 1.0 / interval == pytest.approx(100.0, rel=0.05)


def test_the_square_closes_within_its_own_sigma(shared_data):
    """Not a walk: an IMU pushed twice round a square of 0.3 m, with pauses. It closes to 17 mm, 0.7 % of 2.4 m."""
    recording = read_openshoe_mat(shared_data / "openshoe" / "square2.mat", rate_hz=100.0)
    assert not is_pyshoe(shared_data / "openshoe" / "square2.mat")
    config = {
        "place": {"lat_deg": 58.0, "height_m": 100.0},
        # a hand moves it, nothing hits it: noise a few times that at rest, scale factors count
        "sensor": {"accel_noise_m_s2_rthz": 0.002, "gyro_noise_deg_s_rthz": 0.01,
                   "accel_scale": 5e-3, "gyro_scale": 5e-3},
        "detector": {"threshold": 100.0, "window_s": 0.03},  # as in the program the log came with
        "zupt": {"pivot": False, "sigma_m_s": 0.01, "roll_m": 0.0},
        "filter": {"states": 21},
        "stride": {"min_rest_s": 0.3},
    }  # fmt: skip
    result = navigate_foot(recording, config)
    strides, closure = result.strides, result.closure_n
    assert int(strides.walking.sum()) == 8
    np.testing.assert_allclose(strides.length[strides.walking], 0.305, atol=0.02)
    sigma = result.best.sigma("dr")[-1]
    assert np.all(np.abs(closure) < 2.5 * sigma), (closure, sigma)
    assert np.hypot(closure[0], closure[1]) < 0.012 * result.distance


def test_the_threshold_from_noise_on_the_square(shared_data):
    """A table top is still enough for the threshold that noise alone gives."""
    recording = read_openshoe_mat(shared_data / "openshoe" / "square2.mat", rate_hz=100.0)
    section = FootConfig.parse({"detector": {"threshold": "noise", "margin": 10.0, "window_s": 0.1}}).detector
    rests = detect_rests(recording.imu, section, gravity=9.817, rest_s=5.0)
    assert rests.mask[:1500].all()
    assert 0.5 < rests.mask.mean() < 0.8


# ----------------------------------------------------------------------- walks and runs no default was chosen on


def half_not_chosen_on(folder):
    """Every second file by name: defaults were chosen on the first, third, ... (docs/foot-mounted.md)."""
    return sorted(folder.glob("*.mat"))[1::2]


def test_walks_and_runs_not_chosen_on(shared_data):
    """0.053 m in the mean, 0.050 m median; the author, with a threshold a trial from the truth, 0.065 m in the mean."""
    errors = []
    for path in half_not_chosen_on(shared_data / "pyshoe_more"):
        trial = read_pyshoe(path)
        result = navigate_foot(trial.recording)
        try:
            errors.append((walk_errors(result, trial.recording.reference), trial.errors["shoe"]))
        except InputError:
            assert result.distance < 0.5  # one shuffles on the spot
    ours = np.array([e.author_error for e, _ in errors])
    assert len(ours) >= 11
    assert ours.mean() < min(0.07, np.mean([author for _, author in errors]))
    assert np.median(ours) < 0.06
    nees = np.array([e.nees() for e, _ in errors])
    assert np.all((np.median(nees, axis=0) > 0.5) & (np.median(nees, axis=0) < 2.0))
    assert nees[:, 0].max() < 10.0


def test_another_sensor_outdoors_not_chosen_on(shared_data):
    """Ground points of each stride, up to a rotation and a reflection; the stored LSTM track is 0.4 to 1.4 m off."""
    for path in half_not_chosen_on(shared_data / "llio_foot"):
        data = loadmat(path)
        t, values = np.ravel(data["timestamps"]).astype(float), np.asarray(data["imu_data"], dtype=float)
        result = navigate_foot(ImuSeries(t, values[:, 3:], values[:, :3]))
        at = np.ravel(data["strideIndex"]).astype(int) - 1
        points = np.asarray(data["GCP"], dtype=float)[:, :2]
        track = np.stack([np.interp(t[at[: len(points)]], result.t, x) for x in result.position_n()[:, :2].T], axis=1)
        assert min(misfit(track, points), misfit(track * (1.0, -1.0), points)) < 2.0


def misfit(track, points):
    """RMS distance after turning a track about its first point. [m]"""
    a, b = track - track[0], points - points[0]
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    c, s = np.cos(angle), np.sin(angle)
    return np.sqrt(np.mean(np.sum((a @ np.array([[c, s], [-s, c]]) - b) ** 2, axis=1)))
