"""Starts from the log: rest is what the IMU shows, velocities from positions, headings from what follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import earth, frames, rotation, units
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.config import AlignmentSection, NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.start.alignment import position_error_of_fix
from schuler.navigation.start.levelling import level_in_motion
from schuler.navigation.start.rests import rests_before
from schuler.navigation.start.velocity_fit import velocity_fit, with_velocities
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.simulation.scenario import prepare_mission, simulate_mission

SPEC = ImuSpec(
    "test",
    TriadSpec.gyro(arw_deg_rthr=0.2, bias_deg_s=0.2),
    TriadSpec.accelerometer(vrw_m_s_rthr=0.05, bias_mg=3.0),
)
IMU = {"gyro": {"arw_deg_rthr": 0.2, "bias_deg_s": 0.2}, "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 3.0}}
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 20.0},
    {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0},
    {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
    {"north_m": -60.0, "east_m": 300.0, "speed_m_s": 10.0},
    {"north_m": -150.0, "east_m": 50.0, "speed_m_s": 12.0},
]
PLACE = np.array([0.8, 0.15, 400.0])
RATE = 50.0


@pytest.fixture(scope="module")
def drive():
    """A car with gyro biases of either sign far above what a rest leaves of them."""
    mission = prepare_mission(
        {
            "seed": 3,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": RATE, **IMU},
            "gnss": {"rate_hz": 1.0, "lever_arm_m": [0.0, 0.0, 0.0], "sigma_position_m": [0.5, 0.5, 1.0]},
        }
    )
    return simulate_mission(mission).recording


def config(**sections):
    return {"imu": dict(IMU), "filter": {"smooth": False, "tune": False}, **sections}


def horizontal_nees(result, reference):
    t, dx, P = state_errors(result, reference)
    C = frames.C_en(result.states.llh[np.isin(result.t, t)])
    e = np.einsum("kji,kj->ki", C, dx[:, 6:9])[:, :2]
    S = np.einsum("kji,kjl,klm->kim", C, P[:, 6:9, 6:9], C)[:, :2, :2]
    return float(np.mean(np.einsum("ki,ki->k", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])) / 2.0)


def heading_error(result, reference, at=-1):
    t, dx, _ = state_errors(result, reference)
    C = frames.C_en(result.states.llh[np.isin(result.t, t)])
    return np.einsum("kji,kj->ki", C, dx[:, :3])[at, 2]


def notes(result, part):
    return [n for n in result.notes if part in n]


# --- rests ------------------------------------------------------------------------------------------------------------


def still_log(pieces, rng, bias=(0.002, -0.003, 0.0015), noise=(1e-3, 1e-2)):
    """Rates of pieces (seconds, rate about z [rad/s], forward force [m/s^2], factor on the noise)."""
    gyro, accel = [], []
    for seconds, turn, force, factor in pieces:
        n = round(seconds * RATE)
        gyro.append(np.array(bias) + (0.0, 0.0, turn) + factor * noise[0] * rng.standard_normal((n, 3)))
        accel.append(np.array((force, 0.0, -9.81)) + factor * noise[1] * rng.standard_normal((n, 3)))
    gyro = np.concatenate(gyro)
    return ImuSeries(np.arange(len(gyro)) / RATE, gyro, np.concatenate(accel))


def fixes(t, speed, sigma_v=0.1, sigma_r=1.0):
    """Fixes that go north with a speed."""
    t, v = np.asarray(t, dtype=float), np.zeros((len(t), 3))
    v[:, 0] = speed
    r = np.zeros((len(t), 3))
    r[1:, 0] = np.cumsum(0.5 * (v[1:, 0] + v[:-1, 0]) * np.diff(t))
    llh = frames.llh_from_ecef(frames.ecef_from_ned(r, PLACE))
    return GnssSeries(
        t, llh, np.tile(sigma_r**2 * np.eye(3), (len(t), 1, 1)), v, np.tile(sigma_v**2 * np.eye(3), (len(t), 1, 1))
    )


SHAKEN = (200.0, 0.0, 0.0, 30.0)  # driving on a road


def test_all_of_a_long_rest_counts_not_its_last_seconds():
    """A phone lay still for 200 s, was then turned in the hand, and the first fix came while it moved."""
    imu = still_log([(200.0, 0.0, 0.0, 1.0), (12.0, 0.3, 0.0, 20.0), SHAKEN], np.random.default_rng(1))
    rests = rests_before(imu, fixes(np.arange(212.0, 410.0), 8.0), 212.0, SPEC, 300.0)
    assert len(rests) == 1
    assert rests.duration > 195.0
    assert not rests.confirmed.any()
    mean, sigma = rests.mean_rate()
    assert sigma < 0.02 * units.DEG  # below a tenth of the turn-on bias
    assert np.all(np.abs(mean - (0.002, -0.003, 0.0015)) < 4.0 * sigma)


def test_the_rest_of_a_phone_is_no_longer_than_asked_for():
    imu = still_log([(100.0, 0.0, 0.0, 1.0), (5.0, 0.3, 0.0, 20.0), (30.0, 0.0, 0.0, 1.0), SHAKEN],
                    np.random.default_rng(1))  # fmt: skip
    gnss = fixes(np.arange(140.0, 330.0), 8.0)
    assert len(rests_before(imu, gnss, 140.0, SPEC, 300.0)) == 2
    last = rests_before(imu, gnss, 140.0, SPEC, 20.0)
    assert len(last) == 1
    assert last.start[0] > 105.0
    assert not len(rests_before(imu, gnss, 140.0, SPEC, 0.0))


@pytest.mark.parametrize("turn_deg_s", [3.0, -3.0])
def test_a_smooth_turn_is_no_rest(turn_deg_s):
    """As quiet as a rest, but faster than a gyro bias can be."""
    imu = still_log([(30.0, turn_deg_s * units.DEG, 0.5, 1.0), SHAKEN], np.random.default_rng(2))
    assert not len(rests_before(imu, fixes(np.arange(30.0, 220.0), 8.0), 30.0, SPEC, 300.0))


def test_a_steady_acceleration_is_no_rest():
    """Not more than half of a stretch may be something else than its rest."""
    imu = still_log([(20.0, 0.0, 0.0, 1.0), (6.0, 0.0, 1.5, 1.0), SHAKEN], np.random.default_rng(3))
    rests = rests_before(imu, fixes(np.arange(26.0, 220.0), 9.0), 26.0, SPEC, 300.0)
    assert rests.stop[-1] <= 20.0
    assert abs(rests.force[-1, 0]) < 0.02


def test_a_fix_that_moves_vetoes_and_one_that_stands_confirms():
    imu = still_log([(40.0, 0.0, 0.0, 1.0), SHAKEN], np.random.default_rng(4))
    t = np.arange(0.0, 230.0)
    moving = rests_before(imu, fixes(t, np.where(t < 20.0, 5.0, 8.0)), 40.0, SPEC, 300.0)
    assert not len(moving)
    standing = rests_before(imu, fixes(t, np.where(t < 40.0, 0.0, 8.0)), 38.0, SPEC, 300.0)
    assert standing.confirmed.all()
    assert standing.duration > 35.0


def test_slow_turns_that_pass_for_rest_are_in_the_claim():
    """Where motion is as quiet as rest (a ship), one quiet stretch says little; shaken motion leaves no doubt."""
    ship = [(60.0, w * units.DEG, 0.0, 1.0) for w in (0.3, -0.4, 0.2, 0.5, -0.3)]
    claims = []
    for later in (ship, [SHAKEN]):
        imu = still_log([(10.0, 0.4 * units.DEG, 0.0, 1.0), (2.0, 0.0, 0.3, 5.0), *later], np.random.default_rng(5))
        rests = rests_before(imu, fixes(np.arange(12.0, imu.t[-1]), 8.0), 12.0, SPEC, 300.0)
        claims.append(rests.mean_rate()[1] / units.DEG)
    assert claims[0] > 0.1  # the true error is 0.4
    assert claims[1] < 0.03


def test_rests_that_disagree_widen_the_claim():
    rng = np.random.default_rng(6)
    alike = still_log([(20.0, 0.0, 0.0, 1.0), (5.0, 0.3, 0.0, 20.0), (20.0, 0.0, 0.0, 1.0), SHAKEN], rng)
    apart = replace(alike, gyro=alike.gyro + np.where(alike.t < 22.0, 0.002, 0.0)[:, None])
    gnss = fixes(np.arange(0.0, 240.0), np.where(np.arange(240.0) < 45.0, 0.0, 8.0))
    sigma = [rests_before(x, gnss, 45.0, SPEC, 300.0).mean_rate()[1] for x in (alike, apart)]
    assert sigma[1] > 3.0 * sigma[0]
    assert sigma[1] > 0.3 * 0.002 / np.sqrt(2.0)


# --- velocities -------------------------------------------------------------------------------------------------------


def test_a_parabola_is_fitted_exactly_also_at_the_ends():
    t = np.arange(0.0, 12.0)
    r = np.stack((2.0 * t + 0.4 * t**2, -1.0 * t, 0.1 * t**2), axis=1)
    llh = frames.llh_from_ecef(frames.ecef_from_ned(r, PLACE))
    v, cov = velocity_fit(GnssSeries(t, llh, np.tile(np.eye(3), (12, 1, 1))))
    # rounding of Earth-fixed metres, and axes that turn over 80 m
    np.testing.assert_allclose(v, np.stack((2.0 + 0.8 * t, np.full(12, -1.0), 0.2 * t), axis=1), atol=2e-4)
    assert np.sqrt(cov[6, 0, 0]) == pytest.approx(1.0 / np.sqrt(10.0), rel=0.01)  # slope of five equal weights
    assert cov[0, 0, 0] > 4.0 * cov[6, 0, 0]


def test_the_claim_of_fitted_velocities_holds():
    """NEES over a drive with jerk: between 0.3 and 1.3, since the jerk is taken for larger than it is."""
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 400.0)
    v = np.stack((10.0 + 4.0 * np.sin(0.2 * t), 5.0 * np.cos(0.3 * t), np.zeros(400)), axis=1)
    r = np.stack((10.0 * t - 20.0 * np.cos(0.2 * t), 5.0 / 0.3 * np.sin(0.3 * t), np.zeros(400)), axis=1)
    noisy = r + rng.standard_normal(r.shape)
    place = PLACE
    llh = frames.llh_from_ecef(frames.ecef_from_ned(noisy, place))
    fit, cov = velocity_fit(GnssSeries(t, llh, np.tile(np.eye(3), (400, 1, 1))))
    turn = np.einsum("nji,jk->nik", frames.C_en(llh), frames.C_en(place))
    e = (fit - np.einsum("nij,nj->ni", turn, v))[:, :2]
    nees = np.mean(np.einsum("ni,ni->n", e, np.linalg.solve(cov[:, :2, :2], e[:, :, None])[:, :, 0])) / 2.0
    assert 0.3 < nees < 1.3  # statistical: 400 fixes, neighbours correlated


@pytest.mark.parametrize(("noise", "least", "most"), [(5.0, 0.8, 1.0), (0.5, 0.19, 0.21)])
def test_velocities_are_as_much_better_as_neighbouring_fixes_agree(noise, least, most):
    """Standing, stated 5 m: at most five times, which errors that wander by 0.1 m a second and square root leave."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 400.0)
    r = noise * rng.standard_normal((400, 3)) + np.cumsum(0.1 * rng.standard_normal((400, 3)), axis=0)
    llh = frames.llh_from_ecef(frames.ecef_from_ned(r, PLACE))
    fit, cov = velocity_fit(GnssSeries(t, llh, np.tile(25.0 * np.eye(3), (400, 1, 1))))
    slope = 5.0 / np.sqrt(10.0)
    assert np.all(np.sqrt(cov[10:-10, 0, 0]) > least * slope)
    if noise < 5.0:  # the noise of the fits' accelerations is taken for jerk, and grows with the noise
        assert np.sqrt(cov[10:-10, 0, 0]).max() < 2.0 * most * slope
    assert np.mean(fit[10:-10, :2] ** 2) < np.mean(cov[10:-10, 0, 0])


def test_stated_velocities_stay_but_for_components_that_are_no_measurement():
    g = fixes(np.arange(20.0), 8.0)
    assert with_velocities(g) is g
    cov = g.cov_v_n.copy()
    cov[:, 2, 2] = 100.0
    full = with_velocities(replace(g, cov_v_n=cov, v_n=g.v_n + np.array([0.0, 0.0, 3.0])))
    np.testing.assert_array_equal(full.v_n[:, :2], g.v_n[:, :2])
    assert np.abs(full.v_n[:, 2]).max() < 0.01
    assert full.cov_v_n[5, 2, 2] < 1.0


# --- starts -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [26.0, 41.0, 55.0, 70.0])
def test_a_late_first_fix_does_not_make_a_turn_a_bias(drive, first):
    late = navigate(drive, config(outages={"windows_s": [[0.0, first]]}))
    assert horizontal_nees(late, drive.reference) < 3.0
    full = navigate(drive, config())
    after = (late.trajectory.t[0] + 10.0, drive.reference.t[-1])
    rms = [x.errors(drive.reference).between(*after).rms_horizontal for x in (late, full)]
    assert rms[0] < 1.3 * rms[1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_start_s_claim_holds_with_biases_of_either_sign(drive, sign):
    """Normalised error of attitude, velocity and position at the start, over first fixes at many times."""
    turned = replace(drive, imu=replace(drive.imu, gyro=drive.imu.gyro + sign * 0.15 * units.DEG * h(drive.imu)))
    values = []
    for first in np.arange(24.0, 84.0, 5.0):
        r = navigate(turned, config(outages={"windows_s": [[0.0, first], [first + 3.0, 1e4]]}))
        _, dx, P = state_errors(r, drive.reference)
        s = np.sqrt(np.diag(P[0]))
        values.append((dx[0] / s) @ np.linalg.solve(P[0] / np.outer(s, s), dx[0] / s) / 9.0)
    # one drive, one bias: the twelve starts share it, so their mean is as wide as that of three
    assert np.mean(values) < chi_square_band(9, 3, 0.999)[1]


def h(imu):
    """Seconds of a sample: 1 for rates."""
    return 1.0 if imu.kind == "rate" else 1.0 / RATE


def test_velocities_without_a_vertical_one_are_used_for_what_they_say(drive):
    g = drive.need_gnss()
    cov = g.cov_v_n.copy()
    cov[:, 2, :] = cov[:, :, 2] = 0.0
    cov[:, 2, 2] = 100.0
    nmea = replace(drive, gnss=replace(g, v_n=g.v_n * (1.0, 1.0, 0.0), cov_v_n=cov))
    result, full = navigate(nmea, config()), navigate(drive, config())
    assert result.trajectory.t[0] == full.trajectory.t[0]
    assert result.innovations.rejected() == {"position": 0, "velocity": 0}
    errors = [x.errors(drive.reference).rms_horizontal for x in (result, full)]
    assert errors[0] < 1.1 * errors[1]


@pytest.mark.parametrize("k", [0, 1])
def test_fixes_five_seconds_apart_level_and_the_gyro_bias_is_in_the_claim(k):
    """Closed form: on a straight with constant acceleration a bias b turns the level by b times the way to the middle.

    Tolerance of discretisation: gravity turns by 1e-4 rad over the way, squares of the turn are left out.
    """
    t, a, b = np.arange(0.0, 10.0001, 0.01), 1.5, np.array([2e-3, -3e-3, 0.0])
    force = np.tile([a, 0.0, -earth.gravity_ned(PLACE[0], PLACE[2])[2]], (len(t), 1))
    rates = ImuSeries(t, np.tile(b, (len(t), 1)), force)
    at = np.array([0.0, 5.0, 10.0])
    v = np.stack([10.0 + a * at, np.zeros(3), np.zeros(3)], axis=1)
    llh = PLACE + np.outer(10.0 * at + 0.5 * a * at**2, [1.0 / 6.37e6, 0.0, 0.0])
    gnss = GnssSeries(at, llh, np.tile(np.eye(3), (3, 1, 1)), v, np.tile(1e-4 * np.eye(3), (3, 1, 1)))
    section = AlignmentSection(tilt_floor_deg=0.01)
    expected = level_in_motion(rates, gnss, k, 0.0, 0.01, (b, 1e-4), section, SPEC)
    np.testing.assert_allclose(expected.rpy_nb, 0.0, atol=4e-4)
    unknown = level_in_motion(rates, gnss, k, 0.0, 0.01, (np.zeros(3), 5e-3), section, SPEC)
    np.testing.assert_allclose(unknown.rpy_nb - expected.rpy_nb, unknown.psi_gyro @ -b, atol=4e-4)
    assert abs(unknown.rpy_nb[0]) > 4e-3  # half of five seconds, as far from the fix as the middle is
    assert unknown.sigma_b_g == 5e-3
    with pytest.raises(InputError, match="two GNSS velocities at most 15 s apart"):
        level_in_motion(rates, gnss.where([0]), 0, 0.0, 0.01, (b, 1e-4), section, SPEC)


@pytest.mark.parametrize("pitch", [-0.08, 1.05])
@pytest.mark.parametrize("b_a", [(0.1, 0.0, 0.0), (0.0, -0.1, 0.0), (-0.05, 0.08, 0.1)])
def test_an_accelerometer_bias_tilts_a_start_in_motion_as_it_says(b_a, pitch):
    """Its sensitivity against the start of a log with the bias in it, flat and as a phone stands in a mount.

    Discretisation: squares of 0.01 rad.
    """
    t, at, heading = np.arange(0.0, 3.001, 0.01), np.arange(4.0), 0.7
    C_nb = rotation.dcm_from_rpy([0.05, pitch, heading])
    force = -C_nb.T @ earth.gravity_ned(PLACE[0], PLACE[2])
    v = np.tile([10.0 * np.cos(heading), 10.0 * np.sin(heading), 0.0], (4, 1))
    eyes = np.tile(np.eye(3), (4, 1, 1))
    gnss = GnssSeries(at, np.tile(PLACE, (4, 1)), eyes, v, 1e-4 * eyes)
    exact, biased = (
        level_in_motion(
            ImuSeries(t, np.zeros((len(t), 3)), np.tile(force + b, (len(t), 1))), gnss, 1, heading, 0.1,
            (np.zeros(3), 1e-3), AlignmentSection(), SPEC,
        )
        for b in (np.zeros(3), np.array(b_a))
    )  # fmt: skip
    error = rotation.rotvec_from_dcm(biased.C_nb @ exact.C_nb.T)
    assert np.linalg.norm(error[:2]) > 0.005
    np.testing.assert_allclose(error[:2], (-exact.psi_accel @ b_a)[:2], atol=2e-4)


@pytest.mark.parametrize("begin", [40.0, 55.0, 70.0])
def test_a_run_starts_in_motion_where_fixes_are_five_seconds_apart(drive, begin):
    part = drive.between(begin, 1e9)
    rare = replace(part, gnss=part.gnss.where(np.arange(len(part.gnss)) % 5 == 0))
    result = navigate(rare, config())
    assert result.verdict.status != "failed"
    assert horizontal_nees(result, drive.reference) < 4.0  # statistical: few independent errors in so short a run


def test_positions_alone_start_a_run(drive):
    positions = replace(drive, gnss=replace(drive.need_gnss(), v_n=None, cov_v_n=None))
    result = navigate(positions, config())
    assert horizontal_nees(result, drive.reference) < 3.0
    assert abs(heading_error(result, drive.reference)) < 3.0 * units.DEG
    rpy = drive.reference.rpy_nb[0] / units.DEG
    given = config(
        alignment={"method": "given", "rpy_deg": rpy.tolist(), "sigma_deg": [0.5, 0.5, 2.0]},
        outages={"windows_s": [[0.0, 60.0]]},
    )
    result = navigate(positions, given)
    e = state_errors(result, drive.reference)
    assert np.all(np.abs(e[1][0, 3:6]) < 4.0 * np.sqrt(np.einsum("ii->i", e[2][0])[3:6]))


def test_no_rest_is_used_when_none_is_wanted(drive):
    result = navigate(drive, config(alignment={"rest_s": 0.0}))
    assert not notes(result, "gyro biases start")
    assert notes(result, "levelled in motion")


@pytest.mark.parametrize("positions", [False, True])
@pytest.mark.parametrize("wrong", [0.0, 90.0, 180.0])
def test_an_unknown_heading_is_found(drive, wrong, positions):
    g = drive.need_gnss()
    recording = replace(drive, gnss=replace(g, v_n=None, cov_v_n=None)) if positions else drive
    rpy = drive.reference.rpy_nb[0] / units.DEG + (0.0, 0.0, wrong)
    unknown = {"method": "given", "rpy_deg": rpy.tolist(), "sigma_deg": [1.0, 1.0, 180.0]}
    result = navigate(recording, config(alignment=unknown))
    assert notes(result, "accelerations")
    t, _, _ = state_errors(result, drive.reference)
    minute = int(np.searchsorted(t, 20.0 + 60.0))  # a minute of driving
    assert abs(heading_error(result, drive.reference, minute)) < 4.0 * result.sigma("dpsi")[minute, 2]
    assert horizontal_nees(result, drive.reference) < 3.0


@pytest.mark.parametrize("wrong", [90.0, -135.0])
def test_an_unknown_heading_is_found_where_noise_is_stated_far_too_small(drive, wrong):
    """Fixes of 2 cm, an IMU thirty times as noisy as stated: no heading fits, and the right one is found."""
    gnss = drive.need_gnss()
    rng = np.random.default_rng(4)
    offsets = np.einsum("nij,nj->ni", frames.C_en(gnss.llh), rng.standard_normal((len(gnss), 3)) * [0.02, 0.02, 0.04])
    llh = frames.llh_from_ecef(drive.reference.at(gnss.t).r_eb_e + offsets)
    cov = np.broadcast_to(np.diag([0.02, 0.02, 0.04]) ** 2, (len(gnss), 3, 3))
    imu = drive.need_imu()
    noise = 30.0 * np.sqrt(imu.interval) * np.array([0.2 * units.DEG, 0.05]) / 60.0  # of increments
    shaken = replace(
        imu,
        gyro=imu.gyro + noise[0] * rng.standard_normal(imu.gyro.shape),
        accel=imu.accel + noise[1] * rng.standard_normal(imu.accel.shape),
    )
    log = replace(
        drive, imu=shaken, gnss=replace(gnss, llh=llh, cov_r_n=np.ascontiguousarray(cov), v_n=None, cov_v_n=None)
    )
    rpy = drive.reference.rpy_nb[0] / units.DEG + (0.0, 0.0, wrong)
    prepared = prepared_run(
        log,
        NavigationConfig.checked(
            config(alignment={"method": "given", "rpy_deg": rpy.tolist(), "sigma_deg": [1.0, 1.0, 180.0]})
        ),
    )
    nav = prepared.initial.nav
    off = frames.wrap_angle(nav.rpy_nb[2] - drive.reference.at(np.array([nav.t])).rpy_nb[0, 2]) / units.DEG
    assert abs(off) < 15.0  # between two of the headings tried


@pytest.mark.parametrize("mount", [90.0, 180.0])
def test_a_course_that_is_not_the_heading_is_found_out(drive, mount):
    """The vehicle starts backwards, or the IMU looks sideways: its accelerations say so."""
    C = rotation.dcm_from_rpy(np.array([0.0, 0.0, mount * units.DEG]))
    turned = replace(drive, imu=replace(drive.imu, gyro=drive.imu.gyro @ C, accel=drive.imu.accel @ C))
    result = navigate(turned, config())
    (sentence,) = notes(result, "accelerations of the first")
    assert "the course is" in sentence
    assert result.errors(drive.reference).rms_horizontal < 1.0
    off = frames.wrap_angle(result.trajectory.rpy_nb[-1, 2] - drive.reference.at(result.t[-1:]).rpy_nb[0, 2])
    assert abs(abs(off) - mount * units.DEG) < 3.0 * units.DEG


@pytest.mark.parametrize("up", [90.0, -90.0])
def test_an_upright_x_axis_levels_as_others_do(up):
    """Laws: the force lies along gravity, to rounding; another heading is a turn about the vertical by as much.

    But for the north component of gravity, 3e-7 of it at this height.
    """
    t, at = np.arange(0.0, 3.001, 0.01), np.arange(4.0)
    C_bs = rotation.dcm_from_rpy(np.array([2.0, -3.0, 1.0]) * units.DEG) @ rotation.dcm_from_rpy(
        [0.0, up * units.DEG, 0.0]
    )
    g_n = earth.gravity_ned(PLACE[0], PLACE[2])
    rates = ImuSeries(t, np.zeros((len(t), 3)), np.tile(-C_bs @ g_n, (len(t), 1)))
    v = np.tile([10.0, 0.0, 0.0], (4, 1))
    gnss = GnssSeries(
        at, np.tile(PLACE, (4, 1)), np.tile(np.eye(3), (4, 1, 1)), v, np.tile(1e-4 * np.eye(3), (4, 1, 1))
    )
    levelled = [
        level_in_motion(rates, gnss, 1, heading, 0.1, (np.zeros(3), 1e-3), AlignmentSection(), SPEC).C_nb
        for heading in np.linspace(0.0, 6.0, 7)
    ]
    for k, C_nb in enumerate(levelled):
        np.testing.assert_allclose(C_nb @ C_bs @ g_n, g_n, atol=1e-9)
        np.testing.assert_allclose(C_nb, rotation.dcm_from_rpy(np.array([0.0, 0.0, float(k)])) @ levelled[0], atol=1e-6)


@pytest.mark.parametrize(("up", "begin"), [(90.0, 0.0), (-90.0, 45.0)])
def test_an_upright_x_axis_has_no_course(drive, up, begin):
    """The log shows the heading; errors are those of the same IMU lying."""
    part = drive.between(begin, 1e9)
    C = rotation.dcm_from_rpy(np.array([0.0, up * units.DEG, 0.0]))
    result = navigate(replace(part, imu=part.need_imu().rotated(C)), config())
    assert notes(result, "accelerations of the first")
    assert "course" not in notes(result, "aligned")[0]
    C_nb = rotation.dcm_from_rpy(result.trajectory.rpy_nb[-1]) @ C
    true = rotation.dcm_from_rpy(drive.reference.at(result.t[-1:]).rpy_nb[0])
    assert np.degrees(np.arccos(0.5 * (np.trace(C_nb @ true.T) - 1.0))) < 2.0  # statistical
    assert (
        result.errors(drive.reference).rms_horizontal
        < 1.2 * navigate(part, config()).errors(drive.reference).rms_horizontal
    )


def test_a_right_course_is_left_alone(drive):
    result = navigate(drive, config())
    assert not notes(result, "accelerations")
    assert not notes(result, "the course is taken for the heading")


@pytest.mark.parametrize("aside", [-12.0, 30.0])
def test_a_course_aside_of_the_heading_is_claimed_no_better_than_fixes_bear_it_out(drive, aside):
    """A body that goes aside of where it points, too little for another heading to be clearly likelier."""
    C = rotation.dcm_from_rpy(np.array([0.0, 0.0, aside * units.DEG]))
    turned = replace(drive, imu=replace(drive.imu, gyro=drive.imu.gyro @ C, accel=drive.imu.accel @ C))
    prepared = prepared_run(turned, NavigationConfig.checked(config()))
    nav = prepared.initial.nav
    true = drive.reference.at(np.array([nav.t])).rpy_nb[0, 2] + aside * units.DEG
    off, sigma = abs(frames.wrap_angle(nav.rpy_nb[2] - true)), float(np.sqrt(prepared.initial.P[2, 2]))
    assert off < 3.0 * sigma
    assert any("bear out no more" in note for note in prepared.notes)


@pytest.mark.parametrize("first", [7, 10, 13])
def test_wrong_fixes_do_not_choose_a_heading(drive, first):
    """Two in a row, so that they are not seen to jump back, of fixes of a centimetre."""
    rng = np.random.default_rng(2)
    reference, gnss = drive.need_reference(), drive.need_gnss()
    r = frames.ecef_from_llh(reference.at(gnss.t).llh) + 0.01 * rng.standard_normal((len(gnss), 3))
    C = frames.C_en(gnss.llh)
    cov = np.tile(1e-4 * np.eye(3), (len(gnss), 1, 1))
    off = np.isin(np.arange(len(gnss)) % 20, (first, first + 1))[:, None] * (C @ np.array([12.0, 16.0, 0.0]))
    right, wrong = (
        prepared_run(
            replace(drive, gnss=replace(gnss, llh=frames.llh_from_ecef(x), cov_r_n=cov)),
            NavigationConfig.checked(config()),
        )
        for x in (r, r + off)
    )
    assert abs(frames.wrap_angle(wrong.initial.nav.rpy_nb[2] - right.initial.nav.rpy_nb[2])) < 1e-3


def test_a_heading_that_nothing_shows_is_said_to_be_in_doubt():
    """At rest nothing shows it: an error where it must come from the log, a note where it was given."""
    imu = still_log([(120.0, 0.0, 0.0, 1.0)], np.random.default_rng(8))
    from schuler.recording.recording import Recording

    standing = Recording(imu, fixes(np.arange(0.0, 120.0), 0.0))
    with pytest.raises(InputError, match="nor do its accelerations"):
        navigate(standing, config())
    result = navigate(
        standing, config(alignment={"method": "given", "rpy_deg": [0.0, 0.0, 0.0], "sigma_deg": [1.0, 1.0, 180.0]})
    )
    assert notes(result, "in doubt")


def test_a_start_in_a_turn_has_the_velocity_of_the_imu():
    """The antenna 10 m ahead moves sideways by 0.8 m/s more. Statistical: four sigmas of a fix."""
    lever, sigma = [10.0, 0.0, -1.0], 0.02
    mission = prepare_mission(
        {
            "seed": 5,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": RATE, **IMU},
            "gnss": {"rate_hz": 5.0, "lever_arm_m": lever, "sigma_velocity_m_s": [sigma] * 3},
        }
    )
    log = simulate_mission(mission).recording
    imu, gnss, truth = log.need_imu(), log.need_gnss(), log.need_reference()
    rate = np.interp(gnss.t, imu.t, imu.rates().gyro[:, 2])
    t = gnss.t[np.argmax(np.abs(rate))]
    assert np.abs(rate).max() > 0.05
    log = replace(log, imu=imu.between(t - 1.0 / RATE, imu.t[-1]), gnss=gnss.where(gnss.t >= t - 1e-6))
    given = {"method": "given", "rpy_deg": [float(v) for v in truth.at(np.array([t])).rpy_nb[0] / units.DEG]}
    asked = NavigationConfig.checked(config(alignment=given, gnss={"lever_arm_m": lever}))
    start = prepared_run(log, asked).initial.nav
    v = truth.at(np.array([start.t])).v_eb_e[0]
    np.testing.assert_allclose(start.v_eb_e, v, rtol=0.0, atol=4.0 * sigma)


def test_the_position_of_a_start_errs_as_its_attitude_and_lever_arm_do():
    """Numerical twin: the fix is the antenna's, so the IMU is where the arm leads back to. Central differences."""
    layout, h = StateLayout({"lever": StateModel.constant(0.1)}), 1e-6
    C, lever, r_antenna = rotation.dcm_from_rpy([0.1, -0.2, 2.0]), np.array([1.5, 0.3, -1.0]), np.array([7.0, 8.0, 9.0])

    def place(error):
        """By an attitude and a lever arm so wrong, estimate minus truth."""
        return r_antenna - rotation.dcm_from_rotvec(error[:3]) @ C @ (lever + error[3:])

    T = position_error_of_fix(layout, C, lever, np.zeros(3))
    twin = np.stack([(place(h * e) - place(-h * e)) / (2.0 * h) for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(T[6:9, :3], twin[:, :3], atol=1e-8)
    np.testing.assert_allclose(T[6:9, layout["lever"]], twin[:, 3:], atol=1e-8)
