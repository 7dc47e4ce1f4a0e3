"""schuler: the Python workbench for inertial navigation.

Read a log, say what noise its sensors have, calibrate, navigate with and without GNSS, and get an honest answer with
its uncertainty. SI units and radians inside; conventions in docs/conventions.md.

The names below are the public surface; each is loaded when first used, so importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schuler.calibration.bench.ferraris import calibrate_ferraris
    from schuler.calibration.bench.multiposition import calibrate_multiposition
    from schuler.calibration.bench.poses import Poses, poses_of
    from schuler.calibration.bench.ratetable import calibrate_angle_rate, calibrate_ratetable
    from schuler.calibration.bench.sixposition import calibrate_sixposition
    from schuler.calibration.freepose.calibrate import calibrate_freepose
    from schuler.calibration.freepose.fleet import calibrate_fleet
    from schuler.calibration.result.result import CalibrationResult
    from schuler.calibration.thermal.calibrate import calibrate_thermal
    from schuler.characterisation.allan import allan_deviation
    from schuler.characterisation.identify import identify_noise
    from schuler.characterisation.result import NoiseIdentification
    from schuler.diagnosis.diagnosis import Diagnosis
    from schuler.diagnosis.first import check
    from schuler.filtering.engine import FilterOptions, InitialState
    from schuler.filtering.states import StateLayout, StateModel, layout_for
    from schuler.mechanization.strapdown import NavState, mechanize
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.navigator import Navigator
    from schuler.navigation.result import NavigationResult
    from schuler.navigation.run import navigate
    from schuler.navigation.start.fine_alignment import fine_alignment
    from schuler.recording.io import ReadHints, read, write
    from schuler.recording.recording import Metadata, Recording
    from schuler.recording.series import GnssSeries, ImuSeries, Increments, OdometerSeries
    from schuler.recording.trajectory import Trajectory
    from schuler.sensors.errors import ImuErrors
    from schuler.sensors.spec import ImuSpec, TriadSpec
    from schuler.simulation.scenario import Scenario, simulate

_PLACES = {
    "schuler.calibration.bench.ferraris": ("calibrate_ferraris",),
    "schuler.calibration.freepose.fleet": ("calibrate_fleet",),
    "schuler.calibration.freepose.calibrate": ("calibrate_freepose",),
    "schuler.calibration.bench.multiposition": ("calibrate_multiposition",),
    "schuler.calibration.bench.poses": ("Poses", "poses_of"),
    "schuler.calibration.bench.ratetable": ("calibrate_angle_rate", "calibrate_ratetable"),
    "schuler.calibration.result.result": ("CalibrationResult",),
    "schuler.calibration.bench.sixposition": ("calibrate_sixposition",),
    "schuler.calibration.thermal.calibrate": ("calibrate_thermal",),
    "schuler.characterisation.allan": ("allan_deviation",),
    "schuler.characterisation.identify": ("identify_noise",),
    "schuler.characterisation.result": ("NoiseIdentification",),
    "schuler.diagnosis.diagnosis": ("Diagnosis",),
    "schuler.diagnosis.first": ("check",),
    "schuler.navigation.config": ("NavigationConfig",),
    "schuler.filtering.engine": ("FilterOptions", "InitialState"),
    "schuler.navigation.start.fine_alignment": ("fine_alignment",),
    "schuler.navigation.run": ("navigate",),
    "schuler.navigation.navigator": ("Navigator",),
    "schuler.navigation.result": ("NavigationResult",),
    "schuler.filtering.states": ("StateLayout", "StateModel", "layout_for"),
    "schuler.mechanization.strapdown": ("NavState", "mechanize"),
    "schuler.recording.io": ("ReadHints", "read", "write"),
    "schuler.recording.recording": ("Metadata", "Recording"),
    "schuler.recording.series": ("GnssSeries", "ImuSeries", "Increments", "OdometerSeries"),
    "schuler.recording.trajectory": ("Trajectory",),
    "schuler.sensors.errors": ("ImuErrors",),
    "schuler.sensors.spec": ("ImuSpec", "TriadSpec"),
    "schuler.simulation.scenario": ("Scenario", "simulate"),
}
_HOME = {name: place for place, names in _PLACES.items() for name in names}

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
    "calibrate_angle_rate",
    "calibrate_ferraris",
    "calibrate_fleet",
    "calibrate_freepose",
    "calibrate_multiposition",
    "calibrate_ratetable",
    "calibrate_sixposition",
    "calibrate_thermal",
    "check",
    "fine_alignment",
    "identify_noise",
    "layout_for",
    "mechanize",
    "navigate",
    "poses_of",
    "read",
    "simulate",
    "write",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return metadata.version("schuler")
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'schuler' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
