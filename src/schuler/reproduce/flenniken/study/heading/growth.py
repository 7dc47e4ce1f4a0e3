"""The bound of a heading with GNSS, beside that of free integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.flenniken.study.heading.linear import LinearModel, steady_covariance
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class HeadingBound:
    """1-sigma of heading over time, with updates and without.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    aided, free : ndarray, shape (k,)
        After each update, and with none. [rad]
    steady_prior, steady_posterior : float
        In the steady state, before and after an update. [rad]
    settled_s : float
        Last time the aided sigma is more than a twentieth off its final value. [s]
    """

    t: FloatArray
    aided: FloatArray
    free: FloatArray
    steady_prior: float
    steady_posterior: float
    settled_s: float

    def summary(self) -> str:
        """Two sentences."""
        return (
            f"steady heading: 1-sigma {self.steady_posterior / DEG:.4g} deg after an update, "
            f"{self.steady_prior / DEG:.4g} deg before, settled after {self.settled_s:.0f} s\n"
            f"free integration: {self.free[-1] / DEG:.4g} deg after {self.t[-1]:.0f} s"
        )

    def plot(self) -> Figure:
        """Both bounds over time (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.flenniken.study.heading.figures import bound_figure

        return draw(bound_figure(self))


def heading_bound(model: LinearModel, sigma_fix: float, *, duration: float = 900.0) -> HeadingBound:
    """Covariance of a heading filter with a fix each second, and of free integration with the same start.

    Parameters
    ----------
    model : LinearModel
        Heading first.
    sigma_fix : float
        1-sigma of a heading fix. [rad]
    duration : float
        [s]

    References
    ----------
    Flenniken (2005), section 4.2, figures 4.1 and 4.2; its sigma and rate of the fixes are not printed, 0.2 deg at 1 Hz
    fits the bounds it quotes.
    """
    d = model.discrete(1.0)
    R = np.array([[sigma_fix**2]])
    prior, posterior = steady_covariance(model, R, 1.0)
    count = round(duration)
    aided, free = np.empty(count), np.empty(count)
    P, F = model.P0.copy(), model.P0.copy()
    for k in range(count):
        P, F = d.Phi @ P @ d.Phi.T + d.Qd, d.Phi @ F @ d.Phi.T + d.Qd
        K = P @ model.C.T / (model.C @ P @ model.C.T + R)
        A = np.eye(len(P)) - K @ model.C
        P = A @ P @ A.T + K @ R @ K.T
        aided[k], free[k] = np.sqrt(P[0, 0]), np.sqrt(F[0, 0])
    t = np.arange(1.0, count + 1.0)
    final = float(np.sqrt(posterior[0, 0]))
    off = np.flatnonzero(np.abs(aided / final - 1.0) > 0.05)
    settled = float(t[off[-1]]) if len(off) else 0.0
    return HeadingBound(np.asarray(t, dtype=np.float64), aided, free, float(np.sqrt(prior[0, 0])), final, settled)
