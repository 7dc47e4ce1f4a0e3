"""Errors of a navigation campaign over time: how far the runs scatter, and what the filter said of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.montecarlo.column import Consistency
from schuler.montecarlo.job import NavigationJob
from schuler.montecarlo.result import Campaign
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import Cell, ResultTable
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The nine errors: name, unit in which people read them, its size in SI.
COMPONENTS = tuple(
    (f"{what} {axis}", unit, size)
    for what, unit, size in (("attitude", "deg", DEG), ("velocity", "m/s", 1.0), ("position", "m", 1.0))
    for axis in ("north", "east", "down")
)
#: Columns whose quantiles are looked at; those of all others would only take memory.
SHOWN = ("horizontal", "rms_horizontal")
_PARTS = ("attitude", "velocity", "position")
_DEGREES = 9  # of the NEES
_TENTHS = 10


@dataclass(frozen=True, repr=False)
class Scatter(Displayed):
    """Errors of the runs of a campaign against the filter's own sigmas.

    Attributes
    ----------
    name : str
        Name of the mission.
    runs : int
        Over which the statistics are.
    t : ndarray, shape (k,)
        From the start of the recording. [s]
    mean : ndarray, shape (k, 9)
        Mean error: attitude, velocity, position, each north, east, down. [rad], [m/s], [m]
    sigma, low, high : ndarray, shape (k, 9)
        Scatter about the mean, and its 95 % interval for normal errors.
    rms : ndarray, shape (k, 9)
        Root mean square error, about the truth.
    claimed : ndarray, shape (k, 9)
        1-sigma of the filter, its mean square over the runs.
    horizontal : ndarray, shape (k, 3)
        Distance below which 50, 68 and 95 % of the runs are. [m]
    nees : Consistency
        Mean normalised square of the nine errors, per degree of freedom, against its band.
    nis : float or None
        Mean normalised innovation squared per degree of freedom.
    outages : tuple of (start, stop)
        On the time axis of ``t``. [s]
    """

    name: str
    runs: int
    t: FloatArray
    mean: FloatArray
    sigma: FloatArray
    low: FloatArray
    high: FloatArray
    rms: FloatArray
    claimed: FloatArray
    horizontal: FloatArray
    nees: Consistency
    nis: float | None
    outages: tuple[tuple[float, float], ...] = ()

    @property
    def ratio(self) -> FloatArray:
        """Root mean square error over what was claimed: 1 for an honest filter. Shape (k, 9)."""
        return np.asarray(self.rms / self.claimed)

    @property
    def verdict(self) -> str:
        """One sentence on whether the filter is as good as it says."""
        mean = float(np.mean(self.nees.mean))
        evidence = (
            f"mean NEES {mean:.3f} per degree of freedom, {100.0 * self.nees.share:.0f} % of the times inside the band "
            f"{self.nees.low:.3f} to {self.nees.high:.3f}"
        )
        if mean > self.nees.high:
            return f"The filter claims to be better than it is: {evidence}."
        if mean < self.nees.low:
            return f"The filter is better than it claims: {evidence}."
        return f"The filter is as good as it says: {evidence}."

    def at(self, t: float) -> int:
        """Index of the time looked at that is nearest to ``t``."""
        return int(np.argmin(np.abs(self.t - t)))

    def table(self, t: float | None = None) -> ResultTable:
        """Errors at one time, the last if none is given: mean, scatter with its interval, what the filter claimed."""
        k = len(self.t) - 1 if t is None else self.at(t)
        rows: list[tuple[Cell, ...]] = []
        for i, (name, unit, size) in enumerate(COMPONENTS):
            values = [x[k, i] / size for x in (self.mean, self.sigma, self.low, self.high, self.claimed)]
            rows.append((name, unit, *map(float, values), float(self.ratio[k, i])))
        return ResultTable(
            f"{self.name}, {self.runs} runs, {self.t[k]:.1f} s",
            ("error", "unit", "mean", "sigma_of_runs", "sigma_low_95", "sigma_high_95", "sigma_of_filter", "rms_ratio"),
            tuple(rows),
            (f"horizontal error: 50 % of the runs below {self.horizontal[k, 0]:.3g} m, 95 % below "
             f"{self.horizontal[k, 2]:.3g} m",),
        )  # fmt: skip

    def tenths(self) -> ResultTable:
        """Horizontal error and the ratio of what it is to what was claimed, at every tenth of the run."""
        rows: list[tuple[Cell, ...]] = []
        for j in range(1, _TENTHS + 1):
            k = self.at(float(self.t[0] + (self.t[-1] - self.t[0]) * j / _TENTHS))
            r = self.ratio[k]
            groups = [float(np.sqrt(np.mean(r[i : i + 3] ** 2))) for i in (6, 3, 0)]
            rows.append((float(self.t[k]), *map(float, self.horizontal[k, [0, 2]]), *groups, float(self.nees.mean[k])))
        return ResultTable(
            f"{self.name}: every tenth of the run",
            ("t_s", "horizontal_50_m", "horizontal_95_m", "position_ratio", "velocity_ratio", "attitude_ratio", "nees"),
            tuple(rows),
        )

    def summary(self) -> str:
        """Verdict and both tables."""
        nis = "" if self.nis is None else f" Mean NIS {self.nis:.3f} per degree of freedom."
        return "\n\n".join((self.table().summary(), self.tenths().summary(), self.verdict + nis))

    def plot(self) -> Figure:
        """Scatter of the nine errors over time with its interval, and the filter's own sigma."""
        from schuler.montecarlo.report import scatter_figure
        from schuler.plotting.drawing import draw

        return draw(scatter_figure(self))

    def report(self, path: Path | str, campaign: Campaign, job: NavigationJob) -> Path:
        """Write everything into one HTML page."""
        from schuler.montecarlo.report import montecarlo_report

        return montecarlo_report(self, campaign, job, path)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        arrays = {
            name: getattr(self, name).tolist()
            for name in ("t", "mean", "sigma", "low", "high", "rms", "claimed", "horizontal")
        }
        n = self.nees
        return {
            "name": self.name, "runs": self.runs, "components": [name for name, _, _ in COMPONENTS], **arrays,
            "nees": {"mean": n.mean.tolist(), "low": n.low, "high": n.high, "share_inside": n.share}, "nis": self.nis,
            "outages": [list(o) for o in self.outages], "verdict": self.verdict,
        }  # fmt: skip


def scatter(campaign: Campaign, job: NavigationJob) -> Scatter:
    """Errors over time of a campaign whose function was :func:`navigation_run` or :func:`lane_runs`.

    Raises
    ------
    InputError
        If it has fewer than two runs, other columns, or no quantiles of the horizontal error.
    """
    first = campaign["position"]
    if first.n < 2:
        raise InputError(f"scatter: expected two runs or more, got {first.n}")
    parts = [campaign[name] for name in _PARTS]
    bounds = [p.sigma_interval(0.95) for p in parts]
    horizontal = campaign["horizontal"]
    start, stop = job.plan.mission.ideal.t[[0, -1]]
    windows = list(job.navigation.outages.resolve(float(start), float(stop)))
    if job.simulation.gnss is not None:
        windows += [(float(a), float(b)) for a, b in job.simulation.gnss.outages_s]
    return Scatter(
        name=job.name, runs=first.n, t=job.plan.t, mean=np.concatenate([p.mean for p in parts], axis=1),
        sigma=np.concatenate([p.sigma for p in parts], axis=1), low=np.concatenate([b[0] for b in bounds], axis=1),
        high=np.concatenate([b[1] for b in bounds], axis=1), rms=np.concatenate([p.rms for p in parts], axis=1),
        claimed=np.concatenate([campaign[f"sigma_{name}"].rms for name in _PARTS], axis=1),
        horizontal=np.stack([horizontal.quantile(q) for q in (0.5, 0.68, 0.95)], axis=1),
        nees=campaign["nees"].consistency(_DEGREES),
        nis=float(campaign["nis"].mean) if "nis" in campaign.statistics else None, outages=tuple(sorted(windows)),
    )  # fmt: skip
