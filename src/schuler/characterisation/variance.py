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


def integrate_signal(x: ArrayLike, data: str, dt: float) -> Signal:
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
    present_ = ~np.isnan(array)
    k.prepare_allan(gaps=True)
    if np.count_nonzero(present_) < shortest:
        raise InputError(f"x: expected at least {shortest} values, got {np.count_nonzero(present_)} and NaN")
    as_floats(array[present_], "x (without its NaN)")
    missing = len(array) - int(np.count_nonzero(present_))
    if data == "integral":
        return Signal(array, None, missing, dt)
    zero = np.zeros(1)
    less_mean = np.where(present_, array - np.mean(array[present_]), 0.0)
    return Signal(
        np.concatenate((zero, np.cumsum(less_mean))),
        np.concatenate((zero, np.cumsum(present_, dtype=np.float64))),
        missing,
    )


def allan_variances(
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


def on_grid(t: ArrayLike, x: ArrayLike, rate_hz: float) -> FloatArray:
    """Put stamped samples on a regular grid, with NaN where none came.

    Parameters
    ----------
    t : array_like, shape (n,)
        Time stamps, increasing. [s]
    x : array_like, shape (n,) or (n, axes)
        Samples; NaN among them stays.
    rate_hz : float
        The true sampling rate. [Hz]

    Returns
    -------
    ndarray, shape (k,) or (k, axes)
        One row for each sampling interval from the first sample to the last.

    Raises
    ------
    InputError
        If two samples fall on one place, or stamps stray from the grid by more than half a sample, by jitter or because
        the rate is another one; the message gives the rate the stamps suggest.

    Notes
    -----
    Steps between stamps are rounded to whole samples one by one, so a gap of any length keeps its length; then the
    stamps are compared with the grid laid through their median. Nothing is interpolated.
    """
    t = as_floats(t, "t", (None,))
    x = np.asarray(x, dtype=np.float64)
    if x.ndim not in (1, 2) or len(x) != len(t):
        raise InputError(f"x: expected one row for each of the {len(t)} stamps, got shape {x.shape}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected one positive finite number, got {rate_hz!r}")
    if len(t) < 2:
        raise InputError(f"t: expected at least 2 stamps, got {len(t)}")
    steps = np.diff(t) * rate_hz
    steps_ = np.round(steps).astype(np.int64)
    suggested = f"the stamps suggest {1.0 / float(np.median(np.diff(t))):.6g} Hz" if np.median(steps) > 0.0 else ""
    if np.any(steps_ < 1):
        i = int(np.argmax(steps_ < 1))
        raise InputError(
            f"t: expected stamps about 1 / ({rate_hz:g} Hz) apart, got {steps[i] / rate_hz:.6g} s between samples {i} "
            f"and {i + 1}; sort the samples, drop doubles, or state the true rate ({suggested})"
        )
    place = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(steps_)))
    stray = (t - t[0]) * rate_hz - place
    stray -= np.median(stray)
    worst = int(np.argmax(np.abs(stray)))
    if abs(stray[worst]) > 0.5:
        raise InputError(
            f"t: expected stamps within half a sample of a grid of {rate_hz:g} Hz, got sample {worst} off by "
            f"{stray[worst]:.2f} samples; state the true rate ({suggested}) or resample"
        )
    if place[-1] > 100 * len(t):
        raise InputError(
            f"t: expected a recording that is mostly there, got {len(t)} samples on {place[-1] + 1} places; "
            "treat its stretches as recordings of their own"
        )
    out = np.full((int(place[-1]) + 1, *x.shape[1:]), np.nan)
    out[place] = x
    return out
