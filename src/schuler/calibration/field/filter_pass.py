"""One pass of the calibration filter, its start replaced by the prior at the end.

The filter is linearised at its estimates. To linearise at the result of the pass before without using the log twice, a
pass starts there with a variance of its own; at its end the information of that start is taken out and the prior put
in: exact for constants, nearly so for slow walks; other walks start at their prior. The start is held within
:data:`NEAR` sigma of the pass before: with the variance of the prior, estimates wander far at first (20 deg/s of a
cheap gyroscope's bias), and linearisation errors made there remain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.problem import Problem, wandering_parameters
from schuler.exceptions import InputError
from schuler.filtering.engine import ForwardRun, run, unpack_symmetric
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import DIMENSIONS, KINDS, MeasurementSchedule
from schuler.mechanization.strapdown import NavState

#: 1-sigma of a start over that of the result it is taken from: wide, to carry no information, but near.
NEAR = 30.0


@dataclass(frozen=True)
class Pass:
    """Result of a pass.

    Attributes
    ----------
    values : ndarray, shape (m,)
        Parameters at the end of the log.
    covariance : ndarray, shape (m, m)
    rpy : ndarray, shape (3,)
        Attitude at the start, where it was linearised. [rad]
    nis : dict of str to (float, int)
        Sum of normalised innovations squared and their number of components, by kind of measurement.
    run : ForwardRun
    start : ndarray, shape (m,)
        Parameters at which it was linearised.
    variance : ndarray, shape (m,), or None
        Variance of that start; None if start and variance were those of the prior.
    noise_inflation : float
        Factor on all noise, see :mod:`schuler.calibration.field.noise_inflation`; 1 for a final result.
    """

    values: FloatArray
    covariance: FloatArray
    rpy: FloatArray
    nis: dict[str, tuple[float, int]]
    run: ForwardRun
    start: FloatArray
    variance: FloatArray | None
    noise_inflation: float = 1.0

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
        1-sigma of the start where it comes from a pass: it is held near. None: twice the prior's variance.
    smoothable : bool
        Keep the nodes of the smoother, some 50 MB for ten minutes.

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
        # a walk has another value at the end of the log, where its start would be taken out
        walking = wandering_parameters(problem)
        variance = np.where(walking, layout.initial_variances(), variance)
        start = np.where(walking, problem.prior, start)
    origin = problem.prior if start is None else start
    nav = NavState.from_geodetic(problem.increments.start, problem.llh, np.zeros(3), rpy)
    initial = InitialState.from_sigmas(
        nav, layout,
        attitude=np.array([problem.tilt_sigma, problem.tilt_sigma, problem.heading_sigma]),
        velocity=np.full(3, 0.1), position=np.full(3, 1.0), parameters=origin.copy(),
    )  # fmt: skip
    if variance is not None:
        initial.P[9:, 9:] = np.diag(variance)
    options = replace(problem.options, smoother=smoothable)
    forward = run(problem.increments, problem.schedule, initial, layout, problem.gyro_psd, problem.accel_psd, options)
    n = layout.size
    values, P = forward.rec_est[-1], unpack_symmetric(forward.rec_P[-1:], n)[0, 9:, 9:]
    if variance is not None and m:
        values, P = replace_start_by_prior(problem, origin, variance, values, P)
    if not (np.isfinite(values).all() and np.isfinite(P).all() and (np.diag(P) >= 0.0).all()):
        raise InputError(
            "the filter diverged: the log does not fit the specification of the IMU. Check units and axes of the log, "
            "that the uncertainties of the specification allow for the errors of the IMU, and that nothing large (such "
            "as G_g) is left out"
        )
    return Pass(values, P, rpy, _nis(problem.schedule, forward), forward, origin, variance)


def replace_start_by_prior(
    problem: Problem, start: FloatArray, variance: FloatArray, values: FloatArray, P: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Replace the information of the start of a pass by that of the prior.

    Parameters
    ----------
    problem : Problem
    start, variance : ndarray, shape (m,)
        Parameters of the start and their variance.
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
    free = P0 > 0.0  # without variance: held
    p, v = np.where(free, P0, 1.0), np.where(free, variance, 1.0)
    unit = np.sqrt(p)
    scaled = P / np.outer(unit, unit)
    excess = np.where(free, 1.0 - p / v, 0.0)  # information added, in that of the prior
    posterior = np.linalg.solve(np.eye(len(p)) + scaled * excess, scaled)
    posterior = 0.5 * (posterior + posterior.T)
    pull = np.where(free, (problem.prior - values) / unit - (start - values) * unit / v, 0.0)
    return values + unit * (posterior @ pull), posterior * np.outer(unit, unit)


def _nis(schedule: MeasurementSchedule, forward: ForwardRun) -> dict[str, tuple[float, int]]:
    sums = {}
    for kind in np.unique(schedule.kind):
        name = KINDS[int(kind)]
        if name in ("fix", "zero_velocity"):
            continue
        nis = forward.nis[schedule.kind == kind]
        nis = nis[np.isfinite(nis)]
        sums[name] = (float(nis.sum()), len(nis) * DIMENSIONS[int(kind)])
    return sums
