"""Position errors of many GNSS outages: Hayal's mean and sigmas, and what the filter claims of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.plotting.table import ResultTable, TabularResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class OutageStatistics(TabularResult):
    """Position errors of many outages by their age.

    Attributes
    ----------
    lengths : ndarray, shape (k,)
        Lengths asked for. [s]
    starts : ndarray, shape (n,)
        When GNSS was lost, from the start of the recording. [s]
    age : ndarray, shape (m,)
        Time since GNSS was lost; zero is the last aided state. [s]
    error_n : ndarray, shape (n, m, 3)
        Estimate minus reference, north, east, down. [m]
    cov_n : ndarray, shape (n, m, 3, 3)
        Covariance the filter claims. [m^2]
    name : str
        For titles.
    complete : bool
        False if interrupted: the outages that were finished.
    """

    lengths: FloatArray
    starts: FloatArray
    age: FloatArray
    error_n: FloatArray
    cov_n: FloatArray
    name: str = "outages"
    complete: bool = True

    def __len__(self) -> int:
        return len(self.starts)

    def _at(self, length: float) -> int:
        k = int(np.argmin(np.abs(self.age - length)))
        if abs(self.age[k] - length) > 1e-6:
            raise InputError(
                f"no errors {length:g} s after the loss of GNSS; there are some every {self.age[1]:g} s up to "
                f"{self.age[-1]:g} s"
            )
        return k

    def end_errors(self, length: float) -> FloatArray:
        """Errors at the end of outages of a length [s]. Shape (n, 3). [m]"""
        return self.error_n[:, self._at(length)]

    def mean(self, length: float, *, every_epoch: bool = False) -> FloatArray:
        """Mean error north, east, down, Hayal (5.1). Shape (3,). [m]"""
        value: FloatArray = self._chosen(length, every_epoch).mean(axis=0)
        return value

    def sigma(self, length: float, *, every_epoch: bool = False) -> FloatArray:
        """Standard deviation of the error about its mean, divisor n, Hayal (5.2). Shape (3,). [m]

        Parameters
        ----------
        length : float
            [s]
        every_epoch : bool
            Over all epochs of the outages instead of their last; the source does not say which it takes.
        """
        value: FloatArray = self._chosen(length, every_epoch).std(axis=0)
        return value

    def rms_horizontal(self, length: float) -> float:
        """Root mean square of the horizontal error at the end. [m]"""
        e = self.end_errors(length)
        return float(np.sqrt(np.mean(e[:, 0] ** 2 + e[:, 1] ** 2)))

    def claimed_horizontal(self, length: float) -> float:
        """The same as the filter claims it. [m]"""
        P = self.cov_n[:, self._at(length)]
        return float(np.sqrt(np.mean(P[:, 0, 0] + P[:, 1, 1])))

    def nees(self, length: float) -> float:
        """Mean normalised position error squared per degree of freedom at the end; 1 for an honest filter."""
        e, P = self.end_errors(length), self.cov_n[:, self._at(length)]
        return float(np.mean(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0])) / 3.0)

    def _chosen(self, length: float, every_epoch: bool) -> FloatArray:
        k = self._at(length)
        return self.error_n[:, 1 : k + 1].reshape(-1, 3) if every_epoch else self.error_n[:, k]

    def table(self) -> ResultTable:
        """One row a length: Hayal's mean and sigmas at the end, then over every epoch, and the claim."""
        rows = []
        for length in self.lengths:
            mean, sigma = self.mean(length), self.sigma(length)
            every = float(np.linalg.norm(self.sigma(length, every_epoch=True)))
            end = self.error_n[:, self._at(length)]
            rows.append(
                (
                    float(length), len(self), float(np.linalg.norm(mean)), *map(float, sigma),
                    float(np.linalg.norm(sigma)), every, self.rms_horizontal(length),
                    float(np.hypot(end[:, 0], end[:, 1]).max()), self.claimed_horizontal(length), self.nees(length),
                )
            )  # fmt: skip
        low, high = chi_square_band(3, max(len(self), 1))
        return ResultTable(
            f"{self.name}: position error after outages",
            (
                "outage_s", "outages", "mean_m", "sigma_north_m", "sigma_east_m", "sigma_down_m", "sigma_total_m",
                "sigma_total_every_epoch_m", "rms_horizontal_m", "max_horizontal_m", "claimed_horizontal_m", "nees",
            ),
            tuple(rows),
            (
                "mean is the length of the mean error vector; sigma_total the root of the sum of the three squares "
                "(Hayal 5.1 to 5.4)",
                f"were the {len(self)} outages independent, the NEES of an honest filter would lie in {low:.2f} to "
                f"{high:.2f} (95 %); those that share a slow bias are not",
            ),
            self.complete,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**self.table().to_dict(), "starts_s": self.starts.tolist()}

    def plot(self) -> Figure:
        """Fan of all outages with the claimed 3 sigma, see :func:`schuler.navigation.evaluation.figures.plot_fan`."""
        from schuler.navigation.evaluation.figures import plot_fan

        return plot_fan(self)
