"""An Allan curve with its uncertainty: what every estimator returns and every fit takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class AllanCurve:
    """Deviation of one signal over averaging times, with confidence bounds at every one of them.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times, increasing. [s]
    deviation : ndarray, shape (k,)
        Allan (or modified, Hadamard, ...) deviation. [x]
    low, high : ndarray, shape (k,)
        Bounds between which the true deviation lies with probability ``confidence``: chi-square with ``edf`` degrees of
        freedom; from :func:`.allan.allan_deviation` with fewer than 20 of them the estimate's own distribution. [x]
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom of the variance estimate.
    count : ndarray of int, shape (k,)
        How many squared differences it is the mean of; they overlap, so there are fewer degrees of freedom.
    alpha : ndarray, shape (k,)
        Exponent of the power law ``S(f) ~ f**alpha`` of the rate-like signal taken for ``edf`` around tau: 2
        quantisation, 0 white, -1 flicker, -2 random walk, -3 and -4 steeper.
    kind : str
        ``overlapping``, ``non-overlapping``, ``modified``, ``hadamard``, ``overlapping hadamard``, ``total`` or
        ``time``.
    confidence : float
        Of the bounds, such as 0.95.
    rate_hz : float
        Sampling rate. [Hz]
    samples : int
        Length of the signal, missing ones included.
    missing : int
        Missing samples (NaN or gaps).
    """

    tau: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    edf: FloatArray
    count: IntArray
    alpha: FloatArray
    kind: str
    confidence: float
    rate_hz: float
    samples: int
    missing: int = 0

    def __len__(self) -> int:
        return len(self.tau)

    @property
    def variance(self) -> FloatArray:
        """Square of the deviation. [x^2]"""
        squared: FloatArray = np.square(self.deviation)
        return squared

    @property
    def relative_sigma(self) -> FloatArray:
        """1-sigma uncertainty of the variance relative to it, ``sqrt(2 / edf)``."""
        relative: FloatArray = np.sqrt(2.0 / self.edf)
        return relative
