from .backdrop import read_backdrop as read_backdrop
from .document import navigation_report as navigation_report
from .figures import overview as overview
from .figures import plot_errors as plot_errors
from .figures import plot_horizontal_error as plot_horizontal_error
from .figures import plot_innovations as plot_innovations
from .figures import plot_motion as plot_motion
from .figures import plot_nees as plot_nees
from .figures import plot_outages as plot_outages
from .figures import plot_parameters as plot_parameters
from .figures import plot_profile as plot_profile
from .figures import plot_satellites as plot_satellites
from .figures import plot_separation as plot_separation
from .figures import plot_track as plot_track
from .figures import plot_uncertainty as plot_uncertainty
from .figures import save_figures as save_figures
from .points import points_report as points_report
from .subject import Subject as Subject

__all__ = [
    "Subject",
    "navigation_report",
    "overview",
    "plot_errors",
    "plot_horizontal_error",
    "plot_innovations",
    "plot_motion",
    "plot_nees",
    "plot_outages",
    "plot_parameters",
    "plot_profile",
    "plot_satellites",
    "plot_separation",
    "plot_track",
    "plot_uncertainty",
    "points_report",
    "read_backdrop",
    "save_figures",
]
