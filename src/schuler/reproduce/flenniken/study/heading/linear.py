"""Linear models of a few states, exactly discretised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, as_floats
from schuler.exceptions import InputError


@dataclass(frozen=True)
class LinearModel:
    """``dx/dt = A x + B u + w``, ``z = C x + v`` with white noise.

    Attributes
    ----------
    names : tuple of str
        One for each state, with its unit as suffix.
    A : ndarray, shape (n, n)
    B : ndarray, shape (n, m)
    C : ndarray, shape (p, n)
    Q : ndarray, shape (n, n)
        Power spectral density of ``w``. [unit^2/s]
    P0 : ndarray, shape (n, n)
        Covariance at the start.
    """

    names: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    C: FloatArray
    Q: FloatArray
    P0: FloatArray

    def __post_init__(self) -> None:
        n = len(self.names)
        for name, shape in (("A", (n, n)), ("B", (n, None)), ("C", (None, n)), ("Q", (n, n)), ("P0", (n, n))):
            object.__setattr__(self, name, as_floats(getattr(self, name), name, shape))

    def discrete(self, step: float) -> Discrete:
        """The model over a step with its input held, exact (Van Loan).

        Parameters
        ----------
        step : float
            [s]

        References
        ----------
        Van Loan (1978), IEEE Trans. Automatic Control 23(3), 395-404.
        """
        from scipy.linalg import expm

        if not step > 0.0:
            raise InputError(f"step: expected a positive duration, got {step!r}")
        n, m = len(self.names), self.B.shape[1]
        F = np.zeros((2 * n, 2 * n))
        F[:n, :n], F[:n, n:], F[n:, n:] = -self.A, self.Q, self.A.T
        E = expm(F * step)
        Phi = E[n:, n:].T
        Qd = Phi @ E[:n, n:]
        G = np.zeros((n + m, n + m))
        G[:n, :n], G[:n, n:] = self.A, self.B
        return Discrete(step, Phi, expm(G * step)[:n, n:], 0.5 * (Qd + Qd.T))

    def observability_rank(self) -> int:
        """Rank of ``[C; C A; C A^2; ...]``, rows scaled to unit length."""
        blocks, row = [], self.C
        for _ in self.names:
            blocks.append(row)
            row = row @ self.A
        stack = np.vstack(blocks)
        size = np.linalg.norm(stack, axis=1)
        return int(np.linalg.matrix_rank(stack[size > 0.0] / size[size > 0.0, None], tol=1e-12))


@dataclass(frozen=True)
class Discrete:
    """``x+ = Phi x + Bd u + w``, covariance ``Qd`` of w over ``step`` seconds."""

    step: float
    Phi: FloatArray
    Bd: FloatArray
    Qd: FloatArray


def steady_covariance(model: LinearModel, R: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Covariance before and after an update in the steady state, one update each ``period``. Shapes (n, n).

    Parameters
    ----------
    model : LinearModel
    R : ndarray, shape (p, p)
        Covariance of a measurement.
    period : float
        [s]

    Raises
    ------
    InputError
        If there is no steady state: a state that is driven and not observed.
    """
    from scipy.linalg import solve_discrete_are

    step = model.discrete(period)
    try:
        prior = solve_discrete_are(step.Phi.T, model.C.T, step.Qd, R)
    except np.linalg.LinAlgError as error:
        raise InputError(f"no steady state: a driven state of {', '.join(model.names)} is not observed") from error
    S = model.C @ prior @ model.C.T + R
    K = np.linalg.solve(S, model.C @ prior).T
    return prior, prior - K @ S @ K.T
