"""Sensor error models: budgets, one realisation of the errors, noise processes, a catalogue, increments."""

from schuler.sensors import catalogue
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.sensors.grades import GradeVerdict, grade
from schuler.sensors.initial_errors import InitialErrors
from schuler.sensors.noise import (
    AutoRegressive,
    Coloured,
    Flicker,
    GaussMarkov,
    GaussMarkov2,
    NoiseModel,
    Process,
    Quantisation,
    Ramp,
    RandomConstant,
    RandomWalk,
    SampledStateSpace,
    Sinusoid,
    StateSpace,
    White,
    flicker,
    gauss_markov,
    noise_model,
    quantise,
    quantise_increments,
    random_walk,
    white,
)
from schuler.sensors.spec import ImuSpec, TriadSpec, allan_minimum
from schuler.sensors.triads import AccelerometerTriad, GyroTriad, SimpleTriad

__all__ = [
    "AccelerometerTriad",
    "ApplyReport",
    "AutoRegressive",
    "Coloured",
    "Flicker",
    "GaussMarkov",
    "GaussMarkov2",
    "GradeVerdict",
    "GyroTriad",
    "ImuErrors",
    "ImuSpec",
    "InitialErrors",
    "NoiseModel",
    "Process",
    "Quantisation",
    "Ramp",
    "RandomConstant",
    "RandomWalk",
    "SampledStateSpace",
    "SimpleTriad",
    "Sinusoid",
    "StateSpace",
    "TriadSpec",
    "White",
    "allan_minimum",
    "catalogue",
    "flicker",
    "gauss_markov",
    "grade",
    "noise_model",
    "quantise",
    "quantise_increments",
    "random_walk",
    "white",
]
