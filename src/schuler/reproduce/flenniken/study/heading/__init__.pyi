from .filters import BiasTruth as BiasTruth
from .filters import constant_bias as constant_bias
from .filters import gauss_markov_bias as gauss_markov_bias
from .filters import gyro_readings as gyro_readings
from .filters import position_filter as position_filter
from .filters import split_bias as split_bias
from .growth import HeadingBound as HeadingBound
from .growth import heading_bound as heading_bound
from .linear import Discrete as Discrete
from .linear import LinearModel as LinearModel
from .outages import HeadingOutages as HeadingOutages
from .outages import PositionOutage as PositionOutage
from .outages import heading_nees as heading_nees
from .outages import heading_outages as heading_outages
from .outages import position_outage as position_outage
from .outages import recorded_outage as recorded_outage
from .runs import FilterRuns as FilterRuns
from .runs import run_filter as run_filter

__all__ = [
    "BiasTruth",
    "Discrete",
    "FilterRuns",
    "HeadingBound",
    "HeadingOutages",
    "LinearModel",
    "PositionOutage",
    "constant_bias",
    "gauss_markov_bias",
    "gyro_readings",
    "heading_bound",
    "heading_nees",
    "heading_outages",
    "position_filter",
    "position_outage",
    "recorded_outage",
    "run_filter",
    "split_bias",
]
