"""Sensor error models: budgets, one realisation of the errors, noise processes, a catalogue, increments."""

from schuler.sensors import catalogue
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.sensors.noise import (
    GaussMarkov,
    NoiseModel,
    Process,
    Ramp,
    RandomWalk,
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

__all__ = [
    "ApplyReport",
    "GaussMarkov",
    "ImuErrors",
    "ImuSpec",
    "NoiseModel",
    "Process",
    "Ramp",
    "RandomWalk",
    "TriadSpec",
    "White",
    "allan_minimum",
    "catalogue",
    "flicker",
    "gauss_markov",
    "noise_model",
    "quantise",
    "quantise_increments",
    "random_walk",
    "white",
]
