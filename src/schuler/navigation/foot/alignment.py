"""Start and alignment of a walk: levelled over its first rest, gyro biases from its mean rate, heading as given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import earth, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import levelling
from schuler.mechanization.strapdown import NavState
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.start.rest_bias import with_bias
from schuler.recording.series import ImuSeries, Increments
from schuler.standstill.intervals import Rests

_SWAY_S = 0.1  # a foot that stands sways for about as long in one direction
_STILL, _MOST_OF_GRAVITY = 0.04, 0.25  # of gravity: missed by no foot that stands, and by more than a stance of a run
_EARLY_S = 3.0  # a few strides; rests that are long enough are not waited for any longer
_LEVELLED = 0.15  # of gravity: acceleration of a stance that can still be levelled over
_LEAST_BLOCKS = 4  # of that length, for a scatter
_MOST_OF_BIAS = 4.0  # 1 sigmas of the biases believed in and of sway


def walk_start(
    imu: ImuSeries, rests: Rests, increments: Increments, config: FootConfig, gravity: float, notes: list[str]
) -> float:
    """Start of the first rest that is long enough, at the beginning of an interval. [s]

    A log that begins in a run has but stances: where a long rest comes late, an early stance is taken that levels best.

    Parameters
    ----------
    imu : ImuSeries
        Rates.
    rests : Rests
    increments : Increments
        Of the same samples.
    config : FootConfig
    gravity : float
        [m/s^2]
    notes : list of str
        Gets a sentence if the log does not begin with that rest.

    Raises
    ------
    InputError
        If the foot does not rest.
    """
    long = np.flatnonzero(rests.stop - rests.start >= config.alignment.min_rest_s - 1e-9)
    early = np.flatnonzero((rests.start <= increments.start + _EARLY_S) & (np.diff(rests.index)[:, 0] > 2))
    if len(early) and not (len(long) and long[0] <= early[-1]):
        sigmas = [acceleration_sigma(imu.between(*rests.t[rests.index[k] - [0, 1]]), config, gravity) for k in early]
        if min(sigmas) < _LEVELLED * gravity:
            long = early[[int(np.argmin(sigmas))]]
    if not len(long):
        raise InputError(
            f"the foot never rests for {config.alignment.min_rest_s} s ({len(rests)} shorter rests; {rests.method}): "
            "check units and axes, raise the threshold, or give rest="
        )
    if rests.index[long[0], 0] == 0:
        return increments.start
    start = float(rests.start[long[0]])
    begin = float(increments.t[np.searchsorted(increments.t, start - 1e-9)])
    notes.append(f"the foot first rests {begin - increments.start:.2f} s into the log; navigation starts there")
    return begin


def align_foot(
    imu: ImuSeries,
    rests: Rests,
    begin: float,
    llh: FloatArray,
    layout: StateLayout,
    config: FootConfig,
    notes: list[str],
) -> InitialState:
    """Initial state: levelled over the first rest, heading as given, at rest in the origin.

    Parameters
    ----------
    imu : ImuSeries
    rests : Rests
        The first one begins at ``begin`` or before.
    begin : float
        Where navigation starts. [s]
    llh : ndarray, shape (3,)
        Place of the start. [rad], [m]
    layout, config
        Layout and configuration of the run.
    notes : list of str
        Gets a sentence on what was done.

    Returns
    -------
    InitialState
        Tilt and accelerometer biases correlated as levelling makes them; gyro biases, where they are states, from what
        the configuration allows and the mean rate of the rest, whose sway is in its sigma.
    """
    section = config.alignment
    first = int(np.flatnonzero(rests.stop > begin)[0])
    end = min(float(rests.stop[first]), begin + section.rest_s)
    still = imu.rates().between(begin, end)
    force, moving = still.accel.mean(axis=0), 0.0
    gravity = float(np.linalg.norm(earth.gravity_ned(llh[0], llh[2])))
    brief = rests.stop[first] - rests.start[first] < section.min_rest_s - 1e-9
    off = abs(np.linalg.norm(force) / gravity - 1.0)
    if brief or _STILL < off < _MOST_OF_GRAVITY:  # a stance of a run: direction alone counts
        moving = acceleration_sigma(still, config, gravity)
        force = force * gravity / np.linalg.norm(force)
    level = levelling(
        force, t=begin, sigma_bias=config.sensor.accel_bias_m_s2,
        sigma_noise=float(np.hypot(section.tilt_sigma_deg * units.DEG * np.linalg.norm(force), moving)),
    ).with_heading(section.heading_deg * units.DEG, section.heading_sigma_deg * units.DEG, "heading given")  # fmt: skip
    if config.filter.states == 9:  # no bias in the filter: its tilt is part of the noise of levelling
        level = replace(level, sigma_b_a=0.0)
    nav = NavState.from_geodetic(begin, llh, np.zeros(3), level.rpy_nb)
    notes.append(
        f"levelled over {end - begin:.2f} s at rest: roll {level.rpy_nb[0] / units.DEG:.2f}, "
        f"pitch {level.rpy_nb[1] / units.DEG:.2f} deg; heading {section.heading_deg:g} deg as given"
    )
    # the IMU of a foot that stands may move as fast as the filter believes of any rest
    initial = InitialState.from_sigmas(
        nav, layout, attitude=np.zeros(3), velocity=np.full(3, config.zupt.sigma_m_s),
        position=np.full(3, config.filter.position_sigma_m),
    ).aligned(level, layout)  # fmt: skip
    return _with_rest_rate(initial, imu, rests, still, layout, config) if "b_g" in layout else initial


def acceleration_sigma(still: ImuSeries, config: FootConfig, gravity: float) -> float:
    """1-sigma of the mean acceleration of a foot over one of its rests. [m/s^2]

    Parameters
    ----------
    still : ImuSeries
        The samples at rest.
    config : FootConfig
        How fast a resting foot may be, and how large accelerometer biases are.
    gravity : float
        [m/s^2]

    Returns
    -------
    float
        The change of velocity over the length of the rest, and what the magnitude of the mean specific force misses
        gravity by beyond a bias.
    """
    rate_squared = float(np.mean(np.sum(still.gyro**2, axis=1)))
    speed = np.hypot(config.zupt.sigma_m_s, config.zupt.roll_m * np.sqrt(rate_squared))
    changing = np.sqrt(2.0) * speed / (still.t[-1] - still.t[0] + still.interval)
    missing = (np.linalg.norm(still.accel.mean(axis=0)) - gravity) ** 2 - config.sensor.accel_bias_m_s2**2
    return float(np.sqrt(changing**2 + max(missing, 0.0)))


def _with_rest_rate(
    initial: InitialState, imu: ImuSeries, rests: Rests, still: ImuSeries, layout: StateLayout, config: FootConfig
) -> InitialState:
    """Initial state with gyro biases as configured and the mean rate of a rest, which is the bias but for sway.

    The first rest, ``still``, or the longest of the log where that is brief. A brief one that contradicts the biases
    believed in is the stance of a walk, which rolls on at 1 to 10 deg/s; a long one counts alone then. Earth rate is a
    tenth of the sway of the stillest foot.
    """
    long_s = config.alignment.rest_s - 2.0 * imu.interval
    k = int(np.argmax(rests.stop - rests.start))
    if still.t[-1] - still.t[0] < min(long_s, rests.stop[k] - rests.start[k] - imu.interval):
        still = imu.rates().between(float(rests.start[k]), float(rests.stop[k]))
    block = max(round(_SWAY_S / still.interval), 1)
    count = len(still) // block
    if count < _LEAST_BLOCKS:
        return initial
    means = still.gyro[: count * block].reshape(count, block, 3).mean(axis=1)
    sway, rate = float(np.sqrt(means.var(axis=0, ddof=1).mean() / count)), means.mean(axis=0)
    sigma = config.sensor.gyro_bias_deg_s * units.DEG
    if still.t[-1] - still.t[0] < long_s:
        sway = max(sway, float(np.linalg.norm(rate)) / 3.0)
    elif float(np.abs(rate).max()) > _MOST_OF_BIAS * np.hypot(sigma, sway):
        return with_bias(initial, layout, rate, sway)
    gain = sigma**2 / (sigma**2 + sway**2)
    return with_bias(initial, layout, gain * rate, float(np.sqrt(gain)) * sway)
