"""How errors of an IMU grow when nothing aids it: closed forms, and dead reckoning in the plane and in space."""

from schuler.growth.bounded import horizontal, schuler_frequency, vertical
from schuler.growth.dead_reckoning import (
    Bounds,
    planar_bounds,
    planar_reckoning,
    spatial_bounds,
    spatial_reckoning,
)
from schuler.growth.forms import (
    constant,
    gauss_markov,
    lateral,
    lateral_white,
    lateral_white_large,
    lateral_white_sampled,
    random_walk,
    second_order_vertical,
    white,
    white_sampled,
)
from schuler.growth.gauss_markov import integral_covariance, integral_variance
from schuler.growth.totals import Growth, growth
from schuler.growth.upright import upright_bounds, upright_reckoning

__all__ = [
    "Bounds",
    "Growth",
    "constant",
    "gauss_markov",
    "growth",
    "horizontal",
    "integral_covariance",
    "integral_variance",
    "lateral",
    "lateral_white",
    "lateral_white_large",
    "lateral_white_sampled",
    "planar_bounds",
    "planar_reckoning",
    "random_walk",
    "schuler_frequency",
    "second_order_vertical",
    "spatial_bounds",
    "spatial_reckoning",
    "upright_bounds",
    "upright_reckoning",
    "vertical",
    "white",
    "white_sampled",
]
