"""Where a filter starts: navigation state, parameter estimates, and the covariance of their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import earth
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.error_model import parameter_columns
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.mechanization.strapdown import NavState
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, repr=False)
class InitialState(Abridged):
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
        """The same state with the covariance of an attitude and of the errors that spoiled it, correlated as they are.

        Parameters
        ----------
        alignment : Alignment
            Source of the attitude of ``nav``; its own bias sigmas count only where the layout has no bias.
        layout : StateLayout
            Its sensor blocks are correlated with the attitude.

        Notes
        -----
        At rest scale factors, cross-coupling and g-sensitivity act as biases do. Were the attitude independent of them,
        the first velocities, which agree with it, would be taken for a measurement of cross-coupling: of 1.15 deg the
        filter would claim 0.2 after ten seconds.

        Where cross-couplings of both triads are states, the size of the force at rest is a measurement of the errors
        along gravity, see :func:`measured_along_gravity`. Learnt later, beside a tilt of degrees, the product of both
        would be taken for a turn of the axes.
        """
        C, llh = alignment.C_nb, self.nav.llh
        f_b, omega_b = -C.T @ earth.gravity_ned(llh[0], llh[2]), C.T @ earth.earth_rate_ned(llh[0])
        columns = parameter_columns(layout, np.eye(3), omega_b, f_b, self.parameters)
        g, psi_accel, force = float(np.linalg.norm(f_b)), alignment.psi_accel, None
        if {"b_a", "M_a6", "M_g"} <= layout.models.keys():
            force = alignment.force
        if force is not None:
            psi_accel = psi_accel * force / g  # less the error along it, the force is as large as gravity
        A = -(alignment.psi_gyro @ columns[0] + psi_accel @ columns[1])
        P = self.P.copy()
        P[:3, :] = P[:, :3] = 0.0
        P[:3, :3] = alignment.cov_noise_n + A @ P[9:, 9:] @ A.T
        P[:3, 9:] = A @ P[9:, 9:]
        P[9:, :3] = P[:3, 9:].T
        for block, psi, sigma in (
            ("b_a", alignment.psi_accel, alignment.sigma_b_a),
            ("b_g", alignment.psi_gyro, alignment.sigma_b_g),
        ):
            if block not in layout:
                P[:3, :3] += sigma**2 * psi @ psi.T
        start = InitialState(self.nav, P, self.parameters)
        if force is None:
            return start
        noise = g * float(np.sqrt(0.5 * np.trace(alignment.cov_noise_n[:2, :2])))
        return measured_along_gravity(start, force - g, noise, np.concatenate((np.zeros(9), f_b @ columns[1] / g)), g)


def measured_along_gravity(
    start: InitialState, excess: float, sigma: float, H: FloatArray, gravity: float
) -> InitialState:
    """Levelled start with the errors of the accelerometers along gravity that the size of the force at rest tells.

    Parameters
    ----------
    start : InitialState
        Its tilt correlated with the errors that made it.
    excess : float
        Size of the specific force with the estimates of the start, less gravity. [m/s^2]
    sigma : float
        1-sigma of that size without errors of the sensors. [m/s^2]
    H : ndarray, shape (n,)
        Error of the size by errors of the states, along the levelled force.
    gravity : float
        [m/s^2]

    Notes
    -----
    The levelled force is ``|f| d``, true gravity upwards ``g u``, off it by the tilt ``tau``: the error along d is
    ``|f| - g cos(tau)``, the excess and ``g tau^2 / 2``. Of that term mean and variance count (a second-order filter:
    Bar-Shalom, Li, Kirubarajan (2001), section 10.3.2): with a tilt of 1-sigma ``s`` about either axis ``g s^2``, and
    the square of that.
    """
    second = 0.5 * gravity * float(np.trace(start.P[:2, :2]))
    PH = start.P @ H
    S = float(H @ PH) + sigma**2 + second**2
    P = start.P - np.outer(PH, PH) / S
    return InitialState(start.nav, P, start.parameters - PH[9:] * (excess + second) / S)


def with_states(start: InitialState, of: StateLayout, layout: StateLayout) -> InitialState:
    """A start in a layout with further states, which begin at zero with the uncertainties of their models.

    Parameters
    ----------
    start : InitialState
    of : StateLayout
        Its own layout, whose blocks the other one has too.
    layout : StateLayout
    """
    P = np.diag(np.append(np.zeros(9), layout.initial_variances()))
    estimates = np.zeros(layout.size - 9)
    at = np.array([i for name in of.blocks for i in range(layout[name].start, layout[name].stop)], dtype=np.int64)
    P[np.ix_(at, at)] = start.P
    estimates[at[9:] - 9] = start.parameters
    return InitialState(start.nav, P, estimates)
