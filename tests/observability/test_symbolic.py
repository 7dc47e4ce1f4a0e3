"""Formulas: ranks by scheme exactly, Tables 5.1 and 5.2 by span, the same system in two ways."""

import sys

import pytest
import sympy as sp

from schuler.exceptions import InputError, MissingExtraError
from schuler.observability import symbolic as sym
from schuler.reproduce.du.study.observability_tables import closed, table_5_1, table_5_2

TILT = sp.atan(sp.Rational(3, 4))  # stands for any

#: axis, roll, pitch, azimuth; rank without Earth rate, exact rank with it.
SCHEMES = [
    (None, 0, 0, 0, 8, 9), (None, 0, 0, TILT, 8, 9), ("x", 0, 0, 0, 10, 10), ("x", 0, TILT, 0, 10, 10),
    ("x", 0, 0, TILT, 10, 12), ("x", TILT, 0, 0, 11, 12), ("y", 0, 0, 0, 10, 12), ("y", TILT, 0, 0, 10, 12),
    ("y", 0, TILT, 0, 11, 12), ("z", 0, 0, 0, 8, 12), ("z", TILT, 0, 0, 11, 12), ("z", 0, TILT, TILT, 11, 12),
]  # fmt: skip


@pytest.mark.parametrize(("axis", "roll", "pitch", "azimuth", "without", "with_earth"), SCHEMES)
@pytest.mark.thinned(4)
def test_ranks(axis, roll, pitch, azimuth, without, with_earth):
    """Exact. With Earth rate a rank in numbers counts X at an azimuth 11 and Z level 10: what is of second order in W
    is lost in its Gramian (see test_ranks_of_the_gramian); 9, 10 and 12 are the same here."""
    for earth, expected in ((False, without), (True, with_earth)):
        model = sym.rotary_model(axis, roll=roll, pitch=pitch, azimuth=azimuth, earth=earth, biases="navigation")
        assert sym.symbolic_rank(model) == expected


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("axis", "manoeuvre"),
    [(None, False), ("x", False), ("z", False), pytest.param("z", True, marks=pytest.mark.campaign)],
)
def test_turning_F_and_constant_F_are_the_same_system(axis, manoeuvre):
    """The recursion with derivatives, biases in the IMU, against biases in navigation: powers of a constant matrix."""
    options = {"roll": TILT, "earth": False, "manoeuvre": manoeuvre, "order": 6}
    turning = sym.rotary_model(axis, **options)
    constant = sym.rotary_model(axis, **options, biases="navigation")
    C = turning.derivatives[0][0:3, 9:12]  # C_ns at the instant
    Q = sp.diag(sp.eye(6), C, C)
    first, second = sym.observability_matrix(turning), sym.observability_matrix(constant)
    assert (first - second * Q).applyfunc(sp.simplify) == sp.zeros(*first.shape)


@pytest.mark.campaign
def test_output_injection_keeps_the_span():
    """What velocity does to the others may be left out of F, since it is measured."""
    model = sym.rotary_model("z", earth=True, order=6)
    full, short = (sym.observability_matrix(model, injected=i) for i in (False, True))
    numbers = sym._numbers(sp, model)[0]
    both = sp.Matrix.vstack(full, short).subs(numbers)
    assert full.subs(numbers).rank() == short.subs(numbers).rank() == both.rank()


def test_table_5_1():
    model = sym.rotary_model(None, biases="navigation")
    result = sym.observable_combinations(model)
    assert len(result) == 9
    assert sym.same_span(model, result, table_5_1(model))
    # not by accident: one sign reversed is another space
    wrong = table_5_1(model)
    wrong[4] = wrong[4].subs(model.constants["g"], -model.constants["g"])
    assert not sym.same_span(model, result, wrong)


@pytest.mark.thinned(4)
@pytest.mark.parametrize(
    ("axis", "roll", "earth"), [("z", TILT, False), ("x", 0, True), ("y", 0, True), ("z", 0, True)]
)
def test_table_5_2(axis, roll, earth):
    """Every combination of the table is determined, and with its derivatives it is all that is."""
    model = sym.rotary_model(axis, roll=roll, earth=earth, biases="navigation")
    result = sym.observable_combinations(model)
    table = table_5_2(model)
    assert sym.same_span(model, result, [*result, *table])
    assert sym.same_span(model, result, closed(model, table))


def test_named_combinations_of_the_conventional_system():
    model = sym.rotary_model(None, biases="navigation")
    k, x = model.constants, dict(zip(model.names, model.states, strict=True))
    result = sym.observable_combinations(model)
    assert sp.expand(k["g"] * x["eps_N"] + x["b_E"]) in [sp.expand(c) for c in result]
    assert sym.observable_states(model) == ["dv_E", "dv_N", "dv_U", "b_U"]


def test_what_level_rotation_about_z_hides():
    """Du, section 5.3: a tilt that turns with the IMU: d_h = delta, b_h = g delta / w, eps_h(0) = -i delta / w."""
    model = sym.rotary_model("z", earth=False, biases="navigation")
    g, w = model.constants["g"], model.constants["w"]
    hidden = sym.unobservable_directions(model)
    assert {"eps_N": 1, "b_E": -g, "d_E": -w} in hidden  # delta = -w along east
    assert {"eps_E": 1, "b_N": g, "d_N": w} in hidden  # delta = w along north
    stack = sym.observability_matrix(model)
    for direction in hidden:
        v = sp.Matrix([direction.get(name, 0) for name in model.names])
        assert (stack * v).applyfunc(sp.simplify) == sp.zeros(stack.rows, 1)


@pytest.mark.parametrize("axis", [None, "z"])
def test_manoeuvres_make_everything_observable(axis):
    """Horizontal acceleration that changes its direction, without Earth rate: conventional and rotary (F28)."""
    assert sym.symbolic_rank(sym.rotary_model(axis, manoeuvre=True, earth=False)) == 12


@pytest.mark.campaign
def test_thesis_verdicts_without_earth_rate():
    """Which states each scheme determines one by one, in the axes of the IMU (Du, section 5.3)."""
    velocity = {"dv_E", "dv_N", "dv_U"}
    for axis, pitch, expected in (
        (None, 0, {"b_z", "d_x", "d_y"}),
        ("x", 0, {"b_y", "b_z", "d_x", "d_y", "d_z", "eps_E"}),
        ("y", 0, {"b_x", "b_z", "d_x", "d_y", "d_z", "eps_N"}),
        ("z", 0, {"b_z"}),
        ("z", TILT, {"b_x", "b_y", "b_z", "d_x", "d_y", "d_z", "eps_E", "eps_N"}),
    ):
        model = sym.rotary_model(axis, pitch=pitch, earth=False)
        assert set(sym.observable_states(model)) == velocity | expected


def test_an_angle_may_be_a_symbol():
    model = sym.rotary_model("z", pitch=sp.Symbol("p"), earth=False, biases="navigation")
    assert len(sym.observable_combinations(model)) == 11


@pytest.mark.campaign
def test_our_axes_give_the_same_ranks():
    """North-east-down, errors of estimates: Du's Z is our -D, his X our y."""
    for axis, rank in ((None, 9), ("y", 10), ("z", 12)):
        assert sym.symbolic_rank(sym.rotary_model(axis, axes="ned")) == rank
    model = sym.rotary_model(None, axes="ned", biases="navigation", earth=False)
    texts = {str(c) for c in sym.observable_combinations(model)}
    assert "b_a_E - eps_N*g" in texts


def test_faults():
    with pytest.raises(InputError, match="axis"):
        sym.rotary_model("u")
    with pytest.raises(InputError, match="rational"):
        sym.symbolic_rank(sym.rotary_model("z", pitch=sp.pi / 6))
    with pytest.raises(InputError, match="order"):
        sym.observability_matrix(sym.rotary_model(None, order=3), 5)
    with pytest.raises(InputError, match="navigation axes"):
        closed(sym.rotary_model(None), [])
    with pytest.raises(InputError, match="enu"):
        table_5_1(sym.rotary_model(None, axes="ned", biases="navigation"))


def test_without_sympy(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(MissingExtraError, match=r"schuler\[symbolic\]"):
        sym.rotary_model(None)
