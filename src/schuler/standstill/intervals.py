"""Intervals at rest from samples at rest: runs, breaks closed, short runs left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.timebase import check_times


def true_runs(mask: BoolArray) -> IntArray:
    """First index of each run of True and the one after its last. Shape (k, 2)."""
    edge = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.stack((np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)), axis=1)


def runs_between_pauses(mask: BoolArray, t: FloatArray, pause: float) -> IntArray:
    """Runs of True as :func:`true_runs`, cut where the time jumps by more than ``pause`` [s]. Shape (k, 2)."""
    first, last = true_runs(mask).T
    jump = np.flatnonzero(np.diff(t) > max(pause, 1.5 * float(np.median(np.diff(t))))) + 1
    jump = jump[mask[jump - 1] & mask[jump]]
    return np.stack((np.sort(np.concatenate((first, jump))), np.sort(np.concatenate((last, jump)))), axis=1)


@dataclass(frozen=True, repr=False)
class Rests(Abridged):
    """Rests of a log, sample by sample.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the log. [s]
    mask : ndarray of bool, shape (n,)
        Samples at rest.
    index : ndarray of int, shape (k, 2)
        First sample of each rest and the one after its last.
    statistic, threshold : ndarray, shape (n,)
        Statistic of the detector and what it was compared with; empty where the rests were given.
    method : str
        How they were detected, a phrase for summaries.
    """

    t: FloatArray
    mask: BoolArray
    index: IntArray
    statistic: FloatArray
    threshold: FloatArray
    method: str

    def __len__(self) -> int:
        return len(self.index)

    @property
    def start(self) -> FloatArray:
        """Time of the first sample of each rest. Shape (k,). [s]"""
        return self.t[self.index[:, 0]]

    @property
    def stop(self) -> FloatArray:
        """Time of the last sample of each rest. Shape (k,). [s]"""
        return self.t[self.index[:, 1] - 1]

    @property
    def middle(self) -> IntArray:
        """Sample in the middle of each rest. Shape (k,)."""
        return (self.index[:, 0] + self.index[:, 1] - 1) // 2


def rests_from_mask(
    t: ArrayLike,
    mask: ArrayLike,
    *,
    min_rest_s: float = 0.0,
    bridge_s: float = 0.0,
    statistic: FloatArray | None = None,
    threshold: FloatArray | None = None,
    method: str = "given",
) -> Rests:
    """Join samples at rest into rests: short breaks are closed first, then short rests left out.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    mask : array_like of bool, shape (n,)
    min_rest_s : float
        Shorter rests are left out; the time from the first to the last sample counts, and one interval. [s]
    bridge_s : float
        Breaks not longer than this are closed. [s]
    statistic, threshold : ndarray, shape (n,), optional
    method : str

    Raises
    ------
    InputError
        If the mask is not as long as the log.
    """
    t = check_times(t, "t")
    rest = np.array(mask, dtype=bool)
    if rest.shape != t.shape:
        raise InputError(f"rest: expected a mask of shape {t.shape}, one value for each IMU sample, got {rest.shape}")
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    for a, b in true_runs(~rest):
        if a > 0 and b < len(t) and t[b - 1] - t[a] + step <= bridge_s + 1e-9:
            rest[a:b] = True
    for a, b in true_runs(rest):
        if t[b - 1] - t[a] + step < min_rest_s - 1e-9:
            rest[a:b] = False
    empty = np.empty(0)
    return Rests(
        t, rest, true_runs(rest), empty if statistic is None else statistic,
        empty if threshold is None else threshold, method,
    )  # fmt: skip
