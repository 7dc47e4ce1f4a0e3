"""A rotating IMU through the filter: as good as its covariance says, and what levers, offsets and encoders do."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from places import ROOT

from schuler import frames, rotation
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording
from schuler.rotary.aids import in_imu_axes, lever_arms
from schuler.rotary.encoder import Encoder, EncoderReadings, read_encoder
from schuler.rotary.navigation import navigate_rotary
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schemes import continuous, dual_axis, fixed, reciprocating
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import simulate_imu
from schuler.simulation.motion import StaticMotion
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion
from schuler.units import DEG, DEG_PER_HR

PLACE = np.array([45.75 * DEG, 20.0 * DEG, 300.0])
LEVER = (0.8, 0.3, -1.2)
OFFSET = np.array([0.05, -0.03, 0.02])
BIAS = {"b_g": np.array([100.0, -200.0, 150.0]) * DEG_PER_HR, "b_a": np.array([0.05, -0.08, 0.03])}
ARW, VRW = 0.4 * DEG / 60.0, 0.1 / 60.0
CONFIG = {
    "imu": {"gyro": {"arw_deg_rthr": 0.4, "bias_deg_hr": 300.0}, "accel": {"vrw_m_s_rthr": 0.1, "bias_m_s2": 0.1}},
    "gnss": {"lever_arm_m": LEVER},
}
TURN = continuous("-z", 20.0 * DEG, acceleration=10.0 * DEG, start=20.0)


@cache
def vehicle():
    lap = [
        Manoeuvre(duration=10.0, speed=12.0),
        Manoeuvre(duration=10.0),
        Manoeuvre(duration=8.0, turn=0.5 * np.pi),
        Manoeuvre(duration=10.0, speed=15.0),
        Manoeuvre(duration=8.0, turn=-0.6 * np.pi),
        Manoeuvre(duration=8.0, speed=8.0),
    ]
    return ManoeuvreMotion.of([Manoeuvre(duration=30.0), *lap, *lap], PLACE, heading=0.4, bank=0.0)


@cache
def ideal(schedule, offset=(0.0, 0.0, 0.0)):
    return ideal_rotating_imu(RotatingMotion(vehicle(), schedule, np.array(offset)), 100.0)


@cache
def truth():
    return vehicle_truth(RotatingMotion(vehicle(), fixed()), np.round(np.arange(0.0, vehicle().duration, 0.01), 2))


def recording(schedule=TURN, *, offset=(0.0, 0.0, 0.0), sign=1.0, seed=1, noisy=True, lever=LEVER):
    errors = ImuErrors(
        b_g=sign * BIAS["b_g"],
        b_a=sign * BIAS["b_a"],
        gyro_noise=NoiseModel((White(ARW),) if noisy else ()),
        accel_noise=NoiseModel((White(VRW),) if noisy else ()),
    )
    rngs = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2)]
    imu = simulate_imu(ideal(schedule, tuple(offset)), errors, rngs[0]).imu
    receiver = GnssModel(
        sigma_position=(0.05,) * 3, sigma_velocity=(0.03,) * 3, lever_arm_b=lever, first_s=0.37
    )  # fmt: skip
    return Recording(imu, simulate_gnss(vehicle(), receiver, rngs[1]), reference=truth())


def true_start(t=0.0, sigma=(0.5 * DEG, 0.5 * DEG, 2.0 * DEG), seed=None):
    """The vehicle's true state, or one with errors as uncertain as it says."""
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.states import imu_spec, state_layout

    config = NavigationConfig.parse(CONFIG)
    layout = state_layout(config, imu_spec(config))
    s = truth().at([t])
    z = np.zeros(9) if seed is None else np.random.default_rng(seed).standard_normal(9)
    C = frames.C_en(s.llh[0])
    nav = NavState(
        t,
        s.r_eb_e[0] + C @ (0.5 * z[6:9]),
        s.v_eb_e[0] + C @ (0.05 * z[3:6]),
        rotation.quat_multiply(rotation.quat_from_rotvec(C @ (np.array(sigma) * z[:3])), s.q_eb[0]),
    )
    return InitialState.from_sigmas(nav, layout, attitude=sigma, velocity=[0.05] * 3, position=[0.5] * 3)


def encoder(schedule=TURN, between="cubic", **errors):
    return read_encoder(
        schedule, Encoder(**errors), vehicle().duration, np.random.default_rng(0), between=between
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------- laws


@pytest.mark.campaign
@pytest.mark.parametrize("noise", [{}, {"gyro": 3.0, "accel": 2.0}], ids=["budget", "factors"])
def test_a_platform_that_stands_still_changes_nothing(noise):
    log, config = recording(fixed()), CONFIG | {"filter": {"noise": noise}}
    here, there = navigate_rotary(log, fixed(), config), navigate(log, config)
    # rounding: turning by the identity; the same engine on the same numbers
    assert np.abs(here.trajectory.r_eb_e - there.trajectory.r_eb_e).max() < 1e-8
    np.testing.assert_allclose(here.covariance_e, there.covariance_e, rtol=1e-9, atol=1e-15)
    assert here.innovations.mean_nis() == pytest.approx(there.innovations.mean_nis(), rel=1e-9)


def test_a_platform_that_stands_askew_is_a_mounting():
    """Aligned from the log with the platform at 70 deg: the same vehicle as with the mounting in the configuration."""
    angle = 70.0 * DEG
    log = recording(fixed("z", angle))
    here = navigate_rotary(log, fixed("z", angle), CONFIG)
    there = navigate(log, CONFIG | {"imu": CONFIG["imu"] | {"mount_rpy_deg": (0.0, 0.0, 70.0)}})
    # rounding
    assert np.abs(here.trajectory.r_eb_e - there.trajectory.r_eb_e).max() < 1e-6
    assert np.abs(here.trajectory.q_eb - there.trajectory.q_eb).max() < 1e-9
    C = fixed("z", angle).C_bs([0.0])[0]
    np.testing.assert_allclose(here.parameter("b_a")[-1] @ C.T, there.parameter("b_a")[-1], atol=1e-9)


def test_rate_of_a_lever_arm_is_its_derivative():
    schedule = dual_axis(8, dwell=3.0, rate=30.0 * DEG, acceleration=20.0 * DEG)
    t = np.linspace(0.5, 60.0, 301)
    h = 1e-4
    l_s, rate = lever_arms(schedule, t, LEVER)
    step = (lever_arms(schedule, t + h, LEVER)[0] - lever_arms(schedule, t - h, LEVER)[0]) / (2.0 * h)
    np.testing.assert_allclose(rate, step, atol=2e-5)  # discretisation, across jumps of the acceleration
    np.testing.assert_allclose(np.linalg.norm(l_s, axis=1), np.linalg.norm(LEVER), rtol=1e-12)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    "schedule",
    [
        TURN,
        reciprocating("x", 30.0 * DEG, acceleration=30.0 * DEG, start=5.0),
        dual_axis(8, dwell=2.0, rate=60.0 * DEG, acceleration=60.0 * DEG, start=5.0),
    ],
    ids=lambda s: s.name,
)
def test_perfect_sensors_give_the_truth(schedule):
    """Lever arm and offset together; receiver errors only."""
    errors = ImuErrors.none()
    imu = simulate_imu(ideal(schedule, tuple(OFFSET)), errors, np.random.default_rng(0)).imu
    receiver = GnssModel(
        sigma_position=(1e-6,) * 3, reported_position=(1e-3,) * 3, sigma_velocity=(1e-6,) * 3,
        reported_velocity=(5e-3,) * 3, lever_arm_b=LEVER, first_s=0.37,
    )  # fmt: skip
    log = Recording(imu, simulate_gnss(vehicle(), receiver, np.random.default_rng(0)))
    result = navigate_rotary(log, schedule, CONFIG, offset_m=OFFSET, initial=true_start())
    e = result.errors(truth())
    # discretisation: the lever arm's velocity takes the mean rate of an interval, half a sample old; in turns of
    # 20 deg/s that begin within 4 s, 2 m of arm make 1.5 mm/s of it
    assert np.abs(e.attitude_n).max() < 0.02 * DEG
    assert np.abs(e.velocity_n).max() < 5e-3
    assert np.abs(e.position_n).max() < 5e-3


# ------------------------------------------------------------------------------------------------ consistency


def test_nees_and_nis_are_in_band_with_biases_of_both_signs():
    runs, kept, nis, counts = 12, [], [], []
    log_truth = truth()
    for k in range(runs):
        sign = 1.0 if k % 2 else -1.0
        # the filter's models are what is drawn: biases at 1 sigma or less of 300 deg/h and 0.1 m/s^2, fixed by hand
        log = recording(sign=sign, seed=100 + k, offset=tuple(OFFSET))
        result = navigate_rotary(log, TURN, CONFIG, offset_m=OFFSET, initial=true_start(seed=k))
        parameters = sign * np.concatenate((BIAS["b_a"], BIAS["b_g"]))
        late = result.nees(log_truth, parameters)[40::20]
        kept.append(late.mean())
        nis.append(result.innovations.mean_nis())
        counts.append(3 * len(result.innovations))
        error = result.parameters[-1] - parameters
        assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(result.covariance_e[-1])[9:]))
    # statistical: 15 degrees of freedom, at least one independent value a run
    low, high = chi_square_band(15, runs, 0.999)
    assert low < np.mean(kept) < high
    low, high = chi_square_band(int(np.sum(counts)), 1, 0.9999)
    assert low < np.average(nis, weights=counts) < high


# --------------------------------------------------------------------------------------------- logs as they come


def test_clocks_outages_and_rates():
    """Stamps in GPS seconds, an IMU that reports rates, GNSS lost for 20 s: what a log of somebody's looks like."""
    shift = 345_600.0
    ideal_rates = ideal_rotating_imu(RotatingMotion(vehicle(), TURN), 100.0, kind="rate")
    errors = ImuErrors(
        b_g=BIAS["b_g"], b_a=BIAS["b_a"], gyro_noise=NoiseModel((White(ARW),)), accel_noise=NoiseModel((White(VRW),))
    )
    imu = simulate_imu(ideal_rates, errors, np.random.default_rng(6)).imu
    log = replace(recording(), imu=imu).shifted(shift)
    config = CONFIG | {"outages": {"windows_s": [(100.0, 120.0)]}}
    result = navigate_rotary(log, encoder(), config, platform_zero_s=shift)
    assert result.outages == ((shift + 100.0, shift + 120.0),)
    assert result.innovations.mean_nis() < 1.3
    e = result.errors(log.reference)
    inside = (e.t > shift + 100.0) & (e.t < shift + 120.0)
    assert 0.1 < e.horizontal[inside].max() < 10.0  # metres
    smooth = result.smooth().errors(log.reference)
    assert smooth.horizontal[inside].max() < 0.5 * e.horizontal[inside].max()
    # the same through the filter without a shift, to what is left of a clock of 3e5 s: nanoseconds
    plain = navigate_rotary(replace(recording(), imu=imu), encoder(), config)
    assert np.abs(plain.trajectory.r_eb_e[-1] - result.trajectory.r_eb_e[-1]).max() < 1e-3


# ------------------------------------------------------------------------------- levers, offset, encoder


@pytest.mark.campaign
def test_lever_arm_and_offset_matter_and_are_modelled():
    rocking = reciprocating("-z", 60.0 * DEG, acceleration=60.0 * DEG, start=5.0)
    far = np.array([0.10, 0.0, 0.0])
    log = recording(rocking, offset=tuple(far))
    right = navigate_rotary(log, rocking, CONFIG, offset_m=far, initial=true_start())
    on_axis = navigate_rotary(log, rocking, CONFIG, initial=true_start())
    no_lever = navigate_rotary(log, rocking, CONFIG | {"gnss": {"gate": "off"}}, offset_m=far, initial=true_start())
    assert 0.9 < right.innovations.mean_nis() < 1.1  # statistical
    # 60 deg/s at 0.1 m: 0.11 m/s^2 towards the axis, gone at each reversal; 0.1 m/s of velocity
    assert on_axis.innovations.mean_nis() > 1.5  # seen 1.98
    assert no_lever.innovations.mean_nis() > 2.0  # seen 3.35
    bias = right.parameter("b_a")[-1] - BIAS["b_a"]
    wrong = on_axis.parameter("b_a")[-1] - BIAS["b_a"]
    assert abs(bias[0]) < 4.0 * right.sigma("b_a")[-1, 0]
    assert abs(wrong[0]) > 10.0 * on_axis.sigma("b_a")[-1, 0]  # seen 0.033 m/s^2


def test_a_steady_offset_looks_like_a_bias():
    """``- rate^2 offset`` along the offset: an accelerometer's bias until the rate changes. Du leaves the term out."""
    far = np.array([0.10, 0.0, 0.0])
    rate = 20.0 * DEG
    wrong = navigate_rotary(recording(offset=tuple(far)), TURN, CONFIG, initial=true_start())
    seen = wrong.parameter("b_a")[-1] - BIAS["b_a"]
    # statistical: four of its own sigma
    assert seen[0] == pytest.approx(-(rate**2) * 0.10, abs=4.0 * wrong.sigma("b_a")[-1, 0])


def test_encoder_readings_do_what_the_schedule_does():
    log = recording()
    by_schedule = navigate_rotary(log, TURN, CONFIG, initial=true_start())
    by_encoder = navigate_rotary(log, encoder(), CONFIG, initial=true_start())
    turned = rotation.rotvec_from_quat(
        rotation.quat_multiply(
            by_encoder.trajectory.q_eb[-2000:], rotation.quat_conjugate(by_schedule.trajectory.q_eb[-2000:])
        )
    )
    # discretisation: 50 Hz readings of a platform that turns steadily
    assert np.abs(turned).max() < 1e-3 * DEG
    late = navigate_rotary(log, encoder(time_offset=0.05), CONFIG, initial=true_start())
    shift = late.trajectory.rpy_nb[-2000:, 2] - by_schedule.trajectory.rpy_nb[-2000:, 2]
    # an encoder 50 ms ahead at -20 deg/s about down leaves the heading 1 deg off, whatever the filter does
    assert np.mean(frames.wrap_angle(shift)) / DEG == pytest.approx(1.0, abs=0.1)
    mended = navigate_rotary(log, encoder(time_offset=0.05), CONFIG, initial=true_start(), platform_zero_s=0.05)
    shift = mended.trajectory.rpy_nb[-2000:, 2] - by_schedule.trajectory.rpy_nb[-2000:, 2]
    assert np.abs(frames.wrap_angle(shift)).max() < 0.01 * DEG


def test_aligned_from_the_log_smoothed_and_reported(tmp_path):
    log = recording(offset=tuple(OFFSET))
    result = navigate_rotary(log, encoder(), CONFIG, offset_m=OFFSET)
    assert any("platform turned during alignment" in note for note in result.notes)
    # the rest of 30 s fixes the gyro biases, half of it with a turning platform
    first = result.parameter("b_g")[0] - BIAS["b_g"]
    assert np.all(np.abs(first) < 4.0 * result.sigma("b_g")[0])
    assert result.sigma("b_g")[0].max() < 20.0 * DEG_PER_HR
    nees = result.nees(truth())[60:]
    assert np.median(nees) < 2.0  # statistical, one run
    smooth = result.smooth()
    filtered, smoothed = result.errors(truth()), smooth.errors(truth())
    assert smoothed.statistics()["rms_heading_deg"] < 0.5 * filtered.statistics()["rms_heading_deg"]
    assert smoothed.rms_horizontal < filtered.rms_horizontal
    assert "axes of the turning IMU" in result.summary()
    page = result.report(tmp_path / "rotary.html")
    assert page.stat().st_size > 10_000


def test_zero_velocity_of_a_turning_imu_at_rest():
    """Rest is found in the log turned to the body; without GNSS after the start, on a table."""
    place = StaticMotion(PLACE, np.array([0.0, 30.0 * DEG, 0.0]), 120.0)
    schedule = continuous("-z", 20.0 * DEG)
    motion = RotatingMotion(place, schedule, OFFSET)
    errors = ImuErrors(
        b_g=BIAS["b_g"], b_a=BIAS["b_a"], gyro_noise=NoiseModel((White(ARW),)), accel_noise=NoiseModel((White(VRW),))
    )
    imu = simulate_imu(ideal_rotating_imu(motion, 100.0), errors, np.random.default_rng(3)).imu
    spec = {"b_a": StateModel.constant(0.2), "b_g": StateModel.constant(400.0 * DEG_PER_HR)}
    start = InitialState.from_sigmas(
        NavState.from_geodetic(0.0, PLACE, rpy_nb=(0.01, 30.0 * DEG + 0.01, 0.01)), StateLayout(spec),
        attitude=[DEG] * 3, velocity=[0.01] * 3, position=[1.0] * 3,
    )  # fmt: skip
    config = CONFIG | {"aiding": {"zero_velocity": {"sigma_m_s": 0.01, "rate_hz": 1.0}}}
    result = navigate_rotary(Recording(imu), schedule, config, offset_m=OFFSET, initial=start)
    assert result.innovations.counts()["zero_velocity"]["accepted"] > 100
    error = result.parameter("b_a")[-1] - BIAS["b_a"]
    assert np.all(np.abs(error) < 4.0 * result.sigma("b_a")[-1])
    assert result.sigma("b_a")[-1].max() < 0.005  # rotation about a tilted axis shows all three
    tilt = result.trajectory.rpy_nb[-1, :2] - (0.0, 30.0 * DEG)
    assert np.abs(tilt).max() < 0.1 * DEG


# --------------------------------------------------------------------------------------------------- errors


def test_a_platform_that_turns_the_other_way_is_refused():
    turned = replace(TURN, axes=-TURN.axes)
    with pytest.raises(InputError, match="sign is turned"):
        navigate_rotary(recording(), turned, CONFIG, initial=true_start())
    readings = encoder()
    askew = replace(readings, axes=np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match="check its axis"):
        navigate_rotary(recording(), askew, CONFIG, initial=true_start())
    degrees = replace(readings, angle=readings.angle / DEG)
    with pytest.raises(InputError, match="unit of its angles"):
        navigate_rotary(recording(), degrees, CONFIG, initial=true_start())
    wrapped = replace(readings, angle=np.mod(readings.angle, 2.0 * np.pi), between="linear")
    with pytest.raises(InputError, match=r"numpy\.unwrap"):
        navigate_rotary(recording(), wrapped, CONFIG, initial=true_start())


def test_an_encoder_that_covers_less():
    readings = encoder()
    part = EncoderReadings(readings.t[100:5000], readings.angle[100:5000], readings.axes, between="cubic")
    result = navigate_rotary(recording(), part, CONFIG)
    assert any("IMU log cut" in note for note in result.notes)
    assert result.trajectory.t[-1] <= readings.t[4999]
    with pytest.raises(InputError, match="platform_zero_s"):
        navigate_rotary(recording(), part, CONFIG, platform_zero_s=1e6)


@pytest.mark.parametrize(
    ("section", "text"),
    [
        ({"aiding": {"non_holonomic": {}}}, "aiding.non_holonomic"),
        ({"gnss": {"coupling": "tight"}}, "gnss.coupling"),
        ({"gnss": {"lever_sigma_m": 0.1}}, "gnss.lever_sigma_m"),
        ({"imu": CONFIG["imu"] | {"mount_rpy_deg": (0.0, 0.0, 90.0)}}, "imu.mount_rpy_deg"),
        ({"filter": {"noise": {"accel": [1.0, 1.0, 2.0]}}}, "filter.noise.accel"),
        ({"alignment": {"method": "gyrocompass"}}, "gyrocompass"),
    ],
)
def test_what_does_not_go_with_rotation_is_refused(section, text):
    with pytest.raises(ConfigError, match=text):
        navigate_rotary(recording(continuous("z", 0.3)), continuous("z", 0.3), CONFIG | section)


def test_a_measurement_tied_to_the_body_is_refused():
    heading = MeasurementSchedule.of(10, [1.0], [0.0], 0.01)
    with pytest.raises(InputError, match="heading"):
        in_imu_axes(heading, TURN)


# ------------------------------------------------------------------------------------------------- the page


@pytest.mark.campaign
def test_the_documented_program_runs(tmp_path, monkeypatch):
    page = ROOT / "docs" / "rotary-filters.md"
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(program, str(page), "exec"), {})
    assert (tmp_path / "rotary.html").stat().st_size > 10_000
