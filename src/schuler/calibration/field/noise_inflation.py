"""Measurement noise enlarged: while the estimates of the first passes are far off, and where a log shows more noise.

Linearisation error of the first passes: a bias of 0.1 g estimated beside a scale factor of 2 % leaves errors of second
order of 0.2 m/s^2, little beside the noise of a cheap unit but hundreds of sigma of a good one. The filter would take
them for information, be off by much more than its covariance, and the next pass would start there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.filter_pass import Pass
from schuler.calibration.field.problem import Problem
from schuler.calibration.result.result import Residuals
from schuler.filtering.measurements import (
    FIX,
    GRAVITY,
    GRAVITY_VECTOR,
    KINDS,
    ZERO_RATE,
    ZERO_VELOCITY,
    MeasurementSchedule,
)
from schuler.units import G0

#: Largest errors of second order of a block, in sigma of the block. Where rests are held, the ten blocks of a rest are
#: compared with one attitude and a third is allowed: with 30, one of 200 drawn MPU-6000 (0.2 g) diverged.
LARGEST_ERROR, LARGEST_ERROR_HELD = 30.0, 10.0
_CHANCE = 1e-4  # probability of the residuals below which the noise is enlarged
_FEWEST = 5  # degrees of freedom of the test of rests
#: Residuals that test a kind of measurement, families of parameters fitted to them, and their largest number.
_TESTS: dict[str, tuple[str, tuple[str, ...], int]] = {
    "gravity": ("accel", ("b_a", "M_a"), 9),
    "gravity_vector": ("accel", ("b_a", "M_a"), 9),
    "earth_rate": ("gyro", ("b_g", "G_g"), 12),
    "zero_rate": ("gyro", ("b_g", "G_g"), 4),  # fitted to three axes, of which the residuals are one
}


def noise_inflation(problem: Problem, sigma: FloatArray) -> float:
    """Factor on all noise with which a pass from parameters of these 1-sigma is nearly linear; 1 or more.

    Parameters
    ----------
    problem : Problem
    sigma : ndarray, shape (m,)
        1-sigma of the parameters at the start of the pass.

    Notes
    -----
    Attitude and direction of the specific force are off by an angle ``eta``: bias over gravity, scale factor and
    misalignment of the accelerometers, and those of the gyroscopes times a turn by a radian. The error of second order
    is ``g eta^2``.
    """
    eta = 0.0
    for block in ("b_a", "S_a", "M_a", "S_g", "M_g"):
        if block in problem.layout:
            at = problem.layout[block]
            eta += float(np.max(sigma[at.start - 9 : at.stop - 9])) / (G0 if block == "b_a" else 1.0)
    s = problem.schedule
    gravity = np.isin(s.kind, (GRAVITY, GRAVITY_VECTOR))
    if not gravity.any():
        return 1.0
    block_sigma = float(np.sqrt(np.median(s.R[gravity, 0, 0])))
    largest = LARGEST_ERROR_HELD if np.any(s.kind == ZERO_RATE) else LARGEST_ERROR
    return max(1.0, G0 * eta**2 / (largest * block_sigma))


def inflate_noise(problem: Problem, factor: float) -> Problem:
    """The problem with ``factor`` times the noise of readings; position and velocity are held as before."""
    if factor == 1.0:
        return problem
    s = problem.schedule
    readings = ~np.isin(s.kind, (FIX, ZERO_VELOCITY))
    R = np.where(readings, factor**2, 1.0)[:, None, None] * s.R
    return replace(problem, schedule=replace(s, R=R), gyro_psd=factor**2 * problem.gyro_psd)


def inflated_sigma(problem: Problem, last: Pass) -> FloatArray:
    """1-sigma of a pass, enlarged where its innovations exceed their variance, at most the prior's. Shape (m,)."""
    count = sum(n for _, n in last.nis.values())
    factor = max(1.0, last.cost / count) if count else 1.0
    variance = np.minimum(factor * np.diag(last.covariance), problem.layout.initial_variances())
    return np.sqrt(variance)


def variance_factors(
    last: Pass, problem: Problem, residuals: dict[str, Residuals], names: tuple[str, ...], t: FloatArray
) -> dict[str, float]:
    """Factors on the variances of kinds of measurements that show more noise than chance explains.

    Parameters
    ----------
    last : Pass
        Converged.
    problem : Problem
    residuals : dict of str to Residuals
        Per rest, at the parameters of the pass: ``accel`` and ``gyro``.
    names : tuple of str
        Estimated parameters.
    t : ndarray, shape (k,)
        Middle of each rest. [s]

    Returns
    -------
    dict of str to float

    Notes
    -----
    Two tests, the larger factor counts. Innovations of all blocks show noise that is larger than stated from block to
    block. An error common to the blocks of a rest (a support that gives way, a hand, a bias that depends on the pose)
    is an innovation of the first block only and would pass there, but the mean of the rest is then off by many of its
    sigma. So magnitude of gravity and vertical rate are tested for the means of rests too; their factor on all blocks
    makes these means right. Parameters are those at the end of the log, with the variance of their walk since the
    rest.
    """
    from scipy.stats import chi2

    factors: dict[str, float] = {}
    for kind, (total, count) in last.nis.items():
        if count > 20 and chi2.sf(total, count) < _CHANCE:
            factors[kind] = total / count
        if kind not in _TESTS:
            continue
        name, families, largest = _TESTS[kind]
        rests = residuals[name]
        variance = rests.sigma**2 + _wander_variance(
            problem, 1 if name == "accel" else 0, rests.direction, float(problem.increments.t[-1]) - t
        )
        freedom = len(t) - min(largest, sum(n[:3] in families for n in names))
        squares = float(np.sum(rests.value**2 / variance))
        if freedom >= _FEWEST and chi2.sf(squares, freedom) < _CHANCE:
            factors[kind] = max(factors.get(kind, 1.0), squares / freedom)
    return factors


def _wander_variance(problem: Problem, sensor: int, up: FloatArray | None, ago: FloatArray) -> FloatArray:
    """Variance in a rest's readings of the walk of parameters since that rest. Shape (k,)."""
    assert up is not None
    g = float(np.linalg.norm(earth.gravity_ned(float(problem.llh[0]), float(problem.llh[2]))))
    variance = np.zeros(len(ago))
    dynamics = problem.layout.dynamics()
    for (which, axis, source), (rate, density) in zip(problem.layout.table(), dynamics, strict=True):
        if which == sensor and source < 4 and density > 0.0:
            sensitivity = up[:, axis] * (1.0 if source == 0 else g * up[:, source - 1])
            variance += sensitivity**2 * density * (ago if rate == 0.0 else -np.expm1(-rate * ago) / rate)
    return variance


def scale_variances(schedule: MeasurementSchedule, factors: dict[str, float]) -> MeasurementSchedule:
    """Measurements with their variances times the factors of their kinds."""
    R = schedule.R.copy()
    for kind, name in KINDS.items():
        if name in factors:
            R[schedule.kind == kind] *= factors[name]
    return replace(schedule, R=R)
