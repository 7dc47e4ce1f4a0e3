"""Dead reckoning of many runs at once: in the horizontal plane, in the north-up plane, and in space.

Flenniken (2005) integrates with Runge-Kutta and inputs held over a step. That is the exact solution for held inputs, so
sums do the same work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.growth.integrals import Start
from schuler.plotting.notebook import Abridged
from schuler.units import G0

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.sensors.spec import ImuSpec, TriadSpec


Attitude: TypeAlias = Literal["strapdown", "thesis"]


@dataclass(frozen=True, repr=False)
class Bounds(Abridged):
    """1-sigma over runs at the end of each step.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    sigma, mean : dict of str to ndarray, shape (k,)
        By quantity: ``heading`` [rad], ``velocity_north`` [m/s], ``position_up`` [m] and so on.
    runs : int
    """

    t: FloatArray
    sigma: dict[str, FloatArray]
    mean: dict[str, FloatArray]
    runs: int

    @property
    def uncertainty(self) -> float:
        """Relative standard error of a sigma."""
        return float(1.0 / np.sqrt(2.0 * (self.runs - 1)))

    def index(self, seconds: float) -> int:
        """Index of the time nearest to ``seconds``."""
        return int(np.argmin(np.abs(self.t - seconds)))

    def plot(self) -> Figure:
        """Bounds over time (matplotlib)."""
        from schuler.growth.figures import bounds_figure
        from schuler.plotting.drawing import draw

        return draw(bounds_figure(self))


def planar_reckoning(
    rate: FloatArray, accel: FloatArray, step: float, *, heading: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Heading, velocity and position from readings held over each step.

    Parameters
    ----------
    rate, accel : ndarray, shape (k, runs)
        Turn rate, north over east [rad/s], and forward acceleration [m/s^2].
    step : float
        [s]
    heading : float
        At the start. [rad]

    Returns
    -------
    heading : ndarray, shape (k, runs)
        At the end of each step. [rad]
    velocity, position : ndarray, shape (k, runs, 2)
        North, east. [m/s], [m]

    References
    ----------
    Flenniken (2005), eqs. (3.1)-(3.7).
    """
    end = heading + step * np.cumsum(rate, axis=0)
    begin = end - step * rate
    a = accel[..., None] * np.stack((np.cos(begin), np.sin(begin)), axis=-1)
    velocity = step * np.cumsum(a, axis=0)
    position = step * np.cumsum(velocity - 0.5 * step * a, axis=0)
    return end, velocity, position


def spatial_reckoning(
    rate: FloatArray,
    accel: FloatArray,
    step: float,
    *,
    gravity: float = G0,
    attitude: Attitude = "strapdown",
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Attitude, velocity and position in space from readings held over each step, flat Earth that stands still.

    Parameters
    ----------
    rate, accel : ndarray, shape (k, runs, 3)
        Body rates [rad/s] and specific force [m/s^2], forward, right, down.
    step : float
        [s]
    gravity : float
        Zero leaves it out, of readings too. [m/s^2]
    attitude : {"strapdown", "thesis"}
        Rotations composed; or angles as plain sums of the body rates, which holds for small angles or turns about one
        axis only, eqs. (5.25)-(5.29).
    rpy : tuple of float
        Roll, pitch, yaw at the start. [rad]

    Returns
    -------
    angles : ndarray, shape (k, runs, 3)
        Roll, pitch, yaw at the end of each step. [rad]
    velocity, position : ndarray, shape (k, runs, 3)
        North, east, down. [m/s], [m]

    References
    ----------
    Flenniken (2005), eqs. (5.25)-(5.40), whose axes are north-up-east; ours are north-east-down throughout.
    """
    count, runs = rate.shape[:2]
    angles, velocity = np.empty((count, runs, 3)), np.empty((count, runs, 3))
    position = np.empty((count, runs, 3))
    v, r = np.zeros((runs, 3)), np.zeros((runs, 3))
    start = np.array(rpy)
    q = np.tile(rotation.quat_from_dcm(rotation.dcm_from_rpy(start)), (runs, 1))
    summed = np.tile(start, (runs, 1))
    down = np.array([0.0, 0.0, gravity])
    for k in range(count):
        C = rotation.dcm_from_quat(q) if attitude == "strapdown" else rotation.dcm_from_rpy(summed)
        a = np.einsum("rij,rj->ri", C, accel[k]) + down
        r = r + step * v + 0.5 * step**2 * a
        v = v + step * a
        if attitude == "strapdown":
            q = rotation.quat_multiply(q, rotation.quat_from_rotvec(step * rate[k]))
            angles[k] = rotation.rpy_from_quat(q)
        elif attitude == "thesis":
            summed = summed + step * rate[k]
            angles[k] = summed
        else:
            raise InputError(f"attitude: expected 'strapdown' or 'thesis', got {attitude!r}")
        velocity[k], position[k] = v, r
    return angles, velocity, position


def readings(
    triad: TriadSpec, shape: tuple[int, ...], step: float, rng: np.random.Generator, *, start: Start = "stationary"
) -> FloatArray:
    """Errors of a triad's samples: white noise, in-run bias, turn-on bias; time is the first axis of ``shape``."""
    e = triad.random_walk / np.sqrt(step) * rng.standard_normal(shape)
    if triad.in_run_bias:
        keep = float(np.exp(-step / triad.in_run_time))
        b = triad.in_run_bias * rng.standard_normal(shape[1:]) if start == "stationary" else np.zeros(shape[1:])
        drive = triad.in_run_bias * np.sqrt(1.0 - keep**2)
        for k in range(shape[0]):
            e[k] += b
            b = keep * b + drive * rng.standard_normal(shape[1:])
    if triad.turn_on_bias:
        e += triad.turn_on_bias * rng.standard_normal(shape[1:])
    return np.asarray(e)


def planar_bounds(
    spec: ImuSpec,
    duration: float,
    *,
    rate_hz: float = 20.0,
    runs: int = 2000,
    seed: int = 0,
    start: Start = "zero",
    turn_rate: float = 0.0,
    acceleration: float = 0.0,
) -> Bounds:
    """Monte Carlo of the planar platform, at rest or moving.

    Parameters
    ----------
    spec : ImuSpec
    duration : float
        [s]
    rate_hz, runs, seed
    start : {"stationary", "zero"}
        State of the in-run biases at the start; the thesis's numbers fit zero.
    turn_rate, acceleration : float
        True motion: errors are against the reckoning of true readings. [rad/s], [m/s^2]

    References
    ----------
    Flenniken (2005), section 3.2, figures 3.1-3.6.
    """
    step, count = 1.0 / rate_hz, round(duration * rate_hz)
    rng = np.random.default_rng(seed)
    w, a = np.full((count, 1), turn_rate), np.full((count, 1), acceleration)
    true = planar_reckoning(w, a, step)
    wrong = planar_reckoning(
        w + readings(spec.gyro, (count, runs), step, rng, start=start),
        a + readings(spec.accel, (count, runs), step, rng, start=start), step,
    )  # fmt: skip
    heading, velocity, position = (x - y for x, y in zip(wrong, true, strict=True))
    named = {"heading": heading, **by_axis(("north", "east"), velocity, position)}
    return bounds_over(step, named, runs)


def spatial_bounds(
    spec: ImuSpec,
    duration: float,
    *,
    rate_hz: float = 20.0,
    runs: int = 1000,
    seed: int = 0,
    start: Start = "stationary",
    gravity: float = G0,
    attitude: Attitude = "strapdown",
) -> Bounds:
    """Monte Carlo of six sensors at rest, with gravity or without (Flenniken 2005, figures 5.2-5.7).

    Parameters as of :func:`planar_bounds` and :func:`spatial_reckoning`.
    """
    step, count = 1.0 / rate_hz, round(duration * rate_hz)
    rng = np.random.default_rng(seed)
    rate = readings(spec.gyro, (count, runs, 3), step, rng, start=start)
    force = readings(spec.accel, (count, runs, 3), step, rng, start=start)
    force[..., 2] -= gravity
    angles, velocity, position = spatial_reckoning(rate, force, step, gravity=gravity, attitude=attitude)
    named = {name: angles[..., i] for i, name in enumerate(("roll", "pitch", "heading"))}
    named |= by_axis(("north", "east", "down"), velocity, position)
    return bounds_over(step, named, runs)


def by_axis(axes: Sequence[str], velocity: FloatArray, position: FloatArray) -> dict[str, FloatArray]:
    """Components of velocity and position, shape (..., n), by name."""
    named: dict[str, FloatArray] = {}
    for i, axis in enumerate(axes):
        named |= {f"velocity_{axis}": velocity[..., i], f"position_{axis}": position[..., i]}
    return named


def bounds_over(step: float, named: dict[str, FloatArray], runs: int) -> Bounds:
    """Deviation and mean over runs of errors of shape (k, runs)."""
    count = len(next(iter(named.values())))
    return Bounds(
        np.asarray(step * np.arange(1, count + 1), dtype=np.float64),
        {name: np.asarray(np.std(x, axis=1, ddof=1)) for name, x in named.items()},
        {name: np.asarray(np.mean(x, axis=1)) for name, x in named.items()},
        runs,
    )


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
    Flenniken (2005), eqs. (3.53)-(3.55), where gravity enters the upward channel.
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
        State of the in-run biases at the start.
    gravity : float
        Zero leaves it out. [m/s^2]
    gravity_model : {"strapdown", "thesis"}
        See :func:`upright_reckoning`.

    Returns
    -------
    Bounds
        ``pitch``, and velocity and position ``north`` and ``up``.

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
