"""Stamps of a live IMU: which samples go on, and when it is another clock."""

from __future__ import annotations

import math

import numpy as np

from schuler.arrays import BoolArray, FloatArray

_RESUMED = 20  # samples in order among themselves that are believed against the one before them


class Stamps:
    """Judge of the stamps of an IMU, one block after the other.

    A sample goes on if it comes after the last one by no more than ``max_gap_s``. Others are left out, until so many in
    a row agree with each other that it must be the clock that stepped, or the log that paused.

    Parameters
    ----------
    max_gap_s : float
        [s]
    """

    def __init__(self, max_gap_s: float) -> None:
        self.max_gap_s = max_gap_s
        self.last = -math.inf  # newest sample that was taken [s]
        self.other = -math.inf  # newest sample of what may be another clock [s]
        self.count = 0  # samples of that clock

    def continues(self, t: FloatArray) -> bool:
        """Whether all of these stamps follow the newest sample and each other. Shape (n,)."""
        if not len(t):
            return True
        step = t[1:] - t[:-1]
        first = float(t[0]) - self.last
        return 0.0 < first <= self.max_gap_s and bool((step > 0.0).all() and (step <= self.max_gap_s).all())

    def advance(self, t: float) -> None:
        """Remember the last of samples that continue."""
        self.last, self.count = t, 0

    def judge(self, t: FloatArray) -> tuple[BoolArray, str, int]:
        """Samples to be taken.

        Parameters
        ----------
        t : ndarray, shape (n,)
            Stamps in the order of arrival. [s]

        Returns
        -------
        taken : ndarray of bool, shape (n,)
            Up to the first sample of another clock, if there is one.
        sentence : str
            On samples that were left out; empty if there are none.
        resumed : int
            Sample from which on another clock, or the same after a pause, is to be believed; n if there is none. It and
            what follows are for the next call.
        """
        n = len(t)
        if self.continues(t):
            if n:
                self.last, self.count = float(t[-1]), 0
            return np.ones(n, dtype=bool), "", n
        with np.errstate(invalid="ignore"):
            step = np.diff(t, prepend=self.last)
        if n and np.all(step > 0.0) and self._is_first(step):
            self.last, self.count = float(t[-1]), 0
            return np.ones(n, dtype=bool), "", n
        taken = np.zeros(n, dtype=bool)
        reasons: dict[str, int] = {}
        for i, stamp in enumerate(t.tolist()):
            ahead = stamp - self.last
            if 0.0 < ahead <= self.max_gap_s or self.last == -math.inf < stamp < math.inf:
                taken[i], self.last, self.count = True, stamp, 0
                continue
            if not math.isfinite(stamp):
                reason = "without a time"
            elif ahead == 0.0:
                reason = "repeated"
            else:
                reason = "out of order" if ahead < 0.0 else "far ahead"
                agrees = 0.0 < stamp - self.other <= self.max_gap_s
                self.count, self.other = (self.count + 1 if agrees else 1), stamp
                if self.count >= _RESUMED:
                    self.last, self.count = -math.inf, 0
                    return taken, "", i
            reasons[reason] = reasons.get(reason, 0) + 1
        counts = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
        return taken, f"IMU samples left out: {counts}" if reasons else "", n

    def _is_first(self, step: FloatArray) -> bool:
        """Whether nothing was taken before, and the block itself is without a pause."""
        return self.last == -math.inf and bool(np.all(step[1:] <= self.max_gap_s)) and math.isinf(step[0])
