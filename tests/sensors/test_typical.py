"""Biases and scales that data sheets leave out: typical of the class, never zero, and stated ones stay."""

from __future__ import annotations

import pytest

from schuler import units
from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.navigation.states import imu_spec, state_layout
from schuler.sensors import catalogue
from schuler.sensors.spec import TriadSpec
from schuler.sensors.typical import typical_turn_on_bias, with_typical_biases

STATED = [
    n for n in catalogue.names("imu") if "emulated" not in n and catalogue.entry(n).gyro and catalogue.entry(n).accel
]
STATED = [n for n in STATED if not any("turn_on_bias" in text for text in catalogue.entry(n).unstated)]


@pytest.mark.parametrize("name", STATED)
@pytest.mark.parametrize("which", ["gyro", "accel"])
def test_what_is_typical_is_of_the_size_that_sheets_state(name, which):
    triad = catalogue.triad(name, which)
    bias, _ = typical_turn_on_bias(triad, which)
    if name.startswith("MPU") and which == "gyro":
        assert bias < triad.turn_on_bias  # 20 deg/s is a tolerance of raw parts, removed by everybody at rest
    else:
        assert 1.0 / 60.0 < bias / triad.turn_on_bias < 60.0


def test_entries_without_turn_on_biases_say_so():
    for name in catalogue.names("imu"):
        entry = catalogue.entry(name)
        for which, table in (("gyro", entry.gyro), ("accel", entry.accel)):
            if table and "emulated" not in name:
                unstated = f"{which}.turn_on_bias" in entry.unstated
                assert unstated == (catalogue.triad(name, which).turn_on_bias == 0.0), (name, which)


@pytest.mark.parametrize(("name", "gyro_deg_hr", "accel_mg"), [("LN-200", 10.0, 1.0), ("VN-200", 720.0, 5.0)])
def test_navigation_takes_what_is_typical_and_says_so(name, gyro_deg_hr, accel_mg):
    notes = []
    spec = imu_spec(NavigationConfig.checked({"imu": {"catalogue": name}}), notes)
    assert spec.gyro.turn_on_bias / units.DEG_PER_HR == pytest.approx(gyro_deg_hr)
    assert spec.accel.turn_on_bias / units.MG == pytest.approx(accel_mg)
    assert len(notes) == 2
    assert all(name in note and "no turn-on bias" in note for note in notes)
    # the budget of the literature stays what its source prints
    assert catalogue.spec(name).gyro.turn_on_bias == 0.0
    layout = state_layout(NavigationConfig.checked({"imu": {"catalogue": name}}), spec)
    assert layout.models["b_a"].sigma >= spec.accel.turn_on_bias


def test_stated_biases_stay_zero_ones_too():
    notes = []
    assert imu_spec(NavigationConfig.checked({"imu": {"catalogue": "MTi-G-710"}}), notes) == catalogue.spec("MTi-G-710")
    grade = imu_spec(NavigationConfig.checked({"imu": {"catalogue": "flenniken-tactical"}}), notes)
    assert grade == catalogue.spec("flenniken-tactical")
    assert notes == []


def test_a_grade_says_that_the_part_is_unknown_so_its_biases_are_typical_ones():
    notes = []
    spec = imu_spec(NavigationConfig.checked({"imu": {"catalogue": "consumer"}}), notes)
    assert spec.gyro.turn_on_bias == pytest.approx(3.0 * units.DEG)
    assert spec.accel.turn_on_bias == pytest.approx(50.0 * units.MG)
    assert len(notes) == 2


def test_a_sheet_in_the_configuration_that_leaves_a_bias_out_is_completed_and_a_zero_stays():
    sheet = {"gyro": {"arw_deg_rthr": 0.2}, "accel": {"vrw_m_s_rthr": 0.05}}
    notes = []
    spec = imu_spec(NavigationConfig.checked({"imu": sheet}), notes)
    assert spec.gyro.turn_on_bias == pytest.approx(0.2 * units.DEG)
    assert len(notes) == 2
    notes.clear()
    zero = {"gyro": {"arw_deg_rthr": 0.2, "bias_deg_s": 0.0}, "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 0.0}}
    spec = imu_spec(NavigationConfig.checked({"imu": zero}), notes)
    assert spec.gyro.turn_on_bias == spec.accel.turn_on_bias == 0.0
    assert notes == []


def test_a_bias_is_not_typical_below_its_own_wander():
    triad = TriadSpec(random_walk=1e-6, bias_instability=0.01)
    assert typical_turn_on_bias(triad, "gyro")[0] == 0.01
    spec, _ = with_typical_biases(catalogue.spec("VN-200"), ())
    assert spec == catalogue.spec("VN-200")


@pytest.mark.parametrize("states", [21, 33, ("b_a", "b_g", "S_g", "M_g")])
def test_scales_that_the_states_estimate_are_typical_where_none_is_stated(states):
    """A part that is not known has a scale all the same: zero was an error that stopped the run."""
    config = NavigationConfig.checked({"imu": {"catalogue": "consumer"}, "filter": {"states": states}})
    notes = []
    spec = imu_spec(config, notes)
    assert spec.gyro.scale_factor == 0.03
    assert spec.accel.scale_factor == (0.0 if isinstance(states, tuple) else 0.03)
    assert spec.gyro.misalignment == (0.0 if states == 21 else 0.02)
    assert sum("3 % is taken, typical of consumer grade" in note for note in notes) == 1 + isinstance(states, int)
    layout = state_layout(config, spec)
    assert layout.models["S_g"].sigma == pytest.approx(0.03)


def test_scales_that_are_stated_or_not_estimated_stay():
    for section in (
        {"catalogue": "MPU-6050"},
        {"gyro": {"arw_deg_rthr": 0.2, "scale_ppm": 400.0}, "accel": {"vrw_m_s_rthr": 0.05}},
    ):
        plain = imu_spec(NavigationConfig.checked({"imu": section}))
        scaled = imu_spec(NavigationConfig.checked({"imu": section, "filter": {"states": 21}}))
        assert scaled.gyro.scale_factor == plain.gyro.scale_factor > 0.0
        assert plain.accel.scale_factor in (0.0, scaled.accel.scale_factor)
        assert scaled.accel.scale_factor > 0.0
    zero = {"gyro": {"arw_deg_rthr": 0.2, "scale_ppm": 0.0}, "accel": {"vrw_m_s_rthr": 0.05}}
    assert imu_spec(NavigationConfig.checked({"imu": zero, "filter": {"states": 21}})).gyro.scale_factor == 0.0
    own = NavigationConfig.checked({"imu": {"catalogue": "flenniken-consumer"}, "filter": {"states": 21}})
    with pytest.raises(InputError, match="nothing to estimate"):
        state_layout(own, imu_spec(own))
