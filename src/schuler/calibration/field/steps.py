"""Rests and turns; they stand in :mod:`schuler.simulation.steps`, so that scenarios have them too."""

from schuler.simulation.steps import (
    ZERO,
    Axis,
    Rest,
    Routine,
    Step,
    Turn,
    Vector,
    check_duration,
    pose_in_words,
    turn_in_words,
)

__all__ = [
    "ZERO",
    "Axis",
    "Rest",
    "Routine",
    "Step",
    "Turn",
    "Vector",
    "check_duration",
    "pose_in_words",
    "turn_in_words",
]
