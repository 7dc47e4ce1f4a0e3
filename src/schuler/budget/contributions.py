"""Error budgets: which source contributes how much, at any time of a mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import FloatArray
from schuler.budget.covariance import QUANTITIES, LinearCovariance, linear_covariance
from schuler.budget.scenario import BudgetMission
from schuler.budget.sources import Angles
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import ResultTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.sensors.spec import ImuSpec


@dataclass(frozen=True, repr=False)
class ErrorBudget(Displayed):
    """Contributions to one quantity at one time.

    Attributes
    ----------
    quantity : str
        One of :data:`.covariance.QUANTITIES`.
    time : float
        [s]
    names, groups : tuple of str
    contribution : ndarray, shape (sources,)
        1-sigma of each source alone. SI
    total : float
        1-sigma of all: root of the sum of squares.
    imu, mission : str
    """

    quantity: str
    time: float
    names: tuple[str, ...]
    groups: tuple[str, ...]
    contribution: FloatArray
    total: float
    imu: str
    mission: str

    @property
    def share(self) -> FloatArray:
        """Share of each source in the variance. Shape (sources,)."""
        return np.asarray(np.square(self.contribution) / self.total**2)

    def by_group(self) -> dict[str, float]:
        """1-sigma by group, largest first."""
        squares: dict[str, float] = {}
        for group, value in zip(self.groups, self.contribution, strict=True):
            squares[group] = squares.get(group, 0.0) + float(value) ** 2
        return {g: float(np.sqrt(v)) for g, v in sorted(squares.items(), key=lambda item: -item[1])}

    def by_source(self) -> dict[str, float]:
        """1-sigma by single source, largest first; those that contribute nothing are left out."""
        order = np.argsort(-self.contribution, kind="stable")
        return {self.names[i]: float(self.contribution[i]) for i in order if self.contribution[i] > 0.0}

    def table(self, *, single: bool = False) -> ResultTable:
        """By group, or by single source, largest first."""
        _, unit, scale = QUANTITIES[self.quantity]
        entries = (self.by_source() if single else self.by_group()).items()
        rows: list[tuple[Any, ...]] = [
            (name, value / scale, 100.0 * value**2 / self.total**2) for name, value in entries
        ]  # fmt: skip
        rows.append(("all", self.total / scale, 100.0))
        column = f"{self.quantity}_{unit.replace('/', '_')}"
        return ResultTable(
            f"{self.mission}, {self.imu}: {self.quantity} 1-sigma after {self.time:g} s",
            ("source", column, "share_percent"),
            tuple(rows),
            ("each source alone through the same filter; squares add up",),
        )

    def summary(self) -> str:
        """The table by group."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON. SI"""
        return {
            "quantity": self.quantity, "time_s": self.time, "imu": self.imu, "mission": self.mission,
            "total": self.total, "by_group": self.by_group(),
            "by_source": dict(zip(self.names, self.contribution.tolist(), strict=True)),
        }  # fmt: skip

    def plot(self, *, single: bool = False) -> Figure:
        """Bars by group, or of every parameter, with the total (matplotlib)."""
        from schuler.budget.report import budget_figure

        return budget_figure(self, single=single)


@explains_arguments
def error_budget(
    mission: BudgetMission,
    spec: ImuSpec,
    *,
    quantity: str = "horizontal",
    time: float | None = None,
    states: int | tuple[str, ...] | None = None,
    angles: Angles = "elements",
) -> ErrorBudget:
    """Contributions of all sources to a quantity, noise by axis: every parameter by itself.

    Parameters
    ----------
    mission : BudgetMission
    spec : ImuSpec
    quantity : str
    time : float, optional
        The end by default. [s]
    states, angles : optional
        See :func:`.covariance.linear_covariance`.

    References
    ----------
    Flenniken (2005), section 7.4, figure 7.4; docs/budget.md maps his 48 parameters to the names here.

    Examples
    --------
    >>> from schuler.sensors import catalogue
    >>> mission = schuler.prepare_budget("examples/budget_town.toml")
    >>> print(schuler.error_budget(mission, catalogue.spec("MTi-G-710"), time=149.0).summary())
    town, GNSS lost for a minute, MTi-G-710: horizontal 1-sigma after 149 s
    source                          horizontal_m  share_percent
    gyroscope noise                         2.94           44.8
    ...
    """
    covariance = linear_covariance(mission, spec, states=states, by_axis=True, angles=angles)
    return budget_of(covariance, quantity, time)


def budget_of(covariance: LinearCovariance, quantity: str = "horizontal", time: float | None = None) -> ErrorBudget:
    """Contributions at a record of a linear covariance, the last not after ``time``."""
    if quantity not in QUANTITIES:
        raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
    at = float(covariance.t[-1]) if time is None else time
    if not covariance.t[0] <= at <= covariance.t[-1] + 1e-6:
        raise InputError(f"time: expected {covariance.t[0]:g} to {covariance.t[-1]:g} s, got {at:g}")
    r = int(np.searchsorted(covariance.t, at + 1e-6, side="right") - 1)
    places = list(QUANTITIES[quantity][0])
    part = np.sqrt(np.sum(np.square(covariance.parts[:, r, places]), axis=1))
    total = float(covariance.quantity(quantity)[r])
    return ErrorBudget(
        quantity, float(covariance.t[r]), covariance.names, covariance.groups, part, total, covariance.imu,
        covariance.mission,
    )  # fmt: skip
