"""Parts of the conversions to other programs: axes renamed, places of accelerometers, results without uncertainty."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.calibration.result.parameters import LINEAR, Gauge, vector
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.sensors.errors import ImuErrors

_NEAR = 0.1  # scales that are further from 1 than this belong to a log in counts


def determined_errors(result: CalibrationResult, families: tuple[str, ...] = ()) -> ImuErrors:
    """Errors of a result all of whose parameters (of some families, such as ``"M_a"``) are determined.

    Raises
    ------
    InputError
        If one is not.
    """
    lost = [
        n for n, s in zip(result.names, result.sigma, strict=True)
        if not np.isfinite(s) and (not families or n[:3] in families)
    ]  # fmt: skip
    if lost:
        raise InputError(
            f"result: expected every parameter determined, but {', '.join(lost)} are not, and other programs have no "
            "word for that; collect what the verdicts ask for, or hold them (`fixed`) at values you trust"
        )
    return result.errors


def turned(errors: ImuErrors, P: FloatArray) -> ImuErrors:
    """The same IMU with sensors and body axes both renamed: ``v_new = P v_old``."""
    return ImuErrors(
        b_a=P @ errors.b_a, M_a=P @ errors.M_a @ P.T, b_g=P @ errors.b_g, M_g=P @ errors.M_g @ P.T,
        G_g=P @ errors.G_g @ P.T, temperature_0=errors.temperature_0,
    )  # fmt: skip


def turned_places(rows: FloatArray, P: FloatArray) -> FloatArray:
    """Places of the accelerometers, a row each, with axes renamed; the sign of a sensor does not move it."""
    return np.asarray(np.abs(P) @ rows @ P.T)


def places_of(result: CalibrationResult) -> FloatArray | None:
    """Places of the accelerometers [m], a row each, or None if the result has none."""
    values = result.parameters
    if not any(n.startswith("r_a") for n in values):
        return None
    return np.array([[values.get(f"r_a_{i}{j}", 0.0) for j in "xyz"] for i in "xyz"])


def named_places(rows: FloatArray) -> dict[str, float]:
    """Places of the accelerometers, a row each, as named parameters."""
    return {f"r_a_{i}{j}": float(rows[a, c]) for a, i in enumerate("xyz") for c, j in enumerate("xyz")}


def left_out(result: CalibrationResult, program: str, families: tuple[str, ...]) -> tuple[str, ...]:
    """A sentence for each family of parameters that is not zero and that a program has no place for."""
    sentences = []
    for family in families:
        there = {n: v for n, v in result.parameters.items() if n.startswith(family) and v != 0.0}
        if there:
            largest = max(there, key=lambda n: abs(there[n]))
            sentences.append(
                f"{program} has no place for {family}: left out, the largest is {largest} = {there[largest]:.4g}."
            )
    return tuple(sentences)


def held(
    errors: ImuErrors, program: str, gauge: Gauge, families: tuple[str, ...], nominal: tuple[float, float] = (1.0, 1.0)
) -> CalibrationResult:
    """A result whose parameters are held at the values of another program, which states no uncertainty."""
    values = dict(zip(LINEAR, vector(errors).tolist(), strict=True))
    fixed = {n: v for n, v in values.items() if n[:3] in families}
    return CalibrationResult(
        method=f"from {program}", names=(), values=np.empty(0), covariance=np.empty((0, 0)), gauge=gauge, fixed=fixed,
        nominal=nominal, verdicts=(f"{program} states no uncertainty: all parameters are held at its values.",),
        provenance={"source": program},
    )  # fmt: skip


def diagonal_matrix(K: ArrayLike | None, name: str) -> FloatArray:
    """A matrix (3, 3) from itself or from its diagonal (3,)."""
    if np.ndim(np.asarray(K)) == 1:
        return np.diag(as_floats(np.asarray(K), name, (3,)))
    return as_floats(np.asarray(K), name, (3, 3))


def inverse(matrix: FloatArray, name: str) -> FloatArray:
    """Inverse of a response.

    Raises
    ------
    InputError
        If it has none, to six digits.
    """
    if not np.linalg.cond(matrix) < 1e6:
        raise InputError(f"{name}: expected a matrix that can be inverted, got {matrix.tolist()}")
    return np.asarray(np.linalg.inv(matrix))


def usual_nominal(TK: FloatArray) -> float:
    """1 for a matrix of scales near 1, of a log in SI; else the mean scale, of a log in counts."""
    scales = np.diag(TK)
    return 1.0 if np.all(np.abs(scales - 1.0) < _NEAR) else float(np.mean(np.abs(scales)))
