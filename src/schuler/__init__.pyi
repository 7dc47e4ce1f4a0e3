from .budget import choose_imu as choose_imu
from .budget import error_budget as error_budget
from .budget import linear_covariance as linear_covariance
from .budget import prepare_budget as prepare_budget
from .calibration import CalibrationResult as CalibrationResult
from .calibration import Poses as Poses
from .calibration import apply_calibration as apply_calibration
from .calibration import calibrate_angle_rate as calibrate_angle_rate
from .calibration import calibrate_ferraris as calibrate_ferraris
from .calibration import calibrate_field as calibrate_field
from .calibration import calibrate_fleet as calibrate_fleet
from .calibration import calibrate_freepose as calibrate_freepose
from .calibration import calibrate_multiposition as calibrate_multiposition
from .calibration import calibrate_ratetable as calibrate_ratetable
from .calibration import calibrate_sixposition as calibrate_sixposition
from .calibration import calibrate_thermal as calibrate_thermal
from .calibration import calibration_certificate as calibration_certificate
from .calibration import calibration_history as calibration_history
from .calibration import poses_of as poses_of
from .characterisation import NoiseIdentification as NoiseIdentification
from .characterisation import allan_deviation as allan_deviation
from .characterisation import identify_noise as identify_noise
from .diagnosis import Diagnosis as Diagnosis
from .diagnosis import check as check
from .filtering import FilterOptions as FilterOptions
from .filtering import InitialState as InitialState
from .filtering import StateLayout as StateLayout
from .filtering import StateModel as StateModel
from .filtering import layout_for as layout_for
from .gnss import prepare_ranges as prepare_ranges
from .gnss import solve_baseline as solve_baseline
from .gnss import solve_points as solve_points
from .mechanization import NavState as NavState
from .mechanization import mechanize as mechanize
from .montecarlo import campaign as campaign
from .navigation import NavigationConfig as NavigationConfig
from .navigation import NavigationResult as NavigationResult
from .navigation import Navigator as Navigator
from .navigation import compare_architectures as compare_architectures
from .navigation import compare_runs as compare_runs
from .navigation import fine_alignment as fine_alignment
from .navigation import navigate as navigate
from .navigation import rerun as rerun
from .navigation import tune_noise as tune_noise
from .navigation.foot import navigate_foot as navigate_foot
from .observability import scenario_observability as scenario_observability
from .proposal import Proposal as Proposal
from .proposal import propose as propose
from .recording import GnssSeries as GnssSeries
from .recording import ImuSeries as ImuSeries
from .recording import Increments as Increments
from .recording import Metadata as Metadata
from .recording import OdometerSeries as OdometerSeries
from .recording import Recording as Recording
from .recording import Trajectory as Trajectory
from .recording.io import ReadHints as ReadHints
from .recording.io import read as read
from .recording.io import write as write
from .rotary import compare_rotary as compare_rotary
from .rotary import navigate_rotary as navigate_rotary
from .rotary import search_schemes as search_schemes
from .sensors import ImuErrors as ImuErrors
from .sensors import ImuSpec as ImuSpec
from .sensors import TriadSpec as TriadSpec
from .simulation import Scenario as Scenario
from .simulation import simulate as simulate

__version__: str

__all__ = [
    "CalibrationResult",
    "Diagnosis",
    "FilterOptions",
    "GnssSeries",
    "ImuErrors",
    "ImuSeries",
    "ImuSpec",
    "Increments",
    "InitialState",
    "Metadata",
    "NavState",
    "NavigationConfig",
    "NavigationResult",
    "Navigator",
    "NoiseIdentification",
    "OdometerSeries",
    "Poses",
    "ReadHints",
    "Recording",
    "Scenario",
    "StateLayout",
    "StateModel",
    "Trajectory",
    "TriadSpec",
    "allan_deviation",
    "apply_calibration",
    "calibrate_angle_rate",
    "calibrate_ferraris",
    "calibrate_field",
    "calibrate_fleet",
    "calibrate_freepose",
    "calibrate_multiposition",
    "calibrate_ratetable",
    "calibrate_sixposition",
    "calibrate_thermal",
    "calibration_certificate",
    "calibration_history",
    "campaign",
    "check",
    "choose_imu",
    "compare_architectures",
    "compare_rotary",
    "compare_runs",
    "error_budget",
    "fine_alignment",
    "identify_noise",
    "layout_for",
    "linear_covariance",
    "mechanize",
    "navigate",
    "navigate_foot",
    "navigate_rotary",
    "poses_of",
    "prepare_budget",
    "prepare_ranges",
    "read",
    "rerun",
    "scenario_observability",
    "search_schemes",
    "simulate",
    "solve_baseline",
    "solve_points",
    "tune_noise",
    "write",
]
