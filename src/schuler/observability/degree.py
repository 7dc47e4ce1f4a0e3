"""Degree of observability over time: how far measurements take each uncertainty below what it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.observability.ranks import spectra
from schuler.observability.system import LinearSystem
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, repr=False)
class Degree(Abridged):
    """Uncertainty of every state over time, relative to the start.

    Attributes
    ----------
    names : tuple of str
    t : ndarray, shape (r,)
        [s]
    sigma : ndarray, shape (r, n)
        1-sigma of the filter after the measurements up to then. SI
    ratio : ndarray, shape (r, n)
        To the prior: 1 has learnt nothing, above 1 the error grows faster than it is seen.
    values : ndarray, shape (r, n)
        Singular values of the observability matrix of the measurements up to then.
    """

    names: tuple[str, ...]
    t: FloatArray
    sigma: FloatArray
    ratio: FloatArray
    values: FloatArray

    @property
    def degree(self) -> FloatArray:
        """Share of the prior variance that is gone, 0 to 1. Shape (r, n)."""
        return np.asarray(np.clip(1.0 - np.square(self.ratio), 0.0, 1.0))


def degree_of_observability(system: LinearSystem, times: ArrayLike, *, noise: bool = True) -> Degree:
    """Filter covariance along a system, in units of the prior.

    Parameters
    ----------
    system : LinearSystem
    times : array_like, shape (r,)
        Increasing, within the system. [s]
    noise : bool
        With the noise that drives the states; without, what is learnt is never lost.

    Returns
    -------
    Degree

    References
    ----------
    Ham and Brown (1983), Observability, eigenvalues, and Kalman filtering: the ratio of covariances, here of single
    states.

    Notes
    -----
    Noise enters half before and half after a transition, as in the engine.
    """
    times = np.asarray(times, dtype=np.float64)
    if np.any(np.diff(times) <= 0.0) or times[0] < system.t[0] - 1e-9 or times[-1] > system.t[-1] + 1e-6:
        raise InputError(f"times: expected increasing numbers from {system.t[0]:g} to {system.t[-1]:g} s")
    record = np.searchsorted(system.t, times + 1e-6, side="right") - 1
    scale = system.sigma
    step = system.step * scale / scale[:, None]
    H = system.H * scale
    psd = system.psd / np.square(scale) if noise else np.zeros(system.n)
    P = np.eye(system.n) if system.prior is None else system.prior / np.outer(scale, scale)
    first = np.searchsorted(system.at, np.arange(len(system.t) + 1))
    sigma = np.empty((len(system.t), system.n))
    dt = np.diff(system.t, prepend=system.t[0])
    for k in range(len(system.t)):
        if k:
            half = np.diag(0.5 * dt[k] * psd)
            P = step[k] @ (P + half) @ step[k].T + half
        for rows in H[first[k] : first[k + 1]]:
            used = rows[np.any(rows != 0.0, axis=1)]
            W = used @ P
            P = P - W.T @ np.linalg.solve(W @ used.T + np.eye(len(used)), W)
        P = 0.5 * (P + P.T)
        sigma[k] = np.sqrt(np.maximum(np.diag(P), 0.0))
    values = np.array([one.values for one in spectra(system, times)])
    ratio = sigma[record]
    return Degree(system.names, times, ratio * scale, ratio, values)
