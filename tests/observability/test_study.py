"""Scenarios and runs: the examples, the results of chapter 5, real filters of any kind."""

from dataclasses import replace

import numpy as np
import pytest
from places import EXAMPLES

from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import navigate
from schuler.navigation.states import imu_spec
from schuler.observability import (
    ObservabilityScenario,
    observability,
    result_system,
    scenario_observability,
    scenario_system,
    spectrum,
)
from schuler.observability.symbolic import scenario_formulas, scenario_model
from schuler.sensors import catalogue
from schuler.simulation.scenario import simulate
from schuler.units import DEG, DEG_PER_HR

#: Of the examples: rank without Earth rate (Du, section 5.3) and what stays hidden.
EXPECTED = {
    "conventional": (8, {"eps_U", "d_U", "eps_E with b_N = g eps_E", "eps_N with b_E = -g eps_N"}),
    "rotary_x": (10, {"eps_U", "eps_N with b_E = -g eps_N"}),
    "rotary_y": (10, {"eps_U", "eps_E with b_N = g eps_E"}),
    "rotary_z_level": (
        8,
        {"eps_U", "d_U", "eps_E with d_N = w eps_E, b_N = g eps_E", "eps_N with d_E = -w eps_N, b_E = -g eps_N"},
    ),
    "rotary_z_tilted": (11, {"eps_U"}),
}


def example(name, **changes):
    return ObservabilityScenario.load(EXAMPLES / f"observability_{name}.toml").model_copy(update=changes)


def base(**changes):
    data = {
        "imu": "NAV440-emulated",
        "motion": {"type": "static", "lat_deg": 45.75, "lon_deg": 0.0, "duration_s": 30.0},
        "velocity": {"rate_hz": 2.0},
    }
    return data | changes


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", EXPECTED)
def test_examples(name):
    """The engine's own rows, the motion's own transitions: the expected ranks by all three rules."""
    rank, hidden = EXPECTED[name]
    result = scenario_observability(example(name))
    s = result.spectrum
    assert (s.formal, s.rank, s.useful) == (rank, rank, rank)
    assert {c.text for c in result.unseen()} == hidden
    assert len(result.seen()) == rank
    assert result.summary().startswith(result.system.name)


def test_driving_makes_everything_observable():
    """F28: at rest heading and the biases hidden behind tilts are unknown, after the first turns all is known."""
    result = scenario_observability(example("manoeuvre", every_s=10.0))
    at_rest = spectrum(scenario_system(example("manoeuvre")), until=60.0)
    assert result.spectrum.useful == 15
    assert at_rest.useful < 15
    names = list(result.degree.names)
    heading = result.degree.ratio[:, names.index("eps_D")]
    assert heading[result.degree.t <= 60.0].min() > 0.3
    assert heading[-1] < 0.1


#: Du, chapter 5, after 300 s, as printed: tilt east and north [deg], azimuth [deg], accelerometers x and y [m/s^2],
#: gyroscopes x, y, z [deg/h].
ANCHORS = {
    ("NAV440", "conventional"): "0.76 0.76 31 0.13 0.13 7 5 375",
    ("NAV440", "rotary_y"): "0.76 0.021 1.0 0.001 0.13 7 5 7",
    ("NAV440", "rotary_z_level"): "0.49 0.49 12.9 0.083 0.083 307 307 156",
    ("NAV440", "rotary_z_tilted"): "0.022 0.023 1.0 0.001 0.001 8 8 7",
    ("MTi-G", "conventional"): "0.51 0.51 197 0.086 0.086 30 17 2363",
    ("MTi-G", "rotary_y"): "0.51 0.055 1.3 <0.001 0.086 21 17 21",
    ("MTi-G", "rotary_z_level"): "0.51 0.51 94 0.086 0.086 317 317 1130",
    ("MTi-G", "rotary_z_tilted"): "0.055 0.055 2.0 0.001 0.001 18 18 26",
}
#: Du, chapter 5: prior of accelerometers [m/s^2] and gyroscopes [rad/s], walk of the latter, angle and
#: velocity walks. SI
NOISE = {
    "NAV440": (0.2, 400.0 * DEG_PER_HR, 10.0 * DEG_PER_HR, 0.4 * DEG / 60.0, 0.5 / 60.0),
    "MTi-G": (0.1, DEG, 20.0 * DEG_PER_HR, 3.0 * DEG / 60.0, 0.002),
}


@pytest.mark.parametrize(("imu", "name"), ANCHORS)
@pytest.mark.thinned(4)
def test_means_and_sigmas_of_chapter_5(imu, name):
    """Standard deviations of a velocity filter at 1 Hz, 1 cm/s. Tolerance: 0.6 of the last printed digit, or 1.5 % for
    how the reference puts noise into steps of a second (it matters for the MTi-G's tilt, 0.0543 here)."""
    accel, gyro, walk, arw, vrw = NOISE[imu]
    data = example(name).model_dump(exclude_defaults=True)
    data |= {"velocity": {"rate_hz": 1.0, "sigma_m_s": 0.01}}
    data["motion"]["earth_rotation"] = True
    data["prior"] = {"velocity_m_s": (0.01, 0.01, 0.01)}
    root = np.sqrt(2.0 / 300.0)
    data["models"] = {"b_a": {"sigma": accel, "noise": 5e-4 * root}, "b_g": {"sigma": gyro, "noise": walk * root}}
    system = scenario_system(data)
    psd = system.psd.copy()
    psd[0:3], psd[3:6] = arw**2, vrw**2
    result = observability(replace(system, psd=psd), axes="enu", every_s=300.0)
    sigma = dict(zip(result.degree.names, result.degree.sigma[-1], strict=True))
    names = ("eps_E", "eps_N", "eps_U", "b_x", "b_y", "d_x", "d_y", "d_z")
    units = (DEG, DEG, DEG, 1.0, 1.0, DEG_PER_HR, DEG_PER_HR, DEG_PER_HR)
    for state, unit, printed in zip(names, units, ANCHORS[imu, name].split(), strict=True):
        if printed.startswith("<"):
            assert sigma[state] / unit < float(printed[1:]), state
            continue
        last = 10.0 ** -len(printed.partition(".")[2])
        assert sigma[state] / unit == pytest.approx(float(printed), abs=0.6 * last, rel=0.015), state


def test_states_of_a_filter_with_more_of_them():
    """Scale factors, a lever arm, aids: named, with models where the IMU says nothing."""
    data = base(
        states=["b_a", "b_g", "S_a", "lever"], models={"lever": {"sigma": 0.5}, "S_a": {"sigma": 1e-3}},
        gnss={"lever_arm_m": [1.0, 0.0, -1.0]}, zero_velocity={}, heading={},
    )  # fmt: skip
    result = scenario_observability(data)
    assert result.system.names[15:18] == ("S_a_x", "S_a_y", "S_a_z")
    assert result.system.names[18:] == ("lever_x", "lever_y", "lever_z")
    rows = {row[0]: row[1] for row in result.table().rows}
    assert rows["b_a_z"] == "no"  # hidden behind the scale factor of the axis that feels gravity
    texts = [c.text for c in result.unseen()]
    assert any("S_a_z" in t and "b_a" in t for t in texts)


def test_a_lever_arm_on_a_rotating_imu_turns_in_its_axes():
    """Velocities of the antenna: what turns with the platform is the IMU, the vehicle rests."""
    data = base(
        velocity={"rate_hz": 2.0, "lever_arm_m": [1.0, 0.5, 0.0]},
        rotary={"schedule": {"type": "continuous", "axis": "z", "rate_deg_s": 20.0}},
    )
    from schuler.observability.scenario import measurements, scenario_motion

    scenario = ObservabilityScenario.parse(data)
    vehicle, imu, schedule = scenario_motion(scenario)
    result = measurements(scenario, vehicle, imu, schedule)
    assert np.abs(result.z[:, :3]).max() < 1e-12  # the antenna rests
    C = schedule.C_bs(result.t)
    assert result.lever == pytest.approx(np.einsum("nji,j->ni", C, [1.0, 0.5, 0.0]), abs=1e-12)
    rate = np.linalg.norm(result.z[:, 3:6], axis=1)
    assert rate == pytest.approx(np.hypot(1.0, 0.5) * 20.0 * DEG, rel=1e-9)


def test_a_recorded_run_is_looked_at_as_it_was():
    """What the filter itself kept: the same ranks as along the true motion, at rest and driving."""
    motion = {
        "type": "waypoints", "lat_deg": 45.75, "lon_deg": 0.0,
        "waypoints": [
            {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 20.0},
            {"north_m": 150.0, "east_m": 0.0, "speed_m_s": 12.0},
            {"north_m": 200.0, "east_m": 100.0, "speed_m_s": 9.0},
            {"north_m": 50.0, "east_m": 150.0, "speed_m_s": 9.0},
        ],
    }  # fmt: skip
    recording = simulate(
        {"motion": motion, "imu": {"catalogue": "NAV440-emulated", "rate_hz": 50.0}, "gnss": {"rate_hz": 2.0}}
    )
    result = navigate(recording, {"imu": {"catalogue": "NAV440-emulated"}, "filter": {"states": 15, "smooth": True}})
    system = result_system(result)
    assert system.names[:9:3] == ("eps_N", "dv_N", "dr_N")
    assert system.n == 15
    outcome = spectrum(system)
    assert outcome.formal == 15
    spec = catalogue.spec("NAV440-emulated")
    psd = {"gyro_psd": spec.gyro.random_walk**2, "accel_psd": spec.accel.random_walk**2}
    study = observability(result_system(result, **psd), every_s=20.0)
    own = np.sqrt(np.diag(result.state_at(-1).P))  # that of the filter: the attitude is claimed no better than the axes
    assert result.t[-1] == pytest.approx(study.degree.t[-1], abs=1.0)
    assert study.degree.sigma[-1] == pytest.approx(own, rel=0.02)  # discretisation, and up to a second between the two
    with pytest.raises(InputError, match=r"filter\.smooth"):
        result_system(result.smooth())


@pytest.mark.campaign
@pytest.mark.realdata
def test_a_recorded_drive(shared_data):
    """29 states on a car (rtkexp_drive): sigmas are the run's own, and height cannot be told from the antenna's height
    above the IMU, which is estimated beside it."""
    from schuler.recording.io import read

    config = NavigationConfig.load(EXAMPLES / "rtkexp_drive.toml", [("filter.smooth", True)])
    spec = imu_spec(config)
    result = navigate(read(shared_data / "rtkexp_drive", **config.recording), config)
    psd = {"gyro_psd": spec.gyro.random_walk**2, "accel_psd": spec.accel.random_walk**2}
    outcome = observability(result_system(result, **psd), every_s=60.0)
    assert outcome.system.n == result.layout.size == 29
    assert outcome.degree.sigma[-1] == pytest.approx(np.sqrt(np.diag(result.covariance[-1])), rel=5e-3)
    assert outcome.spectrum.useful == 28
    (hidden,) = outcome.unseen()
    assert hidden.text.startswith("lever_z with")
    down = (
        hidden.coefficients[outcome.along.names.index("dr_D")]
        / hidden.coefficients[outcome.along.names.index("lever_z")]
    )
    assert down == pytest.approx(-1.0, abs=0.02)


@pytest.mark.campaign
def test_formulas_of_scenarios():
    """Letters beside numbers: the ranks are the same."""
    for name in ("conventional", "rotary_x", "rotary_z_level", "rotary_z_tilted"):
        texts = scenario_formulas(example(name))
        assert texts[0] == f"rank {EXPECTED[name][0]} of 12"
    assert scenario_model(example("rotary_z_level", axes="ned")).names[0] == "dv_N"
    with pytest.raises(InputError, match="at rest"):
        scenario_formulas(example("manoeuvre"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"velocity": None}, "at least one measurement"),
        ({"states": ["b_a", "lever"]}, "models.lever"),
        ({"states": ["nothing"]}, "nothing"),
        ({"imu": "none at all"}, "catalogue"),
        ({"known": ["dx"]}, "no state 'dx'"),
        ({"colour": 1}, "colour"),
        ({"heading": {}, "rotary": {"schedule": {"type": "continuous", "rate_deg_s": 5.0}}}, "not with a rotary IMU"),
    ],
)
def test_faults_say_what_to_do(changes, message):
    with pytest.raises(InputError, match=message):
        scenario_system(base(**changes))


def test_plain_numbers():
    result = scenario_observability(base(known=("dr",), states=["b_a", "b_g"])).to_dict()
    assert result["rank"] <= result["rank_formal"] <= 12
    assert len(result["singular_values"]) == 12
    assert set(result["sigma_of_prior"]) == set(result["states"])
    assert all(set(c) == {"text", "factors"} for c in result["seen"])
