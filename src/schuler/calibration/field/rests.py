"""Rests of a log for field calibration: what stands still, and not what turns slowly and uniformly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_vector3
from schuler.calibration.field.rest_checks import consistent, contrasts, span_of, steady
from schuler.calibration.field.rest_edges import regained
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill import detectors
from schuler.standstill.stationarity import StaticIntervals, static_intervals
from schuler.units import DEG, DEG_PER_HR_PER_G

#: Sensitivity of a cheap gyroscope to specific force, 0.1 deg/s/g (MPU-6000). [(rad/s)/(m/s^2)]
G_SENSITIVITY = 360.0 * DEG_PER_HR_PER_G
#: Tilting at rest that the other rests of a log can excuse: a support that gives way. [rad/s]
MAX_CREEP = 0.05 * DEG
#: Above any bias: the first search does not test the mean rate. [rad/s]
_ANY_RATE = 1e3
#: Blocks of the test for settling. [s]
_BLOCK_S = 0.2
#: Margins tried, and how much more time at rest the wider one must find.
_MARGINS = (3.0, 10.0)
_LONGER = 1.05


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
        If known, from a log that certainly rests: without it a log of one pose cannot be told from one that turns
        uniformly about the vertical. [rad/s]
    max_rate : float
        A mean rate that differs more than this from that of the other rests is motion, whatever else. [rad/s]
    g_sensitivity : float
        1-sigma of the elements of G_g that may make rates at rest differ from pose to pose. [(rad/s)/(m/s^2)]
    max_creep : float
        Largest rate of tilting that is excused because other rests of the log tilt as much. [rad/s]
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
    5. Edges are moved out to where the motion begins, see :func:`schuler.calibration.field.rest_edges.regained`.

    What it cannot see: the same slow rotation about the vertical in most poses (it has the form of G_g), or one in the
    only pose of the log. Most rests must be rests. ``docs/field-routine.md`` has the smallest rates refused.

    References
    ----------
    Yaman (2017), section 4.8, whose standard deviations of norms, :func:`printed_rests`, are blind to uniform rotation.
    """
    _check(min_s, limit, settle_s, g_sensitivity, max_creep)
    bias = None if gyro_bias is None else as_vector3(gyro_bias, "gyro_bias")
    notes = []
    if noise is None:
        noise = detectors.noise_at_rest(imu, window_s)
        notes.append(
            f"noise at rest estimated: specific force {_listed(noise[0])} m/s^2, rate {_listed(noise[1])} rad/s"
        )
    if min_s * imu.rate_hz < 18.0:
        raise InputError(f"min_s: {min_s:g} s are {min_s * imu.rate_hz:.1f} samples; expected 18 or more")
    best: StaticIntervals | None = None
    for factor in _MARGINS if margin is None else (margin,):
        quiet = partial(static_intervals, imu, min_s=min_s, window_s=window_s, margin=factor, noise=noise)
        found = _found(imu, quiet, bias, max_rate, g_sensitivity, max_creep, limit, min_s, settle_s)
        if best is None or found.mask.sum() > _LONGER * best.mask.sum():
            best = found
        wide = found.threshold * _MARGINS[1] / _MARGINS[0]
        if np.count_nonzero(found.statistic < wide) <= _LONGER * np.count_nonzero(found.statistic < found.threshold):
            break  # nothing to be won by it
    assert best is not None
    return replace(best, notes=(*notes, *best.notes))


def _found(
    imu: ImuSeries,
    quiet: Callable[..., StaticIntervals],
    bias: FloatArray | None,
    max_rate: float,
    g_sensitivity: float,
    max_creep: float,
    limit: float,
    min_s: float,
    settle_s: float,
) -> StaticIntervals:
    """Rests among the intervals that ``quiet`` finds around a gyro bias."""
    rates = imu.rates()
    centre = bias
    if centre is None:
        found = quiet(gyro_bias=np.zeros(3), max_rate=_ANY_RATE)
        if not len(found):
            return replace(found, method="field")
        centre = np.median(found.means(rates)[0], axis=0)
    found = quiet(gyro_bias=centre, max_rate=max_rate)
    index, notes = found.index, list(found.notes)
    if len(index):
        index, said = _settled(rates, found, min_s, limit, settle_s)
        notes += said
    if len(index):
        keep, said = steady(rates, index, found.sigma_f, max_creep=max_creep, limit=limit)
        index, notes = index[keep], notes + said
    if len(index):
        keep, centre, said = consistent(
            rates, index, found.sigma_w, bias=bias, g_sensitivity=g_sensitivity, max_rate=max_rate, limit=limit
        )
        index, notes = index[keep], notes + said
        # where the sensor still settled is not asked again
        ends = np.stack([np.isin(index[:, side], found.index[:, side]) for side in (0, 1)], axis=1)
        index = regained(rates, index, reach_s=found.window_s, limit=limit, ends=ends)
    mask = np.zeros(len(imu), dtype=bool)
    for a, b in index:
        mask[a:b] = True
    return replace(
        found, start=imu.t[index[:, 0]], stop=imu.t[index[:, 1] - 1], index=index, mask=mask, method="field",
        gyro_bias=centre, notes=tuple(notes),
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
    There is no test of the mean rate. Half a window is cut from both ends of an interval, of which the source says
    nothing.

    References
    ----------
    Yaman (2017), eqs. (4-65), (4-66).
    """
    return static_intervals(
        imu, min_s=min_s, window_s=window_s, margin=margin, noise=noise, thresholds=thresholds, method="printed",
        gyro_bias=np.zeros(3), max_rate=_ANY_RATE,
    )  # fmt: skip


def _settled(
    rates: ImuSeries, found: StaticIntervals, min_s: float, limit: float, settle_s: float
) -> tuple[IntArray, list[str]]:
    """Intervals without the blocks at their ends that are not like the middle, shape (k, 2), and what was cut."""
    x = np.concatenate((rates.accel, rates.gyro), axis=1)
    dt = rates.interval
    m = max(2, round(_BLOCK_S / dt))
    zones = np.minimum(round(settle_s / dt), np.diff(found.index, axis=1)[:, 0] // 4) // m * m
    inner = found.index + zones[:, None] * (1, -1)
    sigma = np.concatenate(
        (
            found.sigma_f * contrasts(rates.accel, inner, found.sigma_f).colour,
            found.sigma_w * contrasts(rates.gyro, inner, found.sigma_w).colour,
        )
    )
    kept, why, cut = [], [], 0
    for (a, b), zone in zip(found.index, zones, strict=True):
        middle = x[a + zone : b - zone]
        ends = (x[a : a + zone], x[b - zone : b][::-1])
        first, last = (m * _unsettled(end.reshape(-1, m, 6).mean(axis=1), middle, sigma, m, limit) for end in ends)
        if rates.t[b - last - 1] - rates.t[a + first] + dt >= min_s:
            kept.append((a + first, b - last))
            cut += first + last
        else:
            why.append(f"refused {span_of(rates, a, b)}: less than {min_s:g} s of it is settled")
    if cut:
        why.append(f"{cut * dt:.1f} s cut from the ends of rests, where the sensor still settled")
    return np.array(kept, dtype=np.int64).reshape(-1, 2), why


def _unsettled(blocks: FloatArray, middle: FloatArray, sigma: FloatArray, m: int, limit: float) -> int:
    """How many blocks of m samples from the end inwards to leave out: means of shape (j, 6), outermost first.

    Each is compared with the middle by itself, and together with all further in.
    """
    if not len(blocks):
        return 0
    off = blocks - middle.mean(axis=0)
    count = np.arange(len(blocks), 0, -1)[:, None]
    together = np.cumsum(off[::-1], axis=0)[::-1] / count
    far = np.zeros(len(blocks), dtype=bool)
    for difference, samples in ((off, m), (together, count * m)):
        far |= np.any(np.abs(difference) > limit * sigma * np.sqrt(1.0 / samples + 1.0 / len(middle)), axis=1)
    return int(np.flatnonzero(far).max(initial=-1)) + 1


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
