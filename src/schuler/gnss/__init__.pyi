from .ambiguities import AmbiguityFix as AmbiguityFix
from .ambiguities import decorrelate as decorrelate
from .ambiguities import fix_ambiguities as fix_ambiguities
from .ambiguities import integer_least_squares as integer_least_squares
from .ambiguities import success_rate as success_rate
from .baseline import solve_baseline as solve_baseline
from .baseline_result import BaselineSolution as BaselineSolution
from .constellation import CircularOrbits as CircularOrbits
from .constellation import nominal_orbits as nominal_orbits
from .constellation import walker as walker
from .dop import Dilution as Dilution
from .dop import dilution as dilution
from .ephemerides import Ephemerides as Ephemerides
from .ephemerides import GlonassRecords as GlonassRecords
from .ephemerides import KeplerRecords as KeplerRecords
from .integrity import Identification as Identification
from .integrity import Integrity as Integrity
from .integrity import identify as identify
from .integrity import protection_levels as protection_levels
from .ionosphere import ionosphere_free as ionosphere_free
from .ionosphere import klobuchar as klobuchar
from .observations import Observations as Observations
from .point import solve_points as solve_points
from .point_evaluation import PointEvaluation as PointEvaluation
from .point_result import PointSolution as PointSolution
from .preparation import prepare_ranges as prepare_ranges
from .protection_errors import Stanford as Stanford
from .protection_errors import stanford as stanford
from .ranges import Ranges as Ranges
from .ranges import predicted_ranges as predicted_ranges
from .ranges import predicted_rates as predicted_rates
from .ranges import sagnac as sagnac
from .satellites import SatelliteStates as SatelliteStates
from .satellites import satellite_states as satellite_states
from .signals import SPEED_OF_LIGHT as SPEED_OF_LIGHT
from .signals import frequency_hz as frequency_hz
from .signals import satellite as satellite
from .signals import satellite_name as satellite_name
from .signals import wavelengths as wavelengths
from .synthetic import RangeErrors as RangeErrors
from .synthetic import Sector as Sector
from .synthetic import SyntheticRanges as SyntheticRanges
from .synthetic import broadcast_satellites as broadcast_satellites
from .synthetic import synthetic_ranges as synthetic_ranges
from .troposphere import niell_mapping as niell_mapping
from .troposphere import saastamoinen as saastamoinen
from .troposphere import zenith_delays as zenith_delays
from .weighting import Weighting as Weighting

__all__ = [
    "SPEED_OF_LIGHT",
    "AmbiguityFix",
    "BaselineSolution",
    "CircularOrbits",
    "Dilution",
    "Ephemerides",
    "GlonassRecords",
    "Identification",
    "Integrity",
    "KeplerRecords",
    "Observations",
    "PointEvaluation",
    "PointSolution",
    "RangeErrors",
    "Ranges",
    "SatelliteStates",
    "Sector",
    "Stanford",
    "SyntheticRanges",
    "Weighting",
    "broadcast_satellites",
    "decorrelate",
    "dilution",
    "fix_ambiguities",
    "frequency_hz",
    "identify",
    "integer_least_squares",
    "ionosphere_free",
    "klobuchar",
    "niell_mapping",
    "nominal_orbits",
    "predicted_ranges",
    "predicted_rates",
    "prepare_ranges",
    "protection_levels",
    "saastamoinen",
    "sagnac",
    "satellite",
    "satellite_name",
    "satellite_states",
    "solve_baseline",
    "solve_points",
    "stanford",
    "success_rate",
    "synthetic_ranges",
    "walker",
    "wavelengths",
    "zenith_delays",
]
