"""Error budget at impact: parameters one at a time, all together, and as shares of the variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.table import ResultTable
from schuler.reproduce.flenniken.study.rocket.ellipse import ImpactEllipse
from schuler.reproduce.flenniken.study.rocket.errors import RocketErrors, is_random
from schuler.reproduce.flenniken.study.rocket.sensitivity import Influence

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ImpactBudget:
    """Contribution of each parameter to the position error at impact.

    Attributes
    ----------
    names : tuple of str
        Parameters that are not zero, by contribution, largest first.
    effect : ndarray, shape (n, 3)
        Error by a parameter as it is, north, up, east; zero for noise. [m]
    P : ndarray, shape (n, 3, 3)
        Covariance by it if its value is a 1-sigma. [m^2]
    ground : ndarray, shape (2, 3)
        From position errors to the point on the ground.
    variant : str
    """

    names: tuple[str, ...]
    effect: FloatArray
    P: FloatArray
    ground: FloatArray
    variant: str

    @property
    def contribution(self) -> FloatArray:
        """2-norm of the position error by each alone; of noise the root mean square. Shape (n,). [m]"""
        return np.asarray(np.sqrt(np.einsum("nii->n", self.P)))

    @property
    def shares(self) -> FloatArray:
        """Shares of the variance, which add up to one: first-order Sobol indices, as all is linear. Shape (n,)."""
        c = self.contribution**2
        return np.asarray(c / c.sum())

    @property
    def sigma(self) -> float:
        """1-sigma of the position error if all values are independent 1-sigmas. [m]"""
        return float(np.sqrt(np.sum(self.contribution**2)))

    @property
    def mean(self) -> FloatArray:
        """Position error if all constants have their value at once, north, up, east. [m]"""
        return np.asarray(self.effect.sum(axis=0))

    @property
    def together(self) -> float:
        """Root mean square of the position error with everything on as it is: the total of the source's chart. [m]"""
        noise = np.sum(
            [self.P[i] for i, name in enumerate(self.names) if is_random(name)] or [np.zeros((3, 3))], axis=0
        )
        return float(np.sqrt(self.mean @ self.mean + np.trace(noise)))

    @property
    def ellipse(self) -> ImpactEllipse:
        """Covariance ellipse of the point on the ground if all values are independent 1-sigmas."""
        return ImpactEllipse(np.zeros(2), self.ground @ self.P.sum(axis=0) @ self.ground.T)

    def table(self) -> ResultTable:
        """One row a parameter, largest first, totals last."""
        rows: list[tuple[Any, ...]] = [
            (name, *(None if is_random(name) else float(x) for x in d), float(c), float(s))
            for name, d, c, s in zip(self.names, self.effect, self.contribution, self.shares, strict=True)
        ]
        rows.append(("all on as they are", *(float(x) for x in self.mean), self.together, None))
        rows.append(("all as independent 1-sigmas", None, None, None, self.sigma, 1.0))
        columns = ("parameter", "north_m", "up_m", "east_m", "norm_m", "variance_share")
        return ResultTable(f"Position error at impact, {self.variant}", columns, tuple(rows))

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**self.table().to_dict(), "ellipse": self.ellipse.to_dict()}

    def plot(self) -> Figure:
        """Bars, largest first, with the totals (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.flenniken.study.rocket.figures import ranking_figure

        return draw(ranking_figure(self))


def impact_budget(weights: Influence, errors: RocketErrors) -> ImpactBudget:
    """One-at-a-time budget of a flight.

    Parameters
    ----------
    weights : Influence
        Influence in the flight by the way of navigating.
    errors : RocketErrors
        Values of the parameters.

    Returns
    -------
    ImpactBudget

    Raises
    ------
    InputError
        If all parameters are zero.

    References
    ----------
    Flenniken (2005), section 7.4, figure 7.4.
    """
    names = [k for k, value in errors.parameters().items() if value != 0.0 and "_tau_" not in k]
    if not names:
        raise InputError("errors: all parameters are zero; a budget needs some that are not")
    effect = [np.zeros(3) if is_random(name) else weights.effect(errors.only(name)) for name in names]
    P = [weights.covariance(errors, name) for name in names]
    order = sorted(range(len(names)), key=lambda i: -float(np.trace(P[i])))
    return ImpactBudget(
        tuple(names[i] for i in order), np.array([effect[i] for i in order]), np.array([P[i] for i in order]),
        weights.trajectory.ground, weights.variant,
    )  # fmt: skip
