"""More noise for the first passes, as long as what linearisation neglects would otherwise be many sigma.

A bias of 0.1 g that is found beside a scale factor of 2 % leaves errors of second order of 0.2 m/s^2: not much beside
the noise of a cheap unit, but hundreds of sigma of a good one. The filter would take them for news, be wrong by much
more than it believes, and the next pass would start there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.filter_pass import Pass, Problem
from schuler.filtering.measurements import FIX, GRAVITY, GRAVITY_VECTOR, ZERO_RATE, ZERO_VELOCITY
from schuler.units import G0

#: Errors of second order of a block that a pass bears, in sigma of the block. Where rests are held, the ten blocks of a
#: rest are compared with one attitude and a third is borne: with thirty one of 200 drawn MPU-6000 (0.2 g) diverged.
BEARABLE, BEARABLE_HELD = 30.0, 10.0


def softness(problem: Problem, sigma: FloatArray) -> float:
    """Factor on all noise with which a pass from parameters of these 1-sigma is nearly linear; 1 if it is anyway.

    Parameters
    ----------
    problem : Problem
    sigma : ndarray, shape (m,)
        With which the parameters start in it.

    Notes
    -----
    Attitude and direction of the specific force are wrong by an angle ``eta``: bias over gravity, scale factor and
    misalignment of the accelerometers, and what those of the gyroscopes make of a turn by a radian. Of second order is
    ``g eta^2``.
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
    bearable = BEARABLE_HELD if np.any(s.kind == ZERO_RATE) else BEARABLE
    return max(1.0, G0 * eta**2 / (bearable * block_sigma))


def softened(problem: Problem, factor: float) -> Problem:
    """The problem with ``factor`` times the noise of readings; what holds the place stays."""
    if factor == 1.0:
        return problem
    s = problem.schedule
    readings = ~np.isin(s.kind, (FIX, ZERO_VELOCITY))
    R = np.where(readings, factor**2, 1.0)[:, None, None] * s.R
    return replace(problem, schedule=replace(s, R=R), gyro_psd=factor**2 * problem.gyro_psd)


def believable_sigma(problem: Problem, last: Pass) -> FloatArray:
    """1-sigma of a pass, enlarged by what its innovations exceed chance, at most those of the prior. Shape (m,)."""
    count = sum(n for _, n in last.nis.values())
    excess = max(1.0, last.cost / count) if count else 1.0
    variance = np.minimum(excess * np.diag(last.covariance), problem.layout.initial_variances())
    return np.sqrt(variance)
