"""Whole runs by navigate() with every aid, tightly coupled, reset, uncoupled; and what is refused."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest
from aided_recording import HEADING_BIAS, MOUNT, SCALE, config, drawn, recorded

from schuler import frames, units
from schuler.exceptions import InputError
from schuler.filtering import measurements as ms
from schuler.navigation.run import navigate
from schuler.recording.recording import Recording


@pytest.fixture(scope="module")
def truth():
    return drawn()


@pytest.fixture(scope="module")
def recording(truth):
    return recorded(truth)


def horizontal(result, recording, start=60.0, stop=100.0):
    return result.errors(recording.reference).between(start, stop).max_horizontal


def test_every_aid_of_a_configuration_is_used_and_helps(recording):
    """Largest horizontal error in an outage of 40 s: inertial alone, with wheels, with all; and their parameters."""
    alone = navigate(recording, config(recording))
    wheels = {"lever_m": list(ac.LEVER_V), "lateral_sigma_m_s": 0.05, "vertical_sigma_m_s": 0.05}
    some = navigate(recording, config(recording, aiding={"non_holonomic": wheels}))
    t = 80.0
    place = recording.reference.at(np.array([t]))
    llh = frames.llh_from_ecef(place.r_eb_e)[0] / [units.DEG, units.DEG, 1.0]
    full = navigate(
        recording,
        config(
            recording,
            aiding={
                "zero_velocity": {},
                "zero_rate": {},
                "non_holonomic": wheels,
                "odometer": {"lever_m": list(ac.LEVER_V), "scale_sigma": 0.05},
                "heading": {"bias_sigma_deg": 5.0},
                "barometer": {"lever_m": list(ac.LEVER_H)},
                "fixes": {"t_s": [t - recording.start], "llh_deg": [list(llh)]},
            },
        ),
    )
    a, b, c = (horizontal(r, recording) for r in (alone, some, full))
    assert c < b < a, (a, b, c)
    assert b < 0.5 * a
    assert c < 1.5
    counts = full.innovations.counts()
    names = {"position", "velocity", "zero_velocity", "zero_rate", "lateral", "vertical", "speed", "heading", "height"}
    assert set(counts) == names | {"fix"}
    for name, count in counts.items():
        offered = sum(count.values()) - count["condition not met"] - count["unused"]
        assert count["accepted"] > 0.98 * offered > 0, (name, count)
    assert counts["lateral"]["condition not met"] > 0
    assert "without their condition" in full.summary()
    assert any(note.startswith("at rest: ") for note in full.notes)
    for kind in ("position", "velocity", "speed", "heading", "height"):  # the others are exact in this log
        assert 0.75 < full.innovations.of(kind).mean_nis() < 1.25, kind
    for name, true in (("mount", MOUNT), ("odometer", SCALE), ("b_heading", HEADING_BIAS)):
        error = np.abs(full.parameter(name)[-1] - true)
        assert np.all(error < 4.5 * full.sigma(name)[-1]), name  # statistical
    smoothed = full.smooth()
    assert np.isfinite(smoothed.trajectory.r_eb_e).all()


def test_tight_run_of_a_recording_with_ranges(recording, truth):
    """Ranges in, no GNSS series needed; clocks found; two satellites through the outage beat none."""
    bare = replace(recording, gnss=None)
    tight = {"coupling": "tight", "tight": {"clock_noise_m": 0.3, "clock_drift_noise_m_s": 0.1, "system_noise_m": 0.02}}
    result = navigate(bare, config(recording, gnss=tight, outages={"windows_s": []}))
    assert list(result.layout.models)[-3:] == ["clock", "clock_drift", "clock_2"]
    assert result.errors(recording.reference).between(30.0, 119.0).rms_horizontal < 1.0
    assert 0.9 < result.innovations.mean_nis() < 1.1
    clock = truth.at("clock", result.t)
    assert np.all(np.abs(result.parameter("clock") - clock)[20:] < 5.0 * result.sigma("clock")[20:])
    r = recording.ranges
    subset = replace(r, reason=np.where((r.t > 60.0) & (r.t < 100.0) & _not_among_first(r, 2), 3, r.reason))
    a = navigate(replace(bare, ranges=subset), config(recording, gnss=tight, outages={"windows_s": []}))
    b = navigate(bare, config(recording, gnss=tight))
    assert horizontal(a, recording) < horizontal(b, recording)


def _not_among_first(ranges, n):
    keep = np.zeros(len(ranges), dtype=bool)
    for t in np.unique(ranges.t):
        keep[np.flatnonzero(ranges.t == t)[:n]] = True
    return ~keep


def test_coupling_off_uses_no_fix_but_starts_from_one(recording):
    off = {"coupling": "off"}
    result = navigate(recording, config(recording, gnss=off, outages={"windows_s": []}))
    assert len(result.innovations) == 0
    assert any("free inertial" in note for note in result.notes)
    wheels = navigate(
        recording,
        config(recording, gnss=off, outages={"windows_s": []}, aiding={"zero_velocity": {}, "odometer": {}}),
    )
    assert set(wheels.innovations.counts()) == {"zero_velocity", "speed"}


def test_reset_run(recording):
    reset = {"coupling": "reset", "reset_every_s": 5.0}
    result = navigate(recording, config(recording, gnss=reset, outages={"windows_s": []}))
    assert set(result.innovations.counts()) == {"reset_position", "reset_velocity"}
    assert np.diff(np.unique(result.innovations.t)).min() == pytest.approx(5.0)
    assert np.all(np.diff(result.parameters, axis=0) == 0.0)
    with pytest.raises(InputError, match="kept nothing to smooth"):
        result.smooth()


def test_estimated_delay_and_lever_arm(recording):
    late = replace(recording, gnss=replace(recording.gnss, t=recording.gnss.t - 0.1))
    result = navigate(
        late,
        config(
            recording,
            gnss={
                "delay_sigma_s": 0.1,
                "lever_sigma_m": 0.3,
                "lever_arm_m": (ac.LEVER + np.array([0.2, -0.2, 0.0])).tolist(),
            },
            outages={"windows_s": []},
        ),
    )
    assert result.parameter("delay")[-1, 0] == pytest.approx(0.1, abs=0.01)
    np.testing.assert_allclose(result.parameter("lever")[-1, :2], [-0.2, 0.2], atol=0.2)


def test_aids_whose_series_is_missing_are_refused(recording):
    bare = Recording(imu=recording.imu, gnss=recording.gnss, reference=recording.reference)
    for section, message in (
        ({"odometer": {}}, r"aiding\.odometer is configured, but the recording has no odometer series"),
        ({"heading": {}}, "aiding needs a heading series, and the recording has none"),
        ({"barometer": {}}, "aiding needs a height series, and the recording has none"),
    ):
        with pytest.raises(InputError, match=message):
            navigate(bare, config(recording, aiding=section))
    with pytest.raises(InputError, match='coupling = "tight" needs raw satellite measurements'):
        navigate(bare, config(recording, gnss={"coupling": "tight"}))


def test_standing_vehicles_and_unmet_conditions_are_counted_not_used(recording):
    result = navigate(
        recording, config(recording, aiding={"non_holonomic": {"min_speed_m_s": 2.0}}, outages={"windows_s": []})
    )
    i = result.innovations.of("lateral")
    speed = np.linalg.norm(recording.reference.at(i.t).v_eb_e, axis=1)
    assert np.all(i.status[speed < 1.5] == ms.GATED)
    assert np.isnan(i.nis[i.status == ms.GATED]).all()
    assert np.any(i.status == ms.ACCEPTED)
