"""Noise tuned from a log's own fixes: found where it is mis-stated, left where it is right, written and read again."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from schuler import units
from schuler.cli import main
from schuler.exceptions import InputError, TomlError
from schuler.filtering.measurements import POSITION, VELOCITY
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.inputs.imu_noise import NO_NOISE, NOISIER
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.start.heading import HEADING_CONTRADICTED
from schuler.navigation.tuning.automatic import STATED_NOISE, noise_is_open
from schuler.navigation.tuning.entries import tuned_configuration, tuned_entries
from schuler.navigation.tuning.lever import LEVER_ESTIMATED
from schuler.navigation.tuning.likelihood import HORIZONS, Residuals, halves, residuals_of, trials
from schuler.navigation.tuning.noise import TUNING_KINDS, terms_of, vertical_axis, with_factors
from schuler.navigation.tuning.slow import SlowError, with_slow_error
from schuler.navigation.tuning.slow_search import ASKED, SHOWS, slow_lead
from schuler.navigation.tuning.tuning import Tuning, contradicted, slow_error_left, tune
from schuler.recording.io import write
from schuler.rotation import dcm_from_rpy
from schuler.simulation.scenario import prepare_mission, simulate_mission
from schuler.toml import toml_with

IMU = {
    "gyro": {"arw_deg_rthr": 5.0, "bias_deg_hr": 100.0, "in_run_deg_hr": 20.0, "in_run_time_s": 300.0},
    "accel": {"vrw_m_s_rthr": 3.0, "bias_mg": 3.0, "in_run_mg": 0.3, "in_run_time_s": 300.0},
}
CORNERS = [(0, 0, 10), (200, -30, 12), (330, 120, 9), (200, 330, 13), (-60, 300, 10), (-150, 50, 12), (0, 0, 11)]
POINTS: list[dict[str, float]] = [
    {"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} | ({} if i else {"stop_s": 15.0})
    for i, (n, e, v) in enumerate(CORNERS)
]


#: Round small blocks, now fast, now slowly: a lever arm shows where turns are sharp.
BLOCKS: list[dict[str, float]] = [
    {"north_m": n, "east_m": e, "speed_m_s": 2.0 + 1.0 * (i % 3)} | ({} if i else {"stop_s": 15.0})
    for i, (n, e) in enumerate(
        [(0.0, 0.0), *[(20.0, 0.0), (20.0, 15.0), (45.0, 15.0), (45.0, -10.0), (0.0, -10.0), (0.0, 0.0)] * 3]
    )
]


def recorded(seed=1, imu=None, points=POINTS, rate_hz=50.0, **gnss):
    mission = prepare_mission(
        {
            "seed": seed,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": points},
            "imu": {"rate_hz": rate_hz, "kind": "increment", **(imu or IMU)},
            "gnss": {"rate_hz": 1.0, "sigma_position_m": [0.3, 0.3, 0.5], "sigma_velocity_m_s": [0.05] * 3} | gnss,
        }
    )
    return simulate_mission(mission).recording


def config(**filter_):
    return NavigationConfig.checked({"imu": dict(IMU), "filter": {"smooth": False, **filter_}})


@pytest.fixture(scope="module")
def recording():
    return recorded()


def mis_stated(recording, imu=1.0, gnss=1.0):
    """The configuration and the log with sigmas stated so many times too small."""
    g = recording.need_gnss()
    stated = replace(g, cov_r_n=g.cov_r_n / gnss**2, cov_v_n=g.cov_v_n / gnss**2)
    sheet = {
        "gyro": {**IMU["gyro"], "arw_deg_rthr": IMU["gyro"]["arw_deg_rthr"] / imu},
        "accel": {**IMU["accel"], "vrw_m_s_rthr": IMU["accel"]["vrw_m_s_rthr"] / imu},
    }
    return replace(recording, gnss=stated), NavigationConfig.checked(
        {"imu": sheet, "filter": {"smooth": False, "tune": True}}
    )


# --- mis-stated by ten, either way; the interval is 95 % (statistical), widened by a fifth for ten looks at it


@pytest.mark.parametrize(("imu", "gnss"), [(10.0, 1.0), (0.1, 1.0), (1.0, 10.0), (1.0, 0.1)])
@pytest.mark.thinned(2)
def test_noise_mis_stated_by_ten_is_found_and_the_fixes_fit_again(recording, imu, gnss):
    log, wrong = mis_stated(recording, imu, gnss)
    as_stated = navigate(log, wrong.untuned())
    tuning = tune(prepared_run(log, wrong))
    result = navigate(log, tuned_configuration(wrong, tuning))
    assert tuning.better
    assert tuning.gain > 2.0 * tuning.gain_sigma
    names = ("position", "velocity") if imu == 1.0 else ("gyro", "accel", "position", "velocity")
    for name, truth in zip(names, (gnss, gnss) if imu == 1.0 else (imu, imu, 1.0, 1.0), strict=True):
        low, high = tuning.intervals[name]
        assert low / 1.2 < truth < high * 1.2, (name, tuning.factors[name], low, high)
    before, after = as_stated.innovations.mean_nis(), result.innovations.mean_nis()
    assert abs(np.log(before)) > 2.0 * abs(np.log(after))
    assert 0.8 < after < 1.25  # 1 +- 0.05 (statistical), and what tuning leaves
    assert contradicted(prepared_run(log, wrong))


def test_a_consistent_run_stays_exactly_as_it_is(recording):
    own, plain = navigate(recording, config(tune="auto")), navigate(recording, config(tune=False))
    np.testing.assert_array_equal(own.covariance_e, plain.covariance_e)
    assert own.notes == plain.notes
    prepared = prepared_run(recording, config())
    assert not contradicted(prepared)


def test_noise_of_a_grade_is_no_word_on_this_unit_and_is_tuned_where_there_are_fixes_enough(recording):
    def is_open(log=recording, **sections):
        config = NavigationConfig.checked({"imu": {"catalogue": "consumer"}, **sections})
        prepared = prepared_run(log, config)
        assert not contradicted(prepared)
        return noise_is_open(config, prepared)

    assert is_open()
    assert not is_open(recording.between(recording.start, recording.start + 30.0))  # too few fixes
    assert not is_open(gnss={"sigma_scale": 1.0})  # said by hand
    assert not noise_is_open(config(), prepared_run(recording, config()))  # a sheet


@pytest.mark.campaign
def test_an_unstated_lever_arm_is_found_beside_the_noise_of_a_grade():
    log = recorded(6, {"catalogue": "consumer"}, BLOCKS, lever_arm_m=[1.0, 0.3, -1.0])
    config = NavigationConfig.checked({"imu": {"catalogue": "consumer"}})
    assert not contradicted(prepared_run(log, config))
    assert LEVER_ESTIMATED in navigate(log, config).notes


def test_noise_that_is_wrong_in_one_stretch_contradicts(recording):
    """Stretches that differ are no excuse where all of the log is clearly off."""
    imu = recording.need_imu()
    shaken = (imu.t > 60.0) & (imu.t < 85.0)
    noise = 8.0 * np.sqrt(imu.interval) * IMU["accel"]["vrw_m_s_rthr"] / 60.0  # of increments
    shake = np.where(shaken[:, None], noise * np.random.default_rng(2).standard_normal(imu.accel.shape), 0.0)
    assert contradicted(prepared_run(replace(recording, imu=replace(imu, accel=imu.accel + shake)), config()))


@pytest.mark.campaign
def test_noise_stated_by_hand_stays_and_a_part_by_name_is_tuned(recording):
    log, wrong = mis_stated(recording, gnss=0.1)
    own = navigate(log, NavigationConfig.checked({"imu": wrong.imu.model_dump(include={"gyro", "accel"})}))
    assert STATED_NOISE in own.notes
    assert not any("noise tuned from" in note for note in own.notes)
    by_name = navigate(log, {"imu": {"catalogue": "consumer"}})
    assert any("noise tuned from" in note for note in by_name.notes)
    assert STATED_NOISE not in by_name.notes


def test_what_held_back_fixes_do_not_bear_out_is_refused(recording):
    asked, plain = navigate(recording, config(tune=True)), navigate(recording, config(tune=False))
    np.testing.assert_array_equal(asked.trajectory.r_eb_e, plain.trajectory.r_eb_e)
    assert any("no better than configured and is not used" in note for note in asked.notes)


@pytest.mark.campaign
def test_noise_that_the_log_scatters_by_is_believed_however_much_it_is(recording):
    log, wrong = mis_stated(recording, imu=200.0)
    result = navigate(log, wrong)
    assert any("noise tuned from" in note for note in result.notes)
    assert not any(note.startswith(NO_NOISE) for note in result.notes)
    assert any(remark.startswith(NOISIER) for remark in result.verdict.remarks)
    right = navigate(recording, mis_stated(recording)[1].untuned())
    apart = np.linalg.norm(result.trajectory.r_eb_e - right.trajectory.r_eb_e, axis=1)
    assert np.median(apart) < 0.5 * np.sqrt(np.trace(right.covariance[-1, 6:9, 6:9]))  # seen 0.03 of 0.23 m


@pytest.mark.campaign
def test_noise_that_the_log_does_not_scatter_by_is_another_motion_and_the_run_is_doubted():
    """Gyroscopes of the wrong sign."""
    quiet = {
        "gyro": {**IMU["gyro"], "arw_deg_rthr": IMU["gyro"]["arw_deg_rthr"] / 30.0},
        "accel": {**IMU["accel"], "vrw_m_s_rthr": IMU["accel"]["vrw_m_s_rthr"] / 30.0},
    }
    log = recorded(imu=quiet)
    imu = log.need_imu()
    result = navigate(
        replace(log, imu=replace(imu, gyro=-imu.gyro)), {"imu": quiet, "filter": {"smooth": False, "tune": True}}
    )
    assert any(note.startswith(NO_NOISE) for note in result.notes)
    assert not any("noise tuned from" in note for note in result.notes)
    assert result.verdict.status != "ok"
    assert any(reason.startswith(NO_NOISE) for reason in result.verdict.reasons)


WIDER = [pytest.param(deg, abs(deg) > 4, marks=pytest.mark.campaign) for deg in (2, -4, 20, 40, -40, 90, -150)]


@pytest.mark.parametrize(("off_deg", "doubted"), [(0, False), (-20, True), *WIDER])
def test_a_given_heading_that_the_log_contradicts_is_doubted(recording, off_deg, doubted):
    """Tuning makes noise of a heading 20 deg off, and of one 150 deg off; the likelihood of others tells it before.

    With a budget that states its biases; those typical of a grade (3 deg/s, 50 mg) explain one 40 deg to the left too.
    """
    at = recording.need_reference().at(recording.need_imu().t[:1] + 0.02)
    rpy = at.rpy_nb[0] / units.DEG + [0.0, 0.0, off_deg]
    result = navigate(
        recording,
        {
            "imu": {"catalogue": "flenniken-consumer"},
            "alignment": {"method": "given", "rpy_deg": [*rpy[:2], float((rpy[2] + 180.0) % 360.0 - 180.0)]},
            "filter": {"smooth": False},
        },
    )
    assert any(note.startswith(HEADING_CONTRADICTED) for note in result.notes) == doubted
    assert not doubted or any(reason.startswith(HEADING_CONTRADICTED) for reason in result.verdict.reasons)


def test_too_few_fixes_are_refused_with_their_number(recording):
    few = replace(recording, gnss=recording.need_gnss().where(np.arange(0, 36, 2)))
    with pytest.raises(InputError, match="needs at least 20 GNSS fixes"):
        tune(prepared_run(few, config()))
    assert not contradicted(prepared_run(*mis_stated(few, gnss=10.0)))


@pytest.mark.campaign
@pytest.mark.parametrize("imu", [10.0, 0.1])
def test_intervals_cover_what_they_claim(imu):
    """95 % of the intervals hold the truth, as many miss it as chance allows with probability 0.998 (statistical)."""
    missed = counted = 0
    for seed in range(12):
        tuning = tune(prepared_run(*mis_stated(recorded(seed), imu)))
        for name, truth in (("accel", imu), ("position", 1.0), ("velocity", 1.0)):
            if name != "accel" and name not in tuning.intervals:
                continue  # a sigma of fixes that the log does not exclude stays as stated
            low, high = tuning.intervals[name]
            missed, counted = missed + (not low < truth < high), counted + 1
    assert missed <= binom.ppf(0.998, counted, 0.05)


# --- slow errors of positions and of ranges


def slow_drift(seed, sigma, tau):
    return recorded(seed, rate_hz=20.0, drift_position_m=[sigma] * 3, drift_time_s=tau)


def position_nees(result, log):
    _, dx, P = state_errors(result, log.need_reference())
    return float(
        np.mean(np.einsum("ki,ki->k", dx[:, 6:9], np.linalg.solve(P[:, 6:9, 6:9], dx[:, 6:9, None])[:, :, 0]) / 3)
    )


@pytest.mark.campaign
@pytest.mark.parametrize(("seed", "tau"), [(4, 60.0), (2, 20.0)])
def test_a_slow_error_of_fixes_is_recognised_and_gets_its_states(seed, tau):
    log = slow_drift(seed, 2.0, tau)
    plain, result = navigate(log, config(tune=False)), navigate(log, config(tune=True))
    assert any(note.startswith("GNSS positions have a slow error") for note in result.notes)
    assert "b_r" in result.layout
    # one error of a minute in a log of minutes: few degrees of freedom (statistical)
    assert position_nees(plain, log) > 10.0
    assert 0.02 < position_nees(result, log) < 4.0


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.thinned(2)
def test_white_errors_of_fixes_are_not_taken_for_slow_ones(seed):
    tuning = tune(prepared_run(recorded(seed), config()))
    assert tuning.slow == {}


@pytest.mark.campaign
def test_a_slow_error_beside_noise_that_is_stated_by_hand_is_doubted():
    """Law: the solution stays to the last bit, and a position many sigmas off is not ok."""
    log = slow_drift(5, 2.0, 60.0)
    plain, result = navigate(log, config(tune=False)), navigate(log, config(tune="auto"))
    np.testing.assert_array_equal(result.covariance_e, plain.covariance_e)
    assert position_nees(result, log) > 10.0
    assert result.verdict.status == "doubtful"
    assert any("gnss.correlated" in cause for cause in result.verdict.causes)
    assert STATED_NOISE in result.notes


@pytest.mark.parametrize("seed", [2, 4, pytest.param(6, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("worse", [1.0, 5.0])
def test_white_fixes_and_a_noisy_imu_show_no_slow_error(seed, worse):
    """Law: beside the right white noise a slow error is no likelier (statistical: 1.1 was the most of 64 drives)."""
    log, wrong = mis_stated(recorded(seed), imu=worse)
    prepared = prepared_run(log, wrong)
    assert slow_lead(prepared, np.isin(prepared.schedule.kind, TUNING_KINDS)) < ASKED


def test_a_slow_error_that_is_likely_but_not_proven_is_doubted(recording):
    result = navigate(recording, config(tune=False))
    doubted = replace(result, notes=(*result.notes, *slow_error_left(SHOWS + 1.0))).verdict
    assert doubted.status == "doubtful"
    assert "slow error" in doubted.reasons[0]
    assert "gnss.correlated" in doubted.causes[0]
    assert not slow_error_left(SHOWS)


def test_a_slow_error_added_is_that_of_the_configuration(recording):
    """The start from a fix has the fix's slow error in it, to rounding; scaled as well as configured larger."""
    added = with_slow_error(prepared_run(recording, config()), SlowError(1.0, 60.0))
    added = with_factors(added, {"slow": 2.0})
    slow = {"position_sigma_m": 2.0, "position_tau_s": 60.0}
    data = {"imu": dict(IMU), "filter": {"smooth": False}, "gnss": {"correlated": slow}}
    given = prepared_run(recording, NavigationConfig.checked(data))
    assert added.layout.models == given.layout.models
    np.testing.assert_allclose(added.initial.P, given.initial.P, rtol=1e-9, atol=1e-12)


@pytest.mark.campaign
def test_a_given_start_is_tuned_without_states_it_does_not_have():
    log = slow_drift(4, 2.0, 60.0)
    start = prepared_run(log, config()).initial
    result = navigate(log, config(tune=True), initial=start)
    assert "b_r" not in result.layout
    assert "lever" not in result.layout


# --- the lever arm of an antenna that nobody stated


@pytest.mark.campaign
@pytest.mark.parametrize("lever", [(0.6, -0.4, -0.8), (-0.7, 0.5, 0.3)])
def test_a_lever_arm_that_nobody_stated_is_estimated(lever):
    imu = {"gyro": {**IMU["gyro"], "arw_deg_rthr": 0.3}, "accel": {**IMU["accel"], "vrw_m_s_rthr": 0.1}}
    log = recorded(1, imu, BLOCKS, 20.0, lever_arm_m=list(lever), sigma_position_m=[0.02, 0.02, 0.04])
    asked = {"imu": imu, "filter": {"smooth": False, "tune": True}}
    result = navigate(log, asked)
    assert LEVER_ESTIMATED in result.notes
    error = result.parameter("lever")[-1] - np.array(lever)
    assert np.all(np.abs(error) < 4.0 * result.sigma("lever")[-1])  # statistical
    assert np.all(np.abs(error[:2]) < 0.1)  # down trades against height on level ground


@pytest.mark.campaign
def test_a_lever_arm_that_is_stated_is_not_estimated():
    lever = [0.6, -0.4, -0.8]
    log = recorded(1, IMU, BLOCKS, lever_arm_m=lever, sigma_position_m=[0.02, 0.02, 0.04])
    asked = {"imu": IMU, "filter": {"smooth": False, "tune": True}, "gnss": {"lever_arm_m": lever}}
    assert LEVER_ESTIMATED not in navigate(log, asked).notes


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.thinned(2)
def test_an_antenna_at_the_imu_stays_there(seed):
    log, wrong = mis_stated(recorded(seed, points=BLOCKS, sigma_position_m=[0.02, 0.02, 0.04]), imu=10.0)
    result = navigate(log, wrong)
    assert any("noise tuned from" in note for note in result.notes)
    assert LEVER_ESTIMATED not in result.notes
    assert "lever" not in result.layout


# --- the likelihood


def test_half_of_the_fixes_and_the_fixes_between(recording):
    schedule = prepared_run(recording, config()).schedule
    one, other = halves(schedule, np.ones(len(schedule), dtype=bool))
    assert not np.any(one & other)
    assert np.all(one | other)
    for kind in (POSITION, VELOCITY):
        t = schedule.t[schedule.kind == kind]
        assert np.array_equal(schedule.t[one & (schedule.kind == kind)], t[::2])


def test_fixes_that_judge_are_not_used(recording):
    prepared = prepared_run(recording, config())
    one, other = halves(prepared.schedule, np.ones(len(prepared.schedule), dtype=bool))
    without = replace(prepared, schedule=prepared.schedule.where(one)).run()
    sets = trials(prepared, one, other)
    assert {trial.horizon for trial in sets} == {4.0, 15.0} | {HORIZONS[0][0]}
    judged = residuals_of(sets[:1])(prepared)
    first = judged.t[0]
    k = int(np.searchsorted(without.rec_t, first))
    assert np.all(judged.weight > 0.0)
    # the same covariance as a run that never saw the other half: the claimed sigma grows between fixes
    assert np.all(np.sqrt(judged.variance[judged.kind == POSITION]) > 0.3)
    assert k > 0


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_capped_score_is_least_at_the_true_sigma(scale):
    z = np.random.default_rng(3).standard_normal((20_000, 3))
    ones = np.ones_like(z)

    def score(sigma):
        r = Residuals(np.arange(len(z)), np.full(len(z), POSITION), ones[:, 0], z, sigma**2 * ones, ones)
        return float(r.scores().sum())

    assert score(1.0) < min(score(scale), score(1.05), score(0.95))  # 1 % is its standard error here


def test_an_outlier_moves_the_score_no_more_than_a_few_fixes():
    z = np.zeros((2, 3))
    z[0, 0], z[1, 0] = 4.0, 4000.0
    ones = np.ones_like(z)
    score = Residuals(np.arange(2.0), np.full(2, POSITION), ones[:, 0], z, ones, ones).scores()
    assert score[1] < 15.0 * score[0]


def test_factors_act_on_what_they_name(recording):
    prepared = prepared_run(recording, config())
    assert terms_of(prepared) == (
        "gyro", "accel", "accel_down", "gyro_bias", "accel_bias", "position", "height", "velocity", "climb",
    )  # fmt: skip
    changed = with_factors(prepared, {"accel": 3.0, "height": 2.0, "gyro_bias": 5.0})
    np.testing.assert_allclose(changed.psd[1], np.array([9.0, 9.0, 1.0]) * prepared.psd[1])
    np.testing.assert_array_equal(changed.psd[0], prepared.psd[0])
    at = prepared.schedule.kind == POSITION
    ratio = np.sqrt(np.einsum("nii->ni", changed.schedule.R) / np.einsum("nii->ni", prepared.schedule.R))
    np.testing.assert_allclose(ratio[at], np.broadcast_to([1.0, 1.0, 2.0], ratio[at].shape))
    np.testing.assert_allclose(ratio[~at], 1.0)
    assert changed.layout.models["b_g"].noise == pytest.approx(5.0 * prepared.layout.models["b_g"].noise)


@pytest.mark.parametrize(
    ("mounted", "expected"), [((0.0, 90.0, 0.0), [4.0, 9.0, 9.0]), ((90.0, 0.0, 0.0), [9.0, 4.0, 9.0])]
)
def test_the_accelerometer_with_gravity_is_tuned_by_itself(recording, mounted, expected):
    """However the IMU is mounted; entries of a configuration are by its axes."""
    C = dcm_from_rpy(np.radians(mounted))
    turned = prepared_run(replace(recording, imu=recording.need_imu().rotated(C)), config())
    changed = with_factors(turned, {"accel": 3.0, "accel_down": 2.0})
    np.testing.assert_allclose(changed.psd[1], np.array(expected) * turned.psd[1])
    factors = {"accel": 3.0, "accel_down": 2.0}
    tuning = Tuning(factors, {}, True, 9.0, 1.0, {}, {}, 40, vertical=vertical_axis(turned.imu))
    assert tuned_entries(config(), tuning)["filter"]["noise"]["accel"] == np.sqrt(expected).tolist()


# --- the file


@pytest.mark.campaign
def test_what_is_written_and_read_again_gives_the_same_run(recording, tmp_path, capsys):
    log, wrong = mis_stated(recording, gnss=10.0)
    write(log, tmp_path / "log.parquet")
    sheets = "\n".join(
        f"[imu.{name}]\n" + "\n".join(f"{key} = {value}" for key, value in sheet.items()) for name, sheet in IMU.items()
    )
    text = f"# mine\n{sheets}\n[filter]\nsmooth = false  # quick\ntune = true\n"
    (tmp_path / "drive.toml").write_text(text, encoding="utf-8")
    call = ["tune", str(tmp_path / "log.parquet"), "--config", str(tmp_path / "drive.toml"), "--unchecked", "--json"]
    assert main(call) == 0
    printed = json.loads(capsys.readouterr().out)
    written = (tmp_path / "drive.toml").read_text(encoding="utf-8")
    assert written.startswith("# mine\n")
    assert "smooth = false  # quick" in written
    assert "schuler tune: " in written
    assert printed["better"]
    tuned = NavigationConfig.load(tmp_path / "drive.toml")
    tuning = tune(prepared_run(log, wrong))
    assert tuned == tuned_configuration(wrong, tuning)
    run = navigate(log, wrong)
    assert any("noise tuned" in note for note in run.notes)
    np.testing.assert_array_equal(navigate(log, tuned).trajectory.r_eb_e, run.trajectory.r_eb_e)


def test_entries_are_put_in_line_by_line():
    text = "# top\n[a]\nx = 1  # old\n\n# about b\n[b]\ny = [1, 2]\n"
    new = toml_with(text, {"a": {"x": 2, "n": {"z": 0.5}}, "b": {"t": False}}, {"a.x": "why"})
    assert new == "# top\n[a]\nx = 2  # why\n\n# about b\n[b]\ny = [1, 2]\nt = false\n\n[a.n]\nz = 0.5\n"
    assert tomllib.loads(new) == {"a": {"x": 2, "n": {"z": 0.5}}, "b": {"y": [1, 2], "t": False}}


def test_entries_in_no_section_stand_before_all_sections():
    new = toml_with("a = 1\n\n# about b\n[b]\ny = 2\n", {"a": 3, "d": ["p @ q"], "b": {"y": [{"u": 1.0}]}})
    assert new == 'a = 3\nd = ["p @ q"]\n\n# about b\n[b]\ny = [{u = 1.0}]\n'
    assert tomllib.loads(new) == {"a": 3, "d": ["p @ q"], "b": {"y": [{"u": 1.0}]}}


@pytest.mark.parametrize("text", ["[a]\nn = { z = 1.0 }\n", "a.n.z = 1.0\n", "[a.n]\nz = [\n 1,\n 2,\n]\n"])
def test_entries_that_cannot_be_put_in_are_shown(text):
    with pytest.raises(TomlError, match=r"put these in their place:\n\[a\.n\]\nz = 0\.5"):
        toml_with(text, {"a": {"n": {"z": 0.5}}})
