from ._checks import Shape as Shape
from ._checks import Start as Start
from .autoregressive import AutoRegressive as AutoRegressive
from .bias_instability import Flicker as Flicker
from .bias_instability import flicker as flicker
from .coloured import Coloured as Coloured
from .counted import Counted as Counted
from .generators import gauss_markov as gauss_markov
from .generators import quantise as quantise
from .generators import quantise_increments as quantise_increments
from .generators import random_walk as random_walk
from .generators import white as white
from .markov import GaussMarkov as GaussMarkov
from .markov import GaussMarkov2 as GaussMarkov2
from .process import NoiseModel as NoiseModel
from .process import Process as Process
from .process import terms_of as terms_of
from .shot import ShotNoise as ShotNoise
from .state_space import SampledStateSpace as SampledStateSpace
from .state_space import StateSpace as StateSpace
from .terms import Quantisation as Quantisation
from .terms import Ramp as Ramp
from .terms import RandomConstant as RandomConstant
from .terms import RandomWalk as RandomWalk
from .terms import Sinusoid as Sinusoid
from .terms import White as White
from .terms import noise_model as noise_model

__all__ = [
    "AutoRegressive",
    "Coloured",
    "Counted",
    "Flicker",
    "GaussMarkov",
    "GaussMarkov2",
    "NoiseModel",
    "Process",
    "Quantisation",
    "Ramp",
    "RandomConstant",
    "RandomWalk",
    "SampledStateSpace",
    "Shape",
    "ShotNoise",
    "Sinusoid",
    "Start",
    "StateSpace",
    "White",
    "flicker",
    "gauss_markov",
    "noise_model",
    "quantise",
    "quantise_increments",
    "random_walk",
    "terms_of",
    "white",
]
