"""Rests and turns; they stand in :mod:`schuler.simulation.routine_steps`, so that scenarios have them too."""

from schuler.simulation.routine_steps import (
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
