"""Recommended rate of rotation: the slowest beyond which there is next to nothing to gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.table import ResultTable
from schuler.reproduce.du.study.metrics import index, mean_interval
from schuler.reproduce.du.study.tables import RECOMMENDED_DEG_S
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.reproduce.du.study.static import StaticTest

_RESAMPLES = 2000


@dataclass(frozen=True, eq=False)
class RateChoice:
    """A recommended rate.

    Attributes
    ----------
    imu : str
    rate : float
        The slowest tested rate whose mean error is at most ``tolerance`` above that of all faster rates. [rad/s]
    tolerance : float
    quantity : str
        Whose means are compared.
    rates : ndarray, shape (m,)
        [rad/s]
    means, low, high : ndarray, shape (m,)
        Means over runs and their 95 % intervals, SI.
    confidence : float
        Share of resampled campaigns (runs drawn with replacement) that choose the same rate.
    """

    imu: str
    rate: float
    tolerance: float
    quantity: str
    rates: FloatArray
    means: FloatArray
    low: FloatArray
    high: FloatArray
    confidence: float

    def table(self) -> ResultTable:
        """Means by rate, also relative to the mean of all faster rates."""
        order = np.argsort(np.abs(self.rates))
        rows: list[tuple[Any, ...]] = []
        for n, k in enumerate(order):
            faster = order[n + 1 :]
            over = float(self.means[k] / self.means[faster].mean()) if len(faster) else None
            rows.append(
                (round(float(self.rates[k]) / DEG, 6), float(self.means[k]), float(self.low[k]), float(self.high[k]),
                 over, bool(abs(self.rates[k] - self.rate) < 1e-9))
            )  # fmt: skip
        return ResultTable(
            f"{self.imu}: {self.quantity.replace('_', ' ')} by rate",
            ("rate_deg_s", "mean_m" if "position" in self.quantity else "mean_m_s", "low_95", "high_95", "over_faster",
             "chosen"),
            tuple(rows),
            (self.text,),
        )  # fmt: skip

    @property
    def text(self) -> str:
        """The rule and what it chose, one sentence."""
        thesis = RECOMMENDED_DEG_S.get(self.imu)
        return (
            f"{self.rate / DEG:g} deg/s: the slowest rate whose mean is at most {100 * self.tolerance:.0f} % above "
            f"that of all faster ones ({100 * self.confidence:.0f} % of resampled campaigns agree)"
            + ("" if thesis is None else f"; the thesis recommends {thesis:g}")
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()


def recommended_rate(
    test: StaticTest, *, tolerance: float = 0.1, quantity: str = "horizontal_position", strategy: str = "II"
) -> RateChoice:
    """Choose a rate from a sweep: the slowest that is nearly as good as all faster ones together.

    Parameters
    ----------
    test : StaticTest
        Test at several rates.
    tolerance : float
        How much worse than the faster ones is still as good; 10 % because a slow platform is quieter, wears less and
        asks less of the knowledge of the lever arm (its acceleration grows with the square of the rate).
    quantity, strategy : str

    Returns
    -------
    RateChoice

    Raises
    ------
    InputError
        If the tolerance is negative.

    References
    ----------
    Du (2015), section 4.1.2.5 recommends by eye: 20 deg/s for NAV440, 10 for MTi-G.
    """
    if not tolerance >= 0.0:
        raise InputError(f"tolerance: expected a share of zero or more, got {tolerance!r}")
    if strategy not in test.rotary:
        raise InputError(f"strategy: expected 'I' or 'II', got {strategy!r}")
    values = test.rotary[strategy][:, :, index(quantity)]
    order = np.argsort(np.abs(test.rates))

    def chosen(means: FloatArray) -> int:
        # against the mean of the faster ones, not the smallest of many, which is small by luck
        for n, k in enumerate(order[:-1]):
            if means[k] <= (1.0 + tolerance) * means[order[n + 1 :]].mean():
                return int(k)
        return int(order[-1])

    pick = chosen(values.mean(axis=1))
    rng = np.random.default_rng(test.seed)
    runs = values.shape[1]
    agree = sum(
        chosen(values[:, rng.integers(runs, size=runs)].mean(axis=1)) == pick for _ in range(_RESAMPLES)
    )  # fmt: skip
    intervals = np.array([mean_interval(v) for v in values])
    return RateChoice(
        test.imu.name, float(test.rates[pick]), tolerance, quantity, test.rates, intervals[:, 0], intervals[:, 1],
        intervals[:, 2], agree / _RESAMPLES,
    )  # fmt: skip
