"""A run with its smoothed twin and the numbers that are known of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from schuler.navigation.evaluation.errors import evaluate
from schuler.navigation.result import NavigationResult
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory


@dataclass(frozen=True, repr=False)
class EvaluatedRun:
    """A solution, its smoothed twin and what is known of their errors.

    Attributes
    ----------
    result : NavigationResult
        Filtered.
    smoothed : NavigationResult or None
    reference : Trajectory or None
        What errors are against: that of the recording, or its GNSS fixes.
    at_antenna : bool
        The reference is the antenna's.
    numbers : dict
        Numbers of both, as ``schuler navigate --json`` prints them; units in the names.
    truth_parameters : array_like or None
        True sensor errors of a simulation, order of the layout, SI.
    """

    result: NavigationResult
    smoothed: NavigationResult | None
    reference: Trajectory | None
    at_antenna: bool
    numbers: dict[str, Any]
    truth_parameters: Any = None


def evaluate_run(
    recording: Recording, result: NavigationResult, smooth: bool, truth_parameters: Any = None
) -> EvaluatedRun:
    """Compare a solution with the recording's reference, or with all its GNSS fixes where there is none.

    Fixes are compared where they belong by the time offset that the run estimates, if it does.

    Parameters
    ----------
    recording : Recording
    result : NavigationResult
        Filtered; what only a smoother needs is forgotten afterwards.
    smooth : bool
        Also the smoothed solution, where the run kept what it needs.
    truth_parameters : array_like, optional
        True sensor errors of a simulation, for the consistency of all states; order of the layout, SI.
    """
    reference, at_antenna = recording.reference, False
    if reference is None and recording.gnss is not None:
        g = recording.gnss
        reference, at_antenna = Trajectory.from_geodetic(g.t + result.fixes_later_s, g.llh, g.v_n), True
    smoothed = result.smooth(keep=False) if smooth and result.can_smooth else None
    origin = recording.start
    numbers: dict[str, Any] = {
        "verdict": result.verdict.to_dict(),
        "epochs": result.epochs, "elapsed_s": None, "states": result.layout.size,
        "start_s": float(result.trajectory.t[0]) - recording.start,
        "stop_s": float(result.trajectory.t[-1]) - recording.start,
        "point": result.point, "reference": _reference_name(recording, reference is not None, at_antenna),
        **evaluate(result, reference, parameters=truth_parameters, at_antenna=at_antenna, origin=origin),
        "nis_mean": result.innovations.mean_nis(), "measurements": result.innovations.counts(),
        "rejected": result.innovations.rejected(), "complete": result.complete, "notes": result.notes,
    }  # fmt: skip
    if smoothed is not None:
        numbers["smoothed"] = evaluate(smoothed, reference, at_antenna=at_antenna, origin=origin)
    return EvaluatedRun(result, smoothed, reference, at_antenna, numbers, truth_parameters)


def _reference_name(recording: Recording, present: bool, at_antenna: bool) -> str:
    if not present:
        return "none"
    if at_antenna:
        return "GNSS fixes at the antenna"
    return "true trajectory" if "scenario" in recording.metadata.options else "the reference in the log"
