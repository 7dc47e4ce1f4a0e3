"""Calibration by rotation: exact recovery, Du's Table 4.5, Monte Carlo against the predicted accuracy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler import rotation
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments
from schuler.reproduce.du.study.accuracy import predicted_accuracy
from schuler.reproduce.du.study.trial import whole_turns
from schuler.rotary import schemes
from schuler.rotary.calibration import allan_random_walk, calibrate_rotation, estimate
from schuler.rotary.encoder import EncoderReadings
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.simulation.motion import StaticMotion
from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR, PPM

LLH = np.array([51.0 * DEG, -114.0 * DEG, 1000.0])
BIAS = np.array([300.0, -200.0, 100.0]) * DEG_PER_HR
M_G = np.array([[1e-3, 2e-4, 2.5e-3], [-3e-4, -8e-4, -1.5e-3], [4e-4, 5e-4, 2e-3]])


def recording(schedule, errors, duration, *, rate_hz=20.0, rpy=(0.0, 0.0, 0.0), rng=None):
    motion = RotatingMotion(StaticMotion(LLH, np.array(rpy), duration), schedule)
    ideal = ideal_rotating_imu(motion, rate_hz)
    dtheta, dv, _ = errors.apply_increments(
        ideal.gyro, ideal.accel, 1.0 / rate_hz, rng or np.random.default_rng(0)
    )  # fmt: skip
    return Increments(ideal.t[1:], np.full(len(dtheta), 1.0 / rate_hz), dtheta, dv)


def body(rpy=(0.0, 0.0, 0.0)):
    return NavState.from_geodetic(0.0, LLH, rpy_nb=rpy)


@pytest.mark.parametrize("axis", ["z", "-z", "x", "y"])
@pytest.mark.parametrize("rate", [10.0, -25.0])
def test_any_axis_returns_the_errors_exactly(axis, rate):
    """Without noise, biases and the column of M; tolerance: M times the Earth's rate across the axis, 0.05 deg/h."""
    schedule = schemes.continuous(axis, rate * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 60.0 + whole_turns(rate * DEG, 60.0), rpy=(0.1, -0.2, 0.7))
    result = calibrate_rotation(log, schedule, body((0.1, -0.2, 0.7)), random_walk=1e-5)
    column = "xyz".index(axis[-1])
    assert_allclose(result.axes, np.eye(3)[[column]])
    assert_allclose(result.bias, BIAS, atol=0.05 * DEG_PER_HR)
    assert_allclose(result.response[0], M_G[:, column], atol=0.1 * DEG_PER_HR / (10.0 * DEG))
    assert result.names[3:] == tuple(f"M_g_{i}{axis[-1]}" for i in "xyz")


def test_an_oblique_axis_gives_the_response_along_it():
    """About a direction between the axes the response is M times that direction; tolerance as above."""
    u = np.array([0.0, 0.6, -0.8])
    schedule = schemes.continuous(u, 20.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 60.0 + whole_turns(20.0 * DEG, 60.0))
    result = calibrate_rotation(log, schedule, body(), random_walk=1e-5)
    assert abs(result.axes[0] @ u) == pytest.approx(1.0)
    assert_allclose(result.M @ u, M_G @ u, atol=0.1 * DEG_PER_HR / (10.0 * DEG))
    assert result.names[3] == "response_1_x"
    # and when the axis is named
    named = calibrate_rotation(log, schedule, body(), axes=u[None], random_walk=1e-5)
    assert_allclose(named.response[0], M_G @ u, atol=0.1 * DEG_PER_HR / (10.0 * DEG))


def test_run_up_tilt_and_mounting():
    """The run-up is left out of the default spans; a clamped outer gimbal and an askew mounting change nothing."""
    plain = schemes.continuous("z", 10.0 * DEG, acceleration=5.0 * DEG, start=60.0)
    C_mount = rotation.dcm_from_rotvec([0.3, -0.2, 0.1])
    for schedule in (plain, schemes.tilted(plain, "x", 0.5), plain.mounted(C_mount)):
        log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 60.0 + 2.0 + 72.0)
        result = calibrate_rotation(log, schedule, body(), random_walk=1e-5)
        u = schedule.omega_bs_s([100.0])[0] / (10.0 * DEG)
        assert_allclose(result.M @ u, M_G @ u, atol=0.1 * DEG_PER_HR / (10.0 * DEG))
        assert_allclose(result.bias, BIAS, atol=0.1 * DEG_PER_HR)
        turning = [s for s in result.stretches if np.any(s.platform)]
        assert len(turning) == 2
        assert turning[0].start == pytest.approx(62.0)


def test_three_axes_in_turn_give_all_of_M():
    """Stretches of three recordings together: all nine elements, and compensation then leaves nothing."""
    stretches, logs = [], []
    for axis in "xyz":
        schedule = schemes.continuous(axis, 10.0 * DEG, start=36.0)
        log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 72.0)
        stretches += calibrate_rotation(log, schedule, body(), random_walk=1e-5).stretches
        logs.append((schedule, log))
    result = estimate(stretches, np.full(3, 1e-5))
    assert_allclose(result.M, M_G, atol=1e-9)  # now the Earth's rate has its columns too: rounding and ripple
    assert_allclose(result.bias, BIAS, atol=1e-5 * DEG_PER_HR)
    schedule, log = logs[0]
    true = recording(schedule, ImuErrors(), 72.0)
    clean = result.compensated(log)
    assert_allclose(clean.dtheta_ib_b, true.dtheta_ib_b, atol=1e-10)


def test_the_earths_rate_matters():
    """Left in, its part along the axis ends in the bias, 15.04 sin(lat) deg/h; the result says so."""
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS), 60.0 + 72.0)
    left_in = calibrate_rotation(log, schedule, body(), random_walk=1e-5, earth_rotation=False)
    assert (left_in.bias - BIAS)[2] / DEG_PER_HR == pytest.approx(-15.041 * np.sin(LLH[0]), abs=0.01)
    assert "Earth" in left_in.summary()


def test_whole_revolutions_average_what_depends_on_the_angle():
    """A wrong heading of 5 degrees: over whole turns only its part along the axis, none here, is left."""
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS), 60.0 + 60.0)
    wrong = body((0.0, 0.0, 5.0 * DEG))
    whole = calibrate_rotation(log, schedule, wrong, random_walk=1e-5)
    cut = calibrate_rotation(log, schedule, wrong, random_walk=1e-5, whole_revolutions=False)
    mean = [f.bias + f.response[0] * 10.0 * DEG - BIAS for f in (whole, cut)]
    assert np.abs(mean[0]).max() < 1e-3 * DEG_PER_HR
    assert np.abs(mean[1]).max() > 0.1 * DEG_PER_HR
    assert any("no whole revolution" in note for note in whole.notes)


def test_encoder_readings_do_as_well():
    """Angles of an encoder of 20 arcsec resolution: the rate over a revolution to a count in 36 s."""
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 60.0 + 72.0)
    t = np.arange(0.0, 132.0 + 1e-9, 0.02)
    count = 20.0 / 3600.0 * DEG
    readings = EncoderReadings(t, np.round(schedule.angles(t) / count) * count, schedule.axes)
    result = calibrate_rotation(log, readings, body(), spans=[(0.0, 60.0), (60.0, 132.0)], random_walk=1e-5)
    assert_allclose(result.response[0], M_G[:, 2], atol=count / 36.0 / (10.0 * DEG) + 1e-6)
    with pytest.raises(InputError, match="spans"):
        calibrate_rotation(log, readings, body())


def test_table_4_5_as_printed():
    """Du's predicted accuracy, printed digits: ppm by rate with the two IMUs' random walks; 14.3, not 14.2, at 60."""
    printed = {
        3.0: (645.5, 322.7, 215.2, 161.4, 129.1, 107.6, 92.2, 80.7, 71.7, 64.5),
        0.4: (86.1, 43.0, 28.7, 21.5, 17.2, 14.3, 12.3, 10.8, 9.6, 8.6),
    }
    for arw, row in printed.items():
        ours = [predicted_accuracy(arw * DEG_PER_RTHR, w * DEG).response_source / PPM for w in range(10, 101, 10)]
        assert_allclose(ours, row, atol=0.0501)
    assert predicted_accuracy(3.0 * DEG_PER_RTHR, DEG).bias / DEG_PER_HR == pytest.approx(23.2, abs=0.05)
    assert predicted_accuracy(0.4 * DEG_PER_RTHR, DEG).bias / DEG_PER_HR == pytest.approx(3.1, abs=0.05)
    one = predicted_accuracy(1e-4, 10.0 * DEG)
    assert one.response == pytest.approx(np.sqrt(2.0) * one.response_source)


def test_monte_carlo_meets_the_prediction():
    """400 logs: unbiased (4 standard errors) and sigma within 4 of its own, 1 / sqrt(2 * 400 * 3); and at the rate."""
    runs, rate, arw = 400, 20.0 * DEG, 0.4 * DEG_PER_RTHR
    schedule = schemes.continuous("z", rate, start=60.0)
    motion = RotatingMotion(StaticMotion(LLH, np.zeros(3), 132.0), schedule)
    ideal = ideal_rotating_imu(motion, 5.0)
    clean = Increments(ideal.t[1:], np.full(len(ideal.gyro), 0.2), ideal.gyro, ideal.accel)
    template = calibrate_rotation(clean, schedule, body(), spans=[(0, 60), (60, 132)], random_walk=arw)
    errors = ImuErrors(b_g=BIAS, M_g=M_G, gyro_noise=NoiseModel((White(arw),)))
    d, k, applied, chi = [], [], [], []
    for run in range(runs):
        rng = np.random.default_rng([8, run])
        dtheta, _, _ = errors.apply_increments(clean.dtheta_ib_b, clean.dv_ib_b, 0.2, rng)
        sums = np.concatenate((np.zeros((1, 3)), np.cumsum(dtheta, axis=0)))
        stretches = []
        for s in template.stretches:
            a, b = round(s.start * 5.0), round(s.stop * 5.0)
            stretches.append(s._replace(reading=(sums[b] - sums[a]) / s.duration))
        result = estimate(stretches, template.random_walk)
        d.append((result.bias - BIAS) / result.sigma_bias)
        k.append((result.response[0] - M_G[:, 2]) / result.sigma_response[0])
        left = result.bias + result.response[0] * rate - BIAS - M_G[:, 2] * rate
        applied.append(left / result.sigma_at(np.array([0.0, 0.0, rate])))
        chi.append(result.chi_square / result.degrees)
    predicted = predicted_accuracy(arw, rate, turning_s=72.0)
    # the Earth's rate along the axis is a part in 1e4 of the platform's
    assert_allclose(template.sigma_bias, predicted.bias, rtol=1e-3)
    assert_allclose(template.sigma_response[0], predicted.response, rtol=1e-3)
    assert_allclose(template.sigma_at(np.array([0.0, 0.0, rate])), predicted.at_rate, rtol=1e-3)
    for z in map(np.array, (d, k, applied)):
        assert np.abs(z.mean(axis=0)).max() < 4.0 / np.sqrt(runs)
        assert abs(np.sqrt(np.mean(z**2)) - 1.0) < 4.0 / np.sqrt(2.0 * 3.0 * runs)
    assert abs(np.mean(chi) - 1.0) < 4.0 * np.sqrt(2.0 / (runs * template.degrees))


def test_noise_is_found_from_the_log():
    """Differences of samples give the random walk within 4 of its standard errors, turning or not."""
    arw = 3.0 * DEG_PER_RTHR
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    errors = ImuErrors(b_g=BIAS, M_g=M_G, gyro_noise=NoiseModel((White(arw),)))
    log = recording(schedule, errors, 132.0, rate_hz=50.0)
    result = calibrate_rotation(log, schedule, body())
    assert_allclose(result.random_walk, arw, rtol=4.0 * np.sqrt(0.75 / len(log)))
    assert result.scatter < 1.7


def test_noise_by_allan_deviation():
    """At one second of a ten minutes' rest: sigma / N = 1 within 4 / sqrt(2 edf), edf about 600 (overlapping)."""
    arw = 0.4 * DEG_PER_RTHR
    errors = ImuErrors(b_g=BIAS, gyro_noise=NoiseModel((White(arw),)))
    log = recording(schemes.fixed(), errors, 600.0)
    assert_allclose(allan_random_walk(log, (0.0, 600.0)), arw, rtol=4.0 / np.sqrt(2.0 * 600.0))
    with pytest.raises(InputError, match="rest longer"):
        allan_random_walk(log, (0.0, 10.0))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"spans": [(0.0, 60.0)]}, "never turns"),
        ({"spans": [(60.0, 132.0)]}, "separate"),
        ({"spans": [(50.0, 80.0)]}, "not constant"),
        ({"spans": [(0.0, 60.0), (60.0, 80.0)]}, "revolutions"),
        ({"spans": [(0.0, 600.0)]}, "within the log"),
        ({"spans": []}, "at least one"),
        ({"random_walk": 0.0}, "positive"),
        ({"axes": [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]}, "perpendicular"),
    ],
)
def test_errors_say_what_to_do(change, match):
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS), 132.0, rate_hz=5.0)
    with pytest.raises(InputError, match=match):
        calibrate_rotation(log, schedule, body(), **({"random_walk": 1e-5} | change))


def test_summary_and_figure_tell_values_with_their_sigma():
    """Names, units, scatter; three panels."""
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    errors = ImuErrors(b_g=BIAS, M_g=M_G, gyro_noise=NoiseModel((White(0.4 * DEG_PER_RTHR),)))
    result = calibrate_rotation(recording(schedule, errors, 140.0), schedule, body())
    text = result.summary()
    for word in ("b_g_x: ", "M_g_xz: ", "ppm", "deg/h", "72 s turning at 10 deg/s", "white noise explains"):
        assert word in text
    assert len(result.plot().axes) == 3


def test_both_senses_of_rotation_need_no_rest():
    """Plus and minus the rate separate biases from responses as well as a rest does."""
    schedule = schemes.reciprocating("z", 10.0 * DEG, turn=4.0 * np.pi)
    log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 144.0)
    result = calibrate_rotation(log, schedule, body(), random_walk=1e-5)
    assert_allclose(result.bias, BIAS, atol=0.05 * DEG_PER_HR)
    assert_allclose(result.response[0], M_G[:, 2], atol=1e-6)


def test_strategies():
    """I takes the bias off, II also the response, none leaves the log as it is; unknown ones are refused."""
    schedule = schemes.continuous("z", 10.0 * DEG, start=60.0)
    log = recording(schedule, ImuErrors(b_g=BIAS, M_g=M_G), 132.0)
    true = recording(schedule, ImuErrors(), 132.0)
    result = calibrate_rotation(log, schedule, body(), random_walk=1e-5)

    def left(strategy):
        part = result.compensated(log, strategy).between(60.0, 132.0)
        return (part.dtheta_ib_b - true.between(60.0, 132.0).dtheta_ib_b).sum(axis=0) / 72.0

    assert_allclose(left("none"), BIAS + M_G[:, 2] * 10.0 * DEG, atol=0.2 * DEG_PER_HR)
    assert_allclose(left("I"), M_G[:, 2] * 10.0 * DEG, atol=0.2 * DEG_PER_HR)
    assert_allclose(left("II"), 0.0, atol=0.05 * DEG_PER_HR)
    assert result.compensated(log, "none") is log
    with pytest.raises(InputError, match="strategy"):
        result.compensated(log, "III")
