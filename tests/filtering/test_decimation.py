"""Propagating the covariance at 10 Hz changes nothing that matters: states and sigmas against every-sample runs."""

from __future__ import annotations

import filter_cases as cases
import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, gnss_measurements
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.recording.series import Increments
from schuler.simulation.imu import truth
from schuler.simulation.motion import LocalMotion, euler_attitude, ideal_increments


def gentle():
    return cases.drive(2.0), 100.0


def vibrating():
    """Gentle turns with 9 to 12 Hz vibration of a centimetre and half a degree."""
    w = 2 * np.pi * np.array([9.0, 10.7, 12.1])
    a = np.array([2e-3, 1.5e-3, 2e-3])

    def path(t):
        ph = np.outer(t, w)
        r = np.stack((50 * np.sin(0.1 * t), 40 * (1 - np.cos(0.12 * t)), 0 * t), -1) + a * np.sin(ph)
        v = np.stack((5 * np.cos(0.1 * t), 4.8 * np.sin(0.12 * t), 0 * t), -1) + a * w * np.cos(ph)
        acc = np.stack((-0.5 * np.sin(0.1 * t), 0.576 * np.cos(0.12 * t), 0 * t), -1) - a * w**2 * np.sin(ph)
        return r, v, acc

    def angles(t):
        ph = np.outer(t, w[::-1])
        b = 0.008
        rpy = np.stack((0.1 * np.sin(0.2 * t), 0.05 * np.cos(0.17 * t), 0.3 * t), -1) + b * np.sin(ph)
        return rpy, np.stack((0.02 * np.cos(0.2 * t), -0.0085 * np.sin(0.17 * t), 0.3 + 0 * t), -1) + b * w[
            ::-1
        ] * np.cos(ph)

    return LocalMotion(cases.ORIGIN, path, euler_attitude(angles), 130.0), 400.0


def turntable():
    """Spinning at 3 rad/s about a tilted axis, slowly walking."""

    def path(t):
        r = np.stack((0.5 * t, 3 * np.sin(0.3 * t), 0 * t), -1)
        return (
            r,
            np.stack((0.5 + 0 * t, 0.9 * np.cos(0.3 * t), 0 * t), -1),
            np.stack((0 * t, -0.27 * np.sin(0.3 * t), 0 * t), -1),
        )

    def angles(t):
        rpy = np.stack((0.4 * np.sin(0.5 * t), 0.3 * np.cos(0.4 * t), 3.0 * t), -1)
        return rpy, np.stack((0.2 * np.cos(0.5 * t), -0.12 * np.sin(0.4 * t), 3.0 + 0 * t), -1)

    return LocalMotion(cases.ORIGIN, path, euler_attitude(angles), 130.0), 100.0


def start_at_truth(case, lay):
    T = case.truth
    nav = NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0])
    return InitialState.from_sigmas(nav, lay, attitude=cases.START_ATT, velocity=cases.START_V, position=cases.START_R)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("states", [15, 33])
@pytest.mark.parametrize("motion", [gentle, vibrating, turntable])
def test_ten_hertz_equals_every_sample(motion, states):
    body, rate_hz = motion()
    seconds = 120.0
    t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    dtheta, dv = ideal_increments(body, t)
    fixes = np.arange(1.0037, seconds, 1.0)
    case = cases.Case(
        Increments(t[1:], np.diff(t), dtheta, dv), fixes, body.state(fixes), truth(body, np.arange(0.0, seconds + 0.5))
    )
    lay = cases.layout(states)
    rng = np.random.default_rng(5)
    log, _ = cases.corrupted(case, lay, np.sqrt(lay.initial_variances()) * rng.standard_normal(lay.size - 9), rng)
    schedule = gnss_measurements(cases.fixes(case, rng), cases.LEVER, gate=None)
    results = []
    for rate in (10.0, None):
        forward = run(
            log, schedule, cases.start(case, lay, np.random.default_rng(1)), lay, np.full(3, cases.GYRO_N**2),
            np.full(3, cases.ACCEL_N**2), FilterOptions(covariance_rate_hz=rate),
        )  # fmt: skip
        results.append(NavigationResult.from_run(forward, schedule.t, schedule.kind, lay))
    slow, fast = results
    assert slow.propagations < fast.propagations / 5
    settled = slow.t > 10.0
    sigma_slow = np.sqrt(np.einsum("kii->ki", slow.covariance_e))[settled]
    sigma_fast = np.sqrt(np.einsum("kii->ki", fast.covariance_e))[settled]
    # discretisation of the process noise over 0.1 s instead of one sample
    assert np.abs(sigma_slow / sigma_fast - 1.0).max() < 1e-3
    from schuler.navigation.evaluation.consistency import state_errors

    _, dx_slow, _ = state_errors(slow, case.truth, np.zeros(lay.size - 9))
    _, dx_fast, _ = state_errors(fast, case.truth, np.zeros(lay.size - 9))
    assert np.abs((dx_slow - dx_fast)[settled] / sigma_fast).max() < 0.01


def test_a_large_turn_forces_a_propagation(drive_case):
    lay = cases.layout(15)
    n = 200
    inc = Increments(
        np.arange(1, n + 1) * 0.01,
        np.full(n, 0.01),
        np.tile([0.0, 0.0, 0.05], (n, 1)),
        np.tile([0, 0, -0.0981], (n, 1)),
    )
    forward = run(
        inc, MeasurementSchedule.empty(), start_at_truth(drive_case, lay), lay,
        np.full(3, 1e-8), np.full(3, 1e-6), FilterOptions(covariance_rate_hz=1.0, flush_angle=0.3),
    )  # fmt: skip
    assert forward.propagations == pytest.approx(n * 0.05 / 0.35, abs=3)  # every seventh sample of 0.05 rad
