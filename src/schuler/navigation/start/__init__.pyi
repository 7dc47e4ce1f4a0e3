from .alignment import align as align
from .calibrated_errors import Age as Age
from .calibration import CalibrationStart as CalibrationStart
from .calibration import calibration_start as calibration_start

__all__ = [
    "Age",
    "CalibrationStart",
    "align",
    "calibration_start",
]
