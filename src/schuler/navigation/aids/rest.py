"""Measurements at rest: zero velocity, zero rotation, gravity, Earth rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    EARTH_RATE,
    GRAVITY,
    GRAVITY_VECTOR,
    ZERO_RATE,
    ZERO_VELOCITY,
    MeasurementSchedule,
    gate_threshold,
    in_windows,
)
from schuler.navigation.sections import RestSection
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.standstill.detectors import MAX_RATE, moving_moments, window_samples
from schuler.standstill.intervals import runs_between_pauses, true_runs
from schuler.standstill.stationarity import StaticIntervals, interval_mask, static_intervals

#: Opening of the note on stops that are found by comparison with the motion, such as those with the engine idling.
SHAKEN = "stops that shake"
_CALMEST_DRIVE = 0.01  # quantile of the vibration while GNSS sees motion
_APART = 0.2  # decades of (specific force) x (rate) by which stops must be calmer than that
_LEAST_STOP_S, _LEAST_DRIVE_S = 3.0, 20.0  # of samples that GNSS calls slow, and fast
_SLOW = 0.1  # GNSS speed of a stop, before its uncertainty is added [m/s]
_VIBRATION_HZ = 3.0  # lowest frequency at which a vehicle shakes at rest, on its springs and by its engine


def rests(
    imu: ImuSeries, gnss: GnssSeries | None, section: RestSection, windows: Sequence[tuple[float, float]] = ()
) -> StaticIntervals:
    """Stretches at rest by the IMU, less those during which GNSS sees motion, with stops of an idling engine.

    Parameters
    ----------
    imu : ImuSeries
    gnss : GnssSeries, optional
        Rests during which it moves are dropped: a smooth ride is as quiet as rest. Without velocities its speed comes
        from positions a second apart.
    section : RestSection
    windows : sequence of (start, stop)
        Outages, whose fixes are not used. [s]

    Notes
    -----
    The noise at rest is learnt from the quietest windows of the log, with the engine off perhaps, and an idling one
    shakes ten times as much; or the log has hardly a stop, and the calmest ride is taken for one. So the vibration
    (standard deviations of specific force and of rate over a window, multiplied) where GNSS is slow is compared with
    that where it is fast. Where the stops' median is clearly below the calmest hundredth of the drive, what is calmer
    than half way between them is at rest too, unless it turns or GNSS sees it move; and what is not, and has no fix
    around it (an outage), is no rest. New stops without a fix are asked for a quarter of the way and twice the time: a
    stop that is missed costs little, a stop that is none a wreck.
    """
    base = static_intervals(imu, min_s=section.min_s, window_s=section.window_s, margin=section.margin)
    if gnss is None or len(gnss) < 2:
        return base
    t, speed, sigma = horizontal_speeds(gnss)
    use = ~in_windows(t, windows)
    t, fast, slow = t[use], (speed > section.max_speed_m_s + 3.0 * sigma)[use], (speed < _SLOW + 3.0 * sigma)[use]
    if not len(t):
        return base
    mask = base.mask.copy()
    _clear_moving(mask, imu.t, t[fast])
    notes = base.notes
    shaken = _calmer_than_the_drive(imu, t, fast, slow, section, mask)
    if np.any(shaken & ~mask):
        more = float(np.sum(shaken & ~mask)) * imu.interval
        notes = (*notes, f"{SHAKEN} are found by comparison with the drive: {more:.1f} s at rest more")
        mask |= shaken
    index = np.array(
        [(a, b) for a, b in runs_between_pauses(mask, imu.t, 0.5 * section.window_s) if b - a >= 2], dtype=np.int64
    ).reshape(-1, 2)
    return replace(
        base, start=imu.t[index[:, 0]], stop=imu.t[index[:, 1] - 1], index=index,
        mask=interval_mask(index, len(imu)), notes=notes,
    )  # fmt: skip


def horizontal_speeds(gnss: GnssSeries) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, horizontal speeds and their 1-sigma: GNSS velocities, or positions about a second apart. Shape (m,).

    Receivers that state no vertical velocity have a large sigma for it, which says nothing here.
    """
    if gnss.v_n is not None and gnss.cov_v_n is not None:
        sigma = np.sqrt(np.maximum(gnss.cov_v_n[:, 0, 0], gnss.cov_v_n[:, 1, 1]))
        return gnss.t, np.hypot(gnss.v_n[:, 0], gnss.v_n[:, 1]), sigma
    r = frames.ecef_from_llh(gnss.llh)
    ahead = np.searchsorted(gnss.t, gnss.t + 1.0 - 1e-6)
    i = np.flatnonzero(ahead < len(gnss))
    j = ahead[i]
    near = gnss.t[j] - gnss.t[i] < 3.0
    i, j = i[near], j[near]
    dt = gnss.t[j] - gnss.t[i]
    d_n = np.einsum("nji,nj->ni", frames.C_en(gnss.llh[i]), r[j] - r[i])
    variance = np.maximum(gnss.cov_r_n[:, 0, 0], gnss.cov_r_n[:, 1, 1])
    # errors of neighbouring fixes are alike, so this is an upper bound
    return 0.5 * (gnss.t[i] + gnss.t[j]), np.hypot(d_n[:, 0], d_n[:, 1]) / dt, np.sqrt(variance[i] + variance[j]) / dt


def _clear_moving(mask: BoolArray, t: FloatArray, moving: FloatArray) -> None:
    """Take the runs of a mask away during which a time of motion lies."""
    for a, b in true_runs(mask):
        if np.searchsorted(moving, t[a]) != np.searchsorted(moving, t[b - 1], side="right"):
            mask[a:b] = False


def _calmer_than_the_drive(
    imu: ImuSeries, t: FloatArray, fast: BoolArray, slow: BoolArray, section: RestSection, mask: BoolArray
) -> BoolArray:
    """Samples at rest by their vibration, which GNSS tells from that of the drive. Shape (n,).

    Runs of ``mask`` without a fix that shake as the drive does are cleared.
    """
    nothing = np.zeros(len(imu), dtype=bool)
    rates = imu.rates()
    W = window_samples(imu, section.window_s)
    mean, variance = moving_moments(np.hstack((rates.accel, rates.gyro)), W)
    force, rate = (np.sqrt(np.maximum(variance[:, k].sum(axis=1), 1e-300)) for k in (slice(0, 3), slice(3, 6)))
    vibration = np.log10(force) + np.log10(rate)
    after = np.clip(np.searchsorted(t, imu.t), 1, len(t) - 1)
    before = after - 1
    # two fixes around, near enough that nothing drives off and stops between them
    around = (t[before] <= imu.t) & (imu.t <= t[after]) & (t[after] - t[before] < 2.5)
    driving, slow = around & fast[before] & fast[after], around & slow[before] & slow[after]
    if slow.sum() * imu.interval < _LEAST_STOP_S or driving.sum() * imu.interval < _LEAST_DRIVE_S:
        return nothing
    stop = float(np.median(vibration[slow]))
    way = float(np.quantile(vibration[driving], _CALMEST_DRIVE)) - stop
    if way < _APART:
        return nothing
    calm = slow & (vibration < stop + 0.5 * way)
    bias = np.median(mean[calm, 3:], axis=0)
    for a, b in true_runs(mask):
        if not around[a:b].any() and np.median(vibration[a:b]) > stop + 0.5 * way:
            mask[a:b] = False
    out = nothing
    for share, asked, least in ((0.5, slow, 1.0), (0.25, ~around, 2.0)):
        still = asked & (vibration < stop + share * way)
        still &= np.linalg.norm(mean[:, 3:] - bias, axis=1) < MAX_RATE
        for a, b in runs_between_pauses(still, imu.t, 0.5 * section.window_s):
            # half a window at both ends holds little of a motion that begins or ends there
            a, b = a + W // 2, b - W // 2
            if b - a >= 2 and imu.t[b - 1] - imu.t[a] >= least * section.min_s:
                out[a:b] = True
    _clear_moving(out, imu.t, t[fast])
    return out


def rest_times(intervals: StaticIntervals, rate_hz: float) -> FloatArray:
    """Times within intervals at rest, at a given rate from the start of each. Shape (m,). [s]"""
    if not rate_hz > 0.0:
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    parts = [np.arange(a, b + 1e-9, 1.0 / rate_hz) for a, b in zip(intervals.start, intervals.stop, strict=True)]
    return np.concatenate(parts) if parts else np.empty(0)


def zero_velocities(
    intervals: StaticIntervals,
    *,
    sigma: float = 0.02,
    rate_hz: float = 2.0,
    gate: float | None = 0.9999,
    imu: ImuSeries | None = None,
) -> MeasurementSchedule:
    """Zero-velocity updates while at rest.

    Parameters
    ----------
    intervals : StaticIntervals
        Intervals of :func:`schuler.standstill.stationarity.static_intervals`.
    sigma : float
        1-sigma velocity of the vehicle at rest, vibration included. [m/s]
    rate_hz : float
        How often. [Hz]
    gate : float, optional
        Probability with which a correct measurement passes; a detector that errs is caught here.
    imu : ImuSeries, optional
        Its vibration in each rest, taken as of :data:`_VIBRATION_HZ`, is added to ``sigma``.

    References
    ----------
    Yaman (2017), section 4.5, eqs. (4-36)-(4-39); Groves (2013), section 15.3.
    """
    if not sigma > 0.0:
        raise InputError(f"sigma: expected a positive number, got {sigma!r}")
    t = rest_times(intervals, rate_hz)
    variance = np.full(len(t), sigma**2)
    if imu is not None and len(t):
        accel = imu.rates().accel
        shaking = np.array([accel[a:b].var(axis=0).max() for a, b in intervals.index])
        at = np.clip(np.searchsorted(intervals.start, t + 1e-9) - 1, 0, len(intervals) - 1)
        variance += shaking[at] / (2.0 * np.pi * _VIBRATION_HZ) ** 2
    return MeasurementSchedule.of(ZERO_VELOCITY, t, np.zeros(len(t)), variance, gate=gate_threshold(gate, 3))


def zero_rates(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Zero-rotation updates: means of the raw angular rate over blocks at rest.

    Parameters
    ----------
    imu : ImuSeries
    intervals : StaticIntervals
        Rests of this log.
    sigma_noise : float
        Root density N of the gyroscopes: a mean over T has ``N / sqrt(T)``. [rad/s/sqrt(Hz)]
    sigma : float
        1-sigma rotation of the vehicle in the mean over a block. [rad/s]
    block_s : float
        Length of a block. [s]
    gate : float, optional
        Probability with which a correct measurement passes.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block, when a live filter has it too. Rests shorter than a block give none.

    Raises
    ------
    InputError
        If both sigmas are zero, or the intervals are of another log.

    Notes
    -----
    The noise of a block has also driven the attitude during it; that correlation, by which heading would not
    change at rest, is left out: conservative for heading, right for the biases.
    """
    t, _, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(ZERO_RATE, t, rate, sigma_noise**2 / length + sigma**2, gate=gate_threshold(gate, 3))


def gravities(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    vector: bool = False,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Gravity at rest: means of the raw specific force over blocks are as large as gravity, or are gravity.

    Parameters
    ----------
    imu, intervals, block_s, gate
        See :func:`zero_rates`.
    sigma_noise : float
        Root density N of the accelerometers. [m/s^2/sqrt(Hz)]
    sigma : float
        1-sigma acceleration of the vehicle in the mean over a block. [m/s^2]
    vector : bool
        North, east and down against the attitude; False: the magnitude only, whatever the attitude.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block. Gravity is that of the ellipsoid, which the filter navigates with.

    Notes
    -----
    **Not together with zero-velocity updates.** What the velocity gains from one update to the next is the mean
    specific force and gravity between them: these updates compare all three components of the same readings with
    gravity already. Once more, and the filter takes their noise for less than it is.

    Without them the noise of a block is in the velocity too, which satellites see. That correlation is left out; it
    costs little as long as velocities are measured with more than ``sigma_noise sqrt(block_s)``.

    References
    ----------
    Yaman (2017), eqs. (4-44)-(4-50), magnitude; (4-59)-(4-63), vector, all columns kept.
    """
    t, force, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(
        GRAVITY_VECTOR if vector else GRAVITY, t, np.hstack((force, rate)), sigma_noise**2 / length + sigma**2,
        gate=gate_threshold(gate, 3 if vector else 1),
    )  # fmt: skip


def earth_rates(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Earth rate at rest: means of the raw rate over blocks, along the measured vertical, are the Earth's.

    Parameters
    ----------
    imu, intervals, sigma_noise, sigma, block_s, gate
        See :func:`zero_rates`; ``sigma`` is the turning about the vertical.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block.

    Notes
    -----
    The vertical component of :func:`zero_rates`, **not together with them**. It needs neither attitude nor heading, and
    leaves alone what a vehicle on its springs does about the horizontal axes. The noise of a block has driven the
    heading too; that correlation is left out, as there.

    References
    ----------
    Yaman (2017), eqs. (4-51)-(4-57): there the magnitude, whose noise and Earth rate go into the g-sensitivity.
    """
    t, force, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(
        EARTH_RATE, t, np.hstack((force, rate)), sigma_noise**2 / length + sigma**2, gate=gate_threshold(gate, 1)
    )


def _blocks(
    imu: ImuSeries, intervals: StaticIntervals, block_s: float, sigma_noise: float, sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Ends of whole blocks at rest, means of specific force and rate in them, shapes (n,), (n, 3), (n, 3); length."""
    if not (block_s > 0.0 and sigma_noise >= 0.0 and sigma >= 0.0 and sigma_noise + sigma > 0.0):
        raise InputError(
            f"expected block_s > 0 and a positive sigma or sigma_noise, got {block_s!r}, {sigma!r}, {sigma_noise!r}"
        )
    if len(imu) != len(intervals.mask):
        raise InputError(
            f"imu: expected the log of {len(intervals.mask)} samples the intervals come from, got {len(imu)}"
        )
    rates = imu.rates()
    W = max(1, round(block_s * rates.rate_hz))
    first = np.array([k for a, b in intervals.index for k in range(int(a), int(b) - W + 1, W)], dtype=np.int64)
    force, rate = (
        np.array([x[k : k + W].mean(axis=0) for k in first]).reshape(-1, 3) for x in (rates.accel, rates.gyro)
    )
    return rates.t[first + W - 1], force, rate, W / rates.rate_hz
