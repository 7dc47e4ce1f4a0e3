"""A filter over many runs at once: gains do not depend on the data, so they are computed once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.heading.linear import LinearModel


@dataclass(frozen=True)
class FilterRuns:
    """Estimates of all runs and their common covariance at the end of each sample.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    names : tuple of str
    estimate : ndarray, shape (k, n, runs)
        After an update where there is one.
    P, prior : ndarray, shape (k, n, n)
        Covariance after and before the update.
    """

    t: FloatArray
    names: tuple[str, ...]
    estimate: FloatArray
    P: FloatArray
    prior: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """1-sigma of every state. Shape (k, n)."""
        return np.asarray(np.sqrt(np.maximum(np.einsum("kii->ki", self.P), 0.0)))


def run_filter(
    model: LinearModel,
    increments: FloatArray,
    step: float,
    measured: FloatArray,
    R: FloatArray,
    updates: BoolArray,
    *,
    noise: FloatArray | None = None,
) -> FilterRuns:
    """Run a filter over all runs.

    Parameters
    ----------
    model : LinearModel
    increments : ndarray, shape (k, runs)
        Integral of the input over each sample.
    step : float
        [s]
    measured : ndarray, shape (k, p, runs)
        Measurements at the end of each sample, used where ``updates`` says so.
    R : ndarray, shape (p, p)
    updates : ndarray of bool, shape (k,)
        False during an outage and between fixes.
    noise : ndarray, shape (n, n), optional
        Process noise over a sample in place of the model's, for filters as printed.

    Returns
    -------
    FilterRuns

    References
    ----------
    Joseph's form of the update; Flenniken (2005), appendix C, whose gain has a sign wrong (E17).
    """
    increments = as_floats(increments, "increments", (None, None))
    count, runs = increments.shape
    if len(updates) != count or len(measured) != count:
        raise InputError(f"updates and measured: expected {count} samples, got {len(updates)}, {len(measured)}")
    d = model.discrete(step)
    Qd = d.Qd if noise is None else as_floats(noise, "noise", d.Qd.shape)
    n, C = len(model.names), model.C
    x, P = np.zeros((n, runs)), model.P0.copy()
    estimate, after, before = np.empty((count, n, runs)), np.empty((count, n, n)), np.empty((count, n, n))
    for k in range(count):
        x = d.Phi @ x + d.Bd * (increments[k] / step)
        P = d.Phi @ P @ d.Phi.T + Qd
        before[k] = P
        if updates[k]:
            K = np.linalg.solve(C @ P @ C.T + R, C @ P).T
            x = x + K @ (measured[k] - C @ x)
            A = np.eye(n) - K @ C
            P = A @ P @ A.T + K @ R @ K.T
        estimate[k], after[k] = x, P
    return FilterRuns(step * np.arange(1, count + 1), model.names, estimate, after, before)
