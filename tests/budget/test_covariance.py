"""Linear covariance against the engine, against itself, against Monte Carlo; budgets add up."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler import frames
from schuler.budget import (
    QUANTITIES,
    budget_of,
    error_budget,
    linear_covariance,
    linearised_mission,
    prepare_budget,
    true_covariance,
)
from schuler.budget.linearisation import linearise
from schuler.budget.replay import records_at, replay_filter
from schuler.budget.scenario import BudgetScenario, rotation_of_start, true_schedule
from schuler.budget.sources import filter_layout
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import RESET_POSITION, MeasurementSchedule
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.reproduce.flenniken.study.rocket import rocket_motion
from schuler.sensors.catalogue import spec
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.motion import StaticMotion
from schuler.units import DEG

IMU = "MTi-G-710"


def engine_parts(what, rate_hz):
    """Ideal readings, true start and true measurements of a scenario; of a motion without aids."""
    if isinstance(what, dict):
        scenario = BudgetScenario.parse(what)
        motion = scenario.motion.build()
        schedule = true_schedule(motion, scenario)
    else:
        motion, schedule = what, MeasurementSchedule.empty()
    ideal = ideal_imu(motion, rate_hz)
    truth = ideal.truth
    return ideal, NavState(0.0, truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0]), schedule


@pytest.mark.parametrize("states", [9, 15, 21, 33])
def test_replay_is_the_engine(town, mission, states):
    """1e-3 of a sigma: at 20 Hz the engine's filter takes discretisation for scale factors, and moves its estimates."""
    imu = spec("yaman-automotive")
    layout = filter_layout(imu, states)
    ideal, start, schedule = engine_parts(town, 20.0)
    increments = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()
    P0 = np.diag(np.concatenate((mission.start_sigma**2, layout.initial_variances())))
    psd = [imu.gyro.random_walk**2] * 3, [imu.accel.random_walk**2] * 3
    options = FilterOptions(covariance_rate_hz=2.0, record_s=20.0)
    done = run(increments, schedule, InitialState(start, P0, np.zeros(layout.size - 9)), layout, *psd, options)
    node = records_at(mission.run, done.rec_t[:-1])
    ours = replay_filter(mission.run, layout, P0, psd[0][0], psd[1][0], node)
    assert_allclose(ours.t, done.rec_t[:-1], atol=1e-9)
    T = ecef_from_ned_states(frames.llh_from_ecef(done.rec_nav[:-1, 7:]), layout.size)
    theirs = np.swapaxes(T, 1, 2) @ unpack_symmetric(done.rec_P[:-1], layout.size) @ T
    sigma = [np.sqrt(np.einsum("rii->ri", P)) for P in (ours.P, theirs)]
    assert_allclose(sigma[0], sigma[1], rtol=1e-3)
    if states < 21:
        assert_allclose(sigma[0], sigma[1], rtol=1e-4)


@pytest.mark.parametrize("states", [9, 15, 33])
def test_contributions_add_up_to_the_filters_own_covariance(mission, states):
    """Where the filter knows all errors its own variance is the sum of the parts: 1e-9, rounding."""
    constant = TriadSpec.gyro(arw_deg_rthr=0.3, bias_deg_hr=20.0, scale_ppm=500.0, misalignment_mrad=1.0)
    force = TriadSpec.accelerometer(noise_ug_rthz=100.0, density="two-sided", bias_mg=2.0, scale_ppm=300.0)
    imu = ImuSpec("known", constant, force)
    if states < 33:  # nothing it does not estimate
        imu = replace(imu, gyro=replace(constant, scale_factor=0.0, misalignment=0.0))
        imu = replace(imu, accel=replace(force, scale_factor=0.0))
    if states < 15:
        imu = replace(imu, gyro=replace(imu.gyro, turn_on_bias=0.0), accel=replace(imu.accel, turn_on_bias=0.0))
    result = linear_covariance(mission, imu, states=states)
    squares = np.sum(np.square(result.parts), axis=0)
    assert_allclose(squares, np.einsum("rii->ri", result.P), rtol=1e-12)
    assert_allclose(squares, np.einsum("rii->ri", result.believed), rtol=1e-9)


def test_all_at_once_is_source_by_source(mission):
    """Two ways through the compiled replays, for IMUs with in-run biases, instability and unestimated errors."""
    for name in ("MPU-6000", "flenniken-tactical", IMU):
        P = true_covariance(mission, spec(name))
        Q = linear_covariance(mission, spec(name)).P
        assert_allclose(np.einsum("rii->ri", P), np.einsum("rii->ri", Q), rtol=1e-8)


def test_free_integration_is_the_closed_form():
    """At rest without aids: constant biases, tilt and noise of a minute against the closed forms (1 %: gravity)."""
    motion = StaticMotion(np.array([48.0 * DEG, 0.2, 0.0]), np.zeros(3), 60.0)
    sigma = np.array([1e-3, 2e-3, 3e-3, 0.02, 0.02, 0.02, 1.0, 1.0, 1.0])
    still = linearised_mission(motion, MeasurementSchedule.empty(), sigma, states=9)
    imu = ImuSpec(
        "plain", TriadSpec(random_walk=1e-4, turn_on_bias=1e-5), TriadSpec(random_walk=1e-3, turn_on_bias=5e-3)
    )
    result = linear_covariance(still, imu, by_axis=True)
    by = dict(zip(result.names, result.parts[:, -1], strict=True))
    g, t = 9.8093, 60.0
    expected = {
        "b_a_x": 5e-3 * t**2 / 2.0, "b_g_y": g * 1e-5 * t**3 / 6.0, "attitude_east": g * 2e-3 * t**2 / 2.0,
        "velocity_north": 0.02 * t, "position_north": 1.0, "accel_noise_x": 1e-3 * np.sqrt(t**3 / 3.0),
        "gyro_noise_y": g * 1e-4 * np.sqrt(t**5 / 20.0),
    }  # fmt: skip
    for name, value in expected.items():
        assert_allclose(by[name][6], value, rtol=0.01)
    assert by["b_a_z"][6] < 1e-3 * by["b_a_x"][6]
    total = np.sqrt(sum(np.square(v) for v in by.values()))
    assert_allclose(result.sigma[-1], total, rtol=1e-12)


def simulated_errors(town, mission, imu, runs, states):
    """Errors of the engine over simulated runs at ten times. Shape (10, runs, 9)."""
    ideal, start, true = engine_parts(town, 50.0)
    layout = filter_layout(imu, states)
    P0 = np.diag(np.concatenate((mission.start_sigma**2, layout.initial_variances())))
    C = frames.C_en(start.llh)
    times = np.floor(np.linspace(0.1, 1.0, 10) * (ideal.t[-1] - 1.0))  # just after an update, as the records
    errors = np.empty((10, runs, 9))
    for r in range(runs):
        rng = np.random.default_rng([5, r])
        readings = simulate_imu(ideal, ImuErrors.draw(imu, rng), rng).imu.increments()
        noise = np.sqrt(np.einsum("nii->ni", true.R)) * rng.standard_normal((len(true), 3))
        z = true.z.copy()
        position = true.kind == 1
        z[position, :3] += noise[position] @ C.T
        z[~position, :3] += noise[~position]
        e = mission.start_sigma * rng.standard_normal(9)
        turned = frames.C_en(start.llh) @ e[:3]
        from schuler import rotation

        q = rotation.quat_multiply(rotation.quat_from_rotvec(turned), start.q_eb)
        wrong = NavState(0.0, start.r_eb_e + C @ e[6:], start.v_eb_e + C @ e[3:6], q)
        done = run(
            readings, replace(true, z=z), InitialState(wrong, P0, np.zeros(layout.size - 9)), layout,
            [imu.gyro.random_walk**2] * 3, [imu.accel.random_walk**2] * 3,
            FilterOptions(covariance_rate_hz=2.0, record_s=1.0, output_rate_hz=10.0),
        )  # fmt: skip
        at = np.searchsorted(done.t, times - 1e-6)
        reference = ideal.truth.at(done.t[at])
        C_t = frames.C_en(frames.llh_from_ecef(reference.r_eb_e))
        r_n = np.einsum("tji,tj->ti", C_t, done.r[at] - reference.r_eb_e)
        v_n = np.einsum("tji,tj->ti", C_t, done.v[at] - reference.v_eb_e)
        dq = rotation.dcm_from_quat(done.q[at]) @ np.swapaxes(rotation.dcm_from_quat(reference.q_eb), 1, 2)
        psi = np.stack((dq[:, 2, 1] - dq[:, 1, 2], dq[:, 0, 2] - dq[:, 2, 0], dq[:, 1, 0] - dq[:, 0, 1]), axis=1) / 2.0
        errors[:, r] = np.hstack((np.einsum("tji,tj->ti", C_t, psi), v_n, r_n))
    return times, errors


def ratios(town, mission, imu, runs, states=15):
    times, errors = simulated_errors(town, mission, imu, runs, states)
    result = linear_covariance(mission, imu, states=states)
    at = np.searchsorted(result.t, times - 1e-6)
    scatter = np.sqrt(np.mean(errors**2, axis=1))
    # the root of the summed variances of each vector: one number of three (attitude, velocity, position)
    return np.sqrt(
        np.sum(scatter.reshape(10, 3, 3) ** 2, axis=2) / np.sum(result.sigma[at].reshape(10, 3, 3) ** 2, axis=2)
    )  # fmt: skip


def test_monte_carlo_scatter_is_the_linear_covariance(town, mission):
    """80 runs of a 15-state filter with a scale factor it does not know: 4 standard errors of a vector's RMS."""
    imu = replace(spec("yaman-tactical"), name="tactical")
    result = ratios(town, mission, imu, 80)
    assert np.all(np.abs(result - 1.0) < 4.0 / np.sqrt(2.0 * 80.0))


AT_REST = {
    "name": "ten minutes at rest, GNSS for the first five",
    "motion": {"type": "static", "lat_deg": 48.0, "lon_deg": 11.0, "duration_s": 600.0},
    "gnss": {"outages_s": [[300.0, 600.0]]},
}


@pytest.mark.slow
@pytest.mark.parametrize("where", ["drive", "rest", "rocket"])
def test_monte_carlo_of_a_thousand_runs(town, where):
    """Ratio 0.95 to 1.05 at every tenth of the run: two to three standard errors of one component."""
    if where == "rocket":
        scenario = rocket_motion()
        sigma = [1e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1, 5.0, 5.0, 5.0]
        mission = linearised_mission(scenario, MeasurementSchedule.empty(), sigma, imu_rate_hz=50.0)
    else:
        scenario = town if where == "drive" else AT_REST
        mission = prepare_budget(scenario)
    result = ratios(scenario, mission, replace(spec("yaman-tactical"), name="tactical"), 1000)
    assert np.all((result > 0.95) & (result < 1.05))


def test_truth_other_than_believed(mission):
    """A worse IMU than the filter believes: more error, the filter's own covariance unmoved."""
    good, bad = spec("flenniken-tactical"), spec("flenniken-automotive")
    fooled = linear_covariance(mission, good, truth=bad)
    honest, given = linear_covariance(mission, good), linear_covariance(mission, bad)
    assert_allclose(fooled.believed, honest.believed)
    assert fooled.quantity("position").max() > given.quantity("position").max() > honest.quantity("position").max()
    assert "believes" in fooled.summary()


def test_budget_of_a_time(mission):
    result = linear_covariance(mission, spec(IMU))
    budget = budget_of(result, "horizontal", 140.0)
    assert_allclose(np.sum(budget.share), 1.0, rtol=1e-12)
    assert_allclose(np.sqrt(sum(v**2 for v in budget.by_group().values())), budget.total, rtol=1e-12)
    table = budget.table(single=True)
    assert table.column("source")[-1] == "all"
    assert "gyroscope" in budget.summary()
    assert error_budget(mission, spec(IMU), quantity="heading").quantity == "heading"
    assert set(budget.to_dict()["by_source"]) == set(result.names)
    assert budget.plot() is not None
    for bad, what in (({"quantity": "speed"}, "quantity"), ({"time": 1e6}, "time")):
        with pytest.raises(InputError, match=what):
            budget_of(result, **bad)


def test_aids_help(town):
    """Each aid lowers what it should: wheels the outage, rests the velocity, two antennas the heading."""
    bare = dict(town)
    del bare["zero_velocity"]
    imu = spec("flenniken-automotive")
    none = linear_covariance(prepare_budget(bare), imu)
    wheels = linear_covariance(prepare_budget(bare | {"non_holonomic": {}}), imu)
    antennas = linear_covariance(prepare_budget(bare | {"gnss": bare["gnss"] | {"heading_sigma_deg": 0.3}}), imu)
    at = int(np.argmin(np.abs(none.t - 149.0)))
    assert wheels.quantity("horizontal")[at] < 0.3 * none.quantity("horizontal")[at]
    assert antennas.quantity("heading")[80] < 0.5 * none.quantity("heading")[80]
    assert any(name.startswith("lateral") for name in wheels.names)


def test_a_run_in_legs_is_the_whole(town, mission, monkeypatch):
    """1e-7: discretisation, the run has left the truth by micrometres. Legs end at nodes, as those of an hour do."""
    imu = spec(IMU)
    whole = linear_covariance(mission, imu)
    monkeypatch.setattr("schuler.budget.linearisation.LEG_S", 47.5)
    legs = prepare_budget(town)
    assert len(legs.run.t) > len(mission.run.t)
    assert_allclose(linear_covariance(legs, imu).quantity("position"), whole.quantity("position"), rtol=1e-7)


def test_long_missions_stay_on_the_truth():
    """Three hours at 2 Hz: discretisation of an hour, 0.1 m. In one leg it grows by e every ten minutes."""
    motion = StaticMotion(np.array([0.8, 0.2, 100.0]), np.array([0.1, 0.0, 0.5]), 3.0 * 3600.0)
    mission = linearised_mission(
        motion, MeasurementSchedule.empty(), np.ones(9), imu_rate_hz=2.0, node_rate_hz=0.1, every_s=600.0
    )
    truth = motion.state(mission.run.t[-1:])
    assert np.linalg.norm(mission.run.place[-1, :3] - truth.r_eb_e[0]) < 0.2


def test_start_is_given_as_roll_pitch_heading():
    """A roll error turns about the forward axis: level and heading east, about east."""
    motion = StaticMotion(np.array([0.8, 0.2, 0.0]), np.array([0.0, 0.0, 0.5 * np.pi]), 5.0)
    assert_allclose(rotation_of_start(motion), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_what_cannot_be_done_is_said(town):
    with pytest.raises(ConfigError, match="no such configuration file"):
        prepare_budget("nowhere.toml")
    with pytest.raises(ConfigError, match="states"):
        prepare_budget(town | {"states": 16})
    ideal, _, _ = engine_parts(town, 20.0)
    increments = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()
    with pytest.raises(InputError, match="resets have no memory"):
        linearise(increments, MeasurementSchedule.of(RESET_POSITION, [5.0], np.zeros((1, 3)), 1.0), ideal.truth)
    with pytest.raises(InputError, match="velocity and attitude"):
        linearise(increments, MeasurementSchedule.empty(), Trajectory(ideal.truth.t, ideal.truth.r_eb_e))
    assert set(QUANTITIES) >= {"horizontal", "heading"}
