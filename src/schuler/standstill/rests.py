"""Rests of a log that was turned by hand: intervals at standstill, slow uniform rotation refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill import detectors
from schuler.standstill.consistency import consistent_rates, constant_direction
from schuler.standstill.edges import cut_settling, extend_edges
from schuler.standstill.stationarity import StaticIntervals, interval_mask, static_intervals
from schuler.standstill.thresholds import noise_at_rest
from schuler.units import DEG, DEG_PER_HR_PER_G

#: Sensitivity of a cheap gyroscope to specific force, 0.1 deg/s/g (MPU-6000). [(rad/s)/(m/s^2)]
G_SENSITIVITY = 360.0 * DEG_PER_HR_PER_G
#: Rate of tilting that is accepted where the other rests of the log tilt too: a support that gives way. [rad/s]
MAX_CREEP = 0.05 * DEG
#: Above any bias: the first search does not test the mean rate. [rad/s]
_ANY_RATE = 1e3
#: Margins tried, and the factor on the time at rest from which the wider one is taken.
_MARGINS = (3.0, 10.0)
_LONGER = 1.05
#: Fewest samples of a rest that is given.
_FEWEST_SAMPLES = 20


def field_rests(
    imu: ImuSeries,
    *,
    min_s: float = 2.0,
    window_s: float = 0.5,
    margin: float | None = None,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    gyro_bias: ArrayLike | None = None,
    max_rate: float = detectors.MAX_RATE,
    g_sensitivity: float = G_SENSITIVITY,
    max_creep: float = MAX_CREEP,
    limit: float = 5.0,
    settle_s: float = 1.0,
) -> StaticIntervals:
    """Find the rests of a log that was turned by hand.

    Parameters
    ----------
    imu : ImuSeries
        In SI units; raw biases and scale factors do not matter.
    min_s : float
        Shorter rests are left out. [s]
    window_s : float
        Window of the deviations. [s]
    margin : float, optional
        Factor on the threshold of the variances, see
        :func:`schuler.standstill.stationarity.static_intervals`. None: 3, or 10 if that finds a twentieth more
        time at rest, as of a sensor that is held in the hand.
    noise : (array_like, array_like), optional
        Standard deviations of a sample at rest, specific force [m/s^2] and rate [rad/s]; None: from the log.
    gyro_bias : array_like, shape (3,), optional
        From a log that certainly rests: without it a log of one pose cannot be told from one that turns uniformly
        about the vertical. [rad/s]
    max_rate : float
        A mean rate that differs more than this from that of the other rests is motion, whatever else. [rad/s]
    g_sensitivity : float
        1-sigma of the elements of G_g that may make rates at rest differ from pose to pose. [(rad/s)/(m/s^2)]
    max_creep : float
        Largest rate of tilting that is accepted because other rests of the log tilt as much. [rad/s]
    limit : float
        Standard deviations beyond which a rest is refused.
    settle_s : float
        At most so much is cut from both ends because the sensor still settles there. [s]

    Returns
    -------
    StaticIntervals
        ``gyro_bias`` is the mean rate at rest, freed from g-sensitivity; ``notes`` name what was refused, and why.

    Raises
    ------
    InputError
        If an argument is out of range, or the log is shorter than ten windows where the noise must be estimated.

    Notes
    -----
    1. Candidates are found by the standard deviation of each axis. Their mean rates are not compared with zero, since
       the bias of a cheap gyroscope is some 20 deg/s, but with their median; within ``max_rate`` of it they are
       searched for once more, so that a slow turn which begins or ends at a rest is not joined to it.
    2. Blocks of 0.2 s at both ends that differ from the middle are cut, up to ``settle_s``.
    3. A rest is refused if its specific force changes direction from the first third to the last. That contrast is
       independent of the noise, which is taken from the second difference of the three thirds over all rests, so
       noise need not be white; and if most rests of a log tilt, so may the others, up to ``max_creep``.
    4. A rest is refused if its mean rate does not follow from those of the others by ``b + G f``: the bias is the same
       in every pose and the sensitivity small, but a rotation about a fixed direction is neither. Earth rate, which
       changes with the pose, is part of the uncertainty. The fit has least absolute deviations, then least squares
       without what was refused; every rest is predicted from the others only. Rates may scatter as the median
       of them does, for biases that wander.
    5. Edges are moved out to where the motion begins, see :func:`schuler.standstill.edges.extend_edges`.

    Not detectable: the same slow rotation about the vertical in most poses (it has the form of G_g), or one in the only
    pose of the log. ``docs/field-routine.md`` has the smallest rates refused.

    References
    ----------
    Yaman (2017), section 4.8, whose standard deviations of norms, :func:`printed_rests`, are blind to uniform rotation.
    """
    _check(min_s, limit, settle_s, g_sensitivity, max_creep)
    bias = None if gyro_bias is None else as_vector3(gyro_bias, "gyro_bias")
    notes = []
    if noise is None:
        noise = noise_at_rest(imu, window_s)
        notes.append(
            f"noise at rest estimated: specific force {_listed(noise[0])} m/s^2, rate {_listed(noise[1])} rad/s"
        )
    if min_s * imu.rate_hz < 18.0:
        raise InputError(f"min_s: {min_s:g} s are {min_s * imu.rate_hz:.1f} samples; expected 18 or more")
    limits = _Limits(max_rate, g_sensitivity, max_creep, limit, min_s, settle_s)
    best: StaticIntervals | None = None
    for factor in _MARGINS if margin is None else (margin,):
        search = partial(static_intervals, imu, min_s=min_s, window_s=window_s, margin=factor, noise=noise)
        rests = _checked_rests(imu, search, bias, limits)
        if best is None or rests.mask.sum() > _LONGER * best.mask.sum():
            best = rests
        wide = rests.threshold * _MARGINS[1] / _MARGINS[0]
        if np.count_nonzero(rests.statistic < wide) <= _LONGER * np.count_nonzero(rests.statistic < rests.threshold):
            break  # the wider margin can gain nothing
    assert best is not None
    return replace(best, notes=(*notes, *best.notes))


class _Limits(NamedTuple):
    """Limits of the checks, see :func:`field_rests`."""

    max_rate: float
    g_sensitivity: float
    max_creep: float
    limit: float
    min_s: float
    settle_s: float


def _checked_rests(
    imu: ImuSeries, search: Callable[..., StaticIntervals], bias: FloatArray | None, limits: _Limits
) -> StaticIntervals:
    """Rests among the intervals that ``search`` gives around a gyro bias: settled, not tilting, of consistent rate."""
    rates = imu.rates()
    centre = bias
    if centre is None:
        candidates = search(gyro_bias=np.zeros(3), max_rate=_ANY_RATE)
        if not len(candidates):
            return replace(candidates, method="field")
        centre = np.median(candidates.means(rates)[0], axis=0)
    candidates = search(gyro_bias=centre, max_rate=limits.max_rate)
    index, notes, limit = candidates.index, list(candidates.notes), limits.limit
    if len(index):
        index, reasons = cut_settling(rates, candidates, limits.min_s, limit, limits.settle_s)
        notes += reasons
    if len(index):
        keep, reasons = constant_direction(rates, index, candidates.sigma_f, max_creep=limits.max_creep, limit=limit)
        index, notes = index[keep], notes + reasons
    if len(index):
        keep, centre, reasons = consistent_rates(
            rates, index, candidates.sigma_w, bias=bias, g_sensitivity=limits.g_sensitivity,
            max_rate=limits.max_rate, limit=limit,
        )  # fmt: skip
        index, notes = index[keep], notes + reasons
        # ends where the sensor still settled stay cut
        ends = np.stack([np.isin(index[:, side], candidates.index[:, side]) for side in (0, 1)], axis=1)
        index = extend_edges(rates, index, reach_s=candidates.window_s, limit=limit, ends=ends)
    return replace(
        candidates, start=imu.t[index[:, 0]], stop=imu.t[index[:, 1] - 1], index=index,
        mask=interval_mask(index, len(imu)), method="field", gyro_bias=centre, notes=tuple(notes),
    )  # fmt: skip


def printed_rests(
    imu: ImuSeries,
    *,
    thresholds: tuple[float, float] | None = None,
    min_s: float = 2.0,
    window_s: float = 0.5,
    margin: float = 3.0,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
) -> StaticIntervals:
    """Rests by the detector of the thesis as printed, for comparison: uniform rotation about any axis passes.

    Parameters
    ----------
    imu : ImuSeries
    thresholds : (float, float), optional
        Standard deviations allowed, of the norms of specific force [m/s^2] and rate [rad/s]; None: from the noise.
    min_s, window_s, margin, noise
        As in :func:`field_rests`.

    Returns
    -------
    StaticIntervals

    Notes
    -----
    There is no test of the mean rate. Half a window is cut from both ends of an interval, which the thesis does not
    mention.

    References
    ----------
    Yaman (2017), eqs. (4-65), (4-66).
    """
    return static_intervals(
        imu, min_s=min_s, window_s=window_s, margin=margin, noise=noise, thresholds=thresholds, method="printed",
        gyro_bias=np.zeros(3), max_rate=_ANY_RATE,
    )  # fmt: skip


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
        As given: nothing is tested or cut, noise is zero. ``gyro_bias`` is the median of the mean rates.

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
        if b - a < _FEWEST_SAMPLES:
            raise InputError(
                f"spans: expected {_FEWEST_SAMPLES} samples or more in {start:.2f}..{stop:.2f} s, got {max(b - a, 0)}; "
                f"the log covers {imu.t[0]:.2f}..{imu.t[-1]:.2f} s"
            )
    if np.any(first[1:] < last[:-1]):
        k = int(np.flatnonzero(first[1:] < last[:-1])[0])
        raise InputError(f"spans: expected rests one after the other, but {pairs[k]} and {pairs[k + 1]} s overlap")
    index = np.stack((first, last), axis=1)
    gyro = imu.rates().gyro
    zero = np.zeros(3)
    return StaticIntervals(
        imu.t[first], imu.t[last - 1], index, interval_mask(index, len(imu)), np.zeros(len(imu)), 0.0, "given", 0.0,
        zero, zero,
        np.median([gyro[a:b].mean(axis=0) for a, b in index], axis=0), ("rests as given",),
    )  # fmt: skip


def _check(min_s: float, limit: float, settle_s: float, g_sensitivity: float, max_creep: float) -> None:
    if not limit >= 1.0:
        raise InputError(f"limit: expected 1 standard deviation or more, got {limit}")
    for name, value in (("settle_s", settle_s), ("g_sensitivity", g_sensitivity), ("max_creep", max_creep)):
        if not (np.isfinite(value) and value >= 0.0):
            raise InputError(f"{name}: expected zero or a positive number, got {value}")
    if not (np.isfinite(min_s) and min_s > 0.0):
        raise InputError(f"min_s: expected a positive time, got {min_s} s")


def _listed(x: ArrayLike) -> str:
    return ", ".join(f"{v:.2g}" for v in np.atleast_1d(x))
