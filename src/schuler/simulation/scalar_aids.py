"""Simulated aids that give one number: odometer, heading, barometric height; each with the truth about its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.recording.series import OdometerSeries, ScalarSeries
from schuler.sensors.noise import gauss_markov
from schuler.simulation.motion import Motion

_MOST = 1e10  # samples: more than any memory holds


@dataclass(frozen=True, kw_only=True)
class HeadingModel:
    """A magnetometer or two antennas.

    Attributes
    ----------
    rate_hz : float
    sigma : float
        White 1-sigma. [rad]
    bias, bias_sigma : float
        Constant error: a given part, and the 1-sigma of a drawn one. [rad]
    drift, drift_time : float
        1-sigma of a Gauss-Markov error beside them, which the stated accuracy does not show (iron along a road), and
        its correlation time. [rad], [s]
    declination : float
        A magnetic heading is the true one less this, positive where the needle points east of true north. [rad]
    outages : tuple of (start, stop)
        [s]
    """

    rate_hz: float = 1.0
    sigma: float = 0.02
    bias: float = 0.0
    bias_sigma: float = 0.0
    drift: float = 0.0
    drift_time: float = 60.0
    declination: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        _check("HeadingModel", self.rate_hz, self.sigma, self.bias_sigma, self.drift, self.drift_time)


@dataclass(frozen=True, kw_only=True, repr=False)
class HeightModel(Abridged):
    """A barometer.

    Attributes
    ----------
    rate_hz : float
    sigma : float
        White 1-sigma. [m]
    bias, bias_sigma : float
        Error at the start: a given part, and the 1-sigma of a drawn one. [m]
    bias_walk : float
        Root density of its random walk (weather). [m/sqrt(s)]
    lever_b : ndarray, shape (3,)
        From the IMU to the barometer, body axes. [m]
    outages : tuple of (start, stop)
        [s]
    """

    rate_hz: float = 1.0
    sigma: float = 0.3
    bias: float = 0.0
    bias_sigma: float = 0.0
    bias_walk: float = 0.0
    lever_b: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    outages: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        _check("HeightModel", self.rate_hz, self.sigma, self.bias_sigma, self.bias_walk, 1.0)
        object.__setattr__(self, "lever_b", as_vector3(self.lever_b, "HeightModel.lever_b"))


class SimulatedScalar(NamedTuple):
    """A series and its slow error.

    Attributes
    ----------
    series : ScalarSeries
    bias : ndarray, shape (n,)
        Measured less true but for the white noise, at each sample; of a magnetic heading with the declination added.
        [unit of the series]
    """

    series: ScalarSeries
    bias: FloatArray


def simulate_heading(motion: Motion, model: HeadingModel, rng: np.random.Generator) -> SimulatedScalar:
    """Heading of the body's x axis, wrapped to +-pi.

    Parameters
    ----------
    motion : Motion
    model : HeadingModel
    rng : numpy.random.Generator

    Returns
    -------
    SimulatedScalar
    """
    t = times(motion.duration, model.rate_hz)
    white = model.sigma * rng.standard_normal(len(t))
    constant = model.bias + model.bias_sigma * rng.standard_normal()
    bias = constant + model.drift * gauss_markov(1.0, model.drift_time, (len(t),), 1.0 / model.rate_hz, rng)
    keep = outside(t, model.outages, "heading")
    t, white, bias = t[keep], white[keep], bias[keep]
    yaw = motion.state(t).rpy_nb[:, 2]
    value = frames.wrap_angle(yaw - model.declination + bias + white)
    return SimulatedScalar(ScalarSeries(t, value, np.full(len(t), model.sigma)), bias)


def simulate_height(motion: Motion, model: HeightModel, rng: np.random.Generator) -> SimulatedScalar:
    """Barometric height: ellipsoidal height plus a bias that walks.

    Parameters
    ----------
    motion : Motion
    model : HeightModel
    rng : numpy.random.Generator

    Returns
    -------
    SimulatedScalar
    """
    t = times(motion.duration, model.rate_hz)
    white = model.sigma * rng.standard_normal(len(t))
    steps = model.bias_walk * np.sqrt(np.diff(t)) * rng.standard_normal(max(len(t) - 1, 0))
    bias = model.bias + model.bias_sigma * rng.standard_normal() + np.concatenate(([0.0], np.cumsum(steps)))
    keep = outside(t, model.outages, "height")
    t, white, bias = t[keep], white[keep], bias[keep]
    s = motion.state(t)
    h = frames.llh_from_ecef(s.r_eb_e + s.C_eb @ np.asarray(model.lever_b))[:, 2]
    return SimulatedScalar(ScalarSeries(t, h + bias + white, np.full(len(t), model.sigma)), bias)


def simulate_odometer(
    motion: Motion,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    sigma: float = 0.05,
    scale_error: float = 0.0,
    lever_arm_b: Sequence[float] = (0.0, 0.0, 0.0),
    outages: tuple[tuple[float, float], ...] = (),
) -> OdometerSeries:
    """Speed of a wheel along the body's x axis.

    Parameters
    ----------
    motion : Motion
    rate_hz : float
    rng : numpy.random.Generator
    sigma : float
        White 1-sigma. [m/s]
    scale_error : float
        Relative error of the wheel's circumference. [-]
    lever_arm_b : sequence of 3 floats
        From the IMU to the wheel, body axes. [m]
    outages : tuple of (start, stop)
        [s]
    """
    t = times(motion.duration, rate_hz)
    white = sigma * rng.standard_normal(len(t))
    keep = outside(t, outages, "odometer")
    t, white = t[keep], white[keep]
    s = motion.state(t)
    v_b = rotation.rotate(rotation.quat_conjugate(s.q_eb), s.v_eb_e) + np.cross(
        s.omega_eb_b, as_vector3(lever_arm_b, "lever")
    )
    return OdometerSeries(t, (1.0 + scale_error) * v_b[:, 0] + white, np.full(len(t), sigma))


def times(duration: float, rate_hz: float, first: float = 0.0) -> FloatArray:
    """Sample times of a sensor within a motion. Shape (n,). [s]"""
    if duration * rate_hz > _MOST:
        raise InputError(
            f"a motion of {duration:g} s has more than {_MOST:.0e} measurements at {rate_hz:g} Hz: lower the rate"
        )
    return np.arange(first, duration + 1e-9, 1.0 / rate_hz)


def outside(t: FloatArray, windows: Sequence[tuple[float, float]], what: str) -> np.ndarray:
    """Which times are in no window ``start <= t < stop``; an error if none is. Shape (n,) of bool."""
    keep = np.ones(len(t), dtype=bool)
    for start, stop in windows:
        keep &= ~((t >= start) & (t < stop))
    if not keep.any():
        raise InputError(f"the outages leave no {what} at all")
    return keep


def _check(name: str, rate: float, sigma: float, bias_sigma: float, spread: float, time: float) -> None:
    if not (rate > 0.0 and sigma > 0.0 and time > 0.0 and bias_sigma >= 0.0 and spread >= 0.0):
        raise InputError(
            f"{name}: expected a positive rate, sigma and time and no negative spread, got rate {rate}, sigma {sigma}, "
            f"bias_sigma {bias_sigma}, drift or walk {spread}, time {time}"
        )
