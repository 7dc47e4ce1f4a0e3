"""State layouts: order, names, models, and the layouts made for an IMU's error budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout, StateModel, layout_for
from schuler.sensors import catalogue
from schuler.sensors.noise import GaussMarkov, RandomWalk
from schuler.sensors.spec import ImuSpec, TriadSpec, allan_minimum

SPEC = ImuSpec(
    name="test",
    gyro=TriadSpec.gyro(
        arw_deg_rthr=0.2, bias_deg_hr=100.0, in_run_deg_hr=5.0, in_run_time_s=600.0, scale_ppm=800.0,
        misalignment_mrad=0.7, g_sensitivity_deg_hr_g=20.0,
    ),
    accel=TriadSpec.accelerometer(
        vrw_m_s_rthr=0.05, bias_mg=3.0, in_run_mg=0.05, in_run_time_s=300.0, scale_ppm=500.0, misalignment_mrad=0.4
    ),
)  # fmt: skip
SPEC_WITHOUT_WANDER = ImuSpec(
    "steady",
    gyro=TriadSpec.gyro(arw_deg_rthr=0.2, bias_deg_hr=1.0, scale_ppm=800.0),
    accel=TriadSpec.accelerometer(vrw_m_s_rthr=0.05, bias_mg=3.0, in_run_mg=0.05, in_run_time_s=300.0, scale_ppm=500.0),
)


def test_sensor_blocks_stand_before_the_others():
    layout = StateLayout({"lever": StateModel.constant(0.1), "b_g": StateModel.constant(1.0)})
    assert layout.blocks == ["dpsi", "dv", "dr", "b_g", "lever"]
    assert layout["b_g"] == slice(9, 12)
    assert layout["lever"] == slice(12, 15)
    assert layout.size == 15
    assert layout.n_sensor == 3
    assert layout.names[9] == "b_g[0]"
    assert "b_a" not in layout
    assert len(layout.table()) == 6


@pytest.mark.parametrize(
    ("states", "blocks"),
    [
        (9, []),
        (15, ["b_a", "b_g"]),
        (21, ["b_a", "b_g", "S_a", "S_g"]),
        (27, ["b_a", "b_g", "S_a", "S_g", "b_a_run", "b_g_run"]),
        (33, ["b_a", "b_g", "S_a", "S_g", "M_a6", "M_g"]),
        (42, ["b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g"]),
    ],
)
def test_numbers_of_states_mean_what_they_say(states, blocks):
    layout = layout_for(SPEC, states)
    assert layout.size == states
    assert list(layout.models) == blocks
    assert len(layout.initial_variances()) == len(layout.dynamics()) == len(layout.table()) == states - 9


def test_models_follow_the_budget():
    models = layout_for(SPEC, 42).models
    bias, wander = SPEC.gyro.turn_on_bias, SPEC.gyro.in_run_bias
    assert models["b_g"].sigma == pytest.approx(np.hypot(bias, wander))
    assert models["b_g"].noise == pytest.approx(wander * np.sqrt(2.0 / 600.0))
    assert models["b_g"].tau is None
    assert models["S_a"] == StateModel.constant(500e-6)
    assert models["M_g"] == StateModel.constant(0.7e-3)
    assert models["G_g"].sigma == SPEC.gyro.g_sensitivity > 0.0
    both = layout_for(SPEC, 27).models
    assert both["b_a_run"].tau == 300.0
    assert both["b_a"] == StateModel.constant(SPEC.accel.turn_on_bias)  # the wander stands in its own block


@pytest.mark.parametrize(("tau", "within"), [(20.0, 0.12), (50.0, 0.12), (100.0, 0.16)])
def test_an_in_run_block_stands_for_a_bias_instability_below_its_walk(tau, within):
    """The Allan deviation of both together is the flat 0.664 B, where the walk alone is too little (discretisation:
    one process a decade).
    """
    models = layout_for(catalogue.spec("MTi-G-710"), ("b_a", "b_g", "b_a_run", "b_g_run")).models
    for name, triad in (("b_a", catalogue.spec("MTi-G-710").accel), ("b_g", catalogue.spec("MTi-G-710").gyro)):
        walk, run, flat = models[name], models[f"{name}_run"], allan_minimum(triad.bias_instability)
        assert run.noise**2 * run.tau / 2.0 == pytest.approx(run.sigma**2)
        alone = RandomWalk(walk.noise).allan_variance(tau)
        both = alone + GaussMarkov(run.sigma, run.tau).allan_variance(tau)
        assert np.sqrt(both) == pytest.approx(flat, rel=within)
        assert alone <= flat**2 * tau / 100.0 * (1.0 + 1e-12)


def test_a_gauss_markov_model_keeps_its_variance():
    model = StateModel.gauss_markov(2.0, 50.0)
    assert model.noise**2 * model.tau / 2.0 == pytest.approx(model.sigma**2)


@pytest.mark.parametrize("name", ["MPU-6000", "HG1700", "VN-200", "tactical", "consumer"])
def test_catalogue_entries_give_usable_layouts(name):
    layout = layout_for(catalogue.spec(name), 15)
    assert (layout.initial_variances() > 0.0).all()


def test_values_by_block():
    layout = layout_for(SPEC, 21)
    vector = layout.values(b_g=[1.0, 2.0, 3.0], S_a=[4.0, 5.0, 6.0])
    np.testing.assert_array_equal(vector, [0, 0, 0, 1, 2, 3, 4, 5, 6, 0, 0, 0])


def test_descriptions_are_for_people():
    assert StateModel.constant(0.5).describe() == "random constant, 1-sigma 0.5"
    assert "random walk 0.1/sqrt(s)" in StateModel.random_walk(0.5, 0.1).describe()
    assert "tau 100 s" in StateModel.gauss_markov(0.5, 100.0).describe()
    assert layout_for(SPEC, 15).to_dict()["b_a"]["tau"] is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StateModel(-1.0), "non-negative finite sigma"),
        (lambda: StateModel(1.0, np.nan), "non-negative finite sigma"),
        (lambda: StateModel(1.0, tau=0.0), "positive correlation time"),
        (lambda: StateLayout({"bias": StateModel(1.0)}), "unknown state block 'bias'; known are b_a"),
        (lambda: StateLayout({"M_a": StateModel(1.0), "M_a6": StateModel(1.0)}), "use one of them"),
        (lambda: StateLayout({})["b_g"], "no state block 'b_g' in this layout; it has dpsi, dv, dr"),
        (lambda: layout_for(SPEC, 16), "expected one of 9, 15, 21"),
        (lambda: layout_for(SPEC, ("b_q",)), "unknown state block 'b_q'"),
        (lambda: layout_for(SPEC, ("lever",)), "says nothing about lever"),
        (lambda: layout_for(replace(SPEC_WITHOUT_WANDER, name="bare"), 33), "budget of bare has zero for it"),
        (lambda: layout_for(SPEC).values(dr=[0.0, 0.0, 0.0]), "dr is a navigation block"),
        (lambda: layout_for(SPEC).values(b_g=[0.0]), "expected shape"),
        (lambda: layout_for(SPEC_WITHOUT_WANDER, 27), "b_g_run needs an in-run bias"),
    ],
)
def test_impossible_layouts_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
