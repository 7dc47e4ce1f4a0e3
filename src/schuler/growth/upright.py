"""Dead reckoning in the north-up plane, where gravity enters through a wrong pitch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.growth.dead_reckoning import Bounds, bounds_over, by_axis, readings
from schuler.growth.gauss_markov import Start
from schuler.units import G0

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

GravityModel: TypeAlias = Literal["strapdown", "thesis"]


def upright_reckoning(
    rate: FloatArray, accel: FloatArray, step: float, *, gravity: float = G0, gravity_model: GravityModel = "strapdown"
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pitch, velocity and position in the north-up plane, gravity included.

    Parameters
    ----------
    rate, accel : ndarray, shape (k, runs)
        Pitch rate, nose up, and forward specific force; the upward specific force is taken to be ``gravity``.
    step, gravity : float
    gravity_model : {"strapdown", "thesis"}
        A tilt turns the upward reading into a northward acceleration, as an IMU's does; or, as printed, pitch enters
        the upward channel.

    Returns
    -------
    pitch : ndarray, shape (k, runs)
    velocity, position : ndarray, shape (k, runs, 2)
        North, up.

    References
    ----------
    Flenniken (2005), eqs. (3.53)-(3.55); the digest's remark on the gravity channel.
    """
    end = step * np.cumsum(rate, axis=0)
    begin = end - step * rate
    c, s = np.cos(begin), np.sin(begin)
    if gravity_model == "strapdown":
        a = np.stack((accel * c - gravity * s, accel * s + gravity * (c - 1.0)), axis=-1)
    elif gravity_model == "thesis":
        a = np.stack((accel * c, (accel - gravity) * s), axis=-1)
    else:
        raise InputError(f"gravity_model: expected 'strapdown' or 'thesis', got {gravity_model!r}")
    velocity = step * np.cumsum(a, axis=0)
    return end, velocity, step * np.cumsum(velocity - 0.5 * step * a, axis=0)


def upright_bounds(
    spec: ImuSpec,
    duration: float,
    *,
    rate_hz: float = 20.0,
    runs: int = 2000,
    seed: int = 0,
    start: Start = "zero",
    gravity: float = G0,
    gravity_model: GravityModel = "strapdown",
) -> Bounds:
    """Monte Carlo of the upright platform at rest.

    Parameters
    ----------
    spec : ImuSpec
    duration : float
        [s]
    rate_hz, runs, seed
        The same seed gives the same readings as :func:`.planar_bounds`.
    start : {"stationary", "zero"}
        Of the in-run biases.
    gravity : float
        Zero leaves it out. [m/s^2]
    gravity_model : {"strapdown", "thesis"}
        See :func:`upright_reckoning`.

    Returns
    -------
    Bounds
        Of ``pitch``, and velocity and position ``north`` and ``up``.

    References
    ----------
    Flenniken (2005), section 3.9, figures 3.14-3.17.
    """
    step, count = 1.0 / rate_hz, round(duration * rate_hz)
    rng = np.random.default_rng(seed)
    rate = readings(spec.gyro, (count, runs), step, rng, start=start)
    accel = readings(spec.accel, (count, runs), step, rng, start=start)
    pitch, velocity, position = upright_reckoning(rate, accel, step, gravity=gravity, gravity_model=gravity_model)
    named = {"pitch": pitch, **by_axis(("north", "up"), velocity, position)}
    return bounds_over(step, named, runs)
