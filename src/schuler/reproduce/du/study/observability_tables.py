"""Tables 5.1 and 5.2 of Du's thesis as formulas, to be held against what the symbolic model gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from schuler.exceptions import InputError
from schuler.observability.symbolic import coefficients, observability_matrix
from schuler.observability.symbolic_model import Symbolic, SymbolicModel


def table_5_1(model: SymbolicModel) -> list[Symbolic]:
    """Combinations that velocity determines if the IMU does not turn: nine.

    Parameters
    ----------
    model : SymbolicModel
        Model of a conventional IMU, ``axes="enu"``, biases in navigation axes.

    References
    ----------
    Du (2015), Table 5.1.
    """
    x, k = _parts(model)
    return [
        x["dv_E"], x["dv_N"], x["dv_U"], x["b_U"],
        k["g"] * x["eps_N"] + x["b_E"],
        -k["g"] * x["eps_E"] + x["b_N"],
        -k["W"] * k["s"] * x["eps_E"] + x["d_N"],
        k["W"] * k["s"] * x["eps_N"] - k["W"] * k["c"] * x["eps_U"] + x["d_E"],
        k["W"] * k["c"] * x["eps_E"] + x["d_U"],
    ]  # fmt: skip


def table_5_2(model: SymbolicModel) -> list[Symbolic]:
    """Combinations that velocity and two derivatives determine if the IMU turns: eight.

    Parameters
    ----------
    model : SymbolicModel
        Model of a rotating IMU, ``axes="enu"``, biases in navigation axes.

    Returns
    -------
    list of sympy.Expr
        ``db_E/dt`` and ``db_N/dt`` are written out as what they are of the biases at that moment. The table says
        "b_U(t)", which stands for its derivatives too: with those of all eight, :func:`closed` gives everything that
        is determined.

    References
    ----------
    Du (2015), Table 5.2.
    """
    x, k = _parts(model)
    b = [x["b_E"], x["b_N"], x["b_U"]]
    turning = model.F[9:12, 9:12]
    rate = [sum(turning[i, j] * b[j] for j in range(3)) for i in range(3)]
    return [
        x["dv_E"], x["dv_N"], x["dv_U"], x["b_U"],
        k["g"] * x["eps_N"] + x["b_E"],
        -k["g"] * x["eps_E"] + x["b_N"],
        k["g"] * (-k["W"] * k["s"] * x["eps_E"] + x["d_N"]) + rate[0],
        -k["g"] * (k["W"] * k["s"] * x["eps_N"] - k["W"] * k["c"] * x["eps_U"] + x["d_E"]) + rate[1],
    ]  # fmt: skip


def closed(model: SymbolicModel, combinations: Sequence[Symbolic]) -> list[Symbolic]:
    """Combinations with all their derivatives with time, which are known when they are.

    Parameters
    ----------
    model : SymbolicModel
        With a constant system matrix: biases in navigation axes.
    combinations : sequence of sympy.Expr
        The velocity errors among them: what they do to the others is left out as known.
    """
    if model.names[6].endswith("_x"):
        raise InputError("closed: expected a model with biases in navigation axes, whose system matrix is constant")
    rows = coefficients(model, combinations)
    stack = observability_matrix(replace(model, H=rows), injected=True)
    derivatives = [sum(stack[i, j] * model.states[j] for j in range(stack.cols)) for i in range(stack.rows)]
    return [c for c in derivatives if c != 0]


def _parts(model: SymbolicModel) -> tuple[dict[str, Symbolic], dict[str, Symbolic]]:
    if model.axes != "enu" or model.names[6] != "d_E":
        raise InputError("expected a model with axes 'enu' and biases in navigation axes")
    return dict(zip(model.names, model.states, strict=True)), model.constants
