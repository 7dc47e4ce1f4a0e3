"""Scenarios: what is simulated is what was described, reproducibly; the round trip through the strapdown closes."""

import numpy as np
import pytest
from places import EXAMPLES

from schuler import frames, rotation
from schuler.exceptions import ConfigError, InputError
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import StaticMotion
from schuler.simulation.scalar_aids import simulate_odometer
from schuler.simulation.scenario import Scenario, prepare_mission, simulate, simulate_mission

STATIC = {"type": "static", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "duration_s": 400.0}


def scenario(**changes):
    data = {
        "motion": dict(STATIC),
        "imu": {
            "rate_hz": 50.0,
            "gyro": {"arw_deg_rthr": 0.3, "bias_deg_hr": 50.0},
            "accel": {"vrw_m_s_rthr": 0.1, "bias_mg": 3.0},
        },
        "gnss": {"rate_hz": 2.0},
    }
    data.update(changes)
    return data


@pytest.mark.parametrize("earth_rotation", [True, False])
def test_an_ideal_imu_navigates_back_to_the_truth(earth_rotation):
    data = {
        "motion": {
            "type": "manoeuvres", "lat_deg": 47.0, "lon_deg": 8.0, "earth_rotation": earth_rotation,
            "manoeuvres": [
                {"duration_s": 5.0},
                {"duration_s": 20.0, "speed_m_s": 40.0},
                {"duration_s": 30.0, "turn_deg": 200.0, "climb_m_s": 3.0},
            ],
        },
        "imu": {"rate_hz": 100.0, "ideal": True},
    }  # fmt: skip
    recording = simulate(data)
    T = recording.reference
    start = NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0])
    path = mechanize(recording.imu.increments(), start, earth_rotation=earth_rotation)
    np.testing.assert_allclose(path.r_eb_e[-1], T.r_eb_e[-1], atol=1e-5)  # discretisation
    turn = rotation.quat_multiply(path.q_eb[-1], rotation.quat_conjugate(T.q_eb[-1]))
    assert np.linalg.norm(rotation.rotvec_from_quat(turn)) < 1e-9


def test_seeds_make_runs_repeat_and_differ():
    a, b, c = simulate(scenario(seed=5)), simulate(scenario(seed=5)), simulate(scenario(seed=6))
    np.testing.assert_array_equal(a.imu.gyro, b.imu.gyro)
    np.testing.assert_array_equal(a.gnss.llh, b.gnss.llh)
    assert not np.array_equal(a.imu.gyro, c.imu.gyro)


def test_parts_draw_from_generators_of_their_own():
    """Another GNSS rate leaves the IMU as it was."""
    a, b = simulate(scenario(seed=5)), simulate(scenario(seed=5, gnss={"rate_hz": 5.0}))
    np.testing.assert_array_equal(a.imu.gyro, b.imu.gyro)
    c = simulate(scenario(seed=5, gnss=None))
    np.testing.assert_array_equal(a.imu.accel, c.imu.accel)
    assert c.gnss is None


def test_applied_errors_are_the_reported_ones():
    """Mean of the static log minus truth is the drawn bias, within the noise."""
    run = simulate_mission(prepare_mission(scenario(seed=3)))
    mission = prepare_mission(scenario(seed=3))
    n, dt = len(run.recording.imu), 0.02
    mean = (run.recording.imu.gyro - mission.ideal.gyro).mean(axis=0) / dt
    sigma = 0.3 / 60 * np.pi / 180 / np.sqrt(n * dt)
    np.testing.assert_allclose(mean, run.errors.b_g, atol=5 * sigma)  # statistical: 5 standard errors
    np.testing.assert_allclose(run.report.b_g, np.tile(run.errors.b_g, (n, 1)))


def test_white_gnss_errors_have_their_sigmas():
    motion = StaticMotion(np.array([0.8, 0.1, 300.0]), np.zeros(3), 4000.0)
    model = GnssModel(
        rate_hz=1.0, sigma_position=(1.0, 2.0, 3.0), sigma_velocity=(0.1, 0.2, 0.3), lever_arm_b=(1.0, 2.0, 3.0)
    )
    g = simulate_gnss(motion, model, np.random.default_rng(1))
    ned = frames.ned_from_ecef(frames.ecef_from_llh(g.llh), motion.llh)
    np.testing.assert_allclose(ned.mean(axis=0), [1.0, 2.0, 3.0], atol=5 * 3.0 / np.sqrt(4000))
    np.testing.assert_allclose(ned.std(axis=0), [1.0, 2.0, 3.0], rtol=5 / np.sqrt(8000))
    np.testing.assert_allclose(g.v_n.std(axis=0), [0.1, 0.2, 0.3], rtol=5 / np.sqrt(8000))
    np.testing.assert_allclose(np.sqrt(np.diag(g.cov_r_n[0])), [1.0, 2.0, 3.0])


def test_drifting_gnss_errors_have_their_correlation():
    motion = StaticMotion(np.array([0.8, 0.1, 300.0]), np.zeros(3), 40_000.0)
    model = GnssModel(rate_hz=0.5, sigma_position=(1e-3,) * 3, drift_position=(2.0, 2.0, 2.0), drift_time=50.0)
    g = simulate_gnss(motion, model, np.random.default_rng(2))
    x = frames.ned_from_ecef(frames.ecef_from_llh(g.llh), motion.llh)[:, 0]
    n_eff = 40_000.0 / 100.0
    assert x.std() == pytest.approx(2.0, rel=5 / np.sqrt(2 * n_eff))  # statistical, correlated over 2 tau
    lag = np.mean(x[25:] * x[:-25]) / np.var(x)
    assert lag == pytest.approx(np.exp(-1.0), abs=5 / np.sqrt(n_eff))


def test_outages_latency_and_wrong_clocks():
    motion = StaticMotion(np.array([0.8, 0.1, 300.0]), np.zeros(3), 100.0)
    g = simulate_gnss(
        motion, GnssModel(first_s=0.3, outages=((20.0, 30.0),), latency=0.2, clock_shift=0.05), np.random.default_rng(0)
    )
    assert g.t[0] == pytest.approx(0.35)
    assert not np.any((g.t - 0.05 >= 20.0) & (g.t - 0.05 < 30.0))
    np.testing.assert_allclose(g.received - (g.t - 0.05), 0.2)
    with pytest.raises(InputError, match="leave no GNSS fix"):
        simulate_gnss(motion, GnssModel(outages=((0.0, 200.0),)), np.random.default_rng(0))


def test_odometer_reads_forward_speed():
    run = prepare_mission(EXAMPLES / "town.toml")
    o = simulate_odometer(run.motion, 5.0, np.random.default_rng(0), sigma=0.01, scale_error=0.02)
    speed = np.linalg.norm(run.motion.state(o.t).v_eb_e, axis=1)
    np.testing.assert_allclose(o.speed, 1.02 * speed, atol=0.06)  # statistical: 5 sigma of 1000 samples


def test_example_scenarios_run():
    recording = simulate(EXAMPLES / "town.toml")
    assert recording.odometer is not None
    assert len(recording.reference) == len(recording.imu) + 1
    assert recording.metadata.options["scenario"]["name"] == "town"


def test_rate_output_samples_at_the_stamps():
    mission = prepare_mission(scenario(imu={"rate_hz": 50.0, "kind": "rate", "ideal": True}))
    assert mission.ideal.kind == "rate"
    recording = simulate_mission(mission).recording
    assert recording.imu.kind == "rate"
    assert len(recording.imu) == 400 * 50 + 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imu": {"rate_hz": -1.0, "ideal": True}}, "imu.rate_hz: expected more than 0, got -1.0"),
        ({"imu": {"rate_hz": 10.0}}, "imu: give one of catalogue"),
        (
            {"imu": {"rate_hz": 10.0, "ideal": True, "catalog": "x"}},
            "imu.catalog: unknown entry; did you mean catalogue",
        ),
        ({"motion": {**STATIC, "type": "dance"}}, "motion.type: expected 'static'"),
        ({"motion": {"type": "static", "lat_deg": 47.0, "lon_deg": 8.0}}, "static motion needs duration_s"),
        ({"gnss": {"sigma_position_m": [1.0, 1.0]}}, "gnss.sigma_position_m"),
        (
            {"motion": {**STATIC, "type": "waypoints", "waypoints": [{"north_m": 1.0, "speed_m_s": 1.0}]}},
            "give north_m and east_m, or lat_deg",
        ),
        ({"motion": {**STATIC, "laps": 3}}, 'laps is of type = "manoeuvres"; a motion of type'),
        ({"extra": 1}, "extra: unknown entry; known are name, seed"),
        ({"imu": {"catalogue": "VN-20"}}, "VN-200"),
    ],
)
def test_faulty_scenarios_say_where_and_what(changes, message):
    with pytest.raises(InputError, match=message.replace("(", r"\(").replace("[", r"\[")):
        prepare_mission(scenario(**changes))


def test_all_faults_are_reported_at_once():
    with pytest.raises(ConfigError) as caught:
        Scenario.parse({"motion": {"type": "static"}, "imu": {"rate": 1}})
    text = str(caught.value)
    assert "motion.lat_deg: missing" in text
    assert "motion.lon_deg: missing" in text
    assert "imu.rate: unknown entry" in text


def test_missing_and_broken_files(tmp_path):
    with pytest.raises(ConfigError, match="no such scenario file"):
        Scenario.load(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("motion = [")
    with pytest.raises(ConfigError, match="not a TOML file"):
        Scenario.load(tmp_path / "bad.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"imu": {"catalogue": "MTi-G-710", "rate_hz": 1e300}}, "more than 1e[+]10 samples: lower the rate"),
        ({"gnss": {"rate_hz": 1e300}}, "more than 1e[+]10 measurements at 1e[+]300 Hz"),
    ],
)
def test_rates_of_no_sensor_are_refused(change, message):
    motion = {"type": "manoeuvres", "lat_deg": 48.0, "lon_deg": 11.0, "manoeuvres": [{"duration_s": 10.0}]}
    data = {"motion": motion, "imu": {"catalogue": "MTi-G-710", "rate_hz": 50.0}, **change}
    with pytest.raises(InputError, match=message):
        simulate(Scenario.parse(data))


def test_too_short_a_motion_for_the_rate():
    with pytest.raises(InputError, match="holds no two samples"):
        ideal_imu(StaticMotion(np.zeros(3), np.zeros(3), 0.1), 10.0)
