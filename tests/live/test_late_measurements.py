"""A late measurement does what it does in time, whatever it measures; one of the clock before a step does nothing."""

import functools
from dataclasses import replace

import live_cases as cases
import numpy as np
import pytest

from schuler.live import Fix, Heading, Height, ImuBlock, LiveNavigator, SatelliteEpoch, Speed
from schuler.live.playback import messages
from schuler.simulation import simulate

ROUNDING = 1e-9  # of sums over blocks of other lengths, relative to position, velocity and attitude in SI
KINDS = (Fix, SatelliteEpoch, Speed, Heading, Height)
SCENARIO = {
    **cases.SCENARIO,
    "odometer": {"rate_hz": 10.0, "sigma_m_s": 0.05, "scale_error": 0.01},
    "heading": {"rate_hz": 5.0, "sigma_deg": 1.5, "bias_deg": 2.0},
    "barometer": {"rate_hz": 5.0, "sigma_m": 0.3, "bias_m": 15.0},
    "satellites": {
        "systems": "GE", "rate_hz": 1.0, "noise_m": 0.5, "rate_noise_m_s": 0.05, "clock_m": 3000.0,
        "clock_drift_m_s": 30.0, "offsets_m": [12.0], "lever_arm_m": [0.6, -0.2, -1.1],
    },
}  # fmt: skip
AIDS = {
    "non_holonomic": {}, "zero_velocity": {}, "zero_rate": {}, "odometer": {}, "heading": {"bias_sigma_deg": 3.0},
    "barometer": {"bias_sigma_m": 20.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def recording():
    return simulate(SCENARIO).between(0.0, 45.0)


@pytest.fixture(scope="module")
def in_time(recording):
    return functools.cache(lambda coupling: run(recording, coupling))


def started(recording, coupling="loose"):
    gnss = {"coupling": coupling, "lever_arm_m": [0.6, -0.2, -1.1]}
    return LiveNavigator.from_config({**cases.CONFIG, "gnss": gnss, "aiding": AIDS}, kind=recording.imu.kind)


def run(recording, coupling, late=(), lag_s=1.3):
    """Solution and parameters at the end; from 30 s on messages of some kinds come late, all by 42 s."""
    live = started(recording, coupling)
    stream = [
        (t + lag_s if isinstance(m, late) and 30.0 < t < 40.0 else t, m) for t, m in messages(recording, 0.2)
    ]  # fmt: skip
    for _, message in sorted(stream, key=lambda pair: pair[0]):
        live.take(message)
        live.solution()
    assert not [e.text for e in live.events if e.kind in ("late", "measurement")]
    s = live.solution()
    return np.concatenate((cases.position(s), s.v_eb_n, s.rpy_nb, s.sigma_r_n, live.parameters))


@pytest.mark.parametrize("coupling", [pytest.param("loose", marks=pytest.mark.campaign), "tight"])
def test_late_is_in_time_for_all_kinds_at_once(recording, in_time, coupling):
    np.testing.assert_allclose(run(recording, coupling, KINDS), in_time(coupling), rtol=0.0, atol=5.0 * ROUNDING)


@pytest.mark.campaign
@pytest.mark.parametrize("kind", KINDS)
def test_late_is_in_time_for_each_kind(recording, in_time, kind):
    coupling = "tight" if kind is SatelliteEpoch else "loose"
    np.testing.assert_allclose(run(recording, coupling, kind), in_time(coupling), rtol=0.0, atol=5.0 * ROUNDING)


@pytest.mark.campaign
@pytest.mark.parametrize("step", [400.0, pytest.param(-20.0, marks=pytest.mark.campaign)])
def test_a_late_measurement_of_the_clock_before_its_step_changes_nothing(recording, step):
    """All clocks step at 25 s; a fix, a speed and a height of before come a second after."""
    stream = [(t, m) for t, m in messages(recording, 0.2) if not isinstance(m, SatelliteEpoch)]
    old = [m for t, m in stream if 23.0 < t < 24.0 and not isinstance(m, ImuBlock)]
    ends = []
    for stale in ([], old):
        live, waiting = started(recording), list(stale)
        for t, message in stream:
            live.take(message if t < 25.0 else replace(message, t=message.t + step))
            if t > 26.0:
                while waiting:
                    live.take(waiting.pop())
        solution = live.solution()
        ends.append(cases.position(solution))
        assert any("does not continue" in e.text for e in live.events)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=5.0 * ROUNDING)
