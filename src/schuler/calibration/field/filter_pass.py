"""One pass of the calibration filter, and the prior it is given only at its end.

The filter is linearised at what it believes. To linearise at the result of the pass before without using the log
twice, a pass starts there with a variance of its own, and at its end what that start said is taken out again and the
prior put in: for constants exactly, for slow walks as far as they are slow; other walks start at their prior. The start
is held within :data:`NEAR` sigma of the pass before: with the whole prior estimates wander far while little is known
(20 deg/s of a cheap gyroscope's bias), and what is linearised there stays wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.schedule import BlockNoise
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, ForwardRun, InitialState, run, unpack_symmetric
from schuler.filtering.measurements import DIMENSIONS, KINDS, MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments

#: 1-sigma of a start, in those of the result it is taken from. Wide enough to tell nothing, narrow enough to stay near.
NEAR = 30.0


@dataclass(frozen=True)
class Problem:
    """What all passes over one log share.

    Attributes
    ----------
    increments : Increments
        From the first rest on.
    schedule : MeasurementSchedule
    layout : StateLayout
    prior : ndarray, shape (m,)
        What is believed of the parameters before the log.
    llh : ndarray, shape (3,)
        [rad, rad, m]
    noise : BlockNoise
        That the measurements were given.
    gyro_psd : ndarray, shape (3,)
        [rad^2/s]
    accel_psd : ndarray, shape (3,)
        [m^2/s^3]
    tilt_sigma, heading_sigma : float
        Of the attitude at the start. [rad]
    options : FilterOptions
    """

    increments: Increments
    schedule: MeasurementSchedule
    layout: StateLayout
    prior: FloatArray
    llh: FloatArray
    noise: BlockNoise
    gyro_psd: FloatArray
    accel_psd: FloatArray
    tilt_sigma: float
    heading_sigma: float
    options: FilterOptions


@dataclass(frozen=True)
class Pass:
    """What a pass found.

    Attributes
    ----------
    values : ndarray, shape (m,)
        Parameters at the end of the log.
    covariance : ndarray, shape (m, m)
    rpy : ndarray, shape (3,)
        Attitude at the start that it was linearised at, heading by the smoother where there was one. [rad]
    nis : dict of str to (float, int)
        Sum of normalised innovations squared and their number of components, by kind of measurement.
    run : ForwardRun
    start : ndarray, shape (m,)
        Parameters it was linearised at.
    variance : ndarray, shape (m,), or None
        With which it started there; None if that was the prior, start and variance.
    softness : float
        Factor on all noise, see :mod:`schuler.calibration.field.softening`; 1 for a result.
    """

    values: FloatArray
    covariance: FloatArray
    rpy: FloatArray
    nis: dict[str, tuple[float, int]]
    run: ForwardRun
    start: FloatArray
    variance: FloatArray | None
    softness: float = 1.0

    @property
    def cost(self) -> float:
        """Sum of all normalised innovations squared."""
        return sum(value for value, _ in self.nis.values())


def filter_pass(
    problem: Problem,
    rpy: FloatArray,
    start: FloatArray | None = None,
    sigma: FloatArray | None = None,
    *,
    smoothable: bool = False,
) -> Pass:
    """Run the filter over the log once.

    Parameters
    ----------
    problem : Problem
    rpy : ndarray, shape (3,)
        Attitude at the start. [rad]
    start : ndarray, shape (m,), optional
        Parameters to linearise at; None is the prior itself.
    sigma : ndarray, shape (m,), optional
        Their 1-sigma where they come from a pass: the start is held near. None: twice the prior's variance.
    smoothable : bool
        Keep what the smoother needs, some 50 MB for ten minutes.

    Raises
    ------
    InputError
        If the filter diverged.
    """
    layout = problem.layout
    m = layout.size - 9
    variance = None
    if start is not None:
        variance = 2.0 * layout.initial_variances()
        variance = variance if sigma is None else np.minimum(variance, (NEAR * sigma) ** 2)
        # what a walk was at the start of the log is not what is taken out at its end
        moving = wandering(problem)
        variance = np.where(moving, layout.initial_variances(), variance)
        start = np.where(moving, problem.prior, start)
    at = problem.prior if start is None else start
    nav = NavState.from_geodetic(problem.increments.start, problem.llh, np.zeros(3), rpy)
    initial = InitialState.from_sigmas(
        nav, layout,
        attitude=np.array([problem.tilt_sigma, problem.tilt_sigma, problem.heading_sigma]),
        velocity=np.full(3, 0.1), position=np.full(3, 1.0), parameters=at.copy(),
    )  # fmt: skip
    if variance is not None:
        initial.P[9:, 9:] = np.diag(variance)
    options = replace(problem.options, smoother=smoothable)
    forward = run(problem.increments, problem.schedule, initial, layout, problem.gyro_psd, problem.accel_psd, options)
    n = layout.size
    values, P = forward.rec_est[-1], unpack_symmetric(forward.rec_P[-1:], n)[0, 9:, 9:]
    if variance is not None and m:
        values, P = with_prior(problem, at, variance, values, P)
    if not (np.isfinite(values).all() and np.isfinite(P).all() and (np.diag(P) >= 0.0).all()):
        raise InputError(
            "the filter diverged: the log does not fit the specification of the IMU. Check units and axes of the log, "
            "that the uncertainties of the specification allow for the errors of the IMU, and that nothing large (such "
            "as G_g) is left out"
        )
    return Pass(values, P, rpy, _nis(problem.schedule, forward), forward, at, variance)


def wandering(problem: Problem) -> np.ndarray:
    """Which parameters decay, or walk in the log by more than a tenth of their prior sigma. Shape (m,)."""
    rate, density = problem.layout.dynamics().T
    span = float(problem.increments.dt.sum())
    return np.asarray((rate > 0.0) | (density * span > 0.01 * problem.layout.initial_variances()))


def with_prior(
    problem: Problem, start: FloatArray, variance: FloatArray, values: FloatArray, P: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Take the start of a pass out of its result and put the prior in.

    Parameters
    ----------
    problem : Problem
    start, variance : ndarray, shape (m,)
        Of the start.
    values, P : ndarray, shape (m,), (m, m)
        Result of the pass.

    Returns
    -------
    values, P : ndarray, shape (m,), (m, m)

    Notes
    -----
    Information adds: ``P'^-1 = P^-1 + P0^-1 - V^-1`` and the same for the vectors, written so that nothing singular
    is inverted.
    """
    P0 = problem.layout.initial_variances()
    free = P0 > 0.0  # what is known exactly starts so and stays so
    p, v = np.where(free, P0, 1.0), np.where(free, variance, 1.0)
    unit = np.sqrt(p)
    scaled = P / np.outer(unit, unit)
    more = np.where(free, 1.0 - p / v, 0.0)  # information added, in that of the prior
    posterior = np.linalg.solve(np.eye(len(p)) + scaled * more, scaled)
    posterior = 0.5 * (posterior + posterior.T)
    pull = np.where(free, (problem.prior - values) / unit - (start - values) * unit / v, 0.0)
    return values + unit * (posterior @ pull), posterior * np.outer(unit, unit)


def _nis(schedule: MeasurementSchedule, forward: ForwardRun) -> dict[str, tuple[float, int]]:
    found = {}
    for kind in np.unique(schedule.kind):
        name = KINDS[int(kind)]
        if name in ("fix", "zero_velocity"):
            continue
        nis = forward.nis[schedule.kind == kind]
        nis = nis[np.isfinite(nis)]
        found[name] = (float(nis.sum()), len(nis) * DIMENSIONS[int(kind)])
    return found
