"""What an adjustment of one triad from magnitudes returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of :func:`schuler.calibration.bench.gauss_helmert.adjust`.

    Attributes
    ----------
    values : ndarray, shape (9,)
        In the order :data:`schuler.calibration.bench.sensor_geometry.PARAMETERS`: bias [x], scale factors [-], angles
        [rad]; held ones have the value they had.
    free : ndarray of bool, shape (9,)
        Estimated.
    undetermined : ndarray of bool, shape (9,)
        Estimated in vain: some combination with this parameter changes the conditions not at all or less than noise.
    null_space : ndarray, shape (9, k)
        Those combinations, for bias over rho, s and theta; unit columns.
    normal : ndarray, shape (9, 9)
        N of the last iteration, prior included; zero for held parameters.
    cofactor : ndarray, shape (9, 9)
        Covariance with the weights as given; zero for held parameters, infinite variance for undetermined ones.
    condition : float
        Condition number of N scaled to a unit diagonal, infinite with a null space.
    corrections : ndarray, shape (n, 3)
        e, adjusted minus observed. [x]
    misclosure : ndarray, shape (n,)
        ``|v| - rho`` of the observed readings with the estimated parameters. [x]
    misclosure_sigma : ndarray, shape (n,)
        Its 1 sigma after the adjustment, with the weights as given. [x]
    redundancy : ndarray, shape (n,)
        Share of an error in one attitude that appears in its misclosure, 0 to 1; they sum up to ``freedom``.
    variance_of_unit_weight : float
        ``e' P e / freedom``, NaN without redundancy.
    freedom : int
        Conditions and prior values less parameters that were determined.
    converged : bool
    iterations : int
        Of the last stage.
    history : ndarray, shape (k, 9)
        Parameters after each iteration, all stages.
    """

    values: FloatArray
    free: BoolArray
    undetermined: BoolArray
    null_space: FloatArray
    normal: FloatArray
    cofactor: FloatArray
    condition: float
    corrections: FloatArray
    misclosure: FloatArray
    misclosure_sigma: FloatArray
    redundancy: FloatArray
    variance_of_unit_weight: float
    freedom: int
    converged: bool
    iterations: int
    history: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """1 sigma of the parameters with the weights as given. Shape (9,)."""
        return np.asarray(np.sqrt(np.diag(self.cofactor)))

    @property
    def chi_square(self) -> float:
        """``e' P e``, prior included: chi-square with ``freedom`` degrees of freedom if noise and model are right."""
        return self.variance_of_unit_weight * self.freedom if self.freedom else 0.0
