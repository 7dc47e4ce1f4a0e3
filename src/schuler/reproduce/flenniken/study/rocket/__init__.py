"""Flenniken's rocket: where 54 errors put its computed impact, and which of them count."""

from schuler.reproduce.flenniken.study.rocket.budget import ImpactBudget, impact_budget
from schuler.reproduce.flenniken.study.rocket.ellipse import ImpactEllipse, circular_error_probable
from schuler.reproduce.flenniken.study.rocket.errors import RocketErrors, all_angles, is_random, parameter_names
from schuler.reproduce.flenniken.study.rocket.influence import Influence, Variant, influence
from schuler.reproduce.flenniken.study.rocket.motion import RocketMotion, rocket_motion
from schuler.reproduce.flenniken.study.rocket.scatter import ImpactScatter, impact_scatter
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketProfile, RocketTrajectory, rocket_trajectory

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
