"""Simulated heading, height, odometer, GNSS faults and stream faults: what was asked for is in them, and is told."""

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.exceptions import ConfigError, InputError
from schuler.recording.io import read, write
from schuler.recording.series import ImuSeries
from schuler.simulation.gnss import GnssFault, GnssModel, draw_gnss, simulate_gnss
from schuler.simulation.imu import StreamFaults, faulty_stream
from schuler.simulation.motion import StaticMotion
from schuler.simulation.scalar_aids import HeadingModel, HeightModel, simulate_heading, simulate_height
from schuler.simulation.scenario import Scenario, prepare_mission, simulate, simulate_mission
from schuler.units import DEG

ORIGIN = np.array([0.82, 0.2, 450.0])
DRIVE = {
    "type": "manoeuvres", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "heading_deg": 170.0,
    "manoeuvres": [
        {"duration_s": 5.0},
        {"duration_s": 15.0, "speed_m_s": 15.0},
        {"duration_s": 20.0, "turn_deg": 60.0, "climb_m_s": 0.5},
        {"duration_s": 20.0, "turn_deg": -100.0},
    ],
}  # fmt: skip
SENSORS = {"gyro": {"arw_deg_rthr": 0.3, "bias_deg_hr": 50.0}, "accel": {"vrw_m_s_rthr": 0.1, "bias_mg": 3.0}}


def drive(**changes):
    return {"motion": DRIVE, "imu": {"rate_hz": 50.0, **SENSORS}, "gnss": {"rate_hz": 2.0}, **changes}


def standing(seconds: float, rpy=(0.0, 0.0, 0.0)) -> StaticMotion:
    return StaticMotion(ORIGIN, np.array(rpy), seconds)


def test_heading_is_true_heading_less_declination_with_its_errors():
    n = 4000
    model = HeadingModel(rate_hz=1.0, sigma=0.03, bias=0.05, declination=0.2)
    made = simulate_heading(standing(n, (0.02, -0.03, 3.1)), model, np.random.default_rng(1))
    assert np.all(np.abs(made.series.value) <= np.pi)
    error = frames.wrap_angle(made.series.value - 3.1 + 0.2 - 0.05)
    assert abs(error.mean()) < 5 * 0.03 / np.sqrt(n)  # statistical: 5 standard errors
    assert error.std() == pytest.approx(0.03, rel=5 / np.sqrt(2 * n))
    np.testing.assert_array_equal(made.series.sigma, 0.03)
    np.testing.assert_array_equal(made.bias, 0.05)


def test_heading_bias_is_drawn_and_drifts():
    model = HeadingModel(rate_hz=0.2, sigma=1e-9, bias_sigma=0.1, drift=0.04, drift_time=30.0)
    made = simulate_heading(standing(20_000.0), model, np.random.default_rng(2))
    np.testing.assert_allclose(made.series.value, made.bias, atol=1e-7)  # the white part
    assert made.bias.std() == pytest.approx(0.04, rel=5 / np.sqrt(2 * 20_000 / 60))  # statistical, correlated
    drawn = [simulate_heading(standing(2.0), model, np.random.default_rng(s)).bias[0] for s in range(200)]
    assert np.std(drawn) == pytest.approx(np.hypot(0.1, 0.04), rel=5 / np.sqrt(400))


def test_height_bias_walks_from_its_start():
    model = HeightModel(rate_hz=4.0, sigma=0.2, bias=30.0, bias_walk=0.05, lever_b=(0.0, 0.0, -2.0))
    made = simulate_height(standing(4000.0), model, np.random.default_rng(3))
    assert made.bias[0] == 30.0
    steps = np.diff(made.bias)
    assert steps.std() == pytest.approx(0.05 * np.sqrt(0.25), rel=5 / np.sqrt(2 * len(steps)))  # statistical
    white = made.series.value - 452.0 - made.bias
    assert abs(white.mean()) < 5 * 0.2 / np.sqrt(len(white))
    assert white.std() == pytest.approx(0.2, rel=5 / np.sqrt(2 * len(white)))


def test_outages_take_samples_away_and_leave_the_others_as_they_were():
    for make, model in ((simulate_heading, HeadingModel), (simulate_height, HeightModel)):
        whole = make(standing(50.0), model(), np.random.default_rng(4)).series
        part = make(standing(50.0), model(outages=((10.0, 20.0), (48.5, 99.0))), np.random.default_rng(4)).series
        kept = ((whole.t < 10.0) | (whole.t >= 20.0)) & (whole.t < 48.5)
        np.testing.assert_array_equal(part.t, whole.t[kept])
        np.testing.assert_array_equal(part.value, whole.value[kept])


def test_a_receiver_that_claims_a_centimetre_and_is_wrong_by_twenty_metres():
    fault = GnssFault(10.0, 15.0, position=(20.0, 0.0, 0.0), velocity=(0.0, 1.0, 0.0))
    rng = lambda: np.random.default_rng(5)  # noqa: E731
    sound = simulate_gnss(standing(30.0), GnssModel(), rng())
    wrong = simulate_gnss(
        standing(30.0),
        GnssModel(faults=(fault,), reported_position=(0.01, 0.01, 0.02), reported_velocity=(1, 1, 1)),
        rng(),
    )
    d = frames.ned_from_ecef(frames.ecef_from_llh(wrong.llh), ORIGIN) - frames.ned_from_ecef(
        frames.ecef_from_llh(sound.llh), ORIGIN
    )
    inside = (sound.t >= 10.0) & (sound.t < 15.0)
    np.testing.assert_allclose(d[inside], np.tile((20.0, 0.0, 0.0), (5, 1)), atol=1e-4)  # axes turn over 20 m
    np.testing.assert_array_equal(d[~inside], 0.0)
    np.testing.assert_allclose(wrong.v_n - sound.v_n, inside[:, None] * (0.0, 1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(wrong.cov_r_n[0], np.diag((1e-4, 1e-4, 4e-4)))
    np.testing.assert_allclose(wrong.cov_v_n[0], np.eye(3))


def test_stale_and_late_fixes():
    model = GnssModel(stale=0.3, late=0.2, late_time=0.7, latency=0.1)
    made = draw_gnss(standing(2000.0), model, np.random.default_rng(6))
    n = len(made.gnss)
    repeats = np.flatnonzero(made.stale)
    assert len(repeats) == pytest.approx(0.3 * n, abs=5 * np.sqrt(0.21 * n))  # statistical
    np.testing.assert_array_equal(made.gnss.llh[repeats], made.gnss.llh[repeats - 1])
    assert np.all(np.any(np.diff(made.gnss.llh[np.flatnonzero(~made.stale)], axis=0) != 0.0, axis=1))
    delay = np.round(made.gnss.received - made.gnss.t, 9)
    assert set(delay) == {0.1, 0.8}
    assert (delay == 0.8).mean() == pytest.approx(0.2, abs=5 * np.sqrt(0.16 / n))


def test_correlated_errors_are_told():
    model = GnssModel(sigma_position=(1e-6,) * 3, sigma_velocity=(1e-6,) * 3, drift_position=(2.0, 2.0, 4.0))
    made = draw_gnss(standing(300.0), model, np.random.default_rng(7))
    ned = frames.ned_from_ecef(frames.ecef_from_llh(made.gnss.llh), ORIGIN)
    np.testing.assert_allclose(ned, made.drift_position, atol=1e-4)  # white errors, and axes turn over metres


def log(n: int = 2000) -> ImuSeries:
    rng = np.random.default_rng(8)
    return ImuSeries(
        np.arange(n) / 100.0, rng.standard_normal((n, 3)), rng.standard_normal((n, 3)), "rate", np.arange(n) * 1.0
    )


def test_a_stream_without_faults_is_itself():
    back = faulty_stream(log(), StreamFaults(), np.random.default_rng(1)).imu
    for name in ("t", "gyro", "accel", "temperature"):
        np.testing.assert_array_equal(getattr(back, name), getattr(log(), name))


def test_gaps_repeats_and_jitter_of_a_stream():
    sound = log()
    made = faulty_stream(
        sound, StreamFaults(gaps=((3.0, 3.5),), repeats=0.1, jitter=0.002, clock_shift=0.25), np.random.default_rng(1)
    )
    assert (~made.kept).sum() == 50
    gaps = made.imu.gaps(2.5)
    assert len(gaps) == 1
    assert gaps[0, 1] == pytest.approx(0.51, abs=0.01)
    inner = np.flatnonzero(made.repeated[1:] & (np.diff(made.imu.t) < 0.1)) + 1
    np.testing.assert_array_equal(made.imu.gyro[inner], made.imu.gyro[inner - 1])
    assert len(inner) == pytest.approx(195, abs=5 * np.sqrt(195))  # statistical
    shift = made.imu.t - sound.t[made.kept] - 0.25
    assert np.abs(shift).max() <= 0.004 + 1e-12
    assert shift.std() == pytest.approx(0.002, rel=0.1)  # a little less, for the limit at two sigma
    with pytest.raises(InputError, match="leave no two"):
        faulty_stream(sound, StreamFaults(gaps=((0.0, 100.0),)), np.random.default_rng(1))


@pytest.mark.parametrize("axes", ["vehicle", "imu"])
def test_a_turned_imu_measures_the_same_in_its_own_axes(axes):
    rpy = np.array([3.0, -4.0, 25.0]) * DEG
    imu = {"rate_hz": 50.0, "ideal": True}
    plain = simulate(drive(imu=imu))
    turned = simulate_mission(
        prepare_mission(drive(imu={**imu, "mount_rpy_deg": [3.0, -4.0, 25.0], "reference_axes": axes}))
    )
    C_vs = rotation.dcm_from_rpy(rpy)
    back = turned.recording.imu.rotated(C_vs)  # what imu.mount_rpy_deg of a navigation configuration does
    np.testing.assert_allclose(back.accel, plain.imu.accel, atol=1e-14)  # rounding
    np.testing.assert_allclose(back.gyro, plain.imu.gyro, atol=1e-16)
    C = turned.recording.reference.C_nb @ (C_vs.T if axes == "imu" else np.eye(3))
    np.testing.assert_allclose(C, plain.reference.C_nb, atol=1e-14)
    np.testing.assert_allclose(turned.recording.metadata.options["truth"]["mount"], rpy[1:], rtol=1e-15)


def test_truth_stays_with_the_recording(tmp_path):
    data = drive(
        seed=3,
        imu={"rate_hz": 50.0, **SENSORS, "stream": {"clock_shift_s": 0.02}},
        gnss={"clock_shift_s": 0.05, "drift_position_m": [1.0, 1.0, 1.0]},
        odometer={"scale_error": 0.01, "scale_sigma": 0.02},
        heading={"bias_sigma_deg": 2.0},
        barometer={"bias_m": 12.0, "bias_noise_m": 0.1},
    )
    run = simulate_mission(prepare_mission(data))
    truth = run.recording.metadata.options["truth"]
    np.testing.assert_array_equal(truth["b_g"], run.errors.b_g)
    assert truth["odometer"] == run.aids.odometer_scale != 0.01
    assert truth["delay"] == pytest.approx(-0.03)
    assert truth["baro_start"] == 12.0
    assert truth["baro"] == run.aids.height_bias[-1]
    assert truth["b_heading"] == run.aids.heading_bias[-1] != 0.0
    np.testing.assert_array_equal(truth["b_r"], run.aids.gnss_drift_position[-1])
    speed = np.linalg.norm(prepare_mission(data).motion.state(run.recording.odometer.t).v_eb_e, axis=1)
    moving = speed > 10.0
    ratio = run.recording.odometer.speed[moving] / speed[moving] - 1.0
    assert ratio.mean() == pytest.approx(truth["odometer"], abs=1e-3)  # statistical: 0.05 m/s at 15 m/s, 400 samples
    back = read(write(run.recording, tmp_path / "run.parquet")[0])
    assert back.metadata.options == run.recording.metadata.options
    np.testing.assert_array_equal(back.heading.value, run.recording.heading.value)
    np.testing.assert_array_equal(back.height.value, run.recording.height.value)


def test_a_new_aid_leaves_everything_else_as_it_was():
    before = simulate(drive(seed=5, odometer={}))
    after = simulate(drive(seed=5, odometer={"scale_sigma": 0.0}, heading={}, barometer={}, satellites={}))
    np.testing.assert_array_equal(after.imu.gyro, before.imu.gyro)
    np.testing.assert_array_equal(after.gnss.llh, before.gnss.llh)
    np.testing.assert_array_equal(after.odometer.speed, before.odometer.speed)
    one = simulate(drive(seed=5, barometer={"sigma_m": 2.0}, heading={}))
    np.testing.assert_array_equal(one.heading.value, after.heading.value)
    # and what the caller's generator gives next
    for data in (drive(), drive(odometer={"scale_sigma": 0.1})):
        rng = np.random.default_rng(1)
        simulate(data, rng)
        assert rng.spawn(1)[0].bit_generator.seed_seq.spawn_key == (4,)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"heading": {"sigma": 1.0}}, "heading.sigma: unknown entry; did you mean sigma_deg"),
        ({"barometer": {"sigma_m": -1.0}}, "barometer.sigma_m: expected more than 0"),
        ({"gnss": {"stale": 1.0}}, "gnss.stale: expected less than 1"),
        ({"gnss": {"reported_position_m": [0.0, 1.0, 1.0]}}, "reported_position: expected positive values"),
        ({"imu": {"rate_hz": 50.0, "ideal": True, "stream": {"gaps_s": [[3.0, 2.0]]}}}, "a gap stops after it starts"),
        ({"satellites": {"windows": [{"start_s": 1.0, "stop_s": 2.0}]}}, "satellites.windows.0.satellites: missing"),
        ({"satellites": {"give": "observations", "clock_shift_s": 0.1}}, "shift the IMU instead"),
        ({"satellites": {"systems": "GX"}}, "expected letters among G"),
        ({"satellites": {"offsets_m": [1.0, 2.0]}}, "one for each of the 1 groups after the first, got 2"),
    ],
)
def test_faulty_sections_say_where_and_what(changes, message):
    with pytest.raises(InputError, match=message):
        simulate(drive(**changes))


def test_unknown_sections_are_refused():
    with pytest.raises(ConfigError, match="height: unknown entry"):
        Scenario.parse(drive(height={}))
