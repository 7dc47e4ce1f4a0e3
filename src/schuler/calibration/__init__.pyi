from .bench.counts import CountFactors as CountFactors
from .bench.counts import count_factors as count_factors
from .bench.ferraris import calibrate_ferraris as calibrate_ferraris
from .bench.multiposition import calibrate_multiposition as calibrate_multiposition
from .bench.pose_table import PoseTable as PoseTable
from .bench.pose_table import calibrate_poses as calibrate_poses
from .bench.pose_table import read_pose_table as read_pose_table
from .bench.poses import Poses as Poses
from .bench.poses import poses_of as poses_of
from .bench.ratetable import calibrate_angle_rate as calibrate_angle_rate
from .bench.ratetable import calibrate_ratetable as calibrate_ratetable
from .bench.sensor_geometry import triad_matrix as triad_matrix
from .bench.sixposition import calibrate_sixposition as calibrate_sixposition
from .bench.turns import Turns as Turns
from .bench.turns import turns_of as turns_of
from .bench.turns_in_log import rate_plateaus as rate_plateaus
from .design.dwell import dwell_time as dwell_time
from .design.plans import Plan as Plan
from .design.plans import attitude_plan as attitude_plan
from .design.pose_design import NextPose as NextPose
from .design.pose_design import next_pose as next_pose
from .design.pose_design import predicted_sigma as predicted_sigma
from .design.pose_design import prior_of as prior_of
from .design.pose_design import sigma_of_mean as sigma_of_mean
from .field.advice import Advice as Advice
from .field.calibration import FieldCalibration as FieldCalibration
from .field.calibration import calibrate_field as calibrate_field
from .field.coaching import Coach as Coach
from .field.coaching import coach as coach
from .field.covariance_prediction import CovarianceState as CovarianceState
from .field.covariance_prediction import PredictedCovariance as PredictedCovariance
from .field.covariance_prediction import initial_covariance as initial_covariance
from .field.covariance_prediction import predict_covariance as predict_covariance
from .field.options import CoachOptions as CoachOptions
from .field.options import FieldOptions as FieldOptions
from .field.planning import planned_routine as planned_routine
from .field.problem import parameter_names as parameter_names
from .freepose.calibrate import calibrate_freepose as calibrate_freepose
from .freepose.fleet import FleetTable as FleetTable
from .freepose.fleet import calibrate_fleet as calibrate_fleet
from .freepose.simulation import hand_log as hand_log
from .magnetometer.calibrate import with_magnetometer as with_magnetometer
from .magnetometer.fit import fit_magnetometer as fit_magnetometer
from .report.certificate import calibration_certificate as calibration_certificate
from .report.document import calibration_report as calibration_report
from .report.output_figures import output_figure as output_figure
from .report.pose_figure import plan_figure as plan_figure
from .report.thermal_figure import thermal_figure as thermal_figure
from .result.application import AppliedCalibration as AppliedCalibration
from .result.application import apply_calibration as apply_calibration
from .result.conventions import from_imu_tk as from_imu_tk
from .result.conventions import from_kalibr as from_kalibr
from .result.conventions import from_psins as from_psins
from .result.conventions import from_ros_imu_calib as from_ros_imu_calib
from .result.conventions import to_imu_tk as to_imu_tk
from .result.conventions import to_kalibr as to_kalibr
from .result.conventions import to_psins as to_psins
from .result.conventions import to_ros_imu_calib as to_ros_imu_calib
from .result.result import CalibrationResult as CalibrationResult
from .result.result import Residuals as Residuals
from .result.result import result_from as result_from
from .result.result_file import read_result as read_result
from .result.result_file import write_result as write_result
from .result.session import Session as Session
from .result.session import with_session as with_session
from .result.unit_history import UnitHistory as UnitHistory
from .result.unit_history import calibration_history as calibration_history
from .result.unit_history import history_of as history_of
from .thermal.calibrate import calibrate_thermal as calibrate_thermal
from .thermal.correction import compensate_thermal as compensate_thermal
from .thermal.correction import thermal_correction as thermal_correction
from .thermal.correction import thermal_value as thermal_value

__all__ = [
    "Advice",
    "AppliedCalibration",
    "CalibrationResult",
    "Coach",
    "CoachOptions",
    "CountFactors",
    "CovarianceState",
    "FieldCalibration",
    "FieldOptions",
    "FleetTable",
    "NextPose",
    "Plan",
    "PoseTable",
    "Poses",
    "PredictedCovariance",
    "Residuals",
    "Session",
    "Turns",
    "UnitHistory",
    "apply_calibration",
    "attitude_plan",
    "calibrate_angle_rate",
    "calibrate_ferraris",
    "calibrate_field",
    "calibrate_fleet",
    "calibrate_freepose",
    "calibrate_multiposition",
    "calibrate_poses",
    "calibrate_ratetable",
    "calibrate_sixposition",
    "calibrate_thermal",
    "calibration_certificate",
    "calibration_history",
    "calibration_report",
    "coach",
    "compensate_thermal",
    "count_factors",
    "dwell_time",
    "fit_magnetometer",
    "from_imu_tk",
    "from_kalibr",
    "from_psins",
    "from_ros_imu_calib",
    "hand_log",
    "history_of",
    "initial_covariance",
    "next_pose",
    "output_figure",
    "parameter_names",
    "plan_figure",
    "planned_routine",
    "poses_of",
    "predict_covariance",
    "predicted_sigma",
    "prior_of",
    "rate_plateaus",
    "read_pose_table",
    "read_result",
    "result_from",
    "sigma_of_mean",
    "thermal_correction",
    "thermal_figure",
    "thermal_value",
    "to_imu_tk",
    "to_kalibr",
    "to_psins",
    "to_ros_imu_calib",
    "triad_matrix",
    "turns_of",
    "with_magnetometer",
    "with_session",
    "write_result",
]
