"""Where a filter starts: navigation state, parameter estimates, and the covariance of their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.mechanization.strapdown import NavState


@dataclass(frozen=True)
class InitialState:
    """Where a filter starts: navigation state, parameter estimates, and the covariance of their errors.

    Attributes
    ----------
    nav : NavState
    P : ndarray, shape (n, n)
        Covariance, navigation errors in north-east-down axes, order of the layout.
    parameters : ndarray, shape (n - 9,)
        Parameter estimates.
    """

    nav: NavState
    P: FloatArray
    parameters: FloatArray

    def __post_init__(self) -> None:
        P = as_floats(self.P, "InitialState.P")
        n = len(P)
        if P.ndim != 2 or P.shape != (n, n) or n < 9:
            raise InputError(f"InitialState.P: expected a square matrix of at least 9 states, got shape {P.shape}")
        if np.any(np.diag(P) < 0.0):
            raise InputError(f"InitialState.P: expected variances of 0 or more, got {np.diag(self.P).min():.3g}")
        sigma = np.sqrt(np.diag(P))
        if np.any(np.abs(P - P.T) > 1e-9 * np.outer(sigma, sigma)):
            raise InputError("InitialState.P: expected a symmetric matrix")
        object.__setattr__(self, "P", 0.5 * (P + P.T))
        object.__setattr__(self, "parameters", as_floats(self.parameters, "InitialState.parameters", (n - 9,)))

    @classmethod
    def from_sigmas(
        cls,
        nav: NavState,
        layout: StateLayout,
        *,
        attitude: ArrayLike,
        velocity: ArrayLike,
        position: ArrayLike,
        parameters: FloatArray | None = None,
    ) -> InitialState:
        """From 1-sigma values.

        Parameters
        ----------
        nav : NavState
        layout : StateLayout
            Its models give the initial uncertainty of the parameters.
        attitude, velocity, position : array_like, shape (3,) or (3, 3)
            1-sigma values north, east, down, or covariances. [rad], [m/s], [m]
        parameters : ndarray, shape (m,), optional
            Parameter estimates, default zero.
        """
        P = np.zeros((layout.size, layout.size))
        for i, (name, value) in enumerate((("attitude", attitude), ("velocity", velocity), ("position", position))):
            block = np.asarray(value, dtype=np.float64)
            part = slice(3 * i, 3 * i + 3)
            P[part, part] = as_floats(block, name, (3, 3)) if block.ndim == 2 else np.diag(as_vector3(value, name) ** 2)
        P[range(9, layout.size), range(9, layout.size)] = layout.initial_variances()
        return cls(nav, P, np.zeros(layout.size - 9) if parameters is None else parameters)

    def aligned(self, alignment: Alignment, layout: StateLayout) -> InitialState:
        """The same state with the covariance of an attitude and of the biases that spoiled it, correlated as they are.

        Parameters
        ----------
        alignment : Alignment
            Where the attitude of ``nav`` came from.
        layout : StateLayout
            Its bias blocks are correlated with the attitude; where it has none, the alignment's own bias sigmas count.
        """
        P = self.P.copy()
        P[:3, :] = P[:, :3] = 0.0
        P[:3, :3] = alignment.cov_noise_n
        for block, psi, sigma in (
            ("b_a", alignment.psi_accel, alignment.sigma_b_a),
            ("b_g", alignment.psi_gyro, alignment.sigma_b_g),
        ):
            part = layout[block] if block in layout else slice(0, 0)
            P_b = P[part, part] if block in layout else sigma**2 * np.eye(3)
            if sigma > 0.0:
                P[:3, :3] += psi @ P_b @ psi.T
                if block in layout:
                    P[:3, part] = psi @ P_b
                    P[part, :3] = P[:3, part].T
        return InitialState(self.nav, P, self.parameters)
