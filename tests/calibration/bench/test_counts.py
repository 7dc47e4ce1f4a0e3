"""Logs in counts: factors and middle found, results that compensate counts as they compensate SI."""

from dataclasses import replace

import numpy as np
import pytest

from schuler import earth
from schuler.calibration.bench.counts import SCALE_SIGMA, CountFactors, count_factors, factors_of
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.result.parameters import LINEAR, vector
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.units import DEG, G0

LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
G = float(np.linalg.norm(earth.gravity_ned(LLH[0], LLH[2])))
#: An MPU-6000's finest ranges: 16384 counts a g, 131 a degree per second.
LSB = (G0 / 16384.0, DEG / 131.0)
HALF = 32768.0  # of 16 bits


def turned(name: str, seed: int) -> tuple[ImuSeries, ImuErrors]:
    """150 s of turns and rests at 50 Hz, SI."""
    rng = np.random.default_rng(seed)
    errors = ImuErrors.draw(catalogue.spec(name), rng, gauge="upper")
    motion = RoutineMotion(thesis_routine(dwell_s=5.0, repeats=1), LLH)
    return simulate_imu(ideal_imu(motion, 50.0, kind="rate"), errors, rng).imu, errors


def in_counts(imu: ImuSeries, middle=0.0) -> ImuSeries:
    return replace(imu, accel=np.round(imu.accel / LSB[0] + middle), gyro=np.round(imu.gyro / LSB[1] + middle))


@pytest.fixture(scope="module")
def automotive():
    return turned("yaman-automotive", 3)


def result_of(errors: ImuErrors, left_out=()) -> CalibrationResult:
    names = tuple(n for n in LINEAR if n[:3] not in left_out)
    rng = np.random.default_rng(0)
    A = rng.standard_normal((len(names), len(names)))
    return CalibrationResult(
        "field", names, vector(errors, names), 1e-8 * (A @ A.T), "upper", history=np.zeros((2, len(names)))
    )


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_counts_are_compensated_as_si_is(automotive, kind):
    """Rounding: counts of 1e5 times factors, in double precision."""
    imu, errors = automotive
    middle = np.array([[HALF, -HALF, -HALF], [2048.0, 2048.0, 2048.0]]) if kind == "rate" else np.zeros((2, 3))
    factors = CountFactors((0.0024, 0.0002), middle)
    counts = ImuSeries(imu.t, imu.gyro / 0.0002 + middle[1], imu.accel / 0.0024 + middle[0], kind)
    result = result_of(errors)
    there = factors.in_counts(result)
    assert there.nominal == (0.0024, 0.0002)
    np.testing.assert_allclose(there.apply(counts).accel, result.apply(factors.to_si(counts)).accel, atol=1e-9)
    np.testing.assert_allclose(there.apply(counts).gyro, result.apply(factors.to_si(counts)).gyro, atol=1e-9)
    np.testing.assert_array_equal(there.covariance, result.covariance)
    back = factors.in_si(there)
    np.testing.assert_allclose(back.values, result.values, atol=1e-12)
    assert (back.nominal, back.extra, back.fixed) == ((1.0, 1.0), {}, {})
    again = factors_of(there)
    assert again.nominal == factors.nominal
    np.testing.assert_array_equal(again.middle, middle)


def test_iterations_and_biases_that_were_left_out_move_too(automotive):
    _, errors = automotive
    middle = np.array([[HALF, -HALF, HALF], [0.0, 0.0, 0.0]])
    factors = CountFactors((0.002, 1.0), middle)
    there = factors.in_counts(result_of(errors))
    np.testing.assert_allclose(there.history[:, there.names.index("b_a_y")], -HALF * 0.002)
    assert not there.history[:, there.names.index("b_g_y")].any()
    without = factors.in_counts(result_of(errors, left_out=("b_a",)))
    assert without.fixed == {"b_a_x": HALF * 0.002, "b_a_y": -HALF * 0.002, "b_a_z": HALF * 0.002}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", ["yaman-automotive", "yaman-tactical", "MPU-6000"])
@pytest.mark.parametrize("middle", [0.0, HALF])
def test_factors_are_found(name, middle):
    """The mean factor of three axes, to 1e-3: four digits, Earth rate, g-sensitivity of 0.1 deg/s/g and 50 deg/s."""
    imu, errors = turned(name, 3)
    outcome = count_factors(in_counts(imu, middle), gravity=G)
    for s, lsb, M in zip(outcome.nominal, LSB, (errors.M_a, errors.M_g), strict=True):
        assert s == pytest.approx(lsb / np.cbrt(np.linalg.det(np.eye(3) + M)), rel=1e-3)
    np.testing.assert_array_equal(outcome.middle, np.full((2, 3), middle))
    # SI again, but for the factor itself
    np.testing.assert_allclose(outcome.to_si(in_counts(imu, middle)).accel, imu.accel, rtol=0.05, atol=0.01)


def test_axes_that_were_turned_have_the_middle_below_zero(automotive):
    """Read with axes FLU: y and z of a converter without sign come out negative."""
    turn = np.array([1.0, -1.0, -1.0])
    counts = in_counts(automotive[0], HALF)
    sensors = replace(counts, accel=counts.accel * turn, gyro=counts.gyro * turn)
    outcome = count_factors(sensors, gravity=G)
    np.testing.assert_array_equal(outcome.middle, HALF * np.array([turn, turn]))


def test_one_triad_in_counts(automotive):
    imu, _ = automotive
    mixed = replace(imu, accel=np.round(imu.accel / LSB[0]))
    outcome = count_factors(mixed, ["accel"], gravity=G)
    assert outcome.nominal[0] == pytest.approx(LSB[0], rel=0.02)
    assert outcome.nominal[1] == 1.0
    with pytest.raises(InputError, match=r"gyro: expected SI, but gravity and the turns fit with a factor of 0\.09"):
        count_factors(replace(mixed, gyro=11.0 * imu.gyro), ["accel"], gravity=G)


def test_counts_that_could_be_radians(automotive):
    """A turn of 45 degrees is 45 counts times seconds: taken for radians, seven full turns and 58 degrees."""
    imu, errors = automotive
    counts = replace(in_counts(imu), gyro=imu.gyro / DEG)
    outcome = count_factors(counts, gravity=G)
    assert outcome.nominal[1] == pytest.approx(DEG / np.cbrt(np.linalg.det(np.eye(3) + errors.M_g)), rel=1e-3)


def test_readings_of_both_signs_have_no_middle(automotive):
    """A bias beyond any reading's size could be a middle; one reading below zero says it is none."""
    imu, _ = automotive
    counts = in_counts(imu)
    far = replace(counts, gyro=counts.gyro + 8192.0)
    assert far.gyro.min() > 0.0
    np.testing.assert_array_equal(count_factors(far, gravity=G).middle[1], np.full(3, 8192.0))
    far = replace(far, gyro=np.where(np.arange(len(far))[:, None] == 700, -1.0, far.gyro))
    assert not count_factors(far, gravity=G).middle.any()
    # and a bias near no power of two is a bias
    assert not count_factors(replace(counts, gyro=counts.gyro + 12000.0), gravity=G).middle.any()


def test_given_rests_are_used(automotive):
    imu, _ = automotive
    spans = [(a + 0.5, b - 0.5) for a, b in thesis_routine(dwell_s=5.0, repeats=1).rests if b - a > 3.0]
    outcome = count_factors(in_counts(imu), gravity=G, intervals=spans)
    assert outcome.nominal == pytest.approx(count_factors(in_counts(imu), gravity=G).nominal, rel=2e-3)


def test_a_calibration_by_another_method_tells_them_too(automotive):
    result = calibrate_freepose(in_counts(automotive[0], HALF), gravity=G)
    outcome = factors_of(result)
    assert outcome.nominal == result.nominal
    np.testing.assert_array_equal(outcome.middle, np.full((2, 3), HALF))
    assert np.abs(outcome.in_si(result).errors.b_a).max() < 2.0


def test_scale_factors_are_relative_to_what_was_found():
    spec = catalogue.spec("yaman-tactical")
    wide = CountFactors((0.0024, 1.0)).widened(spec)
    assert wide.accel.scale_factor == pytest.approx(np.hypot(spec.accel.scale_factor, SCALE_SIGMA))
    assert wide.gyro == spec.gyro
    assert replace(wide.accel, scale_factor=spec.accel.scale_factor) == spec.accel


def test_what_cannot_be_told(automotive):
    imu, errors = automotive
    with pytest.raises(InputError, match=r"state what a count is: .*poses at rest found"):
        count_factors(in_counts(imu.between(0.0, 20.0)))
    with pytest.raises(InputError, match="nominal: expected two positive factors"):
        CountFactors((0.0, 1.0))
    with pytest.raises(InputError, match="middle"):
        CountFactors((1.0, 1.0), np.zeros(2))
    result, factors = result_of(errors), CountFactors((0.0024, 0.0002))
    with pytest.raises(InputError, match="expected one of a log in SI"):
        factors.in_counts(factors.in_counts(result))
    with pytest.raises(InputError, match="expected one with factors"):
        factors.in_si(result)
