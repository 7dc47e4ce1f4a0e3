"""Mean squares of differences of a signal, with or without gaps: the estimators themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.characterisation.confidence import KINDS, differences
from schuler.exceptions import InputError

#: Share of the samples of a cluster that must be there.
LEAST_PRESENT = 0.8
_CHUNK = 32  # blocks between two signs of progress


@dataclass(frozen=True)
class Signal:
    """A signal as its running sum.

    Attributes
    ----------
    X : ndarray, shape (n + 1,)
        Running sum of the samples less their mean, missing ones as zero; or the integral as it came, since its
        differences are exact and any arithmetic before them is not; missing values NaN.
    present : ndarray, shape (n + 1,), or None
        Running number of samples that are there; None without gaps and for an integral.
    missing : int
    unit : float
        What a difference of ``X`` over one sample is divided by to be in the unit of the signal: the sampling interval
        for an integral. [s]
    """

    X: FloatArray
    present: FloatArray | None
    missing: int
    unit: float = 1.0

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.X) - 1


def signal(x: ArrayLike, data: str, dt: float) -> Signal:
    """Running sum of a rate-like signal or of the integral it was given as.

    Raises
    ------
    InputError
        If it is not one-dimensional, not numeric, infinite, or too short.
    """
    from schuler.characterisation import _kernels as k

    array = np.asarray(x)
    if array.dtype != np.float64 or isinstance(x, np.ma.MaskedArray):
        if array.dtype.kind not in "fiub":
            raise InputError(f"x: expected real numbers, got an array of type {array.dtype}")
        array = np.ma.filled(np.ma.asarray(x).astype(np.float64), np.nan)
    if array.ndim != 1:
        raise InputError(f"x: expected one signal, shape (n,), got shape {array.shape}; give one axis at a time")
    shortest = 3 if data == "rate" else 4
    if len(array) < shortest:
        raise InputError(f"x: expected at least {shortest} values, got {len(array)}")
    array = np.ascontiguousarray(array)
    mean = float(np.mean(array)) if data == "rate" else float(np.sum(array))
    if np.isfinite(mean):  # as it is only if every value is
        k.prepare_allan(gaps=False)
        if data == "rate":
            X = np.empty(len(array) + 1)
            k.running_sum(array, mean, X)
            return Signal(X, None, 0)
        return Signal(array, None, 0, dt)
    there = ~np.isnan(array)
    k.prepare_allan(gaps=True)
    if np.count_nonzero(there) < shortest:
        raise InputError(f"x: expected at least {shortest} values, got {np.count_nonzero(there)} and NaN")
    as_floats(array[there], "x (without its NaN)")
    missing = len(array) - int(np.count_nonzero(there))
    if data == "integral":
        return Signal(array, None, missing, dt)
    zero = np.zeros(1)
    less_mean = np.where(there, array - np.mean(array[there]), 0.0)
    return Signal(
        np.concatenate((zero, np.cumsum(less_mean))),
        np.concatenate((zero, np.cumsum(there, dtype=np.float64))),
        missing,
    )


def variance(
    s: Signal, kind: str, ms: IntArray, progress: Callable[[float], None] | None = None
) -> tuple[FloatArray, IntArray]:
    """Variance of a kind at averaging times of ``ms`` samples, and of how many squares it is the mean.

    Returns
    -------
    variance : ndarray, shape (k,)
        [x^2]; NaN where the count is zero.
    count : ndarray of int, shape (k,)
    """
    from schuler.characterisation import _kernels as k

    order, overlapping, modified = KINDS[kind]
    total = np.zeros(len(ms))
    m = ms.astype(np.float64)
    norm = (m * s.unit) ** 2 * (2.0 if order == 2 else 6.0)
    count = np.array([differences(kind, int(i), s.n).count for i in ms], dtype=np.int64)
    stride = 0 if overlapping else 1
    if s.missing:
        count[:] = 0
        if s.present is None:
            k.gappy_integral(s.X, ms, order, stride, total, count)
            return np.asarray(_mean(total, count) / norm), count
        excess = np.zeros(len(ms))
        k.gappy_clusters(s.X, s.present, ms, order, stride, LEAST_PRESENT, total, excess, count)
        return _less_excess(s, total, excess, count, m, order), count
    if kind == "total":
        k.reflected_differences(s.X, ms, total)
        count[:] = s.n - 1
    elif not overlapping:
        k.apart(s.X, ms, order, total)
    else:
        sums = np.zeros(len(ms))
        chunk = _CHUNK * k.BLOCK
        for first in range(0, s.n, chunk):
            stop = min(first + chunk, s.n)
            if modified:
                k.modified_differences(s.X, ms, first, stop, sums, total)
            elif order == 2:
                k.second_differences(s.X, ms, first, stop, total)
            else:
                k.third_differences(s.X, ms, first, stop, total)
            if progress is not None:
                progress(stop / s.n)
    if modified:
        norm = norm * m**2
    return np.asarray(_mean(total, count) / norm), count


def _less_excess(
    s: Signal, total: FloatArray, excess: FloatArray, count: IntArray, m: FloatArray, order: int
) -> FloatArray:
    """Variance less what white noise adds because samples are missing from the means.

    The level of the white noise is the variance at one sample. Where an estimate happens to lie below what that level
    predicts it is scaled instead, so that it stays positive.
    """
    from schuler.characterisation import _kernels as k

    assert s.present is not None
    norm = 2.0 if order == 2 else 6.0
    raw = _mean(total, count) / norm
    extra = _mean(excess, count) / norm
    at_one, n_one = np.zeros(1), np.zeros(1, dtype=np.int64)
    k.gappy_clusters(s.X, s.present, np.ones(1, dtype=np.int64), 2, 0, 1.0, at_one, np.zeros(1), n_one)
    white = 0.5 * float(at_one[0]) / max(1, int(n_one[0]))
    least = np.maximum(raw, white * (1.0 / m + extra))
    part = np.divide(white * extra, least, out=np.zeros_like(raw), where=least > 0.0)
    return np.asarray(raw * (1.0 - part))


def _mean(total: FloatArray, count: IntArray) -> FloatArray:
    mean: FloatArray = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    return mean
