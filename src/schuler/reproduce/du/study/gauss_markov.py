"""Gauss-Markov models of an IMU's biases from the autocorrelation of a log at rest, for a filter in rotating axes.

White noise is in the autocorrelation at lag zero only, so a slow bias far below it can be seen at the other lags, given
time. What a filter needs is what is left after its own white noise: ``sigma^2 exp(-lag / tau)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.correlation import autocorrelation, expected_autocovariance
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout, StateModel
from schuler.plotting.table import Cell, ResultTable
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov

Sensor = Literal["gyro", "accel"]
_LEAST_LAGS = 10
_TRIES = 60  # correlation times tried, evenly in their logarithm


@dataclass(frozen=True)
class FittedBias:
    """A Gauss-Markov bias found in an autocorrelation.

    Attributes
    ----------
    sigma : float
        Steady-state standard deviation; zero if none is seen. [x]
    tau : float
        Correlation time. [s]
    sigma_range, tau_range : tuple of float
        Smallest and largest over the single axes and the halves of the record: what the record tells, without a model.
    white : float
        Root density of what is only at lag zero. [x/sqrt(Hz)]
    duration_s : float
        Length of the record. [s]
    """

    sigma: float
    tau: float
    sigma_range: tuple[float, float]
    tau_range: tuple[float, float]
    white: float
    duration_s: float

    def model(self, turn_on: float) -> StateModel:
        """State model of a filter, with the turn-on uncertainty of the bias at first. [x]

        Raises
        ------
        InputError
            If no slow bias was seen.
        """
        if not self.sigma > 0.0:
            raise InputError(
                "no slow bias is seen in the autocorrelation, so it has no Gauss-Markov model: use a random constant, "
                "or a longer record"
            )
        return StateModel.gauss_markov(self.sigma, self.tau, turn_on)


@dataclass(frozen=True)
class StaticModels:
    """Biases of the gyroscopes and of the accelerometers.

    Attributes
    ----------
    gyro, accel : FittedBias
    """

    gyro: FittedBias
    accel: FittedBias

    def layout(self, *, gyro_turn_on: float, accel_turn_on: float) -> StateLayout:
        """The fifteen states of Du's filter.

        Parameters
        ----------
        gyro_turn_on, accel_turn_on : float
            1-sigma of what the biases are at first. [rad/s], [m/s^2]
        """
        return StateLayout({"b_a": self.accel.model(accel_turn_on), "b_g": self.gyro.model(gyro_turn_on)})

    def table(self) -> ResultTable:
        """One row a triad, SI."""
        rows: list[tuple[Cell, ...]] = []
        for name, b in (("gyro [rad/s]", self.gyro), ("accel [m/s^2]", self.accel)):
            rows.append((name, b.sigma, *b.sigma_range, b.tau, *b.tau_range, b.white))
        return ResultTable(
            "Gauss-Markov biases from the autocorrelation at rest",
            ("triad", "sigma", "sigma_least", "sigma_most", "tau_s", "tau_least_s", "tau_most_s", "white"),
            tuple(rows),
            (f"record of {self.gyro.duration_s:.0f} s; ranges over axes and halves of it",),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()


def fit_bias(signals: ArrayLike, rate_hz: float, *, longest_s: float | None = None) -> FittedBias:
    """Fit ``sigma`` and ``tau`` to the autocorrelations of one or more axes together.

    Parameters
    ----------
    signals : array_like, shape (n, m)
        Readings at rest of m axes of one kind, without gaps. [x]
    rate_hz : float
        [Hz]
    longest_s : float, optional
        Longest lag; default a quarter of the record. [s]

    Returns
    -------
    FittedBias

    Raises
    ------
    InputError
        If the record is too short for ten lags of its means over a second.

    Notes
    -----
    Readings are averaged to 1 Hz. The expectation fitted is that of a finite record whose own mean was removed
    (:func:`~schuler.characterisation.correlation.expected_autocovariance`), and sigma is found linearly for every tau.
    Lag zero, which has the white noise, is left out. All lags weigh the same, as they do under white noise that is much
    larger than the bias.

    References
    ----------
    Du (2015), section 6.1: models from the autocorrelation of static data; how is not said.
    """
    x = as_floats(signals, "signals", (None, None))
    block = max(round(rate_hz), 1)
    x = x[: len(x) // block * block].reshape(-1, block, x.shape[1]).mean(axis=1)
    rate = rate_hz / block
    longest = 0.25 * len(x) / rate if longest_s is None else longest_s
    if longest * rate < _LEAST_LAGS:
        raise InputError(
            f"expected a record of at least {4 * _LEAST_LAGS} s, or a longest lag of {_LEAST_LAGS} s; got "
            f"{len(x) / rate:.0f} s and {longest:.0f} s"
        )
    sigma, tau, white = _fit(x, rate, longest)
    parts = [x[:, i : i + 1] for i in range(x.shape[1])]
    half = len(x) // 2
    if 0.25 * half >= _LEAST_LAGS:
        parts += [x[:half], x[half:]]
    single = np.array([_fit(p, rate, min(longest, 0.5 * len(p) / rate))[:2] for p in parts])
    return FittedBias(
        sigma, tau, (float(single[:, 0].min()), float(single[:, 0].max())),
        (float(single[:, 1].min()), float(single[:, 1].max())), white, len(x) / rate,
    )  # fmt: skip


def static_models(imu: ImuSeries) -> StaticModels:
    """Models of both triads from a log at rest, with the platform standing still.

    Parameters
    ----------
    imu : ImuSeries
        IMU axes, evenly sampled, without gaps.

    Raises
    ------
    InputError
        If the log has gaps or is too short.

    Notes
    -----
    With the platform still, biases in IMU and body axes are the same; turning, Earth rate and gravity would be in the
    autocorrelation at the period of rotation. What a rotating IMU's filter needs are models in IMU axes: these.
    """
    if len(imu.gaps()):
        raise InputError("the log has gaps; take a part without, the autocorrelation needs even samples")
    rates = imu.rates()
    return StaticModels(fit_bias(rates.gyro, rates.rate_hz), fit_bias(rates.accel, rates.rate_hz))


def _fit(x: FloatArray, rate: float, longest: float) -> tuple[float, float, float]:
    """sigma, tau and white noise density of the mean autocorrelation of several signals."""
    correlations = [autocorrelation(column, rate, longest_s=longest) for column in x.T]
    lag, duration = correlations[0].lag, len(x) / rate
    value = np.mean([c.value for c in correlations], axis=0)
    best = (np.inf, 0.0, 1.0)
    for tau in np.geomspace(2.0 / rate, duration, _TRIES):
        shape = expected_autocovariance(GaussMarkov(1.0, float(tau)), lag[1:], duration)
        size = float(shape @ value[1:] / (shape @ shape))
        misfit = float(np.sum((value[1:] - max(size, 0.0) * shape) ** 2))
        if misfit < best[0]:
            best = (misfit, max(size, 0.0), float(tau))
    _, variance, tau = best
    left = value[0]
    if variance > 0.0:
        left = value[0] - variance * float(expected_autocovariance(GaussMarkov(1.0, tau), lag[:1], duration)[0])
    return sqrt(variance), tau, sqrt(max(float(left), 0.0) / rate)
