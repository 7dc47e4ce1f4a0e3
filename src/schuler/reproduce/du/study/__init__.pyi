from .accuracy import CalibrationAccuracy as CalibrationAccuracy
from .accuracy import CalibrationTrials as CalibrationTrials
from .accuracy import calibration_trials as calibration_trials
from .accuracy import predicted_accuracy as predicted_accuracy
from .accuracy import table_4_5 as table_4_5
from .analytic_tables import DuErrors as DuErrors
from .analytic_tables import cycle_rate as cycle_rate
from .analytic_tables import instantaneous_errors as instantaneous_errors
from .analytic_tables import secular_errors as secular_errors
from .analytic_tables import table_text as table_text
from .drives import drive as drive
from .drives import long_drive as long_drive
from .fixed_errors import Chapter3 as Chapter3
from .fixed_errors import chapter3 as chapter3
from .floor import NoiseFloor as NoiseFloor
from .floor import noise_floor as noise_floor
from .gauss_markov import FittedBias as FittedBias
from .gauss_markov import StaticModels as StaticModels
from .gauss_markov import fit_bias as fit_bias
from .gauss_markov import static_models as static_models
from .imus import MTI_G as MTI_G
from .imus import NAV440 as NAV440
from .imus import Emulation as Emulation
from .imus import FilterImu as FilterImu
from .imus import drawn_emulation as drawn_emulation
from .imus import emulation as emulation
from .integrated import IntegratedDrive as IntegratedDrive
from .integrated import rotary_schedule as rotary_schedule
from .kinematic import KinematicTest as KinematicTest
from .kinematic import kinematic_test as kinematic_test
from .lever_arms import LeverCase as LeverCase
from .lever_arms import LeverStudy as LeverStudy
from .lever_arms import lever_study as lever_study
from .metrics import Improvement as Improvement
from .metrics import improvement as improvement
from .outage_errors import OutageErrors as OutageErrors
from .outage_errors import second_order_table as second_order_table
from .outages import DriveRuns as DriveRuns
from .outages import RotaryComparison as RotaryComparison
from .outages import rotary_comparison as rotary_comparison
from .outages import smoothing_table as smoothing_table
from .rates import RateChoice as RateChoice
from .rates import recommended_rate as recommended_rate
from .static import StaticTest as StaticTest
from .static import static_test as static_test
from .trial import Trial as Trial
from .trial import trial_run as trial_run
from .zupt import ZuptStudy as ZuptStudy
from .zupt import zupt_sigmas as zupt_sigmas
from .zupt import zupt_study as zupt_study
from .zupt_runs import ZuptEmulation as ZuptEmulation
from .zupt_runs import zupt_emulation as zupt_emulation

__all__ = [
    "MTI_G",
    "NAV440",
    "CalibrationAccuracy",
    "CalibrationTrials",
    "Chapter3",
    "DriveRuns",
    "DuErrors",
    "Emulation",
    "FilterImu",
    "FittedBias",
    "Improvement",
    "IntegratedDrive",
    "KinematicTest",
    "LeverCase",
    "LeverStudy",
    "NoiseFloor",
    "OutageErrors",
    "RateChoice",
    "RotaryComparison",
    "StaticModels",
    "StaticTest",
    "Trial",
    "ZuptEmulation",
    "ZuptStudy",
    "calibration_trials",
    "chapter3",
    "cycle_rate",
    "drawn_emulation",
    "drive",
    "emulation",
    "fit_bias",
    "improvement",
    "instantaneous_errors",
    "kinematic_test",
    "lever_study",
    "long_drive",
    "noise_floor",
    "predicted_accuracy",
    "recommended_rate",
    "rotary_comparison",
    "rotary_schedule",
    "second_order_table",
    "secular_errors",
    "smoothing_table",
    "static_models",
    "static_test",
    "table_4_5",
    "table_text",
    "trial_run",
    "zupt_emulation",
    "zupt_sigmas",
    "zupt_study",
]
