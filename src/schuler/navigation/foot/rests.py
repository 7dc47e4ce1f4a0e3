"""Where the foot rests: from a detector's statistic and threshold to intervals of zero velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import units
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.navigation.foot.adaptive_threshold import by_motion, by_time_since_rest
from schuler.navigation.foot.config import DetectorSection
from schuler.recording.series import ImuSeries
from schuler.recording.times import check_times
from schuler.standstill import detectors
from schuler.standstill.detectors import Kind

#: Names used for foot-mounted detectors, and those of :mod:`schuler.standstill.detectors`.
DETECTORS: dict[str, Kind] = {
    "shoe": "glrt",
    "ared": "angular rate energy",
    "amv": "acceleration variance",
    "magnitude": "acceleration magnitude",
}


@dataclass(frozen=True)
class Rests:
    """Rests of the foot.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the log. [s]
    mask : ndarray of bool, shape (n,)
        Samples at rest.
    index : ndarray of int, shape (k, 2)
        First sample of each rest and the one after its last.
    statistic, threshold : ndarray, shape (n,)
        Of the detector; empty where the rests were given.
    method : str
        A phrase for summaries.
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


def find_rests(imu: ImuSeries, section: DetectorSection, *, gravity: float, rest_s: float = 1.0) -> Rests:
    """Detect the rests of a foot.

    Parameters
    ----------
    imu : ImuSeries
    section : DetectorSection
        Detector, threshold, hysteresis, shortest rest.
    gravity : float
        Local gravity. [m/s^2]
    rest_s : float
        Length of the stillness at the start of the log that ``threshold = "noise"`` takes noise, gyro bias and
        the magnitude of specific force from. [s]

    Returns
    -------
    Rests

    Raises
    ------
    InputError
        If the window does not fit into the log, or there is no stillness to take the noise from.

    Notes
    -----
    The window is centred on the sample, see :func:`schuler.standstill.detectors.statistic`.

    References
    ----------
    Skog, Handel, Nilsson, Rantakokko (2010), Zero-velocity detection - an algorithm evaluation, eqs. (10)-(18).
    """
    kind = DETECTORS[section.kind]
    rates = imu.rates()
    sigma_f: FloatArray = np.full(3, section.sigma_accel_m_s2)
    sigma_w: FloatArray = np.full(3, section.sigma_gyro_deg_s * units.DEG)
    bias = np.zeros(3)
    if section.threshold == "noise":
        still = rates.between(rates.t[0], rates.t[0] + rest_s)
        if len(still) < 20 or still.t[-1] - still.t[0] < 0.9 * rest_s:
            raise InputError(f"threshold = 'noise' needs {rest_s} s at rest at the start; the log is too short")
        sigma_f, sigma_w = still.accel.std(axis=0, ddof=1), still.gyro.std(axis=0, ddof=1)
        if not (np.all(sigma_f > 0.0) and np.all(sigma_w > 0.0)):
            raise InputError("threshold = 'noise': an axis never changes at the start of the log; is it connected?")
        bias = still.gyro.mean(axis=0)
        gravity = float(np.linalg.norm(still.accel.mean(axis=0)))
    value = detectors.statistic(
        rates, kind, section.window, sigma_f=sigma_f, sigma_w=sigma_w, gravity=gravity, gyro_bias=bias
    )
    below: BoolArray
    if section.threshold == "motion":
        limit = by_motion(
            imu.t, value, ratio=section.ratio, cycle_s=min(section.cycle_s, imu.t[-1] - imu.t[0]), floor=section.floor
        )
        method = f"{section.ratio:g} of the mean over {section.cycle_s:g} s"
    elif section.threshold == "time":
        limit, found = by_time_since_rest(
            imu.t, value, growth=section.growth_per_s, delay_s=section.delay_s, floor=section.floor
        )
        method = f"rising by {section.growth_per_s:g} a second since the last rest"
    elif section.threshold == "noise":
        W = detectors.window_samples(imu, section.window)
        limit = np.full(len(imu), section.margin * detectors.threshold(kind, W, section.false_alarm))
        method = f"{limit[0]:.3g} from the noise at rest"
    else:
        limit = np.full(len(imu), float(section.threshold))
        method = f"{section.threshold:g}"
    below = found if section.threshold == "time" else _with_hysteresis(value, limit, section.leave)
    shortest = 0.0 if section.threshold == "time" else section.min_rest_s  # by time single samples are found
    return rests_of(
        imu.t, below, min_rest_s=shortest, bridge_s=section.bridge_s, statistic=value, threshold=limit,
        method=f"{section.kind} over {section.window:g} s, threshold {method}",
    )  # fmt: skip


def rests_of(
    t: ArrayLike,
    mask: ArrayLike,
    *,
    min_rest_s: float = 0.0,
    bridge_s: float = 0.0,
    statistic: FloatArray | None = None,
    threshold: FloatArray | None = None,
    method: str = "given",
) -> Rests:
    """Rests from samples at rest: short breaks closed first, then short rests left out.

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
    for a, b in intervals(~rest):
        if a > 0 and b < len(t) and t[b - 1] - t[a] + step <= bridge_s + 1e-9:
            rest[a:b] = True
    for a, b in intervals(rest):
        if t[b - 1] - t[a] + step < min_rest_s - 1e-9:
            rest[a:b] = False
    empty = np.empty(0)
    return Rests(
        t, rest, intervals(rest), empty if statistic is None else statistic,
        empty if threshold is None else threshold, method,
    )  # fmt: skip


def intervals(mask: BoolArray) -> IntArray:
    """First index of each run of True and the one after its last. Shape (k, 2)."""
    edge = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.stack((np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)), axis=1)


def _with_hysteresis(value: FloatArray, limit: FloatArray, leave: float) -> BoolArray:
    """Rest begins below the limit and lasts until ``leave`` times the limit is reached."""
    enter, out = value < limit, value >= leave * limit
    # the last sample that decided, of those before and at each one
    decided = np.maximum.accumulate(np.where(enter | out, np.arange(len(value)), -1))
    rest: BoolArray = np.where(decided >= 0, enter[np.maximum(decided, 0)], False)
    return rest
