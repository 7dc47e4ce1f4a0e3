"""Statistics of a campaign of field calibrations: what is left of every error, and is the claimed uncertainty true."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.plotting.table import Cell, ResultTable
from schuler.reproduce.yaman.study.bound import information_bound
from schuler.reproduce.yaman.study.runs import FieldJob
from schuler.reproduce.yaman.study.tables import RUNS, noise_limit, printed_unit, published

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Histogram:
    """Distribution of one parameter over the runs, before and after, as the source's figures D.1 to D.47.

    Attributes
    ----------
    name, unit : str
        Numbers are in ``unit``.
    modelled_edges, residual_edges : ndarray, shape (bins + 1,)
        [unit]
    modelled_count, residual_count : ndarray of int, shape (bins,)
        Runs in each bin; all runs are in one.
    """

    name: str
    unit: str
    modelled_edges: FloatArray
    modelled_count: IntArray
    residual_edges: FloatArray
    residual_count: IntArray


@dataclass(frozen=True, eq=False)
class FieldCampaign:
    """Many runs of one grade.

    Attributes
    ----------
    job : FieldJob
    names : tuple of str
        Parameters, see :mod:`schuler.calibration.result.parameters`.
    run : ndarray of int, shape (n,)
        Numbers of the runs that were finished, ascending: run k is child k of the seed.
    modelled, estimate : ndarray, shape (n, p)
        Errors put in, and found. SI.
    covariance : ndarray, shape (n, p, p)
        Claimed.
    prior_sigma : ndarray, shape (p,)
    passes : ndarray of int, shape (n,)
    status : tuple of str
        Status of each calibration.
    nis : dict of str to ndarray, shape (n,)
        Mean normalised innovation squared of each run, by kind of measurement; NaN where a run has none of the kind.
    failed : tuple of (int, str)
        Runs without a calibration, and why.
    seconds, cpu_seconds : float
        Time it took, and processor time of all runs together, without what processes need to start. [s]
    workers : int
    complete : bool
        False if it was interrupted.
    """

    job: FieldJob
    names: tuple[str, ...]
    run: IntArray
    modelled: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    prior_sigma: FloatArray
    passes: IntArray
    status: tuple[str, ...]
    nis: dict[str, FloatArray]
    failed: tuple[tuple[int, str], ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    workers: int = 1
    complete: bool = True
    _bound: dict[str, float] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.run)

    @property
    def residual(self) -> FloatArray:
        """Estimate minus truth. Shape (n, p). SI."""
        return np.asarray(self.estimate - self.modelled)

    @property
    def sigma(self) -> FloatArray:
        """Claimed 1-sigma. Shape (n, p). SI."""
        return np.asarray(np.sqrt(np.einsum("kii->ki", self.covariance)))

    @property
    def normalised(self) -> FloatArray:
        """Residuals over their claimed 1-sigma. Shape (n, p)."""
        return np.asarray(self.residual / self.sigma)

    @property
    def nees(self) -> FloatArray:
        """Normalised estimation error squared of each run, all parameters, per degree of freedom. Shape (n,)."""
        s = self.sigma
        correlation = self.covariance / (s[:, :, None] * s[:, None, :])
        z = self.normalised
        squared = np.einsum("ki,ki->k", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0])
        return np.asarray(squared / len(self.names))

    def nees_band(self, probability: float = 0.95) -> tuple[float, float]:
        """Band of the mean of :attr:`nees` over the runs, if the claimed covariance is true."""
        return chi_square_band(len(self.names), len(self), probability)

    def column(self, name: str) -> int:
        """Place of a parameter."""
        if name not in self.names:
            raise InputError(f"name: expected one of {', '.join(self.names)}, got {name!r}")
        return self.names.index(name)

    def mean(self, name: str) -> tuple[float, float]:
        """Mean residual of a parameter and its standard error. SI."""
        e = self.residual[:, self.column(name)]
        return float(e.mean()), float(e.std(ddof=1) / np.sqrt(len(e)))

    def scatter_ratio(self, name: str, probability: float = 0.95) -> tuple[float, float, float]:
        """Root mean square of residuals over claimed 1-sigma, and the limits between which that of the process lies.

        With ``probability`` the ratio of an endless campaign is between the limits; 1 is what should be in between.
        """
        low, high = chi_square_band(1, len(self), probability)
        ratio = float(np.sqrt(np.mean(self.normalised[:, self.column(name)] ** 2)))
        return ratio, ratio / float(np.sqrt(high)), ratio / float(np.sqrt(low))

    def complaints(self, probability: float = 0.99) -> tuple[str, ...]:
        """Contradictions to what the calibrations claim: means, scatter, NEES; failed runs.

        Parameters
        ----------
        probability : float
            That nothing is found wrong where nothing is, all tests together.

        Returns
        -------
        tuple of str
            Sentences; none if all is well.
        """
        from scipy.stats import t

        each = 1.0 - (1.0 - probability) / (2 * len(self.names) + 1)
        complaints = []
        low, high = self.nees_band(each)
        if not low < self.nees.mean() < high:
            complaints.append(f"NEES {self.nees.mean():.3f} outside of {low:.3f} to {high:.3f}")
        most = float(t.ppf(0.5 + 0.5 * each, len(self) - 1))
        for name in self.names:
            ratio, low, high = self.scatter_ratio(name, each)
            if not low < 1.0 < high:
                complaints.append(f"{name}: scatter is {ratio:.3f} times what is claimed ({low:.3f} to {high:.3f})")
            mean, error = self.mean(name)
            if abs(mean) > most * error:
                complaints.append(f"{name}: mean residual is {mean / error:.1f} standard errors from zero")
        if self.failed:
            complaints.append(f"{len(self.failed)} runs failed")
        return tuple(complaints)

    def bound(self) -> dict[str, float]:
        """1-sigma that no estimator can beat with this routine and noise, see :mod:`.field_bound`. SI."""
        if not self._bound:
            self._bound.update(
                information_bound(
                    self.job.spec, self.job.routine, self.job.place, heading_sigma=self.job.heading_sigma,
                    gravity_in_turns=self.job.options.during_turns,
                )
            )  # fmt: skip
        return self._bound

    def table(self) -> ResultTable:
        """Modelled and residual errors of every parameter, with standard errors and what was claimed."""
        rows: list[tuple[Cell, ...]] = []
        for i, name in enumerate(self.names):
            unit, factor = printed_unit(name)
            mean, error = (v / factor for v in self.mean(name))
            x, e = self.modelled[:, i] / factor, self.residual[:, i] / factor
            ratio = self.scatter_ratio(name)
            rows.append(
                (
                    name, unit, float(x.mean()), float(x.std(ddof=1)), mean, error, mean / error,
                    float(e.std(ddof=1)), float(np.median(self.sigma[:, i]) / factor), *ratio,
                )
            )  # fmt: skip
        return ResultTable(
            f"Field calibration, {self.job.spec.name}, {len(self)} runs",
            (
                "parameter", "unit", "modelled_mean", "modelled_std", "residual_mean", "standard_error",
                "mean_in_standard_errors", "residual_std", "claimed", "scatter_over_claimed", "low", "high",
            ),
            tuple(rows), self._notes(), self.complete,
        )  # fmt: skip

    def thesis(self) -> ResultTable:
        """Beside tables 5.3 and 5.4 of the source, with the reason where our scatter is above.

        Notes
        -----
        Both scatters are those of samples, 2.2 % at 1000 runs: up to two standard errors of their difference they
        count as equal. The bound is that of :meth:`bound`.
        """
        rows: list[tuple[Cell, ...]] = []
        bound = self.bound()
        for i, name in enumerate(self.names):
            unit, factor = printed_unit(name)
            source = published(self.job.spec.name, name)
            mean, error = self.mean(name)
            std = float(self.residual[:, i].std(ddof=1))
            theirs = (None, None, None) if source is None else tuple(v / factor for v in source[1:])
            rows.append(
                (
                    name, unit, theirs[0], float(self.modelled[:, i].std(ddof=1)) / factor, theirs[1], mean / factor,
                    error / factor, theirs[2], std / factor, bound[name] / factor if name in bound else None,
                    "" if source is None else self.reason(name),
                )
            )  # fmt: skip
        return ResultTable(
            f"Beside Yaman (2017), tables 5.3 and 5.4: {self.job.spec.name}, {len(self)} runs",
            (
                "parameter", "unit", "source_modelled_std", "modelled_std", "source_mean", "residual_mean",
                "standard_error", "source_std", "residual_std", "bound", "verdict",
            ),
            tuple(rows),
            (
                "means are estimate minus truth; the source's are taken for truth minus estimate and turned",
                "bound: 1-sigma that no estimator beats with this routine and two-sided noise densities",
            ),
            self.complete,
        )  # fmt: skip

    def reason(self, name: str) -> str:
        """Whether the scatter of a parameter is at or below the source's; if not, why."""
        source = published(self.job.spec.name, name)
        if source is None:
            raise InputError(f"{name}: the source has no {self.job.spec.name} with this parameter")
        std = float(self.residual[:, self.column(name)].std(ddof=1))
        if std <= source[3]:
            return "below the source"
        if std <= source[3] * (1.0 + 2.0 * np.sqrt(0.5 / len(self) + 0.5 / RUNS)):
            return "equal, within two standard errors"
        limit = noise_limit(self.job.spec, name, self.job.routine.duration)
        if limit is not None and source[3] < limit:
            return "source below the noise limit N / sqrt(T): not to be reached"
        if source[3] < self.bound().get(name, 0.0):
            return "source below the bound of this routine: not to be reached"
        return "above the source"

    def above(self) -> list[str]:
        """Parameters whose scatter is above the source's although noise and routine allow less."""
        printed = [name for name in self.names if published(self.job.spec.name, name) is not None]
        return [name for name in printed if self.reason(name) == "above the source"]

    def histogram(self, name: str, bins: int = 40) -> Histogram:
        """Distribution of a parameter over the runs before and after the calibration."""
        i = self.column(name)
        unit, factor = printed_unit(name)
        before = np.histogram(self.modelled[:, i] / factor, bins)
        after = np.histogram(self.residual[:, i] / factor, bins)
        return Histogram(name, unit, before[1], before[0], after[1], after[0])

    def plot(self, which: str = "residual", **options: Any) -> Figure:
        """Histograms, or what is left of every parameter (matplotlib), see :mod:`.report.field_campaign_figures`."""
        from schuler.reproduce.yaman.study.campaign_figures import campaign_figure

        return campaign_figure(self, which, **options)

    def summary(self) -> str:
        """Statistics, and where there is a source the comparison with it, as text."""
        tables = [self.table()]
        if any(published(self.job.spec.name, name) is not None for name in self.names):
            tables.append(self.thesis())
        return "\n\n".join(t.summary() for t in tables)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: both tables."""
        return {"statistics": self.table().to_dict(), "thesis": self.thesis().to_dict()}

    def to_csv(self, path: Path | str) -> Path:
        """Write one row a run: number, NEES, passes, status, then modelled, residual and claimed 1-sigma. SI."""
        columns = ["run", "nees", "passes", "status"]
        columns += [f"{what}_{name}" for what in ("modelled", "residual", "sigma") for name in self.names]
        nees, residual, sigma = self.nees, self.residual, self.sigma
        rows = tuple(
            (
                int(self.run[k]), float(nees[k]), int(self.passes[k]), self.status[k],
                *self.modelled[k].tolist(), *residual[k].tolist(), *sigma[k].tolist(),
            )
            for k in range(len(self))
        )  # fmt: skip
        return ResultTable("runs", tuple(columns), rows).to_csv(path)

    def _notes(self) -> tuple[str, ...]:
        low, high = self.nees_band()
        notes = [
            f"NEES per degree of freedom {float(self.nees.mean()):.4f}, 95 % band {low:.4f} to {high:.4f}",
            "NIS " + ", ".join(f"{kind} {float(np.nanmean(v)):.3f}" for kind, v in self.nis.items()),
            f"{float(self.passes.mean()):.1f} passes, {self.seconds:.0f} s with {self.workers} processes, "
            f"{self.cpu_seconds:.0f} s of processors",
        ]
        odd = [s for s in self.status if s != "ok"]
        if odd:
            notes.append(f"{len(odd)} calibrations are no plain success: {', '.join(sorted(set(odd)))}")
        if self.failed:
            notes.append(f"{len(self.failed)} runs failed; run {self.failed[0][0]}: {self.failed[0][1]}")
        return tuple(notes)
