from .detectors import KINDS as KINDS
from .detectors import MAX_RATE as MAX_RATE
from .detectors import mean_rate as mean_rate
from .detectors import moving_moments as moving_moments
from .detectors import statistic as statistic
from .gait import gait_threshold as gait_threshold
from .gait import stride_period as stride_period
from .intervals import Rests as Rests
from .intervals import rests_from_mask as rests_from_mask
from .live import LiveRests as LiveRests
from .rests import field_rests as field_rests
from .rests import given_rests as given_rests
from .rests import printed_rests as printed_rests
from .stationarity import StaticIntervals as StaticIntervals
from .stationarity import static_intervals as static_intervals
from .thresholds import elapsed_time_threshold as elapsed_time_threshold
from .thresholds import noise_at_rest as noise_at_rest
from .thresholds import threshold as threshold
from .thresholds import threshold_from_rest as threshold_from_rest
from .unscaled import UnscaledRests as UnscaledRests
from .unscaled import unscaled_rests as unscaled_rests

__all__ = [
    "KINDS",
    "MAX_RATE",
    "LiveRests",
    "Rests",
    "StaticIntervals",
    "UnscaledRests",
    "elapsed_time_threshold",
    "field_rests",
    "gait_threshold",
    "given_rests",
    "mean_rate",
    "moving_moments",
    "noise_at_rest",
    "printed_rests",
    "rests_from_mask",
    "static_intervals",
    "statistic",
    "stride_period",
    "threshold",
    "threshold_from_rest",
    "unscaled_rests",
]
