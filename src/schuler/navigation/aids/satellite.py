"""Pseudoranges, range rates and carrier phases for tight coupling, and resets for the uncoupled architecture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.limits import MOST_CHANNELS
from schuler.filtering.measurements import (
    ARC_START,
    CARRIER_PHASE,
    PSEUDORANGE,
    RANGE_RATE,
    RESET_POSITION,
    RESET_VELOCITY,
    MeasurementSchedule,
    gate_threshold,
    merged,
)
from schuler.gnss.carrier import carrier_phases
from schuler.gnss.ranges import Ranges
from schuler.gnss.slow_errors import SlowRangeError, slow_channels, slow_sigmas
from schuler.recording.series import GnssSeries

_MOST_CLOCKS = 4


def range_measurements(
    ranges: Ranges,
    lever_arm_b: ArrayLike,
    *,
    use_rates: bool = True,
    sigma_scale: float = 1.0,
    gate: float | None = 0.9999,
    slow: SlowRangeError | None = None,
    channels: int = MOST_CHANNELS,
) -> MeasurementSchedule:
    """Pseudorange and range rate of every satellite to be used.

    Parameters
    ----------
    ranges : Ranges
        Corrected; rows with a reason against them are left out.
    lever_arm_b : array_like, shape (3,)
        From the IMU to the antenna. [m]
    use_rates : bool
        Also range rates.
    sigma_scale : float
        Factor on all 1-sigma values.
    gate : float, optional
        Probability with which a correct measurement passes: innovation fault detection satellite by satellite.
    slow : SlowRangeError, optional
        Error that stays with a satellite, a state of the filter; where there are more satellites than channels, white
        noise as large stands for it.
    channels : int
        Number of satellites at a time for which the filter has such a state.

    Raises
    ------
    InputError
        For more clocks than the filter has states for, or standard deviations that are not positive.

    References
    ----------
    Yaman (2017), eqs. (4-19)-(4-35); Groves (2013), section 14.3.2. Added: Sagnac, the change of the line of sight in
    the range rate, lever arm, the clock estimate in the prediction, one clock for each system.
    """
    if len(ranges.groups) > _MOST_CLOCKS:
        raise InputError(f"expected at most {_MOST_CLOCKS} receiver clocks, got {', '.join(ranges.groups)}")
    lever = as_vector3(lever_arm_b, "lever_arm_b")
    threshold = gate_threshold(gate, 1)
    parts = []
    r = ranges.where(ranges.used & np.isfinite(ranges.pseudorange) & np.isfinite(ranges.r_sat_e).all(axis=1))
    _check_sigmas(r.sigma_range, "ranges")
    if len(r):
        z, variance = np.column_stack((r.r_sat_e, r.pseudorange, r.group)), (sigma_scale * r.sigma_range) ** 2
        if slow is not None and slow.sigma > 0.0:
            channel = slow_channels(r, slow.tau, channels)
            z = np.column_stack((z, channel, slow.scale(r)))
            variance = variance + np.where(channel > 0, 0.0, slow_sigmas(r, slow) ** 2)
        parts.append(MeasurementSchedule.of(PSEUDORANGE, r.t, z, variance, lever, threshold))
    placed = np.isfinite(ranges.r_sat_e).all(axis=1) & np.isfinite(ranges.v_sat_e).all(axis=1)
    r = ranges.where(ranges.used & np.isfinite(ranges.range_rate) & placed)
    if use_rates and len(r):
        _check_sigmas(r.sigma_rate, "range rates")
        z = np.column_stack((r.r_sat_e, r.v_sat_e, r.range_rate))
        parts.append(MeasurementSchedule.of(RANGE_RATE, r.t, z, (sigma_scale * r.sigma_rate) ** 2, lever, threshold))
    return merged(*parts)


def carrier_measurements(
    ranges: Ranges,
    lever_arm_b: ArrayLike,
    *,
    sigma: float,
    gate: float | None = 0.9999,
    channels: int = MOST_CHANNELS,
) -> MeasurementSchedule:
    """Carrier phases, whose ambiguities are states of the filter.

    Parameters
    ----------
    ranges : Ranges
        Corrected; rows with a reason against them are left out.
    lever_arm_b : array_like, shape (3,)
        From the IMU to the antenna, body axes. [m]
    sigma : float
        1-sigma of a phase of a strong satellite overhead. [m]
    gate : float, optional
        Probability with which a correct measurement passes.
    channels : int
        Number of satellites at a time for whose ambiguities the filter has a state; phases of others are left out.

    Returns
    -------
    MeasurementSchedule
        The first phase of an arc only sets the ambiguity. Merged with others of an epoch, phases belong behind these.

    Notes
    -----
    Without a prior of the ambiguity the phases of an arc say what their changes say, with the correlation that
    neighbouring changes have by the phase they share (docs/decisions/0031-ambiguities-are-states.md).
    """
    r, p = ranges, carrier_phases(ranges, sigma, channels)
    own = p.channel > 0
    row, before, channel = p.row[own], p.before[own], p.channel[own]
    z = np.column_stack((r.r_sat_e[row], r.carrier_range[row], channel, np.where(before >= 0, r.t[before], 0.0)))
    s = MeasurementSchedule.of(
        CARRIER_PHASE, r.t[row], z, p.sigma[own] ** 2, as_vector3(lever_arm_b, "lever_arm_b"), gate_threshold(gate, 1)
    )
    return replace(s, kind=np.where(before >= 0, CARRIER_PHASE, ARC_START))


def _check_sigmas(sigma: FloatArray, what: str) -> None:
    bad = ~(np.isfinite(sigma) & (sigma > 0.0))
    if bad.any():
        raise InputError(
            f"expected positive standard deviations of {what}, {int(bad.sum())} of {len(sigma)} are not: "
            "filtering.satellites.with_sigmas fills them in"
        )


def resets(gnss: GnssSeries, lever_arm_b: ArrayLike, *, every_s: float = 0.0) -> MeasurementSchedule:
    """Uncoupled integration: position and velocity are put where GNSS is; attitude and biases stay as they are.

    Parameters
    ----------
    gnss : GnssSeries
    lever_arm_b : array_like, shape (3,)
        From the IMU to the antenna. [m]
    every_s : float
        Least time between two resets; 0 takes every fix. [s]

    References
    ----------
    Stefanisko (2015), section 3.1.1.
    """
    lever = as_vector3(lever_arm_b, "lever_arm_b")
    g = thinned(gnss, every_s)
    positions = MeasurementSchedule.of(RESET_POSITION, g.t, frames.ecef_from_llh(g.llh), g.cov_r_n, lever)
    if g.v_n is None or g.cov_v_n is None:
        return positions
    return merged(positions, MeasurementSchedule.of(RESET_VELOCITY, g.t, g.v_n, g.cov_v_n, lever))


def thinned(gnss: GnssSeries, every_s: float) -> GnssSeries:
    """The fixes that are at least ``every_s`` apart; all of them for 0."""
    if every_s <= 0.0:
        return gnss
    kept: list[int] = []
    for k, t in enumerate(gnss.t):
        if not kept or t - gnss.t[kept[-1]] >= every_s - 1e-6:
            kept.append(k)
    return gnss.where(np.array(kept, dtype=np.int64))
