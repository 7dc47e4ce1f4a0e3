"""Turns of the gyroscopes about the vertical beside those of the course: a gain, its sigma, and a sign beyond doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.diagnosis.course import course_turns
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.units import DEG, G0

PLACE = np.array([48.7 * DEG, 9.1 * DEG, 300.0])


def slalom(seconds=120.0, fixes_hz=5.0, noise_m=0.01, velocities=True, seed=1):
    """A car that weaves at 8 m/s on level ground, upright; rates and forces of its path."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.02)
    w = 0.3 * np.sin(0.9 * t) + 0.2 * np.sin(0.37 * t + 1.0)
    course, speed = np.cumsum(w) * 0.02, 8.0
    v_n = speed * np.stack((np.cos(course), np.sin(course), 0.0 * t), axis=1)
    zero = np.zeros_like(t)
    imu = ImuSeries(t, np.stack((zero, zero, w), axis=1), np.stack((zero, speed * w, zero - G0), axis=1))
    k = np.arange(0, len(t), round(50.0 / fixes_hz))
    r = np.cumsum(v_n, axis=0)[k] * 0.02 + noise_m * rng.standard_normal((len(k), 3))
    cov = np.broadcast_to(np.eye(3) * max(noise_m, 0.01) ** 2, (len(k), 3, 3))
    v = (v_n[k], cov) if velocities else (None, None)
    return imu, GnssSeries(t[k], frames.llh_from_ecef(frames.ecef_from_ned(r, PLACE)), cov, *v)


@pytest.mark.parametrize("velocities", [True, False])
def test_a_vehicle_turns_as_its_course_does(velocities):
    turns = course_turns(*slalom(velocities=velocities))
    # discretisation: the mean of a window of half a second either side of a turn of 7 s period
    np.testing.assert_allclose(turns.gain, 1.0, atol=0.05)
    assert np.all(np.abs(turns.gain - 1.0) < 4.0 * turns.sigma)
    assert not turns.reversed
    assert turns.axis == "z"


def test_a_scale_of_the_gyroscope_is_the_inverse_gain_and_its_bias_nothing():
    imu, gnss = slalom()
    as_read, changed = (course_turns(x, gnss) for x in (imu, replace(imu, gyro=imu.gyro * 1.25 + 0.1)))
    np.testing.assert_allclose(changed.gain, as_read.gain / 1.25, rtol=1e-9)  # rounding


@pytest.mark.parametrize("rotvec", [(0.0, 0.0, 0.0), (180.0, 0.0, 0.0), (0.0, 90.0, 0.0), (20.0, -30.0, 80.0)])
def test_only_a_reversed_gyroscope_is_reversed_however_it_is_mounted(rotvec):
    imu, gnss = slalom()
    mounted = imu.rotated(rotation.dcm_from_rotvec(np.array(rotvec) * DEG))
    assert not course_turns(mounted, gnss).reversed
    assert course_turns(replace(mounted, gyro=-mounted.gyro), gnss).reversed
    assert course_turns(replace(mounted, accel=-mounted.accel), gnss).reversed  # gravity itself: down is up


def test_a_body_that_points_anywhere_is_not_reversed():
    imu, gnss = slalom()
    gyro = imu.gyro.copy()
    gyro[:, 2] = 0.3 * np.sin(0.61 * imu.t)
    turns = course_turns(replace(imu, gyro=gyro), gnss)
    assert np.all(np.abs(turns.gain) < 0.6)
    assert not turns.reversed


def test_one_half_convicts_nobody():
    imu, gnss = slalom()
    gyro = imu.gyro * np.where(imu.t < 60.0, -1.0, 1.0)[:, None]
    assert not course_turns(replace(imu, gyro=gyro), gnss).reversed


def test_noise_of_the_fixes_widens_the_sigma():
    """Positions of a metre once a second, 40 seeds of two halves each; statistical, and differences of neighbouring
    positions alternate, so that a regression on slow turns scatters by half of the sigma."""
    gains, sigmas = [], []
    for seed in range(40):
        imu, gnss = slalom(fixes_hz=1.0, noise_m=1.0, velocities=False, seed=seed)
        turns = course_turns(imu, gnss)
        assert not turns.reversed
        gains.append(turns.gain)
        sigmas.append(turns.sigma)
    assert 0.3 < np.std(gains) / np.sqrt(np.mean(np.square(sigmas))) < 1.0
    imu, gnss = slalom(fixes_hz=1.0, noise_m=5.0, velocities=False)
    assert not course_turns(replace(imu, gyro=-imu.gyro), gnss).reversed  # nothing is told


def test_what_hardly_moves_or_falls_tells_nothing():
    imu, gnss = slalom()
    assert course_turns(imu, gnss.where(np.arange(len(gnss)) < 10)) is None
    assert course_turns(imu, gnss.where(np.arange(len(gnss)) < 1)) is None
    still = replace(gnss, v_n=0.01 * gnss.v_n)
    assert course_turns(imu, still) is None
    assert course_turns(replace(imu, accel=0.5 * imu.accel), gnss) is None
