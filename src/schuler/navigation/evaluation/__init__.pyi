from .architectures import Comparison as Comparison
from .architectures import ComparisonRow as ComparisonRow
from .architectures import compare_architectures as compare_architectures
from .architectures import reference_of as reference_of
from .consistency import Separation as Separation
from .consistency import attitude_difference as attitude_difference
from .consistency import chi_square_band as chi_square_band
from .consistency import nees as nees
from .consistency import separation as separation
from .consistency import state_errors as state_errors
from .errors import OutageError as OutageError
from .errors import TrajectoryErrors as TrajectoryErrors
from .errors import drift_curve as drift_curve
from .errors import evaluate as evaluate
from .errors import outage_errors as outage_errors
from .errors import trajectory_errors as trajectory_errors
from .evaluated import EvaluatedRun as EvaluatedRun
from .evaluated import evaluate_run as evaluate_run
from .modes import Mode as Mode
from .modes import available_modes as available_modes
from .modes import parse_mode as parse_mode
from .outages import OutageStatistics as OutageStatistics
from .outages import outage_statistics as outage_statistics
from .runs import Run as Run
from .runs import RunComparison as RunComparison
from .runs import compare_runs as compare_runs
from .runs import read_run as read_run

__all__ = [
    "Comparison",
    "ComparisonRow",
    "EvaluatedRun",
    "Mode",
    "OutageError",
    "OutageStatistics",
    "Run",
    "RunComparison",
    "Separation",
    "TrajectoryErrors",
    "attitude_difference",
    "available_modes",
    "chi_square_band",
    "compare_architectures",
    "compare_runs",
    "drift_curve",
    "evaluate",
    "evaluate_run",
    "nees",
    "outage_errors",
    "outage_statistics",
    "parse_mode",
    "read_run",
    "reference_of",
    "separation",
    "state_errors",
    "trajectory_errors",
]
