"""Rotation routines; they stand in :mod:`schuler.simulation.routine`, so that scenarios have them too."""

from schuler.simulation.routine import RoutineMotion, free_routine, six_face_routine, thesis_routine
from schuler.simulation.steps import Rest, Routine, Turn

__all__ = ["Rest", "Routine", "RoutineMotion", "Turn", "free_routine", "six_face_routine", "thesis_routine"]
