"""Navigation campaigns: honest where the filter knows the truth, alike in lanes and in the whole chain, and words."""

import pickle

import numpy as np
import pytest
from places import ROOT

from schuler.exceptions import ConfigError, InputError
from schuler.montecarlo import run_seed
from schuler.montecarlo.engine import campaign
from schuler.montecarlo.error_scatter import COMPONENTS, scatter
from schuler.montecarlo.fingerprint import fingerprint
from schuler.montecarlo.job import NavigationJob, StartSection, read_job
from schuler.montecarlo.navigation import lane_runs, navigation_run, runner
from schuler.units import DEG

MOTION = """
[simulation.motion]
type = "manoeuvres"
lat_deg = 48.0
lon_deg = 11.0
speed_m_s = 10.0
laps = 2
manoeuvres = [{ duration_s = 10.0, turn_deg = 60.0 }, { duration_s = 10.0, speed_m_s = 15.0 },
              { duration_s = 10.0, turn_deg = -80.0 }, { duration_s = 10.0, speed_m_s = 10.0 }]
"""
IMU = """
[simulation.imu]
rate_hz = 50.0
[simulation.imu.gyro]
arw_deg_rthr = 0.5
bias_deg_hr = 100.0
[simulation.imu.accel]
vrw_m_s_rthr = 0.1
bias_mg = 3.0
"""
GNSS = """
[simulation.gnss]
first_s = 1.0
lever_arm_m = [0.5, 0.0, -1.0]
outages_s = [[50.0, 70.0]]
"""
START = """
[start]
attitude_deg = [0.2, 0.2, 1.5]
"""


@pytest.fixture
def write(tmp_path):
    def write(*parts, name="campaign.toml"):
        path = tmp_path / name
        path.write_text("\n".join(parts))
        return path

    return write


@pytest.fixture
def job(write):
    return read_job(write("[evaluation]\nevery_s = 4.0", START, '[simulation]\nname = "loop"', MOTION, IMU, GNSS))[0]


def test_an_honest_filter_is_found_honest(job):
    """Bands hold 95 % of the times, which hang together: at least 60 % inside, the mean within 4 of its own errors."""
    result = scatter(campaign(lane_runs, job, 200, seed=1, workers=1), job)
    assert "as good as it says" in result.verdict
    assert result.nees.share > 0.6
    inside = (result.low < result.claimed) & (result.claimed < result.high)
    assert inside.mean() > 0.85
    # mean errors: 4 standard errors at every time and axis
    assert np.all(np.abs(result.mean) < 4.5 * result.sigma / np.sqrt(200))
    assert result.t[0] == 4.0
    assert result.outages == ((50.0, 70.0),)
    # the outage shows
    assert result.rms[result.at(68.0), 6] > 2.0 * result.rms[result.at(48.0), 6]


@pytest.mark.campaign
def test_the_whole_chain_says_the_same_as_lanes(job):
    """Other random numbers, so sigmas agree within the spread of two estimates: 4.5 standard errors each of 108."""
    n, m = 60, 160
    whole = scatter(campaign(navigation_run, job, n, workers=1), job)
    lanes = scatter(campaign(lane_runs, job, m, workers=1), job)
    ratio = whole.rms / lanes.rms
    assert np.all(np.abs(np.log(ratio)) < 4.5 * np.sqrt(0.5 / n + 0.5 / m))
    # what the filter claims hardly hangs on the noise
    np.testing.assert_allclose(whole.claimed, lanes.claimed, rtol=5e-3)
    assert abs(whole.nis - lanes.nis) < 4.5 * np.sqrt(2.0 / 400.0 * (1.0 / n + 1.0 / m))


def test_factors_on_the_noise_are_those_of_the_whole_chain(job):
    """What the filter claims hardly hangs on the noise that is drawn: 1.5 %, statistical, of four runs each."""
    from schuler.navigation.config import NavigationConfig

    noise = {"filter": {"noise": {"gyro": 5.0, "accel": [3.0, 2.0, 4.0]}}}
    config = NavigationConfig.parse(job.navigation.model_dump(exclude_defaults=True) | noise)
    noisy = NavigationJob(job.simulation, config, job.start, job.evaluation)
    whole = scatter(campaign(navigation_run, noisy, 4, workers=1), noisy)
    lanes, without = (scatter(campaign(lane_runs, each, 4, workers=1), each) for each in (noisy, job))
    np.testing.assert_allclose(whole.claimed, lanes.claimed, rtol=0.015)
    assert np.max(lanes.claimed / without.claimed) > 1.2


def test_lane_runs_do_not_hang_on_their_neighbours(job):
    a = campaign(lane_runs, job, 40, workers=2, batch=7, keep=True).rows()
    b = campaign(lane_runs, job, 40, workers=1, batch=40, keep=True).rows()
    for name, x in a.columns.items():
        np.testing.assert_array_equal(x, b.columns[name])


@pytest.mark.parametrize("batch", [None, 24])
def test_lanes_on_a_cluster_are_those_of_this_process(job, batch):
    """Whole batches are handed out, and every bit is the same."""
    distributed = pytest.importorskip("distributed")
    here = campaign(lane_runs, job, 40, seed=3, workers=1, batch=40, keep=True)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        there = campaign(lane_runs, job, 40, seed=3, scheduler=client, batch=batch, keep=True)
    for name, x in there.rows().columns.items():
        np.testing.assert_array_equal(x, here.rows().columns[name])
    np.testing.assert_array_equal(there["nees"].moments.m2, here["nees"].moments.m2)


def test_errors_are_estimate_minus_truth_in_north_east_down(job):
    """Against the library's own comparison of trajectories."""
    from schuler.montecarlo.navigation import _drawn
    from schuler.navigation.evaluation.errors import trajectory_errors
    from schuler.navigation.run import navigate
    from schuler.simulation.scenario import simulate_mission

    seed = run_seed(0, 3)
    got = navigation_run(job, seed)
    np.testing.assert_array_equal(navigation_run(job, seed)["position"], got["position"])
    simulation = simulate_mission(job.plan.mission, np.random.default_rng(seed))
    result = navigate(simulation.recording, job.plan.config, initial=_drawn(job.plan, seed))
    errors = trajectory_errors(result.states, job.plan.truth)
    np.testing.assert_allclose(got["position"], errors.position_n, atol=1e-6)  # rounding of 6.4e6 m
    np.testing.assert_allclose(got["velocity"], errors.velocity_n, atol=1e-9)
    np.testing.assert_allclose(got["attitude"], errors.attitude_n, atol=1e-9)
    k = np.searchsorted(result.t, job.plan.t - 1e-6)
    np.testing.assert_allclose(got["sigma_position"], result.sigma("dr")[k], rtol=1e-5)
    np.testing.assert_allclose(got["nees"], result.nees(job.plan.mission.ideal.truth)[k], rtol=1e-6)


def test_the_start_scatters_as_it_is_told(job):
    """400 draws: 4 standard errors of a sigma are 14 %."""
    from schuler import frames
    from schuler.montecarlo.navigation import _drawn
    from schuler.navigation.evaluation.consistency import attitude_difference

    nav = job.plan.initial.nav
    C = frames.C_en(nav.llh)
    drawn = [_drawn(job.plan, run_seed(0, k)).nav for k in range(400)]
    r = np.array([C.T @ (d.r_eb_e - nav.r_eb_e) for d in drawn])
    v = np.array([C.T @ (d.v_eb_e - nav.v_eb_e) for d in drawn])
    psi = attitude_difference(np.array([d.q_eb for d in drawn]), nav.q_eb[None]) @ C
    for x, sigma in ((r, (2.0, 2.0, 3.0)), (v, (0.1, 0.1, 0.1)), (psi, np.array((0.2, 0.2, 1.5)) * DEG)):
        np.testing.assert_allclose(x.std(axis=0), sigma, rtol=0.14)


def test_runs_that_align_themselves(write):
    path = write("[evaluation]\nsettle_s = 5.0", '[simulation]\nname = "loop"', MOTION, IMU, GNSS)
    job, _ = read_job(path)
    function, why = runner(job)
    assert function is navigation_run
    assert "do not align themselves; give the errors they start with" in why
    got = campaign(function, job, 6, workers=1)
    t = job.plan.t
    assert np.allclose(np.diff(t), 1.0)
    assert 5.0 < t[0] < 20.0
    assert got["position"].shape == (len(t), 3)
    assert not got.failures
    # one that is aligned later than it is looked at is a failure that says so
    from dataclasses import replace

    late = replace(job)
    late.__dict__["plan"] = job.plan._replace(t=job.plan.t - 20.0)
    with pytest.raises(InputError, match=r"run is known from .* was it aligned late\? Raise evaluation.settle_s"):
        navigation_run(late, run_seed(0, 0))


def test_files_and_sections(write, tmp_path):
    plain = write(*(p.replace("simulation.", "") for p in ("seed = 5", MOTION, IMU, GNSS)), name="scenario.toml")
    job, file = read_job(plain)
    assert (file.seed, job.start) == (5, None)
    assert job.navigation.gnss.lever_arm_m == (0.5, 0.0, -1.0)
    assert job.navigation.imu.gyro == {"arw_deg_rthr": 0.5, "bias_deg_hr": 100.0}
    write("[imu]\ncatalogue = 'MTi-G-710'\n[filter]\nstates = 9", name="navigation.toml")
    both = write("simulation = 'scenario.toml'\nnavigation = 'navigation.toml'\nruns = 7", START)
    job, file = read_job(both)
    assert (job.navigation.filter.states, file.runs, job.start.attitude_deg) == (9, 7, (0.2, 0.2, 1.5))
    assert read_job(plain, tmp_path / "navigation.toml")[0].navigation == job.navigation
    with pytest.raises(ConfigError, match=r"runs"):
        read_job(write("runs = 0\nsimulation = 'scenario.toml'", name="x.toml"))
    with pytest.raises(ConfigError, match=r"missing.toml: no such scenario file"):
        read_job(write("simulation = 'missing.toml'", name="y.toml"))


def test_what_a_job_is_of(write, tmp_path):
    parts = ('[simulation]\nname = "loop"', MOTION, GNSS, START, "[simulation.imu]\nspec = 'unit.toml'")
    from schuler.sensors import catalogue
    from schuler.sensors.spec_file import write_spec

    write_spec(tmp_path / "unit.toml", catalogue.spec("MTi-G-710"))
    job, _ = read_job(write(*parts))
    before = fingerprint(job)
    assert fingerprint(read_job(write(*parts, name="again.toml"))[0]) == before
    # the place of a file does not count, its contents do
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "unit.toml").rename(tmp_path / "elsewhere" / "unit.toml")
    (tmp_path / "elsewhere" / "c.toml").write_text("\n".join(parts))
    assert fingerprint(read_job(tmp_path / "elsewhere" / "c.toml")[0]) == before
    write_spec(tmp_path / "elsewhere" / "unit.toml", catalogue.spec("MPU-6000"))
    assert fingerprint(read_job(tmp_path / "elsewhere" / "c.toml")[0]) != before


def test_a_job_is_sent_without_what_it_has_prepared(job):
    assert len(job.plan.t) == 20
    sent = pickle.dumps(job)
    assert len(sent) < 20_000
    back = pickle.loads(sent)
    assert back == job
    assert fingerprint(back) == fingerprint(job)
    a, b = navigation_run(job, run_seed(1, 1)), navigation_run(back, run_seed(1, 1))
    np.testing.assert_array_equal(a["position"], b["position"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"aiding": {"zero_velocity": {}}}, "have no aids but GNSS"),
        ({"gnss": {"lever_arm_m": [0.4, 0.0, -1.0]}}, "need the true lever arm"),
        ({"gnss": {"lever_arm_m": [0.5, 0.0, -1.0], "sigma_scale": 2.0}}, "take GNSS as it comes"),
        ({"gnss": {"lever_arm_m": [0.5, 0.0, -1.0], "coupling": "reset"}}, "know no coupling 'reset'"),
    ],
)
def test_what_lanes_do_not_have_goes_through_the_whole_chain(job, change, words):
    from schuler.navigation.config import NavigationConfig

    data = job.navigation.model_dump(exclude_defaults=True) | change
    other = NavigationJob(job.simulation, NavigationConfig.parse(data), job.start, job.evaluation)
    function, why = runner(other)
    assert function is navigation_run
    assert words in why
    with pytest.raises(InputError, match=words):
        runner(other, "lanes")
    assert runner(job)[0] is lane_runs
    assert runner(job, "filter")[0] is navigation_run


def test_rounding_is_left_out_only_if_lanes_are_asked_for(write):
    path = write('[simulation]\nname = "loop"', MOTION, GNSS, START, "[simulation.imu]\ncatalogue = 'MPU-6000'")
    job, file = read_job(path)
    assert runner(job, file.engine)[0] is navigation_run
    knowingly, file = read_job(path, engine="lanes")
    assert runner(knowingly, file.engine)[0] is lane_runs
    assert fingerprint(knowingly) != fingerprint(job)


def test_tables_and_figures(job, tmp_path):
    done = campaign(lane_runs, job, 16, workers=1)
    result = scatter(done, job)
    table = result.table()
    assert table.column("error") == [name for name, _, _ in COMPONENTS]
    row = table.row(error="attitude down")
    assert row["sigma_of_runs"] == pytest.approx(result.sigma[-1, 2] / DEG)
    assert len(result.tenths()) == 10
    assert result.table(40.0).title.endswith("40.0 s")
    assert len(result.plot().axes) == 9
    assert result.to_dict()["nees"]["share_inside"] == result.nees.share
    assert result.verdict in result.summary()
    with pytest.raises(InputError, match="two runs"):
        scatter(campaign(lane_runs, job, 1, workers=1), job)


def test_the_report_is_the_same_however_the_runs_were_done(job, tmp_path):
    pages = []
    for name, workers, batch in (("a", 1, 24), ("b", 2, 5)):
        done = campaign(lane_runs, job, 24, workers=workers, batch=batch)
        pages.append(scatter(done, job).report(tmp_path / f"{name}.html", done, job).read_bytes())
    assert pages[0] == pages[1]
    text = pages[0].decode()
    assert "loop" in text
    assert "sigma of the filter" in text


@pytest.mark.slow
def test_a_thousand_runs_of_an_hour():
    """Ratio of scatter to sigma 0.95 to 1.05 at every tenth: 3.9 standard errors of three axes of a thousand runs."""

    job, file = read_job(ROOT / "examples" / "montecarlo_hour.toml")
    function, _ = runner(job, file.engine)
    result = scatter(campaign(function, job, 1000, seed=1, pool="threads"), job)
    tenths = result.tenths()
    for name in ("position_ratio", "velocity_ratio", "attitude_ratio"):
        assert np.all(np.abs(np.array(tenths.column(name)) - 1.0) < 0.05), name


def test_without_gnss_a_start_is_needed(write):
    job, _ = read_job(write('[simulation]\nname = "blind"', MOTION, IMU))
    with pytest.raises(InputError, match=r"without GNSS no run can align itself.*\[start\]"):
        _ = job.plan
    blind = NavigationJob(job.simulation, job.navigation, StartSection())
    result = scatter(campaign(runner(blind)[0], blind, 32, workers=1), blind)
    assert result.nis is None
    assert result.rms[-1, 6:8].min() > 20.0
