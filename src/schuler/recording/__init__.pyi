from .formats.instinct_csv import read_instinct_gnss as read_instinct_gnss
from .formats.openshoe import read_microstrain_text as read_microstrain_text
from .formats.openshoe import read_openshoe_mat as read_openshoe_mat
from .formats.psins import RangeLog as RangeLog
from .formats.psins import read_psins_ranges as read_psins_ranges
from .formats.pyshoe import PyShoeTrial as PyShoeTrial
from .formats.pyshoe import read_pyshoe as read_pyshoe
from .formats.rinex_navigation import glonass_channels as glonass_channels
from .formats.rinex_navigation import read_rinex_navigation as read_rinex_navigation
from .formats.rinex_observation import read_rinex_observation as read_rinex_observation
from .formats.ubx import UbxLog as UbxLog
from .formats.ubx import read_ubx as read_ubx
from .io.dispatch import left_out as left_out
from .io.dispatch import read as read
from .io.dispatch import write as write
from .io.hints import ReadHints as ReadHints
from .public import PublicFile as PublicFile
from .public import PublicRecording as PublicRecording
from .public import fetch as fetch
from .recording import Metadata as Metadata
from .recording import Recording as Recording
from .satellite_positions import baseline_series as baseline_series
from .satellite_positions import gnss_series as gnss_series
from .series import GnssSeries as GnssSeries
from .series import ImuSeries as ImuSeries
from .series import Increments as Increments
from .series import OdometerSeries as OdometerSeries
from .series import ScalarSeries as ScalarSeries
from .tables.pandas import from_pandas as from_pandas
from .tables.pandas import tables_from_pandas as tables_from_pandas
from .tables.pandas import to_pandas as to_pandas
from .tables.polars import PolarsFrames as PolarsFrames
from .tables.polars import from_polars as from_polars
from .tables.polars import tables_from_polars as tables_from_polars
from .tables.polars import to_polars as to_polars
from .tables.xarray import from_xarray as from_xarray
from .tables.xarray import tables_from_xarray as tables_from_xarray
from .tables.xarray import to_xarray as to_xarray
from .trajectory import FullTrajectory as FullTrajectory
from .trajectory import Trajectory as Trajectory

__all__ = [
    "FullTrajectory",
    "GnssSeries",
    "ImuSeries",
    "Increments",
    "Metadata",
    "OdometerSeries",
    "PolarsFrames",
    "PublicFile",
    "PublicRecording",
    "PyShoeTrial",
    "RangeLog",
    "ReadHints",
    "Recording",
    "ScalarSeries",
    "Trajectory",
    "UbxLog",
    "baseline_series",
    "fetch",
    "from_pandas",
    "from_polars",
    "from_xarray",
    "glonass_channels",
    "gnss_series",
    "left_out",
    "read",
    "read_instinct_gnss",
    "read_microstrain_text",
    "read_openshoe_mat",
    "read_psins_ranges",
    "read_pyshoe",
    "read_rinex_navigation",
    "read_rinex_observation",
    "read_ubx",
    "tables_from_pandas",
    "tables_from_polars",
    "tables_from_xarray",
    "to_pandas",
    "to_polars",
    "to_xarray",
    "write",
]
