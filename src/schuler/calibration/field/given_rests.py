"""Rests that are known, from a note pad or a plan, instead of found in the log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals

_SAMPLES = 20


def given_rests(imu: ImuSeries, spans: Sequence[tuple[float, float]] | FloatArray) -> StaticIntervals:
    """Rests of a log between given times.

    Parameters
    ----------
    imu : ImuSeries
    spans : sequence of (start, stop), or ndarray, shape (k, 2)
        In the time of the log, one after the other. [s]

    Returns
    -------
    StaticIntervals
        Taken as they are: nothing is tested or cut, noise is zero. ``gyro_bias`` is the median of the mean rates.

    Raises
    ------
    InputError
        If there is none, one has fewer than 20 samples in the log, or they overlap.
    """
    pairs = np.asarray(spans, dtype=np.float64).reshape(-1, 2)
    if not len(pairs):
        raise InputError("spans: expected a start and a stop for each rest, got none")
    first = np.searchsorted(imu.t, pairs[:, 0] - 1e-9)
    last = np.searchsorted(imu.t, pairs[:, 1] + 1e-9, side="right")
    for (start, stop), a, b in zip(pairs, first, last, strict=True):
        if b - a < _SAMPLES:
            raise InputError(
                f"spans: expected {_SAMPLES} samples or more in {start:.2f}..{stop:.2f} s, got {max(b - a, 0)}; the "
                f"log covers {imu.t[0]:.2f}..{imu.t[-1]:.2f} s"
            )
    if np.any(first[1:] < last[:-1]):
        k = int(np.flatnonzero(first[1:] < last[:-1])[0])
        raise InputError(f"spans: expected rests one after the other, but {pairs[k]} and {pairs[k + 1]} s overlap")
    index = np.stack((first, last), axis=1)
    mask = np.zeros(len(imu), dtype=bool)
    for a, b in index:
        mask[a:b] = True
    gyro = imu.rates().gyro
    zero = np.zeros(3)
    return StaticIntervals(
        imu.t[first], imu.t[last - 1], index, mask, np.zeros(len(imu)), 0.0, "given", 0.0, zero, zero,
        np.median([gyro[a:b].mean(axis=0) for a, b in index], axis=0), ("rests as given",),
    )  # fmt: skip
