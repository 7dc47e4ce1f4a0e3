"""How a calibration came about: estimates and uncertainties over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.filter_pass import Pass, Problem, with_prior
from schuler.exceptions import InputError
from schuler.filtering.engine import unpack_symmetric


@dataclass(frozen=True)
class FieldHistory:
    """Parameters over the time of the log.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    names : tuple of str
        See :mod:`schuler.calibration.result.parameters`.
    values, sigma : ndarray, shape (k, p)
        Estimate and 1-sigma after each time, linearised at the final result. SI.
    prior_sigma : ndarray, shape (p,)
        1-sigma before the log.
    """

    t: FloatArray
    names: tuple[str, ...]
    values: FloatArray
    sigma: FloatArray
    prior_sigma: FloatArray

    @property
    def normalised(self) -> FloatArray:
        """Square root of the variance over that before the log. Shape (k, p)."""
        return np.asarray(self.sigma / self.prior_sigma)

    def reached(self, share: float = 0.1) -> dict[str, float]:
        """Time from which the uncertainty stays below a share of that before the log, by name; inf if never. [s]"""
        if not share > 0.0:
            raise InputError(f"share: expected a positive number, got {share!r}")
        above = self.normalised >= share
        found = {}
        for i, name in enumerate(self.names):
            last = np.flatnonzero(above[:, i])
            if not len(last):
                found[name] = float(self.t[0])
            elif last[-1] + 1 < len(self.t):
                found[name] = float(self.t[last[-1] + 1])
            else:
                found[name] = float("inf")
        return found


def history_of(problem: Problem, last: Pass, names: tuple[str, ...]) -> FieldHistory:
    """Estimates and uncertainties at the records of a pass, its prior included at each."""
    forward = last.run
    P = unpack_symmetric(forward.rec_P, problem.layout.size)[:, 9:, 9:]
    values, sigma = forward.rec_est.copy(), np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    if last.variance is not None:
        for k in range(len(values)):
            values[k], C = with_prior(problem, last.start, last.variance, forward.rec_est[k], P[k])
            sigma[k] = np.sqrt(np.maximum(np.diag(C), 0.0))
    return FieldHistory(forward.rec_t, names, values, sigma, np.sqrt(problem.layout.initial_variances()))
