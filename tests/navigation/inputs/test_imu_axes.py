"""The attitude is claimed no better than the sensors' axes are known, and nothing else of a solution changes."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel, layout_for
from schuler.mechanization.strapdown import NavState
from schuler.navigation import navigator_file
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import attitude_difference, separation
from schuler.navigation.inputs.imu_axes import AXES_UNCERTAIN, axes_covariance, axes_note, claimed_attitude
from schuler.navigation.navigator import Navigator
from schuler.navigation.run import navigate
from schuler.navigation.solution_tables import result_of, tables_of
from schuler.navigation.start.calibration import calibration_start
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.simulation.scenario import prepare_mission, simulate_mission

GYRO = {"arw_deg_rthr": 0.2, "bias_deg_hr": 100.0, "scale_ppm": 1000.0}
ACCEL = {"vrw_m_s_rthr": 0.05, "bias_mg": 3.0, "scale_ppm": 1000.0}
M_G, M_A = 0.01, 0.02
TILTED = {"gyro": {**GYRO, "misalignment_mrad": 1e3 * M_G}, "accel": {**ACCEL, "misalignment_mrad": 1e3 * M_A}}
SPEC = ImuSpec(
    "test", TriadSpec.gyro(density=None, **TILTED["gyro"]), TriadSpec.accelerometer(density=None, **TILTED["accel"])
)
LEVER = [0.7, 0.1, -1.0]
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 25.0},
    {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0},
    {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
    {"north_m": -60.0, "east_m": 300.0, "speed_m_s": 10.0},
]


def aiding(**sections):
    return NavigationConfig.parse({"imu": {"catalogue": "MPU-6050"}, "aiding": sections}).aiding


def config(imu, states=15, smooth=True):
    return {"imu": imu, "gnss": {"lever_arm_m": LEVER}, "filter": {"smooth": smooth, "tune": False, "states": states}}


def random_covariance(rng, scale, k=()):
    A = rng.standard_normal((*k, 3, 3)) * scale
    return A @ np.swapaxes(A, -1, -2)


@pytest.fixture(scope="module")
def mission():
    return prepare_mission(
        {
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": 50.0, "kind": "rate", **TILTED},
            "gnss": {"rate_hz": 1.0, "first_s": 0.37, "lever_arm_m": LEVER},
        }
    )


@pytest.fixture(scope="module")
def recording(mission):
    return simulate_mission(mission, np.random.default_rng(1)).recording


@pytest.fixture(scope="module")
def runs(recording):
    """One run, with the attitude claimed as its axes are known and as the filter has it."""
    claimed = navigate(recording, config(TILTED))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("schuler.navigation.run.axes_covariance", lambda *given: np.zeros((3, 3)))
        return claimed, navigate(recording, config(TILTED))


# ---------------------------------------------------------------------------------------------- one function for all


def test_no_direction_is_better_known_than_the_axes(rng):
    """Above both, in every direction; rounding."""
    P, F = random_covariance(rng, [0.01, 0.03, 0.001], (40,)), np.diag([4e-4, 1e-4, 0.0])
    C = rotation.dcm_from_rotvec(rng.standard_normal((40, 3)))
    claim, F_n = claimed_attitude(P, C, F), C @ F @ np.swapaxes(C, 1, 2)
    for more in (claim - P, claim - F_n):
        assert np.linalg.eigvalsh(more).min() > -1e-18
    np.testing.assert_array_equal(claim, np.swapaxes(claim, 1, 2))
    # the same in other axes, and one by one; rounding
    D = rotation.dcm_from_rotvec([0.3, -1.0, 0.5])
    np.testing.assert_allclose(claimed_attitude(D @ P @ D.T, D @ C, F), D @ claim @ D.T, atol=1e-18)
    np.testing.assert_array_equal(claimed_attitude(P[7], C[7], F), claim[7])


def test_known_alike_about_all_axes_it_lifts_eigenvalues(rng):
    """Closed form: those below ``m^2`` become ``m^2``, the others stay, and so do directions; rounding."""
    V, C = (rotation.dcm_from_rotvec(rng.standard_normal(3)) for _ in range(2))
    claim = claimed_attitude(V @ np.diag([1e-6, 3e-4, 9e-4]) @ V.T, C, 4e-4 * np.eye(3))
    np.testing.assert_allclose(V.T @ claim @ V, np.diag([4e-4, 4e-4, 9e-4]), atol=1e-18)


def test_what_is_worse_known_stays_to_the_last_bit(rng):
    P = np.eye(3) + random_covariance(rng, 1.0, (5,))
    P[1] = np.nan
    np.testing.assert_array_equal(claimed_attitude(P, np.eye(3), 1e-4 * np.eye(3)), P)


# ------------------------------------------------------------------------------------------------ what is not known


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        (9, M_A), (15, M_A), (21, M_A), (33, 0.0),
        (("b_a", "b_g", "M_a6"), M_G),  # the gyroscopes' axes are taken for the body's
        (("b_a", "b_g", "M_g"), M_A),
        (("b_a", "b_g", "M_a", "M_g"), M_A),  # axes of the accelerometers: the gauge is upper
    ],
)  # fmt: skip
def test_axes_are_known_as_cross_couplings_without_states_are(states, expected):
    """The largest of the four cross-couplings about an axis; those with states are in the filter's covariance."""
    F = axes_covariance(SPEC, layout_for(SPEC, states), aiding())
    np.testing.assert_array_equal(F, np.diag(np.full(3, expected**2)))


@pytest.mark.parametrize(
    ("sections", "models", "shown"),
    [
        ({"non_holonomic": {"mount_sigma_deg": 0.0}}, (), (1, 2)),
        ({"non_holonomic": {}}, ("mount",), ()),
        ({"heading": {}}, (), (2,)),
        ({"heading": {"bias_sigma_deg": 1.0}}, ("b_heading",), ()),
        ({"odometer": {}, "zero_velocity": {}}, ("odometer",), ()),
    ],
)
def test_aids_that_show_the_body_itself_count(sections, models, shown):
    """The vehicle's motion, if the body is the vehicle; a heading sensor, if its heading is the body's."""
    layout = StateLayout({**layout_for(SPEC, 15).models, **{name: StateModel.constant(0.02) for name in models}})
    expected = np.array([0.0 if k in shown else M_A**2 for k in range(3)])
    np.testing.assert_array_equal(np.diag(axes_covariance(SPEC, layout, aiding(**sections))), expected)


def test_a_calibration_says_it_instead_of_the_budget():
    """All elements to 0.1 mrad but one, 0.3 mrad; with the accelerometers alone the gyroscopes keep the budget's."""
    from schuler.calibration.result.parameters import LINEAR, vector
    from schuler.calibration.result.result import CalibrationResult

    layout = layout_for(SPEC, 15)

    def start(names):
        drawn = vector(ImuErrors.draw(SPEC, np.random.default_rng(1)), names)
        variance = np.array([(3e-4 if name == "M_g_zy" else 1e-4) ** 2 for name in names])
        return calibration_start(
            CalibrationResult("multiposition", names, drawn, np.diag(variance), "full"), layout, SPEC
        )

    # what was measured acts through the part of the errors that is taken out: 2 % of a variance, linearisation
    of_all = np.diag(axes_covariance(SPEC, layout, aiding(), start(LINEAR)))
    np.testing.assert_allclose(np.sqrt(of_all), [3e-4, 1e-4, 1e-4], rtol=0.05)
    some = start(tuple(name for name in LINEAR if name[:3] in ("b_a", "M_a")))
    np.testing.assert_allclose(np.sqrt(np.diag(axes_covariance(SPEC, layout, aiding(), some))), M_G, rtol=0.05)


# ------------------------------------------------------------------------------------------------------- solutions


def test_only_the_claimed_attitude_changes(runs):
    """Estimates, all other covariances and what a run goes on with: to the last bit those of the filter."""
    for claimed, plain in (runs, tuple(r.smooth() for r in runs)):
        for name in ("r_eb_e", "v_eb_e", "q_eb"):
            np.testing.assert_array_equal(getattr(claimed.trajectory, name), getattr(plain.trajectory, name))
        np.testing.assert_array_equal(claimed.parameters, plain.parameters)
        np.testing.assert_array_equal(claimed.covariance_e[:, 3:], plain.covariance_e[:, 3:])
        np.testing.assert_array_equal(claimed.filter_covariance_e(), plain.covariance_e)
        np.testing.assert_array_equal(claimed.state_at(-1).P, plain.state_at(-1).P)
        np.testing.assert_array_equal(claimed.state_at(7).P, plain.state_at(7).P)
        assert claimed.sigma("dpsi")[-1].min() > 0.999 * M_A
        assert plain.sigma("dpsi")[-1, :2].max() < 0.5 * M_A
    pairs = [separation(*pair) for pair in zip(runs, [r.smooth() for r in runs], strict=True)]
    np.testing.assert_array_equal(pairs[0].covariance, pairs[1].covariance)


def test_the_note_says_what_is_claimed(runs):
    claimed, plain = (r.verdict.remarks for r in runs)
    note = next(remark for remark in claimed if remark.startswith(AXES_UNCERTAIN))
    assert "budget states to 1.1 deg" in note
    assert "33 states" in note
    assert not any(remark.startswith(AXES_UNCERTAIN) for remark in plain)
    F, P = np.diag([0.0, 4e-4, 0.0]), np.eye(3) * 1e-6
    assert "calibration states to 1.1 deg" in axes_note(F, P, calibrated=True)[0]
    assert not axes_note(F, 1e-4 * np.eye(3))
    assert not axes_note(0.0 * F, 0.0 * P)


def test_tables_of_a_result_keep_both(runs):
    back = result_of(tables_of(runs[0]))
    np.testing.assert_array_equal(back.covariance_e, runs[0].covariance_e)
    np.testing.assert_array_equal(back.filter_covariance_e(), runs[0].filter_covariance_e())
    np.testing.assert_array_equal(back.axes_covariance_b, runs[0].axes_covariance_b)


def navigator(F=None):
    layout = layout_for(SPEC, 15)
    nav = NavState.from_geodetic(0.0, [0.8, 0.1, 400.0], rpy_nb=[0.1, 0.2, 0.3])
    initial = InitialState.from_sigmas(nav, layout, attitude=[0.001] * 3, velocity=[0.1] * 3, position=[1.0] * 3)
    live = Navigator(initial, layout, [1e-8] * 3, [1e-6] * 3, interval_s=0.01, axes_covariance_b=F)
    for k in range(30):
        live.imu(0.01 * (k + 1), [1e-4, 0.0, 2e-4], [0.0, 0.0, -0.0981])
    return live


def test_a_navigator_claims_the_same(tmp_path):
    """As a result does, in north-east-down; copies and files keep it, a file without it (of before) claims less."""
    F = np.diag([4e-4, 4e-4, 1e-4])
    live, plain = navigator(F), navigator()
    np.testing.assert_array_equal(live.state.q_eb, plain.state.q_eb)
    expected = plain.covariance
    expected[:3, :3] = claimed_attitude(
        expected[:3, :3], frames.C_en(plain.state.llh).T @ rotation.dcm_from_quat(plain.state.q_eb), F
    )
    np.testing.assert_allclose(live.covariance, expected, atol=1e-15 * expected.max())  # rounding of two rotations
    np.testing.assert_array_equal(live.covariance[3:, 3:], plain.covariance[3:, 3:])
    path = live.save(tmp_path / "live.json")
    for other in (copy.copy(live), Navigator.load(path)):
        np.testing.assert_array_equal(other.covariance, live.covariance)
    document = navigator_file.read_document(path)
    del document["axes_covariance_b"]
    old = Navigator.load(navigator_file.write_document(tmp_path / "old.json", document))
    np.testing.assert_array_equal(old.covariance, plain.covariance)
    assert json.loads(path.read_text().splitlines()[0])["format"] == navigator_file.NAVIGATOR_FORMAT


@pytest.mark.campaign
@pytest.mark.parametrize("states", [15, 21])
def test_attitudes_lie_inside_their_claims(mission, states):
    """NEES of the attitude of 24 drives, misalignments drawn from the budget.

    Per degree of freedom 0.5 to 1.3: cross-couplings are the same for a whole drive, so that there are about 72 values
    (statistical, 4 sigmas); below 1, since no direction is known worse than by the larger of two cross-couplings.
    """
    mean = {"filtered": [], "smoothed": []}
    for seed in range(24):
        recording = simulate_mission(mission, np.random.default_rng(seed)).recording
        result = navigate(recording, config(TILTED, states))
        for name, solution in (("filtered", result), ("smoothed", result.smooth())):
            late = solution.t > solution.t[0] + 30.0
            truth = mission.ideal.truth.at(solution.t[late]).full()
            psi = attitude_difference(solution.states.q_eb[late], truth.q_eb)
            P = solution.covariance_e[late, :3, :3]
            mean[name].append(np.einsum("ki,ki->k", psi, np.linalg.solve(P, psi[:, :, None])[:, :, 0]).mean() / 3.0)
    for name, values in mean.items():
        assert 0.4 < np.mean(values) < 1.3, name


def test_broken_covariances_are_still_seen(runs):
    """An attitude block that is no covariance, under a claim that is one."""
    own = runs[0].filter_covariance_e()[:, :3, :3].copy()
    own[-1, 0, 1] = own[-1, 1, 0] = 2.0 * np.sqrt(own[-1, 0, 0] * own[-1, 1, 1])
    assert not any("not positive" in reason for reason in runs[0].verdict.reasons)
    assert any("not positive" in reason for reason in replace(runs[0], _attitude_e=own).verdict.reasons)
