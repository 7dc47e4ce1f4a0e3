from .closed_forms import constant as constant
from .closed_forms import gauss_markov as gauss_markov
from .closed_forms import lateral as lateral
from .closed_forms import lateral_white as lateral_white
from .closed_forms import lateral_white_large as lateral_white_large
from .closed_forms import lateral_white_sampled as lateral_white_sampled
from .closed_forms import random_walk as random_walk
from .closed_forms import second_order_vertical as second_order_vertical
from .closed_forms import white as white
from .closed_forms import white_sampled as white_sampled
from .dead_reckoning import Bounds as Bounds
from .dead_reckoning import planar_bounds as planar_bounds
from .dead_reckoning import planar_reckoning as planar_reckoning
from .dead_reckoning import spatial_bounds as spatial_bounds
from .dead_reckoning import spatial_reckoning as spatial_reckoning
from .dead_reckoning import upright_bounds as upright_bounds
from .dead_reckoning import upright_reckoning as upright_reckoning
from .integrals import integral_variance as integral_variance
from .schuler_loop import horizontal as horizontal
from .schuler_loop import schuler_frequency as schuler_frequency
from .schuler_loop import vertical as vertical
from .totals import Growth as Growth
from .totals import growth as growth

__all__ = [
    "Bounds",
    "Growth",
    "constant",
    "gauss_markov",
    "growth",
    "horizontal",
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
