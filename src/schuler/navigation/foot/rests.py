"""Rests of the foot by the detector of a configuration, and the zero velocities they are used as."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import MeasurementSchedule, zero_velocity
from schuler.navigation.foot.config import DetectorSection, FootConfig
from schuler.recording.series import ImuSeries
from schuler.standstill.detectors import Kind, statistic, window_samples
from schuler.standstill.gait import gait_threshold, stride_period
from schuler.standstill.intervals import Rests, rests_from_mask
from schuler.standstill.thresholds import below_with_hysteresis, elapsed_time_threshold, threshold

_SHORT_S = 0.05  # a rest that a swing can hold
_APART = 0.2  # of a stride, at which another rest is no part of the same stance
_NO_GAIT_S = 1.5  # mean of the statistic where the log shows no stride

#: Names used for foot-mounted detectors, and those of :mod:`schuler.standstill.detectors`.
DETECTORS: dict[str, Kind] = {
    "shoe": "glrt",
    "ared": "angular rate energy",
    "amv": "acceleration variance",
    "magnitude": "acceleration magnitude",
}


def detect_rests(
    imu: ImuSeries, section: DetectorSection, *, gravity: float, rest_s: float = 1.0, period_s: float | None = None
) -> Rests:
    """Detect the rests of a foot.

    Parameters
    ----------
    imu : ImuSeries
    section : DetectorSection
        Detector, threshold, hysteresis, shortest rest.
    gravity : float
        Local gravity. [m/s^2]
    rest_s : float
        Time at rest at the start of the log that ``threshold = "noise"`` takes noise, gyro bias and the magnitude of
        specific force from. [s]
    period_s : float, optional
        Time from stride to stride, 0 where nothing repeats; left out: :func:`~schuler.standstill.gait.stride_period`.
        [s]

    Returns
    -------
    Rests

    Raises
    ------
    InputError
        If the window does not fit into the log, or the log does not begin with a rest to take the noise from.

    Notes
    -----
    The window is centred on the sample, see :func:`schuler.standstill.detectors.statistic`.

    References
    ----------
    Skog, Handel, Nilsson, Rantakokko (2010), Zero-velocity detection - an algorithm evaluation, eqs. (10)-(18).
    """
    kind, rates = DETECTORS[section.kind], imu.rates()
    sigma_f: FloatArray = np.full(3, section.sigma_accel_m_s2)
    sigma_w: FloatArray = np.full(3, section.sigma_gyro_deg_s * units.DEG)
    bias = np.zeros(3)
    if section.threshold == "noise":
        sigma_f, sigma_w, bias, gravity = _moments_at_start(rates, rest_s)
    value = statistic(rates, kind, section.window, sigma_f=sigma_f, sigma_w=sigma_w, gravity=gravity, gyro_bias=bias)
    at_rest: BoolArray | None = None
    shortest = section.min_rest_s
    if section.threshold == "motion":
        stride = section.cycle_s or (stride_period(imu) if period_s is None else period_s or None)
        cycle, stillest = (_NO_GAIT_S, 0.0) if stride is None else (stride, section.stillest)
        if section.kind == "magnitude":  # passes through zero in every swing, and lower than in a stance
            stillest = 0.0
        limit = gait_threshold(
            imu.t, value, ratio=section.ratio, cycle_s=min(cycle, imu.t[-1] - imu.t[0]), floor=section.floor,
            stillest=stillest,
        )  # fmt: skip
        method = f"{section.ratio:g} of the mean over {cycle:.2f} s" + (
            ", nothing repeats like a gait" if stride is None
            else f" or {stillest:g} times the least" if stillest > 0.0 else ""
        )  # fmt: skip
    elif section.threshold == "time":
        limit, at_rest = elapsed_time_threshold(
            imu.t, value, growth=section.growth_per_s, delay_s=section.delay_s, floor=section.floor
        )
        method = f"rising by {section.growth_per_s:g} a second since the last rest"
        shortest = 0.0  # each stance gives single samples
    elif section.threshold == "noise":
        W = window_samples(imu, section.window)
        limit = np.full(len(imu), section.margin * threshold(kind, W, section.false_alarm))
        method = f"{limit[0]:.3g} from the noise at rest"
    else:
        limit = np.full(len(imu), float(section.threshold))
        method = f"{section.threshold:g}"
    if at_rest is None:
        at_rest = below_with_hysteresis(value, limit, section.leave)
    rests = rests_from_mask(
        imu.t, at_rest, min_rest_s=shortest, bridge_s=section.bridge_s, statistic=value, threshold=limit,
        method=f"{section.kind} over {section.window:g} s, threshold {method}",
    )  # fmt: skip
    if section.threshold != "motion" or stride is None:
        return rests
    mask = rests.mask.copy()
    for k in in_swings(rests, stride):
        mask[rests.index[k, 0] : rests.index[k, 1]] = False
    return rests_from_mask(imu.t, mask, statistic=value, threshold=limit, method=rests.method)


def in_swings(rests: Rests, stride_s: float) -> IntArray:
    """Which rests lie in the middle of a swing: moments in which rate and force happen to look like a stance.

    From the stance before to the stance after passes less time than a stride takes, and neither is near: a foot that
    comes to rest in between would have had to swing twice.

    Parameters
    ----------
    rests : Rests
    stride_s : float
        Time from stride to stride. [s]

    Returns
    -------
    ndarray of int
        Indices of rests.
    """
    start, stop = rests.start, rests.stop
    before, after = start[1:-1] - stop[:-2], start[2:] - stop[1:-1]
    short = stop[1:-1] - start[1:-1] < _SHORT_S
    apart = np.minimum(before, after) > _APART * stride_s
    within: IntArray = 1 + np.flatnonzero(short & apart & (start[2:] - stop[:-2] < stride_s))
    return within


def _moments_at_start(rates: ImuSeries, rest_s: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Standard deviations of force and rate, mean rate and magnitude of the mean force over the first ``rest_s`` s."""
    still = rates.between(rates.t[0], rates.t[0] + rest_s)
    if len(still) < 20 or still.t[-1] - still.t[0] < 0.9 * rest_s:
        raise InputError(f"threshold = 'noise' needs {rest_s} s at rest at the start; the log is too short")
    sigma_f, sigma_w = still.accel.std(axis=0, ddof=1), still.gyro.std(axis=0, ddof=1)
    if not (np.all(sigma_f > 0.0) and np.all(sigma_w > 0.0)):
        raise InputError("threshold = 'noise': an axis never changes at the start of the log; is it connected?")
    return sigma_f, sigma_w, still.gyro.mean(axis=0), float(np.linalg.norm(still.accel.mean(axis=0)))


def zero_velocities(imu: ImuSeries, rests: Rests, config: FootConfig) -> MeasurementSchedule:
    """Zero velocity at every sample at rest, less certain while the foot turns.

    Parameters
    ----------
    imu : ImuSeries
    rests : Rests
        Rests of the same log or its later part.
    config : FootConfig
        Section ``zupt``.

    Returns
    -------
    MeasurementSchedule
        1-sigma ``sqrt(sigma^2 + (roll |omega|)^2)``: a sole that rolls over the ground at omega moves the IMU at omega
        times its distance from the point it rolls on, and that point wanders by ``roll``.
    """
    section = config.zupt
    times = rests.t[rests.mask]
    at = np.searchsorted(imu.t, times - 1e-9)
    omega = np.linalg.norm(imu.rates().gyro[at], axis=1)
    unit = zero_velocity(times, 1.0, gate=None if section.gate == "off" else section.gate)
    variance = section.sigma_m_s**2 + (section.roll_m * omega) ** 2
    return replace(unit, R=unit.R * variance[:, None, None])
