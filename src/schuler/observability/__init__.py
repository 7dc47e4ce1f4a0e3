"""What a filter can know: observability of any filter along any motion, in numbers and in formulas."""

from schuler.observability.building import motion_system, result_system
from schuler.observability.combinations import Combination, recognised, seen, unseen
from schuler.observability.degree import Degree, degree_of_observability
from schuler.observability.local import derivatives, local_matrix, local_spectrum, motion_local_spectrum
from schuler.observability.models import RotaryModel, model_system
from schuler.observability.named import in_du_axes, in_navigation_axes
from schuler.observability.ranks import Spectrum, spectra, spectrum
from schuler.observability.scenario import ObservabilityScenario, scenario_system
from schuler.observability.study import (
    Observability,
    named_constants,
    observability,
    scenario_observability,
)
from schuler.observability.system import LinearSystem
from schuler.observability.transitions import system_matrices, transitions

__all__ = [
    "Combination",
    "Degree",
    "LinearSystem",
    "Observability",
    "ObservabilityScenario",
    "RotaryModel",
    "Spectrum",
    "degree_of_observability",
    "derivatives",
    "in_du_axes",
    "in_navigation_axes",
    "local_matrix",
    "local_spectrum",
    "model_system",
    "motion_local_spectrum",
    "motion_system",
    "named_constants",
    "observability",
    "recognised",
    "result_system",
    "scenario_observability",
    "scenario_system",
    "seen",
    "spectra",
    "spectrum",
    "system_matrices",
    "transitions",
    "unseen",
]
