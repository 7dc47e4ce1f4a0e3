"""Spikes of a log that is navigated: what is no motion is replaced, what is one stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.navigation.inputs.spikes import IN_A_ROW, without_spikes
from schuler.recording.series import ImuSeries

H = 0.01  # sample interval [s]


def log(kind="increment", n=400):
    """A turn that swells and fades, gravity and a gentle sway; stamps jitter by a tenth of the interval."""
    rng = np.random.default_rng(3)
    t = H * (np.arange(n) + 0.1 * rng.uniform(-1.0, 1.0, n))
    gyro = np.stack((0.01 * np.sin(t), 0.02 * np.cos(t), 0.5 * np.sin(3.0 * t)), axis=1)
    accel = np.stack((np.sin(2.0 * t), np.cos(t), np.full(n, -9.8)), axis=1) + 0.01 * rng.standard_normal((n, 3))
    dt = np.diff(t, prepend=t[0] - H)[:, None] if kind == "increment" else 1.0
    return ImuSeries(t, gyro * dt, accel * dt, kind)


@pytest.mark.parametrize("kind", ["increment", "rate"])
@pytest.mark.parametrize(("name", "size"), [("gyro", 50.0), ("accel", 1000.0), ("accel", -300.0)])
@pytest.mark.parametrize("length", range(1, IN_A_ROW + 1))
def test_a_spike_is_replaced_by_the_rate_beside_it(kind, name, size, length):
    """Of the clean readings what is put in their place differs by no more than these change over the spike."""
    clean, notes = log(kind), []
    values, h = getattr(clean, name).copy(), H if kind == "increment" else 1.0
    values[200 : 200 + length, 1] += size * h
    mended = without_spikes(
        ImuSeries(clean.t, **{"gyro": clean.gyro, "accel": clean.accel, name: values}, kind=kind), notes
    )
    limit = {"gyro": 0.2, "accel": 0.3}[name]  # discretisation: rates of change times the readings beside it
    assert np.abs(getattr(mended, name) - getattr(clean, name)).max() < limit * h
    others = np.r_[0:200, 200 + length : 400]
    np.testing.assert_array_equal(getattr(mended, name)[others], getattr(clean, name)[others])
    assert len(notes) == 1
    assert notes[0].startswith(f"{length} IMU readings are no motion (the first at {clean.t[200]:.3f} s")


@pytest.mark.parametrize(("name", "size"), [("gyro", 50.0), ("accel", 300.0)])
def test_two_spikes_with_a_reading_between_them_are_replaced_and_it_stays(name, size):
    clean, notes = log("rate"), []
    values = getattr(clean, name).copy()
    values[200, 1] += size
    values[202, 0] -= size
    mended = without_spikes(ImuSeries(clean.t, **{"gyro": clean.gyro, "accel": clean.accel, name: values}), notes)
    assert np.abs(getattr(mended, name) - getattr(clean, name)).max() < 0.3
    np.testing.assert_array_equal(getattr(mended, name)[201], getattr(clean, name)[201])
    assert notes[0].startswith("2 IMU readings are no motion")


def shock(values):
    values[200:204, 0] += 300.0  # it lasts


def ringing(values):
    values[200:206, 0] += 300.0 * np.array([1.0, -0.6, 0.4, -0.3, 0.2, -0.1])


def knock(values):
    values[200:203, 0] += 300.0, 100.0, 250.0  # it does not pause between two peaks


def fall(values):
    values[200, 2] -= 300.0  # and lies on its side afterwards
    values[201:] = values[201:][:, [2, 1, 0]]


def often(values):
    values[10::30, 0] += 300.0


@pytest.mark.parametrize("motion", [shock, ringing, knock, fall, often])
def test_what_may_be_motion_stays_as_it_was_read(motion):
    clean, notes = log("rate"), []
    accel = clean.accel.copy()
    motion(accel)
    imu = ImuSeries(clean.t, clean.gyro, accel)
    assert without_spikes(imu, notes) is imu
    assert not notes


@pytest.mark.parametrize("at", [0, 2, 397, 399])
def test_nothing_is_replaced_where_one_side_is_missing(at):
    clean = log("rate")
    accel = clean.accel.copy()
    accel[at, 0] += 1000.0
    imu = ImuSeries(clean.t, clean.gyro, accel)
    assert without_spikes(imu, []) is imu
