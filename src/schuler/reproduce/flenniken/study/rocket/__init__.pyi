from .budget import ImpactBudget as ImpactBudget
from .budget import impact_budget as impact_budget
from .ellipse import ImpactEllipse as ImpactEllipse
from .ellipse import circular_error_probable as circular_error_probable
from .errors import RocketErrors as RocketErrors
from .errors import all_angles as all_angles
from .errors import is_random as is_random
from .errors import parameter_names as parameter_names
from .motion import RocketMotion as RocketMotion
from .motion import rocket_motion as rocket_motion
from .scatter import ImpactScatter as ImpactScatter
from .scatter import impact_scatter as impact_scatter
from .sensitivity import Influence as Influence
from .sensitivity import Variant as Variant
from .sensitivity import influence as influence
from .trajectory import RocketProfile as RocketProfile
from .trajectory import RocketTrajectory as RocketTrajectory
from .trajectory import rocket_trajectory as rocket_trajectory

__all__ = [
    "ImpactBudget",
    "ImpactEllipse",
    "ImpactScatter",
    "Influence",
    "RocketErrors",
    "RocketMotion",
    "RocketProfile",
    "RocketTrajectory",
    "Variant",
    "all_angles",
    "circular_error_probable",
    "impact_budget",
    "impact_scatter",
    "influence",
    "is_random",
    "parameter_names",
    "rocket_motion",
    "rocket_trajectory",
]
