"""Stefanisko's experiment against an independent program's numbers, and filters that claim too much or too little.

Reference numbers are RMS over 40 runs of another program with one seed; their class is statistical, 30 % as it
says.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.reproduce.stefanisko.study.bias_removal import expected_at_rest
from schuler.reproduce.stefanisko.study.campaign import figure_eight
from schuler.reproduce.stefanisko.study.coincidence import (
    coincidence_study,
    coincident_fixes,
    common_interval,
    compare_scheduling,
)
from schuler.reproduce.stefanisko.study.experiment import ESIEE, FigureEight, Track
from schuler.simulation.motion import inertial_quantities
from schuler.simulation.scenario import simulate
from schuler.units import DEG

PRINTED = 0.30
CASE = FigureEight()
RUNS = 40


@pytest.fixture(scope="module")
def moving():
    return figure_eight(CASE, RUNS)


def test_the_motion_is_what_it_says():
    """Up to 13.3 m/s, level, no slip; at rest what perfect sensors read is known; rounding."""
    state = CASE.motion().state(np.linspace(0.0, 40.0, 4001))
    speed = np.linalg.norm(state.v_eb_e, axis=1)
    assert speed.max() == pytest.approx(60.0 * 2.0 * np.pi / 40.0 * np.sqrt(2.0), rel=1e-6)
    v_b = np.einsum("nji,nj->ni", state.C_eb, state.v_eb_e)
    assert np.abs(v_b[:, 1:]).max() < 1e-9
    rest = replace(CASE, moving=False).motion().state(np.zeros(1))
    omega, f = inertial_quantities(rest)
    expected = expected_at_rest(ESIEE)
    np.testing.assert_allclose(omega[0], expected[0], atol=1e-15)
    np.testing.assert_allclose(f[0], expected[1], atol=1e-4)  # gravity of the ellipsoid in two forms


def test_errors_before_in_and_after_the_outage(moving):
    for t, position in ((50.0, 0.50), (90.0, 4.1), (93.0, 1.1), (120.0, 0.59)):
        assert moving.position(t) == pytest.approx(position, rel=PRINTED), t
    for t, velocity in ((50.0, 0.006), (90.0, 0.22), (93.0, 0.006), (120.0, 0.006)):
        assert moving.velocity(t) == pytest.approx(velocity, rel=PRINTED), t
    assert moving.heading(50.0) / DEG == pytest.approx(0.05, rel=PRINTED)
    assert moving.heading(90.0) / DEG == pytest.approx(0.12, rel=PRINTED)


def test_the_claim_is_the_error(moving):
    """His sign error (E15) is not ours: he would be 8 km off. RMS within 30 % of the root of the trace, 5.4."""
    for t in (5.0, 20.0, 50.0, 70.0, 90.0, 93.0, 120.0):
        assert moving.ratio(t) == pytest.approx(1.0, rel=0.30), t
    low, high = chi_square_band(15, RUNS, 0.9999)
    for t in (10.0, 50.0, 90.0, 120.0):
        assert low < moving.nees[:, moving._index(t)].mean() < high, t
    assert moving.nis.mean() == pytest.approx(1.0, abs=0.03)


def test_biases_are_found_with_both_signs(moving):
    """The estimates' errors at 50 s are a twentieth of the drawn 0.05 m/s^2: laws, and unbiased in standard errors."""
    e, s = moving.errors[:, 49, 9:12], np.sqrt(moving.variances[:, 49, 9:12])
    assert np.sqrt(np.mean(e**2)) < 0.05 / 20.0
    assert np.all(np.abs(np.mean(e / s, axis=0)) < 4.0 / np.sqrt(RUNS))


def test_without_outage():
    result = figure_eight(replace(CASE, outage_s=None, duration_s=92.0), RUNS)
    assert result.position(90.0) == pytest.approx(0.39, rel=PRINTED)


def test_at_rest_the_heading_is_lost():
    """Heading 6, 10, 14 deg at 50, 90, 120 s; position as an independent program has it. Ours lies 29 % above at 90
    s.
    """
    result = figure_eight(replace(CASE, moving=False), RUNS)
    for t, heading in ((50.0, 6.0), (90.0, 10.0), (120.0, 14.0)):
        assert result.heading(t) / DEG == pytest.approx(heading, rel=PRINTED), t
    assert result.position(50.0) == pytest.approx(0.50, rel=PRINTED)
    assert result.position(90.0) == pytest.approx(4.2, rel=0.35)  # 5.4: the heading makes it not quite normal


@pytest.mark.parametrize(
    ("change", "true", "claimed"),
    [
        ({"q_factor": 1.0 / 0.006}, 8.6, 52.0),  # variance of a sample taken for a density: far too careful
        ({"q_factor": 0.01}, 4.6, 0.8),  # over-confident
        ({"walk_b_a": 2e-4, "walk_b_g": 1e-3 * DEG}, 6.5, None),
    ],
)
def test_wrong_process_noise_shows(change, true, claimed):
    result = figure_eight(replace(CASE, **change, duration_s=95.0), RUNS)
    assert result.position(90.0) == pytest.approx(true, rel=PRINTED)
    if claimed is not None:
        assert result.claimed(slice(6, 9), 90.0) == pytest.approx(claimed, rel=PRINTED)
        assert abs(np.log(result.ratio(90.0))) > np.log(3.0)  # and the ratio of 5.4 catches it


def test_ins_alone():
    """About 120 m in 40 s from the same initial errors."""
    result = figure_eight(replace(CASE, gnss=False, duration_s=42.0, outage_s=None), RUNS)
    assert result.position(40.0) == pytest.approx(120.0, rel=PRINTED)


def test_coincidence_against_asynchronous():
    """0.50 to 0.31 m at 50 s, 4.1 to 3.6 m at the end of the outage; white noise: a third of the fixes, root 3."""
    study = coincidence_study(RUNS, case=replace(CASE, duration_s=95.0))
    first, second = study.coincidence, study.asynchronous
    assert second.position(50.0) == pytest.approx(0.31, rel=PRINTED)
    assert second.position(90.0) == pytest.approx(3.6, rel=PRINTED)
    assert first.position(50.0) / second.position(50.0) == pytest.approx(np.sqrt(3.0), rel=0.15)
    assert first.position(90.0) > second.position(90.0)
    assert second.ratio(90.0) == pytest.approx(1.0, rel=0.30)
    table = study.table()
    assert table.column("check_m") == [0.5, 4.1, 0.31, 3.6]
    json.dumps(study.to_dict())


def test_runs_do_not_depend_on_their_number(moving):
    few = figure_eight(CASE, 3)
    np.testing.assert_array_equal(few.errors, moving.errors[:3])
    assert moving.table().column("t_s") == [50.0, 90.0, 93.0, 120.0]


def test_interruption_keeps_the_runs_that_were_finished():
    def stop(fraction):
        if fraction > 0.2:
            raise KeyboardInterrupt

    result = figure_eight(replace(CASE, duration_s=5.0, outage_s=None), 10, progress=stop)
    assert len(result.nis) == 3
    assert not result.complete


def test_what_cannot_be_done_is_said():
    with pytest.raises(InputError, match=r"multiple of 0\.1 s"):
        FigureEight(update_s=0.25)
    with pytest.raises(InputError, match="positive"):
        FigureEight(q_factor=0.0)
    with pytest.raises(InputError, match="at least one"):
        figure_eight(CASE, 0)


def test_common_interval():
    assert common_interval(0.006, 0.1) == pytest.approx(0.3)
    assert common_interval(0.01, 1.0) == pytest.approx(1.0)
    assert common_interval(0.005, 0.006) == pytest.approx(0.03)
    with pytest.raises(InputError, match="at least"):
        common_interval(0.0, 0.1)


def test_coincident_fixes_of_a_log():
    """6 ms and 0.1 s: every third fix."""
    t = 0.1 * np.arange(1, 31)
    gnss = GnssSeries(t, np.tile(ESIEE, (30, 1)), np.tile(np.eye(3), (30, 1, 1)))
    kept = coincident_fixes(gnss, 0.006 * np.arange(1000))
    np.testing.assert_allclose(kept.t, 0.3 * np.arange(1, 11))
    with pytest.raises(InputError, match="no fix lies within 1e-05 s of an IMU sample"):
        coincident_fixes(gnss, 0.006 * np.arange(1000) + 0.0015, tolerance_s=1e-5)


def test_scheduling_of_a_recording(tmp_path):
    scenario = {
        "motion": {
            "type": "manoeuvres", "lat_deg": 48.84, "lon_deg": 2.59,
            "manoeuvres": [
                {"duration_s": 20.0}, {"duration_s": 8.0, "speed_m_s": 12.0}, {"duration_s": 10.0, "turn_deg": 120.0},
                {"duration_s": 10.0, "turn_deg": -140.0}, {"duration_s": 10.0, "turn_deg": 90.0},
            ],
        },
        "imu": {"rate_hz": 1.0 / 0.006, "catalogue": "MTi-G-710"},
        "gnss": {"rate_hz": 10.0},
    }  # fmt: skip
    recording = simulate(scenario, np.random.default_rng(1))
    config = NavigationConfig.parse({"imu": {"catalogue": "MTi-G-710"}, "filter": {"smooth": False}})
    first, second = compare_scheduling(recording, config)
    assert "coincident fixes" in first.recording
    assert second.rows[0].numbers["rms_horizontal_m"] < first.rows[0].numbers["rms_horizontal_m"]
    assert isinstance(recording, Recording)
    assert isinstance(recording.imu, ImuSeries)


@pytest.mark.slow
def test_full_campaign():
    """Four hundred runs: NEES within its band to 1e-4 but in the first seconds, where heading is not small."""
    result = figure_eight(CASE, 400, seed=7)
    low, high = chi_square_band(15, 400, 0.9999)
    for t in range(10, 120, 10):
        assert low < result.nees[:, result._index(t)].mean() < high, t
    assert result.position(90.0) == pytest.approx(4.1, rel=PRINTED)


def test_track_is_shared_by_cases():
    track = Track.of(replace(CASE, duration_s=1.2, outage_s=None))
    np.testing.assert_allclose(track.fixes_t, [0.3, 0.6, 0.9, 1.2])
    assert len(track.increments) == 200
