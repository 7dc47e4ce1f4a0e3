"""Calibration in the field by hand: routines of rests and turns, where a log rests, the filter that calibrates."""

from schuler.calibration.field.routine import RoutineMotion, free_routine, six_face_routine, thesis_routine
from schuler.calibration.field.steps import Rest, Routine, Turn, pose_in_words, turn_in_words
from schuler.standstill.rests import field_rests, printed_rests

__all__ = [
    "Rest",
    "Routine",
    "RoutineMotion",
    "Turn",
    "field_rests",
    "free_routine",
    "pose_in_words",
    "printed_rests",
    "six_face_routine",
    "thesis_routine",
    "turn_in_words",
]
