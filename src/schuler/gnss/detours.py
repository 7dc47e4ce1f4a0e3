"""Ranges by a direct path or by a detour: how likely each is, by its residual and its signal's strength."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.gnss.epoch_fits import Padded

_BIN_DBHZ = 5.0
_BINS = 13
_UNKNOWN_DBHZ = 45.0
_PRIOR_SHARE, _PRIOR_DETOUR = 0.1, 30.0  # of ranges that took a detour, and its mean length [m]
_PRIOR_COUNT = 20.0  # ranges that the prior is worth
_LEAST_SHARE, _MOST_SHARE = 0.01, 0.9
_SHORTEST, _LONGEST = 10.0, 500.0  # mean detours that can be told from noise, and that occur [m]
_EARLY = 0.1  # share of wrong ranges that are too short: detours are longer, and few things else go wrong
_ANYTHING = 1e-9  # density of errors of any size [1/m]


@dataclass(frozen=True)
class RangeNoise:
    """Distribution of ranges' residuals, k epochs of m places.

    A range is direct with normal noise, or took a detour, with an exponential distribution of the length. The share of
    detours is that of ranges of like signal strength.

    Attributes
    ----------
    usable : ndarray, shape (k, m)
        1 where there is a range, 0 where there is none.
    w, w_rate : ndarray, shape (k, m)
        Inverse of the stated 1-sigma of ranges and range rates. [1/m], [s/m]
    bin : ndarray of int, shape (k, m)
        C/N0 in steps of 5 dB.
    share : ndarray, shape (13,)
        Of ranges that took a detour, by bins.
    detour : float
        Mean length. [m]
    factor, rate_factor : float
        Of the noise of direct ranges and of range rates over the stated one, at least 1.
    """

    usable: FloatArray
    w: FloatArray
    w_rate: FloatArray
    bin: IntArray
    share: FloatArray
    detour: float = _PRIOR_DETOUR
    factor: float = 1.0
    rate_factor: float = 1.0

    @classmethod
    def stated(cls, p: Padded, cn0: FloatArray) -> RangeNoise:
        """Before anything is learned. ``cn0`` [dB-Hz] has NaN where it is unknown."""
        strength = np.nan_to_num(cn0, nan=_UNKNOWN_DBHZ) / _BIN_DBHZ
        bins = np.clip(strength, 0, _BINS - 1).astype(np.int64)
        return cls(p.usable.astype(float), p.w, p.w_rate, bins, np.full(_BINS, _PRIOR_SHARE))

    def probability_direct(self, residual: FloatArray, widened: float = 1.0) -> FloatArray:
        """Probability that each range is direct, its noise being taken ``widened`` times larger. Shape (k, m).

        Bayes' rule with the shares as prior; 0 where there is no range.
        """
        share = self.share[self.bin]
        inverse = self.w / (self.factor * widened)
        exponent = np.minimum(0.5 * (residual * inverse) ** 2, 500.0)
        direct = (1.0 - share) * inverse / np.sqrt(2.0 * np.pi) * np.exp(-exponent)
        side = np.where(residual > 0.0, 1.0 - _EARLY, _EARLY)
        late = side * np.exp(-np.minimum(np.abs(residual) / self.detour, 500.0)) / self.detour + _ANYTHING
        return np.asarray(self.usable * direct / (direct + share * late))

    def largest_direct(self) -> FloatArray:
        """Residual up to which a late range is rather direct than not, 0 where there is none. Shape (k, m). [m]"""
        share, sigma = (
            self.share[self.bin],
            np.divide(self.factor, self.w, where=self.w > 0.0, out=np.ones_like(self.w)),
        )
        odds = (1.0 - share) / share * self.detour / ((1.0 - _EARLY) * np.sqrt(2.0 * np.pi) * sigma)
        lean = sigma / self.detour
        return np.asarray(self.usable * sigma * (lean + np.sqrt(np.maximum(lean**2 + 2.0 * np.log(odds), 0.0))))

    def learned(
        self, residual: FloatArray, direct: FloatArray, rate_residual: FloatArray, rate_weight: FloatArray
    ) -> RangeNoise:
        """With shares, mean detour and noise as the residuals have them, by their present probabilities.

        Parameters
        ----------
        residual, direct : ndarray, shape (k, m)
            [m], and probabilities.
        rate_residual, rate_weight : ndarray, shape (k, m)
            [m/s], and weights.

        Notes
        -----
        The second half of a round of expectation maximisation, with conjugate priors of some ranges' worth.

        References
        ----------
        Dempster, Laird & Rubin (1977), J. Royal Statistical Society B 39, section 4.3.
        """
        late = self.usable - direct
        count = np.bincount(self.bin.ravel(), self.usable.ravel(), _BINS) + _PRIOR_COUNT
        share = (np.bincount(self.bin.ravel(), late.ravel(), _BINS) + _PRIOR_COUNT * _PRIOR_SHARE) / count
        length = np.sum(late * np.abs(residual)) + _PRIOR_COUNT * _PRIOR_DETOUR
        return replace(
            self,
            share=np.clip(share, _LEAST_SHARE, _MOST_SHARE),
            detour=float(np.clip(length / (np.sum(late) + _PRIOR_COUNT), _SHORTEST, _LONGEST)),
            factor=max(1.0, _spread(residual * self.w, direct)),
            rate_factor=max(1.0, _spread(rate_residual * self.w_rate, rate_weight)),
        )


def _spread(v: FloatArray, w: FloatArray) -> float:
    total = float(np.sum(w))
    return float(np.sqrt(np.sum(w * v**2) / total)) if total > 0.0 else 1.0
