"""Rests of a log in unknown units: only ratios of readings are used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.plotting.notebook import Abridged
from schuler.recording.io.checks import largest, norms, quiet_rates
from schuler.recording.series import ImuSeries
from schuler.standstill.intervals import true_runs

_BLOCK = 1 << 16  # samples that are looked at at a time


@dataclass(frozen=True, repr=False)
class UnscaledRests(Abridged):
    """Stretches of rest with their means, in the units of the log.

    Attributes
    ----------
    first, last : ndarray of int, shape (m,)
        Sample range ``first:last`` of each.
    t : ndarray, shape (m, 2)
        Start and stop. [s]
    accel, gyro : ndarray, shape (m, 3)
        Means.
    accel_sd, gyro_sd : ndarray, shape (m, 3)
        Standard deviation of a sample, the median over the windows of the rest.
    """

    first: IntArray
    last: IntArray
    t: FloatArray
    accel: FloatArray
    gyro: FloatArray
    accel_sd: FloatArray
    gyro_sd: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    @property
    def seconds(self) -> float:
        """Total time at rest. [s]"""
        return float(np.sum(self.t[:, 1] - self.t[:, 0]))


def unscaled_rests(
    imu: ImuSeries,
    speed: tuple[FloatArray, FloatArray] | None = None,
    *,
    window_s: float = 1.0,
    force_spread: float = 0.03,
    force_drift: float = 0.01,
    rate_noise: float = 3.0,
    max_speed: float = 0.3,
) -> UnscaledRests:
    """Find all stretches of rest of a log.

    Parameters
    ----------
    imu : ImuSeries
        Rates or increments in any units.
    speed : (ndarray, ndarray), optional
        Times [s] and speeds [m/s] of another source on the IMU's clock.
    window_s : float
        Length of the windows, which do not overlap; at least ten samples. [s]
    force_spread, force_drift : float
        Largest standard deviation of the specific force on an axis, and largest difference between the two halves of
        a window, as shares of the log's median norm.
    rate_noise : float
        Largest standard deviation of the angular rate on an axis, as a multiple of that of the quietest tenth.
    max_speed : float
        A window in which ``speed`` is larger is no rest. [m/s]

    Returns
    -------
    UnscaledRests
        Empty if there is none.

    Notes
    -----
    A window rests if its specific force is steady, does not drift and is near the median norm, and if its rates are
    quiet (:func:`schuler.recording.io.checks.quiet_rates`).
    """
    t = imu.t
    interval = imu.interval if len(t) > 1 else 1.0
    per = max(10, int(np.ceil(window_s / interval)))
    m = len(t) // per
    if m == 0:
        none, empty = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        return UnscaledRests(none, none, np.zeros((0, 2)), empty, empty, empty, empty)
    f = imu.accel[: m * per].reshape(m, per, 3)
    w = imu.gyro[: m * per].reshape(m, per, 3)
    times = t[: m * per].reshape(m, per)
    typical = float(np.median(norms(imu.accel), overwrite_input=True))
    # a part at a time: deviations from the mean of a window are as much as the log
    number = max(1, _BLOCK // per)
    parts = [slice(k, k + number) for k in range(0, m, number)]
    f_sd, w_sd = (np.concatenate([x[k].std(axis=1) for k in parts]) for x in (f, w))
    steady = _steady_force(f, f_sd, typical, force_spread, force_drift)
    mean_rate, mean_force = w.mean(axis=1), f.mean(axis=1)
    still = steady & quiet_rates(w_sd.max(axis=1), mean_rate, mean_force, steady, largest(imu.gyro), rate_noise)
    if speed is not None:
        middle = times.mean(axis=1)
        inside = (middle >= speed[0][0]) & (middle <= speed[0][-1])
        still &= ~inside | (np.interp(middle, *speed) < max_speed)
    without_gap = times[:, -1] - times[:, 0] < 1.5 * per * interval
    windows = _split_by_attitude(true_runs(still & without_gap), mean_force)
    return _means(imu, windows, per, f_sd, w_sd)


def _steady_force(f: FloatArray, f_sd: FloatArray, typical: float, spread: float, drift: float) -> BoolArray:
    """Windows (m, per, 3) whose specific force neither scatters nor drifts and has about the usual norm. Shape (m,)."""
    level = np.linalg.norm(f.mean(axis=1), axis=1)
    half = f.shape[1] // 2
    moved = np.linalg.norm(f[:, :half].mean(axis=1) - f[:, half:].mean(axis=1), axis=1)
    steady = (f_sd.max(axis=1) <= spread * typical) & (moved <= drift * typical) & (level > 0.0)
    return np.asarray(steady & (np.abs(level - typical) < 0.3 * max(typical, 1e-300)))


def _split_by_attitude(runs: IntArray, means: FloatArray) -> list[tuple[int, int]]:
    """Runs of windows, parted where the mean specific force changes by more than a twentieth."""
    parts = []
    for i, j in runs.tolist():
        start = i
        for k in range(i + 1, j):
            if np.linalg.norm(means[k] - means[start]) > 0.05 * np.linalg.norm(means[start]):
                parts.append((start, k))
                start = k
        parts.append((start, j))
    return parts


def _means(
    imu: ImuSeries, windows: list[tuple[int, int]], per: int, f_sd: FloatArray, w_sd: FloatArray
) -> UnscaledRests:
    index = np.array(windows, dtype=np.int64).reshape(-1, 2)
    lo, hi = (index * per).T
    samples = list(zip(lo, hi, strict=True))
    accel, gyro = (np.array([x[a:b].mean(axis=0) for a, b in samples]).reshape(-1, 3) for x in (imu.accel, imu.gyro))
    sd_f, sd_w = (np.array([np.median(s[a:b], axis=0) for a, b in index]).reshape(-1, 3) for s in (f_sd, w_sd))
    return UnscaledRests(lo, hi, np.stack([imu.t[lo], imu.t[hi - 1]], axis=1), accel, gyro, sd_f, sd_w)
