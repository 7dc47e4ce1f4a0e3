"""Warm start after a pause: what a run knew before it, grown by the models of its states."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState

LONGEST_S = 3600.0  # of a pause after which the parameters still are what their models say [s]
_TELLS, _SMALLEST = 0.99, 1e-12  # variance over that of the prior: below it counts, and is this at least
_VELOCITY = 0.01  # 1-sigma of a vehicle that stands [m/s]
_STANDS = 0.1  # speed up to which, and three sigmas, a state may be of one that stands [m/s]


class Kept(NamedTuple):
    """Parameters and their covariance at the end of a run, and its time."""

    t: float  # [s]
    parameters: FloatArray  # (m,)
    P: FloatArray  # (m, m)


def grown(kept: Kept, layout: StateLayout, t: float) -> Kept:
    """Parameters at a later time by their Gauss-Markov models, random walks and constants.

    Parameters
    ----------
    kept : Kept
    layout : StateLayout
        Its first parameters are those kept, without a receiver's clock.
    t : float
        [s]
    """
    beta, noise = layout.dynamics()[: len(kept.parameters)].T
    D, T = np.exp(-beta * (t - kept.t)), t - kept.t
    # integral of the driving noise through the decay: q (1 - D^2) / (2 beta), and q T without decay
    Q = noise * np.where(beta > 0.0, -np.expm1(-2.0 * beta * T) / np.where(beta > 0.0, 2.0 * beta, 1.0), T)
    return Kept(t, D * kept.parameters, D[:, None] * kept.P * D + np.diag(Q))


def informed(initial: InitialState, kept: Kept, prior: Kept) -> InitialState:
    """A start with what is kept of the run before, as a measurement of its parameters.

    Parameters
    ----------
    initial : InitialState
        Start by an alignment that knows the prior only.
    kept : Kept
        At the time of the start.
    prior : Kept
        What every start knows of the same parameters, and what therefore is in both.

    Notes
    -----
    In axes in which the prior has mean zero and covariance one, and the kept covariance is diagonal s, the kept values
    y are those of a measurement y / (1 - s) of variance s / (1 - s). Where s is near one or above, nothing is left.
    """
    at = np.flatnonzero(np.diag(prior.P) > 0.0)
    L = np.linalg.cholesky(prior.P[np.ix_(at, at)])
    s, V = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, kept.P[np.ix_(at, at)]).T))
    use = s < _TELLS
    s, V = np.maximum(s[use], _SMALLEST), V[:, use]
    rows = np.linalg.solve(L.T, V).T  # of a measurement, V' L^-1
    y, R = rows @ (kept.parameters - prior.parameters)[at], s / (1.0 - s)
    H = np.zeros((len(s), len(initial.P)))
    H[:, 9 + at] = rows
    S = H @ initial.P @ H.T + np.diag(R)
    K = np.linalg.solve(S, H @ initial.P).T
    dx = K @ (y / (1.0 - s) - rows @ (initial.parameters[: len(prior.parameters)] - prior.parameters)[at])
    A = np.eye(len(initial.P)) - K @ H
    P = A @ initial.P @ A.T + (K * R) @ K.T
    nav = initial.nav
    attitude, velocity, position = (ecef_from_ned_states(nav.llh, 9) @ dx[:9]).reshape(3, 3)
    corrected = NavState(
        nav.t, nav.r_eb_e + position, nav.v_eb_e + velocity,
        rotation.quat_multiply(rotation.quat_from_rotvec(attitude), nav.q_eb),
    )  # fmt: skip
    return InitialState(corrected, 0.5 * (P + P.T), initial.parameters + dx[9:])


def stands(nav: NavState, P: FloatArray) -> bool:
    """Whether a state may be of a vehicle that stands: as fast as its velocity is uncertain; P in north-east-down."""
    return float(np.linalg.norm(nav.v_eb_e)) <= _STANDS + 3.0 * float(np.sqrt(np.trace(P[3:6, 3:6])))


def stood(nav: NavState, P: FloatArray, parameters: FloatArray, layout: StateLayout, t: float) -> InitialState:
    """State of a vehicle that has stood since, at a later time: place and attitude as they were, parameters grown.

    Parameters
    ----------
    nav : NavState
    P : ndarray, shape (n, n)
        Navigation errors in north-east-down axes.
    parameters : ndarray, shape (m,)
    layout : StateLayout
    t : float
        [s]
    """
    later = grown(Kept(nav.t, parameters, P[9:, 9:]), layout, t)
    D = np.exp(-layout.dynamics()[:, 0] * (t - nav.t))
    P = P.copy()
    P[:9, 9:] *= D
    P[9:, :9] = P[:9, 9:].T
    P[9:, 9:] = later.P
    P[3:6, :] = P[:, 3:6] = 0.0
    P[3:6, 3:6] = _VELOCITY**2 * np.eye(3)
    return InitialState(replace(nav, t=t, v_eb_e=np.zeros(3)), P, later.parameters)
