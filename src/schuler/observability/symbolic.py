"""Symbolic observability of IMUs that turn at a constant rate: ranks and combinations as formulas (SymPy)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.observability.scenario import ObservabilityScenario
from schuler.observability.symbolic_model import Symbolic, SymbolicModel, sympy_module
from schuler.observability.symbolic_model import rotary_model as rotary_model  # handed on beside the recursion
from schuler.rotary.sections import axis_of


def observability_matrix(model: SymbolicModel, order: int | None = None, *, injected: bool = False) -> Symbolic:
    """Stack of ``N_0 = H``, ``N_k = N_(k-1) F + dN_(k-1)/dt`` at the instant of the model.

    Parameters
    ----------
    model : SymbolicModel
    order : int, optional
        Number of blocks, at most what the model was made for; by default all.
    injected : bool
        Take out of ``F`` what velocity errors do. Velocity is measured, so its effect can be calculated (output
        injection): rows span the same space, and are far shorter.

    Returns
    -------
    sympy.Matrix, shape (3 order, 12)
    """
    sp = sympy_module()
    return _recursion(sp, model, order, {}, injected=injected).to_Matrix()


def _recursion(
    sp: Any, model: SymbolicModel, order: int | None, values: dict[Symbolic, Symbolic], *, injected: bool
) -> Any:
    """The stack as a matrix over the field of its constants, some of them replaced by numbers."""
    from sympy.polys.matrices import DomainMatrix

    count = len(model.derivatives) if order is None else order
    if not 1 <= count <= len(model.derivatives):
        raise InputError(f"order: expected 1 to {len(model.derivatives)}, what the model was made for, got {order}")
    F = []
    for derivative in model.derivatives[:count]:
        entries = derivative.subs(values)
        if injected:
            entries[:, :3] = sp.zeros(entries.rows, 3)
        F.append(entries)
    stacked = DomainMatrix.from_Matrix(sp.Matrix.vstack(model.H, *F)).to_field()
    if stacked.domain.is_EX:
        raise InputError(
            "roll, pitch, azimuth: expected symbols, or angles whose sine and cosine are rational, such as "
            "sympy.atan(Rational(3, 4)); roots in them keep the combinations from being exact"
        )
    n, m = model.H.cols, model.H.rows
    H = stacked.extract(range(m), range(n))
    parts = [stacked.extract(range(m + n * j, m + n * (j + 1)), range(n)) for j in range(count)]
    last = max((j for j, entries in enumerate(F) if not entries.is_zero_matrix), default=0)
    field = stacked.domain
    D: list[Any] = [H, *[None] * (count - 1)]  # derivatives of the current block, None for zero
    stack = [H]
    for k in range(1, count):
        new: list[Any] = []
        for j in range(count - k):
            total = D[j + 1]
            for i in range(max(0, j - last), j + 1):
                if D[i] is not None:
                    term = D[i] * parts[j - i] * field(int(sp.binomial(j, i)))
                    total = term if total is None else total + term
            new.append(total)
        D = new
        stack.append(D[0] if D[0] is not None else H * field(0))
    return stack[0].vstack(*stack[1:]) if count > 1 else H


def symbolic_rank(model: SymbolicModel, order: int | None = None) -> int:
    """Rank of the observability matrix for almost all values of its constants.

    Notes
    -----
    Rational numbers are put in for the constants and the rank is computed exactly, for two sets of numbers.
    """
    sp = sympy_module()
    # numbers can lower a rank by accident, never raise it
    return max(int(_recursion(sp, model, order, v, injected=False).rank()) for v in _numbers(sp, model))


def _numbers(sp: Any, model: SymbolicModel) -> list[dict[Symbolic, Symbolic]]:
    """Rational values; sine and cosine of the latitude belong to a Pythagorean triple."""
    sets = []
    for k, (c, s) in enumerate(((sp.Rational(3, 5), sp.Rational(4, 5)), (sp.Rational(12, 13), sp.Rational(5, 13)))):
        values = {}
        for i, (name, symbol) in enumerate(model.constants.items()):
            if symbol != 0:
                values[symbol] = {"c": c, "s": s}.get(name, sp.Rational(2 * i + 3 + k, i + 2 + 3 * k))
        sets.append(values)
    return sets


def _rank(sp: Any, M: Symbolic) -> int:
    from sympy.polys.matrices import DomainMatrix

    return int(DomainMatrix.from_Matrix(M).to_field().rank())


def observable_combinations(model: SymbolicModel, order: int | None = None) -> list[Symbolic]:
    """A sparse basis of the combinations of states that velocity determines.

    Returns
    -------
    list of sympy.Expr
        Sums of the states with formulas as factors. Each holds a state that no other has; velocity and biases are
        preferred for it.
    """
    sp = sympy_module()
    reduced, pivots, places = _reduced(sp, model, order)
    states = [model.states[i] for i in places]
    return [
        sum((sp.factor(reduced[k, i]) * states[i] for i in range(len(states))), sp.Integer(0))
        for k in range(len(pivots))
    ]


def unobservable_directions(model: SymbolicModel, order: int | None = None) -> list[dict[str, Symbolic]]:
    """A basis of the errors that velocity does not show: values of the states, those not named are zero."""
    sp = sympy_module()
    reduced, pivots, places = _reduced(sp, model, order)
    names = [model.names[i] for i in places]
    directions = []
    for free in (i for i in range(len(names)) if i not in pivots):
        direction = {names[free]: sp.Integer(1)}
        for k, pivot in enumerate(pivots):
            if reduced[k, free] != 0:
                direction[names[pivot]] = -sp.factor(reduced[k, free])
        directions.append(direction)
    return directions


def observable_states(model: SymbolicModel, order: int | None = None) -> list[str]:
    """States that are determined by themselves."""
    return [str(c) for c in observable_combinations(model, order) if c.is_Symbol]


def same_span(model: SymbolicModel, first: Sequence[Symbolic], second: Sequence[Symbolic]) -> bool:
    """Whether two sets of combinations span the same space, for almost all values of the constants."""
    a, b = coefficients(model, first), coefficients(model, second)
    sp = sympy_module()
    both = sp.Matrix.vstack(a, b)
    for values in _numbers(sp, model):
        ranks = [_rank(sp, m.subs(values)) for m in (a, b, both)]
        if len(set(ranks)) != 1:
            return False
    return True


def coefficients(model: SymbolicModel, combinations: Sequence[Symbolic]) -> Symbolic:
    """Rows of factors of combinations. Shape (m, n)."""
    sp = sympy_module()
    return sp.Matrix([[sp.sympify(c).expand().coeff(x) for x in model.states] for c in combinations])


#: Velocity, accelerometer and gyroscope biases, then attitude: which state leads a combination.
_PREFERRED = (0, 1, 2, 9, 10, 11, 6, 7, 8, 3, 4, 5)


def _reduced(sp: Any, model: SymbolicModel, order: int | None) -> tuple[Symbolic, tuple[int, ...], tuple[int, ...]]:
    """Reduced echelon form over the rational functions of the constants, its pivots, and the places of its columns."""
    stack = _recursion(sp, model, order, {}, injected=True)
    reduced, pivots = stack.extract(range(stack.shape[0]), _PREFERRED).rref()
    return reduced.to_Matrix()[: len(pivots), :], tuple(pivots), _PREFERRED


_REFUSED = (
    "formulas are for a vehicle at rest whose IMU is fixed or turns at a constant rate about an axis of the body: "
)


def scenario_model(scenario: ObservabilityScenario, *, biases: str = "navigation") -> SymbolicModel:
    """Symbolic model of a scenario.

    Parameters
    ----------
    scenario : ObservabilityScenario
        Static; its IMU fixed, or turning at a constant rate about x, y or z.
    biases : {"navigation", "imu"}

    Notes
    -----
    Angles that are zero are zero; any other stands for a general one and is replaced by one of a Pythagorean triangle,
    so that everything stays exact.

    Raises
    ------
    InputError
        For any other scenario.
    """
    axis = _axis(scenario)
    sp: Any = sympy_module()
    general = (sp.Rational(3, 4), sp.Rational(5, 12), sp.Rational(8, 15))
    roll, pitch, azimuth = (
        sp.atan(ratio) if angle else 0 for angle, ratio in zip(scenario.motion.rpy_deg, general, strict=True)
    )
    model: SymbolicModel = rotary_model(
        axis, roll=roll, pitch=pitch, azimuth=azimuth, earth=scenario.motion.earth_rotation,
        biases="imu" if biases == "imu" else "navigation", axes=scenario.axes,
    )  # fmt: skip
    return model


def scenario_formulas(scenario: ObservabilityScenario) -> tuple[str, ...]:
    """Rank and combinations of a scenario as text."""
    model = scenario_model(scenario)
    texts = [str(c) for c in observable_combinations(model)]
    return (f"rank {len(texts)} of {len(model.names)}", *texts)


def _axis(scenario: ObservabilityScenario) -> Any:
    """Letter of the platform's axis in the axes of the model, None if the IMU is fixed."""
    if scenario.motion.type != "static":
        raise InputError(f"{_REFUSED}the motion is of type {scenario.motion.type}")
    if scenario.rotary is None or scenario.rotary.schedule.type == "fixed":
        return None
    s = scenario.rotary.schedule
    if s.type != "continuous" or s.tilt_deg or any(s.mount_rpy_deg) or s.start_s or s.acceleration_deg_s2:
        raise InputError(f"{_REFUSED}the schedule is of type {s.type}, or tilted, mounted askew, or starts later")
    u = np.abs(axis_of(s.axis))
    if np.sum(u > 1e-12) != 1:
        raise InputError(f"{_REFUSED}its axis is {s.axis}")
    letters = "xyz" if scenario.axes == "ned" else "yxz"
    return letters[int(np.argmax(u))]
