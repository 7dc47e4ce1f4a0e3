"""Random errors of a sensor: exact discrete generators with their spectra and Allan variances.

Everything here is a *rate-like* signal x (angular rate in rad/s or specific force in m/s^2) sampled every ``dt``. Over
an interval ``dt`` it adds ``x * dt`` to an increment, so white noise of root density N has standard deviation
``N / sqrt(dt)`` on a rate sample and ``N * sqrt(dt)`` on an increment. Spectra are two-sided: ``S(f)`` is defined for
negative and positive f and integrates to the variance over both.
"""

from schuler.sensors.noise._checks import Shape, Start
from schuler.sensors.noise.autoregressive import AutoRegressive
from schuler.sensors.noise.budget import noise_model
from schuler.sensors.noise.coloured import Coloured
from schuler.sensors.noise.counted import Counted
from schuler.sensors.noise.drawn_once import Ramp, RandomConstant, Sinusoid
from schuler.sensors.noise.flicker import Flicker, flicker
from schuler.sensors.noise.generators import gauss_markov, quantise, quantise_increments, random_walk, white
from schuler.sensors.noise.markov import GaussMarkov, GaussMarkov2
from schuler.sensors.noise.process import NoiseModel, Process, terms_of
from schuler.sensors.noise.shot import ShotNoise
from schuler.sensors.noise.state_space import SampledStateSpace, StateSpace
from schuler.sensors.noise.terms import Quantisation, RandomWalk, White

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
