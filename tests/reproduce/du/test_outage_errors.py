"""Why the NEES of an MTi-G leaves its band in an outage: second order of tilt in the vertical, and nothing else."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import logm

from schuler import rotation
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.reproduce.du.study.imus import MTI_G
from schuler.reproduce.du.study.integrated import START, IntegratedDrive, rotary_schedule
from schuler.reproduce.du.study.outage_errors import OutageErrors, extended_pose_errors, second_order_table
from schuler.reproduce.du.study.outages import DriveRuns
from schuler.units import G0

#: One outage of 300 s instead of three; and of 60 s, for what does not need that.
SHORT = {"length_s": 661.0, "outages": ((360.0, 660.0),)}
BRIEF = {"length_s": 121.0, "outages": ((60.0, 120.0),)}
RUNS, FEW = 64, 16


def drive(rotary=True, size=1.0):
    return IntegratedDrive(MTI_G, rotary_schedule(MTI_G) if rotary else None, truth="filter", size=size, **SHORT)


@cache
def lanes(rotary, size):
    return DriveRuns.of(drive(rotary, size), RUNS, seed=9)


@cache
def engine(rotary):
    return OutageErrors.of(drive(rotary), FEW, seed=9, every_s=10.0)


@pytest.mark.parametrize("rotary", [True, False], ids=["rotary", "conventional"])
def test_excess_goes_down_with_the_square_of_all_errors(rotary):
    """A defect would be as large at any size; a second-order term is a quarter at half the size."""
    result = {size: float(lanes(rotary, size).nees(361.0, 659.0).mean()) for size in (1.0, 0.5, 0.25, 0.125)}
    low, high = chi_square_band(15, RUNS, 0.9999)
    assert low < result[0.125] < high  # statistical, one independent value a run at least
    assert low < result[0.25] < high
    # at full size far out of it: 0.30 and 1.40 above with this luck, 0.36 and 1.6 with much
    assert result[1.0] - result[0.125] == pytest.approx(0.30 if rotary else 1.40, rel=0.15)
    # the same luck at all sizes: differences of 1 and 1/2, of 1/2 and 1/4, one is four times the other
    falls = -np.diff(list(result.values()))
    assert 3.4 < falls[0] / falls[1] < 5.0  # 4 and terms of fourth order: 4.4 and 3.8 are seen
    assert 3.4 < falls[1] / falls[2] < 5.6


@pytest.mark.parametrize("rotary", [True, False], ids=["rotary", "conventional"])
def test_the_car_sinks_by_the_square_of_the_tilt(rotary):
    """Mean of the down velocity error: a linear filter has none, closed form ``g E[tilt**2] / 2`` integrated."""
    runs = lanes(rotary, 1.0)
    t, error, sigma = runs.records.t, runs.records.error, runs.records.sigma
    k = (t >= 359.5) & (t <= 659.5)
    tilt = np.sum(sigma[:, k, :2] ** 2, axis=2)  # E[tilt**2] as the filter claims
    expected = 0.5 * G0 * float(np.mean(np.sum(0.5 * (tilt[:, 1:] + tilt[:, :-1]), axis=1)))
    last = error[:, k, 5][:, -1]
    scatter = float(last.std()) / np.sqrt(RUNS)
    assert last.mean() == pytest.approx(expected, abs=4.0 * scatter)  # statistical
    assert last.mean() > 4.0 * scatter
    if rotary:  # noise of the gyroscopes alone: g N^2 T^2 / 2
        assert expected == pytest.approx(0.5 * G0 * MTI_G.spec.gyro.random_walk**2 * 300.0**2, rel=0.15)


@pytest.mark.parametrize("rotary", [True, False], ids=["rotary", "conventional"])
def test_excess_is_in_the_vertical_and_is_the_tilt(rotary):
    e = engine(rotary)
    mean = {d: float(e.nees(d).mean()) for d in ("states", "no vertical", "less sag", "extended pose")}
    low, high = chi_square_band(15, FEW, 0.9999)
    for definition in ("no vertical", "less sag"):
        assert low < mean[definition] < high  # statistical, one independent value a run at least
    # paired: nearly all of the excess is gone, whatever this luck's level is
    excess = mean["states"] - mean["less sag"]
    assert excess > (0.1 if rotary else 0.6)  # 0.13 and more are seen
    assert mean["extended pose"] - mean["less sag"] < 0.15 * excess


def test_it_is_the_run_of_the_lanes():
    """The engine repeats what the lanes did, NEES and all."""
    runs, e = DriveRuns.of(drive(), FEW, seed=9), engine(True)
    at = np.searchsorted(runs.records.t, e.t - 1e-6)
    np.testing.assert_allclose(e.nees(), runs.records.nees["all"][:, at], rtol=2e-3)  # sums in another order
    np.testing.assert_allclose(e.error[..., 5], runs.records.error[:, at, 5], atol=1e-5)


def test_extended_pose_errors_are_the_logarithm_of_the_group():
    """Logarithm of X^-1 X_hat, 5 by 5, of the estimate's axes turned to those of the errors; to rounding of logm."""
    rng = np.random.default_rng(3)
    for size in (1e-5, 0.02, 0.5, 2.0):
        psi, dv, dr = size * rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal(3)
        C_hat = rotation.dcm_from_rpy(rng.uniform(-1.0, 1.0, 3))
        C = rotation.dcm_from_rotvec(-psi) @ C_hat
        hat, true = np.eye(5), np.eye(5)
        v, r = 30.0 * rng.standard_normal(3), 100.0 * rng.standard_normal(3)
        true[:3, :3], true[:3, 3], true[:3, 4] = C, v, r
        hat[:3, :3], hat[:3, 3], hat[:3, 4] = C_hat, v + dv, r + dr
        xi = np.real(logm(np.linalg.inv(true) @ hat))
        expected = np.concatenate((C_hat @ xi[:3, 3], C_hat @ xi[:3, 4]))
        result = extended_pose_errors(np.concatenate((psi, dv, dr, [7.0])))
        np.testing.assert_allclose(result[3:9], expected, atol=1e-9)
        np.testing.assert_array_equal(result[[0, 1, 2, 9]], [*psi, 7.0])
        # equal to the states to first order
        np.testing.assert_allclose(result[3:9], np.concatenate((dv, dr)), atol=3.0 * np.linalg.norm(psi))


def test_a_tilt_that_stays_is_first_order_in_extended_poses():
    """At rest with a constant attitude error: the transition along the estimate, closed form, holds exactly."""
    psi, T = np.array([0.3, -0.2, 0.4]), 20.0
    g = np.array([0.0, 0.0, G0])
    f_hat = rotation.dcm_from_rotvec(psi) @ -g
    dv, dr = (f_hat + g) * T, (f_hat + g) * 0.5 * T**2
    e = extended_pose_errors(np.concatenate((psi, dv, dr)))
    np.testing.assert_allclose(e[3:6], np.cross(psi, f_hat) * T, rtol=1e-12)  # rounding
    np.testing.assert_allclose(e[6:9], np.cross(psi, f_hat) * 0.5 * T**2, rtol=1e-12)
    # the states themselves are off by g tilt^2 / 2, to terms of fourth order
    tilt = psi[0] ** 2 + psi[1] ** 2
    assert dv[2] - (np.cross(psi, f_hat) * T)[2] == pytest.approx(-0.5 * G0 * tilt * T, rel=0.1)


def test_size_scales_everything_the_filter_is_told():
    full, half = (replace(drive(size=size), **BRIEF) for size in (1.0, 0.5))
    for name, model in full.states.models.items():
        assert half.states.models[name].sigma == pytest.approx(0.5 * model.sigma)
        assert half.states.models[name].noise == pytest.approx(0.5 * model.noise)
    a, b = full.scenario, half.scenario
    np.testing.assert_allclose(b.initial.P, 0.25 * a.initial.P)
    np.testing.assert_allclose(np.sqrt(np.diag(b.initial.P)[:3]), 0.5 * START[0])
    np.testing.assert_allclose(b.gyro_psd, 0.25 * np.asarray(a.gyro_psd))
    np.testing.assert_allclose(b.accel_psd, 0.25 * np.asarray(a.accel_psd))
    np.testing.assert_allclose(b.errors.white, 0.5 * a.errors.white)
    np.testing.assert_allclose(b.aiding.sigma, 0.5 * a.aiding.sigma)
    np.testing.assert_allclose(b.aiding.schedule.R, 0.25 * a.aiding.schedule.R)


def test_table():
    brief = replace(drive(), **BRIEF)
    table = second_order_table(MTI_G, 2, sizes=(0.5,), drive=brief, seed=9)
    assert table.column("imu_is") == ["conventional", "rotary"]
    assert table.row(imu_is="rotary")["size"] == 0.5
    single = OutageErrors.of(replace(brief, size=0.5), [0, 1], seed=9)
    assert table.row(imu_is="rotary")["extended_pose"] == pytest.approx(single.nees("extended pose").mean())


def test_what_makes_no_sense_is_refused():
    with pytest.raises(InputError, match="truth 'filter'"):
        replace(drive(), truth="unit", size=0.5)
    with pytest.raises(InputError, match="positive"):
        drive(size=0.0)
    with pytest.raises(InputError, match="counted from 0"):
        OutageErrors.of(drive(), 1, outage=1)
    with pytest.raises(InputError, match="at least one"):
        OutageErrors.of(drive(), [])
    with pytest.raises(InputError, match="definition"):
        engine(True).nees("tilt")
    with pytest.raises(InputError, match="last axis"):
        extended_pose_errors(np.zeros((4, 6)))
