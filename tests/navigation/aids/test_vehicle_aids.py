"""Wheels as measurements: when they count, what is refused, and that they hold a car that lost GNSS."""

from __future__ import annotations

import numpy as np
import pytest
from filter_cases import Case, drive

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    GATED,
    LATERAL,
    POSITION,
    SPEED,
    VERTICAL,
    MeasurementSchedule,
    gate_threshold,
    merged,
)
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.aids.vehicle import (
    VehicleConditions,
    non_holonomic,
    odometer_measurements,
    smoothed_motion,
    times_of_fixes,
    weaker_without_fixes,
)
from schuler.recording.series import ImuSeries, OdometerSeries
from schuler.simulation.imu import truth


def log(seconds=20.0, rate=100.0, turn=None, across=None, along=None) -> ImuSeries:
    """A level log; ``turn`` [rad/s], ``across`` and ``along`` [m/s^2] are functions of time."""
    t = np.arange(round(seconds * rate)) / rate
    gyro, accel = np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.81], (len(t), 1))
    for column, function in ((gyro[:, 2], turn), (accel[:, 1], across), (accel[:, 0], along)):
        if function is not None:
            column += function(t)
    return ImuSeries(t, gyro, accel)


def between(start, stop, value):
    return lambda t: np.where((t >= start) & (t < stop), value, 0.0)


def met(schedule, kind):
    part = schedule.where(schedule.kind == kind)
    return part.t, part.gate > 0.0


def test_times_and_noise():
    s = non_holonomic(
        log(10.0), rate_hz=4.0, sigma_lateral=0.1, sigma_vertical=0.2, lever_b=(-1.0, 0.0, 0.3), start=2.0
    )
    for kind, sigma in ((LATERAL, 0.1), (VERTICAL, 0.2)):
        part = s.where(s.kind == kind)
        np.testing.assert_allclose(part.t, np.arange(2.25, 9.98, 0.25), atol=1e-12)  # rounding
        assert np.all(part.R[:, 0, 0] == sigma**2)
        assert np.all(part.lever == (-1.0, 0.0, 0.3))
        assert np.all(part.z[:, 0] == 0.0)
        assert np.all(part.z[:, 7] == VehicleConditions().min_speed)
    assert np.all(np.diff(s.t) >= 0.0)
    assert np.all(s.gate == gate_threshold(0.9999, 1))


def test_without_a_gate_every_update_passes():
    assert np.all(np.isinf(non_holonomic(log(), gate=None).gate))


def test_sigmas_are_larger_from_fifteen_seconds_after_the_last_fix():
    """Of wheels alone; by what came before, so that a live run has the same."""
    wheels = non_holonomic(log(60.0), rate_hz=2.0)
    fix = MeasurementSchedule.of(POSITION, [20.0], np.zeros((1, 3)), np.eye(3)[None])
    schedule = merged(wheels, fix)
    times = times_of_fixes(schedule, 1.0)
    np.testing.assert_array_equal(times, [1.0, 20.0])
    weaker = weaker_without_fixes(schedule, 3.0, times)
    late = ((schedule.t > 16.0) & (schedule.t < 20.0)) | (schedule.t > 35.0)
    expected = np.where(late & (schedule.kind != POSITION), 9.0, 1.0)
    np.testing.assert_allclose(weaker.R[:, 0, 0] / schedule.R[:, 0, 0], expected, rtol=1e-12)  # rounding
    assert weaker_without_fixes(schedule, 1.0, times) is schedule
    assert weaker_without_fixes(fix, 3.0, times) is fix


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_turns_stop_the_lateral_one_only(sign):
    s = non_holonomic(log(turn=between(8.0, 12.0, sign * 0.5)), rate_hz=10.0)
    t, good = met(s, LATERAL)
    # means over half a second: 0.35 of 0.5 rad/s is reached 0.1 s inside the turn
    clear = (np.abs(t - 8.1) > 0.02) & (np.abs(t - 11.9) > 0.02)
    np.testing.assert_array_equal(good[clear], ((t < 8.1) | (t > 11.9))[clear])
    assert met(s, VERTICAL)[1].all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("along", "force", "stopped", "other"), [("across", 6.0, LATERAL, VERTICAL), ("along", 5.0, VERTICAL, LATERAL)]
)
def test_hard_cornering_and_braking_stop_one_only(along, force, stopped, other, sign):
    s = non_holonomic(log(**{along: between(8.0, 12.0, sign * force)}), rate_hz=10.0)
    t, good = met(s, stopped)
    assert good[(t < 7.7) | (t > 12.3)].all()
    assert not good[(t > 8.3) & (t < 11.7)].any()
    assert met(s, other)[1].all()


def test_a_tilted_sensor_is_no_manoeuvre():
    """A constant force across and along is tilt or bias: as much as 5 m/s^2 changes nothing."""
    s = non_holonomic(log(across=lambda t: 5.0 + 0 * t, along=lambda t: -5.0 + 0 * t))
    assert np.all(s.gate > 0.0)


def test_vibration_is_no_manoeuvre():
    s = non_holonomic(
        log(across=lambda t: 8.0 * np.sin(2 * np.pi * 20.0 * t), turn=lambda t: np.cos(2 * np.pi * 15.0 * t))
    )
    assert np.all(s.gate > 0.0)


def test_conditions_that_ask_for_nothing():
    free = VehicleConditions(np.inf, np.inf, np.inf, 0.0)
    wild = log(turn=between(3.0, 9.0, 2.0), across=between(3.0, 9.0, 20.0), along=between(3.0, 9.0, 20.0))
    assert np.all(non_holonomic(wild, conditions=free).gate > 0.0)


def test_smoothed_motion_is_the_mean_over_half_a_second():
    imu = log(turn=lambda t: 0.1 * t)
    turn, across, along = smoothed_motion(imu, np.array([5.0, 10.0]))
    np.testing.assert_allclose(turn, [0.5, 1.0], atol=1e-3)  # half a sample of an even window
    np.testing.assert_allclose((across, along), 0.0, atol=1e-12)  # rounding


def test_increments_count_as_their_rates():
    rates = log(turn=between(8.0, 12.0, 0.5))
    steps = ImuSeries(rates.t, rates.gyro * 0.01, rates.accel * 0.01, "increment")
    a, b = non_holonomic(rates), non_holonomic(steps)
    np.testing.assert_array_equal(a.gate, b.gate)


def test_a_log_too_short_for_one_update_gives_none():
    assert len(non_holonomic(log(0.1), rate_hz=1.0)) == 0
    assert len(non_holonomic(log(10.0), start=20.0)) == 0


@pytest.mark.parametrize("bad", [{"rate_hz": 0.0}, {"sigma_lateral": -0.1}, {"sigma_vertical": np.nan}])
def test_rates_and_sigmas_must_be_positive(bad):
    with pytest.raises(InputError, match="expected positive rate_hz and sigmas, got"):
        non_holonomic(log(), **bad)


@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_conditions_must_not_be_negative(value):
    with pytest.raises(InputError, match=r"VehicleConditions.max_turn_rate: expected a number from 0 to inf"):
        VehicleConditions(max_turn_rate=value)


# --------------------------------------------------------------------------------------------------- odometer


def wheel(rate=50.0, seconds=10.0, sigma=0.05) -> OdometerSeries:
    t = np.arange(round(seconds * rate)) / rate
    return OdometerSeries(t, np.sin(t), np.full(len(t), sigma))


@pytest.mark.parametrize(("rate", "largest", "seen"), [(50.0, 10.0, 10.0), (12.0, 10.0, 6.0), (8.0, 10.0, 8.0)])
def test_fast_odometers_are_thinned_to_no_more_than_the_rate(rate, largest, seen):
    s = odometer_measurements(wheel(rate), max_rate_hz=largest)
    assert 1.0 / np.diff(s.t).mean() == pytest.approx(seen, rel=1e-6)
    np.testing.assert_allclose(s.z[:, 0], np.sin(s.t), rtol=1e-14)  # readings, backwards too
    assert np.all(s.kind == SPEED)
    assert np.all(s.z[:, 7] == 0.0)  # a wheel that stands still says so


def test_every_reading_on_request():
    assert len(odometer_measurements(wheel(), max_rate_hz=None)) == 500


def test_refusals_of_the_odometer():
    with pytest.raises(InputError, match="max_rate_hz: expected a positive number"):
        odometer_measurements(wheel(), max_rate_hz=0.0)
    with pytest.raises(InputError, match=r"odometer: expected positive 1-sigma values, got 0.0; give sigma_m_s"):
        odometer_measurements(wheel(sigma=0.0))


# --------------------------------------------------------------------------------------------- in the filter


@pytest.fixture(scope="module")
def car() -> Case:
    return Case.of(drive(1.0), 60.0)


def go(case: Case, schedule, v_error=(0.0, 0.0, 0.0)):
    """Filter with no GNSS from a known place and attitude, with a velocity error north, east, down."""
    lay = StateLayout({"b_a": StateModel.constant(1e-3), "b_g": StateModel.constant(1e-6)})
    nav = case.truth
    v = nav.v_eb_e[0] + frames.C_en(nav.llh[0]) @ np.asarray(v_error)
    initial = InitialState.from_sigmas(
        NavState(0.0, nav.r_eb_e[0], v, nav.q_eb[0]), lay,
        attitude=np.full(3, 1e-3), velocity=np.full(3, 0.3), position=np.full(3, 0.1),
    )  # fmt: skip
    noise = np.full(3, 1e-10), np.full(3, 1e-6)
    return run(case.increments, schedule, initial, lay, *noise, FilterOptions(record_s=5.0))


def as_series(case: Case) -> ImuSeries:
    inc = case.increments
    return ImuSeries(inc.t, inc.dtheta_ib_b, inc.dv_ib_b, "increment")


def test_below_the_least_speed_updates_are_counted_as_gated(car):
    """The car of this log stands for its first five seconds."""
    schedule = non_holonomic(as_series(car), conditions=VehicleConditions(np.inf, np.inf, np.inf, 1.0))
    status = go(car, schedule).status
    state = truth(drive(1.0), np.unique(schedule.t))
    speed = np.repeat(np.linalg.norm(state.v_eb_e, axis=1), 2)  # lateral and vertical
    clear = np.abs(speed - 1.0) > 0.2
    np.testing.assert_array_equal((status == GATED)[clear], (speed < 1.0)[clear])


def test_wheels_take_a_velocity_error_away(car):
    """Without GNSS: 0.5 m/s of wrong velocity at the start, less than 0.1 m/s a minute later."""
    t = car.increments.t[4::10]
    state = truth(drive(1.0), t)
    ahead = rotation.dcm_from_quat(state.q_eb)[:, :, 0]
    forward = np.einsum("ni,ni->n", state.v_eb_e, ahead)
    odometer = odometer_measurements(OdometerSeries(t, forward, np.full(len(t), 0.05)))
    free = VehicleConditions(np.inf, np.inf, np.inf, 0.5)
    wheels = merged(non_holonomic(as_series(car), conditions=free, gate=None), odometer)
    end = car.truth.v_eb_e[60]
    unaided, aided = (
        go(car, s, (0.3, -0.3, 0.3)).rec_nav[-1, 4:7] - end for s in (MeasurementSchedule.empty(), wheels)
    )
    assert np.linalg.norm(unaided) > 0.4
    assert np.linalg.norm(aided) < 0.1
