"""The noise of an error budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

from schuler.sensors.noise._checks import Start
from schuler.sensors.noise.drawn_once import Ramp
from schuler.sensors.noise.flicker import Flicker
from schuler.sensors.noise.markov import GaussMarkov
from schuler.sensors.noise.process import NoiseModel, Process
from schuler.sensors.noise.terms import RandomWalk, White

if TYPE_CHECKING:
    from schuler.sensors.spec import TriadSpec


def noise_model(triad: TriadSpec, start: Start = "stationary") -> NoiseModel:
    """The noise terms of an error budget: N, in-run Gauss-Markov, K, R and B, as far as they are not zero.

    Parameters
    ----------
    triad : TriadSpec
    start : {"stationary", "zero"}
        Of the in-run Gauss-Markov bias.

    Returns
    -------
    NoiseModel
        B is :class:`Flicker`, drawn over a band that fits rate and duration. Q is not a term here: it comes from
        rounding (:func:`quantise_increments`).
    """
    terms: list[Process] = [White(triad.random_walk)]
    if triad.in_run_bias:
        terms.append(GaussMarkov(triad.in_run_bias, triad.in_run_time, start))
    if triad.rate_random_walk:
        terms.append(RandomWalk(triad.rate_random_walk))
    if triad.rate_ramp:
        terms.append(Ramp(triad.rate_ramp))
    if triad.bias_instability:
        terms.append(Flicker(triad.bias_instability))
    return NoiseModel(tuple(terms))
