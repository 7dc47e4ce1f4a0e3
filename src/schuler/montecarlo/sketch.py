"""Quantiles without the values: counts in buckets of equal ratio, for many quantities at once."""

from __future__ import annotations

import math

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError

_HALF = 1 << 25  # more than there are buckets for doubles on one side, at the finest accuracy allowed
_TINY = 1e-300  # below this a value counts as zero
_WAIT = 1 << 20  # entries that are collected before they are put in order


class QuantileSketch:
    """Counts of values in buckets of equal ratio.

    A value that is asked for comes back with a relative error of at most ``accuracy``: the bucket of ``x`` is
    ``ceil(log_g |x|)`` with ``g = (1 + accuracy) / (1 - accuracy)``, and its representative ``2 g^i / (g + 1)`` is
    that close to both its ends. Counts are whole numbers, so adding up parts in any order gives the same sketch. Memory
    grows with the number of buckets that occur (the range of the values), not with the number of values.

    Parameters
    ----------
    elements : int
        Number of quantities.
    accuracy : float
        Relative, from 0.0001 to 0.1.

    References
    ----------
    Masson, Rim, Lee (2019), "DDSketch", Proc. VLDB 12:2195.
    """

    def __init__(self, elements: int, accuracy: float = 0.005) -> None:
        if not 1e-4 <= accuracy <= 0.1:
            raise InputError(f"accuracy: expected a relative error from 0.0001 to 0.1, got {accuracy!r}")
        self.elements, self.accuracy = elements, accuracy
        self._g = (1.0 + accuracy) / (1.0 - accuracy)
        self._keys: IntArray = np.zeros(0, dtype=np.int64)
        self._counts: IntArray = np.zeros(0, dtype=np.int64)
        self._new: list[IntArray] = []
        self._waiting = 0

    def add(self, x: FloatArray) -> None:
        """Add values. Shape (n, elements), finite."""
        size = np.abs(x)
        nonzero = size > _TINY
        bucket = np.zeros(x.shape, dtype=np.int64)
        index = np.ceil(np.log(size[nonzero]) / math.log(self._g)).astype(np.int64) + (_HALF >> 1)
        bucket[nonzero] = np.where(x[nonzero] > 0.0, index, -index)
        self._new.append((bucket + _HALF + 2 * _HALF * np.arange(self.elements)).ravel())
        self._waiting += x.size
        if self._waiting > max(_WAIT, len(self._keys)):
            self._settle()

    def quantile(self, share: float) -> FloatArray:
        """The value below which a share lies: the lower of the two order statistics around rank ``share (n - 1)``.

        Parameters
        ----------
        share : float
            From 0 to 1.

        Returns
        -------
        ndarray, shape (elements,)
            Within ``accuracy`` of that order statistic, relatively.
        """
        if not 0.0 <= share <= 1.0:
            raise InputError(f"quantile: expected a share from 0 to 1, got {share!r}")
        self._settle()
        first = np.searchsorted(self._keys, 2 * _HALF * np.arange(self.elements + 1))
        below = np.concatenate(([0], np.cumsum(self._counts)))
        number = below[first[1:]] - below[first[:-1]]
        if not np.all(number):
            raise InputError("quantile: there are no values yet")
        # a hair up, for shares such as 0.7 whose rank would come out as 6.999...
        rank = np.floor(share * (number - 1) + 1e-9).astype(np.int64)
        k = np.searchsorted(below, below[first[:-1]] + rank, side="right") - 1
        bucket = self._keys[k] % (2 * _HALF) - _HALF
        index = np.abs(bucket) - (_HALF >> 1)
        value: FloatArray = np.sign(bucket) * (2.0 / (self._g + 1.0)) * self._g ** np.where(bucket == 0, 0, index)
        return value

    def _settle(self) -> None:
        if not self._new:
            return
        buckets, counts = np.unique(np.concatenate(self._new), return_counts=True)
        keys = np.concatenate((self._keys, buckets))
        self._keys, inverse = np.unique(keys, return_inverse=True)
        total = np.zeros(len(self._keys), dtype=np.int64)
        np.add.at(total, inverse, np.concatenate((self._counts, counts)))
        self._counts, self._new, self._waiting = total, [], 0
