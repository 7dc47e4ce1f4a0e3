from .calibration import allan_random_walk as allan_random_walk
from .calibration import calibrate_rotation as calibrate_rotation
from .calibration_result import RotationCalibration as RotationCalibration
from .du_axes import du_axis as du_axis
from .du_axes import installation_matrix as installation_matrix
from .du_axes import rpy_from_du as rpy_from_du
from .du_axes import scale_matrix as scale_matrix
from .du_axes import swap_matrix as swap_matrix
from .du_axes import swap_vector as swap_vector
from .encoder import Encoder as Encoder
from .encoder import EncoderReadings as EncoderReadings
from .encoder import platform_error as platform_error
from .encoder import read_encoder as read_encoder
from .free_navigation import ErrorHistory as ErrorHistory
from .free_navigation import free_run as free_run
from .free_navigation import static_run as static_run
from .mechanization import body_increments as body_increments
from .mechanization import mechanize_rotating as mechanize_rotating
from .modulated_errors import Modulation as Modulation
from .modulated_errors import effective_rate as effective_rate
from .modulated_errors import modulation as modulation
from .modulated_errors import open_loop_errors as open_loop_errors
from .navigation import navigate_rotary as navigate_rotary
from .platform_usage import PlatformLimits as PlatformLimits
from .platform_usage import PlatformUsage as PlatformUsage
from .platform_usage import usage as usage
from .platform_usage import within as within
from .report import errors_figure as errors_figure
from .report import front_figure as front_figure
from .report import modulation_figure as modulation_figure
from .report import rates_figure as rates_figure
from .report import scheme_figure as scheme_figure
from .rotating_imu import RotatingMotion as RotatingMotion
from .rotating_imu import ideal_rotating_imu as ideal_rotating_imu
from .rotating_imu import vehicle_truth as vehicle_truth
from .schedule import Schedule as Schedule
from .schedule import stacked as stacked
from .schemes import Move as Move
from .schemes import carousel as carousel
from .schemes import continuous as continuous
from .schemes import dual_axis as dual_axis
from .schemes import dwell as dwell
from .schemes import fixed as fixed
from .schemes import from_rates as from_rates
from .schemes import reciprocating as reciprocating
from .schemes import sequence as sequence
from .schemes import tilted as tilted
from .search.comparison import ScenarioComparison as ScenarioComparison
from .search.comparison import compare_rotary as compare_rotary
from .search.evolution import SearchSettings as SearchSettings
from .search.evolution import search_schemes as search_schemes
from .search.families import SchemeSpace as SchemeSpace
from .search.objective import SchemeObjective as SchemeObjective
from .search.objective import scheme_objective as scheme_objective
from .search.scenario import RotaryScenario as RotaryScenario
from .search.scenario import load_rotary as load_rotary
from .search.search_result import SchemeSearch as SchemeSearch

__all__ = [
    "Encoder",
    "EncoderReadings",
    "ErrorHistory",
    "Modulation",
    "Move",
    "PlatformLimits",
    "PlatformUsage",
    "RotaryScenario",
    "RotatingMotion",
    "RotationCalibration",
    "ScenarioComparison",
    "Schedule",
    "SchemeObjective",
    "SchemeSearch",
    "SchemeSpace",
    "SearchSettings",
    "allan_random_walk",
    "body_increments",
    "calibrate_rotation",
    "carousel",
    "compare_rotary",
    "continuous",
    "du_axis",
    "dual_axis",
    "dwell",
    "effective_rate",
    "errors_figure",
    "fixed",
    "free_run",
    "from_rates",
    "front_figure",
    "ideal_rotating_imu",
    "installation_matrix",
    "load_rotary",
    "mechanize_rotating",
    "modulation",
    "modulation_figure",
    "navigate_rotary",
    "open_loop_errors",
    "platform_error",
    "rates_figure",
    "read_encoder",
    "reciprocating",
    "rpy_from_du",
    "scale_matrix",
    "scheme_figure",
    "scheme_objective",
    "search_schemes",
    "sequence",
    "stacked",
    "static_run",
    "swap_matrix",
    "swap_vector",
    "tilted",
    "usage",
    "vehicle_truth",
    "within",
]
