from .choice import Bottleneck as Bottleneck
from .choice import ImuChoice as ImuChoice
from .choice import Verdict as Verdict
from .choice import bottleneck as bottleneck
from .choice import catalogue_specs as catalogue_specs
from .choice import choose_imu as choose_imu
from .contributions import ErrorBudget as ErrorBudget
from .contributions import budget_of as budget_of
from .contributions import error_budget as error_budget
from .covariance import QUANTITIES as QUANTITIES
from .covariance import LinearCovariance as LinearCovariance
from .covariance import linear_covariance as linear_covariance
from .covariance import true_covariance as true_covariance
from .report import budget_content as budget_content
from .report import choice_content as choice_content
from .report import covariance_content as covariance_content
from .requirements import Requirement as Requirement
from .requirements import requirement as requirement
from .scenario import BudgetMission as BudgetMission
from .scenario import BudgetScenario as BudgetScenario
from .scenario import linearised_mission as linearised_mission
from .scenario import prepare_budget as prepare_budget

__all__ = [
    "QUANTITIES",
    "Bottleneck",
    "BudgetMission",
    "BudgetScenario",
    "ErrorBudget",
    "ImuChoice",
    "LinearCovariance",
    "Requirement",
    "Verdict",
    "bottleneck",
    "budget_content",
    "budget_of",
    "catalogue_specs",
    "choice_content",
    "choose_imu",
    "covariance_content",
    "error_budget",
    "linear_covariance",
    "linearised_mission",
    "prepare_budget",
    "requirement",
    "true_covariance",
]
