"""Heading and position filters of two to six states: what a bias model is worth while GNSS is away."""

from schuler.reproduce.flenniken.study.heading.filters import (
    BiasTruth,
    constant_bias,
    gauss_markov_bias,
    gyro_readings,
    position_filter,
    split_bias,
)
from schuler.reproduce.flenniken.study.heading.growth import HeadingBound, heading_bound
from schuler.reproduce.flenniken.study.heading.linear import Discrete, LinearModel
from schuler.reproduce.flenniken.study.heading.outages import (
    HeadingOutages,
    heading_nees,
    heading_outages,
    recorded_outage,
)
from schuler.reproduce.flenniken.study.heading.runs import FilterRuns, run_filter

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
