"""Statistics of one column of a campaign's results."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.montecarlo.moments import Moments, Products
from schuler.montecarlo.sketch import QuantileSketch
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, repr=False)
class Consistency(Abridged):
    """A mean normalised square over runs against its chi-square band.

    Attributes
    ----------
    mean : ndarray
        Mean over the runs, per degree of freedom: 1 for an honest filter.
    low, high : float
        Band in which it lies with the given probability, errors normal and runs independent.
    probability : float
    """

    mean: FloatArray
    low: float
    high: float
    probability: float

    @property
    def inside(self) -> BoolArray:
        """Where the mean lies in the band."""
        return np.asarray((self.mean >= self.low) & (self.mean <= self.high))

    @property
    def share(self) -> float:
        """Share of the entries inside."""
        return float(np.mean(self.inside))


@dataclass(frozen=True, repr=False)
class ColumnStatistics(Abridged):
    """Statistics over the runs of one number or of every element of one array.

    Attributes
    ----------
    name : str
    shape : tuple of int
        Shape of what one run gives, and of every statistic.
    moments : Moments
    """

    name: str
    shape: tuple[int, ...]
    moments: Moments
    _sketch: QuantileSketch | None = field(default=None, repr=False)
    _centre: FloatArray | None = field(default=None, repr=False)
    _products: Products | None = field(default=None, repr=False)

    def _shaped(self, x: FloatArray) -> FloatArray:
        return x.reshape(self.shape)

    @property
    def n(self) -> int:
        """Number of runs."""
        return self.moments.n

    @property
    def mean(self) -> FloatArray:
        """Mean."""
        return self._shaped(self.moments.mean)

    @property
    def variance(self) -> FloatArray:
        """Variance about the mean, divided by ``n - 1``; at least two runs."""
        if self.n < 2:
            raise InputError(f"{self.name}: a spread needs two runs or more, got {self.n}")
        return self._shaped(self.moments.m2 / (self.n - 1))

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation about the mean, divided by ``n - 1``."""
        return np.sqrt(self.variance)

    @property
    def rms(self) -> FloatArray:
        """Root of the mean square: of an error, about the truth instead of about its mean."""
        return self._shaped(np.sqrt(self.moments.mean**2 + self.moments.m2 / self.n))

    @property
    def standard_error(self) -> FloatArray:
        """1-sigma of the mean."""
        error: FloatArray = self.sigma / np.sqrt(self.n)
        return error

    @property
    def minimum(self) -> FloatArray:
        """Smallest value."""
        return self._shaped(self.moments.low)

    @property
    def maximum(self) -> FloatArray:
        """Largest value."""
        return self._shaped(self.moments.high)

    @property
    def kurtosis(self) -> FloatArray:
        """``n m4 / m2^2``: 3 for normal values, 1.8 for uniform ones; 3 where all values are the same."""
        m = self.moments
        flat = m.m2 <= 0.0
        return self._shaped(np.where(flat, 3.0, m.n * m.m4 / np.where(flat, 1.0, m.m2) ** 2))

    def sigma_interval(self, probability: float = 0.95, *, normal: bool = True) -> tuple[FloatArray, FloatArray]:
        """Confidence interval of :attr:`sigma`.

        Parameters
        ----------
        probability : float
        normal : bool
            True: exact for normal values, ``(n - 1) s^2 / sigma^2`` is chi-square. False: for large n and any values
            with a fourth moment, from the standard error ``s sqrt((kurtosis - (n - 3) / (n - 1)) / (4 n))``.

        Returns
        -------
        low, high : ndarray
        """
        s = self.sigma
        if not 0.0 < probability < 1.0:
            raise InputError(f"probability: expected a number between 0 and 1, got {probability!r}")
        if normal:
            low, high = chi_square_band(self.n - 1, 1, probability)
            return s / np.sqrt(high), s / np.sqrt(low)
        from scipy.special import ndtri

        n = self.n
        # ln s is nearer to normal than s, and keeps the lower end positive
        spread = np.sqrt(np.maximum(self.kurtosis - (n - 3.0) / (n - 1.0), 0.0) / (4.0 * n))
        factor = np.exp(float(ndtri(0.5 + 0.5 * probability)) * spread)
        return s / factor, s * factor

    def quantile(self, share: float) -> FloatArray:
        """The value below which a share of the runs lies.

        The lower of the two order statistics around rank ``share (n - 1)``, with an error of at most :attr:`accuracy`
        times its distance from what the first run gave.

        Raises
        ------
        InputError
            If quantiles of this column were not kept.
        """
        if self._sketch is None or self._centre is None:
            raise InputError(f"{self.name}: quantiles were not kept; name it in Statistics(quantiles=(...))")
        return self._shaped(np.clip(self._centre + self._sketch.quantile(share), self.moments.low, self.moments.high))

    @property
    def accuracy(self) -> float | None:
        """Largest error of a quantile over its distance from what the first run gave; None if they were not kept."""
        return None if self._sketch is None else self._sketch.accuracy

    @property
    def covariance(self) -> FloatArray:
        """Covariance over the last axis, divided by ``n - 1``. Shape (..., m, m).

        Raises
        ------
        InputError
            If it was not kept.
        """
        if self._products is None:
            raise InputError(f"{self.name}: its covariance was not kept; name it in Statistics(covariance=(...))")
        if self.n < 2:
            raise InputError(f"{self.name}: a covariance needs two runs or more, got {self.n}")
        return self._products.C / (self.n - 1)

    def consistency(self, degrees: int, probability: float = 0.95) -> Consistency:
        """Mean of a normalised square, such as a NEES per degree of freedom, against its band.

        Parameters
        ----------
        degrees : int
            Degrees of freedom of one value of one run.
        probability : float
        """
        if degrees < 1:
            raise InputError(f"degrees: expected one or more, got {degrees!r}")
        return Consistency(self.mean, *chi_square_band(degrees, self.n, probability), probability)
