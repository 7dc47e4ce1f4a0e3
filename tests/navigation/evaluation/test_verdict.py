"""Verdicts on runs: right models are believed, planted wrecks are not, and no reference is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, FORCED, POSITION, REJECTED
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.evidence import slow_nis
from schuler.navigation.evaluation.verdict import Verdict
from schuler.navigation.inputs.gnss_faults import rejections
from schuler.navigation.inputs.imu_axes import AGAINST_COURSE, AXES_UNCERTAIN, against_course
from schuler.navigation.inputs.imu_noise import NOISIER, noise_against_budget
from schuler.navigation.result import Innovations
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec
from schuler.simulation.scenario import prepare_mission, simulate_mission

IMU = {
    "gyro": {"arw_deg_rthr": 0.2, "bias_deg_hr": 100.0, "in_run_deg_hr": 5.0, "in_run_time_s": 600.0},
    "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 3.0, "in_run_mg": 0.05, "in_run_time_s": 600.0},
}
LEVER = [0.7, 0.1, -1.0]
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 25.0},
    {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0, "stop_s": 10.0},
    {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
    {"north_m": -60.0, "east_m": 300.0, "speed_m_s": 10.0},
    {"north_m": -150.0, "east_m": 50.0, "speed_m_s": 12.0},
]


def drive(seed=1, **gnss):
    mission = {
        "seed": seed,
        "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
        "imu": {"rate_hz": 50.0, "kind": "rate", **IMU},
        "gnss": {"rate_hz": 1.0, "first_s": 0.37, "lever_arm_m": LEVER, **gnss},
    }
    return simulate_mission(prepare_mission(mission)).recording


def config(**sections):
    data = {"imu": dict(IMU), "gnss": {"lever_arm_m": LEVER}, "filter": {"smooth": False}}
    for name, section in sections.items():
        data[name] = {**data.get(name, {}), **section}
    return data


@pytest.fixture(scope="module")
def recording():
    return drive()


def with_imu(recording, gyro, accel):
    imu = recording.imu
    return replace(recording, imu=replace(imu, gyro=imu.gyro * gyro, accel=imu.accel * accel))


def with_gnss(recording, **series):
    return replace(recording, gnss=replace(recording.gnss, **series))


def displaced(recording, north):
    llh = recording.gnss.llh.copy()
    llh[:, 0] += north / 6.37e6
    return with_gnss(recording, llh=llh)


SMALL = {"gyro": {"arw_deg_rthr": 0.002, "bias_deg_hr": 1.0}, "accel": {"vrw_m_s_rthr": 0.0005, "bias_mg": 0.03}}
GIVEN = {"method": "given", "rpy_deg": [0.0, 0.0, 171.5]}  # the drive leaves towards -8.5 deg


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    "sections",
    [{}, {"outages": {"every_s": 60.0, "length_s": 20.0}}, {"aiding": {"non_holonomic": {}, "zero_velocity": {}}}],
    ids=["plain", "outages", "wheels"],
)
def test_a_run_with_right_models_is_ok(seed, sections):
    # statistical: of 480 such runs none was doubtful
    assert navigate(drive(seed), config(**sections)).verdict.status == "ok"


UNTUNED = {"filter": {"tune": False}}
WRECKS = {
    "gyro sign": (lambda r: with_imu(r, [1, 1, -1], 1.0), {}, "failed", "axes or mounting"),
    "gyro sign, by the course": (lambda r: with_imu(r, -1.0, 1.0), {}, None, "turns against the course of the fixes"),
    "upside down": (lambda r: with_imu(r, [1, -1, -1], [1, -1, -1]), {}, "doubtful", "axes or mounting"),
    "clock 1 s late": (lambda r: with_gnss(r, t=r.gnss.t + 1.0), UNTUNED, None, "clocks that differ"),
    "clock 1 s early": (lambda r: with_gnss(r, t=r.gnss.t - 1.0), UNTUNED, None, "clocks that differ"),
    "imu 100 times too good": (lambda r: r, {"imu": SMALL}, "failed", "budget of the IMU"),
    "gnss 100 times too good": (lambda r: r, {"gnss": {"sigma_scale": 0.01}}, None, "times too good"),
    "gnss 3 times too good": (lambda r: r, {"gnss": {"sigma_scale": 0.33}}, None, "times too good"),
    "start 180 deg wrong": (lambda r: r, {"alignment": GIVEN}, "failed", "heading at the start"),
    "gnss lies for a minute": (
        lambda r: displaced(r, 20.0 * (np.abs(r.gnss.t - r.gnss.t[0] - 120.0) < 30.0)), {}, None, "GNSS positions jump",
    ),
    "slow gnss errors": (
        lambda r: drive(drift_position_m=[3.0, 3.0, 5.0], drift_time_s=60.0), UNTUNED, "doubtful", "slow errors",
    ),
}  # fmt: skip


def test_an_imu_that_points_backwards_is_found_at_the_start(recording):
    """No wreck: the heading comes from accelerations, half a turn off the course."""
    result = navigate(with_imu(recording, [-1, -1, 1], [-1, -1, 1]), config())
    assert result.verdict.status == "ok"
    assert any("deg off it: the vehicle moved backwards" in note for note in result.notes)
    assert result.errors(recording.reference).rms_horizontal < 2.0  # 1.38 m; fixes of metres


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", WRECKS)
def test_a_planted_wreck_is_not_ok_and_its_cause_is_listed(recording, name):
    change, sections, status, cause = WRECKS[name]
    verdict = navigate(change(recording), config(**sections)).verdict
    assert verdict.status == status if status else verdict.status != "ok"
    assert any(cause in c for c in verdict.causes), verdict.summary()
    assert verdict.reasons


def test_gyroscopes_against_the_course_are_doubted_alone_and_are_the_likeliest_cause(recording):
    """A dense enough chain of good fixes carries a run whose gyroscope is reversed: nothing else in it says so."""
    assert against_course(recording.imu, recording.gnss) == []
    assert against_course(recording.imu, None) == []
    (note,) = against_course(with_imu(recording, [1, 1, -1], 1.0).imu, recording.gnss)
    assert note.startswith(AGAINST_COURSE)
    assert "about z" in note
    run = navigate(recording, config())
    verdict = replace(run, notes=(*run.notes, note)).verdict
    assert verdict.status == "doubtful"
    assert verdict.reasons == (note,)
    assert "turns against the course of the fixes" in verdict.causes[0]


@pytest.mark.campaign
def test_no_reference_is_asked(recording):
    alone = replace(recording, reference=None)
    change = {"gnss": {"sigma_scale": 0.01}}
    assert navigate(alone, config(**change)).verdict == navigate(recording, config(**change)).verdict


def test_a_verdict_has_text_and_a_dictionary():
    verdict = Verdict("failed", ("reason",), ("cause", "other"), ("remark",))
    assert verdict.summary().splitlines()[0] == "verdict: FAILED"
    assert "likely: cause" in verdict.summary()
    assert verdict.to_dict()["causes"] == ["cause", "other"]
    assert Verdict("ok").summary() == "verdict: OK, nothing contradicts the claims"


def innovations(values, sigma=1.0):
    n = len(values)
    return Innovations(
        np.arange(n, dtype=float), np.full(n, POSITION), np.full(n, ACCEPTED), (values**2).sum(axis=1) / sigma**2,
        values, np.full((n, 3), sigma),
    )  # fmt: skip


def test_means_of_innovations_are_one_if_white_and_grow_with_what_stays():
    z = np.random.default_rng(1).standard_normal((3000, 3))
    size, limit = slow_nis([z], 10)
    assert abs(size - 1.0) < 4.0 * np.sqrt(2.0 / 900)  # statistical: four standard errors of 900 degrees of freedom
    # a constant of half a sigma adds a quarter of the length to the mean square
    grown, _ = slow_nis([z + 0.5], 10)
    assert abs(grown - size - 2.5) < 0.3
    assert grown > limit
    assert slow_nis([z[:25]], 10) == (0.0, np.inf)


@pytest.mark.campaign
def test_an_aid_that_never_acted_is_a_remark(recording):
    imu = recording.imu
    rng = np.random.default_rng(3)
    shaken = replace(recording, imu=replace(imu, gyro=imu.gyro + 0.02 * rng.standard_normal(imu.gyro.shape)))
    moving = replace(shaken, gnss=shaken.gnss.where(shaken.gnss.t > 30.0))
    result = navigate(
        moving, config(aiding={"barometer": None} | {"fixes": {"t_s": [1.0], "llh_deg": [[47.0, 8.0, 400.0]]}})
    )
    assert any("aiding.fixes never acted" in remark for remark in result.verdict.remarks)


@pytest.mark.parametrize(
    ("factors", "status"),
    [((8.0, 1.0, 1.0), "ok"), ((32.0, 1.0, 1.0), "doubtful"), ((1.0, 2.0, 1.0), "ok"), ((1.0, 1.0, 4.0), "doubtful")],
)
def test_noise_that_the_run_enlarged_and_found_right_is_a_remark(recording, factors, status):
    none = np.empty(0)
    enlarged = rejections(none, none, none, np.empty((0, 3, 3)), tuple(f**2 for f in factors))
    run = navigate(recording, config())
    verdict = replace(run, notes=(*run.notes, *enlarged, f"{NOISIER}: angular rate 90 times")).verdict
    assert verdict.status == status
    assert all(any(note in text for text in (*verdict.remarks, *verdict.reasons)) for note in enlarged)


@pytest.mark.parametrize(
    ("moved_s", "sigmas", "status"), [(-0.2, 8.0, "doubtful"), (-0.2, 5.0, "ok"), (0.0, 8.0, "ok")]
)
def test_an_offset_that_the_run_looked_for_and_that_wanders_is_doubted(recording, moved_s, sigmas, status):
    """A constant of the clocks; one whose state was asked for has the limit of other parameters."""
    run = navigate(recording, config(gnss={"delay_sigma_s": 0.3}, filter={"tune": False}))
    at, K = run.layout["delay"].start - 9, len(run.t)
    wide, narrow = run.sigma("delay")[[K // 2, K - 1], 0]
    parameters = run.parameters.copy()
    parameters[:, at] = np.where(np.arange(K) > K // 2, sigmas * np.sqrt(wide**2 - narrow**2), 0.0)
    verdict = replace(run, parameters=parameters, provenance={**run.provenance, "fixes_moved_s": moved_s}).verdict
    assert verdict.status == status
    assert status == "ok" or "hardly tells an offset of GNSS stamps from a lever arm" in verdict.causes[0]


@pytest.mark.parametrize(("rejected", "status"), [(4, "ok"), (30, "doubtful")])
def test_a_moment_of_rejections_is_a_remark_and_a_tenth_of_the_fixes_is_not(recording, rejected, status):
    run = navigate(recording, config())
    inn = run.innovations
    own = np.flatnonzero((inn.kind == POSITION) & (inn.status == ACCEPTED))[40 : 41 + rejected]
    changed = inn.status.copy()
    changed[own[:-1]], changed[own[-1]] = REJECTED, FORCED
    assert replace(run, innovations=replace(inn, status=changed)).verdict.status == status


def test_noise_far_beyond_the_budget_is_noted_and_none_at_its_level(recording):
    assert noise_against_budget(recording.imu, imu_spec(NavigationConfig.checked(config()))) == []
    (note,) = noise_against_budget(recording.imu, imu_spec(NavigationConfig.checked(config(imu=SMALL))))
    assert note.startswith(NOISIER)


def with_variance(recording, rows, variance):
    cov = recording.gnss.cov_r_n.copy()
    cov[rows] = variance * np.eye(3)
    return replace(recording, gnss=replace(recording.gnss, cov_r_n=cov))


@pytest.mark.parametrize("variance", [1e8, 1.8e13, 1e30])
def test_fixes_that_state_no_accuracy_are_left_out(recording, variance):
    """2**32 mm is what receivers write for a position they do not have. Rounding of the record's ends only."""
    n = len(recording.gnss)
    rows = np.arange(n) % 3 == 1
    run = navigate(with_variance(recording, rows, variance), config())
    without = navigate(replace(recording, gnss=recording.gnss.where(~rows)), config())
    assert any(f"{rows.sum()} GNSS fixes left out that state a horizontal 1-sigma above 1000 m" in s for s in run.notes)
    np.testing.assert_array_equal(run.trajectory.r_eb_e, without.trajectory.r_eb_e)
    with pytest.raises(InputError, match="all GNSS fixes state a horizontal 1-sigma above 1000 m, at least "):
        navigate(with_variance(recording, slice(None), variance), config())


def test_a_height_and_a_velocity_of_unknown_accuracy_are_bounded(recording):
    cov_r, cov_v = recording.gnss.cov_r_n.copy(), np.tile(1e20 * np.eye(3), (len(recording.gnss), 1, 1))
    cov_r[:, 2, 2] = 1.8e13
    gnss = replace(recording.gnss, cov_r_n=cov_r, cov_v_n=cov_v)
    run = navigate(replace(recording, gnss=gnss), config())
    assert any("1-sigma of height was larger than 10000 m" in s for s in run.notes)
    assert any("1-sigma of velocity was larger than 1000 m/s" in s for s in run.notes)
    assert run.verdict.status != "failed"
    assert np.linalg.eigvalsh(run.covariance_e).min() > 0.0


@pytest.mark.parametrize("value", [-0.5, np.nan])
def test_a_square_that_is_negative_or_no_number_fails_the_run(recording, value):
    run = navigate(recording, config())
    assert run.verdict.status == "ok"
    inn = run.innovations
    nis = np.where(np.arange(len(inn)) == np.flatnonzero(inn.status == ACCEPTED)[5], value, inn.nis)
    broken = replace(run, innovations=replace(inn, nis=nis))
    assert broken.verdict.status == "failed"
    assert "the normalised square of 1 innovations is negative or no number" in broken.verdict.reasons[0]


def test_a_covariance_that_is_not_positive_fails_the_run(recording):
    run = navigate(recording, config())
    cov = run.covariance_e.copy()
    half = len(cov) // 2
    cov[half:, 0, 1] = cov[half:, 1, 0] = 1.5 * np.sqrt(cov[half:, 0, 0] * cov[half:, 1, 1])
    broken = replace(run, covariance_e=cov)
    assert broken.verdict.status == "failed"
    assert "covariances are not positive at" in broken.verdict.reasons[0]


@pytest.mark.parametrize("part", ["r_eb_e", "v_eb_e"])
def test_a_solution_where_nothing_can_be_fails_the_run(recording, part):
    """Finite numbers, covariances and innovations in order: a light-second away, or at 40 km/s."""
    run = navigate(recording, config())
    T = run.trajectory
    far = np.where(
        np.arange(len(T.t))[:, None] >= len(T.t) // 2, {"r_eb_e": 3e8, "v_eb_e": 4e4}[part], getattr(T, part)
    )
    broken = replace(run, trajectory=replace(T, **{part: far}))
    assert broken.verdict.status == "failed"
    assert f"which nothing does, from {T.t[len(T.t) // 2]:.1f} s on" in broken.verdict.reasons[0]


def test_resets_have_no_test_and_break_nothing(recording):
    run = navigate(recording, config(gnss={"coupling": "reset"}))
    assert not any("broke down" in reason for reason in run.verdict.reasons)


def test_a_run_that_a_few_measurements_tested_is_doubtful(recording):
    short = recording.between(recording.imu.t[0], recording.imu.t[0] + 33.0)
    late = config(alignment=GIVEN, gnss={"velocity": False}, outages={"windows_s": [[0.0, 27.0]]})
    verdict = navigate(short, late).verdict
    assert verdict.status == "doubtful"
    assert "too few to tell" in " ".join(verdict.reasons)


@pytest.mark.parametrize(("accel", "claimed"), [(0.05, False), (5e3, True)])
def test_a_claim_beyond_the_distance_between_fixes_is_doubtful(recording, accel, claimed):
    noisy = {"gyro": IMU["gyro"], "accel": {**IMU["accel"], "vrw_m_s_rthr": accel}}
    run = config(imu=noisy, filter={"tune": False}, gnss={"velocity": False})
    verdict = navigate(recording, run).verdict
    assert any("adds nothing" in reason for reason in verdict.reasons) == claimed


def test_poor_fixes_are_not_taken_for_a_poor_prediction(recording):
    """Innovations of fixes of 6 m are larger than the way between two; what the run predicts is not."""
    g, rng = recording.gnss, np.random.default_rng(4)
    r = frames.ecef_from_llh(g.llh) + 6.0 * rng.standard_normal((len(g), 3))
    cov = np.tile(36.0 * np.eye(3), (len(g), 1, 1))
    poor = replace(recording, gnss=replace(g, llh=frames.llh_from_ecef(r), cov_r_n=cov))
    assert not any("adds nothing" in reason for reason in navigate(poor, config()).verdict.reasons)


@pytest.mark.parametrize(("misalignment", "expected"), [(0.02, True), (1e-4, False)])
def test_axes_that_the_budget_hardly_knows_are_a_remark(recording, misalignment, expected):
    """A rotation of both triads shows in no measurement of this log, and 15 states know nothing of it."""
    imu = {triad: {**terms, "misalignment_mrad": 1e3 * misalignment} for triad, terms in IMU.items()}
    verdict = navigate(recording, config(imu=imu)).verdict
    assert verdict.status == "ok"
    assert any(remark.startswith(AXES_UNCERTAIN) for remark in verdict.remarks) == expected
