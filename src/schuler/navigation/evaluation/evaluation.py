"""The numbers of a navigation run that people compare, as one dictionary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import ArrayLike
from schuler.navigation.evaluation.consistency import nees
from schuler.navigation.evaluation.errors import TrajectoryErrors
from schuler.navigation.evaluation.outages import outage_errors
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


def evaluate(
    result: NavigationResult,
    reference: Trajectory | None,
    *,
    at_antenna: bool = False,
    parameters: ArrayLike | None = None,
    origin: float = 0.0,
) -> dict[str, Any]:
    """Accuracy, consistency and outage behaviour of a solution.

    Parameters
    ----------
    result : NavigationResult
    reference : Trajectory, optional
        Truth or a better solution; without it only what the filter knows of itself is reported.
    at_antenna : bool
        The reference is the antenna's.
    parameters : array_like, optional
        True parameters, for the NEES over all states; without them over the nine navigation states.
    origin : float
        Time that is called zero in the times of outages. [s]

    Returns
    -------
    dict
        Keys as documented in docs/commands.md; None where something cannot be known.
    """
    numbers: dict[str, Any] = {"rms_horizontal_m": None, "max_horizontal_m": None, "nees_mean": None}
    if reference is not None:
        errors = result.errors(reference, at_antenna=at_antenna)
        numbers.update(errors.statistics())
        if result.outages:
            numbers.update(_outages(errors, result, origin))
        if reference.q_eb is not None and reference.v_eb_e is not None and not at_antenna:
            numbers["nees_mean"] = float(np.mean(nees(result, reference, parameters)))
    numbers.setdefault("outages", [])
    numbers.setdefault("mean_outage_max_horizontal_m", None)
    return numbers


def _outages(errors: TrajectoryErrors, result: NavigationResult, origin: float) -> dict[str, Any]:
    found = outage_errors(errors, result.outages)
    aided = np.ones(len(errors.t), dtype=bool)
    for start, stop in result.outages:
        aided &= ~((errors.t >= start) & (errors.t <= stop))
    return {
        "outages": [
            {
                "start_s": round(o.start - origin, 6),
                "stop_s": round(o.stop - origin, 6),
                "max_horizontal_m": o.max_horizontal,
                "end_horizontal_m": o.end_horizontal,
                "max_vertical_m": o.max_vertical,
            }
            for o in found
        ],
        "mean_outage_max_horizontal_m": float(np.mean([o.max_horizontal for o in found])) if found else None,
        "rms_horizontal_aided_m": float(np.sqrt(np.mean(errors.horizontal[aided] ** 2))) if aided.any() else None,
    }
