from .aids.aiding import Sources as Sources
from .aids.aiding import aiding_schedule as aiding_schedule
from .aids.rest import earth_rates as earth_rates
from .aids.rest import gravities as gravities
from .aids.rest import zero_rates as zero_rates
from .aids.rest import zero_velocities as zero_velocities
from .aids.satellite import range_measurements as range_measurements
from .aids.satellite import resets as resets
from .aids.scalar import heading_measurements as heading_measurements
from .aids.scalar import height_measurements as height_measurements
from .aids.scalar import known_positions as known_positions
from .aids.vehicle import VehicleConditions as VehicleConditions
from .aids.vehicle import non_holonomic as non_holonomic
from .aids.vehicle import odometer_measurements as odometer_measurements
from .config import NavigationConfig as NavigationConfig
from .evaluation.architectures import Comparison as Comparison
from .evaluation.architectures import compare_architectures as compare_architectures
from .evaluation.consistency import Separation as Separation
from .evaluation.consistency import chi_square_band as chi_square_band
from .evaluation.consistency import nees as nees
from .evaluation.consistency import separation as separation
from .evaluation.consistency import state_errors as state_errors
from .evaluation.errors import TrajectoryErrors as TrajectoryErrors
from .evaluation.errors import evaluate as evaluate
from .evaluation.errors import trajectory_errors as trajectory_errors
from .evaluation.evaluated import EvaluatedRun as EvaluatedRun
from .evaluation.evaluated import evaluate_run as evaluate_run
from .evaluation.modes import Mode as Mode
from .evaluation.modes import available_modes as available_modes
from .evaluation.modes import parse_mode as parse_mode
from .evaluation.outages import OutageStatistics as OutageStatistics
from .evaluation.outages import outage_statistics as outage_statistics
from .evaluation.runs import RunComparison as RunComparison
from .evaluation.runs import compare_runs as compare_runs
from .navigator import Navigator as Navigator
from .navigator import Outcome as Outcome
from .repetition import Repetition as Repetition
from .repetition import RunFolder as RunFolder
from .repetition import read_run_folder as read_run_folder
from .repetition import rerun as rerun
from .report.document import navigation_report as navigation_report
from .report.figures import overview as overview
from .report.figures import plot_errors as plot_errors
from .report.figures import plot_innovations as plot_innovations
from .report.figures import plot_satellites as plot_satellites
from .report.figures import plot_track as plot_track
from .report.figures import save_figures as save_figures
from .result import Innovations as Innovations
from .result import NavigationResult as NavigationResult
from .run import navigate as navigate
from .run import tune_noise as tune_noise
from .solution_tables import read_solution as read_solution
from .solution_tables import result_of as result_of
from .solution_tables import tables_of as tables_of
from .solution_tables import write_solution as write_solution
from .start.calibrated_errors import Age as Age
from .start.calibration import CalibrationStart as CalibrationStart
from .start.calibration import calibration_start as calibration_start
from .start.fine_alignment import fine_alignment as fine_alignment
from .states import clock_models as clock_models
from .states import imu_spec as imu_spec
from .states import state_layout as state_layout
from .tuning.tuning import Tuning as Tuning

__all__ = [
    "Age",
    "CalibrationStart",
    "Comparison",
    "EvaluatedRun",
    "Innovations",
    "Mode",
    "NavigationConfig",
    "NavigationResult",
    "Navigator",
    "OutageStatistics",
    "Outcome",
    "Repetition",
    "RunComparison",
    "RunFolder",
    "Separation",
    "Sources",
    "TrajectoryErrors",
    "Tuning",
    "VehicleConditions",
    "aiding_schedule",
    "available_modes",
    "calibration_start",
    "chi_square_band",
    "clock_models",
    "compare_architectures",
    "compare_runs",
    "earth_rates",
    "evaluate",
    "evaluate_run",
    "fine_alignment",
    "gravities",
    "heading_measurements",
    "height_measurements",
    "imu_spec",
    "known_positions",
    "navigate",
    "navigation_report",
    "nees",
    "non_holonomic",
    "odometer_measurements",
    "outage_statistics",
    "overview",
    "parse_mode",
    "plot_errors",
    "plot_innovations",
    "plot_satellites",
    "plot_track",
    "range_measurements",
    "read_run_folder",
    "read_solution",
    "rerun",
    "resets",
    "result_of",
    "save_figures",
    "separation",
    "state_errors",
    "state_layout",
    "tables_of",
    "trajectory_errors",
    "tune_noise",
    "write_solution",
    "zero_rates",
    "zero_velocities",
]
