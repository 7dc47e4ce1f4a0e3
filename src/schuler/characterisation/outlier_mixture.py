"""Normal mixture for deviations from a level: noise, and outliers of which some hide in it.

A limit leaves outliers below it in the noise, which makes it too large by an amount that no limit tells. The noise is
normal, so what its middle is made of says how much of each distance is noise: expectation maximisation fits noise and
three normal parts for outliers (to either side and wide) to a histogram.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray

_LEAST = 3.0  # noise sigmas that outliers of one part are off (rms): smaller ones would be the noise's own tails
_ROUNDS = 300  # of expectation maximisation; a quarter of them moves the noise by 0.1 % at most
_ROUNDS_LESS = 50  # from the mixture of the complete log to that without one of its blocks
_BLOCKS = 10  # of the jackknife
_INNER = 6.0  # sigmas up to which bins are a tenth wide
_OUTER_BINS = 80


@dataclass(frozen=True)
class OutlierMixture:
    """Normal mixture; its first part is the noise.

    Attributes
    ----------
    share : ndarray, shape (4,)
        Sum is one.
    mean, sigma : ndarray, shape (4,)
        In units of the deviations.
    scatter : float
        1-sigma uncertainty of the logarithm of the noise's sigma, by a jackknife over blocks of the log.
    """

    share: FloatArray
    mean: FloatArray
    sigma: FloatArray
    scatter: float = 0.0

    def densities(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Densities of noise and of outliers at deviations z, shape (n,) each, relative to one another."""
        good, bad = np.zeros((2, len(z)))
        for k, (share, mean, sigma) in enumerate(zip(self.share, self.mean, self.sigma, strict=True)):
            density = np.exp(-0.5 * np.square((z - mean) / sigma)) / sigma
            if k == 0:
                good += density
            else:
                bad += share / max(1.0 - self.share[0], 1e-300) * density
        return good, np.maximum(bad, 1e-300)


def outlier_mixture(z: FloatArray, limit: float) -> OutlierMixture:
    """Fit noise and outliers to deviations from the level.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Deviations in units of a robust spread, in order of time.
    limit : float
        Beyond it are surely outliers, to start from; there must be some.

    Returns
    -------
    OutlierMixture

    References
    ----------
    McLachlan and Peel (2000), Finite Mixture Models, sections 2.8 (EM) and 2.16 (standard errors by resampling).
    """
    reach = max(1.01 * float(np.abs(z).max()), _INNER + 1.0)
    outer = np.geomspace(_INNER, reach, _OUTER_BINS)[1:]
    edges = np.concatenate((-outer[::-1], np.linspace(-_INNER, _INNER, 121), outer))
    blocks = np.array([np.histogram(part, edges)[0] for part in np.array_split(z, _BLOCKS)], dtype=np.float64)
    counts = blocks.sum(axis=0)
    complete = _maximised(counts, edges, _start(z, limit), _ROUNDS)
    less = [np.log(_maximised(counts - block, edges, complete, _ROUNDS_LESS).sigma[0]) for block in blocks]
    scatter = float(np.sqrt((_BLOCKS - 1) * np.var(less)))
    return OutlierMixture(complete.share, complete.mean, complete.sigma, scatter)


def _start(z: FloatArray, limit: float) -> OutlierMixture:
    far = z[np.abs(z) > limit]
    share, size = len(far) / len(z), float(np.median(np.abs(far)))
    above = float(far[far > 0.0].mean()) if np.any(far > 0.0) else size
    below = float(far[far < 0.0].mean()) if np.any(far < 0.0) else -size
    return OutlierMixture(
        np.array([1.0 - share, share / 3.0, share / 3.0, share / 3.0]),
        np.array([0.0, above, below, 0.0]),
        np.array([1.0, max(1.0, size / 3.0), max(1.0, size / 3.0), size]),
    )


def _maximised(counts: FloatArray, edges: FloatArray, start: OutlierMixture, rounds: int) -> OutlierMixture:
    """Expectation maximisation from ``start`` on."""
    share, mean, sigma = start.share, start.mean, start.sigma
    middle = 0.5 * (edges[1:] + edges[:-1])[:, None]
    for _ in range(rounds):
        part = share * _probability(edges, mean, sigma)
        part *= (counts / part.sum(axis=1))[:, None]
        number = np.maximum(part.sum(axis=0), 1e-9)
        share = number / number.sum()
        mean = np.sum(part * middle, axis=0) / number
        sigma = np.sqrt(np.sum(part * (middle - mean) ** 2, axis=0) / number)
        # an outlier has its noise besides
        sigma = np.maximum(sigma, sigma[0])
        moved = np.maximum(1.0, _LEAST * sigma[0] / np.hypot(mean, sigma))
        moved[0] = 1.0
        mean, sigma = mean * moved, sigma * moved
    return OutlierMixture(share, mean, sigma)


def _probability(edges: FloatArray, mean: FloatArray, sigma: FloatArray) -> FloatArray:
    """Probability of every bin, shape (b, k), from the tail that keeps its digits."""
    from scipy.special import ndtr

    z = (edges[:, None] - mean) / sigma
    below, above = np.diff(ndtr(z), axis=0), -np.diff(ndtr(-z), axis=0)
    return np.asarray(np.maximum(np.where(z[:-1] > 0.0, above, below), 1e-300))
