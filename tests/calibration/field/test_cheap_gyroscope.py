"""Biases of tens of degrees per second: linearisation, and what is said where the specification does not allow them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.calibration.field.calibration import calibrate_field
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.result.parameters import vector
from schuler.exceptions import InputError
from schuler.sensors import catalogue
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.units import DEG

LLH = np.array([39.92 * DEG, 33.2 * DEG, 1000.0])
CHEAP = catalogue.spec("MPU-6000")


@pytest.fixture(scope="module")
def ideal():
    return ideal_imu(RoutineMotion(thesis_routine(dwell_s=5.0, repeats=1), LLH), 50.0)


def calibrated(ideal, spec=CHEAP, seed=0, unit=CHEAP, **more):
    """Calibration of one drawn unit, and its normalised errors."""
    rng = np.random.default_rng(seed)
    errors = ImuErrors.draw(unit, rng, gauge="upper")
    imu = simulate_imu(ideal, errors, rng).imu
    heading = (float(rng.standard_normal()) * DEG, DEG)
    solution = calibrate_field(imu, spec, latitude=LLH[0], height=LLH[2], heading=heading, **more)
    return solution, solution.calibration.values - vector(errors, solution.calibration.names)


@pytest.mark.campaign
def test_errors_are_as_large_as_stated(ideal):
    """NEES over ten units, 30 parameters each: statistical, chi-square band of 1 in 10000 to both sides.

    With the whole prior as the start of every pass it was 3 to 6: estimates wander while little is known.
    """
    nees = []
    for seed in range(10):
        solution, e = calibrated(ideal, seed=seed)
        assert solution.calibration.status == "ok"
        assert len(solution.passes) <= 5
        nees.append(e @ np.linalg.solve(solution.calibration.covariance, e))
    dof = 10 * len(e)
    assert chi2.ppf(1e-4, dof) < sum(nees) < chi2.isf(1e-4, dof)


def test_a_specification_that_does_not_allow_the_bias_is_contradicted(ideal):
    """50 deg/s of an automotive unit: the value comes out, but leans to zero by more than its sigma, and it is said."""
    solution, _ = calibrated(ideal, catalogue.spec("yaman-automotive"), seed=3)
    result = solution.calibration
    assert result.status == "warning"
    match = next(v for v in result.verdicts if v.startswith("not what was known before"))
    assert "b_g_y is off by" in match
    assert "more generous" in match


def test_one_pass_from_the_prior_is_lost_and_says_so(ideal):
    """The source's single pass: 128 degrees of attitude are lost in the first rest."""
    options = FieldOptions(passes=1)
    try:
        solution, _ = calibrated(ideal, seed=3, options=options)
    except InputError as error:
        assert "diverged" in str(error)  # noqa: PT017
    else:
        assert solution.calibration.variance_of_unit_weight > 100.0


def test_passes_that_do_not_settle_are_refused(ideal):
    """Without scale factors, of 3 %, nothing explains the log."""
    no_scale = replace(
        CHEAP,
        gyro=replace(CHEAP.gyro, turn_on_bias=0.01 * DEG, scale_factor=0.0, misalignment=0.0, g_sensitivity=0.0),
        accel=replace(CHEAP.accel, scale_factor=0.0),
    )
    solution, _ = calibrated(ideal, no_scale, seed=3, options=FieldOptions(passes=3))
    result = solution.calibration
    match = " ".join(result.verdicts)
    assert result.status != "ok"
    assert "not what was known before" in match
    assert "taken for zero, since the specification of the IMU has no uncertainty for it: S_a, S_g, M_g, G_g" in match
