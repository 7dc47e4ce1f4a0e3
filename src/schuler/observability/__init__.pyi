from .axes import in_du_axes as in_du_axes
from .axes import in_navigation_axes as in_navigation_axes
from .combinations import Combination as Combination
from .combinations import recognised as recognised
from .combinations import seen as seen
from .combinations import unseen as unseen
from .degree import Degree as Degree
from .degree import degree_of_observability as degree_of_observability
from .dynamics import system_matrices as system_matrices
from .dynamics import transitions as transitions
from .filter_system import motion_system as motion_system
from .filter_system import result_system as result_system
from .local import derivatives as derivatives
from .local import local_matrix as local_matrix
from .local import local_spectrum as local_spectrum
from .local import motion_local_spectrum as motion_local_spectrum
from .numeric_model import RotaryModel as RotaryModel
from .numeric_model import model_system as model_system
from .ranks import Spectrum as Spectrum
from .ranks import spectra as spectra
from .ranks import spectrum as spectrum
from .report import observability_figure as observability_figure
from .scenario import ObservabilityScenario as ObservabilityScenario
from .scenario import scenario_system as scenario_system
from .study import Observability as Observability
from .study import named_constants as named_constants
from .study import observability as observability
from .study import scenario_observability as scenario_observability
from .symbolic import observability_matrix as observability_matrix
from .symbolic import observable_combinations as observable_combinations
from .symbolic import observable_states as observable_states
from .symbolic import same_span as same_span
from .symbolic import scenario_formulas as scenario_formulas
from .symbolic import symbolic_rank as symbolic_rank
from .symbolic import unobservable_directions as unobservable_directions
from .symbolic_model import SymbolicModel as SymbolicModel
from .symbolic_model import rotary_model as rotary_model
from .system import LinearSystem as LinearSystem

__all__ = [
    "Combination",
    "Degree",
    "LinearSystem",
    "Observability",
    "ObservabilityScenario",
    "RotaryModel",
    "Spectrum",
    "SymbolicModel",
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
    "observability_figure",
    "observability_matrix",
    "observable_combinations",
    "observable_states",
    "recognised",
    "result_system",
    "rotary_model",
    "same_span",
    "scenario_formulas",
    "scenario_observability",
    "scenario_system",
    "seen",
    "spectra",
    "spectrum",
    "symbolic_rank",
    "system_matrices",
    "transitions",
    "unobservable_directions",
    "unseen",
]
