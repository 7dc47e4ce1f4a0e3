"""navigate(): alignment in its variants, configuration, honest failure, real drives."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from places import EXAMPLES

from schuler import units
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.errors import drift_curve, outage_errors, trajectory_errors
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.sensors import TriadSpec, catalogue, write_spec
from schuler.simulation.scenario import prepare_mission, simulate_mission

IMU = {
    "gyro": {"arw_deg_rthr": 0.2, "bias_deg_hr": 100.0, "in_run_deg_hr": 5.0, "in_run_time_s": 600.0},
    "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 3.0, "in_run_mg": 0.05, "in_run_time_s": 600.0},
}
LEVER = [0.7, 0.1, -1.0]
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 25.0},
    {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0},
    {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
    {"north_m": -60.0, "east_m": 300.0, "speed_m_s": 10.0},
    {"north_m": -150.0, "east_m": 50.0, "speed_m_s": 12.0},
]


def drive(seed=1, points=None, kind="increment", **gnss):
    mission = prepare_mission(
        {
            "seed": seed,
            "motion": {
                "type": "waypoints",
                "lat_deg": 47.0,
                "lon_deg": 8.0,
                "height_m": 400.0,
                "waypoints": points or POINTS,
            },
            "imu": {"rate_hz": 100.0, "kind": kind, **IMU},
            "gnss": {"rate_hz": 1.0, "first_s": 0.37, "lever_arm_m": LEVER, **gnss},
        }
    )
    return simulate_mission(mission).recording


def config(**sections):
    data = {"imu": dict(IMU), "gnss": {"lever_arm_m": LEVER}}
    for name, section in sections.items():
        data[name] = {**data.get(name, {}), **section}
    return data


@pytest.fixture(scope="module")
def recording():
    return drive()


def test_rates_of_the_log_are_forgotten_before_it_is_filtered(monkeypatch):
    """Alignment makes them of increments; of a day at 200 Hz they are 830 MB."""
    made, left, rates, run = [], [], ImuSeries.rates, PreparedRun.run

    def keep(imu):
        made.append(weakref.ref(series := rates(imu)))
        return series

    def count(prepared, *given, **more):
        left.append(sum(ref() is not None for ref in made))
        return run(prepared, *given, **more)

    recording = drive()
    monkeypatch.setattr(ImuSeries, "rates", keep)
    monkeypatch.setattr(PreparedRun, "run", count)
    navigate(recording, config(filter={"tune": False}))
    assert made
    assert left[-1] == 0


def test_a_drive_from_rest_is_navigated(recording):
    result = navigate(recording, config())
    errors = result.errors(recording.reference).between(60.0, 1e9)
    assert errors.rms_horizontal < 1.0
    assert np.abs(errors.attitude_n[:, :2]).max() < np.radians(0.6)
    assert np.abs(errors.attitude_n[:, 2]).max() < np.radians(3.0)
    assert any("levelled, heading from course" in note for note in result.notes)
    assert any("gyro biases start from the mean at rest" in note for note in result.notes)
    assert result.smooth().errors(recording.reference).rms_horizontal < 0.6
    assert 0.9 < result.innovations.mean_nis() < 1.1


def test_a_log_that_starts_in_motion_is_levelled_in_motion():
    moving = drive(points=[{**POINTS[0], "stop_s": 0.0}, *POINTS[1:]])
    result = navigate(moving, config())
    assert any("levelled in motion" in note for note in result.notes)
    assert result.trajectory.t[0] < 3.0
    errors = result.errors(moving.reference).between(40.0, 1e9)
    assert errors.rms_horizontal < 1.2


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", range(6))
def test_alignment_errors_are_as_claimed(seed):
    r = drive(seed=seed)
    result = navigate(r, config())
    t = result.t[:1]
    truth = r.reference.at(t)
    e = trajectory_errors(Trajectory(result.t, result.states.r_eb_e, result.states.v_eb_e, result.states.q_eb), truth)
    assert np.all(np.abs(e.attitude_n[0]) < 4.0 * result.sigma("dpsi")[0])


def test_rates_and_increments_give_the_same_solution():
    a, b = navigate(drive(kind="increment"), config()), navigate(drive(kind="rate"), config())
    difference = np.linalg.norm(a.trajectory.r_eb_e[-1] - b.trajectory.r_eb_e[-1])
    assert difference < 2.0  # statistical: other noise, the same fixes


def test_given_attitude_and_mount(recording):
    """A log in IMU axes turned by a mount, with the mount and the attitude stated."""
    from schuler import rotation

    C_bs = rotation.dcm_from_rpy(np.radians([10.0, -5.0, 90.0]))
    turned = Recording(
        ImuSeries(recording.imu.t, recording.imu.gyro @ C_bs, recording.imu.accel @ C_bs, "increment"),
        recording.gnss, None, recording.reference, recording.metadata,
    )  # fmt: skip
    rpy = np.degrees(recording.reference.rpy_nb[0])
    result = navigate(
        turned,
        config(
            imu={"mount_rpy_deg": [10.0, -5.0, 90.0]},
            alignment={"method": "given", "rpy_deg": list(rpy), "sigma_deg": [0.5, 0.5, 1.0]},
        ),
    )
    assert result.errors(recording.reference).rms_horizontal < 1.2
    assert any("IMU axes turned into the vehicle" in note for note in result.notes)


def test_clock_shift_is_applied(recording):
    late = Recording(recording.imu.shifted(0.2), recording.gnss, None, recording.reference, recording.metadata)
    right = navigate(late, config(imu={"clock_shift_s": -0.2}))
    wrong = navigate(late, config(gnss={"gate": "off"}))
    assert right.innovations.mean_nis() < 1.1
    assert wrong.innovations.mean_nis() > 1.2


def test_outages_are_windows_of_the_recording(recording):
    result = navigate(recording, config(outages={"windows_s": [[60.0, 80.0]]}))
    start = recording.start
    (window,) = result.outages
    assert window == (start + 60.0, start + 80.0)
    used = result.innovations.t
    assert not np.any((used >= window[0]) & (used < window[1]))
    (o,) = outage_errors(result.errors(recording.reference), result.outages)
    assert 0.3 < o.max_horizontal < 30.0
    age, rms, largest = drift_curve(result.errors(recording.reference), result.outages, step=5.0)
    assert age.tolist() == [5.0, 10.0, 15.0, 20.0]
    assert np.all(largest >= rms)
    assert largest[-1] == pytest.approx(o.max_horizontal, rel=0.2)


def test_repeated_outages_follow_their_period():
    c = NavigationConfig.parse(config(outages={"every_s": 45.0, "length_s": 15.0}))
    assert c.outages.resolve(100.0, 100.0 + 548.0) == tuple((100.0 + 45.0 * k, 115.0 + 45.0 * k) for k in range(1, 12))
    c = NavigationConfig.parse(config(outages={"every_s": 45.0, "length_s": 15.0, "first_s": 40.0}))
    assert c.outages.resolve(0.0, 549.0)[0] == (40.0, 55.0)
    assert len(c.outages.resolve(0.0, 549.0)) == 11


def test_states_can_be_chosen_and_modelled(recording):
    result = navigate(
        recording,
        config(
            filter={
                "states": ["b_a", "b_g", "lever"],
                "models": {"lever": {"sigma": 0.3}, "b_a": {"sigma": 0.05, "noise": 1e-5}},
            },
            gnss={"lever_arm_m": [0.5, 0.1, -1.0]},
        ),
    )
    assert result.layout.blocks == ["dpsi", "dv", "dr", "b_a", "b_g", "lever"]
    assert result.layout.models["b_a"].sigma == 0.05
    error = result.parameter("lever")[-1] + [0.5, 0.1, -1.0] - LEVER
    assert np.all(np.abs(error) < 4.5 * result.sigma("lever")[-1])


def test_free_inertial_navigation_needs_a_start(recording):
    alone = Recording(recording.imu, None, None, recording.reference, recording.metadata)
    with pytest.raises(
        InputError, match="alignment needs GNSS positions; for a free inertial run give an initial state"
    ):
        navigate(alone, config())
    import schuler

    T = recording.reference
    nav = schuler.NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0])
    layout = schuler.StateLayout({})
    initial = schuler.InitialState.from_sigmas(
        nav, layout, attitude=[1e-3] * 3, velocity=[0.01] * 3, position=[0.1] * 3
    )
    result = navigate(alone, config(filter={"states": 9}), initial=initial)
    assert any("free inertial solution" in note for note in result.notes)
    assert len(result.innovations) == 0
    assert result.errors(T).max_horizontal < 2000.0


def test_gaps_are_bridged_or_part_the_log(recording):
    keep = np.ones(len(recording.imu), dtype=bool)
    keep[9000:9020] = False
    imu = recording.imu.rates()
    gappy = Recording(
        ImuSeries(imu.t[keep], imu.gyro[keep], imu.accel[keep], "rate"), recording.gnss, None, recording.reference
    )
    result = navigate(gappy, config())
    assert any("1 pauses of the IMU log bridged, the longest 0.210 s" in note for note in result.notes)
    part = navigate(gappy, config(imu={"max_gap_s": 0.1}))
    assert any("pauses for 0.210 s at" in note and "its longest part is navigated" in note for note in part.notes)


def test_a_vehicle_that_never_moves_has_no_course():
    still = simulate_mission(
        prepare_mission(
            {
                "motion": {"type": "static", "lat_deg": 47.0, "lon_deg": 8.0, "duration_s": 60.0},
                "imu": {"rate_hz": 50.0, **IMU},
                "gnss": {"rate_hz": 1.0},
            }
        )
    ).recording
    with pytest.raises(InputError, match=r"never moves faster than 1\.0 m/s .* gives no heading"):
        navigate(still, config())
    with pytest.raises(InputError, match="would leave the heading unknown"):
        navigate(still, config(alignment={"method": "gyrocompass"}))


def test_gyrocompassing_starts_a_good_imu():
    good = {
        "gyro": {"arw_deg_rthr": 0.002, "bias_deg_hr": 0.01},
        "accel": {"vrw_m_s_rthr": 0.003, "bias_ug": 30.0},
    }
    r = simulate_mission(
        prepare_mission(
            {
                "motion": {
                    "type": "static",
                    "lat_deg": 47.0,
                    "lon_deg": 8.0,
                    "duration_s": 400.0,
                    "rpy_deg": [1.0, 2.0, 130.0],
                },
                "imu": {"rate_hz": 50.0, **good},
                "gnss": {"rate_hz": 1.0, "sigma_velocity_m_s": [0.02, 0.02, 0.02]},
            }
        )
    ).recording
    result = navigate(
        r, {"imu": good, "alignment": {"method": "gyrocompass", "rest_s": 300.0, "tilt_floor_deg": 0.001}}
    )
    errors = result.errors(r.reference)
    assert np.abs(errors.attitude_n[0, 2]) < 4.0 * result.sigma("dpsi")[0, 2]
    assert result.sigma("dpsi")[0, 2] < 0.5 * units.DEG


def test_clocks_that_do_not_overlap_are_refused(recording):
    off = Recording(recording.imu.shifted(1e5), recording.gnss, None, recording.reference)
    with pytest.raises(InputError, match=r"no GNSS fix lies within the IMU log .* check the clocks"):
        navigate(off, config())


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"imu": {"catalogue": "VN-200"}}, "give either catalogue"),
        ({"imu": {"gyro": {}, "accel": {}}}, "give either catalogue"),
        ({"filter": {"states": 16}}, "filter.states"),
        ({"filter": {"state": 15}}, "filter.state: unknown entry; did you mean states?"),
        ({"gnss": {"gate": 2.0}}, "gnss.gate"),
        ({"outages": {"windows_s": [[5.0, 4.0]]}}, r"an outage stops after it starts, got 5\.0\.\.4\.0 s"),
        ({"outages": {"every_s": 10.0}}, "every_s and length_s go together"),
        ({"outages": {"every_s": 10.0, "length_s": 10.0}}, "length_s must be shorter than every_s"),
        ({"alignment": {"method": "given"}}, "rpy_deg goes with method"),
    ],
)
def test_faulty_configurations_are_refused_with_place_and_reason(sections, message):
    with pytest.raises(ConfigError, match=message):
        NavigationConfig.parse(config(**sections))


@pytest.mark.parametrize(("missing", "sensors"), [("accel", "accelerometers"), ("gyro", "gyroscopes")])
def test_a_budget_from_a_log_of_one_triad_alone_is_refused(tmp_path, missing, sensors):
    """Identified from gyroscopes alone it would make the accelerometers perfect."""
    spec = catalogue.spec("consumer")
    path = write_spec(tmp_path / "imu.toml", replace(spec, **{missing: TriadSpec(random_walk=0.0)}))
    config = NavigationConfig.parse({"imu": {"spec": str(path)}})
    with pytest.raises(ConfigError, match=rf"got nothing of the {sensors} .* into its section \[{missing}\]"):
        imu_spec(config)


def test_unknown_data_sheet_values_are_refused(recording):
    bad = config(imu={"gyro": {"arw_deg_hr": 1.0}})
    with pytest.raises(InputError, match="arw_deg_rthr"):
        navigate(recording, bad)


def test_unknown_state_blocks_are_refused(recording):
    with pytest.raises(InputError, match="b_x"):
        navigate(recording, config(filter={"states": ["b_a", "b_x"]}))


def test_results_are_reproducible(recording):
    a, b = navigate(recording, config()), navigate(recording, config())
    np.testing.assert_array_equal(a.trajectory.r_eb_e, b.trajectory.r_eb_e)
    np.testing.assert_array_equal(a.smooth().trajectory.q_eb, b.smooth().trajectory.q_eb)
    assert a.provenance["config"]["gnss"]["lever_arm_m"] == LEVER or a.provenance["config"]["gnss"][
        "lever_arm_m"
    ] == tuple(LEVER)


def test_summary_is_for_people(recording):
    text = navigate(recording, config()).summary()
    assert "filtered solution" in text
    assert "position: " in text
    assert "mean normalised innovation squared" in text


@pytest.mark.campaign
@pytest.mark.realdata
def test_real_drive_with_rtk_on(shared_data):
    """Cheap MEMS in a car: below 5 cm RMS to the RTK it is fed with."""
    recording, reference = real_drive(shared_data)
    result = navigate(recording, EXAMPLES / "rtkexp_drive.toml")
    errors = result.errors(reference, at_antenna=True)
    assert errors.rms_horizontal < 0.05
    # its noise is that of ten seconds without a fix (test_drive.py), four times a second it is more than there is
    assert 0.1 < result.innovations.of("position").mean_nis() < 1.0


@pytest.mark.campaign
@pytest.mark.realdata
def test_real_drive_through_eleven_outages(shared_data):
    """Eleven outages of 15 s: a peer's causal filter drifts 7.5 m on average with position and velocity only."""
    import tomllib

    recording, reference = real_drive(shared_data)
    data = tomllib.loads((EXAMPLES / "rtkexp_drive.toml").read_text())
    data["outages"] = {"every_s": 45.0, "length_s": 15.0, "first_s": 40.0}
    result = navigate(recording, data)
    assert len(result.outages) == 11
    causal = outage_errors(result.errors(reference, at_antenna=True), result.outages)
    smoothed = outage_errors(result.smooth().errors(reference, at_antenna=True), result.outages)
    assert np.mean([o.max_horizontal for o in causal]) < 7.5
    assert np.mean([o.max_horizontal for o in smoothed]) < 1.0


def real_drive(shared_data):
    import tomllib

    from schuler.recording.io import read

    data = tomllib.loads((EXAMPLES / "rtkexp_drive.toml").read_text())
    recording = read(shared_data / "rtkexp_drive", **data["recording"])
    g = recording.gnss
    return recording, Trajectory.from_geodetic(g.t, g.llh, g.v_n)


def test_a_log_simulated_on_a_still_earth_is_navigated_on_one():
    data = {
        "seed": 4,
        "motion": {
            "type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "waypoints": POINTS, "earth_rotation": False,
        },
        "imu": {"rate_hz": 100.0, "kind": "increment", **IMU},
        "gnss": {"rate_hz": 1.0, "lever_arm_m": LEVER},
    }  # fmt: skip
    recording = simulate_mission(prepare_mission(data)).recording
    with pytest.raises(ConfigError, match="earth_rotation is true, but the recording was simulated with false"):
        navigate(recording, config())
    result = navigate(recording, config(filter={"earth_rotation": False}))
    assert 0.9 < result.innovations.mean_nis() < 1.1


def test_provenance_repeats_the_simulation(recording):
    """Scenario and seed are in the result, so that the log can be made again from a solution file alone."""
    options = navigate(recording, config()).provenance["recording_options"]
    again = simulate_mission(prepare_mission(options["scenario"]), np.random.default_rng(options["seed"])).recording
    np.testing.assert_array_equal(again.imu.gyro, recording.imu.gyro)
    np.testing.assert_array_equal(again.gnss.llh, recording.gnss.llh)
    child = np.random.default_rng(np.random.SeedSequence(5).spawn(3)[2])
    seed = simulate_mission(prepare_mission(options["scenario"]), child).recording.metadata.options["seed"]
    assert seed == {"entropy": 5, "spawn_key": [2]}


def test_the_antenna_is_where_the_estimated_lever_arm_puts_it(recording):
    """Wrong by 0.5 m in the configuration, estimated: the antenna is the IMU moved by the sum."""
    wrong = np.array([0.5, 0.0, 0.0])
    given = np.array(LEVER) + wrong
    result = navigate(recording, config(gnss={"lever_arm_m": list(given), "lever_sigma_m": 0.5}))
    last = given + result.parameter("lever")[-1]
    moved = result.trajectory.moved_by(last)
    np.testing.assert_allclose(result.antenna().r_eb_e[-1], moved.r_eb_e[-1], atol=1e-8)  # rounding of 6.4e6 m
    assert np.linalg.norm(result.antenna().r_eb_e[-1] - result.trajectory.moved_by(given).r_eb_e[-1]) > 0.01
