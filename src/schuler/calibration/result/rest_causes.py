"""Causes of a bias that changes from rest to rest: specific force, temperature and drift, each of them tried."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from schuler.arrays import FloatArray
from schuler.calibration.result.rest_scatter import RestScatter

#: Probability of explaining so much by chance, below which a cause counts as seen.
CHANCE = 1e-3
#: Factor by which chi-square over degrees of freedom has to fall for a cause to be decisive.
DECISIVE = 1.5


@dataclass(frozen=True)
class RestCause:
    """One quantity that the readings at rest follow.

    Attributes
    ----------
    name : {"g-sensitivity", "temperature", "drift"}
    probability : float
        Of explaining as much by chance.
    before, after : float
        Chi-square by white noise over degrees of freedom without and with it.
    """

    name: str
    probability: float
    before: float
    after: float

    @property
    def decisive(self) -> bool:
        """Whether it is seen beyond chance and explains a good part of the scatter."""
        return self.probability < CHANCE and self.before > DECISIVE * self.after

    @property
    def sentence(self) -> str:
        """What is seen, in words."""
        what = {"g-sensitivity": "which way is up", "temperature": "temperature", "drift": "time"}[self.name]
        return (
            f"readings at rest follow {what} ({self.name}): chi-square over degrees of freedom falls from "
            f"{self.before:.2g} to {self.after:.2g}"
        )


def rest_causes(
    t: FloatArray,
    means: FloatArray,
    white: FloatArray,
    scatter: RestScatter,
    *,
    f: FloatArray | None = None,
    temperature: FloatArray | None = None,
) -> list[RestCause]:
    """Try what could make readings differ between rests.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    means, white : ndarray, shape (n, 3)
        Readings and their 1 sigma by white noise. [x]
    scatter : RestScatter
        Fit of a constant.
    f : ndarray, shape (n, 3), optional
        Specific force, for gyroscopes. [m/s^2]
    temperature : ndarray, shape (n,), optional
        [degC]

    Returns
    -------
    list of RestCause
        The likeliest first: by what is left of the scatter. Drift and temperature are tried against a scatter without
        memory, specific force against the scatter that was fitted, so that a drift is not taken for it.
    """
    from scipy.special import fdtrc

    tries: list[tuple[str, FloatArray]] = []
    if f is not None:
        tries.append(("g-sensitivity", f))
    if temperature is not None and np.ptp(temperature) > 0.5:
        tries.append(("temperature", (temperature - temperature.mean())[:, None]))
    tries.append(("drift", (t - t.mean())[:, None]))
    out, n = [], len(t)
    for name, columns in tries:
        q = columns.shape[1]
        freedom = n - 1 - q
        if freedom < 3 or scatter.freedom < 1:
            continue
        A0, A1 = np.ones((n, 1)), np.column_stack((np.ones(n), columns / max(float(np.abs(columns).max()), 1e-300)))
        gained = left = white_left = 0.0
        for i in range(3):
            V = scatter.rests[i]
            L = np.linalg.cholesky(V if name == "g-sensitivity" else np.diag(np.diag(V)))
            y = np.linalg.solve(L, means[:, i])
            rss = [_left(np.linalg.solve(L, A), y) for A in (A0, A1)]
            gained, left = gained + rss[0] - rss[1], left + rss[1]
            white_left += _left(A1 / white[:, i, None], means[:, i] / white[:, i])
        if left <= 0.0:
            continue
        ratio = (gained / (3 * q)) / (left / (3 * freedom))
        p = float(fdtrc(3 * q, 3 * freedom, max(ratio, 0.0)))
        out.append(RestCause(name, p, scatter.reduced, white_left / (3 * freedom)))
    return sorted(out, key=lambda cause: (not cause.decisive, cause.after))


def _left(A: npt.NDArray[Any], y: npt.NDArray[Any]) -> float:
    r = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    return float(r @ r)
