"""Heading and position filters of two to six states: what a bias model is worth while GNSS is away."""

from schuler.reproduce.flenniken.study.heading.comparison import HeadingOutages, heading_outages, recorded_outage
from schuler.reproduce.flenniken.study.heading.consistency import heading_nees
from schuler.reproduce.flenniken.study.heading.filters import (
    constant_bias,
    gauss_markov_bias,
    position_filter,
    split_bias,
)
from schuler.reproduce.flenniken.study.heading.growth import HeadingBound, heading_bound
from schuler.reproduce.flenniken.study.heading.linear import Discrete, LinearModel
from schuler.reproduce.flenniken.study.heading.runs import FilterRuns, run_filter
from schuler.reproduce.flenniken.study.heading.truth import BiasTruth, gyro_readings

__all__ = [
    "BiasTruth",
    "Discrete",
    "FilterRuns",
    "HeadingBound",
    "HeadingOutages",
    "LinearModel",
    "constant_bias",
    "gauss_markov_bias",
    "gyro_readings",
    "heading_bound",
    "heading_nees",
    "heading_outages",
    "position_filter",
    "recorded_outage",
    "run_filter",
    "split_bias",
]
