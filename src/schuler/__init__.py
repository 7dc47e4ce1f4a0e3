"""schuler: the Python workbench for inertial navigation.

Read a log, say what noise its sensors have, calibrate, navigate with and without GNSS, and get an honest answer with
its uncertainty. SI units and radians inside; conventions in docs/conventions.md.

The names below are the public surface; each is loaded when first used, so importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schuler.characterisation.allan import allan_deviation
    from schuler.characterisation.identify import identify_noise
    from schuler.characterisation.result import NoiseIdentification
    from schuler.filtering.config import NavigationConfig
    from schuler.filtering.engine import FilterOptions, InitialState
    from schuler.filtering.fine_alignment import fine_alignment
    from schuler.filtering.navigate import navigate
    from schuler.filtering.navigator import Navigator
    from schuler.filtering.result import NavigationResult
    from schuler.filtering.states import StateLayout, StateModel, layout_for
    from schuler.mechanization.strapdown import NavState, mechanize
    from schuler.recording.io import ReadHints, read, write
    from schuler.recording.recording import Metadata, Recording
    from schuler.recording.series import GnssSeries, ImuSeries, Increments, OdometerSeries, Trajectory
    from schuler.sensors.errors import ImuErrors
    from schuler.sensors.spec import ImuSpec, TriadSpec
    from schuler.simulation.scenario import Scenario, simulate

_PLACES = {
    "schuler.characterisation.allan": ("allan_deviation",),
    "schuler.characterisation.identify": ("identify_noise",),
    "schuler.characterisation.result": ("NoiseIdentification",),
    "schuler.filtering.config": ("NavigationConfig",),
    "schuler.filtering.engine": ("FilterOptions", "InitialState"),
    "schuler.filtering.fine_alignment": ("fine_alignment",),
    "schuler.filtering.navigate": ("navigate",),
    "schuler.filtering.navigator": ("Navigator",),
    "schuler.filtering.result": ("NavigationResult",),
    "schuler.filtering.states": ("StateLayout", "StateModel", "layout_for"),
    "schuler.mechanization.strapdown": ("NavState", "mechanize"),
    "schuler.recording.io": ("ReadHints", "read", "write"),
    "schuler.recording.recording": ("Metadata", "Recording"),
    "schuler.recording.series": ("GnssSeries", "ImuSeries", "Increments", "OdometerSeries", "Trajectory"),
    "schuler.sensors.errors": ("ImuErrors",),
    "schuler.sensors.spec": ("ImuSpec", "TriadSpec"),
    "schuler.simulation.scenario": ("Scenario", "simulate"),
}
_HOME = {name: place for place, names in _PLACES.items() for name in names}

__all__ = [
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
    "ReadHints",
    "Recording",
    "Scenario",
    "StateLayout",
    "StateModel",
    "Trajectory",
    "TriadSpec",
    "allan_deviation",
    "fine_alignment",
    "identify_noise",
    "layout_for",
    "mechanize",
    "navigate",
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
