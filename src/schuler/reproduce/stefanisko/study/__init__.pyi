from .bias_removal import BiasStudy as BiasStudy
from .bias_removal import bias_study as bias_study
from .bias_removal import corrected_log as corrected_log
from .bias_removal import corrected_track as corrected_track
from .bias_removal import mean_removed as mean_removed
from .bias_removal import moving_mean_removed as moving_mean_removed
from .campaign import FigureEightResult as FigureEightResult
from .campaign import figure_eight as figure_eight
from .coincidence import CoincidenceStudy as CoincidenceStudy
from .coincidence import coincidence_study as coincidence_study
from .coincidence import compare_scheduling as compare_scheduling
from .experiment import FigureEight as FigureEight
from .generator import flat_navigation as flat_navigation
from .generator import gendata as gendata
from .generator import velocity_from_samples as velocity_from_samples
from .sign_sets import SignStudy as SignStudy
from .sign_sets import sign_study as sign_study

__all__ = [
    "BiasStudy",
    "CoincidenceStudy",
    "FigureEight",
    "FigureEightResult",
    "SignStudy",
    "bias_study",
    "coincidence_study",
    "compare_scheduling",
    "corrected_log",
    "corrected_track",
    "figure_eight",
    "flat_navigation",
    "gendata",
    "mean_removed",
    "moving_mean_removed",
    "sign_study",
    "velocity_from_samples",
]
