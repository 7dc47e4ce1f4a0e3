from .engine import FilterOptions as FilterOptions
from .engine import ForwardRun as ForwardRun
from .engine import run as run
from .error_model import noise_density as noise_density
from .error_model import parameter_columns as parameter_columns
from .error_model import system_matrix_ecef as system_matrix_ecef
from .error_model import system_matrix_ned as system_matrix_ned
from .initial_state import InitialState as InitialState
from .measurements import KINDS as KINDS
from .measurements import STATUS as STATUS
from .measurements import MeasurementSchedule as MeasurementSchedule
from .measurements import gnss_measurements as gnss_measurements
from .measurements import merged as merged
from .measurements import position as position
from .measurements import velocity as velocity
from .measurements import zero_velocity as zero_velocity
from .states import BLOCK_TEXT as BLOCK_TEXT
from .states import BLOCKS as BLOCKS
from .states import StateLayout as StateLayout
from .states import StateModel as StateModel
from .states import layout_for as layout_for

__all__ = [
    "BLOCKS",
    "BLOCK_TEXT",
    "KINDS",
    "STATUS",
    "FilterOptions",
    "ForwardRun",
    "InitialState",
    "MeasurementSchedule",
    "StateLayout",
    "StateModel",
    "gnss_measurements",
    "layout_for",
    "merged",
    "noise_density",
    "parameter_columns",
    "position",
    "run",
    "system_matrix_ecef",
    "system_matrix_ned",
    "velocity",
    "zero_velocity",
]
