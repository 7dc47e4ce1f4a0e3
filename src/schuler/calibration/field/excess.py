"""How much larger the noise at rest is than was thought: by innovations, and by the rests themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.calibration.field.filter_pass import Pass, Problem
from schuler.calibration.result.result import Residuals
from schuler.filtering.measurements import KINDS, MeasurementSchedule

_CHANCE = 1e-4  # what is less probable than this enlarges the noise
_FEWEST = 5  # degrees of freedom of the test of rests
#: Residuals that test a kind of measurement, families of parameters that fit them, and how many of these they see.
_TESTS: dict[str, tuple[str, tuple[str, ...], int]] = {
    "gravity": ("accel", ("b_a", "M_a"), 9),
    "gravity_vector": ("accel", ("b_a", "M_a"), 9),
    "earth_rate": ("gyro", ("b_g", "G_g"), 12),
    "zero_rate": ("gyro", ("b_g", "G_g"), 4),  # fitted to three axes, of which the residuals are one
}


def excess(
    last: Pass, problem: Problem, residuals: dict[str, Residuals], names: tuple[str, ...], t: FloatArray
) -> dict[str, float]:
    """Factors on the variances of kinds of measurements that show more noise than chance explains.

    Parameters
    ----------
    last : Pass
        Settled.
    problem : Problem
    residuals : dict of str to Residuals
        Per rest, at its parameters: ``accel`` and ``gyro``.
    names : tuple of str
        Parameters that were estimated.
    t : ndarray, shape (k,)
        Middle of each rest. [s]

    Returns
    -------
    dict of str to float

    Notes
    -----
    Two tests, the larger factor counts. Innovations of all blocks see noise that is larger than stated from block to
    block. What is common to the blocks of a rest (a support that gives way, a hand, a bias that depends on the pose) is
    news in its first block only and would pass there, but then the rest is wrong by many times what a mean of so many
    blocks should be. So magnitude of gravity and vertical rate of whole rests are tested too; their factor on all
    blocks makes the means right. Parameters are those at the end of the log: what walks may have moved is allowed for.
    """
    from scipy.stats import chi2

    factors: dict[str, float] = {}
    for kind, (total, count) in last.nis.items():
        if count > 20 and chi2.sf(total, count) < _CHANCE:
            factors[kind] = total / count
        if kind not in _TESTS:
            continue
        name, families, most = _TESTS[kind]
        rests = residuals[name]
        variance = rests.sigma**2 + _moved(
            problem, 1 if name == "accel" else 0, rests.direction, float(problem.increments.t[-1]) - t
        )
        freedom = len(t) - min(most, sum(n[:3] in families for n in names))
        squares = float(np.sum(rests.value**2 / variance))
        if freedom >= _FEWEST and chi2.sf(squares, freedom) < _CHANCE:
            factors[kind] = max(factors.get(kind, 1.0), squares / freedom)
    return factors


def _moved(problem: Problem, sensor: int, up: FloatArray | None, ago: FloatArray) -> FloatArray:
    """Variance of what a rest sees of parameters that have moved since. Shape (k,)."""
    assert up is not None
    g = float(np.linalg.norm(earth.gravity_ned(float(problem.llh[0]), float(problem.llh[2]))))
    variance = np.zeros(len(ago))
    dynamics = problem.layout.dynamics()
    for (which, axis, source), (rate, density) in zip(problem.layout.table(), dynamics, strict=True):
        if which == sensor and source < 4 and density > 0.0:
            seen = up[:, axis] * (1.0 if source == 0 else g * up[:, source - 1])
            variance += seen**2 * density * (ago if rate == 0.0 else -np.expm1(-rate * ago) / rate)
    return variance


def enlarged(schedule: MeasurementSchedule, factors: dict[str, float]) -> MeasurementSchedule:
    """Measurements with their variances times the factors, by kind."""
    R = schedule.R.copy()
    for kind, name in KINDS.items():
        if name in factors:
            R[schedule.kind == kind] *= factors[name]
    return replace(schedule, R=R)
