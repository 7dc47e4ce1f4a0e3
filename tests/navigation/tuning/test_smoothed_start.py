"""Start of runs that judge noise: the tuned noise is the log's, not the start's, nor that of last bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, units
from schuler.exceptions import DivergenceError
from schuler.filtering.initial_state import InitialState
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.tuning.likelihood import Residuals
from schuler.navigation.tuning.noise import with_factors
from schuler.navigation.tuning.search import proven
from schuler.navigation.tuning.start import expected_gain, unless_refuted, with_smoothed_start
from schuler.navigation.tuning.tuning import too_few, tune
from schuler.simulation.scenario import prepare_mission, simulate_mission

IMU = {"gyro": {"arw_deg_rthr": 2.0, "bias_deg_s": 0.5}, "accel": {"vrw_m_s_rthr": 1.0, "bias_mg": 10.0}}
STATED = {"gyro": {"arw_deg_rthr": 0.2, "bias_deg_s": 0.5}, "accel": {"vrw_m_s_rthr": 0.1, "bias_mg": 10.0}}
CORNERS = [(0, 0, 6), (60, -10, 7), (90, 40, 5), (50, 90, 8), (-20, 80, 6), (-40, 10, 7), (20, -30, 6), (70, 20, 5)]
POINTS = [{"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} for n, e, v in CORNERS]


@pytest.fixture(scope="module")
def drive():
    """A car under way, fixes of 2 cm, its IMU ten times as noisy as stated."""
    mission = prepare_mission(
        {
            "seed": 5,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": 50.0, "kind": "increment", **IMU},
            "gnss": {"rate_hz": 2.0, "lever_arm_m": [0.0, 0.0, 0.0], "sigma_position_m": [0.02, 0.02, 0.04]},
        }
    )
    recording = simulate_mission(mission).recording
    return replace(recording, gnss=replace(recording.need_gnss(), v_n=None, cov_v_n=None))


def config(**filter_):
    return NavigationConfig.checked({"imu": dict(STATED), "filter": {"smooth": False, **filter_}})


def started(drive, off_deg, claimed_deg):
    """The run from the truth, its heading off."""
    prepared = prepared_run(drive, config())
    t = prepared.initial.nav.t
    state = drive.reference.at(np.array([t]))
    rpy = state.rpy_nb[0] + np.array([0.0, 0.0, off_deg * units.DEG])
    nav = NavState.from_geodetic(t, state.llh[0], state.v_eb_n[0], rpy)
    attitude = np.array([1.0, 1.0, claimed_deg]) * units.DEG
    initial = InitialState.from_sigmas(
        nav, prepared.layout, attitude=attitude, velocity=[0.1] * 3, position=[0.02, 0.02, 0.04]
    )
    return replace(prepared, initial=initial)


def heading_off(prepared, drive):
    nav = prepared.initial.nav
    return float(frames.wrap_angle(nav.rpy_nb[2] - drive.reference.at(np.array([nav.t])).rpy_nb[0, 2])) / units.DEG


@pytest.mark.parametrize("off", [15.0, -15.0])
def test_a_start_that_is_off_is_smoothed(drive, off):
    wrong = started(drive, off, 8.0)
    right = with_smoothed_start(wrong)
    assert abs(heading_off(wrong, drive)) == pytest.approx(15.0, abs=0.1)
    assert abs(heading_off(right, drive)) < 2.0  # statistical: its 1-sigma is 0.6 deg
    assert np.all(np.diag(right.initial.P) <= np.diag(wrong.initial.P) * (1.0 + 1e-9))


@pytest.mark.campaign
def test_noise_is_that_of_the_log_wherever_the_start_is_off(drive):
    one, other = (tune(started(drive, off, 8.0)) for off in (12.0, -12.0))
    assert one.better
    assert other.better
    assert "position" not in one.factors  # right as stated
    for name in ("gyro", "accel", "height"):
        low, high = one.intervals[name]
        assert low < other.factors[name] < high
        # a tenth of the width of the interval, which is statistical
        assert abs(np.log(other.factors[name] / one.factors[name])) < 0.1 * np.log(high / low), name


@pytest.mark.campaign
def test_noise_does_not_hang_on_last_bits(drive):
    imu = drive.need_imu()
    rng = np.random.default_rng(1)
    turned = replace(imu, gyro=imu.gyro * (1.0 + 1e-12 * rng.standard_normal(imu.gyro.shape)))
    one, other = (tune(prepared_run(log, config())) for log in (drive, replace(drive, imu=turned)))
    for name, factor in one.factors.items():
        assert other.factors[name] == pytest.approx(factor, rel=1e-3)  # rounding, grown by a search


def test_a_start_is_kept_unless_fixes_refute_it(drive):
    tuned = {"gyro": 10.0, "accel": 10.0, "accel_down": 10.0}
    right = with_factors(started(drive, 2.0, 3.0), tuned)
    kept, notes = unless_refuted(right)
    assert kept is right
    assert not notes
    wrong = with_factors(started(drive, 25.0, 3.0), tuned)
    other, (note,) = unless_refuted(wrong)
    assert "refute the start" in note
    # statistical: four of its own 1-sigma, a fifth of which smoothing leaves
    assert abs(heading_off(other, drive)) * units.DEG < 4.0 * np.sqrt(other.initial.P[2, 2])
    assert other.initial.P[2, 2] < wrong.initial.P[2, 2]


def test_expected_gain_is_that_of_linear_measurements():
    """Evidence of a linear state in closed form: what the smoothed start gains beyond what the right one is off."""
    rng = np.random.default_rng(3)
    n, m = 4, 12
    H, B = rng.standard_normal((m, n)), rng.standard_normal((n, n))
    P, L = B @ B.T + np.diag([0.1, 0.1, 1.0, 100.0]), H.T @ H  # noise of unit variance
    smoothed = np.linalg.inv(np.linalg.inv(P) + L)
    narrow = np.linalg.inv(np.linalg.inv(P) + np.linalg.inv(25.0 * smoothed))

    def log_evidence(y, mean, cov):
        S, r = H @ cov @ H.T + np.eye(m), y - H @ mean
        return -0.5 * (r @ np.linalg.solve(S, r) + np.linalg.slogdet(S)[1])

    y = H @ rng.multivariate_normal(np.zeros(n), P) + rng.standard_normal(m)
    mean = smoothed @ H.T @ y
    off = np.linalg.solve(P, mean)  # of the start at zero from the best state
    won = log_evidence(y, mean, narrow) - log_evidence(y, np.zeros(n), P)
    error = 0.5 * (mean @ off + off @ np.linalg.solve(np.linalg.inv(narrow) + L, off))
    assert won - error == pytest.approx(expected_gain(P, narrow), abs=1e-8)  # rounding
    assert abs(expected_gain(P, P)) < 1e-9  # rounding: fixes that say nothing


def test_noise_that_is_too_small_does_not_refute_a_start(drive):
    right = started(drive, 2.0, 3.0)  # a tenth of the noise there is
    kept, notes = unless_refuted(right)
    assert kept is right
    assert not notes


@pytest.mark.parametrize("imu", [{"catalogue": "MPU-6000"}, STATED])
def test_a_log_too_short_to_tune_is_begun_anew_too(drive, imu, monkeypatch):
    wrong = with_factors(started(drive, 60.0, 20.0), {"gyro": 10.0, "accel": 10.0, "accel_down": 10.0})
    t = wrong.initial.nav.t
    every_third = (wrong.schedule.t < t + 27.0) & (np.arange(len(wrong.schedule)) % 3 == 0)
    short = replace(
        wrong, increments=wrong.increments.between(t - 1e-9, t + 27.0), schedule=wrong.schedule.where(every_third),
        headings=None,
    )  # fmt: skip
    assert too_few(short)
    monkeypatch.setattr("schuler.navigation.run.prepared_run", lambda *_, **__: short)
    notes = navigate(drive, {"imu": dict(imu), "filter": {"smooth": False}}).notes
    # noise stated by hand stays, and what it makes of the log
    assert any("refute the start" in note for note in notes) == (imu is not STATED)


@pytest.mark.campaign
def test_a_given_attitude_is_never_replaced(drive):
    rpy = drive.reference.rpy_nb[0] / units.DEG + (0.0, 0.0, 40.0)
    given = {"method": "given", "rpy_deg": rpy.tolist(), "sigma_deg": [1.0, 1.0, 3.0]}
    result = navigate(drive, {"imu": dict(STATED), "alignment": given, "filter": {"smooth": False, "tune": True}})
    assert not any("refute the start" in note for note in result.notes)


def residuals(won):
    """Innovations of unit variance in stretches of the log, whose negative log likelihoods are those given."""
    t = np.arange(float(30 * len(won)))
    y = np.zeros((len(t), 3))
    y[15::30, 0] = np.sqrt(2.0 * np.asarray(won))
    ones = np.ones((len(t), 3))
    return Residuals(t, np.zeros(len(t), dtype=np.int64), np.ones(len(t)), y, 1e3 * ones, ones)


@pytest.mark.parametrize(
    ("won", "is_proven"),
    [
        ([400.0, 90.0, 60.0, 80.0, 20.0], True),  # all win; the sum alone is only 1.8 standard errors
        ([400.0, 0.0, 0.0, 0.0, 0.0], False),  # one stretch
        ([1.5, 1.0, 1.5, 1.0, 1.5], False),  # sure, and less than 8
        ([3.0, 2.5, 3.0, 2.0, 3.0], True),
    ],
)
def test_what_is_won_in_one_stretch_proves_nothing(won, is_proven):
    after = residuals(np.zeros(len(won)))
    before = replace(after, innovation=residuals(won).innovation * np.sqrt(1e3 * 0.999))
    assert proven(before, after) == is_proven


def test_a_run_that_diverges_while_it_is_smoothed_leaves_the_start(drive, monkeypatch):
    prepared, run = prepared_run(drive, config()), PreparedRun.run

    def diverging(self, **given):
        if self.options.smoother:
            raise DivergenceError("the filter diverged")
        return run(self, **given)

    assert with_smoothed_start(prepared) is not prepared
    monkeypatch.setattr(PreparedRun, "run", diverging)
    assert with_smoothed_start(prepared) is prepared
