"""Free-inertial tests at rest: the emulations against independent ones, floors, laws in the rate, intervals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.montecarlo.engine import campaign
from schuler.reproduce.du.study import tables as thesis
from schuler.reproduce.du.study.floor import noise_floor
from schuler.reproduce.du.study.imus import drawn_emulation, emulation
from schuler.reproduce.du.study.kinematic import kinematic_test
from schuler.reproduce.du.study.metrics import QUANTITIES, improvement, index, mean_interval, rms_values, share_below
from schuler.reproduce.du.study.static import static_test
from schuler.reproduce.du.study.static_tables import in_band
from schuler.reproduce.du.study.trial import Trial, ideal, trial_run
from schuler.rotary.free_navigation import static_run
from schuler.rotary.schemes import fixed
from schuler.sensors import catalogue
from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR

RUNS = 100
POSITION, VELOCITY, AZIMUTH = index("horizontal_position"), index("horizontal_velocity"), index("azimuth")


@pytest.fixture(scope="module", params=thesis.IMUS)
def reduced(request):
    """All cases at a tenth of the sampling rate: white noise does not care."""
    return static_test(emulation(request.param, rate_hz=10.0), rates_deg_s=(10.0, 20.0, 50.0, 100.0), runs=RUNS, seed=3)


def test_means_are_those_of_an_independent_emulation(reduced):
    """Within 10 % of an independent emulation's means widened by three standard errors of ours and theirs (200 runs);
    statistical.
    """
    table = reduced.beside_the_check()
    assert len(table) == 7
    for strategy, rate, _, _, _, _, _, _, _, _ in table.rows:
        x = reduced.case(strategy, rate * DEG if rate else None)
        for k, printed in ((POSITION, 0), (VELOCITY, 1)):
            low, high = thesis.EMULATED[reduced.imu.name, strategy, rate][printed]
            error = np.std(x[:, k]) / np.mean(x[:, k]) * np.sqrt(1.0 / RUNS + 1.0 / 200.0)
            ours = np.mean(x[:, k])
            assert low * (0.9 - 3.0 * error) < ours < high * (1.1 + 3.0 * error), (strategy, rate, k)


@pytest.mark.slow
@pytest.mark.parametrize("name", thesis.IMUS)
def test_full_campaign_is_inside_the_band_of_an_independent_emulation(name):
    """600 runs: every mean within 10 %, and the recommended rates are the thesis's; statistical, fixed seed."""
    result = static_test(emulation(name, rate_hz=20.0), runs=600, seed=1)
    table = result.beside_the_check()
    for quantity in ("position", "velocity"):
        assert all(table.column(f"{quantity}_in_band")), table.summary()
    assert result.recommended_rate().rate / DEG == pytest.approx(thesis.RECOMMENDED_DEG_S[name])


def test_order_of_strategies(reduced):
    """II better than I better than conventional, in the mean of all rates, for both horizontal quantities."""
    for k in (POSITION, VELOCITY):
        means = [reduced.case(s)[:, k].mean() for s in ("II", "I", "conventional")]
        assert means[0] < means[1] < means[2]


def test_azimuth_of_strategy_one_grows_with_the_rate(reduced):
    """K_gz omega T / sqrt(3): 1000 ppm are 0.3 deg per deg/s; exact but for noise, 4 standard errors and 1 %."""
    for rate in reduced.rates:
        x = reduced.case("I", rate)[:, AZIMUTH]
        expected = 1e-3 * rate * 300.0 / np.sqrt(3.0)
        # noise adds in quadrature; it counts for MTi-G at the lowest rate
        noise = reduced.imu.gyro_random_walk * np.sqrt(300.0 / 2.0 + 300.0**2 / (3.0 * 60.0))
        rms = np.sqrt(np.mean(x**2))
        assert rms == pytest.approx(np.hypot(expected, noise), rel=0.01 + 4.0 * noise / expected / np.sqrt(RUNS))


def test_strategy_two_is_near_the_floor_and_above_it(reduced):
    """Mean square at 100 deg/s: the floor of white noise with a Schuler loop (5 to 8 % less), and little besides."""
    floor = noise_floor(reduced.imu.gyro_random_walk, 300.0)
    rms = np.sqrt(np.mean(reduced.case("II", 100.0 * DEG)[:, POSITION] ** 2))
    error = 4.0 * 0.55 / np.sqrt(RUNS)
    assert rms == pytest.approx(floor.horizontal_position, rel=0.12 + error)


def test_improvement_is_certain_and_stated(reduced):
    """Rotation with strategy II helps both, with 95 %; NAV440 by more than ten, MTi-G by less than three."""
    result = reduced.improvement("II")
    assert result.certain
    if reduced.imu.name == "NAV440":
        assert result.low > 10.0
    else:
        assert result.high < 3.0
    assert result.single_low < result.low < result.ratio < result.high < result.single_high
    assert "times smaller" in result.summary()


def test_recommended_rate_is_the_thesis_s(reduced):
    choice = reduced.recommended_rate()
    assert choice.rate / DEG == pytest.approx(thesis.RECOMMENDED_DEG_S[reduced.imu.name])
    assert choice.confidence > 0.5
    assert "the thesis recommends" in choice.summary()


def test_tables_and_figure(reduced):
    text = reduced.summary()
    for word in ("half widths", "strategy", "verdict", "slowest rate"):
        assert word in text
    beside = reduced.beside_the_thesis()
    assert len(beside) == 7 + 4
    azimuth = beside.row(strategy="conventional", quantity="azimuth_deg")
    assert "drift" in azimuth["why"]
    assert len(reduced.plot().axes) == 5
    histories = reduced.histories(20.0 * DEG, 7)
    for name, history in histories.items():
        rms = np.sqrt(np.mean(history.horizontal**2))  # the run is found again from its number
        rate = None if name == "conventional" else 20.0 * DEG
        assert rms == pytest.approx(reduced.case(name, rate)[7, POSITION], rel=1e-9)
    assert len(reduced.plot_run(20.0 * DEG).axes) == 6
    with pytest.raises(InputError, match="was not tested"):
        reduced.case("II", 33.0 * DEG)
    with pytest.raises(InputError, match="strategy"):
        reduced.case("III")


def test_noise_floors_have_printed_digits():
    """Printed digits: 1722 m and 18.2 m/s, 230 and 2.4 at 300 s; 706, 10.6, 0.51 and 94, 1.4, 0.07 at 210 s."""
    for arw, T, position, velocity in ((3.0, 300.0, 1722.0, 18.2), (0.4, 300.0, 230.0, 2.4), (3.0, 210.0, 706.0, 10.6),
                                       (0.4, 210.0, 94.0, 1.4)):  # fmt: skip
        result = noise_floor(arw * DEG_PER_RTHR, T, gravity=9.81)
        assert result.horizontal_position == pytest.approx(position, rel=0.003)
        assert result.horizontal_velocity == pytest.approx(velocity, abs=0.051)
    assert noise_floor(3.0 * DEG_PER_RTHR, 210.0).attitude / DEG == pytest.approx(0.51, abs=0.005)
    assert noise_floor(0.4 * DEG_PER_RTHR, 210.0).attitude / DEG == pytest.approx(0.07, abs=0.005)


def test_a_trial_without_noise_and_errors_is_exact():
    """Round-off of the mechanization: micrometres in five minutes, at any rate."""
    perfect = replace(
        emulation("NAV440", rate_hz=20.0), gyro_random_walk=0.0, accel_random_walk=0.0, gyro_bias=(0.0, 0.0, 0.0),
        accel_bias=(0.0, 0.0, 0.0), response=(0.0, 0.0, 0.0),
    )  # fmt: skip
    for rate in (0.0, 30.0 * DEG):
        for values in trial_run(Trial(imu=perfect, rate=rate), 0).values():
            assert np.abs(values).max() < 1e-4


def test_calibration_takes_fixed_gyroscope_errors_out():
    """Without noise strategy II leaves nothing of biases and responses of hundreds of deg/h: metres, not kilometres."""
    silent = replace(
        emulation("MTi-G", rate_hz=20.0), gyro_random_walk=0.0, accel_random_walk=0.0, accel_bias=(0.0, 0.0, 0.0)
    )  # fmt: skip
    result = trial_run(Trial(imu=silent, rate=10.0 * DEG), 0)
    assert result["II"][POSITION] < 3.0  # M times the Earth's rate across the axis
    assert result["I"][POSITION] > 500.0


def test_rotation_of_the_noise_leaves_its_size():
    """Noise drawn in body axes and turned: the mean square of MTi-G's rotary runs is that of noise drawn in the IMU's.

    Two samples of 150 runs, 4 standard errors (relative scatter of a squared error about 1.2).
    """
    imu = replace(emulation("MTi-G", rate_hz=5.0), accel_bias=(0.0, 0.0, 0.0), response=(0.0, 0.0, 0.0))
    trial = Trial(imu=imu, rate=10.0 * DEG)
    ours = campaign(trial_run, trial, 150, keep=True, workers=1).column("II")[:, POSITION]
    floor = noise_floor(imu.gyro_random_walk, 300.0).horizontal_position
    residual = imu.gyro_random_walk / np.sqrt(72.0) * 9.81 / (10.0 * DEG) * 300.0  # modulated, secular: a few percent
    assert np.mean(ours**2) == pytest.approx(0.9 * floor**2 + residual**2 / 5.0, rel=0.1 + 4.0 * 1.2 / np.sqrt(150.0))


def test_runs_do_not_depend_on_each_other():
    """Same seed, same run; another strategy's data are the same recording."""
    trial = Trial(imu=emulation("NAV440", rate_hz=10.0), rate=20.0 * DEG)
    a, b = trial_run(trial, 11), trial_run(trial, 11)
    assert all(np.array_equal(a[k], b[k]) for k in a)
    assert not np.array_equal(a["II"], trial_run(trial, 12)["II"])


def test_in_run_drift_explains_the_measured_attitude():
    """NAV440 with 12 deg/h of 1/f noise (the sheet allows 20): conventional attitude errors are those measured, 0.48 to
    0.73 deg, without it a third of them; 40 runs of a quantity that scatters by half of itself: 35 %.
    """
    measured = np.array(thesis.STATIC_CONVENTIONAL["NAV440"][4:]) * DEG
    means = []
    for drift in (0.0, 12.0):
        trial = Trial(imu=emulation("NAV440", rate_hz=5.0, instability_deg_hr=drift))
        means.append(campaign(trial_run, trial, 40, keep=True, workers=1).column("conventional")[:, 4:].mean(axis=0))
    assert np.all(means[0] < 0.5 * measured)
    assert_allclose(means[1], measured, rtol=0.35)


def test_rms_of_a_known_history():
    """A constant accelerometer bias: b T^2 / (2 sqrt(5)); 3 % (Schuler loop)."""
    from schuler.sensors.errors import ImuErrors

    history = static_run(fixed(), ImuErrors(b_a=np.array([1e-2, 0.0, 0.0])), duration=120.0, rate_hz=20.0)
    rms = np.sqrt(np.mean(history.horizontal**2))
    assert rms == pytest.approx(1e-2 * 120.0**2 / (2.0 * np.sqrt(5.0)), rel=0.03)
    trial = Trial(imu=emulation("NAV440", rate_hz=10.0))
    truth = ideal(trial).vehicle
    assert_allclose(rms_values(truth, truth), 0.0, atol=1e-12)
    assert len(QUANTITIES) == len(rms_values(truth, truth))


def test_emulation_is_in_our_axes():
    """Du's biases (right, forward, up) and K_gxz, K_gyz, K_gz as forward, right, down."""
    result = emulation("NAV440")
    assert_allclose(result.accel_bias, (0.095, 0.113, -0.052))
    assert_allclose(np.array(result.gyro_bias) / DEG_PER_HR, (285.5, -228.1, 74.0))
    assert_allclose(result.response, (-1.77e-3, -1.77e-3, 1e-3))
    assert result.gyro_random_walk == pytest.approx(0.4 * DEG_PER_RTHR)
    with pytest.raises(InputError, match="imu"):
        emulation("ADIS16488")


def test_any_imu_of_the_catalogue():
    """A unit drawn from a sheet goes through the same tests; what the thesis does not have is left empty."""
    unit = replace(drawn_emulation(catalogue.spec("MTi-G-710"), seed=4), rate_hz=5.0)
    assert unit.gyro_instability == pytest.approx(10.0 * DEG_PER_HR)
    result = static_test(unit, rates_deg_s=(10.0, 30.0), runs=12)
    assert result.improvements().column("thesis") == [None] * 4
    assert result.improvement("II").certain
    assert "MTi-G-710" in result.summary()
    driven = kinematic_test(unit, rate_deg_s=10.0, runs=12)
    assert driven.table().column("thesis") == [None] * 10
    assert "claimed" not in driven.summary()
    with pytest.raises(InputError, match="imu"):
        result.beside_the_thesis()
    with pytest.raises(InputError, match="pass one"):
        kinematic_test(unit)


def test_improvement_of_known_samples():
    """A ratio of exactly two; an interval that holds the truth of normal samples; too few runs are refused."""
    x = np.linspace(1.0, 2.0, 50)
    result = improvement(2.0 * x, x)
    assert (result.ratio, result.low, result.high, result.wins) == pytest.approx((2.0, 2.0, 2.0, 1.0))
    assert result.compared((1.5, 2.5)) == "holds"
    assert result.compared((3.0, 5.0)) == "does not hold: less"
    assert result.compared((1.0, 1.5)) == "does not hold: more"
    rng = np.random.default_rng(4)
    inside = 0
    for k in range(100):
        a, b = 10.0 + rng.standard_normal(60), 5.0 + rng.standard_normal(60)
        one = improvement(a, b, resamples=400, seed=k)
        inside += one.low < 2.0 < one.high
    assert inside >= 86  # 95 % of 100, minus four sigma of a binomial
    assert improvement(x, 2.0 * x).certain is False
    with pytest.raises(InputError, match="ten runs"):
        improvement([1.0, 2.0], [1.0, 2.0])
    with pytest.raises(InputError, match="positive"):
        improvement(-x, x)


def test_shares_and_bands():
    values = np.tile(np.arange(1.0, 101.0), (4, 1))
    assert share_below(values, 50.5) == pytest.approx(0.5, abs=0.04)
    assert share_below(values, 0.0) == 0.0
    mean, low, high = mean_interval(np.arange(1.0, 101.0))
    assert mean == pytest.approx(50.5)
    assert high - mean == pytest.approx(1.96 * np.std(np.arange(100.0), ddof=1) / 10.0, rel=1e-3)
    assert low == pytest.approx(2.0 * mean - high)
    assert in_band(108.0, (100.0, 100.0))
    assert not in_band(111.0, (100.0, 100.0))


def test_impossible_trials_are_refused():
    imu = emulation("NAV440")
    with pytest.raises(InputError, match="begin later"):
        Trial(imu=imu, rate=1.0 * DEG)
    with pytest.raises(InputError, match="drive lasts"):
        Trial(imu=imu, vehicle="drive")
    with pytest.raises(InputError, match="other than zero"):
        static_test("NAV440", rates_deg_s=(0.0,), runs=10)
