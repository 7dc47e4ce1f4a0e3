"""How uncertain a mission will be, which error is to blame, which IMU is good enough: linear covariance, no data."""

from schuler.budget.budget import ErrorBudget, budget_of, error_budget
from schuler.budget.choice import Bottleneck, ImuChoice, Verdict, bottleneck, catalogue_specs, choose_imu
from schuler.budget.covariance import QUANTITIES, LinearCovariance, linear_covariance, true_covariance
from schuler.budget.requirement import Requirement, requirement
from schuler.budget.scenario import (
    BudgetMission,
    BudgetScenario,
    linearised_mission,
    prepare_budget,
)

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
    "budget_of",
    "catalogue_specs",
    "choose_imu",
    "error_budget",
    "linear_covariance",
    "linearised_mission",
    "prepare_budget",
    "requirement",
    "true_covariance",
]
